//! Elements turned so that cells with less symmetry than their element continue over all faces.
//!
//! A cell with the full group of its element fits in any numbering of the nodes. A gyroid, a chiral or a
//! directional cell continues over a face only if both elements lie rightly. [`orient`] numbers the nodes of the
//! elements anew, each by a symmetry of its reference shape that keeps the handedness of the cell in space.
//! Symmetries of the cell, and what it shows on each face in each order of the corners, follow from its
//! coefficients (`views`). A breadth-first search turns the elements of each component, then every face is
//! checked (`search`). Where no turns fit, as around an edge with three hexes, the error names these edges, or the
//! elements there hold the cell in several turns whose weights make it continue (`mixing`).
//!
//! Not promised: where a face leaves a neighbour several cells that continue equally well, only one is tried.

mod bad_edges;
mod mixing;
mod search;
mod views;

pub use search::{Aim, Directions};

use super::misfit::Misfit;
use super::mixture::Mixture;
use super::{Member, TilingError, interface};
use crate::scaffold::{ElementMap, Scaffold};
use druse_cells::cell::Cell;
use druse_geometry::field::Field;
use druse_geometry::frame::{Element, Mat3};
use search::Search;
use std::sync::Arc;
use views::Views;

/// How the elements of a scaffold were turned.
pub struct Oriented {
    /// Number of the elements whose numbering is another.
    pub turned: usize,
    /// The elements that hold the cells in several turns; without any where turns alone make them continue.
    pub mixture: Mixture,
}

/// What becomes of faces over which no turns make the cells continue.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Mismatch {
    /// They are an error.
    #[default]
    Refuse,
    /// The elements at their nodes hold the cells in several turns.
    Blend {
        /// The width of the layer beside these faces in which they do, as a share of an element: above 0, at most 1.
        /// Without it the shares of turns change evenly over the whole element.
        width: Option<f64>,
    },
}

/// Turns the elements of a scaffold so that the cells of all members continue over its faces; `None` if nothing
/// needs a turn. With directions, also elements in which the cells continue already are turned. A scaffold that others
/// share is copied first; after an error it is as it was.
///
/// # Errors
/// [`TilingError::Misfit`] where no turns fit and nothing is blended.
pub fn orient(
    scaffold: &mut Arc<Scaffold>,
    members: &[Member<Cell>],
    aim: &Aim,
    mismatch: Mismatch,
) -> Result<Option<Oriented>, TilingError> {
    let cells = || members.iter().flat_map(|m| m.cells.iter());
    if cells().all(|c| c.fits_any_numbering() && c.element().dimension() == 3) {
        return Ok(None);
    }
    if !matches!(aim, Aim::Directions(_)) && continues(scaffold, members) {
        return Ok(None);
    }
    // The tiling itself refuses cells without a slope, and shapes that no cell fills.
    let has_slope = |c: &&Cell| c.gamma().is_finite() && c.gamma() > 0.0;
    let shapes = scaffold.shapes();
    let fill = |m: &Member<Cell>| shapes.iter().all(|s| m.of(*s).is_some());
    if !cells().all(has_slope) || !members.iter().all(fill) {
        return Ok(None);
    }
    let views = Views::new(&shapes, members);
    // Cells that no turn changes are as they are; the tiling itself refuses them.
    if shapes.iter().all(|s| views.shape(*s).has_one_class()) {
        return Ok(None);
    }
    let search = Search::new(scaffold, &views);
    let found = search.run(aim);
    let identity = Mat3::identity();
    let turn = |e: usize, shape: Element| {
        let matrix = &views.shape(shape).turns[usize::from(found.turns[e])].matrix;
        ((matrix - identity).norm_squared() > 1e-9).then_some(matrix)
    };
    let is_turned = |e: &ElementMap| turn(e.index(), e.shape()).is_some();
    let turned = scaffold.elements().filter(is_turned).count();
    if turned == 0 && found.bad.is_empty() {
        return Ok(None);
    }
    let mut mixture = Mixture::default();
    if let Some(&first) = found.bad.first() {
        let width = match mismatch {
            Mismatch::Blend { width } => width,
            Mismatch::Refuse => None,
        };
        let mixed = mixing::mixture(&search, &found.bad, &found.turns, width);
        match (mixed, mismatch) {
            (Some(mixed), Mismatch::Blend { .. }) => mixture = mixed,
            (mixed, _) => {
                let edges = bad_edges::bad_edges(&search, &found.bad, &found.turns);
                let face = search.face(first);
                let elements = face.map_or([first.element; 2], |f| f.elements);
                return Err(TilingError::Misfit(Box::new(Misfit {
                    lines: bad_edges::line_count(&edges),
                    edges,
                    faces: found.bad.len(),
                    elements: elements.map(|e| scaffold.number(e as usize)),
                    can_blend: mixed.is_some(),
                })));
            }
        }
    }
    Arc::make_mut(scaffold).turn(turn);
    Ok(Some(Oriented { turned, mixture }))
}

/// Whether cells continue over all faces as the elements are numbered.
fn continues(scaffold: &Scaffold, members: &[Member<Cell>]) -> bool {
    members.iter().all(|member| {
        let slope = member.cells.first().map_or(1.0, |c| c.gamma());
        let value = |shape, xi| member.of(shape).map_or(0.0, |c| Field::value(c, xi));
        interface::check(scaffold, &value, slope).is_ok()
    })
}

#[cfg(test)]
mod tests;
