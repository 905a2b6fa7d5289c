//! Crystal forms: convex crystals as intersections of half-spaces.
//!
//! A form {hkl} is the orbit of the plane (hkl) under a point group. Its planes have the normals
//! `h a* + k b* + l c*` of the reciprocal lattice and lie at one distance from the origin. Moving a form in or
//! out keeps the directions of its planes. Point groups have Hermann-Mauguin symbols (`m-3m`). Trigonal groups
//! refer to hexagonal axes, or to rhombohedral ones for that lattice.

use super::polygon::unit;
use super::{Faces, PolyError, PolyMesh};
use druse_cells::symmetry::{Operator, PointGroup};
use druse_geometry::frame::{Mat3, Vec3};
use std::collections::BTreeSet;

/// Lattice systems and their free lengths and angles.
pub const SYSTEMS: [(&str, &[&str]); 7] = [
    ("cubic", &["a"]),
    ("tetragonal", &["a", "c"]),
    ("orthorhombic", &["a", "b", "c"]),
    ("hexagonal", &["a", "c"]),
    ("rhombohedral", &["a", "alpha"]),
    ("monoclinic", &["a", "b", "c", "beta"]),
    ("triclinic", &["a", "b", "c", "alpha", "beta", "gamma"]),
];

/// The 32 point groups: symbol, generators in coordinates along the lattice's axes.
#[rustfmt::skip]
const GROUPS: [(&str, &[&str]); 32] = [
    ("1", &[]), ("-1", &["-x,-y,-z"]),
    ("2", &["-x,y,-z"]), ("m", &["x,-y,z"]), ("2/m", &["-x,y,-z", "-x,-y,-z"]),
    ("222", &["-x,-y,z", "-x,y,-z"]), ("mm2", &["-x,-y,z", "x,-y,z"]), ("mmm", &["-x,-y,z", "-x,y,-z", "-x,-y,-z"]),
    ("4", &["-y,x,z"]), ("-4", &["y,-x,-z"]), ("4/m", &["-y,x,z", "-x,-y,-z"]), ("422", &["-y,x,z", "-x,y,-z"]),
    ("4mm", &["-y,x,z", "x,-y,z"]), ("-42m", &["y,-x,-z", "-x,y,-z"]), ("4/mmm", &["-y,x,z", "-x,y,-z", "-x,-y,-z"]),
    ("3", &["-y,x-y,z"]), ("-3", &["-y,x-y,z", "-x,-y,-z"]), ("32", &["-y,x-y,z", "y,x,-z"]),
    ("3m", &["-y,x-y,z", "-y,-x,z"]), ("-3m", &["-y,x-y,z", "-y,-x,z", "-x,-y,-z"]),
    ("6", &["x-y,x,z"]), ("-6", &["-y,x-y,z", "x,y,-z"]), ("6/m", &["x-y,x,z", "-x,-y,-z"]), ("622", &["x-y,x,z", "y,x,-z"]),
    ("6mm", &["x-y,x,z", "-y,-x,z"]), ("-6m2", &["-y,x-y,z", "x,y,-z", "-y,-x,z"]), ("6/mmm", &["x-y,x,z", "y,x,-z", "-x,-y,-z"]),
    ("23", &["z,x,y", "-x,-y,z"]), ("m-3", &["z,x,y", "-x,-y,z", "-x,-y,-z"]), ("432", &["z,x,y", "-y,x,z"]),
    ("-43m", &["z,x,y", "y,-x,-z"]), ("m-3m", &["z,x,y", "-y,x,z", "-x,-y,-z"]),
];

/// The rows of the trigonal and hexagonal groups, whose operators refer to hexagonal axes.
const HEXAGONAL_ROWS: std::ops::Range<usize> = 15..27;

/// The trigonal groups on rhombohedral axes.
const RHOMBOHEDRAL_GROUPS: [(&str, &[&str]); 5] = [
    ("3", &["z,x,y"]),
    ("-3", &["z,x,y", "-x,-y,-z"]),
    ("32", &["z,x,y", "-y,-x,-z"]),
    ("3m", &["z,x,y", "y,x,z"]),
    ("-3m", &["z,x,y", "y,x,z", "-x,-y,-z"]),
];

/// The holohedry of each lattice system: the full point group of its lattice.
const HOLOHEDRIES: [(&str, &str); 7] = [
    ("cubic", "m-3m"),
    ("tetragonal", "4/mmm"),
    ("orthorhombic", "mmm"),
    ("hexagonal", "6/mmm"),
    ("rhombohedral", "-3m"),
    ("monoclinic", "2/m"),
    ("triclinic", "-1"),
];

/// Schoenflies symbols and the Hermann-Mauguin symbols of the table.
#[rustfmt::skip]
const SCHOENFLIES_SYMBOLS: [(&str, &str); 34] = [
    ("C1", "1"), ("Ci", "-1"), ("C2", "2"), ("Cs", "m"), ("C2h", "2/m"), ("D2", "222"), ("C2v", "mm2"), ("D2h", "mmm"),
    ("C4", "4"), ("S4", "-4"), ("C4h", "4/m"), ("D4", "422"), ("C4v", "4mm"), ("D2d", "-42m"), ("D4h", "4/mmm"),
    ("C3", "3"), ("S6", "-3"), ("C3i", "-3"), ("D3", "32"), ("C3v", "3m"), ("D3d", "-3m"),
    ("C6", "6"), ("C3h", "-6"), ("S3", "-6"), ("C6h", "6/m"), ("D6", "622"), ("C6v", "6mm"), ("D3h", "-6m2"), ("D6h", "6/mmm"),
    ("T", "23"), ("Th", "m-3"), ("O", "432"), ("Td", "-43m"), ("Oh", "m-3m"),
];

/// The point group with a Hermann-Mauguin or Schoenflies symbol, as matrices in Cartesian axes: one set for
/// each orientation of its axes. Hexagonal and trigonal groups have their main axis along z and axis a along x;
/// trigonal groups may also have it along (1, 1, 1).
///
/// # Errors
/// [`FormError::Unknown`].
pub fn cartesian_group(name: &str) -> Result<Vec<Vec<Mat3>>, FormError> {
    let symbol = SCHOENFLIES_SYMBOLS.iter().find(|row| row.0 == name);
    // A symbol that is not Schoenflies' is taken as Hermann-Mauguin's.
    let symbol = symbol.map_or(name, |row| row.1);
    let hexagonal = lattice_vectors([1.0; 3], [90.0, 90.0, 120.0]).unwrap_or_else(Mat3::identity);
    let row = GROUPS.iter().position(|row| row.0 == symbol);
    let standing = row.map(|n| {
        let axes = if HEXAGONAL_ROWS.contains(&n) {
            hexagonal
        } else {
            Mat3::identity()
        };
        // Groups of the hexagonal family are written in axes 120 degrees apart; Cartesian axes give
        // orthogonal matrices: A M A^-1.
        (GROUPS[n].1, axes)
    });
    // Trigonal groups have a second orientation, about the diagonal of rhombohedral axes.
    let diagonal = RHOMBOHEDRAL_GROUPS.iter().find(|row| row.0 == symbol);
    let diagonal = diagonal.map(|row| (row.1, Mat3::identity()));
    let rows = standing.into_iter().chain(diagonal);
    let orientations: Vec<Vec<Mat3>> = rows
        .map(|(generators, axes)| {
            // The axes have an inverse, so that the identity is not reached.
            let inverse = axes.try_inverse().unwrap_or_else(Mat3::identity);
            let group = generated(symbol, generators);
            let matrix = |o: &Operator<3>| axes * operator_matrix(o) * inverse;
            group.operators().iter().map(matrix).collect()
        })
        .collect();
    if orientations.is_empty() {
        return Err(FormError::Unknown {
            what: "point group",
            name: name.to_owned(),
            known: format!(
                "{}, or the Schoenflies symbol",
                group_names().collect::<Vec<_>>().join(", ")
            ),
        });
    }
    Ok(orientations)
}

/// The point group that the operators of a row of the tables generate. Rows are valid; a test builds all of them.
fn generated(name: &str, generators: &[&str]) -> PointGroup<3> {
    let operators: Vec<Operator<3>> = generators
        .iter()
        .map(|g| {
            g.parse()
                .unwrap_or_else(|_| unreachable!("a row of the table: {g}"))
        })
        .collect();
    PointGroup::generated(name, &operators)
        .unwrap_or_else(|e| unreachable!("a row of the table: {e}"))
}

/// The matrix of an operator, in coordinates along the lattice's axes.
fn operator_matrix(operator: &Operator<3>) -> Mat3 {
    let column = |k: usize| {
        let mut e = [0.0; 3];
        e[k] = 1.0;
        Vec3::from(operator.apply(e))
    };
    Mat3::from_columns(&[column(0), column(1), column(2)])
}

/// Hermann-Mauguin symbols of the 32 point groups.
pub fn group_names() -> impl Iterator<Item = &'static str> {
    GROUPS.iter().map(|row| row.0)
}

/// Why a crystal cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FormError {
    /// An unknown name.
    #[error("no {what} is named {name:?}; expected one of {known}")]
    Unknown {
        /// The kind of name.
        what: &'static str,
        /// The name found.
        name: String,
        /// The known names.
        known: String,
    },
    /// A length or an angle that no lattice cell has.
    #[error("{name} = {value}; expected {expected}")]
    Axis {
        /// The name of the length or angle.
        name: String,
        /// Its value.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A group that does not keep the lattice.
    #[error(
        "the group {group} is not a symmetry of this {system} lattice: {operator} changes its axes"
    )]
    Group {
        /// The group.
        group: String,
        /// The system.
        system: String,
        /// The operator.
        operator: String,
    },
    /// A plane with the indices 0 0 0.
    #[error("the plane [0, 0, 0]; expected indices that are not all 0")]
    Zero,
    /// A distance out of range.
    #[error("the form {{{} {} {}}} lies at distance {distance}; expected a finite number more than 0", hkl[0], hkl[1], hkl[2])]
    Distance {
        /// A plane of the form.
        hkl: [i32; 3],
        /// Its distance.
        distance: f64,
    },
    /// Too many planes.
    #[error("{0} planes; expected at most 400")]
    TooMany(usize),
    /// Planes that do not enclose a bounded volume.
    #[error("the planes enclose no bounded volume: {0}; add a form that closes the crystal")]
    Open(String),
    /// A form that the crystal does not have.
    #[error("the crystal has no form {{{} {} {}}}", .0[0], .0[1], .0[2])]
    NoForm([i32; 3]),
}

/// A crystal: lattice, point group, forms with distances.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    /// The lattice vectors as columns.
    lattice: Mat3,
    group: PointGroup<3>,
    /// Indices of a plane of each form, and its distance.
    pub planes: Vec<([i32; 3], f64)>,
}

impl Form {
    /// A crystal without planes, of a lattice system (a name of [`SYSTEMS`]) with lengths and angles (degrees) by name,
    /// and a point group by Hermann-Mauguin symbol; without one, the holohedry. Lengths that are left out are 1, or
    /// what the system ties to a given one (c of tetragonal and hexagonal axes to a); angles are 90 degrees, or 120 for
    /// gamma of hexagonal axes.
    ///
    /// # Errors
    /// [`FormError`] names the argument that does not fit.
    pub fn new(
        system: &str,
        axes: &[(String, f64)],
        group: Option<&str>,
    ) -> Result<Self, FormError> {
        let Some((_, free)) = SYSTEMS.iter().find(|row| row.0 == system) else {
            return Err(FormError::Unknown {
                what: "lattice system",
                name: system.to_owned(),
                known: SYSTEMS.map(|row| row.0).join(", "),
            });
        };
        // Each lattice system leaves some lengths and angles free; the others follow from its symmetry.
        let (mut lengths, mut angles) = ([1.0; 3], [90.0; 3]);
        if system == "hexagonal" {
            angles[2] = 120.0;
        }
        for (name, value) in axes {
            if !free.contains(&name.as_str()) {
                return Err(FormError::Unknown {
                    what: "free axis or angle",
                    name: name.clone(),
                    known: free.join(", "),
                });
            }
            let place = |names: [&str; 3]| names.iter().position(|n| n == name);
            let wrong = |expected| FormError::Axis {
                name: name.clone(),
                value: *value,
                expected,
            };
            if let Some(k) = place(["a", "b", "c"]) {
                if !(value.is_finite() && *value > 0.0) {
                    return Err(wrong("a length more than 0"));
                }
                lengths[k] = *value;
            }
            if let Some(k) = place(["alpha", "beta", "gamma"]) {
                if !(*value > 0.0 && *value < 180.0) {
                    return Err(wrong("an angle between 0 and 180 degrees"));
                }
                angles[k] = *value;
            }
        }
        let given = |n: &str| axes.iter().any(|a| a.0 == n);
        match system {
            "cubic" | "rhombohedral" => lengths = [lengths[0]; 3],
            "tetragonal" | "hexagonal" => lengths[1] = lengths[0],
            _ => {}
        }
        // Without c the cell is as high as it is wide.
        if matches!(system, "tetragonal" | "hexagonal") && !given("c") {
            lengths[2] = lengths[0];
        }
        if system == "rhombohedral" {
            angles = [angles[0]; 3];
        }
        let lattice = lattice_vectors(lengths, angles).ok_or(FormError::Axis {
            name: "alpha, beta, gamma".into(),
            value: angles.iter().sum(),
            expected: "three angles that close a cell",
        })?;
        // Without a symbol the group is that of the lattice, the holohedry.
        let holohedry = HOLOHEDRIES
            .iter()
            .find(|row| row.0 == system)
            .map_or("1", |r| r.1);
        let name = group.unwrap_or(holohedry);
        // Rhombohedral axes take their own rows, and the groups 1 and -1, which are the same on all axes.
        let rows: Vec<&(&str, &[&str])> = match system {
            "rhombohedral" => RHOMBOHEDRAL_GROUPS.iter().chain(&GROUPS[..2]).collect(),
            _ => GROUPS.iter().collect(),
        };
        let Some((_, generators)) = rows.iter().find(|row| row.0 == name) else {
            let known: Vec<&str> = rows.iter().map(|row| row.0).collect();
            return Err(FormError::Unknown {
                what: "point group",
                name: name.to_owned(),
                known: known.join(", "),
            });
        };
        let group = generated(name, generators);
        // An operator is a symmetry of the lattice if it keeps its metric, up to rounding.
        let metric = lattice.transpose() * lattice;
        for operator in group.operators() {
            let m = operator_matrix(operator);
            let changed = (m.transpose() * metric * m - metric).amax();
            if changed > 1e-9 * metric.amax() {
                return Err(FormError::Group {
                    group: name.to_owned(),
                    system: system.to_owned(),
                    operator: operator.to_string(),
                });
            }
        }
        Ok(Self {
            lattice,
            group,
            planes: Vec::new(),
        })
    }

    /// Adds a form: the plane `hkl` and its images under the group, at a distance from the origin.
    ///
    /// # Errors
    /// [`FormError::Zero`], [`FormError::Distance`].
    pub fn add(&mut self, hkl: [i32; 3], distance: f64) -> Result<(), FormError> {
        if hkl == [0; 3] {
            return Err(FormError::Zero);
        }
        if !(distance.is_finite() && distance > 0.0) {
            return Err(FormError::Distance { hkl, distance });
        }
        self.planes.push((hkl, distance));
        Ok(())
    }

    /// Moves the form that `hkl` belongs to outward by a distance, or inward by a negative one; its planes keep their
    /// directions. Of several such forms the first moves.
    ///
    /// # Errors
    /// [`FormError::NoForm`], [`FormError::Distance`].
    pub fn push(&mut self, hkl: [i32; 3], by: f64) -> Result<(), FormError> {
        let orbit = self.orbit(hkl);
        let found = self.planes.iter_mut().find(|p| orbit.contains(&p.0));
        let Some((_, distance)) = found else {
            return Err(FormError::NoForm(hkl));
        };
        let moved = *distance + by;
        if !(moved.is_finite() && moved > 0.0) {
            return Err(FormError::Distance {
                hkl,
                distance: moved,
            });
        }
        *distance = moved;
        Ok(())
    }

    /// The indices of all planes of a form.
    pub fn orbit(&self, hkl: [i32; 3]) -> BTreeSet<[i32; 3]> {
        let images = self.group.operators().iter();
        images.map(|o| o.apply_to_frequency(hkl)).collect()
    }

    /// Whether another form has the same planes as form `n` (its number in `planes`) at the same or a smaller
    /// distance. Of forms at the same distance the first has the faces.
    pub fn repeats(&self, n: usize) -> bool {
        let (own, distance) = self.planes[n];
        let orbit = self.orbit(own);
        let mut others = self.planes.iter().enumerate().filter(|o| o.0 != n);
        others.any(|(_, (hkl, other))| orbit.contains(hkl) && *other <= distance)
    }

    /// The polyhedron; the faces of form number n, from 0, are group n + 1. A form that others cut off entirely has no
    /// face.
    ///
    /// # Errors
    /// [`FormError::Open`], [`FormError::TooMany`].
    pub fn mesh(&self) -> Result<PolyMesh, FormError> {
        // Columns of the inverse transpose are a*, b*, c*. The lattice is invertible, as `new` checks.
        let reciprocal = self
            .lattice
            .try_inverse()
            .unwrap_or_else(Mat3::identity)
            .transpose();
        let mut planes: Vec<(Vec3, f64, u32)> = Vec::new();
        for (n, &(hkl, distance)) in self.planes.iter().enumerate() {
            for image in self.orbit(hkl) {
                let normal = unit(reciprocal * Vec3::from(image.map(f64::from)));
                let Some(normal) = normal else { continue };
                // Of planes with the same direction only the nearest counts; of equal ones the first.
                let same = planes.iter_mut().find(|p| (p.0 - normal).norm() < 1e-9);
                match same {
                    Some(plane) if plane.1 <= distance => {}
                    Some(plane) => *plane = (normal, distance, n as u32 + 1),
                    None => planes.push((normal, distance, n as u32 + 1)),
                }
            }
        }
        // Corners come from all triples of planes against all planes: the limit bounds a cost of the fourth power.
        if planes.len() > 400 {
            return Err(FormError::TooMany(planes.len()));
        }
        convex(&planes)
    }
}

/// Lattice vectors as columns, from lengths and angles in degrees: a along x, b in the plane of x and y, z of c
/// positive. `None` where three such angles close no cell of positive volume.
fn lattice_vectors(lengths: [f64; 3], angles: [f64; 3]) -> Option<Mat3> {
    // Right angles and those of hexagonal axes are exact.
    let cosine = angles.map(|a| if a == 90.0 { 0.0 } else { a.to_radians().cos() });
    let cosine = [0, 1, 2].map(|k| if angles[k] == 120.0 { -0.5 } else { cosine[k] });
    let sine = (1.0 - cosine[2] * cosine[2]).sqrt();
    let cy = (cosine[0] - cosine[1] * cosine[2]) / sine;
    // The square of the height of c over its length; up to 1e-12 it may be the rounding of a flat cell.
    let cz = 1.0 - cosine[1] * cosine[1] - cy * cy;
    if cz <= 1e-12 {
        return None;
    }
    let a = Vec3::new(lengths[0], 0.0, 0.0);
    let b = Vec3::new(cosine[2], sine, 0.0) * lengths[1];
    let c = Vec3::new(cosine[1], cy, cz.sqrt()) * lengths[2];
    Some(Mat3::from_columns(&[a, b, c]))
}

/// The polyhedron of points with n.x <= d for all planes (n, d, group), all d > 0. Each corner belongs to the faces of
/// all planes through it; tolerances are shares of the greatest distance.
fn convex(planes: &[(Vec3, f64, u32)]) -> Result<PolyMesh, FormError> {
    // Corners closer than ten times `close` are one, where more than three planes meet: each has their roundings.
    let size = planes.iter().map(|p| p.1).fold(0.0, f64::max);
    let close = 1e-9 * size;
    let mut points: Vec<Vec3> = Vec::new();
    // Corners are the meetings of three planes that no other plane cuts off; coplanar normals have none.
    for i in 0..planes.len() {
        for j in i + 1..planes.len() {
            for k in j + 1..planes.len() {
                let (a, b, c) = (planes[i], planes[j], planes[k]);
                let across = b.0.cross(&c.0);
                let determinant = a.0.dot(&across);
                if determinant.abs() < 1e-9 {
                    continue;
                }
                // p = (d_a n_b x n_c + d_b n_c x n_a + d_c n_a x n_b) / det.
                let p =
                    (a.1 * across + b.1 * c.0.cross(&a.0) + c.1 * a.0.cross(&b.0)) / determinant;
                let inside = planes.iter().all(|(n, d, _)| n.dot(&p) <= d + close);
                if inside && !points.iter().any(|q| (p - q).norm() < 10.0 * close) {
                    points.push(p);
                }
            }
        }
    }
    if points.len() < 4 {
        return Err(FormError::Open("no corners".into()));
    }
    let mut number = vec![u32::MAX; points.len()];
    let mut vertices = Vec::new();
    let (mut faces, mut groups) = (Faces::default(), Vec::new());
    // A face for each plane with three corners or more, in the order of their angles about the normal.
    for &(normal, distance, group) in planes {
        let mut on: Vec<usize> = (0..points.len())
            .filter(|&v| normal.dot(&points[v]) > distance - 10.0 * close)
            .collect();
        if on.len() < 3 {
            continue;
        }
        let centre = on.iter().map(|&v| points[v]).sum::<Vec3>() / on.len() as f64;
        let Some(x) = unit(points[on[0]] - centre) else {
            continue;
        };
        let y = normal.cross(&x);
        let angle = |v: usize| {
            let p = points[v] - centre;
            // The angle of the first corner is 0, whichever sign rounding gives it.
            let a = p.dot(&y).atan2(p.dot(&x));
            if a < -1e-9 {
                a + std::f64::consts::TAU
            } else {
                a
            }
        };
        on.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
        faces.push(on.into_iter().map(|v| {
            if number[v] == u32::MAX {
                number[v] = vertices.len() as u32;
                vertices.push(points[v]);
            }
            number[v]
        }));
        groups.push(group);
    }
    PolyMesh::new(vertices, faces, groups).map_err(|e| {
        FormError::Open(match e {
            PolyError::Open { .. } | PolyError::Empty => "the intersection is unbounded".into(),
            other => other.to_string(),
        })
    })
}
