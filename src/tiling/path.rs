//! Whether a solid stays connected while one cell becomes another.
//!
//! A blend with the same weights everywhere is looked at in one element: its solid voxels fall into
//! pieces, and pieces that a symmetry of the cell takes to each other count as one, because through
//! the faces the structure goes on in symmetric copies. It is connected if one such class touches the
//! faces; what touches none is loose.

use super::blend::Blend;
use super::source::CellField;
use crate::frame::{CellPoint, Element, Mat3, Vec3};

/// Voxels along an edge of the element's box.
const VOXELS: usize = 24;
/// Weights tried between the cells, their own included.
const WEIGHTS: usize = 9;

/// What [`check_path`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathCheck {
    /// Connected at every weight tried, or no less than its ends are.
    Connected,
    /// Not connected at this weight of the second cell.
    Broken {
        /// The first weight at which it is not.
        weight: f64,
    },
}

/// Follows the blend of cells `from` and `to` of a palette in one element. `operators` are the
/// symmetries that the cells share.
pub fn check_path<C: CellField>(
    blend: &Blend<C>,
    shape: Element,
    operators: &[Mat3],
    from: usize,
    to: usize,
) -> PathCheck {
    let count = blend.members().len();
    let classes = |w: f64| {
        let mut weights = vec![0.0; count];
        weights[from] = 1.0 - w;
        weights[to] = w;
        let solid = |p| blend.uniform(shape, &weights, p) < 0.0;
        touching_classes(shape, operators, solid)
    };
    let ends = [classes(0.0), classes(1.0)];
    // Cells of several pieces may stay so.
    let most = ends[0].max(ends[1]).max(1);
    for i in 1..WEIGHTS - 1 {
        let weight = i as f64 / (WEIGHTS - 1) as f64;
        let found = classes(weight);
        let vanished = found == 0 && ends.iter().all(|e| *e > 0);
        if vanished || found > most {
            return PathCheck::Broken { weight };
        }
    }
    PathCheck::Connected
}

/// The least member of a set.
fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

/// Classes of pieces that touch the element's faces.
pub(super) fn touching_classes(
    shape: Element,
    operators: &[Mat3],
    solid: impl Fn(CellPoint<3>) -> bool,
) -> usize {
    let hull = shape.cell_box();
    let size = (hull.max - hull.min) / VOXELS as f64;
    let place =
        |i: usize| -> [usize; 3] { [i / (VOXELS * VOXELS), i / VOXELS % VOXELS, i % VOXELS] };
    let centre = |i: usize| {
        let at = Vec3::from(place(i).map(|c| c as f64 + 0.5));
        hull.min + size.component_mul(&at)
    };
    let total = VOXELS.pow(3);
    let near = size.amax() * 1.01;
    let mut is_solid = vec![false; total];
    let mut touches = vec![false; total];
    for i in 0..total {
        let p = centre(i);
        let d = shape.face_distance(CellPoint(p));
        if d <= 0.0 {
            is_solid[i] = solid(CellPoint(p));
            touches[i] = d > -near;
        }
    }
    let mut parent: Vec<u32> = (0..total as u32).collect();
    let join = |a: usize, b: usize, parent: &mut Vec<u32>| {
        let (a, b) = (root(parent, a as u32), root(parent, b as u32));
        parent[a.max(b) as usize] = a.min(b);
    };
    for i in (0..total).filter(|&i| is_solid[i]) {
        let at = place(i);
        for (axis, stride) in [VOXELS * VOXELS, VOXELS, 1].into_iter().enumerate() {
            if at[axis] + 1 < VOXELS && is_solid[i + stride] {
                join(i, i + stride, &mut parent);
            }
        }
        for m in operators {
            let image = (m * centre(i) - hull.min).component_div(&size);
            let cell = [image.x, image.y, image.z].map(f64::floor);
            if cell.iter().all(|c| (0.0..VOXELS as f64).contains(c)) {
                let [x, y, z] = cell.map(|c| c as usize);
                let other = (x * VOXELS + y) * VOXELS + z;
                if is_solid[other] {
                    join(i, other, &mut parent);
                }
            }
        }
    }
    let mut classes: Vec<u32> = (0..total)
        .filter(|&i| is_solid[i] && touches[i])
        .map(|i| root(&mut parent, i as u32))
        .collect();
    classes.sort_unstable();
    classes.dedup();
    classes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_counted_up_to_symmetry() {
        let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let identity = Mat3::identity();
        let count = |solid: &dyn Fn(Vec3) -> bool, operators: &[Mat3]| {
            touching_classes(Element::Hex, operators, |p| solid(p.0))
        };
        // A rod through the cell, a ball within it, two rods, nothing.
        let rod = |p: Vec3| p.x.hypot(p.y) < 0.2;
        assert_eq!(count(&rod, &[identity]), 1);
        assert_eq!(count(&|p: Vec3| p.norm() < 0.3, &[identity]), 0);
        let rods = |p: Vec3| (p.x.abs() - 0.3).hypot(p.y) < 0.1;
        assert_eq!(count(&rods, &[identity]), 2);
        assert_eq!(count(&rods, &[identity, mirror]), 1);
        assert_eq!(count(&|_| false, &[identity]), 0);
    }
}
