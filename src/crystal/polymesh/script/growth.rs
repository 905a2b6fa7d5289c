//! The least growth of a mesh in the rest of a script: a mesh that would be too large is refused before it is made.
//!
//! Corners are counted step by step: a scheme multiplies them by a number of its own, an extrusion or subdivision of
//! all faces too, and other steps on a mesh remove none. The count ends at the first step that makes another mesh or
//! writes a file, and at loops whose number of rounds is not known yet.

use super::argument::{self, Statement};
use super::{Interpreter, Item, ScriptError};
use crate::polymesh::{Extrusion, MAX_CORNERS, Parts, Remesh, extrusion_named};

/// Corners of a mesh from which on the steps that follow are counted: smaller ones cost little to make.
pub(super) const MIN_CORNERS: u64 = 1 << 18;

/// Refuses items of a script, in `rounds` rounds, after which the mesh would have too many corners, if it has
/// `min_corners` now; smaller meshes are not checked. Nothing is run, and steps after the line `until` do not count.
pub(super) fn require_bounded(
    list: &[Item],
    rounds: usize,
    interpreter: &Interpreter,
    until: usize,
    min_corners: u64,
) -> Result<(), ScriptError> {
    let corners = interpreter.mesh().map_or(0, |m| m.corner_count() as u64);
    if corners < min_corners.max(1) {
        return Ok(());
    }
    let mut count = Count {
        corners,
        interpreter,
        until,
        has_parameters: false,
    };
    count.rounds(list, rounds).map(|_| ())
}

/// The corners that a mesh has at least after the steps so far.
struct Count<'a, 'w> {
    corners: u64,
    interpreter: &'a Interpreter<'w>,
    until: usize,
    /// Whether a parameter gets its value on the way.
    has_parameters: bool,
}

impl Count<'_, '_> {
    /// Counts rounds of a list; returns whether the steps after them can be counted. Errors state that the mesh would
    /// be too large.
    fn rounds(&mut self, list: &[Item], rounds: usize) -> Result<bool, ScriptError> {
        for round in 1..=rounds {
            let before = self.corners;
            let goes_on = self.items(list).map_err(|e| ScriptError {
                message: match rounds {
                    1 => e.message,
                    _ => format!("{}, in round {round} of the {rounds} left", e.message),
                },
                ..e
            })?;
            if !goes_on {
                return Ok(false);
            }
            // A round that adds nothing is followed by others of its kind.
            if self.corners == before {
                break;
            }
        }
        Ok(true)
    }

    /// Counts a list of items once; returns whether the items after it can be counted.
    fn items(&mut self, list: &[Item]) -> Result<bool, ScriptError> {
        for item in list {
            match item {
                Item::Parameter { .. } => self.has_parameters = true,
                Item::Repeat {
                    count,
                    body,
                    line,
                    column,
                } => {
                    // After a parameter of the script got a new value its old one is not valid: only a
                    // count without parameters is known then. A count beyond 1e5 is an error of the run.
                    let times = if self.has_parameters {
                        count.finite(&|_, _| None).ok()
                    } else {
                        argument::number(count, self.interpreter, *line, *column).ok()
                    };
                    let times = times.filter(|t| *line <= self.until && (0.0..=1e5).contains(t));
                    let Some(times) = times else {
                        return Ok(false);
                    };
                    if !self.rounds(body, times as usize)? {
                        return Ok(false);
                    }
                }
                Item::Step(statement) => {
                    let factor = factor(statement).filter(|_| statement.line <= self.until);
                    let Some(factor) = factor else {
                        return Ok(false);
                    };
                    // Each step multiplies the corners. The first number beyond the limit ends the script
                    // before the mesh is made.
                    self.corners = self.corners.saturating_mul(factor);
                    if self.corners > MAX_CORNERS {
                        let text = format!(
                            "the mesh would have {} corners or more; expected at most {MAX_CORNERS}",
                            self.corners
                        );
                        return Err(statement.fault(0, text));
                    }
                }
            }
        }
        Ok(true)
    }
}

/// The number of new corners for each old one, at least; `None` for steps that cannot be counted: those that make
/// another mesh, `save`, and faulty ones, which fail later with their own message.
fn factor(statement: &Statement) -> Option<u64> {
    let all = statement.words.iter().any(|w| w.text == "all");
    match statement.verb.as_str() {
        "remesh" => Some(
            Remesh::named(&statement.words.first()?.text)
                .ok()?
                .least_growth(),
        ),
        "extrude" if all => {
            let (kind, operator) = extrusion_named(&statement.words.first()?.text)?;
            let extrusion = Extrusion {
                operator,
                ..Extrusion::regular(kind)
            };
            // Of a face with any even number of corners, since the corners of a cap are in proportion.
            Some(extrusion.cap_corners(2) / 2)
        }
        "subdivide" if all => {
            let is_triangles = statement.words.iter().any(|w| w.text == "into=triangles");
            let into = if is_triangles {
                Parts::Triangles
            } else {
                Parts::Quads
            };
            Some(into.corners())
        }
        "extrude" | "subdivide" | "assign" | "merge" | "renumber" | "startvertex"
        | "symmetrize" | "move" | "turn" | "scale" => Some(1),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polymesh::{PolyMesh, extrusion_names, scheme_names, seed};

    fn seeds() -> Vec<PolyMesh> {
        vec![
            seed::platonic("cube", 1.0).unwrap(),
            seed::platonic("dodecahedron", 1.0).unwrap(),
            seed::prism(8, 1.0, 1.0).unwrap(),
            seed::pyramid(5, 1.0, None).unwrap(),
        ]
    }

    /// The mesh that a step makes of another, and the factor that is counted for it.
    fn grown(mesh: &PolyMesh, step: &str) -> Option<(usize, u64)> {
        let files = crate::polymesh::NoFiles;
        let script = super::super::Script::parse(step).unwrap();
        let [Item::Step(statement)] = &script.items[..] else {
            panic!("{step}")
        };
        let mut interpreter = Interpreter::new(&files);
        let model = crate::polymesh::Model {
            mesh: Some(std::sync::Arc::new(mesh.clone())),
            ..Default::default()
        };
        interpreter.history().push("seed", model);
        script.run(&mut interpreter, None).ok()?;
        Some((interpreter.mesh()?.corner_count(), factor(statement)?))
    }

    #[test]
    fn schemes_grow_as_the_table_has_it() {
        let names = scheme_names();
        let duals = names.iter().map(|name| format!("dual_{name}"));
        for name in names.iter().map(|n| (*n).to_owned()).chain(duals) {
            let scheme = Remesh::named(&name).unwrap();
            let mut is_tight = false;
            for mesh in seeds() {
                let Some((made, least)) = grown(&mesh, &format!("remesh {name}")) else {
                    continue;
                };
                let old = mesh.corner_count();
                assert!(made >= least as usize * old, "{name}: {made} of {old}");
                is_tight |= made == scheme.growth() as usize * old;
                if scheme.least_growth() > 1 {
                    assert_eq!(made, scheme.growth() as usize * old, "{name}");
                }
            }
            assert!(is_tight || scheme.least_growth() == 1, "{name}");
        }
    }

    #[test]
    fn extrusions_and_subdivisions_have_the_corners_that_are_counted() {
        let mut compared = 0;
        for mesh in seeds() {
            let old = mesh.corner_count() as u64;
            for name in extrusion_names() {
                if let Some((made, factor)) = grown(&mesh, &format!("extrude {name} all")) {
                    assert_eq!(made as u64, factor * old, "{name}");
                    compared += 1;
                }
            }
            for (step, factor) in [("subdivide all", 4), ("subdivide all into=triangles", 3)] {
                assert_eq!(grown(&mesh, step), Some(((factor * old) as usize, factor)));
            }
            // Two faces of the mesh, in three iterations.
            let chosen: Vec<bool> = (0..mesh.face_count()).map(|f| f < 2).collect();
            let extrusion = Extrusion {
                iterations: 3,
                ..Extrusion::regular(crate::polymesh::Kind::Cubical)
            };
            let made = extrusion.of(&mesh, &chosen).unwrap().mesh;
            let expected = extrusion.corners(&mesh, &chosen, 3);
            assert_eq!(made.corner_count() as u64, expected);
        }
        assert!(compared > 60, "{compared}");
    }

    #[test]
    fn loops_are_refused_before_their_mesh_is_large() {
        for (text, words) in [
            ("cube\nrepeat 20 { remesh catmull_clark }", "in round"),
            (
                "cube\nrepeat 5 { repeat 5 { remesh doo_sabin } }",
                "or more",
            ),
            ("cube\nrepeat 20 { extrude cubical all }", "or more"),
            ("cube\nrepeat 30 { subdivide all; scale 0.5 }", "or more"),
        ] {
            let files = crate::polymesh::NoFiles;
            let mut interpreter = Interpreter::new(&files);
            let script = super::super::Script::parse(text).unwrap();
            let error = script.run(&mut interpreter, None).unwrap_err();
            assert_eq!(error.line, 2, "{error}");
            assert!(error.message.contains(words), "{error}");
            // The mesh before it is the largest that was made.
            let corners = interpreter.mesh().unwrap().corner_count();
            assert!(corners < 1 << 21, "{text}: {corners}");
        }
    }
}
