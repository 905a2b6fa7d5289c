//! The diameter at which round beams have a target volume fraction.
//!
//! With equal diameters a point is in the solid if its distance to the nearest axis is less than half
//! the diameter. So the diameter is twice a percentile of these distances over the scaffold. The
//! distances are sampled at points of a low-discrepancy sequence in every element, each weighted by its
//! volume. The resulting fraction is accurate to about one part in a thousand.

use crate::beams::Beams;
use crate::field::Field;
use crate::frame::{Aabb, CellPoint, Vec3};
use crate::scaffold::Scaffold;
use rayon::prelude::*;

/// Number of points over the scaffold, and minimum in an element.
const TOTAL_POINTS: usize = 1 << 17;
const MIN_POINTS_PER_ELEMENT: usize = 8;
/// Steps of the sequence along each axis: powers of the reciprocal of the root of x^4 = x + 1.
const STEPS: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_3,
];

/// The diameter, world units, at which beams and plates fill a fraction (0 to 1) of the scaffold's volume; `None`
/// if there are no points. `beams` all have the diameter `trial_diameter`, from which distances to their axes
/// follow.
pub(super) fn diameter_for_fraction(
    beams: &Beams,
    trial_diameter: f64,
    scaffold: &Scaffold,
    fraction: f64,
) -> Option<f64> {
    let points_per_element = (TOTAL_POINTS / scaffold.len().max(1)).max(MIN_POINTS_PER_ELEMENT);
    let of_element = |index: usize| {
        let element = scaffold.element(index);
        let shape = element.shape();
        let region = Aabb::of(shape.vertices());
        // Every box holds as many points, so that one stands for a volume |det J| |box| / points; boxes of wedges and
        // pyramids are smaller than those of hexes.
        let box_volume = region.size().product();
        (0..points_per_element).filter_map(move |n| {
            let number = (index * points_per_element + n + 1) as f64;
            let part = Vec3::from(STEPS.map(|s| (number * s).fract()));
            let xi = CellPoint(region.min + region.size().component_mul(&part));
            // Points of the box outside the element are dropped.
            (shape.face_distance(xi) <= 0.0).then(|| {
                let (place, jacobian) = element.map_and_jacobian(xi);
                let to_axis = beams.value(place) + trial_diameter / 2.0;
                (to_axis, jacobian.determinant().abs() * box_volume)
            })
        })
    };
    let elements = (0..scaffold.len()).into_par_iter();
    let mut distances: Vec<(f64, f64)> = elements.flat_map_iter(of_element).collect();
    distances.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let total: f64 = distances.iter().map(|f| f.1).sum();
    let mut sum = 0.0;
    let mut diameter = None;
    for (distance, volume) in distances {
        sum += volume;
        diameter = Some(2.0 * distance);
        if sum >= fraction * total {
            break;
        }
    }
    diameter
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::Beam;
    use crate::scaffold::{Connectivity, Kind};

    /// A beam in a cube beside another cube of two wedges: pi d^2 / 4 is its share of both.
    #[test]
    fn elements_of_all_shapes_count_by_their_volumes() {
        let nodes = (0..12u8)
            .map(|n| Vec3::new(f64::from(n % 3), f64::from(n / 3 % 2), f64::from(n / 6)))
            .collect();
        let mut elements = Connectivity::default();
        elements.push(Kind::Hex8, &[0, 1, 4, 3, 6, 7, 10, 9]);
        elements.push(Kind::Wedge6, &[1, 2, 5, 7, 8, 11]);
        elements.push(Kind::Wedge6, &[1, 5, 4, 7, 11, 10]);
        let scaffold = Scaffold::new(nodes, elements).unwrap();
        let trial = 1e-6;
        let beam = Beam {
            ends: [Vec3::new(0.5, 0.5, -1.0), Vec3::new(0.5, 0.5, 2.0)],
            radii: [trial / 2.0; 2],
        };
        let beams = Beams::new(&[beam], &[]).unwrap();
        let diameter = diameter_for_fraction(&beams, trial, &scaffold, 0.05).unwrap();
        let expected = (4.0 * 0.05 * 2.0 / std::f64::consts::PI).sqrt();
        assert!(
            (diameter / expected - 1.0).abs() < 3e-3,
            "{diameter} {expected}"
        );
    }
}
