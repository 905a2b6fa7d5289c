//! Pictures: rays by OpenVDB, light here.
//!
//! One key light with shadows from the upper left, a fill light, sky and ground, and in crevices
//! darkening from the depths of neighbouring samples; far parts fade a little. One ray a pixel, and three
//! more where it and the pixels beside it see different things.

use super::camera::View;
use super::colormap::Paint;
use super::samples::Samples;
use super::shading::{FINE, Hit, Lights, Short, develop, openness};
use super::{LevelSet, Session, VdbError, Volume, ffi};
use crate::frame::{Aabb, Vec3, WorldPoint};
use rayon::prelude::*;

/// What a picture shows, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// From the part towards the eye, z up; any length.
    pub towards_eye: Vec3,
    /// Perspective of 30 degrees, or parallel rays.
    pub perspective: bool,
    /// Axis and world coordinate of a plane; what lies before it is left away.
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

/// Pixels, row by row from the top, red green blue alpha (straight).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// 4 bytes a pixel, sRGB.
    pub rgba: Vec<u8>,
}

/// Numbers that the bridge gives for each sample.
pub(super) const NUMBERS: usize = 6;
/// Largest picture: larger ones are a slip of the keyboard.
const MOST_PIXELS: usize = 1 << 26;

/// Six numbers for each sample of a view under a light, as the bridge gives them: of the samples with some
/// numbers, or, without any, of all.
pub(super) type Trace<'t, E> = dyn FnMut(&View, Vec3, &[u32]) -> Result<Vec<f32>, E> + 't;

impl Picture {
    pub(super) fn check(&self) -> Result<(), VdbError> {
        let pixels = self.width.saturating_mul(self.height);
        if pixels == 0 || pixels > MOST_PIXELS {
            return Err(VdbError::Parameter {
                name: "size of the picture in pixels",
                value: pixels as f64,
                expected: "1 to 2^26",
            });
        }
        if let Some((axis, at)) = self.cut
            && (axis > 2 || !at.is_finite())
        {
            return Err(VdbError::Parameter {
                name: if axis > 2 {
                    "axis of the cut"
                } else {
                    "place of the cut"
                },
                value: if axis > 2 { axis as f64 } else { at },
                expected: "axis 0, 1 or 2 and a finite place",
            });
        }
        Ok(())
    }

    /// The picture of what lies in a box. `trace` gives six numbers for each sample of a view under a
    /// light, as the bridge does; with `at_once` it is asked for all of a view, whichever are needed.
    pub(super) fn compose<E: From<VdbError> + Send>(
        &self,
        bounds: Aabb,
        grid: Option<&Volume>,
        session: Session<'_>,
        at_once: bool,
        trace: &mut Trace<'_, E>,
    ) -> Result<(Image, [f32; 2]), E> {
        let (width, height) = (self.width, self.height);
        if bounds.is_empty() {
            let nothing = Samples::none(width, height);
            return Ok((develop(self, &nothing, &Lights::none()), [0.0; 2]));
        }
        let (columns, rows) = (width * FINE, height * FINE);
        let towards = self.towards_eye;
        let coarse = [width.div_ceil(8).max(32), height.div_ceil(8).max(32)];
        let view = View::fit(bounds, towards, self.perspective, coarse[0], coarse[1]);
        let key = (view.up * 0.8 - view.right * 0.7 - view.forward * 0.55).normalize();
        // Once coarsely, to see what part of the frame is filled.
        let (low, high) = covered(&trace(&view, key, &[])?, coarse[0]);
        let view = view.cropped(low, high, columns, rows);
        let all = if at_once {
            trace(&view, key, &[])?
        } else {
            Vec::new()
        };
        let mut look = |wanted: &[u32]| {
            let numbers = if at_once {
                let own = wanted
                    .iter()
                    .flat_map(|&n| &all[NUMBERS * n as usize..][..NUMBERS]);
                own.copied().collect()
            } else {
                trace(&view, key, wanted)?
            };
            let samples = wanted.par_iter().zip(numbers.par_chunks_exact(NUMBERS));
            let hits = samples.with_min_len(1 << 12).map(|(&n, s)| {
                let (i, j) = (n as usize % columns, n as usize / columns);
                s[0].is_finite().then(|| Hit {
                    position: view.position(i, j, s[0].into()).cast(),
                    normal: Short::new(s[1], s[2], s[3]),
                    on_cut: s[4] > 0.5,
                    lit: s[5] > 0.5,
                })
            });
            Ok::<Vec<_>, E>(session.threads.install(|| hits.collect()))
        };
        let mut samples = Samples::first(width, height, &mut look)?;
        samples.divide(&mut look)?;
        session.threads.install(|| {
            let hits = samples.hits();
            let values = grid.map(|g| values_at(hits, view.eye, g)).transpose()?;
            let paint = Paint::new(values.unwrap_or_default());
            let reach = 0.05 * bounds.half_diagonal();
            let radius = reach / (FINE as f64 * view.pixel());
            let open =
                openness(&samples, reach, radius, session.progress).map_err(VdbError::from)?;
            let range = paint.range();
            let lights = Lights::new(&view, key, hits, open).with_paint(paint);
            Ok((develop(self, &samples, &lights), range))
        })
    }
}

impl LevelSet {
    /// Takes a picture of the solid.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a size of 0 or beyond 2^26 pixels or a cut on an axis other than
    /// 0, 1, 2; [`VdbError::Cancelled`]; what OpenVDB refuses.
    pub fn render(&self, picture: &Picture, session: Session<'_>) -> Result<Image, VdbError> {
        Ok(self.render_with(picture, None, session)?.0)
    }

    /// As [`LevelSet::render`], coloured by the values of a grid, dark violet to yellow; the values at the
    /// two ends, which 2 % of what is seen lie beyond.
    ///
    /// # Errors
    /// As [`LevelSet::render`].
    pub fn render_by(
        &self,
        picture: &Picture,
        grid: &Volume,
        session: Session<'_>,
    ) -> Result<(Image, [f32; 2]), VdbError> {
        self.render_with(picture, Some(grid), session)
    }

    fn render_with(
        &self,
        picture: &Picture,
        grid: Option<&Volume>,
        session: Session<'_>,
    ) -> Result<(Image, [f32; 2]), VdbError> {
        picture.check()?;
        let bounds = self.bounds()?;
        picture.compose(bounds, grid, session, false, &mut |view, key, wanted| {
            self.trace(view, (key, picture.cut), wanted, session)
        })
    }

    /// Six numbers for each sample of a view, or for those wanted, as the bridge gives them.
    pub(super) fn trace(
        &self,
        view: &View,
        (light, cut): (Vec3, Option<(usize, f64)>),
        wanted: &[u32],
        session: Session<'_>,
    ) -> Result<Vec<f32>, VdbError> {
        let camera = view.camera(light, cut);
        let count = match wanted.len() {
            0 => camera.columns * camera.rows,
            some => some,
        };
        let mut numbers = vec![0f32; NUMBERS * count];
        ffi::grid_trace(&self.grid, &camera, wanted, &mut numbers, &session.host())
            .map_err(|e| VdbError::of("rendering", session, &e))?;
        Ok(numbers)
    }

    /// A picture as the bytes of a PNG file, from the usual place.
    ///
    /// # Errors
    /// As [`LevelSet::render`].
    pub fn picture(
        &self,
        width: usize,
        height: usize,
        cut: Option<(usize, f64)>,
        session: Session<'_>,
    ) -> Result<Vec<u8>, VdbError> {
        let picture = Picture {
            width,
            height,
            cut,
            ..Picture::default()
        };
        self.render(&picture, session)?.png()
    }
}

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

/// Values of a grid where samples met something, 0 elsewhere.
fn values_at(hits: &[Option<Hit>], eye: Vec3, grid: &Volume) -> Result<Vec<f32>, VdbError> {
    let rows = hits.par_chunks(1 << 14).map(|hits| {
        let places = hits.iter().map(|hit| {
            let p = hit.as_ref().map_or(eye, |h| eye + h.position.cast());
            WorldPoint(p)
        });
        grid.samples(&places.collect::<Vec<_>>())
    });
    Ok(rows.collect::<Result<Vec<_>, _>>()?.concat())
}

/// The box of samples that met something; all of them if none did.
fn covered(numbers: &[f32], columns: usize) -> ([usize; 2], [usize; 2]) {
    let rows = numbers.len() / (NUMBERS * columns);
    let mut found = ([columns, rows], [0, 0]);
    for (n, sample) in numbers.chunks_exact(NUMBERS).enumerate() {
        if sample[0].is_finite() {
            let at = [n % columns, n / columns];
            for a in 0..2 {
                found.0[a] = found.0[a].min(at[a]);
                found.1[a] = found.1[a].max(at[a]);
            }
        }
    }
    if found.0[0] > found.1[0] {
        return ([0, 0], [columns - 1, rows - 1]);
    }
    found
}
