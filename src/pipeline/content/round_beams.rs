//! Cells of round beams and plates: graphs of a recipe with their diameters as one field in space.
//!
//! A strut has the requested diameter in space, however its element deforms the cell. Diameters are
//! evaluated along the struts, not at element corners. In a transition the diameter is multiplied by the
//! sum of the weights of the cells that contain the part. Parts of one cell taper with its weight, down
//! to two voxels or half the requested diameter, and end where the weight is zero. Parts that all cells
//! contain keep their diameter. The solid is a union of balls, so it is continuous for any weights.
//!
//! Graphs and other cells cannot share one tiling as beams; there the graphs are fitted.

use super::tiling::CellTiling;
use crate::beams::{
    Beam, Beams, Cut, Network, NetworkError, Plate, RadiusLimits, ReferenceParts, ScaffoldSolid,
    WeightsAt, Width,
};
use crate::cell::{default_group, operators_of};
use crate::field::{Field, Interval, WorldField};
use crate::frame::{CellBox, CellPoint, Element, Vec3};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::shape::{Borrowed, Shape, intersection};
use crate::pipeline::base::warning::Warning;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::source::{skeleton, skeleton_notes};
use crate::pipeline::inputs::spatial_value::{SpatialContext, sign_hint};
use crate::recipe;
use crate::recipe::{
    CellPlace, CellSection, Length, Outside, Recipe, Section, TilingSection, Varying,
};
use crate::scaffold::Scaffold;
use crate::tiling::{Boundary, Filling, TilingError, TilingOptions};
use std::sync::OnceLock;

mod fraction;

use fraction::diameter_for_fraction;

/// Chordal error of curved struts, and error of radii between the points at which they are evaluated, voxels: small
/// beside what voxels resolve, like that of the boundary below.
const CHORDAL_ERROR: f64 = 0.02;
const RADIUS_ERROR: f64 = 0.01;
/// Least radius of tapering struts, voxels: thinner ones break.
const MIN_RADIUS: f64 = 1.0;
/// Chordal error of the scaffold's boundary, voxels.
const BOUNDARY_ERROR: f64 = 0.05;

/// Beams and plates over a scaffold.
pub(crate) struct RoundBeams {
    beams: Beams,
    /// Numbers of nodes, of straight segments of struts and of flat facets of plates, in this order, each counted
    /// once.
    counts: [usize; 3],
    /// Least and greatest diameter that is not 0, world units.
    diameters: [f64; 2],
    /// Chordal error of the scaffold's boundary, world units. It follows from the recipe's voxels, also
    /// in estimates on coarser ones.
    boundary_error: f64,
    /// The scaffold's outer faces, made when a field is first cut by them.
    outer: OnceLock<ScaffoldSolid>,
}

/// Whether a tiling's cells are round beams and plates. Warns if graphs are fitted because another cell is not;
/// refuses that where the recipe requests `section = "round"`.
pub(crate) fn is_round(files: &mut InputFiles, tiling: &TilingSection) -> Result<bool, RunError> {
    let cells = &files.recipe.sections().cell;
    let (round, fitted): (Vec<&str>, Vec<&str>) = tiling
        .cells()
        .iter()
        .partition(|name| cells[**name].is_round(tiling));
    // Nothing to decide where all cells are of one kind.
    let ([first, ..], [other, ..]) = (&round[..], &fitted[..]) else {
        return Ok(!round.is_empty());
    };
    // A section that the recipe requests is an error here; one that is the default becomes a warning.
    let named = round
        .iter()
        .find(|name| cells[**name].section == Some(Section::Round));
    if let Some(name) = named {
        return Err(RunError::Tiling(format!(
            "cell.{name} has section = \"round\" and cell.{other} is not a graph of round struts; \
             no transition joins the two; expected round cells only, or section = \"fitted\" in \
             [cell.{name}]"
        )));
    }
    let message = format!(
        "tiling: cell.{first} is fitted and not made of round beams, because it shares the tiling with cell.{other}; \
         its struts have the requested thickness on average only: use graphs alone for round struts, or set \
         section = \"fitted\" in [cell.{first}]"
    );
    files.warn(Warning::SECTION, message)?;
    Ok(false)
}

/// Refuses keys that round beams do not support, of the cell `name` and of the tiling.
fn check(recipe: &Recipe, name: &str, tiling: &TilingSection) -> Result<(), RunError> {
    let section = &recipe.sections().cell[name];
    let unsupported = |key: &str, expected: &str| {
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
    let is_placed = |p: &CellPlace| *p != CellPlace::Reference;
    if section.place.as_ref().is_some_and(is_placed) {
        return unsupported("place", "none");
    }
    if section.invert == Some(true) {
        return unsupported("invert", "none");
    }
    if section.solid.is_some_and(|s| s != recipe::Solid::Below) {
        return unsupported("solid", "none");
    }
    // A thickness of the tiling overrides the cell's keys.
    let own = tiling.thickness.is_none();
    if tiling.level.is_some() || (own && section.level.is_some()) {
        return unsupported("level", "a thickness");
    }
    let by_fraction =
        tiling.volume_fraction.is_some() || (own && section.volume_fraction.is_some());
    if by_fraction && fraction(recipe, tiling).is_none() {
        return unsupported("volume_fraction", "one number for one cell, or a thickness");
    }
    Ok(())
}

/// The volume fraction, above 0 and below 1, that beams of one diameter must have in the scaffold. `None` if none is
/// requested, for several cells, for one that varies or is out of range, and for a cell's own beside a thickness of the
/// tiling.
pub(crate) fn fraction(recipe: &Recipe, tiling: &TilingSection) -> Option<f64> {
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

/// The struts and plates of a cell in each element shape that it fills, in reference coordinates.
fn shape_parts(
    recipe: &Recipe,
    name: &str,
    tiling: &TilingSection,
    scaffold: &Scaffold,
) -> Result<Vec<(Element, ReferenceParts)>, RunError> {
    check(recipe, name, tiling)?;
    let key = format!("cell.{name}");
    let section = &recipe.sections().cell[name];
    let own_element = section.own_element();
    let shapes = scaffold.shapes();
    // A cell of one shape leaves the elements of other shapes empty.
    let filled: Vec<Element> = shapes
        .iter()
        .copied()
        .filter(|s| own_element.is_none_or(|o| o == *s))
        .collect();
    if let (true, Some(own_element)) = (filled.is_empty(), own_element) {
        let names: Vec<&str> = shapes.iter().map(|s| s.name()).collect();
        return Err(RunError::Tiling(format!(
            "{key} is for a {}; the scaffold has elements of shape {}",
            own_element.name(),
            names.join(", ")
        )));
    }
    // A thickness without a unit is in reference lengths and overrides the graph's radii; one with a unit is applied in
    // space, by `sized_parts`.
    let own_radius = section.thickness.and_then(|t| match t.0 {
        Length::Bare(t) => Some(t / 2.0),
        _ => None,
    });
    let of_shape = |shape: Element| {
        let parts = skeleton(recipe, section, shape).map_err(|fault| fault.of(&key))?;
        let mut parts = ReferenceParts {
            struts: parts.struts().to_vec(),
            plates: parts.plates().to_vec(),
        };
        // The second number of a strut is its radius, that of a plate half its thickness.
        if let Some(radius) = own_radius {
            for strut in &mut parts.struts {
                strut.1 = radius;
            }
            for plate in &mut parts.plates {
                plate.1 = radius;
            }
        }
        let parts = symmetrised(recipe, &key, section, shape, parts)?;
        Ok((shape, parts.clipped_to(shape)))
    };
    filled.into_iter().map(of_shape).collect()
}

/// A graph with all its images under its group, so that neighbours match in any numbering of their
/// nodes. It applies to graphs of files and cells with a group; graphs of the library have the symmetry
/// of their element.
fn symmetrised(
    recipe: &Recipe,
    key: &str,
    section: &CellSection,
    shape: Element,
    parts: ReferenceParts,
) -> Result<ReferenceParts, RunError> {
    let graph = section.graph.as_ref().or(section.plates.as_ref());
    let is_file = graph.is_some_and(|g| g.path.extension().is_some());
    let group = match &section.group {
        Some(word) => {
            let path = recipe.resolve(std::path::Path::new(word));
            if path.is_file() {
                let group =
                    crate::pipeline::inputs::group::read_group(&path).map_err(RunError::from)?;
                group.line()
            } else {
                word.clone()
            }
        }
        // Graphs of files have no symmetry of their own, graphs of the library do.
        None if is_file => default_group(shape).to_owned(),
        None => return Ok(parts),
    };
    let operators = operators_of(shape, &group).map_err(|e| RunError::Cell {
        key: key.to_owned(),
        fault: e.into(),
    })?;
    Ok(parts.symmetrised(&operators))
}

impl RoundBeams {
    /// Maps the cells' struts and plates through all elements and sizes them. `section` is the tiling's, whose
    /// thickness `spatial` evaluates; notes on graphs become warnings of `files`.
    pub fn load(
        files: &mut InputFiles,
        tiling: &CellTiling,
        section: &TilingSection,
        spatial: &SpatialContext,
    ) -> Result<Self, RunError> {
        let recipe = files.recipe;
        let scaffold = &tiling.loaded.scaffold;
        let names = section.cells();
        for name in &names {
            for note in skeleton_notes(recipe, &recipe.sections().cell[*name])? {
                files.warn(Warning::MESH, format!("cell.{name}: {note}"))?;
            }
        }
        let cells = names
            .iter()
            .map(|name| shape_parts(recipe, name, section, scaffold));
        let cells = cells.collect::<Result<Vec<_>, _>>()?;
        let failed = |e: NetworkError| RunError::Tiling(e.to_string());
        let chord = CHORDAL_ERROR * recipe.scale().voxel_size;
        let network = Network::new(scaffold, &cells, chord).map_err(failed)?;
        let (beams, plates) = sized_parts(files, tiling, section, spatial, &network)?;
        let counts = network.counts();
        // For many struts the network takes hundreds of megabytes.
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

    /// Least and greatest diameter that is not 0, world units.
    pub fn diameters(&self) -> [f64; 2] {
        self.diameters
    }

    /// The solid as a field: the beams, cut by the scaffold's outer faces if the boundary is cut,
    /// and by the mesh that the scaffold fills, if there is one.
    pub fn shape<'a>(
        &'a self,
        tiling: &'a CellTiling,
        options: TilingOptions,
        offsets: Offsets,
    ) -> Shape<'a> {
        let scaffold = &tiling.loaded.scaffold;
        let bounds = self.beams.bounds();
        let field: Box<WorldField> = Box::new(Borrowed(&self.beams));
        let mut shape = Shape {
            field,
            extent: bounds,
            name: "the scaffold".into(),
        };
        if options.boundary == Boundary::Cut {
            let outer = self.outer.get_or_init(|| {
                let components = 0..scaffold.components().len();
                let mesh = |n| scaffold.boundary(n, self.boundary_error).mesh;
                ScaffoldSolid::new(components.map(mesh))
            });
            shape.extent = bounds.intersection(scaffold.bounds());
            // Offsets need true distances near the edge of the cut, which the plain maximum does not
            // give.
            shape.field = if offsets.count == 0 {
                Box::new(Cut::new(&self.beams, outer))
            } else {
                let outer_field = Box::new(Borrowed(outer));
                intersection(shape.field, outer_field, options.half_width, offsets)
            };
        }
        if let Some(envelope) = &tiling.loaded.envelope {
            let borrowed = Box::new(Borrowed(envelope.as_ref()));
            shape.extent = shape.extent.intersection(envelope.bounds());
            shape.field = intersection(shape.field, borrowed, options.half_width, offsets);
        }
        shape
    }

    /// The report's entry.
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

    /// Memory, bytes.
    pub fn bytes(&self) -> u64 {
        self.beams.bytes() as u64
    }

    /// The beams as a filling of elements.
    pub fn in_elements<'a>(&'a self, scaffold: &'a Scaffold) -> ElementView<'a> {
        ElementView {
            beams: &self.beams,
            scaffold,
        }
    }
}

/// Beams and plates of a network with the diameters that a recipe requests: those of one volume fraction, those of
/// the cells, or those of `[tiling] thickness`. `spatial` evaluates formulas and names the key in errors.
fn sized_parts(
    files: &mut InputFiles,
    tiling: &CellTiling,
    section: &TilingSection,
    spatial: &SpatialContext,
    network: &Network,
) -> Result<(Vec<Beam>, Vec<Plate>), RunError> {
    let recipe = files.recipe;
    let scaffold = &tiling.loaded.scaffold;
    let weights = tiling.cell_weights()?;
    let at = |element: usize, xi: CellPoint<3>| weights.at(element, xi);
    let at: Option<&WeightsAt> = (!weights.is_single()).then_some(&at as &WeightsAt);
    let voxel = recipe.scale().voxel_size;
    let limits = RadiusLimits {
        tolerance: RADIUS_ERROR * voxel,
        min_radius: MIN_RADIUS * voxel,
    };
    if let Some(fraction) = fraction(recipe, section) {
        // All beams get a tiny diameter first; distances to their axes then give the diameter of the fraction.
        // Thin beams have small boxes, which makes the nearest-beam search fast.
        let trial = 1e-6 * scaffold.bounds().half_diagonal();
        let constant =
            |d: f64| network.sized(scaffold, Width::<RunError>::Constant(d), None, limits);
        let (beams, plates) = constant(trial)?;
        let found = Beams::new(&beams, &plates)
            .and_then(|b| diameter_for_fraction(&b, trial, scaffold, fraction));
        // Without any beam the diameter is 0 and the caller refuses the network.
        return constant(found.unwrap_or_default());
    }
    let Some(thickness) = &section.thickness else {
        return match physical_thicknesses(recipe, &section.cells())? {
            None => network.sized(scaffold, Width::<RunError>::Relative, at, limits),
            Some([d, ..]) if weights.is_single() => {
                network.sized(scaffold, Width::<RunError>::Constant(d), None, limits)
            }
            // Weights times own thickness over the least one: the beam's diameter is the sum of these over its cells.
            Some(own) => {
                let positive = own.iter().copied().filter(|&t| t > 0.0);
                let unit = positive.fold(f64::INFINITY, f64::min);
                let at = |element: usize, xi: CellPoint<3>| {
                    let all = weights.at(element, xi);
                    std::array::from_fn(|n| all[n] * own[n] / unit)
                };
                let width = Width::<RunError>::Constant(unit);
                network.sized(scaffold, width, Some(&at), limits)
            }
        };
    };
    if let Varying::Field(field) = thickness
        && field.outside == Some(Outside::Error)
    {
        // Rounding may put struts of the boundary outside the box of the nodes; the nodes decide, and
        // the struts take the nearest value.
        spatial.values(files, thickness, scaffold.nodes())?;
    }
    let thickness = thickness.or_nearest();
    let negative = |d: f64, p: Vec3| {
        Err(RunError::Tiling(format!(
            "{}: found {d} at ({:.4}, {:.4}, {:.4}); expected a thickness that is not negative{}",
            spatial.key,
            p.x,
            p.y,
            p.z,
            sign_hint(&thickness)
        )))
    };
    if let Varying::Number(d) = thickness {
        if d <= 0.0 {
            return Err(RunError::Tiling(format!(
                "{}: found {d}; expected a positive thickness",
                spatial.key
            )));
        }
        return network.sized(scaffold, Width::<RunError>::Constant(d), at, limits);
    }
    let mut diameters = |places: &[Vec3]| {
        let found = spatial.values(files, &thickness, places)?;
        match found.iter().position(|&d| d < 0.0) {
            Some(n) => negative(found[n], places[n]),
            None => Ok(found),
        }
    };
    network.sized(scaffold, Width::Varying(&mut diameters), at, limits)
}

/// The thicknesses of the cells in world units, in the order of `names`, padded with 0 to eight, the most cells of a
/// tiling; `None` if no cell has one. Some with and some without is an error.
fn physical_thicknesses(recipe: &Recipe, names: &[&str]) -> Result<Option<[f64; 8]>, RunError> {
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

/// Round beams as a filling of elements, for the continuity certificate. Bounds are trivial, because the certificate
/// evaluates points only; slopes are those of a distance, 1 in the world.
pub(crate) struct ElementView<'a> {
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
        Interval::REAL_LINE
    }

    fn gradient_sup(&self, element: usize) -> f64 {
        self.scaffold.element(element).stretch().1
    }

    fn gradient_rms(&self, element: usize) -> f64 {
        self.scaffold.element(element).stretch().1
    }
}
