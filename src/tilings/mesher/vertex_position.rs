//! Positions of the vertices on their edges.
//!
//! A vertex lies on a voxel edge: at the share a / (a - b) of it, the zero of the linear interpolant of the values a
//! and b at its ends, or at the zero of the exact field. It keeps a margin from the edge's ends, so that two vertices
//! at one voxel stay apart after rounding; only a vertex that is alone at its voxel may lie at the end itself.
//! Positions are in world units, margins are shares of an edge.

use super::edge_vertices::{BATCH, CrossedEdges, split, upper_slot};
use super::{Mesher, MesherError, ZERO_MAGNITUDE};
use druse_geometry::field::WorldField;
use druse_geometry::frame::{Coord, Vec3, WorldPoint};
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Greatest number of evaluations of an exact field along one edge.
const MAX_STEPS: usize = 40;
/// Fewer vertices than these, 100 KiB, are no task of their own.
const MIN_TASK_VERTICES: usize = 1 << 12;

/// Minimum distance of a vertex from the ends of its edge in double precision, voxels.
pub(super) const MIN_MARGIN: f64 = 1e-3;

/// Minimum distance of a vertex from the ends of its edge, voxels: 1e-3, or four roundings to `f32` of the greatest
/// coordinate (voxels), but at most a quarter.
pub(super) fn margin(max_coordinate: f64) -> f64 {
    (4.0 * max_coordinate * f64::from(f32::EPSILON)).clamp(MIN_MARGIN, 0.25)
}

/// Moves vertices of a mesh made [`in_double`](Mesher::in_double) away from the ends of their edges by the
/// margin that single precision needs for coordinates up to `max_coordinate`, but for vertices alone at a
/// voxel. Returns whether that margin exceeds the one of double precision; if not, no vertex moves. `origin`
/// is the position of voxel (0, 0, 0); world units.
pub fn move_off_voxels(
    vertices: &mut [Vec3],
    voxel_size: f64,
    origin: Vec3,
    max_coordinate: f64,
) -> bool {
    let margin = margin(max_coordinate / voxel_size);
    if margin <= MIN_MARGIN {
        return false;
    }
    let tasks = vertices.par_iter_mut().with_min_len(MIN_TASK_VERTICES);
    tasks.for_each(|v| {
        let at = (*v - origin) / voxel_size;
        // A vertex lies on an edge of the lattice: two of its coordinates are integers.
        let share = at.map(|c| c - c.floor());
        let from_voxel = share.map(|s| s.min(1.0 - s));
        let axis = from_voxel.imax();
        // The mesher puts only a vertex that is alone there so near.
        if from_voxel[axis] < MIN_MARGIN / 2.0 {
            return;
        }
        let within = share[axis].clamp(margin, 1.0 - margin);
        v[axis] = (at[axis].floor() + within) * voxel_size + origin[axis];
    });
    true
}

/// All vertices in the order of their numbers, world units. `margin` is their least distance from the ends of edges,
/// as a share of the edge.
pub(super) fn vertices(
    crossed: &CrossedEdges,
    mesher: &Mesher,
    margin: f64,
    progress: &dyn Progress,
) -> Result<Vec<Vec3>, MesherError> {
    // All threads write the zeros, since the first touch of the memory takes as long as the work.
    let zeros = (0..crossed.vertices)
        .into_par_iter()
        .with_min_len(MIN_TASK_VERTICES);
    let mut all: Vec<Vec3> = zeros.map(|_| Vec3::zeros()).collect();
    // The number of vertices of each batch gives its place in the list.
    let count = |part: &[u32]| -> usize {
        let counts = part.iter().map(|&n| crossed.edges[n as usize].count());
        counts.sum::<u32>() as usize
    };
    let counts: Vec<usize> = crossed.order.chunks(BATCH).map(count).collect();
    let chunks = crossed.order.chunks(BATCH);
    let parts: Vec<_> = chunks.zip(split(&mut all, &counts)).collect();
    progress.stage("vertices", Some(crossed.order.len() as u64));
    parts.into_par_iter().try_for_each(|(part, out)| {
        let mut slots = out.iter_mut();
        for &n in part {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            for_each_crossing(crossed, n as usize, |crossing| {
                if let Some(slot) = slots.next() {
                    *slot = mesher.place(crossed, &crossing, margin);
                }
            });
        }
        progress.advance(part.len() as u64);
        Ok(())
    })?;
    Ok(all)
}

/// An edge that the surface crosses.
struct Crossing {
    /// The voxel at which the edge begins.
    voxel: Coord,
    axis: usize,
    /// The values at the ends.
    ends: [f32; 2],
}

/// Calls `visit` with the crossed edges of a leaf in the order of their vertices. `n` is the leaf's number. Values are
/// those at both ends, world units.
fn for_each_crossing(crossed: &CrossedEdges, n: usize, mut visit: impl FnMut(Crossing)) {
    let leaf = &crossed.leaves[n];
    for axis in 0..3 {
        // Along the axis the other end is one stride away, or in the leaf above.
        let (stride, shift) = ([64, 8, 1][axis], [6, 3, 0][axis]);
        let next = crossed.neighbours[n].upper(
            [
                upper_slot(1, 0, 0),
                upper_slot(0, 1, 0),
                upper_slot(0, 0, 1),
            ][axis],
        );
        for x in 0..8 {
            let mut bits = crossed.edges[n].masks[8 * axis + x];
            while bits != 0 {
                let at = 64 * x + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let other = if at >> shift & 7 < 7 {
                    leaf.values[at + stride]
                } else {
                    // The leaf exists: both ends of a crossed edge are in leaves.
                    next.map_or(0.0, |n| crossed.leaves[n].values[at - 7 * stride])
                };
                let [y, z] = [at >> 3 & 7, at & 7].map(|c| c as i32);
                let voxel = leaf.origin.offset(x as i32, y, z);
                visit(Crossing {
                    voxel,
                    axis,
                    ends: [leaf.values[at], other],
                });
            }
        }
    }
}

impl Mesher<'_> {
    /// The vertex of a crossed edge, world units: the zero of the values, or of the exact field, at least `margin` (a
    /// share of the edge) from an end where other crossed edges meet.
    fn place(&self, crossed: &CrossedEdges, crossing: &Crossing, margin: f64) -> Vec3 {
        // What counts as zero is zero: it is outside.
        let zero = -ZERO_MAGNITUDE * self.voxel_size;
        let value = |v: f32| {
            let v = f64::from(v);
            if v < zero { v } else { v.max(0.0) }
        };
        let [a, b] = crossing.ends.map(value);
        // Linear interpolation between the ends.
        let mut share = a / (a - b);
        if let Some(field) = self.exact_field {
            share = self.exact_zero(field, crossing, share);
        }
        // 0 / 0 where both ends count as zero.
        if share.is_nan() {
            share = 0.5;
        }
        // Near an end, other edges at that voxel may have a vertex in the same place.
        let end = usize::from(share > 0.5);
        if [share, 1.0 - share][end] < margin {
            let mut voxel = crossing.voxel;
            let start = voxel.0[crossing.axis];
            voxel.0[crossing.axis] = start.wrapping_add(end as i32);
            // No other vertex can coincide with one that is alone at its voxel.
            let margin = if crossed.ends_one_edge(voxel) {
                0.0
            } else {
                margin
            };
            share = share.clamp(margin, 1.0 - margin);
        }
        self.world(crossing, share)
    }

    fn world(&self, crossing: &Crossing, share: f64) -> Vec3 {
        let mut at = crossing.voxel.0.map(f64::from);
        at[crossing.axis] += share;
        Vec3::from(at) * self.voxel_size + self.origin
    }

    /// The zero of a field along an edge whose ends differ in sign, as a share of the edge. Illinois method: false
    /// position that halves the value of a retained end. `start` is the first guess. It ends at a value within 1e-9
    /// voxels of 0 or not finite, with both ends within 1e-9 of the edge, or after [`MAX_STEPS`] evaluations.
    fn exact_zero(&self, field: &WorldField, crossing: &Crossing, start: f64) -> f64 {
        let tolerance = 1e-9;
        let [a, b] = crossing.ends.map(f64::from);
        // The zero lies between both ends of the bracket: one that is retained, and the latest point.
        let (mut retained, mut latest): ((f64, f64), (f64, f64)) = ((0.0, a), (1.0, b));
        let mut share = start;
        for _ in 0..MAX_STEPS {
            // Rounding has put the point on an end: there is nothing between.
            if !(share > retained.0.min(latest.0) && share < retained.0.max(latest.0)) {
                return share;
            }
            let value = field.value(WorldPoint(self.world(crossing, share)));
            if value.abs() <= tolerance * self.voxel_size || !value.is_finite() {
                return share;
            }
            // The value of a retained end is halved, so that the next point is nearer to it.
            if (value < 0.0) == (latest.1 < 0.0) {
                retained.1 /= 2.0;
            } else {
                retained = latest;
            }
            latest = (share, value);
            if (retained.0 - latest.0).abs() <= tolerance {
                return share;
            }
            // The secant through both ends.
            share = (retained.0 * latest.1 - latest.0 * retained.1) / (latest.1 - retained.1);
        }
        share
    }
}
