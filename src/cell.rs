//! Unit cells: symmetric Fourier series in an element's reference frame.
//!
//! A cell is a real function Phi = sum over orbits of C exp(2 pi i k.u) that is invariant under a
//! group of symmetries of its element, together with what is solid: Phi < level, Phi > level,
//! |Phi| < level. With the element's whole group it continues across the faces of a mesh whatever the
//! numbering of the nodes ([`Cell::fits_any_numbering`]); with a smaller one only where elements are
//! turned alike. What is not one series (averages over several bands, minima, sheets) is a [`Form`].
//!
//! Conventions: points are Cartesian reference coordinates ([`Element`]: edges 1, of the tet sqrt 2);
//! lengths, gradients and |f| are in that unit; a [`Cell`] as a [`Field`] is negative inside its
//! solid. `shift` moves the field by a constant, not the surface by a distance. Volume fractions are
//! of the *element*, not of the period. Cells of planar elements are fields in space that do not
//! depend on z.
//!
//! | element | groups | lattices |
//! |---|---|---|
//! | tri | D3, C1 | hex2 |
//! | quad | D4, C1 | square |
//! | tet | Td, T, C3v, C1 | fcc2, cubic |
//! | hex | Oh, O, T, Th, Td, D4h, D2h, C4v, C3v, C1 | cubic |
//! | wedge | D3h, C3v, C1 | hexprism |
//! | pyramid | C4v, C1 | fcc1, tetragonal |
//! | ball | Ih | icosahedral |
//!
//! The first group (the whole one) and the first lattice are the defaults; any other group that
//! keeps the element and the lattice will do. The ball is no element of a scaffold: the icosahedral
//! group has no lattice in space, and a cell of it is one solid that stands alone ([`Icosahedral`]).
//!
//! [`fit()`] and [`fit_source`] make a cell from geometry, [`Surface`] from a closed form; [`Table`] is
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
use crate::frame::{CellBox, CellPoint, Element, Mat3, Vec3};
use crate::symmetry::{Lattice, PointGroup};
use std::sync::{Arc, OnceLock};

mod compatibility;
mod constraint;
mod domain;
pub mod edt;
mod error;
mod expression;
pub mod face_normal;
mod file;
mod fit;
mod hybrid;
mod icosahedral;
mod level_search;
pub mod minkowski;
mod series;
mod solid;
mod source;
mod surface;
mod table;
mod thickness;
mod trig_products;
pub use thickness::NearestLevel;
mod face_trace;
mod trig_sum;
pub use compatibility::{default_group, groups, lattices, operators_of, rank, symmetry};
pub use constraint::Constraint;
pub use error::CellError;
pub use expression::{Form, Node};
pub use file::CellTextError;
pub use fit::{
    Components, Distance, Filter, FitError, FitOptions, FitReport, Hausdorff, Method, Placement,
    Sample, Solver, SourceReport, Spectrum, Symmetrise, Transform, band_of_samples, fit,
    fit_matched, fit_mesh, fit_samples, fit_samples_least_squares, fit_source,
    fourier_coefficients, lanczos, largest_band, least_squares,
};
pub use hybrid::Join;
pub use icosahedral::{Icosahedral, lifted};
pub use level_search::Density;
pub use series::{Coefficient, Series};
pub use solid::{Fold, Smooth, Solid};
pub use source::{
    Caps, Origin, Skeleton, SkeletonError, Source, SourceKind, VoxelError, Voxels, graphs,
    plate_sets,
};
pub use surface::Surface;
pub use table::Table;
pub use trig_products::{Along, Column, FUNCTIONS, Products};

/// A unit cell of an element; as a [`Field`] negative inside its solid, evaluated exactly. The field of
/// a planar element's cell does not depend on z.
#[derive(Clone, Debug)]
pub struct Cell {
    name: String,
    element: Element,
    form: Form,
    group: String,
    operators: Arc<[Mat3]>,
    level: f64,
    solid: Solid,
    face_normal: bool,
    gamma: OnceLock<f64>,
    report: Option<Arc<FitReport>>,
}

impl Cell {
    /// A cell with level 0 and the solid below it, from a series or an expression of several.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] unless every series has the element's dimension, a group of
    /// symmetries of the element and one of its lattices.
    pub fn new(name: &str, element: Element, form: impl Into<Form>) -> Result<Self, CellError> {
        let form = form.into();
        let (group, operators) = compatibility::symmetry_of(element, &form)?;
        Ok(Self {
            name: name.to_owned(),
            element,
            form,
            group,
            operators: operators.into(),
            level: 0.0,
            solid: Solid::Below,
            face_normal: false,
            gamma: OnceLock::new(),
            report: None,
        })
    }

    /// The element's whole group and the lattice of that name for a solid element, ready for a
    /// series or a basis; [`symmetry()`] has other groups and planar elements.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] for a lattice of another element.
    pub fn symmetry(
        element: Element,
        lattice: Option<&str>,
    ) -> Result<(PointGroup<3>, Lattice<3>), CellError> {
        symmetry(element, None, lattice)
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
    pub fn form(&self) -> &Form {
        &self.form
    }

    /// The function, if it is one series in space.
    pub fn series(&self) -> Option<&Series<3>> {
        self.form.series()
    }

    /// The function, if it is one series in the plane.
    pub fn planar(&self) -> Option<&Series<2>> {
        self.form.planar()
    }

    /// Name of the group of all operators that are known to leave the function unchanged.
    pub fn group(&self) -> &str {
        &self.group
    }

    /// Those operators as Cartesian matrices; of a planar cell they leave z in place.
    pub fn operators(&self) -> &[Mat3] {
        &self.operators
    }

    /// Whether the cell is the same whatever the numbering of an element's nodes: whether its group
    /// is the element's whole one.
    pub fn fits_any_numbering(&self) -> bool {
        self.operators.len() == self.element.symmetry_order()
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

    /// Adds a warning to the report.
    fn warn(&mut self, message: String) {
        let mut report = self.report().cloned().unwrap_or_default();
        report.warnings.push(message);
        self.report = Some(Arc::new(report));
    }

    fn with_face_normal(mut self, face_normal: bool) -> Self {
        self.face_normal = face_normal;
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
        let mut cell = self;
        if centre != 0.0 {
            cell.form = cell.form.shifted(centre);
        }
        cell.with_solid(Solid::Sheet, half)
    }
}

impl Field for Cell {
    type Point = CellPoint<3>;

    fn value(&self, p: CellPoint<3>) -> f64 {
        self.solid.value(self.form.value(p), self.level)
    }

    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let (v, g) = self.form.value_and_gradient(p);
        let (v, s) = self.solid.value_and_slope(v, self.level);
        (v, g * s)
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        self.solid.interval(self.form.bound(region), self.level)
    }
}
