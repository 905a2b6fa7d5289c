//! References to input files: a path, or a path with the frame its numbers are in: unit, up axis and placement.
//! The files are read elsewhere.

use super::brief::{Brief, short};
use super::quantity::{Finite, Positive, Unit};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

/// A file and its frame: a path, or a table.
pub type FileRef = Brief<FileFrame>;

/// Which axis of a file points up; `y` is turned onto the recipe's z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Up {
    /// The y axis of the file becomes z.
    Y,
    /// As it is.
    #[default]
    Z,
}

/// A path and the frame of the numbers in it.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FileFrame {
    /// Where the file is, relative to the recipe.
    pub path: PathBuf,
    /// Unit of its numbers; the recipe's when it is left out and the format carries none.
    pub unit: Option<Unit>,
    /// Which of its axes points up.
    #[serde(default)]
    pub up: Up,
    /// A placement applied last, in the recipe's unit.
    #[serde(default)]
    pub transform: Similarity,
}

short!(FileFrame {
    path: PathBuf,
    unit: None,
    up: Up::default(),
    transform: Similarity::default()
});

/// Scale, then rotation, then translation.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Similarity {
    /// Factor on every coordinate.
    pub scale: Positive,
    /// Degrees about x, then y, then z.
    pub rotate: [Finite; 3],
    /// Shift along x, y, z.
    pub translate: [Finite; 3],
}

impl Default for Similarity {
    fn default() -> Self {
        Self {
            scale: Positive(1.0),
            rotate: [Finite(0.0); 3],
            translate: [Finite(0.0); 3],
        }
    }
}

impl Similarity {
    /// The matrix and the translation: a point x goes to `matrix x + translation`.
    pub fn matrix(&self) -> (crate::frame::Mat3, crate::frame::Vec3) {
        let [x, y, z] = self.rotate.map(|a| a.0.to_radians());
        let turn = nalgebra::Rotation3::from_euler_angles(x, y, z);
        (
            turn.matrix() * self.scale.0,
            crate::frame::Vec3::from(self.translate.map(|t| t.0)),
        )
    }
}
