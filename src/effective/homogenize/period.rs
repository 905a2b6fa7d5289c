//! One period of a tiled cell: the field in the unit cube or square that repeats.
//!
//! A hex or quad cell is its own period. Regular tets do not fill space; a cell of a tet is tiled over a
//! periodic scaffold of equal tets, and the effective properties have the symmetry of that scaffold:
//!
//! | packing | tets in the unit cube | symmetry | shape |
//! |---|---|---|---|
//! | `bcc` | 12, between corners and centres of cubes | cubic (Oh) | edges 1 and sqrt 3 / 2, all alike |
//! | `kuhn` | 6 around a diagonal | trigonal (D3d) | edges 1, sqrt 2, sqrt 3 |
//!
//! Struts and plates of a graph are round beams in the period, including those of neighbours that reach into it.

use super::HomogenizeError;
use super::grid::Grid;
use super::packing::Packing;
use super::phases::{Samples, fine_counts};
use druse_cells::cell::{Cell, Skeleton, Solid};
use druse_geometry::field::{Field, SampleLattice};
use druse_geometry::frame::{Aabb, CellPoint, Element, Mat3, Vec3, WorldPoint};
use druse_geometry::progress::{Cancelled, Progress};
use druse_tilings::beams::{Beam, Beams, Plate};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Distance from the period within which images of beams are kept, beyond their radius. Half a period is enough at any
/// growth: along each axis the nearest image of a point is no farther from a point of the period.
const GROWTH: f64 = 0.5;

/// The map from the reference element into the period.
// Identity for a hex; a tet has one map for each tet of the packing.
type Place = Box<dyn Fn(Vec3) -> Vec3>;

/// The contents of a period.
enum PeriodField {
    Cell(Box<Cell>),
    /// Round beams in the period, and the smallest of their diameters.
    Beams(Beams, f64),
}

/// One period of a tiled cell.
pub struct Period {
    element: Element,
    packing: Packing,
    filling: PeriodField,
}

impl Period {
    /// Refuses elements that do not tile space periodically here: `HomogenizeError::Element`.
    fn check(element: Element) -> Result<(), HomogenizeError> {
        match element {
            Element::Hex | Element::Quad | Element::Tet => Ok(()),
            other => Err(HomogenizeError::Element(other.name())),
        }
    }

    /// The period of a cell; for a tet with a packing.
    ///
    /// # Errors
    /// [`HomogenizeError::Element`] for other elements than hex, quad and tet;
    /// [`HomogenizeError::Numbering`] for a cell of a tet that depends on the numbering of the vertices.
    pub fn of_cell(cell: Cell, packing: Packing) -> Result<Self, HomogenizeError> {
        let element = cell.element();
        Self::check(element)?;
        if element == Element::Tet && !cell.fits_any_numbering() {
            return Err(HomogenizeError::Numbering {
                group: cell.group().to_owned(),
                operators: cell.operators().len(),
            });
        }
        Ok(Self {
            element,
            packing,
            filling: PeriodField::Cell(Box::new(cell)),
        })
    }

    /// The period of struts and plates in an element's reference coordinates, as round beams. In tets radii are scaled
    /// with the cube root of the volume; centre lines are mapped exactly.
    ///
    /// # Errors
    /// [`HomogenizeError::Element`] for other elements than hex and tet; [`HomogenizeError::Grid`] where the period is
    /// empty.
    pub fn of_skeleton(
        element: Element,
        skeleton: &Skeleton,
        packing: Packing,
    ) -> Result<Self, HomogenizeError> {
        if !matches!(element, Element::Hex | Element::Tet) {
            return Err(HomogenizeError::Element(element.name()));
        }
        // The maps from the reference element into the period: one per tet, the identity for a hex.
        let (places, factor): (Vec<Place>, f64) = if element == Element::Tet {
            let reference = Element::Tet.vertices();
            let edges = |v: &[Vec3]| Mat3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
            let back = edges(&reference)
                .try_inverse()
                .unwrap_or_else(Mat3::identity);
            let first = reference[0];
            let place = |tet: [Vec3; 4]| -> Place {
                let map = edges(&tet) * back;
                Box::new(move |p: Vec3| tet[0] + map * (p - first))
            };
            let all = packing.tets().into_iter().map(place).collect();
            (all, packing.scales()[1])
        } else {
            (vec![Box::new(|p: Vec3| p)], 1.0)
        };
        let mut beams = Unique::default();
        let mut plates = Unique::default();
        let mut thinnest = f64::INFINITY;
        // A strut on a face or an edge belongs to several tets; `Unique` keeps one of the equal images.
        for place in &places {
            for (ends, radius) in skeleton.struts() {
                thinnest = thinnest.min(2.0 * radius * factor);
                let ends = ends.map(place);
                beams.add(&ends, radius * factor);
            }
            for (corners, radius) in skeleton.plates() {
                thinnest = thinnest.min(2.0 * radius * factor);
                // A convex plate is the union of the triangles at its first corner.
                for n in 1..corners.len() - 1 {
                    let triangle = [corners[0], corners[n], corners[n + 1]].map(place);
                    plates.add(&triangle, radius * factor);
                }
            }
        }
        let beam = |(ends, r): ([Vec3; 2], f64)| Beam {
            ends,
            radii: [r; 2],
        };
        let plate = |(corners, r): ([Vec3; 3], f64)| Plate {
            corners,
            radii: [r; 3],
        };
        let beams: Vec<Beam> = beams.found.into_iter().map(beam).collect();
        let plates: Vec<Plate> = plates.found.into_iter().map(plate).collect();
        let beams = Beams::new(&beams, &plates).ok_or_else(|| {
            HomogenizeError::Grid("found no struts and no plates in the period".to_owned())
        })?;
        Ok(Self {
            element,
            packing,
            filling: PeriodField::Beams(beams, thinnest),
        })
    }

    /// The element.
    pub fn element(&self) -> Element {
        self.element
    }

    /// The cell, unless beams fill the period.
    pub fn cell(&self) -> Option<&Cell> {
        match &self.filling {
            PeriodField::Cell(cell) => Some(cell),
            PeriodField::Beams(..) => None,
        }
    }

    /// Smallest diameter of beams and plates before scaling by volume fraction, in periods; `None` for cells.
    pub fn least_diameter(&self) -> Option<f64> {
        match &self.filling {
            PeriodField::Cell(_) => None,
            PeriodField::Beams(_, thinnest) => Some(*thinnest),
        }
    }

    /// A length in the period per reference length, for elements of the same volume; 1 but for tets.
    #[doc(hidden)]
    pub fn length_scale(&self) -> f64 {
        match self.element {
            Element::Tet => self.packing.scales()[1],
            _ => 1.0,
        }
    }

    /// A description of the period.
    pub fn describe(&self) -> String {
        match self.element {
            Element::Tet => format!(
                "{} tets in a cube ({})",
                self.packing.tets().len(),
                self.packing.name()
            ),
            Element::Quad => "one square".to_owned(),
            _ => "one cube".to_owned(),
        }
    }

    /// The grid with `n` voxels along the period.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn grid(&self, n: usize) -> Result<Grid, HomogenizeError> {
        if self.element == Element::Quad {
            Grid::square(n)
        } else {
            Grid::cube(n)
        }
    }

    /// Greatest frequency of the field, in cycles per period; 0 for beams.
    pub fn band_limit(&self) -> f64 {
        let PeriodField::Cell(cell) = &self.filling else {
            return 0.0;
        };
        let limit = cell.expression().band_limit();
        if self.element == Element::Tet {
            limit / self.packing.scales()[0]
        } else {
            limit
        }
    }

    /// The reference point of the element at a point of the period, which is centred on the origin.
    pub fn reference(&self, p: Vec3) -> CellPoint<3> {
        if self.element != Element::Tet {
            return CellPoint(p);
        }
        self.packing.reference(p)
    }

    /// Whether the field is the same under all symmetries of the cube.
    fn is_octahedral(&self) -> bool {
        match (&self.filling, self.element) {
            (PeriodField::Cell(cell), Element::Hex) => cell.fits_any_numbering(),
            // A tet's cell fits any numbering, see `of_cell`.
            (PeriodField::Cell(_), Element::Tet) => self.packing == Packing::Bcc,
            _ => false,
        }
    }

    /// Samples of the field on `n` voxels along the period, `fineness` along each edge of a voxel. The level and the
    /// solid side are those of the cell; beams are solid below level 0, their values being signed distances in periods.
    ///
    /// # Errors
    /// [`HomogenizeError::Grid`], [`HomogenizeError::Band`] where the cell has frequencies above the grid's
    /// Nyquist frequency, and [`HomogenizeError::Cancelled`].
    pub fn samples(
        &self,
        n: usize,
        fineness: usize,
        progress: &dyn Progress,
    ) -> Result<Samples, HomogenizeError> {
        let grid = self.grid(n)?;
        let limit = self.band_limit();
        // A wave above the Nyquist frequency would be sampled as another one.
        if limit > n as f64 / 2.0 {
            return Err(HomogenizeError::Band {
                limit,
                nyquist: n as f64 / 2.0,
                needed: 2 * limit.ceil() as usize,
            });
        }
        let counts = fine_counts(grid, fineness);
        let (solid, level) = match &self.filling {
            PeriodField::Cell(cell) => (cell.solid(), cell.level()),
            PeriodField::Beams(..) => (Solid::Below, 0.0),
        };
        let values = match &self.filling {
            PeriodField::Cell(cell) if self.is_octahedral() => {
                self.octahedral(cell, counts[0], progress)?
            }
            PeriodField::Cell(cell) => self.direct(cell, counts, progress)?,
            PeriodField::Beams(beams, _) => of_beams(beams, counts, progress)?,
        };
        Samples::new(grid, fineness, values, solid, level)
    }

    /// Values of a cell at every sample, z fastest.
    fn direct(
        &self,
        cell: &Cell,
        counts: [usize; 3],
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, HomogenizeError> {
        let [_, ny, nz] = counts;
        let mut values = vec![0.0; counts.iter().product()];
        values
            .par_chunks_mut(ny * nz)
            .enumerate()
            .for_each(|(i, layer)| {
                if progress.cancelled() {
                    return;
                }
                for (n, v) in layer.iter_mut().enumerate() {
                    let p = place(counts, [i, n / nz, n % nz]);
                    *v = cell.expression().value(self.reference(p));
                }
            });
        stopped(progress)?;
        Ok(values)
    }

    /// Values of a cell with all symmetries of the cube, `n` samples along each axis, z fastest; one of 48 equivalent
    /// samples is evaluated.
    fn octahedral(
        &self,
        cell: &Cell,
        n: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, HomogenizeError> {
        // The samples lie in mirror images i and n - 1 - i. Triples half > i >= j >= k have the consecutive
        // numbers i (i + 1) (i + 2) / 6 + j (j + 1) / 2 + k.
        let half = n.div_ceil(2);
        let number = |[i, j, k]: [usize; 3]| i * (i + 1) * (i + 2) / 6 + j * (j + 1) / 2 + k;
        let mut triples = Vec::with_capacity(number([half, 0, 0]));
        for i in 0..half {
            for j in 0..=i {
                triples.extend((0..=j).map(|k| [i, j, k]));
            }
        }
        let value = |at: &[usize; 3]| {
            if progress.cancelled() {
                return 0.0;
            }
            cell.expression().value(self.reference(place([n; 3], *at)))
        };
        // Fewer than 64 samples are no task of their own.
        let chosen: Vec<f64> = triples.par_iter().with_min_len(64).map(value).collect();
        stopped(progress)?;
        let mut values = vec![0.0; n * n * n];
        values
            .par_chunks_mut(n * n)
            .enumerate()
            .for_each(|(i, layer)| {
                // The representative of a sample: each index reflected into the lower half, then in descending order.
                for (m, v) in layer.iter_mut().enumerate() {
                    let mut at = [i, m / n, m % n].map(|c| c.min(n - 1 - c));
                    at.sort_unstable_by(|a, b| b.cmp(a));
                    *v = chosen[number(at)];
                }
            });
        Ok(values)
    }
}

/// The place of sample `at` of a grid over the period, which is centred on the origin: the centre of its part; 0 along
/// an axis with a single sample.
pub(super) fn place(counts: [usize; 3], at: [usize; 3]) -> Vec3 {
    Vec3::from_fn(|a, _| {
        if counts[a] == 1 {
            0.0
        } else {
            (at[a] as f64 + 0.5) / counts[a] as f64 - 0.5
        }
    })
}

/// `Cancelled` once the user has stopped, so that values left at 0 are not used.
fn stopped(progress: &dyn Progress) -> Result<(), HomogenizeError> {
    if progress.cancelled() {
        Err(Cancelled.into())
    } else {
        Ok(())
    }
}

/// Signed distances to beams at every sample of a cube, in periods, negative inside, z fastest.
fn of_beams(
    beams: &Beams,
    counts: [usize; 3],
    progress: &dyn Progress,
) -> Result<Vec<f64>, HomogenizeError> {
    let [nx, ny, nz] = counts;
    let step = 1.0 / nx as f64;
    // One task per layer across x, into which the beams write their distances along whole rows.
    let layers: Vec<Vec<f32>> = (0..nx)
        .into_par_iter()
        .map(|i| {
            let mut out = vec![0f32; ny * nz];
            if !progress.cancelled() {
                let first = 0.5 * step - 0.5;
                let lattice = SampleLattice {
                    origin: WorldPoint(Vec3::new(first + i as f64 * step, first, first)),
                    step,
                    counts: [1, ny, nz],
                };
                beams.fill(&lattice, &mut out);
            }
            out
        })
        .collect();
    stopped(progress)?;
    Ok(layers.into_iter().flatten().map(f64::from).collect())
}

/// Parts of a period and parts of neighbours that reach into it, without duplicates. `known` holds the rounded corners
/// and radius of each.
struct Unique<const K: usize> {
    known: BTreeSet<Vec<i64>>,
    found: Vec<([Vec3; K], f64)>,
}

impl<const K: usize> Default for Unique<K> {
    fn default() -> Self {
        Self {
            known: BTreeSet::new(),
            found: Vec::new(),
        }
    }
}

impl<const K: usize> Unique<K> {
    /// Adds a part, and its images in neighbouring periods that reach into this one once they have grown by [`GROWTH`].
    /// A part may lie up to two periods away. Equal parts agree to 1e-7 in their corners, in any order, and to 1e-9 in
    /// their radius.
    fn add(&mut self, corners: &[Vec3; K], radius: f64) {
        let cube = Aabb::of([Vec3::repeat(-0.5), Vec3::repeat(0.5)]);
        let reach = cube.dilated(radius + GROWTH);
        let steps = || (-2..=2).map(f64::from);
        for x in steps() {
            for y in steps() {
                for z in steps() {
                    let moved = corners.map(|c| c + Vec3::new(x, y, z));
                    if Aabb::of(moved).intersection(reach).is_empty() {
                        continue;
                    }
                    let mut keys: Vec<[i64; 3]> = moved
                        .iter()
                        .map(|c| <[i64; 3]>::from(c.map(|v| (v * 1e7).round() as i64)))
                        .collect();
                    keys.sort_unstable();
                    let mut key: Vec<i64> = keys.concat();
                    key.push((radius * 1e9).round() as i64);
                    if self.known.insert(key) {
                        self.found.push((moved, radius));
                    }
                }
            }
        }
    }
}
