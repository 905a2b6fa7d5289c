//! The part of a recipe in steps of finer voxels: a first picture soon, up to the recipe's own voxels where they
//! are few. Each step is a run without files; coarse steps leave out operations that need fine voxels. The full
//! run with all files is here too.

use super::elements::Elements;
use super::load;
use super::recipe_text::{Edit, RecipeText};
use super::sampled::{Grid, Sampled};
use super::work::{Subject, TaskProgress, Work, no_recipe};
use crate::cli::failure::Failure;
use crate::cli::server::{Refused, inside};
use crate::frame::Aabb;
use crate::io::WriteError;
use crate::io::atomic::AtomicFile;
use crate::pipeline::{
    Report, RunError, RunOptions, Warning, plan, run, run_keeping_solid, scaffold_of, solid_extent,
};
use crate::progress::Progress;
use crate::recipe::Recipe;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{ErrorKind, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Active voxels of the steps, about.
const LEVEL_VOXELS: [f64; 3] = [1e5, 8e5, 5e6];
/// Time that the first step of a change is to take, without reading files and fitting cells, seconds.
const FIRST_STEP_SECONDS: f64 = 0.35;
/// Share of its voxels that the first step keeps at least to be done in that time: in coarser ones a part falls apart.
const MIN_FIRST_SHARE: f64 = 0.7;
/// Share of the box's voxels that is active in a lattice of coarse voxels.
const ACTIVE_SHARE: f64 = 0.3;
/// Growth of the number of active voxels with their inverse edge: between a surface and a structure as fine as its
/// band.
const VOXEL_GROWTH: f64 = 2.3;
/// Operations that steps of coarse voxels leave out: their widths count voxels, so that coarse ones erase walls, or
/// they need walls that coarse voxels lack.
const FINE_OPERATIONS: [&str; 7] = [
    "gaussian",
    "mean",
    "median",
    "laplacian",
    "curvature",
    "keep_largest",
    "drain",
];
/// Ratio of voxel sizes below which a finer step shows nothing new.
const MIN_REFINEMENT: f64 = 1.25;

/// A finished step.
struct Step {
    /// From 1.
    number: usize,
    report: Report,
    sampled: Arc<Sampled>,
    /// The changes that it is made with.
    edit: Edit,
    /// Operations that its coarse voxels leave out.
    left_out: String,
}

/// Computes the part of a changed recipe and publishes each step, then the estimate of the full run, then wall
/// thickness. A cancellation or a failure keeps what is published.
pub(super) fn show(
    work: &Work,
    text: &RecipeText,
    edit: &Edit,
    progress: &TaskProgress,
) -> Result<(), Failure> {
    let own_text = text.with(edit);
    let recipe = Recipe::embedded(text.path(), &own_text)?;
    let (coarse_edit, left_out) = text.without(&FINE_OPERATIONS, edit);
    let coarse_text = text.with(&coarse_edit);
    let own_size = recipe.scale().voxel_size;
    let options = options(work)?;
    if work.state().published.is_none() {
        show_scaffold(work, &recipe, &options, progress)?;
    }
    let known = work.state().coarse_size;
    let first = match known {
        Some(size) => Some(size),
        None => first_size(&recipe, &options, progress)?,
    };
    let mut size = first.map_or(own_size, |size| size.max(own_size));
    let mut last: Option<Step> = None;
    // Each step has about so many active voxels; the last is on the recipe's own voxels if these are few.
    for number in 1..=LEVEL_VOXELS.len() {
        let is_own = size <= own_size;
        let is_last = is_own || number == LEVEL_VOXELS.len();
        let (used, used_edit) = if is_own {
            (&own_text, edit)
        } else {
            (&coarse_text, &coarse_edit)
        };
        let step_recipe = at_voxel_size(text.path(), used, &recipe, (!is_own).then_some(size))?;
        let start = Instant::now();
        let (report, solid) = match run_keeping_solid(&step_recipe, &options, progress) {
            // Walls vanish in coarse voxels.
            Err(RunError::Empty(_)) if !is_last => {
                size = (size / 2.0).max(own_size);
                continue;
            }
            other => other?,
        };
        // A run in bricks keeps no level set.
        let Some(solid) = solid else { break };
        let sampled = Sampled {
            grid: Grid::LevelSet(solid),
            factor: 1.0,
            bounds: report.solid.bounds.unwrap_or(Aabb::EMPTY),
        };
        let step = Step {
            number,
            report,
            sampled: Arc::new(sampled),
            edit: used_edit.clone(),
            left_out: if is_own {
                String::new()
            } else {
                left_out.join(", ").replace('_', " ")
            },
        };
        publish(work, &step, false, progress)?;
        let count = step.report.band.active_voxels.max(1) as f64;
        if number == 1 {
            // The next change begins with the voxels that this part and machine make in the time, over those of a
            // first step; 1 ms is the least that a run takes.
            let seconds = start.elapsed().as_secs_f64() - input_seconds(&step.report);
            let speed_ratio = FIRST_STEP_SECONDS / seconds.max(1e-3) * count / LEVEL_VOXELS[0];
            let wanted = LEVEL_VOXELS[0] * speed_ratio.clamp(MIN_FIRST_SHARE, 1.0);
            let ratio = (count / wanted).powf(1.0 / VOXEL_GROWTH);
            work.state().coarse_size = Some(size * ratio);
        }
        last = Some(step);
        if is_last {
            break;
        }
        // Voxels of the next step: their number grows with edge^-g, so edge = edge (count / wanted)^(1 / g).
        let ratio = (count / LEVEL_VOXELS[number]).powf(1.0 / VOXEL_GROWTH);
        let finer = (size * ratio).max(own_size);
        if finer * MIN_REFINEMENT > size {
            break;
        }
        size = finer;
    }
    progress.stage("estimate", None);
    let estimate = plan(&recipe, &options, progress)?;
    work.state().estimate = Some(serde_json::to_value(estimate).unwrap_or_default());
    // Wall thickness takes long, so it comes last and for the finest step alone.
    match last.filter(|_| !work.p.no_thickness) {
        Some(step) => publish(work, &step, true, progress),
        None => Ok(()),
    }
}

/// Time that a run took to read files and to fit cells, seconds.
fn input_seconds(report: &Report) -> f64 {
    let inputs = report.stages.iter().filter(|s| s.name == "inputs");
    inputs.map(|s| s.seconds).sum()
}

/// Publishes the scaffold, which shows where the part will be until its first step is made.
fn show_scaffold(
    work: &Work,
    recipe: &Recipe,
    options: &RunOptions,
    progress: &TaskProgress,
) -> Result<(), Failure> {
    progress.stage("scaffold", None);
    let Some((scaffold, groups)) = scaffold_of(recipe, options)? else {
        return Ok(());
    };
    let elements = Elements {
        scaffold: &scaffold,
        groups: &groups,
        fields: &[],
    };
    let mut scene = load::scaffold_scene(work.p, elements, &[]);
    scene.kind = "recipe";
    recipe.scale().unit.symbol().clone_into(&mut scene.unit);
    let result = json!({ "step": 0, "steps": LEVEL_VOXELS.len(), "shows": "scaffold" });
    work.publish(&scene, None, result, progress)
}

/// The options of all runs of a page: brief, with a child that reads files, and with the page's cache.
fn options(work: &Work) -> Result<RunOptions, Failure> {
    Ok(RunOptions {
        threads: work.p.threads,
        brief: true,
        isolated: Some(crate::cli::vdb::reader()?),
        cache: Some(work.cache.clone()),
        ..RunOptions::default()
    })
}

/// The recipe with voxels of another `size` (recipe units; `None` keeps its own), and without files and
/// certificate. The overrides are comments behind the text, as a run's files hold them.
fn at_voxel_size(
    path: &Path,
    text: &str,
    recipe: &Recipe,
    size: Option<f64>,
) -> Result<Recipe, Failure> {
    let mut text = text.to_owned();
    if !text.ends_with('\n') {
        text.push('\n');
    }
    text.push_str("# --set output=[]\n");
    let tiling = recipe.sections().tiling.as_ref();
    if tiling.is_some_and(|t| t.certificate) {
        text.push_str("# --set tiling.certificate=false\n");
    }
    if let Some(size) = size {
        let _ = writeln!(text, "# --set band.voxel_size={size}");
    }
    Ok(Recipe::embedded(path, &text)?)
}

/// The edge of the voxels of the first step, recipe units, from the box of the solid; `None` where the box is
/// unknown or empty.
fn first_size(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &TaskProgress,
) -> Result<Option<f64>, Failure> {
    let extent = solid_extent(recipe, options, progress)?;
    let volume = extent.map(|e| e.size().product()).filter(|v| *v > 0.0);
    Ok(volume.map(|v| (ACTIVE_SHARE * v / LEVEL_VOXELS[0]).cbrt()))
}

/// Meshes and publishes the solid of a step, with or without wall thickness, and the warnings of its run.
fn publish(
    work: &Work,
    step: &Step,
    has_thickness: bool,
    progress: &TaskProgress,
) -> Result<(), Failure> {
    let report = &step.report;
    let Grid::LevelSet(solid) = &step.sampled.grid else {
        return Ok(());
    };
    let tools = crate::vdb::Session::new(&work.threads, progress);
    progress.stage("meshing", None);
    let unit = report.unit.as_str();
    let mut scene = work
        .threads
        .install(|| load::solid_scene(work.p, solid, unit, has_thickness, tools, progress))?;
    let size = report.band.voxel_size;
    scene
        .facts
        .push(["voxel".into(), load::with_unit(size, unit)]);
    let count = crate::cli::numbers::grouped(report.band.active_voxels);
    scene.facts.push(["active voxels".into(), count]);
    if !step.left_out.is_empty() {
        scene.facts.push(["left out".into(), step.left_out.clone()]);
    }
    let result = json!({
        "step": step.number, "steps": LEVEL_VOXELS.len(), "thickness": has_thickness, "voxelSize": size,
        "unit": unit, "activeVoxels": report.band.active_voxels,
    });
    let mut warnings = warnings(work, report, &step.edit);
    // An operation that coarse voxels leave out removes them.
    if step.left_out.contains("keep largest") {
        warnings.retain(|w| w["code"] != Warning::COMPONENTS);
    }
    work.publish(&scene, Some(Arc::clone(&step.sampled)), result, progress)?;
    work.state().warnings = warnings;
    Ok(())
}

/// The warnings of a run, each with the key that it is about.
fn warnings(work: &Work, report: &Report, edit: &Edit) -> Vec<Value> {
    let Subject::Recipe(text) = &work.subject else {
        return Vec::new();
    };
    let described = report.warnings.iter().map(|w| {
        let key = text.key_of(&w.message, edit).map(str::to_owned);
        let key = key.or_else(|| usual_key(w.code).map(str::to_owned));
        json!({ "code": w.code, "message": w.message, "key": key })
    });
    described.collect()
}

/// The key that a kind of warning is about; `None` for kinds without one.
fn usual_key(code: &str) -> Option<&'static str> {
    match code {
        Warning::THIN_WALLS | Warning::RESAMPLED => Some("band.voxel_size"),
        Warning::SCAFFOLD => Some("scaffold"),
        Warning::THICKNESS | Warning::SECTION => Some("tiling.thickness"),
        Warning::WEIGHTS | Warning::TRANSITION | Warning::CONTINUITY => Some("tiling"),
        Warning::COMPONENTS | Warning::REMOVED_COMPONENTS => Some("op"),
        _ => None,
    }
}

/// Runs the changed recipe with all its files and stores the result for the page. `number` identifies the run, which
/// ends once the request `stop` draws another one.
pub(super) fn run_full(work: &Work, text: &RecipeText, edit: &Edit, number: u64) {
    let progress = work.progress_of(&work.full, number);
    let done = super::work::caught(|| {
        let recipe = Recipe::embedded(text.path(), &text.with(edit))?;
        let options = RunOptions {
            brief: false,
            out: work.p.out.clone(),
            ..options(work)?
        };
        Ok(run(&recipe, &options, &progress)?)
    });
    let full = match done {
        Ok(report) => {
            let files = report.outputs.iter().map(|o| {
                let size = crate::cli::numbers::size(o.bytes);
                json!({ "path": o.path, "size": size })
            });
            let requirements = report.requirements.iter().map(ToString::to_string);
            json!({
                "running": false, "files": files.collect::<Vec<_>>(), "warnings": warnings(work, &report, edit),
                "requirements": requirements.collect::<Vec<_>>(),
            })
        }
        // A run that was stopped on purpose is no error.
        Err(_) if progress.cancelled() => json!({ "running": false, "cancelled": true }),
        Err(failure) => json!({ "running": false, "error": work.described(&failure, edit) }),
    };
    work.state().full = full;
}

/// Writes the changed recipe beside the original, under a plain name that is new and ends in `.toml`. Returns path
/// and size for the page.
pub(super) fn save(work: &Work, name: &str) -> Result<Value, Refused> {
    let Subject::Recipe(recipe) = &work.subject else {
        return Err(no_recipe());
    };
    let name = Path::new(name.trim());
    let path = inside(recipe.directory(), name).map_err(|message| Refused {
        status: 403,
        message,
    })?;
    if name.extension().is_none_or(|e| e != "toml") {
        return Err(Refused::new(format!(
            "found the name {}; expected one that ends in .toml",
            name.display()
        )));
    }
    let text = recipe.with(&work.state().edit);
    Recipe::embedded(recipe.path(), &text).map_err(|e| Refused::new(e.to_string()))?;
    let taken = || Refused {
        status: 409,
        message: format!("{} exists already; choose another name", path.display()),
    };
    // Also a link that leads nowhere: what it names is not the page's to make.
    if path.symlink_metadata().is_ok() {
        return Err(taken());
    }
    let written = AtomicFile::create(&path).and_then(|mut file| {
        file.write_all(text.as_bytes())
            .map_err(|e| file.failed(e))?;
        file.commit_new()
    });
    match written {
        Ok(bytes) => Ok(json!({ "path": path.display().to_string(), "bytes": bytes })),
        Err(WriteError::Io { error, .. }) if error.kind() == ErrorKind::AlreadyExists => {
            Err(taken())
        }
        Err(e) => Err(Refused::new(e.to_string())),
    }
}
