//! From a recipe to files: the only module that knows all stages.
//!
//! [`plan`] predicts a run, [`run`] makes it: read the inputs, make the solid one field, sample its
//! band, operate on the level set, measure, write. Until the first operation that needs neighbours all
//! is a field; until the outputs nothing is written, and each output appears whole or not at all.
//!
//! ```
//! use druse::pipeline::{RunOptions, run};
//! use druse::progress::Silent;
//! use druse::recipe::Recipe;
//! let text = "druse = 1\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
//! let recipe = Recipe::parse(text, &[]).unwrap();
//! let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
//! let ball = 4.0 / 3.0 * std::f64::consts::PI * 125.0;
//! assert!((report.solid.volume / ball - 1.0).abs() < 0.01);
//! ```

use crate::band::BandStats;
use crate::progress::{Cancelled, Progress, Threads};
use crate::recipe::{OutputKind, Recipe};
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

mod attributes;
mod beams;
mod bricks;
mod cells;
mod crystals;
mod cut_faces;
mod decimate;
mod deck;
mod error;
mod estimate;
mod field_data;
mod field_grid;
mod field_ops;
mod fit_options;
mod fractions;
mod grading;
mod group;
mod homogenize;
mod input_files;
mod inputs;
mod lattice;
mod least_wall;
mod level_set_ops;
mod memory;
mod meshing;
mod nearest;
mod offsets;
mod output;
mod palette;
mod period_samples;
mod plot;
mod precision;
mod report;
mod requirements;
mod round_beams;
mod sampling;
mod scaffold;
mod scattered_data;
mod sheets;
mod slices;
mod source;
mod spatial_bins;
mod spatial_value;
mod standalone;
mod thickness;
mod tiling;
mod usda;
mod volumes;
mod voxels;

pub use bricks::{BrickPlan, brick_plan, make_bricks, merge_bricks};
pub use cells::{levelled, make_cell, one_element, own_element, read_source};
pub use crystals::{CrystalScript, crystal_script};
pub use error::RunError;
pub use estimate::Estimate;
pub use fit_options::fit_options;
pub use group::{group_fault, read_group};
pub use homogenize::{
    CellPeriod, beam_period, cell_period, free_memory, period_fault, recipe_period,
};
pub use lattice::solid_picture;
pub use plot::{
    Curve, Plot, SweepCurve, modulus_picture, plot, sheet, sheet_columns, sweep_picture,
};
pub use report::{
    Asked, BandReport, BricksReport, ContinuityReport, Input, MeshFacts, OffsetReport, OutputFile,
    Report, ScaffoldReport, SolidReport, Stage, ThicknessReport, Warning, Way,
};
pub use requirements::{Requirement, judge_level_set, judge_mesh};
pub use sampling::{Probe, Probed};
pub use source::{CellFault, enter_source};

pub use slices::{SliceOptions, Sliced, slice};

use cut_faces::CutFaces;
use inputs::Stock;
use least_wall::Phase;
use level_set_ops::Bench;
use thickness::{Lattice, Measured, Thickness, sampled_walls};

/// How a recipe is run.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Worker threads; 0 means one per core.
    pub threads: usize,
    /// Memory that the run may use, bytes; what the machine has when left out.
    pub memory: Option<u64>,
    /// Go through bricks of so many blocks of 128 voxels a side, whatever memory there is. When left
    /// out a run does so only if it would need more memory than it may use, with bricks that fit.
    pub bricks: Option<u32>,
    /// Directory of the outputs; the recipe's own when left out. With it, `report.json` is always
    /// written.
    pub out: Option<PathBuf>,
    /// Whether a warning ends the run.
    pub strict: bool,
    /// Whether measures of the solid that take time, and that no output needs, are left away: walls,
    /// and the mesh of a run that writes none.
    pub brief: bool,
    /// The child process that opens `.vdb` files of others; without one they are read in this process,
    /// which a damaged file can bring down.
    pub isolated: Option<crate::vdb::subprocess::Program>,
    /// A grid of such a file that has been read already: the run takes it instead of reading it again.
    pub opened: Option<crate::vdb::subprocess::Opened>,
}

/// Predicts what [`run`] would need and make, in a few seconds.
///
/// # Errors
/// As [`run`], but for outputs; too little memory is no error here.
pub fn plan(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Estimate, RunError> {
    let threads = threads(options)?;
    let stock = Stock::load(recipe, &threads, options, progress)?;
    let mut found = estimate::estimate(&stock, &threads, progress)?;
    match bricks::decide(&stock, &threads, options, progress) {
        Ok(Some(plan)) => {
            found.bricks = plan.bricks.len() as u64;
            found.brick_bytes = bricks::brick_bytes(&stock, &plan);
            found.peak_memory_bytes = plan.memory_bytes;
        }
        Ok(None)
        | Err(RunError::Memory { .. } | RunError::Whole { .. } | RunError::Budget { .. }) => {}
        Err(other) => return Err(other),
    }
    Ok(found)
}

/// Runs a recipe to its files.
///
/// # Errors
/// [`RunError`]: what is wrong with the recipe, an input, an output or the solid; too little memory,
/// before anything large is made; or the user stopped it.
pub fn run(
    recipe: &Recipe,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Report, RunError> {
    let threads = threads(options)?;
    let sections = recipe.sections();
    let mut clock = Clock::new(progress);
    let mut stock = Stock::load(recipe, &threads, options, progress)?;
    let outputs = targets(&stock, options.out.as_deref())?;
    clock.lap("inputs")?;

    let needs_bricks = bricks::decide(&stock, &threads, options, progress)?;
    clock.lap("estimate")?;
    if let Some(plan) = needs_bricks {
        let parts = bricks::run(&stock, plan, options, &threads, &outputs, &mut clock)?;
        return conclude(stock, parts, (&threads, options.brief), &outputs, clock);
    }

    let mut bench = Bench::new(recipe, &threads, progress);
    let first = stock.pointwise();
    let (mut solid, stats) = if let Some(start) = stock.volumes.take_start() {
        (start, BandStats::default())
    } else {
        stock.begin_visits();
        bench.sample(&field_ops::shape(&stock, bench.scale)?, "band")?
    };
    clock.lap("band")?;

    let mut measured = SolidReport::default();
    for (n, op) in sections.op.iter().enumerate().skip(first) {
        level_set_ops::apply(&mut bench, &stock, (n, op), &mut solid, &mut measured)?;
        clock.lap(&format!("op.{n}.{}", op.name()))?;
    }

    let wanted = !options.brief || outputs.want_a_mesh();
    let mesh = measure(
        bench,
        &stock,
        &solid,
        &mut measured,
        (wanted, !options.brief),
        &mut clock,
    )?;
    let info = solid.info().map_err(RunError::level_set("counting"))?;
    let band = BandReport {
        voxel_size: bench.scale.voxel_size,
        half_width: bench.half_width,
        active_voxels: info.active_voxels,
        leaves: info.leaves,
        active_voxels_sampled: stats.active_voxels,
        leaves_touched: stats.leaves_touched,
        leaves_kept: stats.leaves_kept,
        voxels_evaluated: stats.voxels_evaluated,
        ..BandReport::default()
    };
    let measured_mesh = mesh.as_ref().filter(|_| outputs.want_thickness());
    let thickness = measured_mesh.map(|mesh| {
        let thickness = Thickness::of_mesh(bench, mesh, to_measure(bench, &solid, mesh)?)?;
        clock.lap("thickness")?;
        Ok::<_, RunError>(thickness)
    });
    let thickness = thickness.transpose()?;
    // What only told the solid's measures makes room.
    let mesh = mesh.filter(|_| outputs.write_meshes());
    let done = output::Finished {
        stock: &stock,
        solid: &solid,
        mesh: mesh.as_ref(),
        thickness: thickness.as_ref(),
    };
    let mut written = Vec::new();
    for (output, path) in &outputs.files {
        written.extend(output::write(bench, done, output, path)?);
        clock.lap("write")?;
    }
    let parts = Parts {
        band,
        solid: measured,
        bricks: None,
        outputs: written,
    };
    conclude(stock, parts, (&threads, options.brief), &outputs, clock)
}

/// What a run has found and made.
struct Parts {
    band: BandReport,
    solid: SolidReport,
    bricks: Option<BricksReport>,
    outputs: Vec<OutputFile>,
}

/// Looks at what was made, and writes the report.
fn conclude(
    mut stock: Stock,
    parts: Parts,
    (threads, is_brief): (&Threads, bool),
    outputs: &Targets,
    mut clock: Clock,
) -> Result<Report, RunError> {
    let scale = crate::recipe::Scale {
        voxel_size: parts.band.voxel_size,
        ..stock.recipe.scale()
    };
    stock.look_at(&parts.solid, scale)?;
    let mut continuity = None;
    if let Some(fill) = stock.fill().filter(|_| wants_certificate(stock.recipe)) {
        let found = threads.install(|| fill.certificate())?;
        continuity = Some(ContinuityReport::from(&found));
        clock.lap("certificate")?;
    }
    for message in parts.outputs.iter().filter_map(deck::dropped) {
        stock.warn(Warning::DECK, message)?;
    }
    if let Some(message) = continuity.as_ref().and_then(ContinuityReport::warning) {
        stock.warn(Warning::CONTINUITY, message)?;
    }
    let mut report = Report {
        band: BandReport {
            elements_visited: stock.elements_visited(),
            leaves_by_nodes: stock.leaves_by_nodes(),
            kernel: stock.kernel(),
            ..parts.band
        },
        solid: parts.solid,
        bricks: parts.bricks,
        outputs: parts.outputs,
        threads: threads.count(),
        continuity,
        ..stock.report()
    };
    if let Some(require) = stock
        .recipe
        .sections()
        .require
        .as_ref()
        .filter(|_| !is_brief)
    {
        report.solid.mass = requirements::mass(require, &report.solid, scale.unit);
        report.requirements = requirements::judge(require, &report, scale);
    }
    report.stages = clock.stages;
    report.peak_memory_bytes = memory::peak();
    for path in &outputs.reports {
        let text = serde_json::to_string_pretty(&report)
            .map_err(|e| RunError::Empty(format!("writing the report: {e}")))?;
        crate::io::atomic::write_bytes(path, format!("{text}\n").as_bytes())?;
    }
    Ok(report)
}

/// Whether the recipe asks for its continuity to be measured.
fn wants_certificate(recipe: &Recipe) -> bool {
    let tiling = recipe.sections().tiling.as_ref();
    let require = recipe.sections().require.as_ref();
    tiling.is_some_and(|t| t.certificate) || require.is_some_and(|r| r.value_jump_max.is_some())
}

fn threads(options: &RunOptions) -> Result<Threads, RunError> {
    Threads::new(options.threads).map_err(|e| RunError::Threads(e.to_string()))
}

/// Volume, area, pieces, and as wanted mesh and walls of the solid; gives its mesh.
fn measure(
    bench: Bench,
    stock: &Stock,
    solid: &crate::vdb::LevelSet,
    report: &mut SolidReport,
    (wants_mesh, wants_walls): (bool, bool),
    clock: &mut Clock,
) -> Result<Option<crate::mesh::TriMesh>, RunError> {
    let failed = RunError::level_set("measure");
    let session = bench.session();
    if !wants_mesh {
        let found = solid.measures(session).map_err(&failed)?;
        report.volume = found.volume;
        report.area = found.area;
        report.components = found.components;
        report.bounds = Some(found.bounds);
        clock.lap("measure")?;
        return Ok(None);
    }
    bench.progress.stage("mesh", None);
    let mesh = solid.to_mesh(session).map_err(&failed)?;
    if mesh.is_empty() {
        let last = stock.recipe.sections().op.len();
        return Err(RunError::Empty(match last {
            0 => "sampling".into(),
            n => format!("op.{}", n - 1),
        }));
    }
    clock.lap("mesh")?;
    bench.progress.stage("measure", None);
    // Of the mesh, which is what leaves; OpenVDB's own measure errs by as much to the other side.
    let found = bench.threads.install(|| mesh.measures());
    report.volume = found.volume;
    report.area = found.area;
    report.components = solid.components(session).map_err(&failed)?.len() as u64;
    report.bounds = Some(found.bounds);
    (report.volume_fraction_asked, report.volume_fraction_cell) = stock.fractions();
    report.volume_fraction = stock.room().map(|room| report.volume / room);
    clock.lap("measure")?;
    if !wants_walls {
        return Ok(Some(mesh));
    }
    let measured = to_measure(bench, solid, &mesh)?;
    let walls = sampled_walls(bench, &mesh, measured, Phase::Solid)?;
    let cut = CutFaces::new(stock, bench.scale.voxel_size);
    report.add_walls(walls, stock.thickness_asked(), &cut, bench.threads);
    clock.lap("walls")?;
    if let Some(require) = &stock.recipe.sections().require {
        requirements::measure(require, bench, (solid, &mesh, measured), report)?;
        clock.lap("requirements")?;
    }
    Ok(Some(mesh))
}

/// What measures of its walls need to know of a solid.
fn to_measure(
    bench: Bench,
    solid: &crate::vdb::LevelSet,
    mesh: &crate::mesh::TriMesh,
) -> Result<Measured, RunError> {
    let counted = solid.active_voxels();
    Ok(Measured {
        lattice: Lattice {
            origin: solid.origin(),
            voxel_size: bench.scale.voxel_size,
        },
        active_voxels: counted.map_err(RunError::level_set("counting"))?,
        extent: mesh.bounds().size().max() / bench.scale.voxel_size,
    })
}

/// Outputs with their paths.
struct Targets<'a> {
    files: Vec<(&'a crate::recipe::Output, PathBuf)>,
    reports: Vec<PathBuf>,
}

impl Targets<'_> {
    /// The outputs of a kind.
    fn of(&self, kind: OutputKind) -> impl Iterator<Item = (&crate::recipe::Output, &PathBuf)> {
        let is_wanted = move |o: &crate::recipe::Output| o.named().iter().any(|n| n.0 == kind);
        let files = self
            .files
            .iter()
            .filter(move |(output, _)| is_wanted(output));
        files.map(|(output, path)| (*output, path))
    }

    fn want_a_mesh(&self) -> bool {
        self.want_thickness() || self.write_meshes()
    }

    fn write_meshes(&self) -> bool {
        self.files.iter().any(|(output, _)| output.mesh.is_some())
    }

    fn want_thickness(&self) -> bool {
        self.files.iter().any(|(o, _)| o.holds_thickness())
    }
}

/// Resolves the outputs, refuses those that would overwrite an input, and makes the directory asked
/// for.
fn targets<'a>(stock: &Stock<'a>, out: Option<&Path>) -> Result<Targets<'a>, RunError> {
    let recipe = stock.recipe;
    let mut targets = Targets {
        files: Vec::new(),
        reports: Vec::new(),
    };
    for output in &recipe.sections().output {
        for (kind, path) in output.named() {
            let path = output::target(recipe, out, path);
            if stock.is_input(&path) {
                return Err(RunError::Overwrite(path));
            }
            match kind {
                OutputKind::Report => targets.reports.push(path),
                _ => targets.files.push((output, path)),
            }
        }
    }
    if let Some(out) = out {
        std::fs::create_dir_all(out).map_err(|e| crate::io::WriteError::Create {
            path: out.to_owned(),
            reason: e.to_string(),
        })?;
        if targets.reports.is_empty() {
            targets.reports.push(out.join("report.json"));
        }
    }
    Ok(targets)
}

/// Measures stages and asks after each whether to go on.
struct Clock<'a> {
    progress: &'a dyn Progress,
    began: SystemTime,
    last: Instant,
    stages: Vec<Stage>,
}

impl<'a> Clock<'a> {
    fn new(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            began: SystemTime::now(),
            last: Instant::now(),
            stages: Vec::new(),
        }
    }

    /// Ends a stage; equal names in a row are one.
    fn lap(&mut self, name: &str) -> Result<(), Cancelled> {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        match self.stages.last_mut() {
            Some(stage) if stage.name == name => {
                stage.seconds += seconds;
                stage.peak_memory_bytes = memory::peak();
            }
            _ => self.stages.push(Stage {
                name: name.to_owned(),
                seconds,
                peak_memory_bytes: memory::peak(),
            }),
        }
        if self.progress.cancelled() {
            return Err(Cancelled);
        }
        Ok(())
    }
}
