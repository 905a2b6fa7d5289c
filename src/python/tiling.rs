//! Cells over scaffolds as Python objects; `_tiling.py` has checked the shapes of arrays and the words of turns.

use crate::arrays::{self, Points};
use crate::cell::Cell;
use crate::fault::Fault;
use crate::level_set::LevelSet;
use crate::scaffold::Scaffold;
use crate::session;
use druse::band::Band;
use druse::cell::Table;
use druse::field::WorldField;
use druse::frame::Vec3;
use druse::pipeline::{GradedQuantity, level_shifts};
use druse::tiling::{
    Aim, Blend, Boundary, Directions, Distance, Interpolation, Member, Mismatch, Mixture,
    TiledSolid, TilingOptions, orient,
};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::Arc;

/// Cells over the elements of a scaffold, with weights and a grading at its nodes.
#[pyclass(frozen, module = "druse._druse")]
pub(crate) struct Tiling {
    scaffold: Arc<druse::scaffold::Scaffold>,
    /// By member of the blend, then by element shape.
    members: Vec<Vec<Arc<Table>>>,
    /// By node, then by member.
    weights: Option<Vec<f64>>,
    /// Shifts of the level by node.
    shifts: Option<Vec<f64>>,
    interpolation: Interpolation,
    distance: Distance,
    boundary: Boundary,
    /// The elements that hold the cells in several turns.
    mixture: Mixture,
}

/// How elements are turned, as `_tiling.py` passes it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Orient {
    /// Where the third and the first axis of the cells point.
    toward: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    /// "error" or "blend".
    mismatch: String,
    /// Of the layer in which turns are blended, as a share of an element.
    width: Option<f64>,
}

impl Orient {
    fn aim(&self, elements: usize) -> Aim {
        let everywhere = |v: Option<[f64; 3]>| {
            v.map_or_else(Vec::new, |v| vec![Vec3::from(v).normalize(); elements])
        };
        if self.toward.is_none() {
            return Aim::World;
        }
        Aim::Directions(Directions {
            toward: everywhere(self.toward),
            up: everywhere(self.up),
            is_axial: false,
        })
    }

    fn mismatch(&self) -> Mismatch {
        match self.mismatch.as_str() {
            "blend" => Mismatch::Blend { width: self.width },
            _ => Mismatch::Refuse,
        }
    }
}

impl Tiling {
    /// Calls a function with the field of the tiling; the edge of a voxel and the half width are world units.
    fn with_field<R>(
        &self,
        voxel_size: f64,
        half_width: f64,
        use_field: impl FnOnce(&WorldField<'_>) -> R,
    ) -> Result<R, Fault> {
        let options = TilingOptions {
            half_width,
            distance: self.distance,
            boundary: self.boundary,
            ..TilingOptions::new(voxel_size)
        };
        // A single cell of one shape is itself the field where nothing varies; a blend would only cost time.
        if let (None, None, [member]) = (&self.weights, &self.shifts, &self.members[..])
            && let [table] = &member[..]
            && self.mixture.is_empty()
        {
            return Ok(use_field(&TiledSolid::new(
                &self.scaffold,
                &**table,
                options,
            )?));
        }
        let members = self.members.iter().enumerate().map(|(n, tables)| Member {
            name: n.to_string(),
            cells: tables.iter().map(|t| &**t).collect(),
        });
        let nodes = self.scaffold.nodes().len();
        // Weights are by node and member. `None` is one member, with weight 1 at every node.
        let weights = self.weights.clone().unwrap_or_else(|| vec![1.0; nodes]);
        let blend = Blend::new(
            &self.scaffold,
            members.collect(),
            weights,
            self.interpolation,
        );
        let mut blend = blend?.with_mixture(&self.mixture);
        if let Some(shifts) = &self.shifts {
            blend = blend.graded(shifts.clone())?;
        }
        // Sums of unlike cells lose volume in between; the level is moved so that the fraction is interpolated too.
        if self.members.len() > 1 {
            blend = blend.with_interpolated_volumes();
        }
        Ok(use_field(&TiledSolid::new(
            &self.scaffold,
            &blend,
            options,
        )?))
    }
}

#[pymethods]
impl Tiling {
    /// `cells` by member, then by element shape; `graded` is a quantity's name and its values at the nodes, `words` are
    /// the interpolation, the distance and the boundary.
    #[new]
    fn new(
        py: Python<'_>,
        scaffold: &Scaffold,
        cells: Vec<Vec<Py<Cell>>>,
        weights: Option<PyReadonlyArray1<'_, f64>>,
        graded: Option<(String, PyReadonlyArray1<'_, f64>)>,
        words: (String, String, String),
        turning: Orient,
    ) -> PyResult<Self> {
        let read = || {
            let weights = weights.as_ref().map(|w| arrays::list(w, "weights"));
            let graded = graded.as_ref().map(|(q, v)| Ok((q, arrays::list(v, q)?)));
            let interpolation = match words.0.as_str() {
                "linear" => Interpolation::Linear,
                "smoothstep" => Interpolation::Smoothstep,
                word => return Err(unknown("interpolation", word, "linear or smoothstep")),
            };
            let distance = match words.1.as_str() {
                "fast" => Distance::Fast,
                "exact" => Distance::Exact,
                word => return Err(unknown("distance", word, "fast or exact")),
            };
            let boundary = match words.2.as_str() {
                "cut" => Boundary::Cut,
                "extend" => Boundary::Extend,
                word => return Err(unknown("boundary", word, "cut or extend")),
            };
            let graded: Option<Result<_, Fault>> = graded;
            Ok((
                weights.transpose()?.map(<[f64]>::to_vec),
                graded.transpose()?.map(|(q, v)| (q.clone(), v.to_vec())),
                (interpolation, distance, boundary),
            ))
        };
        let (weights, graded, (interpolation, distance, boundary)) =
            read().map_err(|e| e.raise(py))?;
        if cells.is_empty() || cells.iter().any(Vec::is_empty) {
            return Err(Fault::Argument("no cell; expected at least one".into()).raise(py));
        }
        let cells: Vec<Vec<&Cell>> = cells
            .iter()
            .map(|c| c.iter().map(Py::get).collect())
            .collect();
        let mut scaffold = Arc::clone(&scaffold.scaffold);
        session::work(py, None, |_| {
            let aim = turning.aim(scaffold.len());
            let mut mixture = Mixture::default();
            let as_members = cells.iter().map(|cells| Member {
                name: String::new(),
                cells: cells.iter().map(|c| &c.cell).collect(),
            });
            let as_members: Vec<Member<'_, druse::cell::Cell>> = as_members.collect();
            if let Some(oriented) = orient(&mut scaffold, &as_members, &aim, turning.mismatch())? {
                mixture = oriented.mixture;
            }
            let tables = |cells: &Vec<&Cell>| -> Result<Vec<Arc<Table>>, Fault> {
                cells.iter().map(|c| c.table().cloned()).collect()
            };
            let members = cells.iter().map(tables).collect::<Result<Vec<_>, _>>()?;
            let shifts = graded.map(|(quantity, values)| {
                let quantity = match quantity.as_str() {
                    "level" => GradedQuantity::Level,
                    "volume_fraction" => GradedQuantity::VolumeFraction,
                    _ => GradedQuantity::Thickness,
                };
                let (cell, table) = (&cells[0][0].cell, &*members[0][0]); // the only member
                level_shifts(&scaffold, cell, table, quantity, values)
            });
            let tiling = Self {
                members,
                weights,
                shifts: shifts.transpose()?,
                interpolation,
                distance,
                boundary,
                scaffold,
                mixture,
            };
            // Faults of cells that do not fit the scaffold appear here, whatever the voxel: one as large as an element.
            let edge = tiling.scaffold.stretch().1;
            tiling.with_field(edge, edge, |_| ())?;
            Ok(tiling)
        })
    }

    /// Signed distances at points, clamped to the half width.
    fn distances<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
        voxel_size: f64,
        half_width: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let points = arrays::positions(&points).map_err(|e| e.raise(py))?;
        let found = session::work(py, None, |session| {
            self.with_field(voxel_size, half_width, |field| {
                let at = |&p: &[f64; 3]| {
                    if session.progress.cancelled() {
                        return f64::NAN;
                    }
                    field.value(arrays::world(p))
                };
                points.par_iter().map(at).collect::<Vec<f64>>()
            })
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// The level set; `half_width` in voxels.
    #[pyo3(signature = (voxel_size, half_width, progress=None))]
    fn level_set(
        &self,
        py: Python<'_>,
        voxel_size: f64,
        half_width: f64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<LevelSet> {
        session::work(py, progress, |session| {
            self.with_field(voxel_size, half_width * voxel_size, |field| {
                let band = Band {
                    half_width,
                    ..Band::new(field, self.scaffold.bounds(), voxel_size)?
                };
                Ok(LevelSet::of(druse::vdb::LevelSet::from_band(
                    &band, session,
                )?))
            })?
        })
    }
}

fn unknown(what: &str, word: &str, expected: &str) -> Fault {
    Fault::Argument(format!("{what} is {word:?}; expected {expected}"))
}
