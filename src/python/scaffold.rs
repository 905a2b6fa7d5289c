//! Scaffolds as Python objects, from files and from arrays of nodes and elements. Elements are given as VTK gives
//! them: offsets into a list of node numbers, and types. A scaffold never changes.

use crate::arrays::{self, Points};
use crate::fault::Fault;
use crate::mesh::Mesh;
use crate::session;
use druse::frame::Vec3;
use druse::io::{FieldAt, read_scaffold, write_vtu_fields};
use druse::mesh::TriMesh;
use druse::scaffold::{Connectivity, Kind};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A field of a file: name, whether at nodes, components per value, values.
type Field<'py> = (String, bool, usize, Bound<'py, PyArray1<f64>>);

/// Offsets, node numbers and VTK types of elements.
type Elements<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<u8>>,
);

/// Names and values of fields of one number.
type NumberFields<'py> = Vec<(String, PyReadonlyArray1<'py, f64>)>;

/// Solid elements over nodes.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct Scaffold {
    pub(crate) scaffold: Arc<druse::scaffold::Scaffold>,
}

impl Scaffold {
    fn of(scaffold: druse::scaffold::Scaffold) -> Self {
        Self {
            scaffold: Arc::new(scaffold),
        }
    }
}

/// The elements that offsets (one more than elements), node numbers and VTK types describe. Whether the nodes
/// exist is checked with the scaffold.
fn connectivity(offsets: &[i64], nodes: &[i64], types: &[u8]) -> Result<Connectivity, Fault> {
    let fail = |text: String| Err(Fault::Argument(text));
    if offsets.len() != types.len() + 1 {
        return fail(format!(
            "{} offsets for {} elements; expected one more than elements",
            offsets.len(),
            types.len()
        ));
    }
    let mut made = Connectivity::default();
    // Element n has the nodes from offset n to offset n + 1.
    for (n, (ends, &vtk)) in offsets.windows(2).zip(types).enumerate() {
        let Some(kind) = Kind::from_vtk(vtk) else {
            return fail(format!(
                "element {n} has the VTK type {vtk}; expected a tetrahedron, hexahedron, wedge or pyramid"
            ));
        };
        let range = usize::try_from(ends[0])
            .ok()
            .zip(usize::try_from(ends[1]).ok());
        let element_nodes = range.and_then(|(a, b)| nodes.get(a..b));
        let Some(element_nodes) = element_nodes else {
            return fail(format!(
                "element {n} has the offsets {ends:?} into {} node numbers",
                nodes.len()
            ));
        };
        let element_nodes: Option<Vec<u32>> = element_nodes
            .iter()
            .map(|&n| u32::try_from(n).ok())
            .collect();
        let Some(element_nodes) = element_nodes else {
            return fail(format!(
                "element {n} has a node number below 0 or above {}",
                u32::MAX
            ));
        };
        made.push(kind, &element_nodes);
    }
    Ok(made)
}

#[pymethods]
impl Scaffold {
    /// A scaffold from nodes [n, 3], and elements by offsets, node numbers and VTK types.
    #[new]
    fn new(
        py: Python<'_>,
        nodes: Points<'_>,
        offsets: PyReadonlyArray1<'_, i64>,
        connectivity: PyReadonlyArray1<'_, i64>,
        types: PyReadonlyArray1<'_, u8>,
    ) -> PyResult<Self> {
        let nodes = arrays::rows::<f64, 3>(&nodes, "nodes")?.iter();
        let nodes: Vec<Vec3> = nodes.map(|&p| Vec3::from(p)).collect();
        let elements = self::connectivity(
            arrays::list(&offsets, "offsets")?,
            arrays::list(&connectivity, "connectivity")?,
            arrays::list(&types, "types")?,
        )?;
        session::work(py, None, |_| {
            Ok(Self::of(druse::scaffold::Scaffold::new(nodes, elements)?))
        })
    }

    /// The scaffold of a file, its fields, its notes and its warnings.
    #[staticmethod]
    #[allow(clippy::type_complexity)] // A tuple for the package.
    fn read(
        py: Python<'_>,
        path: PathBuf,
    ) -> PyResult<(Self, Vec<Field<'_>>, Vec<String>, Vec<String>)> {
        let read = session::work(py, None, |_| Ok(read_scaffold(path)?))?;
        let fields = read.fields.into_iter().map(|f| {
            let values = PyArray1::from_vec(py, f.values);
            (f.name, f.at == FieldAt::Points, f.components, values)
        });
        let fields = fields.collect();
        Ok((Self::of(read.scaffold), fields, read.notes, read.warnings))
    }

    /// A box of elements of a VTK type.
    #[staticmethod]
    fn of_box(py: Python<'_>, size: [f64; 3], counts: [usize; 3], vtk_type: u8) -> PyResult<Self> {
        session::work(py, None, |_| {
            let kind = Kind::from_vtk(vtk_type);
            let kind = kind.ok_or_else(|| {
                Fault::Argument(format!("no element has the VTK type {vtk_type}"))
            })?;
            let made = druse::scaffold::Scaffold::box_grid(Vec3::from(size), counts, kind)?;
            Ok(Self::of(made))
        })
    }

    /// Writes a .vtu file with fields of one number per node and per element; returns its size.
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        node_fields: NumberFields<'_>,
        element_fields: NumberFields<'_>,
    ) -> PyResult<u64> {
        let lists = |fields: &NumberFields<'_>| -> Result<Vec<(String, Vec<f64>)>, Fault> {
            let list = |(name, values): &(String, PyReadonlyArray1<'_, f64>)| {
                Ok((name.clone(), arrays::list(values, name)?.to_vec()))
            };
            fields.iter().map(list).collect()
        };
        let nodes = lists(&node_fields)?;
        let elements = lists(&element_fields)?;
        session::work(py, None, |_| {
            let nodes: Vec<_> = nodes.iter().map(|(n, v)| (n.as_str(), &v[..])).collect();
            let elements: Vec<_> = elements.iter().map(|(n, v)| (n.as_str(), &v[..])).collect();
            Ok(write_vtu_fields(path, &self.scaffold, &nodes, &elements)?)
        })
    }

    /// The outer faces as triangles, within a distance of curved ones.
    fn surface(&self, py: Python<'_>, error: f64) -> PyResult<Mesh> {
        session::work(py, None, |_| {
            let mut surface = TriMesh::default();
            for component in 0..self.scaffold.components().len() {
                surface.append(&self.scaffold.boundary(component, error).mesh)?;
            }
            Ok(Mesh::of(surface))
        })
    }

    fn __len__(&self) -> usize {
        self.scaffold.len()
    }

    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::vectors(py, self.scaffold.nodes().to_vec())
    }

    fn elements<'py>(&self, py: Python<'py>) -> Elements<'py> {
        let all = self.scaffold.connectivity();
        let (mut offsets, mut nodes, mut types) = (vec![0], Vec::new(), Vec::new());
        for e in 0..all.len() {
            nodes.extend(all.nodes(e).iter().map(|&n| i64::from(n)));
            offsets.push(nodes.len() as i64);
            types.push(all.kind(e).vtk_type());
        }
        (
            PyArray1::from_vec(py, offsets),
            PyArray1::from_vec(py, nodes),
            PyArray1::from_vec(py, types),
        )
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        arrays::corners(self.scaffold.bounds())
    }

    /// Least and greatest length of the map of a unit of reference length.
    fn stretch(&self) -> (f64, f64) {
        self.scaffold.stretch()
    }

    /// Volume of all elements.
    fn volume(&self) -> f64 {
        self.scaffold.elements().map(|e| e.volume().abs()).sum()
    }

    /// Elements (-1 outside) and reference coordinates (NaN outside) of points.
    #[allow(clippy::type_complexity)] // A pair of arrays.
    fn locate<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>)> {
        let points = arrays::positions(&points)?;
        let (elements, places) = session::work(py, None, |_| {
            let at = |&p: &[f64; 3]| match self.scaffold.locate(arrays::world(p)) {
                Some((e, xi)) => (i64::from(e), <[f64; 3]>::from(xi.0)),
                None => (-1, [f64::NAN; 3]),
            };
            Ok(points
                .par_iter()
                .map(at)
                .unzip::<_, _, Vec<i64>, Vec<[f64; 3]>>())
        })?;
        Ok((
            PyArray1::from_vec(py, elements),
            arrays::matrix(py, places)?,
        ))
    }
}
