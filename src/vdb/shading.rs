//! Shading of hits: ambient occlusion, light and colours, and the pixels of an image.
//!
//! Samples come from `samples`, several for a pixel with an edge. Colours are linear light until the last step, which
//! turns them into sRGB of 8 bits. The factors of the lights are chosen for the eye and have no physical unit.

use super::camera::View;
use super::colormap::ValueColours;
use super::picture::{Image, Picture};
use super::samples::{Hit, Samples, Vec3f};
use crate::frame::Vec3;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Screen-space ambient occlusion: the openness of each sample, from 1 (free) to 0 (buried), from the positions of the
/// first samples of pixels within `reach` (world units; `radius` pixels at the centre). It is evaluated for the first
/// sample of each pixel, and for extra samples on another surface. The result is by number of the sample, in the order
/// of [`Samples::hits`].
pub(super) fn ambient_openness(
    samples: &Samples,
    reach: f64,
    radius: f64,
    progress: &dyn Progress,
) -> Result<Vec<f32>, Cancelled> {
    let [width, height] = samples.size();
    let surroundings = &Surroundings {
        samples,
        reach: reach as f32,
        radius: radius as f32,
    };
    let mut raw = vec![1f32; width * height];
    raw.par_chunks_mut(width)
        .enumerate()
        .try_for_each(|(j, row)| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            for (i, out) in row.iter_mut().enumerate() {
                if let Some(hit) = samples.pixel(i, j) {
                    *out = surroundings.openness(hit, i, j);
                }
            }
            Ok(())
        })?;
    // The mean over 4 x 4 pixels of the same surface removes the pattern of the rotated spirals.
    let smoothed = |n: usize| {
        let (i, j) = (n % width, n / width);
        let Some(hit) = samples.pixel(i, j) else {
            return 1.0;
        };
        let (mut sum, mut count) = (0.0, 0.0);
        for y in j.saturating_sub(1)..(j + 3).min(height) {
            for x in i.saturating_sub(1)..(i + 3).min(width) {
                if samples
                    .pixel(x, y)
                    .is_some_and(|o| has_similar_normal(hit, o))
                {
                    sum += raw[y * width + x];
                    count += 1.0;
                }
            }
        }
        sum / f32::max(count, 1.0)
    };
    let numbers = (0..width * height).into_par_iter().with_min_len(1 << 12); // each is quick
    let mut openness: Vec<f32> = numbers.map(smoothed).collect();
    let divided: Vec<usize> = samples.divided().collect();
    // Extra samples on the surface of the first one share its openness: 256 pixels are quick, few are evaluated.
    let others = divided.par_iter().with_min_len(1 << 8).flat_map_iter(|&n| {
        let first = (samples.hits()[n].as_ref(), openness[n]);
        samples.of_pixel(n).skip(1).map(move |other| {
            let Some(hit) = &samples.hits()[other] else {
                return 1.0;
            };
            match first {
                (Some(own), openness) if has_similar_normal(hit, own) => openness,
                _ => surroundings.openness(hit, n % width, n / width),
            }
        })
    });
    let others: Vec<f32> = others.collect();
    openness.extend(others);
    Ok(openness)
}

/// Whether the normals of two hits are at most 37 degrees apart.
fn has_similar_normal(first: &Hit, other: &Hit) -> bool {
    first.normal.dot(&other.normal) > 0.8
}

/// The samples and reach of the ambient occlusion.
struct Surroundings<'a> {
    samples: &'a Samples,
    /// Reach in world units.
    reach: f32,
    /// Reach in pixels at the centre.
    radius: f32,
}

impl Surroundings<'_> {
    /// The openness of a hit in pixel (i, j). It falls from 1 with the samples around it that rise above the hit's
    /// plane within 1.5 times the reach; beyond the picture nothing hides it.
    fn openness(&self, hit: &Hit, i: usize, j: usize) -> f32 {
        const TAPS: usize = 16;
        let [width, height] = self.samples.size();
        // A spiral, rotated in each of 4 x 4 pixels by another sixteenth of the step between taps, 2.4 radians.
        let turn = ((5 * (i % 4) + 11 * (j % 4)) % 16) as f32 / 16.0;
        let (mut sin, mut cos) = (turn * 2.4).sin_cos();
        // Sine and cosine of that step, the golden angle.
        let (turn_sin, turn_cos) = (0.675_490_3, -0.737_368_9);
        // Beyond 1.5 times the reach nothing occludes. 1e-6 keeps a quotient finite; other factors are chosen by eye.
        let farthest = (1.5 * self.reach).powi(2);
        let mut shade = 0.0;
        for tap in 0..TAPS {
            let r = self.radius * (tap as f32 + 0.5 + turn) / (TAPS as f32 + 1.0);
            let x = i as f32 + 0.5 + r * cos;
            let y = j as f32 + 0.5 + r * sin;
            (cos, sin) = (
                cos * turn_cos - sin * turn_sin,
                cos * turn_sin + sin * turn_cos,
            );
            if x < 0.0 || y < 0.0 || x >= width as f32 || y >= height as f32 {
                continue;
            }
            if let Some(other) = self.samples.pixel(x as usize, y as usize) {
                let to = other.position - hit.position;
                let (square, rise) = (to.norm_squared(), hit.normal.dot(&to));
                if rise > 0.0 && square < farthest {
                    let near = 1.0 - square / farthest;
                    let length = square.sqrt().max(1e-6 * self.reach);
                    shade += (rise / length - 0.08).max(0.0) * near;
                }
            }
        }
        (1.0 - 1.9 * shade / TAPS as f32).clamp(0.0, 1.0)
    }
}

/// The lights and colours of a picture.
pub(super) struct Lights {
    key: Vec3f,
    fill: Vec3f,
    forward: Vec3f,
    /// Normal of a surface that reflects the key light into the eye.
    half: Vec3f,
    /// Depth of the nearest and farthest sample.
    depths: [f32; 2],
    openness: Vec<f32>,
    colours: ValueColours,
}

impl Lights {
    /// Lights for a picture without hits: no sample is shaded with them, so that their values do not matter.
    pub fn unlit() -> Self {
        Self {
            key: Vec3f::z(),
            fill: Vec3f::z(),
            forward: Vec3f::z(),
            half: Vec3f::z(),
            depths: [0.0, 1.0],
            openness: Vec::new(),
            colours: ValueColours::default(),
        }
    }

    /// Sets the colours of the surface.
    pub fn with_colours(self, colours: ValueColours) -> Self {
        Self { colours, ..self }
    }

    /// Lights for the hits of a view. `key` is the unit direction to the key light; `openness` is by number of the
    /// sample, as [`ambient_openness`] returns it. The fill light comes from the right of the view and the viewer's
    /// side.
    pub fn new(view: &View, key: Vec3, hits: &[Option<Hit>], openness: Vec<f32>) -> Self {
        let forward: Vec3f = view.forward.cast();
        let depths = hits.iter().flatten().fold([f32::INFINITY, 0.0], |d, h| {
            let depth = h.position.dot(&forward);
            [f32::min(d[0], depth), f32::max(d[1], depth)]
        });
        let fill = (view.right * 0.9 + view.up * 0.15 - view.forward * 0.6).normalize();
        Self {
            key: key.cast(),
            fill: fill.cast(),
            forward,
            half: (key.cast::<f32>() - forward).normalize(),
            depths,
            openness,
            colours: ValueColours::default(),
        }
    }

    /// Linear colour of sample `n`: ambient light by openness, a key light with shadow and gloss, a
    /// fill light, and a fade into light grey with depth.
    fn shade(&self, n: usize, hit: &Hit) -> [f32; 3] {
        const SURFACE_COLOUR: [f32; 3] = [0.46, 0.55, 0.64];
        const CUT_COLOUR: [f32; 3] = [0.80, 0.30, 0.10];
        const GROUND_COLOUR: [f32; 3] = [0.24, 0.20, 0.17];
        const SKY_COLOUR: [f32; 3] = [0.34, 0.39, 0.46];
        let openness = self.openness[n];
        let shadow = if hit.lit { 1.0 } else { 0.0 };
        let lit = hit.normal.dot(&self.key).max(0.0) * shadow;
        let fill = hit.normal.dot(&self.fill).max(0.0);
        // Light from the sky above and the ground below, mixed by the normal's height.
        let sky = 0.5 + 0.5 * hit.normal.z;
        // Blinn's highlight: (normal . half vector)^32.
        let gloss = 0.12 * hit.normal.dot(&self.half).max(0.0).powi(32) * shadow;
        // Depth from 0 at the nearest hit to 1 at the farthest.
        let span = (self.depths[1] - self.depths[0]).max(f32::MIN_POSITIVE);
        let far = (hit.position.dot(&self.forward) - self.depths[0]) / span;
        let fade = 0.18 * far.clamp(0.0, 1.0);
        let albedo = match self.colours.colour(n) {
            _ if hit.on_cut => CUT_COLOUR,
            Some(own) => own,
            None => SURFACE_COLOUR,
        };
        std::array::from_fn(|c| {
            let ambient =
                (GROUND_COLOUR[c] + (SKY_COLOUR[c] - GROUND_COLOUR[c]) * sky) * openness * openness;
            let light = ambient + 1.05 * lit * (0.4 + 0.6 * openness) + 0.2 * fill * openness;
            (albedo[c] * light + gloss) * (1.0 - fade) + 0.75 * fade
        })
    }
}

/// Shades the samples and averages them into pixels. Averages are of linear light. A pixel without hits is white, or
/// clear with transparency.
pub(super) fn shade_image(picture: &Picture, samples: &Samples, lights: &Lights) -> Image {
    let mut rgba = vec![0u8; 4 * picture.width * picture.height];
    rgba.par_chunks_exact_mut(4)
        .with_min_len(1 << 10) // a pixel is quick work
        .enumerate()
        .for_each(|(n, pixel)| {
            let (mut sum, mut covered, mut all) = ([0f32; 3], 0f32, 0f32);
            for sample in samples.of_pixel(n) {
                all += 1.0;
                if let Some(hit) = &samples.hits()[sample] {
                    covered += 1.0;
                    let colour = lights.shade(sample, hit);
                    (0..3).for_each(|c| sum[c] += colour[c].min(1.0));
                }
            }
            if covered == 0.0 {
                pixel.fill(if picture.transparent { 0 } else { 255 });
                return;
            }
            for c in 0..3 {
                // With transparency the colour is that of the hits and their share becomes alpha; else
                // misses are white.
                let colour = if picture.transparent {
                    sum[c] / covered
                } else {
                    (sum[c] + all - covered) / all
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

/// A linear share of light as a level of sRGB, 0 to 255; shares beyond 0 and 1 are clamped.
fn to_srgb(linear: f32) -> u8 {
    /// A table, since a power would take longer than the rest of a pixel.
    static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let entries = 0..=TABLE_STEPS;
        entries
            .map(|n| {
                let v = n as f32 / TABLE_STEPS as f32;
                let curve = if v <= 0.003_130_8 {
                    12.92 * v
                } else {
                    1.055 * v.powf(1.0 / 2.4) - 0.055
                };
                (255.0 * curve).round() as u8
            })
            .collect()
    });
    /// One step is about a twentieth of a level where the curve is steepest.
    const TABLE_STEPS: usize = 1 << 16;
    TABLE[(linear.clamp(0.0, 1.0) * TABLE_STEPS as f32).round() as usize]
}
