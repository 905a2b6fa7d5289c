//! Beam lattices of files as solids: round beams, cones with flat or half-round ends, balls, and what
//! clips them.

use super::error::RunError;
use super::field_ops::{Borrowed, Shape, common_part, whole};
use super::input_files::not_a_solid;
use super::level_set_ops::Bench;
use super::offsets::Offsets;
use crate::beams::{Beam, Beams, Rod, Rods};
use crate::field::{Complement, WorldField};
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::io::{BeamCap, BeamPart, FileBeam, SolidFile};
use crate::mesh::{MeshSolid, TriMesh};
use crate::recipe::Scale;
use crate::vdb::{LevelSet, Session};
use std::path::Path;

/// Radii that differ by less than this share are one.
const SAME: f64 = 1e-9;

/// The beams of a file in world space.
pub(super) struct Lattice {
    parts: Vec<Part>,
    bounds: Aabb,
}

/// Beams with one clipping mesh or none.
#[derive(Default)]
struct Part {
    beams: Option<Beams>,
    rods: Option<Rods>,
    /// The mesh, and whether what is inside it is kept.
    clip: Option<(MeshSolid, bool)>,
}

/// A beam as a swept ball, or as a cone with the balls that reach beyond it.
fn enter(beam: &FileBeam, beams: &mut Vec<Beam>, rods: &mut Vec<Rod>) {
    let [r, s] = beam.radii;
    let is_flat = beam.caps.map(|c| c == BeamCap::Butt);
    let own = Beam {
        ends: beam.ends,
        radii: beam.radii,
    };
    if (r - s).abs() <= SAME * r.max(s) && is_flat == [false, false] {
        beams.push(own);
        return;
    }
    rods.push(Rod {
        beam: own,
        is_round: is_flat.map(|f| !f),
    });
    for n in 0..2 {
        // At the thinner end the cone holds the inner half of the ball.
        if beam.caps[n] == BeamCap::Sphere && beam.radii[n] > beam.radii[1 - n] {
            beams.push(Beam {
                ends: [beam.ends[n]; 2],
                radii: [beam.radii[n]; 2],
            });
        }
    }
}

impl Lattice {
    /// The beams of a file under a map that scales by `factor`; `solid` makes a solid of a clipping mesh.
    /// `None` if there are none.
    pub fn new(
        parts: &[BeamPart],
        map: impl Fn(Vec3) -> Vec3,
        factor: f64,
        mut solid: impl FnMut(TriMesh) -> Result<MeshSolid, RunError>,
    ) -> Result<Option<Self>, RunError> {
        let mut made: Vec<Part> = Vec::new();
        let (mut free, mut bounds) = ((Vec::new(), Vec::new()), Aabb::EMPTY);
        let mut close = |(beams, rods): (Vec<Beam>, Vec<Rod>), clip: Option<(MeshSolid, bool)>| {
            let part = Part {
                beams: Beams::new(&beams, &[]),
                rods: Rods::new(&rods),
                clip,
            };
            let own = part.bounds();
            if !own.is_empty() {
                bounds = bounds.union(own);
                made.push(part);
            }
        };
        for part in parts {
            let mut own = (Vec::new(), Vec::new());
            let lists = if part.clip.is_some() {
                &mut own
            } else {
                &mut free
            };
            for beam in &part.beams {
                let placed = FileBeam {
                    ends: beam.ends.map(&map),
                    radii: beam.radii.map(|r| r * factor),
                    ..*beam
                };
                enter(&placed, &mut lists.0, &mut lists.1);
            }
            lists.0.extend(part.balls.iter().map(|&(c, r)| Beam {
                ends: [map(c); 2],
                radii: [r * factor; 2],
            }));
            if let Some(clip) = &part.clip {
                let mesh = solid(clip.mesh.mapped(&map))?;
                close(own, Some((mesh, clip.keeps_inside)));
            }
        }
        close(free, None);
        let is_empty = made.is_empty();
        Ok((!is_empty).then_some(Self {
            parts: made,
            bounds,
        }))
    }

    /// The box around all of it.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The beams and a mesh, if there is one, as one field; `reach` bounds the distances that matter.
    pub fn field<'a>(
        &'a self,
        mesh: Option<&'a MeshSolid>,
        (reach, offsets): (f64, Offsets),
    ) -> Box<WorldField<'a>> {
        let join = |a: Option<Box<WorldField<'a>>>, b: Box<WorldField<'a>>| {
            Some(match a {
                Some(a) => whole(a, b, reach, offsets),
                None => b,
            })
        };
        let mut all = mesh.map(|m| Box::new(Borrowed(m)) as Box<WorldField<'a>>);
        for part in &self.parts {
            let mut own: Option<Box<WorldField<'a>>> = None;
            if let Some(beams) = &part.beams {
                own = join(own, Box::new(Borrowed(beams)));
            }
            if let Some(rods) = &part.rods {
                own = join(own, Box::new(Borrowed(rods)));
            }
            let Some(mut own) = own else { continue };
            if let Some((mesh, keeps_inside)) = &part.clip {
                let mesh: Box<WorldField<'a>> = Box::new(Borrowed(mesh));
                let kept = if *keeps_inside {
                    mesh
                } else {
                    Box::new(Complement(mesh))
                };
                own = common_part(own, kept, reach, offsets);
            }
            all = join(all, own);
        }
        all.unwrap_or_else(|| Box::new(crate::field::Union(Vec::new())))
    }
}

impl Part {
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

/// What a file with beams shows, as a level set of voxels of this edge, half a band of so many voxels.
///
/// # Errors
/// A mesh that bounds no solid; what the band and OpenVDB refuse.
pub fn solid_picture(
    path: &Path,
    solid: &SolidFile,
    [voxel_size, half_width]: [f64; 2],
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
    let lattice = Lattice::new(&solid.beams, |v| v, 1.0, repaired)?;
    let Some(lattice) = lattice else {
        return Err(RunError::Empty("the file".into()));
    };
    let bench = Bench {
        threads: session.threads,
        progress: session.progress,
        scale: Scale {
            unit: LengthUnit::default(),
            voxel_size,
        },
        half_width,
        region: None,
    };
    let reach = half_width * voxel_size;
    let shape = Shape {
        field: lattice.field(mesh.as_ref(), (reach, Offsets::default())),
        extent: solid.bounds(),
        name: "the file".into(),
    };
    Ok(bench.sample(&shape, "band")?.0)
}
