//! What all stages of a run share: errors, the report's data, warnings, threads and voxels. A stage is one timed
//! step of a run: reading, sampling, each operation, each measure, each output.
//! The files here use the recipe, geometry and OpenVDB, and none of the modules of the stages.

pub mod chain;
pub mod context;
pub mod deck_facts;
pub mod error;
pub mod histogram;
pub mod layer_facts;
pub mod memory;
pub mod offset;
pub mod report;
pub mod requirement;
pub mod shape;
pub mod stage_timer;
pub mod void_facts;
pub mod warning;
