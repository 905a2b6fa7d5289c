//! What a cell is made from: a signed distance in the reference frame, and what is known of it.
//!
//! A [`Source`] lives in the Cartesian reference coordinates of its element, after placement; it may
//! reach beyond its element or fill only a part of it. Whatever it came from (triangles, points, voxels,
//! struts, plates, a formula), the fit asks it for a value at a point, negative inside.
//!
//! A source is *exact* where its value is the distance to its surface; a formula is not, nor is anything
//! that a placement shears.
//!
//! ```
//! use druse::cell::{FitOptions, Placement, Skeleton, Source, fit_source};
//! use druse::{frame::Element, progress::Silent};
//! let struts = Skeleton::graph(Element::Hex, "bcc", 0.1).unwrap();
//! let source = Source::skeleton(Element::Hex, &struts, &Placement::Reference).unwrap();
//! let options = FitOptions { band_limit: 5.0, ..FitOptions::default() };
//! let cell = fit_source("bcc", Element::Hex, &source, &options, &Silent).unwrap();
//! assert!(cell.report().unwrap().rms < 0.01);
//! ```

use super::FitError;
use super::fit::{Placement, SourceReport};
use crate::field::Formula;
use crate::frame::{Aabb, CellPoint, Element, Vec3};
use crate::mesh::CloudSolid;
use serde::{Deserialize, Serialize};

mod mesh;
mod origin;
mod skeleton;
mod voxels;
pub use mesh::Caps;
pub use origin::Origin;
pub use skeleton::{Skeleton, SkeletonError, graphs, plate_sets};
pub use voxels::{VoxelError, Voxels};

/// What a source was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// Triangles.
    #[default]
    Mesh,
    /// Points with normals.
    Points,
    /// Samples on a regular grid.
    Voxels,
    /// Struts.
    Graph,
    /// Plates.
    Plates,
    /// A formula in x, y, z.
    Formula,
}

impl SourceKind {
    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh",
            Self::Points => "points",
            Self::Voxels => "voxels",
            Self::Graph => "graph",
            Self::Plates => "plates",
            Self::Formula => "formula",
        }
    }
}

/// A real function of a point in reference coordinates.
type Value = Box<dyn Fn(Vec3) -> f64 + Send + Sync>;

/// A signed distance in the reference frame of an element, negative inside, with what is known of it.
pub struct Source {
    value: Value,
    /// Points of its surface inside the element.
    points: Vec<Vec3>,
    exact: bool,
    /// Samples per unit of reference length, where it is sampled.
    resolution: Option<usize>,
    report: SourceReport,
    warnings: Vec<String>,
}

impl Source {
    /// A function in source coordinates, placed.
    fn placed(
        kind: SourceKind,
        element: Element,
        value: impl Fn(Vec3) -> f64 + Send + Sync + 'static,
        bounds: Aabb,
        exact: bool,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        let map = placement.affine(element, bounds)?;
        let (back, factor) = (map.inverse(), map.factor());
        let shear = !map.is_similarity();
        let identity = *placement == Placement::Reference;
        let mut warnings = Vec::new();
        if shear && exact {
            warnings.push(
                "the placement shears the source: its values are no distances any more".to_owned(),
            );
        }
        let value: Value = if identity {
            Box::new(value)
        } else {
            Box::new(move |p| factor * value(back.point(p)))
        };
        let bounds = map.bounds(bounds);
        let inside = bounds.intersection(element_box(element));
        // Of planar elements the area: their sources are flat.
        let extent = |b: Aabb| {
            if b.is_empty() {
                0.0
            } else {
                b.size().as_slice()[..element.dimension()].iter().product()
            }
        };
        Ok(Self {
            value,
            points: Vec::new(),
            exact: exact && !shear,
            resolution: None,
            report: SourceReport {
                kind,
                box_min: bounds.min.into(),
                box_max: bounds.max.into(),
                share_inside: share(extent(inside), extent(bounds)),
                ..SourceReport::default()
            },
            warnings,
        })
    }

    /// Struts, plates or both.
    ///
    /// # Errors
    /// [`FitError::Placement`] and [`FitError::Skeleton`].
    pub fn skeleton(
        element: Element,
        skeleton: &Skeleton,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        let kind = if skeleton.struts().is_empty() {
            SourceKind::Plates
        } else {
            SourceKind::Graph
        };
        let value = skeleton.distances()?;
        Self::placed(kind, element, value, skeleton.bounds(), true, placement)
    }

    /// A formula in x, y, z, negative inside.
    ///
    /// # Errors
    /// [`FitError::Placement`]; "fit" has no box to fit.
    ///
    /// # Panics
    /// When the formula has more than three variables.
    pub fn formula(
        element: Element,
        formula: Formula,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        if *placement == Placement::Fit {
            return Err(FitError::Placement(
                "a formula has no box that could be fitted; expected reference, scale or vertices"
                    .to_owned(),
            ));
        }
        let value = move |p: Vec3| formula.value(&[p.x, p.y, p.z]);
        // It is wherever its element is.
        let everywhere = placement
            .affine(element, Aabb::EMPTY)?
            .inverse()
            .bounds(element_box(element));
        Self::placed(
            SourceKind::Formula,
            element,
            value,
            everywhere,
            false,
            placement,
        )
    }

    /// Points with normals.
    ///
    /// # Errors
    /// [`FitError::Placement`].
    pub fn points(
        element: Element,
        cloud: CloudSolid,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        let bounds = cloud.bounds();
        let map = placement.affine(element, bounds)?;
        let placed: Vec<Vec3> = cloud.points().iter().map(|p| map.point(*p)).collect();
        let count = placed.len();
        let turned = cloud.is_turned();
        let value = move |p: Vec3| cloud.signed_distance(p);
        let mut source = Self::placed(SourceKind::Points, element, value, bounds, true, placement)?;
        source.points = placed;
        source
            .points
            .retain(|p| element.face_distance(CellPoint(*p)) <= 0.0);
        source.report.points = count;
        source.report.share_inside = source.points.len() as f64 / count as f64;
        if turned {
            source
                .warnings
                .push("the normals point inward; turned".to_owned());
        }
        Ok(source)
    }

    /// Samples on a regular grid; by default its box is the element's bounding cube.
    ///
    /// # Errors
    /// [`FitError::Placement`].
    pub fn voxels(
        element: Element,
        voxels: &Voxels,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        let periodic = matches!(element, Element::Hex | Element::Quad);
        let (value, exact) = voxels.function(periodic);
        let unit = Aabb::of([Vec3::repeat(-0.5), Vec3::repeat(0.5)]);
        let mut source = Self::placed(SourceKind::Voxels, element, value, unit, exact, placement)?;
        source.report.points = voxels.counts().iter().product();
        let factor = placement.affine(element, unit)?.factor();
        source.resolution = Some((voxels.counts()[0] as f64 / factor) as usize);
        Ok(source)
    }

    /// The greatest band limit that it is known finely enough for: infinity unless it is sampled.
    pub fn carried_band(&self) -> f64 {
        self.resolution
            .map_or(f64::INFINITY, |n| (n.max(3) - 1).div_euclid(2) as f64)
    }

    /// Whether it is known finely enough for frequencies up to `band_limit`.
    ///
    /// # Errors
    /// [`VoxelError::TooCoarse`]: 2 R + 1 samples per unit of length are needed.
    pub fn resolves(&self, band_limit: f64) -> Result<(), VoxelError> {
        let Some(samples) = self.resolution else {
            return Ok(());
        };
        let needed = 2 * band_limit.floor().clamp(0.0, 1e9) as usize + 1;
        if samples >= needed {
            return Ok(());
        }
        Err(VoxelError::TooCoarse {
            samples,
            band_limit,
            needed,
            largest: samples.saturating_sub(1) as f64 / 2.0,
        })
    }

    /// Its value at a point of the reference frame.
    pub fn value(&self, p: CellPoint<3>) -> f64 {
        (self.value)(p.0)
    }

    /// Whether its value is the distance to its surface.
    pub fn is_exact(&self) -> bool {
        self.exact
    }

    /// Points known to lie on its surface and inside the element; empty where none are known.
    pub fn surface_points(&self) -> &[Vec3] {
        &self.points
    }

    /// What it is and where it stands.
    pub fn report(&self) -> SourceReport {
        self.report
    }

    /// What was odd about it, one sentence each, in lower case.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// The box around an element.
fn element_box(element: Element) -> Aabb {
    let own = element.cell_box();
    Aabb {
        min: own.min,
        max: own.max,
    }
}

/// The part of the whole, from 0 to 1; none of nothing.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 {
        (part / whole).clamp(0.0, 1.0)
    } else {
        0.0
    }
}
