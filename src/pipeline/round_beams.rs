//! Cells made of round beams and plates: from the recipe's graphs and diameters to one field in space.
//!
//! A strut has the diameter asked for whatever its element does to the cell. Diameters are evaluated along
//! the struts themselves, not at the elements' corners. In a transition a part has the diameter asked for
//! times the sum of the weights of the cells that have it. Parts of one cell taper off with its weight, down
//! to two voxels or half of what is asked, and end where the cell has no weight; parts that all cells have
//! keep their diameter. The solid is a union of balls throughout, so it is continuous whatever the weights
//! are.
//!
//! Graphs and other cells cannot be mixed in one tiling as beams; there graphs stay fitted.

use super::error::RunError;
use super::field_ops::{Borrowed, Shape, common_part};
use super::input_files::Inputs;
use super::offsets::Offsets;
use super::report::Warning;
use super::source::{skeleton, skeleton_notes};
use super::spatial_value::Setting;
use super::tiling::Fill;
use crate::beams::{
    Beam, Beams, Cut, Network, NetworkError, Plate, ScaffoldSolid, Shapes, WeightsAt, Width,
};
use crate::cell::{default_group, operators_of};
use crate::field::{Field, Interval, WorldField};
use crate::frame::{CellBox, CellPoint, Element, Vec3};
use crate::recipe::{
    self, CellPlace, CellSection, FieldRef, Length, Outside, Recipe, Section, TilingSection,
    Varying,
};
use crate::scaffold::Scaffold;
use crate::tiling::{Boundary, Filling, TilingError, TilingOptions};
use std::sync::OnceLock;

mod fraction;

use fraction::diameter_for_fraction;

/// Chordal error of curved struts, and greatest error of radii between the places where they are evaluated,
/// voxels.
const CHORDAL_ERROR: f64 = 0.02;
const RADIUS_ERROR: f64 = 0.01;
/// Least radius of tapering struts, voxels: thinner ones fall into pieces.
const LEAST_RADIUS: f64 = 1.0;
/// Chordal error of the scaffold's boundary, voxels.
const BOUNDARY_ERROR: f64 = 0.05;

/// Beams and plates over a scaffold.
pub(super) struct Round {
    beams: Beams,
    /// Numbers of nodes, of straight pieces of struts and of flat pieces of plates, each once.
    counts: [usize; 3],
    /// Least and greatest diameter that is not 0, world units.
    diameters: [f64; 2],
    /// Chordal error of the scaffold's boundary, world units: that of the recipe's voxels, whatever voxels an
    /// estimate has.
    boundary_error: f64,
    outer: OnceLock<ScaffoldSolid>,
}

/// Whether a tiling's cells are made of round beams and plates; warns where graphs stay fitted because of
/// another cell.
pub(super) fn is_round(inputs: &mut Inputs, tiling: &TilingSection) -> Result<bool, RunError> {
    let cells = &inputs.recipe.sections().cell;
    let (round, fitted): (Vec<&str>, Vec<&str>) = tiling
        .cells()
        .iter()
        .partition(|name| cells[**name].is_round(tiling));
    let ([first, ..], [other, ..]) = (&round[..], &fitted[..]) else {
        return Ok(!round.is_empty());
    };
    let named = round
        .iter()
        .find(|name| cells[**name].section == Some(Section::Round));
    if let Some(name) = named {
        return Err(RunError::Tiling(format!(
            "cell.{name} has section = \"round\" and cell.{other} is no graph of round struts; the two \
             cannot pass into each other: expected round cells only, or section = \"fitted\" in \
             [cell.{name}]"
        )));
    }
    let message = format!(
        "tiling: cell.{first} is fitted, not made of round beams, because it shares the tiling with cell.{other}; \
         its struts are as thick as asked on average only: use graphs alone for round struts, or set \
         section = \"fitted\" in [cell.{first}]"
    );
    inputs.warn(Warning::SECTION, message)?;
    Ok(false)
}

/// Refuses what round beams have no use for.
fn check(recipe: &Recipe, name: &str, tiling: &TilingSection) -> Result<(), RunError> {
    let section = &recipe.sections().cell[name];
    let refused = |key: &str, expected: &str| {
        Err(RunError::Tiling(format!(
            "{key} has no meaning for cell.{name}, which is made of round beams; expected {expected}, or \
             section = \"fitted\" in [cell.{name}]"
        )))
    };
    let is_planar = section.own_element().is_some_and(|e| e.dimension() < 3);
    if is_planar || (section.graph.is_none() && section.plates.is_none()) {
        return Err(RunError::Tiling(format!(
            "cell.{name} has section = \"round\" and another source; expected a graph or plates of a solid \
             element, or section = \"fitted\""
        )));
    }
    let placed = |p: &CellPlace| *p != CellPlace::Reference;
    if section.place.as_ref().is_some_and(placed) {
        return refused("place", "none");
    }
    if section.invert == Some(true) {
        return refused("invert", "none");
    }
    if section.solid.is_some_and(|s| s != recipe::Solid::Below) {
        return refused("solid", "none");
    }
    // A thickness for the tiling overrides what the cell says.
    let own = tiling.thickness.is_none();
    if tiling.level.is_some() || (own && section.level.is_some()) {
        return refused("level", "a thickness");
    }
    let by_fraction =
        tiling.volume_fraction.is_some() || (own && section.volume_fraction.is_some());
    if by_fraction && fraction(recipe, tiling).is_none() {
        return refused("volume_fraction", "one number for one cell, or a thickness");
    }
    Ok(())
}

/// The share of the scaffold that beams of one diameter are to fill, if that is asked.
pub(super) fn fraction(recipe: &Recipe, tiling: &TilingSection) -> Option<f64> {
    let [name] = tiling.cells()[..] else {
        return None;
    };
    let own = recipe.sections().cell[name].volume_fraction;
    match tiling.volume_fraction {
        Some(Varying::Number(share)) => (share > 0.0 && share < 1.0).then_some(share),
        Some(_) => None,
        None => own.filter(|_| tiling.thickness.is_none()).map(|f| f.0),
    }
}

/// The parts of a cell in each shape of element.
fn shapes(
    recipe: &Recipe,
    name: &str,
    tiling: &TilingSection,
    scaffold: &Scaffold,
) -> Result<Vec<(Element, Shapes)>, RunError> {
    check(recipe, name, tiling)?;
    let key = format!("cell.{name}");
    let section = &recipe.sections().cell[name];
    let own = section.own_element();
    let shapes = scaffold.shapes();
    let filled: Vec<Element> = shapes
        .iter()
        .copied()
        .filter(|s| own.is_none_or(|o| o == *s))
        .collect();
    if let (true, Some(own)) = (filled.is_empty(), own) {
        let names: Vec<&str> = shapes.iter().map(|s| s.name()).collect();
        return Err(RunError::Tiling(format!(
            "{key} is for a {}; the scaffold has elements of shape {}",
            own.name(),
            names.join(", ")
        )));
    }
    // A bare thickness is in reference lengths and overrides the graph's own radii.
    let asked = section.thickness.and_then(|t| match t.0 {
        Length::Bare(t) => Some(t / 2.0),
        _ => None,
    });
    let of_shape = |shape: Element| {
        let parts = skeleton(recipe, section, shape).map_err(|fault| fault.of(&key))?;
        let mut parts = Shapes {
            struts: parts.struts().to_vec(),
            plates: parts.plates().to_vec(),
        };
        if let Some(radius) = asked {
            for strut in &mut parts.struts {
                strut.1 = radius;
            }
            for plate in &mut parts.plates {
                plate.1 = radius;
            }
        }
        let parts = symmetrised(recipe, &key, section, (shape, parts))?;
        Ok((shape, parts.within(shape)))
    };
    filled.into_iter().map(of_shape).collect()
}

/// A graph of a file, or of a cell whose group is named, with all its images, so that it meets itself whatever
/// the numbering of neighbours; graphs of the library have their element's symmetry.
fn symmetrised(
    recipe: &Recipe,
    key: &str,
    section: &CellSection,
    (shape, parts): (Element, Shapes),
) -> Result<Shapes, RunError> {
    let graph = section.graph.as_ref().or(section.plates.as_ref());
    let is_file = graph.is_some_and(|g| g.path.extension().is_some());
    let group = match &section.group {
        Some(word) => {
            let path = recipe.resolve(std::path::Path::new(word));
            if path.is_file() {
                let group = super::group::read_group(&path).map_err(RunError::from)?;
                group.line()
            } else {
                word.clone()
            }
        }
        None if is_file => default_group(shape).to_owned(),
        None => return Ok(parts),
    };
    let operators = operators_of(shape, &group).map_err(|e| RunError::Cell {
        key: key.to_owned(),
        fault: e.into(),
    })?;
    Ok(parts.symmetrised(&operators))
}

impl Round {
    /// Maps the cells' parts through all elements and gives them their diameters.
    pub fn load(
        inputs: &mut Inputs,
        fill: &Fill,
        section: &TilingSection,
        setting: &Setting,
    ) -> Result<Self, RunError> {
        let recipe = inputs.recipe;
        let scaffold = &fill.loaded.scaffold;
        let names = section.cells();
        for name in &names {
            for note in skeleton_notes(recipe, &recipe.sections().cell[*name])? {
                inputs.warn(Warning::MESH, format!("cell.{name}: {note}"))?;
            }
        }
        let cells = names
            .iter()
            .map(|name| shapes(recipe, name, section, scaffold));
        let cells = cells.collect::<Result<Vec<_>, _>>()?;
        let failed = |e: NetworkError| RunError::Tiling(e.to_string());
        let chord = CHORDAL_ERROR * recipe.scale().voxel_size;
        let network = Network::new(scaffold, &cells, chord).map_err(failed)?;
        let (beams, plates) = sized(inputs, fill, section, (setting, &network))?;
        let counts = network.counts();
        // Of many struts both take hundreds of megabytes.
        drop(network);
        let radii = beams.iter().flat_map(|b| b.radii);
        let radii = radii.chain(plates.iter().flat_map(|p| p.radii));
        let diameters = radii
            .filter(|&r| r > 0.0)
            .fold([f64::INFINITY, 0.0], |d, r| {
                [d[0].min(2.0 * r), d[1].max(2.0 * r)]
            });
        let beams = Beams::new(&beams, &plates).ok_or_else(|| {
            RunError::Tiling("no beam has a diameter; expected a thickness above 0".into())
        })?;
        let cells = &recipe.sections().cell;
        let fillets = names.iter().filter_map(|name| cells[*name].fillet);
        let fillet = fillets
            .map(|f| f.resolve(recipe.scale()))
            .fold(0.0, f64::max);
        Ok(Self {
            beams: beams.with_fillet(fillet),
            counts,
            diameters,
            boundary_error: BOUNDARY_ERROR * recipe.scale().voxel_size,
            outer: OnceLock::new(),
        })
    }

    /// The beams and plates.
    pub fn beams(&self) -> &Beams {
        &self.beams
    }

    /// Least and greatest diameter, world units.
    pub fn diameters(&self) -> [f64; 2] {
        self.diameters
    }

    /// The solid as a field.
    pub fn shape<'a>(
        &'a self,
        fill: &'a Fill,
        options: TilingOptions,
        offsets: Offsets,
    ) -> Shape<'a> {
        let scaffold = &fill.loaded.scaffold;
        let whole = self.beams.bounds();
        let own: Box<WorldField> = Box::new(Borrowed(&self.beams));
        let mut shape = Shape {
            field: own,
            extent: whole,
            name: "the scaffold".into(),
        };
        if options.boundary == Boundary::Cut {
            let outer = self.outer.get_or_init(|| {
                let components = 0..scaffold.components().len();
                let mesh = |n| scaffold.boundary(n, self.boundary_error).mesh;
                ScaffoldSolid::new(components.map(mesh))
            });
            shape.extent = whole.intersection(scaffold.bounds());
            shape.field = if offsets.count == 0 {
                Box::new(Cut::new(&self.beams, outer))
            } else {
                let own = Box::new(Borrowed(outer));
                common_part(shape.field, own, options.half_width, offsets)
            };
        }
        if let Some(envelope) = &fill.loaded.envelope {
            let borrowed = Box::new(Borrowed(envelope.as_ref()));
            shape.extent = shape.extent.intersection(envelope.bounds());
            shape.field = common_part(shape.field, borrowed, options.half_width, offsets);
        }
        shape
    }

    /// What a report says of them.
    pub fn facts(&self) -> serde_json::Value {
        let [nodes, struts, plates] = self.counts;
        serde_json::json!({
            "section": "round",
            "thickness": self.diameters,
            "nodes": nodes,
            "struts": struts,
            "plates": plates,
            "parts": self.beams.len(),
            "bytes": self.beams.bytes(),
        })
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> u64 {
        self.beams.bytes() as u64
    }

    /// The beams as elements see them.
    pub fn in_elements<'a>(&'a self, scaffold: &'a Scaffold) -> ElementView<'a> {
        ElementView {
            beams: &self.beams,
            scaffold,
        }
    }
}

/// Beams and plates of a network with the diameters that a recipe asks for.
fn sized(
    inputs: &mut Inputs,
    fill: &Fill,
    section: &TilingSection,
    (setting, network): (&Setting, &Network),
) -> Result<(Vec<Beam>, Vec<Plate>), RunError> {
    let recipe = inputs.recipe;
    let scaffold = &fill.loaded.scaffold;
    let weights = fill.cell_weights()?;
    let at = |element: usize, xi: CellPoint<3>| weights.at(element, xi);
    let at: Option<&WeightsAt> = (!weights.is_single()).then_some(&at as &WeightsAt);
    let voxel = recipe.scale().voxel_size;
    let tolerance = [RADIUS_ERROR * voxel, LEAST_RADIUS * voxel];
    if let Some(fraction) = fraction(recipe, section) {
        // Thin beams have small boxes, so that the nearest is found soon.
        let trial = 1e-6 * scaffold.bounds().half_diagonal();
        let constant =
            |d: f64| network.sized(scaffold, Width::<RunError>::Constant(d), None, tolerance);
        let (beams, plates) = constant(trial)?;
        let found = Beams::new(&beams, &plates)
            .and_then(|b| diameter_for_fraction(&b, trial, scaffold, fraction));
        return constant(found.unwrap_or_default());
    }
    let Some(thickness) = &section.thickness else {
        return match constants(recipe, &section.cells())? {
            None => network.sized(scaffold, Width::<RunError>::Relative, at, tolerance),
            Some([d, ..]) if weights.is_single() => {
                network.sized(scaffold, Width::<RunError>::Constant(d), None, tolerance)
            }
            Some(own) => {
                let asked = own.iter().copied().filter(|&t| t > 0.0);
                let unit = asked.fold(f64::INFINITY, f64::min);
                let at = |element: usize, xi: CellPoint<3>| {
                    let all = weights.at(element, xi);
                    std::array::from_fn(|n| all[n] * own[n] / unit)
                };
                let width = Width::<RunError>::Constant(unit);
                network.sized(scaffold, width, Some(&at), tolerance)
            }
        };
    };
    if let Varying::Field(field) = thickness
        && field.outside == Some(Outside::Error)
    {
        // Struts on the boundary may lie a hair beyond what the nodes span.
        setting.values(inputs, thickness, scaffold.nodes())?;
    }
    let thickness = match thickness {
        Varying::Field(field) if field.outside == Some(Outside::Error) => {
            Varying::Field(FieldRef {
                outside: Some(Outside::Nearest),
                ..field.clone()
            })
        }
        other => other.clone(),
    };
    let refused = |d: f64, p: Vec3| {
        Err(RunError::Tiling(format!(
            "{}: found {d} at ({:.4}, {:.4}, {:.4}); expected a thickness that is not negative",
            setting.key, p.x, p.y, p.z
        )))
    };
    if let Varying::Number(d) = thickness {
        if d <= 0.0 {
            return Err(RunError::Tiling(format!(
                "{}: found {d}; expected a positive thickness",
                setting.key
            )));
        }
        return network.sized(scaffold, Width::<RunError>::Constant(d), at, tolerance);
    }
    let mut diameters = |places: &[Vec3]| {
        let found = setting.values(inputs, &thickness, places)?;
        match found.iter().position(|&d| d < 0.0) {
            Some(n) => refused(found[n], places[n]),
            None => Ok(found),
        }
    };
    network.sized(scaffold, Width::Varying(&mut diameters), at, tolerance)
}

/// The thicknesses that the cells ask for in units of length, if they do.
fn constants(recipe: &Recipe, names: &[&str]) -> Result<Option<[f64; 8]>, RunError> {
    let cells = &recipe.sections().cell;
    let mut all = [0.0; 8];
    let mut without = None;
    for (own, name) in all.iter_mut().zip(names) {
        match cells[*name].physical_thickness() {
            Some(thickness) => *own = thickness.resolve(recipe.scale()),
            None => without = Some(name),
        }
    }
    match without {
        None => Ok(Some(all)),
        Some(_) if all.iter().all(|&t| t == 0.0) => Ok(None),
        Some(name) => Err(RunError::Tiling(format!(
            "cell.{name} has no thickness in units of length and another cell of the tiling has one; expected \
             one in each, as in thickness = \"0.9mm\", or [tiling] thickness for all"
        ))),
    }
}

/// Round beams as elements see them, for measures of continuity.
pub(super) struct ElementView<'a> {
    beams: &'a Beams,
    scaffold: &'a Scaffold,
}

impl Filling for ElementView<'_> {
    fn check(&self, _: &Scaffold) -> Result<(), TilingError> {
        Ok(())
    }

    fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        let (place, jacobian) = self.scaffold.element(element).map_and_jacobian(xi);
        let (value, slope) = self.beams.value_and_gradient(place);
        (value, jacobian.tr_mul(&slope))
    }

    fn bound(&self, _: usize, _: &CellBox<3>) -> Interval {
        Interval::ALL
    }

    fn gradient_sup(&self, element: usize) -> f64 {
        self.scaffold.element(element).stretch().1
    }

    fn gradient_rms(&self, element: usize) -> f64 {
        self.scaffold.element(element).stretch().1
    }
}
