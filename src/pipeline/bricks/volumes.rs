//! `.vdb` files of a solid in bricks: its level set, its fog and numbers to shade it by, streamed grid by
//! grid.

use super::super::error::RunError;
use super::super::output;
use super::super::report::OutputFile;
use super::Yard;
use super::reach::coarser_copies;
use super::solid::{Bricks, StoredSolid};
use crate::band::{NumberStore, StoreError};
use crate::frame::Aabb;
use crate::io::atomic::{StagedPath, write_bytes};
use crate::recipe::{GridWord, Output, OutputKind, Recipe};
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
    /// If any of them wants it.
    fog: Option<StoredFog<'a>>,
    /// The box around the solid, recipe units.
    bounds: Aabb,
}

impl<'a> Volumes<'a> {
    /// Makes what all files have in common: fog and numbers, where any wants them.
    pub fn new(yard: &'a Yard, solid: &'a StoredSolid, bounds: Aabb) -> Result<Self, RunError> {
        let recipe = yard.stock.recipe;
        yard.make_numbers(&attribute_words(recipe), solid)?;
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

    /// Writes one file, and a scene beside it if that is wished.
    pub fn write(&self, output: &Output, path: &Path) -> Result<Vec<OutputFile>, RunError> {
        let (yard, recipe) = (self.yard, self.yard.stock.recipe);
        let (bricks, store) = (&self.solid.bricks, &self.solid.store);
        let bench = bricks.bench(yard, yard.progress);
        let unit = output.unit_or_default(recipe.unit());
        let words = output::words(recipe, output);
        let staged = StagedPath::create(path)?;
        let failed = RunError::level_set("write");
        // Grids without leaves: types, voxels and backgrounds.
        let empty_on = |bricks: &Bricks| {
            let bench = bricks.bench(yard, yard.progress);
            let empty = LevelSet::empty(bench.transform()?, bench.half_width, bench.session());
            empty.map_err(&failed)
        };
        let empty = empty_on(bricks)?;
        let copies = &self.coarser[..usize::from(output.lod.unwrap_or(0))];
        let mut coarser = Vec::with_capacity(copies.len());
        for (n, copy) in copies.iter().enumerate() {
            let name = output::name_of_coarser(n + 1);
            coarser.push((name, empty_on(&copy.bricks)?, &copy.store));
        }
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
        if words.contains(&GridWord::Surface) {
            output::add_surface(&mut file, output, ("surface", &empty))?;
            grids.push(Streamed::Surface(store));
        }
        for (name, shape, store) in &coarser {
            output::add_surface(&mut file, output, (name, shape))?;
            grids.push(Streamed::Surface(store));
        }
        if let Some(fog) = self
            .fog
            .as_ref()
            .filter(|_| words.contains(&GridWord::Density))
        {
            file.fog("density", &empty_fog, output.half)?;
            grids.push(Streamed::Fog(fog));
        }
        for (word, shape, own) in &numbers {
            file.attribute(&word.to_string(), shape)?;
            grids.push(Streamed::Numbers(store, own));
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
            let names = words.iter().map(ToString::to_string);
            let names: Vec<String> = names.chain(coarser.iter().map(|c| c.0.clone())).collect();
            let text = super::super::usda::scene(path, unit, bounds, &names);
            write_bytes(&scene, text.as_bytes())?;
            files.push(output::listed(&scene, Some(unit))?);
        }
        Ok(files)
    }
}
