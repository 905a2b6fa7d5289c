//! The report of a fit.
//!
//! It is written into `.cell` files as it is, so that the names of its fields are names in files. Missing fields are
//! read as 0, empty or none. Measures that were not taken are absent.

use crate::cell::{DesignReport, SourceKind};
use serde::{Deserialize, Serialize};

/// The accuracy of a cell relative to the geometry of its fit. Lengths are in reference units.
///
/// Distances refer to the combined images of the source, if the source lacks the symmetry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FitReport {
    /// "lsq", "fft" or "paper" as [`crate::cell::Method`] has them, or "matched" ([`crate::cell::fit_matched`]).
    pub method: String,
    /// The solver: dense, iterative with its number of steps, or a transform.
    pub solver: String,
    /// Name of the lattice.
    pub lattice: String,
    /// R: frequencies |f| <= R are kept.
    pub band_limit: f64,
    /// Weight of the penalty (1 + |f|^2) a^2.
    pub regularisation: f64,
    /// Number of real coefficients that are not zero.
    pub degrees_of_freedom: usize,
    /// Root mean square of cell minus source over the element's interior.
    pub rms: f64,
    /// Largest difference on the element's faces.
    pub face_max: f64,
    /// Largest difference on the element's edges.
    pub edge_max: f64,
    /// Distances of the two surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hausdorff: Option<Hausdorff>,
    /// Share of the source's mean square that its symmetric part keeps: 1 for a symmetric source.
    pub kept_energy: f64,
    /// Root mean square of the source minus its symmetric part.
    pub symmetry_residual: f64,
    /// Largest |n . grad Phi| on the element's faces; 0 up to rounding for face-normal cells.
    pub face_normal_residual: f64,
    /// Largest sampled gradient inside the element (1 for a distance).
    pub gradient_inside: f64,
    /// Largest sampled gradient over the whole period.
    pub gradient_outside: f64,
    /// Connected components in one element.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<Components>,
    /// The source, if it is more than a function.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<SourceReport>,
    /// How it was designed, if a target made it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub design: Option<DesignReport>,
    /// Warnings for the user.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// One-sided distances of two surfaces inside the element, sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Hausdorff {
    /// Largest distance of a point of the cell's surface from the source's.
    pub cell_to_source: f64,
    /// Largest distance of a point of the source's surface from the cell's.
    pub source_to_cell: f64,
}

impl Hausdorff {
    /// The larger of the two.
    pub fn max(self) -> f64 {
        self.cell_to_source.max(self.source_to_cell)
    }
}

/// Connected components of solid and void in one element, without connections through its faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Components {
    /// Components of solid in the source.
    pub source_solid: usize,
    /// Components of solid in the cell.
    pub cell_solid: usize,
    /// Components of void in the source.
    pub source_void: usize,
    /// Components of void in the cell.
    pub cell_void: usize,
}

/// The source of a fit, in reference coordinates after placement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SourceReport {
    /// The kind of source.
    pub kind: SourceKind,
    /// Triangles of a mesh.
    pub triangles: usize,
    /// Triangles in a face plane of the element, which count for the inside test only.
    pub caps: usize,
    /// Points of a cloud, or samples of a grid.
    pub points: usize,
    /// Lower corner of the bounding box.
    pub box_min: [f64; 3],
    /// Upper corner of the bounding box.
    pub box_max: [f64; 3],
    /// Share inside the element: of the area of a mesh (without caps), of the points, else of the bounding
    /// box.
    pub share_inside: f64,
}
