//! Many small pictures on one page, a caption under each.

use super::canvas::{Canvas, INK, Shade};
use crate::vdb::Image;
use embedded_graphics::pixelcolor::Rgb888;

/// Height of a caption, pixels.
const CAPTION: usize = 28;

/// How many columns a page of so many pictures has: as many as rows, or one more.
pub fn sheet_columns(pictures: usize) -> usize {
    (pictures as f64).sqrt().ceil().max(1.0) as usize
}

/// Pictures of one size in rows of [`sheet_columns`], each over its caption.
pub fn sheet(pictures: &[(String, Image)]) -> Image {
    let columns = sheet_columns(pictures.len());
    let rows = pictures.len().div_ceil(columns);
    let (width, height) = pictures.first().map_or((1, 1), |p| (p.1.width, p.1.height));
    let mut page = Canvas::new(columns * width, rows * (height + CAPTION));
    for (n, (caption, picture)) in pictures.iter().enumerate() {
        let (left, top) = (n % columns * width, n / columns * (height + CAPTION));
        for (k, c) in picture.rgba.chunks_exact(4).enumerate() {
            let (x, y) = (left + k % picture.width, top + k / picture.width);
            page.pixel(x, y, Shade(Rgb888::new(c[0], c[1], c[2])));
        }
        // Letters are 10 pixels wide.
        let room = width / 10;
        let text: String = caption.chars().take(room).collect();
        let indent = width.saturating_sub(10 * text.chars().count()) / 2;
        page.title(left + indent, top + height + 2, &text, INK);
    }
    page.image()
}
