//! What a cell's function is made of: an expression whose leaves are Fourier series.
//!
//! Series of several bands and lattices, in space or in the plane, combined by weighted sums, minima
//! and maxima (sharp or rounded), magnitude, shift and negation. Sums of series over one group and
//! lattice are one series again, since series are linear in their coefficients; everything else
//! breaks the band limit and stays a node.
//!
//! Rounded minimum: min(a, b) - max(r - |a - b|, 0)^2 / (4 r), which differs from the minimum only
//! where the two are closer than the radius r, has a continuous gradient there, and never decreases
//! when a or b grows. Of more than two the first two are taken first.

use super::compatibility::embedded;
use super::icosahedral::Icosahedral;
use super::{CellError, Series};
use crate::frame::Mat3;
use std::sync::Arc;

mod value;

/// A function of the cell frame; cheap to clone.
#[derive(Clone, Debug)]
pub struct Form(Arc<Node>);

/// The kinds of function.
#[derive(Debug)]
pub enum Node {
    /// A series in space.
    Series(Series<3>),
    /// A series in the plane, constant along z.
    Planar(Series<2>),
    /// A series over the icosahedral module.
    Icosahedral(Icosahedral),
    /// The sum of functions times their weights.
    Sum(Vec<(f64, Form)>),
    /// The least value; rounded where values are closer than the radius, in field units.
    Least(Vec<Form>, f64),
    /// The greatest value, rounded likewise.
    Greatest(Vec<Form>, f64),
    /// The magnitude |phi|.
    Magnitude(Form),
    /// The function lowered by a constant: phi - c.
    Shift(Form, f64),
    /// The function times -1.
    Negation(Form),
}

/// A leaf of a form.
#[derive(Clone, Copy, Debug)]
pub(super) enum Leaf<'a> {
    Series(&'a Series<3>),
    Planar(&'a Series<2>),
    Icosahedral(&'a Icosahedral),
}

/// More parts than any expression needs, all nodes counted.
const MOST_NODES: usize = 256;

impl From<Series<3>> for Form {
    fn from(series: Series<3>) -> Self {
        Self(Arc::new(Node::Series(series)))
    }
}

impl From<Series<2>> for Form {
    fn from(series: Series<2>) -> Self {
        Self(Arc::new(Node::Planar(series)))
    }
}

impl From<Series<6>> for Form {
    /// The series seen in space, where its internal coordinates are 0.
    fn from(series: Series<6>) -> Self {
        Self(Arc::new(Node::Icosahedral(series.into())))
    }
}

impl Form {
    /// What it is.
    pub fn node(&self) -> &Node {
        &self.0
    }

    /// The series, if it is one in space.
    pub fn series(&self) -> Option<&Series<3>> {
        match self.node() {
            Node::Series(s) => Some(s),
            _ => None,
        }
    }

    /// The series, if it is one in the plane.
    pub fn planar(&self) -> Option<&Series<2>> {
        match self.node() {
            Node::Planar(s) => Some(s),
            _ => None,
        }
    }

    /// The series, if it is one over the icosahedral module.
    pub fn icosahedral(&self) -> Option<&Series<6>> {
        match self.node() {
            Node::Icosahedral(s) => Some(s.series()),
            _ => None,
        }
    }

    /// The sum of functions times their weights; series over one group and lattice become one.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no parts, too many, or a weight that is not finite.
    pub fn sum(parts: Vec<(f64, Self)>) -> Result<Self, CellError> {
        check_parts(parts.iter().map(|p| &p.1))?;
        if let Some((weight, _)) = parts.iter().find(|p| !p.0.is_finite()) {
            return Err(CellError::Expression(format!(
                "the weight {weight} is not finite"
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

    /// The function times a number, where that is no new node.
    fn scaled(&self, factor: f64) -> Option<Self> {
        match self.node() {
            Node::Series(s) => Some(s.scaled(factor).into()),
            Node::Planar(s) => Some(s.scaled(factor).into()),
            Node::Icosahedral(s) => Some(s.series().scaled(factor).into()),
            _ => (factor == 1.0).then(|| self.clone()),
        }
    }

    /// a self + b other, if both are series over one group and lattice.
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

    /// The least of the functions: the union of their solids. Rounded with the radius, if it is
    /// positive.
    ///
    /// # Errors
    /// [`CellError::Expression`] for no parts or too many, or a radius that is negative or not
    /// finite.
    pub fn least(parts: Vec<Self>, radius: f64) -> Result<Self, CellError> {
        Self::extreme(parts, radius, Node::Least)
    }

    /// The greatest of the functions: the intersection of their solids, rounded likewise.
    ///
    /// # Errors
    /// As [`Form::least`].
    pub fn greatest(parts: Vec<Self>, radius: f64) -> Result<Self, CellError> {
        Self::extreme(parts, radius, Node::Greatest)
    }

    fn extreme(
        mut parts: Vec<Self>,
        radius: f64,
        node: fn(Vec<Self>, f64) -> Node,
    ) -> Result<Self, CellError> {
        check_parts(parts.iter())?;
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(CellError::Expression(format!(
                "the radius is {radius}; expected a number from 0 on"
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

    /// The function lowered by a constant: phi - c.
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

    /// The function times -1: solid and void exchanged.
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

    /// The parts of the node.
    fn parts(&self) -> Vec<&Self> {
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => Vec::new(),
            Node::Sum(parts) => parts.iter().map(|p| &p.1).collect(),
            Node::Least(parts, _) | Node::Greatest(parts, _) => parts.iter().collect(),
            Node::Magnitude(part) | Node::Shift(part, _) | Node::Negation(part) => vec![part],
        }
    }

    /// Number of nodes, leaves included.
    pub fn nodes(&self) -> usize {
        1 + self.parts().into_iter().map(Self::nodes).sum::<usize>()
    }

    /// The series it is made of, in order.
    pub(super) fn leaves(&self) -> Vec<Leaf<'_>> {
        match self.node() {
            Node::Series(s) => vec![Leaf::Series(s)],
            Node::Planar(s) => vec![Leaf::Planar(s)],
            Node::Icosahedral(s) => vec![Leaf::Icosahedral(s)],
            _ => self.parts().into_iter().flat_map(Self::leaves).collect(),
        }
    }

    /// Number of coefficients, one per orbit pair, of all its series.
    pub fn coefficients(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.coefficients().len(),
            Leaf::Planar(s) => s.coefficients().len(),
            Leaf::Icosahedral(s) => s.series().coefficients().len(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Number of exponentials of all its series: what an exact value costs.
    pub fn exponentials(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.exponentials().len(),
            Leaf::Planar(s) => s.exponentials().len(),
            Leaf::Icosahedral(s) => s.series().exponentials().len(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Number of real degrees of freedom of all its series.
    pub fn degrees_of_freedom(&self) -> usize {
        let count = |l: &Leaf| match l {
            Leaf::Series(s) => s.degrees_of_freedom(),
            Leaf::Planar(s) => s.degrees_of_freedom(),
            Leaf::Icosahedral(s) => s.series().degrees_of_freedom(),
        };
        self.leaves().iter().map(count).sum()
    }

    /// Greatest |f| among its series, in cycles per unit of reference length.
    pub fn band_limit(&self) -> f64 {
        let limit = |l: &Leaf| match l {
            Leaf::Series(s) => s.band_limit(),
            Leaf::Planar(s) => s.band_limit(),
            Leaf::Icosahedral(s) => s.band_limit(),
        };
        self.leaves().iter().map(limit).fold(0.0, f64::max)
    }

    /// The name that all its lattices have.
    pub fn lattice_name(&self) -> Option<&'static str> {
        let leaves = self.leaves();
        let first = leaves.first()?.lattice_name();
        leaves
            .iter()
            .all(|l| l.lattice_name() == first)
            .then_some(first)?
    }
}

fn check_parts<'a>(parts: impl Iterator<Item = &'a Form>) -> Result<(), CellError> {
    let nodes: usize = parts.map(Form::nodes).sum();
    if nodes == 0 {
        return Err(CellError::Expression(
            "no parts; expected at least one".to_owned(),
        ));
    }
    if nodes >= MOST_NODES {
        return Err(CellError::Expression(format!(
            "{nodes} nodes; expected fewer than {MOST_NODES}"
        )));
    }
    Ok(())
}

impl Leaf<'_> {
    pub fn dimension(&self) -> usize {
        match self {
            Self::Series(_) => 3,
            Self::Planar(_) => 2,
            Self::Icosahedral(_) => 6,
        }
    }

    pub fn group_name(&self) -> &str {
        match self {
            Self::Series(s) => s.group().name(),
            Self::Planar(s) => s.group().name(),
            Self::Icosahedral(s) => s.series().group().name(),
        }
    }

    pub fn operators(&self) -> Vec<Mat3> {
        match self {
            Self::Series(s) => embedded(s.group(), s.lattice()),
            Self::Planar(s) => embedded(s.group(), s.lattice()),
            Self::Icosahedral(s) => embedded(s.series().group(), s.series().lattice()),
        }
    }

    pub fn lattice_name(&self) -> Option<&'static str> {
        match self {
            Self::Series(s) => s.lattice().name(),
            Self::Planar(s) => s.lattice().name(),
            Self::Icosahedral(s) => s.series().lattice().name(),
        }
    }

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
