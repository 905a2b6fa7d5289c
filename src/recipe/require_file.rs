//! A file of requirements for `druse check`: a recipe, or only its `unit`, `[build]` and `[require]`. Rules that
//! need other sections of a recipe are not checked.

use super::build::BuildSection;
use super::error::RecipeError;
use super::quantity::Unit;
use super::require::RequireSection;
use super::source::Source;
use crate::frame::LengthUnit;
use serde::Deserialize;
use std::path::Path;

/// Requirements and the unit of their bare lengths.
#[derive(Clone, Debug, PartialEq)]
pub struct RequireFile {
    /// Unit of lengths without a unit.
    pub unit: LengthUnit,
    /// The requirements.
    pub section: RequireSection,
    /// The layers of the build.
    pub build: Option<BuildSection>,
}

/// The keys that are read. Others are not refused, because the file may be a whole recipe, whose other sections do
/// not matter here.
#[derive(Deserialize)]
struct Sections {
    #[serde(default)]
    unit: Unit,
    require: Option<RequireSection>,
    build: Option<BuildSection>,
}

impl RequireFile {
    /// Reads a file. Frame tokens are replaced as in a recipe; lengths stay as written.
    ///
    /// # Errors
    /// [`RecipeError`]: the file is missing, unreadable, or has no valid `[require]`.
    pub fn read(path: &Path) -> Result<Self, RecipeError> {
        let bytes = std::fs::read(path).map_err(|e| RecipeError::io(path, &e))?;
        let text = String::from_utf8(bytes).map_err(|e| RecipeError::not_text(path, &e))?;
        let mut source = Source::new(Some(path), text, &[]);
        let sections: Sections = source.deserialize()?;
        let Some(section) = sections.require.filter(|r| !r.is_empty()) else {
            let message = "no requirement; expected a [require] section with at least one";
            return Err(source
                .fault("require", message)
                .hint("for instance: [require] least_wall = \"0.4mm\""));
        };
        if let Some((key, message)) = sections.build.and_then(|b| b.fault()) {
            return Err(source.fault(&format!("build.{key}"), message));
        }
        let unit = sections.unit.0;
        // Sizes in voxels have no length here, as a file of requirements knows no voxel size; rules that compare
        // them pass.
        super::check::requirements(&section, |size| size.0.in_unit(unit, unit), &source)?;
        Ok(Self {
            unit,
            section,
            build: sections.build,
        })
    }
}
