//! The steps of a script, applied to the model.
//!
//! Each step is a function of its arguments, and of the interpreter where it needs its model or files. It returns the
//! new model with notes; only `run_step` changes the interpreter. A new step is a function here, an arm of `run_step`
//! and a line of the table of verbs.

use super::argument::{Arguments, Statement, Word};
use super::{GroupBy, Interpreter, LoadOptions, ScriptError, nearest, regroup};
use crate::polymesh::form::{Form, SYSTEMS};
use crate::polymesh::history::Model;
use crate::polymesh::{
    Dihedral, Extrusion, Grouping, Parts, PolyMesh, Remesh, extrusion_named, extrusion_names,
    scheme_names, seed,
};
use druse_geometry::frame::Vec3;
use std::path::Path;
use std::sync::Arc;

/// The new model, or an error at the step.
pub(super) type StepResult = Result<Outcome, ScriptError>;

/// The result of a step.
pub(super) struct Outcome {
    pub model: Model,
    pub notes: Vec<String>,
}

impl Outcome {
    /// A new mesh, made by this step as a whole.
    pub fn mesh(mesh: PolyMesh) -> Self {
        Self {
            model: Model {
                mesh: Some(Arc::new(mesh)),
                ..Model::default()
            },
            notes: Vec::new(),
        }
    }

    /// A mesh with the same faces, changed in groups, start vertices or positions.
    pub fn changed(old: &Model, mesh: PolyMesh) -> Self {
        Self {
            model: Model {
                mesh: Some(Arc::new(mesh)),
                form: None,
                ..old.clone()
            },
            notes: Vec::new(),
        }
    }
}

/// Runs a step; on an error the model stays unchanged.
pub(super) fn run_step(
    statement: &Statement,
    interpreter: &mut Interpreter,
) -> Result<(), ScriptError> {
    let mut arguments = Arguments::new(statement, interpreter);
    let outcome = match statement.verb.as_str() {
        "polygon" | "prism" | "antiprism" | "pyramid" => ngon(&mut arguments),
        "grid" => grid(&mut arguments),
        "torus" => torus(&mut arguments),
        "form" => form(&mut arguments),
        "push" => push(&mut arguments, interpreter),
        "load" => load(&mut arguments, interpreter),
        "extrude" => extrude(&mut arguments, interpreter),
        "remesh" => remesh(&mut arguments, interpreter),
        "subdivide" => subdivide(&mut arguments, interpreter),
        "assign" => regroup::assign(&mut arguments, interpreter),
        "merge" => regroup::merge(&mut arguments, interpreter),
        "renumber" => regroup::renumber(&arguments, interpreter),
        "startvertex" => regroup::start_vertex(&mut arguments, interpreter),
        "symmetrize" => regroup::symmetrize(&mut arguments, interpreter),
        "move" | "turn" | "scale" => place(&mut arguments, interpreter),
        "save" => save(&mut arguments, interpreter),
        name => solid(&mut arguments, name),
    }?;
    // Words that no step has taken are errors.
    arguments.finish()?;
    for text in outcome.notes {
        interpreter.note(statement.line, text);
    }
    interpreter
        .history
        .push(statement.text.clone(), outcome.model);
    Ok(())
}

/// The current mesh; an error if there is none.
pub(super) fn mesh_of<'w>(
    a: &Arguments,
    interpreter: &'w Interpreter,
) -> Result<&'w PolyMesh, ScriptError> {
    let message = "there is no mesh yet; begin with a solid such as cube";
    interpreter.mesh().ok_or_else(|| a.fault(message))
}

/// A solid by its canonical name.
fn solid(a: &mut Arguments, name: &str) -> StepResult {
    let edge = a.number("edge")?.unwrap_or(1.0);
    if !(edge.is_finite() && edge > 0.0) {
        return Err(a.fault(format!("edge = {edge}; expected a length more than 0")));
    }
    let made = seed::solid(name, edge);
    made.map(Outcome::mesh)
        .ok_or_else(|| a.fault("the edge is too long for finite coordinates"))
}

/// The steps `polygon`, `prism`, `antiprism` and `pyramid` over a regular polygon.
fn ngon(a: &mut Arguments) -> StepResult {
    let kind = a.statement.verb.as_str();
    let n = a.count("n")?.unwrap_or(match kind {
        "polygon" => 5,
        "pyramid" => 4,
        _ => 6,
    });
    let edge = a.number("edge")?.unwrap_or(1.0);
    let height = match kind {
        "polygon" => None,
        _ => a.number("height")?,
    };
    let made = match kind {
        "polygon" => seed::polygon(n, edge),
        "prism" => seed::prism(n, edge, height.unwrap_or(edge)),
        "antiprism" => seed::antiprism(n, edge, height),
        _ => seed::pyramid(n, edge, height),
    };
    made.map(Outcome::mesh).map_err(|e| a.fault(e.to_string()))
}

/// A list of N counts below 1e9 in the key `counts`; `default` if it is missing.
fn counts<const N: usize>(
    a: &mut Arguments,
    default: [usize; N],
) -> Result<[usize; N], ScriptError> {
    let Some(list) = a.list("counts")? else {
        return Ok(default);
    };
    let whole = |x: &f64| (x.fract() == 0.0 && (0.0..1e9).contains(x)).then_some(*x as usize);
    let list: Option<Vec<usize>> = list.iter().map(whole).collect();
    list.and_then(|l| <[usize; N]>::try_from(l).ok())
        .ok_or_else(|| a.fault(format!("counts: expected {N} whole numbers")))
}

fn grid(a: &mut Arguments) -> StepResult {
    let counts = counts(a, [2; 3])?;
    let edge = a.number("edge")?.unwrap_or(1.0);
    seed::grid(counts, edge)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

fn torus(a: &mut Arguments) -> StepResult {
    let counts = counts(a, [16, 8])?;
    let major = a.number("major")?.unwrap_or(2.0);
    let minor = a.number("minor")?.unwrap_or(0.5);
    seed::torus(major, minor, counts)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

/// Hint for trigonal groups, which have no lattice system of this name.
pub(super) const TRIGONAL_HINT: &str = "trigonal crystals refer to the axes of the lattice system rhombohedral, or to \
     those of hexagonal, with one of the groups 3, -3, 32, 3m, -3m";

/// The step `form`: a crystal from planes with distances, in a lattice system with its axes.
fn form(a: &mut Arguments) -> StepResult {
    let systems = SYSTEMS.map(|row| row.0);
    let word = a.required(&format!("a lattice system: {}", systems.join(", ")))?;
    let system = word.text.as_str();
    let mut axes = Vec::new();
    for name in ["a", "b", "c", "alpha", "beta", "gamma"] {
        if let Some(value) = a.number(name)? {
            axes.push((name.to_owned(), value));
        }
    }
    let group = a.value("group")?.map(|w| w.text);
    let fault = |a: &Arguments, e: crate::polymesh::form::FormError| {
        let mut error = a.fault(e.to_string());
        // "trigonal" is a family with two sets of axes, and no lattice system: a hint names both.
        error.hint = if [Some(system), group.as_deref()].contains(&Some("trigonal")) {
            Some(TRIGONAL_HINT.to_owned())
        } else {
            nearest(system, &systems)
                .filter(|w| *w != system)
                .map(|w| format!("did you mean {w:?}?"))
        };
        error
    };
    let mut form = Form::new(system, &axes, group.as_deref()).map_err(|e| fault(a, e))?;
    for (hkl, distance) in a.planes()? {
        form.add(hkl, distance).map_err(|e| fault(a, e))?;
    }
    if form.planes.is_empty() {
        return Err(a.fault("expected planes with their distances, as in [1,1,1]=1 [1,0,0]=0.9"));
    }
    crystal(form).map_err(|e| fault(a, e))
}

/// The crystal of a form, with a note on each form without a face, unless another has its planes no farther out.
fn crystal(form: Form) -> Result<Outcome, crate::polymesh::form::FormError> {
    let mut outcome = Outcome::mesh(form.mesh()?);
    let groups = outcome.model.mesh.as_ref().map(|m| m.group_counts());
    for (n, (hkl, _)) in form.planes.iter().enumerate() {
        let there = groups
            .as_ref()
            .is_some_and(|g| g.contains_key(&(n as u32 + 1)));
        if !there && !form.repeats(n) {
            let [h, k, l] = hkl;
            let text = format!("the form {{{h} {k} {l}}} lies outside the crystal: it has no face");
            outcome.notes.push(text);
        }
    }
    outcome.model.form = Some(form);
    Ok(outcome)
}

/// The step `push`: moves one form of the crystal that the model still is, and makes its mesh again.
fn push(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let plane = a.required("a plane [h,k,l]")?;
    let hkl = a.indices(plane)?;
    let by = a.required("a distance")?;
    let by = a.evaluate(by)?;
    let Some(mut form) = interpreter.model().form.clone() else {
        return Err(a.fault("the model is no crystal form any more; push directly after form"));
    };
    form.push(hkl, by).map_err(|e| a.fault(e.to_string()))?;
    crystal(form).map_err(|e| a.fault(e.to_string()))
}

/// A file's name: a word, in quotation marks if it has blanks.
fn file(word: &Word) -> &Path {
    Path::new(word.text.trim_matches('"'))
}

/// The step `load`: a mesh from a file.
fn load(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let word = a.required("a file")?;
    let group_by = match a.value("group_by")? {
        None => GroupBy::Material,
        Some(word) => match word.text.as_str() {
            "material" => GroupBy::Material,
            "color" => GroupBy::Color,
            "object" => GroupBy::Object,
            other => {
                let text = format!("group_by = {other:?}; expected material, color or object");
                return Err(a.fault(text));
            }
        },
    };
    let weld = a.number("weld")?.unwrap_or(0.0);
    if weld < 0.0 {
        return Err(a.fault(format!("weld = {weld}; expected a distance from 0")));
    }
    let color_tolerance = a.number("color_tol")?.unwrap_or(0.0);
    if !(0.0..=1.0).contains(&color_tolerance) {
        return Err(a.fault(format!("color_tol = {color_tolerance}; expected 0 to 1")));
    }
    let options = LoadOptions {
        group_by,
        color_tolerance,
        weld,
        flip: a.flag("flip")?,
        allow_open: a.flag("allow_open")?,
    };
    // An unknown word is reported before any fault of the file.
    a.finish()?;
    let loaded = interpreter.files.load(file(word), &options);
    let loaded = loaded.map_err(|e| a.fault(e))?;
    let mut outcome = Outcome::mesh(loaded.mesh);
    outcome.notes = loaded.warnings;
    Ok(outcome)
}

/// The step `save`: writes the current mesh; the model stays.
fn save(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let word = a.required("a file")?;
    let mesh = mesh_of(a, interpreter)?;
    interpreter
        .files
        .save(file(word), mesh)
        .map_err(|e| a.fault(e))?;
    Ok(Outcome {
        model: interpreter.model().clone(),
        notes: Vec::new(),
    })
}

/// The step `extrude`: caps on the chosen faces.
fn extrude(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let word = a.required("an extrusion such as cubical")?;
    let Some((kind, operator)) = extrusion_named(&word.text) else {
        let names = extrusion_names();
        let known: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut error = a.fault(format!("no extrusion is named {:?}", word.text));
        error.hint = nearest(&word.text, &known)
            .map(|w| format!("did you mean {w:?}?"))
            .or_else(|| Some(format!("expected one of {}", known.join(", "))));
        return Err(error);
    };
    let mesh = mesh_of(a, interpreter)?;
    let chosen = a.faces()?;
    let tilt = a.number("tilt")?;
    // A tilt of 0 is upright: a dihedral angle of 90 degrees.
    let dihedral = match (a.value("dihedral")?, tilt) {
        (Some(_), Some(_)) => return Err(a.fault("dihedral and tilt; expected one of them")),
        (None, None) => Dihedral::Regular,
        (None, Some(tilt)) => Dihedral::Degrees(90.0 + tilt),
        (Some(word), None) if word.text == "auto" => Dihedral::Auto,
        (Some(word), None) => Dihedral::Degrees(a.evaluate(&word)?),
    };
    let phase = a.count("phase")?.unwrap_or(0);
    if phase > 1 {
        return Err(a.fault(format!("phase = {phase}; expected 0 or 1")));
    }
    let tiers = a.list("tiers")?;
    let extrusion = Extrusion {
        kind,
        operator,
        dihedral,
        iterations: a.count("iterations")?.unwrap_or(1),
        level: a.flag("level")?,
        odd: phase == 1,
        tiers: tiers.clone().unwrap_or_default(),
    };
    // An empty list would read as no list at all.
    if let Some(list) = tiers.filter(Vec::is_empty) {
        let text = format!(
            "{} tiers; {} takes exactly {}",
            list.len(),
            extrusion.name(),
            kind.tiers()
        );
        return Err(a.fault(text));
    }
    let extruded = extrusion
        .of(mesh, &chosen)
        .map_err(|e| a.fault(e.to_string()))?;
    Ok(Outcome {
        model: Model {
            mesh: Some(Arc::new(extruded.mesh)),
            last: extruded.first,
            tops: extruded.tops,
            form: None,
        },
        notes: extruded.notes,
    })
}

/// The step `remesh`: one rule on the whole mesh.
fn remesh(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let word = a.required("a scheme such as checkerboard")?;
    let mut scheme = Remesh::named(&word.text).map_err(|e| {
        let names = scheme_names();
        let mut error = a.fault(e.to_string());
        error.hint = nearest(&word.text, &names)
            .map(|w| format!("did you mean {w:?}?"))
            .or_else(|| {
                Some(format!(
                    "expected one of {}, or dual_ and one",
                    names.join(", ")
                ))
            });
        error
    })?;
    // Only parameters of this scheme are taken; others remain and are errors.
    for parameter in scheme.parameters() {
        if let Some(value) = a.number(parameter.name)? {
            scheme
                .set(parameter.name, value)
                .map_err(|e| a.fault(e.to_string()))?;
        }
    }
    scheme.grouping = match a.value("groups")? {
        None => Grouping::Class,
        Some(word) => match word.text.as_str() {
            "class" => Grouping::Class,
            "keep" => Grouping::Keep,
            "parent" => Grouping::Parent,
            "distinct" => Grouping::Distinct,
            text if text.starts_with('[') => {
                let list = a.list_of(&word)?;
                let numbers = list.iter().map(|&x| a.whole(&word, x).map(|n| n as u32));
                Grouping::Numbers(numbers.collect::<Result<_, _>>()?)
            }
            other => {
                let text = format!(
                    "groups = {other:?}; expected class, keep, parent, distinct or numbers"
                );
                return Err(a.fault(text));
            }
        },
    };
    let mesh = mesh_of(a, interpreter)?;
    scheme
        .of(mesh)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

/// The step `subdivide`: the chosen faces become quads or triangles.
fn subdivide(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let chosen = a.faces()?;
    let into = match a.value("into")?.as_ref().map(|w| w.text.as_str()) {
        None | Some("quads") => Parts::Quads,
        Some("triangles") => Parts::Triangles,
        Some(other) => {
            return Err(a.fault(format!("into = {other:?}; expected quads or triangles")));
        }
    };
    let (mesh, last) = mesh_of(a, interpreter)?
        .subdivided(&chosen, into)
        .map_err(|e| a.fault(e.to_string()))?;
    let mut outcome = Outcome::mesh(mesh);
    outcome.model.last = last;
    Ok(outcome)
}

/// The steps `move`, `turn` (about an axis through the origin, degrees) and `scale` (about the origin). Factors are
/// positive, since a mirror image would turn faces inside out.
fn place(a: &mut Arguments, interpreter: &Interpreter) -> StepResult {
    let mesh = mesh_of(a, interpreter)?;
    let moved = match a.statement.verb.as_str() {
        "move" => {
            let by = a.required("a shift [x, y, z]")?;
            let by = a.vector_of(by)?;
            mesh.mapped(|v| v + by)
        }
        "turn" => {
            let axis = a.required("an axis [x, y, z]")?;
            let axis = a.vector_of(axis)?;
            let angle = a.required("an angle in degrees")?;
            let angle = a.evaluate(angle)?;
            let axis = nalgebra::Unit::try_new(axis, f64::MIN_POSITIVE)
                .ok_or_else(|| a.fault("the axis [0, 0, 0]; expected a direction"))?;
            let turn = nalgebra::Rotation3::from_axis_angle(&axis, angle.to_radians());
            mesh.mapped(|v: Vec3| turn * v)
        }
        _ => {
            let word = a.required("a factor")?;
            let factor = a.evaluate(word)?;
            if factor <= 0.0 {
                return Err(a.fault(format!("{factor}; expected a factor more than 0")));
            }
            mesh.mapped(|v| v * factor)
        }
    };
    let moved = moved.map_err(|e| a.fault(e.to_string()))?;
    Ok(Outcome::changed(interpreter.model(), moved))
}
