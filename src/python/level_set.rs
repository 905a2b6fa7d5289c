//! Level sets as Python objects: read, made from arrays, operated on, meshed and saved. Operations change the
//! object in place; a boolean operation consumes its operand. Several threads may read an object at a time, but
//! while one changes it the others get an exception and do not wait.

use crate::arrays::{self, Points};
use crate::callable::CallableField;
use crate::fault::Fault;
use crate::mesh::Mesh;
use crate::session;
use druse::band::{BLOCK, Band, LeafBatch, LeafSink};
use druse::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use druse::vdb::subprocess::Program;
use druse::vdb::{
    Compression, Cubes, GridReading, LevelSetBuilder, Picture, Placement, Session, VdbError,
    VdbWriter,
};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{RwLock, RwLockReadGuard};

pub(crate) mod build;

/// A level set; nothing once an operation has consumed it.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct LevelSet(RwLock<Option<druse::vdb::LevelSet>>);

/// Origins, values and active voxels of leaves, by leaf.
type LeafArrays<'py> = (
    Bound<'py, PyArray2<i32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<bool>>,
);

impl LevelSet {
    pub(crate) fn of(level_set: druse::vdb::LevelSet) -> Self {
        Self(RwLock::new(Some(level_set)))
    }

    /// The lock for reading; an exception where another thread changes the level set.
    fn read_guard(&self) -> Result<RwLockReadGuard<'_, Option<druse::vdb::LevelSet>>, Fault> {
        self.0.try_read().map_err(|_| in_use())
    }

    /// Takes the level set, for an operation that changes or consumes it.
    fn take(&self) -> Result<druse::vdb::LevelSet, Fault> {
        let taken = self.0.try_write().map_err(|_| in_use())?.take();
        taken.ok_or_else(consumed)
    }

    /// Puts the level set back. Meanwhile other threads may run Python: one of them may hold the lock while it
    /// raises the exception of an empty level set.
    fn put(&self, py: Python<'_>, level_set: druse::vdb::LevelSet) {
        py.detach(|| {
            if let Ok(mut slot) = self.0.write() {
                *slot = Some(level_set);
            }
        });
    }

    /// Reads from the level set.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        job: impl FnOnce(&druse::vdb::LevelSet, Session<'_>) -> Result<T, Fault> + Send,
    ) -> PyResult<T> {
        let guard = self.read_guard()?;
        let level_set = guard.as_ref().ok_or_else(consumed)?;
        session::work(py, None, |session| job(level_set, session))
    }

    /// Changes the level set. A fault of a parameter leaves it as it is; any other consumes it.
    fn change(
        &self,
        py: Python<'_>,
        progress: Option<&Bound<'_, PyAny>>,
        job: impl FnOnce(&mut druse::vdb::LevelSet, Session<'_>) -> Result<(), VdbError> + Send,
    ) -> PyResult<()> {
        let mut level_set = self.take()?;
        let (level_set, changed) = session::work(py, progress, move |session| {
            let changed = job(&mut level_set, session);
            Ok((level_set, changed))
        })?;
        match changed {
            Ok(()) => {
                self.put(py, level_set);
                Ok(())
            }
            Err(e) => {
                if matches!(e, VdbError::Parameter { .. }) {
                    self.put(py, level_set);
                }
                Err(Fault::from(e).into())
            }
        }
    }
}

/// The error of a level set that another thread uses.
fn in_use() -> Fault {
    Fault::Argument(
        "another thread uses the level set; expected one user at a time, or copy()".into(),
    )
}

/// The error of a level set that a boolean operation or a failure has consumed.
fn consumed() -> Fault {
    Fault::Argument(
        "the level set is empty: a boolean operation consumed it, or an operation on it failed or was interrupted; \
         copy() before the operation keeps it"
            .into(),
    )
}

/// The child that reads untrusted files, from the command that starts the program; `None` for an empty command,
/// where this process reads them.
pub(crate) fn reader(command: Vec<OsString>) -> Option<Program> {
    let mut words = command.into_iter();
    let path = words.next()?.into();
    let arguments = words.chain(["inspect-vdb".into()]).collect();
    Some(Program { path, arguments })
}

#[pymethods]
impl LevelSet {
    /// The level set of a file, read by a child process, and notes on repairs.
    #[staticmethod]
    #[pyo3(signature = (path, grid, program, value=None, invert=false))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        grid: Option<String>,
        program: Vec<OsString>,
        value: Option<f64>,
        invert: bool,
    ) -> PyResult<(Self, Vec<String>)> {
        session::work(py, None, |session| {
            let volume = match reader(program) {
                Some(program) => program.fetch(&path, grid.as_deref())?,
                None => druse::vdb::Volume::read(&path, grid.as_deref())?,
            };
            let how = GridReading {
                value,
                invert,
                cubes: Cubes::Edge(volume.info().cube_edge()),
                ..GridReading::default()
            };
            let adopted = volume.solid(&path, &how, session)?;
            Ok((Self::of(adopted.solid), adopted.notes))
        })
    }

    /// Writes a file with one grid of the name `grid`, with `half` as half floats; `tags` are its metadata. Returns the
    /// size in bytes and the content hash.
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        grid: &str,
        compression: &str,
        half: bool,
        tags: Vec<(String, String)>,
    ) -> PyResult<(u64, String)> {
        self.with(py, |level_set, session| {
            let compression = match compression {
                "none" => Compression::None,
                "zip" => Compression::Zip,
                "blosc" => Compression::Blosc,
                word => {
                    let text = format!("compression is {word:?}; expected none, zip or blosc");
                    return Err(Fault::Argument(text));
                }
            };
            let mut file = VdbWriter::new(&path, session)?.compression(compression);
            // Half floats need their own type of grid in the file.
            if half {
                file.level_set_as_half(grid, level_set)?;
            } else {
                file.level_set(grid, level_set)?;
            }
            for (key, value) in &tags {
                file.tag(key, value)?;
            }
            let written = file.write()?;
            Ok((written.bytes, written.content_hash))
        })
    }

    /// Origins [n, 3], values [n, 512] and active voxels [n, 512] of the leaves.
    fn leaves<'py>(&self, py: Python<'py>) -> PyResult<LeafArrays<'py>> {
        let (origins, values, active) = self.with(py, |level_set, _| {
            let leaves = level_set.leaves()?;
            let mut origins = Vec::with_capacity(leaves.len());
            let mut values = Vec::with_capacity(leaves.len());
            let mut active = Vec::with_capacity(leaves.len());
            for leaf in leaves.iter() {
                origins.push(leaf.origin.0);
                values.push(*leaf.values);
                let is_active: [bool; 512] = std::array::from_fn(|n| leaf.is_active(n));
                active.push(is_active);
            }
            Ok((origins, values, active))
        })?;
        Ok((
            arrays::matrix(py, origins)?,
            arrays::matrix(py, values)?,
            arrays::matrix(py, active)?,
        ))
    }

    /// Values at voxels.
    fn voxels<'py>(
        &self,
        py: Python<'py>,
        voxels: PyReadonlyArray2<'py, i32>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let rows = arrays::rows::<i32, 3>(&voxels, "voxels")?;
        let found = self.with(py, |level_set, _| {
            let voxels: Vec<Coord> = rows.iter().map(|&v| Coord(v)).collect();
            Ok(level_set.values(&voxels)?)
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Values at points, trilinear between voxels.
    fn samples<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let rows = arrays::positions(&points)?;
        let found = self.with(py, |level_set, _| {
            let points: Vec<WorldPoint> = rows.iter().map(|&p| arrays::world(p)).collect();
            Ok(level_set.samples(&points)?)
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        self.with(py, |level_set, session| {
            Ok(Mesh::of(level_set.to_mesh(session)?))
        })
    }

    /// Volume and area of the triangles of [`LevelSet::mesh`].
    fn measures(&self, py: Python<'_>) -> PyResult<(f64, f64)> {
        self.with(py, |level_set, session| {
            let mesh = level_set.to_mesh(session)?;
            Ok((mesh.volume(), mesh.area()))
        })
    }

    /// The same solid on voxels with (0, 0, 0) at `origin`, world units; `half_width` is in voxels.
    fn resampled(
        &self,
        py: Python<'_>,
        voxel_size: f64,
        half_width: f64,
        origin: [f64; 3],
    ) -> PyResult<Self> {
        self.with(py, |level_set, session| {
            let origin = Vec3::from(origin);
            let placement = Placement {
                translation: -origin,
                ..Placement::IDENTITY
            };
            let transform = build::transform(voxel_size)?;
            let mut made = level_set.resampled(transform, half_width, placement, session)?;
            made.set_origin(origin)?;
            Ok(Self::of(made))
        })
    }

    /// Moves the solid with its voxels: the world position of voxel (0, 0, 0).
    fn set_origin(&self, py: Python<'_>, origin: [f64; 3]) -> PyResult<()> {
        self.change(py, None, |level_set, _| {
            level_set.set_origin(Vec3::from(origin))
        })
    }

    fn bounds(&self, py: Python<'_>) -> PyResult<[[f64; 3]; 2]> {
        self.with(py, |level_set, _| Ok(arrays::corners(level_set.bounds()?)))
    }

    /// Voxel size, half width in voxels, origin.
    fn frame(&self) -> Result<(f64, f64, [f64; 3]), Fault> {
        let guard = self.read_guard()?;
        let own = guard.as_ref().ok_or_else(consumed)?;
        Ok((own.voxel_size(), own.half_width(), own.origin().into()))
    }

    /// The description as JSON.
    fn info(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |level_set, _| {
            Ok(serde_json::to_string(&level_set.info()?)?)
        })
    }

    /// The check as JSON, and the violations.
    fn check(&self, py: Python<'_>) -> PyResult<(String, Vec<String>)> {
        self.with(py, |level_set, session| {
            let check = level_set.check(session)?;
            Ok((serde_json::to_string(&check)?, check.problems()))
        })
    }

    /// Volumes of the connected components of the solid.
    fn components(&self, py: Python<'_>) -> PyResult<Vec<f64>> {
        self.with(py, |level_set, session| {
            let all = level_set.components(session)?;
            Ok(all.iter().map(|c| c.volume).collect())
        })
    }

    fn content_hash(&self, py: Python<'_>, grid: &str) -> PyResult<String> {
        self.with(py, |level_set, _| Ok(level_set.content_hash(grid)?))
    }

    /// Consumes the level set.
    fn clear(&self) -> Result<(), Fault> {
        self.take().map(drop)
    }

    fn copy(&self, py: Python<'_>) -> PyResult<Self> {
        self.with(py, |level_set, _| Ok(Self::of(level_set.duplicate()?)))
    }

    fn is_consumed(&self) -> bool {
        self.0.try_read().is_ok_and(|slot| slot.is_none())
    }

    /// A picture as PNG.
    #[pyo3(signature = (width, height, cut=None))]
    fn png<'py>(
        &self,
        py: Python<'py>,
        width: usize,
        height: usize,
        cut: Option<(usize, f64)>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.with(py, |level_set, session| {
            let picture = Picture {
                width,
                height,
                cut,
                ..Picture::default()
            };
            Ok(level_set.render(&picture, session)?.png()?)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Moves (`amount` in world units) or smooths (in voxels); an `operation` that is not below is `renormalise`.
    #[pyo3(signature = (operation, amount, iterations, progress=None))]
    fn apply(
        &self,
        py: Python<'_>,
        operation: &str,
        amount: f64,
        iterations: u32,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        self.change(py, progress, |level_set, session| match operation {
            "dilate" => level_set.dilate(amount, session),
            "erode" => level_set.erode(amount, session),
            "open" => level_set.open(amount, session),
            "close" => level_set.close(amount, session),
            "gaussian" => level_set.gaussian(amount as u32, iterations, session),
            "mean" => level_set.mean(amount as u32, iterations, session),
            "median" => level_set.median(amount as u32, iterations, session),
            "laplacian" => level_set.laplacian(iterations, session),
            "curvature" => level_set.curvature(iterations, session),
            _ => level_set.renormalise(iterations, session),
        })
    }

    /// Combines with another level set, which is consumed; an `operation` that is not below is a subtraction.
    #[pyo3(signature = (operation, other, progress=None))]
    fn combine(
        &self,
        py: Python<'_>,
        operation: &str,
        other: &Self,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        if std::ptr::eq(self, other) {
            let text = "the operand is the level set itself; expected another one, such as copy()";
            return Err(Fault::Argument(text.into()).into());
        }
        // Checked before the operand is taken.
        self.frame()?;
        let other = other.take()?;
        self.change(py, progress, move |level_set, session| match operation {
            "union" => level_set.union(other, session),
            "intersect" => level_set.intersect(other, session),
            _ => level_set.subtract(other, session),
        })
    }
}
