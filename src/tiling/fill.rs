//! The tiling's values in bulk: what can be decided for small boxes is not asked of samples.

use super::near::{Known, Local};
use super::{Filling, TiledSolid};
use crate::field::{Field, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// Samples along the edge of the boxes that are decided as a whole.
const PART: usize = 4;

impl<F: Filling> TiledSolid<'_, F> {
    /// Values on a lattice, over all components.
    pub(super) fn fill_all(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let w = self.options.half_width;
        if !self.is_cut() && self.components.len() > 1 {
            for (n, v) in out.iter_mut().enumerate() {
                *v = self.value(lattice.point(n)) as f32;
            }
            return;
        }
        if lattice.is_empty() {
            return;
        }
        let span = lattice.span();
        let reaches = |c: &usize| {
            let bounds = self.components[*c].boundary.bounds();
            !self.is_cut() || bounds.dilated(w).meets(span)
        };
        let mut scratch = Vec::new();
        out.fill(w as f32);
        for component in (0..self.components.len()).filter(reaches) {
            scratch.clear();
            scratch.resize(out.len(), w as f32);
            self.fill_one(component, lattice, &mut scratch);
            for (o, &v) in out.iter_mut().zip(&scratch) {
                *o = o.min(v);
            }
        }
    }

    /// Values of one component, its boundary included.
    fn fill_one(&self, component: usize, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let w = self.options.half_width;
        let span = lattice.span();
        let whole_depth = self.boundary_range(component, &span);
        if self.is_cut() && whole_depth.lo >= w {
            out.fill(w as f32);
            return;
        }
        let reached = span.dilated(self.reach(whole_depth.hi));
        let wide = self.near(component, &reached, self.margin());
        let mut local = Local::empty();
        for part in parts(lattice) {
            let region = part.span(lattice);
            let depth = if whole_depth.hi <= -w {
                whole_depth
            } else {
                self.boundary_range(component, &region)
            };
            let mut known = Known {
                constant: None,
                is_deep: depth.hi <= -w,
                distance: depth.hi.abs().max(depth.lo.abs()),
            };
            let region = region.dilated(self.reach(depth.hi.min(whole_depth.hi)));
            self.narrow(&wide, &region, &mut local);
            let range = self
                .field_range(&local.near, &region)
                .map(|f| self.distance_range(component, &local.near, &region, f));
            if let Some(d) = range {
                known.constant = [w, -w]
                    .into_iter()
                    .find(|&c| (c > 0.0 && d.lo >= c) || (c < 0.0 && d.hi <= c));
            }
            let whole = match known.constant {
                _ if self.is_cut() && depth.lo >= w => Some(w),
                Some(c) if c > 0.0 || known.is_deep || !self.is_cut() => Some(c),
                _ => None,
            };
            for n in part.indices(lattice) {
                out[n] = whole.unwrap_or_else(|| {
                    let x = lattice.point(n).0;
                    self.value_at(component, &mut local, x, known)
                }) as f32;
            }
        }
    }
}

/// A box of at most 4^3 samples of a lattice, by indices.
struct PartOfLattice {
    first: [usize; 3],
    last: [usize; 3],
}

impl PartOfLattice {
    fn span(&self, lattice: &SampleLattice<WorldPoint>) -> Aabb {
        let at = |i: [usize; 3]| -> Vec3 {
            let [_, ny, nz] = lattice.counts;
            lattice.point((i[0] * ny + i[1]) * nz + i[2]).0
        };
        Aabb {
            min: at(self.first),
            max: at(self.last),
        }
    }

    /// Storage indices of the part's samples, z fastest.
    fn indices(&self, lattice: &SampleLattice<WorldPoint>) -> impl Iterator<Item = usize> + use<> {
        let [_, ny, nz] = lattice.counts;
        let (first, last) = (self.first, self.last);
        (first[0]..=last[0]).flat_map(move |i| {
            (first[1]..=last[1]).flat_map(move |j| {
                let row = (i * ny + j) * nz;
                row + first[2]..=row + last[2]
            })
        })
    }
}

/// The parts of a lattice, in storage order.
fn parts(lattice: &SampleLattice<WorldPoint>) -> impl Iterator<Item = PartOfLattice> {
    let counts = lattice.counts;
    let [nx, ny, nz] = counts.map(|c| c.div_ceil(PART));
    (0..nx * ny * nz).map(move |n| {
        let first = [n / (ny * nz), n / nz % ny, n % nz].map(|i| i * PART);
        let last = [0, 1, 2].map(|a| (first[a] + PART).min(counts[a]) - 1);
        PartOfLattice { first, last }
    })
}
