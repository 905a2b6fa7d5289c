//! `[[op]]`: the operations on the solid, in order, with their parameters. Lengths are kept as written and
//! resolved by the run.

use super::brief::{Brief, Short, short};
use super::drain::Drain;
use super::forms::{Forms, forms};
use super::operand::{Mask, Operand, Side};
use super::quantity::{Finite, HalfWidth, Length, Positive, Size, Width};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::Error;

/// One operation. Those before the first that needs neighbours act on the exact field.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Op {
    /// Keep what is also inside the operand.
    Intersect(Operand),
    /// Add the operand.
    Union(Operand),
    /// Subtract the operand.
    Subtract(Operand),
    /// Add the operand, with the seam rounded.
    Blend(Blend),
    /// Keep what lies in a box.
    Trim(Trim),
    /// Move the surface outward. As one of the first operations on a solid that is still exact, and as far
    /// as its distances hold, at no cost; else, and on files, by distances from points of the surface, exact
    /// at edges and corners. The report names the method under `offsets`.
    Dilate(Brief<Move>),
    /// Move the surface inward, as `dilate`.
    Erode(Brief<Move>),
    /// Erode, then dilate: removes what is thinner than twice the distance.
    Open(Brief<Move>),
    /// Dilate, then erode: fills gaps narrower than twice the distance.
    Close(Brief<Move>),
    /// Keep only a wall along the surface, moved as `dilate` moves it.
    Hollow(Brief<Hollow>),
    /// Fill concave edges to a radius, and gaps narrower than twice it; flat walls stay within 0.02 voxel.
    Fillet(Brief<Fillet>),
    /// Gaussian smoothing of the level set; a width of 1 erases walls of 2 voxels.
    Gaussian(Brief<Kernel>),
    /// Box-mean smoothing of the level set.
    Mean(Brief<Kernel>),
    /// Median filter of the level set.
    Median(Brief<Kernel>),
    /// Laplacian flow, one step per iteration.
    Laplacian(Brief<Flow>),
    /// Mean curvature flow, one step per iteration.
    Curvature(Brief<Flow>),
    /// Restore distances.
    Renormalise(Brief<Renormalise>),
    /// Resample to other voxels or another placement.
    Resample(Brief<Resample>),
    /// Keep the component of greatest volume, report what was dropped.
    KeepLargest(bool),
    /// Drop components under a volume (cubic recipe units).
    DropSmall(Brief<DropSmall>),
    /// Fill closed voids: all (true), or those up to a volume (cubic recipe units).
    FillVoids(UpTo),
    /// Drill channels from cavities to the outside, the shortest that drain them; the report lists them.
    Drain(Brief<Drain>),
    /// Remove redundant nodes of the tree; the surface stays.
    Prune(bool),
    /// Write the fog volume "density" instead of the level set; the last operation.
    Fog(bool),
}

impl Op {
    /// The key it is written with.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Intersect(_) => "intersect",
            Self::Union(_) => "union",
            Self::Subtract(_) => "subtract",
            Self::Blend(_) => "blend",
            Self::Trim(_) => "trim",
            Self::Dilate(_) => "dilate",
            Self::Erode(_) => "erode",
            Self::Open(_) => "open",
            Self::Close(_) => "close",
            Self::Hollow(_) => "hollow",
            Self::Fillet(_) => "fillet",
            Self::Gaussian(_) => "gaussian",
            Self::Mean(_) => "mean",
            Self::Median(_) => "median",
            Self::Laplacian(_) => "laplacian",
            Self::Curvature(_) => "curvature",
            Self::Renormalise(_) => "renormalise",
            Self::Resample(_) => "resample",
            Self::KeepLargest(_) => "keep_largest",
            Self::DropSmall(_) => "drop_small",
            Self::FillVoids(_) => "fill_voids",
            Self::Drain(_) => "drain",
            Self::Prune(_) => "prune",
            Self::Fog(_) => "fog",
        }
    }

    /// The solid it is combined with, for the operations that have one.
    pub fn operand(&self) -> Option<&Operand> {
        match self {
            Self::Intersect(o) | Self::Union(o) | Self::Subtract(o) => Some(o),
            Self::Blend(b) => Some(&b.with),
            _ => None,
        }
    }

    /// Whether it acts on fields: minimum and maximum only.
    pub fn is_pointwise(&self) -> bool {
        matches!(
            self,
            Self::Intersect(_) | Self::Union(_) | Self::Subtract(_) | Self::Trim(_)
        )
    }

    /// The mask of the operation, if it has one.
    pub fn mask(&self) -> Option<&Mask> {
        let mask = match self {
            Self::Dilate(m) | Self::Erode(m) | Self::Open(m) | Self::Close(m) => &m.mask,
            Self::Gaussian(k) | Self::Mean(k) | Self::Median(k) => &k.mask,
            Self::Laplacian(f) | Self::Curvature(f) => &f.mask,
            Self::Fillet(f) => &f.mask,
            _ => return None,
        };
        mask.as_deref()
    }
}

/// A union with a rounded seam.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Blend {
    /// What is added.
    pub with: Operand,
    /// How far from the seam the rounding begins.
    pub radius: Size,
}

/// A box by two corners.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trim {
    /// Least x, y, z.
    pub min: [Length; 3],
    /// Greatest x, y, z.
    pub max: [Length; 3],
}

/// A move of the surface.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Move {
    /// How far, at the mask's full share.
    pub distance: Size,
    /// Where it acts (dilate and erode only): distances vary in proportion.
    pub mask: Option<Brief<Mask>>,
}

short!(Move {
    distance: Size,
    mask: None
});

/// A wall along the surface.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hollow {
    /// Full thickness of the wall.
    pub thickness: Size,
    /// On which side of the surface it lies.
    #[serde(default)]
    pub side: Side,
}

short!(Hollow {
    thickness: Size,
    side: Side::default()
});

/// Rounded concave edges.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fillet {
    /// Minimum radius of concave edges.
    pub radius: Size,
    /// Where it acts.
    pub mask: Option<Brief<Mask>>,
}

short!(Fillet {
    radius: Size,
    mask: None
});

/// Other voxels, another place: scale, then rotation about x, y, z, then shift, then sampling. Voxels of at most
/// a quarter of the new ones' edge are doubled first.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Resample {
    /// Edge of the new voxels; as before when left out.
    pub voxel_size: Option<Size>,
    /// Half width of the new band in voxels; as before when left out.
    pub half_width: Option<HalfWidth>,
    /// Factor on every coordinate.
    pub scale: Positive,
    /// Degrees about x, then y, then z.
    pub rotate: [Finite; 3],
    /// Shift along x, y, z.
    pub translate: [Length; 3],
}

impl Default for Resample {
    fn default() -> Self {
        Self {
            voxel_size: None,
            half_width: None,
            scale: Positive(1.0),
            rotate: [Finite(0.0); 3],
            translate: [Length::Bare(0.0); 3],
        }
    }
}

impl Short for Resample {
    type First = Size;
    fn short(voxel_size: Size) -> Self {
        Self {
            voxel_size: Some(voxel_size),
            ..Self::default()
        }
    }
}

/// A largest volume in cubic recipe units: a number, or true for any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpTo(pub f64);

impl Forms for UpTo {
    const DESCRIPTION: &'static str = "true, false or a positive volume";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "boolean" },
            { "type": "number", "exclusiveMinimum": 0 },
        ] })
    }
    fn flag<E: Error>(all: bool) -> Result<Self, E> {
        Ok(Self(if all { f64::INFINITY } else { 0.0 }))
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        Positive::try_from(v).map(|p| Self(p.0)).map_err(E::custom)
    }
}

forms!(UpTo, "UpTo");

/// A smoothing kernel.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kernel {
    /// Radius of the kernel, voxels when bare; rounded to whole voxels, at least one.
    pub width: Width,
    /// How often it is applied.
    pub iterations: Iterations,
    /// Where it acts.
    pub mask: Option<Brief<Mask>>,
}

short!(Kernel {
    width: Width,
    ..Self::default()
});

/// How often a step is applied: 1 to 1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(try_from = "i64")]
pub struct Iterations(#[schemars(range(min = 1, max = 1000))] pub u32);

impl Default for Iterations {
    fn default() -> Self {
        Self(1)
    }
}

impl TryFrom<i64> for Iterations {
    type Error = String;
    fn try_from(n: i64) -> Result<Self, String> {
        u32::try_from(n)
            .ok()
            .filter(|n| (1..=1000).contains(n))
            .map(Self)
            .ok_or_else(|| format!("found {n}, expected a whole number from 1 to 1000"))
    }
}

/// A flow that moves the surface a little at each step.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Flow {
    /// Number of steps.
    pub iterations: Iterations,
    /// Where it acts.
    pub mask: Option<Brief<Mask>>,
}

short!(Flow {
    iterations: Iterations,
    ..Self::default()
});

/// Restoring unit gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Renormalise {
    /// Number of sweeps.
    pub iterations: Iterations,
}

short!(Renormalise {
    iterations: Iterations
});

/// The smallest component that is kept.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DropSmall {
    /// Least volume of a component that is kept, in cubic recipe units.
    pub volume: Positive,
}

short!(DropSmall { volume: Positive });
