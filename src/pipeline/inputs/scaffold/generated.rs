//! Scaffolds that are made: boxes, and fillings of meshes by cubes. Lengths are resolved to the recipe's unit
//! here.

use super::moved;
use crate::frame::{Aabb, Vec3};
use crate::mesh::MeshSolid;
use crate::recipe::{BoxKind, BoxScaffold, FillScaffold, Scale};
use crate::scaffold::{Connectivity, Kind, Scaffold, ScaffoldError};

/// Greatest number of hexes that fill a mesh.
const MAX_HEXES: f64 = 2e7;

/// A structured box of a whole number of cells, as close to the requested cell size as possible.
pub(super) fn box_scaffold(block: &BoxScaffold, scale: Scale) -> Result<Scaffold, ScaffoldError> {
    let size = Vec3::from(block.size.map(|s| s.resolve(scale)));
    let cell = block.cell_size.resolve(scale);
    let counts = [size.x, size.y, size.z].map(|s| (s / cell).round().max(1.0) as usize);
    let origin = Vec3::from(block.origin.map(|o| o.resolve(scale)));
    let kind = match block.kind {
        BoxKind::Hex => Kind::Hex8,
        BoxKind::Tet => Kind::Tet4,
        BoxKind::Wedge => Kind::Wedge6,
    };
    let scaffold = Scaffold::box_grid(size, counts, kind)?;
    if origin == Vec3::zeros() {
        return Ok(scaffold);
    }
    moved(&scaffold, |v| v + origin)
}

/// The cubes of a grid that meet a solid; a few beside it are kept as well, since the ball around a cube decides.
/// Too many cubes are an error.
pub(super) fn filling_cubes(
    solid: &MeshSolid,
    fill: &FillScaffold,
    scale: Scale,
) -> Result<Scaffold, ScaffoldError> {
    let cell = fill.cell_size.resolve(scale);
    let bounds = solid.bounds();
    let counts = bounds.size().map(|s| (s / cell).ceil().max(1.0));
    let found = counts.product();
    if !found.is_finite() || found > MAX_HEXES {
        return Err(ScaffoldError::TooMany {
            found: found.min(1e18) as usize,
            limit: MAX_HEXES as usize,
            what: "elements",
        });
    }
    // The grid is centred on the solid.
    let origin = bounds.centre().0 - counts * (cell / 2.0);
    let counts = [counts.x, counts.y, counts.z].map(|c| c as usize);
    let grid = Scaffold::box_grid(
        Vec3::from(counts.map(|c| c as f64 * cell)),
        counts,
        Kind::Hex8,
    )?;
    let mut elements = Connectivity::default();
    for e in 0..grid.len() {
        let own = grid.connectivity().nodes(e);
        let at = Aabb::of(own.iter().map(|&n| grid.nodes()[n as usize] + origin));
        // A cube is kept if the ball around it reaches the solid: d <= half diagonal, with d negative inside.
        let d = solid.signed_distance(at.centre().0);
        if d <= at.half_diagonal() {
            elements.push(Kind::Hex8, own);
        }
    }
    let nodes: Vec<Vec3> = grid.nodes().iter().map(|v| v + origin).collect();
    without_unused_nodes(&nodes, &elements)
}

/// A scaffold without unused nodes.
fn without_unused_nodes(
    nodes: &[Vec3],
    elements: &Connectivity,
) -> Result<Scaffold, ScaffoldError> {
    let mut new_number = vec![u32::MAX; nodes.len()];
    let mut kept = Vec::new();
    let mut renumbered = Connectivity::default();
    for e in 0..elements.len() {
        let own: Vec<u32> = elements
            .nodes(e)
            .iter()
            .map(|&n| {
                if new_number[n as usize] == u32::MAX {
                    new_number[n as usize] = kept.len() as u32;
                    kept.push(nodes[n as usize]);
                }
                new_number[n as usize]
            })
            .collect();
        renumbered.push(elements.kind(e), &own);
    }
    Scaffold::new(kept, renumbered)
}
