//! The steps of a script, carried out on the model.

use super::argument::{Arguments, Statement, Word};
use super::{GroupBy, LoadOptions, ScriptError, Workshop, nearest};
use crate::frame::Vec3;
use crate::polymesh::form::{Form, SYSTEMS};
use crate::polymesh::history::Model;
use crate::polymesh::{
    Dihedral, Extrusion, Grouping, PolyMesh, Remesh, extrusion_named, extrusion_names,
    scheme_names, seed,
};
use std::path::Path;
use std::sync::Arc;

type Done = Result<Outcome, ScriptError>;

/// What a step leaves behind.
struct Outcome {
    model: Model,
    notes: Vec<String>,
}

impl Outcome {
    /// A new mesh, all of it made by this step.
    fn mesh(mesh: PolyMesh) -> Self {
        Self {
            model: Model {
                mesh: Some(Arc::new(mesh)),
                ..Model::default()
            },
            notes: Vec::new(),
        }
    }

    /// The same faces with something changed about them.
    fn changed(old: &Model, mesh: PolyMesh) -> Self {
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

/// Carries a step out; on an error the model stays.
pub(super) fn carry_out(statement: &Statement, workshop: &mut Workshop) -> Result<(), ScriptError> {
    let mut arguments = Arguments::new(statement, workshop);
    let outcome = match statement.verb.as_str() {
        "polygon" | "prism" | "antiprism" | "pyramid" => ngon(&mut arguments),
        "grid" => grid(&mut arguments),
        "torus" => torus(&mut arguments),
        "form" => form(&mut arguments),
        "push" => push(&mut arguments, workshop),
        "load" => load(&mut arguments, workshop),
        "extrude" => extrude(&mut arguments, workshop),
        "remesh" => remesh(&mut arguments, workshop),
        "assign" => assign(&mut arguments, workshop),
        "merge" => merge(&mut arguments, workshop),
        "renumber" => renumber(&arguments, workshop),
        "startvertex" => start_vertex(&mut arguments, workshop),
        "symmetrize" => symmetrize(&mut arguments, workshop),
        "move" | "turn" | "scale" => place(&mut arguments, workshop),
        "save" => save(&mut arguments, workshop),
        name => solid(&mut arguments, name),
    }?;
    arguments.finish()?;
    for text in outcome.notes {
        workshop.note(statement.line, text);
    }
    workshop.history.push(statement.text.clone(), outcome.model);
    Ok(())
}

/// The mesh, which must be there.
fn mesh_of<'w>(a: &Arguments, workshop: &'w Workshop) -> Result<&'w PolyMesh, ScriptError> {
    let message = "there is no mesh yet; begin with a solid such as cube";
    workshop.mesh().ok_or_else(|| a.fault(message))
}

fn solid(a: &mut Arguments, name: &str) -> Done {
    let edge = a.number("edge")?.unwrap_or(1.0);
    if !(edge.is_finite() && edge > 0.0) {
        return Err(a.fault(format!("edge = {edge}; expected a length more than 0")));
    }
    let made = seed::solid(name, edge);
    made.map(Outcome::mesh)
        .ok_or_else(|| a.fault("the edge is too long for numbers"))
}

fn ngon(a: &mut Arguments) -> Done {
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

/// A list of counts.
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

fn grid(a: &mut Arguments) -> Done {
    let counts = counts(a, [2; 3])?;
    let edge = a.number("edge")?.unwrap_or(1.0);
    seed::grid(counts, edge)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

fn torus(a: &mut Arguments) -> Done {
    let counts = counts(a, [16, 8])?;
    let major = a.number("major")?.unwrap_or(2.0);
    let minor = a.number("minor")?.unwrap_or(0.5);
    seed::torus(major, minor, counts)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

fn form(a: &mut Arguments) -> Done {
    let systems = SYSTEMS.map(|row| row.0);
    let word = a.needed(&format!("a lattice system: {}", systems.join(", ")))?;
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
        error.hint = nearest(system, &systems)
            .filter(|w| *w != system)
            .map(|w| format!("did you mean {w:?}?"));
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

fn crystal(form: Form) -> Result<Outcome, crate::polymesh::form::FormError> {
    let mut outcome = Outcome::mesh(form.mesh()?);
    let groups = outcome.model.mesh.as_ref().map(|m| m.group_counts());
    for (n, (hkl, _)) in form.planes.iter().enumerate() {
        let there = groups
            .as_ref()
            .is_some_and(|g| g.contains_key(&(n as u32 + 1)));
        if !there {
            let [h, k, l] = hkl;
            let text = format!("the form {{{h} {k} {l}}} lies outside the crystal: it has no face");
            outcome.notes.push(text);
        }
    }
    outcome.model.form = Some(form);
    Ok(outcome)
}

fn push(a: &mut Arguments, workshop: &Workshop) -> Done {
    let plane = a.needed("a plane [h,k,l]")?;
    let hkl = a.indices(plane)?;
    let by = a.needed("a distance")?;
    let by = a.evaluate(by)?;
    let Some(mut form) = workshop.model().form.clone() else {
        return Err(a.fault("the model is no crystal form any more; push right after form"));
    };
    form.push(hkl, by).map_err(|e| a.fault(e.to_string()))?;
    crystal(form).map_err(|e| a.fault(e.to_string()))
}

/// A file's name: a word, in quotation marks if it has blanks.
fn file(word: &Word) -> &Path {
    Path::new(word.text.trim_matches('"'))
}

fn load(a: &mut Arguments, workshop: &Workshop) -> Done {
    let word = a.needed("a file")?;
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
    let options = LoadOptions {
        group_by,
        weld,
        flip: a.flag("flip")?,
    };
    let loaded = workshop.files.load(file(word), &options);
    let loaded = loaded.map_err(|e| a.fault(e))?;
    let mut outcome = Outcome::mesh(loaded.mesh);
    outcome.notes = loaded.warnings;
    Ok(outcome)
}

fn save(a: &mut Arguments, workshop: &Workshop) -> Done {
    let word = a.needed("a file")?;
    let mesh = mesh_of(a, workshop)?;
    workshop
        .files
        .save(file(word), mesh)
        .map_err(|e| a.fault(e))?;
    Ok(Outcome {
        model: workshop.model().clone(),
        notes: Vec::new(),
    })
}

fn extrude(a: &mut Arguments, workshop: &Workshop) -> Done {
    let word = a.needed("an extrusion such as cubical")?;
    let Some((kind, operator)) = extrusion_named(&word.text) else {
        let names = extrusion_names();
        let known: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut error = a.fault(format!("no extrusion is named {:?}", word.text));
        error.hint = nearest(&word.text, &known)
            .map(|w| format!("did you mean {w:?}?"))
            .or_else(|| Some(format!("expected one of {}", known.join(", "))));
        return Err(error);
    };
    let mesh = mesh_of(a, workshop)?;
    let chosen = a.faces()?;
    let tilt = a.number("tilt")?;
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

fn remesh(a: &mut Arguments, workshop: &Workshop) -> Done {
    let word = a.needed("a scheme such as checkerboard")?;
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
    let mesh = mesh_of(a, workshop)?;
    scheme
        .of(mesh)
        .map(Outcome::mesh)
        .map_err(|e| a.fault(e.to_string()))
}

fn group_number(a: &Arguments, word: &Word) -> Result<u32, ScriptError> {
    let value = a.evaluate(word)?;
    match a.whole(word, value)? {
        0 => Err(a.fault("group 0; groups count from 1")),
        n => Ok(n as u32),
    }
}

fn assign(a: &mut Arguments, workshop: &Workshop) -> Done {
    let mesh = mesh_of(a, workshop)?;
    let chosen = a.faces()?;
    let word = a.needed("a group number, or new")?;
    let id = match word.text.as_str() {
        "new" => mesh.greatest_group().saturating_add(1),
        _ => group_number(a, word)?,
    };
    let groups = mesh.groups().iter().zip(&chosen);
    let groups = groups.map(|(&g, &c)| if c { id } else { g }).collect();
    Ok(Outcome::changed(
        workshop.model(),
        mesh.clone().with_groups(groups),
    ))
}

fn merge(a: &mut Arguments, workshop: &Workshop) -> Done {
    let mesh = mesh_of(a, workshop)?;
    let mut ids = Vec::new();
    while let Some(word) = a.bare() {
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
        workshop.model(),
        mesh.clone().with_groups(groups),
    ))
}

fn renumber(a: &Arguments, workshop: &Workshop) -> Done {
    let mesh = mesh_of(a, workshop)?;
    let counts = mesh.group_counts();
    let order: Vec<u32> = counts.into_keys().collect();
    let place = |g: &u32| order.binary_search(g).map_or(1, |n| n as u32 + 1);
    let groups = mesh.groups().iter().map(place).collect();
    Ok(Outcome::changed(
        workshop.model(),
        mesh.clone().with_groups(groups),
    ))
}

fn start_vertex(a: &mut Arguments, workshop: &Workshop) -> Done {
    let mesh = mesh_of(a, workshop)?;
    let chosen = a.faces()?;
    let toward = match a.value("toward")? {
        Some(word) => Some(a.vector_of(&word)?),
        None => None,
    };
    let at = a.count("at")?;
    let lowest = match a.bare() {
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
        let point = |k: usize| mesh.vertices()[face[k] as usize];
        let places = 0..face.len();
        let found = if let Some(target) = toward {
            let far = |k: &usize| (point(*k) - target).norm_squared();
            places.min_by(|a, b| far(a).total_cmp(&far(b)))
        } else if let Some(vertex) = at {
            face.iter().position(|&v| v as usize == vertex)
        } else {
            places.min_by_key(|&k| face[k])
        };
        shift[f] = found
            .ok_or_else(|| a.fault(format!("face {f} has no vertex {}", at.unwrap_or_default())))?;
    }
    Ok(Outcome::changed(workshop.model(), mesh.with_starts(&shift)))
}

fn symmetrize(a: &mut Arguments, workshop: &Workshop) -> Done {
    let rotations = a.flag("rotations")?;
    let mesh = mesh_of(a, workshop)?;
    let pieces = mesh.pieces().1;
    if pieces != 1 {
        return Err(a.fault(format!("the mesh has {pieces} pieces; expected one")));
    }
    let (made, order) = mesh.symmetrized(rotations);
    let orbits = made.greatest_group();
    let mut outcome = Outcome::changed(workshop.model(), made);
    let what = if rotations { "rotations" } else { "symmetries" };
    outcome.notes = vec![format!("{order} {what}, {orbits} orbits of faces")];
    Ok(outcome)
}

fn place(a: &mut Arguments, workshop: &Workshop) -> Done {
    let mesh = mesh_of(a, workshop)?;
    let moved = match a.statement.verb.as_str() {
        "move" => {
            let by = a.needed("a shift [x, y, z]")?;
            let by = a.vector_of(by)?;
            mesh.mapped(|v| v + by)
        }
        "turn" => {
            let axis = a.needed("an axis [x, y, z]")?;
            let axis = a.vector_of(axis)?;
            let angle = a.needed("an angle in degrees")?;
            let angle = a.evaluate(angle)?;
            let axis = nalgebra::Unit::try_new(axis, f64::MIN_POSITIVE)
                .ok_or_else(|| a.fault("the axis [0, 0, 0]; expected a direction"))?;
            let turn = nalgebra::Rotation3::from_axis_angle(&axis, angle.to_radians());
            mesh.mapped(|v: Vec3| turn * v)
        }
        _ => {
            let word = a.needed("a factor")?;
            let factor = a.evaluate(word)?;
            if factor <= 0.0 {
                return Err(a.fault(format!("{factor}; expected a factor more than 0")));
            }
            mesh.mapped(|v| v * factor)
        }
    };
    let moved = moved.map_err(|e| a.fault(e.to_string()))?;
    Ok(Outcome::changed(workshop.model(), moved))
}
