//! Triangle meshes as Python objects, from files and from arrays of numpy. A mesh never changes; its solid
//! (closed, oriented, for distances) is made at the first use.

use crate::arrays::{self, Points};
use crate::fault::Fault;
use crate::level_set::LevelSet;
use crate::session;
use druse::band::Band;
use druse::frame::{LengthUnit, Vec3};
use druse::mesh::{MeshSolid, TriMesh};
use druse::polymesh::PolyMesh;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

/// Triangles over shared vertices, and their solid once it is needed.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct Mesh {
    pub(crate) mesh: Arc<TriMesh>,
    solid: OnceLock<(MeshSolid, Vec<String>)>,
}

impl Mesh {
    pub(crate) fn of(mesh: TriMesh) -> Self {
        Self {
            mesh: Arc::new(mesh),
            solid: OnceLock::new(),
        }
    }

    /// The solid that the triangles bound, and notes on its repairs.
    pub(crate) fn solid(&self) -> Result<&(MeshSolid, Vec<String>), Fault> {
        if let Some(solid) = self.solid.get() {
            return Ok(solid);
        }
        let (solid, repairs) = MeshSolid::repaired((*self.mesh).clone())?;
        let notes = repairs.into_iter().map(|r| r.message).collect();
        Ok(self.solid.get_or_init(|| (solid, notes)))
    }
}

#[pymethods]
impl Mesh {
    #[new]
    fn new(vertices: Points<'_>, faces: PyReadonlyArray2<'_, u32>) -> Result<Self, Fault> {
        let vertices = arrays::rows::<f64, 3>(&vertices, "vertices")?;
        let vertices = vertices.iter().map(|&v| Vec3::from(v)).collect();
        let faces = arrays::rows::<u32, 3>(&faces, "faces")?.to_vec();
        Ok(Self::of(TriMesh::new(vertices, faces)?))
    }

    /// The mesh of a file, and the warnings of its reader.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<(Self, Vec<String>)> {
        let read = session::work(py, None, |_| Ok(druse::io::read_mesh(path)?))?;
        Ok((Self::of(read.mesh), read.warnings))
    }

    fn save(&self, py: Python<'_>, path: PathBuf, unit: &str) -> PyResult<u64> {
        let unit: LengthUnit = unit.parse().map_err(|e| Fault::Argument(format!("{e}")))?;
        session::work(py, None, |_| {
            Ok(druse::io::write_mesh(path, &*self.mesh, unit)?)
        })
    }

    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::vectors(py, self.mesh.vertices().to_vec())
    }

    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        arrays::matrix(py, self.mesh.triangles().to_vec())
    }

    fn counts(&self) -> (usize, usize) {
        (self.mesh.vertices().len(), self.mesh.triangles().len())
    }

    fn volume(&self) -> f64 {
        self.mesh.volume()
    }

    fn area(&self) -> f64 {
        self.mesh.area()
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        arrays::corners(self.mesh.bounds())
    }

    /// Signed distances at points.
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let points = arrays::positions(&points)?;
        let found = session::work(py, None, |_| {
            let solid = &self.solid()?.0;
            let at = |&p: &[f64; 3]| solid.signed_distance(Vec3::from(p));
            Ok(points.par_iter().map(at).collect::<Vec<f64>>())
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// The level set of the solid, and notes on repairs; `half_width` is in voxels.
    #[pyo3(signature = (voxel_size, half_width, progress=None))]
    fn level_set(
        &self,
        py: Python<'_>,
        voxel_size: f64,
        half_width: f64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(LevelSet, Vec<String>)> {
        session::work(py, progress, |session| {
            let (solid, notes) = self.solid()?;
            let band = Band {
                half_width,
                ..Band::new(solid, solid.bounds(), voxel_size)?
            };
            let level_set = druse::vdb::LevelSet::from_band(&band, session)?;
            Ok((LevelSet::of(level_set), notes.clone()))
        })
    }
}

/// The triangles of a polygon modelling script.
#[pyfunction]
pub(crate) fn crystal(py: Python<'_>, script: String) -> PyResult<Mesh> {
    session::work(py, None, |_| {
        let polygons = PolyMesh::from_script(&script)?;
        let made = polygons.triangulated();
        let mesh = made.map_err(|e| Fault::Argument(e.to_string()))?.mesh;
        Ok(Mesh::of(mesh))
    })
}
