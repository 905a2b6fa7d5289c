//! A canvas of pixels: lines, text, and shades of a field. Positions are pixels from the upper left corner; what
//! lies beyond the page is left out.

use crate::vdb::Image;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::{FONT_7X13, FONT_10X20};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::Drawable;
use embedded_graphics::primitives::{Line, Primitive, PrimitiveStyle};
use embedded_graphics::text::{Baseline, Text};
use std::convert::Infallible;

pub(super) const TEXT_COLOUR: Rgb888 = Rgb888::new(20, 20, 24);
pub(super) const ACCENT_COLOUR: Rgb888 = Rgb888::new(214, 40, 40);
pub(super) const GRID_COLOUR: Rgb888 = Rgb888::new(205, 208, 214);

/// A pixel colour.
#[derive(Clone, Copy)]
pub(super) struct Shade(pub Rgb888);

impl Shade {
    /// The colour of a value between -1 (deep in the solid) and 1 (deep in the void), paler outside the element.
    pub fn of(value: f64, outside: bool) -> Self {
        // The root makes changes near the surface visible. Colours run from the first number at the surface to the
        // second.
        let depth = value.abs().min(1.0).sqrt();
        let mix = |near: f64, far: f64| (near + (far - near) * depth) as u8;
        let color = if value < 0.0 {
            Rgb888::new(mix(176.0, 70.0), mix(205.0, 120.0), mix(235.0, 180.0))
        } else {
            Rgb888::new(mix(255.0, 222.0), mix(255.0, 219.0), mix(252.0, 206.0))
        };
        Self(color).faded(outside)
    }

    /// A paler shade if `fade` is set.
    pub fn faded(self, fade: bool) -> Self {
        // A quarter of the colour and three quarters of white.
        let light = |c: u8| (u16::from(c) / 4 + 191) as u8;
        let c = self.0;
        if fade {
            Self(Rgb888::new(light(c.r()), light(c.g()), light(c.b())))
        } else {
            self
        }
    }
}

/// A white page.
pub(super) struct Canvas {
    width: usize,
    height: usize,
    rgba: Vec<u8>,
}

impl Canvas {
    /// A white page of a size in pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            rgba: vec![255; 4 * width * height],
        }
    }

    /// Sets a pixel, if it lies on the page.
    pub fn pixel(&mut self, x: usize, y: usize, shade: Shade) {
        if x < self.width && y < self.height {
            let at = 4 * (y * self.width + x);
            let c = shade.0;
            self.rgba[at..at + 3].copy_from_slice(&[c.r(), c.g(), c.b()]);
        }
    }

    // The error type of the canvas has no value, so that drawing cannot fail.
    fn draw_text(&mut self, at: Point, text: &str, style: MonoTextStyle<'_, Rgb888>) {
        let Ok(_) = Text::with_baseline(text, at, style, Baseline::Top).draw(self);
    }

    /// Writes small text (letters of 7 by 13 pixels); (x, y) is its upper left corner.
    pub fn text(&mut self, x: usize, y: usize, text: &str, color: Rgb888) {
        let style = MonoTextStyle::new(&FONT_7X13, color);
        self.draw_text(Point::new(x as i32, y as i32), text, style);
    }

    /// Writes large text (letters of 10 by 20 pixels); (x, y) is its upper left corner.
    pub fn title(&mut self, x: usize, y: usize, text: &str, color: Rgb888) {
        let style = MonoTextStyle::new(&FONT_10X20, color);
        self.draw_text(Point::new(x as i32, y as i32), text, style);
    }

    /// Draws a line of one pixel between two points.
    pub fn line(&mut self, from: [usize; 2], to: [usize; 2], color: Rgb888) {
        self.stroke(from, to, color, 1);
    }

    /// Draws a line of two pixels between two points.
    pub fn thick_line(&mut self, from: [usize; 2], to: [usize; 2], color: Rgb888) {
        self.stroke(from, to, color, 2);
    }

    fn stroke(&mut self, from: [usize; 2], to: [usize; 2], color: Rgb888, width: u32) {
        let point = |p: [usize; 2]| Point::new(p[0] as i32, p[1] as i32);
        let line = Line::new(point(from), point(to));
        let Ok(()) = line
            .into_styled(PrimitiveStyle::with_stroke(color, width))
            .draw(self);
    }

    /// A rectangle between two corners.
    pub fn frame(&mut self, a: [usize; 2], b: [usize; 2], color: Rgb888) {
        for (from, to) in [
            (a, [b[0], a[1]]),
            ([b[0], a[1]], b),
            (b, [a[0], b[1]]),
            ([a[0], b[1]], a),
        ] {
            self.line(from, to, color);
        }
    }

    /// The page as a picture.
    pub fn image(self) -> Image {
        Image {
            width: self.width,
            height: self.height,
            rgba: self.rgba,
        }
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        for Pixel(p, color) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(p.x), usize::try_from(p.y)) {
                self.pixel(x, y, Shade(color));
            }
        }
        Ok(())
    }
}
