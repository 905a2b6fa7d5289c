//! A recipe's tiled field looked at without sampling it: at points, over shared faces.

use super::error::RunError;
use super::inputs::Stock;
use super::offsets::Offsets;
use super::report::{ContinuityReport, ScaffoldReport, Warning};
use super::round_beams::Round;
use super::sheets::SheetOptions;
use super::tiling::{Fill, Filled};
use super::{RunOptions, threads};
use crate::cell::{Cell, Table};
use crate::field::{Field, WorldField};
use crate::frame::{Vec3, WorldPoint};
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use crate::tiling::{CellField, TiledSolid, TilingError, TilingOptions};
use rayon::prelude::*;
use std::path::Path;

/// The tiled field at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Probed {
    /// The field's value; NaN outside the scaffold.
    pub phi: f64,
    /// Its gradient in world space.
    pub gradient: [f64; 3],
    /// The solid's signed distance, recipe units, clamped to the band; outside the scaffold too.
    pub distance: f64,
    /// The element's number in its file; -1 outside.
    pub element: i64,
    /// Reference coordinates in the element.
    pub reference: [f64; 3],
    /// Weights of the cells, in the order of [`Probe::cells`].
    pub weights: Vec<f64>,
}

impl Probed {
    /// A point outside the scaffold, with so many cells.
    fn outside(distance: f64, cells: usize) -> Self {
        Self {
            phi: f64::NAN,
            gradient: [f64::NAN; 3],
            distance,
            element: -1,
            reference: [f64::NAN; 3],
            weights: vec![f64::NAN; cells],
        }
    }
}

/// A recipe's scaffold with its cells, read and ready.
pub struct Probe<'a> {
    stock: Stock<'a>,
    threads: Threads,
}

impl<'a> Probe<'a> {
    /// Reads a recipe's scaffold and cells.
    ///
    /// # Errors
    /// As [`super::run`]; a recipe without a scaffold.
    pub fn new(
        recipe: &'a Recipe,
        options: &'a RunOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let threads = threads(options)?;
        let stock = Stock::load(recipe, &threads, options, progress)?;
        if stock.fill().is_none() {
            return Err(RunError::Tiling(
                "the recipe has no scaffold to look at; expected [scaffold] and [tiling]".into(),
            ));
        }
        Ok(Self { stock, threads })
    }

    fn fill(&self) -> Result<&Fill, RunError> {
        let none = || RunError::Tiling("the recipe has no scaffold".into());
        self.stock.fill().ok_or_else(none)
    }

    /// Names of the cells.
    pub fn cells(&self) -> Vec<String> {
        let palette = self.stock.fill().map(|f| &f.palette);
        let names = palette.into_iter().flatten().map(|e| e.name.clone());
        names.collect()
    }

    /// What is known of the scaffold.
    pub fn scaffold(&self) -> Option<&ScaffoldReport> {
        self.stock.fill().map(|f| &f.loaded.report)
    }

    /// What looked wrong so far.
    pub fn warnings(&self) -> Vec<Warning> {
        self.stock.report().warnings
    }

    /// The field at world points, by tables or exactly by the cells' series.
    ///
    /// # Errors
    /// Cells that do not fit the scaffold.
    pub fn evaluate(&self, points: &[[f64; 3]], exact: bool) -> Result<Vec<Probed>, RunError> {
        let fill = self.fill()?;
        let options = self
            .stock
            .tiling_options(self.stock.recipe.scale(), Offsets::default());
        let points: Vec<Vec3> = points.iter().map(|&p| p.into()).collect();
        self.threads.install(|| {
            if let Some(round) = fill.round() {
                let shape = round.shape(fill, options, Offsets::default());
                let solid = (&*shape.field, options.half_width);
                return probe_round(fill, round, solid, &points);
            }
            if let Some(sheets) = fill.sheets() {
                let how = SheetOptions {
                    tiling: options,
                    offsets: Offsets::default(),
                    nodes: 0.0,
                    visits: None,
                };
                let field = if exact {
                    sheets.field(fill, || fill.exact(), how)?.0
                } else {
                    sheets.field(fill, || fill.tabulated(), how)?.0
                };
                return probe_sheets(fill, &*field, options.half_width, &points);
            }
            if exact {
                probe::<Cell>(fill, &fill.exact()?, options, &points)
            } else {
                probe::<Table>(fill, &fill.tabulated()?, options, &points)
            }
        })
    }

    /// The continuity over all shared faces; with a path also as fields of a `.vtu` of the scaffold.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn certificate(&self, picture: Option<&Path>) -> Result<ContinuityReport, RunError> {
        let fill = self.fill()?;
        let found = self.threads.install(|| fill.certificate())?;
        if let Some(path) = picture {
            let scaffold = &fill.loaded.scaffold;
            let quality: Vec<f64> = scaffold.elements().map(|e| e.quality()).collect();
            let cell_weights = fill.cell_weights()?;
            let names = self.cells();
            let mut weights = vec![Vec::with_capacity(scaffold.len()); names.len()];
            for e in scaffold.elements() {
                let own = cell_weights.list(e.index(), e.shape().centroid());
                for (all, w) in weights.iter_mut().zip(own) {
                    all.push(w);
                }
            }
            let titles: Vec<String> = names.iter().map(|n| format!("weight_{n}")).collect();
            let mut fields: Vec<(&str, &[f64])> = vec![
                ("quality", &quality),
                ("value_jump", &found.jump_of_element),
                ("crease_degrees", &found.crease_of_element),
            ];
            for (title, own) in titles.iter().zip(&weights) {
                fields.push((title, own));
            }
            crate::io::write_vtu(path, scaffold, &fields)?;
        }
        Ok(ContinuityReport::from(&found))
    }
}

/// Round beams at points: phi is the signed distance to the uncut beams, `distance` that of the solid.
fn probe_round(
    fill: &Fill,
    round: &Round,
    (solid, half_width): (&WorldField, f64),
    points: &[Vec3],
) -> Result<Vec<Probed>, RunError> {
    let scaffold = &fill.loaded.scaffold;
    let weights = fill.cell_weights()?;
    let count = fill.palette.len();
    let one = |&p: &Vec3| {
        let p = WorldPoint(p);
        let distance = solid.value(p).clamp(-half_width, half_width);
        let Some((e, xi)) = scaffold.locate(p) else {
            return Probed::outside(distance, count);
        };
        let (phi, gradient) = round.beams().value_and_gradient(p);
        Probed {
            phi,
            gradient: gradient.into(),
            distance,
            element: scaffold.number(e as usize) as i64,
            reference: xi.0.into(),
            weights: weights.list(e as usize, xi),
        }
    };
    Ok(points.par_iter().map(one).collect())
}

/// Sheets at points: phi is the signed distance that the solid is made of, not clamped to the band.
fn probe_sheets(
    fill: &Fill,
    field: &WorldField,
    half_width: f64,
    points: &[Vec3],
) -> Result<Vec<Probed>, RunError> {
    let scaffold = &fill.loaded.scaffold;
    let count = fill.palette.len();
    let filled = fill.tabulated()?;
    let one = |&p: &Vec3| {
        let (phi, gradient) = field.value_and_gradient(WorldPoint(p));
        let distance = phi.clamp(-half_width, half_width);
        match scaffold.locate(WorldPoint(p)) {
            None => Probed::outside(distance, count),
            Some((e, xi)) => Probed {
                phi,
                gradient: gradient.into(),
                distance,
                element: scaffold.number(e as usize) as i64,
                reference: xi.0.into(),
                weights: filled.weights(e as usize, xi),
            },
        }
    };
    Ok(points.par_iter().map(one).collect())
}

fn probe<C: CellField>(
    fill: &Fill,
    filled: &Filled<'_, C>,
    options: TilingOptions,
    points: &[Vec3],
) -> Result<Vec<Probed>, RunError> {
    let scaffold = &fill.loaded.scaffold;
    let failed = |e: TilingError| RunError::Tiling(e.to_string());
    let count = fill.palette.len();
    let one = |p: Vec3, distance: f64, filled: &Filled<'_, C>| match scaffold.locate(WorldPoint(p))
    {
        None => Probed::outside(distance, count),
        Some((e, xi)) => {
            let (phi, slope) = filled.value_and_gradient(e as usize, xi);
            let inverse = scaffold.element(e as usize).jacobian(xi).try_inverse();
            let gradient = inverse.map_or(Vec3::repeat(f64::NAN), |i| i.tr_mul(&slope));
            Probed {
                phi,
                gradient: gradient.into(),
                distance,
                element: scaffold.number(e as usize) as i64,
                reference: xi.0.into(),
                weights: filled.weights(e as usize, xi),
            }
        }
    };
    // Distances first, so that the tiling borrows the filling that the values are taken of.
    Ok(match filled {
        Filled::One(cell) => {
            let tiled = TiledSolid::new(scaffold, *cell, options).map_err(failed)?;
            let at = |&p: &Vec3| one(p, tiled.value(WorldPoint(p)), filled);
            points.par_iter().map(at).collect()
        }
        Filled::Many(blend) => {
            let tiled = TiledSolid::new(scaffold, &**blend, options).map_err(failed)?;
            let at = |&p: &Vec3| one(p, tiled.value(WorldPoint(p)), filled);
            points.par_iter().map(at).collect()
        }
    })
}
