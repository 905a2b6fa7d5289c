//! Plots of curves over a common abscissa, as the volume fraction or the height of layers, with a legend and a
//! grid.

use super::canvas::{Canvas, GRID_COLOUR, TEXT_COLOUR};
use crate::vdb::Image;
use embedded_graphics::pixelcolor::Rgb888;

/// Sizes in pixels.
const WIDTH: usize = 900;
const HEIGHT: usize = 560;
const LEFT_MARGIN: usize = 80;
const TOP_MARGIN: usize = 50;
/// Width of a letter.
const NAME_LETTER: usize = 7;
/// Colours of the curves.
const COLOURS: [Rgb888; 6] = [
    Rgb888::new(214, 40, 40),
    Rgb888::new(49, 104, 142),
    Rgb888::new(44, 140, 90),
    Rgb888::new(200, 130, 20),
    Rgb888::new(120, 60, 160),
    Rgb888::new(90, 90, 95),
];

/// A named curve.
pub struct SweepCurve {
    /// The name in the legend.
    pub name: String,
    /// Abscissa and ordinate.
    pub points: Vec<[f64; 2]>,
}

/// Draws curves over a common abscissa; the ordinate starts at 0. Points whose ordinate is not finite are left out,
/// negative ones lie at 0. `abscissa` is the label of the axis.
pub fn sweep_picture(title: &str, abscissa: &str, curves: &[SweepCurve]) -> Image {
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    // The legend takes 250 pixels to the right, the labels of the abscissa 70 below.
    let (width, height) = (WIDTH - LEFT_MARGIN - 250, HEIGHT - TOP_MARGIN - 70);
    let points = || curves.iter().flat_map(|c| &c.points);
    let (mut low, mut high) =
        points().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[0]), h.max(p[0])));
    // Without points the axis is that of fractions; a single abscissa has an axis of length 1 around it.
    if low > high {
        (low, high) = (0.0, 1.0);
    } else if low == high {
        (low, high) = (low - 0.5, high + 0.5);
    }
    let max_ordinate = points()
        .map(|p| p[1])
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let max_ordinate = if max_ordinate > 0.0 {
        rounded_up(max_ordinate)
    } else {
        1.0
    };
    let x = |v: f64| LEFT_MARGIN + ((v - low) / (high - low) * width as f64).round() as usize;
    let y = |v: f64| {
        TOP_MARGIN + ((1.0 - (v / max_ordinate).clamp(0.0, 1.0)) * height as f64).round() as usize
    };
    canvas.title(LEFT_MARGIN, 14, title, TEXT_COLOUR);
    // Six lines of the grid along each axis, with their numbers.
    for n in 0..=5 {
        let share = f64::from(n) / 5.0;
        let (across, up) = (low + (high - low) * share, max_ordinate * share);
        canvas.line(
            [x(across), TOP_MARGIN],
            [x(across), TOP_MARGIN + height],
            GRID_COLOUR,
        );
        canvas.text(
            x(across).saturating_sub(14),
            TOP_MARGIN + height + 8,
            &format!("{across:.3}"),
            TEXT_COLOUR,
        );
        canvas.line(
            [LEFT_MARGIN, y(up)],
            [LEFT_MARGIN + width, y(up)],
            GRID_COLOUR,
        );
        canvas.text(
            LEFT_MARGIN - 56,
            y(up).saturating_sub(6),
            &format!("{up:.4}"),
            TEXT_COLOUR,
        );
    }
    canvas.frame(
        [LEFT_MARGIN, TOP_MARGIN],
        [LEFT_MARGIN + width, TOP_MARGIN + height],
        TEXT_COLOUR,
    );
    canvas.text(
        LEFT_MARGIN + width / 2 - 50,
        TOP_MARGIN + height + 32,
        abscissa,
        TEXT_COLOUR,
    );
    for (n, curve) in curves.iter().enumerate() {
        let colour = COLOURS[n % COLOURS.len()];
        let shown: Vec<[usize; 2]> = curve
            .points
            .iter()
            .filter(|p| p[1].is_finite())
            .map(|p| [x(p[0]), y(p[1])])
            .collect();
        for pair in shown.windows(2) {
            canvas.thick_line(pair[0], pair[1], colour);
        }
        // A single point has its name beside it, left of it where the frame is near.
        if let [[px, py]] = shown[..] {
            let length = NAME_LETTER * curve.name.len() + 8;
            let is_right = px + length < LEFT_MARGIN + width;
            let left = if is_right {
                px + 8
            } else {
                px.saturating_sub(length)
            };
            canvas.text(left, py.saturating_sub(6), &curve.name, colour);
        }
        for [px, py] in shown {
            canvas.frame(
                [px.saturating_sub(2), py.saturating_sub(2)],
                [px + 2, py + 2],
                colour,
            );
        }
        let line_top = TOP_MARGIN + 12 + 24 * n;
        let left = LEFT_MARGIN + width + 16;
        canvas.thick_line([left, line_top + 6], [left + 24, line_top + 6], colour);
        canvas.text(left + 32, line_top, &curve.name, TEXT_COLOUR);
    }
    canvas.image()
}

/// The smallest of 1, 2, 2.5, 4, 5 and 8 times a power of ten that is not less than a value.
fn rounded_up(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0];
    let step = steps
        .into_iter()
        .find(|s| s * power >= value * (1.0 - 1e-12));
    let rounded = step.unwrap_or(10.0) * power;
    // The numbers next to 0 and to infinity have no round one above them.
    if rounded.is_normal() { rounded } else { value }
}
