//! `[[op]]`: what is done to the solid, in order.

use super::brief::{Brief, Short};
use super::file::FileRef;
use super::quantity::{Length, Positive, Size, Width};
use schemars::JsonSchema;
use serde::Deserialize;

/// One operation. Those before the first that needs neighbours act on the exact field.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Op {
    /// Keep what is also inside the operand.
    Intersect(Operand),
    /// Add the operand.
    Union(Operand),
    /// Take the operand away.
    Subtract(Operand),
    /// Move the surface outward.
    Dilate(Size),
    /// Move the surface inward.
    Erode(Size),
    /// Erode, then dilate: removes what is thinner than twice the distance.
    Open(Size),
    /// Dilate, then erode: fills gaps narrower than twice the distance.
    Close(Size),
    /// Gaussian smoothing of the level set.
    Gaussian(Brief<Kernel>),
    /// Box-mean smoothing of the level set.
    Mean(Brief<Kernel>),
    /// Median filter of the level set.
    Median(Brief<Kernel>),
    /// Laplacian flow, one step per iteration.
    Laplacian(Brief<Flow>),
    /// Mean curvature flow, one step per iteration.
    Curvature(Brief<Flow>),
    /// Make the values distances again.
    Renormalise(Brief<Renormalise>),
    /// Keep the component of greatest volume, report what was dropped.
    KeepLargest(bool),
    /// Drop components under a volume (cubic recipe units).
    DropSmall(Brief<DropSmall>),
}

impl Op {
    /// The key it is written with.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Intersect(_) => "intersect",
            Self::Union(_) => "union",
            Self::Subtract(_) => "subtract",
            Self::Dilate(_) => "dilate",
            Self::Erode(_) => "erode",
            Self::Open(_) => "open",
            Self::Close(_) => "close",
            Self::Gaussian(_) => "gaussian",
            Self::Mean(_) => "mean",
            Self::Median(_) => "median",
            Self::Laplacian(_) => "laplacian",
            Self::Curvature(_) => "curvature",
            Self::Renormalise(_) => "renormalise",
            Self::KeepLargest(_) => "keep_largest",
            Self::DropSmall(_) => "drop_small",
        }
    }

    /// The solid it is combined with, for the three operations that have one.
    pub fn operand(&self) -> Option<&Operand> {
        match self {
            Self::Intersect(o) | Self::Union(o) | Self::Subtract(o) => Some(o),
            _ => None,
        }
    }
}

/// A solid to combine with.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Operand {
    /// The inside of a closed mesh.
    Mesh(FileRef),
    /// A wall along a closed mesh.
    Skin(Skin),
    /// A ball.
    Sphere(Ball),
    /// An axis-aligned box.
    Box(Block),
}

/// A wall along a closed mesh.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Skin {
    /// The mesh.
    pub mesh: FileRef,
    /// Full thickness of the wall.
    pub thickness: Size,
    /// On which side of the mesh the wall lies.
    #[serde(default)]
    pub side: Side,
}

/// Side of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Within the mesh.
    #[default]
    Inside,
    /// Around it.
    Outside,
    /// Half the thickness on each side.
    Both,
}

/// A ball.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// Its radius.
    pub radius: Size,
    /// Its centre.
    #[serde(default = "origin")]
    pub centre: [Length; 3],
}

/// An axis-aligned box.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Edge lengths along x, y, z.
    pub size: [Size; 3],
    /// Its centre.
    #[serde(default = "origin")]
    pub centre: [Length; 3],
}

fn origin() -> [Length; 3] {
    [Length::Bare(0.0); 3]
}

/// A smoothing kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kernel {
    /// Radius of the kernel, voxels when bare; rounded to whole voxels, at least one.
    pub width: Width,
    /// How often it is applied.
    pub iterations: Iterations,
}

impl Short for Kernel {
    type First = Width;
    fn short(width: Width) -> Self {
        Self {
            width,
            ..Self::default()
        }
    }
}

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Flow {
    /// Number of steps.
    pub iterations: Iterations,
}

impl Short for Flow {
    type First = Iterations;
    fn short(iterations: Iterations) -> Self {
        Self { iterations }
    }
}

/// Restoring unit gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Renormalise {
    /// Number of sweeps.
    pub iterations: Iterations,
}

impl Short for Renormalise {
    type First = Iterations;
    fn short(iterations: Iterations) -> Self {
        Self { iterations }
    }
}

/// The least piece that stays.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DropSmall {
    /// Least volume of a component that is kept, in cubic recipe units.
    pub volume: Positive,
}

impl Short for DropSmall {
    type First = Positive;
    fn short(volume: Positive) -> Self {
        Self { volume }
    }
}
