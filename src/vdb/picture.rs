//! A picture of a level set: its request and its pixels.
//!
//! A picture is a request without any level set; the image that `render` makes has no file format until it is encoded.

use super::error::VdbError;
use crate::frame::Vec3;

/// Options of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Direction from the part towards the eye, z up; any length.
    pub towards_eye: Vec3,
    /// Perspective that sees the sphere around the solid under 30 degrees, or parallel rays.
    pub perspective: bool,
    /// Axis and world coordinate of a section plane; the part on the eye's side is not shown.
    pub cut: Option<(usize, f64)>,
    /// Whether the background is transparent instead of white.
    pub transparent: bool,
}

impl Default for Picture {
    fn default() -> Self {
        Self {
            width: 1000,
            height: 800,
            towards_eye: Vec3::new(-0.55, -1.0, 0.62),
            perspective: true,
            cut: None,
            transparent: false,
        }
    }
}

/// An image: pixels row by row from the top, red, green, blue and straight alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// 4 bytes per pixel, sRGB.
    pub rgba: Vec<u8>,
}

/// Values per sample that the bridge returns: depth, normal, cut, light.
pub(super) const RAY_VALUES: usize = 6;

/// Greatest number of pixels of a picture: numbers of four samples of each, and six values a sample, fit 32 bits.
pub(super) const MAX_PIXELS: usize = 1 << 26;

impl Image {
    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a size that PNG cannot hold.
    pub fn png(&self) -> Result<Vec<u8>, VdbError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let written = encoder
            .write_header()
            .and_then(|mut w| w.write_image_data(&self.rgba));
        written.map_err(|_| VdbError::Parameter {
            name: "size of the picture in pixels",
            value: self.width as f64 * self.height as f64,
            expected: "a size that PNG can hold",
        })?;
        Ok(bytes)
    }
}
