//! How far a table displaces the surface, measured.
//!
//! At points spread over the element the difference of table and cell is divided by the mean slope: what
//! it comes to wherever a grading, a blend or an offset puts the surface. At points of the surface itself it is
//! divided by the slope there.

use super::{Cell, Table};
use crate::field::Field;
use crate::frame::{CellPoint, Vec3};
use rayon::prelude::*;

/// Points in the element, and at most as many of the surface.
const POINTS: usize = 1024;
/// Fewer where the cell has so many exponentials that together they would be more than this.
const EXPONENTIALS: usize = 20_000_000;
/// But not fewer than these.
const LEAST: usize = 128;
/// Steps towards the surface.
const STEPS: usize = 6;
/// A point that is left this far from the surface, in reference lengths by the mean slope, is none of it.
const NEAR: f64 = 1e-3;
/// Slopes below this share of the mean one count as that: where the surface meets itself it has no place
/// to be displaced from.
const FLAT: f64 = 0.25;
/// Powers of the inverse of the root of x^4 = x + 1: multiples of them are spread evenly over a box.
const SPREAD: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_2,
];

/// Where a table is compared with its cell.
pub(super) struct Probe {
    places: Vec<Place>,
}

struct Place {
    at: CellPoint<3>,
    /// The cell's.
    value: f64,
    /// What differences are divided by.
    slope: f64,
}

impl Probe {
    /// Places for a cell; `table` is one of its tables, to find the surface by.
    pub fn new(cell: &Cell, table: &Table) -> Self {
        let count = (EXPONENTIALS / cell.form().exponentials().max(1)).clamp(LEAST, POINTS);
        let element = cell.element();
        let around = element.cell_box();
        let inside = |p: Vec3| element.face_distance(CellPoint(p)) <= 0.0;
        let spread = |n: usize| {
            let t = Vec3::from(SPREAD).map(|s| (0.5 + s * n as f64).fract());
            around.min + (around.max - around.min).component_mul(&t)
        };
        // Elements fill at least a third of their boxes.
        let points: Vec<Vec3> = (1..)
            .map(spread)
            .take(8 * count)
            .filter(|p| inside(*p))
            .take(count)
            .collect();
        let mean = cell.gamma();
        let places = points.into_par_iter().flat_map_iter(|p| {
            let within = Place {
                at: CellPoint(p),
                value: cell.value(CellPoint(p)),
                slope: mean,
            };
            let foot = foot(table, p, mean).filter(|p| inside(*p)).map(|foot| {
                let (value, gradient) = cell.value_and_gradient(CellPoint(foot));
                Place {
                    at: CellPoint(foot),
                    value,
                    slope: gradient.norm().max(FLAT * mean),
                }
            });
            [Some(within), foot].into_iter().flatten()
        });
        Self {
            places: places.collect(),
        }
    }

    /// The greatest displacement by a table, reference lengths.
    pub fn displacement(&self, table: &Table) -> f64 {
        let off = |p: &Place| (table.value(p.at) - p.value).abs() / p.slope;
        self.places.iter().map(off).fold(0.0, f64::max)
    }
}

/// A point of a table's surface that is reached by going down its slope from a point.
fn foot(table: &Table, mut p: Vec3, mean: f64) -> Option<Vec3> {
    for _ in 0..STEPS {
        let (v, g) = table.value_and_gradient(CellPoint(p));
        p -= g * (v / g.norm_squared().max(f64::MIN_POSITIVE));
    }
    let left = table.value(CellPoint(p)).abs();
    (left <= NEAR * mean).then_some(p)
}
