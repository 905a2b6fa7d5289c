//! P17: what two threads make of wall time, on a machine that nothing else keeps busy.

use super::clock::{Spread, processor_seconds, wall_seconds};
use super::figure::Found;
use std::thread::available_parallelism;

const ROUNDS: usize = 5;
/// Rounds that are tried until so many count.
const TRIES: usize = 4 * ROUNDS;
/// Least wall seconds of a side of a round: the system counts in hundredths.
const MIN_SPEEDUP_SHARE: f64 = 0.5;
/// Wall seconds spent measuring the load of other processes before a round.
const LOOK: f64 = 0.3;
/// A round counts when other processes use less than so much of one processor.
const MAX_FOREIGN_LOAD: f64 = 0.1;

/// Processor seconds that all processes of this machine have used, and other guests of its host.
fn machine_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/stat").ok()?;
    let mut words = text.lines().next()?.split_whitespace().skip(1);
    let hundredths: Vec<f64> = words.by_ref().map_while(|w| w.parse().ok()).collect();
    // user, nice, system, idle, waiting, irq, softirq, steal; what follows is in user already.
    let busy = [0, 1, 2, 5, 6, 7].iter().filter_map(|&n| hundredths.get(n));
    Some(busy.sum::<f64>() / 100.0)
}

/// One side of a round.
struct Side {
    wall: f64,
    /// Processors that others used meanwhile.
    others: f64,
}

fn side(times: usize, work: &mut dyn FnMut()) -> Option<Side> {
    let (machine, own) = (machine_seconds()?, processor_seconds());
    let wall = wall_seconds(|| (0..times).for_each(|_| work()));
    let own = processor_seconds() - own;
    let others = (machine_seconds()? - machine - own) / wall;
    Some(Side { wall, others })
}

/// Wall time of a work on one thread against that on two, in turn, of rounds during which other processes
/// left both processors to this one.
pub fn one_against_two(key: &'static str, one: &mut dyn FnMut(), two: &mut dyn FnMut()) -> Found {
    if available_parallelism().map_or(1, std::num::NonZero::get) < 2 {
        return Found::skipped(key, "skipped: one processor");
    }
    let single = wall_seconds(&mut *one);
    let times = (MIN_SPEEDUP_SHARE / single.max(1e-3)).ceil() as usize;
    let (mut ones, mut twos, mut least) = (Vec::new(), Vec::new(), f64::INFINITY);
    let mut sleep = || std::thread::sleep(std::time::Duration::from_secs_f64(LOOK));
    for _ in 0..TRIES {
        let before = side(1, &mut sleep).map_or(0.0, |s| s.others);
        if before >= MAX_FOREIGN_LOAD {
            least = least.min(before);
            continue;
        }
        let both = side(times, one).zip(side(2 * times, two));
        let Some((a, b)) = both else {
            return Found::skipped(key, "skipped: no /proc/stat to tell what others use");
        };
        let others = a.others.max(b.others);
        least = least.min(others);
        if others < MAX_FOREIGN_LOAD {
            ones.push(2.0 * a.wall);
            twos.push(b.wall);
        }
        if ones.len() == ROUNDS {
            let ratios = Spread::of_ratios(&ones, &twos);
            return Found::new(key, ratios.median, ratios.to_string());
        }
    }
    let why = format!(
        "skipped: of {TRIES} rounds {} alone; others used {least:.1} processors at the least",
        ones.len()
    );
    Found::skipped(key, why)
}
