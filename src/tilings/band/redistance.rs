//! Closest-point redistancing: distances from points of the surface, for offsets of any size in one step.
//!
//! [`SurfacePoints::new`] takes the leaves of a band; [`SurfacePoints::moved`] returns a leaf of the moved surface.
//! Each crossing of the surface with a lattice edge is a point with a normal and second derivatives from the voxels
//! around it. The distance of a voxel x is that to the surface through its nearest point q. With h the component of x -
//! q along the normal n, t the tangential component, and k = t·H t / |t|^2 the normal curvature in the direction of t
//! (H is the Hessian of the distance), it is `d = h + k |t|^2 / (2 (1 + h k))`, which is exact to second order in |t|
//! and at most |x - q|; for |t| from 1 voxel to 2 it blends to |x - q|.
//!
//! Points at sharp edges and corners use the distance to the planes that meet there, in closed form; corners are points
//! too. No distance is shorter than |x - q| by more than a limit, which keeps offset bands free of gaps. Signs are
//! those of the level set. The error does not grow with the distance. A leaf depends only on the points within its
//! reach, so that results depend neither on threads nor on bricks with a halo of that width. The law
//! `moved_polyhedra_have_distances_in_closed_form` allows 0.25 voxel root mean square, 1.6 at corners.

use super::index::LeafIndex;
use super::leaf::{LEAF, VOXELS};
use super::smooth::LeafRef;
use druse_geometry::frame::{Coord, Vec3};
use rayon::prelude::*;

mod block;
mod cache;
mod candidates;
mod coarser;
mod corner;
mod field;
mod search;
mod surface_points;
mod vector;
mod wedge;

pub use field::ClosestPointField;

use block::OffsetLengths;
use corner::Corner;
use search::Search;
use surface_points::{NO_WEDGE, Point, Stencils};
use wedge::Wedge;

/// Points of the surface of a level set, ordered by the leaves that contain them.
pub struct SurfacePoints {
    points: Vec<Point>,
    /// Planes that meet at sharp edges and corners; points refer to them by index.
    wedges: Vec<Wedge>,
    /// Coordinates of the points, by axis.
    at: [Vec<f32>; 3],
    /// Origins of the leaves with points, ascending, and the range of their points.
    leaves: Vec<(Coord, std::ops::Range<u32>)>,
    /// Indices in `leaves`, by origin.
    index: LeafIndex,
    voxel_size: f32,
    background: f32,
}

/// A leaf after an offset of the surface.
#[derive(Clone, Debug)]
pub struct MovedLeaf {
    /// Active voxels.
    pub mask: [u64; 8],
    /// 512 signed distances, world units.
    pub values: [f32; VOXELS],
}

impl MovedLeaf {
    /// Restores the old active values of the leaf that are smaller in magnitude than the old background (world units).
    pub fn keep(&mut self, before: &LeafRef<'_>, background: f32) {
        // Values at the background are clamped ones, up to rounding.
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
    /// Minimum half width, voxels, of a band that determines surface points: stencils extend two voxels from the voxels of a crossing.
    pub const MIN_HALF_WIDTH: f64 = 3.0;
    /// Greatest distance of a corner of the surface from the crossing that determines it, voxels.
    pub const MAX_CORNER_OFFSET: f64 = wedge::MAX_CORNER_OFFSET as f64;

    /// Whether a band of this half width (voxels) is wide enough.
    pub fn suffices(half_width: f64) -> bool {
        half_width as f32 >= Self::MIN_HALF_WIDTH as f32
    }

    /// The points of the band of a closed surface. `leaf` returns leaf 0 to `count - 1` in ascending order of origin, from any
    /// thread. `voxel_size` and `background` (half width times voxel size) are in world units. Runs on the
    /// caller's thread pool.
    pub fn new<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a> + Sync,
        voxel_size: f64,
        background: f32,
    ) -> Self {
        let index = indexed(count, &leaf);
        let voxel_size = voxel_size as f32;
        let found = (0..count)
            .into_par_iter()
            .with_min_len(32) // Leaves: fewer are no task.
            .map_init(Stencils::default, |stencils, n| {
                let lengths = BandLengths {
                    voxel_size,
                    background,
                };
                points_of(&leaf, n, &index, stencils, lengths)
            })
            .collect();
        Self::joined(found, voxel_size, background)
    }

    /// The points of the leaves of a band that `is_requested` selects, on the calling thread; leaves without points are
    /// left out. The leaves around the requested ones must be given as well.
    pub(super) fn of_leaves<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a>,
        is_requested: impl Fn(Coord) -> bool,
        voxel_size: f64,
        background: f32,
    ) -> Vec<LeafPoints> {
        let index = indexed(count, &leaf);
        let lengths = BandLengths {
            voxel_size: voxel_size as f32,
            background,
        };
        let mut stencils = Stencils::default();
        let requested = (0..count).filter(|&n| is_requested(leaf(n).origin));
        let found = requested.map(|n| points_of(&leaf, n, &index, &mut stencils, lengths));
        found.filter(|f| !f.points.is_empty()).collect()
    }

    /// The points of all leaves, in order of the leaves. `found` is sorted by origin; lengths are in world units.
    pub(super) fn joined(found: Vec<LeafPoints>, voxel_size: f32, background: f32) -> Self {
        let mut surface = Self {
            points: Vec::with_capacity(found.iter().map(|f| f.points.len()).sum()),
            wedges: Vec::new(),
            at: Default::default(),
            leaves: Vec::new(),
            index: LeafIndex::default(),
            voxel_size,
            background,
        };
        // Numbers of wedges count over all leaves. Corners may come as a second part of a leaf's points.
        let found = found.into_iter().filter(|f| !f.points.is_empty());
        for mut leaf in corner::placed(found.collect()) {
            let first = surface.points.len() as u32;
            let first_wedge = surface.wedges.len() as u32;
            for point in leaf.points.iter_mut().filter(|p| p.wedge != NO_WEDGE) {
                point.wedge += first_wedge;
            }
            surface.wedges.extend(leaf.wedges);
            for (a, at) in surface.at.iter_mut().enumerate() {
                at.extend(leaf.points.iter().map(|p| p.at[a]));
            }
            surface.points.extend(leaf.points);
            let end = surface.points.len() as u32;
            match surface.leaves.last_mut() {
                Some((origin, range)) if *origin == leaf.origin => range.end = end,
                _ => {
                    surface.index.insert(leaf.origin, surface.leaves.len());
                    surface.leaves.push((leaf.origin, first..end));
                }
            }
        }
        surface
    }

    /// Memory in use, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.points.len() * (size_of::<Point>() + size_of::<[f32; 3]>())
            + self.wedges.len() * size_of::<Wedge>()
            + self.leaves.len() * size_of::<(Coord, std::ops::Range<u32>)>()
            + self.index.bytes()
    }

    /// Sets the background (world units) of the band that [`Self::moved`] returns.
    #[must_use]
    pub fn with_background(self, background: f32) -> Self {
        Self { background, ..self }
    }

    /// Sets all curvatures to zero.
    #[must_use]
    pub fn without_curvature(mut self) -> Self {
        for point in &mut self.points {
            point.hessian = [0.0; 6];
        }
        self
    }

    /// Greatest distance, voxels, of a relevant point for an offset by `by` world units.
    fn reach(&self, by: f64) -> f32 {
        (by.abs() as f32 + self.background) / self.voxel_size
    }

    /// The unsigned distance, voxels, of a position to the surface, and the unit vector away from the surface; `None`
    /// if no leaf within reach has a point. `place` is in voxels relative to a leaf's origin, 0 to 8 on each axis. The
    /// distance may exceed the reach.
    pub(super) fn distance(&self, origin: Coord, place: Vec3) -> Option<(f64, Vec3)> {
        let mut best: Option<(f64, &Point, Vec3)> = None;
        // A place lies up to a voxel beyond the leaf's samples.
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

    /// Origins of the leaves that an offset by `by` (world units) can change, except for changes of the sign of
    /// a whole leaf; ascending.
    pub fn leaves_within(&self, by: f64) -> Vec<Coord> {
        let around = search::around(self.reach(by));
        self.leaves_near(|origin, found| {
            let steps = around.iter();
            found.extend(steps.map(|s| origin.offset(LEAF * s[0], LEAF * s[1], LEAF * s[2])));
        })
    }

    /// The leaves that `add_near` adds for any leaf with points; ascending.
    fn leaves_near(&self, add_near: impl Fn(Coord, &mut Vec<Coord>) + Sync) -> Vec<Coord> {
        // Deduplicated in chunks first, since neighbouring leaves are near the same leaves.
        let mut found: Vec<Coord> = self
            .leaves
            .par_chunks(256) // Leaves: the list of each task stays short.
            .flat_map_iter(|part| {
                let mut found = Vec::new();
                for (origin, _) in part {
                    add_near(*origin, &mut found);
                }
                found.sort_unstable();
                found.dedup();
                found
            })
            .collect();
        found.par_sort_unstable();
        found.dedup();
        found
    }

    /// The leaf at `origin` after an offset of the surface outwards by `by` world units (inwards if negative).
    /// `inside` holds the voxels that were inside, laid out as a mask.
    pub fn moved(&self, origin: Coord, inside: &[u64; 8], by: f64) -> MovedLeaf {
        let lengths = self.lengths(by);
        let near = search::around(lengths.max_distance(*inside, u64::MAX).max(0.0));
        self.leaf_from(origin, inside, lengths, near.into_iter())
    }

    /// The lengths of an offset by world units.
    fn lengths(&self, by: f64) -> OffsetLengths {
        OffsetLengths {
            by: by as f32 / self.voxel_size,
            half_width: self.background / self.voxel_size,
            voxel_size: self.voxel_size,
            background: self.background,
            spacing: 1.0,
        }
    }

    /// The leaf whose first sample is a voxel, from the points of the leaves that lie `near` it, in leaves. `inside`
    /// holds the voxels inside, as a mask; `first` is in the voxels of the points.
    fn leaf_from(
        &self,
        first: Coord,
        inside: &[u64; 8],
        lengths: OffsetLengths,
        near: impl Iterator<Item = [i32; 3]>,
    ) -> MovedLeaf {
        let mut search = Search::new(inside, lengths);
        if search.max_distance() > 0.0 {
            for step in near {
                let [x, y, z] = step.map(|s| LEAF * s);
                let Some(number) = self.index.get(first.offset(x, y, z)) else {
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

/// Indexes leaves by origin.
fn indexed<'a>(count: usize, leaf: &impl Fn(usize) -> LeafRef<'a>) -> LeafIndex {
    let mut all = LeafIndex::default();
    for n in 0..count {
        all.insert(leaf(n).origin, n);
    }
    all
}

/// Lengths of a band, world units.
#[derive(Clone, Copy)]
struct BandLengths {
    voxel_size: f32,
    /// Magnitude of the values beyond the band.
    background: f32,
}

/// The points of leaf `n`, from its values and those of the leaves around it; `all` finds leaves by their origins. A
/// leaf without active voxels or crossings has none.
fn points_of<'a>(
    leaf: &impl Fn(usize) -> LeafRef<'a>,
    n: usize,
    all: &LeafIndex,
    stencils: &mut Stencils,
    lengths: BandLengths,
) -> LeafPoints {
    let own = leaf(n);
    let (mut points, mut wedges, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    let values = |origin: Coord| Some(leaf(all.get(origin)? as usize).values);
    if own.mask != [0; 8] && surface_points::has_crossings(&own, values) {
        stencils.gather(&own, values, lengths.voxel_size, lengths.background);
        points = stencils.points();
        corners = wedge::find(&mut points, &mut wedges, &own, values, lengths);
    }
    LeafPoints {
        origin: own.origin,
        points,
        wedges,
        corners,
    }
}

#[derive(Clone)]
pub(super) struct LeafPoints {
    pub origin: Coord,
    points: Vec<Point>,
    /// Wedges; points refer to them by index.
    wedges: Vec<Wedge>,
    /// Corners, which become points of the leaves that contain them.
    corners: Vec<Corner>,
}

impl LeafPoints {
    /// Memory in use, bytes.
    fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.points.len() * size_of::<Point>()
            + self.wedges.len() * size_of::<Wedge>()
            + self.corners.len() * size_of::<Corner>()
    }
}
