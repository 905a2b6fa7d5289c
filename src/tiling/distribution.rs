//! Numbers that differ over a scaffold: weights of cells, gradings of levels.
//!
//! They are given at the nodes and go on between the corners of elements, or at control points
//! in space, where they are smooth whatever the elements are.

use super::TilingError;
use super::control_lattice::ControlLattice;
use super::corners::Corners;
use crate::field::Interval;
use crate::frame::{Aabb, CellBox, CellPoint, Element, Vec3, WorldPoint};
use crate::scaffold::Scaffold;

/// How numbers go on between the places where they are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Linear along edges.
    #[default]
    Linear,
    /// Flat at the corners, steep between them.
    Smoothstep,
    /// Twice differentiable in space, by control points about an element apart.
    Smooth,
}

impl Interpolation {
    /// Where the numbers are given: the scaffold's nodes, of which only corners count, or control
    /// points around it.
    pub fn places(self, scaffold: &Scaffold) -> Vec<Vec3> {
        match self {
            Self::Linear | Self::Smoothstep => scaffold.nodes().to_vec(),
            Self::Smooth => ControlLattice::around(scaffold).points(),
        }
    }
}

/// Greatest number of numbers at a place.
pub(super) const MOST: usize = 8;

/// Numbers over a scaffold, at most [`MOST`] at each place.
pub(super) struct Distribution<'a> {
    scaffold: &'a Scaffold,
    count: usize,
    /// By place, then number.
    values: Vec<f64>,
    how: Interpolation,
    lattice: Option<ControlLattice>,
}

impl<'a> Distribution<'a> {
    /// `count` numbers at each of the interpolation's places; as many as there should be if there are
    /// not.
    pub fn new(
        scaffold: &'a Scaffold,
        how: Interpolation,
        count: usize,
        values: Vec<f64>,
    ) -> Result<Self, usize> {
        let lattice = (how == Interpolation::Smooth).then(|| ControlLattice::around(scaffold));
        let places = lattice.map_or(scaffold.nodes().len(), |l| l.points().len());
        if count == 0 || count > MOST || values.len() != count * places {
            return Err(count.clamp(1, MOST) * places);
        }
        Ok(Self {
            scaffold,
            count,
            values,
            how,
            lattice,
        })
    }

    /// How they go on between their places.
    pub fn interpolation(&self) -> Interpolation {
        self.how
    }

    /// All numbers at a point of an element with their gradients by the reference coordinates; those
    /// beyond the count are 0.
    pub fn at(&self, element: usize, xi: CellPoint<3>) -> [(f64, Vec3); MOST] {
        let mut all = [(0.0, Vec3::zeros()); MOST];
        let e = self.scaffold.element(element);
        if let Some(lattice) = &self.lattice {
            let (x, jacobian) = e.map_and_jacobian(xi);
            lattice.at(&self.values, x.0, &mut all[..self.count]);
            for (_, slope) in &mut all[..self.count] {
                *slope = jacobian.tr_mul(slope);
            }
            return all;
        }
        let corners = Corners::at(e.shape(), xi, self.how);
        for (number, own) in all[..self.count].iter_mut().enumerate() {
            *own = corners.of(|v| self.values[e.nodes()[v] as usize * self.count + number]);
        }
        all
    }

    /// What a number can be over a box of an element's frame.
    pub fn range(&self, element: usize, number: usize, region: &CellBox<3>) -> Interval {
        let e = self.scaffold.element(element);
        let middle = CellPoint((region.min + region.max) / 2.0);
        let half = (region.max - region.min) / 2.0;
        if let Some(lattice) = &self.lattice {
            let reach = e.stretch().1 * half.norm();
            let x = e.map(middle).0;
            let around = Aabb { min: x, max: x }.dilated(reach);
            let (hull, slope) = lattice.range(&self.values, self.count, number, &around);
            let mut all = [(0.0, Vec3::zeros()); MOST];
            lattice.at(&self.values, x, &mut all[..self.count]);
            return within(all[number].0, slope * reach, hull);
        }
        let shape = e.shape();
        let at = |v: usize| self.values[e.nodes()[v] as usize * self.count + number];
        let mut whole = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for v in 0..e.kind().corner_count() {
            whole = whole.hull(Interval::new(at(v), at(v)));
        }
        let straight = self.how == Interpolation::Linear && shape != Element::Pyramid;
        if !straight || whole.hi - whole.lo < 1e-12 {
            return whole;
        }
        // A slope's components are multilinear: greatest at corners.
        let mut steepest = Vec3::zeros();
        for v in shape.vertices() {
            let c = Corners::at(shape, CellPoint(v), Interpolation::Linear);
            steepest = steepest.sup(&c.of(at).1.abs());
        }
        let value = Corners::at(shape, middle, self.how).of(at).0;
        within(value, steepest.dot(&half), whole)
    }

    /// The greatest that a number is in an element, and a bound of its slope there by the reference
    /// coordinates.
    pub fn extremes(&self, element: usize, number: usize) -> (f64, f64) {
        let e = self.scaffold.element(element);
        if let Some(lattice) = &self.lattice {
            let (hull, slope) = lattice.range(&self.values, self.count, number, &e.bounds());
            return (hull.hi, slope * e.stretch().1);
        }
        // Over the reference edge for linear numbers, by S' <= 3/2 and sum S >= 1/2 for smoothed ones.
        let steepest = match self.how {
            Interpolation::Smoothstep => 15.0,
            _ => 2.5,
        };
        let corners = &e.nodes()[..e.kind().corner_count()];
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        for &n in corners {
            let own = self.values[n as usize * self.count + number];
            least = least.min(own);
            greatest = greatest.max(own);
        }
        (greatest, (greatest - least).max(0.0) * steepest)
    }
}

/// A number that differs over a scaffold, at points of world space.
pub struct Graded<'a>(Distribution<'a>);

impl<'a> Graded<'a> {
    /// The number at the interpolation's places (see [`Interpolation::places`]).
    ///
    /// # Errors
    /// [`TilingError::WeightCount`] if there are not as many numbers as places.
    pub fn new(
        scaffold: &'a Scaffold,
        how: Interpolation,
        values: Vec<f64>,
    ) -> Result<Self, TilingError> {
        let found = values.len();
        Distribution::new(scaffold, how, 1, values)
            .map(Self)
            .map_err(|expected| TilingError::WeightCount { found, expected })
    }

    /// The number at a point; `None` outside the scaffold.
    pub fn at(&self, p: WorldPoint) -> Option<f64> {
        let (element, xi) = self.0.scaffold.locate(p)?;
        Some(self.0.at(element as usize, xi)[0].0)
    }

    /// The numbers as given.
    pub fn values(&self) -> &[f64] {
        &self.0.values
    }
}

/// Weights of at most 8 cells over a scaffold: not negative, their sum 1.
pub struct Weights<'a>(Distribution<'a>);

impl<'a> Weights<'a> {
    /// `count` weights at each of the interpolation's places (see [`Interpolation::places`]), by place and
    /// then cell. Negative ones count as 0, and all are divided by their sum.
    ///
    /// # Errors
    /// [`TilingError::WeightCount`] if there are not as many weights as places and cells,
    /// [`TilingError::Weights`] where they sum to 0 or are not finite.
    pub fn new(
        scaffold: &'a Scaffold,
        how: Interpolation,
        count: usize,
        mut values: Vec<f64>,
    ) -> Result<Self, TilingError> {
        let found = values.len();
        normalise(scaffold, how, count, &mut values)?;
        Distribution::new(scaffold, how, count, values)
            .map(Self)
            .map_err(|expected| TilingError::WeightCount { found, expected })
    }

    /// The weights at a point of an element; those beyond the count are 0.
    pub fn at(&self, element: usize, xi: CellPoint<3>) -> [f64; 8] {
        self.0.at(element, xi).map(|w| w.0)
    }
}

/// Clamps `count` weights at each place at 0 and divides them by their sum.
///
/// # Errors
/// [`TilingError::Weights`] where they sum to 0 or are not finite.
pub(super) fn normalise(
    scaffold: &Scaffold,
    how: Interpolation,
    count: usize,
    weights: &mut [f64],
) -> Result<(), TilingError> {
    for (place, own) in weights.chunks_exact_mut(count.max(1)).enumerate() {
        for w in own.iter_mut() {
            *w = w.max(0.0);
        }
        let sum: f64 = own.iter().sum();
        if !(sum.is_finite() && sum > 0.0) {
            let places = how.places(scaffold);
            return Err(TilingError::Weights {
                at: places.get(place).copied().unwrap_or_default().into(),
                sum,
            });
        }
        for w in own.iter_mut() {
            *w /= sum;
        }
    }
    Ok(())
}

/// The numbers that are at most `reach` from a value and in a range that contains it.
fn within(value: f64, reach: f64, range: Interval) -> Interval {
    Interval::new((value - reach).max(range.lo), (value + reach).min(range.hi))
}
