//! Both steps of rule Q in a straight element, eight points at a time: the map is the same everywhere.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::sample_batch::{MOST, ROW, Row};
use crate::frame::{CellPoint, Vec3};
use crate::simd::{self, Eight, Lanes, Number, Work};
use crate::tiling::inverse_map::{dot, product};
use crate::tiling::local_map::Trail;
use crate::tiling::newton_distance::{Pace, to_world};

/// Points that walk in one element.
pub(super) struct Walk {
    /// Where they are.
    pub at: [CellPoint<3>; MOST],
    /// Value there, and gradient by reference coordinates.
    pub slopes: [[f32; 4]; MOST],
    pub len: usize,
    /// The first step, world units.
    way: [Row; 3],
    /// |F| at the start; 0 where that is a zero already.
    size: Row,
    /// The scale there; after the second step that of the walk.
    scale: Row,
}

impl Default for Walk {
    fn default() -> Self {
        let row = [[0.0; ROW]; MOST / ROW];
        Self {
            at: [CellPoint(Vec3::zeros()); MOST],
            slopes: [[0.0; 4]; MOST],
            len: 0,
            way: [row; 3],
            size: row,
            scale: row,
        }
    }
}

impl Walk {
    /// The first step: all points move to its end.
    pub fn set_off(&mut self, pace: Pace, map: &Trail) {
        simd::run(SetOff(pace, map, self));
    }

    /// The second step: the scales are found.
    pub fn arrive(&mut self, pace: Pace, map: &Trail) {
        simd::run(Arrive(pace, map, self));
    }

    /// Distance per field unit at the start of point `n`.
    pub fn scale(&self, n: usize) -> f64 {
        self.scale[n / ROW % (MOST / ROW)][n % ROW]
    }
}

struct SetOff<'a>(Pace, &'a Trail, &'a mut Walk);

struct Arrive<'a>(Pace, &'a Trail, &'a mut Walk);

/// Values and gradients of row `row`.
#[inline(always)]
fn slopes<L: Lanes>(
    lanes: L,
    all: &[[f32; 4]; MOST],
    row: usize,
) -> Option<(Eight<L>, [Eight<L>; 3])> {
    let [f, x, y, z] = lanes.by_row(all.as_chunks().0.get(row)?);
    let (x, y) = (Eight::singles_of(lanes, x), Eight::singles_of(lanes, y));
    let z = Eight::singles_of(lanes, z);
    Some((Eight::singles_of(lanes, f), [x, y, z]))
}

impl Work for SetOff<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(pace, map, walk) = self;
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let by = map.rows(zero);
        for row in 0..walk.len.div_ceil(ROW).min(MOST / ROW) {
            let Some((f, g)) = slopes(lanes, &walk.slopes, row) else {
                break;
            };
            let g = to_world(by, g);
            let square = dot(g, g, zero);
            let way = pace.step(f, g, square);
            let size = f.abs();
            walk.size[row] = size.below(zero.like(pace.zero), zero, size).row();
            walk.scale[row] = (square.sqrt() / (square + zero.like(pace.damping))).row();
            for (to, way) in walk.way.iter_mut().zip(way) {
                to[row] = way.row();
            }
            let Some(at) = walk.at.as_chunks_mut::<ROW>().0.get_mut(row) else {
                break;
            };
            let mut starts = [[0.0; 3]; ROW];
            for (to, at) in starts.iter_mut().zip(&*at) {
                *to = at.0.into();
            }
            let from = Eight::points(lanes, starts);
            let [x, y, z] = product(by, way, from);
            let (x, y, z) = (x.row(), y.row(), z.row());
            for (n, at) in at.iter_mut().enumerate() {
                at.0 = Vec3::new(x[n], y[n], z[n]);
            }
        }
    }
}

impl Work for Arrive<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self(pace, map, walk) = self;
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let by = map.rows(zero);
        let [least, most] = pace.scales;
        for row in 0..walk.len.div_ceil(ROW).min(MOST / ROW) {
            let Some((f, g)) = slopes(lanes, &walk.slopes, row) else {
                break;
            };
            let g = to_world(by, g);
            let [x, y, z] = pace.step(f, g, dot(g, g, zero));
            let way = [
                Eight::of(lanes, &walk.way[0][row]) + x,
                Eight::of(lanes, &walk.way[1][row]) + y,
                Eight::of(lanes, &walk.way[2][row]) + z,
            ];
            let size = Eight::of(lanes, &walk.size[row]);
            let scale = dot(way, way, zero).sqrt() / size;
            let scale = zero.below(size, scale, Eight::of(lanes, &walk.scale[row]));
            walk.scale[row] = scale.min(zero.like(most)).max(zero.like(least)).row();
        }
    }
}
