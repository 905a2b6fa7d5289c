//! The palette of a tiling: its cells, each for every element shape that it fills.
//!
//! Cells are made for each shape separately. Where they do not match on faces between different shapes
//! (or between wedges and pyramids), they are fitted again together so that they match.

use super::fractions;
use super::grading::GradedCell;
use crate::cell::{Cell, Density, Solid, Table, fit_matched};
use crate::field::Field;
use crate::frame::Element;
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::warning::Warning;
use crate::pipeline::content::tiling::ContentKind;
use crate::pipeline::inputs::cells;
use crate::pipeline::inputs::fit_options::fit_options;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::source::SourceFault;
use crate::recipe;
use crate::recipe::{CellSection, Length, Recipe, Size, TilingSection};
use crate::scaffold::Scaffold;
use crate::tiling::{Blend, FaceJoins, Filling, Interpolation, Member, TilingError};
use crate::vdb::Session;

/// The accuracy that tables of cells need.
#[derive(Clone, Copy)]
pub(crate) struct TableAccuracy {
    /// Edge of a voxel in reference lengths, where elements are largest in voxels.
    voxel_size: f64,
    /// Displacement of the surface that tables may cause, voxels.
    tolerance: f64,
}

impl TableAccuracy {
    /// The accuracy that a recipe requires over a scaffold.
    pub fn new(recipe: &Recipe, tiling: &TilingSection, scaffold: &Scaffold) -> Self {
        Self {
            voxel_size: recipe.scale().voxel_size / scaffold.stretch().1,
            tolerance: tiling.tolerance.0,
        }
    }

    /// The report's entry for a table, with its errors in voxels.
    pub fn facts(&self, table: &Table) -> serde_json::Value {
        let voxels = |length: f64| length / self.voxel_size;
        // Errors of values over the slope of the field are displacements of the surface.
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

/// Greatest root mean square difference, in edge lengths, of a matched cell from the requested one
/// without a warning.
const MAX_MATCHING_RMS: f64 = 0.05;
/// Thickness in reference lengths of sheets until their tiling gives another.
const PROVISIONAL_THICKNESS: f64 = 0.1;
/// Greatest error of tables where element shapes meet, edge lengths.
const MATCHED_TABLE_TOLERANCE: f64 = 2e-5;

/// Greatest jump of tables across shared faces, over the range of values there: a fifth below the 1e-5 from which W114
/// warns, since the certificate samples other points.
const MAX_RELATIVE_JUMP: f64 = 8e-6;
/// Greatest number of refinements to reach it.
const MAX_REFINEMENTS: usize = 4;

/// One cell of the palette, made for each element shape.
pub(crate) struct PaletteCell {
    pub name: String,
    pub cells: Vec<Cell>,
    pub tables: Vec<Table>,
    /// Density of the non-affine elements that each cell fills.
    pub densities: Vec<Option<Density>>,
}

impl PaletteCell {
    /// An entry without cells, for struts that are made as beams.
    pub fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            cells: Vec::new(),
            tables: Vec::new(),
            densities: Vec::new(),
        }
    }

    /// The cell of the first shape, whose level is graded.
    pub fn graded(&self) -> GradedCell<'_> {
        GradedCell {
            name: &self.name,
            cell: &self.cells[0],
            density: self.densities[0].as_ref(),
            slope: self.tables[0].gradient_rms(),
        }
    }
}

/// The section of a cell, with what its use in the tiling changes.
fn section_in_use(files: &InputFiles, name: &str, kind: ContentKind) -> CellSection {
    let section = &files.recipe.sections().cell[name];
    // The thickness of a sheet that is graded by the tiling is provisional.
    let is_provisional = section.solid == Some(recipe::Solid::Sheet) && section.levels().is_empty();
    match (kind, is_provisional) {
        (ContentKind::Sheets, _) => CellSection {
            solid: None,
            thickness: None,
            invert: None,
            ..section.clone()
        },
        (_, true) => CellSection {
            thickness: Some(Size(Length::Bare(PROVISIONAL_THICKNESS))),
            ..section.clone()
        },
        (_, false) => section.clone(),
    }
}

/// Makes the cells of a name for every shape that occurs; for a metric sheet (a wall of a given thickness in
/// space), one side of its mid-surface. A cell of one shape in a mixed scaffold is made for that shape only; a
/// name that fits no shape is an error.
pub(crate) fn cells_by_shape(
    files: &mut InputFiles,
    shapes: &[Element],
    name: &str,
    kind: ContentKind,
    session: Session,
) -> Result<Vec<Cell>, RunError> {
    let key = format!("cell.{name}");
    let section = section_in_use(files, name, kind);
    let own_element = section.element.map(Element::from);
    let mut all = Vec::new();
    for &shape in shapes {
        // In a scaffold of one shape a misfit is left to `cells::make`, whose error names both shapes.
        // A planar cell fills the prisms over its element.
        let element = own_element
            .filter(|&a| crate::tiling::fills(a, shape))
            .unwrap_or(shape);
        if shapes.len() > 1 && own_element.is_some_and(|a| !crate::tiling::fills(a, shape)) {
            continue;
        }
        let mut cell = cells::make(files, &key, &section, element, session)?;
        if kind == ContentKind::Sheets {
            let fault = |e: crate::cell::CellError| RunError::Cell {
                key: key.clone(),
                fault: e.into(),
            };
            cell = cell.with_solid(Solid::Below, 0.0).map_err(fault)?;
        }
        all.push(cell);
    }
    if all.is_empty() {
        let names: Vec<&str> = shapes.iter().map(|s| s.name()).collect();
        return Err(RunError::MixedElements(names.join(" and ")));
    }
    Ok(all)
}

/// Levels, matches and tabulates the cells of a name. `cells` have the level of their section; a volume fraction
/// is met anew with the elements as they are. A table is a cell's field at nodes of a grid, which runs evaluate.
/// Adds warnings to `files`.
pub(crate) fn palette_cell(
    files: &mut InputFiles,
    scaffold: &Scaffold,
    cells: Vec<Cell>,
    name: &str,
    accuracy: TableAccuracy,
    kind: ContentKind,
    session: Session,
) -> Result<PaletteCell, RunError> {
    let key = format!("cell.{name}");
    let section = &section_in_use(files, name, kind);
    let shapes = scaffold.shapes();
    let mut entry = PaletteCell::named(name);
    for cell in cells {
        let density = fractions::density(scaffold, &cell, files.cache);
        let cell = match section.volume_fraction {
            Some(target) => fractions::at_fraction(cell, density.as_ref(), target.0, &key)?,
            None => cell,
        };
        entry.cells.push(cell);
        entry.densities.push(density);
    }
    // Cells of one name in several shapes must agree on the faces that the shapes share.
    let needs_matching = cells_need_matching(scaffold, &entry)?;
    if needs_matching {
        let options = fit_options(section);
        entry.cells = fit_matched(&entry.cells, &options, session.progress)
            .map_err(|e| SourceFault::from(e).of(&key))?;
        // One shift for all shapes keeps their agreement; a shift for each would break it.
        if let Some(target) = section.volume_fraction {
            let shifted =
                fractions::with_common_shift(scaffold, &entry.cells, &entry.densities, target.0);
            entry.cells = shifted.map_err(|e| RunError::Cell {
                key: key.clone(),
                fault: e.into(),
            })?;
        }
        let rms_errors = entry
            .cells
            .iter()
            .filter_map(|c| Some((c, c.report()?.rms)));
        if let Some((cell, rms)) = rms_errors
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|f| f.1 > MAX_MATCHING_RMS)
        {
            let message = format!(
                "{key}: the {} cell that matches its neighbours on their faces differs from the \
                 requested one by {rms:.3} edge lengths (rms): raise band_limit, or choose a cell \
                 that looks alike on all faces (struts along edges, plates on faces)",
                cell.element().name()
            );
            files.warn(Warning::CELL, message)?;
        }
    }
    let max_displacement = accuracy.tolerance * accuracy.voxel_size;
    for cell in &entry.cells {
        // Errors of tables differ between element shapes, so tables must be accurate where shapes meet. Matched cells
        // take the default tolerance where the strict one needs too large a table.
        let table = match shapes.len() {
            1 => Table::for_displacement(cell, max_displacement),
            _ if needs_matching => {
                Table::with_tolerance(cell, MATCHED_TABLE_TOLERANCE).or_else(|_| Table::new(cell))
            }
            _ => Table::for_displacement(cell, max_displacement.min(MATCHED_TABLE_TOLERANCE)),
        };
        let table = table.map_err(|e| RunError::Cell {
            key: key.clone(),
            fault: e.into(),
        })?;
        // With a tolerance of 0 no table is finer, and none is reported.
        if let Some(displacement) = table
            .displacement()
            .filter(|&d| d > max_displacement && max_displacement > 0.0)
        {
            let (displacement, tolerance) =
                (displacement / accuracy.voxel_size, accuracy.tolerance);
            let message = format!(
                "{key}: the table of {} samples per axis displaces the surface by {} voxels, more than \
                 tiling.tolerance = {tolerance}",
                table.samples(),
                short_number(displacement)
            );
            files.warn(Warning::TABLE, message)?;
        }
        entry.tables.push(table);
    }
    refine_tables(scaffold, &mut entry);
    Ok(entry)
}

/// Refines tables until the jump across faces is at most twice that of the exact cells or [`MAX_RELATIVE_JUMP`]; gives
/// up after [`MAX_REFINEMENTS`], or where no finer table is possible. Tables of elements that are rotated against
/// each other, as wedges may be, have different errors on their shared face.
fn refine_tables(scaffold: &Scaffold, entry: &mut PaletteCell) {
    let elements: Vec<Element> = entry.cells.iter().map(Cell::element).collect();
    let cell_index = |shape: Element| {
        let fills_shape = |&e: &Element| e == shape || crate::tiling::fills(e, shape);
        elements.iter().position(fills_shape)
    };
    let ways = FaceJoins::of(scaffold);
    let jump_of = |tables: &[Table]| {
        ways.relative_jump(&|shape, p| {
            cell_index(shape).map_or(0.0, |n| Field::value(&tables[n], p))
        })
    };
    let mut jump = jump_of(&entry.tables);
    if jump <= MAX_RELATIVE_JUMP {
        return;
    }
    let exact_jump = ways.relative_jump(&|shape, p| {
        cell_index(shape).map_or(0.0, |n| Field::value(&entry.cells[n], p))
    });
    let target_jump = MAX_RELATIVE_JUMP.max(2.0 * exact_jump);
    for attempt in 0..MAX_REFINEMENTS {
        if jump <= target_jump {
            return;
        }
        // Factor by which the errors must fall, halved as a margin.
        let share = 0.5 * target_jump / jump;
        let finer = |(cell, table): (&Cell, &Table)| {
            // The measured displacement is tried in the first half of the attempts, the bound in the rest.
            let measured = table
                .displacement()
                .filter(|_| attempt < MAX_REFINEMENTS / 2);
            match measured {
                Some(displacement) => Table::for_displacement(cell, displacement * share),
                // The bound is several times the error, so it is lowered to a tenth at most per attempt.
                None => Table::with_tolerance(cell, table.error_bound() * share.max(0.1)),
            }
        };
        let tables = entry.cells.iter().zip(&entry.tables).map(finer);
        let Ok(tables) = tables.collect::<Result<Vec<_>, _>>() else {
            return;
        };
        let next = jump_of(&tables);
        if next < jump {
            jump = next;
            entry.tables = tables;
        }
    }
}

/// Whether cells that are made separately need matching: they do not match on shared faces, though each
/// one fits its element in every numbering.
fn cells_need_matching(scaffold: &Scaffold, entry: &PaletteCell) -> Result<bool, RunError> {
    let is_symmetric = |c: &Cell| c.fits_any_numbering() && c.element().dimension() == 3;
    let covers = scaffold
        .shapes()
        .iter()
        .all(|s| entry.cells.iter().any(|c| c.element() == *s));
    if !covers || !entry.cells.iter().all(is_symmetric) {
        return Ok(false);
    }
    let member = Member {
        name: entry.name.clone(),
        cells: entry.cells.iter().collect(),
    };
    // One member of weight 1 everywhere: the blend is the cells themselves, and its check compares their faces.
    let weights = vec![1.0; scaffold.nodes().len()];
    let blend = Blend::new(scaffold, vec![member], weights, Interpolation::Linear)
        .map_err(|e| RunError::Tiling(e.to_string()))?;
    Ok(matches!(
        blend.check(scaffold),
        Err(TilingError::Discontinuity { .. })
    ))
}
