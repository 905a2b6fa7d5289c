//! Unions of round beams and plates in world space, as one distance field.
//!
//! The solid is the union of balls swept along segments ([`Beam`]) and over triangles ([`Plate`]), with linear radii. A
//! value is the minimum of the parts' exact distances: exact outside and within any single part; where parts overlap,
//! the depth is that of the deepest part. The field is 1-Lipschitz, which all bounds use. A tree over the parts'
//! bounding boxes finds the parts near a leaf, and parts that are farther than another one everywhere in the leaf are
//! omitted. [`Beams::with_fillet`] rounds the corners between parts.
//!
//! [`Network`] maps the struts and plates of a cell through the elements of a scaffold. [`Cut`] clips the
//! solid at the scaffold's outer faces. [`Rods`] are cones with flat or hemispherical ends.

use druse_geometry::field::{Field, Interval, LeafBits, Leaves, SampleLattice};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use druse_geometry::mesh::Bvh;

mod cut;
mod fillet;
mod network;
mod part;
mod rod;
mod rows;
mod size;
pub use cut::{Cut, ScaffoldSolid};
pub use network::{Network, NetworkError, ReferenceParts};
pub use part::{Beam, Plate};
pub use rod::{Rod, Rods};
pub use size::{DiametersAt, RadiusLimits, WeightsAt, Width};

use part::{Axis, Part};
use rows::{NearbyParts, ROW_LEN};

/// Samples along the edge of a leaf.
const LEAF_EDGE: usize = 8;
/// Margin for rounding, in sample steps.
const ROUNDING_MARGIN: f64 = 1e-4;

/// A union of beams and plates.
///
/// ```
/// # mod druse { pub use druse_geometry::*; pub use druse_tilings::*; }
/// use druse::beams::{Beam, Beams};
/// use druse::field::Field;
/// use druse::frame::{Vec3, WorldPoint};
/// let cone = Beam { ends: [Vec3::zeros(), Vec3::x() * 5.0], radii: [1.0, 2.0] };
/// let beams = Beams::new(&[cone], &[]).unwrap();
/// assert_eq!(beams.value(WorldPoint(Vec3::new(9.0, 0.0, 0.0))), 2.0);
/// ```
pub struct Beams {
    /// In the order of the tree's slots.
    parts: Vec<Part>,
    tree: Bvh,
    bounds: Aabb,
    /// Fillet radius at corners between parts, world units; 0 for none.
    fillet: f64,
}

/// Classification of a leaf's samples.
enum LeafContent {
    /// All samples are at least the background; the layer around them then has their sign, see [`is_settled`].
    Outside,
    /// All samples are at most minus the background, likewise.
    Inside,
    /// The values are written.
    Values,
}

impl Beams {
    /// The union of beams and plates; `None` without any. Fillets are off.
    pub fn new(beams: &[Beam], plates: &[Plate]) -> Option<Self> {
        let part = |n: usize| match beams.get(n) {
            Some(beam) => Part::Beam(Axis::new(beam)),
            None => Part::from(&plates[n - beams.len()]),
        };
        let count = beams.len() + plates.len();
        let bounds = (0..count).fold(Aabb::EMPTY, |b, n| b.union(part(n).bounds()));
        if bounds.is_empty() {
            return None;
        }
        let tree = Bvh::new(count, |n| part(n).bounds());
        let parts = tree.order().iter().map(|&n| part(n as usize)).collect();
        Some(Self {
            parts,
            tree,
            bounds,
            fillet: 0.0,
        })
    }

    /// The same union with corners between parts rounded by a radius, world units. Points farther than the
    /// radius from two parts keep their values.
    #[must_use]
    pub fn with_fillet(self, radius: f64) -> Self {
        Self {
            fillet: radius.max(0.0),
            ..self
        }
    }

    /// The bounding box of the solid, world units.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Number of beams and plates.
    pub fn len(&self) -> usize {
        self.parts.len()
    }

    /// Whether the union has no parts, which never holds.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// The beams without the plates, in unspecified order. A beam with one end ball inside the other is
    /// returned as a ball with equal ends.
    pub fn beams(&self) -> impl Iterator<Item = Beam> + '_ {
        self.parts.iter().filter_map(|part| match part {
            Part::Beam(axis) => Some(axis.beam()),
            Part::Plate(_) => None,
        })
    }

    /// Whether the union has plates.
    pub fn has_plates(&self) -> bool {
        self.parts.iter().any(|part| matches!(part, Part::Plate(_)))
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> usize {
        let plate = |p: &Part| match p {
            Part::Beam(_) => 0,
            Part::Plate(facet) => size_of_val(&**facet),
        };
        self.parts.iter().map(plate).sum::<usize>() + size_of_val(&*self.parts) + self.tree.bytes()
    }

    /// The smallest distance, and the part that has it.
    fn nearest_part(&self, p: Vec3) -> (f64, usize) {
        let mut best = (f64::INFINITY, 0);
        self.tree.nearest(p, f64::INFINITY, |slot| {
            let d = self.parts[slot].nearest(p).0;
            (d < best.0).then(|| {
                best = (d, slot);
                // Inside the solid, all parts whose boxes contain the point are candidates.
                d.max(0.0)
            })
        });
        best
    }

    /// Collects into `found` the parts that give the minimum below `reach` somewhere in a ball, and those that affect
    /// fillets there. Returns the smallest distance of the centre, or infinity if no part is within `reach` of the
    /// ball. World units.
    fn gather(&self, centre: Vec3, radius: f64, reach: f64, found: &mut Vec<(f64, u32)>) -> f64 {
        found.clear();
        let point_box = Aabb {
            min: centre,
            max: centre,
        };
        let far = radius + reach;
        // A part beyond least + 2 radius from the centre is farther than the nearest throughout the ball; fillets
        // extend to farther parts.
        let rounding = self.fillet_reach(radius);
        let mut least = f64::INFINITY;
        self.tree
            .overlapping(&point_box.dilated(far.max(0.0)), |slot| {
                let d = self.parts[slot].nearest(centre).0;
                if d <= far.min((least + 2.0 * radius).max(rounding)) {
                    least = least.min(d);
                    found.push((d, slot as u32));
                }
                true
            });
        found.retain(|f| f.0 <= (least + 2.0 * radius).max(rounding));
        least
    }

    /// Distance from the centre of a ball below which parts affect fillets in the ball; negative infinity
    /// without fillets.
    fn fillet_reach(&self, radius: f64) -> f64 {
        if self.fillet > 0.0 {
            self.fillet + radius
        } else {
            f64::NEG_INFINITY
        }
    }

    /// Maximal decrease of values by fillets in a ball, from the parts around its centre.
    fn depth_of_fillets(&self, radius: f64, found: &[(f64, u32)]) -> f64 {
        let reach = self.fillet_reach(radius);
        let is_corner = found.iter().filter(|f| f.0 < reach).count() > 1;
        if is_corner { self.fillet } else { 0.0 }
    }

    /// Applies fillets to values of the plain union at the points `at(n)`.
    fn round_corners(
        &self,
        scratch: &mut Scratch,
        radius: f64,
        at: impl Fn(usize) -> Vec3,
        values: &mut [f32],
    ) {
        if self.depth_of_fillets(radius, &scratch.found) == 0.0 {
            return;
        }
        let reach = self.fillet_reach(radius);
        scratch.found.retain(|f| f.0 < reach);
        let Scratch { found, close, .. } = scratch;
        for (n, value) in values.iter_mut().enumerate() {
            if f64::from(*value) < self.fillet {
                let parts = found.iter().map(|f| &self.parts[f.1 as usize]);
                let union = (f64::from(*value), Vec3::zeros());
                *value = fillet::with_fillets(parts, at(n), self.fillet, union, close).0 as f32;
            }
        }
    }

    /// Values of a leaf of 8^3 samples moved outwards by `by`, at most the background; [`LeafBits::from_values`] clamps
    /// them below. All lengths are in world units, and `origin` is the first sample. `out` is set only for
    /// [`LeafContent::Values`]; `scratch` has buffers, which each leaf overwrites.
    fn leaf(
        &self,
        origin: Vec3,
        step: f64,
        by: f64,
        background: f64,
        out: &mut [f32; 512],
        scratch: &mut Scratch,
    ) -> LeafContent {
        // The ball around all samples of the leaf.
        let half = (LEAF_EDGE - 1) as f64 / 2.0;
        let centre = origin.add_scalar(half * step);
        let radius = (half * 3f64.sqrt() + ROUNDING_MARGIN) * step;
        // Parts within the background of a moved sample give its value; a fillet reaches farther by its radius, and
        // needs true distances up to it even where the surface is moved inwards.
        let reach = if self.fillet > 0.0 {
            (background + by).max(0.0) + self.fillet
        } else {
            background + by
        };
        let least = self.gather(centre, radius, reach, &mut scratch.found);
        // The distance is 1-Lipschitz: the value at the centre bounds those in the ball.
        if least - self.depth_of_fillets(radius, &scratch.found) - by >= background + radius {
            return LeafContent::Outside;
        }
        if least - by <= -background - radius {
            return LeafContent::Inside;
        }
        scratch.near.clear();
        for &(_, slot) in &scratch.found {
            scratch.near.push(&self.parts[slot as usize], centre);
        }
        let at: [f32; LEAF_EDGE] = std::array::from_fn(|n| ((n as f64 - half) * step) as f32);
        // No part beyond `reach` is collected: samples that no part lowers are out of the band, and beyond all fillets.
        out.fill((background + by).max(self.fillet) as f32);
        rows::lower_to_distances(&scratch.near, &at, &at, &at, out);
        // Fillets lower values near corners between parts. The clamp comes after them.
        if self.fillet > 0.0 {
            let place = |n: usize| {
                let steps = [n >> 6, n >> 3 & 7, n & 7].map(|c| c as f64 - half);
                centre + Vec3::from(steps) * step
            };
            self.round_corners(scratch, radius, place, out);
            let most = (background + by) as f32;
            for v in out.iter_mut() {
                *v = v.min(most);
            }
        }
        if by != 0.0 {
            for v in out.iter_mut() {
                *v -= by as f32;
            }
        }
        LeafContent::Values
    }

    /// Values of a block of at most 8^3 samples. They are left in `scratch.values`, in rows of [`ROW_LEN`] along z; the
    /// last values of a shorter row are beyond the lattice.
    fn block(&self, lattice: &SampleLattice<WorldPoint>, scratch: &mut Scratch) {
        let span = lattice.span();
        let centre = span.centre().0;
        let radius = span.half_diagonal() + ROUNDING_MARGIN * lattice.step;
        // No sample is farther from the solid than `reach`: parts farther than that from the samples give no value.
        let (least, _) = self.nearest_part(centre);
        let reach = (least + radius).max(self.fillet);
        self.gather(centre, radius, reach, &mut scratch.found);
        scratch.near.clear();
        for &(_, slot) in &scratch.found {
            scratch.near.push(&self.parts[slot as usize], centre);
        }
        // Coordinates relative to the centre, in single precision, for a block of whole rows.
        let at = |axis: usize, n: usize| {
            let from = lattice.origin.0[axis] - centre[axis];
            (from + n as f64 * lattice.step) as f32
        };
        let xs: [f32; ROW_LEN] = std::array::from_fn(|n| at(0, n));
        let ys: [f32; ROW_LEN] = std::array::from_fn(|n| at(1, n));
        let zs: [f32; ROW_LEN] = std::array::from_fn(|n| at(2, n));
        let [nx, ny, _] = lattice.counts;
        scratch.values[..nx * ny * ROW_LEN].fill(f32::INFINITY);
        let values = &mut scratch.values[..nx * ny * ROW_LEN];
        rows::lower_to_distances(&scratch.near, &xs[..nx], &ys[..ny], &zs, values);
        // `round_corners` borrows the scratch.
        if self.fillet > 0.0 {
            let mut values = std::mem::take(&mut scratch.values);
            let place = |n: usize| {
                let [i, j, k] = [n / ROW_LEN / ny, n / ROW_LEN % ny, n % ROW_LEN].map(|c| c as f64);
                lattice.origin.0 + Vec3::new(i, j, k) * lattice.step
            };
            self.round_corners(scratch, radius, place, &mut values[..nx * ny * ROW_LEN]);
            scratch.values = values;
        }
    }
}

/// Buffers of an evaluation.
struct Scratch {
    /// Distances from the centre and slots of the collected parts.
    found: Vec<(f64, u32)>,
    /// Distances and directions of the parts at a corner.
    close: Vec<(f64, Vec3)>,
    near: NearbyParts,
    values: Vec<f32>,
}

impl Scratch {
    fn new() -> Self {
        Self {
            found: Vec::new(),
            close: Vec::new(),
            near: NearbyParts::default(),
            values: vec![0.0; LEAF_EDGE * LEAF_EDGE * ROW_LEN],
        }
    }
}

/// The bits of a leaf without active voxels.
fn without_band(inside: bool) -> LeafBits {
    LeafBits {
        negative: [if inside { u64::MAX } else { 0 }; 8],
        within: [0; 8],
        finite: true,
        settled: true,
    }
}

/// Whether a sample outside the band has the sign of all 26 neighbours: the slope is at most 1, and a neighbour
/// is at most sqrt(3) steps away.
fn is_settled(background: f64, step: f64) -> bool {
    // 1.75 exceeds sqrt(3) by more than rounding.
    background >= 1.75 * step
}

impl Field for Beams {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        if self.fillet > 0.0 {
            return self.value_and_gradient(p).0;
        }
        self.nearest_part(p.0).0
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (value, slot) = self.nearest_part(p.0);
        let (_, centre) = self.parts[slot].nearest(p.0);
        let union = (value, (p.0 - centre).try_normalize(0.0).unwrap_or_default());
        if self.fillet <= 0.0 || value >= self.fillet {
            return union;
        }
        let point_box = Aabb { min: p.0, max: p.0 };
        let mut parts = Vec::new();
        self.tree
            .overlapping(&point_box.dilated(self.fillet), |slot| {
                parts.push(&self.parts[slot]);
                true
            });
        fillet::with_fillets(parts.into_iter(), p.0, self.fillet, union, &mut Vec::new())
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let (value, radius) = (
            self.nearest_part(region.centre().0).0,
            region.half_diagonal(),
        );
        let least = value - radius;
        let depth = if least < self.fillet {
            self.fillet
        } else {
            0.0
        };
        Interval::new(least - depth, value + radius)
    }

    /// The values at the samples of a lattice, z fastest, in blocks of 8^3 that share the search for near parts.
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let mut scratch = Scratch::new();
        let [nx, ny, nz] = lattice.counts;
        // In blocks of 8^3; a row of a block is eight samples along z, and the last may be cut.
        for i in (0..nx).step_by(LEAF_EDGE) {
            for j in (0..ny).step_by(LEAF_EDGE) {
                for k in (0..nz).step_by(ROW_LEN) {
                    let counts = [
                        (nx - i).min(LEAF_EDGE),
                        (ny - j).min(LEAF_EDGE),
                        (nz - k).min(ROW_LEN),
                    ];
                    let origin = lattice.point((i * ny + j) * nz + k);
                    let part = SampleLattice {
                        origin,
                        counts,
                        ..*lattice
                    };
                    self.block(&part, &mut scratch);
                    // Rows of the block to rows of the lattice.
                    for (row, values) in scratch
                        .values
                        .chunks(ROW_LEN)
                        .take(counts[0] * counts[1])
                        .enumerate()
                    {
                        let (a, b) = (row / counts[1], row % counts[1]);
                        let to = ((i + a) * ny + j + b) * nz + k;
                        out[to..to + counts[2]].copy_from_slice(&values[..counts[2]]);
                    }
                }
            }
        }
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        // Beyond a band narrower than 1.75 voxels a neighbour may have another sign: samples are evaluated one by one.
        let (by, background) = (f64::from(leaves.by), f64::from(leaves.background));
        if !is_settled(background, leaves.step) {
            return None;
        }
        let mut scratch = Scratch::new();
        let (mut kept, mut evaluated) = (0, 0);
        // A leaf without band has bits alone: the values of the next one take their place.
        for (n, origin) in leaves.origins.iter().enumerate() {
            let values = &mut leaves.values[kept];
            leaves.bits[n] =
                match self.leaf(origin.0, leaves.step, by, background, values, &mut scratch) {
                    LeafContent::Outside => without_band(false),
                    LeafContent::Inside => without_band(true),
                    LeafContent::Values => {
                        evaluated += 512;
                        LeafBits {
                            settled: true,
                            ..LeafBits::from_values(values, leaves.background)
                        }
                    }
                };
            kept += usize::from(!leaves.bits[n].is_out());
        }
        Some(evaluated)
    }

    /// A bit for each of the 4^3 leaves of a cube, bit 16 x + 4 y + z: those wholly below the band, and those wholly
    /// above it, with the layer of samples around each. `first` is the cube's first sample; `band` and `step` are in
    /// world units.
    fn sides(&self, first: WorldPoint, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        // The cube has 4^3 leaves, 32 samples along an axis. Each leaf is divided into eight parts of 4^3
        // samples, 5^3 with the layer around the leaf. These are the positions of the parts' centres along an axis.
        const CENTRES: [f64; 8] = [1.0, 6.0, 9.0, 14.0, 17.0, 22.0, 25.0, 30.0];
        // The middle of the cube, the reach of a part from its centre, and the distance of the farthest centre.
        let half = 15.5;
        let centre = first.0.add_scalar(half * step);
        let reach = (2.0 * 3f64.sqrt() + ROUNDING_MARGIN) * step;
        let radius = 14.5 * 3f64.sqrt() * step;
        let mut scratch = Scratch::new();
        // Fillets lower the values of the union.
        let outer = band[1] + reach + self.fillet;
        let least = self.gather(centre, radius, outer, &mut scratch.found);
        if least >= outer + radius {
            return Some([0, u64::MAX]);
        }
        for &(_, slot) in &scratch.found {
            scratch.near.push(&self.parts[slot as usize], centre);
        }
        let at = CENTRES.map(|m| ((m - half) * step) as f32);
        // Where no part is near, a leaf is outside.
        scratch.values.fill(outer as f32);
        rows::lower_to_distances(&scratch.near, &at, &at, &at, &mut scratch.values);
        let (mut not_inside, mut not_outside) = (0u64, 0u64);
        let limits = [(band[0] - reach) as f32, outer as f32];
        // Two parts along each axis belong to one leaf: it is on a side if all eight are.
        for (n, &v) in scratch.values.iter().enumerate() {
            let bit = 1 << (16 * (n >> 7) + 4 * (n >> 4 & 3) + (n >> 1 & 3));
            not_inside |= if v <= limits[0] { 0 } else { bit };
            not_outside |= if v >= limits[1] { 0 } else { bit };
        }
        Some([!not_inside, !not_outside])
    }
}
