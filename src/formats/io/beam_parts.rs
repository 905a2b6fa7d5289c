//! Beams of files: their ends, caps and clipping meshes.
//!
//! These are types only; `beams.rs` reads and writes them. Lengths are in the unit of the file; those of a
//! [`BeamLattice`] get a factor from the writer.

use super::mesh_format::MeshFile;
use druse_geometry::frame::{Aabb, Vec3};
use druse_geometry::mesh::TriMesh;

/// Beams over shared nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeamLattice {
    /// The positions of the nodes.
    pub nodes: Vec<Vec3>,
    /// The beams between them.
    pub beams: Vec<Beam>,
}

/// The cap at an end of a beam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BeamCap {
    /// A ball of the beam's radius there.
    #[default]
    Sphere,
    /// The half of that ball that points away from the beam.
    Hemisphere,
    /// Flat.
    Butt,
}

/// A beam in file coordinates: a cylinder or a truncated cone, and its caps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileBeam {
    /// The end points of the axis.
    pub ends: [Vec3; 2],
    /// The radius at each end.
    pub radii: [f64; 2],
    /// The cap at each end.
    pub caps: [BeamCap; 2],
}

impl FileBeam {
    /// The bounding box of the axis with its radius and caps, exact but for the cone of a beam whose radii differ,
    /// whose discs count as those of a cylinder.
    pub fn bounds(&self) -> Aabb {
        let direction = (self.ends[1] - self.ends[0])
            .try_normalize(0.0)
            .unwrap_or_default();
        (0..2).fold(Aabb::EMPTY, |b, n| {
            let (c, r) = (self.ends[n], self.radii[n]);
            let outward = if n == 0 { -direction } else { direction };
            // The half extent of the disc at the end along each axis; a hemisphere extends it on the outward side.
            let disc = direction.map(|a| r * (1.0 - a * a).max(0.0).sqrt());
            let reach = |sign: f64| {
                Vec3::from_fn(|axis, _| match self.caps[n] {
                    BeamCap::Sphere => r,
                    BeamCap::Hemisphere if outward[axis] * sign >= 0.0 => r,
                    _ => disc[axis],
                })
            };
            b.union(Aabb {
                min: c - reach(-1.0),
                max: c + reach(1.0),
            })
        })
    }
}

/// A mesh that clips a lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamClip {
    /// Whether the lattice remains inside the mesh (true) or outside.
    pub keeps_inside: bool,
    /// The mesh, in file coordinates.
    pub mesh: TriMesh,
}

/// The beams and balls of one object of a file, in file coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeamPart {
    /// The beams.
    pub beams: Vec<FileBeam>,
    /// Centres and radii of balls.
    pub balls: Vec<(Vec3, f64)>,
    /// The clipping mesh, if any.
    pub clip: Option<BeamClip>,
}

impl BeamPart {
    /// The number of beams and balls.
    pub fn len(&self) -> usize {
        self.beams.len() + self.balls.len()
    }

    /// Whether there are no beams and no balls.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A bounding box: that of beams and balls, intersected with that of a mesh that clips the outside.
    pub fn bounds(&self) -> Aabb {
        let beams = self
            .beams
            .iter()
            .fold(Aabb::EMPTY, |b, beam| b.union(beam.bounds()));
        let ball = |&(c, r): &(Vec3, f64)| Aabb { min: c, max: c }.dilated(r);
        let all = self.balls.iter().fold(beams, |b, s| b.union(ball(s)));
        match &self.clip {
            Some(clip) if clip.keeps_inside => all.intersection(clip.mesh.bounds()),
            _ => all,
        }
    }
}

/// The solid in a file: triangles, and beams if the format supports them.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidFile {
    /// The triangles (none in a file of beams only), the unit and the warnings.
    pub file: MeshFile,
    /// The beams of each object, in the unit of the triangles.
    pub beams: Vec<BeamPart>,
}

impl SolidFile {
    /// The bounding box of triangles and beams.
    pub fn bounds(&self) -> Aabb {
        let mesh = &self.file.mesh;
        let start = if mesh.is_empty() {
            Aabb::EMPTY
        } else {
            mesh.bounds()
        };
        self.beams
            .iter()
            .fold(start, |b, part| b.union(part.bounds()))
    }
}

/// A beam between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// The indices of its nodes.
    pub ends: [u32; 2],
    /// The radius at each end.
    pub radii: [f64; 2],
}
