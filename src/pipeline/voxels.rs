//! The voxels that a solid lies on, and its way to others.

use super::inputs::Stock;
use super::volumes::resample_placement;
use crate::recipe::{Resample, Scale};
use crate::vdb::{MOST_FINER, Placement};

/// Voxels beside a point that its value is made of, where a level set is resampled.
pub(super) const PARABOLA: f64 = 2.0;

/// Voxels, and the band on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Voxels {
    pub scale: Scale,
    /// Half width of the band, voxels.
    pub half_width: f64,
}

/// The way of a solid to other voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Resampling {
    pub placement: Placement,
    pub from: Voxels,
    pub to: Voxels,
}

impl Voxels {
    /// Those that a solid is sampled on.
    pub fn first(stock: &Stock) -> Self {
        Self {
            scale: stock.recipe.scale(),
            half_width: stock.recipe.sections().band.half_width.0,
        }
    }

    /// How an operation resamples. Voxels much finer than the new ones are doubled before: a band as wide as
    /// the new one would be too many of them.
    pub fn ways(self, op: &Resample) -> Vec<Resampling> {
        let mut last = self.way(op);
        let mut all = Vec::new();
        while last.factor() >= MOST_FINER {
            let double = last.from.coarser();
            last.from = double.to;
            all.push(double);
        }
        all.push(last);
        all
    }

    /// Where an operation resamples to.
    pub fn resampled(self, op: &Resample) -> Self {
        self.way(op).to
    }

    fn way(self, op: &Resample) -> Resampling {
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

    /// The same solid on voxels of twice the edge.
    pub fn coarser(self) -> Resampling {
        let voxel_size = 2.0 * self.scale.voxel_size;
        Resampling {
            placement: Placement::NONE,
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
    /// Edge of a new voxel in old ones.
    pub fn factor(&self) -> f64 {
        self.to.scale.voxel_size / (self.from.scale.voxel_size * self.placement.scale)
    }

    /// Half width that the old band is widened to, voxels.
    pub fn wanted(&self) -> f64 {
        (self.to.half_width * self.factor() + PARABOLA).max(self.from.half_width)
    }

    /// How many times as many leaves the old band has then.
    pub fn growth(&self) -> f64 {
        growth(self.from.half_width, self.wanted())
    }

    /// How many times as many leaves the new band has as the old one: the surface is as large.
    pub fn leaves(&self) -> f64 {
        self.factor().powi(-2) * growth(self.from.half_width, self.to.half_width)
    }
}

/// How many times as many leaves a band has whose half width (voxels) is another: it meets a leaf's width
/// more of them than it is wide.
fn growth(from: f64, to: f64) -> f64 {
    const LEAF: f64 = 7.0;
    (2.0 * to + LEAF) / (2.0 * from + LEAF)
}
