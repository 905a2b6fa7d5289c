//! The struts of a graph over a scaffold as a beam lattice for a file, without voxels or triangles. Operations of the
//! recipe and cuts are not part of it; plates are refused.

use crate::beams::Beams;
use crate::frame::{CellPoint, Vec3};
use crate::io::{Beam, BeamLattice};
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::Content;
use crate::pipeline::inputs::source::skeleton;
use std::collections::{BTreeSet, HashMap};

/// Greatest distance of the mapped midpoint of a strut from the midpoint of its mapped ends, over its
/// length: beyond it the element is curved.
const MAX_BEND: f64 = 1e-6;

/// Every strut of every element as a beam, in recipe units; struts that neighbours share count once. A round-beam
/// tiling returns the beams of the solid itself. Otherwise the struts are those of the first cell, and each end's
/// radius scales with the cube root of the element's volume there. Shear of an element does not change the round
/// section.
///
/// # Errors
/// No scaffold, and plates; without round beams also elements of several shapes, curved ones, and a faulty graph.
pub(crate) fn beams(inputs: &Inputs) -> Result<BeamLattice, RunError> {
    let fault = |message: String| RunError::Tiling(format!("beams: {message}"));
    let sections = inputs.recipe.sections();
    let Some((tiling, section)) = inputs.tiling().zip(sections.tiling.as_ref()) else {
        return Err(fault("the recipe has no scaffold".into()));
    };
    let name = section.cells().first().copied().unwrap_or_default();
    let scaffold = &tiling.loaded.scaffold;
    // Nodes of neighbours agree up to rounding; coordinates on this grid identify them.
    let merge_step = 1e-7 * scaffold.bounds().half_diagonal();
    if let Content::Beams(round) = tiling.content() {
        let beams = round.beams();
        if beams.has_plates() {
            return Err(fault(format!(
                "cell.{name} has plates; a beam lattice holds struts only"
            )));
        }
        return Ok(lattice_of(beams, merge_step));
    }
    let shapes = scaffold.shapes();
    let [shape] = shapes[..] else {
        return Err(fault("the scaffold has elements of several shapes".into()));
    };
    let struts = skeleton(inputs.recipe, &sections.cell[name], shape)
        .map_err(|fault| fault.of(&format!("cell.{name}")))?;
    if !struts.plates().is_empty() {
        return Err(fault(format!(
            "cell.{name} has plates; a beam lattice holds struts only"
        )));
    }
    let mut node_of: HashMap<[i64; 3], u32> = HashMap::new();
    let mut lattice = BeamLattice::default();
    let mut seen = BTreeSet::new();
    for element in scaffold.elements() {
        // The place in the world, and the cube root of |det J| as the local factor on lengths.
        let placed = |p: Vec3| {
            let (place, jacobian) = element.map_and_jacobian(CellPoint(p));
            (place.0, jacobian.determinant().abs().cbrt())
        };
        for (ends, radius) in struts.struts() {
            let [(a, ra), (b, rb)] = ends.map(placed);
            let (middle, _) = placed((ends[0] + ends[1]) / 2.0);
            if ((a + b) / 2.0 - middle).norm() > MAX_BEND * (b - a).norm() {
                let number = scaffold.number(element.index());
                let message = format!(
                    "element {number} is curved; expected straight elements, because beams are straight"
                );
                return Err(fault(message));
            }
            let mut node = |p: Vec3| {
                let key = <[i64; 3]>::from(p.map(|c| (c / merge_step).round() as i64));
                *node_of.entry(key).or_insert_with(|| {
                    lattice.nodes.push(p);
                    lattice.nodes.len() as u32 - 1
                })
            };
            let ends = [node(a), node(b)];
            // Struts on shared faces and edges are found from several elements.
            if ends[0] != ends[1] && seen.insert([ends[0].min(ends[1]), ends[0].max(ends[1])]) {
                lattice.beams.push(Beam {
                    ends,
                    radii: [ra * radius, rb * radius],
                });
            }
        }
    }
    Ok(lattice)
}

/// The lattice of round beams, with shared nodes merged.
fn lattice_of(beams: &Beams, merge_step: f64) -> BeamLattice {
    let mut lattice = BeamLattice::default();
    let mut node_of: HashMap<[i64; 3], u32> = HashMap::new();
    for beam in beams.beams() {
        let ends = beam.ends.map(|p| {
            let key = <[i64; 3]>::from(p.map(|c| (c / merge_step).round() as i64));
            *node_of.entry(key).or_insert_with(|| {
                lattice.nodes.push(p);
                lattice.nodes.len() as u32 - 1
            })
        });
        // The format has no balls. A ball (both ends equal) lies inside the beams that meet there.
        if ends[0] != ends[1] {
            let radii = beam.radii;
            lattice.beams.push(Beam { ends, radii });
        }
    }
    lattice
}
