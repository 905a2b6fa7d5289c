//! Finite-element decks of the finished solid: cubes of its voxels as elements, in the output's unit. A cube of
//! some voxels along each edge becomes an element if its share of solid is great enough; loads and steps are left
//! to the user.

use super::output::file_entry;
use crate::frame::{LengthUnit, Vec3, figures};
use crate::io::{DeckMaterial, VoxelMesh, write_voxel_deck};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::deck_facts::DeckFacts;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::OutputFile;
use crate::pipeline::content::inputs::Inputs;
use crate::recipe::{Output, Recipe};
use crate::vdb::{LevelSet, SolidCubes, largest_face_component};
use std::path::Path;

/// Least share of solid in an element, unless the output sets another.
const SOLID_SHARE: f64 = 0.5;
/// Poisson's ratio, unless the output sets another; Young's modulus is 1.
pub(crate) const POISSON: f64 = 0.3;

/// No cubes yet, of the output's element size on the voxels of `context`.
pub(crate) fn cubes(
    context: StageContext,
    recipe: &Recipe,
    output: &Output,
) -> Result<SolidCubes, RunError> {
    let edge = output.element_voxels(context.scale).map_err(|message| {
        let outputs = &recipe.sections().output;
        let number = outputs.iter().position(|o| std::ptr::eq(o, output));
        let key = format!("output.{}.element_size", number.unwrap_or(0));
        recipe.source().fault(&key, message)
    })?;
    Ok(SolidCubes::new(edge))
}

/// Writes the deck of a solid in memory.
pub(crate) fn write(
    context: StageContext,
    inputs: &Inputs,
    solid: &LevelSet,
    output: &Output,
    path: &Path,
) -> Result<OutputFile, RunError> {
    let mut all = cubes(context, inputs.recipe, output)?;
    all.add(solid, None, context.session())
        .map_err(RunError::level_set("fe"))?;
    write_cubes(context, inputs.recipe, solid.origin(), &all, output, path)
}

/// Writes the deck of cubes. `recipe` names the part, `origin` is the position of voxel (0, 0, 0) in the recipe's
/// unit. Only the largest set of cubes that are joined by faces is written; the report counts the others.
pub(crate) fn write_cubes(
    context: StageContext,
    recipe: &Recipe,
    origin: Vec3,
    cubes: &SolidCubes,
    output: &Output,
    path: &Path,
) -> Result<OutputFile, RunError> {
    let unit = output.unit_or_default(recipe.unit());
    let factor = recipe.unit().to(unit);
    let share = output.solid_share.map_or(SOLID_SHARE, |s| s.0);
    let solid = cubes.at_least(share);
    // Loose cubes would make the stiffness matrix singular.
    let (kept, components) = largest_face_component(&solid);
    if kept.is_empty() {
        let message =
            format!("no element has a share of solid of {share}; give a smaller element_size");
        return Err(recipe.source().fault("output", message).into());
    }
    let voxel = context.scale.voxel_size * factor;
    let edge = f64::from(cubes.edge()) * voxel;
    let mesh = VoxelMesh {
        cubes: &kept,
        origin: origin * factor,
        edge,
    };
    let material = DeckMaterial {
        young: output.young.map_or(1.0, |y| y.0),
        poisson: output.poisson.map_or(POISSON, |p| p.0),
        density: output.density.map(|d| d.0),
    };
    let written = write_voxel_deck(path, mesh, &heading(recipe, edge, unit), material)?;
    Ok(OutputFile {
        deck: Some(DeckFacts {
            nodes: written.nodes,
            elements: written.elements,
            element_size: edge,
            volume: written.elements as f64 * edge.powi(3),
            dropped_elements: (solid.len() - kept.len()) as u64,
            dropped_components: components as u64 - 1,
        }),
        ..file_entry(path, Some(unit))?
    })
}

/// The lines under `*HEADING`.
fn heading(recipe: &Recipe, edge: f64, unit: LengthUnit) -> Vec<String> {
    let name = recipe.source().path.as_deref().and_then(Path::file_name);
    let name = name.map_or_else(
        || "a recipe".to_owned(),
        |n| n.to_string_lossy().into_owned(),
    );
    vec![
        format!("Druse: cubes of {} {unit}, made from {name}", figures(edge)),
        format!("lengths in {unit}, Young's modulus in force per {unit}^2; no loads, no steps"),
    ]
}

/// The warning about elements that a deck leaves out; `None` for other files and complete decks.
pub(crate) fn dropped(file: &OutputFile) -> Option<String> {
    let deck = file.deck.as_ref().filter(|d| d.dropped_elements > 0)?;
    Some(format!(
        "{}: {} elements in {} components share no face with the largest one and are left out; smaller \
         elements may connect them",
        file.path, deck.dropped_elements, deck.dropped_components
    ))
}
