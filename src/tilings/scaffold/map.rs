//! The map of one element: cell frame to world and back.
//!
//! x = F(xi) = sum `N_a(xi)` `X_a`, evaluated in powers of xi and bounded by Bernstein control points. F is inverted in
//! closed form for elements whose map is affine within 1e-12 of their size (every Tet4, straight Tet10,
//! parallelepipeds), for the others by damped Newton steps.

use super::basis::Basis;
use super::bernstein::{Net, Part, index, lattice};
use super::kind::{Family, Kind};
use super::polynomial::{Polynomial, Powers};
use super::pyramid::{Collapsed, Twisted};
use druse_geometry::frame::{Aabb, CellPoint, Element, Mat3, Vec3};

/// Largest |xi| on an axis of a point that the inverse finds; the cell ends at 1/2.
const MAX_INVERSE_COORDINATE: f64 = 1.5;
/// Maximum number of Newton steps.
const MAX_NEWTON_STEPS: usize = 60;
/// Relative deviation from an affine map that counts as rounding.
const AFFINE_TOLERANCE: f64 = 1e-12;

/// Bounds and map of an element.
#[derive(Clone)]
pub(super) struct Geometry {
    /// The box of its control points, which contains it.
    pub bounds: Aabb,
    /// Bounds of the singular values of the Jacobian.
    pub stretch: (f64, f64),
    pub determinant: Determinant,
    pub map: Map,
}

/// det dx/dxi over the cell, cubic world units per cubic reference length; negative in mirrored elements. Computed once:
/// that of a quadratic cube has 216 coefficients.
#[derive(Clone, Copy)]
pub(super) struct Determinant {
    /// Times the cell's volume, the element's.
    pub mean: f64,
    /// Bounds of its values.
    pub range: (f64, f64),
}

#[derive(Clone)]
pub(super) enum Map {
    Affine(Affine),
    Curved(Box<Curved>),
    /// A pyramid whose base is no parallelogram.
    Twisted(Twisted),
    /// A quadratic pyramid that is curved.
    Collapsed(Box<Collapsed>),
}

/// x = origin + jacobian xi.
#[derive(Clone)]
pub(super) struct Affine {
    pub origin: Vec3,
    pub jacobian: Mat3,
    /// Not finite for a degenerate element.
    pub inverse: Mat3,
}

/// A map that is not affine.
#[derive(Clone)]
pub(super) struct Curved {
    pub kind: Kind,
    pub net: Net<Vec3>,
    /// Bounds of the second derivatives of F by xi over the cell, per component; in the order of [`PAIRS`].
    pub bend: [Vec3; 6],
    /// The same map in powers of xi.
    pub polynomial: Polynomial,
    /// The point at the centre of the cell.
    origin: Vec3,
    /// The inverse Jacobian at the centre, for the first guess of the inverse.
    start: Mat3,
}

/// Index pairs of a symmetric second derivative.
pub(super) const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

impl Geometry {
    /// The map of an element of this kind with these nodes, world units. `nodes` are in the order of the kind, as many
    /// as it has.
    pub fn new(kind: Kind, nodes: &[Vec3]) -> Self {
        let net = kind.controls(nodes);
        let bounds = Aabb::of(net.coefficients.iter().copied());
        let map = Map::new(kind, nodes, net, &bounds);
        let determinant = map.determinant();
        Self {
            bounds,
            stretch: map.stretch(determinant.range),
            determinant,
            map,
        }
    }

    /// The geometry of the same element with its nodes in another order. Its box and the singular values of its
    /// Jacobian stay, since a turn of the reference cell is orthogonal; its determinant too, but for its sign if the turn
    /// mirrors.
    pub fn renumbered(&self, kind: Kind, nodes: &[Vec3], mirrors: bool) -> Self {
        let mut determinant = self.determinant;
        if mirrors {
            let (low, high) = determinant.range;
            (determinant.mean, determinant.range) = (-determinant.mean, (-high, -low));
        }
        Self {
            bounds: self.bounds,
            stretch: self.stretch,
            determinant,
            map: Map::new(kind, nodes, kind.controls(nodes), &self.bounds),
        }
    }

    /// The control points of a map that may leave the box of its corners: none of those are of degree 1.
    pub fn curved_controls(&self) -> Option<&Net<Vec3>> {
        match &self.map {
            Map::Curved(c) => (c.net.degree > 1).then_some(&c.net),
            Map::Affine(_) | Map::Twisted(_) => None,
            Map::Collapsed(c) => Some(&c.net),
        }
    }
}

impl Map {
    /// The simplest map through the control points `net`, whose box is `bounds`: an affine one where it is that to
    /// rounding, else a curved one; that of a pyramid is twisted or collapsed.
    fn new(kind: Kind, nodes: &[Vec3], net: Net<Vec3>, bounds: &Aabb) -> Self {
        let affine = Affine::through(kind, &net);
        let tolerance = AFFINE_TOLERANCE * bounds.half_diagonal();
        let degree = kind.degree() as f64;
        // The map is affine if all control points lie where the affine map takes their parameters.
        let is_affine = lattice(net.family, net.degree)
            .zip(&net.coefficients)
            .all(|(p, c)| {
                let xi = kind.from_parameters(Vec3::from(p.map(|i| i as f64 / degree)));
                (affine.map(xi) - c).norm() <= tolerance
            });
        if is_affine {
            return Self::Affine(affine);
        }
        if kind.shape() != Element::Pyramid {
            return Self::Curved(Box::new(Curved::new(kind, net)));
        }
        let curved = (kind != Kind::Pyramid5)
            .then(|| Collapsed::new(kind, nodes, net, tolerance))
            .flatten();
        match curved {
            Some(collapsed) => Self::Collapsed(Box::new(collapsed)),
            None => Self::Twisted(Twisted::new(nodes)),
        }
    }

    fn determinant(&self) -> Determinant {
        let (mean, range) = match self {
            Self::Affine(affine) => {
                let mean = affine.jacobian.determinant();
                (mean, (mean, mean))
            }
            Self::Curved(curved) => {
                let net = super::orientation::jacobian_determinant(curved);
                (net.mean(), net.range())
            }
            Self::Twisted(t) => (t.mean_determinant(), t.determinant_range()),
            Self::Collapsed(c) => (c.mean_determinant(), c.determinant_net().range()),
        };
        Determinant { mean, range }
    }

    /// Bounds of the singular values of the Jacobian, whose determinant lies in `range`.
    fn stretch(&self, range: (f64, f64)) -> (f64, f64) {
        match self {
            Self::Affine(affine) => {
                let s = affine.jacobian.singular_values();
                (s.min(), s.max())
            }
            Self::Curved(curved) => stretch(curved.jacobian_net(), range),
            Self::Twisted(twisted) => twisted.stretch(),
            Self::Collapsed(collapsed) => stretch(collapsed.jacobian_net(), range),
        }
    }
}

impl Affine {
    /// The affine map that agrees at the first corner and its neighbours along r1, r2, r3.
    fn through(kind: Kind, net: &Net<Vec3>) -> Self {
        let corners = net.corners();
        if kind.shape() == Element::Pyramid {
            return super::pyramid::affine([0, 1, 3, 2, 4].map(|i| corners[i].0));
        }
        let at = |axis: usize| {
            let unit = Vec3::ith(axis, 1.0);
            corners
                .iter()
                .find(|c| c.1 == unit)
                .map_or(corners[0].0, |c| c.0)
                - corners[0].0
        };
        let jacobian = Mat3::from_columns(&[at(0), at(1), at(2)]) * kind.parameters_by_cell();
        let first = kind.from_parameters(Vec3::zeros());
        Self::new(corners[0].0 - jacobian * first.0, jacobian)
    }

    /// The map origin + jacobian xi. The inverse of a singular matrix is NaN in every entry, by which callers know it.
    pub fn new(origin: Vec3, jacobian: Mat3) -> Self {
        Self {
            origin,
            jacobian,
            inverse: jacobian
                .try_inverse()
                .unwrap_or_else(|| Mat3::repeat(f64::NAN)),
        }
    }

    /// The world point of a cell point.
    pub fn map(&self, xi: CellPoint<3>) -> Vec3 {
        self.origin + self.jacobian * xi.0
    }
}

impl Curved {
    fn new(kind: Kind, net: Net<Vec3>) -> Self {
        let powers = match (net.family, net.degree) {
            (_, 1) => Powers::Linear,
            (Family::Simplex, _) => Powers::Simplex,
            (Family::Tensor | Family::Prism, _) => Powers::Quadratic,
        };
        let polynomial = Polynomial::of(powers, |xi| {
            // The first coefficients of a cube are the values at its corners.
            if (net.family, net.degree) == (Family::Tensor, 1) {
                let [x, y, z] = [0, 1, 2].map(|a| usize::from(xi[a] > 0.0));
                return net.coefficients[x + 2 * y + 4 * z];
            }
            let basis = Basis::at(kind, kind.parameters(CellPoint(xi)));
            let controls = net.coefficients.iter().zip(basis.values);
            controls.map(|(c, value)| c * value).sum()
        });
        let bend = bend(kind, &net);
        let mut curved = Self {
            kind,
            net,
            polynomial,
            bend,
            origin: Vec3::zeros(),
            start: Mat3::identity(),
        };
        let (origin, centre) = curved.evaluate(CellPoint(Vec3::zeros()));
        curved.origin = origin;
        curved.start = centre.try_inverse().unwrap_or_else(Mat3::zeros);
        curved
    }

    /// The point and the Jacobian dx/dxi.
    pub fn evaluate(&self, xi: CellPoint<3>) -> (Vec3, Mat3) {
        let (x, rows) = self.polynomial.evaluate::<f64>(xi.0.into());
        (x.into(), Mat3::from(rows).transpose())
    }

    /// The Jacobian dx/dxi as a polynomial over the cell.
    pub fn jacobian_net(&self) -> Net<Mat3> {
        let degree = match self.net.family {
            Family::Simplex => self.net.degree - 1,
            Family::Tensor | Family::Prism => self.net.degree,
        };
        Net::of(self.net.family, degree, |r| {
            self.evaluate(self.kind.from_parameters(r)).1
        })
    }

    /// The preimage of `x` by Newton's method from `start`; the error is the least distance from `x` that was reached,
    /// world units.
    pub fn newton(&self, x: Vec3, start: CellPoint<3>) -> Result<CellPoint<3>, f64> {
        newton(|xi| self.evaluate(xi), x, start, self.origin)
    }

    /// A start for Newton's method: the preimage by the affine map at the reference origin, drawn into the cube of half
    /// width 0.5. It is the origin if that map is singular.
    pub fn initial_guess(&self, x: Vec3) -> CellPoint<3> {
        let xi = self.start * (x - self.origin);
        let far = xi.amax();
        CellPoint(if far > 0.5 { xi * (0.5 / far) } else { xi })
    }
}

/// Bounds of the singular values sigma of a Jacobian J. On each part of the cell, with J0 the mean over its net,
/// |sigma(J) - sigma(J0)| <= |J - J0|. A part is split while its lower bound is below half of the least sigma(J0),
/// at most 64 times in all. Also, `sigma_min >= |det J| / sigma_max^2`; det J lies between `lowest` and `highest`.
/// World units per reference length. The lower bound is 0 where none is proved.
fn stretch(jacobian: Net<Mat3>, (lowest, highest): (f64, f64)) -> (f64, f64) {
    let whole = Part::whole(jacobian.family);
    let mut open = vec![(jacobian, whole)];
    let (mut least, mut greatest) = (f64::INFINITY, 0f64);
    let mut splits_left = 64;
    while let Some((net, part)) = open.pop() {
        let centre = net.mean();
        // Over the part, J is a mean of its coefficients: |J - J0| is at most eta.
        let eta = net
            .coefficients
            .iter()
            .map(|c| (c - centre).norm())
            .fold(0.0, f64::max);
        let s = centre.singular_values();
        let low = s.min() - eta;
        if low < 0.5 * s.min() && splits_left > 0 {
            splits_left -= 1;
            let way = part.longest_way();
            open.extend(net.split(way).into_iter().zip(part.split(way)));
        } else {
            least = least.min(low);
            greatest = greatest.max(s.max() + eta);
        }
    }
    // |det J| is the product of the singular values, two of them at most `greatest`.
    let by_volume = lowest.max(-highest) / greatest.powi(2);
    (least.max(by_volume).max(0.0), greatest)
}

/// The inverse of `map` at `x` by Newton steps from `start`, halved while the residual grows; the error is the residual
/// if they do not converge. The coordinates of `x` and `origin` determine the rounding error. Steps are cut to one
/// cell's length, and points stay within [`MAX_INVERSE_COORDINATE`].
pub(super) fn newton(
    map: impl Fn(CellPoint<3>) -> (Vec3, Mat3),
    x: Vec3,
    start: CellPoint<3>,
    origin: Vec3,
) -> Result<CellPoint<3>, f64> {
    let mut xi = start;
    let (f, mut j) = map(xi);
    let mut residual = x - f;
    // The rounding of x - F(xi): below it no step can improve.
    let rounding = 8.0 * f64::EPSILON * x.amax().max(origin.amax());
    for _ in 0..MAX_NEWTON_STEPS {
        let left = residual.norm();
        let Some(inverse) = j.try_inverse() else {
            return Err(left);
        };
        let mut step = inverse * residual;
        let length = step.norm();
        if length < 1e-8 || left <= rounding {
            // Convergence is quadratic: the error after this step is below 1e-13.
            return Ok(CellPoint(xi.0 + step));
        }
        if length > 1.0 {
            step /= length;
        }
        // A step that does not reduce the residual, or leaves the range of the inverse, is halved.
        let mut share = 1.0;
        loop {
            let next = CellPoint(xi.0 + step * share);
            if next.0.amax() <= MAX_INVERSE_COORDINATE {
                let (f, slope) = map(next);
                let rest = x - f;
                if rest.norm() < left {
                    (xi, j, residual) = (next, slope, rest);
                    break;
                }
            }
            share /= 2.0;
            // Neither the step nor its halves down to 1e-4 reduce the residual.
            if share < 1e-4 {
                return Err(left);
            }
        }
    }
    Err(residual.norm())
}

/// Bounds of the second derivatives over the cell whose control points these are: the greatest
/// second differences, which are their Bernstein coefficients.
pub(super) fn bend(kind: Kind, net: &Net<Vec3>) -> [Vec3; 6] {
    match net.family {
        // For speed, as the arm of all tensor nets gives the same. Of a trilinear map, the second differences of the
        // mixed derivatives are those of its two faces across.
        Family::Tensor if net.degree == 1 => PAIRS.map(|[j, k]| {
            if j == k {
                return Vec3::zeros();
            }
            let (a, b, across) = (1 << j, 1 << k, 1 << (3 - j - k));
            let c = &net.coefficients;
            let twist = |n: usize| (c[n + a + b] - c[n + a] - c[n + b] + c[n]).abs();
            twist(0).sup(&twist(across))
        }),
        // By the parameters r, which in a cube are the cell's coordinates up to a constant.
        Family::Tensor => PAIRS.map(|[j, k]| supremum(second(net, j, k))),
        Family::Prism => {
            // With r = T xi + constant, d2F / dxi_j dxi_k = sum over a, b of T_aj T_bk d2F / dr_a dr_b. The nets of the
            // derivatives differ in degree: their bounds are added.
            let t = kind.parameters_by_cell();
            let by_r: [[Vec3; 3]; 3] =
                [0, 1, 2].map(|a| [0, 1, 2].map(|b| supremum(second(net, a, b))));
            PAIRS.map(|[j, k]| {
                let mut s = Vec3::zeros();
                for a in 0..3 {
                    for b in 0..3 {
                        s += by_r[a][b] * (t[(a, j)] * t[(b, k)]).abs();
                    }
                }
                s
            })
        }
        Family::Simplex => {
            // All nets are of one degree: coefficients are added before the bound, which is sharper.
            let t = kind.parameters_by_cell();
            let by_r: [[Vec<Vec3>; 3]; 3] =
                [0, 1, 2].map(|a| [0, 1, 2].map(|b| second(net, a, b).collect()));
            PAIRS.map(|[j, k]| {
                supremum((0..by_r[0][0].len()).map(|i| {
                    let mut s = Vec3::zeros();
                    for a in 0..3 {
                        for b in 0..3 {
                            s += by_r[a][b][i] * (t[(a, j)] * t[(b, k)]);
                        }
                    }
                    s
                }))
            })
        }
    }
}

/// Bernstein coefficients of the second derivative by parameters j and k. Its degree is lower along these axes, in a
/// simplex in all. `net` are control points over the parameters' reference cell.
fn second(net: &Net<Vec3>, j: usize, k: usize) -> impl Iterator<Item = Vec3> + '_ {
    let n = net.degree;
    let (family, c) = (net.family, &net.coefficients);
    // The first derivative has one degree less along its axis, in a simplex along all axes; the second derivative has
    // that degree as a factor.
    let in_simplex = match family {
        Family::Simplex => true,
        Family::Tensor => false,
        Family::Prism => j < 2 && k < 2,
    };
    let scale = if j == k || in_simplex {
        n * (n - 1)
    } else {
        n * n
    };
    let fits = move |p: &[usize; 3]| {
        let mut q = *p;
        q[j] += 1;
        q[k] += 1;
        match family {
            Family::Simplex => q.iter().sum::<usize>() <= n,
            Family::Tensor => q[j] <= n && q[k] <= n,
            Family::Prism => q[0] + q[1] <= n && q[2] <= n,
        }
    };
    lattice(family, n).filter(fits).map(move |p| {
        let at = |dj: usize, dk: usize| {
            let mut q = p;
            q[j] += dj;
            q[k] += dk;
            c[index(family, n, q)]
        };
        (at(1, 1) - at(1, 0) - at(0, 1) + at(0, 0)) * scale as f64
    })
}

fn supremum(mut vectors: impl Iterator<Item = Vec3>) -> Vec3 {
    let first = vectors.next().unwrap_or_default().abs();
    vectors.fold(first, |m, v| m.sup(&v.abs()))
}
