//! Unit cells: symmetric Fourier series in an element's reference frame.
//!
//! A cell is a real function Phi = sum over orbits of C exp(2 pi i k.u) that is invariant under the
//! symmetry group of its element, so that it continues across the faces of a mesh whatever the
//! numbering of the nodes, together with what is solid: Phi < level, Phi > level, |Phi| < level.
//!
//! Conventions: points are Cartesian reference coordinates (hex edge 1, tet edge sqrt 2, origin at
//! the centroid); lengths, gradients and |f| are in that unit; a [`Cell`] as a [`Field`] is
//! negative inside its solid. `shift` moves the field by a constant, not the surface by a distance.
//! Volume fractions are of the *element*, not of the period.
//!
//! | element | group | lattices (the first is the default) |
//! |---|---|---|
//! | tri | D3 | hex2 |
//! | quad | D4 | square |
//! | tet | Td | fcc2, cubic |
//! | hex | Oh | cubic |
//!
//! [`fit()`] and [`fit_mesh`] make a cell from geometry, [`Surface`] from a closed form; [`Table`] is
//! the fast evaluation, [`Cell::from_json`] and [`Cell::to_json`] the text of a `.cell` file.
//!
//! ```
//! use druse::cell::{Cell, Surface};
//! use druse::field::Field;
//! use druse::frame::{CellPoint, Element, Vec3};
//! let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
//! assert!((p.value(CellPoint(Vec3::zeros())) - 3.0).abs() < 1e-14);
//! assert!((p.level_for_volume_fraction(0.35).unwrap() + 0.525_019_98).abs() < 1e-6);
//! ```

use crate::field::{Field, Interval};
use crate::frame::{CellBox, CellPoint, Element, Vec3};
use crate::symmetry::{Lattice, PointGroup, SymmetryError};
use std::sync::{Arc, OnceLock};

mod domain;
mod file;
mod fit;
mod level;
mod series;
mod solid;
mod surface;
mod table;
mod thickness;
mod wave;
pub use file::CellTextError;
pub use fit::{
    Caps, Components, Distance, FitError, FitOptions, FitReport, Hausdorff, Placement, Sample,
    SourceReport, fit, fit_mesh, least_squares,
};
pub use series::{Coefficient, Series};
pub use solid::Solid;
pub use surface::Surface;
pub use table::Table;

/// Why a cell cannot be made, or a question about it has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CellError {
    /// The group, the lattice or an operator is wrong in itself.
    #[error(transparent)]
    Symmetry(#[from] SymmetryError),
    /// A coefficient that cannot stand in a series.
    #[error("coefficient {place} (k = {index}): {reason}")]
    Coefficient {
        /// Its place in the list, from 0.
        place: usize,
        /// Its index.
        index: String,
        /// What is wrong.
        reason: String,
    },
    /// A group or lattice that does not go with the element.
    #[error("a {element} cell cannot have {what} {found:?}; expected {expected}")]
    Unfitting {
        /// The element.
        element: &'static str,
        /// "group" or "lattice".
        what: &'static str,
        /// What was given.
        found: String,
        /// What goes with the element.
        expected: String,
    },
    /// A number that is out of its range.
    #[error("{what} is {found}; expected {expected}")]
    OutOfRange {
        /// The parameter.
        what: &'static str,
        /// What was given.
        found: f64,
        /// Its range.
        expected: String,
    },
    /// A surface that has no form with the symmetry of the element.
    #[error(
        "surface {surface} has no form with group {group}, as a {element} cell needs: {reason}"
    )]
    NoSuchForm {
        /// The surface.
        surface: &'static str,
        /// The element.
        element: &'static str,
        /// The element's group.
        group: &'static str,
        /// What happens to it under the group.
        reason: &'static str,
    },
    /// A field of one sign: no surface in the element.
    #[error(
        "nothing {missing} inside the {element}: the field runs from {least} to {greatest} there, \
         which does not contain the level {level}"
    )]
    NoSurface {
        /// "solid" or "void".
        missing: &'static str,
        /// The element.
        element: &'static str,
        /// Least value sampled.
        least: f64,
        /// Greatest value sampled.
        greatest: f64,
        /// The level.
        level: f64,
    },
    /// A band that no table can hold.
    #[error(
        "the cell's largest index is {index} per period, which needs a table of more than {limit} \
         samples per axis"
    )]
    TableTooLarge {
        /// Largest index on the cubic period.
        index: i32,
        /// Greatest number of samples per axis.
        limit: usize,
    },
}

/// Element, group, and the lattices that go with it; the first is the default.
const PAIRINGS: [(Element, &str, &[&str]); 4] = [
    (Element::Tri, "D3", &["hex2"]),
    (Element::Quad, "D4", &["square"]),
    (Element::Tet, "Td", &["fcc2", "cubic"]),
    (Element::Hex, "Oh", &["cubic"]),
];

/// The name of the group that makes cells continuous over meshes of this element.
pub fn default_group(element: Element) -> &'static str {
    PAIRINGS[element as usize].1
}

/// The names of the lattices for this element; the first is the default.
pub fn lattices(element: Element) -> &'static [&'static str] {
    PAIRINGS[element as usize].2
}

/// A unit cell of a solid element; as a [`Field`] negative inside its solid, evaluated exactly.
#[derive(Clone, Debug)]
pub struct Cell {
    name: String,
    element: Element,
    series: Arc<Series<3>>,
    level: f64,
    solid: Solid,
    face_normal: bool,
    gamma: OnceLock<f64>,
    report: Option<Arc<FitReport>>,
}

impl Cell {
    /// A cell with level 0 and the solid below it.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] unless the series has the element's group and one of its lattices.
    pub fn new(name: &str, element: Element, series: Series<3>) -> Result<Self, CellError> {
        let (_, group, lattices) = PAIRINGS[element as usize];
        let unfitting = |what, found: String, expected: String| CellError::Unfitting {
            element: element.name(),
            what,
            found,
            expected,
        };
        if element.dimension() != 3 {
            return Err(unfitting(
                "dimension",
                "3".to_owned(),
                element.dimension().to_string(),
            ));
        }
        if series.group().name() != group {
            let found = series.group().name().to_owned();
            return Err(unfitting("group", found, group.to_owned()));
        }
        let lattice = series.lattice();
        if !lattice.name().is_some_and(|n| lattices.contains(&n)) {
            let found = lattice
                .name()
                .map_or_else(|| format!("{:?}", lattice.vectors()), str::to_owned);
            return Err(unfitting("lattice", found, lattices.join(" or ")));
        }
        Ok(Self {
            name: name.to_owned(),
            element,
            series: Arc::new(series),
            level: 0.0,
            solid: Solid::Below,
            face_normal: false,
            gamma: OnceLock::new(),
            report: None,
        })
    }

    /// The group and the lattice of that name for an element, ready for a series or a basis.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] for a lattice of another element.
    pub fn symmetry(
        element: Element,
        lattice: Option<&str>,
    ) -> Result<(PointGroup<3>, Lattice<3>), CellError> {
        let (_, group, known) = PAIRINGS[element as usize];
        let name = lattice.unwrap_or(known[0]);
        if !known.contains(&name) || element.dimension() != 3 {
            return Err(CellError::Unfitting {
                element: element.name(),
                what: "lattice",
                found: name.to_owned(),
                expected: known.join(" or "),
            });
        }
        let lattice = Lattice::named(name)?;
        Ok((PointGroup::named(group, &lattice)?, lattice))
    }

    /// Its name, for people.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The element it fills.
    pub fn element(&self) -> Element {
        self.element
    }

    /// The function whose level set is the surface.
    pub fn series(&self) -> &Series<3> {
        &self.series
    }

    /// The level, in field units; for a sheet half its thickness in field units.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// Which side of the level is solid.
    pub fn solid(&self) -> Solid {
        self.solid
    }

    /// Whether the surface was made to meet the element's faces at a right angle.
    pub fn face_normal(&self) -> bool {
        self.face_normal
    }

    /// How it was fitted, if it was.
    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_deref()
    }

    fn with_report(mut self, report: FitReport) -> Self {
        self.report = Some(Arc::new(report));
        self
    }

    /// The same cell under another name.
    #[must_use]
    pub fn named(mut self, name: &str) -> Self {
        name.clone_into(&mut self.name);
        self
    }

    /// The same function with another solid.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a level that is not finite, or of a sheet not positive.
    pub fn with_solid(mut self, solid: Solid, level: f64) -> Result<Self, CellError> {
        solid.check(level)?;
        self.solid = solid;
        self.level = level;
        self.gamma = OnceLock::new();
        Ok(self)
    }

    /// The cell whose field is lower by `by` (in field units): positive values add material.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] if a sheet would lose all its thickness.
    pub fn shifted(self, by: f64) -> Result<Self, CellError> {
        let level = self.solid.shifted(self.level, by);
        let solid = self.solid;
        self.with_solid(solid, level)
    }

    /// The cell with solid and void exchanged.
    #[must_use]
    pub fn inverted(mut self) -> Self {
        self.solid = self.solid.inverted();
        self
    }

    /// The sheet around the cell's surface: |Phi - level| < `half`, in field units.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] unless `half` is positive and finite.
    pub fn sheet(self, half: f64) -> Result<Self, CellError> {
        let centre = self.solid.centre(self.level);
        let cell = if centre == 0.0 {
            self
        } else {
            self.recentred(centre)?
        };
        cell.with_solid(Solid::Sheet, half)
    }

    /// The same function minus a constant, which moves into the coefficient of k = 0.
    fn recentred(mut self, constant: f64) -> Result<Self, CellError> {
        let mut terms = vec![([0; 3], [self.series.mean() - constant, 0.0])];
        terms.extend(
            self.series
                .coefficients()
                .iter()
                .filter(|t| t.k != [0; 3])
                .map(|t| (t.k, t.c)),
        );
        let (group, lattice) = (self.series.group().clone(), self.series.lattice().clone());
        self.series = Arc::new(Series::new(group, lattice, &terms)?);
        Ok(self)
    }
}

impl Field for Cell {
    type Point = CellPoint<3>;

    fn value(&self, p: CellPoint<3>) -> f64 {
        self.solid.value(self.series.value(p), self.level)
    }

    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let (v, g) = self.series.value_and_gradient(p);
        let (v, s) = self.solid.value_and_slope(v, self.level);
        (v, g * s)
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        self.solid.interval(self.series.bound(region), self.level)
    }
}
