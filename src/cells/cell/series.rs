//! Symmetric Fourier series: one coefficient per orbit pair, evaluated exactly.
//!
//! A frequency is a tuple k of D integers, the indices on the reciprocal lattice. With u, the lattice coordinates of
//! a point, its wave is exp(2 pi i k.u), and f is its Cartesian frequency in cycles per reference length. The operators
//! of the group map a frequency to its orbit, and all members of an orbit have the same coefficient.
//! The series keeps both the coefficients and all their waves; [`TrigSum`] adds these up.

use super::CellError;
use super::trig_sum::{AXES, TrigSum};
use crate::symmetry::{Frequency, Lattice, PointGroup, SpaceGroup};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, is_in_range};
use nalgebra::SVector;
use std::f64::consts::TAU;

/// A coefficient: C = (re, im) multiplies every exponential of the orbit of `k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient<const D: usize> {
    /// The representative of the orbit.
    pub k: Frequency<D>,
    /// Real and imaginary part.
    pub c: [f64; 2],
}

/// A real, invariant, band-limited function: the sum over orbits of C exp(2 pi i k.u).
///
/// Each orbit pair (k, -k) is listed once, by its lexicographically largest member, in ascending order of
/// (|f|, k). The opposite orbit has the conjugate coefficient.
pub struct Series<const D: usize> {
    group: PointGroup<D>,
    lattice: Lattice<D>,
    coefficients: Vec<Coefficient<D>>,
    /// Every wave with its coefficient (re, im), in ascending order of the index.
    expanded: Vec<(Frequency<D>, [f64; 2])>,
    waves: TrigSum,
}

/// Largest accepted index. No cell needs a larger one, and its table would not fit in memory.
const MAX_INDEX: i32 = 4096;
/// Largest accepted number of exponentials.
const MAX_EXPONENTIALS: usize = 2_000_000;

impl<const D: usize> Series<D> {
    /// The series with these coefficients, each orbit pair at most once.
    /// `terms` are pairs of an index and (re, im); any member of the orbit, or of its opposite, may be listed.
    ///
    /// # Errors
    /// [`CellError::Coefficient`] for an orbit pair listed twice, a number that is not finite or beyond 1e18, a
    /// complex coefficient of an orbit that holds k and -k (the function would not be real), an
    /// index beyond 4096 or more than two million exponentials.
    pub fn new(
        group: PointGroup<D>,
        lattice: Lattice<D>,
        terms: &[(Frequency<D>, [f64; 2])],
    ) -> Result<Self, CellError> {
        let mut coefficients = Vec::with_capacity(terms.len());
        let mut expanded = Vec::new();
        for (place, &(k, c)) in terms.iter().enumerate() {
            let fail = |reason: String| CellError::Coefficient {
                place,
                index: format!("{k:?}"),
                reason,
            };
            if !c.iter().all(|v| is_in_range(*v)) {
                return Err(fail(format!(
                    "the coefficient {c:?} is not finite or too large; expected numbers below 1e18"
                )));
            }
            if k.iter().any(|v| v.saturating_abs() > MAX_INDEX) {
                return Err(fail(format!("the index is beyond {MAX_INDEX}")));
            }
            // One term per orbit pair +-k: of the two representatives the greater is kept, and C(-k) = conj C(k).
            let rep = group.canonical(k);
            let opposite = group.canonical(k.map(|v| -v));
            let (rep, c) = if rep < opposite {
                (opposite, [c[0], -c[1]])
            } else {
                (rep, c)
            };
            let orbit = group.orbit(rep);
            let size = c[0].abs().max(c[1].abs());
            // An orbit with k and -k needs a real coefficient. An imaginary part up to 1e-9 of the coefficient is
            // rounding and becomes 0.
            if orbit.is_self_paired() && c[1].abs() > 1e-9 * size {
                return Err(fail(format!(
                    "its orbit holds k and -k, so that the imaginary part must be 0, found {}",
                    c[1]
                )));
            }
            let c = if orbit.is_self_paired() {
                [c[0], 0.0]
            } else {
                c
            };
            // A short list of orbits may expand to very many waves in a large group.
            if expanded.len() + 2 * orbit.members.len() > MAX_EXPONENTIALS {
                return Err(fail(format!(
                    "the series has more than {MAX_EXPONENTIALS} exponentials"
                )));
            }
            // Every member of the orbit has the same coefficient C; its opposite, if it is in another orbit,
            // has the conjugate.
            for &q in &orbit.members {
                expanded.push((q, c));
                if !orbit.is_self_paired() {
                    expanded.push((q.map(|v| -v), [c[0], -c[1]]));
                }
            }
            coefficients.push((place, Coefficient { k: rep, c }));
        }
        // By frequency, then by index. The norm is rounded, so that rounding does not change the order within a shell.
        let order = |k: Frequency<D>| ((lattice.frequency_norm(k) * 1e9).round() as i64, k);
        coefficients.sort_by_key(|(_, t)| order(t.k));
        // After sorting, an orbit that is listed twice is beside itself.
        if let Some(pair) = coefficients.windows(2).find(|w| w[0].1.k == w[1].1.k) {
            return Err(CellError::Coefficient {
                place: pair[1].0,
                index: format!("{:?}", terms[pair[1].0].0),
                reason: format!(
                    "its orbit pair, that of {:?}, is listed twice (first in place {})",
                    pair[0].1.k, pair[0].0
                ),
            });
        }
        expanded.sort_by_key(|t| t.0);
        let padded = expanded.iter().map(|&(k, c)| (pad(k), c)).collect();
        Ok(Self {
            group,
            lattice,
            coefficients: coefficients.into_iter().map(|(_, t)| t).collect(),
            waves: TrigSum::new(padded),
            expanded,
        })
    }

    /// The mean over the operators of a space group with its site group: the invariant series that is nearest.
    /// Coefficients below 1e-14 of the greatest are dropped.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn mean_over(&self, space: &SpaceGroup<D>) -> Result<Self, CellError> {
        let site = space.site_group()?;
        let mean = space.mean(&self.expanded);
        let size = |c: &[f64; 2]| c[0].abs().max(c[1].abs());
        let least = 1e-14 * mean.values().map(size).fold(0.0, f64::max);
        let mut terms = Vec::new();
        for (k, mut c) in mean {
            let opposite = site.canonical(k.map(|v| -v));
            // One member of each pair of orbits.
            if site.canonical(k) != k || opposite > k || size(&c) <= least {
                continue;
            }
            if opposite == k {
                c[1] = 0.0;
            }
            terms.push((k, c));
        }
        Self::new(site, self.lattice.clone(), &terms)
    }

    /// The group under which the series is invariant.
    pub fn group(&self) -> &PointGroup<D> {
        &self.group
    }

    /// The lattice of its periods.
    pub fn lattice(&self) -> &Lattice<D> {
        &self.lattice
    }

    /// The coefficients, one per orbit pair.
    pub fn coefficients(&self) -> &[Coefficient<D>] {
        &self.coefficients
    }

    /// Every exponential with its coefficient, in ascending order of the index.
    /// The values are (re, im).
    pub fn exponentials(&self) -> &[(Frequency<D>, [f64; 2])] {
        &self.expanded
    }

    /// Largest |f| of its exponentials, in cycles per unit of reference length.
    pub fn band_limit(&self) -> f64 {
        self.coefficients
            .iter()
            .map(|t| self.lattice.frequency_norm(t.k))
            .fold(0.0, f64::max)
    }

    /// Number of real degrees of freedom in use: one per self-paired orbit, two per pair.
    pub fn degrees_of_freedom(&self) -> usize {
        self.coefficients
            .iter()
            .map(|t| {
                if self.group.orbit(t.k).is_self_paired() {
                    1
                } else {
                    2
                }
            })
            .sum()
    }

    /// Mean over the period cell: the coefficient of k = 0.
    pub fn mean(&self) -> f64 {
        self.coefficients
            .iter()
            .find(|t| t.k == [0; D])
            .map_or(0.0, |t| t.c[0])
    }

    /// Bound of |value - mean|: the sum of |C| over all exponentials except the constant.
    /// It bounds from above; the series need not reach it.
    pub fn amplitude(&self) -> f64 {
        self.sum_of(|k| if k == [0; D] { 0.0 } else { 1.0 })
    }

    /// Bound of the length of the Cartesian gradient: 2 pi sum |C| |f|.
    pub fn gradient_bound(&self) -> f64 {
        self.sum_of(|k| TAU * self.lattice.frequency_norm(k))
    }

    /// Bound of the norm of the Cartesian second derivative: 4 pi^2 sum |C| |f|^2.
    pub fn hessian_bound(&self) -> f64 {
        self.sum_of(|k| (TAU * self.lattice.frequency_norm(k)).powi(2))
    }

    /// The sum of |C| times a weight over all waves.
    fn sum_of(&self, weight: impl Fn(Frequency<D>) -> f64) -> f64 {
        self.expanded
            .iter()
            .map(|&(k, [re, im])| libm::hypot(re, im) * weight(k))
            .sum()
    }

    /// The series multiplied by a number.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        // Adding 0 turns a negative zero into a positive one; files do not keep the sign of zero.
        let scale = |c: [f64; 2]| c.map(|v| v * factor + 0.0);
        let coefficients: Vec<Coefficient<D>> = self
            .coefficients
            .iter()
            .map(|t| Coefficient {
                k: t.k,
                c: scale(t.c),
            })
            .collect();
        let expanded: Vec<_> = self.expanded.iter().map(|&(k, c)| (k, scale(c))).collect();
        self.with(coefficients, expanded)
    }

    /// The series minus a constant.
    /// `by` is in the function's unit.
    #[must_use]
    pub fn lowered(&self, by: f64) -> Self {
        let constant = [0; D];
        let lowered = |c: [f64; 2]| [c[0] - by, c[1]];
        let mut coefficients = self.coefficients.clone();
        let mut expanded = self.expanded.clone();
        // The constant is the first coefficient; in `expanded` its position is searched.
        match coefficients.first_mut().filter(|t| t.k == constant) {
            Some(t) => t.c = lowered(t.c),
            None => coefficients.insert(
                0,
                Coefficient {
                    k: constant,
                    c: [-by, 0.0],
                },
            ),
        }
        match expanded.binary_search_by_key(&constant, |t| t.0) {
            Ok(at) => expanded[at].1 = lowered(expanded[at].1),
            Err(at) => expanded.insert(at, (constant, [-by, 0.0])),
        }
        self.with(coefficients, expanded)
    }

    /// a self + b other, if both have the same group and lattice.
    /// `None` if group or lattice differ.
    pub fn plus(&self, a: f64, other: &Self, b: f64) -> Option<Self> {
        if self.group.operators() != other.group.operators() || self.lattice != other.lattice {
            return None;
        }
        // The order of `new`, by which both lists are sorted.
        let order = |k: Frequency<D>| ((self.lattice.frequency_norm(k) * 1e9).round() as i64, k);
        let mut coefficients: Vec<Coefficient<D>> = self.scaled(a).coefficients;
        for t in &other.coefficients {
            let c = t.c.map(|v| v * b);
            match coefficients.binary_search_by_key(&order(t.k), |s| order(s.k)) {
                Ok(index) => {
                    let old = coefficients[index].c;
                    coefficients[index].c = [old[0] + c[0], old[1] + c[1]];
                }
                Err(index) => coefficients.insert(index, Coefficient { k: t.k, c }),
            }
        }
        // Waves with the same index are neighbours after sorting and add up.
        let mut expanded = self.scaled(a).expanded;
        expanded.extend(other.expanded.iter().map(|&(k, c)| (k, c.map(|v| v * b))));
        expanded.sort_by_key(|t| t.0);
        expanded.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 = [kept.1[0] + next.1[0], kept.1[1] + next.1[1]];
            }
            same
        });
        Some(self.with(coefficients, expanded))
    }

    /// A series over the same group and lattice with other coefficients.
    /// The lists keep the orders of [`Series`]; neither is checked.
    fn with(
        &self,
        coefficients: Vec<Coefficient<D>>,
        expanded: Vec<(Frequency<D>, [f64; 2])>,
    ) -> Self {
        Self {
            group: self.group.clone(),
            lattice: self.lattice.clone(),
            coefficients,
            waves: TrigSum::new(expanded.iter().map(|&(k, c)| (pad(k), c)).collect()),
            expanded,
        }
    }

    /// The lattice coordinates of a point, on the last axes as [`pad`] puts indices; the others are 0.
    fn lattice_point(&self, p: CellPoint<D>) -> [f64; AXES] {
        let u = self.lattice.inverse() * p.0;
        let mut padded = [0.0; AXES];
        for a in 0..D {
            padded[AXES - D + a] = u[a];
        }
        padded
    }
}

impl<const D: usize> std::fmt::Debug for Series<D> {
    /// Shows the group, the lattice and the coefficients; derived data is omitted.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Series")
            .field("group", &self.group.name())
            .field("lattice", &self.lattice.vectors())
            .field("coefficients", &self.coefficients)
            .finish_non_exhaustive()
    }
}

/// Puts the indices on the last axes, where the inner loop runs.
fn pad<const D: usize>(k: Frequency<D>) -> [i32; AXES] {
    let mut padded = [0; AXES];
    padded[AXES - D..].copy_from_slice(&k);
    padded
}

impl<const D: usize> Field for Series<D> {
    type Point = CellPoint<D>;

    fn value(&self, p: CellPoint<D>) -> f64 {
        self.waves.value(self.lattice_point(p))
    }

    fn value_and_gradient(&self, p: CellPoint<D>) -> (f64, SVector<f64, D>) {
        let (v, g) = self.waves.value_and_gradient(self.lattice_point(p));
        let g = SVector::<f64, D>::from_fn(|a, _| g[AXES - D + a]);
        // Derivatives in lattice coordinates become Cartesian by the transpose of the inverse lattice.
        (v, self.lattice.inverse().tr_mul(&g))
    }

    fn bound(&self, region: &CellBox<D>) -> Interval {
        let centre = (region.min + region.max) / 2.0;
        let radius = (region.max - region.min).norm() / 2.0;
        let (v, g) = self.value_and_gradient(CellPoint(centre));
        // Taylor bounds of first order (gradient bound) and second order (gradient at the centre).
        let reach = (self.gradient_bound() * radius)
            .min(g.norm() * radius + self.hessian_bound() * radius * radius / 2.0);
        // The slack covers the rounding of the sum of waves.
        let (m, a) = (self.mean(), self.amplitude());
        let slack = 1e-12 * (m.abs() + a);
        Interval::new(
            (v - reach).max(m - a) - slack,
            (v + reach).min(m + a) + slack,
        )
    }
}
