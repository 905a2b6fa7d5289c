//! Pictures: rays by OpenVDB, light here.
//!
//! One key light with shadows from the upper left, a fill light, sky and ground, and in crevices
//! darkening from the depths of neighbouring samples; far parts fade a little. Four rays a pixel.

use super::camera::View;
use super::{LevelSet, Session, VdbError, ffi};
use crate::frame::Vec3;
use crate::progress::{Cancelled, Progress};
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

/// Rays along each edge of a pixel.
const FINE: usize = 2;
/// Largest picture: larger ones are a slip of the keyboard.
const MOST_PIXELS: usize = 1 << 26;

/// What one ray met.
#[derive(Clone, Copy)]
struct Hit {
    /// Relative to the eye.
    position: Vec3,
    normal: Vec3,
    on_cut: bool,
    lit: bool,
}

impl LevelSet {
    /// Takes a picture of the solid.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a size of 0 or beyond 2^26 pixels or a cut on an axis other than
    /// 0, 1, 2; [`VdbError::Cancelled`]; what OpenVDB refuses.
    pub fn render(&self, picture: &Picture, session: Session<'_>) -> Result<Image, VdbError> {
        let (width, height) = (picture.width, picture.height);
        let pixels = width.saturating_mul(height);
        if pixels == 0 || pixels > MOST_PIXELS {
            return Err(VdbError::Parameter {
                name: "size of the picture in pixels",
                value: pixels as f64,
                expected: "1 to 2^26",
            });
        }
        if let Some((axis, at)) = picture.cut
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
        let bounds = self.bounds()?;
        if bounds.is_empty() {
            return Ok(develop(
                picture,
                &vec![None; pixels * FINE * FINE],
                &Lights::none(),
            ));
        }
        let (columns, rows) = (width * FINE, height * FINE);
        let view = View::fit(
            bounds,
            picture.towards_eye,
            picture.perspective,
            columns,
            rows,
        );
        let key = (view.up * 0.9 - view.right * 0.55 - view.forward * 0.65).normalize();
        let mut numbers = vec![0f32; 6 * columns * rows];
        let camera = view.camera(key, picture.cut);
        ffi::grid_trace(&self.grid, &camera, &mut numbers, &session.host())
            .map_err(|e| VdbError::of("rendering", session, &e))?;
        session.threads.install(|| {
            let hits: Vec<Option<Hit>> = numbers
                .par_chunks_exact(6)
                .enumerate()
                .map(|(n, s)| {
                    s[0].is_finite().then(|| Hit {
                        position: view.position(n % columns, n / columns, s[0].into()),
                        normal: Vec3::new(s[1].into(), s[2].into(), s[3].into()),
                        on_cut: s[4] > 0.5,
                        lit: s[5] > 0.5,
                    })
                })
                .collect();
            drop(numbers);
            let reach = 0.05 * bounds.half_diagonal();
            let open = openness(
                &hits,
                columns,
                reach,
                reach / view.pixel(),
                session.progress,
            )?;
            Ok(develop(
                picture,
                &hits,
                &Lights::new(&view, key, &hits, open),
            ))
        })
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

/// How open each sample is to the sky around it: 1 free, 0 buried. Looks at the positions that
/// samples within `reach` (world units; `radius` samples at the centre) saw.
fn openness(
    hits: &[Option<Hit>],
    columns: usize,
    reach: f64,
    radius: f64,
    progress: &dyn Progress,
) -> Result<Vec<f32>, Cancelled> {
    const TAPS: usize = 14;
    let rows = hits.len() / columns;
    let mut raw = vec![1f32; hits.len()];
    raw.par_chunks_mut(columns)
        .enumerate()
        .try_for_each(|(j, row)| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            for (i, out) in row.iter_mut().enumerate() {
                let Some(hit) = &hits[j * columns + i] else {
                    continue;
                };
                // A spiral, turned differently on each of 4 x 4 samples; the blur takes that away.
                let turn = f64::from((5 * (i & 3) as u32 + 11 * (j & 3) as u32) % 16) / 16.0;
                let mut shade = 0.0;
                for tap in 0..TAPS {
                    let r = radius * ((tap as f64 + 0.5 + turn) / (TAPS as f64 + 1.0));
                    let angle = (tap as f64 + turn) * 2.399_963_229_728_653;
                    let x = i as f64 + r * angle.cos();
                    let y = j as f64 + r * angle.sin();
                    if x < 0.0 || y < 0.0 || x >= columns as f64 || y >= rows as f64 {
                        continue;
                    }
                    if let Some(other) = &hits[y as usize * columns + x as usize] {
                        let to = other.position - hit.position;
                        let length = to.norm().max(1e-12 * reach);
                        let near = (1.0 - (length / (1.5 * reach)).powi(2)).max(0.0);
                        shade += (hit.normal.dot(&to) / length - 0.08).max(0.0) * near;
                    }
                }
                *out = (1.0 - 1.9 * shade / TAPS as f64).clamp(0.0, 1.0) as f32;
            }
            Ok(())
        })?;
    // Mean over 4 x 4 samples of the same surface.
    let blurred = (0..hits.len()).into_par_iter().map(|n| {
        let Some(hit) = &hits[n] else { return 1.0 };
        let (i, j) = (n % columns, n / columns);
        let (mut sum, mut count) = (0.0, 0.0);
        for y in j.saturating_sub(1)..(j + 3).min(rows) {
            for x in i.saturating_sub(1)..(i + 3).min(columns) {
                if let Some(other) = &hits[y * columns + x]
                    && hit.normal.dot(&other.normal) > 0.8
                {
                    sum += raw[y * columns + x];
                    count += 1.0;
                }
            }
        }
        sum / f32::max(count, 1.0)
    });
    Ok(blurred.collect())
}

/// Light from everywhere.
struct Lights {
    key: Vec3,
    fill: Vec3,
    forward: Vec3,
    /// Depth of the nearest and farthest sample.
    depths: [f64; 2],
    open: Vec<f32>,
}

impl Lights {
    fn none() -> Self {
        Self {
            key: Vec3::z(),
            fill: Vec3::z(),
            forward: Vec3::z(),
            depths: [0.0, 1.0],
            open: Vec::new(),
        }
    }

    fn new(view: &View, key: Vec3, hits: &[Option<Hit>], open: Vec<f32>) -> Self {
        let depth = |h: &Hit| h.position.dot(&view.forward);
        let depths = hits.iter().flatten().fold([f64::INFINITY, 0.0], |d, h| {
            [f64::min(d[0], depth(h)), f64::max(d[1], depth(h))]
        });
        Self {
            key,
            fill: (view.right * 0.9 + view.up * 0.15 - view.forward * 0.6).normalize(),
            forward: view.forward,
            depths,
            open,
        }
    }

    /// Linear colour of a sample.
    fn shade(&self, n: usize, hit: &Hit) -> [f64; 3] {
        const SURFACE: [f64; 3] = [0.56, 0.62, 0.68];
        const CUT: [f64; 3] = [0.80, 0.33, 0.12];
        let open = f64::from(self.open[n]);
        let lit = if hit.lit {
            hit.normal.dot(&self.key).max(0.0)
        } else {
            0.0
        };
        let fill = hit.normal.dot(&self.fill).max(0.0);
        let sky = 0.5 + 0.5 * hit.normal.z;
        let half = (self.key - self.forward).normalize();
        let gloss = hit.normal.dot(&half).max(0.0).powi(40) * if hit.lit { 0.10 } else { 0.0 };
        let span = (self.depths[1] - self.depths[0]).max(f64::MIN_POSITIVE);
        let far = (hit.position.dot(&self.forward) - self.depths[0]) / span;
        let fade = 0.22 * far.clamp(0.0, 1.0);
        let albedo = if hit.on_cut { CUT } else { SURFACE };
        std::array::from_fn(|c| {
            let ground = [0.30, 0.27, 0.25][c];
            let above = [0.40, 0.44, 0.50][c];
            let around = (ground + (above - ground) * sky) * open * open;
            let light = around + 0.85 * lit * (0.35 + 0.65 * open) + 0.22 * fill * open;
            let colour = albedo[c] * light + gloss;
            colour * (1.0 - fade) + 0.85 * fade
        })
    }
}

/// Samples to pixels.
fn develop(picture: &Picture, hits: &[Option<Hit>], lights: &Lights) -> Image {
    let columns = picture.width * FINE;
    let mut rgba = vec![0u8; 4 * picture.width * picture.height];
    rgba.par_chunks_exact_mut(4)
        .enumerate()
        .for_each(|(n, pixel)| {
            let (i, j) = (n % picture.width * FINE, n / picture.width * FINE);
            let (mut sum, mut covered) = ([0.0; 3], 0.0);
            for k in 0..FINE * FINE {
                let at = (j + k / FINE) * columns + i + k % FINE;
                if let Some(hit) = &hits[at] {
                    covered += 1.0;
                    let colour = lights.shade(at, hit);
                    (0..3).for_each(|c| sum[c] += colour[c].min(1.0));
                }
            }
            let all = (FINE * FINE) as f64;
            for c in 0..3 {
                let colour = match (picture.transparent, covered > 0.0) {
                    (true, true) => sum[c] / covered,
                    (true, false) => 0.0,
                    (false, _) => (sum[c] + all - covered) / all,
                };
                pixel[c] = to_srgb(colour);
            }
            pixel[3] = if picture.transparent {
                (255.0 * covered / all).round() as u8
            } else {
                255
            };
        });
    Image {
        width: picture.width,
        height: picture.height,
        rgba,
    }
}

fn to_srgb(linear: f64) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let curve = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * curve).round() as u8
}
