//! Conversion between arrays of numpy and points. The Python part of the package makes arrays contiguous and
//! checks their shapes and types; here only contiguity and finite coordinates are checked.

use crate::fault::Fault;
use druse::frame::{CellPoint, Vec3, WorldPoint};
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
};
use pyo3::prelude::*;

/// Contiguous coordinates of shape [n, 3].
pub(crate) type Points<'py> = PyReadonlyArray2<'py, f64>;

/// The values of a contiguous array of one axis, without a copy; `what` names it in errors.
pub(crate) fn list<'a, T: Element>(
    array: &'a PyReadonlyArray1<'_, T>,
    what: &str,
) -> Result<&'a [T], Fault> {
    let values = array.as_slice();
    values.map_err(|_| Fault::Argument(format!("{what}: expected a contiguous array")))
}

/// The rows of a contiguous array of shape [n, `N`], without a copy; the package has checked the shape.
pub(crate) fn rows<'a, T: Element, const N: usize>(
    array: &'a PyReadonlyArray2<'_, T>,
    what: &str,
) -> Result<&'a [[T; N]], Fault> {
    let values = array.as_slice();
    let values =
        values.map_err(|_| Fault::Argument(format!("{what}: expected a contiguous array")))?;
    Ok(values.as_chunks().0)
}

/// Finite positions.
pub(crate) fn positions<'a>(points: &'a Points<'_>) -> Result<&'a [[f64; 3]], Fault> {
    let rows: &[[f64; 3]] = rows(points, "points")?;
    match rows.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        None => Ok(rows),
        Some(n) => Err(Fault::Argument(format!(
            "point {n} is {:?}; expected finite coordinates",
            rows[n]
        ))),
    }
}

/// A point of the world.
pub(crate) fn world(p: [f64; 3]) -> WorldPoint {
    WorldPoint(Vec3::from(p))
}

/// A point in an element's reference coordinates.
pub(crate) fn reference(p: [f64; 3]) -> CellPoint<3> {
    CellPoint(Vec3::from(p))
}

/// Vectors as an array of shape [n, 3], without a copy where the allocation can be kept.
pub(crate) fn vectors<'py>(
    py: Python<'py>,
    vectors: Vec<Vec3>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<[f64; 3]> = vectors.into_iter().map(Into::into).collect();
    matrix(py, rows)
}

/// Rows as an array of shape [n, `N`].
pub(crate) fn matrix<'py, T: Element, const N: usize>(
    py: Python<'py>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let count = rows.len();
    let flat: Bound<'py, PyArray1<T>> = rows.into_flattened().into_pyarray(py);
    flat.reshape([count, N])
}

/// Coordinates of a box as [[x, y, z], [x, y, z]].
pub(crate) fn corners(bounds: druse::frame::Aabb) -> [[f64; 3]; 2] {
    [bounds.min.into(), bounds.max.into()]
}
