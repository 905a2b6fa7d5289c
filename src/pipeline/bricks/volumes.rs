//! `.vdb` files of a solid in bricks: its level set, its fog and numbers to shade it by, streamed grid by
//! grid.

use super::super::error::RunError;
use super::super::output;
use super::super::report::OutputFile;
use super::super::thickness::Thickness;
use super::Yard;
use super::halo::{coarser_copies, wants_segments};
use super::solid::{Bricks, StoredSolid};
use crate::band::{NumberStore, StoreError};
use crate::frame::Aabb;
use crate::io::atomic::{StagedPath, write_bytes};
use crate::recipe::{GridWord, Output, OutputKind, Recipe, Segments};
use crate::vdb::{Attribute, FileError, LevelSet, StoredFog, Streamed};
use std::path::Path;

/// The numbers that any `.vdb` of a recipe holds.
pub(super) fn attribute_words(recipe: &Recipe) -> Vec<GridWord> {
    let mut all: Vec<GridWord> = Vec::new();
    let outputs = recipe.sections().output.iter();
    for output in outputs.filter(|o| o.vdb.is_some()) {
        let words = output::words(recipe, output).into_iter();
        for word in words.filter(GridWord::is_attribute) {
            if !all.contains(&word) {
                all.push(word);
            }
        }
    }
    all
}

/// What the `.vdb` files of a run are made from.
pub(super) struct Volumes<'a> {
    yard: &'a Yard<'a>,
    solid: &'a StoredSolid,
    /// On voxels of twice the edge, four times ... as many as any of them wants.
    coarser: Vec<StoredSolid>,
    /// The largest first, if any of them wants them.
    pieces: Vec<StoredSolid>,
    /// If any of them wants it.
    fog: Option<StoredFog<'a>>,
    /// The box around the solid, recipe units.
    bounds: Aabb,
}

impl<'a> Volumes<'a> {
    /// Makes what all files have in common: fog and numbers, where any wants them.
    pub fn new(
        yard: &'a Yard,
        solid: &'a StoredSolid,
        bounds: Aabb,
        thickness: Option<&Thickness>,
    ) -> Result<Self, RunError> {
        let recipe = yard.stock.recipe;
        yard.make_numbers(&attribute_words(recipe), solid, thickness)?;
        let bench = solid.bricks.bench(yard, yard.progress);
        let mut outputs = recipe.sections().output.iter();
        let wants_fog = outputs.any(|o| {
            let is_volume = o.named().iter().any(|n| n.0 == OutputKind::Vdb);
            is_volume && output::words(recipe, o).contains(&GridWord::Density)
        });
        let fog = wants_fog.then(|| StoredFog::new(&solid.store, bench.session()));
        let fog = fog
            .transpose()
            .map_err(|e: StoreError| FileError::from(e))?;
        Ok(Self {
            yard,
            solid,
            coarser: yard.coarser(solid, coarser_copies(recipe))?,
            pieces: if wants_segments(recipe) {
                yard.segments(solid)?
            } else {
                Vec::new()
            },
            fog,
            bounds,
        })
    }

    /// Whether any holds more than the surface.
    pub fn are_many(&self) -> bool {
        self.fog.is_some()
            || !self.coarser.is_empty()
            || !attribute_words(self.yard.stock.recipe).is_empty()
    }

    /// Writes the files of an output, and a scene beside each if that is wished.
    pub fn write(&self, output: &Output, path: &Path) -> Result<Vec<OutputFile>, RunError> {
        let pieces = || (1..).zip(&self.pieces);
        match output.segments {
            None => {
                let words = output::words(self.yard.stock.recipe, output);
                let own = words.contains(&GridWord::Surface);
                let own = own.then(|| (GridWord::Surface.to_string(), self.solid));
                let levels = usize::from(output.lod.unwrap_or(0));
                let copies = (1..).zip(&self.coarser[..levels]);
                let copies = copies.map(|(n, copy)| (output::name_of_coarser(n), copy));
                let surfaces: Vec<_> = own.into_iter().chain(copies).collect();
                self.write_one(output, path, &words, &surfaces)
            }
            Some(Segments::Grids) => {
                let named = pieces().map(|(n, piece)| (output::name_of_piece(n), piece));
                let named: Vec<_> = named.collect();
                self.write_one(output, path, &[], &named)
            }
            Some(Segments::Files) => {
                let mut files = Vec::new();
                for (n, piece) in pieces() {
                    let surface = [(GridWord::Surface.to_string(), piece)];
                    let path = output::numbered(path, n);
                    files.extend(self.write_one(output, &path, &[], &surface)?);
                }
                Ok(files)
            }
        }
    }

    /// Writes one file: level sets by their names, and the other grids of these words.
    fn write_one(
        &self,
        output: &Output,
        path: &Path,
        words: &[GridWord],
        surfaces: &[(String, &StoredSolid)],
    ) -> Result<Vec<OutputFile>, RunError> {
        let (yard, recipe) = (self.yard, self.yard.stock.recipe);
        let (bricks, store) = (&self.solid.bricks, &self.solid.store);
        let bench = bricks.bench(yard, yard.progress);
        let unit = output.unit_or_default(recipe.unit());
        let staged = StagedPath::create(path)?;
        let failed = RunError::level_set("write");
        // Grids without leaves: types, voxels and backgrounds.
        let empty_on = |bricks: &Bricks| {
            let bench = bricks.bench(yard, yard.progress);
            let empty = LevelSet::empty(bench.transform()?, bench.half_width, bench.session());
            empty.map_err(&failed)
        };
        let shapes = surfaces.iter().map(|(_, solid)| empty_on(&solid.bricks));
        let shapes: Vec<LevelSet> = shapes.collect::<Result<_, _>>()?;
        let empty = empty_on(bricks)?;
        let empty_fog = empty.to_fog(bench.session()).map_err(&failed)?;
        let mut numbers: Vec<(&GridWord, Attribute, NumberStore)> = Vec::new();
        for word in words.iter().filter(|w| w.is_attribute()) {
            let shape = empty.attributes(&[word.components()], |_| Vec::new(), bench.session());
            let shape = shape.map_err(&failed)?.into_iter().next();
            let own = yard.numbers(word, self.solid)?;
            numbers.extend(shape.map(|shape| (word, shape, own)));
        }
        let mut file = output::vdb_file(bench, yard.stock, output, path)?;
        let mut grids = Vec::new();
        for ((name, solid), shape) in surfaces.iter().zip(&shapes) {
            output::add_surface(&mut file, output, (name, shape))?;
            grids.push(Streamed::Surface(&solid.store));
        }
        let wants_fog = words.contains(&GridWord::Density);
        if let Some(fog) = self.fog.as_ref().filter(|_| wants_fog) {
            file.fog("density", &empty_fog, output.half)?;
            grids.push(Streamed::Fog(fog));
        }
        for (word, shape, own) in &numbers {
            file.attribute(&word.to_string(), shape)?;
            let factor = if **word == GridWord::Thickness {
                recipe.unit().to(unit) as f32
            } else {
                1.0
            };
            grids.push(Streamed::Numbers(store, own, factor));
        }
        let written = file.write_streamed_to(staged.path(), &grids)?;
        staged.commit()?;
        let mut files = vec![OutputFile {
            content_hash: Some(written.content_hash),
            ..output::listed(path, Some(unit))?
        }];
        if output.usda {
            let scene = path.with_extension("usda");
            let factor = recipe.unit().to(unit);
            let bounds = Aabb {
                min: self.bounds.min * factor,
                max: self.bounds.max * factor,
            };
            let mut names: Vec<String> = words.iter().map(ToString::to_string).collect();
            let others = surfaces.iter().map(|(name, _)| name);
            let others: Vec<String> = others.filter(|n| !names.contains(n)).cloned().collect();
            names.extend(others);
            let text = super::super::usda::scene(path, unit, bounds, &names);
            write_bytes(&scene, text.as_bytes())?;
            files.push(output::listed(&scene, Some(unit))?);
        }
        Ok(files)
    }
}
