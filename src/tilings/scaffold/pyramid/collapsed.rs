//! The quadratic pyramid: polynomial in collapsed coordinates.
//!
//! With a = x / h and b = y / h (h as in the linear pyramid, |a|, |b| <= 1/2) the shape functions
//! span 1, h {1, a, b, ab} and h^2 {1, a, b, ...} with every power up to a^2 b^2: the polynomials of
//! degree 2 in x, y, z and four rational functions that the base needs. Without a^2 b^2 h^2 these
//! are the 13 functions of the serendipity pyramid. The trace on a triangle is the quadratic one of
//! six nodes, that on the base the biquadratic one of nine (or of eight), so neighbours meet.
//!
//! J = dx/dxi is again a polynomial in (a, b, h), of degree 2 in each, det J of degree (5, 5, 3): their Bernstein
//! coefficients bound them as those of other curved elements do. At the apex (h = 0) J depends on the direction (a, b),
//! and the bounds cover every direction. The volume element is h^2 da db dh / sqrt 2.

use super::{Affine, ratios};
use crate::scaffold::bernstein::{Coefficient, Net, index};
use crate::scaffold::cell_box::{confine, grow};
use crate::scaffold::kind::{Family, Kind};
use crate::scaffold::map::{PAIRS, bend, newton};
use druse_geometry::frame::{Aabb, CellBox, CellPoint, Element, Mat3, Vec3};
use std::f64::consts::SQRT_2;
use std::sync::OnceLock;

/// Maximum number of shape functions.
const MAX_TERMS: usize = 14;
/// Maximum depth of splits.
const MAX_SPLIT_DEPTH: usize = 24;
/// Relative slack that covers rounding.
const ROUNDING_SLACK: f64 = 1e-12;

/// A box of parametric coordinates: least and greatest corner.
type Span = (Vec3, Vec3);

/// The terms 1, h, ah, bh, abh, then h^2 times 1, a, b, a^2, b^2, ab, a^2 b, a b^2, a^2 b^2, and their
/// gradients by x, y and h.
fn terms(a: f64, b: f64, h: f64) -> ([f64; MAX_TERMS], [Vec3; MAX_TERMS]) {
    // x = a h and y = b h. Gradients are written with a and b: none divides by h, which is 0 at the apex.
    let (x, y, ab) = (a * h, b * h, a * b);
    let v = Vec3::new;
    // h^2 a b^2 is b x y, and so on.
    (
        [
            1.0,
            h,
            x,
            y,
            a * y,
            h * h,
            x * h,
            y * h,
            x * x,
            y * y,
            x * y,
            a * x * y,
            b * x * y,
            ab * x * y,
        ],
        [
            Vec3::zeros(),
            v(0.0, 0.0, 1.0),
            v(1.0, 0.0, 0.0),
            v(0.0, 1.0, 0.0),
            v(b, a, -ab),
            v(0.0, 0.0, 2.0 * h),
            v(h, 0.0, x),
            v(0.0, h, y),
            v(2.0 * x, 0.0, 0.0),
            v(0.0, 2.0 * y, 0.0),
            v(y, x, 0.0),
            v(2.0 * a * y, a * x, -ab * x),
            v(b * y, 2.0 * a * y, -ab * y),
            v(2.0 * ab * y, 2.0 * ab * x, -2.0 * ab * ab * h),
        ],
    )
}

/// The terms' factors, from the values at the 27 lattice points of the collapsed cube. They are in the order of the
/// terms: the apex, four of the first power of the height, nine of the second.
fn factors<T: Coefficient>(values: &[T]) -> [T; MAX_TERMS] {
    let at = |i: usize, j: usize, k: usize| values[index(Family::Tensor, 2, [i, j, k])];
    let apex = at(0, 0, 2);
    // h * linear + h^2 * quadratic at h = 1 and h = 1/2.
    let linear = |i, j| (at(i, j, 1) - apex) * 4.0 - (at(i, j, 0) - apex);
    let quadratic = |i, j| (at(i, j, 0) - apex) * 2.0 - (at(i, j, 1) - apex) * 4.0;
    // A bilinear function from its values at +-1/2: the mean, both slopes and the mixed term, in the result below.
    let [p, q, r, s] = [(0, 0), (2, 0), (0, 2), (2, 2)].map(|(i, j)| linear(i, j));
    // Of a parabola: value in the middle, slope, half the second derivative.
    let parabola = |[low, middle, high]: [T; 3]| {
        let bent = (low + high - middle * 2.0) * 2.0;
        [middle, high - low, bent]
    };
    let rows = [0, 1, 2].map(|j| parabola([0, 1, 2].map(|i| quadratic(i, j))));
    // c[i][j] belongs to a^i b^j.
    let c = [0, 1, 2].map(|i| parabola([0, 1, 2].map(|j: usize| rows[j][i])));
    [
        apex,
        (p + q + r + s) * 0.25,
        (q + s - p - r) * 0.5,
        (r + s - p - q) * 0.5,
        p - q - r + s,
        c[0][0],
        c[1][0],
        c[0][1],
        c[2][0],
        c[0][2],
        c[1][1],
        c[2][1],
        c[1][2],
        c[2][2],
    ]
}

/// Values at the lattice points that hold no node, filled in from those that do: the base's centre of 13 nodes, the
/// triangles' points of half height, that of the axis, and the side drawn together. `sum` is a weighted sum of values.
pub(in crate::scaffold) fn complete<T: Copy>(
    kind: Kind,
    values: &mut [T],
    sum: impl Fn(&[(T, f64)]) -> T,
) {
    // Lattice point (i, j, k): a = (i - 1) / 2, b = (j - 1) / 2, h = 1 - k / 2.
    let place = |i: usize, j: usize, k: usize| index(Family::Tensor, 2, [i, j, k]);
    let corners = [[0, 0], [2, 0], [2, 2], [0, 2]];
    let all = |k: usize, weight: f64, v: &[T]| corners.map(|[i, j]| (v[place(i, j, k)], weight));
    let mids = [[1, 0], [2, 1], [1, 2], [0, 1]];
    // The base of eight nodes: u(0, 0) = sum of mid nodes / 2 - sum of corners / 4.
    if kind == Kind::Pyramid13 {
        let around = mids.map(|[i, j]| (values[place(i, j, 0)], 0.5));
        values[place(1, 1, 0)] = sum(&[&all(0, -0.25, values)[..], &around].concat());
    }
    // Half up the middle of a triangle: the quadratic of its six nodes at (1/4, 1/4, 1/2).
    for (n, [i, j]) in mids.into_iter().enumerate() {
        let ends = [corners[n], corners[(n + 1) % 4]];
        let [low, high] = ends.map(|[i, j]| (values[place(i, j, 0)], -0.125));
        let [rising, falling] = ends.map(|[i, j]| (values[place(i, j, 1)], 0.5));
        let base = (values[place(i, j, 0)], 0.25);
        values[place(i, j, 1)] = sum(&[low, high, rising, falling, base]);
    }
    // Half up the axis, with u = apex + h linear(a, b) + h^2 quadratic(a, b) and a bilinear `linear`.
    let centre = (values[place(1, 1, 0)], 0.25);
    let around = [
        &all(1, 0.25, values)[..],
        &all(0, -0.0625, values),
        &[centre],
    ];
    values[place(1, 1, 1)] = sum(&around.concat());
    // The cube's side at h = 0 is the apex.
    let apex = values[place(0, 0, 2)];
    values[place(0, 0, 2)..].fill(apex);
}

/// Each shape function's factors of the terms.
fn table(kind: Kind) -> &'static [[f64; MAX_TERMS]] {
    static TABLES: [OnceLock<Vec<[f64; MAX_TERMS]>>; 2] = [const { OnceLock::new() }; 2];
    TABLES[usize::from(kind == Kind::Pyramid14)].get_or_init(|| {
        let unit = |node: usize| -> Vec<f64> {
            let all = 0..kind.node_count();
            all.map(|n| f64::from(u8::from(n == node))).collect()
        };
        let nodes = 0..kind.node_count();
        nodes
            .map(|n| factors(&kind.on_lattice(&unit(n), 0.0, |s, &v, w| s + v * w)))
            .collect()
    })
}

/// Shape functions of a quadratic pyramid at a point.
pub(in crate::scaffold) fn shape_functions(kind: Kind, xi: CellPoint<3>) -> Vec<f64> {
    let (a, b, h) = ratios(xi);
    let (values, _) = terms(a, b, h);
    let one = |row: &[f64; MAX_TERMS]| row.iter().zip(values).map(|(c, v)| c * v).sum();
    table(kind).iter().map(one).collect()
}

/// Gradients of the shape functions by the cell's coordinates; at the apex the limit along the axis.
pub(in crate::scaffold) fn shape_gradients(kind: Kind, xi: CellPoint<3>) -> Vec<Vec3> {
    let (a, b, h) = ratios(xi);
    let (_, slopes) = terms(a, b, h);
    let one = |row: &[f64; MAX_TERMS]| {
        let g: Vec3 = row.iter().zip(slopes).map(|(c, g)| g * *c).sum();
        Vec3::new(g.x, g.y, -SQRT_2 * g.z)
    };
    table(kind).iter().map(one).collect()
}

/// The map of a quadratic pyramid with curved edges or faces.
#[derive(Clone)]
pub(in crate::scaffold) struct Collapsed {
    kind: Kind,
    /// The map over the collapsed cube.
    pub net: Net<Vec3>,
    factors: [Vec3; MAX_TERMS],
    /// The map of the corners without their twist, to start Newton's steps.
    affine: Affine,
}

impl Collapsed {
    /// The map; `None` if it is that of the linear pyramid within `tolerance`.
    pub fn new(kind: Kind, nodes: &[Vec3], net: Net<Vec3>, tolerance: f64) -> Option<Self> {
        let values = kind.on_lattice(nodes, Vec3::zeros(), |s, v, w| s + v * w);
        let factors = factors(&values);
        if factors[5..].iter().all(|c| c.norm() <= tolerance) {
            return None;
        }
        let affine = super::affine([nodes[0], nodes[1], nodes[2], nodes[3], nodes[4]]);
        Some(Self {
            kind,
            net,
            factors,
            affine,
        })
    }

    /// The point and the Jacobian dx/dxi at collapsed coordinates.
    fn at(&self, a: f64, b: f64, h: f64) -> (Vec3, Mat3) {
        let (values, slopes) = terms(a, b, h);
        let (mut x, mut j) = (Vec3::zeros(), [Vec3::zeros(); 3]);
        for ((c, v), g) in self.factors.iter().zip(values).zip(slopes) {
            x += c * v;
            j[0] += c * g.x;
            j[1] += c * g.y;
            j[2] += c * (-SQRT_2 * g.z);
        }
        (x, Mat3::from_columns(&j))
    }

    /// The same at parametric coordinates, those of the cube.
    fn at_parameters(&self, r: Vec3) -> (Vec3, Mat3) {
        self.at(r.x - 0.5, r.y - 0.5, 1.0 - r.z)
    }

    /// The point and the Jacobian dx/dxi; at the apex that along the axis.
    pub fn evaluate(&self, xi: CellPoint<3>) -> (Vec3, Mat3) {
        let (a, b, h) = ratios(xi);
        self.at(a, b, h)
    }

    /// dx/dxi over the collapsed cube.
    pub fn jacobian_net(&self) -> Net<Mat3> {
        Net::of(Family::Tensor, 2, |r| self.at_parameters(r).1)
    }

    /// det dx/dxi over the collapsed cube.
    pub fn determinant_net(&self) -> Net<f64> {
        Net::of(Family::Tensor, 5, |r| self.at_parameters(r).1.determinant())
    }

    /// Mean of det J over the pyramid, weighed by the volume element h^2, whose integral from 0 to 1 is 1/3.
    pub fn mean_determinant(&self) -> f64 {
        let weighed = Net::of(Family::Tensor, 5, |r| {
            self.at_parameters(r).1.determinant() * (1.0 - r.z).powi(2)
        });
        3.0 * weighed.mean()
    }

    /// A determinant found at parametric coordinates, and its place in the cell frame: where that is the
    /// apex, which stands for every direction, a place beside it and the determinant there.
    pub fn spot(&self, determinant: f64, r: Vec3) -> (f64, CellPoint<3>) {
        let mut found = (determinant, super::from_parameters(r));
        if r.z < 1.0 {
            return found;
        }
        // Places nearer and nearer to the apex, until the determinant there has the sign that is shown.
        for h in [1e-3, 1e-5, 1e-7] {
            let at = super::from_parameters(Vec3::new(r.x, r.y, 1.0 - h));
            found = (self.evaluate(at).1.determinant(), at);
            if found.0.signum() == determinant.signum() {
                break;
            }
        }
        found
    }

    /// The preimage of a point, near the element; else the residual.
    pub fn inverse(&self, x: Vec3, start: Option<CellPoint<3>>) -> Result<CellPoint<3>, f64> {
        let centroid = Element::Pyramid.centroid();
        let start = start.unwrap_or_else(|| super::start_of(&self.affine, x));
        let map = |xi| self.evaluate(xi);
        newton(map, x, start, self.affine.origin)
            .or_else(|_| newton(map, x, centroid, self.affine.origin))
    }

    /// A box around the points of the closed cell that map into `world`; `None` if there are none.
    ///
    /// Parts of the collapsed cube are contracted around the preimage and split, until they are small beside
    /// the box in the cell frame, where all of them meet in the apex. `longest` is the greatest stretch of the map.
    pub fn cell_box(&self, world: &Aabb, longest: f64) -> Option<CellBox<3>> {
        let mut found: CellBox<3> = CellBox::of([]);
        // No preimage is smaller than the box over the greatest stretch: half of that is fine enough.
        let fine = (0.5 * world.size().max() / longest).max(1e-9);
        let cube = (Vec3::zeros(), Vec3::repeat(1.0));
        let mut open = vec![(self.net.clone(), cube, cube, 0)];
        while let Some((net, part, domain, depth)) = open.pop() {
            let Some((inner, own, settled)) = self.contract(&net, part, domain, world) else {
                continue;
            };
            let covered = (0..3).all(|a| found.min[a] <= own.min[a] && own.max[a] <= found.max[a]);
            let size = (own.max - own.min).max();
            if settled || covered || size <= fine || depth == MAX_SPLIT_DEPTH {
                found.min = found.min.inf(&own.min);
                found.max = found.max.sup(&own.max);
                continue;
            }
            // Towards the apex first, so that parts there get small in the cell frame.
            let far = 1.0 - part.0.z;
            let way = (part.1 - part.0)
                .component_mul(&Vec3::new(far, far, 2.0))
                .imax();
            let (mut low, mut high) = (part, part);
            low.1[way] = f64::midpoint(part.0[way], part.1[way]);
            high.0[way] = low.1[way];
            for (net, part) in net.split(way).into_iter().zip([low, high]) {
                let domain = (part.0.sup(&inner.0), part.1.inf(&inner.1));
                let empty = (0..3).any(|a| domain.0[a] > domain.1[a]);
                if !empty && Aabb::of(net.coefficients.iter().copied()).meets(*world) {
                    open.push((net, part, domain, depth + 1));
                }
            }
        }
        if found.is_empty() {
            return None;
        }
        grow(&mut found);
        confine(Element::Pyramid, found)
    }

    /// What of a domain within a part of the cube may map into `world`, and a box around it in the cell frame. `part`
    /// is that of `net`; `domain` lies in it. `None` proves that nothing maps into `world`.
    ///
    /// With m the middle, R the radius of the domain and q half the second derivatives by r times R R, F(r) in c +- h
    /// implies |J (xi' - m') - (c - F(m))| <= h + q, where xi' is linear in r and differs from xi by at most (`R_a
    /// R_h`, `R_b R_h`, 0). The flag states that the box is within a small factor of the preimage's own.
    fn contract(
        &self,
        net: &Net<Vec3>,
        part: Span,
        domain: Span,
        world: &Aabb,
    ) -> Option<(Span, CellBox<3>, bool)> {
        let (target, half) = (world.centre().0, world.size() / 2.0);
        let size = part.1 - part.0;
        let mut bounds = bend(self.kind, net);
        for (b, [j, k]) in bounds.iter_mut().zip(PAIRS) {
            // Second derivatives by r of the whole cube: those of the part over its size.
            *b /= size[j] * size[k];
        }
        let (mut min, mut max) = domain;
        let mut cell_box = frustum(domain);
        for _ in 0..4 {
            // An interval Newton step in r and at once in xi, as in `cell_box.rs`.
            let (middle, radius) = ((min + max) / 2.0, (max - min) / 2.0);
            let (a, b, h) = (middle.x - 0.5, middle.y - 0.5, 1.0 - middle.z);
            let (x, j) = self.at(a, b, h);
            let Some(inverse) = j.try_inverse().filter(|_| h > 0.0) else {
                break;
            };
            let mut rest = Vec3::zeros();
            for (b, [j, k]) in bounds.iter().zip(PAIRS) {
                let times = if j == k { 0.5 } else { 1.0 };
                rest += b * (times * radius[j] * radius[k]);
            }
            let rounding = ROUNDING_SLACK * (x.amax() + target.amax());
            let spread = (half + rest).add_scalar(rounding);
            // dr / dxi, from x = a h, y = b h, z = (1 - h) / sqrt 2.
            let by_cell = Mat3::new(
                1.0 / h,
                0.0,
                a * SQRT_2 / h,
                0.0,
                1.0 / h,
                b * SQRT_2 / h,
                0.0,
                0.0,
                SQRT_2,
            );
            let y = by_cell * inverse;
            let (centre, reach) = (middle + y * (target - x), y.abs() * spread);
            let next = (min.sup(&(centre - reach)), max.inf(&(centre + reach)));
            let bilinear = Vec3::new(radius.x, radius.y, 0.0) * radius.z;
            let (linear, excess) = (
                inverse.abs() * half.add_scalar(rounding),
                inverse.abs() * rest + bilinear,
            );
            let (centre, reach) = (
                Vec3::new(a * h, b * h, middle.z / SQRT_2) + inverse * (target - x),
                linear + excess,
            );
            cell_box = frustum(next).intersection(CellBox {
                min: centre - reach,
                max: centre + reach,
            });
            if (0..3).any(|a| next.0[a] > next.1[a]) || cell_box.is_empty() {
                return None;
            }
            // An edge fell below 3/4, with half edges in `radius`.
            let shrunk = (0..3).any(|a| next.1[a] - next.0[a] < 1.5 * radius[a]);
            (min, max) = next;
            let adds = |share: f64| (0..3).all(|a| excess[a] <= share * linear[a] + 1e-9);
            if adds(0.25) {
                return Some(((min, max), cell_box, true));
            }
            if !shrunk {
                return Some(((min, max), cell_box, adds(0.5)));
            }
        }
        Some(((min, max), cell_box, false))
    }
}

/// The box in the cell frame around a box of parameters.
fn frustum((min, max): Span) -> CellBox<3> {
    let (far, near) = (1.0 - min.z, 1.0 - max.z);
    let span = |low: f64, high: f64| {
        let (low, high) = (low - 0.5, high - 0.5);
        [(low * far).min(low * near), (high * far).max(high * near)]
    };
    let (x, y) = (span(min.x, max.x), span(min.y, max.y));
    CellBox {
        min: Vec3::new(x[0], y[0], min.z / SQRT_2),
        max: Vec3::new(x[1], y[1], max.z / SQRT_2),
    }
}
