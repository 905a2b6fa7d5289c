//! From a file to the scene of its page.
//!
//! Each kind of file has a scene: a level set, a mesh, a scaffold, a cell. Scenes hold few enough triangles for
//! a browser; notes state what they leave out. Level sets are also kept for slices.

use super::elements::Elements;
use super::sampled::{Grid, Sampled};
use super::scene::{At, Field, Scene};
use super::surface::{SurfaceOptions, body};
use super::{KINDS, Parameters, elements};
use crate::cell::Cell;
use crate::cli::failure::Failure;
use crate::cli::kind::FileKind;
use crate::cli::numbers;
use crate::frame::{Vec3, WorldPoint, figures};
use crate::io::{ElementFile, read_cell, read_elements, read_mesh, read_solid};
use crate::mesh::{TriMesh, mesh_components};
use crate::progress::Progress;
use crate::vdb::{CoarseReading, Cubes, GridReading, LevelSet, Volume};
use crate::{pipeline, vdb};
use std::path::Path;

/// Triangles that are meshed for one that remains: walls survive the simplification better than coarse voxels.
const SIMPLIFICATION_RATIO: usize = 6;
/// Active voxels of a band of three voxels' half width for a triangle.
pub(super) const VOXELS_PER_TRIANGLE: f64 = 3.0;
/// Size of the largest .vdb whose other grids are read.
const MAX_INSPECTED_BYTES: u64 = 256 << 20;
/// Voxels along one element of a cell, and along an element of a block.
const ELEMENT_VOXELS: [f64; 2] = [160.0, 72.0];
/// Elements along an edge of the block.
const BLOCK_ELEMENTS: usize = 3;
/// Half width of the bands, voxels.
const BAND_HALF_WIDTH: f64 = 3.0;
/// Voxels along the longest side of beams.
const BEAM_VOXELS: f64 = 400.0;

/// Reads a file and makes its scene; of a level set also the grid for slices.
pub(super) fn scene(
    p: &Parameters,
    tools: vdb::Session,
    progress: &dyn Progress,
) -> Result<(Scene, Option<Sampled>), Failure> {
    if let Some(cell) = crate::cli::cell_text::surface(&p.file, None)? {
        return Ok((cell_scene(p, &cell, tools, progress)?, None));
    }
    let scene = match kind_of(&p.file)? {
        FileKind::Vdb => return level_set(p, tools, progress),
        FileKind::Mesh => mesh_scene(p, tools, progress),
        FileKind::Scaffold => scaffold(p, progress),
        _ => cell_scene(p, &read_cell(&p.file)?, tools, progress),
    };
    Ok((scene?, None))
}

/// Whether a file takes long to read, so that it is read once.
pub(super) fn is_large(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| found.len() > MAX_INSPECTED_BYTES)
}

/// Refuses a file that no page shows.
pub(super) fn check(path: &Path) -> Result<(), Failure> {
    if crate::cli::cell_text::surface(path, None)?.is_none() {
        kind_of(path)?;
    }
    Ok(())
}

/// The scene of a level set in memory, in its own unit, whose name is `unit`. Wall thickness is
/// measured if `has_thickness`.
pub(super) fn solid_scene(
    p: &Parameters,
    solid: &LevelSet,
    unit: &str,
    has_thickness: bool,
    tools: vdb::Session,
    progress: &dyn Progress,
) -> Result<Scene, Failure> {
    let mesh = solid.to_mesh(tools)?;
    let mut none = |_: &[Vec3]| Ok::<Vec<Field>, Failure>(Vec::new());
    let how = SurfaceOptions {
        has_thickness,
        ..options(p)
    };
    let (body, components) = body("surface", &mesh, how, unit, &mut none, progress)?;
    let mut notes = Vec::new();
    simplified(mesh.triangles().len(), body.triangles.len(), &mut notes);
    let mut facts = Vec::new();
    if body.is_closed {
        let volume: f64 = components.iter().map(|c| c.volume).sum();
        facts.push(["volume".into(), volume_text(volume, unit)]);
    }
    Ok(Scene {
        kind: "recipe",
        unit: unit.to_owned(),
        bodies: vec![body],
        facts,
        notes,
    })
}

/// Whether a file is one of NanoVDB, which no other command reads.
fn is_nano(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("nvdb"))
}

/// The kind of a file that a page shows; any other is an error.
pub(super) fn kind_of(path: &Path) -> Result<FileKind, Failure> {
    if is_nano(path) {
        return Ok(FileKind::Vdb);
    }
    FileKind::of(path, &KINDS)
}

/// The options of surfaces from the flags.
fn options(p: &Parameters) -> SurfaceOptions {
    SurfaceOptions {
        max_triangles: p.triangles,
        has_thickness: !p.no_thickness,
    }
}

/// How level sets are read that have too many voxels to be meshed as they are.
pub(super) fn coarse_reading(p: &Parameters) -> CoarseReading {
    CoarseReading {
        max_voxels: (VOXELS_PER_TRIANGLE * (SIMPLIFICATION_RATIO * p.triangles) as f64) as u64,
        threads: p.threads,
    }
}

/// The unit that lengths are shown in, and its number in a unit of the file: millimetres for small parts in metres.
fn shown_unit(stated: Option<&str>, longest: f64) -> (&str, f64) {
    match stated {
        Some("m") if longest < 1.0 => ("mm", 1000.0),
        Some(unit) => (unit, 1.0),
        None => ("", 1.0),
    }
}

/// The scene of a level set of a file, and its grid for slices. Large ones are read on coarser voxels.
fn level_set(
    p: &Parameters,
    tools: vdb::Session,
    progress: &dyn Progress,
) -> Result<(Scene, Option<Sampled>), Failure> {
    progress.stage("reading", None);
    let reader = crate::cli::vdb::reader()?;
    let volume = reader.fetch_coarse(&p.file, p.grid.as_deref(), coarse_reading(p))?;
    let (step, own) = (volume.coarse_step(), volume.name().to_owned());
    let stated = volume.meta("druse.unit").map(str::to_owned);
    let info = volume.info().clone();
    let mut notes = Vec::new();
    progress.stage("meshing", None);
    // A mean over cubes of voxels leaves crumbs where thin walls were.
    let (mesh, grid) = if step > 1 {
        let mesh = without_crumbs(&volume.coarse_mesh(tools)?, info.voxel_size[0])?;
        (mesh, Grid::Volume(volume))
    } else {
        let how = GridReading {
            cubes: Cubes::Edge(info.cube_edge()),
            ..GridReading::default()
        };
        let adopted = volume.solid(&p.file, &how, tools)?;
        notes.extend(adopted.notes);
        let mesh = adopted.solid.to_mesh(tools)?;
        (mesh, Grid::LevelSet(adopted.solid))
    };
    let (unit, factor) = shown_unit(stated.as_deref(), mesh.bounds().size().max());
    let mesh = mesh.mapped(|x| x * factor);
    let edge = factor * info.voxel_size[0];
    if step > 1 {
        notes.push(format!(
            "meshed on voxels of {} {unit}, {step} times those of the file: thinner walls may be missing; \
             --triangles with a larger number shows more",
            figures(edge)
        ));
        if is_large(&p.file) && own == "surface" {
            notes.push(
                "the file has no coarser copies; `lod = 4` in the output that writes it lets it open at once"
                    .into(),
            );
        }
    }
    let grids = values(p, &own, &mut notes)?;
    let mut sampled = |points: &[Vec3]| {
        let points: Vec<WorldPoint> = points.iter().map(|&x| WorldPoint(x / factor)).collect();
        let field = |grid: &Volume| -> Result<Field, Failure> {
            let mut values = grid.samples(&points)?;
            // A grid with thickness in its name holds lengths, which take the unit of the page.
            let is_length = grid.name().contains("thickness");
            if is_length {
                for v in &mut values {
                    *v *= factor as f32;
                }
            }
            Ok(Field {
                name: grid.name().to_owned(),
                unit: if is_length {
                    unit.to_owned()
                } else {
                    String::new()
                },
                at: At::Vertices,
                values,
                labels: None,
            })
        };
        grids
            .iter()
            .map(field)
            .collect::<Result<Vec<Field>, Failure>>()
    };
    let found = mesh.triangles().len();
    let (body, components) = body(&own, &mesh, options(p), unit, &mut sampled, progress)?;
    simplified(found, body.triangles.len(), &mut notes);
    let mut facts = vec![
        ["grid".into(), own.clone()],
        // The edge of the file's own voxels.
        ["voxel".into(), with_unit(edge / f64::from(step), unit)],
    ];
    if step == 1 {
        facts.push(["active voxels".into(), numbers::grouped(info.active_voxels)]);
    }
    if body.is_closed {
        let volume: f64 = components.iter().map(|c| c.volume).sum();
        facts.push(["volume".into(), volume_text(volume, unit)]);
    }
    let scene = Scene {
        kind: "level set",
        unit: unit.to_owned(),
        bodies: vec![body],
        facts,
        notes,
    };
    let sampled = Sampled {
        grid,
        factor,
        bounds: scene.bounds(),
    };
    Ok((scene, Some(sampled)))
}

/// A mesh without components smaller than a voxel, which averages over voxels leave of thin walls.
fn without_crumbs(mesh: &TriMesh, voxel: f64) -> Result<TriMesh, Failure> {
    let (components, component_of) = mesh_components(mesh);
    let is_kept = |t: &&[u32; 3]| {
        let component = &components[component_of[t[0] as usize] as usize];
        component.volume.abs() >= voxel.powi(3)
    };
    let kept = mesh.triangles().iter().filter(is_kept).copied().collect();
    TriMesh::new(mesh.vertices().to_vec(), kept).map_err(|e| Failure::usage(e.to_string()))
}

/// A number with its unit, which may be empty.
pub(super) fn with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", figures(value)).trim_end().to_owned()
}

/// A volume with its cubed unit.
fn volume_text(volume: f64, unit: &str) -> String {
    let cubed = if unit.is_empty() { "" } else { "³" };
    with_unit(volume, &format!("{unit}{cubed}"))
}

/// Adds a note if fewer triangles are kept than were found.
fn simplified(found: usize, kept: usize, notes: &mut Vec<String>) {
    if kept < found {
        notes.push(format!(
            "simplified to {} of {} triangles",
            numbers::grouped(kept as u64),
            numbers::grouped(found as u64)
        ));
    }
}

/// The grids that colour a level set: those of --values, or all grids of floats on cubes beside `own`, the one that is
/// shown. Without --values there are none of a NanoVDB file, nor of a large file, which gets a note.
fn values(p: &Parameters, own: &str, notes: &mut Vec<String>) -> Result<Vec<Volume>, Failure> {
    let reader = crate::cli::vdb::reader()?;
    let names: Vec<String> = match &p.values {
        Some(names) => names.clone(),
        None if is_nano(&p.file) => Vec::new(),
        None => {
            let bytes =
                std::fs::metadata(&p.file).map_err(|e| crate::io::ReadError::io(&p.file, e))?;
            // The names of its grids are known only after all of it is read.
            if bytes.len() > MAX_INSPECTED_BYTES {
                notes.push("the file is large: --values names the grids to colour by".into());
                return Ok(Vec::new());
            }
            let info = crate::cli::vdb::inspect(&p.file)?;
            let floats = info
                .grids
                .iter()
                .filter(|g| g.grid_type.contains("_float_") && g.cubic);
            floats
                .map(|g| g.name.clone())
                .filter(|n| n != own)
                .collect()
        }
    };
    let fetch = |name: &String| -> Result<Volume, Failure> {
        Ok(reader
            .fetch(&p.file, Some(name.as_str()))?
            .require_cubes(&p.file)?)
    };
    names.iter().map(fetch).collect()
}

/// The scene of a mesh file; beams are brought onto voxels and meshed.
fn mesh_scene(
    p: &Parameters,
    tools: vdb::Session,
    progress: &dyn Progress,
) -> Result<Scene, Failure> {
    progress.stage("reading", None);
    let solid = read_solid(&p.file)?;
    let unit = solid
        .file
        .unit
        .map_or_else(String::new, |u| u.symbol().to_owned());
    let mut notes = solid.file.warnings.clone();
    let mesh = if solid.beams.is_empty() {
        solid.file.mesh
    } else {
        let voxel = solid.bounds().size().max() / BEAM_VOXELS;
        notes.push(format!("beams meshed on voxels of {}", figures(voxel)));
        let level_set = pipeline::solid_picture(&p.file, &solid, voxel, BAND_HALF_WIDTH, tools)?;
        level_set.to_mesh(tools)?
    };
    surface_scene(p, &mesh, unit, notes, progress)
}

/// The scene of a mesh of triangles with the unit of its file; `notes` are those of its reader.
fn surface_scene(
    p: &Parameters,
    mesh: &TriMesh,
    unit: String,
    mut notes: Vec<String>,
    progress: &dyn Progress,
) -> Result<Scene, Failure> {
    let mut none = |_: &[Vec3]| Ok::<Vec<Field>, Failure>(Vec::new());
    let (body, components) = body("surface", mesh, options(p), &unit, &mut none, progress)?;
    simplified(mesh.triangles().len(), body.triangles.len(), &mut notes);
    let mut facts = vec![[
        "triangles in the file".into(),
        numbers::grouped(mesh.triangles().len() as u64),
    ]];
    if body.is_closed {
        let volume: f64 = components.iter().map(|c| c.volume).sum();
        facts.push(["volume".into(), volume_text(volume, &unit)]);
    } else {
        notes.push(
            "the surface is not closed: cuts are not filled, wall thickness is not measured".into(),
        );
    }
    Ok(Scene {
        kind: "mesh",
        unit,
        bodies: vec![body],
        facts,
        notes,
    })
}

/// The scene of a file of elements; one of surface elements is a mesh.
fn scaffold(p: &Parameters, progress: &dyn Progress) -> Result<Scene, Failure> {
    progress.stage("reading", None);
    let file = match read_elements(&p.file)? {
        ElementFile::Solids(file) => file,
        ElementFile::Surface(_) => {
            let file = read_mesh(&p.file)?;
            let unit = file
                .unit
                .map_or_else(String::new, |u| u.symbol().to_owned());
            return surface_scene(p, &file.mesh, unit, file.warnings, progress);
        }
    };
    progress.stage("faces", None);
    Ok(scaffold_scene(p, Elements::of(&file), &file.warnings))
}

/// The scene of a scaffold, with `warnings` of its reader and of its check as notes. A scaffold has no unit.
pub(super) fn scaffold_scene(p: &Parameters, own: Elements, warnings: &[String]) -> Scene {
    let report = own.scaffold.report();
    let mut notes = warnings.to_vec();
    notes.extend(report.warnings());
    let (body, is_outer) = elements::body(own, p.triangles);
    if is_outer {
        notes.push(format!(
            "only outer faces: all faces would be more than {} triangles; --triangles with a larger number shows all",
            numbers::grouped(p.triangles as u64)
        ));
    }
    let kinds: Vec<String> = report
        .kinds
        .iter()
        .map(|(k, n)| format!("{n} {}", k.name()))
        .collect();
    let facts = vec![
        ["elements".into(), kinds.join(", ")],
        ["nodes".into(), numbers::grouped(report.nodes as u64)],
        ["volume".into(), figures(report.volume)],
        [
            "quality".into(),
            format!(
                "{} on average, worst {} (element {})",
                figures(report.mean_quality),
                figures(report.worst_quality.0),
                report.worst_quality.1
            ),
        ],
        [
            "inverted, degenerate".into(), // inverted: the Jacobian changes sign
            format!("{}, {}", report.folded.len(), report.degenerate.len()),
        ],
    ];
    Scene {
        kind: "scaffold",
        unit: String::new(),
        bodies: vec![body],
        facts,
        notes,
    }
}

/// The scene of a cell: one element in fine voxels and a block of elements in coarse ones, in reference lengths. A
/// cell of the ball has no block.
fn cell_scene(
    p: &Parameters,
    cell: &Cell,
    tools: vdb::Session,
    progress: &dyn Progress,
) -> Result<Scene, Failure> {
    let failed = |e: pipeline::RunError| match e {
        pipeline::RunError::Cancelled(_) => Failure::stopped(130),
        e => Failure::data(&p.file, e.to_string()),
    };
    let [fine, coarse] = ELEMENT_VOXELS.map(|n| 1.0 / n);
    let one = pipeline::one_element(cell, fine, BAND_HALF_WIDTH, tools).map_err(failed)?;
    let block = pipeline::cell_block(cell, BLOCK_ELEMENTS, coarse, BAND_HALF_WIDTH, tools)
        .map_err(failed)?;
    let solids = [("one element", Some(one)), ("block of 3 x 3 x 3", block)];
    // Both share the triangles of the page.
    let body_options = SurfaceOptions {
        max_triangles: p.triangles / solids.len(),
        ..options(p)
    };
    let (mut bodies, mut notes) = (Vec::new(), Vec::new());
    for (name, solid) in solids {
        let Some(solid) = solid else { continue };
        let mesh = solid.to_mesh(tools)?;
        let mut none = |_: &[Vec3]| Ok::<Vec<Field>, Failure>(Vec::new());
        let (body, _) = body(name, &mesh, body_options, "", &mut none, progress)?;
        simplified(mesh.triangles().len(), body.triangles.len(), &mut notes);
        bodies.push(body);
    }
    let text = crate::cli::cell_text::describe(cell);
    let facts = text
        .lines()
        .take(1)
        .map(|line| ["cell".into(), line.to_owned()])
        .collect();
    Ok(Scene {
        kind: "cell",
        unit: String::new(),
        bodies,
        facts,
        notes,
    })
}
