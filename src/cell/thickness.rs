//! The thickness of a cell's solid, and the level that gives a wanted one.
//!
//! A sheet |Phi| < t has, to first order, the thickness 2 t / gamma with gamma the root mean square of
//! the gradient on its middle surface. The thickness of anything else is measured: from points of the
//! surface the solid is crossed along the inward normal, and the tenth percentile of the chords, by
//! area, is taken: on a round strut its diameter, undisturbed by the nodes, where chords are longer.
//! Beyond the element a chord goes on in the mirror image, as in a neighbour.

use super::level_search::{Piece, Samples};
use super::table::Table;
use super::{Cell, CellError, Solid};
use crate::field::Field;
use crate::frame::{CellPoint, Element, Vec3};
use rayon::prelude::*;

/// Steps along a chord, and the longest chord that is followed, in reference units.
const STEP: f64 = 0.01;
const LONGEST: f64 = 1.2;
/// The share of the area whose chords are shorter than the thickness.
const PERCENTILE: f64 = 0.1;
/// The measured thickness must meet the wanted one to this share.
const TOLERANCE: f64 = 0.02;
/// Parts per edge of the simplex on which surface points are found.
const PARTS: usize = 24;

/// A point outside the element mirrored back through the faces; cells of a hex are periodic, those of
/// the ball go on beyond it.
fn folded(element: Element, mut x: Vec3) -> Vec3 {
    if matches!(element, Element::Hex | Element::Ball) {
        return x;
    }
    let faces = element.faces();
    for _ in 0..8 {
        let out = |f: &crate::frame::Face| f.normal.dot(&x) - f.offset;
        let worst = faces
            .iter()
            .max_by(|a, b| out(a).total_cmp(&out(b)))
            .filter(|f| out(f) > 0.0);
        let Some(face) = worst else { break };
        x -= face.normal * (2.0 * out(face));
    }
    x
}

/// The function with its surface points, ready for any level.
struct Gauge<'a> {
    cell: &'a Cell,
    samples: Samples,
    /// The bare function: level 0, solid below.
    table: Table,
}

impl<'a> Gauge<'a> {
    fn new(cell: &'a Cell) -> Result<Self, CellError> {
        let bare = cell.clone().with_solid(Solid::Below, 0.0)?;
        Ok(Self {
            cell,
            samples: Samples::new(cell, PARTS),
            table: Table::new(&bare)?,
        })
    }

    /// Length of the chord from a surface point inwards.
    fn chord(&self, from: Vec3, level: f64) -> f64 {
        let (solid, element) = (self.cell.solid, self.cell.element);
        let phi = |x: Vec3| self.table.value(CellPoint(folded(element, x)));
        let (v, g) = self.table.value_and_gradient(CellPoint(from));
        let inward = -g * solid.value_and_slope(v, level).1;
        let Some(inward) = inward.try_normalize(1e-9) else {
            return LONGEST;
        };
        let value = |s: f64| solid.value(phi(from + inward * s), level);
        let (mut s, mut inside) = (STEP / 4.0, 0.0);
        while s < LONGEST {
            if value(s) > 0.0 && s > STEP / 2.0 {
                let (mut lo, mut hi) = (inside, s);
                for _ in 0..20 {
                    let mid = f64::midpoint(lo, hi);
                    if value(mid) > 0.0 {
                        hi = mid;
                    } else {
                        lo = mid;
                    }
                }
                return lo;
            }
            inside = s;
            s += STEP;
        }
        LONGEST
    }

    /// The thickness at a level: 0 where nothing is solid, infinite where nothing is void.
    fn thickness(&self, level: f64) -> f64 {
        let solid = self.cell.solid;
        let levels: &[f64] = if solid.is_symmetric() {
            &[level, -level]
        } else {
            &[level]
        };
        let mut pieces = Vec::new();
        for &t in levels {
            pieces.extend(Piece::all(&self.samples, t));
        }
        let mut chords: Vec<(f64, f64)> = pieces
            .par_iter()
            .map(|p| (self.chord(p.centre.0, level), p.area))
            .collect();
        let area: f64 = chords.iter().map(|c| c.1).sum();
        if area <= 0.0 {
            let empty = solid.value(self.samples.values[0], level) > 0.0;
            return if empty { 0.0 } else { f64::INFINITY };
        }
        chords.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = 0.0;
        for (chord, part) in chords {
            below += part;
            if below >= PERCENTILE * area {
                return chord;
            }
        }
        LONGEST
    }
}

/// A level, and what thickness it gives, in units of reference length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestLevel {
    /// The level.
    pub level: f64,
    /// The thickness that it gives: 0 where nothing is solid, infinite where nothing is void.
    pub thickness: f64,
    /// The nearest thicknesses below and above the one asked for.
    pub around: (f64, f64),
}

impl NearestLevel {
    /// Whether the thickness is the one asked for, within the accuracy of its measure.
    pub fn meets(&self, asked: f64) -> bool {
        (self.thickness - asked).abs() <= TOLERANCE * asked
    }
}

impl Cell {
    /// The level at which walls or struts have this thickness: the wall of a sheet to first order,
    /// else the tenth percentile of the chords through the solid, in units of reference length.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive, or that no level gives.
    pub fn level_for_thickness(&self, thickness: f64) -> Result<f64, CellError> {
        let found = self.nearest_level_for_thickness(thickness)?;
        let (below, above) = found.around;
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

    /// The level whose thickness is nearest to the one asked for, measured as
    /// [`Cell::level_for_thickness`] does.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive.
    pub fn nearest_level_for_thickness(&self, thickness: f64) -> Result<NearestLevel, CellError> {
        if !(thickness.is_finite() && thickness > 0.0) {
            return Err(CellError::OutOfRange {
                what: "thickness",
                found: thickness,
                expected: "a positive length, hex edge 1, tet edge 1.414".to_owned(),
            });
        }
        if self.solid == Solid::Sheet {
            return Ok(NearestLevel {
                level: thickness * self.gamma_at(&[0.0]) / 2.0,
                thickness,
                around: (thickness, thickness),
            });
        }
        let gauge = Gauge::new(self)?;
        let (least, greatest) = gauge.samples.range();
        let (mut thin, mut thick) = match self.solid {
            Solid::Below => (least, greatest),
            Solid::Above => (greatest, least),
            _ => (least.abs().max(greatest.abs()), 0.0),
        };
        for _ in 0..30 {
            let level = f64::midpoint(thin, thick);
            if gauge.thickness(level) < thickness {
                thin = level;
            } else {
                thick = level;
            }
        }
        let (below, above) = (gauge.thickness(thin), gauge.thickness(thick));
        let (level, found) = if (above - thickness).abs() < (below - thickness).abs() {
            (thick, above)
        } else {
            (thin, below)
        };
        Ok(NearestLevel {
            level,
            thickness: found,
            around: (below, above),
        })
    }

    /// The thickness of the solid, as [`Cell::level_for_thickness`] measures it: 0 if there is no
    /// solid, infinite if there is no void.
    ///
    /// # Errors
    /// [`CellError::TableTooLarge`].
    pub fn thickness(&self) -> Result<f64, CellError> {
        if self.solid == Solid::Sheet {
            return Ok(2.0 * self.level / self.gamma_at(&[0.0]));
        }
        Ok(Gauge::new(self)?.thickness(self.level))
    }
}
