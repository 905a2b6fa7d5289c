//! `druse cell info`, `eval`, `plot`, `homogenize`, `library` and `implicit`: the first two are here, the others
//! in files of their names. Points are in the cell's reference coordinates.

use super::cell_text::{describe, facts, read};
use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::cell::{Cell, default_group, groups, lattices, rank};
use crate::field::Field;
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use crate::io::atomic::{require_writable, write_bytes};
use crate::symmetry::{Basis, GROUP_NAMES, GroupText, Lattice, PointGroup, SymmetryError};
use clap::{Args, Subcommand};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Describe a cell; with --group list the operators, orbits and frequency domain of a group.
    Info {
        /// The .cell file, or the name of a surface.
        #[arg(required_unless_present = "group")]
        cell: Option<PathBuf>,
        /// A point group: D3, D4 in the plane; Td, Oh, D3h, C4v, D2h, D4h, T, Th, O, C3v, C1; Ih; or a file
        /// with one generator a line, such as "x,-z,y" (and `name`, `lattice` and a word).
        #[arg(long, conflicts_with = "cell", value_name = "NAME|FILE")]
        group: Option<String>,
        /// The group's lattice: square, hex2, cubic, fcc2, fcc1, hexprism or tetragonal [default: that
        /// of its element].
        #[arg(long, requires = "group")]
        lattice: Option<String>,
        /// List orbits of frequencies up to this many cycles per unit of length, at most 16.
        #[arg(long, requires = "group", value_name = "R", default_value_t = 2.0)]
        band_limit: f64,
    },
    /// Evaluate a cell's function and its Cartesian gradient at points of the reference cell.
    Eval {
        /// The .cell file, or the name of a surface.
        cell: PathBuf,
        /// Points: a .csv with the header x,y,z, or a .npy of shape [n, 3]; - reads a .csv from stdin. For a
        /// planar cell x,y or [n, 2].
        #[arg(long, value_name = "FILE")]
        points: PathBuf,
        /// The .csv to write; without it the table is printed.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Plot a cell and its source: slices with both surfaces, error against number of coefficients.
    Plot(super::plot::Parameters),
    /// Compute effective stiffness, conductivity and permeability of a periodic cell.
    Homogenize(Box<super::homogenize::Parameters>),
    /// Design cells at several volume fractions that meet on their faces.
    Library(Box<super::library::Parameters>),
    /// Write a repeated cell as a 3MF with an implicit function (volumetric and implicit extensions).
    Implicit(Box<super::implicit::Parameters>),
}

/// Executes the command that the arguments name; only `eval` writes a file here.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    match &p.what {
        What::Plot(p) => super::plot::answer(p, session),
        What::Homogenize(p) => super::homogenize::answer(p, session),
        What::Library(p) => super::library::answer(p, session),
        What::Implicit(p) => super::implicit::answer(p, session),
        What::Info {
            group: Some(group),
            lattice,
            band_limit,
            ..
        } => group_info(group, lattice.as_deref(), *band_limit),
        What::Info { cell, .. } => {
            // Without --group the parser requires a cell.
            let cell = read(cell.as_deref().unwrap_or(Path::new("")))?;
            Ok(Answer::new(describe(&cell), facts(&cell)))
        }
        What::Eval {
            cell,
            points,
            output,
        } => eval(&read(cell)?, points, output.as_deref()),
    }
}

/// Greatest frequency that orbits are listed up to, cycles per unit of length.
const MAX_LISTED_BAND_LIMIT: f64 = 16.0;

/// The operators and orbits of a named group, or of one in a file, on a lattice (a default where none is named).
/// `radius` bounds the frequencies of the orbits, cycles per unit of length.
fn group_info(name: &str, lattice: Option<&str>, radius: f64) -> Result<Answer, Failure> {
    // The number of orbits grows fast with the radius, the more so in more dimensions.
    if !(0.0..=MAX_LISTED_BAND_LIMIT).contains(&radius) {
        return Err(Failure::usage(format!(
            "--band-limit: found {radius}; expected 0 to {MAX_LISTED_BAND_LIMIT}"
        )));
    }
    let path = Path::new(name);
    if !GROUP_NAMES.contains(&name) && path.is_file() {
        return group_file(path, lattice, radius);
    }
    // The default lattice is that of the element whose whole group it is, or of the first that has it; C1 and groups
    // of no element are cubic.
    let all = || {
        Element::SCAFFOLD_ELEMENTS
            .into_iter()
            .chain([Element::Ball])
    };
    let first = || all().find(|e| groups(*e).contains(&name));
    let whole = all().find(|e| default_group(*e) == name);
    let default_lattice = match name {
        "C1" => "cubic",
        _ => whole.or_else(first).map_or("cubic", |e| lattices(e)[0]),
    };
    let lattice = lattice.unwrap_or(default_lattice);
    let failed = |e: SymmetryError| Failure::usage(e.to_string());
    // The name of the lattice gives the dimension: 2, 6 for icosahedral groups, or 3.
    if let Ok(plane) = Lattice::<2>::named(lattice) {
        let group = PointGroup::named(name, &plane).map_err(failed)?;
        return Ok(list_group(group, plane, radius));
    }
    if let Ok(six) = Lattice::<6>::named(lattice) {
        let group = PointGroup::named(name, &six).map_err(failed)?;
        return Ok(list_group(group, six, radius));
    }
    let space = Lattice::<3>::named(lattice).map_err(failed)?;
    let group = PointGroup::named(name, &space).map_err(failed)?;
    Ok(list_group(group, space, radius))
}

/// The same for a group from a file of generators. They act on the coordinates of the file's lattice, or of `lattice`
/// where it names none; with both, the group is listed on `lattice`, as in a fit.
fn group_file(path: &Path, lattice: Option<&str>, radius: f64) -> Result<Answer, Failure> {
    let text = crate::pipeline::read_group(path)?;
    if text.dimension == 2 {
        return list_file::<2>(path, &text, lattice, "square", radius);
    }
    list_file::<3>(path, &text, lattice, "cubic", radius)
}

/// [`group_file`] in `D` dimensions; `default` is the lattice on which generators act where nothing names one.
fn list_file<const D: usize>(
    path: &Path,
    text: &GroupText,
    lattice: Option<&str>,
    default: &str,
    radius: f64,
) -> Result<Answer, Failure> {
    let name = super::cell_text::stem(path);
    let group = text.group::<D>(&name, lattice.unwrap_or(default));
    let (group, own) = group.map_err(|e| crate::pipeline::group_fault(path, e))?;
    let Some(lattice) = lattice else {
        return Ok(list_group(group, own, radius));
    };
    let failed = |e: SymmetryError| Failure::usage(e.to_string());
    let lattice = Lattice::named(lattice).map_err(failed)?;
    let group = group.on_lattice(&own, &lattice).map_err(failed)?;
    Ok(list_group(group, lattice, radius))
}

/// The operators, elements and orbits of a point group in `D` dimensions, up to frequencies of `radius`, at most 16.
fn list_group<const D: usize>(group: PointGroup<D>, lattice: Lattice<D>, radius: f64) -> Answer {
    let name = group.name().to_owned();
    let lattice_name = lattice.name().unwrap_or("of its own");
    let domain = group.frequency_domain(&lattice);
    let elements: Vec<&str> = Element::SCAFFOLD_ELEMENTS
        .into_iter()
        .chain([Element::Ball])
        .filter(|e| rank(*e) == D && is_of(*e, &group, &lattice))
        .map(Element::name)
        .collect();
    let operators: Vec<String> = group.operators().iter().map(ToString::to_string).collect();
    let orbits = group.orbits(&lattice, radius);
    let generators: Vec<String> = group.generators().iter().map(ToString::to_string).collect();
    let unknowns = Basis::new(group, lattice, radius).len();
    let mut text = format!(
        "{name}: {} operators on the lattice {lattice_name}\n",
        operators.len()
    );
    for operator in &operators {
        let _ = writeln!(text, "  {operator}");
    }
    let _ = writeln!(
        text,
        "generated by {}\nkeeps: {}\nfrequency domain: {domain}",
        generators.join("; "),
        elements.join(", ")
    );
    let _ = writeln!(
        text,
        "{} orbits of frequencies up to {radius}, {unknowns} degrees of freedom; one representative \
         of each (the lexicographically greatest) and its size:",
        orbits.len()
    );
    let mut listed = Vec::new();
    for orbit in &orbits {
        let k: Vec<i32> = orbit.representative().to_vec();
        let _ = writeln!(text, "  {k:?}  {}", orbit.members.len());
        listed.push(json!({ "k": k, "size": orbit.members.len() }));
    }
    let facts = json!({
        "group": name,
        "lattice": lattice_name,
        "operators": operators,
        "generators": generators,
        "elements": elements,
        "frequency_domain": domain,
        "band_limit": radius,
        "degrees_of_freedom": unknowns,
        "orbits": listed,
    });
    Answer::new(text, facts)
}

/// Whether every operator of a group maps an element onto itself. Operators in the plane keep the other axes.
fn is_of<const D: usize>(element: Element, group: &PointGroup<D>, lattice: &Lattice<D>) -> bool {
    group.cartesian(lattice).iter().all(|q| {
        let in_space = Mat3::from_fn(|i, j| match (i < D, j < D) {
            (true, true) => q[(i, j)],
            _ => f64::from(u8::from(i == j)),
        });
        element.is_invariant_under(&in_space)
    })
}

/// Values and gradients of a cell at the points of a file, as a table; written to `output` if there is one.
fn eval(cell: &Cell, points: &Path, output: Option<&Path>) -> Result<Answer, Failure> {
    output.map_or(Ok(()), require_writable)?;
    let planar = cell.element().dimension() == 2;
    let columns: &[&str] = if planar {
        &["x", "y", "phi", "gx", "gy"]
    } else {
        &["x", "y", "z", "phi", "gx", "gy", "gz"]
    };
    let mut table = columns.join(",") + "\n";
    let mut rows = Vec::new();
    for [x, y, z] in super::points::read(points, cell.element().dimension())? {
        let (phi, g) = cell
            .expression()
            .value_and_gradient(CellPoint(Vec3::new(x, y, z)));
        let row = if planar {
            vec![x, y, phi, g.x, g.y]
        } else {
            vec![x, y, z, phi, g.x, g.y, g.z]
        };
        let numbers: Vec<String> = row.iter().map(ToString::to_string).collect();
        table += &numbers.join(",");
        table.push('\n');
        rows.push(json!(row));
    }
    let Some(path) = output else {
        return Ok(Answer::new(
            table,
            json!({ "columns": columns, "rows": rows }),
        ));
    };
    write_bytes(path, table.as_bytes())?;
    let shown = path.display().to_string();
    let text = format!("{}  {} points", super::terminal::line(&shown), rows.len());
    Ok(Answer::new(
        text,
        json!({ "path": shown, "points": rows.len() }),
    ))
}
