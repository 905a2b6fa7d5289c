//! The voxels of a solid, and resampling onto other voxels. This file only computes sizes and widths;
//! `level_set_ops` and the bricks resample. Growth and ratios are estimates for memory, all others are exact.

use crate::band::SurfacePoints;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::inputs::volumes::resample_placement;
use crate::recipe::{Resample, Scale};
use crate::vdb::{MAX_REFINEMENT_RATIO, Placement};

/// Reach of the interpolation of a resampled level set, voxels.
pub(crate) const INTERPOLATION_REACH: f64 = 2.0;

/// The size of voxels and the half width of the band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Voxels {
    pub scale: Scale,
    /// Half width of the band, voxels.
    pub half_width: f64,
}

/// A resampling from some voxels to others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Resampling {
    pub placement: Placement,
    pub from: Voxels,
    pub to: Voxels,
}

impl Voxels {
    /// The voxels that a solid is sampled on first.
    pub fn first(inputs: &Inputs) -> Self {
        Self {
            scale: inputs.recipe.scale(),
            half_width: inputs.recipe.sections().band.half_width.0,
        }
    }

    /// The steps of a `resample` operation, in order; the last one ends on the requested voxels. Voxels much finer
    /// than the target are coarsened in factors of two first: otherwise the old band would have to be widened to
    /// too many voxels.
    pub fn resampling_steps(self, op: &Resample) -> Vec<Resampling> {
        let mut last = self.resampling(op);
        let mut all = Vec::new();
        while last.factor() >= MAX_REFINEMENT_RATIO {
            let double = last.from.coarser();
            last.from = double.to;
            all.push(double);
        }
        all.push(last);
        all
    }

    /// The voxels after a `resample` operation.
    pub fn resampled(self, op: &Resample) -> Self {
        self.resampling(op).to
    }

    /// The resampling of an operation in one step. Keys that the operation leaves out keep the present voxels.
    fn resampling(self, op: &Resample) -> Resampling {
        let edge = op.voxel_size.map(|size| size.resolve(self.scale));
        let voxel_size = edge.unwrap_or(self.scale.voxel_size);
        Resampling {
            placement: resample_placement(op, self.scale),
            from: self,
            to: Self {
                scale: Scale {
                    voxel_size,
                    ..self.scale
                },
                half_width: op.half_width.map_or(self.half_width, |w| w.0),
            },
        }
    }

    /// The resampling onto voxels of twice the edge.
    pub fn coarser(self) -> Resampling {
        let voxel_size = 2.0 * self.scale.voxel_size;
        Resampling {
            placement: Placement::IDENTITY,
            from: self,
            to: Self {
                scale: Scale {
                    voxel_size,
                    ..self.scale
                },
                ..self
            },
        }
    }
}

impl Resampling {
    /// Whether the new voxels are every second of the old ones, and the band determines the surface.
    pub fn is_doubling(&self) -> bool {
        self.to.scale.voxel_size == 2.0 * self.from.scale.voxel_size
            && self.placement == Placement::IDENTITY
            && SurfacePoints::suffices(self.from.half_width)
    }

    /// Edge of a new voxel, in old voxels. A placement that scales the solid up makes its voxels larger first.
    pub fn factor(&self) -> f64 {
        self.to.scale.voxel_size / (self.from.scale.voxel_size * self.placement.scale)
    }

    /// Half width that the old band must be widened to, voxels.
    pub fn source_half_width(&self) -> f64 {
        (self.to.half_width * self.factor() + INTERPOLATION_REACH).max(self.from.half_width)
    }

    /// Estimated number of leaves of the widened old band over that of the old band.
    pub fn growth(&self) -> f64 {
        growth(self.from.half_width, self.source_half_width())
    }

    /// Estimated number of leaves of the new band over that of the old band: a surface has a number that falls
    /// with the square of the edge.
    pub fn leaf_ratio(&self) -> f64 {
        self.factor().powi(-2) * growth(self.from.half_width, self.to.half_width)
    }
}

/// Number of leaves of a band over that of a band of another half width (voxels). A band of 2 w voxels meets
/// (2 w + 7) / 8 leaves across on average, as leaves of 8 voxels span 7 edges.
fn growth(from: f64, to: f64) -> f64 {
    const LEAF_WIDTH: f64 = 7.0;
    (2.0 * to + LEAF_WIDTH) / (2.0 * from + LEAF_WIDTH)
}
