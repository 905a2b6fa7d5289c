//! Finite-element decks of the scaffold's elements, with the effective stiffness of the cell in each.
//!
//! A law is a homogenised cell: its stiffness and volume fraction over the graded quantity (its parameter).
//! `effective` makes the laws; this file divides elements into classes and writes.
//! Elements of similar thickness, fraction or level share a material. Operations on the solid after the tiling
//! are not part of the deck.

use super::deck::POISSON;
use super::output::file_entry;
use super::output_targets::Targets;
use crate::frame::{Element, figures};
use crate::homogenize::Isotropic;
use crate::io::{DeckClass, ElementDeck, write_element_deck};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::deck_facts::{MacroDeckFacts, MacroLawFacts};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::{BandReport, OutputFile, SolidReport, StageResults};
use crate::pipeline::base::stage_timer::StageTimer;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::GradedQuantity;
use crate::pipeline::effective::{EffectiveElements, Law, LawSettings, packing_name};
use crate::pipeline::homogenize::period_fault;
use crate::recipe::{Output, Recipe};
use std::path::Path;

/// Voxels along the period, unless the output sets another number.
pub(crate) const RESOLUTION: u32 = 32;
/// Greatest number of materials of a cell; each covers an equal part, 3 %, of the range of its parameter.
const MAX_CLASSES: usize = 32;

/// Warnings about a written deck.
pub(crate) fn warnings(file: &OutputFile) -> Vec<String> {
    let facts = file.macro_deck.iter();
    facts
        .flat_map(|f| f.notes.iter().map(|n| format!("{}: {n}", file.path)))
        .collect()
}

/// The solid's material of an output; Young's modulus is 1 and Poisson's ratio `POISSON` where it names none, or
/// without an output.
pub(crate) fn solid_material(output: Option<&Output>) -> Result<Isotropic, RunError> {
    let young = output.and_then(|o| o.young).map_or(1.0, |y| y.0);
    let poisson = output.and_then(|o| o.poisson).map_or(POISSON, |p| p.0);
    Isotropic::new(young, poisson).map_err(|e| period_fault("output", e))
}

/// Writes all decks of a recipe whose outputs need no voxels.
pub(crate) fn write_all(
    context: StageContext,
    inputs: &Inputs,
    outputs: &Targets,
    timer: &mut StageTimer,
) -> Result<StageResults, RunError> {
    let mut written = Vec::new();
    for (output, path) in &outputs.files {
        written.push(write(context, inputs, output, path)?);
        timer.end_stage("write")?;
    }
    Ok(StageResults {
        outputs: written,
        band: BandReport {
            voxel_size: context.scale.voxel_size,
            half_width: context.half_width,
            ..BandReport::default()
        },
        solid: SolidReport::default(),
        bricks: None,
    })
}

/// Writes the deck of an output to `path` and returns its entry in the report.
pub(crate) fn write(
    context: StageContext,
    inputs: &Inputs,
    output: &Output,
    path: &Path,
) -> Result<OutputFile, RunError> {
    let made = context
        .threads
        .install(|| make(context, inputs, output, path))?;
    Ok(OutputFile {
        macro_deck: Some(made),
        ..file_entry(path, Some(output.unit_or_default(inputs.recipe.unit())))?
    })
}

/// Writes the deck of the scaffold's elements and returns its facts. Lengths are converted to the
/// output's unit.
fn make(
    context: StageContext,
    inputs: &Inputs,
    output: &Output,
    path: &Path,
) -> Result<MacroDeckFacts, RunError> {
    let recipe = inputs.recipe;
    let unit = output.unit_or_default(recipe.unit());
    let factor = recipe.unit().to(unit);
    let settings = LawSettings {
        solid: solid_material(Some(output))?,
        resolution: output.resolution.unwrap_or(RESOLUTION) as usize,
        stiffness: true,
    };
    let elements = EffectiveElements::of(inputs)?;
    let laws = elements.laws(inputs, settings, context.session())?;
    let density = output.density.map(|d| d.0);
    let mut classes = Vec::new();
    let mut class_of = vec![0u32; elements.cell_of.len()];
    let mut facts = MacroDeckFacts::default();
    for (c, law) in laws.iter().enumerate() {
        let cell_classes = material_classes(&elements, c);
        for (n, (parameter, members)) in cell_classes.iter().enumerate() {
            for &e in members {
                class_of[e] = classes.len() as u32;
            }
            let fraction = law.fraction(*parameter);
            classes.push(DeckClass {
                name: format!("{}_{}_{}", law.cell, elements.cells[c].shape.name(), n + 1),
                stiffness: law.stiffness(*parameter),
                density: density.map(|d| d * fraction),
                note: note(&elements, law, c, *parameter),
            });
        }
        facts
            .laws
            .push(law_facts(&elements, law, c, cell_classes.len()));
    }
    // The volume of solid follows from the parameter of each element, not from that of its class.
    for (e, volume) in elements.volumes.iter().enumerate() {
        let fraction = laws[elements.cell_of[e]].fraction(elements.parameters[e]);
        facts.volume += volume * factor.powi(3);
        facts.solid_volume += volume * factor.powi(3) * fraction;
    }
    facts.mass = density.map(|d| d * facts.solid_volume);
    let (stretch, stretched) = elements.stretched();
    facts.stretch = stretch;
    facts.notes = notes(inputs, &elements, &laws, stretch, stretched);
    let rotations = elements.rotations();
    let loaded = &elements.tiling.loaded;
    let deck = ElementDeck {
        scaffold: &loaded.scaffold,
        factor,
        classes: &classes,
        class_of: &class_of,
        frames: &rotations,
        groups: &loaded.groups,
    };
    let name = recipe.source().path.as_deref().and_then(Path::file_name);
    let name = name.map_or_else(|| "a recipe".into(), |n| n.to_string_lossy());
    let heading = [
        format!("Druse: elements of the scaffold of {name} with homogenised cells"),
        format!("lengths in {unit}, moduli in force per {unit}^2; no loads, no steps"),
    ];
    let written = write_element_deck(path, deck, &heading)?;
    facts.nodes = written.nodes;
    facts.elements = written.elements;
    Ok(facts)
}

/// The elements of a cell in classes of similar parameters: the mean parameter by volume, and the elements.
fn material_classes(elements: &EffectiveElements, cell: usize) -> Vec<(f64, Vec<usize>)> {
    let [low, high] = elements.range(cell);
    let count = if elements.table(cell).len() > 1 {
        MAX_CLASSES
    } else {
        1
    };
    let mut bins: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (e, p) in elements.parameters.iter().enumerate() {
        if elements.cell_of[e] == cell {
            let class_position = (p - low) / (high - low).max(f64::MIN_POSITIVE) * count as f64;
            bins[(class_position as usize).min(count - 1)].push(e);
        }
    }
    bins.retain(|b| !b.is_empty());
    let mean = |bin: &Vec<usize>| {
        let volume: f64 = bin.iter().map(|&e| elements.volumes[e]).sum();
        let sum = bin
            .iter()
            .map(|&e| elements.volumes[e] * elements.parameters[e]);
        sum.sum::<f64>() / volume
    };
    bins.into_iter().map(|b| (mean(&b), b)).collect()
}

/// The word of a graded quantity in the report.
fn quantity_word(quantity: Option<GradedQuantity>) -> &'static str {
    match quantity {
        Some(GradedQuantity::Thickness) => "thickness",
        Some(GradedQuantity::VolumeFraction) => "volume_fraction",
        Some(GradedQuantity::Level) => "level",
        None => "none",
    }
}

/// The comment on the material of a class, in the deck: the cell, its period, its volume fraction, and a thickness or
/// level that is graded.
fn note(elements: &EffectiveElements, law: &Law, cell: usize, parameter: f64) -> String {
    let quantity = match elements.cells[cell].quantity {
        Some(GradedQuantity::Thickness) => {
            format!(", thickness {} element sizes", figures(parameter))
        }
        Some(GradedQuantity::Level) => format!(", level {}", figures(parameter)),
        _ => String::new(),
    };
    format!(
        "cell {}, {}, volume fraction {:.5}{quantity}",
        law.cell,
        law.period,
        law.fraction(parameter)
    )
}

/// The report's entry for the law of cell `c`, which is in `materials` classes.
fn law_facts(elements: &EffectiveElements, law: &Law, c: usize, materials: usize) -> MacroLawFacts {
    let cell = &elements.cells[c];
    MacroLawFacts {
        cell: law.cell.clone(),
        element: cell.shape.name(),
        period: law.period.clone(),
        quantity: quantity_word(cell.quantity),
        range: elements.range(c),
        volume_fraction: law.fractions(),
        aspect: cell.aspect,
        points: law.len(),
        materials,
    }
}

/// Sentences on what a deck does not represent. `stretch` is the greatest stretch of an element and
/// `stretched` the number of elements above 1.25.
fn notes(
    inputs: &Inputs,
    elements: &EffectiveElements,
    laws: &[Law],
    stretch: f64,
    stretched: usize,
) -> Vec<String> {
    let mut all: Vec<String> = laws.iter().flat_map(|l| l.notes.clone()).collect();
    let count = elements.cell_of.len();
    if elements.blended > 0 {
        all.push(format!(
            "{} of {count} elements are blends of cells; each has the law of the cell with the greatest weight at \
             its centre",
            elements.blended
        ));
    }
    if stretched > 0 {
        // Tets are compared with those of the packing, which are not regular themselves.
        let tets = elements.cells.iter().find(|c| c.shape == Element::Tet);
        let beside = tets.map_or_else(
            || "the mean element".to_owned(),
            |c| format!("the tets of the packing {}", packing_name(c)),
        );
        all.push(format!(
            "{stretched} of {count} elements are stretched by more than 1.25 beside {beside}, the most by {stretch:.2}; \
             their cells are homogenised without that stretch"
        ));
    }
    if elements.tiling.loaded.envelope.is_some() {
        all.push(
            "the mesh that the scaffold fills cuts elements, which the deck holds whole; kind = \"tet\" in [scaffold] \
             fill gives elements that follow it"
                .to_owned(),
        );
    }
    if let Some(op) = inputs.recipe.sections().op.first() {
        all.push(format!(
            "op.0.{} and later operations are not part of a deck of the scaffold's elements; kind = \"hex8\" gives a \
             deck of the finished solid",
            op.name()
        ));
    }
    all
}

/// Whether all files of a recipe are decks of the scaffold's elements, and nothing needs the solid.
pub(crate) fn needs_no_voxels(recipe: &Recipe) -> bool {
    let sections = recipe.sections();
    let mut files = sections
        .output
        .iter()
        // A report is written in any case.
        .filter(|o| o.report.is_none())
        .peekable();
    files.peek().is_some()
        && files.all(Output::is_macro_deck)
        && sections.require.is_none()
        && sections.build.is_none()
}
