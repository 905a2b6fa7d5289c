//! OFF, Geomview's object file format: text, with or without normals, colours and texture coordinates.
//!
//! Each vertex and each face takes a line, or several if a line has too few numbers. Further numbers on its line
//! are colours, normals or texture coordinates and are ignored, unless the file has fewer lines than items:
//! then they belong to the next item. `OFF BINARY` and vertices of four or more coordinates are refused.

use super::error::ReadError;
use super::number;
use super::number::words;
use super::polygons::Soup;
use super::source::{Source, quote};
use druse_geometry::frame::{Vec3, is_in_range};

/// Lines without comments and blank lines, with the unread numbers of the current line.
struct Lines {
    source: Source,
    numbers: Vec<f64>,
    at: usize, // index of the first unread number
}

impl Lines {
    /// Advances to the next line with words; `false` at the end.
    fn next(&mut self) -> Result<bool, ReadError> {
        while self.source.advance()? {
            if words(self.text()).next().is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The current line without its comment.
    fn text(&self) -> &[u8] {
        let line = self.source.current();
        line.split(|&b| b == b'#').next().unwrap_or_default()
    }

    /// Makes the numbers of the current line, from word `skip` on, the next ones to read; unread ones of the line
    /// before are dropped.
    fn take_line(&mut self, skip: usize) -> Result<(), ReadError> {
        let mut numbers = std::mem::take(&mut self.numbers);
        numbers.clear();
        self.at = 0;
        for word in words(self.text()).skip(skip) {
            let Some(x) = number::real(word) else {
                return Err(number::line_error(&self.source, "numbers"));
            };
            numbers.push(x);
        }
        self.numbers = numbers;
        Ok(())
    }

    /// The next number, on this line or a later one; `what` is expected at the end of the file.
    fn number(&mut self, what: impl Fn() -> String) -> Result<f64, ReadError> {
        while self.at == self.numbers.len() {
            if !self.next()? {
                let error = self.source.bad("the end of the file", what());
                return Err(error.with_hint("the file looks truncated"));
            }
            self.take_line(0)?;
        }
        self.at += 1;
        Ok(self.numbers[self.at - 1])
    }

    /// The next number as a count from 0 to `max`.
    fn count(&mut self, what: &str, max: f64) -> Result<u64, ReadError> {
        let x = self.number(|| what.to_owned())?;
        if x >= 0.0 && x.fract() == 0.0 && x <= max {
            return Ok(x as u64);
        }
        Err(self.source.bad(format!("{x}"), what))
    }

    /// Ends a vertex or a face. The rest of its line is the next item if the file has fewer lines than
    /// `remaining` items, otherwise it is ignored. `dense` keeps that decision once it is made.
    fn end(&mut self, dense: &mut Option<bool>, remaining: u64) -> Result<(), ReadError> {
        if self.at == self.numbers.len() {
            return Ok(());
        }
        let is_dense = match *dense {
            Some(is_dense) => is_dense,
            None => self.source.lines_left()? < remaining,
        };
        *dense = Some(is_dense);
        if !is_dense {
            self.at = self.numbers.len();
        }
        Ok(())
    }
}

/// Recognises the keyword OFF with prefixes for vertex data (ST texture, C colour, N normal, 4 coordinates, n any
/// dimension); returns an error for unsupported vertices, `None` for another word.
fn keyword(word: &[u8]) -> Option<Result<(), &'static str>> {
    let word = word.to_ascii_uppercase();
    let mut rest = word.strip_suffix(b"OFF")?;
    for part in [&b"ST"[..], b"C", b"N", b"C"] {
        rest = rest.strip_prefix(part).unwrap_or(rest);
    }
    match rest {
        b"" => Some(Ok(())),
        b"4" => Some(Err("vertices of four coordinates (4OFF)")),
        // The small n of nOFF; NNOFF is both.
        b"N" | b"4N" => Some(Err("vertices of any dimension (nOFF)")),
        _ => None,
    }
}

/// Reads a file: the keyword, the counts, then the content.
pub(super) fn read(source: Source) -> Result<Soup, ReadError> {
    let mut lines = Lines {
        source,
        numbers: Vec::new(),
        at: 0,
    };
    let expected = "OFF, the first line of an .off file";
    if !lines.next()? {
        return Err(lines.source.bad("the end of the file", expected));
    }
    let first: Vec<Vec<u8>> = words(lines.text()).map(<[u8]>::to_vec).collect();
    // `keyword` ignores case, and N alone means normals.
    let dimension = first[0] == b"nOFF" || first[0] == b"4nOFF";
    let refused = match keyword(&first[0]) {
        _ if dimension => Some("vertices of any dimension (nOFF)"),
        Some(Err(what)) => Some(what),
        Some(Ok(()))
            if first
                .get(1)
                .is_some_and(|w| w.eq_ignore_ascii_case(b"BINARY")) =>
        {
            Some("a binary file (OFF BINARY)")
        }
        Some(Ok(())) => {
            lines.take_line(1)?;
            None
        }
        // The keyword may be missing.
        None if first.iter().all(|w| w.iter().all(u8::is_ascii_digit)) => {
            lines.take_line(0)?;
            None
        }
        None => {
            let line = String::from_utf8_lossy(lines.source.current()).into_owned();
            return Err(lines.source.bad(quote(line.trim()), expected));
        }
    };
    if let Some(what) = refused {
        let error = lines
            .source
            .bad(what, "text with three coordinates a vertex");
        return Err(error.with_hint("write it as plain OFF, or as PLY"));
    }
    let max = f64::from(u32::MAX);
    let what = "the numbers of vertices, faces and edges";
    let vertices = lines.count(what, max)?;
    let on_own_lines = lines.at == lines.numbers.len();
    let faces = lines.count(what, max)?;
    // Some writers leave out the number of edges, which is not needed; where each count has its line it is there.
    if on_own_lines || lines.at < lines.numbers.len() {
        lines.count(what, f64::INFINITY)?;
    }
    content(lines, vertices, faces)
}

/// Reads vertices and faces of these numbers, vertices first; corners count from 0. That they exist is checked by the
/// caller.
fn content(mut lines: Lines, vertices: u64, faces: u64) -> Result<Soup, ReadError> {
    let mut soup = Soup::default();
    // A vertex is three digits with separators between, 5 bytes at least; a face with a corner is two, 3 bytes.
    let pending_numbers = (lines.numbers.len() - lines.at) as u64;
    lines
        .source
        .count(vertices.saturating_sub(pending_numbers), 5, "vertices")?;
    // Several items per line, if numbers follow the counts on their line.
    let mut dense = (lines.at < lines.numbers.len()).then_some(true);
    for n in 0..vertices {
        let mut point = [0.0; 3];
        for c in &mut point {
            *c = lines.number(|| format!("vertex {} of {vertices}", n + 1))?;
        }
        if !point.iter().all(|c| is_in_range(*c)) {
            return Err(number::line_error(
                &lines.source,
                "three finite coordinates below 1e18",
            ));
        }
        soup.vertices.push(Vec3::from(point));
        lines.end(&mut dense, vertices - n - 1 + faces)?;
    }
    let pending_numbers = (lines.numbers.len() - lines.at) as u64;
    lines
        .source
        .count(faces.saturating_sub(pending_numbers), 3, "faces")?;
    for n in 0..faces {
        let what = || format!("face {} of {faces}", n + 1);
        let corners = lines.number(what)?;
        let left = (lines.numbers.len() - lines.at) as u64 + lines.source.remaining();
        if !(corners >= 0.0 && corners.fract() == 0.0 && corners <= left as f64) {
            let found = format!("a face of {corners} corners");
            let expected = "a number of corners that the file can hold";
            return Err(lines.source.bad(found, expected));
        }
        let mut face = Vec::new();
        for _ in 0..corners as u64 {
            let corner = lines.number(what)?;
            if !(corner >= 0.0 && corner.fract() == 0.0 && corner < f64::from(u32::MAX)) {
                let found = format!("the vertex number {corner}");
                return Err(lines.source.bad(found, "a whole number from 0"));
            }
            face.push(corner as u32);
        }
        soup.faces.push(face);
        lines.end(&mut dense, faces - n - 1)?;
    }
    Ok(soup)
}
