//! Light on what rays met: openness, colours, pixels.

use super::camera::View;
use super::paint::Paint;
use super::render::{Image, Picture};
use crate::frame::Vec3;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Rays along each edge of a pixel.
pub(super) const FINE: usize = 2;

/// Directions and places of samples: many of them.
pub(super) type Short = nalgebra::Vector3<f32>;

/// What one ray met.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// Relative to the eye.
    pub position: Short,
    pub normal: Short,
    pub on_cut: bool,
    pub lit: bool,
}

/// How open each sample is to the sky around it: 1 free, 0 buried. Looks at the positions that
/// samples within `reach` (world units; `radius` samples at the centre) saw. One sample of each pixel
/// looks, and those that see something else than it.
pub(super) fn openness(
    hits: &[Option<Hit>],
    columns: usize,
    reach: f64,
    radius: f64,
    progress: &dyn Progress,
) -> Result<Vec<f32>, Cancelled> {
    let (width, height) = (columns / FINE, hits.len() / columns / FINE);
    let look = |i: usize, j: usize| {
        Surroundings {
            hits,
            columns,
            reach: reach as f32,
            radius: radius as f32,
        }
        .openness(i, j)
    };
    let mut raw = vec![1f32; width * height];
    raw.par_chunks_mut(width)
        .enumerate()
        .try_for_each(|(j, row)| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            for (i, out) in row.iter_mut().enumerate() {
                *out = look(i * FINE, j * FINE);
            }
            Ok(())
        })?;
    let first = |i: usize, j: usize| hits[j * FINE * columns + i * FINE];
    // Mean over 4 x 4 pixels of the same surface takes the turned spirals away.
    let smooth: Vec<f32> = (0..raw.len())
        .into_par_iter()
        .map(|n| {
            let (i, j) = (n % width, n / width);
            let Some(hit) = first(i, j) else { return 1.0 };
            let (mut sum, mut count) = (0.0, 0.0);
            for y in j.saturating_sub(1)..(j + 3).min(height) {
                for x in i.saturating_sub(1)..(i + 3).min(width) {
                    if first(x, y).is_some_and(|o| hit.normal.dot(&o.normal) > 0.8) {
                        sum += raw[y * width + x];
                        count += 1.0;
                    }
                }
            }
            sum / f32::max(count, 1.0)
        })
        .collect();
    let fine = (0..hits.len()).into_par_iter().map(|n| {
        let Some(hit) = &hits[n] else { return 1.0 };
        let (i, j) = (n % columns, n / columns);
        match first(i / FINE, j / FINE) {
            Some(o) if hit.normal.dot(&o.normal) > 0.8 => smooth[j / FINE * width + i / FINE],
            _ => look(i, j),
        }
    });
    Ok(fine.collect())
}

/// What a sample sees around itself.
struct Surroundings<'a> {
    hits: &'a [Option<Hit>],
    columns: usize,
    /// World units.
    reach: f32,
    /// Samples.
    radius: f32,
}

impl Surroundings<'_> {
    fn openness(&self, i: usize, j: usize) -> f32 {
        const TAPS: usize = 16;
        let Some(hit) = &self.hits[j * self.columns + i] else {
            return 1.0;
        };
        let rows = self.hits.len() / self.columns;
        // A spiral, turned differently in each of 4 x 4 pixels.
        let turn = ((5 * (i / FINE % 4) + 11 * (j / FINE % 4)) % 16) as f32 / 16.0;
        let (mut sin, mut cos) = (turn * 2.4).sin_cos();
        // The golden angle.
        let (turn_sin, turn_cos) = (0.675_490_3, -0.737_368_9);
        let mut shade = 0.0;
        for tap in 0..TAPS {
            let r = self.radius * (tap as f32 + 0.5 + turn) / (TAPS as f32 + 1.0);
            let x = i as f32 + r * cos;
            let y = j as f32 + r * sin;
            (cos, sin) = (
                cos * turn_cos - sin * turn_sin,
                cos * turn_sin + sin * turn_cos,
            );
            if x < 0.0 || y < 0.0 || x >= self.columns as f32 || y >= rows as f32 {
                continue;
            }
            if let Some(other) = &self.hits[y as usize * self.columns + x as usize] {
                let to = other.position - hit.position;
                let length = to.norm().max(1e-6 * self.reach);
                let near = (1.0 - (length / (1.5 * self.reach)).powi(2)).max(0.0);
                shade += (hit.normal.dot(&to) / length - 0.08).max(0.0) * near;
            }
        }
        (1.0 - 1.9 * shade / TAPS as f32).clamp(0.0, 1.0)
    }
}

/// Light from everywhere.
pub(super) struct Lights {
    key: Short,
    fill: Short,
    forward: Short,
    /// Depth of the nearest and farthest sample.
    depths: [f32; 2],
    open: Vec<f32>,
    paint: Paint,
}

impl Lights {
    pub fn none() -> Self {
        Self {
            key: Short::z(),
            fill: Short::z(),
            forward: Short::z(),
            depths: [0.0, 1.0],
            open: Vec::new(),
            paint: Paint::default(),
        }
    }

    /// The same on a coloured surface.
    pub fn with_paint(self, paint: Paint) -> Self {
        Self { paint, ..self }
    }

    pub fn new(view: &View, key: Vec3, hits: &[Option<Hit>], open: Vec<f32>) -> Self {
        let forward: Short = view.forward.cast();
        let depths = hits.iter().flatten().fold([f32::INFINITY, 0.0], |d, h| {
            let depth = h.position.dot(&forward);
            [f32::min(d[0], depth), f32::max(d[1], depth)]
        });
        let fill = (view.right * 0.9 + view.up * 0.15 - view.forward * 0.6).normalize();
        Self {
            key: key.cast(),
            fill: fill.cast(),
            forward,
            depths,
            open,
            paint: Paint::default(),
        }
    }

    /// Linear colour of a sample.
    fn shade(&self, n: usize, hit: &Hit) -> [f32; 3] {
        const SURFACE: [f32; 3] = [0.46, 0.55, 0.64];
        const CUT: [f32; 3] = [0.80, 0.30, 0.10];
        const GROUND: [f32; 3] = [0.24, 0.20, 0.17];
        const SKY: [f32; 3] = [0.34, 0.39, 0.46];
        let open = self.open[n];
        let shadow = if hit.lit { 1.0 } else { 0.0 };
        let lit = hit.normal.dot(&self.key).max(0.0) * shadow;
        let fill = hit.normal.dot(&self.fill).max(0.0);
        let sky = 0.5 + 0.5 * hit.normal.z;
        let half = (self.key - self.forward).normalize();
        let gloss = 0.12 * hit.normal.dot(&half).max(0.0).powi(32) * shadow;
        let span = (self.depths[1] - self.depths[0]).max(f32::MIN_POSITIVE);
        let far = (hit.position.dot(&self.forward) - self.depths[0]) / span;
        let fade = 0.18 * far.clamp(0.0, 1.0);
        let albedo = match self.paint.colour(n) {
            _ if hit.on_cut => CUT,
            Some(own) => own,
            None => SURFACE,
        };
        std::array::from_fn(|c| {
            let around = (GROUND[c] + (SKY[c] - GROUND[c]) * sky) * open * open;
            let light = around + 1.05 * lit * (0.4 + 0.6 * open) + 0.2 * fill * open;
            (albedo[c] * light + gloss) * (1.0 - fade) + 0.75 * fade
        })
    }
}

/// Samples to pixels.
pub(super) fn develop(picture: &Picture, hits: &[Option<Hit>], lights: &Lights) -> Image {
    let columns = picture.width * FINE;
    let mut rgba = vec![0u8; 4 * picture.width * picture.height];
    rgba.par_chunks_exact_mut(4)
        .enumerate()
        .for_each(|(n, pixel)| {
            let (i, j) = (n % picture.width * FINE, n / picture.width * FINE);
            let (mut sum, mut covered) = ([0f32; 3], 0f32);
            for k in 0..FINE * FINE {
                let at = (j + k / FINE) * columns + i + k % FINE;
                if let Some(hit) = &hits[at] {
                    covered += 1.0;
                    let colour = lights.shade(at, hit);
                    (0..3).for_each(|c| sum[c] += colour[c].min(1.0));
                }
            }
            let all = (FINE * FINE) as f32;
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

fn to_srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let curve = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * curve).round() as u8
}
