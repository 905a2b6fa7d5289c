//! Fields that a Python function computes: values negative inside, world units.
//!
//! A call takes the interpreter's lock; an exception in one ends the sampling, and the field keeps it for the
//! caller. The function is called on blocks of points. Its values at the centres of leaves (in a large box of some),
//! computed first, bound it everywhere by its Lipschitz constant, so that culling calls no function.

use druse::field::{Field, Interval, LeafBits, Leaves, SampleLattice};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::progress::Progress;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Points per call of the function.
const BLOCK_POINTS: usize = 1 << 16;
/// Greatest number of samples that bound the function, before one more is added along each axis.
const MAX_BOUND_SAMPLES: f64 = (1 << 24) as f64;
/// Voxels along the edge of a leaf.
const LEAF_VOXELS: f64 = 8.0;

/// A function of points [n, 3] with values [n], negative inside; `lipschitz` is its greatest slope.
pub(crate) struct CallableField<'a> {
    function: Py<PyAny>,
    /// Ends the work once it is cancelled: a call may take long, and a block of leaves needs many.
    progress: &'a dyn Progress,
    lipschitz: f64,
    voxel_size: f64,
    /// The exception of a call.
    raised: Mutex<Option<PyErr>>,
    origin: Vec3,
    /// Distance of the bounding samples, world units; their first place is `origin`, their values are z fastest.
    spacing: f64,
    counts: [usize; 3],
    values: Vec<f64>,
}

impl<'a> CallableField<'a> {
    /// Samples the function around the box `extent`, with the band of `half_width` voxels. `lipschitz` is the
    /// greatest slope of the function. After an exception the field is not sound and keeps it; a cancellation, or an
    /// answer of another length, only leaves values that are NaN.
    pub(crate) fn new(
        function: Py<PyAny>,
        lipschitz: f64,
        extent: Aabb,
        voxel_size: f64,
        half_width: f64,
        progress: &'a dyn Progress,
    ) -> Self {
        // The band goes a voxel beyond the half width, and a bound another for the neighbours.
        let around = extent.dilated((half_width + 2.0) * voxel_size);
        let mut spacing = LEAF_VOXELS * voxel_size;
        let count = |spacing: f64| around.size().map(|s| (s / spacing).ceil() + 1.0);
        // A sample for each leaf along each axis, in large boxes for every second, fourth and so on, and one more.
        while count(spacing).product() > MAX_BOUND_SAMPLES {
            spacing *= 2.0;
        }
        // Where each leaf has a sample, it lies at the centre.
        let shift = Vec3::repeat((LEAF_VOXELS - 1.0) / 2.0 * voxel_size);
        // The first place is rounded down, so the last needs one more.
        let origin = (around.min / spacing).map(f64::floor) * spacing + shift;
        let counts = count(spacing).map(|c| c as usize + 1).into();
        let mut field = Self {
            function,
            progress,
            lipschitz,
            voxel_size,
            raised: Mutex::new(None),
            origin,
            spacing,
            counts,
            values: Vec::new(),
        };
        let lattice = SampleLattice {
            origin: WorldPoint(origin),
            step: spacing,
            counts,
        };
        let mut values = Vec::with_capacity(lattice.len());
        while values.len() < lattice.len() && field.is_sound() {
            let end = lattice.len().min(values.len() + BLOCK_POINTS);
            let points = (values.len()..end).map(|n| lattice.point(n).0);
            values.extend(field.call(points));
        }
        values.resize(lattice.len(), f64::NAN);
        field.values = values;
        field
    }

    /// Whether no call has raised an exception.
    pub(crate) fn is_sound(&self) -> bool {
        let raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.is_none()
    }

    pub(crate) fn take_exception(&self) -> Option<PyErr> {
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.take()
    }

    /// Values at points; NaN after an exception, a cancellation, or an answer of another length.
    fn call(&self, points: impl ExactSizeIterator<Item = Vec3>) -> Vec<f64> {
        let count = points.len();
        let flat: Vec<f64> = points.flat_map(|p| [p.x, p.y, p.z]).collect();
        if self.progress.cancelled() || !self.is_sound() {
            return vec![f64::NAN; count];
        }
        let called = Python::attach(|py| {
            let array = PyArray1::from_vec(py, flat).reshape([count, 3])?;
            let found = self.function.bind(py).call1((array,))?;
            let found: PyReadonlyArray1<'_, f64> = found.extract()?;
            Ok(found.as_slice()?.to_vec())
        });
        let failed = match called {
            Ok(values) if values.len() == count => return values,
            Ok(_) => return vec![f64::NAN; count],
            Err(e) => e,
        };
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.get_or_insert(failed);
        vec![f64::NAN; count]
    }
}

impl Field for CallableField<'_> {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.call(std::iter::once(p.0))[0]
    }

    /// Central differences over a thousandth of a voxel.
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let h = 1e-3 * self.voxel_size;
        // Axis and side of each point: the centre first.
        let steps = [[0, 0], [0, 1], [0, -1], [1, 1], [1, -1], [2, 1], [2, -1]];
        let points = steps.map(|[axis, side]| p.0 + Vec3::ith(axis as usize, side as f64 * h));
        let v = self.call(points.into_iter());
        let slope = Vec3::new(v[1] - v[2], v[3] - v[4], v[5] - v[6]);
        (v[0], slope / (2.0 * h))
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let centre = region.centre().0;
        let index = [0, 1, 2].map(|a| {
            let n = ((centre[a] - self.origin[a]) / self.spacing).round();
            n.clamp(0.0, (self.counts[a] - 1) as f64)
        });
        let [i, j, k] = index.map(|n| n as usize);
        let value = self.values[(i * self.counts[1] + j) * self.counts[2] + k];
        let sample = self.origin + Vec3::from(index) * self.spacing;
        let reach = self.lipschitz * ((centre - sample).norm() + region.half_diagonal());
        if value.is_nan() {
            return Interval::REAL_LINE;
        }
        Interval::new(value - reach, value + reach)
    }

    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let values = self.call((0..lattice.len()).map(|n| lattice.point(n).0));
        for (v, found) in out.iter_mut().zip(values) {
            *v = found as f32;
        }
    }

    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let (origins, step) = (leaves.origins, leaves.step);
        let samples = 0..origins.len() * 512;
        // Sample n is voxel (n / 64 mod 8, n / 8 mod 8, n mod 8) of leaf n / 512.
        let point = |n: usize| {
            let [x, y, z] = [(n >> 6) & 7, (n >> 3) & 7, n & 7].map(|i| i as f64 * step);
            origins[n >> 9].0 + Vec3::new(x, y, z)
        };
        let found = self.call(samples.map(point));
        let by = leaves.by;
        let own = leaves.values.iter_mut().zip(leaves.bits.iter_mut());
        for ((values, bits), found) in own.zip(found.as_chunks::<512>().0) {
            *values = found.map(|v| v as f32 - by);
            *bits = LeafBits::from_values(values, leaves.background);
        }
        Some(found.len() as u64)
    }
}
