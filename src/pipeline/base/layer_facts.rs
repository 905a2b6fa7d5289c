//! The layers of a build, as the report of a run lists them. These are plain data; `measure/build.rs` fills them.

use serde::Serialize;

/// The layers of a part. Lengths are in the recipe's unit; heights are measured along `up`, as the lower end of
/// a layer.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BuildReport {
    /// The direction in which layers are stacked, of length 1.
    pub up: [f64; 3],
    /// Height of a layer.
    pub layer: f64,
    /// Greatest angle between a wall and `up` that needs no support, degrees.
    pub overhang: f64,
    /// Number of layers.
    pub layers: u64,
    /// Lower end of the first layer and upper end of the last.
    pub heights: [f64; 2],
    /// Number of islands: components of a layer that lie over nothing, without the first layer.
    pub islands: u64,
    /// Number of cups: pockets that open upwards, or that the plate closes.
    pub cups: u64,
    /// Area that needs support, as projected onto the plate.
    pub overhang_area: f64,
    /// The greatest area of a layer, and its height.
    pub section_max: [f64; 2],
    /// The greatest change of the area from a layer to the next, and the height of that one.
    pub section_jump: [f64; 2],
    /// The greatest area of holes that are sealed in a layer, and its height.
    pub sealed_max: [f64; 2],
    /// The first islands from below.
    pub island_list: Vec<StartReport>,
    /// The first cups from below.
    pub cup_list: Vec<StartReport>,
    /// All layers in at most 400 steps of height.
    pub profile: Vec<ProfileStep>,
}

/// A component that begins in a layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StartReport {
    /// A point of it.
    pub place: [f64; 3],
    /// Its area in that layer.
    pub area: f64,
}

/// One or more consecutive layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ProfileStep {
    /// Height of the first.
    pub height: f64,
    /// Their greatest area.
    pub area: f64,
    /// Sum of the areas that need support.
    pub overhang: f64,
    /// Greatest area of sealed holes.
    pub sealed: f64,
    /// Number of islands.
    pub islands: u64,
}
