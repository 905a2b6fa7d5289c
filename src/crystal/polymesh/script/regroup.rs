//! Steps that change groups and start vertices and keep the geometry.
//!
//! ```text
//! assign FACES ID|new                                      the faces get this group, or the one after the greatest
//! merge ID ID ...                                          all these groups become the first
//! renumber                                                 the groups become 1, 2, ... in their order
//! startvertex FACES toward=[x, y, z] | at=VERTEX | lowest  the loop of each face begins there
//! symmetrize [GROUP] rotations=false                       a group for each orbit of faces
//! ```
//! A function takes its arguments from `a` and returns the new model; the model of `interpreter` stays. Errors are at
//! the argument or step at fault.

use super::argument::{Arguments, Word};
use super::step::{Outcome, StepResult, mesh_of};
use super::{Interpreter, ScriptError};
use crate::polymesh::PolyMesh;
use crate::polymesh::form::cartesian_group;
use druse_geometry::frame::Mat3;

/// Largest difference of the entries of equal matrices: symmetries of a mesh are exact to about 1e-7 of its size.
const MATRIX_TOLERANCE: f64 = 1e-6;

/// A word as a group number, from 1.
fn group_number(a: &Arguments, word: &Word) -> Result<u32, ScriptError> {
    let value = a.evaluate(word)?;
    match a.whole(word, value)? {
        0 => Err(a.fault("group 0; groups count from 1")),
        n => Ok(n as u32),
    }
}

/// The step `assign`: the chosen faces get a group. `new` is the one after the greatest in use.
pub(super) fn assign(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let mesh = mesh_of(a, interpreter)?;
    let chosen = a.faces()?;
    let word = a.required("a group number, or new")?;
    let id = match word.text.as_str() {
        "new" => mesh.greatest_group().saturating_add(1),
        _ => group_number(a, word)?,
    };
    let groups = mesh.groups().iter().zip(&chosen);
    let groups = groups.map(|(&g, &c)| if c { id } else { g }).collect();
    Ok(Outcome::changed(
        interpreter.model(),
        mesh.clone().with_groups(groups),
    ))
}

/// The step `merge`: several groups become the first of them.
pub(super) fn merge(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let mesh = mesh_of(a, interpreter)?;
    let mut ids = Vec::new();
    while let Some(word) = a.positional() {
        let id = group_number(a, word)?;
        if !mesh.groups().contains(&id) {
            return Err(a.fault(format!("no face is in group {id}")));
        }
        ids.push(id);
    }
    let [first, _, ..] = ids[..] else {
        return Err(a.fault(format!("found {} groups; expected two or more", ids.len())));
    };
    let groups = mesh.groups().iter();
    let groups = groups
        .map(|g| if ids.contains(g) { first } else { *g })
        .collect();
    Ok(Outcome::changed(
        interpreter.model(),
        mesh.clone().with_groups(groups),
    ))
}

/// The step `renumber`: the groups in use become 1, 2, ... in the order of their numbers.
pub(super) fn renumber(a: &Arguments, interpreter: &Interpreter) -> StepResult {
    let mesh = mesh_of(a, interpreter)?;
    let counts = mesh.group_counts();
    let order: Vec<u32> = counts.into_keys().collect();
    // Every group is in the list, so that `map_or` does not use 1.
    let place = |g: &u32| order.binary_search(g).map_or(1, |n| n as u32 + 1);
    let groups = mesh.groups().iter().map(place).collect();
    Ok(Outcome::changed(
        interpreter.model(),
        mesh.clone().with_groups(groups),
    ))
}

/// The step `startvertex`: rotates the corner lists of the chosen faces, so that each begins at the corner nearest to
/// a point, at a vertex (its number, from 0), or at its lowest vertex number.
pub(super) fn start_vertex(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let mesh = mesh_of(a, interpreter)?;
    let chosen = a.faces()?;
    let toward = match a.value("toward")? {
        Some(word) => Some(a.vector_of(&word)?),
        None => None,
    };
    let at = a.count("at")?;
    let lowest = match a.positional() {
        None => false,
        Some(word) if word.text == "lowest" => true,
        Some(word) => {
            let text = format!(
                "found {:?}; expected toward=[x, y, z], at=VERTEX or lowest",
                word.text
            );
            return Err(a.fault(text));
        }
    };
    if usize::from(toward.is_some()) + usize::from(at.is_some()) + usize::from(lowest) != 1 {
        return Err(a.fault("expected exactly one of toward=[x, y, z], at=VERTEX, lowest"));
    }
    let mut shift = vec![0; mesh.face_count()];
    for f in (0..chosen.len()).filter(|&f| chosen[f]) {
        let face = mesh.face(f);
        // Places are counted in the list of the face: nearest to the target, the given vertex, or the lowest number.
        let point = |k: usize| mesh.vertices()[face[k] as usize];
        let places = 0..face.len();
        let start = if let Some(target) = toward {
            let far = |k: &usize| (point(*k) - target).norm_squared();
            places.min_by(|a, b| far(a).total_cmp(&far(b)))
        } else if let Some(vertex) = at {
            face.iter().position(|&v| v as usize == vertex)
        } else {
            places.min_by_key(|&k| face[k])
        };
        shift[f] = start
            // Only a vertex that the face does not have gives no start: the other two rules find one in any face.
            .ok_or_else(|| a.fault(format!("face {f} has no vertex {}", at.unwrap_or_default())))?;
    }
    Ok(Outcome::changed(
        interpreter.model(),
        mesh.with_starts(&shift),
    ))
}

/// The step `symmetrize`: groups of faces from the orbits of the mesh's symmetries, or of those in a point group by
/// symbol; with `rotations` mirrors are left out. A note states the order of the group and the number of orbits.
pub(super) fn symmetrize(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let rotations = a.flag("rotations")?;
    let group = a.positional();
    let mesh = mesh_of(a, interpreter)?;
    let components = mesh.components().1;
    if components != 1 {
        return Err(a.fault(format!(
            "the mesh has {components} components; expected one"
        )));
    }
    let (made, order) = match group {
        None => mesh.symmetrized(rotations),
        Some(word) => symmetrized_by(a, mesh, &word.text, rotations)?,
    };
    let orbits = made.greatest_group();
    let mut outcome = Outcome::changed(interpreter.model(), made);
    let what = if rotations { "rotations" } else { "symmetries" };
    outcome.notes = vec![format!("{order} {what}, {orbits} orbits of faces")];
    Ok(outcome)
}

/// A mesh symmetrized by the subgroup of its symmetries with the symbol `name`, and the order of that group (without
/// its mirrors for `rotations`). The error is an unknown symbol, or a group that the mesh does not have along x, y, z.
fn symmetrized_by(
    a: &Arguments,
    mesh: &PolyMesh,
    name: &str,
    rotations: bool,
) -> Result<(PolyMesh, usize), ScriptError> {
    let orientations = cartesian_group(name).map_err(|e| {
        let mut error = a.fault(e.to_string());
        error.hint = (name == "trigonal").then(|| super::step::TRIGONAL_HINT.to_owned());
        error
    })?;
    // The group has to lie in the symmetries of the mesh, in one of the orientations of its axes.
    let own = mesh.symmetries();
    let is_own = |m: &Mat3| own.iter().any(|s| (s.matrix - m).amax() < MATRIX_TOLERANCE);
    let found = orientations.iter().find(|group| group.iter().all(is_own));
    let Some(group) = found else {
        return Err(a.fault(format!(
            "the mesh does not have the group {name} about its centre, along the axes x, y, z; found {} \
             symmetries of the mesh, expected the {} of the group among them: turn the mesh, or omit the \
             group to use all symmetries of the mesh",
            own.len(),
            orientations[0].len()
        )));
    };
    Ok(mesh.symmetrized_by(rotations, |s| {
        group
            .iter()
            .any(|m| (s.matrix - m).amax() < MATRIX_TOLERANCE)
    }))
}
