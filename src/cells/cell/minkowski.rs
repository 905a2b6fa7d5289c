//! Minkowski sums and differences of two cells of one element.
//!
//! The sum A (+) B holds every a + b; the difference A (-) B holds every x with x + B inside A. On the grid
//! of a period both are thresholds of a convolution of the indicators a and b: (a * b)(x) > 0, and
//! (a * b')(x) = |B| with b'(x) = b(-x). The counts are integers, so that thresholds half way between them
//! are exact. The signed distance of the result is fitted like any other source.
//!
//! B is the part of its cell inside the element, about the element's origin. A continues beyond the
//! element (`Environment::Torus`: periodic for a hex, by reflection for a tet and a wedge, like the
//! neighbours in a tiling) or ends at the element's faces (`Environment::Cell`, where a difference also
//! erodes A from the faces).

use super::edt::signed_distance;
use super::fit::{Extension, Transform};
use super::{Cell, FitError, FitOptions, Table, fit};
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Element, Vec3};
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Sum or difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Operation {
    /// A (+) B: dilation by B.
    #[default]
    Sum,
    /// A (-) B: erosion by B.
    Difference,
}

/// What surrounds the element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Environment {
    /// The cell's own continuation: its neighbours in a tiling.
    #[default]
    Torus,
    /// Void.
    Cell,
}

/// Operation and environment of a Minkowski combination.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Minkowski {
    /// Sum or difference.
    pub operation: Operation,
    /// What surrounds the element.
    pub environment: Environment,
}

/// Samples per unit of reference length, before rounding to a grid size.
const SAMPLES_PER_UNIT: f64 = 64.0;

/// The sum or difference of two sets of samples on a torus of `n`^3 samples at u = j/N - 1/2, last axis
/// fastest. The result is exact, as if computed from all pairs of samples.
/// `n` is even, so that u = 0 is a sample: that of the origin of B. True is solid. The solids wrap around the torus.
///
/// # Panics
/// If `a` or `b` does not hold `n`^3 samples.
pub fn combine(a: &[bool], b: &[bool], n: usize, operation: Operation) -> Vec<bool> {
    assert!(a.len() == n.pow(3) && b.len() == a.len(), "n^3 samples");
    let count = b.iter().filter(|s| **s).count() as f64;
    let transform = Transform::<3>::new(n);
    let indicator =
        |set: &[bool]| -> Vec<f64> { set.iter().map(|s| f64::from(u8::from(*s))).collect() };
    let mut product = transform.forward(&indicator(a));
    let b = transform.forward(&indicator(b));
    // The origin of B is at j = N/2 on each axis; the phase factor shifts it to index 0.
    let phase = std::f64::consts::TAU * ((n / 2) as f64) / n as f64;
    product.multiply(&b, |value, index| {
        let shifted =
            value * Complex64::from_polar(1.0, phase * f64::from(index.iter().sum::<i32>()));
        match operation {
            Operation::Sum => shifted,
            Operation::Difference => shifted.conj(),
        }
    });
    let scale = (n as f64).powi(3).recip();
    // Counts of pairs are integers: any pair for the sum, every point of B for the difference. Half a count separates
    // them despite rounding.
    let threshold = match operation {
        Operation::Sum => 0.5,
        Operation::Difference => count - 0.5,
    };
    transform
        .inverse(product)
        .into_iter()
        .map(|v| v * scale > threshold)
        .collect()
}

/// The cell of a sum or difference, fitted to the signed distance of the result.
/// `name` is that of the new cell, and `options` are those of the fit. The grid has about 64 samples per reference
/// length, so that details of the result below 1/64 are lost.
///
/// # Errors
/// [`FitError`]: cells of different elements, a planar element, on the torus also one whose cell has no continuation, a
/// result that is empty or fills the grid, and those of [`Table::new`] and [`fit()`].
pub fn minkowski(
    name: &str,
    a: &Cell,
    b: &Cell,
    how: Minkowski,
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Cell, FitError> {
    let element = a.element();
    if b.element() != element {
        return Err(FitError::Elements {
            first: element.name(),
            second: b.element().name(),
        });
    }
    let frame = Frame::new(element, how.environment)?;
    progress.stage("minkowski: samples", None);
    let (first, second) = (Table::new(a)?, Table::new(b)?);
    // Indicators of both solids on the grid of the period. A clipped cell is empty outside its element.
    let sampled = |table: &Table, clipped: bool, extension: Extension| -> Vec<bool> {
        frame.sample(|p| {
            // The tolerance keeps samples on the faces, which rounding may put outside.
            let within = !clipped || element.face_distance(p) <= 1e-9;
            within && table.value(CellPoint(extension.inner(p.0))) < 0.0
        })
    };
    let around = frame.extension.unwrap_or(Extension::Natural);
    let solid_a = sampled(&first, frame.extension.is_none(), around);
    let solid_b = sampled(&second, true, Extension::Natural);
    if progress.cancelled() {
        return Err(FitError::Cancelled(Cancelled));
    }
    progress.stage("minkowski: convolution", None);
    let solid = combine(&solid_a, &solid_b, frame.n, how.operation);
    drop((solid_a, solid_b));
    if let Some(missing) = missing(&solid) {
        return Err(FitError::NothingLeft {
            operation: match how.operation {
                Operation::Sum => "sum",
                Operation::Difference => "difference",
            },
            missing,
        });
    }
    let shape = [frame.n; 3];
    let periodic = frame.extension.is_some();
    // Distances on the torus wrap around; in a cell without neighbours they do not.
    let distance = signed_distance(&solid, &shape, &frame.steps(), periodic);
    let source = |p: CellPoint<3>| frame.interpolate(&distance, p);
    fit(name, element, &source, options, progress)
}

/// The phase that is absent, if one is.
/// "solid" or "void", as errors name it.
fn missing(solid: &[bool]) -> Option<&'static str> {
    if !solid.contains(&true) {
        return Some("solid");
    }
    (!solid.contains(&false)).then_some("void")
}

/// A grid of N^3 samples over a box that holds the element, at -1/2 + j/N of its edges.
struct Frame {
    n: usize,
    /// The edges of the box, centred at the origin, in reference lengths.
    size: Vec3,
    /// The continuation of the cell; `None` if it ends at the faces.
    extension: Option<Extension>,
}

impl Frame {
    /// The grid over the box that the environment needs. An error for a planar element, and for the torus of an element
    /// whose cell has no period.
    fn new(element: Element, environment: Environment) -> Result<Self, FitError> {
        if element.dimension() == 2 {
            return Err(FitError::NoExtension {
                element: element.name(),
                lattice: "any".to_owned(),
                method: "minkowski",
            });
        }
        let (size, extension) = match environment {
            // Twice the element's box, so that the convolution does not wrap around.
            Environment::Cell => {
                let v = element.vertices();
                let reach = v.iter().fold(Vec3::zeros(), |m, p| m.sup(&p.abs()));
                (reach * 4.0, None)
            }
            Environment::Torus => {
                let (size, extension) = Extension::box_of(element)?;
                (size, Some(extension))
            }
        };
        let n = super::fit::grid_size((size.max() * SAMPLES_PER_UNIT).round() as usize);
        Ok(Self { n, size, extension })
    }

    /// Distance between samples along each axis, in reference lengths.
    fn steps(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.size[a] / self.n as f64)
    }

    /// The samples in the order of [`combine`]: last axis fastest, the first at the box's lowest corner.
    fn sample(&self, inside: impl Fn(CellPoint<3>) -> bool + Sync) -> Vec<bool> {
        let n = self.n;
        (0..n.pow(3))
            .into_par_iter()
            .map(|index| {
                let j = [index / (n * n), index / n % n, index % n];
                let u = Vec3::from_fn(|a, _| j[a] as f64 / n as f64 - 0.5);
                inside(CellPoint(u.component_mul(&self.size)))
            })
            .collect()
    }

    /// The trilinear interpolant of values on the grid.
    /// It is periodic in the box.
    fn interpolate(&self, values: &[f64], p: CellPoint<3>) -> f64 {
        let u: [f64; 3] = p.0.component_div(&self.size).into();
        super::fit::multilinear(values, self.n, &u)
    }
}
