//! Contacts: samples on a plane where solids touch.
//!
//! A closed solid contains its surface, so solids that share a face are connected. If the shared face lies on a plane
//! of samples, the minimum of their distances is 0 there, and 0 counts as outside: the face would separate the solids.
//! The six neighbours distinguish such a sample from one on a real surface: both ends of an axis lie inside, and the
//! sign changes on no axis. The sample takes the value of the shallower neighbour, as if the shared face did not exist.
//! The same holds with the signs exchanged, for a void that touches itself: a film without thickness is not solid.
//!
//! A single face on a plane of samples, and a gap of one sample or more, stay unchanged.
// Small functions of hot paths, inlined so that they are compiled for the target features of the caller.
#![allow(clippy::inline_always)]

use crate::simd::{self, Lanes, SimdKernel};

/// Largest magnitude of a contact value, in sample steps: coordinates of input files are rounded to single precision.
pub const CONTACT_TOLERANCE: f32 = 1e-4;
/// Smallest depth of the neighbours on both sides of a contact, in steps: far above rounding, below the 1 at a face.
const MIN_DEPTH: f32 = 0.02;
/// A surface has an axis along which the neighbours differ in sign, each by at least this, in steps. A unit normal has
/// a component of at least 0.58; the rest is left to fields that are only nearly distances.
const MIN_SLOPE: f32 = 0.25;

/// The new value of a sample near 0 that lies on a contact, from the neighbours below and above along each axis at
/// distance `step`; `None` if there is no contact. Values and `step` have one unit; the sample itself is within
/// [`CONTACT_TOLERANCE`] steps of 0, which the caller has tested.
pub fn contact_value(neighbours: [[f32; 2]; 3], step: f32) -> Option<f32> {
    let mut found: Option<f32> = None;
    for [below, above] in neighbours {
        let (low, high) = (below.min(above), below.max(above));
        if low < -MIN_SLOPE * step && high > MIN_SLOPE * step {
            return None;
        }
        let value = if high < -MIN_DEPTH * step {
            high
        } else if low > MIN_DEPTH * step {
            low
        } else {
            continue;
        };
        found = match found {
            // Opposite signs on two axes: a saddle of the surface.
            Some(other) if (other < 0.0) != (value < 0.0) => return None,
            Some(other) if other.abs() >= value.abs() => found,
            _ => Some(value),
        };
    }
    found
}

/// The contacts of a leaf of 8^3 samples, as ascending offsets (z fastest) with new values. `layer` gives the 8^2
/// samples next to the leaf along an axis, below (0) or above (1) it, the last axis fastest. It is called only where a
/// contact is possible. `step` is the distance of the samples, world units. The leaf itself does not change; the caller
/// replaces the values.
pub fn leaf_contacts(
    values: &[f32; 512],
    step: f32,
    mut layer: impl FnMut(usize, usize) -> [f32; 64],
) -> Vec<(usize, f32)> {
    let near = simd::run(NearZero {
        values,
        tolerance: CONTACT_TOLERANCE * step,
    });
    // A contact is a sample near 0 in a plane of samples; most leaves have none.
    if near == [0; 8] {
        return Vec::new();
    }
    // A layer beside the leaf is evaluated at most once, and only for samples that need it.
    let mut layers: [Option<[f32; 64]>; 6] = [None; 6];
    let mut found = Vec::new();
    for (x, word) in near.into_iter().enumerate() {
        let mut bits = word;
        while bits != 0 {
            let n = 64 * x + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let index = [n >> 6, n >> 3 & 7, n & 7];
            // Axes with both neighbours in the leaf suffice for most samples on a surface.
            let mut neighbours = [[0.0; 2]; 3];
            for axis in (0..3).filter(|&a| (1..7).contains(&index[a])) {
                let stride = 64 >> (3 * axis);
                neighbours[axis] = [values[n - stride], values[n + stride]];
            }
            let is_inner = index.iter().all(|c| (1..7).contains(c));
            // Opposite signs across an axis: an ordinary surface, no contact.
            let is_surface = neighbours
                .iter()
                .any(|[a, b]| a.min(*b) < -MIN_SLOPE * step && a.max(*b) > MIN_SLOPE * step);
            if is_surface {
                continue;
            }
            if !is_inner {
                for axis in (0..3).filter(|&a| !(1..7).contains(&index[a])) {
                    let stride = 64 >> (3 * axis);
                    let (side, own) = match index[axis] {
                        0 => (0, values[n + stride]),
                        _ => (1, values[n - stride]),
                    };
                    // This axis has neither a contact nor a change of sign.
                    if own.abs() <= MIN_DEPTH * step {
                        continue;
                    }
                    let across = match axis {
                        0 => 8 * index[1] + index[2],
                        1 => 8 * index[0] + index[2],
                        _ => 8 * index[0] + index[1],
                    };
                    let slot = &mut layers[2 * axis + side];
                    let beyond = slot.get_or_insert_with(|| layer(axis, side))[across];
                    neighbours[axis] = [beyond, own];
                }
            }
            if let Some(value) = contact_value(neighbours, step) {
                found.push((n, value));
            }
        }
    }
    found
}

/// A bit for each value within a tolerance of 0, in the layout of a leaf mask.
struct NearZero<'a> {
    values: &'a [f32; 512],
    tolerance: f32,
}

impl SimdKernel for NearZero<'_> {
    type Output = [u64; 8];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [u64; 8] {
        let tolerance = l.splat(self.tolerance);
        let rows = self.values.as_chunks::<8>().0;
        let mut near = [0; 8];
        for (word, slab) in near.iter_mut().zip(rows.as_chunks::<8>().0) {
            let mut bytes = [0; 8];
            for (byte, row) in bytes.iter_mut().zip(slab) {
                *byte = l.below(l.magnitude(l.load(row)), tolerance);
            }
            *word = u64::from_le_bytes(bytes);
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_differ_from_surfaces_gaps_and_saddles() {
        let inner = [0.0, 0.0];
        assert_eq!(contact_value([inner, inner, [-1.0, -0.7]], 1.0), Some(-0.7));
        assert_eq!(contact_value([inner, inner, [1.0, 0.7]], 1.0), Some(0.7));
        // A face, the edge of a box, and one side of a gap of one step.
        assert_eq!(contact_value([inner, inner, [-1.0, 1.0]], 1.0), None);
        assert_eq!(contact_value([[-1.0, 1.0], inner, inner], 1.0), None);
        assert_eq!(contact_value([inner, inner, [-1.0, 0.0]], 1.0), None);
        // The wall of a cylindrical hole, which curves towards the solid.
        let bent = [-0.1, -0.1];
        assert_eq!(contact_value([bent, inner, [-1.0, 1.0]], 1.0), None);
        assert_eq!(contact_value([[-0.3, -0.3], [0.3, 0.3], inner], 1.0), None);
    }

    #[test]
    fn contacts_are_found_inside_and_on_the_sides_of_a_leaf() {
        for plane in 0..8 {
            let depth = |z: usize| -(z as f32 - plane as f32).abs();
            let values = std::array::from_fn(|n| depth(n & 7));
            let layer = |axis: usize, side: usize| match axis {
                2 => {
                    [if side == 0 {
                        depth(0) - 1.0
                    } else {
                        depth(7) - 1.0
                    }; 64]
                }
                _ => std::array::from_fn(|n| depth(n & 7)),
            };
            let found = leaf_contacts(&values, 1.0, layer);
            assert_eq!(found.len(), 64, "{plane}");
            assert!(found.iter().all(|&(n, v)| n & 7 == plane && v == -1.0));
        }
    }
}
