//! Plots of a cell and its source: slices with both surfaces, and the error over the number of
//! coefficients.
//!
//! The slices are horizontal through the centroid, horizontal half way to the top, and vertical through
//! a vertex. Solid is blue, void is white, both darker away from the surface. The cell's surface is
//! black, its source's is red, space outside the element is pale. The curve keeps the M largest
//! coefficients, by |C| times the root of the orbit's size (the best M terms on average). It shows the
//! root mean square difference to the source, or without one to the whole cell, over points of the
//! element.

use crate::cell::{Cell, Series, Source, lifted};
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use crate::vdb::Image;
use canvas::{ACCENT_COLOUR, Canvas, GRID_COLOUR, Shade, TEXT_COLOUR};
use rayon::prelude::*;

mod canvas;
mod modulus;
mod sheet;
mod sweep;

pub use modulus::modulus_picture;
pub use sheet::{contact_sheet, contact_sheet_columns};
pub use sweep::{SweepCurve, sweep_picture};

/// Powers of ten from whose double on not each is labelled.
const MAX_DECADES: usize = 20;
/// Sizes in pixels: of a slice, the margins, the header, the chart and the page.
const SLICE: usize = 380;
const MARGIN: usize = 16;
const HEADER: usize = 54;
const CHART: usize = 330;
const WIDTH: usize = 3 * SLICE + 4 * MARGIN;
const HEIGHT: usize = HEADER + SLICE + CHART + 4 * MARGIN;
/// Pixels per sample of a slice.
const STRIDE: usize = 2;
/// Number of points at which a truncated cell is compared: the curve is drawn, not reported.
const SAMPLE_POINTS: usize = 400;
/// Steps between the points of the curve, at most: equal numbers of coefficients are one point.
const CURVE_POINTS: usize = 16;
/// Smallest root mean square that is drawn; smaller ones are rounding.
const MIN_PLOTTED_RMS: f64 = 1e-9;

/// The error curve: numbers of coefficients kept and root mean square errors.
pub type Curve = Vec<(usize, f64)>;

/// The plot of a cell.
pub struct Plot {
    /// The picture.
    pub image: Image,
    /// The curve in it; empty if the cell is not a single series.
    pub curve: Curve,
}

/// The plane of a slice: its centre, two unit directions and its label.
struct Plane {
    centre: Vec3,
    across: Vec3,
    up: Vec3,
    name: String,
}

/// The planes of a plot: one of a planar cell; two horizontal and one vertical of others, in
/// reference coordinates.
fn planes(element: Element) -> Vec<Plane> {
    let bounds = element.cell_box();
    let (min, max) = (bounds.min, bounds.max);
    let middle = (min + max) / 2.0;
    let level = |z: f64, name: String| Plane {
        centre: Vec3::new(middle.x, middle.y, z),
        across: Vec3::x(),
        up: Vec3::y(),
        name,
    };
    if element.dimension() == 2 {
        return vec![level(0.0, "the plane".into())];
    }
    let z = element.centroid().0.z;
    let above = f64::midpoint(z, max.z);
    let vertex = element.vertices()[0];
    let across = Vec3::new(vertex.x, vertex.y, 0.0).normalize() * -1.0;
    vec![
        level(z, format!("z = {z:.3}")),
        level(above, format!("z = {above:.3}")),
        Plane {
            centre: Vec3::new(0.0, 0.0, middle.z),
            across,
            up: Vec3::z(),
            name: format!("through ({:.2}, {:.2}) and z", across.x, across.y),
        },
    ]
}

/// Draws a cell, with the source that it was fitted to if there is one.
pub fn plot(cell: &Cell, source: Option<&Source>) -> Plot {
    let element = cell.element();
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let bounds = element.cell_box();
    // Half the extent of a slice: a diagonal one of the cube is 1.41 edges wide, and 2 * 0.43 * 1.73 = 1.49.
    let reach = (bounds.max - bounds.min).norm() * 0.43;
    for (n, plane) in planes(element).iter().enumerate() {
        let x = MARGIN + n * (SLICE + MARGIN);
        slice(
            &mut canvas,
            [x, HEADER + MARGIN],
            cell,
            source,
            plane,
            reach,
        );
        canvas.text(x, HEADER + SLICE + 2 * MARGIN + 4, &plane.name, TEXT_COLOUR);
    }
    header(&mut canvas, cell, source);
    let curve = curve(cell, source);
    chart(&mut canvas, &curve, source.is_some());
    facts(&mut canvas, cell);
    Plot {
        image: canvas.image(),
        curve,
    }
}

/// Writes the title and the legend of the slices.
fn header(canvas: &mut Canvas, cell: &Cell, source: Option<&Source>) {
    let what = source.map_or("", |s| s.report().kind.name());
    let title = format!(
        "{}: a {} cell, group {}, {} coefficients",
        cell.name(),
        cell.element().name(),
        cell.group(),
        cell.expression().coefficients()
    );
    canvas.title(MARGIN, 12, &title, TEXT_COLOUR);
    canvas.text(MARGIN, 38, "surface of the cell", TEXT_COLOUR);
    if source.is_some() {
        canvas.text(
            MARGIN + 150,
            38,
            &format!("surface of its source ({what})"),
            ACCENT_COLOUR,
        );
    }
}

/// Values over a slice, one per STRIDE pixels and one more at the end, row by row from the top. `reach` is half
/// the extent of the slice, reference lengths.
fn sampled(plane: &Plane, reach: f64, value: impl Fn(CellPoint<3>) -> f64 + Sync) -> Vec<f64> {
    let count = SLICE / STRIDE + 1;
    let step = 2.0 * reach / (count - 1) as f64;
    (0..count * count)
        .into_par_iter()
        .map(|n| {
            let (row, column) = ((n / count) as f64, (n % count) as f64);
            let p = plane.centre
                + plane.across * (column * step - reach)
                + plane.up * (reach - row * step);
            value(CellPoint(p))
        })
        .collect()
}

/// Bilinear interpolation between the samples of a slice, at the pixel (x, y) from its upper left corner.
fn interpolated(values: &[f64], x: usize, y: usize) -> f64 {
    let count = SLICE / STRIDE + 1;
    let (i, j) = (x / STRIDE, y / STRIDE);
    let (u, v) = (
        (x % STRIDE) as f64 / STRIDE as f64,
        (y % STRIDE) as f64 / STRIDE as f64,
    );
    let sample = |i: usize, j: usize| values[j.min(count - 1) * count + i.min(count - 1)];
    let row = |j| sample(i, j) * (1.0 - u) + sample(i + 1, j) * u;
    row(j) * (1.0 - v) + row(j + 1) * v
}

/// Draws one slice of a cell: its values as shades, the lines of both surfaces and of the element.
/// `corner` is the upper left pixel, `reach` half the extent of the plane in reference lengths.
fn slice(
    canvas: &mut Canvas,
    corner: [usize; 2],
    cell: &Cell,
    source: Option<&Source>,
    plane: &Plane,
    reach: f64,
) {
    let element = cell.element();
    let cell_values = sampled(plane, reach, |p| cell.value(p));
    let source_values = source.map(|s| sampled(plane, reach, |p| s.value(p)));
    let edge = sampled(plane, reach, |p| element.face_distance(p));
    // Shades span the greatest magnitude; a field of zeros would divide by 0.
    let scale = cell_values
        .iter()
        .map(|v| v.abs())
        .fold(0.0, f64::max)
        .max(1e-12);
    // A line passes where the sign changes to the pixel on the right or below.
    let crosses = |values: &[f64], x: usize, y: usize| {
        let here = interpolated(values, x, y) < 0.0;
        let beside = |x, y| (interpolated(values, x, y) < 0.0) != here;
        beside(x + 1, y) || beside(x, y + 1)
    };
    for y in 0..SLICE {
        for x in 0..SLICE {
            let v = interpolated(&cell_values, x, y);
            // Points on the element's faces are inside, up to rounding.
            let outside = interpolated(&edge, x, y) > 1e-9;
            let mut shade = Shade::of(v / scale, outside);
            if crosses(&edge, x, y) {
                shade = Shade(GRID_COLOUR);
            }
            // The cell's surface is drawn over that of the source.
            let marks = [
                (source_values.as_ref(), ACCENT_COLOUR),
                (Some(&cell_values), TEXT_COLOUR),
            ];
            for (values, color) in marks {
                if values.is_some_and(|values| crosses(values, x, y)) {
                    shade = Shade(color).faded(outside);
                }
            }
            canvas.pixel(corner[0] + x, corner[1] + y, shade);
        }
    }
}

/// At most `SAMPLE_POINTS` points of a low-discrepancy sequence in the element. Elements fill more than a
/// twentieth of their box, so that the numbers suffice.
fn points(element: Element) -> Vec<CellPoint<3>> {
    let bounds = element.cell_box();
    // Multiples, modulo 1, of powers of the inverse of the root of x^4 = x + 1: no two points are close.
    let g = 1.220_744_084_605_759_5_f64;
    let steps = [1.0 / g, 1.0 / (g * g), 1.0 / (g * g * g)];
    (1..20 * SAMPLE_POINTS)
        .map(|n| {
            let at = Vec3::from(steps.map(|s| (n as f64 * s + 0.5).fract()));
            CellPoint(bounds.min + at.component_mul(&(bounds.max - bounds.min)))
        })
        .filter(|p| element.face_distance(*p) <= 0.0)
        .take(SAMPLE_POINTS)
        .collect()
}

/// The root mean square error over the number of coefficients kept; empty for cells that are not a single series.
fn curve(cell: &Cell, source: Option<&Source>) -> Curve {
    let form = cell.expression();
    if let Some(series) = form.series() {
        truncated(cell, source, series, |p| p)
    } else if let Some(series) = form.planar() {
        truncated(cell, source, series, |p| CellPoint(p.0.xy()))
    } else if let Some(series) = form.icosahedral() {
        truncated(cell, source, series, |p| CellPoint(lifted(p.0)))
    } else {
        Curve::new()
    }
}

/// The error of a series with only its largest coefficients, over their number. `place` is the point
/// of the series for a point of the cell. The error is the root mean square of the difference to the
/// source, or to the whole series without one.
fn truncated<const D: usize>(
    cell: &Cell,
    source: Option<&Source>,
    series: &Series<D>,
    place: impl Fn(CellPoint<3>) -> CellPoint<D> + Sync,
) -> Curve {
    let points = points(cell.element());
    let targets: Vec<f64> = points
        .iter()
        .map(|p| source.map_or_else(|| series.value(place(*p)), |s| s.value(*p)))
        .collect();
    // All members of an orbit share a coefficient: its energy is |c|^2 times their number.
    let weight = |k, c: [f64; 2]| {
        let size = series.group().orbit(k).members.len() as f64;
        c[0].hypot(c[1]) * size.sqrt()
    };
    let mut terms: Vec<_> = series
        .coefficients()
        .iter()
        .map(|t| (weight(t.k, t.c), (t.k, t.c)))
        .collect();
    terms.sort_by(|a, b| b.0.total_cmp(&a.0));
    let terms: Vec<_> = terms.into_iter().map(|t| t.1).collect();
    // Numbers in equal steps of their logarithm, n^(i / steps).
    let mut counts: Vec<usize> = (0..=CURVE_POINTS)
        .map(|i| {
            (terms.len() as f64)
                .powf(i as f64 / CURVE_POINTS as f64)
                .round() as usize
        })
        .collect();
    counts.dedup();
    counts
        .into_iter()
        .filter_map(|count| {
            let kept = &terms[..count];
            let (group, lattice) = (series.group().clone(), series.lattice().clone());
            let truncated_series = Series::new(group, lattice, kept).ok()?;
            let square: f64 = points
                .par_iter()
                .zip(&targets)
                .map(|(p, g)| (truncated_series.value(place(*p)) - g).powi(2))
                // Summed in the order of the points, so that it is the same at any number of threads.
                .collect::<Vec<_>>()
                .into_iter()
                .sum();
            Some((count, (square / points.len() as f64).sqrt()))
        })
        .collect()
}

/// Draws the error over the number of coefficients, both on logarithmic axes; `against_source` only chooses the
/// label. Fewer than two points give a line of text instead.
fn chart(canvas: &mut Canvas, curve: &[(usize, f64)], against_source: bool) {
    // Pixels beside the chart hold labels: the decades to the left, the numbers below, the title above.
    let (left, top) = (MARGIN + 70, HEADER + SLICE + 3 * MARGIN + 34);
    let (width, height) = (2 * SLICE - 100, CHART - 78);
    // Errors up to `MIN_PLOTTED_RMS` are rounding, and 0 has no logarithm.
    let is_shown = |rms: f64| rms > MIN_PLOTTED_RMS && rms.is_finite();
    let shown: Vec<&(usize, f64)> = curve.iter().filter(|c| is_shown(c.1)).collect();
    if shown.len() < 2 {
        let reason = match curve.len() {
            0 => "no curve: the cell is not a single series",
            _ => "no curve: fewer than two errors above rounding",
        };
        canvas.text(left, top, reason, TEXT_COLOUR);
        return;
    }
    let max_count = shown[shown.len() - 1].0.max(2) as f64;
    let logs = shown.iter().map(|c| c.1.log10());
    // The axis ends at whole decades and spans at least one.
    let (mut low, mut high) = logs.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    (low, high) = (low.floor(), high.ceil().max(low.floor() + 1.0));
    let x = |count: f64| left + (count.ln() / max_count.ln() * width as f64).round() as usize;
    let y = |log: f64| top + ((high - log) / (high - low) * height as f64).round() as usize;
    let decades = low as i32..=high as i32;
    // Not every decade gets a line where there are many.
    let step = (decades.clone().count() / MAX_DECADES).max(1);
    for decade in decades.step_by(step) {
        let level = y(f64::from(decade));
        canvas.line([left, level], [left + width, level], GRID_COLOUR);
        canvas.text(left - 50, level - 5, &format!("1e{decade}"), TEXT_COLOUR);
    }
    for count in [1usize, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000] {
        if (count as f64) <= max_count {
            let column = x(count as f64);
            canvas.line([column, top], [column, top + height], GRID_COLOUR);
            canvas.text(
                column - 6,
                top + height + 8,
                &count.to_string(),
                TEXT_COLOUR,
            );
        }
    }
    canvas.frame([left, top], [left + width, top + height], TEXT_COLOUR);
    for pair in shown.windows(2) {
        let ends = [pair[0], pair[1]].map(|c| [x(c.0 as f64), y(c.1.log10())]);
        canvas.thick_line(ends[0], ends[1], ACCENT_COLOUR);
    }
    let what = if against_source {
        "source"
    } else {
        "whole cell"
    };
    let label = format!("rms difference to the {what} when only the largest coefficients are kept");
    canvas.text(left, top - 16, &label, TEXT_COLOUR);
    canvas.text(
        left + width - 130,
        top + height + 24,
        "coefficients kept",
        TEXT_COLOUR,
    );
}

/// Writes the numbers of a cell beside the chart.
fn facts(canvas: &mut Canvas, cell: &Cell) {
    // The column to the right of the chart.
    let (left, mut top) = (
        2 * (SLICE + MARGIN) + MARGIN,
        HEADER + SLICE + 3 * MARGIN + 16,
    );
    let mut lines = vec![
        format!("frequencies to {:.2}", cell.expression().band_limit()),
        format!("solid {} {:.5}", cell.solid().name(), cell.level()),
        format!("volume fraction {:.4}", cell.volume_fraction()),
        format!("mean slope {:.4}", cell.gamma()),
    ];
    if let Some(r) = cell.report() {
        lines.push(format!("fit rms {:.5}", r.rms));
        lines.push(format!(
            "greatest on faces {:.5}, edges {:.5}",
            r.face_max, r.edge_max
        ));
        lines.push(format!("kept energy {:.5}", r.kept_energy));
        if let Some(h) = r.hausdorff {
            lines.push(format!("Hausdorff distance {:.5}", h.max()));
        }
        if let Some(c) = r.components {
            let line = format!(
                "components {} of solid, {} of void",
                c.cell_solid, c.cell_void
            );
            lines.push(line);
        }
    }
    for line in lines {
        canvas.text(left, top, &line, TEXT_COLOUR);
        top += 20;
    }
}
