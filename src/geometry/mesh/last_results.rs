//! The last results of each thread: a mesh that is both an envelope and a skin is evaluated twice in each place.

use crate::field::{Interval, SampleLattice};
use crate::frame::{Aabb, WorldPoint};
use std::cell::RefCell;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most samples of a lattice whose values are kept: 16 KiB for each thread.
const MAX_SAMPLES: usize = 4096;

/// Tells one mesh from all others that the program makes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct MeshId(u64);

impl MeshId {
    pub fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

#[derive(Default)]
struct LastResults {
    bound: Option<(MeshId, Aabb, Interval)>,
    /// The lattice of the values, and the distance up to which they are exact.
    lattice: Option<(MeshId, SampleLattice<WorldPoint>, f64)>,
    values: Vec<f32>,
}

thread_local! {
    static LAST: RefCell<LastResults> = RefCell::default();
}

/// The bound of a mesh in a region, by `make` unless it is this thread's last one.
pub(super) fn bound(id: MeshId, region: &Aabb, make: impl FnOnce() -> Interval) -> Interval {
    let is_it = |(of, at, _): &(MeshId, Aabb, Interval)| *of == id && at == region;
    if let Some((.., known)) = LAST.with_borrow(|last| last.bound.filter(is_it)) {
        return known;
    }
    let made = make();
    LAST.with_borrow_mut(|last| last.bound = Some((id, *region, made)));
    made
}

/// Fills with the values of a mesh on a lattice, exact up to a distance, by `make` unless they are this thread's last
/// ones. Returns the number of samples that `make` measures.
pub(super) fn fill(
    id: MeshId,
    lattice: &SampleLattice<WorldPoint>,
    max_distance: f64,
    out: &mut [f32],
    make: impl FnOnce(&mut [f32]) -> u64,
) -> u64 {
    if out.len() > MAX_SAMPLES {
        return make(out);
    }
    let is_it = |(of, at, exact_up_to): &(MeshId, SampleLattice<WorldPoint>, f64)| {
        let is_same_place = at.origin.0 == lattice.origin.0 && at.counts == lattice.counts;
        let is_same_step = at.step.to_bits() == lattice.step.to_bits();
        *of == id && is_same_place && is_same_step && *exact_up_to >= max_distance
    };
    let is_known = LAST.with_borrow(|last| {
        let is_known = last.lattice.as_ref().is_some_and(is_it) && last.values.len() == out.len();
        if is_known {
            out.copy_from_slice(&last.values);
        }
        is_known
    });
    if is_known {
        return 0;
    }
    let measured = make(out);
    LAST.with_borrow_mut(|last| {
        last.lattice = Some((id, *lattice, max_distance));
        last.values.clear();
        last.values.extend_from_slice(out);
    });
    measured
}
