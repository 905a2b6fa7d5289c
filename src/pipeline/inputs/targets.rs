//! Designs of cells with a `target` in `[cell.NAME]`, and the cells made from them. A target is an effective
//! property of the homogenised cell, as its bulk modulus; a search varies the cell's coefficients. Moduli are
//! relative to the solid's Young modulus, lengths are reference lengths.

use super::source::{SourceFault, has_extension};
use crate::cell::{Cell, Solid};
use crate::frame::Element;
use crate::inverse::{Design, InverseError, Property, StartChoice, Target};
use crate::pipeline::base::error::CellFault;
use crate::progress::Cancelled;
use crate::recipe;
use crate::recipe::{CellSection, TargetProperty, TargetTable};
use crate::vdb::Session;
use std::path::{Path, PathBuf};

/// Weight of a stiffness where the target names none.
const STIFFNESS_WEIGHT: f64 = 10.0;

/// Voxels along the period of a sheet, whose walls are thinner than those of a network.
const SHEET_VOXELS: usize = 32;

/// Makes a path in a section one that can be opened.
type Resolve<'a> = &'a dyn Fn(&Path) -> PathBuf;

/// The property of a word of the recipe.
fn property(word: TargetProperty) -> Property {
    match word {
        TargetProperty::Bulk => Property::Bulk,
        TargetProperty::Shear => Property::Shear,
        TargetProperty::Young => Property::Young,
        TargetProperty::Conductivity => Property::Conductivity,
        TargetProperty::Permeability => Property::Permeability,
    }
}

/// The target of a table of the recipe. A stiffness without a weight has `STIFFNESS_WEIGHT`.
fn target(table: &TargetTable) -> Result<Target, CellFault> {
    if table.weight.is_some() && table.stiffness.is_none() {
        return Err(CellFault::Rule(
            "found weight without stiffness in target; expected both".to_owned(),
        ));
    }
    let stiffness = table.stiffness.map(|rows| {
        let weight = table.weight.map_or(STIFFNESS_WEIGHT, |w| w.0);
        (rows.map(|row| row.map(|v| v.0)), weight)
    });
    Ok(Target {
        maximise: table.maximise.map(property),
        zener: table.zener.map(|z| z.0),
        poisson: table.poisson.map(|nu| nu.0),
        stiffness,
        min_opening: table.min_opening.map(|r| r.0),
        min_permeability: table.min_permeability.map(|k| k.0),
        max_permeability: table.max_permeability.map(|k| k.0),
    })
}

/// The design that a section with a target describes; `matched` are the cells whose trace on the faces the design keeps.
///
/// # Errors
/// [`CellFault`]: keys that exclude or need each other; a start that cannot be read.
pub fn design(
    name: &str,
    section: &CellSection,
    element: Element,
    matched: Vec<Cell>,
    resolve: &dyn Fn(&Path) -> PathBuf,
) -> Result<Design, CellFault> {
    let rule = |message: String| CellFault::Rule(message);
    if let Some((_, reason)) = section.target_fault() {
        return Err(rule(reason));
    }
    let table = section.target.clone().unwrap_or_default().0;
    let fraction = section.volume_fraction.ok_or_else(|| {
        rule(
            "found target without volume_fraction; expected the share of solid beside it"
                .to_owned(),
        )
    })?;
    let mut design = Design::new(name, element, target(&table)?, fraction.0);
    design.solid = match section.solid.unwrap_or_default() {
        recipe::Solid::Below => Solid::Below,
        recipe::Solid::Above => Solid::Above,
        recipe::Solid::Sheet => Solid::Sheet,
    };
    design.group.clone_from(&section.group);
    design.lattice.clone_from(&section.lattice);
    design.face_normal = section.face_normal.unwrap_or(false);
    design.min_feature = section.min_feature.map(|d| d.0);
    design.matched = matched;
    // Keys that are left out keep the defaults of the design.
    if let Some(band) = section.band_limit {
        design.band_limit = band.0;
    }
    if let Some(nu) = table.solid_poisson {
        design.solid_poisson = nu.0;
    }
    if let Some(n) = table.starts {
        design.starts = n as usize;
    }
    if let Some(n) = table.evaluations {
        design.evaluations = n as usize;
    }
    // At least four voxels for the shortest wave, and an even number; 1e4 bounds the cast.
    let for_waves = (4.0 * design.band_limit / 2.0).ceil().min(1e4) as usize * 2;
    design.voxels = match (table.voxels, design.solid) {
        (Some(n), _) => n as usize,
        (None, Solid::Sheet) => for_waves.max(SHEET_VOXELS),
        (None, _) => for_waves.max(design.voxels),
    };
    design.seed = section.seed.unwrap_or(0);
    design.start = match &section.start {
        Some(word) if has_extension(Path::new(word), &["cell"]) => {
            let cell = crate::io::read_cell(resolve(Path::new(word)));
            let cell = cell.map_err(|e| rule(format!("start: {e}")))?;
            StartChoice::Cell(Box::new(cell))
        }
        Some(word) => StartChoice::Surface(word.clone()),
        None if section.seed.is_some() => StartChoice::Random,
        None => StartChoice::Several,
    };
    Ok(design)
}

/// Makes the cell of a section with a target by a search, which may take minutes. A search that the user stops is
/// a cancellation.
pub(crate) fn make(
    name: &str,
    section: &CellSection,
    element: Element,
    matched: Vec<Cell>,
    resolve: Resolve,
    session: Session,
) -> Result<Cell, SourceFault> {
    let design = design(name, section, element, matched, resolve)?;
    let prepared = design.prepare().map_err(CellFault::from)?;
    let made = session
        .threads
        .install(|| prepared.search(None, session.progress));
    let made = made.map_err(|e: InverseError| CellFault::from(e))?;
    if made.is_stopped {
        return Err(SourceFault::Run(Cancelled.into()));
    }
    Ok(made.cell)
}
