//! The accuracy of a fit: differences, distances of the surfaces, components.
//!
//! Differences of cell and target are measured at points other than those of the fit. Distances of the surfaces are
//! sampled: the true distance may be a little larger. All points represent their images under the group, and lengths
//! are reference lengths.

use super::super::domain::{Domain, Flag, SimplexGrid};
use super::sampling::{QuadraturePoint, Target, quadrature_points};
use super::{FitError, FitOptions, FitReport, Hausdorff, SourceReport, components};
use crate::cell::Cell;
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Additional information about a source.
#[derive(Default)]
pub(super) struct SourceInfo<'a> {
    /// Known points of the surface inside the element.
    pub points: Vec<Vec3>,
    pub source: Option<SourceReport>,
    /// Samples over the whole period, and their number along an axis.
    pub period: Option<(&'a [f64], usize)>,
    /// Whether values have the sign of a distance, but not its magnitude.
    pub inexact: bool,
}

impl SourceInfo<'_> {
    /// The position of the source, for an error about its absence.
    pub fn hint(&self, element: Element) -> String {
        let own = element.cell_box();
        self.source.map_or_else(String::new, |s| {
            format!(
                "; after placement the source fills the box {:?} to {:?}, and the {} the box {:?} to {:?}",
                s.box_min,
                s.box_max,
                element.name(),
                own.min.as_slice(),
                own.max.as_slice(),
            )
        })
    }
}

/// Maximal number of the source's own points that are measured.
const MAX_SOURCE_POINTS: usize = 4000;

/// Maximal number of exponentials that a measurement evaluates, about two seconds of work. Cells of many
/// waves are measured at fewer points.
const MAX_EVALUATIONS: f64 = 2e9;

/// Longer than any edge of a flag, reference lengths; the longest is .87.
const MAX_FLAG_EDGE: f64 = 0.9;

/// The affordable number of measured points of a cell: at most `target`, at least `least`.
/// `target` and `least` are numbers of points; `least` counts even where it takes longer.
fn point_count(cell: &Cell, target: usize, least: usize) -> usize {
    let most = MAX_EVALUATIONS / cell.expression().exponentials().max(1) as f64;
    target.min((most as usize).max(least))
}

/// The affordable number of parts per edge of a flag, a simplex of the element's barycentric subdivision. A flag of n
/// parts per edge has about n^3/6 points.
/// `target` and `least` are numbers of parts.
fn part_count(cell: &Cell, domain: &Domain, target: usize, least: usize) -> usize {
    let most = point_count(cell, usize::MAX, 1) as f64 / domain.flags.len() as f64;
    target.min((libm::cbrt(6.0 * most) as usize).max(least))
}

/// Measures the accuracy of a cell, except for the quantities that the sampling gives. `domain` holds the flags that
/// are sampled, `parts_per_edge` the divisions of each edge of a flag in the fit.
/// Hausdorff distance and components are measured only if the options request it. The only error is that of cancelling.
pub(super) fn measure(
    cell: &Cell,
    target: &Target,
    domain: &Domain,
    parts_per_edge: usize,
    options: &FitOptions,
    info: &SourceInfo,
    progress: &dyn Progress,
) -> Result<FitReport, FitError> {
    let stop = || {
        if progress.cancelled() {
            return Err(FitError::Cancelled(Cancelled));
        }
        Ok(())
    };
    let element = cell.element();
    // Root mean square and maximum of the difference at quadrature points.
    let difference = |quadrature_points: &[QuadraturePoint]| -> (f64, f64) {
        let all: Vec<f64> = quadrature_points
            .par_iter()
            .map(|&(p, _)| cell.value(p) - target.value(p))
            .collect();
        let total: f64 = quadrature_points.iter().map(|(_, w)| w).sum();
        let square: f64 = all
            .iter()
            .zip(quadrature_points)
            .map(|(d, (_, w))| w * d * d)
            .sum();
        let largest = all.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        ((square / total).sqrt(), largest)
    };
    // Three parts per edge more than in the fit, so that the points differ from its own.
    let [interior, faces, edges] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let points_on = |weights: [f64; 3]| {
        let (mut all, _) = quadrature_points(element, domain, parts_per_edge + 3, weights);
        all.retain(|(_, w)| *w > 0.0);
        all
    };
    let (rms, _) = difference(&points_on(interior));
    stop()?;
    let (_, face_max) = difference(&points_on(faces));
    let (_, edge_max) = difference(&points_on(edges));
    stop()?;
    let mut report = FitReport {
        lattice: cell.expression().lattice_name().unwrap_or("").to_owned(),
        band_limit: options.band_limit,
        regularisation: options.lambda(),
        rms,
        face_max,
        edge_max,
        source: info.source,
        ..FitReport::default()
    };
    (report.gradient_inside, report.gradient_outside) = gradients(cell, domain);
    if options.measure {
        stop()?;
        report.hausdorff = hausdorff(cell, target, domain, info, options.band_limit);
        stop()?;
        let c = components::components(cell, target, domain);
        if (c.source_solid, c.source_void) != (c.cell_solid, c.cell_void) {
            report.warnings.push(format!(
                "the cell has {} components of solid and {} of void in an element, the source {} and {}: \
                 thin parts appeared or vanished; a larger band limit keeps them",
                c.cell_solid, c.cell_void, c.source_solid, c.source_void
            ));
        }
        report.components = Some(c);
    }
    Ok(report)
}

/// Points of the period at which the gradient is sampled, 500 where waves are many.
const PERIOD_POINTS: usize = 6000;

/// Largest sampled gradient inside the element and over the whole period.
/// The second is at least the first, and equal for a function that is not one series. Per reference length. Flags have
/// 20 parts per edge, 12 where waves are many.
fn gradients(cell: &Cell, domain: &Domain) -> (f64, f64) {
    let largest = |points: Vec<CellPoint<3>>| {
        points
            .into_par_iter()
            .map(|p| cell.expression().value_and_gradient(p).1.norm())
            .reduce(|| 0.0, f64::max)
    };
    let grid = SimplexGrid::new(part_count(cell, domain, 20, 12)).coordinates();
    let inside = domain
        .flags
        .iter()
        .flat_map(|f| grid.iter().map(|&c| f.point(c)))
        .collect();
    let vectors = match (cell.series(), cell.planar()) {
        (Some(series), _) => series.lattice().vectors().map(Vec3::from).to_vec(),
        (_, Some(series)) => {
            let flat = series.lattice().vectors();
            flat.map(|v| Vec3::new(v[0], v[1], 0.0)).to_vec()
        }
        _ => Vec::new(),
    };
    // A low-discrepancy sequence: multiples of powers of 1/x modulo 1, where x^4 = x + 1.
    let outside = (1..=point_count(cell, PERIOD_POINTS, 500))
        .map(|n| {
            let steps = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9];
            let at = vectors.iter().zip(steps);
            CellPoint(at.map(|(v, s)| v * (n as f64 * s).fract()).sum())
        })
        .collect();
    let inside = largest(inside);
    (inside, largest(outside).max(inside))
}

/// Points where a function changes sign along the edges of the simplex grids of all flags.
/// `parts` is the number of parts per edge of a flag. Points are in the order of the flags.
fn crossings(
    domain: &Domain,
    parts: usize,
    value: &(impl Fn(CellPoint<3>) -> f64 + Sync),
) -> Vec<Vec3> {
    let flags = domain.flags.iter();
    flags
        .flat_map(|f| flag_crossings(f, parts, value))
        .collect()
}

/// Points of the surface in a flag: one on each edge of the grid of `parts` parts whose ends have different signs.
/// Four steps of a safeguarded secant, then a linear step, find each point.
fn flag_crossings(
    flag: &Flag,
    parts: usize,
    value: &(impl Fn(CellPoint<3>) -> f64 + Sync),
) -> Vec<Vec3> {
    let grid = SimplexGrid::new(parts);
    let points: Vec<Vec3> = grid
        .coordinates()
        .into_iter()
        .map(|c| flag.point(c).0)
        .collect();
    let values: Vec<f64> = points.par_iter().map(|p| value(CellPoint(*p))).collect();
    let mut edges = Vec::new();
    grid.tetrahedra(|tet| {
        let n = tet.map(SimplexGrid::index);
        for i in 0..4 {
            for j in 0..i {
                if (values[n[i]] < 0.0) != (values[n[j]] < 0.0) {
                    edges.push([n[i].min(n[j]), n[i].max(n[j])]);
                }
            }
        }
    });
    edges.sort_unstable();
    edges.dedup();
    edges
        .par_iter()
        .map(|&[i, j]| {
            let (mut a, mut b) = ((points[i], values[i]), (points[j], values[j]));
            for _ in 0..4 {
                // A safeguarded secant step: it stays away from both ends, so that both ends move.
                let t = (a.1 / (a.1 - b.1)).clamp(0.05, 0.95);
                let p = a.0 + (b.0 - a.0) * t;
                let v = value(CellPoint(p));
                if (v < 0.0) == (a.1 < 0.0) {
                    a = (p, v);
                } else {
                    b = (p, v);
                }
            }
            let t = a.1 / (a.1 - b.1);
            a.0 + (b.0 - a.0) * t
        })
        .collect()
}

/// The distance of a point to the surface of a function, by Newton steps combined with steps along the
/// surface towards the foot point. `None` if the steps do not converge.
/// `function` gives value and gradient. Steps, at most 12, are at most 0.1 reference lengths, and the iteration ends
/// below 1e-7. A value above 1e-6 of the slope (at least 1) does not count as converged, nor does a slope below 1e-6.
fn distance_to_surface(function: &impl Fn(Vec3) -> (f64, Vec3), q: Vec3) -> Option<f64> {
    let mut x = q;
    let mut last = (0.0, Vec3::zeros());
    for _ in 0..12 {
        let (v, g) = function(x);
        last = (v, g);
        let square = g.norm_squared();
        if square < 1e-12 {
            return None;
        }
        let along = (q - x) - g * ((q - x).dot(&g) / square);
        let step = along - g * (v / square);
        x += if step.norm() > 0.1 {
            step * (0.1 / step.norm())
        } else {
            step
        };
        if step.norm() < 1e-7 {
            break;
        }
    }
    // The last step is not evaluated yet.
    let (v, _) = function(x);
    (v.abs() < 1e-6 * last.1.norm().max(1.0)).then(|| (x - q).norm())
}

/// The distance of a point to a surface by Newton steps. A large result may belong to a farther sheet;
/// then the distance to known points of the surface and their images also counts.
/// A result below 0.02 reference lengths is accepted as it is. `known` points belong to the surface in the domain.
fn distance_or_nearest(
    function: &impl Fn(Vec3) -> (f64, Vec3),
    q: Vec3,
    known: &[Vec3],
    operators: &[Mat3],
) -> f64 {
    let nearest = || {
        // The images of the point replace those of the surface points.
        let images = operators.iter().map(|m| m * q);
        images
            .flat_map(|q| known.iter().map(move |p| (p - q).norm_squared()))
            .fold(f64::INFINITY, f64::min)
            .sqrt()
    };
    match distance_to_surface(function, q) {
        Some(d) if d < 0.02 => d,
        found => found.unwrap_or(f64::INFINITY).min(nearest()),
    }
}

/// Value and gradient of the target by central differences.
/// The step is 1e-5 reference lengths.
fn numerical_gradient(target: &Target, x: Vec3) -> (f64, Vec3) {
    const DIFFERENCE_STEP: f64 = 1e-5;
    let at = |x: Vec3| target.value(CellPoint(x));
    let gradient = Vec3::from_fn(|a, _| {
        let step = Vec3::ith(a, DIFFERENCE_STEP);
        (at(x + step) - at(x - step)) / (2.0 * DIFFERENCE_STEP)
    });
    (at(x), gradient)
}

/// Sampled one-sided distances; `None` if either function has no surface. In reference lengths; `band_limit` in cycles
/// per reference length. Where the source's values are distances, those of the target count as such, though a mean of
/// images is only near a distance.
fn hausdorff(
    cell: &Cell,
    target: &Target,
    domain: &Domain,
    info: &SourceInfo,
    band_limit: f64,
) -> Option<Hausdorff> {
    // A step of a quarter of the shortest wave, within limits of time; flags of a small group are many, so their grids
    // are coarser.
    let flags_per_axis = (domain.flags.len() as f64).cbrt();
    let parts = ((MAX_FLAG_EDGE * 4.0 * band_limit / flags_per_axis).ceil() as usize).clamp(20, 56);
    let parts = part_count(cell, domain, parts, 20);
    let cell_points = crossings(domain, parts, &|p| cell.value(p));
    let source_points = crossings(domain, parts, &|p| target.value(p));
    if cell_points.is_empty() || source_points.is_empty() {
        return None;
    }
    let cell_to_source = cell_points
        .par_iter()
        .map(|p| {
            if info.inexact {
                distance_or_nearest(
                    &|x| numerical_gradient(target, x),
                    *p,
                    &source_points,
                    cell.operators(),
                )
            } else {
                target.value(CellPoint(*p)).abs()
            }
        })
        .reduce(|| 0.0, f64::max);
    let stride = info.points.len().div_ceil(MAX_SOURCE_POINTS).max(1);
    let mut points = source_points;
    // The target of an asymmetric source combines its images (mean, least, greatest): these points may be off it.
    if target.symmetric {
        points.extend(info.points.iter().step_by(stride));
    }
    let function = |x: Vec3| cell.value_and_gradient(CellPoint(x));
    let source_to_cell = points
        .par_iter()
        .map(|&q| distance_or_nearest(&function, q, &cell_points, cell.operators()))
        .reduce(|| 0.0, f64::max);
    Some(Hausdorff {
        cell_to_source,
        source_to_cell,
    })
}
