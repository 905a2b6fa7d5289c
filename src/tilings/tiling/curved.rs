//! Rule Q for the samples of a small box among any elements, curved ones included: d = F(x) sum `w_e` `s_e` / sum `w_e` over
//! the elements e within a voxel of x, with scales `s_e` by two Newton steps, clamped to the half width w of the band. Only
//! distances between two limits d- <= 0 <= d+ are wanted: -w and w, or less where other fields decide.
//!
//! 1. Blocks of 2^3 samples in one element: F at the centre c. With L the slope bound and R the block's half diagonal,
//!    F(c) >= L (R + d+) implies F >= L d+ and so d >= d+ at all samples, and F(c) <= -L (R - d-) the same below.
//! 2. The preimages xi of the other samples in their owners: by the second-order map about the block's centre where that is
//!    within 1e-7 reference units at four corners, otherwise by Newton's method.
//! 3. F and its gradient at xi, for runs of points in one element. F >= L d+ decides a sample, for `s_e` >= 1 / L.
//! 4. For the rest, the scales of owner and neighbours and their mean (`in_band_samples`).
//! 5. Samples in no element take the value of the nearest point of one (`exterior_samples`). Then the cut: max(d, D).
//!
//! The values are those of single points up to the error of step 2. The laws of tests/it/tiling/curved.rs measure it, less
//! than 1e-4 voxels, and compare with values without limits.

mod exterior_samples;
mod in_band_samples;

use super::TiledSolid;
use super::boundary::RegionFacts;
use super::local_map::LocalMap;
use super::locality::{LocalSearch, Owner, OwnerBuffers};
use super::newton_distance::FirstStep;
use super::patch::{Patch, Preimages};
use druse_geometry::frame::{CellPoint, Mat3, Vec3};
use exterior_samples::ExteriorSample;
use in_band_samples::{Contribution, ScaleSum};

/// A sample: its storage index and its position.
#[derive(Clone, Copy)]
pub(super) struct LatticeSample {
    pub n: u32,
    pub x: Vec3,
}

/// A sample whose distance is to be evaluated.
struct PendingSample {
    sample: LatticeSample,
    /// Index of its owner in the list of near elements.
    near_index: u32,
    jacobian: JacobianSource,
    /// Depth below its owner's faces; a lower bound where it exceeds a voxel.
    depth: f64,
}

/// The source of d xi / d x of a sample in its owner.
#[derive(Clone, Copy)]
enum JacobianSource {
    /// A local map, by number.
    Local(u32),
    /// An entry of [`CurvedBatch::single_inverses`].
    Single(u32),
}

/// A block of samples within one element: the `number`th of the box. `radius` is half its diagonal, `depth` that of its
/// centre below the element's faces, world units, and `f` the field at the centre.
struct Block {
    number: usize,
    near_index: usize,
    radius: f64,
    /// The local map at its centre, by number.
    local_map: u32,
    /// Whether the local map is accurate at all its samples.
    is_local_map_accurate: bool,
    depth: f64,
    f: f64,
}

/// Error of a local map, reference units, below which no Newton step is needed.
const LOCAL_MAP_TOLERANCE: f64 = 1e-7;

/// Points with their elements, to be evaluated together.
#[derive(Default)]
struct EvaluationPoints {
    near_indices: Vec<u32>,
    points: Vec<CellPoint<3>>,
}

/// Buffers, reused from box to box.
#[derive(Default)]
pub(super) struct CurvedBatch {
    blocks: Vec<Block>,
    /// The local maps of blocks.
    local_maps: Vec<LocalMap>,
    /// Samples whose owner their block does not give.
    open: Vec<LatticeSample>,
    /// Samples in no element.
    exterior: Vec<LatticeSample>,
    /// Those whose value is that of a point of an element.
    continued: Vec<ExteriorSample>,
    /// The indices of those whose element is not known yet.
    open_exterior: Vec<u32>,
    at: Vec<Vec3>,
    owners: Vec<Option<Owner>>,
    found: Preimages,
    owner_buffers: OwnerBuffers,
    items: Vec<PendingSample>,
    /// d xi / d x of items with a Newton search of their own.
    single_inverses: Vec<Mat3>,
    /// A point for each block, then for each item.
    evaluation_points: EvaluationPoints,
    /// Values at the centres of blocks.
    values: Vec<f64>,
    /// Values and gradients of items in their owners.
    owner_slopes: Vec<(f64, Vec3)>,
    /// Items in the band near faces, to which several elements contribute.
    shared: Vec<u32>,
    contributions: Vec<Contribution>,
    /// A point for each contribution.
    points: Vec<CellPoint<3>>,
    /// A matrix for each contribution without a local map.
    inverses: Vec<Mat3>,
    slopes: Vec<(f64, Vec3)>,
    first_steps: Vec<FirstStep>,
    scales: Vec<f64>,
    /// Items to be searched for in a neighbour of their owner.
    neighbours: Vec<u32>,
    /// A sum for each item.
    sums: Vec<ScaleSum>,
    /// Number of cell evaluations: samples, and centres of blocks.
    pub evaluations: u64,
}

impl EvaluationPoints {
    fn clear(&mut self) {
        self.near_indices.clear();
        self.points.clear();
    }

    fn push(&mut self, near_index: u32, xi: Vec3) {
        self.near_indices.push(near_index);
        self.points.push(CellPoint(xi));
    }
}

/// Opposite corners of a block: its first and its last sample in storage order.
fn ends(samples: &[LatticeSample]) -> [Vec3; 2] {
    match (samples.first(), samples.last()) {
        (Some(a), Some(b)) => [a.x, b.x],
        _ => [Vec3::zeros(); 2],
    }
}

/// Centre and radius of a ball around a block of samples.
fn bounding_ball(samples: &[LatticeSample]) -> (Vec3, f64) {
    let [a, b] = ends(samples);
    ((a + b) / 2.0, (b - a).norm() / 2.0)
}

/// Four corners of a block, no two on an edge. An error that is an odd or an even function of the distance
/// from the centre has the same size at the other four.
fn tetrahedron_corners(samples: &[LatticeSample]) -> [Vec3; 4] {
    let [a, b] = ends(samples);
    [
        a,
        Vec3::new(a.x, b.y, b.z),
        Vec3::new(b.x, a.y, b.z),
        Vec3::new(b.x, b.y, a.z),
    ]
}

impl TiledSolid<'_> {
    /// Distances at samples, given block by block in the order of a lattice, cut at the boundary.
    pub(super) fn fill_curved(
        &self,
        component: usize,
        local: &mut LocalSearch,
        blocks: &[Vec<LatticeSample>],
        known: RegionFacts,
        batch: &mut CurvedBatch,
        out: &mut [f32],
    ) {
        self.find_blocks(local, blocks, batch);
        batch.clear_items();
        batch.open.clear();
        batch.exterior.clear();
        let w = self.options.half_width;
        let mut found = |t: &LatticeSample, d: f64| {
            if known.is_needed(t.n) {
                out[t.n as usize] = self.cut_at_boundary(component, d, t.x, known) as f32;
            }
        };
        let whole = std::mem::take(&mut batch.blocks);
        let mut next = 0;
        for (number, samples) in blocks.iter().enumerate() {
            // Samples of blocks that lie in no single element are located one by one.
            let Some(block) = whole.get(next).filter(|b| b.number == number) else {
                let needed = samples.iter().filter(|t| known.is_needed(t.n));
                batch.open.extend(needed);
                continue;
            };
            // L (R + d): with |F| of that at the centre, all samples, at most R away, are at least d from the surface.
            let change = |reach: f64| self.max_change(&local.near, block.radius + reach);
            if block.f >= change(known.wanted.hi) {
                for t in samples {
                    found(t, w);
                }
            } else if block.f <= -change(-known.wanted.lo) {
                for t in samples {
                    found(t, -w);
                }
            } else {
                self.push_block(local, samples, (block, known), batch);
            }
            next += 1;
        }
        batch.blocks = whole;
        self.push_open(local, batch);
        self.evaluate_items(local, known, batch, |t, d| {
            out[t.n as usize] = self.cut_at_boundary(component, d, t.x, known) as f32;
        });
        if !batch.exterior.is_empty() {
            self.fill_exterior_samples(component, local, known, batch, out);
        }
    }

    /// Passes the distances at all items to `found`.
    fn evaluate_items(
        &self,
        local: &LocalSearch,
        known: RegionFacts,
        batch: &mut CurvedBatch,
        mut found: impl FnMut(&LatticeSample, f64),
    ) {
        self.evaluate_owners(local, batch);
        self.collect_contributions(local, known, batch, &mut found);
        self.blend(local, batch, &mut found);
    }

    /// Finds the blocks within one element, and evaluates the field at their centres.
    fn find_blocks(
        &self,
        local: &mut LocalSearch,
        blocks: &[Vec<LatticeSample>],
        batch: &mut CurvedBatch,
    ) {
        batch.blocks.clear();
        batch.local_maps.clear();
        batch.evaluation_points.clear();
        batch.at.clear();
        batch.at.extend(blocks.iter().map(|b| bounding_ball(b).0));
        let CurvedBatch { at, owners, .. } = batch;
        self.owners(local, at, &mut batch.owner_buffers, owners);
        for (number, (&x, owner)) in at.iter().zip(owners).enumerate() {
            let Some(Owner {
                near_index,
                preimage,
            }) = owner
            else {
                continue;
            };
            let patch = self.patch(local, *near_index);
            let (radius, depth) = (bounding_ball(&blocks[number]).1, patch.depth(preimage));
            if depth <= radius {
                continue;
            }
            // Second derivatives change little from block to block.
            let last = batch.blocks.last().filter(|b| b.near_index == *near_index);
            let local_map = match last {
                Some(last) => batch.local_maps[last.local_map as usize].recentred(x, preimage),
                None => self.store_local_map(local, *near_index, x, preimage),
            };
            let error = patch.local_map_error(
                self.scaffold,
                &local_map,
                tetrahedron_corners(&blocks[number]),
            );
            let is_local_map_accurate = error < LOCAL_MAP_TOLERANCE;
            batch.local_maps.push(local_map);
            batch
                .evaluation_points
                .push(*near_index as u32, preimage.xi);
            batch.blocks.push(Block {
                number,
                near_index: *near_index,
                radius,
                local_map: batch.local_maps.len() as u32 - 1,
                is_local_map_accurate,
                depth,
                f: 0.0,
            });
        }
        self.evaluate_values(local, batch);
        for (block, &f) in batch.blocks.iter_mut().zip(&batch.values) {
            block.f = f;
        }
    }

    /// Adds the needed samples of a block within one element.
    fn push_block(
        &self,
        local: &LocalSearch,
        samples: &[LatticeSample],
        (block, known): (&Block, RegionFacts),
        batch: &mut CurvedBatch,
    ) {
        // Depths beyond a voxel need no exact value.
        let min_depth = block.depth - block.radius;
        let patch = self.patch(local, block.near_index);
        let samples = samples.iter().filter(|t| known.is_needed(t.n));
        batch.at.clear();
        batch.at.extend(samples.clone().map(|t| t.x));
        if block.is_local_map_accurate {
            let first = batch.evaluation_points.points.len();
            let local_map = &batch.local_maps[block.local_map as usize];
            local_map.estimate_all(&batch.at, &mut batch.evaluation_points.points);
            let near_index = block.near_index as u32;
            batch
                .evaluation_points
                .near_indices
                .resize(batch.evaluation_points.points.len(), near_index);
            for (&sample, xi) in samples.zip(&batch.evaluation_points.points[first..]) {
                let depth = if min_depth < self.delta() {
                    patch.depth_at(sample.x, xi.0)
                } else {
                    min_depth
                };
                batch.items.push(PendingSample {
                    sample,
                    near_index,
                    jacobian: JacobianSource::Local(block.local_map),
                    depth,
                });
            }
            return;
        }
        let mut found = std::mem::take(&mut batch.found);
        let all = (&*batch.at, f64::INFINITY);
        let mut local_map = batch.local_maps[block.local_map as usize];
        let for_f32 = true; // Distances are stored so.
        patch.preimages(self.scaffold, all, (&mut local_map, for_f32), &mut found);
        for (&sample, preimage) in samples.zip(&found.all) {
            match preimage {
                Some(preimage) => {
                    let near_index = block.near_index;
                    let owner = Owner {
                        near_index,
                        preimage: *preimage,
                    };
                    batch.push_single(sample, &owner, patch);
                }
                None => batch.open.push(sample),
            }
        }
        batch.found = found;
    }

    /// Finds the owners of open samples and adds them. Samples without an owner are exterior.
    fn push_open(&self, local: &mut LocalSearch, batch: &mut CurvedBatch) {
        let CurvedBatch {
            open, at, owners, ..
        } = batch;
        at.clear();
        at.extend(open.iter().map(|t| t.x));
        self.owners(local, at, &mut batch.owner_buffers, owners);
        let owners = std::mem::take(&mut batch.owners);
        for (n, owner) in owners.iter().enumerate() {
            let sample = batch.open[n];
            if let Some(owner) = owner {
                batch.push_single(sample, owner, self.patch(local, owner.near_index));
            } else {
                batch.exterior.push(sample);
            }
        }
        batch.owners = owners;
    }

    /// Evaluates value and gradient at all items, in their owners.
    fn evaluate_owners(&self, local: &LocalSearch, batch: &mut CurvedBatch) {
        let CurvedBatch {
            evaluation_points,
            owner_slopes,
            ..
        } = &mut *batch;
        owner_slopes.resize(evaluation_points.points.len(), (0.0, Vec3::zeros()));
        let mut first = 0;
        for run in evaluation_points.near_indices.chunk_by(|a, b| a == b) {
            let all = first..first + run.len();
            first = all.end;
            let near_index = run[0] as usize;
            self.evaluate_slopes(
                local,
                near_index,
                &evaluation_points.points[all.clone()],
                &mut owner_slopes[all],
            );
        }
        batch.evaluations += batch.evaluation_points.points.len() as u64;
    }

    /// Evaluates values and gradients at points of one of the near elements.
    fn evaluate_slopes(
        &self,
        local: &LocalSearch,
        near_index: usize,
        points: &[CellPoint<3>],
        slopes: &mut [(f64, Vec3)],
    ) {
        let element = local.near.patches[near_index] as usize;
        self.filling.values_and_gradients(element, points, slopes);
    }

    /// Evaluates the field at all evaluation points.
    fn evaluate_values(&self, local: &LocalSearch, batch: &mut CurvedBatch) {
        let CurvedBatch {
            evaluation_points,
            values,
            ..
        } = &mut *batch;
        values.resize(evaluation_points.points.len(), 0.0);
        let mut first = 0;
        for run in evaluation_points.near_indices.chunk_by(|a, b| a == b) {
            let element = local.near.patches[run[0] as usize] as usize;
            let all = first..first + run.len();
            first = all.end;
            self.filling.values(
                element,
                &evaluation_points.points[all.clone()],
                &mut values[all],
            );
        }
        batch.evaluations += batch.evaluation_points.points.len() as u64;
    }
}

impl CurvedBatch {
    fn clear_items(&mut self) {
        self.items.clear();
        self.single_inverses.clear();
        self.evaluation_points.clear();
    }

    /// Adds a sample with the preimage that Newton's method found in its owner.
    fn push_single(&mut self, sample: LatticeSample, owner: &Owner, patch: &Patch) {
        let preimage = &owner.preimage;
        self.single_inverses.push(preimage.inverse);
        let jacobian = JacobianSource::Single(self.single_inverses.len() as u32 - 1);
        let (near_index, depth) = (owner.near_index as u32, patch.depth(preimage));
        self.evaluation_points.push(near_index, preimage.xi);
        self.items.push(PendingSample {
            sample,
            near_index,
            jacobian,
            depth,
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::{scaffold::Kind, tiling::affine::tests::check_wave};
    use druse_geometry::frame::Vec3;

    #[test]
    fn a_wave_along_a_sector_of_a_tube_has_the_distances_of_its_planes() {
        let bent = |p: Vec3| Vec3::new((1.5 + p.x) * p.y.cos(), (1.5 + p.x) * p.y.sin(), p.z);
        check_wave(Kind::Tet10, bent, Vec3::new(1.5, 0.05, -0.25));
    }
}
