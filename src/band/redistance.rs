//! Distances rebuilt from points of the surface: how a level set is moved by any distance at once.
//!
//! Where the surface crosses an edge of the voxel lattice lies a point of it, with a normal and second
//! derivatives from the voxels about it. The distance of a voxel is that to the surface through its
//! nearest point q: with h along the normal n, t across it and k = t H t / |t|^2 the curvature of the
//! distance's Hessian H that way,
//!
//! `d = h + k |t|^2 / (2 (1 + h k))`,
//!
//! exact to the second order in |t|, which is less than a voxel on a smooth surface, and never more than
//! |x - q|, which it is where |t| is more. Points at sharp edges and corners know the planes that meet
//! there, whose distance is exact. Signs are those of the level set. So the error does not grow with the
//! distance, whatever the values were beyond the voxels next to the surface, and half a cell's walls or
//! gaps are no limit.
//!
//! A voxel looks at what can be its nearest point only: of the points near a leaf, those near the
//! 4^3 and 2^3 voxels that it is in. A leaf depends on nothing but the points within reach of it, so that
//! threads, and bricks whose halo is as wide, do not show.

use super::index::Index;
use super::leaf::{LEAF, VOXELS};
use super::smooth::LeafRef;
use crate::frame::{Coord, Vec3};
use rayon::prelude::*;

mod block;
mod cache;
mod candidates;
mod field;
mod search;
mod surface_points;
mod wedge;

pub use field::ClosestPointField;

use block::Move;
use search::Search;
use surface_points::{NO_WEDGE, Point, Stencils};
use wedge::Wedge;

/// Least half width in voxels of a band whose surface has points: stencils reach two voxels beyond it.
const LEAST_HALF_WIDTH: f32 = 3.0;

/// Points of the surface of a level set, by the leaves that they lie in.
pub struct SurfacePoints {
    points: Vec<Point>,
    wedges: Vec<Wedge>,
    /// Where they lie, by coordinates.
    at: [Vec<f32>; 3],
    /// Origins of leaves that hold points, ascending, with the range of theirs.
    leaves: Vec<(Coord, std::ops::Range<u32>)>,
    index: Index,
    voxel_size: f32,
    background: f32,
}

/// What a move makes of a leaf.
#[derive(Clone, Debug)]
pub struct MovedLeaf {
    /// Which voxels are active.
    pub mask: [u64; 8],
    /// 512 signed distances, world units.
    pub values: [f32; VOXELS],
}

impl MovedLeaf {
    /// Takes back what the leaf held before of distances nearer than its background (world units).
    pub fn keep(&mut self, before: &LeafRef<'_>, background: f32) {
        let near = background * (1.0 - 1e-5);
        for (n, v) in before.values.iter().enumerate() {
            if before.mask[n >> 6] >> (n & 63) & 1 == 1 && v.abs() < near {
                self.values[n] = *v;
                self.mask[n >> 6] |= 1 << (n & 63);
            }
        }
    }
}

impl SurfacePoints {
    /// Whether a band of so many voxels on each side is wide enough.
    pub fn suffices(half_width: f64) -> bool {
        half_width as f32 >= LEAST_HALF_WIDTH
    }

    /// The points of a closed band: `leaf` gives those from 0 to `count`, from any thread, in ascending
    /// order of their origins. `voxel_size` and `background` (half width times voxel size) in world
    /// units. Runs on the calling pool of threads.
    pub fn new<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a> + Sync,
        voxel_size: f64,
        background: f32,
    ) -> Self {
        let all = indexed(count, &leaf);
        let voxel_size = voxel_size as f32;
        let found = (0..count)
            .into_par_iter()
            .with_min_len(32)
            .map_init(Stencils::default, |stencils, n| {
                points_of(&leaf, (n, &all), stencils, (voxel_size, background))
            })
            .collect();
        Self::joined(found, voxel_size, background)
    }

    /// The points of some of a band's leaves, those that `wants` names, without the calling pool of threads.
    pub(super) fn of_leaves<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a>,
        wants: impl Fn(Coord) -> bool,
        (voxel_size, background): (f64, f32),
    ) -> Vec<LeafPoints> {
        let all = indexed(count, &leaf);
        let lengths = (voxel_size as f32, background);
        let mut stencils = Stencils::default();
        let wanted = (0..count).filter(|&n| wants(leaf(n).origin));
        let found = wanted.map(|n| points_of(&leaf, (n, &all), &mut stencils, lengths));
        found.filter(|f| !f.points.is_empty()).collect()
    }

    /// The points of all leaves, in order of the leaves.
    pub(super) fn joined(found: Vec<LeafPoints>, voxel_size: f32, background: f32) -> Self {
        let mut surface = Self {
            points: Vec::with_capacity(found.iter().map(|f| f.points.len()).sum()),
            wedges: Vec::new(),
            at: Default::default(),
            leaves: Vec::new(),
            index: Index::default(),
            voxel_size,
            background,
        };
        for mut leaf in found.into_iter().filter(|f| !f.points.is_empty()) {
            let first = surface.points.len() as u32;
            let before = surface.wedges.len() as u32;
            for point in leaf.points.iter_mut().filter(|p| p.wedge != NO_WEDGE) {
                point.wedge += before;
            }
            surface.wedges.extend(leaf.wedges);
            for (a, at) in surface.at.iter_mut().enumerate() {
                at.extend(leaf.points.iter().map(|p| p.at[a]));
            }
            surface.points.extend(leaf.points);
            surface.index.enter(leaf.origin, surface.leaves.len());
            let range = first..surface.points.len() as u32;
            surface.leaves.push((leaf.origin, range));
        }
        surface
    }

    /// Memory that they take, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.points.len() * (size_of::<Point>() + size_of::<[f32; 3]>())
            + self.wedges.len() * size_of::<Wedge>()
            + self.leaves.len() * size_of::<(Coord, std::ops::Range<u32>)>()
            + self.index.bytes()
    }

    /// The same points, for a band of another background (world units).
    #[must_use]
    pub fn with_background(self, background: f32) -> Self {
        Self { background, ..self }
    }

    /// The same points, of a surface that is taken to be flat about each.
    #[must_use]
    pub fn straightened(mut self) -> Self {
        for point in &mut self.points {
            point.bend = [0.0; 6];
        }
        self
    }

    /// Farthest that a point can matter, voxels, when the surface is moved by `by` world units.
    fn reach(&self, by: f64) -> f32 {
        (by.abs() as f32 + self.background) / self.voxel_size
    }

    /// The distance in voxels from a place, in voxels from a leaf's origin on, each coordinate from 0 to 8,
    /// to the surface within reach, and the unit vector away from it; `None` if it is farther.
    pub(super) fn distance(&self, origin: Coord, place: Vec3) -> Option<(f64, Vec3)> {
        let mut best: Option<(f64, &Point, Vec3)> = None;
        for step in search::around(self.reach(0.0) + 1.0) {
            let [x, y, z] = step.map(|s| LEAF * s);
            let Some(number) = self.index.get(origin.offset(x, y, z)) else {
                continue;
            };
            let from = place - Vec3::new(f64::from(x), f64::from(y), f64::from(z));
            let range = &self.leaves[number as usize].1;
            for point in &self.points[range.start as usize..range.end as usize] {
                let away = from - Vec3::from(point.at.map(f64::from));
                let square = away.norm_squared();
                if best.is_none_or(|b| square < b.0) {
                    best = Some((square, point, away));
                }
            }
        }
        let (_, point, away) = best?;
        Some(match self.wedges.get(point.wedge as usize) {
            Some(wedge) => wedge.distance_and_direction(away),
            None => point.distance(away),
        })
    }

    /// Origins of the leaves that a move by `by` (world units) can change but for the sign of all of them,
    /// ascending.
    pub fn leaves_within(&self, by: f64) -> Vec<Coord> {
        let around = search::around(self.reach(by));
        let near = |&(origin, _): &(Coord, _)| {
            let steps = around.iter();
            let all = steps.map(move |s| origin.offset(LEAF * s[0], LEAF * s[1], LEAF * s[2]));
            all.collect::<Vec<_>>()
        };
        // By the stretch, since neighbours are near the same leaves.
        let mut found: Vec<Coord> = self
            .leaves
            .par_chunks(256)
            .flat_map_iter(|part| {
                let mut found: Vec<Coord> = part.iter().flat_map(near).collect();
                found.sort_unstable();
                found.dedup();
                found
            })
            .collect();
        found.par_sort_unstable();
        found.dedup();
        found
    }

    /// The leaf at `origin` with the surface moved outwards by `by` world units (inwards if negative).
    /// `inside` says which of its voxels lay inside, laid out as masks.
    pub fn moved(&self, origin: Coord, inside: &[u64; 8], by: f64) -> MovedLeaf {
        let lengths = Move {
            by: by as f32 / self.voxel_size,
            half_width: self.background / self.voxel_size,
            voxel_size: self.voxel_size,
            background: self.background,
        };
        let mut search = Search::new(inside, lengths);
        let most = search.most();
        if most > 0.0 {
            let steps = search::around(most);
            for step in &steps {
                let [x, y, z] = step.map(|s| LEAF * s);
                let Some(number) = self.index.get(origin.offset(x, y, z)) else {
                    continue;
                };
                let range = &self.leaves[number as usize].1;
                let all = range.start as usize..range.end as usize;
                let places = [0, 1, 2].map(|a| &self.at[a][all.clone()]);
                search.enter(places, range.start, [x, y, z]);
            }
        }
        search.leaf(&self.points, &self.wedges)
    }
}

/// The numbers of leaves by their origins.
fn indexed<'a>(count: usize, leaf: &impl Fn(usize) -> LeafRef<'a>) -> Index {
    let mut all = Index::default();
    for n in 0..count {
        all.enter(leaf(n).origin, n);
    }
    all
}

/// The points of one leaf, which needs those about it.
fn points_of<'a>(
    leaf: &impl Fn(usize) -> LeafRef<'a>,
    (n, all): (usize, &Index),
    stencils: &mut Stencils,
    lengths: (f32, f32),
) -> LeafPoints {
    let own = leaf(n);
    let (mut points, mut wedges) = (Vec::new(), Vec::new());
    if own.mask != [0; 8] {
        let values = |origin: Coord| Some(leaf(all.get(origin)? as usize).values);
        stencils.gather(&own, values, lengths.0, lengths.1);
        points = stencils.points();
        wedge::find(&mut points, &mut wedges, &own, values, lengths);
    }
    LeafPoints {
        origin: own.origin,
        points,
        wedges,
    }
}

/// What is found in a leaf.
#[derive(Clone)]
pub(super) struct LeafPoints {
    pub origin: Coord,
    points: Vec<Point>,
    /// Numbered by its points.
    wedges: Vec<Wedge>,
}

impl LeafPoints {
    /// Memory that they take, bytes.
    fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.points.len() * size_of::<Point>()
            + self.wedges.len() * size_of::<Wedge>()
    }
}
