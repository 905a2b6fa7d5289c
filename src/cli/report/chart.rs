//! Histograms and curves as inline SVG.
//!
//! Charts need no script and no other file. Numbers in them are those of the report.

use crate::cli::html::{escaped, number};
use serde_json::{Value, json};
use std::fmt::Write;

/// Size of the drawing and of the area of the bars, in its own units.
const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 190.0;
const PLOT_LEFT: f64 = 44.0;
const PLOT_WIDTH: f64 = 400.0;
const PLOT_TOP: f64 = 14.0;
const PLOT_HEIGHT: f64 = 130.0;
/// Steps between the labels of an axis, which has one label more; at most so many where steps are round.
const LABELS: usize = 4;

/// A limit that the chart marks; its value is in the unit of the histogram.
pub(super) struct Limit {
    pub value: f64,
    pub is_met: bool,
}

/// A histogram of the report as SVG, with a line at `limit`; `None` if the report has none, or one without samples
/// within its edges. `label` names the axis.
pub(super) fn histogram(value: &Value, label: &str, limit: Option<&Limit>) -> Option<String> {
    let floats =
        |v: &Value| -> Option<Vec<f64>> { v.as_array()?.iter().map(Value::as_f64).collect() };
    let (edges, counts) = (floats(&value["edges"])?, floats(&value["counts"])?);
    let top = *edges.last().filter(|e| **e > 0.0)?;
    let above = value["above"].as_f64().unwrap_or(0.0);
    let total = counts.iter().sum::<f64>() + above;
    let highest = counts.iter().fold(0.0f64, |a, b| a.max(*b));
    if edges.len() != counts.len() + 1 || highest <= 0.0 {
        return None;
    }
    // A limit beyond the samples lies on the axis too, which ends a twentieth behind it.
    let end = limit.map_or(top, |l| top.max((1.05 * l.value).min(f64::MAX)));
    let x = |v: f64| PLOT_LEFT + v / end * PLOT_WIDTH;
    let bottom = PLOT_TOP + PLOT_HEIGHT;
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">",
        escaped(label)
    );
    let share = 100.0 * (highest / total);
    let _ = write!(
        svg,
        "<line class=\"axis\" x1=\"{PLOT_LEFT}\" y1=\"{bottom}\" x2=\"{}\" y2=\"{bottom}\"/>\
         <line class=\"grid\" x1=\"{PLOT_LEFT}\" y1=\"{PLOT_TOP}\" x2=\"{}\" y2=\"{PLOT_TOP}\"/>\
         <text class=\"tick\" x=\"{}\" y=\"{}\" text-anchor=\"end\">{share:.0} %</text>",
        PLOT_LEFT + PLOT_WIDTH,
        PLOT_LEFT + PLOT_WIDTH,
        PLOT_LEFT - 6.0,
        PLOT_TOP + 4.0,
    );
    // Bars wholly below the limit have another colour; a gap of 1 parts them.
    for (bin, &count) in edges.windows(2).zip(&counts) {
        let height = count / highest * PLOT_HEIGHT;
        let is_below = limit.is_some_and(|l| bin[1] <= l.value);
        let _ = write!(
            svg,
            "<rect class=\"{}\" x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{height:.2}\">\
             <title>{} to {}: {:.1} %</title></rect>",
            if is_below { "bar low" } else { "bar" },
            x(bin[0]) + 0.5,
            bottom - height,
            (x(bin[1]) - x(bin[0]) - 1.0).max(0.5),
            number(&json!(bin[0])),
            number(&json!(bin[1])),
            100.0 * (count / total),
        );
    }
    for tick in ticks(end) {
        let _ = write!(
            svg,
            "<line class=\"axis\" x1=\"{0:.2}\" y1=\"{bottom}\" x2=\"{0:.2}\" y2=\"{1}\"/>\
             <text class=\"tick\" x=\"{0:.2}\" y=\"{2}\" text-anchor=\"middle\">{3}</text>",
            x(tick),
            bottom + 4.0,
            bottom + 17.0,
            number(&json!(tick)),
        );
    }
    if let Some(limit) = limit {
        let _ = write!(
            svg,
            "<line class=\"limit {2}\" x1=\"{0:.2}\" y1=\"{1}\" x2=\"{0:.2}\" y2=\"{bottom}\"/>\
             <text class=\"tick {2}\" x=\"{0:.2}\" y=\"{3}\" text-anchor=\"middle\">required {4}</text>",
            x(limit.value),
            PLOT_TOP - 2.0,
            if limit.is_met { "met" } else { "missed" },
            PLOT_TOP - 5.0,
            number(&json!(limit.value)),
        );
    }
    let mut caption = escaped(label);
    if above > 0.0 {
        let _ = write!(
            caption,
            "; {:.1} % of the samples are above {}",
            100.0 * (above / total),
            number(&json!(top))
        );
    }
    let _ = write!(
        svg,
        "<text class=\"label\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{caption}</text></svg>",
        PLOT_LEFT + PLOT_WIDTH / 2.0,
        HEIGHT - 8.0,
    );
    Some(svg)
}

/// Named curves over a common abscissa as SVG; ordinates start at 0. `None` without a positive ordinate or with a
/// single abscissa.
pub(super) fn curves(list: &[(&str, Vec<[f64; 2]>)], label: &str) -> Option<String> {
    let points = || list.iter().flat_map(|c| &c.1);
    let highest = points().fold(0.0f64, |a, p| a.max(p[1]));
    let (low, high) = points().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
        (a.min(p[0]), b.max(p[0]))
    });
    if highest <= 0.0 || low >= high {
        return None;
    }
    let bottom = PLOT_TOP + PLOT_HEIGHT;
    // The difference of two large numbers may have no value: that of their halves does. The least number has no half.
    let scale = if (high - low).is_finite() { 1.0 } else { 0.5 };
    let x =
        |v: f64| PLOT_LEFT + (scale * v - scale * low) / (scale * high - scale * low) * PLOT_WIDTH;
    let y = |v: f64| bottom - v / highest * PLOT_HEIGHT;
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\">\
         <line class=\"axis\" x1=\"{PLOT_LEFT}\" y1=\"{bottom}\" x2=\"{1}\" y2=\"{bottom}\"/>\
         <text class=\"tick\" x=\"{2}\" y=\"{3}\" text-anchor=\"end\">{4}</text>",
        escaped(label),
        PLOT_LEFT + PLOT_WIDTH,
        PLOT_LEFT - 6.0,
        PLOT_TOP + 4.0,
        number(&json!(highest)),
    );
    // Names stand below each other at the right, in the colours of their curves.
    for (n, (name, points)) in list.iter().enumerate() {
        let mut path = String::new();
        for p in points {
            let _ = write!(path, "{:.2},{:.2} ", x(p[0]), y(p[1]));
        }
        let _ = write!(
            svg,
            "<polyline class=\"curve c{n}\" points=\"{}\"/>\
             <text class=\"tick t{n}\" x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            path.trim_end(),
            PLOT_LEFT + PLOT_WIDTH,
            PLOT_TOP + 4.0 + 13.0 * n as f64,
            escaped(name),
        );
    }
    for n in 0..=LABELS {
        let share = n as f64 / LABELS as f64;
        let abscissa = low * (1.0 - share) + high * share;
        let _ = write!(
            svg,
            "<text class=\"tick\" x=\"{:.2}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            x(abscissa),
            bottom + 17.0,
            number(&json!(abscissa)),
        );
    }
    let _ = write!(
        svg,
        "<text class=\"label\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text></svg>",
        PLOT_LEFT + PLOT_WIDTH / 2.0,
        HEIGHT - 8.0,
        escaped(label),
    );
    Some(svg)
}

/// At most [`LABELS`] steps from 0 along an axis that ends at a positive number, at multiples of a round number.
fn ticks(end: f64) -> impl Iterator<Item = f64> {
    let step = round_step(end / LABELS as f64);
    // The numbers next to 0 and to infinity have no round step.
    let (step, count) = if step.is_normal() {
        (step, (end / step * (1.0 + 1e-9)) as usize)
    } else {
        (end, 1)
    };
    (0..=count.min(LABELS)).map(move |n| n as f64 * step)
}

/// A number with one leading digit 1, 2 or 5, at least `value` up to rounding.
fn round_step(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let digit = value / power;
    let rounded = [1.0, 2.0, 5.0].into_iter().find(|d| *d >= digit - 1e-9);
    power * rounded.unwrap_or(10.0)
}

#[cfg(test)]
mod tests {
    use super::{Limit, curves, histogram, ticks};
    use serde_json::json;

    /// Numbers of the report, from the least above 0 to the greatest.
    const SIZES: [f64; 8] = [5e-324, 1e-320, 1e-308, 1e-300, 0.7, 1e300, 1e308, f64::MAX];

    #[test]
    fn axes_of_any_size_have_few_ticks() {
        assert_eq!(ticks(1.0).collect::<Vec<_>>(), [0.0, 0.5, 1.0]);
        assert_eq!(ticks(0.8).count(), 5);
        for end in SIZES {
            let all: Vec<f64> = ticks(end).collect();
            assert!((2..=5).contains(&all.len()), "{end:e}: {all:?}");
            assert!(all.windows(2).all(|w| w[0] < w[1]), "{end:e}: {all:?}");
            assert!(
                all.iter().all(|t| *t <= end * (1.0 + 1e-9)),
                "{end:e}: {all:?}"
            );
        }
    }

    /// Every coordinate of a drawing is a number, and the drawing is short.
    fn require_drawn(svg: &str) {
        assert!(svg.len() < 10_000, "{} bytes", svg.len());
        for name in [
            "x", "y", "x1", "x2", "y1", "y2", "width", "height", "points",
        ] {
            for value in svg.split(&format!(" {name}=\"")).skip(1) {
                let value = value.split('"').next().unwrap_or_default();
                for number in value.split([' ', ',']) {
                    assert!(number.parse::<f64>().unwrap().is_finite(), "{name}={value}");
                }
            }
        }
    }

    #[test]
    fn charts_of_any_numbers_are_short() {
        for size in SIZES {
            let edges = json!([0.0, size / 2.0, size]);
            for counts in [[1.0, 2.0], [size, size]] {
                let value = json!({ "edges": edges, "counts": counts, "above": counts[0] });
                for limit in [None, Some(-size), Some(size / 2.0), Some(size)] {
                    let limit = limit.map(|value| Limit {
                        value,
                        is_met: true,
                    });
                    require_drawn(&histogram(&value, "walls", limit.as_ref()).unwrap());
                }
            }
            let points = vec![[-size, size], [0.0, -size], [size, size / 2.0]];
            require_drawn(&curves(&[("area", points)], "height").unwrap());
        }
        let equal = json!({ "edges": [3.0, 3.0, 3.0], "counts": [1, 1] });
        require_drawn(&histogram(&equal, "walls", None).unwrap());
        // What is no number has no chart.
        let words = json!({ "edges": [0.0, "inf", "nan"], "counts": [1, 1] });
        assert!(histogram(&words, "walls", None).is_none());
        assert!(curves(&[("area", vec![[1.0, 1.0]; 2])], "height").is_none());
    }
}
