//! STL: triangles without sharing, as 50 bytes each or as text.
//!
//! Whether a file is binary is decided by its size (84 + 50 n), then by its text, never by the word
//! `solid` alone, which many binary files begin with. The header of ours reads `druse unit=mm`.

use super::mesh_file::MeshFile;
use super::source::quote;
use super::{MeshView, Place, ReadError, Source};
use crate::frame::{LengthUnit, Vec3};
use crate::mesh::{Merger, TriMesh};
use std::io::{self, Write};

/// Bytes of the header and the count.
const HEAD: u64 = 84;
/// Bytes of a triangle.
const TRIANGLE: u64 = 50;

/// Reads either kind.
pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let size = source.size();
    let head = source.peek(512)?;
    let text = head[..head.len().min(512)].to_vec();
    let claimed = text
        .get(80..84)
        .map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let fits = claimed.is_some_and(|n| HEAD + TRIANGLE * n == size);
    let is_solid = text.len() >= 5 && text[..5].eq_ignore_ascii_case(b"solid");
    let printable = text
        .iter()
        .all(|&b| b >= 0x20 || matches!(b, b'\n' | b'\r' | b'\t'));
    if !fits && is_solid && printable {
        read_text(source)
    } else {
        read_binary(source)
    }
}

fn read_binary(mut source: Source) -> Result<MeshFile, ReadError> {
    let header: [u8; 80] = source.array("the 80 bytes of an STL header")?;
    let claimed = u64::from(u32::from_le_bytes(source.array("the number of triangles")?));
    let count = source.count(claimed, TRIANGLE, "triangles")?;
    let mut warnings = Vec::new();
    let extra = source.remaining() - TRIANGLE * count as u64;
    if extra > 0 && source.size() != u64::MAX {
        warnings.push(format!(
            "{extra} bytes after the last triangle; passed over"
        ));
    }
    let mut builder = Builder::default();
    for n in 0..count {
        let bytes: [u8; 50] = source.array("a triangle of 50 bytes")?;
        let number = |i: usize| {
            let at = 12 + 4 * i;
            f64::from(f32::from_le_bytes([
                bytes[at],
                bytes[at + 1],
                bytes[at + 2],
                bytes[at + 3],
            ]))
        };
        let corners = [0, 3, 6].map(|i| Vec3::new(number(i), number(i + 1), number(i + 2)));
        if let Some(bad) = corners.iter().flatten().find(|c| !c.is_finite()) {
            let place = Place::Item("triangle", n as u64 + 1);
            return Err(ReadError::data(
                source.path(),
                place,
                format!("the coordinate {bad}"),
                "a finite number",
            ));
        }
        builder.add(corners);
    }
    let unit = stated_unit(&String::from_utf8_lossy(&header));
    builder.finish(&source, unit, warnings)
}

fn read_text(mut source: Source) -> Result<MeshFile, ReadError> {
    let mut builder = Builder::default();
    let mut corners: Vec<Vec3> = Vec::with_capacity(3);
    let mut unit = None;
    let mut ended = false;
    while let Some(line) = source.line()? {
        let mut words = line.split_ascii_whitespace();
        let word = words.next().unwrap_or_default().to_ascii_lowercase();
        match word.as_str() {
            "vertex" => {
                let numbers: Vec<f64> = words
                    .map_while(|w| w.parse().ok())
                    .filter(|c: &f64| c.is_finite())
                    .collect();
                if let [x, y, z] = numbers[..] {
                    corners.push(Vec3::new(x, y, z));
                } else {
                    let found = quote(line);
                    return Err(source.bad(found, "\"vertex\" and three finite numbers"));
                }
                if corners.len() > 3 {
                    return Err(source.bad("a fourth vertex", "\"endloop\" after three"));
                }
            }
            "endloop" | "endfacet" => {
                if let [a, b, c] = corners[..] {
                    builder.add([a, b, c]);
                    corners.clear();
                } else if !corners.is_empty() || word == "endloop" {
                    let found = format!("{} vertices in a facet", corners.len());
                    return Err(source.bad(found, "three"));
                }
            }
            "solid" => {
                unit = unit.or_else(|| stated_unit(line));
                ended = false;
            }
            "endsolid" => ended = true,
            "facet" | "outer" | "" => {}
            _ => {
                let found = quote(line);
                return Err(source.bad(
                    found,
                    "facet, outer loop, vertex, endloop, endfacet or endsolid",
                ));
            }
        }
    }
    if !corners.is_empty() {
        return Err(source
            .bad("the end of the file within a facet", "\"endloop\"")
            .with_hint("the file looks truncated"));
    }
    let odd = (!ended).then(|| "no \"endsolid\": the file may be truncated".to_owned());
    builder.finish(&source, unit, odd.into_iter().collect())
}

/// The unit in a header such as `druse unit=mm`.
fn stated_unit(header: &str) -> Option<LengthUnit> {
    let rest = &header[header.find("unit=")? + 5..];
    let end = rest
        .find(|c: char| !c.is_ascii_alphabetic())
        .unwrap_or(rest.len());
    rest[..end].parse().ok()
}

#[derive(Default)]
struct Builder {
    merger: Merger,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    fn add(&mut self, corners: [Vec3; 3]) {
        self.triangles.push(corners.map(|p| self.merger.add(p)));
    }

    fn finish(
        self,
        source: &Source,
        unit: Option<LengthUnit>,
        warnings: Vec<String>,
    ) -> Result<MeshFile, ReadError> {
        let mesh = TriMesh::new(self.merger.vertices, self.triangles)
            .map_err(|e| ReadError::data(source.path(), Place::File, e.to_string(), "a mesh"))?;
        Ok(MeshFile {
            mesh,
            unit,
            warnings,
        })
    }
}

/// Bytes of the file that [`write`] makes.
pub(super) fn size(mesh: &MeshView) -> u64 {
    HEAD + TRIANGLE * mesh.faces.len() as u64
}

/// Writes binary STL.
pub(super) fn write(out: &mut dyn Write, mesh: &MeshView, unit: LengthUnit) -> io::Result<()> {
    let mut head = [b' '; 80];
    let title = format!("druse unit={unit}");
    head[..title.len()].copy_from_slice(title.as_bytes());
    out.write_all(&head)?;
    out.write_all(&(mesh.faces.len() as u32).to_le_bytes())?;
    for [a, b, c] in mesh.triangle_corners() {
        let n = (b - a)
            .cross(&(c - a))
            .try_normalize(0.0)
            .unwrap_or_default();
        let mut bytes = [0u8; TRIANGLE as usize];
        for (i, x) in [n, a, b, c].iter().flatten().enumerate() {
            bytes[4 * i..4 * i + 4].copy_from_slice(&(*x as f32).to_le_bytes());
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}
