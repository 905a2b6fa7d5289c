//! The palette of a tiling: every cell for every shape of element that it has to fill.
//!
//! Cells are made for each shape by itself. Where they do not meet on faces that different shapes
//! share (or wedges and pyramids among themselves) they are fitted again, all together, so that they
//! do.

use super::cells;
use super::error::{RunError, short};
use super::fractions;
use super::input_files::Inputs;
use super::report::Warning;
use super::source::SourceFault;
use crate::cell::{Cell, Density, Solid, Table, fit_matched};
use crate::field::Field;
use crate::frame::Element;
use crate::recipe::{CellSection, Recipe, TilingSection};
use crate::scaffold::Scaffold;
use crate::tiling::{Blend, Filling, Interpolation, Member, TilingError, Ways};
use crate::vdb::Session;

/// How closely cells are looked at.
#[derive(Clone, Copy)]
pub(super) struct Fineness {
    /// Edge of a voxel in reference lengths, where elements are largest in voxels.
    voxel: f64,
    /// How far tables may displace the surface, voxels.
    tolerance: f64,
}

impl Fineness {
    /// That of a recipe over a scaffold.
    pub fn new(recipe: &Recipe, tiling: &TilingSection, scaffold: &Scaffold) -> Self {
        Self {
            voxel: recipe.scale().voxel_size / scaffold.stretch().1,
            tolerance: tiling.tolerance.0,
        }
    }

    /// What a report says of a table.
    pub fn facts(&self, table: &Table) -> serde_json::Value {
        let voxels = |length: f64| length / self.voxel;
        let slope = table.gradient_rms();
        serde_json::json!({
            "element": table.element().name(),
            "kernel": if table.is_direct() { "products" } else { "spline" },
            "samples": table.samples(),
            "bytes": table.bytes(),
            "dropped_waves": table.dropped(),
            "tolerance_voxels": self.tolerance,
            "error_voxels": {
                "rms": voxels(table.error_rms() / slope),
                "most": table.displacement().map(voxels),
                "bound": voxels(table.error_bound() / slope),
            },
        })
    }
}

/// Root mean square in edge lengths from which a matched cell is no longer the one asked for.
const FAR: f64 = 0.05;
/// Greatest error in edge lengths of the tables of matched cells.
const FINE: f64 = 2e-5;

/// Greatest jump of tables across shared faces, as a share of the range of the values there.
const LARGEST_JUMP: f64 = 8e-6;
/// Tables that are tried to reach it.
const REFINEMENTS: usize = 4;

/// One cell of the palette, for each shape of element.
pub(super) struct Entry {
    pub name: String,
    pub cells: Vec<Cell>,
    pub tables: Vec<Table>,
    /// How elements that are not affine stretch each cell.
    pub densities: Vec<Option<Density>>,
}

impl Entry {
    /// A name without cells: its struts are made as beams.
    pub fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            cells: Vec::new(),
            tables: Vec::new(),
            densities: Vec::new(),
        }
    }
}

/// The cells of a name for every shape that occurs; of a metric sheet the side of its mid-surface.
pub(super) fn entry(
    inputs: &mut Inputs,
    scaffold: &Scaffold,
    (name, fineness, is_sheet): (&str, Fineness, bool),
    session: Session,
) -> Result<Entry, RunError> {
    let key = format!("cell.{name}");
    let section = &inputs.recipe.sections().cell[name];
    let mid_surface = CellSection {
        solid: None,
        thickness: None,
        invert: None,
        ..section.clone()
    };
    let section = if is_sheet { &mid_surface } else { section };
    let shapes = scaffold.shapes();
    let asked = section.element.map(Element::from);
    let mut entry = Entry {
        name: name.to_owned(),
        cells: Vec::new(),
        tables: Vec::new(),
        densities: Vec::new(),
    };
    for &shape in &shapes {
        // A planar cell fills the prisms over its element.
        let element = asked
            .filter(|&a| crate::tiling::fills(a, shape))
            .unwrap_or(shape);
        if shapes.len() > 1 && asked.is_some_and(|a| !crate::tiling::fills(a, shape)) {
            continue;
        }
        let mut cell = cells::make(inputs, &key, section, element, session)?;
        if is_sheet {
            let fault = |e: crate::cell::CellError| RunError::Cell {
                key: key.clone(),
                fault: e.into(),
            };
            cell = cell.with_solid(Solid::Below, 0.0).map_err(fault)?;
        }
        let density = fractions::density(scaffold, &cell);
        let cell = match section.volume_fraction {
            Some(asked) => fractions::levelled(cell, density.as_ref(), asked.0, &key)?,
            None => cell,
        };
        entry.cells.push(cell);
        entry.densities.push(density);
    }
    if entry.cells.is_empty() {
        let names: Vec<&str> = shapes.iter().map(|s| s.name()).collect();
        return Err(RunError::Mixed(names.join(" and ")));
    }
    let torn = is_torn(scaffold, &entry)?;
    if torn {
        let options = super::fit_options(section);
        entry.cells = fit_matched(&entry.cells, &options, session.progress)
            .map_err(|e| SourceFault::from(e).of(&key))?;
        if let Some(asked) = section.volume_fraction {
            let shifted = fractions::shifted(scaffold, &entry.cells, &entry.densities, asked.0);
            entry.cells = shifted.map_err(|e| RunError::Cell {
                key: key.clone(),
                fault: e.into(),
            })?;
        }
        let far = entry
            .cells
            .iter()
            .filter_map(|c| Some((c, c.report()?.rms)));
        if let Some((cell, rms)) = far.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|f| f.1 > FAR) {
            let message = format!(
                "{key}: the {} cell that agrees with its neighbours on their faces differs from the \
                 one asked for by {rms:.3} edge lengths (rms): raise band_limit, or choose a cell \
                 that looks alike on all faces (struts along edges, plates on faces)",
                cell.element().name()
            );
            inputs.warn(Warning::CELL, message)?;
        }
    }
    let asked = fineness.tolerance * fineness.voxel;
    for cell in &entry.cells {
        // Tables of unlike elements err differently: where they meet they must be fine.
        let table = match shapes.len() {
            1 => Table::for_displacement(cell, asked),
            _ if torn => Table::with_tolerance(cell, FINE).or_else(|_| Table::new(cell)),
            _ => Table::for_displacement(cell, asked.min(FINE)),
        };
        let table = table.map_err(|e| RunError::Cell {
            key: key.clone(),
            fault: e.into(),
        })?;
        if let Some(most) = table.displacement().filter(|&d| d > asked && asked > 0.0) {
            let (most, asked) = (most / fineness.voxel, fineness.tolerance);
            let message = format!(
                "{key}: its table of {} samples per axis displaces the surface by {} voxel, more than \
                 tiling.tolerance = {asked}",
                table.samples(),
                short(most)
            );
            inputs.warn(Warning::TABLE, message)?;
        }
        entry.tables.push(table);
    }
    refine(scaffold, &mut entry);
    Ok(entry)
}

/// Makes tables finer until elements meet across faces as closely as their cells do, or within
/// [`LARGEST_JUMP`]: those of elements that are turned against each other, as wedges may be, err
/// differently on the face that they share.
fn refine(scaffold: &Scaffold, entry: &mut Entry) {
    let elements: Vec<Element> = entry.cells.iter().map(Cell::element).collect();
    let of = |shape: Element| {
        let own = |&e: &Element| e == shape || crate::tiling::fills(e, shape);
        elements.iter().position(own)
    };
    let ways = Ways::of(scaffold);
    let jump = |tables: &[Table]| {
        ways.relative_jump(&|shape, p| of(shape).map_or(0.0, |n| Field::value(&tables[n], p)))
    };
    let mut found = jump(&entry.tables);
    if found <= LARGEST_JUMP {
        return;
    }
    let exact =
        ways.relative_jump(&|shape, p| of(shape).map_or(0.0, |n| Field::value(&entry.cells[n], p)));
    let goal = LARGEST_JUMP.max(2.0 * exact);
    for attempt in 0..REFINEMENTS {
        if found <= goal {
            return;
        }
        let share = 0.5 * goal / found;
        let finer = |(cell, table): (&Cell, &Table)| {
            let measured = table.displacement().filter(|_| attempt < REFINEMENTS / 2);
            match measured {
                Some(most) => Table::for_displacement(cell, most * share),
                // The bound is several times the error; tables are larger than by displacement.
                None => Table::with_tolerance(cell, table.error_bound() * share.max(0.1)),
            }
        };
        let tables = entry.cells.iter().zip(&entry.tables).map(finer);
        // What there is does not meet as closely, but it is a table.
        let Ok(tables) = tables.collect::<Result<Vec<_>, _>>() else {
            return;
        };
        let next = jump(&tables);
        if next < found {
            found = next;
            entry.tables = tables;
        }
    }
}

/// Whether cells made for each shape by itself fail to meet on shared faces, though each is the same
/// whatever the numbering of its element: what matching mends.
fn is_torn(scaffold: &Scaffold, entry: &Entry) -> Result<bool, RunError> {
    let whole = |c: &Cell| c.fits_any_numbering() && c.element().dimension() == 3;
    let covers = scaffold
        .shapes()
        .iter()
        .all(|s| entry.cells.iter().any(|c| c.element() == *s));
    if !covers || !entry.cells.iter().all(whole) {
        return Ok(false);
    }
    let member = Member {
        name: entry.name.clone(),
        cells: entry.cells.iter().collect(),
    };
    let weights = vec![1.0; scaffold.nodes().len()];
    let blend = Blend::new(scaffold, vec![member], weights, Interpolation::Linear)
        .map_err(|e| RunError::Tiling(e.to_string()))?;
    Ok(matches!(
        blend.check(scaffold),
        Err(TilingError::Seam { .. })
    ))
}
