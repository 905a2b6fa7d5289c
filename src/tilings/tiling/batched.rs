//! Rule Q (module `rule`) on lattices of samples, in batches of 64 points.
//!
//! Samples are grouped in blocks of 2^3. The field F at a block's centre decides most blocks. Only distances between
//! two limits d- <= 0 <= d+ are wanted in a part of 4^3 samples: -w and w with the half width w of the band, or less
//! where other fields decide. With L the slope bound and R the block's half diagonal, F >= L (R + d+) at the centre
//! implies F >= L d+ and so d >= d+ at all samples, whatever elements they are in; F <= -L (R - d-) is the same below.
//! F is continuous except where a scaffold overlaps itself, where the centre is in several elements; near the boundary
//! only blocks within one element are decided so. The other blocks go through rule Q, eight at a time. Samples outside
//! the scaffold are collected and evaluated at the closest points of the boundary, 64 at a time.
//!
//! Points lie in rows of eight by coordinate; masks have a bit for each point. Single precision, and in curved elements
//! the tolerances of Newton's method and of expansions, are all that differs from single points; the laws in
//! tests/it/tiling of `affine` and `curved` measure it. The distance is d = F s; `rule` computes the scale s and its
//! blend across faces.

mod block;
mod distances;
mod expansions;
mod exterior;
mod locate;
mod newton_steps;
mod rule;
mod sample_batch;

use super::TiledSolid;
use super::boundary::{KnownSide, RegionFacts};
use super::fill::{FillRequest, PartOfLattice, parts};
use super::locality::{LocalSearch, NEIGHBOUR_DISTANCE, NearElements, near_surface_distance};
use block::{BLOCK_EDGE, BLOCK_VOLUME, Block, BlockSpan, FillContext, Part, sample_offset};
use druse_geometry::field::Interval;
use druse_geometry::frame::Vec3;
use expansions::BlockCentres;
use exterior::{ExteriorSample, GAP_TOLERANCE};
use locate::BatchLocations;
pub(super) use locate::PointLocations;
use rule::BatchEvaluation;
use sample_batch::{MAX_SAMPLES, SampleBatch, bits};

/// With more near elements than this, each part of a lattice has its own list of candidates.
const MAX_SHARED_CANDIDATES: usize = 24;
/// With more elements than this near a part, batches are not used: their data take 6 KiB for each element.
const MAX_BATCHED_ELEMENTS: usize = 1024;

/// Buffers, reused from lattice to lattice.
#[derive(Default)]
pub(super) struct BatchBuffers {
    parts: Vec<Part>,
    blocks: Vec<Block>,
    batch: SampleBatch,
    /// At the centres of blocks.
    centres: BatchEvaluation,
    /// At the samples of undecided blocks.
    samples: BatchEvaluation,
    /// Indices of the near elements within reach of a batch.
    near_indices: Vec<u32>,
    exterior: Vec<ExteriorSample>,
    /// Samples beside curved faces, and their locations in an element.
    faded_samples: SampleBatch,
    foot_locations: BatchLocations,
    /// Boundary triangles that may affect a part, part by part.
    part_triangles: Vec<u32>,
    /// Spans of the blocks along each axis.
    block_spans: [Vec<BlockSpan>; 3],
    /// Elements near a part, where many elements are near the lattice.
    candidates: NearElements,
    /// A point of the lattice on a known side of the boundary; set before each lattice.
    pub known_side: Option<KnownSide>,
    /// Whether some sample out of the band may have a neighbour of the other sign.
    has_unproved_sign: bool,
    /// Number of cell evaluations.
    pub evaluations: u64,
}

impl BatchBuffers {
    /// Starts over with these near elements.
    fn start(&mut self, near: &NearElements) {
        self.parts.clear();
        self.blocks.clear();
        self.part_triangles.clear();
        self.centres.start(near);
        self.samples.start(near);
    }

    /// Whether it is proved that all samples out of the band have the sign of their neighbours.
    pub fn are_signs_proved(&self) -> bool {
        !(self.has_unproved_sign || self.samples.has_unproved_sign)
    }
}

impl TiledSolid<'_> {
    /// Whether all near elements are affine.
    fn are_affine(&self, near: &NearElements) -> bool {
        let mut all = near.patches.iter();
        all.all(|&e| self.patches[e as usize].is_affine())
    }

    /// A distance outside an element beyond which it owns no point, despite rounding.
    fn owner_reach(&self) -> f64 {
        1e-3 * self.delta()
    }

    /// The field at the points that are in exactly one element, `None` at others.
    pub(super) fn field_at<const N: usize>(
        &self,
        near: &NearElements,
        points: [Vec3; N],
        buffers: &mut BatchBuffers,
    ) -> [Option<f64>; N] {
        let mut values = [0.0; MAX_SAMPLES];
        buffers.batch.clear();
        for x in points {
            buffers.batch.push(x.into());
        }
        buffers.batch.fill_up();
        buffers.centres.start(near);
        let all = 0..near.patches.len() as u32;
        let batch = (&buffers.batch, self.owner_reach(), None);
        self.locate(near, all, batch, &mut buffers.centres);
        self.evaluate_owned(near, &mut buffers.centres, &mut values);
        // Points in several elements or in none have no single value here: they come back as `None`.
        let single = buffers.centres.single;
        std::array::from_fn(|n| (single >> n & 1 != 0).then_some(values[n % MAX_SAMPLES]))
    }

    /// Values of one component, cut at its boundary; `depth` bounds the distance to it.
    pub(super) fn fill_batched(
        &self,
        component: usize,
        near: &NearElements,
        request: &FillRequest,
        (depth, boundary_triangles): (Interval, Option<&[u32]>),
        buffers: &mut BatchBuffers,
        out: &mut [f32],
    ) {
        let FillRequest { lattice, limits } = *request;
        self.start_sign_proof(request, depth, buffers);
        // The buffer is taken out while `whole` borrows it, and put back before each return.
        let mut block_spans = std::mem::take(&mut buffers.block_spans);
        for (axis, spans) in block_spans.iter_mut().enumerate() {
            spans.clear();
            spans.extend(BlockSpan::all(lattice, axis));
        }
        let whole = FillContext {
            component,
            near,
            is_affine: self.are_affine(near),
            lattice,
            limits,
            boundary_triangles,
            part_triangles: &[],
            block_spans: &block_spans,
            offsets: std::array::from_fn(|n| {
                let [i, j, k] = sample_offset(n);
                (i * lattice.counts[1] + j) * lattice.counts[2] + k
            }),
        };
        // Few elements: all parts share them, so that batches of 64 points fill across parts.
        if near.patches.len() <= MAX_SHARED_CANDIDATES {
            buffers.start(near);
            for part in parts(lattice) {
                let Some(wanted) = request.wanted_in(&part, self.options.half_width) else {
                    continue;
                };
                let own = self.part_depth(&whole, &part, depth, &mut buffers.known_side);
                if !self.is_far_outside(own, wanted) {
                    self.add_part(&whole, &part, own, wanted, buffers);
                }
            }
            self.fill_parts(&whole, buffers, out);
            buffers.block_spans = block_spans;
            return;
        }
        // Many elements: each part keeps only those within reach, since each batch is located in all of its elements.
        let mut candidates = std::mem::take(&mut buffers.candidates);
        for part in parts(lattice) {
            let Some(wanted) = request.wanted_in(&part, self.options.half_width) else {
                continue;
            };
            let own = self.part_depth(&whole, &part, depth, &mut buffers.known_side);
            if self.is_far_outside(own, wanted) {
                continue;
            }
            let region = part.span(lattice).dilated(self.continuation_reach(own.hi));
            self.filter_near(near, &region, &mut candidates);
            if candidates.patches.len() > MAX_BATCHED_ELEMENTS {
                let known = RegionFacts {
                    max_boundary_distance: own.hi.abs().max(own.lo.abs()),
                    is_deep: own.hi <= self.deep_distance(wanted),
                    wanted,
                    ..RegionFacts::UNKNOWN
                };
                self.fill_one_by_one(&whole, &part, (&candidates, known), buffers, out);
                continue;
            }
            buffers.start(&candidates);
            let context = FillContext {
                near: &candidates,
                is_affine: self.are_affine(&candidates),
                ..whole
            };
            self.add_part(&context, &part, own, wanted, buffers);
            self.fill_parts(&context, buffers, out);
        }
        buffers.candidates = candidates;
        buffers.block_spans = block_spans;
    }

    /// Values of a part near very many elements, point by point.
    fn fill_one_by_one(
        &self,
        context: &FillContext,
        part: &PartOfLattice,
        (near, known): (&NearElements, RegionFacts),
        buffers: &mut BatchBuffers,
        out: &mut [f32],
    ) {
        buffers.has_unproved_sign = true;
        let mut local = LocalSearch::new(near.clone());
        for n in part.indices(context.lattice) {
            if context.limits.is_none_or(|l| l.is_needed(n)) {
                let x = context.lattice.point(n).0;
                out[n] = self.value_at(context.component, &mut local, x, known) as f32;
                buffers.evaluations += 1;
            }
        }
    }

    /// Starts the proof that samples out of the band have the sign of their neighbours. It requires that all of
    /// them lie deep in the scaffold. Then |F| changes less between neighbours than the bound that puts a block
    /// or a sample out of the band.
    fn start_sign_proof(&self, request: &FillRequest, depth: Interval, buffers: &mut BatchBuffers) {
        let w = self.options.half_width;
        let away = NEIGHBOUR_DISTANCE * request.lattice.step;
        // The neighbour may be in another element, so the greatest slope of all elements counts.
        let change = self.max_slope_sup * away;
        buffers.has_unproved_sign =
            request.limits.is_some() || depth.hi > -w || away > near_surface_distance(self.options);
        buffers.samples.has_unproved_sign = false;
        buffers.samples.change = change;
    }

    /// Bounds of the distance to the boundary over a part of a lattice; `lattice_depth` holds those over all of it.
    fn part_depth(
        &self,
        context: &FillContext,
        part: &PartOfLattice,
        lattice_depth: Interval,
        known_side: &mut Option<KnownSide>,
    ) -> Interval {
        // Deeper than the band, the boundary has no effect, and tighter bounds would change nothing.
        if lattice_depth.hi <= -self.options.half_width {
            return lattice_depth;
        }
        self.boundary_range(
            context.component,
            &part.span(context.lattice),
            lattice_depth,
            context.boundary_triangles,
            &context.near.patches,
            known_side,
        )
    }

    /// Whether a part is farther outside than the wanted distances: d = D beyond them everywhere, and its samples keep w.
    fn is_far_outside(&self, depth: Interval, wanted: Interval) -> bool {
        self.is_cut() && depth.lo >= wanted.hi
    }

    /// Adds the blocks of a part.
    fn add_part(
        &self,
        context: &FillContext,
        part: &PartOfLattice,
        depth: Interval,
        wanted: Interval,
        buffers: &mut BatchBuffers,
    ) {
        let number = buffers.parts.len();
        let is_deep = depth.hi <= self.deep_distance(wanted);
        let first = buffers.part_triangles.len();
        // Triangles matter only where the boundary may cut.
        if let Some(boundary_triangles) = context.boundary_triangles.filter(|_| !is_deep) {
            let span = part.span(context.lattice);
            let boundary = &self.components[context.component].boundary;
            boundary.collect_among(
                boundary_triangles,
                &span,
                self.boundary_reach(),
                &mut buffers.part_triangles,
            );
        }
        buffers.parts.push(Part {
            is_deep,
            is_outside: depth.lo > 0.0,
            triangle_range: [first, buffers.part_triangles.len()],
            max_boundary_distance: depth.hi.abs().max(depth.lo.abs()),
            reach: self.continuation_reach(depth.hi),
            wanted,
        });
        let along = |a: usize| {
            let (first, last) = (part.first[a], part.last[a]);
            (0..=(last - first) / BLOCK_EDGE).map(move |n| first + n * BLOCK_EDGE)
        };
        for (i, j) in along(0).flat_map(|i| along(1).map(move |j| (i, j))) {
            let block = |k| Block::new([i, j, k], number, context);
            let blocks = along(2).map(block);
            buffers.blocks.extend(blocks.filter(|b| b.sample_mask != 0));
        }
    }

    /// Values of all blocks of the parts added.
    fn fill_parts(&self, context: &FillContext, buffers: &mut BatchBuffers, out: &mut [f32]) {
        let part_triangles = std::mem::take(&mut buffers.part_triangles);
        let context = FillContext {
            part_triangles: &part_triangles,
            ..*context
        };
        self.fill_blocks(&context, buffers, out);
        self.fill_exterior(&context, buffers, out);
        buffers.part_triangles = part_triangles;
    }

    /// Values of all blocks: of most from their centres, of the others in groups of eight.
    fn fill_blocks(&self, context: &FillContext, buffers: &mut BatchBuffers, out: &mut [f32]) {
        let w = self.options.half_width;
        // Larger than rounding errors.
        let least_reach = 1e-3 * context.lattice.step;
        let mut values = [0.0; MAX_SAMPLES];
        // Signs are proved if |F| out of the band, at least w L, is more than it changes between neighbours.
        buffers.has_unproved_sign |= buffers.samples.change > w * context.near.slope_sup;
        let all = std::mem::take(&mut buffers.blocks);
        // The centres of up to 64 blocks make one batch.
        for blocks in all.chunks(MAX_SAMPLES) {
            buffers.batch.clear();
            for block in blocks {
                buffers.batch.push(block.centre(context));
            }
            buffers.batch.fill_up();
            let all = 0..context.near.patches.len() as u32;
            let batch = (&buffers.batch, self.owner_reach(), None);
            self.locate(context.near, all, batch, &mut buffers.centres);
            self.evaluate_owned(context.near, &mut buffers.centres, &mut values);
            let single = buffers.centres.single;
            buffers.evaluations += u64::from(buffers.centres.owned.count_ones());
            let mut far = 0u64;
            for (n, (block, value)) in blocks.iter().zip(&values).enumerate() {
                let wanted = buffers.parts[block.part()].wanted;
                // |F| >= L (R + d) at the centre, with the limit on its side.
                let reach = if *value < 0.0 { -wanted.lo } else { wanted.hi };
                let threshold =
                    self.max_change(context.near, block.radius + reach.max(least_reach));
                far |= u64::from(value.abs() >= threshold) << n;
            }
            // A centre in no element, or in several, decides nothing.
            let mut undecided = buffers.batch.active & !(far & single);
            for n in bits(far & single) {
                let block = &blocks[n];
                let part = &buffers.parts[block.part()];
                // A deep block lies wholly within elements. Any other block must lie in one element, and no other
                // element may reach into it.
                let is_in_one_element = || {
                    let mut all = buffers.centres.locations[..context.near.patches.len()].iter();
                    all.all(|p| p.has_no_face_within(n, block.radius))
                };
                if !(part.is_deep || is_in_one_element()) {
                    undecided |= 1 << n;
                    continue;
                }
                let d = if values[n] < 0.0 { -w } else { w };
                if part.is_deep && block.is_full() {
                    context.fill(block, &[d as f32; BLOCK_VOLUME], out);
                    continue;
                }
                // The field is far, but the boundary may still cut single samples.
                let known = context.region_facts(part);
                for n in bits(u64::from(block.sample_mask)) {
                    let cut = self.cut_sample(context, d, block, n, known);
                    out[context.storage_index(block, n)] = cut as f32;
                }
            }
            // Undecided blocks go on in groups of eight, which fill a batch with their 64 samples.
            let mut numbers = [0; MAX_SAMPLES];
            for (to, n) in numbers.iter_mut().zip(bits(undecided)) {
                *to = n;
            }
            for group in
                numbers[..undecided.count_ones() as usize].chunks(MAX_SAMPLES / BLOCK_VOLUME)
            {
                self.fill_group(context, blocks, group, buffers, out);
            }
        }
        buffers.blocks = all;
    }

    /// The distance of a sample after the cut at the boundary; `d` is that before it.
    #[inline]
    fn cut_sample(
        &self,
        context: &FillContext,
        d: f64,
        block: &Block,
        n: usize,
        known: RegionFacts,
    ) -> f64 {
        if known.is_deep || !self.is_cut() {
            return d;
        }
        self.cut_at_boundary(context.component, d, context.point(block, n), known)
    }

    /// Values of a group of blocks, given by number, whose centres have been located.
    fn fill_group(
        &self,
        context: &FillContext,
        blocks: &[Block],
        group: &[usize],
        buffers: &mut BatchBuffers,
        out: &mut [f32],
    ) {
        let BatchBuffers {
            parts,
            batch,
            centres,
            samples,
            near_indices,
            exterior,
            has_unproved_sign,
            evaluations,
            ..
        } = buffers;
        batch.clear();
        for &n in group {
            batch.push_block(blocks[n].ends(context), blocks[n].sample_mask.into());
        }
        // An element within reach of a sample is within reach of its block's centre plus the radius.
        let margin = |n: usize| {
            let block = &blocks[n];
            block.radius + self.delta() + parts[block.part()].reach
        };
        near_indices.clear();
        for (near_index, location) in (0..context.near.patches.len() as u32).zip(&centres.locations)
        {
            if group
                .iter()
                .any(|&n| location.least_outside(n) <= margin(n))
            {
                near_indices.push(near_index);
            }
        }
        let wanted = group
            .iter()
            .map(|&n| parts[blocks[n].part()].wanted)
            .fold(Interval::new(0.0, 0.0), Interval::hull);
        let voxel_size = self.options.voxel_size;
        let block_centres = (!context.is_affine)
            .then(|| BlockCentres::new((blocks, group), &centres.locations, voxel_size));
        let points = (&*batch, block_centres.as_ref());
        self.evaluate_rule_q(context.near, near_indices, points, wanted, samples);
        *evaluations += u64::from(samples.owned.count_ones());
        for (number, &n) in group.iter().enumerate() {
            let block = &blocks[n];
            let part = &parts[block.part()];
            let first = number * BLOCK_VOLUME;
            let owned = samples.owned >> first & 0xff;
            if part.is_deep && owned == 0xff {
                let d = samples.distances.row(number).map(|d| d as f32);
                context.fill(block, &d, out);
                continue;
            }
            let known = context.region_facts(part);
            for n in bits(u64::from(block.sample_mask)) {
                let index = context.storage_index(block, n);
                if owned >> n & 1 != 0 {
                    let d = samples.distances.d(first + n);
                    out[index] = self.cut_sample(context, d, block, n, known) as f32;
                    continue;
                }
                *has_unproved_sign = true;
                let sample = ExteriorSample {
                    n: index,
                    x: batch.point(first + n),
                    part: block.part(),
                };
                let outside = samples.outside(near_indices.len(), first + n);
                let is_lost = part.is_deep && !context.is_affine;
                if is_lost || outside <= GAP_TOLERANCE * self.options.voxel_size {
                    // The sample may be in a gap between elements, or Newton's method has failed.
                    out[index] = self.single_value(context, &sample, known) as f32;
                    *evaluations += 1;
                } else if self.is_cut() && part.wanted.hi <= 0.0 {
                    out[index] = self.options.half_width as f32;
                } else {
                    exterior.push(sample);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scaffold::{Connectivity, Kind, Scaffold};
    use crate::tiling::{TiledSolid, TilingOptions};
    use druse_cells::cell::of_terms;
    use druse_geometry::field::{Field, Point, SampleLattice};
    use druse_geometry::frame::{Vec3, WorldPoint};

    /// Samples near a zero of cos 2 pi z in an element whose map keeps z: as single points, and to its planes z = 1/4.
    fn check_wave(kind: Kind, map: impl Fn(Vec3) -> Vec3, zero: Vec3) {
        let wave = of_terms("wave", kind.shape(), Some("C1"), &[([0, 0, 1], [0.5, 0.0])]).unwrap();
        let nodes: Vec<Vec3> = kind.reference_nodes().iter().map(|xi| map(xi.0)).collect();
        let mut elements = Connectivity::default();
        elements.push(kind, &Vec::from_iter(0..nodes.len() as u32));
        let scaffold = Scaffold::new(nodes, elements).unwrap();
        let tiled = TiledSolid::new(&scaffold, &wave, TilingOptions::new(0.01)).unwrap();
        let lattice = SampleLattice {
            origin: WorldPoint(zero).stepped(-0.01, [2; 3]),
            step: 0.0123,
            counts: [5, 4, 6],
        };
        let mut values = [0f32; 120];
        tiled.fill(&lattice, &mut values);
        for (n, v) in values.map(f64::from).into_iter().enumerate() {
            let p = lattice.point(n);
            let d = (0.25 - p.0.z.abs()).clamp(-0.03, 0.03);
            assert!((v - d).abs() < 2e-6 && (v - tiled.value(p)).abs() < 2e-8);
        }
    }

    #[test]
    fn a_wave_in_a_sheared_tet_has_the_distances_of_its_planes() {
        let sheared = |p: Vec3| Vec3::new(1.2 * p.x + 0.4 * p.z, p.y + 0.3 * p.x, p.z);
        check_wave(Kind::Tet4, sheared, Vec3::new(0.05, 0.0, 0.25));
    }

    #[test]
    fn a_wave_along_a_sector_of_a_tube_has_the_distances_of_its_planes() {
        let bent = |p: Vec3| Vec3::new((1.5 + p.x) * p.y.cos(), (1.5 + p.x) * p.y.sin(), p.z);
        check_wave(Kind::Tet10, bent, Vec3::new(1.5, 0.05, -0.25));
    }
}
