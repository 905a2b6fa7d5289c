//! The recipe: one TOML document from sources to files.
//!
//! The order of the sections is that of the pipeline: `[cell.NAME]`, `[crystal.NAME]`, `[scaffold]`, `[tiling]`,
//! `[band]`, `[[op]]`, `[[output]]`, `[build]`, `[require]`. Each section is one struct whose fields are the keys; the
//! doc comment of a field documents the key, the JSON schema and the command line's flag. Unknown keys are errors that
//! name the nearest known one. An error about a key has its line or its override.
//!
//! Conventions: a length is a number in the recipe's unit or a string with its own ("0.2mm", "3vx");
//! paths are relative to the recipe; arrays in override keys count from 0. Not promised: a valid recipe may name files
//! that do not exist or hold something else; the run opens them.
//!
//! ```
//! use druse::recipe::Recipe;
//! let text = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
//! let recipe = Recipe::parse(text, &["band.voxel_size=0.1mm".into()]).unwrap();
//! assert_eq!(recipe.scale().voxel_size, 0.1);
//! let error = Recipe::parse("druse = 1\n[bnad]\n", &[]).unwrap_err();
//! assert_eq!(error.hint.as_deref(), Some("did you mean \"band\"?"));
//! ```

use crate::frame::LengthUnit;
use crate::sequence::Clock;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

mod brief;
mod build;
mod cell;
mod check;
mod crystal;
mod deck;
mod drain;
mod error;
mod file;
mod fit;
mod forms;
mod frames;
mod grid_word;
mod hybrid;
mod motion;
mod op;
mod operand;
mod output;
mod quantity;
mod reference;
mod require;
mod require_file;
mod scaffold;
mod source;
mod target;
mod tiling;

pub use brief::{Brief, Short};
pub use build::BuildSection;
pub use cell::{Caps, CellSection, ElementName, Place as CellPlace, Section, Solid};

pub use crystal::{CrystalFrame, CrystalRef, CrystalSection, SurfaceRef};
pub use deck::DeckKind;
pub use drain::{Drain, Drained};
#[cfg(feature = "vdb")]
pub(crate) use error::nearest;
pub use error::{Place, RecipeError, RecipeFault};
pub use file::{FileFrame, FileRef, Similarity, Up};
pub use fit::{Filter, FitMethod, Solver, Symmetrise};
pub use grid_word::GridWord;
pub use hybrid::{Hybrid, Ingredient, Surroundings};
pub use motion::Motion;
pub use op::{
    Blend, DropSmall, Fillet, Flow, Hollow, Iterations, Kernel, Move, Op, Renormalise, Resample,
    Trim, UpTo,
};
pub use operand::{Ball, Block, Grid, Mask, Onto, Operand, Plane, Rod, Side, Single, Skin};
pub use output::{
    Compression, Cut, Decimate, MesherWord, Output, OutputKind, PictureSize, Segments,
};
#[doc(hidden)]
pub use quantity::{Finite, Fraction, Positive};
pub(crate) use quantity::{HalfWidth, Portion};
pub use quantity::{Length, QuantityError, Scale, Size, Unit, Width};
pub use reference::reference;
pub use require::RequireSection;
pub(crate) use require_file::RequireFile;
pub use scaffold::{
    BandSection, Boundary, BoxKind, BoxScaffold, CylinderScaffold, Distance, ElementOrder,
    FillKind, FillScaffold, Plate, ScaffoldSection, Shell, SphereScaffold, is_cad,
};
pub use source::Source;
pub use target::{TargetProperty, TargetTable, TargetWord};
pub use tiling::{
    Assignment, Direction, FieldPlace, FieldRef, Interpolation, Mismatch, Orient, OrientSection,
    Outside, Share, TilingSection, Varying,
};

/// The version of recipes that this program reads.
pub(crate) const VERSION: i64 = 1;

/// Frames per second of a recipe without `fps`.
const DEFAULT_FPS: f64 = 24.0;

/// The sections of a recipe, in the order of the pipeline.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Druse recipe")]
pub struct Sections {
    /// Version of the recipe: 1.
    pub druse: i64,
    /// Unit of every length without a unit.
    #[serde(default)]
    pub unit: Unit,
    /// Frame of the run; `--frames` sets it.
    #[serde(default = "default_frame")]
    pub frame: i32,
    /// Frames per second.
    #[serde(default = "default_fps")]
    pub fps: Positive,
    /// The palette of unit cells, by name.
    #[serde(default)]
    pub cell: BTreeMap<String, CellSection>,
    /// Polygon meshes made by scripts, by name.
    #[serde(default)]
    pub crystal: BTreeMap<String, CrystalSection>,
    /// The mesh whose elements are filled.
    pub scaffold: Option<ScaffoldSection>,
    /// The cells that fill it.
    pub tiling: Option<TilingSection>,
    /// The sampling of the solid.
    pub band: BandSection,
    /// The operations on the solid, in order.
    #[serde(default)]
    pub op: Vec<Op>,
    /// The files that are written.
    #[serde(default)]
    pub output: Vec<Output>,
    /// The layers of the build.
    pub build: Option<BuildSection>,
    /// Requirements on the finished part.
    pub require: Option<RequireSection>,
}

impl Sections {
    /// The unit and the voxel size that lengths refer to. A voxel size in voxels is
    /// refused before.
    fn scale(&self) -> Scale {
        let unit = self.unit.0;
        let voxel_size = self.band.voxel_size.0.in_unit(unit, unit);
        Scale {
            unit,
            voxel_size: voxel_size.expect("a voxel size in voxels is refused"),
        }
    }
}

fn default_frame() -> i32 {
    frames::DEFAULT_FRAME
}

fn default_fps() -> Positive {
    Positive(DEFAULT_FPS)
}

/// A valid recipe: its sections and its text.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    sections: Sections,
    source: Source,
}

impl Recipe {
    /// Reads a file and applies overrides of the form `KEY=VALUE`.
    ///
    /// # Errors
    /// [`RecipeError`]: the file is missing, unreadable or no valid recipe.
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, RecipeError> {
        let bytes = std::fs::read(path).map_err(|e| RecipeError::io(path, &e))?;
        let text = String::from_utf8(bytes).map_err(|e| RecipeError::not_text(path, &e))?;
        Self::load(Source::new(Some(path), text, overrides))
    }

    /// Reads a text; relative paths in it start from the working directory.
    ///
    /// # Errors
    /// [`RecipeError`]: no valid recipe.
    pub fn parse(text: &str, overrides: &[String]) -> Result<Self, RecipeError> {
        Self::load(Source::new(None, text.to_owned(), overrides))
    }

    /// Reads the text that a run's file carries: overrides are comments at its end. `file` is that file;
    /// relative paths start from its folder.
    ///
    /// # Errors
    /// [`RecipeError`]: no valid recipe.
    pub fn embedded(file: &Path, text: &str) -> Result<Self, RecipeError> {
        let (text, overrides) = Source::split_overrides(text);
        Self::load(Source::new(Some(file), text, &overrides))
    }

    fn load(mut source: Source) -> Result<Self, RecipeError> {
        let sections: Sections = source.deserialize()?;
        check::check(&sections, &source)?;
        Ok(Self { sections, source })
    }

    /// The sections of the recipe.
    pub fn sections(&self) -> &Sections {
        &self.sections
    }

    /// Its text and the positions of its keys.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The unit of its lengths.
    pub fn unit(&self) -> LengthUnit {
        self.sections.unit.0
    }

    /// The frame of the run and the rate of frames.
    pub fn clock(&self) -> Clock {
        Clock {
            frame: self.sections.frame,
            fps: self.sections.fps.0,
        }
    }

    /// The unit and the voxel size that its lengths refer to.
    pub fn scale(&self) -> Scale {
        self.sections.scale()
    }

    /// A path of the recipe, seen from the working directory.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.source.directory().join(path)
    }
}

/// The JSON schema of a recipe.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(Sections).to_value()
}
