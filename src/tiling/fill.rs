//! The tiling's values in bulk: what can be decided for small boxes is not asked of samples.

use super::near::Local;
use super::{CellField, TiledSolid};
use crate::field::{Field, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// Samples along the edge of the boxes that are decided as a whole.
const PART: usize = 4;

impl<C: CellField> TiledSolid<'_, C> {
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
        let boundary = &self.components[component].boundary;
        let span = lattice.span();
        let depth = boundary.bound(&span);
        if self.is_cut() && depth.lo >= w {
            out.fill(w as f32);
            return;
        }
        let reach = self.reach(depth.hi);
        let mut local = Local::new(self.near(component, &span.dilated(reach), self.margin()));
        // Signed distances to the boundary, where they can exceed -w.
        let mut depths = vec![-w as f32; out.len()];
        if self.is_cut() && depth.hi > -w {
            boundary.fill(lattice, &mut depths);
        }
        let mut samples = Vec::with_capacity(PART * PART * PART);
        for part in parts(lattice) {
            part.indices(lattice, &mut samples);
            let highest = if self.is_cut() && depth.hi > -w {
                samples
                    .iter()
                    .map(|&n| f64::from(depths[n]))
                    .fold(f64::NEG_INFINITY, f64::max)
            } else {
                depth.hi
            };
            let box_of_part = part.span(lattice).dilated(self.reach(highest));
            let whole = self
                .field_range(&local.near, &box_of_part)
                .map(|f| self.distance_range(component, &local.near, &box_of_part, f));
            let constant = match whole {
                Some(d) if d.lo >= w => Some(w),
                Some(d) if d.hi <= -w => Some(-w),
                _ => None,
            };
            for &n in &samples {
                let outside = f64::from(depths[n]);
                let d = if outside >= w {
                    w
                } else if let Some(d) = constant {
                    d
                } else {
                    let x = lattice.point(n).0;
                    match self.owner(&mut local, x) {
                        Some(at) => self.distance(&local, at, x),
                        None => self.continued(component, Some(&mut local), x),
                    }
                };
                out[n] = d.max(outside).clamp(-w, w) as f32;
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
    fn indices(&self, lattice: &SampleLattice<WorldPoint>, out: &mut Vec<usize>) {
        let [_, ny, nz] = lattice.counts;
        out.clear();
        for i in self.first[0]..=self.last[0] {
            for j in self.first[1]..=self.last[1] {
                let row = (i * ny + j) * nz;
                out.extend(row + self.first[2]..=row + self.last[2]);
            }
        }
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
