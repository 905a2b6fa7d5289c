//! The body of a scaffold: the faces of its elements, with quality, groups and the fields of the file.
//!
//! Faces of curved elements are divided into smaller parts as far as the number of triangles allows; if all
//! faces are too many, only outer ones are shown.

use super::scene::{At, Body, Field, normal_bytes};
use crate::frame::{CellPoint, Vec3};
use crate::io::{DataField, FieldAt, Group, ScaffoldFile};
use crate::scaffold::{ElementMap, Neighbour, Scaffold};

/// Number of parts of an edge of a curved face, where there are few enough triangles; else two, else one.
const CURVED_PARTS: usize = 4;

/// A scaffold with its named sets of elements and the fields of its file.
#[derive(Clone, Copy)]
pub(super) struct Elements<'a> {
    pub scaffold: &'a Scaffold,
    pub groups: &'a [Group],
    pub fields: &'a [DataField],
}

impl<'a> Elements<'a> {
    /// The elements of a file.
    pub fn of(file: &'a ScaffoldFile) -> Self {
        Self {
            scaffold: &file.scaffold,
            groups: &file.groups,
            fields: &file.fields,
        }
    }
}

/// The surface of the elements for a page, and whether it has only the outer faces because all would
/// be more than `max_triangles`.
pub(super) fn body(elements: Elements, max_triangles: usize) -> (Body, bool) {
    let Elements {
        scaffold, fields, ..
    } = elements;
    // Triangles of the outer faces, or of inner ones too. Curved faces have parts^2 pieces; a quad counts twice.
    let count = |parts: usize, inner: bool| -> usize {
        let faces = (0..scaffold.len()).flat_map(|e| scaffold.faces_of(e).map(move |f| (e, f)));
        faces
            .filter(|(_, f)| inner || scaffold.neighbour(*f) == Neighbour::Outside)
            .map(|(e, f)| {
                let element = scaffold.element(e);
                let corners = element.kind().faces()[f.face as usize].corners.len();
                (corners - 2)
                    * if element.is_affine() {
                        1
                    } else {
                        parts * parts
                    }
            })
            .sum()
    };
    let is_outer = count(1, true) > max_triangles;
    // Curved faces in as many parts as the limit allows.
    let allowed = [CURVED_PARTS, 2]
        .into_iter()
        .find(|&n| count(n, !is_outer) <= max_triangles);
    let divisions = allowed.unwrap_or(1);
    let point_fields: Vec<&DataField> = fields.iter().filter(|f| f.at == FieldAt::Points).collect();
    let mut body = Body {
        name: "elements".into(),
        has_elements: !is_outer,
        part_count: scaffold.len(),
        numbers: (0..scaffold.len())
            .map(|e| scaffold.number(e) as u32)
            .collect(),
        ..Body::default()
    };
    let mut at_points: Vec<Vec<f32>> = point_fields.iter().map(|_| Vec::new()).collect();
    for e in 0..scaffold.len() {
        let element = scaffold.element(e);
        let reference_nodes = element.kind().reference_nodes();
        // Mirrored elements have their faces the other way round.
        let sign = element.volume().signum();
        for face in scaffold.faces_of(e) {
            if is_outer && scaffold.neighbour(face) != Neighbour::Outside {
                continue;
            }
            let numbers = element.kind().faces()[face.face as usize].corners;
            let corners: Vec<Vec3> = numbers
                .iter()
                .map(|&n| reference_nodes[n as usize].0)
                .collect();
            let face_divisions = if element.is_affine() { 1 } else { divisions };
            add_face(&mut body, &element, &corners, face_divisions, sign, |xi| {
                for (field, out) in point_fields.iter().zip(&mut at_points) {
                    out.push(at_point(field, &element, xi));
                }
            });
        }
    }
    body.fields.push(Field {
        name: "quality".into(),
        unit: String::new(),
        at: At::Parts,
        values: scaffold.elements().map(|e| e.quality() as f32).collect(),
        labels: None,
    });
    groups(&mut body, elements);
    let cells = fields.iter().filter(|f| f.at == FieldAt::Cells);
    for field in cells {
        let values = field
            .values
            .chunks_exact(field.components.max(1))
            .map(magnitude);
        body.fields
            .push(number_field(field, At::Parts, values.collect()));
    }
    for (field, values) in point_fields.into_iter().zip(at_points) {
        body.fields.push(number_field(field, At::Vertices, values));
    }
    (body, is_outer)
}

/// The field of a page from a field of a file; several components become their magnitude.
fn number_field(field: &DataField, at: At, values: Vec<f32>) -> Field {
    let name = if field.components > 1 {
        format!("magnitude of {}", field.name)
    } else {
        field.name.clone()
    };
    Field {
        name,
        unit: String::new(),
        at,
        values,
        labels: None,
    }
}

/// One number, or the length of several.
fn magnitude(values: &[f64]) -> f32 {
    match values {
        [one] => *one as f32,
        many => many.iter().map(|v| v * v).sum::<f64>().sqrt() as f32,
    }
}

/// A field of the nodes at a reference point of an element, interpolated; NaN where the file lacks a value.
fn at_point(field: &DataField, element: &ElementMap, xi: CellPoint<3>) -> f32 {
    let width = field.components.max(1);
    let mut sum = vec![0.0; width];
    for (&node, weight) in element
        .nodes()
        .iter()
        .zip(element.kind().shape_functions(xi))
    {
        for (k, s) in sum.iter_mut().enumerate() {
            *s += weight
                * field
                    .values
                    .get(node as usize * width + k)
                    .copied()
                    .unwrap_or(f64::NAN);
        }
    }
    magnitude(&sum)
}

/// The groups as a category; an element belongs to the first that has it.
fn groups(body: &mut Body, elements: Elements) {
    if elements.groups.is_empty() {
        return;
    }
    let mut values = vec![f32::NAN; elements.scaffold.len()];
    for (n, group) in elements.groups.iter().enumerate().rev() {
        for &e in &group.elements {
            values[e as usize] = n as f32;
        }
    }
    body.fields.push(Field {
        name: "group".into(),
        unit: String::new(),
        at: At::Parts,
        values,
        labels: Some(elements.groups.iter().map(|g| g.name.clone()).collect()),
    });
}

/// Adds a face with its outline, each edge in `parts` parts. `corners` are in the element's reference frame, `sign` is
/// -1 for a mirrored element; `visit` is called for each vertex.
fn add_face(
    body: &mut Body,
    element: &ElementMap,
    corners: &[Vec3],
    parts: usize,
    sign: f64,
    mut visit: impl FnMut(CellPoint<3>),
) {
    let first = body.positions.len() as u32;
    let n = parts;
    let is_quad = corners.len() == 4;
    let mut add = |xi: Vec3| {
        let (x, jacobian) = element.map_and_jacobian(CellPoint(xi));
        let (u, v) = (
            corners[1] - corners[0],
            corners[corners.len() - 1] - corners[0],
        );
        // The tangents of the face are J u and J v, so their cross product is its normal.
        let normal = (jacobian * u).cross(&(jacobian * v)) * sign;
        body.positions.push(x.0);
        body.normals.push(normal_bytes(normal));
        body.parts.push(element.index() as u32);
        visit(CellPoint(xi));
    };
    let mut rows = Vec::new();
    let mut count = 0u32;
    for j in 0..=n {
        // Rows of a triangle get shorter by one vertex each.
        let last = if is_quad { n } else { n - j };
        rows.push(count);
        for i in 0..=last {
            let (s, t) = (i as f64 / n as f64, j as f64 / n as f64);
            // Bilinear in a quad, barycentric in a triangle.
            add(if is_quad {
                (corners[0] * (1.0 - s) + corners[1] * s) * (1.0 - t)
                    + (corners[3] * (1.0 - s) + corners[2] * s) * t
            } else {
                corners[0] * (1.0 - s - t) + corners[1] * s + corners[2] * t
            });
            count += 1;
        }
    }
    // Vertex (i, j) of the face: row 0 is the edge of the first two corners.
    let vertex = |i: usize, j: usize| first + rows[j] + i as u32;
    let mut put = |t: [u32; 3]| {
        body.triangles
            .push(if sign < 0.0 { [t[0], t[2], t[1]] } else { t });
    };
    for j in 0..n {
        let last = if is_quad { n } else { n - j };
        for i in 0..last {
            put([vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)]);
            if is_quad || i + 1 < last {
                put([vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]);
            }
        }
    }
    // The outline: the two edges at the first corner, then the other two or one.
    for k in 0..n {
        body.lines.push([vertex(k, 0), vertex(k + 1, 0)]);
        body.lines.push([vertex(0, k), vertex(0, k + 1)]);
        if is_quad {
            body.lines.push([vertex(k, n), vertex(k + 1, n)]);
            body.lines.push([vertex(n, k), vertex(n, k + 1)]);
        } else {
            body.lines
                .push([vertex(n - k, k), vertex(n - k - 1, k + 1)]);
        }
    }
}
