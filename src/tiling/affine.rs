//! The tiling's values in bulk among straight elements, whose maps are affine: whole rows of samples are
//! placed in an element without a search.
//!
//! Samples go by blocks of 2^3. The field at a block's centre decides most of them: with L the slope's
//! bound and R the block's half diagonal, |F| >= L (R + w) there means |F| >= L w at all samples, whatever
//! elements they lie in: F is continuous but where a scaffold overlaps itself, which shows in that the
//! centre lies in several elements. What is left goes through rule Q by eight blocks at a time.
//! What lies outside the scaffold waits, and is measured at the boundary's closest points by as many.

mod block;
mod distances;
mod exterior;
mod newton_steps;
mod rule;
mod sample_batch;

use super::boundary::Known;
use super::fill::{BLOCK, PartOfLattice, parts};
use super::locality::{NEIGHBOUR, Near, near_surface};
use super::{Filling, TiledSolid};
use crate::field::{Interval, SampleLattice};
use crate::frame::{Vec3, WorldPoint};
use block::{Along, Block, Part, Scene, VOLUME, place};
use exterior::{GAP, Stray};
use rule::Rule;
pub(super) use rule::Wanted;
use sample_batch::{Bundle, MOST, bits};

/// With more near elements than this the parts of a lattice are taken one by one.
const MANY: usize = 24;
/// With more than this elements are not placed by the row: what is kept of each takes 2 KiB.
pub(super) const CROWD: usize = 1024;

/// Room for the work, kept between lattices.
#[derive(Default)]
pub(super) struct Straight {
    parts: Vec<Part>,
    blocks: Vec<Block>,
    bundle: Bundle,
    centres: Rule,
    samples: Rule,
    /// Of the near elements those that matter to a bundle, by place.
    places: Vec<u32>,
    strays: Vec<Stray>,
    /// Triangles of the boundary that may show, part by part.
    shores: Vec<u32>,
    along: [Vec<Along>; 3],
    /// Elements near a part, where many are near the lattice.
    few: Near,
    /// Whether some sample, as far from the surface as the half width, may have a neighbour of the other sign.
    is_open: bool,
    /// At how many points a cell was looked at.
    pub looked: u64,
}

impl Straight {
    fn clear(&mut self) {
        self.parts.clear();
        self.blocks.clear();
        self.shores.clear();
    }

    /// Whether all samples out of the band are proved to have their neighbours' sign.
    pub fn is_settled(&self) -> bool {
        !(self.is_open || self.samples.is_open)
    }
}

impl<F: Filling> TiledSolid<'_, F> {
    /// Whether all of some elements are straight.
    pub(super) fn are_straight(&self, near: &Near) -> bool {
        let mut all = near.patches.iter();
        all.all(|&e| self.patches[e as usize].is_affine())
    }

    /// The field at those of some points that lie in a single element, all near ones being straight.
    pub(super) fn field_at<const N: usize>(
        &self,
        near: &Near,
        points: [Vec3; N],
        room: &mut Straight,
    ) -> [Option<f64>; N] {
        let mut values = [0.0; MOST];
        room.bundle.clear();
        for x in points {
            room.bundle.push(x.into(), true);
        }
        room.bundle.fill_up();
        let patches = near.patches.iter().map(|&e| &self.patches[e as usize]);
        room.centres.place(patches, &room.bundle, self.delta());
        self.field_of(near, &mut room.centres, &mut values);
        let single = room.centres.single;
        std::array::from_fn(|n| (single >> n & 1 != 0).then_some(values[n % MOST]))
    }

    /// Values of one component among straight elements, its boundary included; `depth` bounds the distance
    /// to the boundary.
    pub(super) fn fill_straight(
        &self,
        (component, near): (usize, &Near),
        (lattice, wanted): (&SampleLattice<WorldPoint>, Wanted),
        (depth, shore): (Interval, Option<&[u32]>),
        room: &mut Straight,
        out: &mut [f32],
    ) {
        self.expect((lattice.step, wanted, depth), room);
        let mut along = std::mem::take(&mut room.along);
        for (axis, along) in along.iter_mut().enumerate() {
            along.clear();
            along.extend(Along::all(lattice, axis));
        }
        let whole = Scene {
            component,
            near,
            lattice,
            wanted,
            shore,
            shores: &[],
            along: &along,
            offsets: std::array::from_fn(|n| {
                let [i, j, k] = place(n);
                (i * lattice.counts[1] + j) * lattice.counts[2] + k
            }),
        };
        if near.patches.len() <= MANY {
            room.clear();
            for part in parts(lattice) {
                let own = self.depth_of(&whole, &part, depth);
                self.enter(&whole, &part, own, room, out);
            }
            self.fill_entered(&whole, room, out);
            room.along = along;
            return;
        }
        let mut few = std::mem::take(&mut room.few);
        for part in parts(lattice) {
            room.clear();
            let own = self.depth_of(&whole, &part, depth);
            let region = part.span(lattice).dilated(self.reach(own.hi));
            self.keep_near(near, &region, &mut few);
            let scene = Scene {
                near: &few,
                ..whole
            };
            self.enter(&scene, &part, own, room, out);
            self.fill_entered(&scene, room, out);
        }
        room.few = few;
        room.along = along;
    }

    /// Prepares to prove that samples out of the band have their neighbours' sign, if they all lie deep in the
    /// scaffold: |F| changes between neighbours by less than what makes a block or a sample far.
    fn expect(&self, (step, wanted, depth): (f64, Wanted, Interval), room: &mut Straight) {
        let w = self.options.half_width;
        let away = NEIGHBOUR * step;
        // A neighbour may lie in an element further away.
        let change = self.steepest * away;
        room.is_open =
            wanted == Wanted::Signs || depth.hi > -w || away > near_surface(self.options);
        room.samples.is_open = false;
        room.samples.change = change;
    }

    /// Bounds of the distance to the boundary over a part of a lattice, within those of the whole.
    fn depth_of(&self, scene: &Scene, part: &PartOfLattice, whole: Interval) -> Interval {
        if whole.hi <= -self.options.half_width {
            return whole;
        }
        let around = (scene.shore, &*scene.near.patches);
        self.boundary_range(scene.component, &part.span(scene.lattice), whole, around)
    }

    /// Enters the blocks of a part that its depth does not decide.
    fn enter(
        &self,
        scene: &Scene,
        part: &PartOfLattice,
        depth: Interval,
        room: &mut Straight,
        out: &mut [f32],
    ) {
        let w = self.options.half_width;
        if self.is_cut() && depth.lo >= w {
            part.indices(scene.lattice).for_each(|n| out[n] = w as f32);
            return;
        }
        let number = room.parts.len();
        let is_deep = depth.hi <= -w;
        let first = room.shores.len();
        if let Some(shore) = scene.shore.filter(|_| !is_deep) {
            let span = part.span(scene.lattice);
            let boundary = &self.components[scene.component].boundary;
            boundary.collect_among(shore, &span, self.sight(), &mut room.shores);
        }
        room.parts.push(Part {
            is_deep,
            shore: [first, room.shores.len()],
            distance: depth.hi.abs().max(depth.lo.abs()),
            reach: self.reach(depth.hi),
        });
        let along = |a: usize| {
            let (first, last) = (part.first[a], part.last[a]);
            (0..=(last - first) / BLOCK).map(move |n| first + n * BLOCK)
        };
        for (i, j) in along(0).flat_map(|i| along(1).map(move |j| (i, j))) {
            let block = |k| Block::new([i, j, k], number, scene);
            room.blocks.extend(along(2).map(block));
        }
    }

    /// Values of all blocks that have been entered.
    fn fill_entered(&self, scene: &Scene, room: &mut Straight, out: &mut [f32]) {
        let shores = std::mem::take(&mut room.shores);
        let scene = Scene {
            shores: &shores,
            ..*scene
        };
        self.fill_blocks(&scene, room, out);
        self.fill_strays(&scene, room, out);
        room.shores = shores;
    }

    fn fill_blocks(&self, scene: &Scene, room: &mut Straight, out: &mut [f32]) {
        let step = scene.lattice.step;
        let w = self.options.half_width;
        let reach = match scene.wanted {
            Wanted::Distances => w,
            // More than rounding.
            Wanted::Signs => 1e-3 * step,
        };
        let mut values = [0.0; MOST];
        room.is_open |= room.samples.change > w * scene.near.slope_sup;
        let all = std::mem::take(&mut room.blocks);
        for blocks in all.chunks(MOST) {
            room.bundle.clear();
            for block in blocks {
                room.bundle.push(block.middle(scene), true);
            }
            room.bundle.fill_up();
            let near = scene.near.patches.iter();
            let patches = near.map(|&e| &self.patches[e as usize]);
            // A voxel's margin is enough for reference coordinates of what elements own.
            room.centres.place(patches, &room.bundle, self.delta());
            self.field_of(scene.near, &mut room.centres, &mut values);
            let single = room.centres.single;
            room.looked += u64::from(room.centres.owned.count_ones());
            let mut far = 0u64;
            for (n, (block, value)) in blocks.iter().zip(&values).enumerate() {
                let least = self.rise(scene.near, block.radius + reach);
                far |= u64::from(value.abs() >= least) << n;
            }
            let mut open = room.bundle.real & !(far & single);
            for n in bits(far & single) {
                let block = &blocks[n];
                let part = &room.parts[block.part()];
                // All of a deep block lies in elements; of others one must hold it, and no other reach in.
                let holds = || {
                    let mut all = room.centres.placed[..scene.near.patches.len()].iter();
                    all.all(|p| p.outside(n).abs() >= block.radius)
                };
                if !(part.is_deep || holds()) {
                    open |= 1 << n;
                    continue;
                }
                let d = if values[n] < 0.0 { -w } else { w };
                if part.is_deep && block.is_whole() {
                    scene.fill(block, &[d as f32; VOLUME], out);
                    continue;
                }
                let known = scene.known(part);
                for n in bits(u64::from(block.places)) {
                    let ended = self.ended(scene, d, (block, n), known);
                    out[scene.index(block, n)] = ended as f32;
                }
            }
            let mut numbers = [0; MOST];
            for (to, n) in numbers.iter_mut().zip(bits(open)) {
                *to = n;
            }
            for group in numbers[..open.count_ones() as usize].chunks(MOST / VOLUME) {
                self.fill_group(scene, (blocks, group), room, out);
            }
        }
        room.blocks = all;
    }

    /// The distance `d` at a sample of the scaffold, the boundary regarded.
    #[inline]
    fn ended(&self, scene: &Scene, d: f64, (block, n): (&Block, usize), known: Known) -> f64 {
        if known.is_deep || !self.is_cut() {
            return d;
        }
        match scene.wanted {
            Wanted::Distances => self.cut(scene.component, d, scene.point(block, n), known),
            // Only on the boundary itself does the sign change.
            Wanted::Signs if d >= 0.0 => d,
            Wanted::Signs => {
                let near = -self.on_boundary();
                let at = scene.point(block, n);
                if self.cut(scene.component, near, at, known) < 0.0 {
                    d
                } else {
                    0.0
                }
            }
        }
    }

    /// Values of some blocks, given by their numbers, whose centres have been placed.
    fn fill_group(
        &self,
        scene: &Scene,
        (blocks, group): (&[Block], &[usize]),
        room: &mut Straight,
        out: &mut [f32],
    ) {
        let Straight {
            parts,
            bundle,
            centres,
            samples,
            places,
            strays,
            is_open,
            looked,
            ..
        } = room;
        bundle.clear();
        for &n in group {
            bundle.push_block(blocks[n].ends(scene), blocks[n].places.into());
        }
        // What is within reach of a sample is within reach of its block's centre and the radius.
        let margin = |n: usize| {
            let block = &blocks[n];
            block.radius + self.delta() + parts[block.part()].reach
        };
        places.clear();
        for (place, placed) in (0..scene.near.patches.len() as u32).zip(&centres.placed) {
            if group.iter().any(|&n| placed.outside(n) <= margin(n)) {
                places.push(place);
            }
        }
        self.rule_q((scene.near, places), bundle, scene.wanted, samples);
        *looked += u64::from(samples.owned.count_ones());
        for (number, &n) in group.iter().enumerate() {
            let block = &blocks[n];
            let part = &parts[block.part()];
            let first = number * VOLUME;
            let owned = samples.owned >> first & 0xff;
            if part.is_deep && owned == 0xff {
                let d = samples.found.row(number).map(|d| d as f32);
                scene.fill(block, &d, out);
                continue;
            }
            let known = scene.known(part);
            for n in bits(u64::from(block.places)) {
                let index = scene.index(block, n);
                if owned >> n & 1 != 0 {
                    let d = samples.found.d(first + n);
                    out[index] = self.ended(scene, d, (block, n), known) as f32;
                    continue;
                }
                *is_open = true;
                let stray = Stray {
                    n: index,
                    x: bundle.point(first + n),
                    part: block.part(),
                };
                let outside = samples.outside(places.len(), first + n);
                if outside <= GAP * self.options.voxel_size {
                    // Perhaps in a gap between elements.
                    out[index] = self.alone(scene, &stray, known) as f32;
                } else if self.is_cut() && scene.wanted == Wanted::Signs {
                    out[index] = self.options.half_width as f32;
                } else {
                    strays.push(stray);
                }
            }
        }
    }
}
