//! Young's modulus by direction as a surface: from the origin in each direction as far as the modulus there.
//!
//! The surface is drawn as triangles with a depth for every sample, nine samples a pixel, coloured by the
//! modulus, with the axes of the cell.

use super::canvas::{Canvas, INK, PALE, Shade};
use crate::frame::{Mat3, Vec3};
use crate::homogenize::{Voigt, directional_modulus};
use crate::vdb::{Image, linear_colour};
use embedded_graphics::pixelcolor::Rgb888;

/// Pixels: the page, the square of the surface, margin.
const WIDTH: usize = 860;
const HEIGHT: usize = 640;
const SQUARE: usize = 560;
const MARGIN: usize = 24;
/// Samples along a pixel's edge.
const FINE: usize = 3;
/// Steps of the polar angle; twice as many around.
const STEPS: usize = 160;
/// Share of the square that the surface reaches from its middle.
const REACH: f64 = 0.42;

/// What one sample shows.
#[derive(Clone, Copy)]
struct Seen {
    depth: f64,
    colour: [f32; 3],
}

/// The picture of a compliance, with lines of text beside it.
pub fn modulus_picture(compliance: &Voigt, title: &str, lines: &[String]) -> Image {
    let modulus = |n: Vec3| directional_modulus(compliance, n);
    let direction = |i: usize, j: usize| {
        let polar = std::f64::consts::PI * i as f64 / STEPS as f64;
        let around = std::f64::consts::PI * j as f64 / STEPS as f64;
        Vec3::new(
            polar.sin() * around.cos(),
            polar.sin() * around.sin(),
            polar.cos(),
        )
    };
    let values: Vec<Vec<f64>> = (0..=STEPS)
        .map(|i| (0..=2 * STEPS).map(|j| modulus(direction(i, j))).collect())
        .collect();
    let all = values.iter().flatten();
    let (least, most) = all.fold((f64::MAX, 0f64), |(l, m), v| (l.min(*v), m.max(*v)));
    // Nearly isotropic moduli have one colour.
    let span = (most - least).max(1e-3 * most);
    let share = |value: f64| ((value - least) / span) as f32;

    let view = view();
    let size = SQUARE * FINE;
    let nothing = Seen {
        depth: f64::NEG_INFINITY,
        colour: [1.0; 3],
    };
    let mut seen = vec![nothing; size * size];
    let at = |i: usize, j: usize| {
        let value = values[i][j];
        (view * direction(i, j) * (value / most), share(value))
    };
    for i in 0..STEPS {
        for j in 0..2 * STEPS {
            let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            for corners in [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]] {
                triangle(&mut seen, size, corners);
            }
        }
    }
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let (left, top) = (MARGIN, HEIGHT - SQUARE - MARGIN);
    for y in 0..SQUARE {
        for x in 0..SQUARE {
            let mut sum = [0f32; 3];
            for n in 0..FINE * FINE {
                let (u, v) = (x * FINE + n % FINE, y * FINE + n / FINE);
                for (s, c) in sum.iter_mut().zip(seen[v * size + u].colour) {
                    *s += c / (FINE * FINE) as f32;
                }
            }
            canvas.pixel(left + x, top + y, Shade(encoded(sum)));
        }
    }
    axes(&mut canvas, [left, top], &view, |n: Vec3| modulus(n) / most);
    canvas.title(MARGIN, 14, title, INK);
    legend(&mut canvas, [least, most], lines);
    canvas.image()
}

/// Rows: to the right, up, towards the eye.
fn view() -> Mat3 {
    let towards = Vec3::new(1.0, 0.7, 0.65).normalize();
    let right = Vec3::z().cross(&towards).normalize();
    let up = towards.cross(&right);
    Mat3::from_rows(&[right.transpose(), up.transpose(), towards.transpose()])
}

/// Place on a square of `size` samples.
fn placed(p: Vec3, size: usize) -> [f64; 2] {
    let half = size as f64 / 2.0;
    let scale = REACH * size as f64;
    [half + p.x * scale, half - p.y * scale]
}

/// Draws a triangle of points with shares of the colours.
fn triangle(seen: &mut [Seen], size: usize, corners: [(Vec3, f32); 3]) {
    let p = corners.map(|c| placed(c.0, size));
    let cross = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let area = cross(p[0], p[1], p[2]);
    if area == 0.0 {
        return;
    }
    let normal = (corners[1].0 - corners[0].0).cross(&(corners[2].0 - corners[0].0));
    let Some(normal) = normal.try_normalize(0.0) else {
        return;
    };
    let normal = if normal.z < 0.0 { -normal } else { normal };
    let light = Vec3::new(-0.5, 0.65, 0.6).normalize();
    let bright = (0.42 + 0.58 * normal.dot(&light).max(0.0)) as f32;
    let range = |axis: usize| {
        let low = p
            .iter()
            .fold(f64::MAX, |m, q| m.min(q[axis]))
            .floor()
            .max(0.0);
        let high = p.iter().fold(0.0, |m: f64, q| m.max(q[axis])).ceil();
        low as usize..(high as usize + 1).min(size)
    };
    for y in range(1) {
        for x in range(0) {
            let q = [x as f64 + 0.5, y as f64 + 0.5];
            let w = [
                cross(q, p[1], p[2]) / area,
                cross(p[0], q, p[2]) / area,
                cross(p[0], p[1], q) / area,
            ];
            if w.iter().any(|w| *w < -1e-9) {
                continue;
            }
            let depth: f64 = (0..3).map(|i| w[i] * corners[i].0.z).sum();
            let sample = &mut seen[y * size + x];
            if depth > sample.depth {
                let share: f32 = (0..3).map(|i| w[i] as f32 * corners[i].1).sum();
                *sample = Seen {
                    depth,
                    colour: linear_colour(share).map(|c| c * bright),
                };
            }
        }
    }
}

/// A linear colour as bytes.
fn encoded(colour: [f32; 3]) -> Rgb888 {
    let [r, g, b] = colour.map(|c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8);
    Rgb888::new(r, g, b)
}

/// The axes outside the surface.
fn axes(canvas: &mut Canvas, [left, top]: [usize; 2], view: &Mat3, reach: impl Fn(Vec3) -> f64) {
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let unit = Vec3::ith(axis, 1.0);
        let on_page = |length: f64| {
            let [x, y] = placed(view * unit * length, SQUARE);
            [left + x.max(0.0) as usize, top + y.max(0.0) as usize]
        };
        let tip = 1.12;
        canvas.line(on_page(reach(unit).min(tip)), on_page(tip), INK);
        let [x, y] = on_page(tip + 0.04);
        canvas.title(x.saturating_sub(5), y.saturating_sub(10), name, INK);
    }
}

/// A bar of colours with its ends, and lines of text.
fn legend(canvas: &mut Canvas, [least, most]: [f64; 2], lines: &[String]) {
    let (left, top, height) = (MARGIN + SQUARE + 16, HEIGHT - SQUARE - MARGIN + 16, 220);
    canvas.text(left, top - 18, "Young's modulus", INK);
    for y in 0..height {
        let share = 1.0 - y as f32 / (height - 1) as f32;
        let colour = encoded(linear_colour(share));
        for x in 0..22 {
            canvas.pixel(left + x, top + y, Shade(colour));
        }
    }
    canvas.frame([left, top], [left + 22, top + height], PALE);
    for n in 0..=4 {
        let share = f64::from(n) / 4.0;
        let value = least + (most - least) * share;
        let y = top + ((1.0 - share) * (height - 1) as f64) as usize;
        canvas.text(left + 30, y.saturating_sub(6), &format!("{value:.5}"), INK);
    }
    for (n, line) in lines.iter().enumerate() {
        canvas.text(left, top + height + 24 + 20 * n, line, INK);
    }
}
