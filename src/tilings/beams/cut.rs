//! Beams clipped at the outer faces of a scaffold.
//!
//! A beam along an outer face would stick out of the part by its radius; the cut ends it there. The maximum of two
//! distances is too small beyond the edges of the cut. Lengths are in world units.

use super::{Beams, LeafContent, Scratch, is_settled, without_band};
use druse_geometry::field::{Field, Interval, LeafBits, Leaves, SampleLattice};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use druse_geometry::mesh::{MeshSolid, TriMesh};

/// The intersection of beams and a scaffold: the maximum of both distances.
pub struct Cut<'a> {
    beams: &'a Beams,
    solid: &'a ScaffoldSolid,
}

/// The union of the components of a scaffold.
pub struct ScaffoldSolid {
    /// Meshes; components whose boxes do not meet share a mesh.
    layers: Vec<MeshSolid>,
}

/// Surfaces whose boxes are apart, with the number of their vertices.
#[derive(Default)]
struct Layer {
    boxes: Vec<Aabb>,
    surfaces: Vec<TriMesh>,
    vertices: usize,
}

impl Layer {
    /// The surfaces as one mesh, with vertices numbered one after the other.
    fn joined(self) -> TriMesh {
        let (mut points, mut triangles) = (Vec::with_capacity(self.vertices), Vec::new());
        for mesh in &self.surfaces {
            let first = points.len() as u32;
            points.extend_from_slice(mesh.vertices());
            triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
        }
        TriMesh::new_unchecked(points, triangles)
    }
}

impl ScaffoldSolid {
    /// The union of closed surfaces. They must be oriented outward and bound solids.
    pub fn new(surfaces: impl IntoIterator<Item = TriMesh>) -> Self {
        Self::with_limit(surfaces, u32::MAX as usize)
    }

    /// The union of closed surfaces in meshes of at most so many vertices, or of one surface.
    fn with_limit(surfaces: impl IntoIterator<Item = TriMesh>, max_vertices: usize) -> Self {
        // Surfaces whose boxes are apart form one mesh, so that most unions need a single search.
        let mut layers: Vec<Layer> = Vec::new();
        for mesh in surfaces {
            let own = mesh.bounds();
            // Surfaces that touch up to rounding count as meeting.
            let near = own.dilated(1e-6 * own.half_diagonal());
            let count = mesh.vertices().len();
            let fits = |l: &Layer| {
                l.vertices + count <= max_vertices && !l.boxes.iter().any(|b| b.meets(near))
            };
            let n = layers.iter().position(fits).unwrap_or(layers.len());
            if n == layers.len() {
                layers.push(Layer::default());
            }
            let layer = &mut layers[n];
            layer.boxes.push(own);
            layer.surfaces.push(mesh);
            layer.vertices += count;
        }
        let meshes = layers.into_iter().map(Layer::joined);
        Self {
            layers: meshes.map(MeshSolid::new).collect(),
        }
    }

    /// Replaces each value by its maximum with the distance from the scaffold minus `by`.
    fn raise(&self, lattice: &SampleLattice<WorldPoint>, by: f32, out: &mut [f32]) {
        let mut outer = vec![0.0; out.len()];
        self.fill(lattice, &mut outer);
        for (o, r) in out.iter_mut().zip(outer) {
            *o = o.max(r - by);
        }
    }
}

impl Field for ScaffoldSolid {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        let all = self.layers.iter().map(|l| l.signed_distance(p.0));
        all.fold(f64::INFINITY, f64::min)
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let layers = self.layers.iter().map(|l| l.value_and_gradient(p));
        let least = layers.min_by(|a, b| a.0.total_cmp(&b.0));
        least.unwrap_or((f64::INFINITY, Vec3::zeros()))
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let all = self.layers.iter().map(|l| l.bound(region));
        all.fold(Interval::new(f64::INFINITY, f64::INFINITY), |a, b| {
            Interval::new(a.lo.min(b.lo), a.hi.min(b.hi))
        })
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let Some((first, others)) = self.layers.split_first() else {
            out.fill(f32::INFINITY);
            return;
        };
        first.fill(lattice, out);
        for layer in others {
            let mut own = vec![0.0; out.len()];
            layer.fill(lattice, &mut own);
            for (o, v) in out.iter_mut().zip(own) {
                *o = o.min(v);
            }
        }
    }
}

impl<'a> Cut<'a> {
    /// The beams inside the scaffold.
    pub fn new(beams: &'a Beams, solid: &'a ScaffoldSolid) -> Self {
        Self { beams, solid }
    }
}

impl Field for Cut<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.beams.value(p).max(self.solid.value(p))
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let own = self.beams.value_and_gradient(p);
        let outer = self.solid.value_and_gradient(p);
        if outer.0 > own.0 { outer } else { own }
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let (own, outer) = (self.beams.bound(region), self.solid.bound(region));
        Interval::new(own.lo.max(outer.lo), own.hi.max(outer.hi))
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.beams.fill(lattice, out);
        let least = out.iter().copied().fold(f32::INFINITY, f32::min);
        if self.solid.bound(&lattice.span()).hi > f64::from(least) {
            self.solid.raise(lattice, 0.0, out);
        }
    }

    /// Fills leaves with the intersection of beams and solid; returns the number of values evaluated, or `None` for a
    /// band too narrow for the rules, whose samples must be evaluated one by one.
    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let (by, background) = (f64::from(leaves.by), f64::from(leaves.background));
        let step = leaves.step;
        if !is_settled(background, step) {
            return None;
        }
        let mut scratch = Scratch::new();
        let (mut kept, mut evaluated) = (0, 0);
        // The beams alone first; the solid is bounded only where they leave something.
        for (n, &origin) in leaves.origins.iter().enumerate() {
            let values = &mut leaves.values[kept];
            let lattice = SampleLattice {
                origin,
                step,
                counts: [8; 3],
            };
            let content = self
                .beams
                .leaf(origin.0, step, by, background, values, &mut scratch);
            // The leaf and its neighbouring samples.
            let with_neighbours = lattice.span().dilated(step);
            let distance = match content {
                LeafContent::Outside => Interval::REAL_LINE,
                _ => self.solid.bound(&with_neighbours),
            };
            let is_outside =
                matches!(content, LeafContent::Outside) || distance.lo - by >= background;
            let is_uncut = distance.hi - by <= -background;
            leaves.bits[n] = if is_outside {
                without_band(false)
            } else if is_uncut && matches!(content, LeafContent::Inside) {
                without_band(true)
            } else {
                // Values exist: those of the beams, raised to the distance of the solid where that cuts.
                evaluated += 512;
                if matches!(content, LeafContent::Inside) {
                    values.fill(-leaves.background);
                }
                if !is_uncut {
                    self.solid.raise(&lattice, leaves.by, values);
                }
                LeafBits {
                    settled: true,
                    ..LeafBits::from_values(values, leaves.background)
                }
            };
            kept += usize::from(!leaves.bits[n].is_out());
        }
        Some(evaluated)
    }

    /// As for the beams alone, with the same bits: a leaf is inside if it is inside the beams and the solid, and
    /// outside if it is outside one of them.
    fn sides(&self, first: WorldPoint, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        let [mut inside, mut outside] = self.beams.sides(first, step, band)?;
        let cube = |corner: Vec3, edge: f64| {
            let far = corner.add_scalar((edge - 1.0) * step);
            Aabb::of([corner, far]).dilated(step)
        };
        if outside == u64::MAX {
            return Some([inside, outside]);
        }
        // The bits are the cubes of 8^3 samples in a cube of 32^3.
        let whole = self.solid.bound(&cube(first.0, 32.0));
        if whole.hi <= band[0] {
            return Some([inside, outside]);
        }
        if whole.lo >= band[1] {
            return Some([0, u64::MAX]);
        }
        for n in 0..64u32 {
            let bit = 1 << n;
            if outside & bit != 0 {
                continue;
            }
            let at = [n >> 4, n >> 2 & 3, n & 3].map(|c| f64::from(c) * 8.0 * step);
            let outer = self.solid.bound(&cube(first.0 + Vec3::from(at), 8.0));
            if outer.lo >= band[1] {
                outside |= bit;
            }
            if outer.hi > band[0] {
                inside &= !bit;
            }
        }
        Some([inside, outside])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three cubes apart from each other, where a mesh holds one, two or all of them: none is lost.
    #[test]
    fn surfaces_that_no_mesh_can_hold_together_stay_in_the_union() {
        let cube = |n: usize| {
            let corner = Vec3::new(3.0 * n as f64, 0.0, 0.0);
            TriMesh::cuboid(&Aabb::of([corner, corner.add_scalar(1.0)]))
        };
        for (limit, layers) in [(1, 3), (16, 2), (u32::MAX as usize, 1)] {
            let solid = ScaffoldSolid::with_limit((0..3).map(cube), limit);
            assert_eq!(solid.layers.len(), layers);
            for n in 0..3 {
                let middle = WorldPoint(Vec3::new(3.0 * f64::from(n) + 0.5, 0.5, 0.5));
                assert!((solid.value(middle) + 0.5).abs() < 1e-12);
            }
        }
    }
}
