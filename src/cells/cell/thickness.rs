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
use druse_geometry::frame::{CellPoint, Element, Face, Vec3};
use rayon::prelude::*;

mod nearest_level;
use nearest_level::LevelSearch;
pub use nearest_level::NearestLevel;

/// Step along a chord and maximal length of a chord, in reference units.
const CHORD_STEP: f64 = 0.01;
const MAX_CHORD: f64 = 1.2;
/// Chords that are followed at once, since a table gives many values in the time of a few.
const BATCH: usize = 128;
/// Bisections of the step in which a chord ends: down to 1e-8 reference lengths.
const CHORD_BISECTIONS: usize = 20;
/// The share of the area whose chords are shorter than the thickness.
const PERCENTILE: f64 = 0.1;
/// Parts per edge of the simplex grid on which surface points are found.
const GRID_PARTS: usize = 24;

/// The faces through which points outside an element are reflected into it. Cells of a hex are periodic and those of
/// the ball continue beyond it, so their points stay where they are.
fn mirrors(element: Element) -> Vec<Face> {
    match element {
        Element::Hex | Element::Ball => Vec::new(),
        _ => element.faces(),
    }
}

/// Reflects a point through the faces until it lies behind all of them.
/// Eight reflections suffice near an element; a point far away may stay outside.
fn reflected_inside(mirrors: &[Face], mut x: Vec3) -> Vec3 {
    for _ in 0..8 {
        let mut farthest = None;
        let mut greatest = 0.0;
        for face in mirrors {
            let out = face.normal.dot(&x) - face.offset;
            if out > 0.0 && out >= greatest {
                (greatest, farthest) = (out, Some(face));
            }
        }
        let Some(face) = farthest else { break };
        x -= face.normal * (2.0 * greatest);
    }
    x
}

/// What the thickness of a cell at any level is measured with.
struct ThicknessProbe<'a> {
    cell: &'a Cell,
    samples: Samples,
    /// Listed once, since values are many.
    mirrors: Vec<Face>,
    /// The function itself: level 0, solid below.
    table: &'a Table,
}

impl<'a> ThicknessProbe<'a> {
    fn new(cell: &'a Cell) -> Result<Self, CellError> {
        Ok(Self {
            cell,
            samples: cell.samples(GRID_PARTS),
            mirrors: mirrors(cell.element),
            table: cell.function_table()?,
        })
    }

    /// The solid's values at points beyond or within the element.
    /// Negative inside.
    fn values(&self, points: impl Iterator<Item = Vec3>, level: f64) -> Vec<f64> {
        let reflected = points.map(|x| CellPoint(reflected_inside(&self.mirrors, x)));
        let points: Vec<_> = reflected.collect();
        let mut phi = vec![0.0; points.len()];
        self.table.values(&points, &mut phi);
        let solid = self.cell.solid;
        let values = phi.into_iter();
        values.map(|v| solid.value(f64::from(v), level)).collect()
    }

    /// The chords from points of the surface along the inward normals, each down to the step in which it ends; they end
    /// at `most` if they are not shorter.
    /// `most` is a length in reference units. A patch without a normal has a chord of the length `most`.
    fn chords_from(&self, patches: &[SurfacePatch], level: f64, most: f64) -> Vec<Chord> {
        let centres: Vec<_> = patches.iter().map(|p| p.centre).collect();
        let mut samples = vec![[0.0; 4]; patches.len()];
        self.table.values_and_gradients(&centres, &mut samples);
        let chord = |(patch, [v, x, y, z]): (&SurfacePatch, [f32; 4])| {
            let gradient = Vec3::from([x, y, z].map(f64::from));
            let (_, slope) = self.cell.solid.value_and_slope(f64::from(v), level);
            // Where the gradient is below 1e-9 there is no normal.
            let inward = (-gradient * slope).try_normalize(1e-9);
            Chord {
                from: patch.centre.0,
                inward: inward.unwrap_or_default(),
                ends: [most; 2],
                area: patch.area,
            }
        };
        let mut chords: Vec<Chord> = patches.iter().zip(samples).map(chord).collect();
        let with_normal = chords
            .iter_mut()
            .filter(|c| most > 0.0 && c.inward != Vec3::zeros());
        let mut walks: Vec<Walk> = with_normal.map(Walk::new).collect();
        // No value changes faster than the function does.
        let slope = self.table.gradient_sup();
        while !walks.is_empty() {
            let values = self.values(walks.iter().map(Walk::place), level);
            for (walk, value) in walks.iter_mut().zip(values) {
                walk.value = value;
            }
            walks.retain_mut(|walk| walk.goes_on(slope) && walk.inside < most);
        }
        chords
    }

    /// The lengths of chords.
    /// Bisects between the ends of each chord; a length is at most `most`.
    fn lengths(&self, chords: &[&Chord], level: f64, most: f64) -> Vec<f64> {
        let mut ends: Vec<[f64; 2]> = chords.iter().map(|c| c.ends).collect();
        for _ in 0..CHORD_BISECTIONS {
            let middles: Vec<f64> = ends.iter().map(|e| f64::midpoint(e[0], e[1])).collect();
            let places = chords.iter().zip(&middles);
            let values = self.values(places.map(|(c, s)| c.from + c.inward * *s), level);
            for ((ends, middle), value) in ends.iter_mut().zip(middles).zip(values) {
                ends[usize::from(value > 0.0)] = middle;
            }
        }
        ends.into_iter()
            .map(|[inside, _]| inside.min(most))
            .collect()
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
        let batches = patches.par_chunks(BATCH);
        let chords = batches.flat_map_iter(|batch| self.chords_from(batch, level, most));
        chords.collect()
    }

    /// The thickness at a level: 0 without solid, infinite without void or beyond [`MAX_CHORD`].
    fn thickness(&self, level: f64) -> f64 {
        let found = self.thickness_within(level, MAX_CHORD);
        if found < MAX_CHORD {
            found
        } else {
            f64::INFINITY
        }
    }

    /// [`Self::thickness`] where it is less than `most`, else `most`, or infinite without void. `most` is positive.
    fn thickness_within(&self, level: f64, most: f64) -> f64 {
        let solid = self.cell.solid;
        let chords = self.chords(level, most);
        let area: f64 = chords.iter().map(|c| c.area).sum();
        if area <= 0.0 {
            // Without a surface the element is full or empty.
            let empty = solid.value(self.samples.values[0], level) > 0.0;
            return if empty { 0.0 } else { f64::INFINITY };
        }
        let wanted = PERCENTILE * area;
        let between = |end: usize| {
            let ends = chords.iter().map(|c| (c.ends[end], c.area));
            percentile(ends.collect(), 0.0, wanted).unwrap_or(most)
        };
        // The result lies between those of the lower and the upper ends: only chords that may end there are measured.
        let [least, greatest] = [0, 1].map(between);
        let shorter = chords.iter().filter(|c| c.ends[1] < least);
        let below = shorter.map(|c| c.area).sum();
        let may_be = |c: &&Chord| c.ends[1] >= least && c.ends[0] <= greatest;
        let measured: Vec<&Chord> = chords.iter().filter(may_be).collect();
        let batches = measured.par_chunks(BATCH);
        let lengths = batches.flat_map_iter(|batch| {
            let lengths = self.lengths(batch, level, most).into_iter();
            lengths.zip(batch.iter().map(|c| c.area))
        });
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

/// A walk along a chord, to the step in which it ends.
struct Walk<'a> {
    chord: &'a mut Chord,
    /// Length to the point that was last inside, and to the present one.
    inside: f64,
    at: f64,
    /// The solid's value there.
    value: f64,
}

impl<'a> Walk<'a> {
    fn new(chord: &'a mut Chord) -> Self {
        Self {
            chord,
            inside: 0.0,
            at: CHORD_STEP / 4.0,
            value: 0.0,
        }
    }

    /// The point that is tried next.
    fn place(&self) -> Vec3 {
        self.chord.from + self.chord.inward * self.at
    }

    /// Ends the chord if the present point is outside; otherwise goes as far as is inside for sure, for a function
    /// that changes by at most `slope` in a unit of length. Returns whether it went on.
    /// `slope` is positive, per unit of reference length. The first quarter step does not end a chord, since the point
    /// may be outside where the surface is curved.
    fn goes_on(&mut self, slope: f64) -> bool {
        if self.value > 0.0 && self.at > CHORD_STEP / 2.0 {
            self.chord.ends = [self.inside, self.at];
            return false;
        }
        self.inside = self.at;
        self.at += CHORD_STEP.max(-self.value / slope);
        true
    }
}

/// The length up to which chords have the `wanted` area, with the area of shorter ones; `None` if all have less.
/// Each chord is (length, area). `below` is the area of shorter chords that are not listed.
fn percentile(mut chords: Vec<(f64, f64)>, mut below: f64, wanted: f64) -> Option<f64> {
    chords.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut chords = chords.into_iter();
    chords.find_map(|(length, area)| {
        below += area;
        (below >= wanted).then_some(length)
    })
}

impl Cell {
    /// The level at which walls or struts have the given thickness in reference lengths (a hex has edge 1, a tet
    /// sqrt 2). For a sheet it is the wall thickness to first order, else the tenth percentile of the chords through
    /// the solid.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive or that no level attains, or
    /// [`CellError::TableTooLarge`].
    ///
    /// ```
    /// # mod druse { pub use druse_cells::*; pub use druse_geometry::*; }
    /// use druse::{cell::{Solid, Surface}, frame::Element};
    ///
    /// let sheet = Surface::SchwarzP.cell(Element::Hex).unwrap().sheet(0.1).unwrap();
    /// let level = sheet.level_for_thickness(0.05).unwrap();
    /// let thin = sheet.with_solid(Solid::Sheet, level).unwrap();
    /// assert!((thin.thickness().unwrap() - 0.05).abs() < 1e-12);
    /// ```
    pub fn level_for_thickness(&self, thickness: f64) -> Result<f64, CellError> {
        let found = self.nearest_level_for_thickness(thickness)?;
        let (below, above) = found.bracket;
        if found.meets(thickness) {
            return Ok(found.level);
        }
        Err(CellError::OutOfRange {
            what: "thickness",
            found: thickness,
            expected: if above.is_finite() {
                format!(
                    "{below:.4} or {above:.4} reference lengths, the nearest: in between, parts of the solid merge"
                )
            } else {
                format!("at most {below:.4} reference lengths")
            },
        })
    }

    /// The level whose thickness is nearest to the given one, with the measure of
    /// [`Cell::level_for_thickness`].
    /// Where no level reaches it, the nearest measured one.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] for a thickness that is not positive; [`CellError::TableTooLarge`].
    pub fn nearest_level_for_thickness(&self, thickness: f64) -> Result<NearestLevel, CellError> {
        Ok(self.nearest_levels_for_thicknesses(&[thickness])?[0])
    }

    /// [`Cell::nearest_level_for_thickness`] for each of some thicknesses. What is measured for one serves the next,
    /// so that levels may differ from those of single calls within the accuracy of the search.
    ///
    /// # Errors
    /// As there.
    #[doc(hidden)]
    pub fn nearest_levels_for_thicknesses(
        &self,
        thicknesses: &[f64],
    ) -> Result<Vec<NearestLevel>, CellError> {
        let is_bad = |t: &&f64| !(t.is_finite() && **t > 0.0);
        if let Some(&found) = thicknesses.iter().find(is_bad) {
            return Err(CellError::OutOfRange {
                what: "thickness",
                found,
                expected: "a positive number of reference lengths (a hex has edge 1, a tet 1.414)"
                    .to_owned(),
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
    /// infinite without void or beyond 1.2 reference lengths.
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
