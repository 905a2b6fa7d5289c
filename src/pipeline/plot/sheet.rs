//! Contact sheets: many small pictures on one page, a caption under each.

use super::canvas::{Canvas, Shade, TEXT_COLOUR};
use crate::vdb::Image;
use embedded_graphics::pixelcolor::Rgb888;

/// Height of a caption, pixels.
const CAPTION_HEIGHT: usize = 28;

/// Number of columns of a contact sheet: as many as rows, or one more.
pub fn contact_sheet_columns(pictures: usize) -> usize {
    (pictures as f64).sqrt().ceil().max(1.0) as usize
}

/// Arranges pictures of one size in rows of [`contact_sheet_columns`], each above its caption. Long captions are cut.
pub fn contact_sheet(pictures: &[(String, Image)]) -> Image {
    let columns = contact_sheet_columns(pictures.len());
    let rows = pictures.len().div_ceil(columns);
    let (width, height) = pictures.first().map_or((1, 1), |p| (p.1.width, p.1.height));
    let mut page = Canvas::new(columns * width, rows * (height + CAPTION_HEIGHT));
    for (n, (caption, picture)) in pictures.iter().enumerate() {
        let (left, top) = (n % columns * width, n / columns * (height + CAPTION_HEIGHT));
        for (k, c) in picture.rgba.chunks_exact(4).enumerate() {
            let (x, y) = (left + k % picture.width, top + k / picture.width);
            page.pixel(x, y, Shade(Rgb888::new(c[0], c[1], c[2])));
        }
        // Letters are 10 pixels wide.
        let max_letters = width / 10;
        let text: String = caption.chars().take(max_letters).collect();
        let indent = width.saturating_sub(10 * text.chars().count()) / 2;
        page.title(left + indent, top + height + 2, &text, TEXT_COLOUR);
    }
    page.image()
}
