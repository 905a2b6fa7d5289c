//! Level sets from arrays and from Python functions. Leaves are cubes of 8^3 voxels, their values with z fastest;
//! the arrays are copied.

use super::{
    Aabb, BLOCK, Band, CallableField, Coord, Fault, LeafBatch, LeafSink, LevelSet, LevelSetBuilder,
    PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods, Session, Transform, Vec3, arrays,
    session,
};
use pyo3::prelude::*;
use std::collections::BTreeMap;

/// The grid of a level set: in Python a tuple of these fields in this order.
#[derive(Clone, Copy, FromPyObject)]
pub(crate) struct GridFrame {
    /// Edge of a voxel, world units.
    #[pyo3(item(0))]
    voxel_size: f64,
    /// Half width of the band, voxels.
    #[pyo3(item(1))]
    half_width: f64,
    /// Centre of voxel (0, 0, 0), world units.
    #[pyo3(item(2))]
    origin: [f64; 3],
}

/// Words of a leaf's mask: bit `8 y + z` of word x.
fn mask(active: &[bool; 512]) -> [u64; 8] {
    let mut mask = [0; 8];
    for (n, _) in active.iter().enumerate().filter(|a| *a.1) {
        mask[n >> 6] |= 1 << (n & 63);
    }
    mask
}

/// The transform of voxels of an edge; an error for one that OpenVDB cannot hold.
pub(super) fn transform(voxel_size: f64) -> Result<Transform, Fault> {
    Transform::new(voxel_size)
        .filter(|_| voxel_size >= Transform::MIN_VOXEL_SIZE)
        .ok_or_else(|| {
            Fault::Argument(format!(
                "voxel_size is {voxel_size}; expected a finite number of at least {}",
                Transform::MIN_VOXEL_SIZE
            ))
        })
}

/// A level set of leaves (mask and values by the lowest voxel), which are sorted into blocks. Regions without
/// leaves get their sign from the leaves around them.
fn build(
    transform: Transform,
    frame: GridFrame,
    leaves: BTreeMap<Coord, ([u64; 8], [f32; 512])>,
    session: Session<'_>,
) -> Result<LevelSet, Fault> {
    let builder = LevelSetBuilder::new(transform, frame.half_width)?;
    let mut blocks: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
    for (at, (mask, values)) in leaves {
        blocks
            .entry(at.aligned(BLOCK))
            .or_default()
            .push(at, mask, &values);
    }
    for (at, block) in &blocks {
        builder.block(*at, block)?;
    }
    let mut made = builder.finish(session)?;
    if frame.origin != [0.0; 3] {
        made.set_origin(Vec3::from(frame.origin))?;
    }
    Ok(LevelSet::of(made))
}

/// The level set of leaves: origins [n, 3], values [n, 512], active voxels [n, 512].
#[pyfunction]
pub(crate) fn from_leaves(
    py: Python<'_>,
    origins: PyReadonlyArray2<'_, i32>,
    values: PyReadonlyArray2<'_, f32>,
    active: PyReadonlyArray2<'_, bool>,
    frame: GridFrame,
) -> PyResult<LevelSet> {
    let origins = arrays::rows::<i32, 3>(&origins, "origins")?;
    let values = arrays::rows::<f32, 512>(&values, "values")?;
    let active = arrays::rows::<bool, 512>(&active, "active")?;
    session::work(py, None, |session| {
        let transform = transform(frame.voxel_size)?;
        let background = (frame.half_width * frame.voxel_size) as f32;
        let mut leaves = BTreeMap::new();
        for (n, origin) in origins.iter().enumerate() {
            let at = Coord(*origin);
            // Indices up to 2^29 leave room in 32 bits for sums and doubles of places.
            if at.aligned(8) != at || origin.iter().any(|c| c.unsigned_abs() > 1 << 29) {
                return Err(Fault::Argument(format!(
                    "leaf {n} is at {origin:?}; expected multiples of 8 up to 2^29"
                )));
            }
            // Signs beyond the band follow from inactive values, which are minus or plus the background.
            let leaf_values: [f32; 512] = std::array::from_fn(|i| {
                let v = values[n][i];
                if active[n][i] || v.is_nan() {
                    v
                } else {
                    background.copysign(v)
                }
            });
            if leaves.insert(at, (mask(&active[n]), leaf_values)).is_some() {
                let text = format!("two leaves are at {origin:?}; expected one");
                return Err(Fault::Argument(text));
            }
        }
        build(transform, frame, leaves, session)
    })
}

/// The level set of distances on a lattice [x, y, z]; voxels within the half width are active.
#[pyfunction]
pub(crate) fn from_dense(
    py: Python<'_>,
    values: PyReadonlyArray3<'_, f32>,
    frame: GridFrame,
) -> PyResult<LevelSet> {
    let shape: [usize; 3] = [values.shape()[0], values.shape()[1], values.shape()[2]];
    let values = values.as_slice();
    let values =
        values.map_err(|_| Fault::Argument("values: expected a contiguous array".into()))?;
    session::work(py, None, |session| {
        if let Some(n) = values.iter().position(|v| !v.is_finite()) {
            let [_, ny, nz] = shape;
            let text = format!(
                "value [{}, {}, {}] is {}; expected a finite number",
                n / (ny * nz),
                n / nz % ny,
                n % nz,
                values[n]
            );
            return Err(Fault::Argument(text));
        }
        let transform = transform(frame.voxel_size)?;
        build(transform, frame, dense(values, shape, frame), session)
    })
}

/// The level set of a function of points [n, 3] within a box, and the number of samples; `half_width` in voxels.
#[pyfunction]
#[pyo3(signature = (function, bounds, voxel_size, lipschitz, half_width, progress=None))]
pub(crate) fn from_function(
    py: Python<'_>,
    function: Py<PyAny>,
    bounds: [[f64; 3]; 2],
    voxel_size: f64,
    lipschitz: f64,
    half_width: f64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(LevelSet, u64)> {
    let extent = Aabb {
        min: Vec3::from(bounds[0]),
        max: Vec3::from(bounds[1]),
    };
    session::work(py, progress, |session| {
        let transform = transform(voxel_size)?;
        // Before the function is called; the culling limits to 2^29 where the box may lie.
        let is_usable = half_width.is_finite() && half_width >= 1.0 && !extent.is_empty();
        let voxels = extent.size() / voxel_size;
        if !is_usable
            || !voxels
                .iter()
                .all(|v| v.is_finite() && *v < f64::from(1 << 28))
        {
            return Err(Fault::Argument(format!(
                "bounds {bounds:?} at half width {half_width}; expected a finite box of fewer than 2^28 voxels \
                 along an axis, and a half width of at least 1"
            )));
        }
        let field = CallableField::new(
            function,
            lipschitz,
            extent,
            voxel_size,
            half_width,
            session.progress,
        );
        let band = Band {
            field: &field,
            transform,
            half_width,
            extent,
        };
        let builder = LevelSetBuilder::new(transform, half_width)?;
        // An exception of the function cannot pass through the evaluation: the field keeps it, and it is raised here.
        let evaluated = field
            .is_sound()
            .then(|| band.evaluate(session.threads, session.progress, &builder));
        if let Some(raised) = field.take_exception() {
            return Ok(Err(raised));
        }
        let stats = evaluated.transpose()?.unwrap_or_default();
        let level_set = builder.finish(session)?;
        Ok(Ok((LevelSet::of(level_set), stats.samples_evaluated)))
    })?
}

/// Leaves of a lattice of distances `values`, z fastest, whose voxel (0, 0, 0) is the first value. Values are clamped
/// to the band; voxels beyond the lattice are outside.
fn dense(
    values: &[f32],
    [nx, ny, nz]: [usize; 3],
    frame: GridFrame,
) -> BTreeMap<Coord, ([u64; 8], [f32; 512])> {
    let background = (frame.half_width * frame.voxel_size) as f32;
    let mut leaves = BTreeMap::new();
    let steps = |n: usize| (0..n).step_by(8);
    for (x, y) in steps(nx).flat_map(|x| steps(ny).map(move |y| (x, y))) {
        for z in steps(nz) {
            let mut leaf_values = [background; 512];
            let mut mask = [0u64; 8];
            for n in 0..512 {
                let [i, j, k] = [x + (n >> 6), y + ((n >> 3) & 7), z + (n & 7)];
                if i < nx && j < ny && k < nz {
                    let v = values[(i * ny + j) * nz + k];
                    leaf_values[n] = v.clamp(-background, background);
                    mask[n >> 6] |= u64::from(v.abs() < background) << (n & 63);
                }
            }
            // Leaves without active voxels get their sign from their neighbours.
            if mask != [0; 8] {
                leaves.insert(Coord([x as i32, y as i32, z as i32]), (mask, leaf_values));
            }
        }
    }
    leaves
}
