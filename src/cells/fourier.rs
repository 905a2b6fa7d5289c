//! Discrete Fourier transforms in double precision, for other crates too.
//!
//! Each crate that plans transforms by itself compiles all algorithms of the library once more.

use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// The transforms of `n` complex numbers: forward by exp(-2 pi i j k / n), and back; both without scaling.
pub fn transforms(n: usize) -> [Arc<dyn Fft<f64>>; 2] {
    let mut planner = FftPlanner::new();
    [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)]
}
