//! The displacement of a cell's surface when a table replaces the cell, measured at sample points.
//!
//! At points spread over the element, the difference of table and cell is divided by the mean slope: a grading, a blend
//! or an offset may put the surface anywhere. At points of the cell's own surface, the difference is divided by the
//! local slope. At other points of the surface the law `tables_displace_the_surface_by_at_most_the_tolerance` allows
//! 1.25 of the tolerance, half of it in the root mean square.

use super::{Cell, Table};
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Vec3};
use rayon::prelude::*;

/// Maximal number of points in the element, and of points on the surface.
const MAX_POINTS: usize = 1024;
/// Maximal number of evaluated exponentials; cells of many exponentials get fewer points.
const MAX_EXPONENTIALS: usize = 20_000_000;
/// Minimal number of points.
const MIN_POINTS: usize = 128;
/// Newton steps towards the surface.
const NEWTON_STEPS: usize = 6;
/// Largest accepted distance of a surface point from the surface, in reference lengths: the value divided by the
/// mean slope.
const FOOT_TOLERANCE: f64 = 1e-3;
/// Smallest slope, relative to the mean, by which a difference is divided. Where the surface intersects
/// itself the slope vanishes and a displacement is undefined.
const MIN_RELATIVE_SLOPE: f64 = 0.25;
/// Steps of a low-discrepancy sequence by axis: 1/x, 1/x^2 and 1/x^3, where x^4 = x + 1.
const SEQUENCE_STEPS: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_2,
];

/// Sample points at which tables are compared with their cell.
pub(super) struct DisplacementProbe {
    points: Vec<SamplePoint>,
}

struct SamplePoint {
    position: CellPoint<3>,
    /// The value of the cell.
    value: f64,
    /// The divisor of differences.
    slope: f64,
}

/// Points are the same for every table of the cell, so that tables compare.
impl DisplacementProbe {
    /// Sample points for a cell; `table` is any table of the cell and serves to find surface points.
    pub fn new(cell: &Cell, table: &Table) -> Self {
        let count = (MAX_EXPONENTIALS / cell.expression().exponentials().max(1))
            .clamp(MIN_POINTS, MAX_POINTS);
        let element = cell.element();
        let around = element.cell_box();
        let inside = |p: Vec3| element.face_distance(CellPoint(p)) <= 0.0;
        // Points of an additive sequence, which fills the box evenly at any number of points.
        let spread = |n: usize| {
            let t = Vec3::from(SEQUENCE_STEPS).map(|s| (0.5 + s * n as f64).fract());
            around.min + (around.max - around.min).component_mul(&t)
        };
        // Elements fill at least a third of their bounding boxes, so 8 times `count` candidates suffice.
        let points: Vec<Vec3> = (1..)
            .map(spread)
            .take(8 * count)
            .filter(|p| inside(*p))
            .take(count)
            .collect();
        let mean = cell.gamma();
        let points = points.into_par_iter().flat_map_iter(|p| {
            let within = SamplePoint {
                position: CellPoint(p),
                value: cell.value(CellPoint(p)),
                slope: mean,
            };
            let foot = foot(table, p, mean).filter(|p| inside(*p)).map(|foot| {
                let (value, gradient) = cell.value_and_gradient(CellPoint(foot));
                SamplePoint {
                    position: CellPoint(foot),
                    value,
                    slope: gradient.norm().max(MIN_RELATIVE_SLOPE * mean),
                }
            });
            [Some(within), foot].into_iter().flatten()
        });
        Self {
            points: points.collect(),
        }
    }

    /// The largest displacement by a table, in reference lengths.
    pub fn displacement(&self, table: &Table) -> f64 {
        let displacement = |p: &SamplePoint| (table.value(p.position) - p.value).abs() / p.slope;
        self.points.iter().map(displacement).fold(0.0, f64::max)
    }
}

/// The surface point that Newton steps along the gradient reach from `p`, if they converge.
/// In reference coordinates; `mean` is the mean slope of the cell. The result may lie outside the element. `None` if
/// the last value is still more than 1e-3 reference lengths times the mean slope from 0.
fn foot(table: &Table, mut p: Vec3, mean: f64) -> Option<Vec3> {
    for _ in 0..NEWTON_STEPS {
        let (v, g) = table.value_and_gradient(CellPoint(p));
        p -= g * (v / g.norm_squared().max(f64::MIN_POSITIVE));
    }
    let residual = table.value(CellPoint(p)).abs();
    (residual <= FOOT_TOLERANCE * mean).then_some(p)
}
