//! Periodic scaffolds of equal tets.
//!
//! A packing fills the unit cube around the origin and repeats with period 1 along each axis. Points are mapped into
//! the tet that contains them by sorting coordinates, without a search.

use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};

/// A periodic scaffold of tets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// Twelve equal tets in a cube, between its corners and the centres of cubes.
    #[default]
    Bcc,
    /// Six tets in a cube, around its diagonal.
    Kuhn,
}

impl Packing {
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bcc => "bcc",
            Self::Kuhn => "kuhn",
        }
    }

    /// One tet of the packing; the others are its images under the packing's symmetry.
    #[doc(hidden)]
    pub fn tet(self) -> [Vec3; 4] {
        self.tets()[0]
    }

    /// The tets of one period around the origin, by their vertices.
    pub(super) fn tets(self) -> Vec<[Vec3; 4]> {
        let e = |a: usize| Vec3::ith(a, 1.0);
        let mut all = Vec::new();
        // The three axes with both orders of the other two: six choices for each packing.
        for a in 0..3 {
            for (b, c) in [((a + 1) % 3, (a + 2) % 3), ((a + 2) % 3, (a + 1) % 3)] {
                match self {
                    Self::Bcc => {
                        // About the line from the cube's centre 0 to the next centre e_a: one tet for each of
                        // the four edges of the face between them.
                        for sign in [-1.0, 1.0] {
                            let side = e(a) + e(b) * sign;
                            all.push([
                                Vec3::zeros(),
                                e(a),
                                (side - e(c)) / 2.0,
                                (side + e(c)) / 2.0,
                            ]);
                        }
                    }
                    Self::Kuhn => {
                        // A tet per path along three edges of the cube, all around the diagonal from corner to corner.
                        let first = Vec3::repeat(-0.5);
                        let steps = [e(a), e(b), e(c)];
                        let second = first + steps[0];
                        all.push([first, second, second + steps[1], Vec3::repeat(0.5)]);
                    }
                }
            }
        }
        all
    }

    /// Barycentric coordinates of a point of the cube around the origin (each coordinate within 1/2) in the tet that
    /// contains it. Their order follows the sorted coordinates, so that it serves only cells that do not depend on the
    /// numbering of the vertices.
    pub(super) fn barycentric(self, p: Vec3) -> [f64; 4] {
        match self {
            Self::Bcc => {
                // By symmetry the point lies in the tet of (0, 0, 0) and (1, 0, 0) with a >= b >= c.
                let mut d = [p.x.abs(), p.y.abs(), p.z.abs()];
                d.sort_by(f64::total_cmp);
                let [c, b, a] = d;
                [1.0 - a - b, a - b, b - c, b + c]
            }
            Self::Kuhn => {
                // From the corner (-1/2, -1/2, -1/2): the tet of the order of the coordinates.
                let mut d = [p.x + 0.5, p.y + 0.5, p.z + 0.5];
                d.sort_by(f64::total_cmp);
                let [c, b, a] = d;
                [1.0 - a, a - b, b - c, c]
            }
        }
    }

    /// The reference point of the tet at a point of the cube around the origin.
    pub(crate) fn reference(self, p: Vec3) -> CellPoint<3> {
        let weights = self.barycentric(p);
        let vertices = Element::Tet.vertices();
        CellPoint((0..4).map(|i| vertices[i] * weights[i]).sum())
    }

    /// The least factor by which lengths change from the reference tet to a tet of the packing.
    pub(crate) fn shrinkage(self) -> f64 {
        self.scales()[0]
    }

    /// The map from the reference tet to one of the packing: the least factor on lengths (its smallest singular value),
    /// and the cube root of its determinant, the mean factor. The edges of the reference tet are invertible.
    pub(super) fn scales(self) -> [f64; 2] {
        let edges = |v: &[Vec3]| Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
        let reference = edges(&Element::Tet.vertices());
        let own = edges(&self.tets()[0]);
        let map = own * reference.try_inverse().unwrap_or_else(Mat3::identity);
        let least = map.singular_values().min();
        [least, map.determinant().abs().cbrt()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_packings_fill_the_cube_and_agree_with_their_barycentric_coordinates() {
        for (packing, count) in [(Packing::Bcc, 12), (Packing::Kuhn, 6)] {
            let tets = packing.tets();
            assert_eq!(tets.len(), count);
            let edges =
                |v: &[Vec3; 4]| Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
            let volume: f64 = tets
                .iter()
                .map(|t| edges(t).determinant().abs() / 6.0)
                .sum();
            assert!((volume - 1.0).abs() < 1e-12);
            for n in 0..200 {
                let t = f64::from(n) * 0.618_034;
                let p = Vec3::new(t.fract(), (t * 7.1).fract(), (t * 3.3).fract()).add_scalar(-0.5);
                let mut own = packing.barycentric(p).to_vec();
                assert!(own.iter().all(|w| *w >= -1e-12));
                // By definition: the tet, or an image of one, that holds the point.
                let mut holds = Vec::new();
                for tet in &tets {
                    for shift in 0..27 {
                        let s = [shift % 3, shift / 3 % 3, shift / 9].map(|c| f64::from(c) - 1.0);
                        let d = p - Vec3::from(s) - tet[0];
                        let w = edges(tet).try_inverse().unwrap() * d;
                        let w = [1.0 - w.sum(), w.x, w.y, w.z];
                        if w.iter().all(|w| *w > -1e-9) {
                            holds = w.to_vec();
                        }
                    }
                }
                own.sort_by(f64::total_cmp);
                holds.sort_by(f64::total_cmp);
                for (a, b) in own.iter().zip(&holds) {
                    assert!((a - b).abs() < 1e-9, "{packing:?} {p} {own:?} {holds:?}");
                }
            }
        }
    }
}
