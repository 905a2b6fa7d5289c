//! Levels: the surface inside the element, the volume it cuts off, and the level for a wanted one.
//!
//! All integrals are over the *element* (of a tet one third of the cube). The function is taken as
//! linear on small tetrahedra of the fundamental simplex; the error is of second order in their
//! size, and levels are extrapolated from two sizes.

use super::domain::{Domain, SimplexGrid};
use super::{Cell, CellError, Solid};
use crate::field::Field;
use crate::frame::CellPoint;
use rayon::prelude::*;

/// Fraction of a tetrahedron where a linear function with these corner values is below `t`, and its
/// derivative with respect to `t`.
fn fraction_below(mut v: [f64; 4], t: f64) -> (f64, f64) {
    v.sort_unstable_by(f64::total_cmp);
    let [a, b, c, d] = v;
    if t <= a {
        (0.0, 0.0)
    } else if t >= d {
        (1.0, 0.0)
    } else if t < b {
        let q = (b - a) * (c - a) * (d - a);
        ((t - a).powi(3) / q, 3.0 * (t - a).powi(2) / q)
    } else if t < c {
        let (q, s) = ((c - a) * (d - a), t - b);
        let r = ((c - a) + (d - b)) / ((c - b) * (d - b));
        (
            ((b - a).powi(2) + 3.0 * (b - a) * s + 3.0 * s * s - r * s.powi(3)) / q,
            (3.0 * (b - a) + 6.0 * s - 3.0 * r * s * s) / q,
        )
    } else {
        let q = (d - a) * (d - b) * (d - c);
        (1.0 - (d - t).powi(3) / q, 3.0 * (d - t).powi(2) / q)
    }
}

/// The sum over the tetrahedra of one layer of the shares below `t`, and its derivative, with every `skip`-th
/// point per edge of the lattice that has the values.
fn layer_below(i: usize, t: f64, skip: usize, values: &[f64]) -> (f64, f64) {
    let at = |c: [usize; 3]| values[SimplexGrid::index(c.map(|x| x * skip))];
    let mut sum = (0.0, 0.0);
    for j in 0..=i {
        for k in 0..=j {
            // Most cubes lie on one side altogether.
            if i > j && j > k {
                let mut range = (f64::INFINITY, f64::NEG_INFINITY);
                for (i, j) in [(i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)] {
                    for v in [at([i, j, k]), at([i, j, k + 1])] {
                        range = (range.0.min(v), range.1.max(v));
                    }
                }
                if t <= range.0 {
                    continue;
                }
                if t >= range.1 {
                    sum.0 += 6.0;
                    continue;
                }
            }
            SimplexGrid::cube([i, j, k], |corners| {
                let (f, df) = fraction_below(corners.map(at), t);
                sum.0 += f;
                sum.1 += df;
            });
        }
    }
    sum
}

/// Values of a cell's function on the simplex lattice of every flag, coarse and fine.
pub(super) struct Samples {
    /// Flag by flag, each in the order of [`SimplexGrid::index`].
    pub values: Vec<f64>,
    domain: Domain,
    grid: SimplexGrid,
}

impl Samples {
    pub fn new(cell: &Cell, parts: usize) -> Self {
        let domain = Domain::solid(cell.element, &cell.operators);
        // As many points in all, whatever the number of flags; coarse grids need an even number.
        let share = libm::cbrt(domain.flags.len() as f64).recip();
        let parts = ((parts as f64 * share) as usize).next_multiple_of(2).max(8);
        let grid = SimplexGrid::new(parts);
        let coordinates = grid.coordinates();
        let values = domain
            .flags
            .iter()
            .flat_map(|flag| {
                let value = |c: &[f64; 3]| cell.form.value(flag.point(*c));
                coordinates.par_iter().map(value).collect::<Vec<f64>>()
            })
            .collect();
        Self {
            values,
            domain,
            grid,
        }
    }

    /// Parts per edge that a second or so of evaluation allows.
    fn parts(cell: &Cell) -> usize {
        match cell.form.exponentials() {
            0..500 => 96,
            500..10_000 => 48,
            _ => 24,
        }
    }

    /// The values on one flag.
    fn on_flag(&self, flag: usize) -> &[f64] {
        let count = self.values.len() / self.domain.flags.len();
        &self.values[flag * count..(flag + 1) * count]
    }

    pub fn range(&self) -> (f64, f64) {
        self.values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| {
                (lo.min(v), hi.max(v))
            })
    }

    /// Share of the element below `t` and its derivative, with every `skip`-th point per edge.
    fn below(&self, t: f64, skip: usize) -> (f64, f64) {
        let grid = SimplexGrid::new(self.grid.parts() / skip);
        let count = (grid.parts() as f64).powi(3);
        let mut total = (0.0, 0.0);
        for (number, flag) in self.domain.flags.iter().enumerate() {
            let values = self.on_flag(number);
            let layers: Vec<(f64, f64)> = (0..grid.parts())
                .into_par_iter()
                .map(|i| layer_below(i, t, skip, values))
                .collect();
            let weight = flag.share / count;
            for (f, df) in layers {
                total = (total.0 + f * weight, total.1 + df * weight);
            }
        }
        total
    }

    /// Share of the element that is solid, with its derivative by the level.
    fn solid(&self, solid: Solid, level: f64, skip: usize) -> (f64, f64) {
        let one_side = || self.below(level, skip);
        let band = || {
            let (above, below) = (self.below(level, skip), self.below(-level, skip));
            (above.0 - below.0, above.1 + below.1)
        };
        match solid {
            Solid::Below => one_side(),
            Solid::Above => {
                let (f, d) = one_side();
                (1.0 - f, -d)
            }
            Solid::Sheet => band(),
            Solid::Channels => {
                let (f, d) = band();
                (1.0 - f, -d)
            }
        }
    }

    /// The level at which the solid's share is `fraction`: bisection safeguards Newton's steps.
    fn level_for(&self, solid: Solid, fraction: f64, skip: usize) -> f64 {
        let (lo, hi) = self.range();
        let (mut lo, mut hi) = if solid.is_symmetric() {
            (0.0, lo.abs().max(hi.abs()))
        } else {
            (lo, hi)
        };
        let rising = matches!(solid, Solid::Below | Solid::Sheet);
        let mut t = f64::midpoint(lo, hi);
        for _ in 0..80 {
            let (f, d) = self.solid(solid, t, skip);
            if (f < fraction) == rising {
                lo = t;
            } else {
                hi = t;
            }
            let newton = t - (f - fraction) / d;
            let next = if newton > lo && newton < hi {
                newton
            } else {
                f64::midpoint(lo, hi)
            };
            if (next - t).abs() <= 1e-14 * (hi.abs() + lo.abs()) || hi - lo <= 0.0 {
                return next;
            }
            t = next;
        }
        t
    }
}

impl Cell {
    /// Share of the element that is solid (relative error about 1e-4 for a fitted cell, less for a
    /// closed form).
    pub fn volume_fraction(&self) -> f64 {
        let samples = Samples::new(self, Samples::parts(self));
        let fine = samples.solid(self.solid, self.level, 1).0;
        let coarse = samples.solid(self.solid, self.level, 2).0;
        ((4.0 * fine - coarse) / 3.0).clamp(0.0, 1.0)
    }

    /// The level at which this share of the element is solid.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] unless 0 < fraction < 1.
    pub fn level_for_volume_fraction(&self, fraction: f64) -> Result<f64, CellError> {
        if !(fraction > 0.0 && fraction < 1.0) {
            return Err(CellError::OutOfRange {
                what: "volume_fraction",
                found: fraction,
                expected: "a share of the element, above 0 and below 1".to_owned(),
            });
        }
        let samples = Samples::new(self, Samples::parts(self));
        let (lo, hi) = samples.range();
        if hi - lo <= 1e-12 * hi.abs().max(lo.abs()).max(f64::MIN_POSITIVE) {
            return Err(self.no_surface("solid", lo, hi));
        }
        let fine = samples.level_for(self.solid, fraction, 1);
        let coarse = samples.level_for(self.solid, fraction, 2);
        Ok((4.0 * fine - coarse) / 3.0)
    }

    pub(super) fn no_surface(&self, missing: &'static str, least: f64, greatest: f64) -> CellError {
        CellError::NoSurface {
            missing,
            element: self.element.name(),
            least,
            greatest,
            level: self.level,
        }
    }

    /// Whether the element holds both solid and void, by samples; else the error that says which
    /// is missing and what the field's range is.
    ///
    /// # Errors
    /// [`CellError::NoSurface`].
    pub fn check_surface(&self) -> Result<(), CellError> {
        let samples = Samples::new(self, 24);
        let solid = |v: &f64| self.solid.value(*v, self.level) < 0.0;
        let (lo, hi) = samples.range();
        if !samples.values.iter().any(solid) {
            return Err(self.no_surface("solid", lo, hi));
        }
        if samples.values.iter().all(solid) {
            return Err(self.no_surface("void", lo, hi));
        }
        Ok(())
    }

    /// Root mean square of the gradient on the surface inside the element (gamma), per unit of
    /// reference length; over the whole element if it holds no surface.
    pub fn gamma(&self) -> f64 {
        *self.gamma.get_or_init(|| {
            let levels: &[f64] = match self.solid {
                Solid::Below | Solid::Above => &[self.level],
                Solid::Sheet | Solid::Channels => &[self.level, -self.level],
            };
            self.gamma_at(levels)
        })
    }

    /// Root mean square of the gradient over the surfaces Phi = level inside the element.
    pub(super) fn gamma_at(&self, levels: &[f64]) -> f64 {
        let samples = Samples::new(self, Samples::parts(self).min(32));
        let pieces: Vec<Piece> = levels
            .iter()
            .flat_map(|&t| Piece::all(&samples, t))
            .collect();
        let squares: Vec<f64> = pieces
            .par_iter()
            .map(|p| {
                // The centre of a flat piece lies beside a curved surface: one step onto it.
                let (v, g) = self.form.value_and_gradient(p.centre);
                let step = g * ((v - p.level) / g.norm_squared().max(f64::MIN_POSITIVE));
                let foot = CellPoint(p.centre.0 - step);
                self.form.value_and_gradient(foot).1.norm_squared() * p.area
            })
            .collect();
        let area: f64 = pieces.iter().map(|p| p.area).sum();
        if area > 0.0 {
            return (squares.iter().sum::<f64>() / area).sqrt();
        }
        let points = SimplexGrid::new(12).coordinates();
        let mut mean = 0.0;
        for flag in &samples.domain.flags {
            for &c in &points {
                let square = self.form.value_and_gradient(flag.point(c)).1.norm_squared();
                mean += square * flag.share / points.len() as f64;
            }
        }
        mean.sqrt()
    }
}

/// The part of a level surface in a small tetrahedron, as if the function were linear there.
pub(super) struct Piece {
    level: f64,
    pub area: f64,
    pub centre: CellPoint<3>,
}

impl Piece {
    /// The pieces of the surface where the function is `t`; every flag has as many images.
    pub fn all(samples: &Samples, t: f64) -> Vec<Self> {
        let mut pieces = Vec::new();
        for flag in 0..samples.domain.flags.len() {
            samples.grid.tetrahedra(|corners| {
                pieces.extend(Self::cut(samples, flag, corners, t));
            });
        }
        pieces
    }

    fn cut(samples: &Samples, flag: usize, corners: [[usize; 3]; 4], t: f64) -> Option<Self> {
        let values = samples.on_flag(flag);
        let v = corners.map(|c| values[SimplexGrid::index(c)]);
        let (_, density) = fraction_below(v, t);
        if density <= 0.0 {
            return None;
        }
        let n = samples.grid.parts() as f64;
        let f = &samples.domain.flags[flag];
        let p = corners.map(|c| f.point(c.map(|x| x as f64 / n)).0);
        let edges = nalgebra::Matrix3::from_rows(&[1, 2, 3].map(|i| (p[i] - p[0]).transpose()));
        let rise = nalgebra::Vector3::new(v[1] - v[0], v[2] - v[0], v[3] - v[0]);
        let gradient = edges.try_inverse()? * rise;
        let (mut centre, mut count) = (nalgebra::Vector3::zeros(), 0.0);
        for i in 0..4 {
            for j in 0..i {
                if (v[i] < t) != (v[j] < t) {
                    centre += p[j] + (p[i] - p[j]) * ((t - v[j]) / (v[i] - v[j]));
                    count += 1.0;
                }
            }
        }
        // The share of the volume grows by area / (gradient volume) with the level.
        (count > 0.0).then(|| Self {
            level: t,
            area: density * gradient.norm() * edges.determinant().abs() / 6.0,
            centre: CellPoint(centre / count),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cubes that are told at a glance add what their six tetrahedra do.
    #[test]
    fn layers_add_up_their_tetrahedra() {
        const PARTS: usize = 12;
        let wave = |c: &[f64; 3]| libm::sin(5.0 * c[0]) + libm::cos(4.0 * c[1]) * c[2];
        let values: Vec<f64> = SimplexGrid::new(PARTS)
            .coordinates()
            .iter()
            .map(wave)
            .collect();
        for (t, skip) in [(0.1, 1), (0.7, 2), (-0.4, 1), (9.0, 2), (-9.0, 1)] {
            let (mut sum, mut told) = ((0.0, 0.0), (0.0, 0.0));
            let coarse = SimplexGrid::new(PARTS / skip);
            coarse.tetrahedra(|tet| {
                let v = tet.map(|c| values[SimplexGrid::index(c.map(|x| x * skip))]);
                let (f, df) = fraction_below(v, t);
                sum = (sum.0 + f, sum.1 + df);
            });
            for i in 0..coarse.parts() {
                let (f, df) = layer_below(i, t, skip, &values);
                told = (told.0 + f, told.1 + df);
            }
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
            assert!(
                near(told.0, sum.0) && near(told.1, sum.1),
                "{t} {told:?} {sum:?}"
            );
        }
    }
}
