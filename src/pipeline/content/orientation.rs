//! Elements of a recipe's scaffold turned (their nodes numbered in another order) so that its cells continue over
//! all faces, or along directions that the recipe gives. It reads directions from formulas and fields; the search
//! itself is in `tiling`.

use crate::cell::Cell;
use crate::frame::{Mat3, Vec3};
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::motion::moves;
use crate::pipeline::inputs::scaffold::LoadedScaffold;
use crate::pipeline::inputs::spatial_value::SpatialContext;
use crate::recipe::{self, Direction, FieldRef, OrientSection, TilingSection, Varying};
use crate::tiling::{Aim, Directions, Member, Mismatch, Mixture, TilingError, orient};
use std::sync::Arc;

/// How elements were turned.
#[derive(Default)]
pub(super) struct Turned {
    /// Number of the elements that have another numbering.
    pub count: usize,
    /// The elements that hold the cells in several turns.
    pub mixture: Mixture,
}

/// Turns the elements of `loaded.scaffold` as the tiling's cells need it.
/// `cells` are the tiling's cells, for each name one per element shape; without any (round beams) nothing is turned.
///
/// # Errors
/// [`RunError::Misfit`] where no turns make the cells continue and the recipe does not allow blends;
/// [`RunError::Tiling`] for `tiling.orient` without cells, and for directions that cannot be evaluated.
pub(super) fn turn_elements(
    files: &mut InputFiles,
    loaded: &mut LoadedScaffold,
    section: &TilingSection,
    cells: &[Vec<Cell>],
    envelope: Option<&MeshSolid>,
) -> Result<Turned, RunError> {
    let wanted = &*section.orient.0;
    if cells.is_empty() && *wanted != OrientSection::default() {
        return Err(RunError::Tiling(
            "tiling.orient has no meaning for round beams, whose graph has the symmetry of its element; expected \
             section = \"fitted\" in the cell, or no such key"
                .into(),
        ));
    }
    let aim = match &wanted.toward {
        // Axes along those of the world would jump while a part moves.
        None if moves(files.recipe) => Aim::Numbering,
        None => Aim::World,
        Some(toward) => {
            let scaffold = &loaded.scaffold;
            let centre = |e: crate::scaffold::ElementMap| e.map(e.shape().centroid()).0;
            let points: Vec<Vec3> = scaffold.elements().map(centre).collect();
            // Directions are taken at the centres of the elements.
            let mut vectors = |key: &str, direction: &Direction| {
                let spatial = SpatialContext {
                    bounds: scaffold.bounds(),
                    envelope,
                    key: format!("tiling.orient.{key}"),
                    clock: files.recipe.clock(),
                };
                unit_vectors(files, &spatial, direction, &points)
            };
            Aim::Directions(Directions {
                toward: vectors("toward", toward)?,
                up: match &wanted.up {
                    Some(up) => vectors("up", up)?,
                    None => Vec::new(),
                },
                is_axial: toward.is_principal(),
            })
        }
    };
    let members: Vec<Member<Cell>> = cells
        .iter()
        .map(|cells| Member {
            name: String::new(),
            cells: cells.iter().collect(),
        })
        .collect();
    let mismatch = match wanted.mismatch {
        recipe::Mismatch::Error => Mismatch::Refuse,
        recipe::Mismatch::Blend => Mismatch::Blend {
            width: wanted.width.map(|w| w.0),
        },
    };
    let found = orient(&mut loaded.scaffold, &members, &aim, mismatch).map_err(|e| match e {
        TilingError::Misfit(misfit) => RunError::Misfit {
            misfit,
            scaffold: Arc::clone(&loaded.scaffold),
        },
        other => RunError::Tiling(other.to_string()),
    })?;
    Ok(found.map_or_else(Turned::default, |found| Turned {
        count: found.turned,
        mixture: found.mixture,
    }))
}

/// Unit vectors of a direction at points: from three numbers, a field of vectors, or the principal
/// direction of a field of stresses. Fails where a vector has length 0, or a field has another number of components.
fn unit_vectors(
    files: &mut InputFiles,
    spatial: &SpatialContext,
    direction: &Direction,
    points: &[Vec3],
) -> Result<Vec<Vec3>, RunError> {
    let vectors = match direction {
        Direction::Components(components) => {
            // Each component may vary over the part on its own.
            let mut all = Vec::new();
            for varying in components.iter() {
                all.push(spatial.values(files, varying, points)?);
            }
            let vector = |n: usize| Vec3::new(all[0][n], all[1][n], all[2][n]);
            (0..points.len()).map(vector).collect()
        }
        Direction::Field(field) => {
            match (direction.is_principal(), spatial.components(files, field)?) {
                // xx yy zz xy yz zx: six components in VTK's order, nine by rows.
                (true, 6) => {
                    let order = ["0", "1", "2", "3", "4", "5"];
                    principal_directions(&components(files, spatial, field, &order, points)?)
                }
                (true, 9) => {
                    let order = ["0", "4", "8", "1", "5", "6"];
                    principal_directions(&components(files, spatial, field, &order, points)?)
                }
                (false, 3) => {
                    let all = components(files, spatial, field, &["0", "1", "2"], points)?;
                    let at = |n: usize| Vec3::new(all[0][n], all[1][n], all[2][n]);
                    (0..points.len()).map(at).collect()
                }
                (is_principal, count) => {
                    let expected = if is_principal {
                        "6 or 9, as stresses have"
                    } else {
                        "3 of a vector, or component = \"principal\" for stresses of 6 or 9"
                    };
                    return Err(RunError::Tiling(format!(
                        "{}: the field {:?} has {count} number{} for each place; expected {expected}",
                        spatial.key,
                        field.field,
                        if count == 1 { "" } else { "s" },
                    )));
                }
            }
        }
    };
    let unit = |(v, p): (&Vec3, &Vec3)| {
        v.try_normalize(0.0).ok_or_else(|| {
            let place = [p.x, p.y, p.z].map(short_number).join(", ");
            RunError::Tiling(format!(
                "{}: the direction has length 0 at ({place}); expected one of another length there",
                spatial.key
            ))
        })
    };
    let mut found = vectors
        .iter()
        .zip(points)
        .map(unit)
        .collect::<Result<Vec<Vec3>, _>>()?;
    // From the axes of the file to those of the recipe; a placement may scale them.
    if let Direction::Field(field) = direction {
        let map = spatial.direction_map(files.recipe, field)?;
        for v in &mut found {
            *v = map(*v).normalize();
        }
    }
    Ok(found)
}

/// Values of components of a field at points, one list per name of `names`.
fn components(
    files: &mut InputFiles,
    spatial: &SpatialContext,
    field: &FieldRef,
    names: &[&str],
    points: &[Vec3],
) -> Result<Vec<Vec<f64>>, RunError> {
    let values = |name: &&str| {
        let component = FieldRef {
            component: Some((*name).to_owned()),
            ..field.clone()
        };
        spatial.values(files, &Varying::Field(component), points)
    };
    names.iter().map(values).collect()
}

/// Directions of the principal stress of the greatest magnitude, from interpolated components xx yy zz xy yz zx of the
/// tensor: a direction of it has no sign, so that it cannot be interpolated itself.
fn principal_directions(all: &[Vec<f64>]) -> Vec<Vec3> {
    let direction = |n: usize| {
        let s = |i: usize| all[i][n];
        let tensor = Mat3::new(s(0), s(3), s(5), s(3), s(1), s(4), s(5), s(4), s(2));
        let eigen = tensor.symmetric_eigen();
        let largest = eigen.eigenvalues.iamax();
        // A stress of zero has no direction.
        let is_zero = eigen.eigenvalues[largest] == 0.0;
        let v: Vec3 = eigen.eigenvectors.column(largest).into();
        if is_zero { Vec3::zeros() } else { v }
    };
    (0..all[0].len()).map(direction).collect()
}
