//! Surfaces of triangles and quads: `.off` and `.obj` with their quads kept, `.ply` and `.stl` as
//! triangles. Faces of more than four corners are refused.

use super::collector::Collector;
use super::scaffold::ElementFile;
use super::tokens::Tokens;
use super::{ReadError, Source, quote};
use crate::scaffold::Kind;
use std::path::Path;

fn kind_of(corners: usize, source: &Source) -> Result<Kind, ReadError> {
    match corners {
        3 => Ok(Kind::Tri3),
        4 => Ok(Kind::Quad4),
        n => Err(source
            .bad(format!("a face of {n} corners"), "3 or 4 corners")
            .with_hint("split the faces of more than four corners")),
    }
}

/// Triangles of any mesh format.
///
/// # Errors
/// As [`super::read_mesh`].
pub fn read_triangles(path: &Path) -> Result<ElementFile, ReadError> {
    let mesh = super::read_mesh(path)?.mesh;
    let mut collector = Collector::new(path);
    for (i, v) in mesh.vertices().iter().enumerate() {
        collector.point(i as u64, (*v).into());
    }
    for (i, t) in mesh.triangles().iter().enumerate() {
        collector.element(i as u64, Kind::Tri3, &t.map(u64::from), &[]);
    }
    collector.finish(|_| None)
}

/// Geomview's object file format: text, with or without colours of the faces.
///
/// # Errors
/// When it cannot be read or is damaged.
pub fn read_off(path: &Path) -> Result<ElementFile, ReadError> {
    let mut tokens = Tokens::new(Source::open(path)?);
    let mut collector = Collector::new(path);
    let line = |tokens: &mut Tokens, what: &str| -> Result<String, ReadError> {
        loop {
            let line = tokens.needed_line(what)?;
            let line = line.split('#').next().unwrap_or("").trim();
            if !line.is_empty() {
                return Ok(line.to_owned());
            }
        }
    };
    let first = line(&mut tokens, "OFF")?;
    let Some(rest) = first.strip_prefix("OFF") else {
        return Err(tokens
            .source
            .bad(quote(&first), "OFF, the first line of an .off file"));
    };
    let what = "the numbers of vertices, faces and edges";
    let counts = match rest.trim() {
        "" => line(&mut tokens, what)?,
        same_line => same_line.to_owned(),
    };
    let numbers: Vec<u64> = counts
        .split_whitespace()
        .filter_map(|w| w.parse().ok())
        .collect();
    let [vertices, faces, ..] = numbers[..] else {
        return Err(tokens.source.bad(quote(&counts), what));
    };
    for i in 0..tokens.source.count(vertices, 6, "vertices")? {
        let text = line(&mut tokens, "a vertex")?;
        let at: Vec<f64> = text
            .split_whitespace()
            .filter_map(|w| w.parse().ok())
            .collect();
        let [x, y, z, ..] = at[..] else {
            return Err(tokens.source.bad(quote(&text), "three coordinates"));
        };
        collector.point(i as u64, [x, y, z]);
    }
    for i in 0..tokens.source.count(faces, 7, "faces")? {
        let text = line(&mut tokens, "a face")?;
        let words: Vec<u64> = text
            .split_whitespace()
            .map_while(|w| w.parse().ok())
            .collect();
        let corners = words
            .split_first()
            .and_then(|(&n, rest)| rest.get(..usize::try_from(n).ok()?));
        let Some(corners) = corners else {
            return Err(tokens
                .source
                .bad(quote(&text), "a number of corners and the corners"));
        };
        let kind = kind_of(corners.len(), &tokens.source)?;
        collector.element(i as u64, kind, corners, &[]);
    }
    collector.finish(|_| None)
}

/// Wavefront's format: `v` and `f` lines; groups (`g`, `o`) become groups.
///
/// # Errors
/// When it cannot be read or is damaged.
pub fn read_obj(path: &Path) -> Result<ElementFile, ReadError> {
    let mut source = Source::open(path)?;
    let mut collector = Collector::new(path);
    let (mut vertices, mut faces) = (0u64, 0u32);
    let mut group: Option<(String, Vec<u32>)> = None;
    while let Some(line) = source.line()? {
        let line = line.trim().to_owned();
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let at: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
                let [x, y, z, ..] = at[..] else {
                    return Err(source.bad(quote(&line), "v and three coordinates"));
                };
                collector.point(vertices, [x, y, z]);
                vertices += 1;
            }
            Some("f") => {
                let mut corners = Vec::new();
                for word in words {
                    let index = word.split('/').next().unwrap_or("");
                    let corner = match index.parse::<i64>() {
                        Ok(n) if n > 0 => n as u64 - 1,
                        // Negative numbers count back from the last vertex.
                        Ok(n) if n < 0 => vertices.wrapping_sub(n.unsigned_abs()),
                        _ => return Err(source.bad(quote(word), "the number of a vertex")),
                    };
                    corners.push(corner);
                }
                let kind = kind_of(corners.len(), &source)?;
                collector.element(u64::from(faces), kind, &corners, &[]);
                if let Some((_, members)) = &mut group {
                    members.push(faces);
                }
                faces += 1;
            }
            Some("g" | "o") => {
                if let Some((name, members)) = group.take() {
                    collector.named_group(&name, &members);
                }
                group = words.next().map(|name| (name.to_owned(), Vec::new()));
            }
            _ => {}
        }
    }
    if let Some((name, members)) = group {
        collector.named_group(&name, &members);
    }
    collector.finish(|_| None)
}
