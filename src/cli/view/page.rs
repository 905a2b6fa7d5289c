//! The page: its parts and the geometry in one file.

use super::scene::Scene;
use crate::cli::Failure;
use crate::io::atomic::write_bytes;
use serde_json::{Value, json};
use std::path::Path;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
/// The scripts, in order.
const SCRIPTS: [&str; 7] = [
    include_str!("webgl.js"),
    include_str!("decode.js"),
    include_str!("camera.js"),
    include_str!("shaders.js"),
    include_str!("drawing.js"),
    include_str!("controls.js"),
    include_str!("page.js"),
];

/// Writes the page of a scene; returns its size.
pub(super) fn write(path: &Path, title: &str, scene: &Scene) -> Result<u64, Failure> {
    let encoded = scene.encode();
    let (mut about, numbers) = encoded.map_err(|e| Failure::data(path, e.to_string()))?;
    about["title"] = json!(title);
    about["version"] = json!(env!("CARGO_PKG_VERSION"));
    let page = fill(title, &about, &base64(&numbers));
    Ok(write_bytes(path, page.as_bytes())?)
}

/// The page with its parts in their places.
fn fill(title: &str, about: &Value, numbers: &str) -> String {
    let mut page = String::with_capacity(PAGE.len() + numbers.len() + (1 << 17));
    // A template's places are `{{name}}`; what fills them is not searched again.
    for part in PAGE.split("{{") {
        let Some((name, rest)) = part.split_once("}}") else {
            page.push_str(part);
            continue;
        };
        match name {
            "title" => page.push_str(&escape(title)),
            "style" => page.push_str(STYLE),
            "scripts" => SCRIPTS.iter().for_each(|s| page.push_str(s)),
            "about" => page.push_str(&about.to_string().replace('<', "\\u003c")),
            _ => page.push_str(numbers),
        }
        page.push_str(rest);
    }
    page
}

/// Text for HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Bytes in base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let all = three
            .iter()
            .enumerate()
            .fold(0u32, |n, (k, &b)| n | u32::from(b) << (16 - 8 * k));
        for k in 0..4 {
            let digit = DIGITS[(all >> (18 - 6 * k) & 63) as usize];
            text.push(if k > three.len() {
                '='
            } else {
                char::from(digit)
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::base64;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }
}
