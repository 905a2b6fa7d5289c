//! From a recipe to files: the module that connects all stages.
//!
//! [`plan`] predicts a run. [`run`] executes it: it reads the inputs, combines them into one field, samples
//! the narrow band, applies level-set operations, measures the solid and writes the outputs atomically.
//! Not promised: outputs do not appear all at once; a file that is complete stays where a later one fails, and a
//! requirement that is not met is no error of [`run`]: the [`Report`] has it.
//!
//! ```
//! use druse::pipeline::{RunOptions, run};
//! use druse::progress::Silent;
//! use druse::recipe::Recipe;
//! let text = "druse = 1\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
//! let recipe = Recipe::parse(text, &[]).unwrap();
//! let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
//! let volume = 4.0 / 3.0 * std::f64::consts::PI * 125.0;
//! assert!((report.solid.volume / volume - 1.0).abs() < 0.01);
//! ```

mod base;
mod bricks;
mod content;
mod effective;
mod estimate;
mod field;
mod frames;
mod grade;
mod homogenize;
mod inputs;
mod measure;
mod ops;
mod outputs;
mod plot;
mod run;
mod sampling;
mod slices;
mod view;

pub use base::deck_facts::{MacroDeckFacts, MacroLawFacts};
pub(crate) use base::error::shell_word;
pub use base::error::{CellFault, RunError};
pub use base::histogram::Histogram;
pub use base::layer_facts::{BuildReport, ProfileStep, StartReport};
pub use base::report::{
    BandReport, BricksReport, ContinuityReport, Input, MeshFacts, OffsetMethod, OffsetReport,
    OutputFile, Report, RequestedThickness, ScaffoldReport, SolidReport, Stage, ThicknessReport,
};
pub use base::requirement::Requirement;
pub use base::void_facts::{CavitiesReport, CavityReport, DrainReport};
pub use base::warning::Warning;
pub use bricks::{BrickPlan, brick_plan, make_bricks, merge_bricks};
pub(crate) use bricks::{check_overridden_outputs, out_of_plan, relative_path};
pub use content::grading::{GradedQuantity, level_shifts};
pub use estimate::Estimate;
pub use frames::{
    check_frames, check_output_tokens, check_series, finished_frame, frame_report,
    write_sequence_scenes,
};
pub use grade::{GradeOptions, GradeReport, GradeRule, grade};
pub use homogenize::{
    CellPeriod, CellProperties, PropertyOptions, beam_period, cell_period, cell_properties,
    period_warnings, resolution_fault,
};
pub(crate) use homogenize::{recipe_period, sampled, shares_of};
pub use inputs::cells::{make_cell, own_element, with_level};
pub(crate) use inputs::cells::{one_element, read_source};
pub(crate) use inputs::crystals::{clock_parameters, crystal_script};
pub(crate) use inputs::fit_options::fit_options;
pub(crate) use inputs::group::{group_fault, read_group};
pub(crate) use inputs::lattice::solid_picture;
pub use inputs::run_cache::RunCache;
pub use inputs::run_options::RunOptions;
pub(crate) use inputs::scaffold::{CadMesh, CadOptions, TetFilling, cad_mesh, outer_mesh};
pub use inputs::source::set_source;
pub use inputs::targets::design;
pub(crate) use measure::file_measures::{level_set_cavities, level_set_layers};
pub(crate) use measure::requirements::{judge_level_set, judge_mesh};
pub use plot::{Curve, Plot, contact_sheet, contact_sheet_columns, plot};
pub(crate) use plot::{SweepCurve, modulus_picture, sweep_picture};
pub use run::{plan, run, run_keeping_solid};
pub(crate) use sampling::FieldSample;
#[doc(hidden)]
pub use sampling::Probe;
pub use slices::{SliceOptions, SliceSummary, slice};
pub(crate) use view::{cell_block, few_triangles, scaffold_of, solid_extent, wall_thickness};

pub(crate) use outputs::output_targets::{REPORT_NAME, check_confined};
