//! Text STL, word by word.
//!
//! The reader uses `vertex` and the ends of loops and facets, in upper or lower case, as one word or two, with
//! any line breaks. Names after `solid`, colours and comments (`#`, `;`, `//`, `!`) end with their line;
//! lines of other words are counted and ignored.

use super::{Builder, stated_unit};
use crate::frame::Vec3;
use crate::io::mesh_file::MeshFile;
use crate::io::number::{self, words};
use crate::io::{ReadError, Source};

/// The meaning of a word.
#[derive(Clone, Copy, PartialEq)]
enum Keyword {
    Solid,
    Facet,
    Normal,
    Outer,
    Loop,
    Vertex,
    EndLoop,
    EndFacet,
    EndSolid,
    /// The first of two words.
    End,
    /// A colour or a comment: the rest of the line.
    Remark,
    /// A number after `normal`.
    Number,
    Other,
}

impl Keyword {
    fn of(word: &[u8]) -> Self {
        if let [b'0'..=b'9' | b'+' | b'-' | b'.', ..] = word {
            return Self::Number;
        }
        let known: [(&[u8], Self); 16] = [
            (b"vertex", Self::Vertex),
            (b"facet", Self::Facet),
            (b"normal", Self::Normal),
            (b"outer", Self::Outer),
            (b"loop", Self::Loop),
            (b"endloop", Self::EndLoop),
            (b"endfacet", Self::EndFacet),
            (b"solid", Self::Solid),
            (b"endsolid", Self::EndSolid),
            (b"end", Self::End),
            (b"end_loop", Self::EndLoop),
            (b"end_facet", Self::EndFacet),
            (b"end_solid", Self::EndSolid),
            (b"color", Self::Remark),
            (b"colour", Self::Remark),
            (b"rgb", Self::Remark),
        ];
        let found = known.iter().find(|k| word.eq_ignore_ascii_case(k.0));
        match (found, word) {
            (Some(found), _) => found.1,
            (None, [b'#' | b';' | b'!', ..] | [b'/', b'/', ..]) => Self::Remark,
            _ => Self::Other,
        }
    }
}

/// Whether the first bytes of a file are STL in text.
pub(super) fn is_text(head: &[u8]) -> bool {
    let has = |what: &[u8]| {
        head.windows(what.len())
            .any(|w| w.eq_ignore_ascii_case(what))
    };
    // UTF-16 contains zeros; the line reader reports it.
    let is_utf16 = matches!(
        head,
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [b's' | b'S', 0, b'o' | b'O', 0, ..]
    );
    // Some programs pad the last block with zeros.
    let zeros = head.iter().rev().take_while(|&&b| b == 0).count();
    let head = &head[..head.len() - zeros];
    is_utf16 || !head.contains(&0) && (has(b"facet") || has(b"vertex") || has(b"solid"))
}

fn unknown(source: &Source) -> ReadError {
    number::line_error(
        source,
        "facet, outer loop, vertex, endloop, endfacet or endsolid",
    )
}

/// Skips a name, which ends at the beginning of a facet; returns whether a facet begins on the same line.
fn skip_name<'a>(rest: &mut (impl Iterator<Item = &'a [u8]> + Clone)) -> bool {
    let next = rest.clone().skip(1);
    let facet = |(a, b): (&[u8], &[u8])| {
        Keyword::of(a) == Keyword::Facet
            && matches!(Keyword::of(b), Keyword::Normal | Keyword::Outer)
    };
    let Some(at) = rest.clone().zip(next).position(facet) else {
        return false;
    };
    if at > 0 {
        rest.nth(at - 1);
    }
    true
}

/// The state of reading a facet.
#[derive(Default)]
struct Facet {
    corners: Vec<Vec3>,
    /// The numbers of the current vertex so far.
    vertex: Option<Vec<f64>>,
    /// Whether the next numbers belong to the normal, which may be invalid.
    normal: bool,
    /// Whether the last word was `end`.
    end: bool,
}

impl Facet {
    fn number(&mut self, source: &Source, word: &[u8]) -> Result<(), ReadError> {
        let Some(numbers) = self.vertex.as_mut() else {
            return Ok(());
        };
        let Some(x) = number::finite(word) else {
            return Err(number::line_error(
                source,
                "\"vertex\" and three finite numbers",
            ));
        };
        numbers.push(x);
        if let [x, y, z] = numbers[..] {
            self.corners.push(Vec3::new(x, y, z));
            self.vertex = None;
            if self.corners.len() > 3 {
                return Err(source.bad("a fourth vertex", "\"endloop\" after three"));
            }
        }
        Ok(())
    }

    /// The meaning of a word, combined with a preceding `end`.
    fn ended(&mut self, word: Keyword) -> Option<Keyword> {
        if !std::mem::take(&mut self.end) {
            return Some(word);
        }
        match word {
            Keyword::Loop => Some(Keyword::EndLoop),
            Keyword::Facet => Some(Keyword::EndFacet),
            Keyword::Solid => Some(Keyword::EndSolid),
            _ => None,
        }
    }
}

pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let mut builder = Builder::default();
    let mut facet = Facet::default();
    let (mut unit, mut ended, mut ignored_lines) = (None, false, 0u64);
    while source.advance()? {
        let line = source.current();
        let mut rest = words(line);
        let mut is_line_start = true;
        while let Some(word) = rest.next() {
            if facet.vertex.is_some() {
                facet.number(&source, word)?;
                continue;
            }
            let first = std::mem::take(&mut is_line_start);
            let Some(kind) = facet.ended(Keyword::of(word)) else {
                return Err(unknown(&source));
            };
            let normal = std::mem::take(&mut facet.normal);
            match kind {
                Keyword::Vertex => facet.vertex = Some(Vec::with_capacity(3)),
                Keyword::EndLoop | Keyword::EndFacet => {
                    if let [a, b, c] = facet.corners[..] {
                        builder.add([a, b, c]);
                        facet.corners.clear();
                    } else if !facet.corners.is_empty() || kind == Keyword::EndLoop {
                        let found = format!("{} vertices in a facet", facet.corners.len());
                        return Err(source.bad(found, "three"));
                    }
                }
                Keyword::Solid => {
                    unit = unit.or_else(|| stated_unit(&String::from_utf8_lossy(line)));
                    ended = false;
                    if !skip_name(&mut rest) {
                        break;
                    }
                }
                Keyword::EndSolid => {
                    ended = true;
                    if !skip_name(&mut rest) {
                        break;
                    }
                }
                Keyword::End => facet.end = true,
                Keyword::Remark => break,
                Keyword::Normal => facet.normal = true,
                Keyword::Facet | Keyword::Outer | Keyword::Loop => {}
                // Invalid normals are ignored.
                Keyword::Number | Keyword::Other if normal => facet.normal = true,
                Keyword::Other if first => {
                    ignored_lines += 1;
                    break;
                }
                Keyword::Number | Keyword::Other => return Err(unknown(&source)),
            }
        }
        if std::mem::take(&mut facet.end) {
            if !facet.corners.is_empty() {
                return Err(unknown(&source));
            }
            ended = true;
        }
    }
    if !facet.corners.is_empty() || facet.vertex.is_some() {
        return Err(source
            .bad("the end of the file within a facet", "\"endloop\"")
            .with_hint("the file looks truncated"));
    }
    let mut warnings = Vec::new();
    if !ended {
        warnings.push("no \"endsolid\": the file may be truncated".to_owned());
    }
    if ignored_lines > 0 {
        warnings.push(format!("{ignored_lines} lines that are no STL; ignored"));
    }
    builder.finish(&source, unit, warnings)
}
