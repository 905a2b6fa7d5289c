//! Exact Euclidean distance transform of a grid of solid and void samples.
//!
//! The squared distance to the nearest sample of one phase is a separable minimum. It is computed axis by
//! axis in linear time as the lower envelope of parabolas (Felzenszwalb and Huttenlocher 2012). The
//! surface lies half way between samples of different phase, so half a step is subtracted (half the mean
//! step, where the steps differ).

use rayon::prelude::*;

/// Signed distance of every sample to the surface between solid and void, negative in the solid. The
/// last axis is fastest. `steps` are the distances between samples along each axis; the result has
/// their unit. With `periodic` the grid wraps around along every axis.
///
/// Without any solid the distance is `f64::INFINITY` everywhere, without any void `f64::NEG_INFINITY`.
///
/// # Panics
/// If the number of samples is not the product of the shape, or that of the steps not the number of axes.
///
/// ```
/// # extern crate druse_cells as druse;
/// let row = [false, false, true, true, true, false];
/// let d = druse::cell::edt::signed_distance(&row, &[6], &[1.0], false);
/// assert_eq!(d, [1.5, 0.5, -0.5, -1.5, -0.5, 0.5]);
/// ```
pub fn signed_distance(solid: &[bool], shape: &[usize], steps: &[f64], periodic: bool) -> Vec<f64> {
    assert_eq!(
        solid.len(),
        shape.iter().product::<usize>(),
        "one sample per point of the shape"
    );
    assert_eq!(shape.len(), steps.len(), "one step per axis");
    let outside = squared(solid, true, shape, steps, periodic);
    let inside = squared(solid, false, shape, steps, periodic);
    // The surface is taken half a step before the nearest sample of the other side; the mean of unequal steps.
    let half = steps.iter().sum::<f64>() / steps.len() as f64 / 2.0;
    outside
        .into_par_iter()
        .zip(inside)
        .map(|(to_solid, to_void)| {
            if to_solid > 0.0 {
                to_solid.sqrt() - half
            } else {
                half - to_void.sqrt()
            }
        })
        .collect()
}

/// Squared distance of every sample to the nearest one of a phase.
/// In the squared unit of the steps; infinite without a sample of the phase. `phase` is true for solid.
fn squared(
    solid: &[bool],
    phase: bool,
    shape: &[usize],
    steps: &[f64],
    periodic: bool,
) -> Vec<f64> {
    let mut values: Vec<f64> = solid
        .iter()
        .map(|s| if *s == phase { 0.0 } else { f64::INFINITY })
        .collect();
    let mut inner = 1;
    for (&n, &step) in shape.iter().zip(steps).rev() {
        // Lines along this axis: consecutive samples are `inner` apart, in blocks of n * inner.
        values.par_chunks_mut(n * inner).for_each_init(
            || Envelope::new(n, step, periodic),
            |envelope, block| {
                for first in 0..inner {
                    envelope.line(block, first, inner);
                }
            },
        );
        inner *= n;
    }
    values
}

/// The lower envelope of parabolas along one line, with its buffers.
struct Envelope {
    n: usize,
    /// Distance between samples, squared.
    unit: f64,
    /// Copies of the line that are evaluated: three if it is periodic.
    copies: usize,
    line: Vec<f64>,
    /// Parabolas of the envelope, and the position from which each is the lowest.
    apex: Vec<usize>,
    from: Vec<f64>,
}

impl Envelope {
    fn new(n: usize, step: f64, periodic: bool) -> Self {
        Self {
            n,
            unit: step * step,
            copies: if periodic { 3 } else { 1 },
            line: Vec::with_capacity(n),
            apex: Vec::new(),
            from: Vec::new(),
        }
    }

    /// Replaces a line by the minimum over q of its value at q plus (p - q)^2.
    /// Distances are in steps of the line, scaled by `unit`. Sample i of the line is at `first` + i `step` in `block`.
    /// A line that is infinite everywhere stays so.
    fn line(&mut self, block: &mut [f64], first: usize, step: usize) {
        let n = self.n;
        self.line.clear();
        self.line.extend((0..n).map(|i| block[first + i * step]));
        self.apex.clear();
        self.from.clear();
        // The lower envelope of the parabolas value(q) + (p - q)^2 (Felzenszwalb and Huttenlocher): `apex`
        // are those on it, `from` where each begins. A periodic line is taken three times.
        for q in 0..n * self.copies {
            let value = self.line[q % n];
            if value == f64::INFINITY {
                continue;
            }
            let at = q as f64;
            let begin = loop {
                let Some(&last) = self.apex.last() else {
                    break f64::NEG_INFINITY;
                };
                let other = last as f64;
                let height = self.line[last % n];
                let rise = (value - height) / self.unit;
                // Where the parabola of q falls below the last one; if that is before the last one begins,
                // the last one is nowhere the lowest.
                let meet = (rise + at * at - other * other) / (2.0 * (at - other));
                if meet > self.from[self.apex.len() - 1] {
                    break meet;
                }
                self.apex.pop();
                self.from.pop();
            };
            self.apex.push(q);
            self.from.push(begin);
        }
        if self.apex.is_empty() {
            return;
        }
        // In a periodic line, only the middle copy has neighbours on both sides.
        let offset = if self.copies == 3 { n } else { 0 };
        let mut lowest = 0;
        // p ascends, so that the parabola below it does too.
        for i in 0..n {
            let p = (offset + i) as f64;
            while lowest + 1 < self.apex.len() && self.from[lowest + 1] < p {
                lowest += 1;
            }
            let q = self.apex[lowest];
            block[first + i * step] = self.line[q % n] + (p - q as f64).powi(2) * self.unit;
        }
    }
}
