//! `.vdb` files of a solid in bricks: its level set, fog and attributes, streamed grid by grid from disk. The
//! files are those of a run in memory, with the same content hash.

use super::BrickRun;
use super::halo::{coarser_copies, needs_segments};
use super::solid::{Bricks, StoredSolid};
use crate::band::{AttributeStore, StoreError};
use crate::frame::Aabb;
use crate::io::atomic::{StagedPath, write_bytes};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::OutputFile;
use crate::pipeline::measure::thickness::Thickness;
use crate::pipeline::outputs::output;
use crate::recipe::{GridWord, Output, OutputKind, Recipe, Segments};
use crate::vdb::{Attribute, FileError, LevelSet, StoredFog, StoredGrid};
use std::path::Path;

/// The attributes that the `.vdb` outputs of a recipe contain, each once.
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

/// The common data of all `.vdb` files of a run.
pub(super) struct Volumes<'a> {
    brick_run: &'a BrickRun<'a>,
    solid: &'a StoredSolid,
    /// Copies on voxels of twice, four times ... the edge: as many as any file contains.
    coarser: Vec<StoredSolid>,
    /// The components, the largest first, if any file contains them.
    components: Vec<StoredSolid>,
    /// The fog, if any file contains it.
    fog: Option<StoredFog<'a>>,
    /// The box around the solid, recipe units.
    bounds: Aabb,
}

impl<'a> Volumes<'a> {
    /// Makes attributes, copies, components and fog, where any file contains them. `bounds` is the box of the
    /// solid in the recipe's unit, for scenes (the `.usda` files beside a volume).
    pub fn new(
        brick_run: &'a BrickRun,
        solid: &'a StoredSolid,
        bounds: Aabb,
        thickness: Option<&Thickness>,
    ) -> Result<Self, RunError> {
        let recipe = brick_run.inputs.recipe;
        brick_run.make_attributes(&attribute_words(recipe), solid, thickness)?;
        let context = solid.bricks.context(brick_run, brick_run.progress);
        let mut outputs = recipe.sections().output.iter();
        // Only `.vdb` files hold fog; it takes a pass over all leaves.
        let has_fog = outputs.any(|o| {
            let is_volume = o.named().iter().any(|n| n.0 == OutputKind::Vdb);
            is_volume && output::words(recipe, o).contains(&GridWord::Density)
        });
        let fog = has_fog.then(|| StoredFog::new(&solid.store, context.session()));
        let fog = fog
            .transpose()
            .map_err(|e: StoreError| FileError::from(e))?;
        Ok(Self {
            brick_run,
            solid,
            coarser: brick_run.coarser(solid, coarser_copies(recipe))?,
            components: if needs_segments(recipe) {
                brick_run.segments(solid)?
            } else {
                Vec::new()
            },
            fog,
            bounds,
        })
    }

    /// Whether any file contains more than the surface.
    pub fn has_more_than_surface(&self) -> bool {
        self.fog.is_some()
            || !self.coarser.is_empty()
            || !attribute_words(self.brick_run.inputs.recipe).is_empty()
    }

    /// Writes the files of an output, and a scene beside each if it requests one. Returns their entries in the
    /// report, in the order of writing.
    pub fn write(&self, output: &Output, path: &Path) -> Result<Vec<OutputFile>, RunError> {
        let components = || (1..).zip(&self.components);
        match output.segments {
            None => {
                let words = output::words(self.brick_run.inputs.recipe, output);
                let has_surface = words.contains(&GridWord::Surface);
                let whole = has_surface.then(|| (GridWord::Surface.to_string(), self.solid));
                // The solid, and behind it its coarser copies.
                let levels = usize::from(output.lod.unwrap_or(0));
                let copies = (1..).zip(&self.coarser[..levels]);
                let copies = copies.map(|(n, copy)| (output::coarser_copy_name(n), copy));
                let surfaces: Vec<_> = whole.into_iter().chain(copies).collect();
                self.write_one(output, path, &words, &surfaces)
            }
            // All components in one file, each a grid with its number.
            Some(Segments::Grids) => {
                let named =
                    components().map(|(n, component)| (output::component_name(n), component));
                let named: Vec<_> = named.collect();
                self.write_one(output, path, &[], &named)
            }
            Some(Segments::Files) => {
                let mut files = Vec::new();
                for (n, component) in components() {
                    let surface = [(GridWord::Surface.to_string(), component)];
                    let path = output::numbered(path, n);
                    files.extend(self.write_one(output, &path, &[], &surface)?);
                }
                Ok(files)
            }
        }
    }

    /// Writes one file: the level sets `surfaces` by their names, and the fog and attributes among `words`; a
    /// scene beside it on request. Returns the entries of the report.
    fn write_one(
        &self,
        output: &Output,
        path: &Path,
        words: &[GridWord],
        surfaces: &[(String, &StoredSolid)],
    ) -> Result<Vec<OutputFile>, RunError> {
        let (brick_run, recipe) = (self.brick_run, self.brick_run.inputs.recipe);
        let (bricks, store) = (&self.solid.bricks, &self.solid.store);
        let context = bricks.context(brick_run, brick_run.progress);
        let unit = output.unit_or_default(recipe.unit());
        let staged = StagedPath::create(path)?;
        let failed = RunError::level_set("write");
        // Grids without leaves define types, voxels and backgrounds.
        let empty_on = |bricks: &Bricks| {
            let context = bricks.context(brick_run, brick_run.progress);
            let empty =
                LevelSet::empty(context.transform()?, context.half_width, context.session());
            empty.map_err(&failed)
        };
        let shapes = surfaces.iter().map(|(_, solid)| empty_on(&solid.bricks));
        let shapes: Vec<LevelSet> = shapes.collect::<Result<_, _>>()?;
        let empty = empty_on(bricks)?;
        let empty_fog = empty.to_fog(context.session()).map_err(&failed)?;
        let mut attributes: Vec<(&GridWord, Attribute, AttributeStore)> = Vec::new();
        for word in words.iter().filter(|w| w.is_attribute()) {
            let shape = empty.attributes(&[word.components()], |_| Vec::new(), context.session());
            let shape = shape.map_err(&failed)?.into_iter().next();
            let values = brick_run.attribute_store(word, self.solid)?;
            attributes.extend(shape.map(|shape| (word, shape, values)));
        }
        // The writer takes empty grids for their names and types, and streams the values from disk.
        let mut file = output::vdb_file(context, brick_run.inputs, output, path)?;
        let mut grids = Vec::new();
        for ((name, solid), shape) in surfaces.iter().zip(&shapes) {
            output::add_surface(&mut file, output, name, shape)?;
            grids.push(StoredGrid::Surface(&solid.store));
        }
        let has_fog = words.contains(&GridWord::Density);
        if let Some(fog) = self.fog.as_ref().filter(|_| has_fog) {
            file.fog("density", &empty_fog, output.half)?;
            grids.push(StoredGrid::Fog(fog));
        }
        for (word, shape, own) in &attributes {
            file.attribute(&word.to_string(), shape)?;
            let factor = if word.has_lengths() {
                recipe.unit().to(unit) as f32
            } else {
                1.0
            };
            grids.push(StoredGrid::Attribute(store, own, factor));
        }
        let written = file.write_streamed_to(staged.path(), &grids)?;
        staged.commit()?;
        let mut files = vec![OutputFile {
            content_hash: Some(written.content_hash),
            ..output::file_entry(path, Some(unit))?
        }];
        // The scene names all grids of the file: the words, then the level sets that are none of them.
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
            let text = crate::pipeline::outputs::usda::scene(path, unit, bounds, &names);
            write_bytes(&scene, text.as_bytes())?;
            files.push(output::file_entry(&scene, Some(unit))?);
        }
        Ok(files)
    }
}
