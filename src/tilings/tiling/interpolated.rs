//! Leaves of 8^3 samples by interpolation, where the cell is smooth over a leaf.
//!
//! The cell is evaluated at 4^3 or 6^3 Chebyshev nodes. Products with small matrices give values, first and
//! second derivatives at the samples. From these rule Q takes both steps: the second one starts where the
//! first ends, with the field continued to the second order.
//!
//! A trial decides whether a leaf may be interpolated: the polynomial is compared with the cell at samples
//! where its error is largest, the leaf's corners among them. A sheet |f| - t is interpolated by f.
//! The error that a leaf may have is `interpolation_tolerance` times the field's root mean square slope;
//! tests/it/tiling/interpolated.rs measures it.

mod leaf;
mod matrices;

use super::batched::PointLocations;
use super::locality::NearElements;
use super::{Distance, TiledSolid};
use druse_geometry::field::{Interval, Point, SampleLattice};
use druse_geometry::frame::{CellPoint, Vec3, WorldPoint};
use leaf::{LeafValues, RuleQ, evaluate_leaf};
use matrices::{MAX_NODES, Matrices};

/// Samples along a leaf's edge.
const EDGE: usize = 8;
/// Samples of a leaf.
const VOLUME: usize = EDGE * EDGE * EDGE;
/// Greatest length of a leaf's edge in waves of the field's highest frequency. Beyond it, nodes could miss
/// features, and second derivatives are not accurate over a Newton step.
const MAX_WAVES: f64 = 0.7;
/// Length of a leaf's edge, in waves, beyond which the few nodes are not tried.
const MAX_WAVES_FEW_NODES: f64 = 0.3;
/// The greater number of nodes is tried if the error of the few is at most this multiple of the tolerance.
const RETRY_FACTOR: f64 = 64.0;
/// Samples of the trial along each axis: the ends, and two between them.
const TRIAL_SAMPLES: [[usize; 2]; 2] = [[0, 7], [1, 5]];

/// Buffers, reused from leaf to leaf.
#[derive(Default)]
pub(super) struct InterpolationBuffers {
    at: Vec<Vec3>,
    points: Vec<CellPoint<3>>,
    values: Vec<f64>,
    locations: PointLocations,
    leaf: LeafValues,
    /// Number of cell evaluations.
    pub evaluations: u64,
}

/// Lattice indices of the trial samples.
fn trial_samples() -> impl Iterator<Item = [usize; 3]> {
    TRIAL_SAMPLES
        .into_iter()
        .flat_map(|ends| (0..8).map(move |n| [ends[n >> 2 & 1], ends[n >> 1 & 1], ends[n & 1]]))
}

impl TiledSolid<'_> {
    /// Interpolates the distances of a leaf if it lies in one element, more than w inside the boundary, and if the
    /// trial is within the tolerance. `near` are the elements less than a voxel away, `depth` is the signed distance to
    /// the boundary, negative inside.
    pub(super) fn fill_interpolated(
        &self,
        (near, depth): (&NearElements, Interval),
        lattice: &SampleLattice<WorldPoint>,
        buffers: &mut InterpolationBuffers,
        out: &mut [f32],
    ) -> bool {
        let w = self.options.half_width;
        let (&[number], Some(tolerance)) = (&*near.patches, self.interpolation_tolerance) else {
            return false;
        };
        let Ok(out) = <&mut [f32; VOLUME]>::try_from(out) else {
            return false;
        };
        // Only whole leaves of rule Q that are deeper inside the boundary than the band, where nothing is cut.
        if lattice.counts != [EDGE; 3] || self.options.distance == Distance::Exact || depth.hi > -w
        {
            return false;
        }
        let patch = &self.patches[number as usize];
        let across = (EDGE - 1) as f64 * lattice.step * patch.max_compression();
        let Some(smooth) = self.filling.smooth(number as usize) else {
            return false;
        };
        // Waves of the highest frequency across the leaf, a measure of how well a polynomial can follow.
        let waves = across * smooth.frequency;
        if waves > MAX_WAVES {
            return false;
        }
        let limits = self.limits(patch);
        let rule = RuleQ::new((limits, patch.slope_sup), smooth.fold, w, lattice.step);
        let allowed = tolerance * patch.slope_rms;
        // Wavy leaves begin with the greater number of nodes.
        let first = usize::from(waves > MAX_WAVES_FEW_NODES);
        for matrices in &Matrices::all()[first..] {
            let Some(error) = self.try_interpolation(number, lattice, (matrices, &rule), buffers)
            else {
                return false;
            };
            if error <= allowed {
                if let Some(visits) = self.visits {
                    visits.count_leaf();
                }
                *out = buffers.leaf.distances;
                return true;
            }
            // An error this far off does not come down to the tolerance with more nodes.
            if error > RETRY_FACTOR * allowed {
                return false;
            }
        }
        false
    }

    /// Interpolates a leaf from the nodes of `matrices`. Returns the greatest error at the trial samples; `None`
    /// if a node or trial sample is outside the element or the field is too curved for the two steps.
    fn try_interpolation(
        &self,
        number: u32,
        lattice: &SampleLattice<WorldPoint>,
        (matrices, rule): (&Matrices, &RuleQ),
        buffers: &mut InterpolationBuffers,
    ) -> Option<f64> {
        let InterpolationBuffers {
            at,
            points,
            values,
            locations,
            leaf,
            evaluations,
        } = buffers;
        at.clear();
        let along = |axis: usize, steps: f64| lattice.origin.0[axis] + steps * lattice.step;
        let offsets = &matrices.positions[..matrices.count];
        for &i in offsets {
            for &j in offsets {
                let (x, y) = (along(0, i), along(1, j));
                at.extend(offsets.iter().map(|&k| Vec3::new(x, y, along(2, k))));
            }
        }
        let count = at.len();
        // Trial samples follow the nodes, so that one inversion of the map serves both.
        at.extend(trial_samples().map(|n| lattice.origin.stepped(lattice.step, n).0));
        let patch = &self.patches[number as usize];
        points.clear();
        // Every point must be in the element.
        if !patch.locate_inside(self.scaffold, at, locations, points) {
            return None;
        }
        values.resize(points.len(), 0.0);
        let (nodes, trial_points) = points.split_at(count);
        let (own, found) = values.split_at_mut(count);
        self.filling.smooth_values(number as usize, nodes, own);
        self.filling.values(number as usize, trial_points, found);
        *evaluations += points.len() as u64;
        let mut node_values = [0.0; MAX_NODES * MAX_NODES * MAX_NODES];
        for (to, v) in node_values.iter_mut().zip(own) {
            *to = *v as f32;
        }
        if !evaluate_leaf(matrices, &node_values, rule, leaf) {
            return None;
        }
        let error = trial_samples().zip(found).map(|([i, j, k], v)| {
            let leaf = leaf.values[(i * EDGE + j) * EDGE + k];
            (f64::from(leaf) - *v).abs()
        });
        Some(error.fold(0.0, f64::max))
    }
}
