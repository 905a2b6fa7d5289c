//! Layers of a solid: outlines and images of plane sections of a field, for printers.
//!
//! A layer of height t that begins at z is cut at its middle, z + t / 2. Its outline is computed on a square
//! grid of samples (marching squares, linear along each edge; if two opposite corners of a square are inside,
//! the mean of the four corners decides). Its image has the coverage of each pixel, estimated from value and
//! slope of the field there.
//!
//! The plane's axes (u, v) and the axis of the layers are right-handed: along z they are (x, y), along x
//! (y, z), along y (z, x). Outlines are counter-clockwise around the solid and clockwise around its holes.
//! Row 0 of an image is at the largest v. Not promised: walls and gaps thinner than a pixel may be lost, and nothing is
//! compensated for the width of a beam or the growth of resin.

use druse_geometry::field::{SampleLattice, WorldField};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use std::collections::HashMap;

mod formats;
pub use formats::{cli_head, cli_layer, cli_tail, grey_png, svg_head, svg_layer, svg_tail};

/// The planes and the pixel grid of the layers of a solid.
///
/// ```
/// # mod druse { pub use druse_geometry::*; pub use druse_solids::*; }
/// use druse::field::Sphere;
/// use druse::frame::{Aabb, Vec3};
/// use druse::slice::Plan;
/// let ball = Sphere { centre: Vec3::zeros(), radius: 5.0 };
/// let bounds = Aabb { min: Vec3::repeat(-5.0), max: Vec3::repeat(5.0) };
/// let plan = Plan::new(bounds, 2, 0.25, 0.25).unwrap();
/// let volume: f64 = (0..plan.layers()).map(|n| plan.layer(&ball, n).area() * 0.25).sum();
/// assert!((volume / 523.6 - 1.0).abs() < 0.005);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Axis of the layers: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Height of a layer, world units.
    pub height: f64,
    /// Edge of a pixel, world units.
    pub pixel: f64,
    /// Lower end of the first layer along the axis.
    pub start: f64,
    /// Smallest u and v of the plane: the outer corner of the first pixel.
    pub corner: [f64; 2],
    /// Pixels along u and v.
    pub pixels: [usize; 2],
    layers: usize,
}

/// Why a plan of layers is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A length that is not positive and finite.
    #[error("{what} is {value}; expected a positive, finite length")]
    Length {
        /// Name of the length.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Too many pixels or layers.
    #[error(
        "layers of {pixels:?} pixels, {layers} of them; expected at most 32768 pixels a side and 1000000 layers: take larger pixels or layers"
    )]
    TooMany {
        /// Pixels along u and v.
        pixels: [f64; 2],
        /// Layers.
        layers: f64,
    },
}

/// A plane section: values of the field on a square grid.
pub struct Layer {
    /// Coordinate of the plane along the axis, world units.
    pub at: f64,
    values: Vec<f32>,
    counts: [usize; 2],
    corner: [f64; 2],
    pixel: f64,
}

/// A closed outline in the plane, counter-clockwise around solid, clockwise around a hole. The first point is
/// not repeated at the end.
pub type Outline = Vec<[f64; 2]>;

impl Plan {
    /// A plan for the given box, world units, with one pixel of margin.
    ///
    /// # Errors
    /// [`PlanError`]: a length that is not positive and finite, more than 32,768 pixels along an axis, or more than a
    /// million layers.
    pub fn new(bounds: Aabb, axis: usize, height: f64, pixel: f64) -> Result<Self, PlanError> {
        for (what, value) in [
            ("the height of a layer", height),
            ("the edge of a pixel", pixel),
            ("the least extent of the solid", bounds.size().min()),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(PlanError::Length { what, value });
            }
        }
        let axes = [(axis + 1) % 3, (axis + 2) % 3];
        let size = bounds.size();
        let pixels = axes.map(|a| (size[a] / pixel).ceil() + 2.0);
        // The tolerance prevents rounding from adding an empty layer.
        let layers = (size[axis] / height - 1e-9).ceil().max(1.0);
        if pixels.iter().any(|&p| p > 32768.0) || layers > 1e6 {
            return Err(PlanError::TooMany { pixels, layers });
        }
        let pixels_used = pixels.map(|p| p as usize);
        let centre = bounds.centre().0;
        Ok(Self {
            axis,
            height,
            pixel,
            start: bounds.min[axis],
            corner: [0, 1].map(|k| centre[axes[k]] - pixels[k] * pixel / 2.0),
            pixels: pixels_used,
            layers: layers as usize,
        })
    }

    /// Number of layers.
    pub fn layers(&self) -> usize {
        self.layers
    }

    /// The lower end of layer `n` along the axis.
    pub fn bottom(&self, n: usize) -> f64 {
        self.start + n as f64 * self.height
    }

    /// The section of a field through the middle of layer `n`, sampled at the centres of the pixels. Values are in
    /// world units, v fastest. Far from the surface only their sign is exact.
    pub fn layer(&self, field: &WorldField, n: usize) -> Layer {
        let at = self.bottom(n) + self.height / 2.0;
        let axes = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let mut origin = Vec3::zeros();
        origin[self.axis] = at;
        let mut counts = [1; 3];
        for k in 0..2 {
            origin[axes[k]] = self.corner[k] + self.pixel / 2.0;
            counts[axes[k]] = self.pixels[k];
        }
        let mut raw = vec![0.0; self.pixels[0] * self.pixels[1]];
        // Fields cull well in small boxes, so the section is filled in squares.
        self.fill(field, origin, counts, &mut raw);
        // The storage order of the lattice is x, y, z; here u is slow and v is fast.
        let values = if axes[0] < axes[1] {
            raw
        } else {
            let [nu, nv] = self.pixels;
            (0..nu * nv).map(|n| raw[n % nv * nu + n / nv]).collect()
        };
        Layer {
            at,
            values,
            counts: self.pixels,
            corner: self.corner,
            pixel: self.pixel,
        }
    }

    /// Samples a lattice of pixels in squares. Those that lie more than two pixels from the surface are skipped: all
    /// their values are one bound. `counts` is 1 along the axis of the section, `origin` the first pixel's centre.
    fn fill(&self, field: &WorldField, origin: Vec3, counts: [usize; 3], out: &mut [f32]) {
        /// Pixels along the edge of a square: small enough to miss the surface, large enough to share a bound.
        const EDGE: usize = 16;
        let slow = (0..3).find(|&a| counts[a] > 1).unwrap_or(0);
        let fast = (0..3).rev().find(|&a| counts[a] > 1).unwrap_or(2);
        let row = counts[fast];
        for first in (0..counts[slow]).step_by(EDGE) {
            let rows = EDGE.min(counts[slow] - first);
            for start in (0..row).step_by(EDGE) {
                let columns = EDGE.min(row - start);
                let mut part = [1; 3];
                let mut corner = origin;
                part[slow] = rows;
                part[fast] = columns;
                corner[slow] += first as f64 * self.pixel;
                corner[fast] += start as f64 * self.pixel;
                let lattice = SampleLattice {
                    origin: WorldPoint(corner),
                    step: self.pixel,
                    counts: part,
                };
                let mut tile = vec![0.0; lattice.len()];
                let bound = field.bound(&lattice.span());
                // Beyond two pixels from the surface only the sign matters: shares and outlines take the values of
                // neighbouring pixels.
                if bound.lo > 2.0 * self.pixel || bound.hi < -2.0 * self.pixel {
                    let value = if bound.lo > 0.0 { bound.lo } else { bound.hi };
                    tile.fill(value as f32);
                } else {
                    field.fill(&lattice, &mut tile);
                }
                for (r, line) in tile.chunks_exact(columns).enumerate() {
                    let at = (first + r) * row + start;
                    out[at..at + columns].copy_from_slice(line);
                }
            }
        }
    }
}

/// An edge of the grid of samples.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct LatticeEdge {
    /// Number of its first sample.
    sample: usize,
    /// 0 along u, 1 along v.
    along: usize,
}

impl Layer {
    fn value(&self, i: usize, j: usize) -> f64 {
        f64::from(self.values[i * self.counts[1] + j])
    }

    /// The share of each pixel inside the solid, 0 to 255. Rows go from the largest v down, with u along a row.
    pub fn coverage(&self) -> Vec<u8> {
        let [nu, nv] = self.counts;
        let mut shares = Vec::with_capacity(nu * nv);
        for j in (0..nv).rev() {
            for i in 0..nu {
                let across = |a: f64, b: f64, n: f64| (b - a) / (n * self.pixel).max(1e-300);
                let [i0, i1] = [i.saturating_sub(1), (i + 1).min(nu - 1)];
                let [j0, j1] = [j.saturating_sub(1), (j + 1).min(nv - 1)];
                let gu = across(self.value(i0, j), self.value(i1, j), (i1 - i0) as f64);
                let gv = across(self.value(i, j0), self.value(i, j1), (j1 - j0) as f64);
                // The change of the value over the pixel (1e-3 where it is flat); a plan of one pixel has no neighbours.
                let reach = (gu.abs() + gv.abs()).max(1e-3) * self.pixel;
                let share = (0.5 - self.value(i, j) / reach).clamp(0.0, 1.0);
                shares.push((share * 255.0).round() as u8);
            }
        }
        shares
    }

    /// The area inside the outlines, world units squared.
    pub fn area(&self) -> f64 {
        self.outlines().iter().map(|o| signed_area(o)).sum()
    }

    /// The outlines, ordered by the square of their first point. Each is closed, in world units; chains that leave the
    /// grid or have fewer than three points are dropped.
    pub fn outlines(&self) -> Vec<Outline> {
        let [nu, nv] = self.counts;
        // The next edge of each edge.
        let mut next: HashMap<LatticeEdge, LatticeEdge> = HashMap::new();
        let mut starts = Vec::new();
        for i in 0..nu.saturating_sub(1) {
            for j in 0..nv.saturating_sub(1) {
                for (from, to) in self.segments(i, j) {
                    next.insert(from, to);
                    starts.push(from);
                }
            }
        }
        let mut outlines = Vec::new();
        for start in starts {
            let mut outline = Vec::new();
            let mut edge = start;
            // Each edge has one successor; a chain that ends at the border of the grid is no outline.
            while let Some(to) = next.remove(&edge) {
                outline.push(self.crossing(edge));
                edge = to;
            }
            if outline.len() > 2 && edge == start {
                outlines.push(outline);
            }
        }
        outlines
    }

    /// The segments of outline in a square, with the solid on their left. (i, j) is the square's first sample, along u
    /// and v.
    fn segments(&self, i: usize, j: usize) -> Vec<(LatticeEdge, LatticeEdge)> {
        let nv = self.counts[1];
        let edge = |i: usize, j: usize, along: usize| LatticeEdge {
            sample: i * nv + j,
            along,
        };
        let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        let values = corners.map(|(i, j)| self.value(i, j));
        let inside = values.map(|v| v < 0.0);
        // Edge k runs from corner k to corner k + 1, counter-clockwise.
        let edges = [
            edge(i, j, 0),
            edge(i + 1, j, 1),
            edge(i, j + 1, 0),
            edge(i, j, 1),
        ];
        // A segment begins at an edge from inside to outside, in counter-clockwise order, and ends at an
        // edge from outside to inside. The solid is therefore on its left.
        let out = |k: usize| inside[k] && !inside[(k + 1) % 4];
        let into = |k: usize| !inside[k] && inside[(k + 1) % 4];
        let leaving: Vec<usize> = (0..4).filter(|&k| out(k)).collect();
        let entering: Vec<usize> = (0..4).filter(|&k| into(k)).collect();
        match (&leaving[..], &entering[..]) {
            ([a], [b]) => vec![(edges[*a], edges[*b])],
            ([a, b], [_, _]) => {
                let joined = values.iter().sum::<f64>() < 0.0;
                let pair = |k: usize| {
                    // Connected: around the outside corner that follows; separate: around the inside corner before.
                    let to = if joined { (k + 1) % 4 } else { (k + 3) % 4 };
                    (edges[k], edges[to])
                };
                vec![pair(*a), pair(*b)]
            }
            _ => Vec::new(),
        }
    }

    /// The zero of the field along an edge.
    fn crossing(&self, LatticeEdge { sample, along }: LatticeEdge) -> [f64; 2] {
        let (i, j) = (sample / self.counts[1], sample % self.counts[1]);
        let a = self.value(i, j);
        let b = if along == 0 {
            self.value(i + 1, j)
        } else {
            self.value(i, j + 1)
        };
        let t = if a == b {
            0.5
        } else {
            (a / (a - b)).clamp(0.0, 1.0)
        };
        let mut p = [i as f64 + 0.5, j as f64 + 0.5];
        p[along] += t;
        [0, 1].map(|k| self.corner[k] + p[k] * self.pixel)
    }
}

/// Signed area of an outline, positive if counter-clockwise.
pub fn signed_area(outline: &[[f64; 2]]) -> f64 {
    let pairs = outline.iter().zip(outline.iter().cycle().skip(1));
    pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
}
