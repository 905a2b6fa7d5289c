//! Wavefront material files: reading of colours, writing of a colour for each group. Other properties of materials are
//! neither read nor kept.

use super::error::ReadError;
use super::source::Source;
use druse_crystal::polymesh::group_color;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// The colours (`Kd`, 0 to 1) of a material file by name, rounded to 255ths; other lines are ignored.
pub(super) fn read(path: &Path) -> Result<BTreeMap<String, [u8; 3]>, ReadError> {
    let mut source = Source::open(path)?;
    let mut colors = BTreeMap::new();
    let mut name = String::new();
    while let Some(line) = source.line()? {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("newmtl") => name = words.collect::<Vec<_>>().join(" "),
            Some("Kd") => {
                let parts: Vec<f64> = words.map_while(|w| w.parse().ok()).collect();
                if let [r, g, b] = parts[..] {
                    colors.insert(name.clone(), rounded([r, g, b]));
                }
            }
            _ => {}
        }
    }
    Ok(colors)
}

/// A colour in 255ths.
pub(super) fn rounded(color: [f64; 3]) -> [u8; 3] {
    color.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// A material for each group; the group number determines the colour.
pub(super) fn text(groups: impl Iterator<Item = u32>) -> String {
    let mut text = String::new();
    for group in groups {
        let [r, g, b] = group_color(group);
        let _ = write!(
            text,
            "newmtl group{group}\nKd {r:.6} {g:.6} {b:.6}\nKa 0 0 0\nKs 0 0 0\nillum 1\n"
        );
    }
    text
}
