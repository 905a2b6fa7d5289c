//! `druse preview FILE... -o X.png`: a shaded picture of level sets, meshes, cells and scaffolds. A level set keeps
//! its voxels; the others are brought onto a fixed number along the longest edge first.

use super::context::Session;
use super::failure::Failure;
use super::kind::FileKind;
use super::output::{Answer, require_output};
use crate::cell::Cell;
use crate::frame::Transform;
use crate::io::atomic::write_bytes;
use crate::io::{ElementFile, read_cell, read_elements, read_mesh, read_solid};
use crate::mesh::TriMesh;
use crate::recipe::{Cut, PictureSize};
use crate::sequence::FrameList;
use crate::vdb::{Image, LevelSet, Picture};
use crate::{pipeline, vdb};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args, Clone)]
pub(super) struct Parameters {
    /// A .vdb, mesh, cell or scaffold, or the name of a surface; several files make a contact sheet.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The picture to write (.png).
    #[arg(short, long, value_name = "X.png")]
    output: PathBuf,
    /// Width and height in pixels; captions of a contact sheet are added.
    #[arg(long, value_name = "WxH", default_value = "1000x800")]
    size: PictureSize,
    /// Cut away the part in front of a plane, as in x=0 (unit of the file).
    #[arg(long, value_name = "AXIS=VALUE")]
    cut: Option<Cut>,
    /// Frames, as in 1001-1240, 1-24x2 or 1,5,9-20x2: a picture of each, with a frame token ($F4, $F,
    /// ####, %04d) in the names of files and output.
    #[arg(long, value_name = "FRAMES", value_parser = super::frames::parse, allow_hyphen_values = true)]
    frames: Option<FrameList>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Voxels along the longest edge of a mesh or cell that is voxelized for a picture.
const PREVIEW_RESOLUTION: f64 = 240.0;
/// Half width of the band of such a level set, voxels.
const BAND_HALF_WIDTH: f64 = 3.0;

/// Renders one picture, or one for each frame.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let Some(frames) = &p.frames else {
        return one_picture(p, session);
    };
    super::frames::check_paths(frames, &p.files, [&p.output])?;
    super::frames::each(frames, session, |frame| {
        let at = |path: &PathBuf| super::frames::path_at(path, frame);
        let frame_parameters = Parameters {
            files: p.files.iter().map(at).collect::<Result<_, _>>()?,
            output: at(&p.output)?,
            ..p.clone()
        };
        one_picture(&frame_parameters, session)
    })
}

/// Renders all files into one picture, side by side where there are several.
fn one_picture(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let tools = vdb::Session::new(&threads, session);
    require_output(&p.output, &["png"])?;
    let columns = pipeline::contact_sheet_columns(p.files.len());
    let rows = p.files.len().div_ceil(columns);
    // The requested size is that of the whole sheet; many pictures keep 16 pixels each.
    let size = [
        (p.size.0 as usize / columns).max(16),
        (p.size.1 as usize / rows).max(16),
    ];
    let mut pictures = Vec::new();
    let mut ranges = Vec::new();
    for path in &p.files {
        let (image, range) = picture(p, path, size, session, tools)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        pictures.push((name.into_owned(), image));
        ranges.extend(range);
    }
    let png = match &pictures[..] {
        [(_, alone)] => alone.png()?,
        _ => pipeline::contact_sheet(&pictures).png()?,
    };
    let bytes = write_bytes(&p.output, &png)?;
    let shown = p.output.display().to_string();
    let mut text = format!(
        "{}  {}",
        super::terminal::line(&shown),
        super::numbers::size(bytes)
    );
    let grid = session.color_grid().unwrap_or_default();
    for [low, high] in &ranges {
        let _ = write!(text, "\n{grid}: {low} dark violet to {high} yellow");
    }
    let facts = json!({ "path": shown, "bytes": bytes, "ranges": ranges });
    Ok(Answer::new(text, facts))
}

/// One picture of `width` by `height` pixels, and the least and greatest value of the grid that
/// colours it, if one does.
fn picture(
    p: &Parameters,
    path: &Path,
    [width, height]: [usize; 2],
    session: &Session,
    tools: vdb::Session,
) -> Result<(Image, Option<[f32; 2]>), Failure> {
    let solid = match super::cell_text::surface(path, None)? {
        Some(cell) => cell_picture(path, &cell, tools)?,
        None => solid_of(path, session, tools)?,
    };
    // A cut beside the part would show it whole, without a word.
    if let Some(cut) = p.cut {
        let bounds = solid.bounds()?;
        let (from, to) = (bounds.min[cut.axis], bounds.max[cut.axis]);
        if cut.at < from || cut.at > to {
            let message = format!(
                "the cut at {} misses the part, which spans {from:.6} to {to:.6} there",
                cut.at
            );
            session.warn_of(pipeline::Warning::MISSED_CUT, message)?;
        }
    }
    let view = Picture {
        width,
        height,
        cut: p.cut.map(|c| (c.axis, c.at)),
        ..Picture::default()
    };
    let Some(name) = session.color_grid() else {
        return Ok((solid.render(&view, tools)?, None));
    };
    FileKind::of(path, &[FileKind::Vdb])?;
    let grid = super::vdb::reader()?
        .fetch(path, Some(name))?
        .require_cubes(path)?;
    let (image, range) = solid.render_by(&view, &grid, tools)?;
    Ok((image, Some(range)))
}

/// A picture of a file as PNG, `width` by `height` pixels.
pub(super) fn png(
    path: &Path,
    [width, height]: [usize; 2],
    threads: usize,
    session: &Session,
) -> Result<Vec<u8>, Failure> {
    let threads = super::context::threads(threads)?;
    let tools = vdb::Session::new(&threads, session);
    let solid = solid_of(path, session, tools)?;
    let view = Picture {
        width,
        height,
        ..Picture::default()
    };
    Ok(solid.render(&view, tools)?.png()?)
}

/// The solid of a file, as a level set: read, or made on about `PREVIEW_RESOLUTION` voxels along the longest side, of
/// a cell on fewer. Notes on level sets and meshes are shown.
fn solid_of(path: &Path, session: &Session, tools: vdb::Session) -> Result<LevelSet, Failure> {
    use FileKind::{Mesh, Scaffold, Vdb};
    Ok(
        match FileKind::of(path, &[Vdb, Mesh, FileKind::Cell, Scaffold])? {
            Vdb => {
                let adopted = super::vdb::level_set(path, None, tools)?;
                for note in &adopted.notes {
                    session.note(&format!("{}: {note}", path.display()));
                }
                adopted.solid
            }
            Mesh => {
                let solid = read_solid(path)?;
                for warning in &solid.file.warnings {
                    session.note(&format!("{}: {warning}", path.display()));
                }
                if solid.beams.is_empty() {
                    voxelized(path, &solid.file.mesh, tools)?
                } else {
                    // The voxels follow from the size of the part: the picture shows no finer ones.
                    let voxel = solid.bounds().size().max() / PREVIEW_RESOLUTION;
                    pipeline::solid_picture(path, &solid, voxel, BAND_HALF_WIDTH, tools)?
                }
            }
            Scaffold => {
                let ElementFile::Solids(file) = read_elements(path)? else {
                    return voxelized(path, &mesh(path, session)?, tools);
                };
                let scaffold = file.scaffold;
                // Curved faces are cut into triangles with an error that the picture does not show.
                let (_, stretch) = scaffold.stretch();
                let mut shell = TriMesh::default();
                for component in 0..scaffold.components().len() {
                    let part = scaffold
                        .boundary(component, stretch / PREVIEW_RESOLUTION)
                        .mesh;
                    shell
                        .append(&part)
                        .map_err(|e| Failure::data(path, e.to_string()))?;
                }
                voxelized(path, &shell, tools)?
            }
            _ => cell_picture(path, &read_cell(path)?, tools)?,
        },
    )
}

/// A mesh; notes about its file are shown.
fn mesh(path: &Path, session: &Session) -> Result<TriMesh, Failure> {
    let file = read_mesh(path)?;
    for warning in file.warnings {
        session.note(&format!("{}: {warning}", path.display()));
    }
    Ok(file.mesh)
}

/// The level set of a mesh for a picture; an empty mesh is an error.
fn voxelized(path: &Path, mesh: &TriMesh, tools: vdb::Session) -> Result<LevelSet, Failure> {
    let size = mesh.bounds().size().max();
    let transform = Transform::new(size / PREVIEW_RESOLUTION)
        .filter(|_| !mesh.is_empty())
        .ok_or_else(|| Failure::data(path, "found no extent; expected a surface"))?;
    Ok(LevelSet::from_mesh(
        mesh,
        transform,
        BAND_HALF_WIDTH,
        tools,
    )?)
}

/// One element of a cell, on voxels one and a half times as large as those of meshes: `path` is for errors.
fn cell_picture(path: &Path, cell: &Cell, tools: vdb::Session) -> Result<LevelSet, Failure> {
    pipeline::one_element(cell, 1.0 / PREVIEW_RESOLUTION * 1.5, BAND_HALF_WIDTH, tools)
        .map_err(|e| Failure::data(path, e.to_string()))
}
