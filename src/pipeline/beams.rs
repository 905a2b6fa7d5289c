//! The struts of a graph over a scaffold as beams: no voxels, no triangles.

use super::error::RunError;
use super::inputs::Stock;
use super::source::skeleton;
use crate::beams::Beams;
use crate::frame::{CellPoint, Vec3};
use crate::io::{Beam, BeamLattice};
use std::collections::{BTreeSet, HashMap};

/// How far the middle of a strut may lie beside the middle of its ends, as a share of its length.
const STRAIGHT: f64 = 1e-6;

/// Every strut of every element, those of neighbours that coincide once. Round beams are those that the solid
/// is made of. Radii of fitted graphs follow the elements' mean scale at the ends of each strut; what an
/// element's map shears stays round.
pub(super) fn beams(stock: &Stock) -> Result<BeamLattice, RunError> {
    let refused = |message: String| RunError::Tiling(format!("beams: {message}"));
    let sections = stock.recipe.sections();
    let Some((fill, tiling)) = stock.fill().zip(sections.tiling.as_ref()) else {
        return Err(refused("the recipe has no scaffold".into()));
    };
    let name = tiling.cells().first().copied().unwrap_or_default();
    let scaffold = &fill.loaded.scaffold;
    // Nodes of neighbours agree to rounding.
    let grain = 1e-7 * scaffold.bounds().half_diagonal();
    if let Some(round) = fill.round() {
        let beams = round.beams();
        if beams.has_plates() {
            return Err(refused(format!(
                "cell.{name} has plates, which are no beams"
            )));
        }
        return Ok(lattice_of(beams, grain));
    }
    let shapes = scaffold.shapes();
    let [shape] = shapes[..] else {
        return Err(refused(
            "the scaffold has elements of several shapes".into(),
        ));
    };
    let struts = skeleton(stock.recipe, &sections.cell[name], shape)
        .map_err(|fault| fault.of(&format!("cell.{name}")))?;
    if !struts.plates().is_empty() {
        return Err(refused(format!(
            "cell.{name} has plates, which are no beams"
        )));
    }
    let mut numbers: HashMap<[i64; 3], u32> = HashMap::new();
    let mut lattice = BeamLattice::default();
    let mut known = BTreeSet::new();
    for element in scaffold.elements() {
        let at = |p: Vec3| {
            let (place, jacobian) = element.map_and_jacobian(CellPoint(p));
            (place.0, jacobian.determinant().abs().cbrt())
        };
        for (ends, radius) in struts.struts() {
            let [(a, ra), (b, rb)] = ends.map(at);
            let (middle, _) = at((ends[0] + ends[1]) / 2.0);
            if ((a + b) / 2.0 - middle).norm() > STRAIGHT * (b - a).norm() {
                let number = scaffold.number(element.index());
                let message = format!("element {number} is curved, and beams are straight");
                return Err(refused(message));
            }
            let mut node = |p: Vec3| {
                let key = <[i64; 3]>::from(p.map(|c| (c / grain).round() as i64));
                *numbers.entry(key).or_insert_with(|| {
                    lattice.nodes.push(p);
                    lattice.nodes.len() as u32 - 1
                })
            };
            let ends = [node(a), node(b)];
            if ends[0] != ends[1] && known.insert([ends[0].min(ends[1]), ends[0].max(ends[1])]) {
                lattice.beams.push(Beam {
                    ends,
                    radii: [ra * radius, rb * radius],
                });
            }
        }
    }
    Ok(lattice)
}

/// Round beams over shared nodes.
fn lattice_of(beams: &Beams, grain: f64) -> BeamLattice {
    let mut lattice = BeamLattice::default();
    let mut numbers: HashMap<[i64; 3], u32> = HashMap::new();
    for beam in beams.beams() {
        let ends = beam.ends.map(|p| {
            let key = <[i64; 3]>::from(p.map(|c| (c / grain).round() as i64));
            *numbers.entry(key).or_insert_with(|| {
                lattice.nodes.push(p);
                lattice.nodes.len() as u32 - 1
            })
        });
        // A ball is no beam of the format; the beams that meet there hold it.
        if ends[0] != ends[1] {
            let radii = beam.radii;
            lattice.beams.push(Beam { ends, radii });
        }
    }
    lattice
}
