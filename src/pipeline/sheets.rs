//! Metric sheets: |d(x)| <= t(x) / 2 with d the world distance to the mid-surface Phi = 0.
//!
//! A cell with `solid = "sheet"` and a thickness fills the scaffold as a wall around its mid-surface. The
//! wall is as thick as asked whatever the elements do to the cell: d comes from closest points of the
//! mid-surface ([`ClosestPointField`]), and t from `[tiling] thickness` in world units, or from the cell's own
//! thickness times the local size of the elements. The mid-surface goes on beyond the scaffold, whose outer
//! faces cut the wall unless `boundary = "extend"`. Inverted, the solid is what the wall leaves out.
//!
//! t is evaluated every [`THICKNESS_STEP`] voxels and interpolated linearly. Where the mid-surface has a crease,
//! at faces of distorted elements, the wall follows it: t is the diameter of a ball that rolls along the
//! mid-surface.

use super::error::RunError;
use super::field_ops::{Borrowed, common_part};
use super::offsets::Offsets;
use super::scattered_data::Scatter;
use super::tiling::{Fill, Filled};
use crate::band::ClosestPointField;
use crate::field::{Complement, Field, Interval, SampleLattice, Union, WorldField};
use crate::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use crate::mesh::MeshSolid;
use crate::scaffold::Scaffold;
use crate::tiling::{self, Boundary, CellField, Graded, Kernel, TiledSolid, TilingOptions, Visits};
use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, PoisonError};

/// Half width, in voxels, of the band of the mid-surface that closest points are taken from.
const MID_HALF_WIDTH: f64 = 3.0;
/// Voxels between places where a graded thickness is evaluated.
const THICKNESS_STEP: i32 = 4;
/// Parts of what is known of a graded thickness, so that threads seldom wait for each other, and how many places
/// each knows at most.
const SHARDS: usize = 16;
const MOST_KNOWN: usize = 1 << 14;
/// How much farther than needed distances hold, so that rounding does not show.
const REACH_SLACK: f64 = 1.0 + 1e-5;

/// The thickness of sheets over a scaffold, world units.
pub(super) struct SheetThickness {
    /// The interpolation's places, and the thickness there.
    places: Vec<Vec3>,
    values: Vec<f64>,
    /// Least and greatest.
    range: [f64; 2],
    /// The scaffold's outer faces, which cut the sheets.
    outer: Vec<MeshSolid>,
    /// Whether the solid is what the sheet leaves out.
    is_inverted: bool,
}

/// What of the recipe and the run a field of sheets depends on.
#[derive(Clone, Copy)]
pub(super) struct SheetOptions<'a> {
    pub tiling: TilingOptions,
    pub offsets: Offsets,
    /// How far nodes may displace the mid-surface, world units.
    pub nodes: f64,
    pub visits: Option<&'a Visits>,
}

impl SheetThickness {
    /// Thickness by place, of which those that count are positive, within outer faces.
    pub fn new(
        (places, values): (Vec<Vec3>, Vec<f64>),
        counts: &[bool],
        outer: Vec<MeshSolid>,
        is_inverted: bool,
    ) -> Self {
        let used = || values.iter().zip(counts).filter(|v| *v.1).map(|v| *v.0);
        let range = [
            used().fold(f64::INFINITY, f64::min),
            used().fold(0.0, f64::max),
        ];
        // Places that no element uses must not widen the range.
        let values = values.into_iter().map(|v| v.clamp(range[0], range[1]));
        Self {
            places,
            values: values.collect(),
            range,
            outer,
            is_inverted,
        }
    }

    /// Least and greatest thickness, world units.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Whether the solid is what the sheet leaves out.
    pub fn is_inverted(&self) -> bool {
        self.is_inverted
    }

    /// The sheets as a field of signed distances, and how the mid-surface is evaluated.
    pub fn field<'a, C: CellField + 'a>(
        &'a self,
        fill: &'a Fill,
        filled: impl Fn() -> Result<Filled<'a, C>, RunError>,
        options: SheetOptions<'a>,
    ) -> Result<(Box<WorldField<'a>>, Kernel), RunError> {
        let h = options.tiling.voxel_size;
        let [least, greatest] = self.range;
        let reach = (greatest / 2.0 + options.tiling.half_width) * REACH_SLACK;
        let mid = TilingOptions {
            boundary: Boundary::Extend,
            distance: tiling::Distance::Fast,
            ..options.tiling
        };
        let scaffold = &fill.loaded.scaffold;
        let far = TilingOptions {
            half_width: reach,
            ..mid
        };
        let (far, _) = solid(
            scaffold,
            filled()?,
            far,
            SheetOptions {
                visits: None,
                ..options
            },
        )?;
        let near = TilingOptions {
            half_width: MID_HALF_WIDTH * h,
            ..mid
        };
        let (near, kernel) = solid(scaffold, filled()?, near, options)?;
        let distance: Box<WorldField<'a>> = if options.offsets.is_estimate {
            far
        } else {
            let transform =
                Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
            // Farther outside no point of the mid-surface is the closest one.
            Box::new(ClosestPointField::new(near, far, transform, reach).near(self.room()))
        };
        let thickness = if greatest - least <= 1e-12 * greatest {
            LocalThickness::Uniform(greatest)
        } else {
            let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
            LocalThickness::Graded(Box::new(GradedThickness {
                graded: Graded::new(scaffold, fill.interpolation(), self.values.clone())
                    .map_err(failed)?,
                outer: &self.outer,
                places: Scatter::new(&self.places),
                step: h,
                known: std::array::from_fn(|_| Mutex::default()),
            }))
        };
        let sheet = Box::new(Sheet {
            distance,
            thickness,
            range: self.range,
        });
        let sheet: Box<WorldField<'a>> = if self.is_inverted {
            Box::new(Complement(sheet))
        } else {
            sheet
        };
        if options.tiling.boundary == Boundary::Extend {
            return Ok((sheet, kernel));
        }
        let reach = options.tiling.half_width;
        let cut = common_part(sheet, self.room(), reach, options.offsets);
        Ok((cut, kernel))
    }

    /// The space within the outer faces.
    fn room(&self) -> Box<WorldField<'_>> {
        let outer = self.outer.iter();
        let outer = outer.map(|b| Box::new(Borrowed(b)) as Box<WorldField<'_>>);
        Box::new(Union(outer.collect()))
    }
}

/// The mid-surface's side as a field.
fn solid<'a, C: CellField + 'a>(
    scaffold: &'a Scaffold,
    filled: Filled<'a, C>,
    options: TilingOptions,
    how: SheetOptions<'a>,
) -> Result<(Box<WorldField<'a>>, Kernel), RunError> {
    let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
    Ok(match filled {
        Filled::One(cell) => {
            let solid = TiledSolid::new(scaffold, cell, options).map_err(failed)?;
            finished(solid, how)
        }
        Filled::Many(blend) => {
            let solid = TiledSolid::owning(scaffold, *blend, options).map_err(failed)?;
            finished(solid, how)
        }
    })
}

fn finished<'a, F: tiling::Filling + 'a>(
    solid: TiledSolid<'a, F>,
    how: SheetOptions<'a>,
) -> (Box<WorldField<'a>>, Kernel) {
    let kernel = solid.kernel();
    let solid = solid.by_nodes(how.nodes);
    let solid = match how.visits {
        Some(visits) => solid.noting(visits),
        None => solid,
    };
    (Box::new(solid), kernel)
}

/// The full thickness of sheets, anywhere in space.
enum LocalThickness<'a> {
    Uniform(f64),
    Graded(Box<GradedThickness<'a>>),
}

/// A thickness that differs over the scaffold.
struct GradedThickness<'a> {
    graded: Graded<'a>,
    /// The scaffold's outer faces, beyond which thickness is that of the closest point.
    outer: &'a [MeshSolid],
    places: Scatter,
    /// Edge of a voxel, world units.
    step: f64,
    /// What was found, by place: neighbouring leaves ask for the same places.
    known: [Mutex<HashMap<Coord, f64>>; SHARDS],
}

impl GradedThickness<'_> {
    /// At one of the places where it is evaluated: `THICKNESS_STEP` voxels times integers.
    fn at_place(&self, place: Coord) -> f64 {
        let Coord([x, y, z]) = place;
        let shard = (x ^ y << 1 ^ z << 2).rem_euclid(SHARDS as i32) as usize;
        let known = || {
            self.known[shard]
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        };
        if let Some(found) = known().get(&place) {
            return *found;
        }
        let found = self.find(place);
        let mut known = known();
        if known.len() >= MOST_KNOWN {
            known.clear();
        }
        known.insert(place, found);
        found
    }

    fn find(&self, place: Coord) -> f64 {
        let p = Vec3::from(place.0.map(|c| f64::from(c * THICKNESS_STEP) * self.step));
        if let Some(value) = self.graded.at(WorldPoint(p)) {
            return value;
        }
        let closest = self.outer.iter().map(|outer| outer.closest(p));
        let q = closest.min_by(|a, b| a.distance.total_cmp(&b.distance));
        let q = q.map_or(p, |closest| closest.point);
        let found = self.graded.at(WorldPoint(q));
        let mean = || self.places.mean(q, self.graded.values());
        found.or_else(mean).unwrap_or_default()
    }

    /// The cube of places around a point: the least one, and how far along it the point is.
    fn cube(&self, p: Vec3) -> (Coord, Vec3) {
        let scaled = p / (self.step * f64::from(THICKNESS_STEP));
        let least = scaled.map(f64::floor);
        (Coord(least.map(|c| c as i32).into()), scaled - least)
    }

    /// Value and gradient at a point.
    fn at(&self, p: Vec3) -> (f64, Vec3) {
        let (least, part) = self.cube(p);
        let corners = self.corners(least);
        let (value, slope) = trilinear(&corners, part);
        (value, slope / (self.step * f64::from(THICKNESS_STEP)))
    }

    fn corners(&self, least: Coord) -> [f64; 8] {
        std::array::from_fn(|n| {
            let [x, y, z] = [n >> 2, n >> 1 & 1, n & 1].map(|c| c as i32);
            self.at_place(least.offset(x, y, z))
        })
    }

    /// Takes half the thickness off distances at the samples of a lattice.
    fn subtract_half(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let mut known: Option<(Coord, [f64; 8])> = None;
        let mut cubes: BTreeMap<Coord, [f64; 8]> = BTreeMap::new();
        for (n, v) in out.iter_mut().enumerate() {
            let (least, part) = self.cube(lattice.point(n).0);
            let corners = match known {
                Some((at, corners)) if at == least => corners,
                _ => *cubes.entry(least).or_insert_with(|| self.corners(least)),
            };
            known = Some((least, corners));
            *v -= (0.5 * trilinear(&corners, part).0) as f32;
        }
    }
}

/// Value and slope between the corners of a unit cube, z fastest.
fn trilinear(corners: &[f64; 8], part: Vec3) -> (f64, Vec3) {
    let (mut value, mut slope) = (0.0, Vec3::zeros());
    for (n, c) in corners.iter().enumerate() {
        let bits = [n >> 2, n >> 1 & 1, n & 1];
        let weight = |a: usize| if bits[a] == 1 { part[a] } else { 1.0 - part[a] };
        let sign = |a: usize| if bits[a] == 1 { 1.0 } else { -1.0 };
        value += c * weight(0) * weight(1) * weight(2);
        slope.x += c * sign(0) * weight(1) * weight(2);
        slope.y += c * sign(1) * weight(0) * weight(2);
        slope.z += c * sign(2) * weight(0) * weight(1);
    }
    (value, slope)
}

/// A wall around a mid-surface.
struct Sheet<'a> {
    /// Signed distances to the mid-surface, clamped beyond the band's reach.
    distance: Box<WorldField<'a>>,
    thickness: LocalThickness<'a>,
    /// Least and greatest thickness.
    range: [f64; 2],
}

impl Sheet<'_> {
    fn half(&self, p: Vec3) -> (f64, Vec3) {
        match &self.thickness {
            LocalThickness::Uniform(t) => (t / 2.0, Vec3::zeros()),
            LocalThickness::Graded(graded) => {
                let (t, slope) = graded.at(p);
                (t / 2.0, slope / 2.0)
            }
        }
    }

    fn of_distances(&self, b: Interval) -> Interval {
        let m = b.magnitude();
        Interval::new(m.lo - self.range[1] / 2.0, m.hi - self.range[0] / 2.0)
    }
}

impl Field for Sheet<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.distance.value(p).abs() - self.half(p.0).0
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (d, g) = self.distance.value_and_gradient(p);
        let (half, slope) = self.half(p.0);
        (d.abs() - half, g * 1f64.copysign(d) - slope)
    }

    fn bound(&self, region: &Aabb) -> Interval {
        self.of_distances(self.distance.bound(region))
    }

    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[Interval; 8]> {
        Some(self.distance.bounds(regions)?.map(|b| self.of_distances(b)))
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }

    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        let count = self.distance.fill_counting(lattice, out);
        for v in out.iter_mut() {
            *v = v.abs();
        }
        match &self.thickness {
            LocalThickness::Uniform(t) => {
                for v in out {
                    *v -= (t / 2.0) as f32;
                }
            }
            LocalThickness::Graded(graded) => graded.subtract_half(lattice, out),
        }
        count
    }
}
