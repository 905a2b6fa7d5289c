//! How a cell is fitted.

use crate::cell::CellError;
use crate::frame::Element;

/// By what rule the coefficients are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Weighted least squares over the element only.
    #[default]
    Lsq,
    /// Fourier transform of samples over the whole period: of the source itself where the element is
    /// the period or the lattice is that of the cube around a tet, else of its continuous
    /// extension by reflection.
    Fft,
    /// The paper's: as `Fft`, but for the tet by the reflection of its corners into the unit
    /// cube, which jumps across the cube's faces. For comparison only.
    Paper,
}

impl Method {
    /// Its name in recipes and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lsq => "lsq",
            Self::Fft => "fft",
            Self::Paper => "paper",
        }
    }
}

/// What the images of a source that lacks the symmetry make together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Symmetrise {
    /// Their mean: the orthogonal projection.
    #[default]
    Average,
    /// Their union: the least of the distances.
    Union,
    /// Their intersection: the greatest of the distances.
    Intersection,
}

/// How the least squares are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// Dense up to 3000 unknowns; then over a grid of the period, dense up to 8000 (1 GiB), then
    /// iterative.
    #[default]
    Auto,
    /// Normal equations and Cholesky.
    Dense,
    /// Matrix-free: conjugate gradients with two Fourier transforms a step.
    Iterative,
}

/// What is done to the spectrum of samples: it calms the waves beside steep places, of voxels that are
/// solid or void above all, and rounds edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Nothing: best for distances.
    #[default]
    None,
    /// Lanczos' factors sinc(k/(h + 1)) for every index k, h the greatest that the samples tell; of
    /// lattices that are not square or cubic those of the length of the frequency.
    Lanczos,
}

/// How a cell is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// By what rule the coefficients are found.
    pub method: Method,
    /// R: keeps |f| <= R, in cycles per unit of reference length. With a tolerance the greatest R
    /// that is tried. Of samples over a period, infinity keeps all that lies below Nyquist on each axis.
    pub band_limit: f64,
    /// Name of the group; `None` for the element's whole one.
    pub group: Option<String>,
    /// Name of the lattice; `None` for the element's default.
    pub lattice: Option<String>,
    /// Weight lambda of the penalty (1 + |f|^2) a^2 of the least squares; 1e-5 if left out, and 3e-6
    /// for face-normal cells. Smaller ones gain a little inside and let the gradient outside grow.
    pub regularisation: Option<f64>,
    /// Least number of samples along an edge of the element's cube; more are taken where the
    /// unknowns ask for them.
    pub samples: usize,
    /// What is done to the spectrum of a transform; least squares do not regard it.
    pub filter: Filter,
    /// How the least squares are solved.
    pub solver: Solver,
    /// How many real coefficients are kept, the largest ones; least squares are solved again for them.
    pub keep: Option<usize>,
    /// Whether the surface is to meet the element's faces at a right angle.
    pub face_normal: bool,
    /// Greatest distance allowed between the two surfaces: the band limit is raised from 4 by
    /// factors of 1.5 until it is met.
    pub tolerance: Option<f64>,
    /// What the images of a source that lacks the symmetry make together.
    pub symmetrise: Symmetrise,
    /// Whether to measure the Hausdorff distance and the number of pieces; a tolerance always does.
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

/// Greatest number of unknowns of the dense solver, of any, and up to which the dense one is taken
/// without being asked for.
const MOST_DENSE: usize = 4000;
const MOST_UNKNOWNS: usize = 40_000;
const DENSE_BY_ITSELF: usize = 3000;
/// Greatest number of unknowns whose matrix and its factor, 16 bytes for each of its entries, are held when
/// neither is given: 1 GiB.
const DENSE_ON_GRID: usize = 8000;

impl FitOptions {
    /// Checks every number by itself.
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
    pub(super) fn lambda(&self) -> f64 {
        self.regularisation
            .unwrap_or(if self.face_normal { 3e-6 } else { 1e-5 })
    }

    /// Weights of the means over interior, faces and edges in the sum of squares. A right angle at
    /// the faces is bought with their values: to ask for these as well would spoil the interior.
    pub(super) fn weights(&self) -> [f64; 3] {
        if self.face_normal {
            [1.0, 0.03, 0.01]
        } else {
            [1.0, 0.3, 0.1]
        }
    }

    /// Greatest number of unknowns that the chosen method takes.
    pub(super) fn most_unknowns(&self, element: Element) -> usize {
        let dense = self.method == Method::Lsq && self.solver == Solver::Dense;
        if dense || element == Element::Ball {
            MOST_DENSE
        } else {
            MOST_UNKNOWNS
        }
    }

    /// That nothing is asked of the ball that needs faces or a period.
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
    pub(super) fn on_grid(&self, element: Element, unknowns: usize) -> bool {
        match self.solver {
            _ if element == Element::Ball => false,
            Solver::Auto => unknowns > DENSE_BY_ITSELF,
            Solver::Dense => false,
            Solver::Iterative => true,
        }
    }

    /// Whether they are solved without a matrix there.
    pub(super) fn iterative(&self, unknowns: usize) -> bool {
        self.solver == Solver::Iterative || unknowns > DENSE_ON_GRID
    }
}
