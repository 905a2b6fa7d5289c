//! Several cells over one scaffold: transitions by weights, graded levels.
//!
//! F = sum over cells of `W_c` `Phi_c` / `gamma_c` - T(W) - B. The weights `W_c` are interpolated between the
//! places where they are given (see [`Interpolation`]); they are not negative and sum to one everywhere.
//! `gamma_c` is the mean slope of the cell, so that no cell outweighs another. B is a grading, interpolated
//! likewise: positive values add material. F is continuous across faces if every cell is.
//!
//! T makes the blend's volume follow the weights: for two cells it is the level at which the solid fraction is
//! interpolated linearly between theirs, tabulated over the weight. For more cells, the tables of all pairs
//! are added, each weighted by the sum of the pair's weights.

use super::distribution::{Distribution, normalise};
use super::mixture::{MixedTurn, Mixture};
use super::source::{CellField, Filling, fills, single};
use super::transition_levels::{TransitionLevels, transition_levels};
use super::{Interpolation, TilingError, interface};
use crate::scaffold::Scaffold;
use druse_cells::cell::{SmoothFunction, Table};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Element, Vec3};
use rayon::prelude::*;

/// Samples along an edge of the element's box for volumes.
const VOLUME_SAMPLES: usize = 28;
/// Greatest number of members.
const MAX_MEMBERS: usize = 8;
/// Points per call to a member.
const CHUNK: usize = 16;

/// Weights of the members at a point, and their gradients.
type Weights = [(f64, Vec3); MAX_MEMBERS];

/// One cell of a palette, for every shape of element in the scaffold.
pub struct Member<'a, C: CellField = Table> {
    /// Its name in messages.
    pub name: String,
    /// The cell for each shape; all agree on shared faces.
    pub cells: Vec<&'a C>,
}

impl<C: CellField> Member<'_, C> {
    /// The cell of a shape.
    pub(super) fn of(&self, shape: Element) -> Option<&C> {
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
    /// Weights of all members.
    weights: Distribution<'a>,
    grading: Option<Distribution<'a>>,
    /// Levels of pairs i < j, in order; empty if volumes are not interpolated.
    pairs: Vec<TransitionLevels>,
    /// Elements that hold each cell in several turns.
    mixture: Option<&'a Mixture>,
}

impl<'a, C: CellField> Blend<'a, C> {
    /// Blends at most 8 cells by weights at the places of the interpolation:
    /// `weights[place * members + member]`, see [`Interpolation::places`]. Weights are clamped at 0 and
    /// divided by their sum.
    ///
    /// # Errors
    /// [`TilingError::WeightCount`], [`TilingError::Weights`] where they sum to 0 or are not finite, [`TilingError::Slope`]
    /// for a cell without slope.
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
        // 1 / gamma. A cell without slope has no surface to be weighed.
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
            mixture: None,
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

    /// The same with every cell in several turns inside some elements.
    #[must_use]
    pub fn with_mixture(mut self, mixture: &'a Mixture) -> Self {
        self.mixture = Some(mixture);
        self
    }

    /// The same with the level T, so that volumes are interpolated. There is one level for each pair of members, from
    /// samples in the first element's shape.
    #[must_use]
    pub fn with_interpolated_volumes(mut self) -> Self {
        let shape = self.scaffold.element(0).shape();
        let samples: Vec<Vec<f64>> = (0..self.members.len())
            .into_par_iter()
            .map(|m| self.member_samples(m, shape))
            .collect();
        self.pairs = Vec::new();
        for i in 0..self.members.len() {
            for j in i + 1..self.members.len() {
                self.pairs.push(transition_levels(&samples[i], &samples[j]));
            }
        }
        self
    }

    /// Values of a normalised member over an element.
    fn member_samples(&self, member: usize, shape: Element) -> Vec<f64> {
        let Some(cell) = self.members[member].of(shape) else {
            return Vec::new();
        };
        volume_samples(shape)
            .into_iter()
            .map(|p| cell.value(p) * self.scales[member])
            .collect()
    }

    /// The blend's value at a reference point of an element, for uniform weights.
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

    /// T(W) and its derivatives. `w` are the weights of the members. Zero where volumes are not interpolated. The table
    /// of a pair is read at the second cell's share of both weights.
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
                // Without weight the pair has no share, and no level.
                if sum <= 1e-12 {
                    continue;
                }
                let share = w[j] / sum;
                let (t, dt) = pair.at(share);
                total.0 += sum * t;
                // d (s t(wj / s)) is t - share dt by wi, and t + (1 - share) dt by wj. The test spares bounds checks.
                if j < 8 {
                    total.1[i] += t - share * dt;
                    total.1[j] += t + (1.0 - share) * dt;
                }
            }
        }
        total
    }

    /// Value and gradient of F = sum `W_c` `Phi_c` / `gamma_c` - T(W) - B at a point of an element. `weights` are those
    /// of the members there, `member_slope` gives value and gradient of a member, or `None` where it has no cell.
    fn mix(
        &self,
        element: usize,
        xi: CellPoint<3>,
        weights: &Weights,
        member_slope: impl Fn(usize) -> Option<(f64, Vec3)>,
    ) -> (f64, Vec3) {
        let count = self.members.len();
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        // A member without weight and without change of weight adds nothing.
        for (m, &(w, dw)) in weights[..count].iter().enumerate() {
            if w == 0.0 && dw == Vec3::zeros() {
                continue;
            }
            let Some((phi, g)) = member_slope(m) else {
                continue;
            };
            // d(W Phi) = W dPhi + Phi dW.
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

    /// The turns of the cells in an element; empty where they lie as it is numbered.
    fn turns(&self, element: usize) -> &[MixedTurn] {
        self.mixture.map_or(&[], |m| m.turns(element))
    }

    /// Values and gradients of a cell at points of an element, at most [`CHUNK`]: sum of w Phi(Q xi) over its turns.
    /// Without turns the cell lies as the element is numbered.
    fn values_in(
        &self,
        element: usize,
        cell: &C,
        points: &[CellPoint<3>],
        out: &mut [(f64, Vec3)],
    ) {
        let turns = self.turns(element);
        if turns.is_empty() {
            cell.values_and_gradients(points, out);
            return;
        }
        let shape = self.scaffold.element(element).shape();
        out.fill((0.0, Vec3::zeros()));
        let mut moved = [CellPoint(Vec3::zeros()); CHUNK];
        let mut cell_values = [(0.0, Vec3::zeros()); CHUNK];
        for turn in turns {
            for (moved, &xi) in moved.iter_mut().zip(points) {
                *moved = turn.point(xi);
            }
            let cell_values = &mut cell_values[..points.len()];
            cell.values_and_gradients(&moved[..points.len()], cell_values);
            for ((sum, &(phi, g)), &xi) in out.iter_mut().zip(&*cell_values).zip(points) {
                let (w, dw) = turn.weight(shape, xi);
                sum.0 += w * phi;
                // grad (w Phi(Q xi)) = w Q^T grad Phi + Phi grad w
                sum.1 += turn.matrix.tr_mul(&g) * w + dw * phi;
            }
        }
    }

    /// Contains the values of a cell over a box of an element.
    fn bound_in(&self, element: usize, cell: &C, region: &CellBox<3>) -> Interval {
        let turns = self.turns(element);
        // A mean of the turns lies in the hull of their values.
        let turn_bounds = turns.iter().map(|t| Field::bound(cell, &t.region(region)));
        turn_bounds
            .reduce(Interval::hull)
            .unwrap_or_else(|| Field::bound(cell, region))
    }

    /// Passes index, value and gradient of points of an element to `found`. Each member with a weight there is
    /// evaluated for many points at once. Points come in their order.
    fn for_each_value(
        &self,
        element: usize,
        points: &[CellPoint<3>],
        mut found: impl FnMut(usize, (f64, Vec3)),
    ) {
        let shape = self.scaffold.element(element).shape();
        let mut slopes = [[(0.0, Vec3::zeros()); CHUNK]; MAX_MEMBERS];
        let mut weights = [[(0.0, Vec3::zeros()); MAX_MEMBERS]; CHUNK];
        let mut first = 0;
        for points in points.chunks(CHUNK) {
            let weights = &mut weights[..points.len()];
            for (weights, &xi) in weights.iter_mut().zip(points) {
                *weights = self.weights.at(element, xi);
            }
            // A member is evaluated for all points of a chunk if any of them needs it.
            let mut is_evaluated = [false; MAX_MEMBERS];
            for (m, member) in self.members.iter().enumerate() {
                let counts = |w: &Weights| w[m].0 != 0.0 || w[m].1 != Vec3::zeros();
                let cell = member.of(shape).filter(|_| weights.iter().any(counts));
                if let Some(cell) = cell {
                    self.values_in(element, cell, points, &mut slopes[m][..points.len()]);
                    is_evaluated[m] = true;
                }
            }
            for (n, (&xi, weights)) in points.iter().zip(&*weights).enumerate() {
                let member_slope = |m: usize| is_evaluated[m].then(|| slopes[m][n]);
                found(first + n, self.mix(element, xi, weights, member_slope));
            }
            first += points.len();
        }
    }
}

impl<C: CellField> Filling for Blend<'_, C> {
    fn check(&self, scaffold: &Scaffold) -> Result<(), TilingError> {
        // Each element needs a cell of its shape from each member; pyramids have no smoothstep.
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
                        number: scaffold.number(number),
                        found: shape.name(),
                    });
                }
            }
        }
        // Around mixed elements cells continue by their weights, not by themselves.
        let is_mixed = self.mixture.is_some_and(|m| !m.is_empty());
        let members = self.members.iter().zip(&self.scales);
        for (member, scale) in members.filter(|_| !is_mixed) {
            let value = |shape, xi| member.of(shape).map_or(0.0, |c| c.value(xi));
            interface::check(scaffold, &value, 1.0 / scale)?;
        }
        Ok(())
    }

    fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        let shape = self.scaffold.element(element).shape();
        self.mix(element, xi, &self.weights.at(element, xi), |m| {
            let cell = self.members[m].of(shape)?;
            if self.turns(element).is_empty() {
                return Some(Field::value_and_gradient(cell, xi));
            }
            let mut found = [(0.0, Vec3::zeros())];
            self.values_in(element, cell, &[xi], &mut found);
            Some(found[0])
        })
    }

    fn values(&self, element: usize, points: &[CellPoint<3>], out: &mut [f64]) {
        self.for_each_value(element, points, |n, (value, _)| out[n] = value);
    }

    fn values_and_gradients_f32(
        &self,
        element: usize,
        points: &[CellPoint<3>],
        out: &mut [[f32; 4]],
    ) {
        self.for_each_value(element, points, |n, slope| out[n] = single(slope));
    }

    /// Contains F = sum `W_c` `Phi_c` / `gamma_c` - T(W) - B over a box of an element's reference frame. There are at
    /// most `MAX_MEMBERS` members.
    fn bound(&self, element: usize, region: &CellBox<3>) -> Interval {
        let shape = self.scaffold.element(element).shape();
        let count = self.members.len();
        // Ranges of weights and of normalised values.
        let mut w = [Interval::new(0.0, 0.0); 8];
        let mut phi = [Interval::new(0.0, 0.0); 8];
        for m in 0..count {
            w[m] = self.weights.range(element, m, region);
            if let Some(cell) = self.members[m].of(shape).filter(|_| w[m].hi > 0.0) {
                let b = self.bound_in(element, cell, region);
                let s = self.scales[m];
                phi[m] = Interval::new(b.lo * s, b.hi * s);
            }
        }
        // The least and greatest mean of the cells' values, over weights in their ranges that sum to one: the
        // remaining weight goes to the least (greatest) values.
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
        // T of a pair is the sum of its two weights times a level, each within its range.
        for i in 0..if self.pairs.is_empty() { 0 } else { count } {
            for j in i + 1..count {
                let pair = &self.pairs[number];
                number += 1;
                let most = (w[i].hi + w[j].hi).min(1.0);
                let least = (w[i].lo + w[j].lo).min(1.0);
                if most <= 0.0 {
                    continue;
                }
                // With one weight 0 at an end the share is 0 or 1: a half there still leaves it in the interval.
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
        let slack = 1e-12 * (range.lo.abs() + range.hi.abs()); // Rounding of the sums.
        Interval::new(range.lo - slack, range.hi + slack)
    }

    /// L with |grad F| <= L over an element, per reference length: the greatest |grad `Phi_c`| / `gamma_c` as the
    /// weights sum to one, plus |grad `W_c`| |`Phi_c`| / `gamma_c` for each member, plus the slopes of T and B.
    fn gradient_sup(&self, element: usize) -> f64 {
        let shape = self.scaffold.element(element).shape();
        let whole = shape.cell_box();
        let corner_count = self.scaffold.element(element).kind().corner_count();
        let turns = self.turns(element).iter();
        let turn_slope: f64 = turns.map(|t| t.max_slope(corner_count)).sum();
        let (mut sup, mut weight_slope) = (0f64, 0.0);
        for m in 0..self.members.len() {
            let (greatest, slope) = self.weights.extremes(element, m);
            let Some(cell) = self.members[m].of(shape).filter(|_| greatest > 0.0) else {
                continue;
            };
            let s = self.scales[m];
            // Turns of a cell blend its copies: their weights' slopes multiply the cell's greatest value.
            let b = Field::bound(cell, &whole);
            sup = sup.max((cell.gradient_sup() + turn_slope * b.hi.max(-b.lo)) * s);
            if slope > 0.0 {
                weight_slope += slope * (b.hi.max(-b.lo) * s);
            }
            // dT / `dW_c` is a sum over the pairs with this member, each at most |t| + |dt|.
            if slope > 0.0 && !self.pairs.is_empty() {
                let most = self
                    .pairs
                    .iter()
                    .map(TransitionLevels::max_slope)
                    .fold(0.0, f64::max);
                let level = self
                    .pairs
                    .iter()
                    .map(TransitionLevels::max_level)
                    .fold(0.0, f64::max);
                weight_slope += slope * (most + level) * (self.members.len() - 1) as f64;
            }
        }
        if let Some(grading) = &self.grading {
            weight_slope += grading.extremes(element, 0).1;
        }
        sup + weight_slope
    }

    /// The weights add less than one wave over an element.
    fn smooth(&self, element: usize) -> Option<SmoothFunction> {
        let shape = self.scaffold.element(element).shape();
        let mut all = self.members.iter();
        let frequency = all.try_fold(0.0, |highest: f64, m| {
            let own = m.of(shape)?.smooth()?;
            own.fold.is_none().then_some(highest.max(own.frequency))
        });
        let turns = self.turns(element);
        // A layer has ends within the element, where weights are not smooth.
        if turns.iter().any(|t| t.layer.is_some()) {
            return None;
        }
        let mixing = if turns.is_empty() { 0.0 } else { 1.0 };
        Some(SmoothFunction {
            frequency: frequency? + 1.0 + mixing,
            fold: None,
        })
    }

    // Members are divided by their mean slopes.
    fn gradient_rms(&self, _: usize) -> f64 {
        1.0
    }
}

/// A regular lattice of points in an element. For the fractions of volume of members.
fn volume_samples(shape: Element) -> Vec<CellPoint<3>> {
    let hull = shape.cell_box();
    let size = hull.max - hull.min;
    let at = |i: usize| (i as f64 + 0.5) / VOLUME_SAMPLES as f64;
    let mut found = Vec::new();
    for i in 0..VOLUME_SAMPLES {
        for j in 0..VOLUME_SAMPLES {
            for k in 0..VOLUME_SAMPLES {
                let p = hull.min + size.component_mul(&Vec3::new(at(i), at(j), at(k)));
                if shape.face_distance(CellPoint(p)) <= 0.0 {
                    found.push(CellPoint(p));
                }
            }
        }
    }
    found
}
