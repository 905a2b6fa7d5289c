//! Leaves by nodes: where an element is so large that its field is smooth over a leaf, the cell is asked at
//! a few nodes, and a polynomial through them says the rest.
//!
//! The nodes of a leaf are those of Chebyshev along each axis, 4^3 or 6^3 of them; values at its 8^3 samples,
//! and first and second derivatives, are products of small matrices. From these rule Q takes both its steps:
//! the second one starts where the first ends, to which the field is continued to the second order.
//!
//! Whether a leaf may be told so is found by trying: the polynomial is compared with the cell at samples
//! where it errs most, the leaf's corners among them. What is folded, a sheet about the zeros of a function, is
//! told by that function.

mod leaf;
mod matrices;

use super::locality::Near;
use super::patch::{Search, Spots};
use super::{Distance, Filling, TiledSolid};
use crate::field::{Interval, Point, SampleLattice};
use crate::frame::{CellPoint, Vec3, WorldPoint};
use leaf::{Rule, Told, tell};
use matrices::{MOST, Matrices};

/// Samples along a leaf's edge.
const EDGE: usize = 8;
/// Samples of a leaf.
const VOLUME: usize = EDGE * EDGE * EDGE;
/// How much of its shortest wave a field may go through along a leaf's edge: beyond this, nodes could miss what
/// lies between them, and second derivatives do not reach as far as a step.
const WITHIN: f64 = 0.7;
/// From here on, few nodes hardly ever do.
const MUCH: f64 = 0.3;
/// More nodes may do where few miss the tolerance by no more than so many times.
const HOPE: f64 = 64.0;
/// Along each axis, samples at which the polynomial is compared with the cell: its ends, and between.
const TRIED: [[usize; 2]; 2] = [[0, 7], [1, 5]];

/// Room for the work, kept between leaves.
#[derive(Default)]
pub(super) struct Nodes {
    at: Vec<Vec3>,
    points: Vec<CellPoint<3>>,
    values: Vec<f64>,
    spots: Spots,
    told: Told,
    /// At how many points a cell was looked at.
    pub looked: u64,
}

/// Storage indices of the samples that are tried.
fn trials() -> impl Iterator<Item = [usize; 3]> {
    TRIED
        .into_iter()
        .flat_map(|ends| (0..8).map(move |n| [ends[n >> 2 & 1], ends[n >> 1 & 1], ends[n & 1]]))
}

impl<F: Filling> TiledSolid<'_, F> {
    /// Distances of a leaf that lies in one element, deeper under the boundary than the band reaches, if
    /// nodes tell them within the tolerance; `near` are the elements less than a voxel away.
    pub(super) fn fill_by_nodes(
        &self,
        (near, depth): (&Near, Interval),
        lattice: &SampleLattice<WorldPoint>,
        room: &mut Nodes,
        out: &mut [f32],
    ) -> bool {
        let w = self.options.half_width;
        let (&[number], Some(tolerance)) = (&*near.patches, self.nodes) else {
            return false;
        };
        let Ok(out) = <&mut [f32; VOLUME]>::try_from(out) else {
            return false;
        };
        if lattice.counts != [EDGE; 3] || self.options.distance == Distance::Exact || depth.hi > -w
        {
            return false;
        }
        let patch = &self.patches[number as usize];
        let across = (EDGE - 1) as f64 * lattice.step * patch.finest();
        let Some(smooth) = self.filling.smooth(number as usize) else {
            return false;
        };
        let waves = across * smooth.frequency;
        if waves > WITHIN {
            return false;
        }
        let pace = self.pace(patch);
        let rule = Rule::new((pace, patch.slope_sup), smooth.fold, w, lattice.step);
        let allowed = tolerance * patch.slope_rms;
        let first = usize::from(waves > MUCH);
        for matrices in &Matrices::all()[first..] {
            let Some(missed) = self.try_nodes(number, lattice, (matrices, &rule), room) else {
                return false;
            };
            if missed <= allowed {
                if let Some(visits) = self.visits {
                    visits.enter_leaf();
                }
                *out = room.told.distances;
                return true;
            }
            if missed > HOPE * allowed {
                return false;
            }
        }
        false
    }

    /// Tells a leaf by so many nodes; gives the greatest difference to the field itself where that was tried,
    /// unless some node lies in no element, or the field bends too much for its distances to be told.
    fn try_nodes(
        &self,
        number: u32,
        lattice: &SampleLattice<WorldPoint>,
        (matrices, rule): (&Matrices, &Rule),
        room: &mut Nodes,
    ) -> Option<f64> {
        let Nodes {
            at,
            points,
            values,
            spots,
            told,
            looked,
        } = room;
        at.clear();
        let along = |axis: usize, steps: f64| lattice.origin.0[axis] + steps * lattice.step;
        let places = &matrices.at[..matrices.count];
        for &i in places {
            for &j in places {
                let (x, y) = (along(0, i), along(1, j));
                at.extend(places.iter().map(|&k| Vec3::new(x, y, along(2, k))));
            }
        }
        let count = at.len();
        at.extend(trials().map(|n| lattice.origin.stepped(lattice.step, n).0));
        let patch = &self.patches[number as usize];
        points.clear();
        let mut trail = patch.start();
        if patch.is_affine() {
            trail.guess_all(at, points);
        } else {
            let centre = lattice.span().centre().0;
            let first = patch.spot(self.scaffold, centre, f64::INFINITY, Search::default())?;
            trail = patch.trail(self.scaffold, centre, &first);
            patch.spots(
                self.scaffold,
                (at, f64::INFINITY),
                (&mut trail, true),
                spots,
            );
            for spot in &spots.all {
                points.push(CellPoint(spot.as_ref().filter(|s| s.beyond <= 0.0)?.xi));
            }
        }
        values.resize(points.len(), 0.0);
        let (nodes, tried) = points.split_at(count);
        let (own, found) = values.split_at_mut(count);
        self.filling.smooth_values(number as usize, nodes, own);
        self.filling.values(number as usize, tried, found);
        *looked += points.len() as u64;
        let mut singles = [0.0; MOST * MOST * MOST];
        for (to, v) in singles.iter_mut().zip(own) {
            *to = *v as f32;
        }
        if !tell(matrices, &singles, rule, told) {
            return None;
        }
        let missed = trials().zip(found).map(|([i, j, k], v)| {
            let told = told.values[(i * EDGE + j) * EDGE + k];
            (f64::from(told) - *v).abs()
        });
        Some(missed.fold(0.0, f64::max))
    }
}
