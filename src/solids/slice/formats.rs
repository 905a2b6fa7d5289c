//! Files of layers: grey images, an SVG drawing, the Common Layer Interface of printers.
//!
//! Functions give text or bytes; the caller writes them in the order head, layers, tail. `to_mm` is the factor from
//! world units to millimetres, `n` the number of a layer from 0.

use super::{Layer, Outline, Plan, signed_area};
use std::fmt::Write;

/// A grey PNG image of 8 bits, white inside. `per_metre` is the number of pixels per metre.
///
/// # Errors
/// Errors of the encoder.
pub fn grey_png(plan: &Plan, layer: &Layer, per_metre: f64) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let [width, height] = plan.pixels.map(|p| p as u32);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let density = per_metre.round().clamp(1.0, f64::from(u32::MAX)) as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions {
        xppu: density,
        yppu: density,
        unit: png::Unit::Meter,
    }));
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&layer.coverage())?;
    writer.finish()?;
    Ok(bytes)
}

/// The head of an SVG drawing with one group per layer, in millimetres. The size is that of the plan.
pub fn svg_head(plan: &Plan, to_mm: f64) -> String {
    let [w, h] = plan.pixels.map(|p| p as f64 * plan.pixel * to_mm);
    let [x, y] = plan.corner.map(|c| c * to_mm);
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"{x} {} {w} {h}\">\n",
        -(y + h)
    )
}

/// One layer of the drawing. The y axis is reversed, since that of SVG points down. `n` is its number; `to_mm` turns
/// world units into millimetres.
pub fn svg_layer(plan: &Plan, n: usize, layer: &Layer, to_mm: f64) -> String {
    let mut text = format!(
        "<g id=\"layer{n}\" data-z=\"{}\" data-height=\"{}\"><path fill-rule=\"nonzero\" d=\"",
        plan.bottom(n) * to_mm,
        plan.height * to_mm
    );
    for outline in layer.outlines() {
        for (k, p) in outline.iter().enumerate() {
            let letter = if k == 0 { 'M' } else { 'L' };
            let _ = write!(text, "{letter}{:.5} {:.5}", p[0] * to_mm, -p[1] * to_mm);
        }
        text.push('Z');
    }
    text.push_str("\"/></g>\n");
    text
}

/// The end of the drawing.
pub fn svg_tail() -> &'static str {
    "</svg>\n"
}

/// The head of a Common Layer Interface file in ASCII, version 2.0, in millimetres.
pub fn cli_head(plan: &Plan) -> String {
    format!(
        "$$HEADERSTART\n$$ASCII\n$$UNITS/1\n$$VERSION/200\n$$LAYERS/{}\n$$HEADEREND\n$$GEOMETRYSTART\n",
        plan.layers()
    )
}

/// One layer: the height of its upper end, then its outlines as those of part 1, with direction 1 counter-clockwise
/// around solid and 0 clockwise around a hole. The first point of an outline is repeated at its end.
pub fn cli_layer(plan: &Plan, n: usize, outlines: &[Outline], to_mm: f64) -> String {
    let mut text = format!("$$LAYER/{:.6}\n", (plan.bottom(n) + plan.height) * to_mm);
    for outline in outlines {
        let direction = u8::from(signed_area(outline) > 0.0);
        let _ = write!(text, "$$POLYLINE/1,{direction},{}", outline.len() + 1);
        for p in outline.iter().chain(outline.first()) {
            let _ = write!(text, ",{:.6},{:.6}", p[0] * to_mm, p[1] * to_mm);
        }
        text.push('\n');
    }
    text
}

/// The end of a Common Layer Interface file.
pub fn cli_tail() -> &'static str {
    "$$GEOMETRYEND\n"
}
