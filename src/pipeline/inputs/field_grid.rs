//! A grid of an OpenVDB file as a field in the recipe's coordinates, interpolated trilinearly between
//! voxels.

use super::input_files::{InputFiles, frame_map};
use super::volumes::{fetch, unit_of};
use crate::frame::{Aabb, Coord, Mat3, Vec3};
use crate::pipeline::base::error::RunError;
use crate::recipe::{FileFrame, Outside};
use crate::vdb::{IndexMap, Volume};
use std::path::Path;

/// Radius of the search for the nearest value where a value is missing, voxels.
const MAX_SEARCH_RADIUS: i32 = 16;
/// Weight below which a voxel's value does not count, so that it may be missing.
const MIN_WEIGHT: f64 = 1e-9;

/// A grid of floats as a field.
pub(crate) struct FieldGrid {
    volume: Volume,
    map: IndexMap,
    /// From differences to `origin`, where the file's origin lies in the recipe's coordinates, to the file's coordinates.
    inward: Mat3,
    origin: Vec3,
    /// First and last active voxel.
    voxels: [Vec3; 2],
    bounds: Aabb,
}

/// A value that is not finite, and its voxel.
pub(crate) type Missing = (f64, [i32; 3]);

impl FieldGrid {
    /// Reads a grid of the file `path` by its name, in a child process if there is one. `file` has its unit and
    /// frame.
    pub fn read(
        files: &InputFiles,
        file: &FileFrame,
        path: &Path,
        name: &str,
    ) -> Result<Self, RunError> {
        let volume = fetch(files.reader, path, Some(name))?;
        let unit = unit_of(&volume, file.unit.map(|u| u.0));
        let outward = frame_map(file, Some(unit), files.recipe.unit());
        // The frame is affine: its images of 0 and of the axes give its matrix, whose inverse leads from
        // points to the file's coordinates.
        let origin = outward(Vec3::zeros());
        let matrix =
            Mat3::from_columns(&[Vec3::x(), Vec3::y(), Vec3::z()].map(|e| outward(e) - origin));
        let info = volume.info();
        let map = info.index_map();
        // A grid without active voxels has the box of voxel (0, 0, 0).
        let voxels = info.bbox.unwrap_or_default();
        let voxels = voxels.map(|v| Vec3::from(v.map(f64::from)));
        // A rotated box is bounded by the images of its corners.
        let corners = (0..8u8).map(|c| {
            let corner = Vec3::from_fn(|a, _| voxels[usize::from((c >> a) & 1)][a]);
            outward(map.world(corner))
        });
        Ok(Self {
            bounds: Aabb::of(corners),
            map,
            volume,
            // A placement has a positive scale, so that its inverse exists.
            inward: matrix.try_inverse().unwrap_or_default(),
            origin,
            voxels,
        })
    }

    /// The box around its active voxels.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The point of the box of active voxels that is nearest to a point, in index space, and whether the
    /// point lies outside that box.
    pub fn nearest_index(&self, p: Vec3) -> (Vec3, bool) {
        let index = self.map.index(self.inward * (p - self.origin));
        let [low, high] = self.voxels;
        // A point that the map cannot place counts as outside.
        let index = index.unwrap_or_else(|| low.add_scalar(-1.0));
        let near = index.sup(&low).inf(&high);
        // More than rounding, voxels.
        (near, (near - index).norm() > 1e-6)
    }

    /// The value at a point in index space (voxels of the file), trilinear between voxel centres. `outside` gives the
    /// substitute for missing values, if there is one.
    pub fn at(&self, index: Vec3, outside: Option<Outside>) -> Result<f64, Missing> {
        let first = index.map(f64::floor);
        let fraction = index - first;
        let corner = |n: i32| {
            let bits = [n & 1, (n >> 1) & 1, (n >> 2) & 1];
            let voxel = [0, 1, 2].map(|a| first[a] as i32 + bits[a]);
            // Trilinear weights: the product over the axes of f or 1 - f.
            let weight: f64 = (0..3)
                .map(|a| {
                    if bits[a] == 1 {
                        fraction[a]
                    } else {
                        1.0 - fraction[a]
                    }
                })
                .product();
            (Coord(voxel), weight)
        };
        let corners: Vec<(Coord, f64)> = (0..8).map(corner).filter(|c| c.1 > MIN_WEIGHT).collect();
        let voxels: Vec<Coord> = corners.iter().map(|c| c.0).collect();
        let values = self.values(&voxels);
        let mut sum = 0.0;
        for ((voxel, weight), v) in corners.into_iter().zip(values) {
            let v = if v.is_finite() {
                v
            } else {
                let missing = Err((v, voxel.0));
                match outside {
                    Some(Outside::Value(v)) => v.0,
                    Some(Outside::Nearest) => self.nearest_value(voxel).map_or(missing, Ok)?,
                    Some(Outside::Error) | None => return missing,
                }
            };
            sum += v * weight;
        }
        Ok(sum)
    }

    /// The grid's values at some voxels; the background at inactive ones.
    fn values(&self, voxels: &[Coord]) -> Vec<f64> {
        // An error only if lengths differ, which they do not.
        let values = self.volume.values(voxels).unwrap_or_default();
        values.into_iter().map(f64::from).collect()
    }

    /// The value of the voxel nearest to one in the innermost shell that has any, within `MAX_SEARCH_RADIUS`; the first
    /// of equally near voxels. `None` without any.
    fn nearest_value(&self, voxel: Coord) -> Option<f64> {
        // Shells of growing cubes, each sorted by distance. A corner of one shell may be farther than a
        // face of the next; the shell decides.
        for reach in 1..=MAX_SEARCH_RADIUS {
            let side = -reach..=reach;
            let mut shell = Vec::new();
            for x in side.clone() {
                for y in side.clone() {
                    // Within the cube only its first and last z belong to the shell.
                    let is_edge = x.abs() == reach || y.abs() == reach;
                    let step = if is_edge { 1 } else { 2 * reach as usize };
                    shell.extend(side.clone().step_by(step).map(|z| (x, y, z)));
                }
            }
            shell.sort_by_key(|(x, y, z)| x * x + y * y + z * z);
            let shell_voxels: Vec<Coord> = shell
                .iter()
                .map(|&(x, y, z)| voxel.offset(x, y, z))
                .collect();
            if let Some(v) = self
                .values(&shell_voxels)
                .into_iter()
                .find(|v| v.is_finite())
            {
                return Some(v);
            }
        }
        None
    }
}
