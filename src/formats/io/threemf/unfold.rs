//! Assembly of one mesh and its beams from the models of an archive.
//!
//! Build items refer to objects, objects to components, each with a placement and perhaps in another part. Lengths of
//! the result are in the unit of the root model. What is omitted becomes a note; limits guard against files that
//! unfold to much more than their size.

use super::archive::Archive;
use super::lattice::ClipMode;
use super::model::{Model, Object, Reference};
use super::{IDENTITY_PLACEMENT, Placement, compose, display_name, transform_point};
use crate::io::beam_parts::{BeamClip, BeamPart, SolidFile};
use crate::io::error::{Place, ReadError};
use crate::io::mesh_format::MeshFile;
use druse_geometry::frame::{LengthUnit, Vec3};
use druse_geometry::mesh::TriMesh;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::rc::Rc;

/// Greatest nesting depth of components.
const MAX_DEPTH: usize = 16;
/// Greatest number of unfolded vertices, triangles and beams: a fixed number and so many copies of the file's content.
const MAX_UNFOLDED_ITEMS: usize = 2_000_000;
const MAX_COPIES: usize = 64;
/// Greatest number of followed references.
const MAX_VISITS: usize = 1_000_000;

/// The state of the assembly.
struct Build {
    archive: Archive,
    /// The models read so far, by the name of their part.
    models: HashMap<String, Rc<Model>>,
    unit: LengthUnit,
    /// The number of vertices, triangles and beams in the models read so far.
    file_size: usize,
    visits: usize, // references followed so far
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    beams: Vec<BeamPart>,
    /// The objects left out, by reason.
    left_out: BTreeMap<String, Vec<u32>>,
    /// Remarks, sorted and without repetition.
    notes: BTreeSet<String>,
    short_beams: usize, // left out
    /// The chain of objects being placed, outermost first.
    path: Vec<(String, u32)>,
}

/// Assembles the build items as one mesh and its beams, in the unit of the root model.
pub(super) fn unfold(mut archive: Archive) -> Result<SolidFile, ReadError> {
    let root = archive.root();
    let mut model = archive.model(&root)?;
    let notes = remove_non_solid_volumes(&mut archive, &mut model)?;
    let model = Rc::new(model);
    let mut build = Build {
        file_size: model.len(),
        unit: model.unit,
        models: HashMap::from([(root.clone(), Rc::clone(&model))]),
        archive,
        visits: 0,
        vertices: Vec::new(),
        triangles: Vec::new(),
        beams: Vec::new(),
        left_out: BTreeMap::new(),
        notes,
        short_beams: 0,
        path: Vec::new(),
    };
    // A model without build items is not valid; all of its objects are taken.
    if model.items.is_empty() {
        build.every_object(&root, &model)?;
    }
    for item in &model.items {
        if item.is_printable {
            build.reference(&root, &model, item, &IDENTITY_PLACEMENT)?;
        } else {
            let reason = "item that is not printable".to_owned();
            build.left_out.entry(reason).or_default().push(item.object);
        }
    }
    build.finish()
}

/// Removes triangles that the slicer's list marks as non-solid; returns notes. A negative volume is an error, since to
/// leave it out would change the solid.
fn remove_non_solid_volumes(
    archive: &mut Archive,
    model: &mut Model,
) -> Result<BTreeSet<String>, ReadError> {
    let mut notes = BTreeSet::new();
    for (id, volumes) in archive.non_solid_volumes() {
        let Some(object) = model.objects.get_mut(&id) else {
            continue;
        };
        let mut is_part = vec![true; object.triangles.len()];
        for volume in volumes {
            let [first, last] = volume.triangles;
            let kind = display_name(&volume.kind);
            if first > last || last >= is_part.len() {
                let found =
                    format!("triangles {first} to {last} of object {id} in the slicer's list");
                let expected = format!("triangles from 0 to {}", is_part.len() as i64 - 1);
                return Err(ReadError::data(&archive.path, Place::File, found, expected));
            }
            if volume.kind == "NegativeVolume" {
                let found =
                    format!("a negative volume in object {id} (triangles {first} to {last})");
                let error = ReadError::data(&archive.path, Place::File, found, "solid parts");
                return Err(error.with_hint(
                    "apply it in the slicer, or export both parts and subtract one in a recipe",
                ));
            }
            // Modifiers and supports are settings within a region, not solid.
            is_part[first..=last].fill(false);
            let count = last - first + 1;
            notes.insert(format!(
                "{count} triangles of object {id} are a {kind} of the slicer and left out"
            ));
        }
        let mut kept = is_part.iter();
        object.has_removed_triangles = is_part.contains(&false);
        object.triangles.retain(|_| kept.next() == Some(&true));
    }
    Ok(notes)
}

/// A list of objects for messages: "object 3", "objects 3, 4"; after eight, "and 17 more".
fn object_list(numbers: &[u32]) -> String {
    let shown: Vec<String> = numbers.iter().take(8).map(u32::to_string).collect();
    let more = match numbers.len() - shown.len() {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    let plural = if numbers.len() == 1 { "" } else { "s" };
    format!("object{plural} {}{more}", shown.join(", "))
}

impl Build {
    fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.archive.path, Place::File, found, expected)
    }

    /// Places every object that is not part of another one, for a model without items; all of them if each is part of
    /// another one, which then ends in the error for cycles.
    fn every_object(&mut self, root: &str, model: &Rc<Model>) -> Result<(), ReadError> {
        let note = "no item to build; every object is taken";
        self.notes.insert(note.to_owned());
        let mut used = BTreeSet::new();
        for object in model.objects.values() {
            let own = object.components.iter().filter(|c| c.part.is_none());
            used.extend(own.map(|c| c.object));
            let lattice = object.lattice.iter();
            used.extend(lattice.flat_map(|l| l.clip_mesh.into_iter().chain(l.representation_mesh)));
        }
        let is_cyclic = model.objects.keys().all(|id| used.contains(id));
        for &id in model.objects.keys() {
            if is_cyclic || !used.contains(&id) {
                self.place(root, model, id, &IDENTITY_PLACEMENT)?;
            }
        }
        Ok(())
    }

    /// Places a referenced object. `name` is the part of the archive that holds the reference, `model` its content,
    /// `outer` the placement of what holds it.
    fn reference(
        &mut self,
        name: &str,
        model: &Rc<Model>,
        reference: &Reference,
        outer: &Placement,
    ) -> Result<(), ReadError> {
        let at = compose(&reference.at, outer);
        let Some(part) = &reference.part else {
            return self.place(name, model, reference.object, &at);
        };
        let part = self.archive.resolve_reference(part)?;
        // A part of the archive is parsed once, however many references it has.
        let other = if let Some(known) = self.models.get(&part) {
            Rc::clone(known)
        } else {
            let read = Rc::new(self.archive.model(&part)?);
            self.file_size += read.len();
            self.models.insert(part.clone(), Rc::clone(&read));
            read
        };
        // A part that states a unit of its own is scaled to that of the model that refers to it.
        let mut scaled = at;
        if other.states_unit && other.unit != model.unit {
            let factor = other.unit.to(model.unit);
            for axis in &mut scaled[..3] {
                *axis *= factor;
            }
            let note = format!(
                "the part {} is in {} and was scaled to {}",
                display_name(&part),
                other.unit.name_3mf(),
                model.unit.name_3mf()
            );
            self.notes.insert(note);
        }
        self.place(&part, &other, reference.object, &scaled)
    }

    /// Places object `id` of the model in part `name`, with its components, under the placement `at`.
    fn place(
        &mut self,
        name: &str,
        model: &Rc<Model>,
        id: u32,
        at: &Placement,
    ) -> Result<(), ReadError> {
        let Some(object) = model.objects.get(&id) else {
            let found = format!("a reference to object {id}");
            return Err(self.bad(found, format!("an object of {}", display_name(name))));
        };
        // Supports and other types are not printed as parts of the model.
        if let Some(kind) = &object.kind {
            let reason = format!("object of type {}", display_name(kind));
            self.left_out.entry(reason).or_default().push(id);
            return Ok(());
        }
        let step = (name.to_owned(), id);
        if self.path.contains(&step) {
            let found = format!(
                "object {id} of {}, which is a component of itself",
                display_name(name)
            );
            return Err(self.bad(found, "components without a cycle"));
        }
        // A short file may refer to itself many times: copies are limited in proportion to its size, and in
        // depth.
        self.visits += 1;
        let total = self.vertices.len()
            + object.vertices.len()
            + self.triangles.len()
            + object.triangles.len()
            + self.beams.iter().map(BeamPart::len).sum::<usize>();
        let limit = self
            .file_size
            .saturating_mul(MAX_COPIES)
            .saturating_add(MAX_UNFOLDED_ITEMS);
        let limit = limit.min(u32::MAX as usize);
        if self.path.len() >= MAX_DEPTH || total > limit || self.visits > MAX_VISITS {
            let found = format!("components that unfold without end at object {id}");
            return Err(self.bad(found, "at most 16 levels and 64 copies of each triangle"));
        }
        // A shape of another extension only: without it the object would be empty.
        if object.is_empty() {
            let slices = object.has_slices.then(|| "slices".to_owned());
            if let Some(shape) = object.foreign.clone().or(slices) {
                let found = format!("object {id}, whose shape is made of {shape}");
                return Err(self.bad(found, "a mesh, a beam lattice or components"));
            }
        }
        if let Some(why) = &object.substitute_reason {
            let note = format!("the mesh of object {id} {why}");
            self.notes.insert(note);
        }
        self.mesh(id, object, at)?;
        self.lattice(name, model, id, object, at)?;
        self.path.push(step);
        for component in &object.components {
            self.reference(name, model, component, at)?;
        }
        self.path.pop();
        Ok(())
    }

    /// Adds the triangles of an object under a placement; `id` is for messages.
    fn mesh(&mut self, id: u32, object: &Object, at: &Placement) -> Result<(), ReadError> {
        self.check_triangles(id, object)?;
        let shift = self.vertices.len() as u32;
        // Vertices that only beams or removed triangles use are not part of the mesh.
        let mut numbers: Vec<u32> = (0..object.vertices.len() as u32).collect();
        if object.lattice.is_some() || object.has_removed_triangles {
            let mut is_used = vec![false; numbers.len()];
            for &v in object.triangles.iter().flatten() {
                is_used[v as usize] = true;
            }
            let mut next = 0;
            for (number, &used) in numbers.iter_mut().zip(&is_used) {
                *number = next;
                next += u32::from(used);
            }
            let kept = object.vertices.iter().zip(&is_used).filter(|v| *v.1);
            self.vertices.extend(kept.map(|v| transform_point(at, v.0)));
        } else {
            self.vertices
                .extend(object.vertices.iter().map(|v| transform_point(at, v)));
        }
        self.triangles
            .extend(oriented_triangles(object, at).map(|t| t.map(|v| numbers[v as usize] + shift)));
        Ok(())
    }

    /// Checks that the triangles of an object name vertices that it has.
    fn check_triangles(&self, id: u32, object: &Object) -> Result<(), ReadError> {
        let count = object.vertices.len();
        let is_wrong = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= count);
        let Some(n) = object.triangles.iter().position(is_wrong) else {
            return Ok(());
        };
        let t = object.triangles[n];
        let found = format!("triangle {} of object {id} with vertices {t:?}", n + 1);
        Err(self.bad(found, format!("vertices from 0 to {}", count as i64 - 1)))
    }

    /// Adds the beams and balls of an object under a placement, with the mesh that clips them; `name` is the part of
    /// `model`.
    fn lattice(
        &mut self,
        name: &str,
        model: &Model,
        id: u32,
        object: &Object,
        at: &Placement,
    ) -> Result<(), ReadError> {
        let Some(lattice) = &object.lattice else {
            return Ok(());
        };
        let placed_beams = lattice
            .placed(&object.vertices, at)
            .map_err(|(found, expected)| self.bad(format!("object {id}: {found}"), expected))?;
        self.short_beams += placed_beams.short;
        // A clipping mesh is an object of the same model, under the same placement.
        let clip = match lattice.clip {
            ClipMode::None => None,
            mode => {
                let clipping = lattice.clip_mesh.and_then(|n| model.objects.get(&n));
                let clipping = clipping
                    .filter(|c| !c.triangles.is_empty())
                    .ok_or_else(|| {
                        let found = format!(
                            "object {id} of {}, clipped by a mesh that is not there",
                            display_name(name)
                        );
                        self.bad(
                            found,
                            "clippingmesh, the number of an object with triangles",
                        )
                    })?;
                // The mode of clipping is set, and `clipping` was found by this number.
                self.check_triangles(lattice.clip_mesh.unwrap_or_default(), clipping)?;
                let vertices = clipping
                    .vertices
                    .iter()
                    .map(|v| transform_point(at, v))
                    .collect();
                let mesh = TriMesh::new(vertices, oriented_triangles(clipping, at).collect());
                Some(BeamClip {
                    keeps_inside: mode == ClipMode::Inside,
                    mesh: mesh.map_err(|e| self.bad(e.to_string(), "a mesh"))?,
                })
            }
        };
        let part = BeamPart {
            beams: placed_beams.beams,
            balls: placed_beams.balls,
            clip,
        };
        if !part.is_empty() {
            self.beams.push(part);
        }
        Ok(())
    }

    /// The mesh and beams of all items, with a note on all that is left out. An error if something is left out
    /// and nothing else is there.
    fn finish(mut self) -> Result<SolidFile, ReadError> {
        for (reason, numbers) in &self.left_out {
            let (n, s) = (numbers.len(), if numbers.len() == 1 { "" } else { "s" });
            // A reason begins with a noun, which takes the plural.
            let (what, rest) = reason.split_once(' ').unwrap_or((reason, ""));
            let verb = if n == 1 { "is" } else { "are" };
            let list = object_list(numbers);
            let note = match rest {
                "that is not printable" => format!("{n} item{s} not printable, left out: {list}"),
                _ => format!("{n} {what}{s} {rest} {verb} left out: {list}"),
            };
            self.notes.insert(note);
        }
        if self.short_beams > 0 {
            let n = self.short_beams;
            let note = format!(
                "{n} beam{} shorter than minlength left out",
                if n == 1 { "" } else { "s" }
            );
            self.notes.insert(note);
        }
        // If nothing remains, the reasons are an error, no longer notes.
        let is_empty = self.triangles.is_empty() && self.beams.is_empty();
        if is_empty && !self.left_out.is_empty() {
            let reasons: Vec<String> = self
                .left_out
                .iter()
                .map(|(reason, numbers)| format!("{reason} ({})", object_list(numbers)))
                .collect();
            let found = format!("nothing to print, only: {}", reasons.join("; "));
            return Err(self.bad(found, "a printable object of type \"model\""));
        }
        let mesh = TriMesh::new(
            std::mem::take(&mut self.vertices),
            std::mem::take(&mut self.triangles),
        );
        let mesh = mesh.map_err(|e| self.bad(e.to_string(), "a mesh"))?;
        Ok(SolidFile {
            file: MeshFile {
                mesh,
                unit: Some(self.unit),
                warnings: self.notes.into_iter().collect(),
            },
            beams: self.beams,
        })
    }
}

/// An object's triangles under a placement; a reflection reverses them, to keep the orientation outward.
fn oriented_triangles<'a>(
    object: &'a Object,
    at: &Placement,
) -> impl Iterator<Item = [u32; 3]> + 'a {
    let mirrors = at[0].dot(&at[1].cross(&at[2])) < 0.0;
    object
        .triangles
        .iter()
        .map(move |&[a, b, c]| if mirrors { [a, c, b] } else { [a, b, c] })
}
