//! Reads STL in text, word by word.
//!
//! The triangles are the vertices between the ends of loops or facets. Keywords may be in upper or lower case, ends one
//! word or two (`endloop`, `end loop`), line breaks anywhere. The names of solids, colours and comments (`#`, `;`,
//! `//`, `!`) end with their line; lines of other words are counted and ignored. Normals are ignored, so malformed
//! ones are accepted.

use super::{Builder, stated_unit};
use crate::io::error::ReadError;
use crate::io::mesh_format::MeshFile;
use crate::io::number;
use crate::io::number::words;
use crate::io::source::Source;
use druse_geometry::frame::Vec3;

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
    /// The first of two words, such as `end loop`; alone at the end of a line, the end of a solid.
    End,
    /// The first word of a colour or a comment, which fills the rest of the line.
    Remark,
    /// A word that begins like a number.
    Number,
    Other,
}

/// The keywords, in lower case; those of vertices and facets, which are the most frequent, come first.
const KEYWORDS: [(&[u8], Keyword); 16] = [
    (b"vertex", Keyword::Vertex),
    (b"facet", Keyword::Facet),
    (b"normal", Keyword::Normal),
    (b"outer", Keyword::Outer),
    (b"loop", Keyword::Loop),
    (b"endloop", Keyword::EndLoop),
    (b"endfacet", Keyword::EndFacet),
    (b"solid", Keyword::Solid),
    (b"endsolid", Keyword::EndSolid),
    (b"end", Keyword::End),
    (b"end_loop", Keyword::EndLoop),
    (b"end_facet", Keyword::EndFacet),
    (b"end_solid", Keyword::EndSolid),
    (b"color", Keyword::Remark),
    (b"colour", Keyword::Remark),
    (b"rgb", Keyword::Remark),
];

impl Keyword {
    fn of(word: &[u8]) -> Self {
        if let [b'0'..=b'9' | b'+' | b'-' | b'.', ..] = word {
            return Self::Number;
        }
        let found = KEYWORDS.iter().find(|k| word.eq_ignore_ascii_case(k.0));
        match (found, word) {
            (Some((_, keyword)), _) => *keyword,
            (None, [b'#' | b';' | b'!', ..] | [b'/', b'/', ..]) => Self::Remark,
            _ => Self::Other,
        }
    }
}

/// Whether `head`, the first bytes of a file, is of an STL in text: it has one of its words and no zeros
/// but at the end, or is UTF-16.
pub(super) fn is_text(head: &[u8]) -> bool {
    let contains = |word: &[u8]| {
        head.windows(word.len())
            .any(|w| w.eq_ignore_ascii_case(word))
    };
    // UTF-16 contains zeros; the line reader reports it.
    let is_utf16 = matches!(
        head,
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [b's' | b'S', 0, b'o' | b'O', 0, ..]
    );
    // Some programs pad the last block of a short file with zeros.
    let zeros = head.iter().rev().take_while(|&&b| b == 0).count();
    let head = &head[..head.len() - zeros];
    is_utf16
        || !head.contains(&0) && (contains(b"facet") || contains(b"vertex") || contains(b"solid"))
}

/// The error that the current line has a word that is no keyword.
fn unknown_word(source: &Source) -> ReadError {
    number::line_error(
        source,
        "facet, outer loop, vertex, endloop, endfacet or endsolid",
    )
}

/// Skips the name of a solid in the words `rest` of a line; it ends with the line or at the beginning of a facet.
/// Returns whether a facet begins on the same line.
fn skip_name<'a>(rest: &mut (impl Iterator<Item = &'a [u8]> + Clone)) -> bool {
    let next = rest.clone().skip(1);
    // A name may have the word "facet".
    let begins_facet = |(word, next): (&[u8], &[u8])| {
        Keyword::of(word) == Keyword::Facet
            && matches!(Keyword::of(next), Keyword::Normal | Keyword::Outer)
    };
    let Some(name_length) = rest.clone().zip(next).position(begins_facet) else {
        return false;
    };
    if name_length > 0 {
        rest.nth(name_length - 1);
    }
    true
}

/// The state of reading a facet.
#[derive(Default)]
struct FacetReader {
    /// The complete vertices.
    corners: Vec<Vec3>,
    /// The coordinates of the current vertex so far; `None` outside a vertex.
    coordinates: Option<Vec<f64>>,
    /// Whether the next words belong to the normal.
    in_normal: bool,
    /// Whether the last word was `end`, whose second word is to come.
    pending_end: bool,
}

impl FacetReader {
    /// Reads a coordinate of the current vertex.
    fn add_coordinate(&mut self, source: &Source, word: &[u8]) -> Result<(), ReadError> {
        let Some(coordinates) = self.coordinates.as_mut() else {
            return Ok(());
        };
        let Some(coordinate) = number::finite(word) else {
            return Err(number::line_error(
                source,
                "\"vertex\" and three finite numbers below 1e18",
            ));
        };
        coordinates.push(coordinate);
        if let [x, y, z] = coordinates[..] {
            self.corners.push(Vec3::new(x, y, z));
            self.coordinates = None;
            if self.corners.len() > 3 {
                return Err(source.bad("a fourth vertex", "\"endloop\" after three"));
            }
        }
        Ok(())
    }

    /// The keyword of a word together with a preceding `end`; `None` for an `end` of something else.
    fn with_pending_end(&mut self, keyword: Keyword) -> Option<Keyword> {
        if !std::mem::take(&mut self.pending_end) {
            return Some(keyword);
        }
        match keyword {
            Keyword::Loop => Some(Keyword::EndLoop),
            Keyword::Facet => Some(Keyword::EndFacet),
            Keyword::Solid => Some(Keyword::EndSolid),
            _ => None,
        }
    }
}

/// Reads the triangles of all solids of a file. Two warnings are possible: no `endsolid`, and ignored lines.
///
/// # Errors
/// A facet without three vertices of finite numbers, an unknown word within a line, a file that ends within a facet.
pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let mut builder = Builder::default();
    let mut facet = FacetReader::default();
    let mut unit = None;
    let mut seen_endsolid = false;
    let mut ignored_lines = 0u64;
    while source.advance()? {
        let line = source.current();
        let mut rest = words(line);
        let mut is_line_start = true;
        while let Some(word) = rest.next() {
            if facet.coordinates.is_some() {
                facet.add_coordinate(&source, word)?;
                continue;
            }
            let is_first_word = std::mem::take(&mut is_line_start);
            let Some(keyword) = facet.with_pending_end(Keyword::of(word)) else {
                return Err(unknown_word(&source));
            };
            let in_normal = std::mem::take(&mut facet.in_normal);
            match keyword {
                Keyword::Vertex => facet.coordinates = Some(Vec::with_capacity(3)),
                Keyword::EndLoop | Keyword::EndFacet => {
                    if let [a, b, c] = facet.corners[..] {
                        builder.add([a, b, c]);
                        facet.corners.clear();
                    } else if !facet.corners.is_empty() || keyword == Keyword::EndLoop {
                        // An end of a facet after that of its loop finds no corners.
                        let found = format!("{} vertices in a facet", facet.corners.len());
                        return Err(source.bad(found, "three"));
                    }
                }
                Keyword::Solid => {
                    unit = unit.or_else(|| stated_unit(&String::from_utf8_lossy(line)));
                    seen_endsolid = false;
                    if !skip_name(&mut rest) {
                        break;
                    }
                }
                Keyword::EndSolid => {
                    seen_endsolid = true;
                    if !skip_name(&mut rest) {
                        break;
                    }
                }
                Keyword::End => facet.pending_end = true,
                Keyword::Remark => break,
                Keyword::Normal => facet.in_normal = true,
                Keyword::Facet | Keyword::Outer | Keyword::Loop => {}
                // The numbers of a normal, or what stands in their place.
                Keyword::Number | Keyword::Other if in_normal => facet.in_normal = true,
                Keyword::Other if is_first_word => {
                    ignored_lines += 1;
                    break;
                }
                Keyword::Number | Keyword::Other => return Err(unknown_word(&source)),
            }
        }
        // An `end` alone at the end of a line ends the solid, not a facet with corners.
        if std::mem::take(&mut facet.pending_end) {
            if !facet.corners.is_empty() {
                return Err(unknown_word(&source));
            }
            seen_endsolid = true;
        }
    }
    if !facet.corners.is_empty() || facet.coordinates.is_some() {
        return Err(source
            .bad("the end of the file within a facet", "\"endloop\"")
            .with_hint("the file looks truncated"));
    }
    let mut warnings = Vec::new();
    if !seen_endsolid {
        warnings.push("no \"endsolid\": the file may be truncated".to_owned());
    }
    if ignored_lines > 0 {
        warnings.push(format!("{ignored_lines} lines that are no STL; ignored"));
    }
    builder.finish(&source, unit, warnings)
}
