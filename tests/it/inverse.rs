//! From a target to a cell: oracles, gradients, bounds, designs, refusals.

mod designs;
mod gradients;
mod openings;
mod oracles;
mod refusals;
mod widths;

use druse::frame::{CellPoint, Element};
use druse::inverse::{Design, Property, Target};

/// A target that maximises one property.
fn largest(property: Property) -> Target {
    Target {
        maximise: Some(property),
        ..Target::default()
    }
}

/// A design that takes a second or two.
fn short(target: Target, fraction: f64) -> Design {
    Design {
        band_limit: 3.0,
        voxels: 12,
        starts: 2,
        evaluations: 20,
        ..Design::new("short", Element::Hex, target, fraction)
    }
}

/// The point of the reference element at a place of the period; of twelve tets around its centre the map turns long edges
/// of 1 into sqrt(2) and the half between two opposite ones into 1.
fn in_element(element: Element, p: [f64; 3]) -> CellPoint<3> {
    let mut sizes = p.map(f64::abs);
    sizes.sort_by(f64::total_cmp);
    let [c, b, a] = sizes;
    let of_tet = [0.5 - 2.0 * b, 0.5 - a - c, 0.5 - a + c];
    CellPoint(if element == Element::Tet { of_tet } else { p }.into())
}
