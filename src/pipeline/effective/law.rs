//! Laws of cells: volume fraction and effective stiffness over a graded quantity (the parameter), tabulated and
//! interpolated. Stiffnesses are in the unit of the solid's modulus and in the period's axes.
//!
//! Between tabulated values, cubic polynomials through four of them interpolate.

use super::super::homogenize::{CellPeriod, period_fault, recipe_period};
use crate::cell::CellError;
use crate::frame::Element;
use crate::homogenize::{
    Grid, HomogenizeError, InitialSolutions, Isotropic, Packing, Samples, Settings, Voigt,
    properties_from,
};
use crate::pipeline::base::error::{CellFault, RunError};
use crate::pipeline::content::tiling::GradedQuantity;
use crate::recipe::{CellSection, Fraction, Length, Recipe, Section, Size};
use crate::vdb::Session;

/// Samples along each edge of a voxel for its share of solid.
const SAMPLES_PER_VOXEL_EDGE: usize = 2;
/// Volume fraction of a cell before a graded quantity sets its level.
const PROVISIONAL_FRACTION: f64 = 0.3;

/// How laws are computed.
#[derive(Clone, Copy)]
pub(in super::super) struct LawSettings {
    pub solid: Isotropic,
    /// Voxels along the period.
    pub resolution: usize,
    /// Whether stiffnesses are computed, not volume fractions alone.
    pub stiffness: bool,
}

#[derive(Clone, Copy)]
pub(in super::super) struct LawCell<'a> {
    pub name: &'a str,
    pub shape: Element,
    pub packing: Packing,
    /// Whether its struts are round beams in world space.
    pub is_round: bool,
    /// The graded quantity, if there is one; a thickness in reference lengths.
    pub quantity: Option<GradedQuantity>,
    /// Ratio of the period's edges.
    pub aspect: [f64; 3],
}

/// Volume fraction and stiffness at one tabulated value of the parameter.
#[derive(Clone, Copy, Debug)]
struct LawPoint {
    parameter: f64,
    fraction: f64,
    stiffness: Voigt,
}

/// The law of a cell.
pub(in super::super) struct Law {
    pub cell: String,
    /// The period, in words.
    pub period: String,
    /// Defects of the period, in words.
    pub notes: Vec<String>,
    points: Vec<LawPoint>,
}

impl Law {
    /// Homogenises a cell at each parameter of its graded quantity, ascending; once if it has none.
    /// `settings` holds the material and the resolution.
    pub fn new(
        recipe: &Recipe,
        cell: LawCell,
        parameters: &[f64],
        settings: LawSettings,
        session: Session,
    ) -> Result<Self, RunError> {
        // Round beams of a graded thickness are sampled once, at the mean diameter; their level then makes them thinner
        // or thicker.
        let mean = parameters.iter().sum::<f64>() / parameters.len().max(1) as f64;
        let source = cell.period(recipe, mean, session)?;
        let key = format!("cell.{}", cell.name);
        let failed = |e: HomogenizeError| {
            let HomogenizeError::Band { needed, .. } = &e else {
                return period_fault(&key, e);
            };
            let resolution = needed.next_multiple_of(2); // resolutions are even
            RunError::Cell {
                key: key.clone(),
                fault: CellFault::Rule(format!(
                    "{e}; resolution = {resolution} in [[output]], or a smaller band_limit"
                )),
            }
        };
        let mut samples = source
            .period
            .samples(
                settings.resolution,
                SAMPLES_PER_VOXEL_EDGE,
                session.progress,
            )
            .map_err(failed)?;
        let grid = cell.grid(samples.grid()).map_err(failed)?;
        let properties = Settings {
            solid: settings.solid,
            conductivity: false,
            permeability: false,
            ..Settings::default()
        };
        let mut law = Self {
            cell: cell.name.to_owned(),
            period: source.period.describe(),
            notes: Vec::new(),
            points: Vec::new(),
        };
        // The solutions at one parameter are the start of the iterations at the next, which is near.
        let mut start = InitialSolutions::default();
        let own_level = [0.0];
        let all = if cell.quantity.is_some() {
            parameters
        } else {
            &own_level[..]
        };
        session.progress.stage("homogenise", Some(all.len() as u64));
        for &parameter in all {
            let level = cell.level(&source, &samples, parameter, mean, &key)?;
            samples = samples.with_level(level);
            let shares = samples.shares();
            let fraction = crate::homogenize::mean(&shares);
            let mut stiffness = [[0.0; 6]; 6];
            if settings.stiffness {
                let quiet = crate::progress::CancelOnly(session.progress);
                let found = properties_from(grid, &shares, &properties, Some(&mut start), &quiet)
                    .map_err(failed)?;
                stiffness = found.stiffness.unwrap_or(stiffness);
                // Where the solid does not percolate along an axis, the void alone carries; the first such value is
                // noted.
                let weak = ["x", "y", "z"]
                    .iter()
                    .zip(found.solid.percolates)
                    .take(source.period.element().dimension());
                let weak: Vec<&str> = weak.filter(|a| !a.1).map(|a| *a.0).collect();
                if !weak.is_empty() && law.notes.is_empty() {
                    law.notes.push(format!(
                        "{key}: the solid of volume fraction {fraction:.3} does not go on along {}: its stiffness \
                         there is that of the void",
                        weak.join(", ")
                    ));
                }
            }
            law.points.push(LawPoint {
                parameter,
                fraction,
                stiffness,
            });
            session.progress.advance(1);
        }
        Ok(law)
    }

    /// Number of tabulated values.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The four points around a parameter with their weights, which are Lagrange's; fewer where the table has
    /// fewer. Beyond the table the value at its end holds.
    fn weights(&self, parameter: f64) -> Vec<(&LawPoint, f64)> {
        let n = self.points.len();
        let p = parameter.clamp(self.points[0].parameter, self.points[n - 1].parameter);
        let above = self.points.partition_point(|q| q.parameter < p);
        // Two points on each side, where the table has them.
        let first = above.saturating_sub(2).min(n.saturating_sub(4));
        let near = &self.points[first..(first + 4).min(n)];
        let weight = |i: usize| {
            let others = (0..near.len()).filter(|&j| j != i);
            others
                .map(|j| (p - near[j].parameter) / (near[i].parameter - near[j].parameter))
                .product::<f64>()
        };
        near.iter()
            .enumerate()
            .map(|(i, q)| (q, weight(i)))
            .collect()
    }

    /// The share of solid.
    pub fn fraction(&self, parameter: f64) -> f64 {
        let weights = self.weights(parameter);
        let sum: f64 = weights.iter().map(|(q, w)| q.fraction * w).sum();
        sum.clamp(0.0, 1.0)
    }

    /// The effective stiffness.
    pub fn stiffness(&self, parameter: f64) -> Voigt {
        let weights = self.weights(parameter);
        let entry = |i: usize, j: usize| weights.iter().map(|(q, w)| q.stiffness[i][j] * w).sum();
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Least and greatest volume fraction of the table.
    pub fn fractions(&self) -> [f64; 2] {
        let all = self.points.iter().map(|p| p.fraction);
        all.fold([f64::INFINITY, 0.0], |r, f| [r[0].min(f), r[1].max(f)])
    }

    /// The parameter at which the solid has a share, by bisection: the share grows with the parameter.
    pub fn parameter_for(&self, fraction: f64) -> f64 {
        let ends = [self.points[0], self.points[self.points.len() - 1]];
        let [mut low, mut high] = ends.map(|p| p.parameter);
        // 50 halvings reach the precision of the numbers.
        for _ in 0..50 {
            let middle = f64::midpoint(low, high);
            if self.fraction(middle) < fraction {
                low = middle;
            } else {
                high = middle;
            }
        }
        f64::midpoint(low, high)
    }
}

impl LawCell<'_> {
    /// The grid of a period with the law's ratio of edges.
    fn grid(&self, grid: Grid) -> Result<Grid, HomogenizeError> {
        let [x, y, z] = self.aspect;
        let size = if grid.is_planar() {
            [x, y, 1.0]
        } else {
            [x, y, z]
        };
        Grid::new(grid.counts(), size)
    }

    /// The period of the cell; round beams with a graded thickness get the mean one, and cells whose level is set
    /// later a provisional volume fraction.
    fn period(&self, recipe: &Recipe, mean: f64, session: Session) -> Result<CellPeriod, RunError> {
        let section = &recipe.sections().cell[self.name];
        let has_beams = section.graph.is_some() || section.plates.is_some();
        let mut flags = CellSection::default();
        if section.own_element().is_none() {
            flags.element = Some(self.shape.into());
        }
        if has_beams {
            flags.section = Some(if self.is_round {
                Section::Round
            } else {
                Section::Fitted
            });
        }
        match self.quantity {
            Some(GradedQuantity::Thickness) if self.is_round => {
                flags.thickness = Some(Size(Length::Bare(mean)));
            }
            Some(_) => flags.volume_fraction = Some(Fraction(PROVISIONAL_FRACTION)),
            None => {}
        }
        recipe_period(recipe, self.name, &flags, self.packing, session)
    }

    /// The level of the samples at which the graded quantity has the value `parameter`; `mean` is the thickness that
    /// beams have at level 0. Round beams have no cell. The fraction of a cell is that of its element, as in a run; a
    /// thickness that no level gives takes the nearest one.
    fn level(
        &self,
        source: &CellPeriod,
        samples: &Samples,
        parameter: f64,
        mean: f64,
        key: &str,
    ) -> Result<f64, RunError> {
        let failed = |e| period_fault(key, e);
        let of_cell = |e: CellError| RunError::Cell {
            key: key.to_owned(),
            fault: e.into(),
        };
        Ok(match (self.quantity, source.period.cell()) {
            (None, _) => match source.volume_fraction {
                Some(share) => samples.level_for_volume_fraction(share).map_err(failed)?,
                None => samples.level(),
            },
            (Some(GradedQuantity::Level), _) => parameter,
            (Some(GradedQuantity::VolumeFraction), None) => samples
                .level_for_volume_fraction(parameter)
                .map_err(failed)?,
            (Some(GradedQuantity::VolumeFraction), Some(cell)) => {
                cell.level_for_volume_fraction(parameter).map_err(of_cell)?
            }
            // The samples of beams are distances: a level l moves the surface by l, so the diameter
            // grows by 2 l.
            (Some(GradedQuantity::Thickness), None) => {
                (parameter - mean) / 2.0 * source.period.length_scale()
            }
            (Some(GradedQuantity::Thickness), Some(cell)) => {
                let found = cell.nearest_level_for_thickness(parameter);
                found.map_err(of_cell)?.level
            }
        })
    }
}
