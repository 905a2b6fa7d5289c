//! A picture of Young's modulus by direction, as a surface whose radius is the modulus.
//!
//! The surface is rendered as triangles with a depth buffer and nine samples per pixel. The modulus sets
//! the colour; the picture includes the axes of the cell.

use super::canvas::{Canvas, GRID_COLOUR, Shade, TEXT_COLOUR};
use crate::frame::{Mat3, Vec3};
use crate::homogenize::{Voigt, directional_modulus};
use crate::polymesh::DepthBuffer;
use crate::vdb::{Image, linear_colour};
use embedded_graphics::pixelcolor::Rgb888;

/// Sizes in pixels: of the page, the square of the surface, and the margin.
const WIDTH: usize = 860;
const HEIGHT: usize = 640;
const SQUARE: usize = 560;
const MARGIN: usize = 24;
/// Samples along the edge of a pixel.
const SAMPLES_PER_EDGE: usize = 3;
/// Steps of the polar angle; the azimuth has twice as many.
const STEPS: usize = 160;
/// Greatest radius of the surface as a share of the edge of the square: the axes reach 1.16 times as far.
const RADIUS_SHARE: f64 = 0.42;

/// The picture of a compliance (the inverse of the stiffness, in Voigt's order), with lines of text beside it.
pub fn modulus_picture(compliance: &Voigt, title: &str, lines: &[String]) -> Image {
    let modulus = |n: Vec3| directional_modulus(compliance, n);
    let direction = |i: usize, j: usize| {
        let polar = std::f64::consts::PI * i as f64 / STEPS as f64;
        // 2 STEPS steps cover the full circle.
        let azimuth = std::f64::consts::PI * j as f64 / STEPS as f64;
        Vec3::new(
            polar.sin() * azimuth.cos(),
            polar.sin() * azimuth.sin(),
            polar.cos(),
        )
    };
    let values: Vec<Vec<f64>> = (0..=STEPS)
        .map(|i| (0..=2 * STEPS).map(|j| modulus(direction(i, j))).collect())
        .collect();
    let all = values.iter().flatten();
    let (min_modulus, max_modulus) = all.fold((f64::MAX, 0f64), |(l, m), v| (l.min(*v), m.max(*v)));
    // Nearly isotropic moduli get one colour.
    let span = (max_modulus - min_modulus).max(1e-3 * max_modulus);
    let share = |value: f64| ((value - min_modulus) / span) as f32;

    let view = view();
    let at = |i: usize, j: usize| view * direction(i, j) * (values[i][j] / max_modulus);
    let mut samples = DepthBuffer::new([SQUARE, SQUARE], SAMPLES_PER_EDGE);
    let mut colours = Vec::new();
    for i in 0..STEPS {
        for j in 0..2 * STEPS {
            let quad = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            for n in [1, 2] {
                let corners = [quad[0], quad[n], quad[n + 1]];
                let points = corners.map(|(i, j)| at(i, j));
                let mean = corners
                    .map(|(i, j)| share(values[i][j]))
                    .iter()
                    .sum::<f32>()
                    / 3.0;
                // Flat triangles at the poles have no normal, and cover no sample.
                let face = colours.len() as u32;
                colours.push(linear_colour(mean).map(|c| f64::from(c) * brightness(points)));
                samples.fill(points.map(on_samples), face);
            }
        }
    }
    let mut canvas = Canvas::new(WIDTH, HEIGHT);
    let (left, top) = (MARGIN, HEIGHT - SQUARE - MARGIN);
    let pixels = samples.pixels(|_, face| face.map_or([1.0; 3], |f| colours[f]));
    for (n, colour) in pixels.enumerate() {
        let at = [left + n % SQUARE, top + n / SQUARE];
        canvas.pixel(at[0], at[1], Shade(encoded(colour.map(|c| c as f32))));
    }
    axes(&mut canvas, [left, top], &view, |n: Vec3| {
        modulus(n) / max_modulus
    });
    canvas.title(MARGIN, 14, title, TEXT_COLOUR);
    legend(&mut canvas, [min_modulus, min_modulus + span], lines);
    canvas.image()
}

/// The rotation of the view. Rows: right, up, towards the viewer.
fn view() -> Mat3 {
    let towards = Vec3::new(1.0, 0.7, 0.65).normalize();
    let right = Vec3::z().cross(&towards).normalize();
    let up = towards.cross(&right);
    Mat3::from_rows(&[right.transpose(), up.transpose(), towards.transpose()])
}

/// The position on a square of `size` samples of a point in the view's axes, where the greatest modulus has length
/// 1.
fn on_square(p: Vec3, size: usize) -> [f64; 2] {
    let half = size as f64 / 2.0;
    let scale = RADIUS_SHARE * size as f64;
    [half + p.x * scale, half - p.y * scale]
}

/// The place of a point among the samples, and its nearness to the viewer, above 0.
fn on_samples(p: Vec3) -> [f64; 3] {
    let [x, y] = on_square(p, SQUARE * SAMPLES_PER_EDGE);
    [x, y, 2.0 + p.z]
}

/// The share of the light that a triangle (in the view's axes) sends to the viewer: 42 % from everywhere, the rest
/// from one lamp.
fn brightness([a, b, c]: [Vec3; 3]) -> f64 {
    let normal = (b - a)
        .cross(&(c - a))
        .try_normalize(0.0)
        .unwrap_or_default();
    let normal = if normal.z < 0.0 { -normal } else { normal };
    let light = Vec3::new(-0.5, 0.65, 0.6).normalize();
    0.42 + 0.58 * normal.dot(&light).max(0.0)
}

/// A linear colour as gamma-encoded bytes.
fn encoded(colour: [f32; 3]) -> Rgb888 {
    let [r, g, b] = colour.map(|c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8);
    Rgb888::new(r, g, b)
}

/// Draws the axes outside the surface, from the surface on. `reach` is the radius of the surface in a direction.
fn axes(canvas: &mut Canvas, [left, top]: [usize; 2], view: &Mat3, reach: impl Fn(Vec3) -> f64) {
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let unit = Vec3::ith(axis, 1.0);
        let on_page = |length: f64| {
            let [x, y] = on_square(view * unit * length, SQUARE);
            [left + x.max(0.0) as usize, top + y.max(0.0) as usize]
        };
        let tip = 1.12;
        canvas.line(on_page(reach(unit).min(tip)), on_page(tip), TEXT_COLOUR);
        let [x, y] = on_page(tip + 0.04);
        canvas.title(x.saturating_sub(5), y.saturating_sub(10), name, TEXT_COLOUR);
    }
}

/// Draws the colour bar between two moduli, 22 by 220 pixels with labels to the right, and lines of text below it.
fn legend(canvas: &mut Canvas, [min_modulus, max_modulus]: [f64; 2], lines: &[String]) {
    let (left, top, height) = (MARGIN + SQUARE + 16, HEIGHT - SQUARE - MARGIN + 16, 220);
    canvas.text(left, top - 18, "Young's modulus", TEXT_COLOUR);
    for y in 0..height {
        let share = 1.0 - y as f32 / (height - 1) as f32;
        let colour = encoded(linear_colour(share));
        for x in 0..22 {
            canvas.pixel(left + x, top + y, Shade(colour));
        }
    }
    canvas.frame([left, top], [left + 22, top + height], GRID_COLOUR);
    // Five labels in equal steps from the first to the second.
    for n in 0..=4 {
        let share = f64::from(n) / 4.0;
        let value = min_modulus + (max_modulus - min_modulus) * share;
        let y = top + ((1.0 - share) * (height - 1) as f64) as usize;
        canvas.text(
            left + 30,
            y.saturating_sub(6),
            &format!("{value:.5}"),
            TEXT_COLOUR,
        );
    }
    for (n, line) in lines.iter().enumerate() {
        canvas.text(left, top + height + 24 + 20 * n, line, TEXT_COLOUR);
    }
}
