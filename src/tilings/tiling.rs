//! Tilings: one cell over all elements of a scaffold, as a signed distance field in world space.
//!
//! [`TiledSolid`] states the field and its distance rules Q and R. Four evaluators compute values; the
//! first row that applies is used. [`TiledSolid::new`] decides on the first, `fill` on the others. Not promised: rule
//! Q is no exact distance off the surface, and where elements meet the surface may have a crease.
//!
//! | module | elements | conditions | method |
//! |---|---|---|---|
//! | `axis_aligned` | a box of equal hexes along the axes | rule Q, a cell that is a short trigonometric series, a narrow band | products of tabulated sines and cosines |
//! | `interpolated` | one element over a leaf of 8^3 samples | a tolerance for it, rule Q, more than w inside the boundary, at most 0.7 waves of the cell over the leaf | polynomials through 4^3 or 6^3 nodes |
//! | `batched` | at most 1,024 elements near 4^3 samples | rule Q | 64 samples at a time, Newton's method for curved maps |
//! | `distance_scale`, `exact` | any | single points, rule R, several components without a cut, more elements | point by point |
//!
//! ```
//! # mod druse { pub use druse_cells::*; pub use druse_geometry::*; pub use druse_tilings::*; }
//! use druse::cell::{Surface, Table};
//! use druse::field::Field;
//! use druse::frame::{Element, Vec3, WorldPoint};
//! use druse::scaffold::{Kind, Scaffold};
//! use druse::tiling::{TiledSolid, TilingOptions};
//! let table = Table::new(&Surface::SchwarzP.cell(Element::Hex).unwrap()).unwrap();
//! let cubes = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
//! let solid = TiledSolid::new(&cubes, &table, TilingOptions::new(0.05)).unwrap();
//! let on_diagonal = |s| solid.value(WorldPoint(Vec3::repeat(s)));
//! // The diagonal of a cube meets the surface at a right angle halfway from the centre to the corner.
//! assert!(on_diagonal(0.75).abs() < 1e-4);
//! assert!((on_diagonal(0.71) - 0.04 * 3f64.sqrt()).abs() < 0.06 * 0.05);
//! ```

use crate::scaffold::Scaffold;
use druse_geometry::field::{
    Field, Interval, LeafParts, Leaves, SampleLattice, ValueLimits, signs_of_values,
};
use druse_geometry::frame::{Aabb, CellPoint, Vec3, WorldPoint};
use druse_geometry::mesh::MeshSolid;

mod axis_aligned;
mod batched;
mod blend;
mod bound;
mod boundary;
mod boundary_distance;
mod certificate;
mod clamp;
mod control_lattice;
mod corners;
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
mod misfit;
mod mixture;
mod newton_distance;
mod orient;
mod patch;
mod source;
mod transition_connectivity;
mod transition_levels;
mod visits;

pub use blend::{Blend, Member};
pub use certificate::{Certificate, Discontinuity, FaceStatistics, certify};
pub use distribution::{Graded, Interpolation, Weights};
pub use error::TilingError;
#[doc(hidden)]
pub use interface::FaceJoins;
pub use misfit::{BadEdge, Misfit};
pub use mixture::{Layer, MixedTurn, Mixture};
pub use orient::{Aim, Directions, Mismatch, Oriented, orient};
pub use source::{CellField, Filling, fills};
#[doc(hidden)]
pub use transition_connectivity::{TransitionCheck, check_transition};
pub use visits::Visits;

use bound::RegionGroup;
use boundary::RegionFacts;
use fill::FillRequest;
use locality::LocalSearch;
use patch::Patch;
use source::FillingRef;

/// The distance rule, see [`TiledSolid`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distance {
    /// Rule Q: two Newton steps, blended over faces.
    #[default]
    Fast,
    /// Rule R: closest points, at several times the cost.
    Exact,
}

/// The treatment of the scaffold's outer faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boundary {
    /// The solid ends at them.
    #[default]
    Cut,
    /// The field continues beyond them with its value at the closest point of the scaffold.
    Extend,
}

/// The evaluator of a tiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// Products of sines and cosines, tabulated along the axes of a box of equal hexes.
    Products,
    /// Look-ups in the cells' tables, through the elements' inverse maps.
    Tables,
}

/// Parameters of a [`TiledSolid`].
#[derive(Clone, Copy, Debug)]
pub struct TilingOptions {
    /// Voxel size, world units: the length over which faces are blended, and the scale of tolerances.
    pub voxel_size: f64,
    /// Half width w of the band, world units: values are clamped to it.
    pub half_width: f64,
    /// The distance rule.
    pub distance: Distance,
    /// The treatment of the scaffold's outer faces.
    pub boundary: Boundary,
}

impl TilingOptions {
    /// A band of 3 voxels on each side, fast distances, and outer faces that end the solid.
    pub fn new(voxel_size: f64) -> Self {
        Self {
            voxel_size,
            half_width: 3.0 * voxel_size,
            distance: Distance::default(),
            boundary: Boundary::default(),
        }
    }
}

/// A set of elements joined by faces.
struct Component {
    boundary: MeshSolid,
}

/// Value, gradient and position at a point of the scaffold, see [`TiledSolid::sample`].
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
///
/// In element `e` with map `x = M_e(xi)` the tiled field is `F(x) = Phi(M_e^-1(x))`. F is continuous over
/// shared faces whatever the elements' numbering, because the cell has the full symmetry of its element.
/// Its gradient is not. Two rules turn F into distances:
///
/// - **Rule Q** ([`Distance::Fast`], the default). Each element near `x` estimates the distance to the zero
///   set by two Newton steps with its own field, continued beyond its faces, which end at p2:
///   `s_e = |x - p2| / |F_e(x)|`.
///   Then `d = F sum w_e s_e / sum w_e`, with weights that fall to zero within one voxel of the shared
///   faces. Only the positive scale is blended: d is continuous, and its zero set is that of F.
/// - **Rule R** ([`Distance::Exact`]). The distance to the closest of the zero points found in each cell, on
///   each face and on each edge within the band, and at most that of rule Q. It is the distance to the zero
///   set where the searches converge.
///
/// **Boundary.** With D the signed distance to the scaffold's outer faces, the solid is `max(d, D)`.
/// Outside, d takes its value at the closest point of the scaffold, so that dilating a block of void cells
/// creates no solid. [`Boundary::Extend`] drops D, for parts that end at another surface. Components of the
/// scaffold that share no faces are evaluated separately and united by the minimum, so that their order
/// does not matter where they overlap.
///
/// Values are world distances clamped to `[-w, w]`, negative inside. Points are `f64`; the cell's table
/// rounds to `f32` in the same way in all elements.
pub struct TiledSolid<'a> {
    scaffold: &'a Scaffold,
    filling: FillingRef<'a>,
    options: TilingOptions,
    patches: Vec<Patch>,
    /// The largest slope bound L of the elements, near the surface.
    max_slope_sup: f64,
    component_of: Vec<u32>,
    components: Vec<Component>,
    /// The whole tiling as one periodic function over a box, where it is one.
    hex_grid: Option<axis_aligned::HexGrid>,
    /// The displacement of the surface, world units, that interpolated leaves may cause; none: no interpolation.
    interpolation_tolerance: Option<f64>,
    /// Records the elements near the samples of bulk evaluation.
    visits: Option<&'a Visits>,
}

/// Chordal error of the boundary's triangles on curved faces, in voxels.
const CHORD_TOLERANCE: f64 = 0.05;

impl<'a> TiledSolid<'a> {
    /// Prepares the tiling: slopes of every element, boundary of every component.
    ///
    /// # Errors
    /// [`TilingError::Length`] for a voxel size or a half width that is not positive, [`TilingError::Empty`], and as
    /// [`Filling::check`].
    pub fn new(
        scaffold: &'a Scaffold,
        filling: &'a dyn Filling,
        options: TilingOptions,
    ) -> Result<Self, TilingError> {
        Self::from_ref(scaffold, FillingRef::Borrowed(filling), options)
    }

    /// As [`Self::new`], with a filling that the tiling owns.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_owned_filling(
        scaffold: &'a Scaffold,
        filling: impl Filling + 'a,
        options: TilingOptions,
    ) -> Result<Self, TilingError> {
        Self::from_ref(scaffold, FillingRef::Owned(Box::new(filling)), options)
    }

    /// Prepares each element and the boundary of each component, and finds the kernel that fits. At level debug the
    /// log names the kernel that was chosen.
    fn from_ref(
        scaffold: &'a Scaffold,
        filling: FillingRef<'a>,
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
        // Slope bounds and inverse maps of each element.
        let patches: Vec<Patch> = (0..scaffold.len())
            .map(|number| {
                Patch::new(
                    scaffold,
                    &*filling,
                    number,
                    locality::near_surface_distance(options),
                )
            })
            .collect();
        // Each component has its own boundary: a mesh within `CHORD_TOLERANCE` voxels of its outer faces.
        let mut component_of = vec![0; scaffold.len()];
        let mut components = Vec::new();
        for (number, elements) in scaffold.components().iter().enumerate() {
            for &e in elements {
                component_of[e as usize] = number as u32;
            }
            let outer = scaffold.boundary(number, CHORD_TOLERANCE * options.voxel_size);
            components.push(Component {
                boundary: MeshSolid::new(outer.mesh),
            });
        }
        // A box of equal hexes along the axes has a faster kernel, if the cell is a short series, the band narrow,
        // its slope bounded and single precision enough, by rules P and Q.
        let hex_grid = filling
            .products()
            .ok_or("the cell is no short series of products of sines")
            .and_then(|products| axis_aligned::HexGrid::new(scaffold, products, &patches, options));
        let max_slope_sup = patches.iter().map(|p| p.slope_sup).fold(0.0, f64::max);
        if log::log_enabled!(target: "druse::tiling", log::Level::Debug) {
            let affine = patches.iter().filter(|p| p.is_affine()).count();
            let (kernel, cause) = match &hex_grid {
                Ok(_) => ("products of sines", "one box of equal hexes along the axes"),
                Err(cause) => ("tables", *cause),
            };
            log::debug!(target: "druse::tiling",
                "tiling: {} elements, {affine} of them affine, {} components; kernel: {kernel}, because {cause}",
                patches.len(),
                components.len()
            );
        }
        Ok(Self {
            scaffold,
            filling,
            options,
            max_slope_sup,
            patches,
            component_of,
            components,
            hex_grid: hex_grid.ok(),
            interpolation_tolerance: None,
            visits: None,
        })
    }

    /// Records the elements near the samples of bulk evaluation in `visits`. Where a box of hexes is evaluated
    /// as one periodic function, the number of elements is right, but not which ones they are.
    #[must_use]
    pub fn with_visits(self, visits: &'a Visits) -> Self {
        Self {
            visits: Some(visits),
            ..self
        }
    }

    /// Interpolates leaves of 8^3 samples within one element from the cell's values at a few nodes, where this
    /// displaces the surface by at most `max_displacement`, world units. Single points and other lattices are
    /// not interpolated.
    #[must_use]
    pub fn with_interpolation(self, max_displacement: f64) -> Self {
        Self {
            interpolation_tolerance: Some(max_displacement).filter(|m| *m > 0.0),
            ..self
        }
    }

    /// The evaluator. [`Kernel::Products`] tabulates scales only where trials were off by at most 0.06 voxels.
    pub fn kernel(&self) -> Kernel {
        match self.hex_grid {
            Some(_) => Kernel::Products,
            None => Kernel::Tables,
        }
    }

    /// Number of the scaffold's components: sets of elements joined by faces.
    pub fn component_count(&self) -> usize {
        self.components.len()
    }

    /// The bounding box of the scaffold, world units.
    pub fn bounds(&self) -> Aabb {
        self.components
            .iter()
            .fold(Aabb::EMPTY, |b, c| b.union(c.boundary.bounds()))
    }

    /// Value, gradient and distance at a point, its element and reference coordinates. `None` outside the scaffold.
    pub fn sample(&self, p: WorldPoint) -> Option<Sample> {
        let (element, reference) = self.scaffold.locate(p)?;
        let element = element as usize;
        let preimage = self.patches[element].preimage_or_affine(self.scaffold, p.0);
        let (phi, slope) = self.filling.value_and_gradient(element, reference);
        Some(Sample {
            phi,
            gradient: preimage.inverse.transpose() * slope,
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
        let mut local = LocalSearch::new(self.near(component, &here, self.margin()));
        if self.owner(&mut local, x).is_none() {
            // Outside, the field is evaluated at the closest point of the boundary.
            let q = boundary.closest(x).point;
            let around = here
                .union(Aabb { min: q, max: q })
                .dilated(self.chord_slack());
            local = LocalSearch::new(self.near(component, &around, self.margin()));
        }
        self.value_at(component, &mut local, x, RegionFacts::UNKNOWN)
    }

    /// The components that determine the value at `x` under [`Boundary::Extend`]: those that contain `x`, else
    /// the nearest ones.
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

impl Field for TiledSolid<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        if let Some(hex_grid) = &self.hex_grid {
            return hex_grid.value(p.0);
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

    /// The gradient is a central difference over 1/1000 voxel, or over less near a kink.
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let here = self.value(p);
        let gradient = Vec3::from_fn(|axis, _| {
            let slopes = |h: f64| {
                let at = |s: f64| self.value(WorldPoint(p.0 + Vec3::ith(axis, s)));
                [(at(h) - here) / h, (here - at(-h)) / h]
            };
            let mut best = [0.0; 2];
            // Beside a kink both sides agree only over short steps, shares of a voxel.
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
        match &self.hex_grid {
            Some(hex_grid) => hex_grid.bound(region),
            None => self.bound_of_all(region),
        }
    }

    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[Interval; 8]> {
        Some(match &self.hex_grid {
            Some(hex_grid) => hex_grid.bounds(regions),
            None => self.bounds_of_all(&regions.into()),
        })
    }

    fn leaf_bound(&self, parts: &LeafParts<Aabb>, near: f64) -> Interval {
        let all = match &self.hex_grid {
            Some(hex_grid) => hex_grid.bounds(&parts.wide),
            None => self.bounds_of_all(&RegionGroup::leaf(parts, near)),
        };
        all[1..].iter().fold(all[0], |a, &b| a.hull(b))
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }

    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        let Some(hex_grid) = &self.hex_grid else {
            let limits = None;
            return self.fill_all(&FillRequest { lattice, limits }, out).0;
        };
        if let Some(visits) = self.visits {
            hex_grid.record(&lattice.span().dilated(self.delta()), visits);
        }
        hex_grid.fill(lattice, out);
        lattice.len() as u64
    }

    fn fill_within(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        if self.hex_grid.is_some() {
            return self.fill_counting(lattice, out);
        }
        let limits = Some(limits);
        self.fill_all(&FillRequest { lattice, limits }, out).0
    }

    /// A grid of hexes is filled faster than samples are left out.
    fn is_selective(&self) -> bool {
        self.hex_grid.is_none()
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let Some(hex_grid) = &self.hex_grid else {
            return self.fill_leaves_separately(leaves);
        };
        if let Some(visits) = self.visits {
            hex_grid.record_leaves(leaves, self.delta(), visits);
        }
        hex_grid.fill_leaves(leaves)
    }

    fn sides(&self, first: WorldPoint, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        let hex_grid = self.hex_grid.as_ref()?;
        Some(hex_grid.sides(first.0, step, band))
    }

    /// A grid of hexes has one field, and no other solid beyond the faces of its box.
    fn may_touch(&self) -> bool {
        self.hex_grid.is_none()
    }

    fn signs(&self, lattice: &SampleLattice<WorldPoint>, needed: &[u64], rows: &mut [u64]) -> u64 {
        match &self.hex_grid {
            Some(hex_grid) if hex_grid.signs(lattice, rows) => lattice.len() as u64,
            _ => signs_of_values(self, lattice, needed, rows),
        }
    }
}
