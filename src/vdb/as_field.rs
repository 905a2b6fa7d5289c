//! A level set as a field, and level sets on other voxels made from it.
//!
//! Between voxels values are quadratic along each axis. The bound of a region is the range of the
//! voxels around it: exact up to what a parabola through three of them can overshoot.

use super::ffi;
use super::{LevelSet, LevelSetBuilder, Session, VdbError};
use crate::band::{Band, Region};
use crate::field::{Field, Interval, SampleLattice};
use crate::frame::{Aabb, Coord, Mat3, Transform, Vec3, WorldPoint};
use std::collections::HashMap;

/// Where a level set is put: a point x goes to `scale turn x + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Positive factor on lengths.
    pub scale: f64,
    /// A rotation.
    pub turn: Mat3,
    /// World units.
    pub shift: Vec3,
}

impl Placement {
    /// Leaves all where it is.
    pub const NONE: Self = Self {
        scale: 1.0,
        turn: Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        shift: Vec3::new(0.0, 0.0, 0.0),
    };

    fn inverse(&self, p: Vec3) -> Vec3 {
        self.turn.tr_mul(&(p - self.shift)) / self.scale
    }

    /// The placement that leads back.
    #[must_use]
    pub fn inverted(&self) -> Self {
        Self {
            scale: 1.0 / self.scale,
            turn: self.turn.transpose(),
            shift: self.inverse(Vec3::zeros()),
        }
    }

    /// The box around the image of a box.
    #[must_use]
    pub fn image(&self, b: Aabb) -> Aabb {
        let centre = self.turn * b.centre().0 * self.scale + self.shift;
        let half = self.turn.abs() * b.size() * (self.scale / 2.0);
        Aabb {
            min: centre - half,
            max: centre + half,
        }
    }
}

/// Ranges of values of cubes of 8 and of 128 voxels.
type Ranges = HashMap<Coord, (f32, f32)>;

/// A level set as a distance field: values are distances up to its half width, and plus or minus it
/// beyond.
pub struct Sampled {
    level_set: LevelSet,
    placement: Placement,
    bounds: Aabb,
    leaves: Ranges,
    blocks: Ranges,
}

/// From so many voxels along the edge of a new one on, they are doubled before a level set is resampled:
/// what is finer than half a new voxel does not show, and its band would have to be widened to many times
/// its width.
pub const MOST_FINER: f64 = 4.0;

/// Factor on values beyond the band.
const FAR: f32 = 64.0;
/// Most cubes that a bound looks at one by one.
const MOST: i64 = 512;

impl Sampled {
    /// A field of a level set whose band is at least `half_width` (world units) wide after placing;
    /// a narrower one is widened first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn new(
        level_set: LevelSet,
        half_width: f64,
        placement: Placement,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        Self::within(
            level_set,
            Region::EVERYWHERE,
            half_width,
            placement,
            session,
        )
    }

    /// The same for values that are made of the level set's voxels in a region: a cell and two voxels more
    /// on each side.
    ///
    /// # Errors
    /// As [`Sampled::new`].
    pub fn within(
        mut level_set: LevelSet,
        region: Region,
        half_width: f64,
        placement: Placement,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let h = level_set.voxel_size();
        // Two voxels more: parabolas must not see where the band ends.
        let wanted = half_width / (placement.scale * h) + 2.0;
        let wider = (wanted - level_set.half_width()).ceil().clamp(0.0, 4096.0);
        level_set.widen_within(wider as u32, region, session)?;
        let mut leaves = Ranges::new();
        let mut blocks = Ranges::new();
        level_set.for_each_leaf(|leaf| {
            let range = leaf
                .values
                .iter()
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| {
                    (a.min(v), b.max(v))
                });
            leaves.insert(leaf.origin, range);
            let block = blocks.entry(leaf.origin.aligned(128)).or_insert(range);
            *block = (block.0.min(range.0), block.1.max(range.1));
        })?;
        let own = level_set.bounds()?;
        let bounds = if own.is_empty() {
            own
        } else {
            placement.image(own)
        };
        Ok(Self {
            level_set,
            placement,
            bounds,
            leaves,
            blocks,
        })
    }

    /// The box around the solid, world units.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// A value as a distance in the world: beyond the band no more is known than that it is far, and
    /// far it must be whatever band one asks for.
    fn distance(&self, v: f32) -> f32 {
        let far = v.abs() >= self.level_set.background() as f32 * (1.0 - 1e-5);
        let scale = self.placement.scale as f32;
        if far { v * scale * FAR } else { v * scale }
    }

    fn samples(&self, points: &[Vec3], out: &mut [f32]) {
        let inside: Vec<[f64; 3]> = points
            .iter()
            .map(|&p| self.placement.inverse(p).into())
            .collect();
        // Refused only when lengths differ.
        if ffi::grid_samples(&self.level_set.grid, inside.as_flattened(), true, out).is_err() {
            out.fill(self.level_set.background() as f32);
        }
        for v in out {
            *v = self.distance(*v);
        }
    }

    fn sample(&self, p: Vec3) -> f64 {
        let mut out = [0.0];
        self.samples(&[p], &mut out);
        f64::from(out[0])
    }

    /// Range of the voxels of cubes of `edge` that meet a box of voxels; `None` when they are many.
    fn range(&self, low: Coord, high: Coord, edge: i32, known: &Ranges) -> Option<(f32, f32)> {
        let first = low.aligned(edge);
        let counts = [0, 1, 2].map(|a| i64::from((high[a] - first[a]) / edge) + 1);
        if counts.iter().product::<i64>() > MOST {
            return None;
        }
        let (mut range, mut absent) = ((f32::INFINITY, f32::NEG_INFINITY), Vec::new());
        for n in 0..counts.iter().product::<i64>() {
            let i = [
                n / (counts[1] * counts[2]),
                n / counts[2] % counts[1],
                n % counts[2],
            ];
            let cube = first.offset(i[0] as i32 * edge, i[1] as i32 * edge, i[2] as i32 * edge);
            match known.get(&cube) {
                Some(&(a, b)) => range = (range.0.min(a), range.1.max(b)),
                None => absent.push(cube),
            }
        }
        // A cube without leaves has one sign: that of any of its voxels.
        let values = self.level_set.values(&absent).ok()?;
        Some(values.iter().fold(range, |(a, b), &v| (a.min(v), b.max(v))))
    }
}

impl Field for Sampled {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.sample(p.0)
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let step = self.level_set.voxel_size() * self.placement.scale / 2.0;
        let gradient = Vec3::from_fn(|a, _| {
            let d = Vec3::ith(a, step);
            (self.sample(p.0 + d) - self.sample(p.0 - d)) / (2.0 * step)
        });
        (self.sample(p.0), gradient)
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let h = self.level_set.voxel_size();
        let w = self.level_set.background() * self.placement.scale * f64::from(FAR) * 2.0;
        let inside = self.placement.inverted().image(*region);
        // Parabolas reach two voxels beyond the cell they lie in.
        let index = |v: f64| v.clamp(-1e9, 1e9) as i32;
        let origin = self.level_set.origin();
        let low = Coord([0, 1, 2].map(|a| index(((inside.min[a] - origin[a]) / h).floor()) - 2));
        let high = Coord([0, 1, 2].map(|a| index(((inside.max[a] - origin[a]) / h).ceil()) + 2));
        let range = self
            .range(low, high, 8, &self.leaves)
            .or_else(|| self.range(low, high, 128, &self.blocks));
        let Some((a, b)) = range else {
            return Interval::new(-w, w);
        };
        // Each axis overshoots by at most an eighth of the range of its three values; and a little for
        // rounding, unless all are equal: then the result is.
        let over = (b - a) * 0.5;
        Interval::new(
            self.distance(a - over).into(),
            self.distance(b + over).into(),
        )
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let points: Vec<Vec3> = (0..lattice.len()).map(|n| lattice.point(n).0).collect();
        self.samples(&points, out);
    }
}

impl LevelSet {
    /// The same solid on voxels of twice, four times ... the edge, until fewer than [`MOST_FINER`] of them
    /// go along an edge of `voxel` (world units).
    ///
    /// # Errors
    /// As [`LevelSet::resampled`].
    pub fn no_finer_than(mut self, voxel: f64, session: Session<'_>) -> Result<Self, VdbError> {
        while voxel >= MOST_FINER * self.voxel_size() {
            let Some(transform) = Transform::new(2.0 * self.voxel_size()) else {
                break;
            };
            self = self.resampled(transform, self.half_width(), Placement::NONE, session)?;
        }
        Ok(self)
    }

    /// The same solid, placed elsewhere, on voxels of another size whose corner is the world's origin.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a half width (voxels) below 1, [`VdbError::Cancelled`], or what
    /// OpenVDB refuses.
    pub fn resampled(
        &self,
        transform: Transform,
        half_width: f64,
        placement: Placement,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let builder = LevelSetBuilder::new(transform, half_width)?;
        let field = Sampled::new(
            self.duplicate()?,
            half_width * transform.voxel_size(),
            placement,
            session,
        )?;
        let extent = field.bounds();
        if !extent.is_empty() {
            let band = Band {
                field: &field,
                transform,
                half_width,
                extent,
            };
            band.evaluate(session.threads, session.progress, &builder)
                .map_err(|e| VdbError::band("resampling", e))?;
        }
        builder.finish(session)
    }
}
