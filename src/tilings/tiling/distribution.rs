//! Quantities that vary over a scaffold: weights of cells, gradings of levels.
//!
//! They are given at the nodes and interpolated between the corners of elements, or at control points in
//! space, where they are smooth whatever the elements are.

use super::TilingError;
use super::control_lattice::ControlLattice;
use super::corners::CornerFunctions;
use crate::scaffold::Scaffold;
use druse_geometry::field::Interval;
use druse_geometry::frame::{Aabb, CellBox, CellPoint, Element, Vec3, WorldPoint};

/// The interpolation of values between the places where they are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Linear along edges.
    #[default]
    Linear,
    /// Smoothstep: zero slope at the corners.
    Smoothstep,
    /// Twice differentiable in space, by control points about an element apart.
    Smooth,
}

impl Interpolation {
    /// The positions at which values are given: the scaffold's nodes, where only corners matter, or control
    /// points around it.
    pub fn places(self, scaffold: &Scaffold) -> Vec<Vec3> {
        match self {
            Self::Linear | Self::Smoothstep => scaffold.nodes().to_vec(),
            Self::Smooth => ControlLattice::around(scaffold).points(),
        }
    }
}

/// Greatest number of quantities.
pub(super) const MAX_QUANTITIES: usize = 8;

/// Quantities over a scaffold, at most [`MAX_QUANTITIES`].
pub(super) struct Distribution<'a> {
    scaffold: &'a Scaffold,
    count: usize,
    /// By place, then by quantity.
    values: Vec<f64>,
    interpolation: Interpolation,
    lattice: Option<ControlLattice>,
}

impl<'a> Distribution<'a> {
    /// `count` quantities at each of the interpolation's places.
    ///
    /// # Errors
    /// The expected number of values, if that of `values` differs or `count` is not 1 to [`MAX_QUANTITIES`].
    pub fn new(
        scaffold: &'a Scaffold,
        interpolation: Interpolation,
        count: usize,
        values: Vec<f64>,
    ) -> Result<Self, usize> {
        let lattice =
            (interpolation == Interpolation::Smooth).then(|| ControlLattice::around(scaffold));
        let places = lattice.map_or(scaffold.nodes().len(), |l| l.points().len());
        if count == 0 || count > MAX_QUANTITIES || values.len() != count * places {
            return Err(count.clamp(1, MAX_QUANTITIES) * places);
        }
        Ok(Self {
            scaffold,
            count,
            values,
            interpolation,
            lattice,
        })
    }

    /// The interpolation between the places.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// All quantities at a point of an element, with gradients by reference coordinates; zeros after `count`.
    pub fn at(&self, element: usize, xi: CellPoint<3>) -> [(f64, Vec3); MAX_QUANTITIES] {
        let mut all = [(0.0, Vec3::zeros()); MAX_QUANTITIES];
        let e = self.scaffold.element(element);
        if let Some(lattice) = &self.lattice {
            let (x, jacobian) = e.map_and_jacobian(xi);
            lattice.at(&self.values, x.0, &mut all[..self.count]);
            for (_, slope) in &mut all[..self.count] {
                *slope = jacobian.tr_mul(slope);
            }
            return all;
        }
        let corners = CornerFunctions::at(e.shape(), xi, self.interpolation);
        for (quantity, own) in all[..self.count].iter_mut().enumerate() {
            *own = corners.of(|v| self.values[e.nodes()[v] as usize * self.count + quantity]);
        }
        all
    }

    /// Range of a quantity over a box of an element's reference frame. `quantity` is its number, from 0.
    pub fn range(&self, element: usize, quantity: usize, region: &CellBox<3>) -> Interval {
        let e = self.scaffold.element(element);
        let middle = CellPoint((region.min + region.max) / 2.0);
        let half = (region.max - region.min) / 2.0;
        // Control lattices are bounded in the world, over a ball around the box's image.
        if let Some(lattice) = &self.lattice {
            let reach = e.stretch().1 * half.norm();
            let x = e.map(middle).0;
            let around = Aabb { min: x, max: x }.dilated(reach);
            let (hull, slope) = lattice.range(&self.values, self.count, quantity, &around);
            let mut all = [(0.0, Vec3::zeros()); MAX_QUANTITIES];
            lattice.at(&self.values, x, &mut all[..self.count]);
            return clamped_interval(all[quantity].0, slope * reach, hull);
        }
        let shape = e.shape();
        let at = |v: usize| self.values[e.nodes()[v] as usize * self.count + quantity];
        // Corner values bound all interpolations; the middle's value and the steepest slope bound linear ones closer.
        let mut whole = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for v in 0..e.kind().corner_count() {
            whole = whole.hull(Interval::new(at(v), at(v)));
        }
        let is_linear = self.interpolation == Interpolation::Linear && shape != Element::Pyramid;
        if !is_linear || whole.hi - whole.lo < 1e-12 {
            return whole;
        }
        // The components of the slope are multilinear: their extremes are at corners. Those of a pyramid are rational.
        let mut steepest = Vec3::zeros();
        for v in shape.vertices() {
            let c = CornerFunctions::at(shape, CellPoint(v), Interpolation::Linear);
            steepest = steepest.sup(&c.of(at).1.abs());
        }
        let value = CornerFunctions::at(shape, middle, self.interpolation)
            .of(at)
            .0;
        clamped_interval(value, steepest.dot(&half), whole)
    }

    /// Bounds of a quantity in an element and of its slope there, by reference coordinates. The first number is the
    /// greatest value, the second the greatest length of the gradient.
    pub fn extremes(&self, element: usize, quantity: usize) -> (f64, f64) {
        let e = self.scaffold.element(element);
        if let Some(lattice) = &self.lattice {
            let (hull, slope) = lattice.range(&self.values, self.count, quantity, &e.bounds());
            return (hull.hi, slope * e.stretch().1);
        }
        // Slope over the spread of corner values: of linear functions at most 2.5 per reference length; with S' <= 3/2
        // and sum S >= 1/2, of the smooth ones at most (3/2 + 3/2) 2.5 / (1/2).
        let steepest = match self.interpolation {
            Interpolation::Smoothstep => 15.0,
            _ => 2.5,
        };
        let corners = &e.nodes()[..e.kind().corner_count()];
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        for &n in corners {
            let corner_value = self.values[n as usize * self.count + quantity];
            least = least.min(corner_value);
            greatest = greatest.max(corner_value);
        }
        (greatest, (greatest - least).max(0.0) * steepest)
    }
}

/// A quantity that varies over a scaffold, at points of world space.
pub struct Graded<'a>(Distribution<'a>);

impl<'a> Graded<'a> {
    /// The quantity from its values at the interpolation's places (see [`Interpolation::places`]).
    ///
    /// # Errors
    /// [`TilingError::WeightCount`] if the number of values is not that of places.
    pub fn new(
        scaffold: &'a Scaffold,
        interpolation: Interpolation,
        values: Vec<f64>,
    ) -> Result<Self, TilingError> {
        let found = values.len();
        Distribution::new(scaffold, interpolation, 1, values)
            .map(Self)
            .map_err(|expected| TilingError::WeightCount { found, expected })
    }

    /// The value at a point; `None` outside the scaffold.
    pub fn at(&self, p: WorldPoint) -> Option<f64> {
        let (element, xi) = self.0.scaffold.locate(p)?;
        Some(self.0.at(element as usize, xi)[0].0)
    }

    /// The values as given.
    pub fn values(&self) -> &[f64] {
        &self.0.values
    }
}

/// Weights of at most 8 cells over a scaffold: not negative, with sum 1.
pub struct Weights<'a>(Distribution<'a>);

impl<'a> Weights<'a> {
    /// `count` weights at each of the interpolation's places (see [`Interpolation::places`]), by place and then
    /// cell. Negative ones count as 0, and all are divided by their sum.
    ///
    /// # Errors
    /// [`TilingError::WeightCount`] if the number of weights is not places times cells,
    /// [`TilingError::Weights`] where they sum to 0 or are not finite.
    pub fn new(
        scaffold: &'a Scaffold,
        interpolation: Interpolation,
        count: usize,
        mut values: Vec<f64>,
    ) -> Result<Self, TilingError> {
        let found = values.len();
        normalise(scaffold, interpolation, count, &mut values)?;
        Distribution::new(scaffold, interpolation, count, values)
            .map(Self)
            .map_err(|expected| TilingError::WeightCount { found, expected })
    }

    /// The weights at a point of an element; zeros after the number of cells.
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
    interpolation: Interpolation,
    count: usize,
    weights: &mut [f64],
) -> Result<(), TilingError> {
    for (place, place_weights) in weights.chunks_exact_mut(count.max(1)).enumerate() {
        for w in place_weights.iter_mut() {
            *w = w.max(0.0);
        }
        let sum: f64 = place_weights.iter().sum();
        if !(sum.is_finite() && sum > 0.0) {
            let places = interpolation.places(scaffold);
            return Err(TilingError::Weights {
                at: places.get(place).copied().unwrap_or_default().into(),
                sum,
            });
        }
        for w in place_weights.iter_mut() {
            *w /= sum;
        }
    }
    Ok(())
}

/// The values within `reach` of `value` and in `range`.
fn clamped_interval(value: f64, reach: f64, range: Interval) -> Interval {
    Interval::new((value - reach).max(range.lo), (value + reach).min(range.hi))
}
