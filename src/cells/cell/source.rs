//! Sources: the geometry from which a cell is fitted, as signed distances in the reference frame.
//!
//! A [`Source`] lives in the Cartesian reference coordinates of its element, after placement. It may
//! extend beyond its element or fill only a part of it. Whatever its origin (triangles, points, voxels,
//! struts, plates, a formula), the fit evaluates it at points; values are negative inside.
//!
//! A source is *exact* if its value is the distance to its surface. A formula is not exact, nor are scalar samples of
//! another mean slope than about 1, nor is a source that its placement shears, except a mesh, whose corners are placed
//! before distances are measured.

use super::FitError;
use super::fit::{Placement, SourceReport};
use druse_geometry::field::Formula;
use druse_geometry::frame::{Aabb, CellPoint, Element, Vec3};
use druse_geometry::mesh::CloudSolid;
use serde::{Deserialize, Serialize};

mod mesh;
mod origin;
mod skeleton;
mod voxels;
pub use mesh::Caps;
pub use origin::Origin;
pub use skeleton::{Skeleton, SkeletonError, graphs, plate_sets};
pub use voxels::{VoxelError, Voxels};

/// The kind of geometry.
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

/// A signed distance in the reference frame of an element, negative inside, with its metadata.
///
/// ```
/// # mod druse { pub use druse_cells::*; pub use druse_geometry::*; }
/// use druse::cell::{FitOptions, Placement, Skeleton, Source, fit_source};
/// use druse::{frame::Element, progress::Silent};
/// let struts = Skeleton::graph(Element::Hex, "bcc", 0.1).unwrap();
/// let source = Source::skeleton(Element::Hex, &struts, &Placement::Reference).unwrap();
/// let options = FitOptions { band_limit: 5.0, ..FitOptions::default() };
/// let cell = fit_source("bcc", Element::Hex, &source, &options, &Silent).unwrap();
/// assert!(cell.report().unwrap().rms < 0.01);
/// ```
pub struct Source {
    value: Value,
    /// Points of its surface inside the element.
    points: Vec<Vec3>,
    exact: bool,
    /// Samples per unit of reference length, if the source is sampled.
    resolution: Option<usize>,
    report: SourceReport,
    warnings: Vec<String>,
}

/// What the values of a source measure.
#[derive(Clone, Copy, PartialEq)]
enum Values {
    /// Signed distances to its surface.
    Distances,
    /// A function that is zero on its surface.
    Levels,
}

impl Source {
    /// A function in source coordinates, mapped to the reference frame by a placement. `bounds` is the box of the
    /// solid in source coordinates.
    /// Values are scaled by the placement's factor, so that distances stay distances under a similarity. The report's
    /// share is that of the box of the source inside the element's box. An error if the placement fits no such box.
    fn placed(
        kind: SourceKind,
        element: Element,
        value: impl Fn(Vec3) -> f64 + Send + Sync + 'static,
        bounds: Aabb,
        values: Values,
        placement: &Placement,
    ) -> Result<Self, FitError> {
        let map = placement.affine(element, bounds)?;
        let (back, factor) = (map.inverse(), map.factor());
        let shear = !map.is_similarity();
        // The map back to source coordinates; a distance is scaled by the factor of the similarity.
        let identity = *placement == Placement::Reference;
        let mut warnings = Vec::new();
        if shear && values == Values::Distances {
            warnings.push(
                "the placement shears the source: its values are no longer distances".to_owned(),
            );
        }
        let value: Value = if identity {
            Box::new(value)
        } else {
            Box::new(move |p| factor * value(back.point(p)))
        };
        let bounds = map.bounds(bounds);
        let inside = bounds.intersection(element_box(element));
        // Planar elements use the area, since their sources are flat.
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
            exact: values == Values::Distances && !shear,
            resolution: None,
            report: SourceReport {
                kind,
                box_min: bounds.min.into(),
                box_max: bounds.max.into(),
                share_inside: ratio(extent(inside), extent(bounds)),
                ..SourceReport::default()
            },
            warnings,
        })
    }

    /// Struts, plates or both.
    /// Struts make the kind `Graph`, even beside plates.
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
        Self::placed(
            kind,
            element,
            value,
            skeleton.bounds(),
            Values::Distances,
            placement,
        )
    }

    /// A formula in x, y, z, negative inside.
    /// The values are levels, not distances. The variables are in source coordinates, before the placement.
    ///
    /// # Errors
    /// [`FitError::Placement`], also for "fit", since a formula has no bounding box.
    ///
    /// # Panics
    /// If the formula has more than three variables.
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
        // The formula is defined on the whole element.
        let domain = placement
            .affine(element, Aabb::EMPTY)?
            .inverse()
            .bounds(element_box(element));
        Self::placed(
            SourceKind::Formula,
            element,
            value,
            domain,
            Values::Levels,
            placement,
        )
    }

    /// Points with normals.
    /// `cloud` has its distance in source coordinates. The report's share counts the points inside the element.
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
        let mut source = Self::placed(
            SourceKind::Points,
            element,
            value,
            bounds,
            Values::Distances,
            placement,
        )?;
        source.points = placed;
        // Points outside the element do not belong to its cell; those on a face do.
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

    /// Samples on a regular grid. By default the box of the grid is the element's bounding cube.
    /// Periodic only for hex and quad elements, whose period is the element's box.
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
        let values = if exact {
            Values::Distances
        } else {
            Values::Levels
        };
        let mut source = Self::placed(SourceKind::Voxels, element, value, unit, values, placement)?;
        source.report.points = voxels.counts().iter().product();
        let factor = placement.affine(element, unit)?.factor();
        source.resolution = Some((voxels.counts()[0] as f64 / factor) as usize);
        Ok(source)
    }

    /// The largest band limit that the samples support; infinite unless the source is sampled.
    /// In cycles per reference length, at least 1: (n - 1) / 2 for n samples per reference length, rounded down.
    pub fn max_band_limit(&self) -> f64 {
        self.resolution
            .map_or(f64::INFINITY, |n| (n.max(3) - 1).div_euclid(2) as f64)
    }

    /// Checks that the samples support frequencies up to `band_limit`.
    /// A source that is not sampled supports all. The band limit is in cycles per reference length; 1e9 stands for more.
    ///
    /// # Errors
    /// [`VoxelError::TooCoarse`] for fewer than 2 R + 1 samples per unit of length, with the band limit R rounded down.
    pub fn check_resolution(&self, band_limit: f64) -> Result<(), VoxelError> {
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

    /// Whether the value is the distance to the surface.
    pub fn is_exact(&self) -> bool {
        self.exact
    }

    /// Known points of the surface inside the element; empty if none are known.
    /// In reference coordinates; a mesh and points know theirs.
    pub fn surface_points(&self) -> &[Vec3] {
        &self.points
    }

    /// Kind, size and position of the source.
    /// Lengths are reference lengths.
    pub fn report(&self) -> SourceReport {
        self.report
    }

    /// Warnings, one lower-case sentence each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// The bounding box of an element.
fn element_box(element: Element) -> Aabb {
    let own = element.cell_box();
    Aabb {
        min: own.min,
        max: own.max,
    }
}

/// The ratio of a part to the whole, from 0 to 1; 0 if the whole is 0.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 {
        (part / whole).clamp(0.0, 1.0)
    } else {
        0.0
    }
}
