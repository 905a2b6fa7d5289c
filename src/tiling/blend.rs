//! Several cells over one scaffold: transitions by weights, graded levels.
//!
//! F = sum over cells of `W_c` `Phi_c` / `gamma_c` - T(W) - B, with the weights `W_c` interpolated
//! between the places where they are given (see [`Interpolation`]), `gamma_c` the mean slope of the
//! cell, so that no cell outweighs another, and B a grading, interpolated likewise: positive values
//! add material. Weights are not negative and sum to one at every place, hence everywhere. All of it
//! is continuous across faces if every cell is.
//!
//! T follows the blend's volume: for two cells it is the level at which the blend's share of the
//! element is interpolated linearly between theirs, tabulated over the weight; for more the pairs'
//! tables are added, weighted by what the pair has of the whole.

use super::distribution::{Distribution, normalise};
use super::source::{CellField, Filling, fills, single};
use super::transition_levels::{Pair, pair};
use super::{Interpolation, TilingError, interface};
use crate::cell::{Smooth, Table};
use crate::field::{Field, Interval};
use crate::frame::{CellBox, CellPoint, Element, Vec3};
use crate::scaffold::Scaffold;
use rayon::prelude::*;

/// Samples along an edge of the element's box for volumes.
const SAMPLES: usize = 28;
/// Most members.
const MOST: usize = 8;
/// Points that members are asked for together.
const TOGETHER: usize = 16;

/// Weights of the members at a point, and their gradients.
type Weights = [(f64, Vec3); MOST];

/// One cell of a palette, for every shape of element that it has to fill.
pub struct Member<'a, C: CellField = Table> {
    /// Its name, for messages.
    pub name: String,
    /// The cell for each shape: all the same function on shared faces.
    pub cells: Vec<&'a C>,
}

impl<C: CellField> Member<'_, C> {
    fn of(&self, shape: Element) -> Option<&C> {
        let found = self.cells.iter().find(|c| c.element() == shape);
        let found = found.or_else(|| self.cells.iter().find(|c| fills(c.element(), shape)));
        found.copied()
    }
}

/// Several cells over one scaffold.
pub struct Blend<'a, C: CellField = Table> {
    scaffold: &'a Scaffold,
    members: Vec<Member<'a, C>>,
    /// 1 / gamma of each member, the same for all shapes.
    scales: Vec<f64>,
    /// One for each member.
    weights: Distribution<'a>,
    grading: Option<Distribution<'a>>,
    /// Levels of pairs i < j, in order; empty if volumes are not followed.
    pairs: Vec<Pair>,
}

impl<'a, C: CellField> Blend<'a, C> {
    /// Blends at most 8 cells by weights at the places of the interpolation:
    /// `weights[place * members + member]`, see [`Interpolation::places`]. Weights are clamped at 0 and
    /// divided by their sum.
    ///
    /// # Errors
    /// [`TilingError::WeightCount`], [`TilingError::Weights`] where they sum to 0 or are not finite, [`TilingError::Slope`] for a
    /// cell without slope.
    pub fn new(
        scaffold: &'a Scaffold,
        members: Vec<Member<'a, C>>,
        mut weights: Vec<f64>,
        interpolation: Interpolation,
    ) -> Result<Self, TilingError> {
        let count = members.len();
        let found = weights.len();
        normalise(scaffold, interpolation, count, &mut weights)?;
        let weights = Distribution::new(scaffold, interpolation, count, weights)
            .map_err(|expected| TilingError::WeightCount { found, expected })?;
        let mut scales = Vec::new();
        for member in &members {
            let rms = member.cells.first().map_or(0.0, |c| c.gradient_rms());
            if !(rms.is_finite() && rms > 0.0) {
                return Err(TilingError::Slope { rms, sup: rms });
            }
            scales.push(1.0 / rms);
        }
        Ok(Self {
            scaffold,
            members,
            scales,
            weights,
            grading: None,
            pairs: Vec::new(),
        })
    }

    /// The same with a grading at the same places, in units of the normalised field (reference lengths
    /// where a cell is a distance); positive values add material.
    ///
    /// # Errors
    /// [`TilingError::WeightCount`].
    pub fn graded(mut self, grading: Vec<f64>) -> Result<Self, TilingError> {
        let found = grading.len();
        let how = self.weights.interpolation();
        let grading = Distribution::new(self.scaffold, how, 1, grading);
        self.grading =
            Some(grading.map_err(|expected| TilingError::WeightCount { found, expected })?);
        Ok(self)
    }

    /// The same with its level following the blend, so that volumes are interpolated.
    #[must_use]
    pub fn with_volumes_followed(mut self) -> Self {
        let shape = self.scaffold.element(0).shape();
        let samples: Vec<Vec<f64>> = (0..self.members.len())
            .into_par_iter()
            .map(|m| self.samples(m, shape))
            .collect();
        self.pairs = Vec::new();
        for i in 0..self.members.len() {
            for j in i + 1..self.members.len() {
                self.pairs.push(pair(&samples[i], &samples[j]));
            }
        }
        self
    }

    /// Values of a normalised member over an element.
    fn samples(&self, member: usize, shape: Element) -> Vec<f64> {
        let Some(cell) = self.members[member].of(shape) else {
            return Vec::new();
        };
        points(shape)
            .into_iter()
            .map(|p| cell.value(p) * self.scales[member])
            .collect()
    }

    /// The blend's value at a point of an element's frame for weights that are the same everywhere.
    pub fn uniform(&self, shape: Element, weights: &[f64], xi: CellPoint<3>) -> f64 {
        let sum: f64 = (0..self.members.len())
            .filter(|&m| weights[m] > 0.0)
            .filter_map(|m| {
                Some(weights[m] * self.scales[m] * self.members[m].of(shape)?.value(xi))
            })
            .sum();
        sum - self.level(weights).0
    }

    /// Weights of the members at a point.
    pub fn weights(&self, element: usize, xi: CellPoint<3>) -> Vec<f64> {
        let all = self.weights.at(element, xi);
        all[..self.members.len()].iter().map(|w| w.0).collect()
    }

    /// The palette.
    pub fn members(&self) -> &[Member<'a, C>] {
        &self.members
    }

    /// T(W) and its derivatives.
    fn level(&self, w: &[f64]) -> (f64, [f64; 8]) {
        let mut total = (0.0, [0.0; 8]);
        let count = self.members.len();
        if self.pairs.is_empty() {
            return total;
        }
        let mut number = 0;
        for i in 0..count {
            for j in i + 1..count {
                let pair = &self.pairs[number];
                number += 1;
                let sum = w[i] + w[j];
                if sum <= 1e-12 {
                    continue;
                }
                let share = w[j] / sum;
                let (t, dt) = pair.at(share);
                total.0 += sum * t;
                // d (s t(wj / s)): by wi t - share dt, by wj t + (1 - share) dt.
                if j < 8 {
                    total.1[i] += t - share * dt;
                    total.1[j] += t + (1.0 - share) * dt;
                }
            }
        }
        total
    }

    /// Value and gradient at a point, from the members' and their weights there.
    fn mix(
        &self,
        (element, xi): (usize, CellPoint<3>),
        weights: &Weights,
        of: impl Fn(usize) -> Option<(f64, Vec3)>,
    ) -> (f64, Vec3) {
        let count = self.members.len();
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        for (m, &(w, dw)) in weights[..count].iter().enumerate() {
            if w == 0.0 && dw == Vec3::zeros() {
                continue;
            }
            let Some((phi, g)) = of(m) else {
                continue;
            };
            let s = self.scales[m];
            value += w * s * phi;
            gradient += g * (w * s) + dw * (s * phi);
        }
        if !self.pairs.is_empty() {
            let (t, by) = self.level(&weights.map(|w| w.0)[..count]);
            value -= t;
            for m in 0..count {
                gradient -= weights[m].1 * by[m];
            }
        }
        if let Some(grading) = &self.grading {
            let (b, db) = grading.at(element, xi)[0];
            value -= b;
            gradient -= db;
        }
        (value, gradient)
    }

    /// Hands value and gradient at points of an element to `found`, with the point's number: each member
    /// that shares in some of them is asked for many at once.
    fn in_bulk(
        &self,
        element: usize,
        points: &[CellPoint<3>],
        mut found: impl FnMut(usize, (f64, Vec3)),
    ) {
        let shape = self.scaffold.element(element).shape();
        let mut slopes = [[(0.0, Vec3::zeros()); TOGETHER]; MOST];
        let mut weights = [[(0.0, Vec3::zeros()); MOST]; TOGETHER];
        let mut first = 0;
        for points in points.chunks(TOGETHER) {
            let weights = &mut weights[..points.len()];
            for (weights, &xi) in weights.iter_mut().zip(points) {
                *weights = self.weights.at(element, xi);
            }
            let mut shares = [false; MOST];
            for (m, member) in self.members.iter().enumerate() {
                let counts = |w: &Weights| w[m].0 != 0.0 || w[m].1 != Vec3::zeros();
                let cell = member.of(shape).filter(|_| weights.iter().any(counts));
                if let Some(cell) = cell {
                    cell.slopes(points, &mut slopes[m][..points.len()]);
                    shares[m] = true;
                }
            }
            for (n, (&xi, weights)) in points.iter().zip(&*weights).enumerate() {
                let of = |m: usize| shares[m].then(|| slopes[m][n]);
                found(first + n, self.mix((element, xi), weights, of));
            }
            first += points.len();
        }
    }
}

impl<C: CellField> Filling for Blend<'_, C> {
    fn check(&self, scaffold: &Scaffold) -> Result<(), TilingError> {
        for number in 0..scaffold.len() {
            let shape = scaffold.element(number).shape();
            if shape == Element::Pyramid
                && self.weights.interpolation() == Interpolation::Smoothstep
            {
                return Err(TilingError::Smoothstep {
                    number: scaffold.number(number),
                });
            }
            for member in &self.members {
                if member.of(shape).is_none() {
                    return Err(TilingError::Shape {
                        cell: member
                            .cells
                            .first()
                            .map_or("nothing", |c| c.element().name()),
                        number,
                        found: shape.name(),
                    });
                }
            }
        }
        for (member, scale) in self.members.iter().zip(&self.scales) {
            let value = |shape, xi| member.of(shape).map_or(0.0, |c| c.value(xi));
            interface::check(scaffold, &value, 1.0 / scale)?;
        }
        Ok(())
    }

    fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        let shape = self.scaffold.element(element).shape();
        self.mix((element, xi), &self.weights.at(element, xi), |m| {
            let cell = self.members[m].of(shape)?;
            Some(Field::value_and_gradient(cell, xi))
        })
    }

    fn values(&self, element: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        self.in_bulk(element, points, |n, (value, _)| out[n] = value);
    }

    fn slopes(&self, element: usize, points: &[CellPoint<3>], out: &mut [(f64, Vec3)]) {
        self.in_bulk(element, points, |n, slope| out[n] = slope);
    }

    fn samples(&self, element: usize, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        self.in_bulk(element, points, |n, slope| out[n] = single(slope));
    }

    fn bound(&self, element: usize, region: &CellBox<3>) -> Interval {
        let shape = self.scaffold.element(element).shape();
        let count = self.members.len();
        let mut w = [Interval::new(0.0, 0.0); 8];
        let mut phi = [Interval::new(0.0, 0.0); 8];
        for m in 0..count {
            w[m] = self.weights.range(element, m, region);
            if let Some(cell) = self.members[m].of(shape).filter(|_| w[m].hi > 0.0) {
                let b = Field::bound(cell, region);
                let s = self.scales[m];
                phi[m] = Interval::new(b.lo * s, b.hi * s);
            }
        }
        // The least and greatest mean of the cells' values over weights in their ranges that sum to
        // one: what is not fixed goes to the least (greatest).
        let mean = |greatest: bool| {
            let key = |m: usize| if greatest { -phi[m].hi } else { phi[m].lo };
            let mut order: [usize; 8] = [0, 1, 2, 3, 4, 5, 6, 7];
            order[..count].sort_by(|&a, &b| key(a).total_cmp(&key(b)));
            let mut left = 1.0 - w[..count].iter().map(|w| w.lo).sum::<f64>();
            let mut sum = 0.0;
            for &m in &order[..count] {
                let more = (w[m].hi - w[m].lo).min(left.max(0.0));
                left -= more;
                sum += (w[m].lo + more) * if greatest { phi[m].hi } else { phi[m].lo };
            }
            sum
        };
        let mut range = Interval::new(mean(false), mean(true));
        let mut number = 0;
        for i in 0..if self.pairs.is_empty() { 0 } else { count } {
            for j in i + 1..count {
                let pair = &self.pairs[number];
                number += 1;
                let most = (w[i].hi + w[j].hi).min(1.0);
                let least = (w[i].lo + w[j].lo).min(1.0);
                if most <= 0.0 {
                    continue;
                }
                let share = |a: f64, b: f64| if a + b > 0.0 { b / (a + b) } else { 0.5 };
                let shares = Interval::new(share(w[i].hi, w[j].lo), share(w[i].lo, w[j].hi));
                let t = pair.range(shares);
                let ends = [t.lo * least, t.lo * most, t.hi * least, t.hi * most];
                range.lo -= ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
                range.hi -= ends.into_iter().fold(f64::INFINITY, f64::min);
            }
        }
        if let Some(grading) = &self.grading {
            let b = grading.range(element, 0, region);
            range.lo -= b.hi;
            range.hi -= b.lo;
        }
        let slack = 1e-12 * (range.lo.abs() + range.hi.abs());
        Interval::new(range.lo - slack, range.hi + slack)
    }

    fn gradient_sup(&self, element: usize) -> f64 {
        let shape = self.scaffold.element(element).shape();
        let whole = shape.cell_box();
        let (mut sup, mut moving) = (0f64, 0.0);
        for m in 0..self.members.len() {
            let (greatest, turn) = self.weights.extremes(element, m);
            let Some(cell) = self.members[m].of(shape).filter(|_| greatest > 0.0) else {
                continue;
            };
            let s = self.scales[m];
            sup = sup.max(cell.gradient_sup() * s);
            if turn > 0.0 {
                let b = Field::bound(cell, &whole);
                moving += turn * (b.hi.max(-b.lo) * s);
            }
            if turn > 0.0 && !self.pairs.is_empty() {
                let most = self.pairs.iter().map(Pair::steepest).fold(0.0, f64::max);
                let level = self.pairs.iter().map(Pair::greatest).fold(0.0, f64::max);
                moving += turn * (most + level) * (self.members.len() - 1) as f64;
            }
        }
        if let Some(grading) = &self.grading {
            moving += grading.extremes(element, 0).1;
        }
        sup + moving
    }

    /// Weights go through less than a wave over an element.
    fn smooth(&self, element: usize) -> Option<Smooth> {
        let shape = self.scaffold.element(element).shape();
        let mut all = self.members.iter();
        let greatest = all.try_fold(0.0, |most: f64, m| {
            let own = m.of(shape)?.smooth()?;
            own.fold.is_none().then_some(most.max(own.frequency))
        });
        Some(Smooth {
            frequency: greatest? + 1.0,
            fold: None,
        })
    }

    fn gradient_rms(&self, _: usize) -> f64 {
        1.0
    }
}

/// Points spread evenly over an element.
fn points(shape: Element) -> Vec<CellPoint<3>> {
    let hull = shape.cell_box();
    let size = hull.max - hull.min;
    let at = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
    let mut found = Vec::new();
    for i in 0..SAMPLES {
        for j in 0..SAMPLES {
            for k in 0..SAMPLES {
                let p = hull.min + size.component_mul(&Vec3::new(at(i), at(j), at(k)));
                if shape.face_distance(CellPoint(p)) <= 0.0 {
                    found.push(CellPoint(p));
                }
            }
        }
    }
    found
}
