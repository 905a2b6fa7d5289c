//! Unit cells: symmetric Fourier series in an element's reference frame.
//!
//! A cell is a real function Phi = sum over orbits of C exp(2 pi i k.u), invariant under a group of
//! symmetries of its element, together with the solid: Phi < level, Phi > level, |Phi| < level or |Phi| > level. With
//! the element's full group, a cell continues across the faces of a mesh for any numbering of the nodes
//! ([`Cell::fits_any_numbering`]). With a subgroup it continues only between elements of equal
//! orientation. A function that is not one series (averages, minima, sheets) is an [`Expression`].
//!
//! [`fit()`] and [`fit_source`] make a cell from geometry, [`Surface`] from a closed form. [`Table`]
//! evaluates a cell fast. [`Cell::from_json`] and [`Cell::to_json`] read and write a `.cell` file.
//! [`groups`] lists the groups and lattices of each element.
//!
//! Not promised: Phi is no distance (its slope varies over the cell), and a fit rounds details finer than the waves of
//! its band: [`FitReport`] has the distances of both surfaces.

use crate::symmetry::{Lattice, PointGroup};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Element, Mat3, Vec3};
use std::sync::{Arc, OnceLock};

mod compatibility;
mod constraint;
mod design;
mod domain;
pub mod edt;
mod error;
mod expression;
pub mod face_normal;
mod file;
mod fit;
mod function_data;
mod hybrid;
mod icosahedral;
mod level_search;
pub mod minkowski;
mod restriction;
mod series;
mod solid;
mod source;
mod surface;
mod table;
mod thickness;
mod trig_products;
pub use thickness::NearestLevel;
mod face_trace;
#[doc(hidden)]
pub use face_trace::face_trace;
mod trig_sum;
#[doc(hidden)]
pub use compatibility::operators_of;
pub use compatibility::{default_group, groups, lattices, rank, space_group, symmetry};
pub use constraint::Constraint;
pub use design::{DesignProperties, DesignReport, DesignStep};
pub use error::CellError;
pub use expression::{Expression, Node};
pub use file::CellTextError;
#[doc(hidden)]
pub use fit::least_squares;
pub use fit::{
    Components, Distance, Filter, FitError, FitOptions, FitReport, Hausdorff, Method, Placement,
    Sample, Solver, SourceReport, Spectrum, Symmetrise, Transform, band_of_samples, fit,
    fit_matched, fit_mesh, fit_samples, fit_samples_least_squares, fit_source,
    fourier_coefficients, lanczos, largest_band,
};
use function_data::FunctionData;
pub use hybrid::Join;
pub use icosahedral::Icosahedral;
#[doc(hidden)]
pub use icosahedral::lifted;
pub use level_search::Density;
pub use restriction::{Frame, Mismatch, Restriction};
pub use series::{Coefficient, Series};
pub use solid::{Fold, SmoothFunction, Solid};
pub use source::{
    Caps, Origin, Skeleton, SkeletonError, Source, SourceKind, VoxelError, Voxels, graphs,
    plate_sets,
};
pub use surface::Surface;
#[doc(hidden)]
pub use surface::{Terms, of_terms};
pub use table::Table;
pub use trig_products::{Along, Column, FUNCTIONS, Products};

/// Least difference of the greatest and the least value of a function that is not constant: its cube is a number.
const MIN_RANGE: f64 = 1e-100;

/// A unit cell of an element. As a [`Field`] it is negative inside its solid and evaluated exactly.
///
/// Points are Cartesian reference coordinates ([`Element`]: edges 1, of the tet sqrt 2). Lengths,
/// gradients and |f| are in that unit. Volume fractions refer to the *element*, not to the period.
/// The field of a planar element's cell does not depend on z.
///
/// ```
/// # mod druse { pub use druse_cells::*; pub use druse_geometry::*; }
/// use druse::cell::{Cell, Surface};
/// use druse::field::Field;
/// use druse::frame::{CellPoint, Element, Vec3};
/// let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
/// assert!((p.value(CellPoint(Vec3::zeros())) - 3.0).abs() < 1e-14);
/// assert!((p.level_for_volume_fraction(0.35).unwrap() + 0.525_019_98).abs() < 1e-6);
/// ```
#[derive(Clone, Debug)]
pub struct Cell {
    name: String,
    element: Element,
    expression: Expression,
    group: String,
    operators: Arc<[Mat3]>,
    level: f64,
    solid: Solid,
    face_normal: bool,
    /// Root mean square of the gradient on the surface, once known; clones share it.
    gamma: Arc<OnceLock<f64>>,
    /// What has been evaluated of the function; clones share it, at any level.
    function_data: Arc<FunctionData>,
    report: Option<Arc<FitReport>>,
}

impl Cell {
    /// A cell with level 0 and the solid below it, from a series or an expression of series.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] unless every series has the element's dimension, a group of symmetries of
    /// the element and one of the element's lattices; [`CellError::Expression`] for a function without a series, or one
    /// that is nearly, but not exactly, constant.
    pub fn new(
        name: &str,
        element: Element,
        expression: impl Into<Expression>,
    ) -> Result<Self, CellError> {
        let expression = expression.into();
        let (group, operators) = compatibility::symmetry_of(element, &expression)?;
        // Searches for levels divide by cubes of differences of values.
        let values = expression.bound(&element.cell_box());
        let range = values.hi - values.lo;
        if range > 0.0 && range < MIN_RANGE {
            return Err(CellError::Expression(format!(
                "values that differ by {range:.1e}; expected at least {MIN_RANGE:?}: multiply the function by a number"
            )));
        }
        Ok(Self {
            name: name.to_owned(),
            element,
            expression,
            group,
            operators: operators.into(),
            level: 0.0,
            solid: Solid::Below,
            face_normal: false,
            gamma: Arc::default(),
            function_data: Arc::default(),
            report: None,
        })
    }

    /// The full group of a solid element and its lattice of the given name, for a series or a basis.
    /// [`symmetry()`] also accepts other groups and planar elements.
    ///
    /// # Errors
    /// [`CellError::Unfitting`] for a lattice of another element.
    pub fn symmetry(
        element: Element,
        lattice: Option<&str>,
    ) -> Result<(PointGroup<3>, Lattice<3>), CellError> {
        symmetry(element, None, lattice)
    }

    /// The display name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The element that the cell fills.
    pub fn element(&self) -> Element {
        self.element
    }

    /// The function whose level set is the surface.
    pub fn expression(&self) -> &Expression {
        &self.expression
    }

    /// The function, if it is a single series in space.
    pub fn series(&self) -> Option<&Series<3>> {
        self.expression.series()
    }

    /// The function, if it is a single series in the plane.
    pub fn planar(&self) -> Option<&Series<2>> {
        self.expression.planar()
    }

    /// Name of the group of all operators that are known to leave the function unchanged.
    /// A common subgroup without a name is called "common".
    pub fn group(&self) -> &str {
        &self.group
    }

    /// The operators of that group as Cartesian matrices. Those of a planar cell leave z unchanged.
    pub fn operators(&self) -> &[Mat3] {
        &self.operators
    }

    /// Whether the cell is independent of the numbering of an element's nodes, that is, whether its group
    /// is the full group of the element.
    pub fn fits_any_numbering(&self) -> bool {
        self.operators.len() == self.element.symmetry_order()
    }

    /// The level in field units. For a sheet it is half the thickness in field units.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// Which side of the level is solid.
    pub fn solid(&self) -> Solid {
        self.solid
    }

    /// Whether the fit constrained the surface to meet the element's faces at a right angle.
    /// It is a note of the fit: later changes of the function do not clear it.
    pub fn face_normal(&self) -> bool {
        self.face_normal
    }

    /// The report of the fit, if the cell is fitted.
    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_deref()
    }

    /// The cell with the report of its fit or design in place of its own.
    #[doc(hidden)]
    #[must_use]
    pub fn with_report(mut self, report: FitReport) -> Self {
        self.report = Some(Arc::new(report));
        self
    }

    /// Adds a warning to the report.
    /// A cell without a report gets one with the warning alone.
    fn warn(&mut self, message: String) {
        let mut report = self.report().cloned().unwrap_or_default();
        report.warnings.push(message);
        self.report = Some(Arc::new(report));
    }

    /// Sets the note that [`Self::face_normal`] returns; the function stays.
    fn with_face_normal(mut self, face_normal: bool) -> Self {
        self.face_normal = face_normal;
        self
    }

    /// The same cell with another name.
    #[must_use]
    pub fn named(mut self, name: &str) -> Self {
        name.clone_into(&mut self.name);
        self
    }

    /// The same function with another solid.
    /// The level is in field units, positive for a sheet or channels and below 1e18 in magnitude. The known root mean
    /// square of the gradient is dropped, as it depends on the surface.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a level that is not below 1e18 in magnitude, or not positive for a sheet or channels.
    pub fn with_solid(mut self, solid: Solid, level: f64) -> Result<Self, CellError> {
        solid.check(level)?;
        self.solid = solid;
        self.level = level;
        self.gamma = Arc::default();
        Ok(self)
    }

    /// The cell whose field is lower by `by` field units. Positive values add material. The surface moves
    /// by a change of level, not by a constant distance.
    ///
    /// # Errors
    /// As [`Self::with_solid`] for the new level.
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
    /// The level of a sheet or channels is replaced: their function is taken as it is.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] unless `half` is positive and below 1e18.
    pub fn sheet(self, half: f64) -> Result<Self, CellError> {
        let centre = self.solid.centre(self.level);
        let mut cell = self;
        if centre != 0.0 {
            cell.expression = cell.expression.shifted(centre);
            cell.function_data = Arc::default();
        }
        cell.with_solid(Solid::Sheet, half)
    }
}

impl Field for Cell {
    type Point = CellPoint<3>;

    fn value(&self, p: CellPoint<3>) -> f64 {
        self.solid.value(self.expression.value(p), self.level)
    }

    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let (v, g) = self.expression.value_and_gradient(p);
        let (v, s) = self.solid.value_and_slope(v, self.level);
        (v, g * s)
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        self.solid
            .interval(self.expression.bound(region), self.level)
    }
}
