//! The library of strut graphs and plate sets, derived from the element's geometry where possible.
//!
//! All coordinates are reference coordinates, in which a hex is the unit cube about the origin and a tet has four of
//! the cube's corners. Other elements have only the sets that follow from vertices, edges and faces.
//! The lists of names and the functions that build them change together.

use super::{Skeleton, SkeletonError};
use druse_geometry::frame::{Element, Vec3};

/// Names of the strut graphs of an element.
pub fn graphs(element: Element) -> &'static [&'static str] {
    match element {
        Element::Hex => &[
            "sc", "bcc", "fcc", "octet", "kelvin", "diamond", "cross", "edges", "spokes", "axes",
        ],
        Element::Tet => &[
            "fcc", "bcc", "octet", "diamond", "cross", "edges", "spokes", "axes",
        ],
        _ if element.dimension() == 2 => &["edges", "spokes"],
        _ => &["edges", "spokes", "axes"],
    }
}

/// Names of the plate sets of an element.
pub fn plate_sets(element: Element) -> &'static [&'static str] {
    match element {
        Element::Hex => &["face_plates", "sc_plates", "bcc_plates", "fcc_plates"],
        Element::Tet => &["face_plates", "fcc_plates"],
        Element::Tri | Element::Quad => &[],
        _ => &["face_plates"],
    }
}

impl Skeleton {
    /// The strut graph of the given name in an element. All struts have the same radius (reference lengths).
    ///
    /// | name | hex | tet |
    /// |---|---|---|
    /// | `edges` | `sc`, simple cubic | `fcc` |
    /// | `spokes`, centroid to vertices | `bcc` | `bcc` |
    /// | `axes`, centroid to face centres | `cross` | `diamond` |
    /// | `fcc` | both diagonals of every face | `edges` |
    /// | `octet` | `fcc` and the octahedron between the face centres | `edges` and the octahedron between their midpoints |
    /// | `kelvin` | edges of the truncated octahedron | |
    /// | `diamond` | four nodes (1,1,1)/4, (1,-1,-1)/4, ... with four struts each; symmetry Td only | `axes` |
    /// | `cross` | `axes` | the three segments between midpoints of opposite edges |
    ///
    /// Planar elements have `edges` and `spokes`; wedges and pyramids also have `axes`. Any name may end in
    /// `_struts`, which distinguishes the diamond struts from the diamond surface.
    ///
    /// # Errors
    /// [`SkeletonError::Unknown`], which lists the names; [`SkeletonError::Radius`].
    pub fn graph(element: Element, name: &str, radius: f64) -> Result<Self, SkeletonError> {
        let known = graphs(element);
        let name = name.strip_suffix("_struts").unwrap_or(name);
        if !known.contains(&name) {
            return Err(SkeletonError::Unknown {
                kind: "graph",
                name: name.to_owned(),
                element: element.name(),
                known: known.join(", "),
            });
        }
        let vertices = element.vertices();
        let edges = element.edges();
        let edge_segments =
            |v: &[Vec3]| edges.iter().map(|&[a, b]| [v[a], v[b]]).collect::<Vec<_>>();
        let centroid = element.centroid().0;
        let spokes = |v: &[Vec3]| v.iter().map(|p| [centroid, *p]).collect::<Vec<_>>();
        let faces: Vec<Vec3> = face_corners(element)
            .iter()
            .map(|f| f.iter().sum::<Vec3>() / f.len() as f64)
            .collect();
        let hex = element == Element::Hex;
        // Neighbouring face centres of a hex, and neighbouring edge middles of a tet, are sqrt(1/2) apart.
        let nearest = 0.75;
        let struts: Vec<[Vec3; 2]> = match name {
            "edges" | "sc" => edge_segments(&vertices),
            "fcc" if !hex => edge_segments(&vertices),
            "spokes" | "bcc" => spokes(&vertices),
            "axes" => spokes(&faces),
            "cross" if hex => spokes(&faces),
            "diamond" if !hex => spokes(&faces),
            "fcc" => diagonals(),
            "octet" if hex => [diagonals(), pairs_within(&faces, nearest)].concat(),
            "octet" => {
                let middles: Vec<Vec3> = edge_segments(&vertices)
                    .iter()
                    .map(|[a, b]| (a + b) / 2.0)
                    .collect();
                [edge_segments(&vertices), pairs_within(&middles, nearest)].concat()
            }
            // The midpoints of opposite edges of a tet are opposite points.
            "cross" => edge_segments(&vertices)
                .iter()
                .map(|[a, b]| [(a + b) / 2.0, -(a + b) / 2.0])
                .collect(),
            "diamond" => diamond(),
            _ => kelvin(),
        };
        let mut skeleton = Self::new();
        for ends in struts {
            skeleton.strut(ends, radius)?;
        }
        Ok(skeleton)
    }

    /// The plate set of the given name in an element. All plates have the same thickness (reference lengths).
    ///
    /// `face_plates` are the element's faces, also named `sc_plates` in a hex; `bcc_plates` are the six
    /// planes {110} through the hex's centre; `fcc_plates` are the planes {111}: the faces of the two tets
    /// in a hex, or of the octahedron in a tet.
    ///
    /// # Errors
    /// [`SkeletonError::Unknown`], which lists the names; [`SkeletonError::Radius`].
    pub fn plates_of(element: Element, name: &str, thickness: f64) -> Result<Self, SkeletonError> {
        let known = plate_sets(element);
        if !known.contains(&name) {
            return Err(SkeletonError::Unknown {
                kind: "plates",
                name: name.to_owned(),
                element: element.name(),
                known: known.join(", "),
            });
        }
        let tet = Element::Tet.vertices();
        let plates: Vec<Vec<Vec3>> = match (name, element) {
            ("face_plates" | "sc_plates", _) => face_corners(element),
            ("fcc_plates", Element::Tet) => {
                // One plate per corner of the tet, through the midpoints of the corner's edges.
                let middle = |i: usize, j: usize| (tet[i] + tet[j]) / 2.0;
                let cut =
                    (0..4).map(|i| (0..4).filter(|&j| j != i).map(|j| middle(i, j)).collect());
                cut.chain(face_corners(element)).collect()
            }
            // In a hex the planes {111} are the faces of both tets in the cube.
            ("fcc_plates", _) => {
                let without = |v: &[Vec3], i: usize| {
                    (0..4).filter(|&j| j != i).map(|j| v[j]).collect::<Vec<_>>()
                };
                let other: Vec<Vec3> = tet.iter().map(|v| -v).collect();
                (0..4)
                    .flat_map(|i| [without(&tet, i), without(&other, i)])
                    .collect()
            }
            _ => diagonal_planes(),
        };
        let mut skeleton = Self::new();
        for corners in plates {
            skeleton.plate(corners, thickness / 2.0)?;
        }
        Ok(skeleton)
    }
}

/// All pairs of points closer than `distance`.
/// Each pair once; reference lengths.
fn pairs_within(points: &[Vec3], distance: f64) -> Vec<[Vec3; 2]> {
    let pairs = (0..points.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs
        .map(|(i, j)| [points[i], points[j]])
        .filter(|[a, b]| (a - b).norm() < distance)
        .collect()
}

/// Corners of every face of a solid element, in cyclic order.
/// Counterclockwise about the outward normal.
fn face_corners(element: Element) -> Vec<Vec<Vec3>> {
    let vertices = element.vertices();
    let around = |f: &druse_geometry::frame::Face| {
        let mut corners: Vec<Vec3> = element
            .face_vertices(f)
            .into_iter()
            .map(|i| vertices[i])
            .collect();
        let centre = corners.iter().sum::<Vec3>() / corners.len() as f64;
        let u = (corners[0] - centre).normalize();
        let v = f.normal.cross(&u);
        let angle = |p: &Vec3| (p - centre).dot(&v).atan2((p - centre).dot(&u));
        corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        corners
    };
    element.faces().iter().map(around).collect()
}

/// Corner `i` of the unit cube; the bits of `i` are the signs.
/// `i` is from 0 to 7.
fn corner(i: usize) -> Vec3 {
    Vec3::from_fn(|a, _| if i >> a & 1 == 1 { 0.5 } else { -0.5 })
}

/// The segments from the centre of every face of the unit cube to the four corners of that face.
/// Each diagonal of a face is two struts that meet at the centre.
fn diagonals() -> Vec<[Vec3; 2]> {
    let mut all = Vec::new();
    for axis in 0..3 {
        for side in [-0.5, 0.5] {
            let centre = Vec3::ith(axis, side);
            let corners = (0..8).map(corner).filter(|c| c[axis] == side);
            all.extend(corners.map(|c| [centre, c]));
        }
    }
    all
}

/// The six planes through the centre of the unit cube and two opposite edges.
/// Two planes for each pair of axes: v = u and v = -u.
fn diagonal_planes() -> Vec<Vec<Vec3>> {
    let mut all = Vec::new();
    for (u, v) in [(0, 1), (1, 2), (2, 0)] {
        let w = 3 - u - v;
        for sign in [1.0, -1.0] {
            let at = |s: f64, t: f64| {
                let mut p = Vec3::zeros();
                (p[u], p[v], p[w]) = (s, s * sign, t);
                p
            };
            all.push(vec![
                at(-0.5, -0.5),
                at(0.5, -0.5),
                at(0.5, 0.5),
                at(-0.5, 0.5),
            ]);
        }
    }
    all
}

/// Bonds of the diamond structure: from each node inside the cube to the nearest cube corner and the
/// three nearest face centres.
fn diamond() -> Vec<[Vec3; 2]> {
    let mut all = Vec::new();
    for s in [
        [1.0, 1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ] {
        let s = Vec3::from(s);
        let node = s / 4.0;
        all.push([node, s / 2.0]);
        all.extend((0..3).map(|a| [node, Vec3::ith(a, s[a] / 2.0)]));
    }
    all
}

/// Edges of the truncated octahedron, whose corners are the permutations of (0, 1/4, 1/2) with signs.
fn kelvin() -> Vec<[Vec3; 2]> {
    let mut corners = Vec::new();
    for zero in 0..3 {
        for (quarter, half) in [
            ((zero + 1) % 3, (zero + 2) % 3),
            ((zero + 2) % 3, (zero + 1) % 3),
        ] {
            for (s, t) in [(0.25, 0.5), (0.25, -0.5), (-0.25, 0.5), (-0.25, -0.5)] {
                let mut p = Vec3::zeros();
                (p[quarter], p[half]) = (s, t);
                corners.push(p);
            }
        }
    }
    // Neighbours are sqrt(2)/4 apart.
    pairs_within(&corners, 0.36)
}
