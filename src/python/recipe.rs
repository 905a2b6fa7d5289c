//! Recipes and the command line as Python objects and functions. Reports and estimates are passed as JSON text,
//! which the package parses.

use crate::arrays::{self, Points};
use crate::fault::Fault;
use crate::level_set::{LevelSet, reader};
use crate::session;
use druse::pipeline::{Probe, RunOptions, plan, run_keeping_solid};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;

/// Samples of a field: phi, gradient, distance, element, reference coordinates, weights of the cells.
type Samples<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// A valid recipe.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct Recipe {
    recipe: druse::recipe::Recipe,
    source: String,
}

#[pymethods]
impl Recipe {
    /// A recipe from a file or from a text, with overrides `KEY=VALUE`.
    #[new]
    #[pyo3(signature = (path, text, overrides))]
    fn new(
        path: Option<PathBuf>,
        text: Option<String>,
        overrides: Vec<String>,
    ) -> Result<Self, Fault> {
        let read = match &path {
            Some(path) => druse::recipe::Recipe::read(path, &overrides),
            None => druse::recipe::Recipe::parse(text.as_deref().unwrap_or(""), &overrides),
        };
        let recipe = read?;
        let source = recipe.source().text();
        Ok(Self { recipe, source })
    }

    /// The text, with its overrides as comments.
    fn text(&self) -> &str {
        &self.source
    }

    /// The text's document as JSON, without overrides.
    fn json(&self) -> Result<String, Fault> {
        let read = toml::from_str::<serde_json::Value>(&self.source);
        let document = read.map_err(|e| Fault::Text(e.to_string()))?;
        Ok(document.to_string())
    }

    /// Runs the recipe; returns the report as JSON, and the level set unless the run used bricks or sampled nothing.
    #[pyo3(signature = (program, out, memory, strict, brief, progress=None))]
    #[allow(clippy::too_many_arguments)] // Each is an argument of the Python function.
    fn run(
        &self,
        py: Python<'_>,
        program: Vec<OsString>,
        out: Option<PathBuf>,
        memory: Option<u64>,
        strict: bool,
        brief: bool,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(String, Option<LevelSet>)> {
        session::work(py, progress, |session| {
            let options = RunOptions {
                threads: session.threads.count(),
                memory,
                out,
                strict,
                brief,
                isolated: reader(program),
                ..RunOptions::default()
            };
            let (report, solid) = run_keeping_solid(&self.recipe, &options, session.progress)?;
            Ok((serde_json::to_string(&report)?, solid.map(LevelSet::of)))
        })
    }

    /// The tiled field at points: names of the cells; phi, gradient, distance, element, reference coordinates and
    /// weights, by point.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        program: Vec<OsString>,
        points: Points<'py>,
        exact: bool,
    ) -> PyResult<(Vec<String>, Samples<'py>)> {
        let points = arrays::positions(&points)?;
        let (cells, found) = session::work(py, None, |session| {
            let options = RunOptions {
                threads: session.threads.count(),
                isolated: reader(program),
                ..RunOptions::default()
            };
            let probe = Probe::new(&self.recipe, &options, session.progress)?;
            Ok((probe.cells(), probe.evaluate(points, exact)?))
        })?;
        // Each point has one weight for each cell; the caller reshapes the list.
        let weights: Vec<f64> = found.iter().flat_map(|s| s.weights.clone()).collect();
        let samples = (
            PyArray1::from_vec(py, found.iter().map(|s| s.phi).collect()),
            arrays::matrix(py, found.iter().map(|s| s.gradient).collect())?,
            PyArray1::from_vec(py, found.iter().map(|s| s.distance).collect()),
            PyArray1::from_vec(py, found.iter().map(|s| s.element).collect()),
            arrays::matrix(py, found.iter().map(|s| s.reference).collect())?,
            PyArray1::from_vec(py, weights),
        );
        Ok((cells, samples))
    }

    /// What a run needs and writes, as JSON.
    fn estimate(&self, py: Python<'_>, program: Vec<OsString>) -> PyResult<String> {
        session::work(py, None, |session| {
            let options = RunOptions {
                threads: session.threads.count(),
                isolated: reader(program),
                ..RunOptions::default()
            };
            let estimate = plan(&self.recipe, &options, session.progress)?;
            Ok(serde_json::to_string(&estimate)?)
        })
    }
}

/// The JSON schema of recipes.
#[pyfunction]
pub(crate) fn schema() -> String {
    druse::recipe::schema().to_string()
}

/// The command line program: its arguments, the first its name, and the command that starts it anew.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, arguments: Vec<OsString>, program: Vec<OsString>) -> u8 {
    py.detach(|| druse::cli::run_program(arguments, reader(program)))
}
