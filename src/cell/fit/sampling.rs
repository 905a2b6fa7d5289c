//! Samples of the source: where they are taken, and how symmetric they are.

use super::super::domain::{SimplexGrid, flag, point};
use super::accuracy::Extra;
use super::{Distance, FitError, Sample};
use crate::frame::{CellPoint, Element, Mat3};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Least number of samples per unknown.
const SAMPLES_PER_UNKNOWN: usize = 12;
/// Weights of faces and edges beside that of the interior, 1.
const FACE_WEIGHT: f64 = 0.3;
const EDGE_WEIGHT: f64 = 0.1;
/// What the average of the source over the images of a point is made of.
pub(super) struct Images<'a> {
    pub source: &'a Distance<'a>,
    pub operators: Vec<Mat3>,
}

impl Images<'_> {
    /// Mean, mean square and spread about the mean over the images of a point.
    fn moments(&self, p: CellPoint<3>) -> [f64; 3] {
        let n = self.operators.len() as f64;
        let values: Vec<f64> = self
            .operators
            .iter()
            .map(|q| (self.source)(CellPoint(q * p.0)))
            .collect();
        let mean = values.iter().sum::<f64>() / n;
        let square = values.iter().map(|v| v * v).sum::<f64>() / n;
        let spread = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        [mean, square, spread]
    }
}

/// The source as the fit sees it: itself if it is symmetric, else the average of its images.
pub(super) struct Target<'a> {
    pub images: Images<'a>,
    pub symmetric: bool,
}

impl Target<'_> {
    pub fn value(&self, p: CellPoint<3>) -> f64 {
        if self.symmetric {
            (self.images.source)(p)
        } else {
            self.images.moments(p)[0]
        }
    }
}

/// Midpoints of a simplex of dimension 1 to 3 cut into n, n^2 or n^3 equal parts, as ordered
/// coordinates in the flag; every part weighs the same.
pub(super) fn midpoints(dimension: usize, n: usize) -> Vec<[f64; 3]> {
    let step = 1.0 / n as f64;
    match dimension {
        1 => (0..n)
            .map(|j| [1.0, (j as f64 + 0.5) * step, 0.0])
            .collect(),
        2 => {
            let mut all = Vec::with_capacity(n * n);
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
            SimplexGrid::new(n).tetrahedra(|corners| {
                all.push(std::array::from_fn(|a| {
                    corners.iter().map(|c| c[a] as f64).sum::<f64>() / 4.0 * step
                }));
            });
            all
        }
    }
}

/// Parts per edge of the fundamental simplex: enough for the unknowns and for the wanted density.
pub(super) fn parts(element: Element, unknowns: usize, per_edge: usize) -> usize {
    let volume = element.measure() / if element == Element::Tet { 24.0 } else { 48.0 };
    let by_density = per_edge as f64 * volume.cbrt();
    let by_unknowns = ((SAMPLES_PER_UNKNOWN * unknowns) as f64).cbrt();
    by_density.max(by_unknowns).ceil().max(6.0) as usize
}

/// How symmetric the source is, over the element's interior.
pub(super) struct Quality {
    pub kept_energy: f64,
    pub residual: f64,
    pub rms: f64,
}

/// Samples of the averaged source with their weights.
pub(super) fn sample(
    element: Element,
    target: &Target,
    parts: usize,
    extra: &Extra,
    progress: &dyn Progress,
) -> Result<(Vec<Sample>, Quality), FitError> {
    let corners = flag(element);
    let mut places = Vec::new();
    for (dimension, n, weight) in [
        (3, parts, 1.0),
        (2, 2 * parts, FACE_WEIGHT),
        (1, 4 * parts, EDGE_WEIGHT),
    ] {
        let midpoints = midpoints(dimension, n);
        let each = weight / midpoints.len() as f64;
        places.extend(midpoints.into_iter().map(|c| (point(&corners, c), each)));
    }
    let interior = parts.pow(3);
    let moments: Vec<[f64; 3]> = places
        .par_iter()
        .map(|(p, _)| {
            if progress.cancelled() {
                return Err(FitError::Cancelled(Cancelled));
            }
            let m = target.images.moments(*p);
            if m[1].is_finite() {
                return Ok(m);
            }
            Err(FitError::NotFinite {
                x: p.0.x,
                y: p.0.y,
                z: p.0.z,
                element: element.name(),
                value: m[1],
            })
        })
        .collect::<Result<_, _>>()?;
    let mean = |f: &dyn Fn(&[f64; 3]) -> f64| {
        moments[..interior].iter().map(f).sum::<f64>() / interior as f64
    };
    let square = mean(&|m| m[1]);
    let kept = mean(&|m| m[0] * m[0]);
    let quality = Quality {
        kept_energy: if square > 0.0 { kept / square } else { 0.0 },
        residual: mean(&|m| m[2]).sqrt(),
        rms: square.sqrt(),
    };
    let least = moments.iter().fold(f64::INFINITY, |a, m| a.min(m[0]));
    let greatest = moments.iter().fold(f64::NEG_INFINITY, |a, m| a.max(m[0]));
    if least >= 0.0 || greatest <= 0.0 {
        return Err(FitError::NoSurface {
            missing: if least >= 0.0 { "solid" } else { "void" },
            element: element.name(),
            least,
            greatest,
            hint: extra.hint(element),
        });
    }
    let samples = places
        .into_iter()
        .zip(&moments)
        .map(|((point, weight), m)| Sample {
            point,
            value: m[0],
            weight,
        })
        .collect();
    Ok((samples, quality))
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
