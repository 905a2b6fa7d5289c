//! Bulk evaluation of a tiling by components: bounds decide whole boxes, an evaluator is chosen for the others.

use super::batched::BatchBuffers;
use super::boundary::{RegionFacts, within_band};
use super::interpolated::InterpolationBuffers;
use super::locality::{LocalSearch, NearElements};
use super::{Distance, TiledSolid};
use druse_geometry::field::{Field, Interval, LeafBits, Leaves, SampleLattice, ValueLimits};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use std::cell::Cell;

/// Samples along the edge of a part: a box that bounds may decide as a whole.
const PART_EDGE: usize = 4;

/// Samples to evaluate, and what is needed of their values.
pub(super) struct FillRequest<'a> {
    pub lattice: &'a SampleLattice<WorldPoint>,
    /// Without limits all values in the band are needed.
    pub limits: Option<&'a ValueLimits>,
}

impl FillRequest<'_> {
    /// The distances that the samples of a part need exactly, within a band of half width `w`; `None` if none is needed.
    pub fn wanted_in(&self, part: &PartOfLattice, w: f64) -> Option<Interval> {
        self.wanted(|limits| limits.hull(part.indices(self.lattice)), w)
    }

    /// [`Self::wanted_in`] of all samples.
    fn wanted_in_all(&self, w: f64) -> Option<Interval> {
        self.wanted(ValueLimits::hull_of_all, w)
    }

    fn wanted(
        &self,
        hull: impl FnOnce(&ValueLimits) -> Option<[f32; 2]>,
        w: f64,
    ) -> Option<Interval> {
        let band = Interval::new(-w, w);
        match self.limits {
            Some(limits) => hull(limits).map(|ends| within_band(ends, band)),
            None => Some(band),
        }
    }
}

/// Buffers that a thread reuses from lattice to lattice.
#[derive(Default)]
struct Scratch {
    values: Vec<f32>,
    /// Elements near the lattice, and near a part of it.
    near: NearElements,
    local: LocalSearch,
    batches: BatchBuffers,
    interpolation: InterpolationBuffers,
    /// Number of samples evaluated as single points.
    single_evaluations: u64,
    /// Boundary triangles near the lattice, and near a part of it.
    boundary_triangles: Vec<u32>,
    part_triangles: Vec<u32>,
}

thread_local! {
    static SCRATCH: Cell<Option<Box<Scratch>>> = Cell::default();
}

/// Runs `work` with the thread's buffers for batches of points.
pub(super) fn with_batch_buffers<T>(work: impl FnOnce(&mut BatchBuffers) -> T) -> T {
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let found = work(&mut scratch.batches);
    SCRATCH.set(Some(scratch));
    found
}

impl TiledSolid<'_> {
    /// Fills leaves one by one, and proves the signs of those deep in the scaffold where possible. Returns the
    /// number of cell evaluations; `None` if the surface is to be moved.
    pub(super) fn fill_leaves_separately(
        &self,
        leaves: &mut Leaves<'_, WorldPoint>,
    ) -> Option<u64> {
        if leaves.by != 0.0 {
            return None;
        }
        // Up to single precision.
        let within = self.options.half_width * (1.0 - 1e-6);
        let mut evaluations = 0;
        let mut kept = 0;
        for (&origin, bits) in leaves.origins.iter().zip(leaves.bits.iter_mut()) {
            let values = leaves.values.get_mut(kept)?;
            let lattice = SampleLattice {
                origin,
                step: leaves.step,
                counts: [8; 3],
            };
            let request = FillRequest {
                lattice: &lattice,
                limits: None,
            };
            let (own, signs_proved) = self.fill_all(&request, values);
            evaluations += own;
            *bits = LeafBits {
                settled: signs_proved && f64::from(leaves.background) >= within,
                ..LeafBits::from_values(values, leaves.background)
            };
            kept += usize::from(!bits.is_out());
        }
        Some(evaluations)
    }

    /// Values on a lattice over all components. Returns the number of cell evaluations, and whether it is proved
    /// that samples at least the half width from the surface have the sign of their neighbours.
    pub(super) fn fill_all(&self, request: &FillRequest, out: &mut [f32]) -> (u64, bool) {
        let FillRequest { lattice, limits } = *request;
        let w = self.options.half_width;
        // Continued without a cut, each component has a value everywhere: single points choose between them.
        if !self.is_cut() && self.components.len() > 1 {
            for component in 0..self.components.len() {
                self.record(&self.near(component, &lattice.span(), self.margin()));
            }
            let mut evaluations = 0;
            for (n, v) in out.iter_mut().enumerate() {
                if limits.is_none_or(|l| l.is_needed(n)) {
                    *v = self.value(lattice.point(n)) as f32;
                    evaluations += 1;
                }
            }
            return (evaluations, false);
        }
        if lattice.is_empty() {
            return (0, false);
        }
        let span = lattice.span();
        let reaches = |c: &usize| {
            let bounds = self.components[*c].boundary.bounds();
            !self.is_cut() || bounds.dilated(w).meets(span)
        };
        let mut scratch = SCRATCH.take().unwrap_or_default();
        scratch.single_evaluations = 0;
        scratch.batches.evaluations = 0;
        scratch.interpolation.evaluations = 0;
        out.fill(w as f32);
        let (mut is_first, mut signs_proved) = (true, true);
        for component in (0..self.components.len()).filter(reaches) {
            if is_first {
                signs_proved &= self.fill_component(component, request, &mut scratch, out);
                is_first = false;
                continue;
            }
            // Components are united: the least value counts.
            let mut values = std::mem::take(&mut scratch.values);
            values.clear();
            values.resize(out.len(), w as f32);
            signs_proved &= self.fill_component(component, request, &mut scratch, &mut values);
            for (o, &v) in out.iter_mut().zip(&values) {
                *o = o.min(v);
            }
            scratch.values = values;
        }
        let evaluations = scratch.single_evaluations
            + scratch.batches.evaluations
            + scratch.interpolation.evaluations;
        SCRATCH.set(Some(scratch));
        (evaluations, signs_proved && !is_first)
    }

    /// Records elements as visited, if requested.
    fn record(&self, near: &NearElements) {
        if let Some(visits) = self.visits {
            near.patches.iter().for_each(|&e| visits.insert(e as usize));
        }
    }

    /// Values of one component, cut at its boundary. Returns whether it is proved that samples out of the band
    /// have the sign of their neighbours.
    fn fill_component(
        &self,
        component: usize,
        request: &FillRequest,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) -> bool {
        let FillRequest { lattice, limits } = *request;
        let w = self.options.half_width;
        let Some(wanted) = request.wanted_in_all(w) else {
            return false;
        };
        let Scratch {
            near,
            local,
            batches,
            interpolation,
            single_evaluations,
            boundary_triangles,
            part_triangles,
            ..
        } = scratch;
        let span = lattice.span();
        boundary_triangles.clear();
        // Without boundary triangles in reach, only elements near the lattice matter.
        let mut reach = 0.0;
        if self.is_cut() {
            self.find_boundary_triangles(component, &span, boundary_triangles);
            if !boundary_triangles.is_empty() {
                reach = self.boundary_reach();
            }
        }
        self.find_near(component, &span.dilated(reach), self.margin(), near);
        let boundary_triangles = self.is_cut().then_some(&**boundary_triangles);
        // Bounds of the signed distance to the boundary, negative inside: a deep part lies at most `deep_distance` from it,
        // where the boundary has no effect.
        let mut known_side = None;
        let whole_depth = self.boundary_range(
            component,
            &span,
            Interval::REAL_LINE,
            boundary_triangles,
            &near.patches,
            &mut known_side,
        );
        if self.is_cut() && whole_depth.lo >= wanted.hi {
            out.fill(w as f32);
            return false;
        }
        if !self.is_cut() {
            let reached = span.dilated(self.continuation_reach(whole_depth.hi));
            self.find_near(component, &reached, self.margin(), near);
        }
        let near = &*near;
        self.record(near);
        if self.fill_interpolated((near, whole_depth), lattice, interpolation, out) {
            return false;
        }
        if self.options.distance == Distance::Fast {
            let boundary = (whole_depth, boundary_triangles);
            batches.known_side = known_side;
            self.fill_batched(component, near, request, boundary, batches, out);
            return batches.are_signs_proved();
        }
        // Rule R, point by point.
        for part in parts(lattice) {
            let Some(wanted) = request.wanted_in(&part, w) else {
                continue;
            };
            let region = part.span(lattice);
            let deep_distance = self.deep_distance(wanted);
            let depth = if whole_depth.hi <= deep_distance {
                whole_depth
            } else {
                self.boundary_range(
                    component,
                    &region,
                    whole_depth,
                    boundary_triangles,
                    &[],
                    &mut known_side,
                )
            };
            let is_deep = depth.hi <= deep_distance;
            part_triangles.clear();
            if let Some(all) = boundary_triangles.filter(|_| !is_deep) {
                // A short list is compared with each sample triangle by triangle.
                let boundary = &self.components[component].boundary;
                boundary.collect_among(all, &region, self.boundary_reach(), part_triangles);
            }
            let mut known = RegionFacts {
                field_distance: None,
                is_deep,
                max_boundary_distance: depth.hi.abs().max(depth.lo.abs()),
                boundary_triangles: boundary_triangles.map(|_| &**part_triangles),
                wanted,
            };
            let region = region.dilated(self.continuation_reach(depth.hi.min(whole_depth.hi)));
            self.restrict(near, &region, local);
            // The search for the range may end at values that decide neither side.
            let least = wanted.hi.min(-wanted.lo) * local.near.slope_sup;
            let range = self
                .field_range(&local.near, &region, least)
                .map(|f| self.distance_range(component, &local.near, &region, f));
            known.field_distance = match range {
                Some(d) if d.lo >= wanted.hi => Some(w),
                Some(d) if d.hi <= wanted.lo => Some(-w),
                _ => None,
            };
            let whole = match known.field_distance {
                _ if self.is_cut() && depth.lo >= wanted.hi => Some(w),
                Some(c) if c > 0.0 || known.is_deep || !self.is_cut() => Some(c),
                _ => None,
            };
            if let Some(d) = whole {
                for n in part.indices(lattice) {
                    out[n] = d as f32;
                }
            } else {
                for n in part.indices(lattice) {
                    if !limits.is_none_or(|l| l.is_needed(n)) {
                        continue;
                    }
                    *single_evaluations += 1;
                    let x = lattice.point(n).0;
                    out[n] = self.value_at(component, local, x, known) as f32;
                }
            }
        }
        false
    }
}

/// A box of at most 4^3 samples of a lattice, by its first and last indices.
pub(super) struct PartOfLattice {
    pub first: [usize; 3],
    pub last: [usize; 3],
}

impl PartOfLattice {
    pub fn span(&self, lattice: &SampleLattice<WorldPoint>) -> Aabb {
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
    pub fn indices(
        &self,
        lattice: &SampleLattice<WorldPoint>,
    ) -> impl Iterator<Item = usize> + use<> {
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
pub(super) fn parts(lattice: &SampleLattice<WorldPoint>) -> impl Iterator<Item = PartOfLattice> {
    let counts = lattice.counts;
    let [nx, ny, nz] = counts.map(|c| c.div_ceil(PART_EDGE));
    (0..nx * ny * nz).map(move |n| {
        let first = [n / (ny * nz), n / nz % ny, n % nz].map(|i| i * PART_EDGE);
        let last = [0, 1, 2].map(|a| (first[a] + PART_EDGE).min(counts[a]) - 1);
        PartOfLattice { first, last }
    })
}
