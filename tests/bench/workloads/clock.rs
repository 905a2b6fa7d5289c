//! Clocks: processor time of this process, rounds in turn, ratios of rounds.

use rustix::time::{ClockId, clock_gettime};
use std::fmt;
use std::time::Instant;

/// Seconds of processor time that this process has used, all threads together.
pub fn processor_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// Processor seconds of each work in each of the rounds, A B C A B C, so that what else goes on in the
/// machine meets all of them alike. `[work][round]`.
pub fn in_turn(rounds: usize, works: &mut [&mut dyn FnMut()]) -> Vec<Vec<f64>> {
    let mut seconds = vec![Vec::with_capacity(rounds); works.len()];
    for _ in 0..rounds {
        for (work, own) in works.iter_mut().zip(&mut seconds) {
            let start = processor_seconds();
            work();
            own.push(processor_seconds() - start);
        }
    }
    seconds
}

/// Wall seconds of a work.
pub fn wall_seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Median, least and greatest of several rounds.
#[derive(Clone, Copy)]
pub struct Spread {
    pub median: f64,
    pub least: f64,
    pub greatest: f64,
}

impl Spread {
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        Self {
            median: sorted[sorted.len() / 2],
            least: sorted[0],
            greatest: sorted[sorted.len() - 1],
        }
    }

    /// Of the ratios round by round.
    pub fn of_ratios(a: &[f64], b: &[f64]) -> Self {
        let ratios: Vec<f64> = a.iter().zip(b).map(|(a, b)| a / b).collect();
        Self::of(&ratios)
    }
}

impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} to {:.2}", self.least, self.greatest)
    }
}
