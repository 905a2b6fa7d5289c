//! From a target to a cell: oracles, gradients, bounds, designs, refusals.

mod designs;
mod gradients;
mod openings;
mod oracles;
mod refusals;
mod widths;

use druse::frame::Element;
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
