//! Frames of elements: how a homogenised cell lies in each, and how far the element stretches it.
//!
//! The derivative of a hexahedron's map at its centre is a rotation times a stretch (polar decomposition). The
//! rotation turns the law. A tetrahedron is compared with the tet of a packing in all numberings of its vertices;
//! the numbering with the least stretch gives the rotation. Laws are invariant under inversion, so that mirror
//! images count as rotations.

use crate::frame::{Element, Mat3, Vec3};
use crate::homogenize::Packing;
use crate::scaffold::{ElementMap, Scaffold};

/// Rotation and stretch of one element.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct ElementFrame {
    /// The rotation from the period's axes to the world's.
    pub rotation: Mat3,
    /// The stretch, of determinant 1, in the period's axes.
    pub stretch: Mat3,
}

impl ElementFrame {
    /// The polar decomposition of a map, R S = U V^T V diag(s) V^T; `None` where the decomposition fails.
    fn of_map(map: Mat3) -> Option<Self> {
        let svd = map.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let rotation = u * v_t;
        // A mirror image times -1 is a rotation.
        let rotation = rotation * rotation.determinant().signum();
        let size = libm::cbrt(svd.singular_values.product());
        let stretch = v_t.transpose() * Mat3::from_diagonal(&(svd.singular_values / size)) * v_t;
        Some(Self { rotation, stretch })
    }

    /// Greatest over least stretch of a direction.
    fn ratio(&self) -> f64 {
        let values = self.stretch.singular_values();
        values.max() / values.min()
    }

    /// The same relative to a period whose edges are in the ratio of `aspect`.
    pub fn ratio_beside(&self, aspect: [f64; 3]) -> f64 {
        let inverse = Mat3::from_diagonal(&Vec3::from(aspect).map(|a| 1.0 / a));
        let values = (self.stretch * inverse).singular_values();
        values.max() / values.min()
    }
}

/// The frame of a hexahedron, at its centre.
fn of_hex(element: &ElementMap) -> Option<ElementFrame> {
    ElementFrame::of_map(element.jacobian(element.shape().centroid()))
}

/// The frame of a tetrahedron beside the tet of a packing, in the numbering of its vertices with the least stretch.
fn of_tet(element: &ElementMap, packing: Packing) -> Option<ElementFrame> {
    let jacobian = element.jacobian(element.shape().centroid());
    let own: Vec<Vec3> = Element::Tet
        .vertices()
        .into_iter()
        .map(|v| jacobian * v)
        .collect();
    let edges = |v: [Vec3; 4]| Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
    let back = edges(packing.tet()).try_inverse()?;
    let mut best: Option<ElementFrame> = None;
    for n in 0..256usize {
        // Two bits of n per vertex; the 24 permutations among the 256 numbers are used.
        let order = [n & 3, (n >> 2) & 3, (n >> 4) & 3, n >> 6];
        let is_permutation = (0..4).all(|v| order.contains(&v));
        if !is_permutation {
            continue;
        }
        let found = ElementFrame::of_map(edges(order.map(|v| own[v])) * back);
        let Some(found) = found else { continue };
        // Equivalent numberings differ by rounding; the first of them stays.
        if best.is_none_or(|b| found.ratio() < b.ratio() * (1.0 - 1e-9)) {
            best = Some(found);
        }
    }
    best
}

/// The frames of all elements, and the packing whose tets are most like those of the scaffold. Wedges and
/// pyramids have none.
pub(in super::super) fn frames(scaffold: &Scaffold) -> (Vec<Option<ElementFrame>>, Packing) {
    let with = |packing: Packing| -> Vec<Option<ElementFrame>> {
        let frame = |e: ElementMap| match e.shape() {
            Element::Hex => of_hex(&e),
            Element::Tet => of_tet(&e, packing),
            _ => None,
        };
        scaffold.elements().map(frame).collect()
    };
    let misfit = |all: &[Option<ElementFrame>]| -> f64 {
        let own = all.iter().zip(scaffold.elements());
        own.map(|(f, e)| f.map_or(0.0, |f| f.ratio().ln() * e.volume().abs()))
            .sum()
    };
    let bcc = with(Packing::Bcc);
    if !scaffold.shapes().contains(&Element::Tet) {
        return (bcc, Packing::Bcc);
    }
    let kuhn = with(Packing::Kuhn);
    if misfit(&kuhn) < misfit(&bcc) {
        (kuhn, Packing::Kuhn)
    } else {
        (bcc, Packing::Bcc)
    }
}

/// The geometric mean ratio of the edges of elements along x, y, z of the period, weighted by volume, of product 1: of
/// the diagonals of their stretches, which are the edges for bricks. `all` are frames with volumes.
pub(in super::super) fn mean_aspect<'a>(
    all: impl Iterator<Item = (&'a ElementFrame, f64)>,
) -> [f64; 3] {
    let (mut sum, mut weight) = (Vec3::zeros(), 0.0);
    for (frame, volume) in all {
        let log_stretch = Vec3::from_fn(|a, _| frame.stretch[(a, a)].ln());
        sum += log_stretch * volume;
        weight += volume;
    }
    let mean = sum / weight;
    let centre = mean.sum() / 3.0;
    // Rounded, so that equal elements have one aspect of 1.
    std::array::from_fn(|a| ((mean[a] - centre).exp() * 1e9).round() / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaffold::Kind;

    #[test]
    fn bricks_and_equal_tets_are_turned_without_stretch() {
        let size = Vec3::new(2.0, 2.0, 1.0);
        let bricks = Scaffold::box_grid(size, [2, 2, 2], Kind::Hex8).unwrap();
        let (all, _) = frames(&bricks);
        let frame = all[0].unwrap();
        assert!((frame.rotation - Mat3::identity()).amax() < 1e-12);
        let aspect = mean_aspect(all.iter().flatten().map(|f| (f, 1.0)));
        assert!((aspect[0] / aspect[2] - 2.0).abs() < 1e-6);
        assert!(frame.ratio_beside(aspect) < 1.0 + 1e-6);
        let tets = Scaffold::box_grid(Vec3::repeat(1.0), [2, 2, 2], Kind::Tet4).unwrap();
        let (all, packing) = frames(&tets);
        assert_eq!(packing, Packing::Kuhn);
        for frame in all {
            let frame = frame.unwrap();
            assert!(frame.ratio() < 1.0 + 1e-6, "{}", frame.ratio());
            assert!((frame.rotation.determinant() - 1.0).abs() < 1e-9);
            // Rotations of the packing keep its diagonal.
            let turned = frame.rotation * Vec3::repeat(1.0);
            assert!((turned.x.abs() - 1.0).abs() < 1e-6 && (turned.x - turned.y).abs() < 1e-6);
        }
    }
}
