//! Wavefront OBJ: text; vertices, polygons and what names them.
//!
//! Free-form curves and surfaces are passed over and counted, as are points and lines; statements that bring
//! in other files (`call`, `csh`) are refused, and so are those that nobody has defined.

use super::mesh_view::Rows;
use super::mtl;
use super::number::{self, words};
use super::polygons::Soup;
use super::polymesh::color_word;
use super::{ReadError, Source, quote};
use crate::frame::{LengthUnit, Vec3};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Statements that say nothing about the shape of the surface.
const PASSED: &[&[u8]] = &[
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

/// Statements of curves and surfaces in free form.
const FREE: &[&[u8]] = &[
    b"vp", b"cstype", b"deg", b"bmat", b"step", b"curv", b"curv2", b"surf", b"parm", b"trim",
    b"hole", b"scrv", b"sp", b"end", b"con", b"bzp", b"bsp", b"cdc", b"cdp", b"res",
];

/// Names that a face has when it is read.
#[derive(Clone, Default, PartialEq)]
pub(super) struct Names {
    pub material: String,
    /// By lines of `c r g b`, as a word.
    pub color: String,
    pub object: String,
}

/// What an OBJ file says beside its polygons.
#[derive(Default)]
pub(super) struct Marks {
    /// The names of all faces from this one on, until the next.
    pub names: Vec<(u32, Names)>,
    /// Colours of vertices; empty where none has one.
    pub tints: Vec<Option<[u8; 3]>>,
    pub libraries: Vec<String>,
}

impl Marks {
    /// The names of each of `count` faces.
    pub fn of_faces(&self, count: usize) -> impl Iterator<Item = &Names> {
        let ends = self.names.iter().skip(1).map(|n| n.0 as usize);
        let runs = self.names.iter().zip(ends.chain([count]));
        runs.flat_map(|(own, end)| std::iter::repeat_n(&own.1, end - own.0 as usize))
    }
}

/// Reads the polygons; `g` and `o` become groups of them.
pub(super) fn read(source: Source) -> Result<Soup, ReadError> {
    let (mut soup, marks) = read_marked(source)?;
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    for (face, names) in marks.of_faces(soup.faces.len()).enumerate() {
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

/// Reads the polygons and what the file says beside them.
pub(super) fn read_marked(mut source: Source) -> Result<(Soup, Marks), ReadError> {
    let mut soup = Soup::default();
    let mut marks = Marks::default();
    let mut now = Names::default();
    let mut changed = true;
    let (mut free, mut kinds) = (0u64, Vec::<String>::new());
    while source.advance_joined()? {
        let statement = source.current();
        let mut rest = words(statement);
        let Some(word) = rest.next() else {
            continue;
        };
        match word {
            b"v" | b"V" => vertex(&source, rest, &mut soup, &mut marks)?,
            b"f" | b"fo" | b"F" => {
                if std::mem::take(&mut changed) {
                    marks.names.push((soup.faces.len() as u32, now.clone()));
                }
                face(&source, rest, &mut soup)?;
            }
            b"usemtl" => changed |= named(&mut now.material, rest),
            b"g" | b"o" => changed |= named(&mut now.object, rest),
            b"mtllib" => {
                let mut name = String::new();
                named(&mut name, rest);
                marks.libraries.push(name);
            }
            b"c" => {
                let Some(color) = color(&statement[statement.len() - rest_length(statement)..])
                else {
                    let expected = "\"c\" and three numbers from 0 to 1";
                    return Err(number::fault(&source, expected));
                };
                changed |= color != now.color;
                now.color = color;
            }
            b"l" | b"p" => soup.skipped += 1,
            [b'#', ..] | [b'/', b'/', ..] => {
                let stated = rest.find_map(|w| std::str::from_utf8(w).ok()?.strip_prefix("unit="));
                soup.unit = soup.unit.or(stated.and_then(|u| u.parse().ok()));
            }
            w if PASSED.contains(&w) => {}
            w if FREE.contains(&w) => {
                free += 1;
                let name = String::from_utf8_lossy(w).into_owned();
                if !kinds.contains(&name) {
                    kinds.push(name);
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
                return Err(number::fault(&source, expected));
            }
        }
    }
    if free > 0 {
        let kinds = kinds.join(", ");
        soup.warnings.push(format!(
            "{free} statements of free-form curves and surfaces ({kinds}); passed over"
        ));
    }
    soup.check(source.path())?;
    Ok((soup, marks))
}

/// What follows the first word of a statement, in bytes.
fn rest_length(statement: &[u8]) -> usize {
    let text = statement.trim_ascii_start();
    text.len() - text.iter().take_while(|b| !b.is_ascii_whitespace()).count()
}

/// Puts words together as a name; whether it is another than before.
fn named<'a>(name: &mut String, words: impl Iterator<Item = &'a [u8]>) -> bool {
    let words: Vec<String> = words
        .map(|w| String::from_utf8_lossy(w).into_owned())
        .collect();
    let new = words.join(" ");
    let other = *name != new;
    *name = new;
    other
}

/// The colour that three numbers are, whatever stands between them.
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

fn vertex<'a>(
    source: &Source,
    words: impl Iterator<Item = &'a [u8]>,
    soup: &mut Soup,
    marks: &mut Marks,
) -> Result<(), ReadError> {
    let mut numbers = [0.0; 7];
    let mut count = 0;
    for word in words.take_while(|w| w[0] != b'#') {
        let Some(x) = number::finite(word) else {
            break;
        };
        if let Some(place) = numbers.get_mut(count) {
            *place = x;
        }
        count += 1;
    }
    if count < 3 {
        return Err(number::fault(source, "\"v\" and three finite numbers"));
    }
    soup.vertices
        .push(Vec3::new(numbers[0], numbers[1], numbers[2]));
    // Three numbers more are a colour, a single one is a weight, which only free forms have.
    if count >= 6 {
        marks.tints.resize(soup.vertices.len() - 1, None);
        let tint = mtl::rounded([numbers[3], numbers[4], numbers[5]]);
        marks.tints.push(Some(tint));
    }
    Ok(())
}

fn face<'a>(
    source: &Source,
    words: impl Iterator<Item = &'a [u8]>,
    soup: &mut Soup,
) -> Result<(), ReadError> {
    let count = soup.vertices.len() as i64;
    let mut wrong = None;
    let corners = words.take_while(|w| w[0] != b'#').map_while(|word| {
        let number = word.split(|&b| b == b'/').next().unwrap_or_default();
        let index = match whole(number) {
            Some(n) if n > 0 => n - 1,
            Some(n) if n < 0 => count + n,
            _ => -1,
        };
        if !(0..i64::from(u32::MAX)).contains(&index) {
            wrong = Some(word);
            return None;
        }
        Some(index as u32)
    });
    soup.faces.push(corners);
    soup.lines
        .push(u32::try_from(source.line_number()).unwrap_or(u32::MAX));
    match wrong {
        None => Ok(()),
        Some(word) => Err(source.bad(
            quote(&String::from_utf8_lossy(word)),
            "vertex numbers from 1, or from -1 backward",
        )),
    }
}

/// A whole number of text.
fn whole(word: &[u8]) -> Option<i64> {
    std::str::from_utf8(word).ok()?.parse().ok()
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
