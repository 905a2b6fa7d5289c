//! Tilings: one cell over all elements of a scaffold, as a distance field in world space.
//!
//! In element `e` with map `x = M_e(xi)` the tiled field is `F(x) = Phi(M_e^-1(x))`: continuous over
//! shared faces whatever the elements' numbering, because the cell has the full symmetry of its
//! element; its gradient is not. [`TiledSolid`] turns F into distances:
//!
//! - **Fast** (rule Q, the default). Every element near `x` measures by two
//!   Newton steps *with its own field*, continued beyond its faces, how far the zero set is:
//!   `s_e = |x - p2| / |F_e(x)|`. Then `d = F sum w_e s_e / sum w_e` with weights that fade within
//!   one voxel of the shared faces: the positive scale is blended, so that d is continuous
//!   and its zero set is exactly that of F.
//! - **Exact** (rule R). The closest of the zero points found in each cell, on each face and on each
//!   edge within the band, never more than rule Q: the distance to the zero set where the searches
//!   converge.
//!
//! **The scaffold's boundary.** With D the signed distance to the scaffold's outer faces the solid is
//! `max(d, D)`; outside, d takes its value at the closest point of the scaffold, so that dilating a
//! block of void cells creates no solid. [`Boundary::Extend`] drops D: something else, an
//! envelope, ends the part. Components of the scaffold that are not joined by faces are each
//! treated so by themselves and united by the minimum, so that overlaps depend on no order.
//!
//! Values are world distances clamped to `[-w, w]`; phi < 0 inside. All points are `f64`; what the
//! cell's table rounds to `f32` it rounds alike in all elements.

use crate::cell::Table;
use crate::field::{Field, Interval, LeafParts, Leaves, SampleLattice, signs_of_values};
use crate::frame::{Aabb, CellPoint, Vec3, WorldPoint};
use crate::mesh::MeshSolid;
use crate::scaffold::Scaffold;

mod affine;
mod axis_aligned;
mod blend;
mod bound;
mod boundary;
mod boundary_distance;
mod certificate;
mod clamp;
mod control_lattice;
mod corners;
mod curved;
mod distance_scale;
mod distribution;
mod error;
mod exact;
mod fill;
mod interface;
mod interpolated;
mod inverse_map;
mod local_map;
mod locality;
mod newton_distance;
mod patch;
mod source;
mod transition_connectivity;
mod transition_levels;
mod visits;

pub use blend::{Blend, Member};
pub use certificate::{Certificate, FaceStatistics, Seam, certify};
pub use distribution::{Graded, Interpolation, Weights};
pub use error::TilingError;
pub(crate) use interface::Ways;
pub use source::{CellField, Filling, fills};
pub use transition_connectivity::{PathCheck, check_path};
pub use visits::Visits;

use affine::Wanted;
use bound::Together;
use boundary::Known;
use locality::Local;
use patch::{Patch, Search};
use source::Held;

/// How distances are measured across element faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distance {
    /// Two Newton steps, blended over faces.
    #[default]
    Fast,
    /// Closest points, several times the time.
    Exact,
}

/// What the scaffold's outer faces do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boundary {
    /// They end the solid.
    #[default]
    Cut,
    /// The field goes on beyond them, constant along the way to the closest point.
    Extend,
}

/// How a tiling finds its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// From sines and cosines tabulated along the axes of a box of equal hexes.
    Products,
    /// By look-ups in the cells' tables, through the elements' maps.
    Tables,
}

/// Parameters of a [`TiledSolid`].
#[derive(Clone, Copy, Debug)]
pub struct TilingOptions {
    /// Voxel size, world units: the scale of blending and of what may be neglected.
    pub voxel_size: f64,
    /// Half width w of the band, world units: values are clamped to it.
    pub half_width: f64,
    /// How distances are measured.
    pub distance: Distance,
    /// What the scaffold's outer faces do.
    pub boundary: Boundary,
}

/// A set of elements joined by faces.
struct Component {
    boundary: MeshSolid,
}

/// What [`TiledSolid::sample`] finds at a point of the scaffold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Value of the cell's field: negative inside.
    pub phi: f64,
    /// Gradient of that value in world space.
    pub gradient: Vec3,
    /// The tiling's distance, world units, clamped to the band.
    pub distance: f64,
    /// Number of the element; the lowest if several share the point.
    pub element: usize,
    /// Reference coordinates in that element.
    pub reference: CellPoint<3>,
}

/// A cell over all elements of a scaffold, as a field of signed distances.
pub struct TiledSolid<'a, F: Filling = Table> {
    scaffold: &'a Scaffold,
    filling: Held<'a, F>,
    options: TilingOptions,
    patches: Vec<Patch>,
    /// The largest of their slope bounds L near the surface.
    steepest: f64,
    component_of: Vec<u32>,
    components: Vec<Component>,
    /// The whole as one function over a box, where it is one.
    aligned: Option<axis_aligned::Aligned>,
    /// How far leaves told by nodes may displace the surface, world units, if they may at all.
    nodes: Option<f64>,
    /// Where the elements are noted that bulk evaluation comes near.
    visits: Option<&'a Visits>,
}

/// Chordal error of the boundary's triangles on curved faces, in voxels.
const CHORD: f64 = 0.05;

impl<'a, F: Filling> TiledSolid<'a, F> {
    /// Prepares the tiling: slopes of every element, boundary of every component.
    ///
    /// # Errors
    /// See [`TilingError`].
    pub fn new(
        scaffold: &'a Scaffold,
        filling: &'a F,
        options: TilingOptions,
    ) -> Result<Self, TilingError> {
        Self::holding(scaffold, Held::Borrowed(filling), options)
    }

    /// As [`Self::new`], of a filling that the tiling keeps.
    ///
    /// # Errors
    /// See [`TilingError`].
    pub fn owning(
        scaffold: &'a Scaffold,
        filling: F,
        options: TilingOptions,
    ) -> Result<Self, TilingError> {
        Self::holding(scaffold, Held::Owned(Box::new(filling)), options)
    }

    fn holding(
        scaffold: &'a Scaffold,
        filling: Held<'a, F>,
        options: TilingOptions,
    ) -> Result<Self, TilingError> {
        for (what, value) in [
            ("voxel size", options.voxel_size),
            ("half width of the band", options.half_width),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(TilingError::Length { what, value });
            }
        }
        if scaffold.is_empty() {
            return Err(TilingError::Empty);
        }
        filling.check(scaffold)?;
        let patches: Vec<Patch> = (0..scaffold.len())
            .map(|number| Patch::new(scaffold, &*filling, number, locality::near_surface(options)))
            .collect();
        let mut component_of = vec![0; scaffold.len()];
        let mut components = Vec::new();
        for (number, elements) in scaffold.components().iter().enumerate() {
            for &e in elements {
                component_of[e as usize] = number as u32;
            }
            let outer = scaffold.boundary(number, CHORD * options.voxel_size);
            components.push(Component {
                boundary: MeshSolid::new(outer.mesh),
            });
        }
        let aligned = filling
            .products()
            .and_then(|products| axis_aligned::Aligned::new(scaffold, products, &patches, options));
        let steepest = patches.iter().map(|p| p.slope_sup).fold(0.0, f64::max);
        Ok(Self {
            scaffold,
            filling,
            options,
            steepest,
            patches,
            component_of,
            components,
            aligned,
            nodes: None,
            visits: None,
        })
    }

    /// Notes from now on which elements bulk evaluation comes near. Of a box evaluated as one
    /// function the set holds as many elements, not the same.
    #[must_use]
    pub fn noting(self, visits: &'a Visits) -> Self {
        Self {
            visits: Some(visits),
            ..self
        }
    }

    /// From now on whole leaves that lie within one element are told by the field at a few nodes, where that
    /// displaces the surface by at most so much, world units. Single points are not, nor other lattices.
    #[must_use]
    pub fn by_nodes(self, most: f64) -> Self {
        Self {
            nodes: Some(most).filter(|m| *m > 0.0),
            ..self
        }
    }

    /// How values are found: products only where they are within 0.0025 voxel of the rule's distances.
    pub fn kernel(&self) -> Kernel {
        match self.aligned {
            Some(_) => Kernel::Products,
            None => Kernel::Tables,
        }
    }

    /// Number of the scaffold's components: sets of elements joined by faces.
    pub fn component_count(&self) -> usize {
        self.components.len()
    }

    /// Number of pairs of components that overlap: an element's centre of one lies inside the other.
    pub fn overlap_count(&self) -> usize {
        let mut pairs = std::collections::BTreeSet::new();
        let mut found = Vec::new();
        if self.components.len() < 2 {
            return 0;
        }
        for (number, patch) in self.patches.iter().enumerate() {
            let own = self.component_of[number];
            let centre = patch.point(self.scaffold, Vec3::zeros());
            found.clear();
            let here = Aabb {
                min: centre,
                max: centre,
            };
            self.scaffold.candidates(&here, &mut found);
            for &other in &found {
                let theirs = self.component_of[other as usize];
                let inside = || {
                    self.patches[other as usize]
                        .spot(self.scaffold, centre, 0.0, Search::default())
                        .is_some_and(|s| s.beyond <= 0.0)
                };
                if theirs != own && inside() {
                    pairs.insert((own.min(theirs), own.max(theirs)));
                }
            }
        }
        pairs.len()
    }

    /// The box around the scaffold's elements, world units.
    pub fn bounds(&self) -> Aabb {
        self.components
            .iter()
            .fold(Aabb::EMPTY, |b, c| b.union(c.boundary.bounds()))
    }

    /// The tiled field at a point: value, gradient, distance and where in which element the point
    /// lies. `None` outside the scaffold.
    pub fn sample(&self, p: WorldPoint) -> Option<Sample> {
        let (element, reference) = self.scaffold.locate(p)?;
        let element = element as usize;
        let spot = self.patches[element].spot_anyway(self.scaffold, p.0);
        let (phi, slope) = self.filling.value_and_gradient(element, reference);
        Some(Sample {
            phi,
            gradient: spot.inverse.transpose() * slope,
            distance: self.value(p),
            element,
            reference,
        })
    }

    /// The distance field of one component at a point.
    fn component_value(&self, component: usize, x: Vec3) -> f64 {
        let boundary = &self.components[component].boundary;
        let w = self.options.half_width;
        if self.is_cut() && !boundary.bounds().dilated(w).contains(WorldPoint(x)) {
            return w;
        }
        let here = Aabb { min: x, max: x };
        let mut local = Local::new(self.near(component, &here, self.margin()));
        if self.owner(&mut local, x).is_none() {
            // The value is taken at the closest point of the boundary.
            let q = boundary.closest(x).point;
            let wide = here
                .union(Aabb { min: q, max: q })
                .dilated(self.chord_slack());
            local = Local::new(self.near(component, &wide, self.margin()));
        }
        self.value_at(component, &mut local, x, Known::NOTHING)
    }

    /// Which components give the value at `x`, when their boundaries do not cut: those that
    /// contain it, or the nearest.
    fn governing(&self, x: Vec3) -> Vec<usize> {
        if self.components.len() == 1 {
            return vec![0];
        }
        let outside: Vec<f64> = self
            .components
            .iter()
            .map(|c| c.boundary.signed_distance(x).max(0.0))
            .collect();
        let least = outside.iter().copied().fold(f64::INFINITY, f64::min);
        (0..outside.len())
            .filter(|&n| outside[n] <= least)
            .collect()
    }
}

impl<F: Filling> Field for TiledSolid<'_, F> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        if let Some(aligned) = &self.aligned {
            return aligned.value(p.0);
        }
        let governing = match self.options.boundary {
            Boundary::Cut => (0..self.components.len()).collect(),
            Boundary::Extend => self.governing(p.0),
        };
        governing
            .into_iter()
            .map(|c| self.component_value(c, p.0))
            .fold(self.options.half_width, f64::min)
    }

    /// The gradient is a central difference over 1/1000 voxel; less where that straddles a kink.
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let here = self.value(p);
        let gradient = Vec3::from_fn(|axis, _| {
            let slopes = |h: f64| {
                let at = |s: f64| self.value(WorldPoint(p.0 + Vec3::ith(axis, s)));
                [(at(h) - here) / h, (here - at(-h)) / h]
            };
            let mut best = [0.0; 2];
            for fraction in [1e-3, 1e-4, 1e-5] {
                best = slopes(fraction * self.options.voxel_size);
                if (best[0] - best[1]).abs() < 1e-3 {
                    break;
                }
            }
            f64::midpoint(best[0], best[1])
        });
        (here, gradient)
    }

    fn bound(&self, region: &Aabb) -> Interval {
        match &self.aligned {
            Some(aligned) => aligned.bound(region),
            None => self.bound_of_all(region),
        }
    }

    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[Interval; 8]> {
        Some(match &self.aligned {
            Some(aligned) => aligned.bounds(regions),
            None => self.bounds_of_all(&regions.into()),
        })
    }

    fn leaf_bound(&self, parts: &LeafParts<Aabb>, near: f64) -> Interval {
        let all = match &self.aligned {
            Some(aligned) => aligned.bounds(&parts.wide),
            None => self.bounds_of_all(&Together::leaf(parts, near)),
        };
        all[1..].iter().fold(all[0], |a, &b| a.hull(b))
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }

    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        match &self.aligned {
            Some(aligned) => {
                if let Some(visits) = self.visits {
                    aligned.note(&lattice.span().dilated(self.delta()), visits);
                }
                aligned.fill(lattice, out);
                lattice.len() as u64
            }
            None => self.fill_all((lattice, Wanted::Distances), out).0,
        }
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let Some(aligned) = &self.aligned else {
            return self.fill_each(leaves);
        };
        if let Some(visits) = self.visits {
            aligned.note_leaves(leaves, self.delta(), visits);
        }
        aligned.fill_leaves(leaves)
    }

    fn sides(&self, first: WorldPoint, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        let aligned = self.aligned.as_ref()?;
        Some(aligned.sides(first.0, step, band))
    }

    fn signs(&self, lattice: &SampleLattice<WorldPoint>, rows: &mut [u64]) -> u64 {
        match &self.aligned {
            Some(aligned) if aligned.signs(lattice, rows) => lattice.len() as u64,
            Some(_) => signs_of_values(self, lattice, rows),
            None => self.fill_signs(lattice, rows),
        }
    }
}
