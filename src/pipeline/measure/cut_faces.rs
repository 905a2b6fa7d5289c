//! The faces that cut walls: outer faces of the scaffold and meshes of Boolean operations.
//!
//! A ball that touches a cut measures the position of the cut and not the thickness of a wall. The
//! thickness percentiles leave such balls out.

use super::least_wall::Wall;
use crate::frame::Vec3;
use crate::mesh::MeshSolid;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::inputs::scaffold::outer_faces;
use crate::recipe::{Boundary, Op, Operand};
use rayon::prelude::*;

/// A ball whose centre is farther from a face than its radius plus this many voxels does not touch the
/// face.
const TOUCH_TOLERANCE: f64 = 0.25;

/// The faces that cut a solid.
pub(crate) struct CutFaces<'a> {
    scaffold: Vec<MeshSolid>,
    meshes: Vec<&'a MeshSolid>,
    /// Edge of a voxel, world units.
    voxel_size: f64,
}

impl<'a> CutFaces<'a> {
    /// The cut faces of a run.
    pub fn new(inputs: &'a Inputs, voxel_size: f64) -> Self {
        let sections = inputs.recipe.sections();
        let is_cut = |s: &crate::recipe::ScaffoldSection| s.boundary == Boundary::Cut;
        let mut scaffold = Vec::new();
        let mut meshes: Vec<&MeshSolid> = Vec::new();
        if let Some(tiling) = inputs.tiling() {
            if sections.scaffold.as_ref().is_some_and(is_cut) {
                scaffold = outer_faces(&tiling.loaded.scaffold, voxel_size);
            }
            meshes.extend(tiling.loaded.envelope.as_deref());
        }
        for (n, op) in sections.op.iter().enumerate() {
            if let Op::Intersect(operand) | Op::Subtract(operand) = op
                && matches!(operand, Operand::Mesh(_) | Operand::Crystal(_))
            {
                meshes.push(inputs.solid(&format!("op.{n}")));
            }
        }
        Self {
            scaffold,
            meshes,
            voxel_size,
        }
    }

    /// The 5th, 50th and 95th percentile of thickness, world units, over the walls whose balls touch no cut.
    /// `thicker` is the number of walls beyond the measured range, which count as thicker than all. `None` where a
    /// percentile falls among those, or without walls.
    pub fn percentiles(&self, walls: &[Wall], thicker: usize) -> Option<[f64; 3]> {
        let whole = walls.par_iter().filter(|wall| !self.touch(wall));
        let mut whole: Vec<f64> = whole.map(|wall| wall.thickness).collect();
        whole.sort_unstable_by(f64::total_cmp);
        let count = whole.len() + thicker;
        let at = |share: usize| whole.get(count * share / 100).copied();
        Some([at(5)?, at(50)?, at(95)?])
    }

    /// Whether the ball of a wall touches a cut.
    fn touch(&self, wall: &Wall) -> bool {
        let reach = wall.thickness / 2.0 + TOUCH_TOLERANCE * self.voxel_size;
        let near = |solid: &MeshSolid, p: Vec3| solid.closest_within(p, reach).is_some();
        let mut all = self.scaffold.iter().chain(self.meshes.iter().copied());
        all.any(|solid| near(solid, wall.centre))
    }
}
