//! The accuracy of a fit: differences, distances of the two surfaces, pieces.

use super::super::domain::{SimplexGrid, flag, point};
use super::sampling::{Target, midpoints};
use super::{FitError, FitOptions, FitReport, Hausdorff, SourceReport, pieces};
use crate::cell::Cell;
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// What is known about a source beside its distance.
#[derive(Default)]
pub(super) struct Extra {
    /// Points of its surface inside the element.
    pub points: Vec<Vec3>,
    pub source: Option<SourceReport>,
}

impl Extra {
    /// Where the source stands, for an error about its absence.
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

/// Points of the source's own list that are measured at most.
const MOST_POINTS: usize = 4000;

/// Measures everything but what the sampling already knows.
pub(super) fn measure(
    cell: &Cell,
    target: &Target,
    parts: usize,
    options: &FitOptions,
    extra: &Extra,
    progress: &dyn Progress,
) -> Result<FitReport, FitError> {
    let stop = || {
        if progress.cancelled() {
            return Err(FitError::Cancelled(Cancelled));
        }
        Ok(())
    };
    let element = cell.element();
    let corners = flag(element);
    let difference = |coordinates: Vec<[f64; 3]>| -> (f64, f64) {
        let all: Vec<f64> = coordinates
            .par_iter()
            .map(|&c| {
                let p = point(&corners, c);
                cell.value(p) - target.value(p)
            })
            .collect();
        let square = all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64;
        (square.sqrt(), all.iter().fold(0.0, |m, d| m.max(d.abs())))
    };
    // Other points than those of the fit.
    let (rms, _) = difference(midpoints(3, parts + 3));
    stop()?;
    let (_, face_max) = difference(midpoints(2, 2 * parts + 3));
    let (_, edge_max) = difference(midpoints(1, 4 * parts + 3));
    stop()?;
    let mut report = FitReport {
        method: "lsq".to_owned(),
        lattice: cell.form().lattice_name().unwrap_or("").to_owned(),
        band_limit: options.band_limit,
        regularisation: options.regularisation,
        rms,
        face_max,
        edge_max,
        source: extra.source,
        ..FitReport::default()
    };
    (report.gradient_inside, report.gradient_outside) = gradients(cell);
    if options.measure {
        stop()?;
        report.hausdorff = hausdorff(cell, target, extra, options.band_limit);
        stop()?;
        let c = pieces::components(cell, target);
        if (c.source_solid, c.source_void) != (c.cell_solid, c.cell_void) {
            report.warnings.push(format!(
                "the cell has {} pieces of solid and {} of void in an element, the source {} and {}: \
                 thin parts appeared or vanished, a larger band limit keeps them",
                c.cell_solid, c.cell_void, c.source_solid, c.source_void
            ));
        }
        report.components = Some(c);
    }
    Ok(report)
}

/// Greatest sampled gradient inside the element and over the whole period.
fn gradients(cell: &Cell) -> (f64, f64) {
    let largest = |points: Vec<CellPoint<3>>| {
        points
            .into_par_iter()
            .map(|p| cell.form().value_and_gradient(p).1.norm())
            .reduce(|| 0.0, f64::max)
    };
    let corners = flag(cell.element());
    let grid = SimplexGrid::new(20).coordinates();
    let inside = largest(grid.into_iter().map(|c| point(&corners, c)).collect());
    // The part of the period with x >= y >= |z|: every other is an image of it.
    let periods = cell.series().and_then(|s| s.lattice().periods());
    let period = periods.map_or(1.0, |p| p[0]);
    let half = (period * 12.0) as i32;
    let mut outside = Vec::new();
    for i in 0..=half {
        for j in 0..=i {
            for k in -j..=j {
                let index = Vec3::new(f64::from(i), f64::from(j), f64::from(k));
                outside.push(CellPoint(index * (period / f64::from(2 * half))));
            }
        }
    }
    (inside, largest(outside).max(inside))
}

/// Points where a function changes sign along the edges of a simplex grid, refined along the edge.
fn crossings(
    element: Element,
    parts: usize,
    value: &(impl Fn(CellPoint<3>) -> f64 + Sync),
) -> Vec<Vec3> {
    let corners = flag(element);
    let grid = SimplexGrid::new(parts);
    let points: Vec<Vec3> = grid
        .coordinates()
        .into_iter()
        .map(|c| point(&corners, c).0)
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
                // Between a secant and a bisection, so that neither end stays for ever.
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

/// The distance of a point to the cell's surface: Newton's steps, then steps along the surface
/// towards the foot point.
fn distance_to_surface(cell: &Cell, q: Vec3) -> Option<f64> {
    let mut x = q;
    for _ in 0..12 {
        let (v, g) = cell.value_and_gradient(CellPoint(x));
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
    (cell.value(CellPoint(x)).abs() < 1e-6).then(|| (x - q).norm())
}

/// Sampled one-sided distances; `None` if either has no surface.
fn hausdorff(cell: &Cell, target: &Target, extra: &Extra, band_limit: f64) -> Option<Hausdorff> {
    let element = cell.element();
    // A quarter of the shortest wave; the simplex is at most 0.87 long.
    let parts = ((0.9 * 4.0 * band_limit).ceil() as usize).clamp(20, 56);
    let own = crossings(element, parts, &|p| cell.value(p));
    let theirs = crossings(element, parts, &|p| target.value(p));
    if own.is_empty() || theirs.is_empty() {
        return None;
    }
    let cell_to_source = own
        .par_iter()
        .map(|p| target.value(CellPoint(*p)).abs())
        .reduce(|| 0.0, f64::max);
    let stride = extra.points.len().div_ceil(MOST_POINTS).max(1);
    let mut points = theirs;
    // An image of an unsymmetric source is not its average: only a symmetric one has these points.
    if target.symmetric {
        let corners = flag(element);
        // Of a point's images the one in the flag's cone reaches farthest along any vector in it.
        let inner = corners[1] + corners[2] + corners[3];
        let operators = &target.images.operators;
        let image = |q: &Vec3| {
            let reach = |a: &Vec3, b: &Vec3| a.dot(&inner).total_cmp(&b.dot(&inner));
            operators.iter().map(|m| m * q).max_by(reach).unwrap_or(*q)
        };
        points.extend(extra.points.iter().step_by(stride).map(image));
    }
    let source_to_cell = points
        .par_iter()
        .map(|&q| {
            let nearest = || {
                own.iter()
                    .map(|p| (p - q).norm())
                    .fold(f64::INFINITY, f64::min)
            };
            match distance_to_surface(cell, q) {
                Some(d) if d < 0.02 => d,
                // The steps may have gone to a farther sheet.
                found => found.unwrap_or(f64::INFINITY).min(nearest()),
            }
        })
        .reduce(|| 0.0, f64::max);
    Some(Hausdorff {
        cell_to_source,
        source_to_cell,
    })
}
