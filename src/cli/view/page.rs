//! The page: its parts and the geometry in one file, or the parts of a live page. Text from outside is escaped;
//! geometry is compressed numbers in base 64 or in a binary answer.

use super::scene::Scene;
use crate::cli::failure::Failure;
use crate::cli::html::{base64, escaped};
use crate::io::atomic::write_bytes;
use flate2::Compression;
use serde_json::{Value, json};
use std::path::Path;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
/// The scripts of all pages, in order.
const SCRIPTS: [&str; 8] = [
    include_str!("kit.js"),
    include_str!("webgl.js"),
    include_str!("decode.js"),
    include_str!("camera.js"),
    include_str!("shaders.js"),
    include_str!("drawing.js"),
    include_str!("controls.js"),
    include_str!("page.js"),
];
/// What begins a page that holds its scene.
const INLINE: &str = include_str!("inline.js");
/// Controls and keys of a live page.
const LIVE_CONTROLS: &str = include_str!("live.html");
const LIVE_KEYS: &str = " · s slice · Ctrl-Z undo · Ctrl-Y redo";
/// What begins a live page.
const LIVE: [&str; 3] = [
    include_str!("parameters.js"),
    include_str!("slices.js"),
    include_str!("live.js"),
];

/// What forbids all requests of a page in one file.
const POLICY: &str = "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; \
                      style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'\">";

/// Writes the page of a scene; returns its size.
pub(super) fn write(path: &Path, title: &str, scene: &Scene) -> Result<u64, Failure> {
    let encoded = describe(scene, title, Compression::new(7)); // of 9: the file is made once and kept
    let (about, numbers) = encoded.map_err(|e| Failure::data(path, e.to_string()))?;
    // No tag can end the script that holds the JSON.
    let about = about.to_string().replace('<', "\\u003c");
    let head = format!("{POLICY}\n<style>\n{STYLE}</style>");
    let mut data = format!(
        "<script type=\"application/json\" id=\"scene\">{about}</script>\n\
         <script type=\"text/plain\" id=\"numbers\">{}</script>\n<script>\n",
        base64(&numbers)
    );
    data.push_str(&SCRIPTS.concat());
    data.push_str(INLINE);
    data.push_str("</script>");
    let page = fill(&[("title", &escaped(title)), ("head", &head), ("data", &data)]);
    Ok(write_bytes(path, page.as_bytes())?)
}

/// The live page.
pub(super) fn live(title: &str) -> String {
    let head = "<link rel=\"stylesheet\" href=\"page.css\">";
    let data = "<script src=\"page.js\" defer></script>";
    fill(&[
        ("title", &escaped(title)),
        ("head", head),
        ("live", LIVE_CONTROLS),
        ("keys", LIVE_KEYS),
        ("data", data),
    ])
}

/// The scripts of the live page.
pub(super) fn live_script() -> String {
    SCRIPTS.iter().chain(&LIVE).copied().collect()
}

/// The style sheet of all pages.
pub(super) fn style() -> &'static str {
    STYLE
}

/// A scene for the live page: a description and compressed numbers.
pub(super) fn pack(scene: &Scene, title: &str) -> std::io::Result<Vec<u8>> {
    // They are read on this machine, at once.
    let (about, numbers) = describe(scene, title, Compression::fast())?;
    let mut bytes = crate::cli::server::headed(&about);
    bytes.extend(numbers);
    Ok(bytes)
}

/// The description of a scene with title and version, and its compressed numbers.
fn describe(
    scene: &Scene,
    title: &str,
    compression: Compression,
) -> std::io::Result<(Value, Vec<u8>)> {
    let (mut about, numbers) = scene.encode(compression)?;
    about["title"] = json!(title);
    about["version"] = json!(env!("CARGO_PKG_VERSION"));
    Ok((about, numbers))
}

/// The page with its parts in their places.
fn fill(parts: &[(&str, &str)]) -> String {
    let sizes = parts.iter().map(|p| p.1.len());
    let mut page = String::with_capacity(PAGE.len() + sizes.sum::<usize>());
    // A template's places are `{{name}}`; what fills them is not searched again.
    for piece in PAGE.split("{{") {
        let Some((name, rest)) = piece.split_once("}}") else {
            page.push_str(piece);
            continue;
        };
        let part = parts.iter().find(|p| p.0 == name);
        page.push_str(part.map_or("", |p| p.1));
        page.push_str(rest);
    }
    page
}
