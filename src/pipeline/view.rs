//! Geometry for interactive views: few triangles, wall thickness at their vertices, blocks of cells, boxes of
//! solids. Views trade accuracy for time: nothing here is reported as a measure of a part.

use super::base::context::StageContext;
use super::base::error::RunError;
use super::base::shape::Shape;
use super::content::inputs::Inputs;
use super::field::field_ops::extent_bound;
use super::field::offsets::predicted_offsets;
use super::inputs::input_files::InputFiles;
use super::inputs::run_options::{RunOptions, threads};
use super::inputs::scaffold;
use super::measure::least_wall::{Phase, TouchingBall, balls};
use super::outputs::decimate::triangles_to_count;
use crate::cell::{Cell, Table};
use crate::frame::{Aabb, Element, LengthUnit, Vec3};
use crate::io::Group;
use crate::mesh::TriMesh;
use crate::progress::{Progress, Silent};
use crate::recipe::{Recipe, Scale};
use crate::scaffold::{Kind, Scaffold};
use crate::tiling::{Boundary, Distance, TiledSolid, TilingOptions};
use crate::vdb::{LevelSet, Session};
use std::sync::Arc;

/// Diameter of the thickest wall that is measured, over the longest side of the part: of a small mesh, and of a large
/// one. Balls in thicker walls touch much of the part, which takes long.
const MAX_WALL_SHARES: [f64; 2] = [0.5, 0.25];
/// Vertices of the largest mesh that counts as small.
const MAX_SMALL_VERTICES: usize = 100_000;

/// At most about `max_triangles` triangles over the vertices of a mesh, as three vertex numbers each; all of them
/// if there are fewer.
///
/// # Errors
/// Only errors of the decimation.
pub fn few_triangles(mesh: &TriMesh, max_triangles: usize) -> Result<Vec<[u32; 3]>, RunError> {
    if mesh.triangles().len() <= max_triangles {
        return Ok(mesh.triangles().to_vec());
    }
    triangles_to_count(mesh, max_triangles)
}

/// The wall thickness of a closed mesh, in its unit, at the vertices `samples`: not a number where no ball is
/// inscribed, up to a share of the longest side.
///
/// # Errors
/// Cancellation.
pub fn wall_thickness(
    mesh: &TriMesh,
    samples: &[u32],
    progress: &dyn Progress,
) -> Result<Vec<f32>, RunError> {
    let is_large = mesh.vertices().len() > MAX_SMALL_VERTICES;
    let thickest = MAX_WALL_SHARES[usize::from(is_large)] * mesh.bounds().size().max();
    let found = balls(mesh, samples, thickest / 2.0, Phase::Solid, progress)?;
    let value = |ball: TouchingBall| match ball {
        TouchingBall::Inscribed(wall) => wall.thickness as f32,
        TouchingBall::Wider | TouchingBall::Pierced => f32::NAN,
    };
    Ok(found.into_iter().map(value).collect())
}

/// A box around the solid of a recipe, in its unit; `None` where it begins with a file's level set, or is empty.
///
/// # Errors
/// As [`run`](super::run) while it reads the inputs.
pub fn solid_extent(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Option<Aabb>, RunError> {
    let threads = threads(options)?;
    let inputs = Inputs::load(recipe, &threads, options, progress)?;
    if inputs.volumes.start().is_some() {
        return Ok(None);
    }
    extent_bound(&inputs, recipe.scale(), predicted_offsets(&inputs))
}

/// A scaffold and its named sets of elements.
type ScaffoldAndGroups = (Arc<Scaffold>, Vec<Group>);

/// The scaffold of a recipe and its named sets of elements; `None` without one.
///
/// # Errors
/// As [`run`](super::run) while it reads the scaffold.
pub fn scaffold_of(
    recipe: &Recipe,
    options: &RunOptions,
) -> Result<Option<ScaffoldAndGroups>, RunError> {
    let Some(section) = &recipe.sections().scaffold else {
        return Ok(None);
    };
    let mut files = InputFiles::new(recipe, options);
    let loaded = threads(options)?.install(|| scaffold::load(&mut files, section, &Silent))?;
    Ok(Some((loaded.scaffold, loaded.groups)))
}

/// A cell in `count` elements along each axis of a box, as a level set; `None` for a cell of the ball, which tiles
/// no box. The box has `count` unit cubes along each axis, each one hex, six tets, six pyramids or two wedges; planar
/// cells fill prisms. `voxel_size` is in reference lengths, `half_width` in voxels.
///
/// # Errors
/// A cell without a surface; an error of the band or of OpenVDB.
pub fn cell_block(
    cell: &Cell,
    count: usize,
    voxel_size: f64,
    half_width: f64,
    session: Session,
) -> Result<Option<LevelSet>, RunError> {
    let kind = match cell.element() {
        Element::Tet => Kind::Tet4,
        Element::Tri | Element::Wedge => Kind::Wedge6,
        Element::Pyramid => Kind::Pyramid5,
        Element::Quad | Element::Hex => Kind::Hex8,
        Element::Ball => return Ok(None),
    };
    let failed = |e: String| RunError::Tiling(e);
    let size = Vec3::repeat(count as f64);
    let scaffold = Scaffold::box_grid(size, [count; 3], kind).map_err(|e| failed(e.to_string()))?;
    let table = Table::new(cell).map_err(|e| failed(e.to_string()))?;
    let options = TilingOptions {
        voxel_size,
        half_width: half_width * voxel_size,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    };
    let solid = TiledSolid::new(&scaffold, &table, options).map_err(|e| failed(e.to_string()))?;
    let shape = Shape {
        extent: scaffold.bounds(),
        field: Box::new(solid),
        name: "the block".into(),
    };
    let scale = Scale {
        unit: LengthUnit::default(),
        voxel_size,
    };
    let context = StageContext::of_solid(session, scale, half_width);
    Ok(Some(context.sample(&shape, "band")?.0))
}
