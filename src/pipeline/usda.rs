//! USD scenes beside `.vdb` files: one Volume whose fields are the file's grids.

use crate::frame::{Aabb, LengthUnit};
use crate::recipe::GridWord;
use std::fmt::Write;
use std::path::Path;

/// The text of the scene of a volume file; `bounds` is in the file's unit. The scene refers to the file
/// by its name.
pub(super) fn scene(volume: &Path, unit: LengthUnit, bounds: Aabb, grids: &[String]) -> String {
    let file = volume.file_name().unwrap_or_default().to_string_lossy();
    let prim = identifier(&volume.file_stem().unwrap_or_default().to_string_lossy());
    let corner = |v: crate::frame::Vec3| format!("({}, {}, {})", v.x, v.y, v.z);
    let mut text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"{prim}\"\n    metersPerUnit = {}\n    upAxis = \"Z\"\n)\n\n\
         def Volume \"{prim}\"\n{{\n    float3[] extent = [{}, {}]\n",
        unit.to(LengthUnit::Metre),
        corner(bounds.min),
        corner(bounds.max)
    );
    for grid in grids {
        let name = identifier(grid);
        let _ = writeln!(text, "    rel field:{name} = </{prim}/{name}>");
    }
    for grid in grids {
        let name = identifier(grid);
        let word: Option<GridWord> = grid.parse().ok();
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
            "\n    def OpenVDBAsset \"{name}\"\n    {{\n        asset filePath = @./{file}@\n        \
             token fieldName = \"{grid}\"\n        token fieldClass = \"{class}\"\n        \
             token fieldDataType = \"{kind}\"\n    }}\n"
        );
    }
    text.push_str("}\n");
    text
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
