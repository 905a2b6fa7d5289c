//! Options of a fit.
//!
//! All have defaults. A fit checks their ranges first; whether a group, lattice or method suits the
//! element is checked when the fit uses it.

use crate::cell::CellError;
use druse_geometry::frame::Element;

/// The method that determines the coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Weighted least squares over the element only.
    #[default]
    Lsq,
    /// Fourier transform of samples over the whole period. The samples are those of the source itself if the
    /// element is the period or the lattice is that of the cube around a tet, else those of its continuous
    /// extension by reflection.
    Fft,
    /// The method of Chen, Kabaria and Lew, for comparison: `Fft`, but a tet is extended by reflection of the cube's
    /// corners in its faces, which is discontinuous across the cube's faces.
    Paper,
}

impl Method {
    /// The name in recipes and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lsq => "lsq",
            Self::Fft => "fft",
            Self::Paper => "paper",
        }
    }
}

/// The combination of the images of a source without the symmetry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Symmetrise {
    /// Their mean: the orthogonal projection.
    #[default]
    Average,
    /// Their union: the minimum of the distances.
    Union,
    /// Their intersection: the maximum of the distances.
    Intersection,
}

/// The solver of the least squares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// Dense up to 3000 unknowns; then over a grid of the period, dense up to 8000 (1 GiB), then
    /// iterative.
    #[default]
    Auto,
    /// Normal equations and Cholesky.
    Dense,
    /// Matrix-free: conjugate gradients with two Fourier transforms per step.
    Iterative,
}

/// Filter of the spectrum of samples. It damps ripples beside steep slopes, above all of binary voxels, and
/// rounds edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// No filter; best for distances.
    #[default]
    None,
    /// Lanczos' factors sinc(k/(h + 1)) for every index k, with h the largest index below Nyquist. On lattices
    /// that are not square or cubic, the factor depends on the length of the frequency.
    Lanczos,
}

/// Options of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// The method that determines the coefficients.
    pub method: Method,
    /// The band limit R: the fit keeps |f| <= R, in cycles per unit of reference length. With a tolerance it
    /// is the largest band limit. For samples over a period, infinity keeps all frequencies below Nyquist.
    pub band_limit: f64,
    /// Name of the group; `None` for the element's full group.
    pub group: Option<String>,
    /// Name of the lattice; `None` for the element's default.
    pub lattice: Option<String>,
    /// Weight lambda of the penalty (1 + |f|^2) a^2 of the least squares. The default is 1e-5, 3e-6 for
    /// face-normal cells, and 0 for samples over a period. A smaller weight fits the interior slightly better, but the
    /// gradient outside grows.
    pub regularisation: Option<f64>,
    /// Minimal number of samples along an edge of the element's cube, at most 1024. Many unknowns increase it.
    pub samples: usize,
    /// Filter of the spectrum of a transform. With least squares over the element, any but `None` is an error.
    pub filter: Filter,
    /// The solver of the least squares.
    pub solver: Solver,
    /// Number of largest real coefficients that are kept; the least squares are then solved for these alone.
    pub keep: Option<usize>,
    /// Whether the surface must meet the element's faces at a right angle.
    pub face_normal: bool,
    /// Largest distance between the two surfaces, reference lengths. The band limit increases from 4 by factors of 1.5
    /// until the distance is within the tolerance, `band_limit` at most. Samples over a period ignore it.
    pub tolerance: Option<f64>,
    /// The combination of the images of a source without the symmetry.
    pub symmetrise: Symmetrise,
    /// Whether to measure the Hausdorff distance and the number of components; a tolerance always does.
    pub measure: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            method: Method::Lsq,
            band_limit: 8.0,
            group: None,
            lattice: None,
            regularisation: None,
            samples: 32,
            filter: Filter::None,
            solver: Solver::Auto,
            keep: None,
            face_normal: false,
            tolerance: None,
            symmetrise: Symmetrise::Average,
            measure: true,
        }
    }
}

/// Maximal number of unknowns of the dense solver and of any solver, and the number up to which `Auto`
/// selects the dense one.
const MAX_DENSE_UNKNOWNS: usize = 4000;
const MAX_UNKNOWNS: usize = 40_000;
const MAX_AUTO_DENSE_UNKNOWNS: usize = 3000;
/// Maximal number of unknowns for a dense matrix over a grid, unless the solver is given. Matrix and factor
/// take 16 bytes per entry: 1 GiB.
const MAX_GRID_DENSE_UNKNOWNS: usize = 8000;

impl FitOptions {
    /// Checks the range of every option.
    /// `of_samples` means samples over a whole period, which alone allow an infinite band limit.
    pub(super) fn check(&self, of_samples: bool) -> Result<(), CellError> {
        let out_of_range = |what, found: f64, expected: &str| CellError::OutOfRange {
            what,
            found,
            expected: expected.to_owned(),
        };
        let positive = |what, found: f64, expected: &str| {
            if found.is_finite() && found > 0.0 {
                return Ok(());
            }
            Err(out_of_range(what, found, expected))
        };
        // Samples over a period limit the band themselves, so that an infinite band limit is allowed for them.
        if !(of_samples && self.band_limit == f64::INFINITY) {
            positive(
                "band_limit",
                self.band_limit,
                "a positive number of cycles per unit of reference length",
            )?;
        }
        positive(
            "regularisation",
            self.lambda(),
            "a positive number, such as 1e-5",
        )?;
        if let Some(tolerance) = self.tolerance {
            positive(
                "tolerance",
                tolerance,
                "a positive distance in reference lengths, such as 0.01",
            )?;
        }
        if self.samples > 1024 {
            return Err(out_of_range(
                "samples",
                self.samples as f64,
                "at most 1024 along an edge of the element's cube",
            ));
        }
        if self.keep == Some(0) {
            return Err(out_of_range("keep", 0.0, "at least one coefficient"));
        }
        Ok(())
    }

    /// The weight of the penalty.
    /// Where none is given it is 1e-5, and 3e-6 for face-normal cells.
    pub(super) fn lambda(&self) -> f64 {
        self.regularisation
            .unwrap_or(if self.face_normal { 3e-6 } else { 1e-5 })
    }

    /// Weights of the means over interior, faces and edges in the sum of squares. A right angle at the faces
    /// conflicts with the values there, so face-normal cells weigh the faces less.
    /// In the order interior, faces, edges.
    pub(super) fn weights(&self) -> [f64; 3] {
        if self.face_normal {
            [1.0, 0.03, 0.01]
        } else {
            [1.0, 0.3, 0.1]
        }
    }

    /// Maximal number of unknowns of the chosen method.
    pub(super) fn max_unknowns(&self, element: Element) -> usize {
        let dense = self.method == Method::Lsq && self.solver == Solver::Dense;
        if dense || element == Element::Ball {
            MAX_DENSE_UNKNOWNS
        } else {
            MAX_UNKNOWNS
        }
    }

    /// Checks that the options for a ball need neither faces nor a period.
    pub(super) fn check_ball(&self) -> Result<(), CellError> {
        let fail = |what, found: &str, expected: &str| {
            Err(CellError::Unfitting {
                element: Element::Ball.name(),
                what,
                found: found.to_owned(),
                expected: expected.to_owned(),
            })
        };
        if self.face_normal {
            return fail("face_normal", "true", "false, since it has no faces");
        }
        if self.method != Method::Lsq {
            return fail("method", self.method.name(), "lsq, since it has no period");
        }
        if self.solver == Solver::Iterative {
            return fail("solver", "iterative", "dense, since it has no period");
        }
        Ok(())
    }

    /// Whether the least squares are solved over a grid of the period.
    /// Never for the ball, which has no period.
    pub(super) fn on_grid(&self, element: Element, unknowns: usize) -> bool {
        match self.solver {
            _ if element == Element::Ball => false,
            Solver::Auto => unknowns > MAX_AUTO_DENSE_UNKNOWNS,
            Solver::Dense => false,
            Solver::Iterative => true,
        }
    }

    /// Whether the least squares over a grid are solved without a matrix.
    pub(super) fn iterative(&self, unknowns: usize) -> bool {
        self.solver == Solver::Iterative || unknowns > MAX_GRID_DENSE_UNKNOWNS
    }
}
