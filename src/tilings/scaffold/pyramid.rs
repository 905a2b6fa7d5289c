//! The linear pyramid: a cube with its upper side collapsed into the apex.
//!
//! With h = 1 - z sqrt 2 (1 at the base, 0 at the apex) the shape functions are (1/2 -+ x / h) (1/2 -+ y / h) h for the
//! base and 1 - h for the apex, so that the map is affine but for one term: F(xi) = A xi + b + c q(xi), q = x y / h,
//! where c = X0 - X1 + X2 - X3 states how far the base is from a parallelogram. Over the pyramid |x|, |y| <= h / 2; the
//! Jacobian J = A + c grad q depends on (x / h, y / h) in `[-1/2, 1/2]^2` alone, and det J is bilinear in them: its
//! range is that of the four corners. Pyramids of 13 and 14 nodes are [`Collapsed`].

mod collapsed;

pub(super) use collapsed::{
    Collapsed, complete, shape_functions as quadratic_functions,
    shape_gradients as quadratic_gradients,
};

use super::Orientation;
use super::cell_box::{beyond_a_face, confine, grow};
use super::map::{Affine, newton};
use druse_geometry::frame::{Aabb, CellBox, CellPoint, Element, Mat3, Vec3};
use std::f64::consts::SQRT_2;

/// Number of steps that narrow a box.
const NARROWING_STEPS: usize = 8;

/// x / h, y / h and h; at the apex (0, 0, 0).
fn ratios(xi: CellPoint<3>) -> (f64, f64, f64) {
    let h = 1.0 - SQRT_2 * xi.0.z;
    if h.abs() < 1e-14 {
        (0.0, 0.0, 0.0)
    } else {
        (xi.0.x / h, xi.0.y / h, h)
    }
}

/// Gradient of q at given x / h and y / h.
fn slope(a: f64, b: f64) -> Vec3 {
    Vec3::new(b, a, SQRT_2 * a * b)
}

/// Parametric coordinates (r, s, t) in the cube of a point.
pub(super) fn parameters(xi: CellPoint<3>) -> Vec3 {
    let (a, b, h) = ratios(xi);
    Vec3::new(a + 0.5, b + 0.5, 1.0 - h)
}

/// The point of the cell frame with these parametric coordinates.
pub(super) fn from_parameters(r: Vec3) -> CellPoint<3> {
    let h = 1.0 - r.z;
    CellPoint(Vec3::new((r.x - 0.5) * h, (r.y - 0.5) * h, r.z / SQRT_2))
}

/// Signs of x and y at the corners of the base, halved.
const CORNERS: [[f64; 2]; 4] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];

pub(super) fn shape_functions(xi: CellPoint<3>) -> [f64; 5] {
    let (a, b, h) = ratios(xi);
    let mut n = [1.0 - h; 5];
    for (n, [x, y]) in n.iter_mut().zip(CORNERS) {
        *n = (0.5 + 2.0 * x * a) * (0.5 + 2.0 * y * b) * h;
    }
    n
}

/// Their gradients by the cell's coordinates; on the axis at the apex.
pub(super) fn shape_gradients(xi: CellPoint<3>) -> [Vec3; 5] {
    let (a, b, _) = ratios(xi);
    let mut n = [Vec3::z() * SQRT_2; 5];
    for (n, [x, y]) in n.iter_mut().zip(CORNERS) {
        // (1/2 + 2x a)(1/2 + 2y b) h = h/4 + x X + y Y + 4xy q.
        *n = Vec3::new(x, y, -SQRT_2 / 4.0) + slope(a, b) * (4.0 * x * y);
    }
    n
}

/// The affine part of the map.
pub(super) fn affine(nodes: [Vec3; 5]) -> Affine {
    let base: Vec3 = nodes[..4].iter().sum::<Vec3>() / 4.0;
    let along = |axis: usize| -> Vec3 { nodes.iter().zip(CORNERS).map(|(n, s)| n * s[axis]).sum() };
    let jacobian = Mat3::from_columns(&[along(0), along(1), (nodes[4] - base) * SQRT_2]);
    Affine::new(base, jacobian)
}

/// The start of the search for a preimage: by the affine map if that is near the element. Near is up to 0.2 reference
/// lengths outside; else the search starts from the centroid.
fn start_of(affine: &Affine, x: Vec3) -> CellPoint<3> {
    let xi = CellPoint(affine.inverse * (x - affine.origin));
    if xi.0.iter().all(|c| c.is_finite()) && Element::Pyramid.face_distance(xi) < 0.2 {
        xi
    } else {
        Element::Pyramid.centroid()
    }
}

/// The map of a pyramid whose base is no parallelogram.
#[derive(Clone)]
pub(super) struct Twisted {
    affine: Affine,
    twist: Vec3,
    nodes: [Vec3; 5],
}

impl Twisted {
    /// The map through the four corners of the base, in order around it, and the apex; further nodes are ignored.
    pub fn new(nodes: &[Vec3]) -> Self {
        let nodes = [nodes[0], nodes[1], nodes[2], nodes[3], nodes[4]];
        Self {
            affine: affine(nodes),
            twist: nodes[0] - nodes[1] + nodes[2] - nodes[3],
            nodes,
        }
    }

    /// The corners, whose hull is the element.
    pub fn corners(&self) -> Vec<Vec3> {
        self.nodes.to_vec()
    }

    /// The point and the Jacobian dx/dxi.
    pub fn evaluate(&self, xi: CellPoint<3>) -> (Vec3, Mat3) {
        let (a, b, h) = ratios(xi);
        let x = self.affine.map(xi) + self.twist * (a * b * h);
        (x, self.jacobian(a, b))
    }

    fn jacobian(&self, a: f64, b: f64) -> Mat3 {
        self.affine.jacobian + self.twist * slope(a, b).transpose()
    }

    /// det J at the corners of the base, in their order.
    fn determinants(&self) -> [f64; 4] {
        CORNERS.map(|[a, b]| self.jacobian(a, b).determinant())
    }

    /// Mean of det J over the pyramid: that of the corners, as it is bilinear.
    pub fn mean_determinant(&self) -> f64 {
        self.determinants().iter().sum::<f64>() / 4.0
    }

    /// Least and greatest det J: it is bilinear over the base, so that its extremes are at corners.
    pub fn determinant_range(&self) -> (f64, f64) {
        let all = self.determinants().into_iter();
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| {
            (a.min(d), b.max(d))
        })
    }

    /// What is wrong where det J is neither above `tiny` nor below `-tiny` at all corners of the base. The place is the
    /// corner with the determinant that decides.
    pub fn defect(&self, tiny: f64) -> Orientation {
        let d = self.determinants();
        let (mut low, mut high) = (0, 0);
        for i in 1..4 {
            if d[i] < d[low] {
                low = i;
            }
            if d[i] > d[high] {
                high = i;
            }
        }
        let at = |i: usize| CellPoint(Vec3::new(CORNERS[i][0], CORNERS[i][1], 0.0));
        // Where both signs occur, the one opposite to the mean is wrong.
        if d[low] < -tiny && d[high] > tiny {
            let wrong = if self.mean_determinant() >= 0.0 {
                low
            } else {
                high
            };
            Orientation::Folded {
                determinant: d[wrong],
                at: at(wrong),
            }
        } else {
            let nearest = if d[low].abs() < d[high].abs() {
                low
            } else {
                high
            };
            Orientation::Degenerate {
                determinant: d[nearest],
                at: at(nearest),
            }
        }
    }

    /// Bounds of the singular values of J over the element, from 8 x 8 tiles of (x / h, y / h). World units per
    /// reference length; the lower one is 0 where none is proved.
    pub fn stretch(&self) -> (f64, f64) {
        const TILES: usize = 8;
        let half_tile = 0.5 / TILES as f64;
        // |J - J(middle)| <= |c| |grad q - grad q(middle)|, less than 2 half tiles times |c|; the rest is slack.
        let eta = self.twist.norm() * half_tile * (2.0 + 0.5 * SQRT_2);
        let (mut least, mut greatest) = (f64::INFINITY, 0f64);
        for i in 0..TILES {
            for j in 0..TILES {
                let middle = |i: usize| (2 * i + 1) as f64 * half_tile - 0.5;
                let s = self.jacobian(middle(i), middle(j)).singular_values();
                least = least.min(s.min() - eta);
                greatest = greatest.max(s.max() + eta);
            }
        }
        let (low, high) = self.determinant_range();
        let by_volume = low.max(-high) / greatest.powi(2);
        (least.max(by_volume).max(0.0), greatest)
    }

    /// The preimage of a point, near the element; else the residual. Without `start` the search begins by [`start_of`];
    /// where it fails, it begins again at the centroid.
    pub fn inverse(&self, x: Vec3, start: Option<CellPoint<3>>) -> Result<CellPoint<3>, f64> {
        let centroid = Element::Pyramid.centroid();
        let start = start.unwrap_or_else(|| start_of(&self.affine, x));
        let map = |xi| self.evaluate(xi);
        newton(map, x, start, self.affine.origin)
            .or_else(|_| newton(map, x, centroid, self.affine.origin))
    }

    /// A box around the points of the closed cell that map into `world`; `None` if there are none.
    ///
    /// F(xi) = A xi + b + c q with |q - q(m)| <= `r_x` / 2 + `r_y` / 2 + `r_z` / sqrt 8 over the pyramid in a box, and
    /// at most 1/2, since |q| <= h / 4. m is the middle of the box, clamped to the pyramid, and r the greatest
    /// distances from it along the axes. This is solved for xi again and again as the box shrinks.
    pub fn cell_box(&self, world: &Aabb) -> Option<CellBox<3>> {
        let shape = Element::Pyramid;
        let y = self.affine.inverse;
        let mut inner = shape.cell_box();
        // A degenerate element has no inverse.
        if !y[0].is_finite() {
            return Some(inner);
        }
        let half = world.size() / 2.0;
        for _ in 0..NARROWING_STEPS {
            let radius = (inner.max - inner.min) / 2.0;
            let middle = (inner.max + inner.min) / 2.0;
            let h = (1.0 - SQRT_2 * middle.z).max(0.0);
            let within = |c: f64| c.clamp(-h / 2.0, h / 2.0);
            let m = Vec3::new(within(middle.x), within(middle.y), middle.z);
            let reach = radius + (middle - m).abs();
            let (a, b, h) = ratios(CellPoint(m));
            let q = a * b * h;
            let spread = f64::midpoint(reach.x, reach.y) + reach.z / 8f64.sqrt();
            let size = half + self.twist.abs() * spread.min(0.5);
            // xi = A^-1 (x - b - c q): the box shrinks as the range of q does.
            let centre = y * (world.centre().0 - self.affine.origin - self.twist * q);
            if beyond_a_face(shape, &centre, &y, &size) {
                return None;
            }
            let width = y.abs() * size;
            let mut next = CellBox {
                min: inner.min.sup(&(centre - width)),
                max: inner.max.inf(&(centre + width)),
            };
            grow(&mut next);
            let next = confine(shape, next)?;
            // An edge fell below 3/4, with half edges in `radius`.
            let shrunk = (0..3).any(|a| next.max[a] - next.min[a] < 1.5 * radius[a]);
            inner = next;
            if !shrunk {
                break;
            }
        }
        Some(inner)
    }
}
