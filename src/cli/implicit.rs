//! `druse cell implicit`: a cell repeated in space as a 3MF with an implicit function instead of triangles. Only
//! programs that read the implicit extension show it; the domain (a box or a mesh) bounds the part.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::{Aabb, Element, LengthUnit, Vec3};
use crate::io::atomic::{AtomicFile, require_writable};
use crate::io::{ImplicitPart, read_mesh};
use crate::mesh::{MeshSolid, TriMesh};
use crate::recipe::Size;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// The .cell file, or the name of a surface.
    cell: PathBuf,
    /// The .3mf to write, in millimetres.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Edge of the reference cell, as in 5mm.
    #[arg(long, value_name = "LENGTH")]
    edge: Size,
    /// Number of cells along x, y and z of the box that is filled.
    #[arg(
        long,
        value_name = "NX,NY,NZ",
        default_value = "1,1,1",
        conflicts_with = "inside"
    )]
    repeat: Repeat,
    /// A closed mesh to fill instead of a box; the centre of a cell lies at its origin.
    #[arg(long, value_name = "MESH")]
    inside: Option<PathBuf>,
    /// Unit of a mesh that states none [default: mm].
    #[arg(long, value_name = "UNIT", requires = "inside")]
    unit: Option<LengthUnit>,
}

/// Numbers of cells along the axes.
#[derive(Clone, Copy)]
struct Repeat([u32; 3]);

impl std::str::FromStr for Repeat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let counts: Vec<u32> = text
            .split(',')
            .map_while(|n| n.trim().parse().ok().filter(|n| (1..=10_000).contains(n)))
            .collect();
        match (counts.as_slice(), text.split(',').count()) {
            (&[x, y, z], 3) => Ok(Self([x, y, z])),
            _ => Err("expected three numbers from 1 to 10000, as in 4,4,2".to_owned()),
        }
    }
}

/// Unit of the file; bare lengths of the arguments are in it too.
const UNIT: LengthUnit = LengthUnit::Millimetre;

/// Writes a cell as an implicit function in a 3MF, in a box of whole cells or inside a mesh.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    if p.output
        .extension()
        .is_none_or(|e| !e.eq_ignore_ascii_case("3mf"))
    {
        let message = format!("found the output {}; expected a .3mf", p.output.display());
        return Err(
            Failure::usage(message).hint("other formats take triangles: druse run, druse mesh")
        );
    }
    require_writable(&p.output)?;
    let cell = super::cell_text::read(&p.cell)?;
    let edge =
        p.edge.0.in_unit(UNIT, UNIT).ok_or_else(|| {
            Failure::usage("found --edge in voxels; expected a length, as in 5mm")
        })?;
    // Other cells continue over the faces of their period.
    if cell.element() == Element::Ball && p.inside.is_none() && p.repeat.0 != [1; 3] {
        let message = "found --repeat for a cell of a ball, which has no period; expected one cell";
        return Err(Failure::usage(message).hint("--inside MESH fills a larger shape"));
    }
    let function = cell
        .unit_expression()
        .map_err(|e| Failure::data(&p.cell, e.to_string()))?;
    let (domain, offset) = match &p.inside {
        Some(path) => (mesh_domain(path, p.unit, session)?, Vec3::zeros()),
        None => box_domain(edge, p.repeat),
    };
    let part = ImplicitPart {
        name: cell.name(),
        function: &function,
        edge,
        domain: &domain,
        is_box: p.inside.is_none(),
        offset,
        unit: UNIT,
    };
    let mut file = AtomicFile::create_seekable(&p.output)?;
    let nodes = part
        .write(&mut file)
        .map_err(|e| Failure::from(file.failed(e)))?;
    let bytes = file.commit()?;
    let size = domain.bounds().size();
    let text = format!(
        "{}  {} with edge {edge} mm in {} x {} x {} mm: {nodes} nodes, {}",
        super::terminal::path(&p.output),
        super::terminal::line(cell.name()),
        crate::frame::figures(size.x),
        crate::frame::figures(size.y),
        crate::frame::figures(size.z),
        super::numbers::size(bytes)
    );
    let facts = json!({
        "path": p.output.display().to_string(), "unit": UNIT.symbol(), "edge": edge, "nodes": nodes,
        "size": [size.x, size.y, size.z], "offset": [offset.x, offset.y, offset.z], "bytes": bytes,
    });
    Ok(Answer::new(text, facts))
}

/// A box of whole cells, the first with its centre in the origin, and the translation that puts the box's least
/// corner there.
fn box_domain(edge: f64, Repeat(counts): Repeat) -> (TriMesh, Vec3) {
    let half = Vec3::repeat(0.5 * edge);
    let bounds = Aabb {
        min: -half,
        max: Vec3::from_fn(|a, _| edge * f64::from(counts[a])) - half,
    };
    (TriMesh::cuboid(&bounds), half)
}

/// The closed surface of a mesh file, in millimetres.
fn mesh_domain(
    path: &Path,
    unit: Option<LengthUnit>,
    session: &Session,
) -> Result<TriMesh, Failure> {
    let read = read_mesh(path)?;
    for warning in &read.warnings {
        session.note(warning);
    }
    let factor = read.unit.or(unit).unwrap_or(UNIT).to(UNIT);
    let mesh = read.mesh.mapped(|v| v * factor);
    let (solid, repairs) =
        MeshSolid::repaired(mesh).map_err(|e| Failure::data(path, e.to_string()))?;
    if let Some(repair) = repairs.first() {
        return Err(Failure::data(
            path,
            format!("found a mesh to repair ({repair}); expected a closed mesh"),
        )
        .hint("druse voxelize repairs it; druse mesh writes the repaired surface"));
    }
    Ok(solid.mesh().clone())
}
