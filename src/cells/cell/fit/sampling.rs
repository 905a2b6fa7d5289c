//! Samples of the source: quadrature points, target values and the symmetry of the source.
//!
//! The points are midpoints of equal parts of the flags of the fundamental domain: interior, faces and edges. The
//! target at a point combines the values at its images under the group, unless the source is symmetric already.

use super::super::domain::{Domain, Flag, SimplexGrid, all_flags};
use super::accuracy::SourceInfo;
use super::{Distance, FitError, Symmetrise};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Minimal number of samples per unknown.
const SAMPLES_PER_UNKNOWN: usize = 12;

/// An operator of a group that gives an image of the source.
pub(super) struct ImageMap {
    pub rotation: Mat3,
    /// The fractions of the periods, of a space group; the image then lies in the same period again.
    pub shift: Option<Vec3>,
}

impl ImageMap {
    fn apply(&self, p: CellPoint<3>) -> CellPoint<3> {
        let turned = self.rotation * p.0;
        CellPoint(match self.shift {
            Some(shift) => (turned + shift).map(|c| c - c.round()),
            None => turned,
        })
    }
}

/// The source and the operators that give its images.
pub(super) struct Images<'a> {
    pub source: &'a Distance<'a>,
    pub operators: Vec<ImageMap>,
    pub symmetrise: Symmetrise,
}

/// Statistics of the source over the images of a point.
struct Moments {
    /// The target value of the fit.
    value: f64,
    mean: f64,
    mean_square: f64,
    /// Mean square deviation from the target value.
    spread: f64,
}

impl Images<'_> {
    /// The values of the source at the images of a point, and their combination.
    /// `mean` and `spread` are statistics, `value` is what the fit takes.
    fn moments(&self, p: CellPoint<3>) -> Moments {
        let n = self.operators.len() as f64;
        let values: Vec<f64> = self
            .operators
            .iter()
            .map(|q| (self.source)(q.apply(p)))
            .collect();
        let mean = values.iter().sum::<f64>() / n;
        let value = match self.symmetrise {
            Symmetrise::Average => mean,
            Symmetrise::Union => values.iter().copied().fold(f64::INFINITY, f64::min),
            Symmetrise::Intersection => values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        };
        Moments {
            value,
            mean,
            mean_square: values.iter().map(|v| v * v).sum::<f64>() / n,
            spread: values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / n,
        }
    }
}

/// The target of the fit: the source itself if it is symmetric, else the combination of its images.
pub(super) struct Target<'a> {
    pub images: Images<'a>,
    pub symmetric: bool,
}

impl Target<'_> {
    /// The value that a fit takes at a point of the element. A symmetric source needs no images.
    pub fn value(&self, p: CellPoint<3>) -> f64 {
        if self.symmetric {
            (self.images.source)(p)
        } else {
            self.images.moments(p).value
        }
    }
}

/// Midpoints of a simplex of dimension 1 to 3 divided into n, n^2 or n^3 equal parts, as ordered coordinates
/// in the flag. All parts have equal weight.
pub(super) fn midpoints(dimension: usize, n: usize) -> Vec<[f64; 3]> {
    let step = 1.0 / n as f64;
    match dimension {
        1 => (0..n)
            .map(|j| [1.0, (j as f64 + 0.5) * step, 0.0])
            .collect(),
        2 => {
            let mut all = Vec::with_capacity(n * n);
            // Row j of the triangle has j + 1 upright parts and j inverted ones, with the centroids at thirds
            // of a step.
            for j in 0..n {
                for k in 0..=j {
                    let (b, c) = (j as f64, k as f64);
                    all.push([1.0, (b + 2.0 / 3.0) * step, (c + 1.0 / 3.0) * step]);
                    if k < j {
                        all.push([1.0, (b + 1.0 / 3.0) * step, (c + 2.0 / 3.0) * step]);
                    }
                }
            }
            all
        }
        _ => {
            let mut all = Vec::with_capacity(n * n * n);
            // The centroid of each small tetrahedron is the mean of its four grid points.
            SimplexGrid::new(n).tetrahedra(|corners| {
                all.push(std::array::from_fn(|a| {
                    corners.iter().map(|c| c[a] as f64).sum::<f64>() / 4.0 * step
                }));
            });
            all
        }
    }
}

/// Ordered coordinates of the midpoints of equal parts of a flag's share of the interior (0), the face (1) or
/// the edge (2) of an element; `None` for the edge of a planar element.
/// `n` is the number of parts per edge.
pub(super) fn stratum(dimension: usize, which: usize, n: usize) -> Option<Vec<[f64; 3]>> {
    match (dimension, which) {
        (3, _) => Some(midpoints(3 - which, n)),
        // The flag of a planar element is the triangle c = 0.
        (_, 0) => Some(
            midpoints(2, n)
                .into_iter()
                .map(|[_, b, c]| [b, c, 0.0])
                .collect(),
        ),
        (_, 1) => Some(midpoints(1, n)),
        _ => None,
    }
}

/// Size of a flag's share of a face or edge, up to a factor; for the interior, the flag's share of the
/// volume.
/// `which` is 0 for the interior, 1 for a face, 2 for an edge.
fn extent(flag: &Flag, dimension: usize, which: usize) -> f64 {
    let [_, vertex, edge, face] = flag.corners;
    match (dimension, which) {
        (_, 0) => flag.share,
        (3, 1) => (edge - vertex).cross(&(face - vertex)).norm(),
        _ => (edge - vertex).norm(),
    }
}

/// Parts per edge of a flag, enough for the unknowns and for the requested density.
/// `per_edge` is the density along an edge of the element's cube. At least 6.
pub(super) fn parts_per_edge(
    element: Element,
    domain: &Domain,
    unknowns: usize,
    per_edge: usize,
) -> usize {
    let dimension = element.dimension();
    let root = |v: f64| v.powf(1.0 / dimension as f64);
    let flags = all_flags(element).len() as f64;
    let by_density = per_edge as f64 * root(element.measure() / flags);
    let by_unknowns = root((SAMPLES_PER_UNKNOWN * unknowns) as f64 / domain.flags.len() as f64);
    by_density.max(by_unknowns).ceil().max(6.0) as usize
}

/// The symmetry of the source over the element's interior.
pub(super) struct Quality {
    /// Share of the mean square that the mean over the group keeps.
    pub kept_energy: f64,
    /// Root mean square deviation from that mean.
    pub residual: f64,
    /// Root mean square of the source.
    pub rms: f64,
}

/// A point of the element with its weight in the mean over interior, faces and edges.
pub(super) type QuadraturePoint = (CellPoint<3>, f64);

/// Midpoints of the parts of all flags, those of the interior first, and the number of the latter. `weights`
/// are those of interior, faces and edges.
/// The weights of each stratum add up to the given one. Faces have twice, and edges four times the parts per edge that
/// the interior has.
pub(super) fn quadrature_points(
    element: Element,
    domain: &Domain,
    parts_per_edge: usize,
    weights: [f64; 3],
) -> (Vec<QuadraturePoint>, usize) {
    let dimension = element.dimension();
    let mut quadrature_points = Vec::new();
    let mut interior = 0;
    for (which, weight) in weights.into_iter().enumerate() {
        let Some(midpoints) = stratum(dimension, which, parts_per_edge << which) else {
            continue;
        };
        // The sphere has no edges.
        if element == Element::Ball && which == 2 {
            continue;
        }
        let sizes = domain.flags.iter().map(|f| extent(f, dimension, which));
        let total: f64 = sizes.clone().sum();
        for (flag, size) in domain.flags.iter().zip(sizes) {
            let point_weight = weight * size / total / midpoints.len() as f64;
            quadrature_points.extend(midpoints.iter().map(|&c| (flag.point(c), point_weight)));
        }
        if which == 0 {
            interior = quadrature_points.len();
        }
    }
    (quadrature_points, interior)
}

/// The target at quadrature points, where the first `interior` belong to the interior, and the symmetry of
/// the source.
/// A value that is not finite, a target of one sign and cancelling are errors. Values are in the order of the points.
pub(super) fn sample(
    element: Element,
    target: &Target,
    quadrature_points: &[QuadraturePoint],
    interior: usize,
    info: &SourceInfo,
    progress: &dyn Progress,
) -> Result<(Vec<f64>, Quality), FitError> {
    // Moments of the source over the images of each point; a value that is not finite ends the fit, with its place.
    let moments: Vec<Moments> = quadrature_points
        .par_iter()
        .map(|(p, _)| {
            if progress.cancelled() {
                return Err(FitError::Cancelled(Cancelled));
            }
            let m = target.images.moments(*p);
            if m.mean_square.is_finite() {
                return Ok(m);
            }
            Err(FitError::NotFinite {
                x: p.0.x,
                y: p.0.y,
                z: p.0.z,
                element: element.name(),
                value: m.mean_square,
            })
        })
        .collect::<Result<_, _>>()?;
    let total: f64 = quadrature_points[..interior].iter().map(|(_, w)| w).sum();
    // Weighted mean over the interior; the points of faces and edges follow later in the list and are left out.
    let mean = |f: &dyn Fn(&Moments) -> f64| {
        let terms = moments[..interior].iter().zip(quadrature_points);
        terms.map(|(m, (_, w))| w * f(m)).sum::<f64>() / total
    };
    let square = mean(&|m| m.mean_square);
    let kept = mean(&|m| m.mean * m.mean);
    let quality = Quality {
        kept_energy: if square > 0.0 { kept / square } else { 0.0 },
        residual: mean(&|m| m.spread).sqrt(),
        rms: square.sqrt(),
    };
    let values: Vec<f64> = moments.iter().map(|m| m.value).collect();
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Without both signs the target has no surface.
    if least >= 0.0 || greatest <= 0.0 {
        return Err(FitError::NoSurface {
            missing: if least >= 0.0 { "solid" } else { "void" },
            element: element.name(),
            least,
            greatest,
            hint: info.hint(element),
        });
    }
    Ok((values, quality))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn midpoints_average_linear_functions_exactly() {
        for dimension in 1..=3 {
            let n = 4usize;
            let all = midpoints(dimension, n);
            assert_eq!(all.len(), n.pow(dimension as u32));
            let mean = all.iter().fold([0.0; 3], |m, c| {
                std::array::from_fn(|a| m[a] + c[a] / all.len() as f64)
            });
            let exact = match dimension {
                1 => [1.0, 0.5, 0.0],
                2 => [1.0, 2.0 / 3.0, 1.0 / 3.0],
                _ => [0.75, 0.5, 0.25],
            };
            for a in 0..3 {
                assert!((mean[a] - exact[a]).abs() < 1e-14, "{dimension} {mean:?}");
            }
        }
    }
}
