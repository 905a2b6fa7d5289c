//! Results of a deck at the elements of its scaffold.
//!
//! Results belong to the deck that the recipe writes. Nodes of a `.frd` are compared by number and place, nodes or
//! elements of a mesh file by place. Results of another mesh are refused: they would be put on wrong elements. Values
//! at nodes become means of elements; a stress of six or nine numbers becomes its von Mises stress.

use super::{GradeOptions, GradeRule};
use crate::frame::{Vec3, WorldPoint};
use crate::io::{DataField, ElementFile, FieldAt, Place, ReadError, read_elements, read_frd};
use crate::pipeline::base::error::RunError;
use crate::pipeline::inputs::field_data::von_mises;
use crate::pipeline::inputs::scattered_data::ScatteredPoints;
use crate::pipeline::inputs::source::has_extension;
use crate::scaffold::{Kind, Scaffold};
use std::path::Path;

/// Distance of a node from its place in the scaffold, over the greater of half the scaffold's diagonal and the node's
/// distance from the origin: results have six digits.
const PLACE_TOLERANCE: f64 = 1e-4;
/// Nodes of a serendipity hexahedron; decks hold triquadratic ones as such.
const DECK_HEX_NODES: usize = 20;

/// A scalar measure of each element.
pub(super) struct ElementResults {
    pub rule: GradeRule,
    /// Von Mises stresses or energy densities, of solid and void together.
    pub values: Vec<f64>,
}

/// Values of a field at nodes of the scaffold or at its elements.
struct Field {
    components: usize,
    /// The components by node or element; NaN where the file has none.
    values: Vec<f64>,
    at: FieldAt,
}

/// Reads the field of the options from the results of a solver; `factor` is the results' unit of length per unit
/// of the scaffold.
pub(super) fn read(
    options: &GradeOptions,
    scaffold: &Scaffold,
    factor: f64,
) -> Result<ElementResults, RunError> {
    let path = &options.results;
    let field = if has_extension(path, &["frd"]) {
        of_frd(path, &options.field, scaffold, factor)?
    } else if has_extension(path, &["vtu", "vtk"]) {
        of_mesh(path, &options.field, scaffold, factor)?
    } else {
        let e = ReadError::data(path, Place::File, "another extension", ".frd, .vtu or .vtk");
        return Err(e
            .with_hint("meshio converts results of other programs to .vtu")
            .into());
    };
    // The number of components shows what the field is, unless an option decides: one number can be a stress.
    let by_components = match field.components {
        1 => GradeRule::Energy,
        6 | 9 => GradeRule::Stress,
        n => {
            let found = format!("the field {:?} of {n} numbers", options.field);
            let expected = "a stress of 6 or 9 numbers, or an energy density of 1";
            return Err(ReadError::data(path, Place::File, found, expected).into());
        }
    };
    let rule = options.rule.unwrap_or(by_components);
    if rule == GradeRule::Energy && field.components > 1 {
        let found = format!(
            "the field {:?} of {} numbers",
            options.field, field.components
        );
        let e = ReadError::data(path, Place::File, found, "an energy density of 1 number");
        return Err(e
            .with_hint("CalculiX writes it with ENER under *EL FILE: --field ENER")
            .into());
    }
    let values = by_element(path, scaffold, &field)?;
    // A field of zeros would give an empty part.
    if values.iter().all(|v| *v == 0.0) {
        let found = format!("the field {:?} with 0 in all elements", options.field);
        return Err(ReadError::data(path, Place::File, found, "the results of a load").into());
    }
    Ok(ElementResults { rule, values })
}

/// The numbers of the nodes of an element that a deck holds.
fn deck_nodes(scaffold: &Scaffold, element: usize) -> &[u32] {
    let nodes = scaffold.connectivity().nodes(element);
    match scaffold.connectivity().kind(element) {
        Kind::Hex27 => &nodes[..DECK_HEX_NODES],
        _ => nodes,
    }
}

/// Whether each node is part of a deck.
fn used(scaffold: &Scaffold) -> Vec<bool> {
    let mut all = vec![false; scaffold.nodes().len()];
    for e in 0..scaffold.len() {
        for &n in deck_nodes(scaffold, e) {
            all[n as usize] = true;
        }
    }
    all
}

/// The error for results of another mesh.
fn other_mesh(path: &Path, place: Place, found: String, expected: String) -> ReadError {
    ReadError::data(path, place, found, expected).with_hint(
        "results belong to the deck that the recipe writes as it is now: solve that deck again, or give the \
         recipe the --set of the run that wrote it",
    )
}

/// A field of a `.frd` file, at the nodes of the deck. `factor` is the file's unit of
/// length per unit of the scaffold.
fn of_frd(path: &Path, name: &str, scaffold: &Scaffold, factor: f64) -> Result<Field, RunError> {
    let file = read_frd(path)?;
    let field = file.field(name)?;
    let used = used(scaffold);
    let expected = used.iter().filter(|u| **u).count();
    // Results of another deck would be put on wrong elements: number and place of every node are
    // compared.
    if file.nodes.len() != expected {
        let found = format!("{} nodes", file.nodes.len());
        let expected = format!("{expected}, those of the scaffold's deck");
        return Err(other_mesh(path, Place::File, found, expected).into());
    }
    let size = scaffold.bounds().half_diagonal() * factor;
    for &(number, at) in &file.nodes {
        let node = (number as usize)
            .checked_sub(1)
            .filter(|&n| n < used.len() && used[n]);
        let position = node.map(|n| scaffold.nodes()[n] * factor);
        if position.is_none_or(|p| (p - at).norm() > PLACE_TOLERANCE * size.max(p.norm())) {
            let found = format!("a node at ({}, {}, {})", at.x, at.y, at.z);
            let expected = position.map_or_else(
                || "a node of the scaffold's deck".to_owned(),
                |p| {
                    format!(
                        "({:.5}, {:.5}, {:.5}), its place in the scaffold's deck",
                        p.x, p.y, p.z
                    )
                },
            );
            return Err(other_mesh(path, Place::Item("node", number), found, expected).into());
        }
    }
    let components = field.components.len();
    // Nodes without a result keep NaN, so that their elements are reported.
    let mut values = vec![f64::NAN; components * used.len()];
    for (row, &number) in field
        .values
        .chunks_exact(components.max(1))
        .zip(&field.nodes)
    {
        // Numbers of the deck count from 1; rows of others are left out.
        let node = (number as usize).checked_sub(1);
        let mut rows = values.chunks_exact_mut(components.max(1));
        if let Some(own) = node.and_then(|n| rows.nth(n)) {
            own.copy_from_slice(row);
        }
    }
    Ok(Field {
        components,
        values,
        at: FieldAt::Points,
    })
}

/// A field of a mesh file, at the nodes or elements of the deck. Other programs renumber them, so
/// they are found by place. `factor` is the file's unit of length per unit of the scaffold.
fn of_mesh(path: &Path, name: &str, scaffold: &Scaffold, factor: f64) -> Result<Field, RunError> {
    let ElementFile::Solids(file) = read_elements(path)? else {
        let found = "surface elements only";
        return Err(ReadError::data(path, Place::File, found, "the scaffold's elements").into());
    };
    let has_name = |f: &&DataField| f.name.eq_ignore_ascii_case(name);
    // Values at elements need no mean.
    let fields = || file.fields.iter().filter(has_name);
    let found = fields()
        .find(|f| f.at == FieldAt::Cells)
        .or_else(|| fields().next());
    let Some(field) = found else {
        let known: Vec<&str> = file.fields.iter().map(|f| f.name.as_str()).collect();
        let expected = match known[..] {
            [] => "point or cell data: the file has none".to_owned(),
            _ => format!("one of {}", known.join(", ")),
        };
        let found = format!("no field {name:?}");
        return Err(ReadError::data(path, Place::File, found, expected).into());
    };
    let theirs = &file.scaffold;
    let (places, own_places, what): (Vec<Vec3>, Vec<Option<Vec3>>, _) = match field.at {
        FieldAt::Points => {
            let used = used(scaffold);
            let places_in_use = scaffold.nodes().iter().zip(used);
            let node_places = places_in_use.map(|(p, used)| used.then_some(*p)).collect();
            (theirs.nodes().to_vec(), node_places, "node")
        }
        FieldAt::Cells => {
            let centre = |s: &Scaffold, e: usize| {
                let element = s.element(e);
                let WorldPoint(p) = element.map(element.shape().centroid());
                p
            };
            let all = (0..theirs.len()).map(|e| centre(theirs, e)).collect();
            let centres = (0..scaffold.len())
                .map(|e| Some(centre(scaffold, e)))
                .collect();
            (all, centres, "element")
        }
    };
    // A finer mesh of the same part holds nodes at the same places, too.
    if theirs.len() != scaffold.len() {
        let found = format!("{} elements", theirs.len());
        let expected = format!("{}, those of the scaffold's deck", scaffold.len());
        return Err(other_mesh(path, Place::File, found, expected).into());
    }
    let size = scaffold.bounds().half_diagonal() * factor;
    let tree = ScatteredPoints::new(&places);
    let mut values = vec![f64::NAN; field.components * own_places.len()];
    // The nearest item of the file (`nearest` gives squared distances), which must be at the place itself.
    for (n, place) in own_places.iter().enumerate() {
        let Some(p) = place.map(|p| p * factor) else {
            continue;
        };
        let nearest = tree.nearest(p, 1);
        let near = nearest
            .first()
            .filter(|f| f.1.sqrt() <= PLACE_TOLERANCE * size.max(p.norm()));
        let Some(&(m, _)) = near else {
            let found = format!("no {what} at ({:.5}, {:.5}, {:.5})", p.x, p.y, p.z);
            let expected = format!("the {what}s of the scaffold's deck");
            return Err(other_mesh(path, Place::File, found, expected).into());
        };
        let k = field.components;
        let row = &field.values[m as usize * k..(m as usize + 1) * k];
        values[n * k..(n + 1) * k].copy_from_slice(row);
    }
    Ok(Field {
        components: field.components,
        values,
        at: field.at,
    })
}

/// One number for each element: the energy density, or the von Mises stress of the mean of its
/// components. Results at nodes are averaged over the element's nodes in the deck.
fn by_element(path: &Path, scaffold: &Scaffold, field: &Field) -> Result<Vec<f64>, RunError> {
    let k = field.components;
    let mut all = Vec::with_capacity(scaffold.len());
    let mut missing = Vec::new();
    for e in 0..scaffold.len() {
        let places: Vec<usize> = match field.at {
            FieldAt::Cells => vec![e],
            FieldAt::Points => deck_nodes(scaffold, e)
                .iter()
                .map(|&n| n as usize)
                .collect(),
        };
        // The mean of the tensors is the stress at the element's centre; a mean of von Mises stresses
        // would not be.
        let mean: Vec<f64> = (0..k)
            .map(|c| {
                places.iter().map(|p| field.values[p * k + c]).sum::<f64>() / places.len() as f64
            })
            .collect();
        let value = if k == 1 { mean[0] } else { von_mises(&mean) };
        if !value.is_finite() {
            missing.push(e);
        }
        // Extrapolation to nodes can make an energy slightly negative.
        all.push(value.max(0.0));
    }
    let Some(&first) = missing.first() else {
        return Ok(all);
    };
    let found = format!("no finite value in {} elements", missing.len());
    let place = Place::Item("element", scaffold.number(first));
    let e = ReadError::data(path, place, found, "a value in every element");
    Err(e
        .with_hint("*EL FILE without a set writes all elements")
        .into())
}
