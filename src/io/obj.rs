//! Wavefront OBJ: text; only vertices and faces are read, polygons become triangles.

use super::mesh_file::MeshFile;
use super::mesh_view::Rows;
use super::polygon::Polygons;
use super::source::quote;
use super::{ReadError, Source};
use crate::frame::{LengthUnit, Vec3};
use std::io::{self, Write};

/// Statements that say nothing about the surface's triangles.
const PASSED: &[&str] = &[
    "vt",
    "vn",
    "vp",
    "g",
    "o",
    "s",
    "l",
    "p",
    "mg",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "call",
    "csh",
];

pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let mut vertices: Vec<Vec3> = Vec::new();
    let mut faces = Polygons::default();
    let mut unit = None;
    // The first face that names a vertex not yet read: line and number, from 1.
    let mut ahead: Option<(ReadError, usize)> = None;
    while let Some(statement) = source.joined_line()? {
        let mut words = statement.split_ascii_whitespace();
        match words.next() {
            None => {}
            Some("v") => {
                let numbers: Vec<f64> = words
                    .take(3)
                    .map_while(|w| w.parse().ok())
                    .filter(|c: &f64| c.is_finite())
                    .collect();
                let [x, y, z] = numbers[..] else {
                    return Err(source.bad(quote(&statement), "\"v\" and three finite numbers"));
                };
                vertices.push(Vec3::new(x, y, z));
            }
            Some("f" | "fo") => {
                for word in words {
                    let number = word.split('/').next().unwrap_or_default();
                    let index = match number.parse::<i64>() {
                        Ok(n) if n > 0 => n - 1,
                        Ok(n) if n < 0 => vertices.len() as i64 + n,
                        _ => -1,
                    };
                    if !(0..i64::from(u32::MAX)).contains(&index) {
                        let expected = "vertex numbers from 1, or from -1 backward";
                        return Err(source.bad(quote(word), expected));
                    }
                    if index as usize >= vertices.len()
                        && ahead.as_ref().is_none_or(|a| a.1 < index as usize)
                    {
                        let found = format!("vertex number {}", index + 1);
                        ahead = Some((
                            source.bad(found, "a number of a vertex in the file"),
                            index as usize,
                        ));
                    }
                    faces.corner(index as u32);
                }
                faces.end();
            }
            Some(w) if w.starts_with('#') => {
                let stated = words
                    .find_map(|w| w.strip_prefix("unit="))
                    .and_then(|u| u.parse().ok());
                unit = unit.or(stated);
            }
            Some(w) if PASSED.contains(&w) => {}
            Some(_) => {
                let expected = "an OBJ statement such as v, vn, f, g, o or #";
                return Err(source.bad(quote(&statement), expected));
            }
        }
    }
    if let Some((error, _)) = ahead.filter(|a| a.1 >= vertices.len()) {
        return Err(error);
    }
    let warnings = faces.dropped_warning();
    let mesh = faces.mesh(vertices, source.path())?;
    Ok(MeshFile {
        mesh,
        unit,
        warnings,
    })
}

/// Writes text with numbers that read back exactly.
pub(super) fn write(out: &mut dyn Write, rows: &mut dyn Rows, unit: LengthUnit) -> io::Result<()> {
    writeln!(out, "# druse unit={unit}")?;
    rows.each_vertex(&mut |v, _| writeln!(out, "v {:?} {:?} {:?}", v.x, v.y, v.z))?;
    rows.each_face(&mut |corners| {
        write!(out, "f")?;
        for &v in corners {
            write!(out, " {}", u64::from(v) + 1)?;
        }
        writeln!(out)
    })
}
