//! Curves over the volume fraction.

use super::canvas::{Canvas, INK, PALE};
use crate::vdb::Image;
use embedded_graphics::pixelcolor::Rgb888;

/// Pixels.
const WIDTH: usize = 900;
const HEIGHT: usize = 560;
const LEFT: usize = 80;
const TOP: usize = 50;
/// Colours of the curves.
const COLOURS: [Rgb888; 6] = [
    Rgb888::new(214, 40, 40),
    Rgb888::new(49, 104, 142),
    Rgb888::new(44, 140, 90),
    Rgb888::new(200, 130, 20),
    Rgb888::new(120, 60, 160),
    Rgb888::new(90, 90, 95),
];

/// A curve: its name and its points.
pub struct SweepCurve {
    /// For the legend.
    pub name: String,
    /// Abscissa and ordinate.
    pub points: Vec<[f64; 2]>,
}

/// Draws curves over a common abscissa, the ordinate from 0 on.
pub fn sweep_picture(title: &str, abscissa: &str, curves: &[SweepCurve]) -> Image {
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let (width, height) = (WIDTH - LEFT - 250, HEIGHT - TOP - 70);
    let points = || curves.iter().flat_map(|c| &c.points);
    let (mut low, mut high) =
        points().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[0]), h.max(p[0])));
    if low >= high {
        (low, high) = (low.min(high) - 0.5, low.max(high) + 0.5);
    }
    let most = points()
        .map(|p| p[1])
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let most = if most > 0.0 { rounded_up(most) } else { 1.0 };
    let x = |v: f64| LEFT + ((v - low) / (high - low) * width as f64).round() as usize;
    let y = |v: f64| TOP + ((1.0 - (v / most).clamp(0.0, 1.0)) * height as f64).round() as usize;
    canvas.title(LEFT, 14, title, INK);
    for n in 0..=5 {
        let share = f64::from(n) / 5.0;
        let (across, up) = (low + (high - low) * share, most * share);
        canvas.line([x(across), TOP], [x(across), TOP + height], PALE);
        canvas.text(
            x(across).saturating_sub(14),
            TOP + height + 8,
            &format!("{across:.3}"),
            INK,
        );
        canvas.line([LEFT, y(up)], [LEFT + width, y(up)], PALE);
        canvas.text(LEFT - 56, y(up).saturating_sub(6), &format!("{up:.4}"), INK);
    }
    canvas.frame([LEFT, TOP], [LEFT + width, TOP + height], INK);
    canvas.text(LEFT + width / 2 - 50, TOP + height + 32, abscissa, INK);
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
        for [px, py] in shown {
            canvas.frame(
                [px.saturating_sub(2), py.saturating_sub(2)],
                [px + 2, py + 2],
                colour,
            );
        }
        let line = TOP + 12 + 24 * n;
        let left = LEFT + width + 16;
        canvas.thick_line([left, line + 6], [left + 24, line + 6], colour);
        canvas.text(left + 32, line, &curve.name, INK);
    }
    canvas.image()
}

/// The least of 1, 2, 2.5, 4, 5 and 8 times a power of ten that is not less.
fn rounded_up(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0];
    let step = steps
        .into_iter()
        .find(|s| s * power >= value * (1.0 - 1e-12));
    step.unwrap_or(10.0) * power
}
