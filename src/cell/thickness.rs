//! The thickness of a cell's solid, and the level for a target thickness.
//!
//! A sheet |Phi| < t has, to first order, the thickness 2 t / gamma, with gamma the root mean square of the
//! gradient on its middle surface. For any other solid, chords along the inward normal are measured from
//! points of the surface; the thickness is their tenth percentile by area. For a round strut this is the
//! diameter: the longer chords at the nodes do not affect it. Beyond the element a chord continues in the
//! mirror image, as in a neighbour.

use super::level_search::{Samples, SurfacePatch};
use super::table::Table;
use super::{Cell, CellError, Solid};
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use rayon::prelude::*;

/// Step along a chord and maximal length of a chord, in reference units.
const CHORD_STEP: f64 = 0.01;
const MAX_CHORD: f64 = 1.2;
/// Bisections of the step in which a chord ends.
const CHORD_BISECTIONS: usize = 20;
/// The share of the area whose chords are shorter than the thickness.
const PERCENTILE: f64 = 0.1;
/// Accepted relative deviation of the measured thickness from the target.
const TOLERANCE: f64 = 0.02;
/// Relative deviation of the thickness at which the search for a level ends.
const ACCURACY: f64 = 1e-4;
/// Chords are followed to this multiple of the target.
const MEASURED_EXCESS: f64 = 1.25;
/// Steps of the search by secants, and by bisection after those, where the thickness jumps.
const SECANT_STEPS: usize = 12;
const BISECTIONS: usize = 26;
/// Parts per edge of the simplex grid on which surface points are found.
const GRID_PARTS: usize = 24;

/// Reflects a point outside the element through the faces until it lies inside. Cells of a hex are
/// periodic and those of the ball continue beyond it, so their points stay unchanged.
fn reflected_inside(element: Element, mut x: Vec3) -> Vec3 {
    if matches!(element, Element::Hex | Element::Ball) {
        return x;
    }
    let faces = element.faces();
    for _ in 0..8 {
        let out = |f: &crate::frame::Face| f.normal.dot(&x) - f.offset;
        let farthest = faces
            .iter()
            .max_by(|a, b| out(a).total_cmp(&out(b)))
            .filter(|f| out(f) > 0.0);
        let Some(face) = farthest else { break };
        x -= face.normal * (2.0 * out(face));
    }
    x
}

/// What the thickness of a cell at any level is measured with.
struct ThicknessProbe<'a> {
    cell: &'a Cell,
    samples: Samples,
    /// The function itself: level 0, solid below.
    table: &'a Table,
}

impl<'a> ThicknessProbe<'a> {
    fn new(cell: &'a Cell) -> Result<Self, CellError> {
        Ok(Self {
            cell,
            samples: cell.samples(GRID_PARTS),
            table: cell.function_table()?,
        })
    }

    /// The value at a level beyond or within the element.
    fn value(&self, x: Vec3, level: f64) -> f64 {
        let (solid, element) = (self.cell.solid, self.cell.element);
        let phi = self.table.value(CellPoint(reflected_inside(element, x)));
        solid.value(phi, level)
    }

    /// The chord from a surface point along the inward normal, to a step; it ends at `most` if it is not shorter.
    fn chord(&self, patch: &SurfacePatch, level: f64, most: f64) -> Chord {
        let from = patch.centre.0;
        let (v, g) = self.table.value_and_gradient(CellPoint(from));
        let inward = -g * self.cell.solid.value_and_slope(v, level).1;
        let mut chord = Chord {
            from,
            inward: Vec3::zeros(),
            ends: [most; 2],
            area: patch.area,
        };
        let Some(inward) = inward.try_normalize(1e-9) else {
            return chord;
        };
        chord.inward = inward;
        // No value changes faster than the function does.
        let slope = self.table.gradient_sup();
        let (mut s, mut inside) = (CHORD_STEP / 4.0, 0.0);
        while inside < most {
            let here = self.value(from + inward * s, level);
            if here > 0.0 && s > CHORD_STEP / 2.0 {
                chord.ends = [inside, s];
                return chord;
            }
            inside = s;
            s += CHORD_STEP.max(-here / slope);
        }
        chord
    }

    /// The length of a chord.
    fn length(&self, chord: &Chord, level: f64, most: f64) -> f64 {
        let [mut lo, mut hi] = chord.ends;
        if lo < hi {
            for _ in 0..CHORD_BISECTIONS {
                let mid = f64::midpoint(lo, hi);
                if self.value(chord.from + chord.inward * mid, level) > 0.0 {
                    hi = mid;
                } else {
                    lo = mid;
                }
            }
        }
        lo.min(most)
    }

    /// The chords at a level, at most `most` long.
    fn chords(&self, level: f64, most: f64) -> Vec<Chord> {
        let levels: &[f64] = if self.cell.solid.is_symmetric() {
            &[level, -level]
        } else {
            &[level]
        };
        let mut patches = Vec::new();
        for &t in levels {
            patches.extend(SurfacePatch::all(&self.samples, t));
        }
        let chords = patches.par_iter().map(|p| self.chord(p, level, most));
        chords.collect()
    }

    /// The thickness at a level: 0 without solid, infinite without void.
    fn thickness(&self, level: f64) -> f64 {
        self.thickness_within(level, MAX_CHORD)
    }

    /// [`Self::thickness`] where it is less than `most`, which is returned otherwise.
    fn thickness_within(&self, level: f64, most: f64) -> f64 {
        let solid = self.cell.solid;
        let chords = self.chords(level, most);
        let area: f64 = chords.iter().map(|c| c.area).sum();
        if area <= 0.0 {
            let empty = solid.value(self.samples.values[0], level) > 0.0;
            return if empty { 0.0 } else { f64::INFINITY };
        }
        let wanted = PERCENTILE * area;
        let between = |end: usize| {
            let ends = chords.iter().map(|c| (c.ends[end], c.area));
            percentile(ends.collect(), 0.0, wanted).unwrap_or(most)
        };
        // Only chords that may end there are measured to the end.
        let [least, greatest] = [0, 1].map(between);
        let shorter = chords.iter().filter(|c| c.ends[1] < least);
        let below = shorter.map(|c| c.area).sum();
        let may_be = |c: &&Chord| c.ends[1] >= least && c.ends[0] <= greatest;
        let lengths = chords.par_iter().filter(may_be);
        let lengths = lengths.map(|c| (self.length(c, level, most), c.area));
        percentile(lengths.collect(), below, wanted).unwrap_or(most)
    }
}

/// A chord through the solid.
struct Chord {
    /// The surface point where it begins, and its direction.
    from: Vec3,
    inward: Vec3,
    /// Lengths between which it ends.
    ends: [f64; 2],
    /// Area of the surface that it stands for.
    area: f64,
}

/// The length up to which chords have the `wanted` area, with the area of shorter ones; `None` if all have less.
fn percentile(mut chords: Vec<(f64, f64)>, mut below: f64, wanted: f64) -> Option<f64> {
    chords.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut chords = chords.into_iter();
    chords.find_map(|(length, area)| {
        below += area;
        (below >= wanted).then_some(length)
    })
}

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

/// A search for levels by thickness.
struct LevelSearch<'a> {
    probe: ThicknessProbe<'a>,
    /// Levels without solid and without void.
    ends: [f64; 2],
    known: Vec<KnownThickness>,
}

impl<'a> LevelSearch<'a> {
    fn new(probe: ThicknessProbe<'a>) -> Self {
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
        }
    }

    /// The level whose thickness is nearest to a target.
    fn nearest(&mut self, target: f64) -> NearestLevel {
        let mut bracket = self.bracket(target);
        let most = (MEASURED_EXCESS * target).min(MAX_CHORD);
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
        let [thin, thick] = bracket.levels;
        let [below, above] = bracket.levels.map(|level| self.probe.thickness(level));
        let (level, thickness) = if (above - target).abs() < (below - target).abs() {
            (thick, above)
        } else {
            (thin, below)
        };
        NearestLevel {
            level,
            thickness,
            bracket: (below, above),
        }
    }

    /// The nearest known levels on both sides of a target.
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
    /// The level at which the line through both ends meets the target, away from the ends.
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

impl Cell {
    /// The level at which walls or struts have the given thickness in units of reference length. For a sheet
    /// it is the wall thickness to first order, else the tenth percentile of the chords through the solid.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive or that no level attains.
    pub fn level_for_thickness(&self, thickness: f64) -> Result<f64, CellError> {
        let found = self.nearest_level_for_thickness(thickness)?;
        let (below, above) = found.bracket;
        if found.meets(thickness) {
            return Ok(found.level);
        }
        Err(CellError::OutOfRange {
            what: "thickness",
            found: thickness,
            expected: format!(
                "one that a level gives, in reference lengths: the nearest are {below:.4} and {above:.4}, \
                 because parts of the solid merge in between"
            ),
        })
    }

    /// The level whose thickness is nearest to the given one, with the measure of
    /// [`Cell::level_for_thickness`].
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive.
    pub fn nearest_level_for_thickness(&self, thickness: f64) -> Result<NearestLevel, CellError> {
        Ok(self.nearest_levels_for_thicknesses(&[thickness])?[0])
    }

    /// [`Cell::nearest_level_for_thickness`] for each of some thicknesses. What is measured for one serves the next,
    /// so that levels may differ from those of single calls within the accuracy of the search.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn nearest_levels_for_thicknesses(
        &self,
        thicknesses: &[f64],
    ) -> Result<Vec<NearestLevel>, CellError> {
        let is_bad = |t: &&f64| !(t.is_finite() && **t > 0.0);
        if let Some(&found) = thicknesses.iter().find(is_bad) {
            return Err(CellError::OutOfRange {
                what: "thickness",
                found,
                expected: "a positive length, hex edge 1, tet edge 1.414".to_owned(),
            });
        }
        if self.solid == Solid::Sheet {
            let gamma = self.gamma_at(&[0.0]);
            let of = |&thickness: &f64| NearestLevel {
                level: thickness * gamma / 2.0,
                thickness,
                bracket: (thickness, thickness),
            };
            return Ok(thicknesses.iter().map(of).collect());
        }
        let mut search = LevelSearch::new(ThicknessProbe::new(self)?);
        Ok(thicknesses.iter().map(|t| search.nearest(*t)).collect())
    }

    /// The thickness of the solid, with the measure of [`Cell::level_for_thickness`]: 0 without solid,
    /// infinite without void.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`].
    pub fn thickness(&self) -> Result<f64, CellError> {
        if self.solid == Solid::Sheet {
            return Ok(2.0 * self.level / self.gamma_at(&[0.0]));
        }
        Ok(ThicknessProbe::new(self)?.thickness(self.level))
    }
}
