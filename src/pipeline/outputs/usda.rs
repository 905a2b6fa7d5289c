//! USD scenes beside `.vdb` files: one Volume whose fields are the grids of a file, or of one file per frame.
//! Scenes hold no values; they name the files, in their folder.

use crate::frame::{Aabb, LengthUnit};
use crate::recipe::GridWord;
use std::fmt::Write;
use std::path::Path;

/// The text of the scene of a volume file; `bounds` is in the file's unit. The scene refers to the file
/// by its name.
pub(crate) fn scene(volume: &Path, unit: LengthUnit, bounds: Aabb, grids: &[String]) -> String {
    let file = volume.file_name().unwrap_or_default().to_string_lossy();
    let prim = identifier(&volume.file_stem().unwrap_or_default().to_string_lossy());
    let mut text = head(&prim, unit, "");
    let _ = writeln!(text, "    float3[] extent = {}", extent(bounds));
    fields(&mut text, &prim, &format!("filePath = @./{file}@"), grids);
    text
}

/// A frame of a sequence of volumes.
pub(crate) struct SceneFrame {
    /// Its number, which is its time code.
    pub frame: i32,
    /// Name of its file.
    pub file: String,
    /// Box of its solid in the file's unit; empty if unknown.
    pub bounds: Aabb,
}

/// The text of the scene of a sequence: a time sample per frame of the files and of the box. `unit`
/// is that of the lengths, `fps` the frames per second, and `grids` are the names of the grids.
pub(crate) fn sequence_scene(
    scene: &Path,
    unit: LengthUnit,
    fps: f64,
    frames: &[SceneFrame],
    grids: &[String],
) -> String {
    let prim = identifier(&scene.file_stem().unwrap_or_default().to_string_lossy());
    let mut times = String::new();
    if let (Some(first), Some(last)) = (frames.first(), frames.last()) {
        let _ = write!(
            times,
            "    startTimeCode = {}\n    endTimeCode = {}\n    timeCodesPerSecond = {fps}\n    framesPerSecond = {fps}\n",
            first.frame, last.frame
        );
    }
    let mut text = head(&prim, unit, &times);
    text.push_str("    float3[] extent.timeSamples = {\n");
    // Frames without a solid have no box.
    for f in frames.iter().filter(|f| !f.bounds.is_empty()) {
        let _ = writeln!(text, "        {}: {},", f.frame, extent(f.bounds));
    }
    text.push_str("    }\n");
    let mut files = String::from("filePath.timeSamples = {\n");
    for f in frames {
        let _ = writeln!(files, "            {}: @./{}@,", f.frame, f.file);
    }
    files.push_str("        }");
    fields(&mut text, &prim, &files, grids);
    text
}

/// The head of a scene, up to the first property of its Volume.
fn head(prim: &str, unit: LengthUnit, times: &str) -> String {
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"{prim}\"\n    metersPerUnit = {}\n    upAxis = \"Z\"\n{times})\n\n\
         def Volume \"{prim}\"\n{{\n",
        unit.to(LengthUnit::Metre)
    )
}

/// A box as USD's extent.
fn extent(bounds: Aabb) -> String {
    let corner = |v: crate::frame::Vec3| format!("({}, {}, {})", v.x, v.y, v.z);
    format!("[{}, {}]", corner(bounds.min), corner(bounds.max))
}

/// Appends the fields of the Volume and the end of the scene; `file` is the attribute that names the file, and
/// `grids` are the grids' names.
fn fields(text: &mut String, prim: &str, file: &str, grids: &[String]) {
    for grid in grids {
        let name = identifier(grid);
        let _ = writeln!(text, "    rel field:{name} = </{prim}/{name}>");
    }
    for grid in grids {
        let name = identifier(grid);
        let word: Option<GridWord> = grid.parse().ok();
        // Viewers choose the shading by this class.
        let class = match &word {
            Some(GridWord::Density) => "fogVolume",
            Some(w) if w.is_attribute() => "unknown",
            _ => "levelSet",
        };
        let kind = match word.map_or(1, |w| w.components()) {
            3 => "float3",
            _ => "float",
        };
        let _ = write!(
            text,
            "\n    def OpenVDBAsset \"{name}\"\n    {{\n        asset {file}\n        \
             token fieldName = \"{grid}\"\n        token fieldClass = \"{class}\"\n        \
             token fieldDataType = \"{kind}\"\n    }}\n"
        );
    }
    text.push_str("}\n");
}

/// A valid USD identifier: letters, digits and underscores, without a leading digit.
fn identifier(name: &str) -> String {
    let valid_char = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let text: String = name.chars().map(valid_char).collect();
    match text.chars().next() {
        Some(c) if !c.is_ascii_digit() => text,
        _ => format!("_{text}"),
    }
}
