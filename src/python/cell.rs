//! Unit cells as Python objects: made, fitted, evaluated, saved and pickled. Points and lengths are in reference
//! coordinates; a cell never changes.

use crate::arrays::{self, Points};
use crate::fault::Fault;
use crate::session;
use druse::cell::{FitOptions, Placement, Source, Table, Voxels, fit_samples, fit_source};
use druse::field::Field;
use druse::frame::Element;
use druse::pipeline;
use druse::recipe::CellSection;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Points that one thread evaluates at a time.
const CHUNK_POINTS: usize = 1 << 12;

/// A unit cell with the table that evaluates it fast, once it is needed.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct Cell {
    pub(crate) cell: druse::cell::Cell,
    table: OnceLock<Arc<Table>>,
}

impl Cell {
    /// A cell whose table is not made yet.
    pub(crate) fn of(cell: druse::cell::Cell) -> Self {
        Self {
            cell,
            table: OnceLock::new(),
        }
    }

    /// The table of default accuracy, made at the first use; two threads may both make it.
    pub(crate) fn table(&self) -> Result<&Arc<Table>, Fault> {
        if let Some(table) = self.table.get() {
            return Ok(table);
        }
        let table = Arc::new(Table::new(&self.cell)?);
        Ok(self.table.get_or_init(|| table))
    }
}

#[pymethods]
impl Cell {
    /// The cell of a section with the TOML text `keys`, and warnings; a `source` is a file, a name or a formula.
    #[staticmethod]
    #[pyo3(signature = (name, source, keys, progress=None))]
    fn make(
        py: Python<'_>,
        name: &str,
        source: Option<PathBuf>,
        keys: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Self, Vec<String>)> {
        let (name, keys) = (name.to_owned(), keys.to_owned());
        session::work_owned(py, progress, move |session| {
            let mut section = CellSection::parse(&keys)?;
            if let Some(source) = &source {
                pipeline::set_source(source, &mut section)?;
            }
            let element = pipeline::own_element(&section, &Path::to_path_buf)?;
            let (cell, warnings) = pipeline::make_cell(&name, &section, element, session)?;
            let warnings = warnings.into_iter().map(|w| w.message).collect();
            Ok((Self::of(cell), warnings))
        })
    }

    /// The cell of samples over a period, of shape [n, n, n] or [n, n]; `binary` ones are 1 inside, others negative.
    #[staticmethod]
    #[pyo3(signature = (name, element, samples, shape, binary, band_limit=None, progress=None))]
    #[allow(clippy::too_many_arguments)] // Each is an argument of the Python function.
    fn of_voxels(
        py: Python<'_>,
        name: &str,
        element: &str,
        samples: PyReadonlyArray1<'_, f64>,
        shape: Vec<usize>,
        binary: bool,
        band_limit: Option<f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let samples = arrays::list(&samples, "voxels")?;
        let (name, element, samples) = (name.to_owned(), element.to_owned(), samples.to_vec());
        session::work_owned(py, progress, move |session| {
            let element = Element::from_name(&element)
                .ok_or_else(|| Fault::Argument(format!("no element is named {element:?}")))?;
            let voxels = Voxels::new(&shape, samples, binary)?;
            // Hexes and quads repeat: their samples are a period. Other elements are fitted to the field
            // between the samples.
            if matches!(element, Element::Hex | Element::Quad) {
                let options = FitOptions {
                    band_limit: band_limit.unwrap_or(f64::INFINITY),
                    ..FitOptions::default()
                };
                let (signed, n) = (voxels.signed_over_period(), voxels.counts()[0]);
                let cell = fit_samples(&name, element, &signed, n, &options, session.progress)?;
                return Ok(Self::of(cell));
            }
            let source = Source::voxels(element, &voxels, &Placement::Reference)?;
            let default = FitOptions::default();
            let options = FitOptions {
                band_limit: band_limit
                    .unwrap_or_else(|| default.band_limit.min(source.max_band_limit())),
                ..default
            };
            let cell = fit_source(&name, element, &source, &options, session.progress)?;
            Ok(Self::of(cell))
        })
    }

    #[staticmethod]
    fn from_json(text: &str) -> Result<Self, Fault> {
        Ok(Self::of(druse::cell::Cell::from_json(text)?))
    }

    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        session::work(py, None, |_| Ok(Self::of(druse::io::read_cell(path)?)))
    }

    fn to_json(&self) -> String {
        self.cell.to_json()
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<u64> {
        session::work(py, None, |_| Ok(druse::io::write_cell(path, &self.cell)?))
    }

    /// The same function with the level and the solid side of a recipe's section.
    fn with_level(&self, py: Python<'_>, keys: &str) -> PyResult<Self> {
        let (cell, keys) = (self.cell.clone(), keys.to_owned());
        session::work_owned(py, None, move |_| {
            let section = CellSection::parse(&keys)?;
            Ok(Self::of(pipeline::with_level(cell, &section)?))
        })
    }

    fn volume_fraction(&self, py: Python<'_>) -> PyResult<f64> {
        let cell = self.cell.clone();
        session::work_owned(py, None, move |_| Ok(cell.volume_fraction()))
    }

    fn thickness(&self, py: Python<'_>) -> PyResult<f64> {
        session::work(py, None, |_| Ok(self.cell.thickness()?))
    }

    /// Slices through the cell as PNG.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = session::work(py, None, |_| {
            Ok(pipeline::plot(&self.cell, None).image.png()?)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Values at reference points: by the series if `exact`, else by its table.
    fn values<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
        exact: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let points = arrays::positions(&points)?;
        let found = session::work(py, None, |_| {
            let mut found = vec![0.0; points.len()];
            let table = if exact { None } else { Some(self.table()?) };
            let chunks = found.par_chunks_mut(CHUNK_POINTS);
            chunks
                .zip(points.par_chunks(CHUNK_POINTS))
                .for_each(|(out, points)| {
                    for (v, &p) in out.iter_mut().zip(points) {
                        let p = arrays::reference(p);
                        *v = match table {
                            Some(table) => Field::value(&**table, p),
                            None => self.cell.value(p),
                        };
                    }
                });
            Ok(found)
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Values and gradients at reference points.
    #[allow(clippy::type_complexity)] // A pair of arrays.
    fn values_and_gradients<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let points = arrays::positions(&points)?;
        let (values, gradients) = session::work(py, None, |_| {
            let at = |&p: &[f64; 3]| {
                let (v, g) = self.cell.value_and_gradient(arrays::reference(p));
                (v, <[f64; 3]>::from(g))
            };
            let points = points.par_iter().with_min_len(CHUNK_POINTS);
            Ok(points.map(at).unzip::<_, _, Vec<f64>, Vec<[f64; 3]>>())
        })?;
        Ok((
            PyArray1::from_vec(py, values),
            arrays::matrix(py, gradients)?,
        ))
    }
}
