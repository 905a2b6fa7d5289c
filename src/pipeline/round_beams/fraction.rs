//! The diameter at which round beams fill a share of the scaffold.
//!
//! With equal diameters a point lies in the solid if its distance to the nearest axis is less than half of
//! them, so the diameter is twice a percentile of those distances over the scaffold. They are measured at
//! points of a low-discrepancy sequence in every element, each with the volume that it stands for; the share
//! that comes out is right to about one part in a thousand.

use crate::beams::Beams;
use crate::field::Field;
use crate::frame::{Aabb, CellPoint, Vec3};
use crate::scaffold::Scaffold;
use rayon::prelude::*;

/// Points over the scaffold, and fewest in an element.
const POINTS: usize = 1 << 17;
const POINTS_PER_ELEMENT: usize = 8;
/// Powers of the reciprocal of the root of x^4 = x + 1: steps of the sequence along each axis.
const STEPS: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_3,
];

/// The diameter at which beams and plates fill a share of the scaffold's volume; `None` if they have no points.
/// `beams` have the diameter `own` throughout.
pub(super) fn diameter_for_fraction(
    beams: &Beams,
    own: f64,
    scaffold: &Scaffold,
    fraction: f64,
) -> Option<f64> {
    let each = (POINTS / scaffold.len().max(1)).max(POINTS_PER_ELEMENT);
    let of_element = |index: usize| {
        let element = scaffold.element(index);
        let shape = element.shape();
        let region = Aabb::of(shape.vertices());
        (0..each).filter_map(move |n| {
            let number = (index * each + n + 1) as f64;
            let part = Vec3::from(STEPS.map(|s| (number * s).fract()));
            let xi = CellPoint(region.min + region.size().component_mul(&part));
            (shape.face_distance(xi) <= 0.0).then(|| {
                let (place, jacobian) = element.map_and_jacobian(xi);
                let to_axis = beams.value(place) + own / 2.0;
                (to_axis, jacobian.determinant().abs())
            })
        })
    };
    let elements = (0..scaffold.len()).into_par_iter();
    let mut found: Vec<(f64, f64)> = elements.flat_map_iter(of_element).collect();
    found.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // Elements of one shape have as many points each, up to the sequence's noise.
    let total: f64 = found.iter().map(|f| f.1).sum();
    let mut sum = 0.0;
    let mut last = None;
    for (distance, volume) in found {
        sum += volume;
        last = Some(2.0 * distance);
        if sum >= fraction * total {
            break;
        }
    }
    last
}
