//! The extension module `druse._druse`: thin classes over the library, which the package `druse` wraps.
//!
//! The package checks and converts arrays, and documents the interface; this module holds the data and calls the
//! library. Every call that works longer than a moment goes through `session`: without the interpreter's lock, with
//! progress, and interruptible.

// The interpreter passes arguments by value.
#![allow(clippy::needless_pass_by_value)]

use pyo3::prelude::*;

mod arrays;
mod callable;
mod cell;
mod fault;
mod level_set;
mod mesh;
mod properties;
mod recipe;
mod scaffold;
mod session;
mod tiling;

/// The version, the classes and the functions.
#[pymodule]
fn _druse(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<cell::Cell>()?;
    module.add_class::<level_set::LevelSet>()?;
    module.add_class::<mesh::Mesh>()?;
    module.add_class::<recipe::Recipe>()?;
    module.add_class::<scaffold::Scaffold>()?;
    module.add_class::<tiling::Tiling>()?;
    module.add_function(wrap_pyfunction!(level_set::build::from_dense, module)?)?;
    module.add_function(wrap_pyfunction!(level_set::build::from_function, module)?)?;
    module.add_function(wrap_pyfunction!(level_set::build::from_leaves, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::crystal, module)?)?;
    module.add_function(wrap_pyfunction!(properties::design, module)?)?;
    module.add_function(wrap_pyfunction!(properties::homogenize, module)?)?;
    module.add_function(wrap_pyfunction!(recipe::main, module)?)?;
    module.add_function(wrap_pyfunction!(recipe::schema, module)?)?;
    module.add_function(wrap_pyfunction!(session::set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(session::threads, module)?)?;
    Ok(())
}
