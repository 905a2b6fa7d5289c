//! Traces: the restrictions of a basis to the faces of its element.
//!
//! On a face the plane waves of a series become waves in the plane, one for each in-plane projection p of
//! the frequencies: `T_p` = sum over the f with projection p of exp(2 pi i f.x0) C, with C the coefficient
//! of f and x0 the face's centre. In the coordinates of a common face of edge 1 (triangle or square), `T_p` of
//! a tet, a wedge and a pyramid refer to the same wave. Two cells agree on a common face, for any numbering of
//! its corners, exactly if their `T_p` are equal and have the full symmetry of the face (D3, D4). These
//! conditions are linear in the coefficients. They are imposed on waves; a system of samples of the face
//! would have condition number 1e8.

use super::Constraint;
use super::face_normal::{self, ProjectionKey, projection_key};
use crate::symmetry::Basis;
use druse_geometry::frame::{Element, Vec3};
use nalgebra::{DVector, Matrix2, Vector2};
use std::collections::{BTreeMap, BTreeSet};

/// The waves of a face by frequency in the face's own coordinates (cycles per edge), as real and
/// imaginary rows on the real orthonormal coefficients.
type Waves = BTreeMap<ProjectionKey<2>, (Vector2<f64>, [DVector<f64>; 2])>;

/// The trace of a basis, given by its number, on one kind of face, given by its number of corners.
struct Trace {
    basis_index: usize,
    corners: usize,
    waves: Waves,
}

/// The equations under which functions of several elements agree on every face type that they share, on
/// the concatenated coefficients of all bases.
pub(super) fn equations(bases: &[(Element, Basis<3>)]) -> Constraint {
    let unknowns: usize = bases.iter().map(|(_, b)| b.len()).sum();
    // Unknowns of basis i are numbered from starts[i] on.
    let mut starts = vec![0];
    for (_, basis) in bases {
        starts.push(starts[starts.len() - 1] + basis.len());
    }
    let traces: Vec<Trace> = bases
        .iter()
        .enumerate()
        .flat_map(|(basis_index, (element, basis))| traces(basis_index, *element, basis))
        .collect();
    // Triangles first, then squares: faces with different numbers of corners never meet.
    let mut rows = Vec::new();
    for corners in [3, 4] {
        let mut of_kind = traces.iter().filter(|t| t.corners == corners);
        let Some(first) = of_kind.next() else {
            continue;
        };
        // Adds sign T_p to an equation; `part` 0 is its real part, 1 its imaginary part. A missing wave is 0.
        let add =
            |t: &Trace, p: ProjectionKey<2>, part: usize, sign: f64, row: &mut DVector<f64>| {
                if let Some((_, parts)) = t.waves.get(&p) {
                    let mut place = row.rows_mut(starts[t.basis_index], parts[part].len());
                    place.axpy(sign, &parts[part], 1.0);
                }
            };
        // T_p of s equals T_q of t: one equation for the real and one for the imaginary part.
        let mut equal = |(s, p): (&Trace, ProjectionKey<2>), (t, q): (&Trace, ProjectionKey<2>)| {
            for part in 0..2 {
                let mut row = DVector::zeros(unknowns);
                add(s, p, part, 1.0, &mut row);
                add(t, q, part, -1.0, &mut row);
                rows.push(row);
            }
        };
        // T_p = T_Qp for every symmetry Q of the face, so that the numbering of its corners has no influence.
        for operator in symmetries(corners) {
            for (p, image) in first
                .waves
                .values()
                .map(|(p, _)| (projection_key(*p), projection_key(operator * p)))
            {
                equal((first, p), (first, image));
            }
        }
        // All other traces of this kind equal the first, and are symmetric with it.
        for other in of_kind {
            let all: BTreeSet<_> = first.waves.keys().chain(other.waves.keys()).collect();
            for &p in all {
                equal((first, p), (other, p));
            }
        }
    }
    Constraint::new(&rows, unknowns)
}

/// The equations under which a function of a solid element's basis vanishes on all faces: two functions whose
/// difference fulfils them have the same trace.
pub fn face_trace(element: Element, basis: &Basis<3>) -> Constraint {
    // With zero for the second of two functions.
    let both = [(element, basis.clone()), (element, basis.clone())];
    let first: Vec<usize> = (0..basis.len()).collect();
    equations(&both).restricted(&first)
}

/// Generators of the symmetries of a triangle and a square about their centres.
fn symmetries(corners: usize) -> [Matrix2<f64>; 2] {
    let mirror = Matrix2::new(-1.0, 0.0, 0.0, 1.0);
    let (s, c) = libm::sincos(std::f64::consts::TAU / corners as f64);
    [mirror, Matrix2::new(c, -s, s, c)]
}

/// The traces of a basis on one face of each kind. Normals within 1e-9 are equal.
fn traces(basis_index: usize, element: Element, basis: &Basis<3>) -> Vec<Trace> {
    let vertices = element.vertices();
    let operators = basis.group().cartesian(basis.lattice());
    let mut chosen: Vec<Vec3> = Vec::new();
    let mut found = Vec::new();
    for face in element.faces() {
        let is_image = |n: &Vec3| {
            operators
                .iter()
                .any(|q| (q * n - face.normal).norm() < 1e-9)
        };
        if chosen.iter().any(is_image) {
            continue;
        }
        chosen.push(face.normal);
        let corners: Vec<Vec3> = element
            .face_vertices(&face)
            .into_iter()
            .map(|v| vertices[v])
            .collect();
        let centre = corners.iter().sum::<Vec3>() / corners.len() as f64;
        // The first axis is along an edge, which the two least corners share; the second points towards the others.
        let edge = corners[1] - corners[0];
        let along = edge.normalize();
        let across = face.normal.cross(&along);
        let side = across.dot(&(centre - corners[0])).signum();
        let axes = [along, across * side].map(|a| a * element.edge());
        let waves = face_normal::projected(
            basis,
            face.normal,
            centre,
            |_| Some((1.0, 0.0)),
            // The rows of p and -p are equal up to a sign.
            |p| projection_key(p) >= projection_key(-p),
        );
        let waves: BTreeMap<_, _> = waves
            .into_values()
            .flat_map(|(p, [re, im])| {
                let p = Vector2::from(axes.map(|a| a.dot(&p)));
                let conjugate = [re.clone(), -&im];
                [
                    (projection_key(p), (p, [re, im])),
                    (projection_key(-p), (-p, conjugate)),
                ]
            })
            .collect();
        found.push(Trace {
            basis_index,
            corners: corners.len(),
            waves,
        });
    }
    found
}
