//! Wavefront OBJ: text with vertices, polygons and their names.
//!
//! Free-form curves and surfaces, points and lines are counted and ignored. Statements that execute other files
//! (`call`, `csh`) and undefined statements are refused.
//!
//! A statement is a word and its arguments; a backslash at its end joins the next line. Vertices count from 1, or
//! backward from the last one with negative numbers. Texture and normal numbers of corners are not kept.

use super::error::ReadError;
use super::mesh_view::Rows;
use super::number::words;
use super::polygon_draft::color_word;
use super::polygons::Soup;
use super::source::{Source, quote};
use super::{mtl, number};
use druse_geometry::frame::{LengthUnit, Vec3};
use std::collections::BTreeMap;
use std::io;
use std::io::Write;

/// Statements without effect on the shape of the surface.
const IGNORED_STATEMENTS: &[&[u8]] = &[
    b"vt",
    b"vn",
    b"s",
    b"mg",
    b"usemap",
    b"maplib",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"shadow_obj",
    b"trace_obj",
    b"ctech",
    b"stech",
    b"vc",
];

/// Statements of free-form curves and surfaces.
const FREE_FORM_STATEMENTS: &[&[u8]] = &[
    b"vp", b"cstype", b"deg", b"bmat", b"step", b"curv", b"curv2", b"surf", b"parm", b"trim",
    b"hole", b"scrv", b"sp", b"end", b"con", b"bzp", b"bsp", b"cdc", b"cdp", b"res",
];

/// The current names of a face.
#[derive(Clone, Default, PartialEq)]
pub(super) struct Names {
    pub material: String,
    /// The colour of the last line `c r g b`, as a word.
    pub color: String,
    pub object: String,
}

/// Names and colours in an OBJ file.
#[derive(Default)]
pub(super) struct Annotations {
    /// The names of all faces from this index on, up to the next entry.
    pub names: Vec<(u32, Names)>,
    /// The colours of vertices; empty if no vertex has a colour.
    pub vertex_colors: Vec<Option<[u8; 3]>>,
    pub libraries: Vec<String>,
}

impl Annotations {
    /// The names of each of `count` faces.
    pub fn of_faces(&self, count: usize) -> impl Iterator<Item = &Names> {
        let ends = self.names.iter().skip(1).map(|n| n.0 as usize);
        let runs = self.names.iter().zip(ends.chain([count]));
        runs.flat_map(|(own, end)| std::iter::repeat_n(&own.1, end - own.0 as usize))
    }
}

/// Reads the polygons; `g` and `o` become groups, in the order of their first faces.
pub(super) fn read(source: Source) -> Result<Soup, ReadError> {
    let (mut soup, annotations) = read_annotated(source)?;
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    for (face, names) in annotations.of_faces(soup.faces.len()).enumerate() {
        if names.object.is_empty() {
            continue;
        }
        let place = *places.entry(&names.object).or_insert_with(|| {
            soup.groups.push((names.object.clone(), Vec::new()));
            soup.groups.len() - 1
        });
        soup.groups[place].1.push(face as u32);
    }
    Ok(soup)
}

/// Reads the polygons with names and colours. That corners are vertices of the file is checked at the end, since faces
/// may name later ones.
pub(super) fn read_annotated(mut source: Source) -> Result<(Soup, Annotations), ReadError> {
    let mut soup = Soup::default();
    let mut annotations = Annotations::default();
    let mut current = Names::default();
    let mut has_changed = true;
    let (mut free_form_count, mut free_form_names) = (0u64, Vec::<String>::new());
    while source.advance_joined()? {
        let statement = source.current();
        let mut rest = words(statement);
        let Some(word) = rest.next() else {
            continue;
        };
        match word {
            b"v" | b"V" => vertex(&source, rest, &mut soup, &mut annotations)?,
            b"f" | b"fo" | b"F" => {
                // Names hold until the next statement: they are recorded only at the first face (`fo` is its old
                // word) after a change.
                if std::mem::take(&mut has_changed) {
                    annotations
                        .names
                        .push((soup.faces.len() as u32, current.clone()));
                }
                face(&source, rest, &mut soup)?;
            }
            b"usemtl" => has_changed |= set_name(&mut current.material, rest),
            b"g" | b"o" => has_changed |= set_name(&mut current.object, rest),
            b"mtllib" => {
                let mut name = String::new();
                set_name(&mut name, rest);
                annotations.libraries.push(name);
            }
            // Colours "c r g b" are a convention of older programs.
            b"c" => {
                let Some(color) = color(&statement[statement.len() - rest_length(statement)..])
                else {
                    let expected = "\"c\" and three numbers from 0 to 1";
                    return Err(number::line_error(&source, expected));
                };
                has_changed |= color != current.color;
                current.color = color;
            }
            b"l" | b"p" => soup.skipped += 1,
            // Druse writes the unit into a comment.
            [b'#', ..] | [b'/', b'/', ..] => {
                let stated = rest.find_map(|w| std::str::from_utf8(w).ok()?.strip_prefix("unit="));
                soup.unit = soup.unit.or(stated.and_then(|u| u.parse().ok()));
            }
            w if IGNORED_STATEMENTS.contains(&w) => {}
            w if FREE_FORM_STATEMENTS.contains(&w) => {
                free_form_count += 1;
                let name = String::from_utf8_lossy(w).into_owned();
                if !free_form_names.contains(&name) {
                    free_form_names.push(name);
                }
            }
            b"call" | b"csh" => {
                let what = String::from_utf8_lossy(word);
                let found = format!("{what}, a statement that runs another file or a command");
                return Err(source
                    .bad(found, "vertices and faces in this file")
                    .with_hint("export the mesh as one plain OBJ"));
            }
            _ => {
                let expected = "an OBJ statement such as v, vn, f, g, o or #";
                return Err(number::line_error(&source, expected));
            }
        }
    }
    if free_form_count > 0 {
        let free_form_names = free_form_names.join(", ");
        soup.warnings.push(format!(
            "{free_form_count} statements of free-form curves and surfaces ({free_form_names}); ignored"
        ));
    }
    soup.check(source.path())?;
    Ok((soup, annotations))
}

/// The number of bytes after the first word of a statement.
fn rest_length(statement: &[u8]) -> usize {
    let text = statement.trim_ascii_start();
    text.len() - text.iter().take_while(|b| !b.is_ascii_whitespace()).count()
}

/// Sets a name from words; returns whether it has changed.
fn set_name<'a>(name: &mut String, words: impl Iterator<Item = &'a [u8]>) -> bool {
    let words: Vec<String> = words
        .map(|w| String::from_utf8_lossy(w).into_owned())
        .collect();
    let joined = words.join(" ");
    let is_changed = *name != joined;
    *name = joined;
    is_changed
}

/// The colour of three numbers (0 to 1) with any separators, as a word; `None` for other text.
fn color(text: &[u8]) -> Option<String> {
    let number = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
    let parts: Option<Vec<f64>> = text
        .split(|b| !number(b))
        .filter(|w| !w.is_empty())
        .map(number::real)
        .collect();
    let [r, g, b] = parts?[..] else { return None };
    Some(color_word(mtl::rounded([r, g, b])))
}

/// Reads a vertex, perhaps with a colour, from the words after `v`, and adds it to `soup`.
fn vertex<'a>(
    source: &Source,
    words: impl Iterator<Item = &'a [u8]>,
    soup: &mut Soup,
    annotations: &mut Annotations,
) -> Result<(), ReadError> {
    let mut numbers = [0.0; 6];
    let mut count = 0;
    // Reading ends at a comment or the first word that is no number in range.
    for word in words.take_while(|w| w[0] != b'#') {
        let Some(x) = number::finite(word) else {
            break;
        };
        if let Some(place) = numbers.get_mut(count) {
            // Numbers beyond the sixth are only counted.
            *place = x;
        }
        count += 1;
    }
    if count < 3 {
        return Err(number::line_error(
            source,
            "\"v\" and three finite numbers below 1e18",
        ));
    }
    soup.vertices
        .push(Vec3::new(numbers[0], numbers[1], numbers[2]));
    // The fourth to sixth are a colour (a seventh is its opacity); a fourth alone is a weight, which only free forms use.
    if count >= 6 {
        annotations
            .vertex_colors
            .resize(soup.vertices.len() - 1, None);
        let tint = mtl::rounded([numbers[3], numbers[4], numbers[5]]);
        annotations.vertex_colors.push(Some(tint));
    }
    Ok(())
}

/// Reads a face from the words after `f`, and adds it with its line to `soup`: vertex numbers, each with texture and
/// normal numbers after slashes, which are ignored.
fn face<'a>(
    source: &Source,
    words: impl Iterator<Item = &'a [u8]>,
    soup: &mut Soup,
) -> Result<(), ReadError> {
    let count = soup.vertices.len() as i64;
    let mut invalid = None;
    let corners = words.take_while(|w| w[0] != b'#').map_while(|word| {
        let number = word.split(|&b| b == b'/').next().unwrap_or_default();
        // Numbers count from 1, negative ones backward from the last vertex so far.
        let index = match integer(number) {
            Some(n) if n > 0 => n - 1,
            Some(n) if n < 0 => count + n,
            // -1 is out of range, so that 0 and other words are reported below.
            _ => -1,
        };
        if !(0..i64::from(u32::MAX)).contains(&index) {
            invalid = Some(word);
            return None;
        }
        Some(index as u32)
    });
    soup.faces.push(corners);
    soup.lines
        .push(u32::try_from(source.line_number()).unwrap_or(u32::MAX));
    match invalid {
        None => Ok(()),
        Some(word) => Err(source.bad(
            quote(&String::from_utf8_lossy(word)),
            "vertex numbers from 1, or from -1 backward",
        )),
    }
}

fn integer(word: &[u8]) -> Option<i64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Writes text with numbers that read back exactly; the unit goes into a comment.
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
