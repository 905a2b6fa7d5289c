//! A run shared by several machines: a plan as a file, bricks one by one, a merge.

use super::super::error::RunError;
use super::super::inputs::Stock;
use super::super::report::Report;
use super::super::{Clock, RunOptions, conclude, targets, threads};
use super::budget::{brick_bytes, check_disks};
use super::directory::{clear, existing, is_derived, size_of};
use super::{BrickPlan, Yard, check_disk, estimate, gather, lay_out, layout, make_directory};
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Memory of a brick's process when nothing is said, bytes.
const MEMORY: u64 = 2 << 30;
/// Largest plan that is read, bytes.
const LARGEST: u64 = 256 << 20;

/// Plans a run in bricks and writes the plan to a file.
///
/// # Errors
/// As [`run`](super::super::run); [`RunError::Memory`] or [`RunError::Whole`] for a recipe that cannot go
/// through bricks.
pub fn brick_plan(
    recipe: &Recipe,
    path: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<BrickPlan, RunError> {
    let threads = threads(options)?;
    let stock = Stock::load(recipe, &threads, options, progress)?;
    let counts = estimate::counts(&stock, &threads, progress)?;
    let budget = options.memory.unwrap_or(MEMORY);
    let found = lay_out(&stock, &threads, &counts, (budget, options.bricks))?;
    let mut plan = layout(&stock, &found, &counts, &threads, progress)?;
    let home = home(path);
    let file = recipe.source().path.clone().unwrap_or_default();
    plan.recipe = relative(&file, home);
    plan.out = options.out.as_deref().map(|out| relative(out, home));
    let text = serde_json::to_string_pretty(&plan).map_err(|e| refused(path, e.to_string()))?;
    crate::io::atomic::write_bytes(path, format!("{text}\n").as_bytes())?;
    Ok(plan)
}

/// Makes bricks of a plan, leaving those that are there and whole; gives how many were left.
///
/// # Errors
/// As [`run`](super::super::run); [`RunError::Plan`] for a plan that is not what is here.
pub fn make_bricks(
    path: &Path,
    bricks: &[Range<usize>],
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<usize, RunError> {
    let (plan, recipe) = read(path)?;
    for range in bricks {
        if range.end > plan.bricks.len() || range.is_empty() {
            return Err(refused(
                path,
                format!(
                    "it has bricks 0 to {}; asked for {} to {}",
                    plan.bricks.len().saturating_sub(1),
                    range.start,
                    range.end.saturating_sub(1)
                ),
            ));
        }
    }
    let threads = threads(options)?;
    let stock = Stock::load(&recipe, &threads, options, progress)?;
    let yard = yard(path, plan, &stock, &threads, progress)?;
    make_directory(&yard.directory)?;
    let asked: usize = bricks.iter().map(ExactSizeIterator::len).sum();
    let share = yard.plan.leaf_bytes / yard.plan.bricks.len().max(1) as u64;
    check_disk(&yard.directory, share.saturating_mul(asked as u64))?;
    let mut left = 0;
    for range in bricks {
        left += yard.make(range.clone()).map_err(|e| yard.stopped(e))?.1;
    }
    Ok(left)
}

/// Puts the bricks of a plan together and writes the recipe's outputs.
///
/// # Errors
/// As [`make_bricks`]; [`RunError::Bricks`] names those that are missing or damaged.
pub fn merge_bricks(
    path: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Report, RunError> {
    let (plan, recipe) = read(path)?;
    let mut clock = Clock::new(progress);
    let threads = threads(options)?;
    let stock = Stock::load(&recipe, &threads, options, progress)?;
    let yard = yard(path, plan, &stock, &threads, progress)?;
    let planned = yard.plan.out.as_ref().map(|out| home(path).join(out));
    let out = options.out.clone().or(planned);
    let outputs = targets(&stock, out.as_deref())?;
    clock.lap("inputs")?;
    let bricks = brick_bytes(&stock, yard.plan.leaf_bytes);
    let later = bricks.saturating_sub(size_of(&yard.directory));
    let files = estimate::disk(&stock, &threads, yard.plan.leaf_bytes);
    let place = outputs.files.first().and_then(|(_, path)| path.parent());
    let place = existing(place.unwrap_or(Path::new(".")));
    check_disks((&yard.directory, later), (place, files))?;
    let made = gather(&yard, Some(path), (&outputs, options.brief), &mut clock);
    let mut parts = made.map_err(|e| yard.stopped(e))?;
    if let Some(bricks) = &mut parts.bricks {
        bricks.found_whole = bricks.count;
    }
    let directory = yard.directory.clone();
    let report = conclude(stock, parts, (&threads, options.brief), &outputs, clock)?;
    // The bricks are the user's; what was made of them here is not needed again.
    clear(&directory, is_derived);
    Ok(report)
}

/// Where the bricks of a plan are: beside it.
fn directory(plan: &Path) -> PathBuf {
    plan.with_extension("bricks")
}

/// The directory that paths of a plan start from.
fn home(plan: &Path) -> &Path {
    plan.parent().unwrap_or(Path::new(""))
}

fn refused(path: &Path, message: String) -> RunError {
    RunError::Plan {
        plan: path.to_owned(),
        message,
    }
}

fn read(path: &Path) -> Result<(BrickPlan, Recipe), RunError> {
    let failed = |e| crate::io::ReadError::io(path, e);
    if std::fs::metadata(path).map_err(failed)?.len() > LARGEST {
        return Err(refused(
            path,
            format!("more than {LARGEST} bytes; expected a plan"),
        ));
    }
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let plan: BrickPlan = serde_json::from_str(&text)
        .map_err(|e| refused(path, format!("{e}; expected a plan made by druse plan")))?;
    plan.check().map_err(|m| refused(path, m))?;
    let file = home(path).join(&plan.recipe);
    if !file.is_file() {
        let message = format!(
            "its recipe {} is not here ({}); keep plan and recipe as they lay to each other",
            plan.recipe.display(),
            file.display()
        );
        return Err(refused(path, message));
    }
    let recipe = Recipe::read(&file, &plan.set)?;
    Ok((plan, recipe))
}

/// The bricks of a plan, if it is of what is here.
fn yard<'a>(
    path: &Path,
    plan: BrickPlan,
    stock: &'a Stock,
    threads: &'a Threads,
    progress: &'a dyn Progress,
) -> Result<Yard<'a>, RunError> {
    let found = plan.differences(stock);
    if !found.is_empty() {
        let message = format!("it is not of what is here: {}", found.join("; "));
        return Err(refused(path, message));
    }
    Ok(Yard::new(stock, plan, directory(path), threads, progress))
}

/// A path as seen from a directory; as it is where the two have nothing in common.
fn relative(path: &Path, from: &Path) -> PathBuf {
    let whole = |p: &Path| std::path::absolute(p).ok();
    let (Some(path_whole), Some(from)) = (whole(path), whole(from)) else {
        return path.to_owned();
    };
    let parts = |p: &Path| -> Vec<std::ffi::OsString> {
        p.components().map(|c| c.as_os_str().to_owned()).collect()
    };
    let (to, from) = (parts(&path_whole), parts(&from));
    let common = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    let up = from[common..]
        .iter()
        .map(|_| std::ffi::OsString::from(".."));
    up.chain(to[common..].iter().cloned()).collect()
}
