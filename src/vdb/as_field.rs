//! A level set as a field, and its resampling to other voxels.
//!
//! Values are interpolated quadratically along each axis. The bound of a region is the range of the voxels
//! around it, widened by the overshoot of a parabola through three of them.
//!
//! The value at x is s phi(R^T (x - t) / s), for a placement with the scale s, the rotation R and the translation t. It
//! is a distance within the band, with an error of third order in the voxel; beyond the band it is 64 times the
//! background, with the right sign. Edges are rounded over a voxel. The laws
//! `a_sampled_level_set_is_a_field_with_a_bound` and `resampling_keeps_the_solid` measure both.

use super::builder::LevelSetBuilder;
use super::error::VdbError;
use super::{LevelSet, Session, ffi};
use crate::band::{BLOCK, Band, LEAF, LeafSink, Region};
use crate::field::{Field, Interval, SampleLattice};
use crate::frame::{Aabb, Coord, Mat3, Transform, Vec3, WorldPoint};
use std::collections::HashMap;

/// A similarity transform: a point x is mapped to `scale rotation x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Positive factor on lengths.
    pub scale: f64,
    /// Rotation matrix.
    pub rotation: Mat3,
    /// Translation, world units.
    pub translation: Vec3,
}

impl Placement {
    /// The identity.
    pub const IDENTITY: Self = Self {
        scale: 1.0,
        rotation: Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        translation: Vec3::new(0.0, 0.0, 0.0),
    };

    fn inverse(&self, p: Vec3) -> Vec3 {
        self.rotation.tr_mul(&(p - self.translation)) / self.scale
    }

    /// The inverse transform.
    #[must_use]
    pub fn inverted(&self) -> Self {
        Self {
            scale: 1.0 / self.scale,
            rotation: self.rotation.transpose(),
            translation: self.inverse(Vec3::zeros()),
        }
    }

    /// The box around the image of a box.
    #[must_use]
    pub fn image(&self, b: Aabb) -> Aabb {
        let centre = self.rotation * b.centre().0 * self.scale + self.translation;
        let half = self.rotation.abs() * b.size() * (self.scale / 2.0);
        Aabb {
            min: centre - half,
            max: centre + half,
        }
    }
}

/// Ranges of values of aligned cubes, by origin.
type Ranges = HashMap<Coord, (f32, f32)>;

/// A level set as a distance field: values are distances within its half width; beyond it only the sign is valid, and
/// the magnitude exceeds any half width.
pub struct SampledLevelSet {
    level_set: LevelSet,
    placement: Placement,
    bounds: Aabb,
    leaves: Ranges,
    blocks: Ranges,
}

/// Ratio of new to old voxel edge from which the old voxels are doubled before resampling (they stay at most half a new
/// one): details finer than half a new voxel do not matter, and the band would have to grow to many times its width.
pub const MAX_REFINEMENT_RATIO: f64 = 4.0;

/// Factor on values beyond the band, so that they exceed any requested half width.
const BEYOND_BAND_FACTOR: f32 = 64.0;
/// Greatest number of cubes whose ranges a bound combines.
const MAX_BOUND_CUBES: i64 = 512;

impl SampledLevelSet {
    /// A field with distances up to `half_width` (world units) after placement; a narrower band is widened first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
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

    /// A field for values that depend only on the level set's voxels in a region. A value depends on its cell and two
    /// more voxels on each side. `half_width` is in world units, after placement.
    ///
    /// # Errors
    /// As [`SampledLevelSet::new`].
    pub fn within(
        mut level_set: LevelSet,
        region: Region,
        half_width: f64,
        placement: Placement,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let h = level_set.voxel_size();
        // Two more voxels, so that parabolas do not include the end of the band; 4096 is more than memory holds.
        let target = half_width / (placement.scale * h) + 2.0;
        let extra = (target - level_set.half_width()).ceil().clamp(0.0, 4096.0);
        level_set.widen_within(extra as u32, region, session)?;
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
            let block = blocks.entry(leaf.origin.aligned(BLOCK)).or_insert(range);
            *block = (block.0.min(range.0), block.1.max(range.1));
        })?;
        let bounds = level_set.bounds()?;
        let bounds = if bounds.is_empty() {
            bounds
        } else {
            placement.image(bounds)
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

    /// A value as a distance in the world. Values at the background are scaled by [`BEYOND_BAND_FACTOR`]: their
    /// distance is unknown and must exceed any requested half width.
    fn distance(&self, v: f32) -> f32 {
        // Values within rounding of the background count as it.
        let is_beyond_band = v.abs() >= self.level_set.background() as f32 * (1.0 - 1e-5);
        let scale = self.placement.scale as f32;
        if is_beyond_band {
            v * scale * BEYOND_BAND_FACTOR
        } else {
            v * scale
        }
    }

    fn samples(&self, points: &[Vec3], out: &mut [f32]) {
        let inside: Vec<[f64; 3]> = points
            .iter()
            .map(|&p| self.placement.inverse(p).into())
            .collect();
        // Quadratic (true) along each axis; fails only if the lengths differ.
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

    /// Range of the voxels of the cubes of `edge` that overlap a box of voxels; `None` for more than
    /// [`MAX_BOUND_CUBES`]. `known` holds the ranges by cube. `None` also if OpenVDB fails.
    fn range(&self, low: Coord, high: Coord, edge: i32, known: &Ranges) -> Option<(f32, f32)> {
        let first = low.aligned(edge);
        let counts = [0, 1, 2].map(|a| i64::from((high[a] - first[a]) / edge) + 1);
        if counts.iter().product::<i64>() > MAX_BOUND_CUBES {
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
        // A cube without leaves is constant: any of its voxels has its value.
        let values = self.level_set.values(&absent).ok()?;
        Some(values.iter().fold(range, |(a, b), &v| (a.min(v), b.max(v))))
    }
}

impl Field for SampledLevelSet {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.sample(p.0)
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let step = self.level_set.voxel_size() * self.placement.scale / 2.0;
        // Central differences over one voxel.
        let gradient = Vec3::from_fn(|a, _| {
            let d = Vec3::ith(a, step);
            (self.sample(p.0 + d) - self.sample(p.0 - d)) / (2.0 * step)
        });
        (self.sample(p.0), gradient)
    }

    /// Contains the values over a box, with the overshoot of the interpolation; a box of too many blocks gets the whole
    /// range of the field.
    fn bound(&self, region: &Aabb) -> Interval {
        let h = self.level_set.voxel_size();
        // Twice the greatest value, which the overshoot does not reach.
        let w = self.level_set.background()
            * self.placement.scale
            * f64::from(BEYOND_BAND_FACTOR)
            * 2.0;
        let inside = self.placement.inverted().image(*region);
        // A parabola depends on voxels up to two beyond its cell; 1e9 keeps coordinates and differences in 32 bits.
        let index = |v: f64| v.clamp(-1e9, 1e9) as i32;
        let origin = self.level_set.origin();
        let low = Coord([0, 1, 2].map(|a| index(((inside.min[a] - origin[a]) / h).floor()) - 2));
        let high = Coord([0, 1, 2].map(|a| index(((inside.max[a] - origin[a]) / h).ceil()) + 2));
        // Leaves give the tighter range; a large region has too many of them.
        let range = self
            .range(low, high, LEAF, &self.leaves)
            .or_else(|| self.range(low, high, BLOCK, &self.blocks));
        let Some((a, b)) = range else {
            return Interval::new(-w, w);
        };
        // A parabola overshoots by at most an eighth of the range of its three values on each side, so that the range
        // grows by at most 5/4 per axis: in all by 0.48 on each side. One half also covers rounding; equal values give
        // an exact result.
        let overshoot = (b - a) * 0.5;
        Interval::new(
            self.distance(a - overshoot).into(),
            self.distance(b + overshoot).into(),
        )
    }

    /// Solids that touch in a plane of voxels were merged when they were sampled. What still parts them is a gap, and
    /// to read a file changes nothing.
    fn may_touch(&self) -> bool {
        false
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let points: Vec<Vec3> = (0..lattice.len()).map(|n| lattice.point(n).0).collect();
        self.samples(&points, out);
    }
}

impl LevelSet {
    /// The solid on voxels of repeatedly doubled edge, until fewer than [`MAX_REFINEMENT_RATIO`] of them fit
    /// along an edge of `voxel` (world units).
    ///
    /// # Errors
    /// As [`LevelSet::resampled`].
    pub fn coarsened_to(mut self, voxel: f64, session: Session<'_>) -> Result<Self, VdbError> {
        while voxel >= MAX_REFINEMENT_RATIO * self.voxel_size() {
            let Some(transform) = Transform::new(2.0 * self.voxel_size()) else {
                break;
            };
            self = self.resampled(transform, self.half_width(), Placement::IDENTITY, session)?;
        }
        Ok(self)
    }

    /// The solid after a placement, on a lattice of another voxel size with voxel (0, 0, 0) at the world's origin.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a half width (voxels) below 1, [`VdbError::Cancelled`], or errors of
    /// OpenVDB.
    pub fn resampled(
        &self,
        transform: Transform,
        half_width: f64,
        placement: Placement,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        let builder = LevelSetBuilder::new(transform, half_width)?;
        // Voxels of twice the edge on the same lattice need no interpolation, if the band determines the surface.
        if self.is_doubling(transform, placement, session) {
            for batch in self.coarser_leaves(half_width, session)? {
                let block = batch.origins[0].aligned(BLOCK);
                let added = builder.block(block, &batch);
                added.map_err(|e| VdbError::band("resampling", e.into()))?;
            }
            return builder.finish(session);
        }
        let field = SampledLevelSet::new(
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
