//! Metric sheets: |d(x)| <= t(x) / 2 with d the world distance to the mid-surface Phi = 0.
//!
//! A cell with `solid = "sheet"` and a thickness fills the scaffold as a wall around its mid-surface.
//! The wall has the requested thickness in space, however the elements deform the cell: d comes from
//! closest points of the mid-surface ([`ClosestPointField`]), t from `[tiling] thickness` in world units
//! or from the cell's own thickness times the local size of the elements. The mid-surface continues
//! beyond the scaffold, whose outer faces cut the wall unless `boundary = "extend"`. An inverted sheet
//! is the complement of the wall.
//!
//! t is evaluated every [`THICKNESS_STEP`] voxels and interpolated linearly. Where the mid-surface has a
//! crease, at faces of distorted elements, the wall follows it: t is the diameter of a ball that rolls
//! along the mid-surface.

use super::tiling::{CellTiling, ElementContent};
use crate::band::ClosestPointField;
use crate::field::{Complement, Field, Interval, SampleLattice, Union, WorldField};
use crate::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::shape::{Borrowed, intersection};
use crate::pipeline::inputs::scattered_data::ScatteredPoints;
use crate::scaffold::Scaffold;
use crate::tiling;
use crate::tiling::{Boundary, CellField, Graded, Kernel, TiledSolid, TilingOptions, Visits};
use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, PoisonError};

/// Half width, in voxels, of the mid-surface's band that provides closest points: the default of a recipe's band.
const MID_HALF_WIDTH: f64 = 3.0;
/// Voxels between the points at which a graded thickness is evaluated.
const THICKNESS_STEP: i32 = 4;
/// Number of shards of the cache of a graded thickness, which reduce lock contention, and greatest
/// number of values in a shard.
const SHARDS: usize = 16;
const MAX_SHARD_VALUES: usize = 1 << 14;
/// Factor on the reach of distances that makes rounding harmless.
const REACH_SLACK: f64 = 1.0 + 1e-5;

/// The thickness of sheets over a scaffold, world units.
pub(crate) struct SheetThickness {
    /// The interpolation's points, and the thickness there.
    points: Vec<Vec3>,
    values: Vec<f64>,
    /// Least and greatest.
    range: [f64; 2],
    /// The scaffold's outer faces, which cut the sheets.
    outer: Vec<MeshSolid>,
    /// Whether the solid is the complement of the sheet.
    is_inverted: bool,
}

/// Options of the field of sheets; `visits` counts the visited elements for the report, if there is one.
#[derive(Clone, Copy)]
pub(crate) struct SheetOptions<'a> {
    pub tiling: TilingOptions,
    pub offsets: Offsets,
    /// Displacement of the mid-surface that interpolation between nodes may cause, world units.
    pub node_tolerance: f64,
    pub visits: Option<&'a Visits>,
}

impl SheetThickness {
    /// The thickness `values` at `points`, world units, which is positive where `counts` is set; elsewhere it is
    /// clamped to the range of the others. `outer` are the scaffold's outer faces.
    pub fn new(
        points: Vec<Vec3>,
        values: Vec<f64>,
        counts: &[bool],
        outer: Vec<MeshSolid>,
        is_inverted: bool,
    ) -> Self {
        let used = || values.iter().zip(counts).filter(|v| *v.1).map(|v| *v.0);
        let range = [
            used().fold(f64::INFINITY, f64::min),
            used().fold(0.0, f64::max),
        ];
        // Values at points that do not count must not widen the range.
        let values = values.into_iter().map(|v| v.clamp(range[0], range[1]));
        Self {
            points,
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

    /// The thickness at the interpolation's points.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Whether the solid is the complement of the sheet.
    pub fn is_inverted(&self) -> bool {
        self.is_inverted
    }

    /// The sheets as a field of signed distances, world units, and the kernel (the method of evaluation) of the
    /// mid-surface. `cells` gives the content of the elements, whose level 0 is the mid-surface; it is called
    /// twice, because each field owns one.
    pub fn field<'a, C: CellField + 'a>(
        &'a self,
        tiling: &'a CellTiling,
        cells: impl Fn() -> Result<ElementContent<'a, C>, RunError>,
        options: SheetOptions<'a>,
    ) -> Result<(Box<WorldField<'a>>, Kernel), RunError> {
        let h = options.tiling.voxel_size;
        let [least, greatest] = self.range;
        // Distances to the mid-surface must hold up to half the thickness and the half width of the band.
        let reach = (greatest / 2.0 + options.tiling.half_width) * REACH_SLACK;
        let mid = TilingOptions {
            boundary: Boundary::Extend,
            distance: tiling::Distance::Fast,
            ..options.tiling
        };
        let scaffold = &tiling.loaded.scaffold;
        // The far field bounds distances, and is enough for estimates; the near one finds the points of the
        // mid-surface.
        let far_options = TilingOptions {
            half_width: reach,
            ..mid
        };
        let (far_field, _) = tiled_field(
            scaffold,
            cells()?,
            far_options,
            SheetOptions {
                visits: None,
                ..options
            },
        )?;
        let near_options = TilingOptions {
            half_width: MID_HALF_WIDTH * h,
            ..mid
        };
        let (near_field, kernel) = tiled_field(scaffold, cells()?, near_options, options)?;
        let distance: Box<WorldField<'a>> = if options.offsets.is_estimate {
            far_field
        } else {
            let transform =
                Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
            // Closest points are needed near the inside of the outer faces only.
            Box::new(
                ClosestPointField::new(near_field, far_field, transform, reach).near(self.inside()),
            )
        };
        // Equal up to the rounding of its interpolation.
        let thickness = if greatest - least <= 1e-12 * greatest {
            LocalThickness::Uniform(greatest)
        } else {
            let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
            LocalThickness::Graded(Box::new(GradedThickness {
                graded: Graded::new(scaffold, tiling.interpolation(), self.values.clone())
                    .map_err(failed)?,
                outer: &self.outer,
                points: ScatteredPoints::new(&self.points),
                step: h,
                cache: std::array::from_fn(|_| Mutex::default()),
            }))
        };
        // phi = |d| - t / 2, with d the signed distance to the mid-surface and t the local thickness.
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
        let cut = intersection(sheet, self.inside(), reach, options.offsets);
        Ok((cut, kernel))
    }

    /// The space within the outer faces.
    fn inside(&self) -> Box<WorldField<'_>> {
        let outer = self.outer.iter();
        let outer = outer.map(|b| Box::new(Borrowed(b)) as Box<WorldField<'_>>);
        Box::new(Union(outer.collect()))
    }
}

/// The side of the mid-surface as a field over the scaffold, and its kernel.
fn tiled_field<'a, C: CellField + 'a>(
    scaffold: &'a Scaffold,
    cells: ElementContent<'a, C>,
    tiling_options: TilingOptions,
    sheet_options: SheetOptions<'a>,
) -> Result<(Box<WorldField<'a>>, Kernel), RunError> {
    let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
    Ok(match cells {
        ElementContent::Cell(cell) => {
            let solid = TiledSolid::new(scaffold, cell, tiling_options).map_err(failed)?;
            with_options(solid, sheet_options)
        }
        ElementContent::Blend(blend) => {
            let solid =
                TiledSolid::with_owned_filling(scaffold, *blend, tiling_options).map_err(failed)?;
            with_options(solid, sheet_options)
        }
    })
}

/// A tiled solid with the interpolation and the counter of visits of some options, and its kernel.
fn with_options<'a>(
    solid: TiledSolid<'a>,
    options: SheetOptions<'a>,
) -> (Box<WorldField<'a>>, Kernel) {
    let kernel = solid.kernel();
    let solid = solid.with_interpolation(options.node_tolerance);
    let solid = match options.visits {
        Some(visits) => solid.with_visits(visits),
        None => solid,
    };
    (Box::new(solid), kernel)
}

/// The full thickness of sheets, anywhere in space.
enum LocalThickness<'a> {
    Uniform(f64),
    Graded(Box<GradedThickness<'a>>),
}

/// A thickness that varies over the scaffold.
struct GradedThickness<'a> {
    graded: Graded<'a>,
    /// The scaffold's outer faces. Outside, the thickness is that of the closest point on them.
    outer: &'a [MeshSolid],
    points: ScatteredPoints,
    /// Edge of a voxel, world units.
    step: f64,
    /// Cache of values by point: neighbouring leaves need the same points.
    cache: [Mutex<HashMap<Coord, f64>>; SHARDS],
}

impl GradedThickness<'_> {
    /// The thickness at a grid point: `THICKNESS_STEP` voxels times integers. It is computed once and kept in a shard
    /// of the cache, which is emptied when it is full.
    fn at_point(&self, point: Coord) -> f64 {
        let Coord([x, y, z]) = point;
        // Neighbouring points go to different shards, so that threads seldom wait for each other.
        let shard = (x ^ (y << 1) ^ (z << 2)).rem_euclid(SHARDS as i32) as usize;
        let cache = || {
            self.cache[shard]
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        };
        if let Some(found) = cache().get(&point) {
            return *found;
        }
        let found = self.find(point);
        let mut cache = cache();
        if cache.len() >= MAX_SHARD_VALUES {
            cache.clear();
        }
        cache.insert(point, found);
        found
    }

    /// The thickness at a grid point without the cache. Outside the scaffold it is that of the closest point of
    /// its outer faces, or the mean of the nearest points where rounding puts that one outside too; 0 without points.
    fn find(&self, point: Coord) -> f64 {
        let p = Vec3::from(point.0.map(|c| f64::from(c * THICKNESS_STEP) * self.step));
        if let Some(value) = self.graded.at(WorldPoint(p)) {
            return value;
        }
        let closest = self.outer.iter().map(|outer| outer.closest(p));
        let q = closest.min_by(|a, b| a.distance.total_cmp(&b.distance));
        let q = q.map_or(p, |closest| closest.point);
        let found = self.graded.at(WorldPoint(q));
        let mean = || self.points.mean(q, self.graded.values());
        found.or_else(mean).unwrap_or_default()
    }

    /// The cube of grid points around a point: its lowest corner, and the point's position in it.
    fn cube(&self, p: Vec3) -> (Coord, Vec3) {
        let scaled = p / (self.step * f64::from(THICKNESS_STEP));
        let least = scaled.map(f64::floor);
        (Coord(least.map(|c| c as i32).into()), scaled - least)
    }

    /// Value and gradient at a point.
    fn at(&self, p: Vec3) -> (f64, Vec3) {
        let (least, fraction) = self.cube(p);
        let corner_values = self.corner_values(least);
        let (value, slope) = trilinear(&corner_values, fraction);
        (value, slope / (self.step * f64::from(THICKNESS_STEP)))
    }

    /// The thickness at the corners of a cube of grid points, z fastest.
    fn corner_values(&self, least: Coord) -> [f64; 8] {
        std::array::from_fn(|n| {
            let [x, y, z] = [n >> 2, (n >> 1) & 1, n & 1].map(|c| c as i32);
            self.at_point(least.offset(x, y, z))
        })
    }

    /// Subtracts half the thickness from distances at the samples of a lattice, `out` in the lattice's order.
    fn subtract_half(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let mut last_cube: Option<(Coord, [f64; 8])> = None;
        let mut cubes: BTreeMap<Coord, [f64; 8]> = BTreeMap::new();
        for (n, v) in out.iter_mut().enumerate() {
            let (least, fraction) = self.cube(lattice.point(n).0);
            let corner_values = match last_cube {
                Some((at, corner_values)) if at == least => corner_values,
                _ => *cubes
                    .entry(least)
                    .or_insert_with(|| self.corner_values(least)),
            };
            last_cube = Some((least, corner_values));
            *v -= (0.5 * trilinear(&corner_values, fraction).0) as f32;
        }
    }
}

/// Value and slope between the values at the corners of a unit cube, z fastest: corner n is (n / 4, n / 2 mod 2, n
/// mod 2). `fraction` is the place in the cube, 0 to 1.
fn trilinear(corner_values: &[f64; 8], fraction: Vec3) -> (f64, Vec3) {
    let (mut value, mut slope) = (0.0, Vec3::zeros());
    for (n, c) in corner_values.iter().enumerate() {
        let bits = [n >> 2, (n >> 1) & 1, n & 1];
        let weight = |a: usize| {
            if bits[a] == 1 {
                fraction[a]
            } else {
                1.0 - fraction[a]
            }
        };
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
    /// Signed distances to the mid-surface, clamped outside the band.
    distance: Box<WorldField<'a>>,
    thickness: LocalThickness<'a>,
    /// Least and greatest thickness.
    range: [f64; 2],
}

impl Sheet<'_> {
    /// Half the thickness at a point and its gradient.
    fn half_thickness(&self, p: Vec3) -> (f64, Vec3) {
        match &self.thickness {
            LocalThickness::Uniform(t) => (t / 2.0, Vec3::zeros()),
            LocalThickness::Graded(graded) => {
                let (t, slope) = graded.at(p);
                (t / 2.0, slope / 2.0)
            }
        }
    }

    /// Bounds of |d| - t / 2 from those of d.
    fn of_distances(&self, b: Interval) -> Interval {
        let m = b.magnitude();
        Interval::new(m.lo - self.range[1] / 2.0, m.hi - self.range[0] / 2.0)
    }
}

impl Field for Sheet<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.distance.value(p).abs() - self.half_thickness(p.0).0
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (d, g) = self.distance.value_and_gradient(p);
        let (half_thickness, slope) = self.half_thickness(p.0);
        (d.abs() - half_thickness, g * 1f64.copysign(d) - slope)
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
