//! Beam lattices of files as solids: round beams, cones with flat or spherical ends, balls, and clipping
//! meshes.

use super::input_files::not_a_solid;
use crate::beams::{Beam, Beams, Rod, Rods};
use crate::field::{Complement, WorldField};
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::io::{BeamCap, BeamPart, FileBeam, SolidFile};
use crate::mesh::{MeshSolid, TriMesh};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::shape::{Borrowed, Shape, intersection, union};
use crate::recipe::Scale;
use crate::vdb::{LevelSet, Session};
use std::path::Path;

/// Relative difference of radii below which they count as equal.
const RADIUS_TOLERANCE: f64 = 1e-9;

/// The beams of a file as a solid in world space.
pub(crate) struct LatticeSolid {
    parts: Vec<ClippedBeams>,
    bounds: Aabb,
}

/// Beams with at most one clipping mesh.
#[derive(Default)]
struct ClippedBeams {
    beams: Option<Beams>,
    rods: Option<Rods>,
    /// The mesh, and whether its inside is kept.
    clip: Option<(MeshSolid, bool)>,
}

/// Adds a beam of a file to one of two lists: as a swept ball where its radii are equal and both ends round, which
/// is the fast kind, or else as a cone and the balls at its ends that the cone does not contain.
fn add_beam(beam: &FileBeam, beams: &mut Vec<Beam>, rods: &mut Vec<Rod>) {
    let [r, s] = beam.radii;
    let is_flat = beam.caps.map(|c| c == BeamCap::Butt);
    let swept = Beam {
        ends: beam.ends,
        radii: beam.radii,
    };
    if (r - s).abs() <= RADIUS_TOLERANCE * r.max(s) && is_flat == [false, false] {
        beams.push(swept);
        return;
    }
    rods.push(Rod {
        beam: swept,
        is_round: is_flat.map(|f| !f),
    });
    for n in 0..2 {
        // `is_round` gives an end the outer half of its ball. Of a whole ball the inner half sticks out of the
        // cone where the cone narrows inward.
        // At the thinner end the cone contains the inner half of the ball.
        if beam.caps[n] == BeamCap::Sphere && beam.radii[n] > beam.radii[1 - n] {
            beams.push(Beam {
                ends: [beam.ends[n]; 2],
                radii: [beam.radii[n]; 2],
            });
        }
    }
}

impl LatticeSolid {
    /// The beams of a file under a map that scales by `factor`, to world units. `solid` makes a solid of a
    /// clipping mesh (a mesh whose inside or outside alone the beams of a part keep). `None` if there are no
    /// beams, or none left in the box of the mesh that clips them.
    pub fn new(
        parts: &[BeamPart],
        map: impl Fn(Vec3) -> Vec3,
        factor: f64,
        mut solid: impl FnMut(TriMesh) -> Result<MeshSolid, RunError>,
    ) -> Result<Option<Self>, RunError> {
        let mut made: Vec<ClippedBeams> = Vec::new();
        // Parts without a clipping mesh are collected into one, so that one search finds their beams.
        let (mut unclipped, mut bounds) = ((Vec::new(), Vec::new()), Aabb::EMPTY);
        let mut add_part = |(beams, rods): (Vec<Beam>, Vec<Rod>),
                            clip: Option<(MeshSolid, bool)>| {
            let part = ClippedBeams {
                beams: Beams::new(&beams, &[]),
                rods: Rods::new(&rods),
                clip,
            };
            let part_bounds = part.bounds();
            if !part_bounds.is_empty() {
                bounds = bounds.union(part_bounds);
                made.push(part);
            }
        };
        for part in parts {
            let mut clipped = (Vec::new(), Vec::new());
            let lists = if part.clip.is_some() {
                &mut clipped
            } else {
                &mut unclipped
            };
            for beam in &part.beams {
                let placed = FileBeam {
                    ends: beam.ends.map(&map),
                    radii: beam.radii.map(|r| r * factor),
                    ..*beam
                };
                add_beam(&placed, &mut lists.0, &mut lists.1);
            }
            // A ball is a beam of length 0.
            lists.0.extend(part.balls.iter().map(|&(c, r)| Beam {
                ends: [map(c); 2],
                radii: [r * factor; 2],
            }));
            if let Some(clip) = &part.clip {
                let mesh = solid(clip.mesh.mapped(&map))?;
                add_part(clipped, Some((mesh, clip.keeps_inside)));
            }
        }
        add_part(unclipped, None);
        let is_empty = made.is_empty();
        Ok((!is_empty).then_some(Self {
            parts: made,
            bounds,
        }))
    }

    /// The bounding box.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The union of the beams and a mesh, if there is one, as a field. `reach` bounds the distances
    /// that matter, world units.
    pub fn field<'a>(
        &'a self,
        mesh: Option<&'a MeshSolid>,
        reach: f64,
        offsets: Offsets,
    ) -> Box<WorldField<'a>> {
        let united = |a: Option<Box<WorldField<'a>>>, b: Box<WorldField<'a>>| {
            Some(match a {
                Some(a) => union(a, b, reach, offsets),
                None => b,
            })
        };
        let mut all = mesh.map(|m| Box::new(Borrowed(m)) as Box<WorldField<'a>>);
        for part in &self.parts {
            let mut part_field: Option<Box<WorldField<'a>>> = None;
            if let Some(beams) = &part.beams {
                part_field = united(part_field, Box::new(Borrowed(beams)));
            }
            if let Some(rods) = &part.rods {
                part_field = united(part_field, Box::new(Borrowed(rods)));
            }
            let Some(mut part_field) = part_field else {
                continue;
            };
            // A clip keeps the inside of its mesh or the outside.
            if let Some((mesh, keeps_inside)) = &part.clip {
                let mesh: Box<WorldField<'a>> = Box::new(Borrowed(mesh));
                let kept = if *keeps_inside {
                    mesh
                } else {
                    Box::new(Complement(mesh))
                };
                part_field = intersection(part_field, kept, reach, offsets);
            }
            all = united(all, part_field);
        }
        // `new` makes no lattice without beams, so that the empty union does not occur.
        all.unwrap_or_else(|| Box::new(crate::field::Union(Vec::new())))
    }
}

impl ClippedBeams {
    fn bounds(&self) -> Aabb {
        let beams = self.beams.as_ref().map_or(Aabb::EMPTY, Beams::bounds);
        let rods = self.rods.as_ref().map_or(Aabb::EMPTY, Rods::bounds);
        let all = beams.union(rods);
        match &self.clip {
            Some((mesh, true)) => all.intersection(mesh.bounds()),
            _ => all,
        }
    }
}

/// The solid of a file with beams as a level set, for a picture. The voxel size is in the file's
/// unit, `half_width` in voxels.
///
/// # Errors
/// A mesh that bounds no solid; a file without beams, or with none left by clips; an error of the band or of OpenVDB.
pub fn solid_picture(
    path: &Path,
    solid: &SolidFile,
    voxel_size: f64,
    half_width: f64,
    session: Session,
) -> Result<LevelSet, RunError> {
    let repaired = |mesh: TriMesh| {
        let made = MeshSolid::repaired(mesh);
        made.map(|m| m.0)
            .map_err(|e| RunError::Read(not_a_solid(path, &e)))
    };
    let mesh = match &solid.file.mesh {
        mesh if mesh.is_empty() => None,
        mesh => Some(repaired(mesh.clone())?),
    };
    let lattice = LatticeSolid::new(&solid.beams, |v| v, 1.0, repaired)?;
    let Some(lattice) = lattice else {
        return Err(RunError::Empty("the file".into()));
    };
    let scale = Scale {
        unit: LengthUnit::default(),
        voxel_size,
    };
    // A picture has no recipe, and all lengths stay in the unit of the file: the one here is not used.
    let context = StageContext::of_solid(session, scale, half_width);
    let reach = half_width * voxel_size;
    let shape = Shape {
        field: lattice.field(mesh.as_ref(), reach, Offsets::default()),
        extent: solid.bounds(),
        name: "the file".into(),
    };
    Ok(context.sample(&shape, "band")?.0)
}
