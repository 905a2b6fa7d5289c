//! The function of a cell: an expression whose leaves are Fourier series.
//!
//! Series of several bands and lattices, in space or in the plane, are combined by weighted sums, minima
//! and maxima (sharp or rounded), magnitude, shift and negation. A sum of series over one group and
//! lattice is stored as one series, since series are linear in their coefficients. Any other combination
//! has no band limit and stays a node.
//!
//! Rounded minimum: min(a, b) - max(r - |a - b|, 0)^2 / (4 r). It differs from the minimum only where the
//! values are closer than the radius r, has a continuous gradient there, and never decreases when a or b
//! grows. Of more than two values, it is applied from the first to the last.

use super::compatibility::embedded;
use super::icosahedral::Icosahedral;
use super::{CellError, Series};
use druse_geometry::frame::{Mat3, is_in_range};
use std::sync::Arc;

mod value;

/// A function in the cell frame; cloning shares the nodes.
#[derive(Clone, Debug)]
pub struct Expression(Arc<Node>);

/// The kinds of function.
#[derive(Debug)]
pub enum Node {
    /// A series in space.
    Series(Series<3>),
    /// A series in the plane, constant along z.
    Planar(Series<2>),
    /// A series over the icosahedral module.
    Icosahedral(Icosahedral),
    /// The weighted sum of functions.
    Sum(Vec<(f64, Expression)>),
    /// The minimum, rounded where values are closer than the radius (in field units).
    Min(Vec<Expression>, f64),
    /// The maximum, rounded likewise.
    Max(Vec<Expression>, f64),
    /// The magnitude |phi|.
    Magnitude(Expression),
    /// The function minus a constant: phi - c.
    Shift(Expression, f64),
    /// The function times -1.
    Negation(Expression),
}

/// A leaf of an expression.
#[derive(Clone, Copy, Debug)]
pub(super) enum Leaf<'a> {
    Series(&'a Series<3>),
    Planar(&'a Series<2>),
    Icosahedral(&'a Icosahedral),
}

/// Limit of the number of nodes of all parts of a combination, which must be below it. The node of the combination is
/// not counted, and neither are magnitudes, shifts and negations checked.
const MAX_NODES: usize = 256;

impl From<Series<3>> for Expression {
    fn from(series: Series<3>) -> Self {
        Self(Arc::new(Node::Series(series)))
    }
}

impl From<Series<2>> for Expression {
    fn from(series: Series<2>) -> Self {
        Self(Arc::new(Node::Planar(series)))
    }
}

impl From<Series<6>> for Expression {
    /// The restriction of the series to space, where its internal coordinates are 0.
    fn from(series: Series<6>) -> Self {
        Self(Arc::new(Node::Icosahedral(series.into())))
    }
}

impl Expression {
    /// The root node.
    pub fn node(&self) -> &Node {
        &self.0
    }

    /// The series, if the function is a single series in space.
    pub fn series(&self) -> Option<&Series<3>> {
        match self.node() {
            Node::Series(s) => Some(s),
            _ => None,
        }
    }

    /// The series, if the function is a single series in the plane.
    pub fn planar(&self) -> Option<&Series<2>> {
        match self.node() {
            Node::Planar(s) => Some(s),
            _ => None,
        }
    }

    /// The series, if the function is a single series over the icosahedral module.
    pub fn icosahedral(&self) -> Option<&Series<6>> {
        match self.node() {
            Node::Icosahedral(s) => Some(s.series()),
            _ => None,
        }
    }

    /// The weighted sum of functions; series over one group and lattice merge into one.
    /// One part that is a series, or has weight 1, needs no new node.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no parts, too many, or a weight that is not finite.
    pub fn sum(parts: Vec<(f64, Self)>) -> Result<Self, CellError> {
        check_parts(parts.iter().map(|p| &p.1))?;
        if let Some((weight, _)) = parts.iter().find(|p| !is_in_range(p.0)) {
            return Err(CellError::Expression(format!(
                "the weight {weight} is not finite or too large; expected a number below 1e18"
            )));
        }
        let mut merged: Vec<(f64, Self)> = Vec::new();
        for (weight, part) in parts {
            let partner = merged
                .iter_mut()
                .find_map(|(w, other)| Some((other.plus(*w, &part, weight)?, w, other)));
            match partner {
                Some((sum, w, other)) => (*w, *other) = (1.0, sum),
                None => merged.push((weight, part)),
            }
        }
        if let [(weight, part)] = merged.as_slice()
            && let Some(scaled) = part.scaled(*weight)
        {
            return Ok(scaled);
        }
        Ok(Self(Arc::new(Node::Sum(merged))))
    }

    /// The function times a number, if that needs no new node.
    /// `None` for other combinations, unless the factor is 1.
    fn scaled(&self, factor: f64) -> Option<Self> {
        match self.node() {
            Node::Series(s) => Some(s.scaled(factor).into()),
            Node::Planar(s) => Some(s.scaled(factor).into()),
            Node::Icosahedral(s) => Some(s.series().scaled(factor).into()),
            _ => (factor == 1.0).then(|| self.clone()),
        }
    }

    /// a self + b other, if both are series over the same group and lattice.
    fn plus(&self, a: f64, other: &Self, b: f64) -> Option<Self> {
        match (self.node(), other.node()) {
            (Node::Series(s), Node::Series(t)) => s.plus(a, t, b).map(Self::from),
            (Node::Planar(s), Node::Planar(t)) => s.plus(a, t, b).map(Self::from),
            (Node::Icosahedral(s), Node::Icosahedral(t)) => {
                s.series().plus(a, t.series(), b).map(Self::from)
            }
            _ => None,
        }
    }

    /// The minimum of functions, which is the union of their solids; rounded if the radius is positive.
    /// The radius is in field units. That of one function is the function.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no parts or too many, or a radius that is negative or not
    /// finite.
    pub fn min(parts: Vec<Self>, radius: f64) -> Result<Self, CellError> {
        Self::extreme(parts, radius, Node::Min)
    }

    /// The maximum of functions, which is the intersection of their solids; rounded likewise.
    ///
    /// # Errors
    /// As [`Expression::min`].
    pub fn max(parts: Vec<Self>, radius: f64) -> Result<Self, CellError> {
        Self::extreme(parts, radius, Node::Max)
    }

    /// A rounded minimum or maximum of the parts; that of one part is the part.
    fn extreme(
        mut parts: Vec<Self>,
        radius: f64,
        node: fn(Vec<Self>, f64) -> Node,
    ) -> Result<Self, CellError> {
        check_parts(parts.iter())?;
        if !(is_in_range(radius) && radius >= 0.0) {
            return Err(CellError::Expression(format!(
                "the radius is {radius}; expected a number from 0 on, below 1e18"
            )));
        }
        if parts.len() == 1 {
            return Ok(parts.swap_remove(0));
        }
        Ok(Self(Arc::new(node(parts, radius))))
    }

    /// The magnitude |phi|.
    #[must_use]
    pub fn magnitude(&self) -> Self {
        Self(Arc::new(Node::Magnitude(self.clone())))
    }

    /// The function minus a constant: phi - c.
    #[must_use]
    pub fn shifted(&self, by: f64) -> Self {
        match self.node() {
            Node::Series(s) => s.lowered(by).into(),
            Node::Planar(s) => s.lowered(by).into(),
            Node::Icosahedral(s) => s.series().lowered(by).into(),
            Node::Shift(inner, more) => Self(Arc::new(Node::Shift(inner.clone(), by + more))),
            _ => Self(Arc::new(Node::Shift(self.clone(), by))),
        }
    }

    /// The function times -1, which exchanges solid and void.
    #[must_use]
    pub fn negated(&self) -> Self {
        match self.node() {
            Node::Series(s) => s.scaled(-1.0).into(),
            Node::Planar(s) => s.scaled(-1.0).into(),
            Node::Icosahedral(s) => s.series().scaled(-1.0).into(),
            Node::Negation(inner) => inner.clone(),
            _ => Self(Arc::new(Node::Negation(self.clone()))),
        }
    }

    /// The operands of the root node.
    /// In their order; none for a series.
    fn parts(&self) -> Vec<&Self> {
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => Vec::new(),
            Node::Sum(parts) => parts.iter().map(|p| &p.1).collect(),
            Node::Min(parts, _) | Node::Max(parts, _) => parts.iter().collect(),
            Node::Magnitude(part) | Node::Shift(part, _) | Node::Negation(part) => vec![part],
        }
    }

    /// Number of nodes, leaves included.
    pub fn nodes(&self) -> usize {
        1 + self.parts().into_iter().map(Self::nodes).sum::<usize>()
    }

    /// The series of the expression, from left to right.
    /// The order is that in which evaluations call back.
    pub(super) fn leaves(&self) -> Vec<Leaf<'_>> {
        match self.node() {
            Node::Series(s) => vec![Leaf::Series(s)],
            Node::Planar(s) => vec![Leaf::Planar(s)],
            Node::Icosahedral(s) => vec![Leaf::Icosahedral(s)],
            _ => self.parts().into_iter().flat_map(Self::leaves).collect(),
        }
    }

    /// Number of coefficients, one per orbit pair, of all series.
    pub fn coefficients(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.coefficients().len(),
            Leaf::Planar(s) => s.coefficients().len(),
            Leaf::Icosahedral(s) => s.series().coefficients().len(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Number of exponentials of all series, to which the cost of an exact evaluation is proportional.
    pub fn exponentials(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.exponentials().len(),
            Leaf::Planar(s) => s.exponentials().len(),
            Leaf::Icosahedral(s) => s.series().exponentials().len(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Number of real degrees of freedom of all series.
    pub fn degrees_of_freedom(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.degrees_of_freedom(),
            Leaf::Planar(s) => s.degrees_of_freedom(),
            Leaf::Icosahedral(s) => s.series().degrees_of_freedom(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Largest |f| of all series, in cycles per unit of reference length.
    pub fn band_limit(&self) -> f64 {
        let limit = |l: &Leaf| match l {
            Leaf::Series(s) => s.band_limit(),
            Leaf::Planar(s) => s.band_limit(),
            Leaf::Icosahedral(s) => s.band_limit(),
        };
        self.leaves().iter().map(limit).fold(0.0, f64::max)
    }

    /// The name of the lattice, if all series have the same lattice.
    pub fn lattice_name(&self) -> Option<&'static str> {
        let leaves = self.leaves();
        let first = leaves.first()?.lattice_name();
        leaves
            .iter()
            .all(|l| l.lattice_name() == first)
            .then_some(first)?
    }
}

/// An error for no parts, and for 256 nodes or more in all parts together.
fn check_parts<'a>(parts: impl Iterator<Item = &'a Expression>) -> Result<(), CellError> {
    let nodes: usize = parts.map(Expression::nodes).sum();
    if nodes == 0 {
        return Err(CellError::Expression(
            "no parts; expected at least one".to_owned(),
        ));
    }
    if nodes >= MAX_NODES {
        return Err(CellError::Expression(format!(
            "{nodes} nodes; expected fewer than {MAX_NODES}"
        )));
    }
    Ok(())
}

impl Leaf<'_> {
    /// Dimension of the lattice: 6 for the icosahedral module.
    pub fn dimension(&self) -> usize {
        match self {
            Self::Series(_) => 3,
            Self::Planar(_) => 2,
            Self::Icosahedral(_) => 6,
        }
    }

    /// The name of its own group, which may be larger than that of the cell.
    pub fn group_name(&self) -> &str {
        match self {
            Self::Series(s) => s.group().name(),
            Self::Planar(s) => s.group().name(),
            Self::Icosahedral(s) => s.series().group().name(),
        }
    }

    /// In space, as Cartesian matrices.
    pub fn operators(&self) -> Vec<Mat3> {
        match self {
            Self::Series(s) => embedded(s.group(), s.lattice()),
            Self::Planar(s) => embedded(s.group(), s.lattice()),
            Self::Icosahedral(s) => embedded(s.series().group(), s.series().lattice()),
        }
    }

    /// `None` for a lattice without a name, which no element has.
    pub fn lattice_name(&self) -> Option<&'static str> {
        match self {
            Self::Series(s) => s.lattice().name(),
            Self::Planar(s) => s.lattice().name(),
            Self::Icosahedral(s) => s.series().lattice().name(),
        }
    }

    /// The name of the lattice, or its vectors if it has none; for errors.
    pub fn lattice_text(&self) -> String {
        self.lattice_name().map_or_else(
            || match self {
                Self::Series(s) => format!("{:?}", s.lattice().vectors()),
                Self::Planar(s) => format!("{:?}", s.lattice().vectors()),
                Self::Icosahedral(s) => format!("{:?}", s.series().lattice().vectors()),
            },
            str::to_owned,
        )
    }
}
