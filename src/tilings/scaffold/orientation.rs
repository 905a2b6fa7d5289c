//! The sign of an element's Jacobian over the whole element, its volume and its quality.
//!
//! det J is a polynomial; the signs of its Bernstein coefficients decide, after splitting where they are mixed.

use super::bernstein::{Net, Part};
use super::element::ElementMap;
use super::kind::{Family, Kind};
use super::map::{Curved, Map};
use druse_geometry::frame::{CellPoint, Vec3};

/// The sign of det J over an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Orientation {
    /// Positive everywhere.
    Positive,
    /// Negative everywhere: harmless, the nodes are numbered in mirror order.
    Negative,
    /// Changes its sign: the element is folded.
    Folded {
        /// det dx/dr at the worst place seen, in cubic world units; r are parametric coordinates.
        determinant: f64,
        /// Where, in the cell frame.
        at: CellPoint<3>,
    },
    /// Vanishes somewhere, within 1e-12 of the element's size cubed, or has no sign that could be proved.
    Degenerate {
        /// det dx/dr there.
        determinant: f64,
        /// Where, in the cell frame.
        at: CellPoint<3>,
    },
}

/// det dx/dr over det dx/dxi.
pub(super) fn parametric_scale(kind: Kind) -> f64 {
    match kind.family() {
        Family::Simplex => 2.0,
        Family::Tensor => 1.0,
        Family::Prism => 3f64.sqrt() / 2.0,
    }
}

/// det dx/dxi of a curved element as a polynomial over the cell: of degree 3 (n - 1) on simplices,
/// 3 n - 1 per axis on cubes and (at most) on prisms.
pub(super) fn jacobian_determinant(c: &Curved) -> Net<f64> {
    let n = c.net.degree;
    let degree = match c.net.family {
        Family::Simplex => 3 * (n - 1),
        Family::Tensor | Family::Prism => 3 * n - 1,
    };
    Net::of(c.net.family, degree, |r| {
        c.evaluate(c.kind.from_parameters(r)).1.determinant()
    })
}

impl ElementMap<'_> {
    /// The signed volume, exact up to rounding; negative for mirror-numbered elements.
    pub fn volume(&self) -> f64 {
        self.geometry.determinant.mean * self.shape().measure()
    }

    /// The sign of det J over the whole element, proved. Determinants below 1e-12 of the cubed diagonal count as 0.
    pub fn orientation(&self) -> Orientation {
        let size = 2.0 * self.bounds().half_diagonal();
        let tiny = 1e-12 * size.powi(3);
        // det dx/dr is this times det dx/dxi; of most elements all bounds have one sign.
        let scale = parametric_scale(self.kind);
        let (low, high) = self.geometry.determinant.range;
        if low * scale > tiny {
            return Orientation::Positive;
        }
        if high * scale < -tiny {
            return Orientation::Negative;
        }
        match &self.geometry.map {
            Map::Affine(_) => Orientation::Degenerate {
                determinant: low * scale,
                at: CellPoint(Vec3::zeros()),
            },
            Map::Curved(c) => sign_of(jacobian_determinant(c), tiny / scale, |d, r| {
                (d * scale, self.kind.from_parameters(r))
            }),
            Map::Twisted(t) => t.defect(tiny),
            Map::Collapsed(c) => sign_of(c.determinant_net(), tiny, |d, r| c.spot(d, r)),
        }
    }

    /// The minimum of det J / (|J|_F / sqrt 3)^3 over nodes and centre, with the sign of the
    /// element's volume: 1 for a regular element, 0 for a degenerate one, negative where folded.
    pub fn quality(&self) -> f64 {
        let sign = self.volume().signum();
        let at = |xi| {
            let j = self.jacobian(xi);
            let size = j.norm() / 3f64.sqrt();
            if size > 0.0 {
                sign * j.determinant() / size.powi(3)
            } else {
                0.0
            }
        };
        let centre = at(self.shape().centroid());
        if self.is_affine() {
            return centre;
        }
        let nodes = self.kind.reference_nodes();
        nodes.into_iter().map(at).fold(centre, f64::min)
    }
}

/// Maximum number of parts examined; an unproved sign is then called degenerate.
const MAX_PARTS: usize = 4096;

/// The sign of a polynomial; `place` gives the value and the point of the cell frame to name for one found at
/// parametric coordinates. Values below `tiny` in magnitude count as 0. Large parts are examined first, so
/// that a change of sign is found early.
fn sign_of(
    net: Net<f64>,
    tiny: f64,
    place: impl Fn(f64, Vec3) -> (f64, CellPoint<3>),
) -> Orientation {
    let family = net.family;
    let mut open = std::collections::VecDeque::from([(net, Part::whole(family))]);
    // Greatest and least value seen, with their places.
    let mut high = (f64::NEG_INFINITY, Vec3::zeros());
    let mut low = (f64::INFINITY, Vec3::zeros());
    // The value nearest to zero, in case the sign cannot be proved.
    let mut nearest = (f64::INFINITY, Vec3::zeros());
    let mut unsure = false;
    let mut examined = 0;
    while let Some((net, part)) = open.pop_front() {
        examined += 1;
        for (value, r) in net.corners() {
            let r = part.place(r);
            if value > high.0 {
                high = (value, r);
            }
            if value < low.0 {
                low = (value, r);
            }
            if value.abs() < nearest.0.abs() {
                nearest = (value, r);
            }
        }
        if high.0 > tiny && low.0 < -tiny {
            continue;
        }
        let (a, b) = net.range();
        if a > tiny || b < -tiny {
            continue;
        }
        if examined < MAX_PARTS && (high.0 > tiny || low.0 < -tiny) {
            let way = part.longest_way();
            open.extend(net.split(way).into_iter().zip(part.split(way)));
        } else {
            unsure = true;
        }
    }
    if high.0 > tiny && low.0 < -tiny {
        // The sign of smaller magnitude is the wrong one; the mean is not available here.
        let wrong = if high.0 >= -low.0 { low } else { high };
        let (determinant, at) = place(wrong.0, wrong.1);
        return Orientation::Folded { determinant, at };
    }
    if unsure {
        let (determinant, at) = place(nearest.0, nearest.1);
        Orientation::Degenerate { determinant, at }
    } else if high.0 > 0.0 {
        Orientation::Positive
    } else {
        Orientation::Negative
    }
}
