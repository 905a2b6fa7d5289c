//! Sections of the page on channels and layers, for printed parts. Both are empty where the run has none; `solid`
//! is the report's object of the solid and `unit` that of its lengths.

use super::chart::curves;
use crate::cli::html::{number, place, table};
use serde_json::Value;
use std::fmt::Write;

/// Greatest number of channels, of islands and of cups that a table lists.
const MAX_ROWS: usize = 20;

/// The table of the channels that `drain` drilled, at most `MAX_ROWS`; empty without any.
pub(super) fn drains(solid: &Value, unit: &str) -> String {
    let list = solid["drains"].as_array().map_or(&[][..], Vec::as_slice);
    if list.is_empty() {
        return String::new();
    }
    let rows: Vec<Vec<String>> = list
        .iter()
        .take(MAX_ROWS)
        .map(|d| {
            vec![
                place(&d["from"]),
                place(&d["to"]),
                number(&d["radius"]),
                number(&d["length"]),
            ]
        })
        .collect();
    let heads = [
        "from",
        "to",
        &format!("radius, {unit}"),
        &format!("length, {unit}"),
    ];
    format!(
        "<p>Drilled channels: {}.</p>{}",
        list.len(),
        table(&heads, &rows)
    )
}

/// The measures, curves and starts of islands and cups of the build's layers; empty without `[build]`.
pub(super) fn layers(solid: &Value, unit: &str) -> String {
    let build = &solid["build"];
    let Some(profile) = build["profile"].as_array() else {
        return String::new();
    };
    let mut out = format!(
        "<p>{} layers of {} {unit} along {}: {} islands, {} cups, {} {unit}² beyond {} degrees.</p>",
        number(&build["layers"]),
        number(&build["layer"]),
        place(&build["up"]),
        number(&build["islands"]),
        number(&build["cups"]),
        number(&build["overhang_area"]),
        number(&build["overhang"]),
    );
    for (name, key) in [
        ("Greatest section", "section_max"),
        ("Greatest change of the section", "section_jump"),
        ("Greatest sealed area", "sealed_max"),
    ] {
        let pair = &build[key];
        if pair[0].as_f64().is_some_and(|v| v > 0.0) {
            let _ = write!(
                out,
                "<p>{name}: {} {unit}² at height {} {unit}</p>",
                number(&pair[0]),
                number(&pair[1])
            );
        }
    }
    let points = |key: &str| -> Vec<[f64; 2]> {
        let pair = |step: &Value| Some([step["height"].as_f64()?, step[key].as_f64()?]);
        profile.iter().filter_map(pair).collect()
    };
    let shown = [
        ("section", points("area")),
        ("overhang", points("overhang")),
        ("sealed", points("sealed")),
    ];
    let label = format!("height, {unit}; areas, {unit}²");
    if let Some(chart) = curves(&shown, &label) {
        let _ = write!(
            out,
            "<div class=\"charts\"><div class=\"chart\">{chart}</div></div>"
        );
    }
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (word, key) in [("island", "island_list"), ("cup", "cup_list")] {
        let list = build[key].as_array().map_or(&[][..], Vec::as_slice);
        rows.extend(
            list.iter()
                .take(MAX_ROWS)
                .map(|s| vec![word.into(), place(&s["place"]), number(&s["area"])]),
        );
    }
    if !rows.is_empty() {
        out.push_str(&table(&["", "begins at", &format!("area, {unit}²")], &rows));
    }
    out
}
