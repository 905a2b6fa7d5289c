//! The search for the level of a cell whose solid has a thickness.
//!
//! The thickness rises from the empty to the full solid and jumps where parts merge. Secants and bisections approach
//! the target from a bracket of known levels. If they miss, levels over the whole range are measured, and the nearest
//! attainable thicknesses on both sides are returned. Measured levels are kept for the next target.

use super::super::Solid;
use super::{CHORD_STEP, MAX_CHORD, ThicknessProbe};

/// Accepted relative deviation of the measured thickness from the target.
const TOLERANCE: f64 = 0.02;
/// Relative deviation of the thickness at which the search for a level ends.
const ACCURACY: f64 = 1e-4;
/// Chords are followed to this multiple of the target.
const MEASURED_EXCESS: f64 = 1.25;
/// Steps of the search by secants, and by bisection after those, where the thickness jumps.
const SECANT_STEPS: usize = 12;
const BISECTIONS: usize = 26;
/// Levels that are measured where the search ends without its target, and the distance of levels at which the nearest
/// one is found then, over the range of all.
const SCANNED_LEVELS: usize = 48;
const LEVEL_ACCURACY: f64 = 1e-4;
/// Halvings of the range towards the full solid at which levels are measured too.
const FULL_HALVINGS: i32 = 13;
/// Least thickness that chords measure: the points where they begin are off the surface by as much.
const MIN_MEASURED: f64 = 2.0 * CHORD_STEP;

/// A level and its thickness, in units of reference length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestLevel {
    /// The level.
    pub level: f64,
    /// Its thickness: 0 without solid, infinite without void.
    pub thickness: f64,
    /// The nearest attainable thicknesses below and above the target.
    pub bracket: (f64, f64),
}

impl NearestLevel {
    /// Whether the thickness equals the target within the accuracy of the measurement.
    /// The limit is 2 % of the target.
    pub fn meets(&self, target: f64) -> bool {
        (self.thickness - target).abs() <= TOLERANCE * target
    }
}

/// The thickness at a level, or a lower bound of it.
struct KnownThickness {
    level: f64,
    thickness: f64,
    is_bound: bool,
}

/// A level and its thickness, if chords measure it: all but full or empty solids have none.
#[derive(Clone, Copy, Default)]
struct MeasuredLevel {
    level: f64,
    thickness: Option<f64>,
}

/// A search for levels by thickness.
pub(super) struct LevelSearch<'a> {
    probe: ThicknessProbe<'a>,
    /// Levels without solid and without void.
    ends: [f64; 2],
    known: Vec<KnownThickness>,
    /// Levels that were measured where the search ended without the target, in order.
    measured: Vec<MeasuredLevel>,
}

/// The cell's own level does not count: the search covers all.
impl<'a> LevelSearch<'a> {
    /// A search over the range of the sampled values, with nothing measured yet.
    pub(super) fn new(probe: ThicknessProbe<'a>) -> Self {
        let (least, greatest) = probe.samples.range();
        let ends = match probe.cell.solid {
            Solid::Below => [least, greatest],
            Solid::Above => [greatest, least],
            _ => [least.abs().max(greatest.abs()), 0.0],
        };
        Self {
            probe,
            ends,
            known: Vec::new(),
            measured: Vec::new(),
        }
    }

    /// The level whose thickness is nearest to a target.
    /// `target` is positive, in reference lengths. What is measured is kept.
    pub(super) fn nearest(&mut self, target: f64) -> NearestLevel {
        let mut bracket = self.bracket(target);
        // Chords longer than this are cut off, so that the thickness is known only as a lower bound there.
        let most = (MEASURED_EXCESS * target).min(MAX_CHORD);
        // Secants converge fast where the thickness is continuous and measured beyond the target; bisections find the
        // jump where it is not.
        for step in 0..SECANT_STEPS + BISECTIONS {
            let level = if step < SECANT_STEPS && target < most {
                bracket.secant()
            } else {
                bracket.middle()
            };
            let thickness = self.probe.thickness_within(level, most);
            let is_bound = thickness >= most;
            self.known.push(KnownThickness {
                level,
                thickness,
                is_bound,
            });
            if !is_bound && (thickness - target).abs() <= ACCURACY * target {
                return NearestLevel {
                    level,
                    thickness,
                    bracket: (thickness, thickness),
                };
            }
            bracket.narrow(level, deviation(thickness, target));
        }
        self.nearest_measured(target, bracket.levels)
    }

    /// The level with the thickness nearest to a target that the search did not reach: the thickness jumps there, or
    /// the target is beyond all. `levels` are those at which the search ended.
    /// Scans the range once, then measures near `levels`. Thicknesses below [`MIN_MEASURED`] and beyond [`MAX_CHORD`]
    /// do not count.
    fn nearest_measured(&mut self, target: f64, levels: [f64; 2]) -> NearestLevel {
        if self.measured.is_empty() {
            let [start, end] = self.ends;
            let evenly = (1..SCANNED_LEVELS).map(|n| n as f64 / SCANNED_LEVELS as f64);
            // Shortly before the solid is full its thickness rises fast: halvings from 1/64, below the even step.
            let towards_end = (6..FULL_HALVINGS).map(|n| 1.0 - 0.5f64.powi(n));
            for share in evenly.chain(towards_end) {
                self.measure(start + (end - start) * share);
            }
        }
        for level in levels {
            self.measure(level);
        }
        let off = |m: &MeasuredLevel| m.thickness.map_or(f64::INFINITY, |t| (t - target).abs());
        let nearest = |all: &[MeasuredLevel]| {
            let numbers = (0..all.len()).min_by(|a, b| off(&all[*a]).total_cmp(&off(&all[*b])));
            numbers.unwrap_or(0)
        };
        // Approaches the target between the nearest level and those beside it: by bisection, or as far as thicknesses
        // are measured and come nearer.
        let range = (self.ends[1] - self.ends[0]).abs();
        for side in [0, 1] {
            let n = nearest(&self.measured);
            // n - 1 or n + 1.
            let beside = n.checked_sub(1 - side).map(|m| m + side);
            let Some(&beside) = beside.and_then(|m| self.measured.get(m)) else {
                continue;
            };
            let is_thin = |m: &MeasuredLevel| m.thickness.map(|t| t < target);
            let (mut near, mut far) = (self.measured[n], beside);
            let is_bracket = is_thin(&far).is_some_and(|thin| is_thin(&near) == Some(!thin));
            while (near.level - far.level).abs() > LEVEL_ACCURACY * range {
                let middle = self.measure(f64::midpoint(near.level, far.level));
                let is_on_near_side = if is_bracket {
                    is_thin(&middle) == is_thin(&near)
                } else {
                    off(&middle) <= off(&near)
                };
                if is_on_near_side {
                    near = middle;
                } else {
                    far = middle;
                }
            }
        }
        let nearest = self.measured[nearest(&self.measured)];
        let known = || self.measured.iter().filter_map(|m| m.thickness);
        let below = known().filter(|t| *t <= target).fold(0.0, f64::max);
        let above = known().filter(|t| *t >= target);
        NearestLevel {
            level: nearest.level,
            thickness: nearest.thickness.unwrap_or(0.0),
            bracket: (below, above.fold(f64::INFINITY, f64::min)),
        }
    }

    /// Measures the thickness at a level and keeps it, in order of levels.
    fn measure(&mut self, level: f64) -> MeasuredLevel {
        let thickness = self.probe.thickness(level);
        let is_measured = (MIN_MEASURED..MAX_CHORD).contains(&thickness);
        let found = MeasuredLevel {
            level,
            thickness: is_measured.then_some(thickness),
        };
        let n = self.measured.partition_point(|m| m.level < level);
        self.measured.insert(n, found);
        found
    }

    /// The nearest known levels on both sides of a target.
    /// Without a known level on a side it is the end of the range.
    fn bracket(&self, target: f64) -> LevelBracket {
        let mut bracket = LevelBracket {
            levels: self.ends,
            deviations: [-target, (MEASURED_EXCESS - 1.0) * target],
            replaced: None,
        };
        let known = self.known.iter();
        for known in known.filter(|k| !k.is_bound || k.thickness >= target) {
            let deviation = deviation(known.thickness, target);
            let end = usize::from(deviation >= 0.0);
            if deviation.abs() <= bracket.deviations[end].abs() {
                bracket.levels[end] = known.level;
                bracket.deviations[end] = deviation;
            }
        }
        bracket
    }
}

/// Deviation of a thickness from a target, with the limit of what is measured.
/// The limit is 1.25 times the target: chords are not followed farther.
fn deviation(thickness: f64, target: f64) -> f64 {
    thickness.min(MEASURED_EXCESS * target) - target
}

/// Two levels, the first with a thinner solid than wanted.
struct LevelBracket {
    levels: [f64; 2],
    /// Deviations of the thickness from the target, as the secant method uses them.
    deviations: [f64; 2],
    /// The end that the last level replaced.
    replaced: Option<usize>,
}

impl LevelBracket {
    /// The level at which the line through both ends meets the target, at least 2 % of the bracket away from the ends.
    fn secant(&self) -> f64 {
        let ([thin, thick], [low, high]) = (self.levels, self.deviations);
        thin + (thick - thin) * (low / (low - high)).clamp(0.02, 0.98)
    }

    fn middle(&self) -> f64 {
        f64::midpoint(self.levels[0], self.levels[1])
    }

    /// Replaces an end by a level between them. If an end stays twice, its deviation counts half (Illinois method).
    fn narrow(&mut self, level: f64, deviation: f64) {
        let end = usize::from(deviation >= 0.0);
        self.levels[end] = level;
        self.deviations[end] = deviation;
        if self.replaced == Some(end) {
            self.deviations[1 - end] /= 2.0;
        }
        self.replaced = Some(end);
    }
}
