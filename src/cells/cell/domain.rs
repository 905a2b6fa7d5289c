//! The fundamental domain of an element under a group: a few flags and a tetrahedral grid on each.
//!
//! A flag is the simplex (centroid, vertex, edge midpoint, face centre) of a vertex on an edge on a
//! face. The flags fill the element. No operator but the identity fixes a flag, so one flag per orbit
//! represents all its images, and averages of invariant functions are averages over these flags. Under
//! the element's full group there is 1 flag for tet and hex, 3 for the wedge, 4 for the pyramid. Points
//! are V0 + a (V1 - V0) + b (V2 - V1) + c (V3 - V2) with 1 >= a >= b >= c >= 0: a = 1 is the element's
//! face, a = 1 and c = 0 its edge. A flag of a planar element is the triangle (centroid, vertex, edge
//! midpoint), c = 0. Volumes of a planar cell refer to the prism over it, [`Domain::solid`].
//!
//! The flags of the ball are those of the inscribed icosahedron, mapped radially onto the sphere so that
//! equal volumes stay equal: a is the radius, and on the sphere a triangle is mapped onto the spherical
//! one by Arvo's sampling map (*Stratified sampling of spherical triangles*, 1995).

use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};

/// A simplex of the barycentric subdivision that represents its orbit.
#[derive(Clone, Debug)]
pub(super) struct Flag {
    /// Centroid, vertex, edge midpoint, face centre. For a planar element the last two coincide.
    pub corners: [Vec3; 4],
    /// The share of the element's volume that the flag and its images fill.
    pub share: f64,
    /// Whether the flag is mapped onto the sphere (flags of the ball).
    round: bool,
}

impl Flag {
    /// The point with ordered coordinates (a, b, c).
    pub fn point(&self, coordinates: [f64; 3]) -> CellPoint<3> {
        if self.round {
            spherical_point(&self.corners, coordinates)
        } else {
            point(&self.corners, coordinates)
        }
    }
}

/// The point of a flag of the ball. The corners of the flag on the icosahedron are a vertex, the middle
/// of an edge (where the spherical triangle has a right angle) and the centre of a face.
fn spherical_point(flag: &[Vec3; 4], [a, b, c]: [f64; 3]) -> CellPoint<3> {
    // Solid angle of a flag: the sphere divided by the number of flags.
    const ANGLE: f64 = std::f64::consts::PI / 30.0;
    let [vertex, edge, face] = [1, 2, 3].map(|i| flag[i].normalize());
    // The unit vector on the great circle through `from` and `to` at the angle acos(`cosine`) from `from`.
    let toward = |from: Vec3, to: Vec3, cosine: f64| {
        let across = (to - from * from.dot(&to)).try_normalize(1e-300);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        from * cosine + across.unwrap_or_default() * sine
    };
    // Arvo's map: the area beside the side from the vertex to the edge's middle, then the height within it.
    let area = if b > 0.0 { c / b } else { 0.0 } * ANGLE;
    let (cosine, side) = (libm::cos(area), edge.dot(&vertex));
    let on_side = toward(edge, face, (cosine - side) / (1.0 - side * cosine));
    let share = if a > 0.0 { b / a } else { 0.0 };
    let height = 1.0 - share * share * (1.0 - on_side.dot(&vertex));
    CellPoint(toward(vertex, on_side, height) * (a * flag[1].norm()))
}

/// One flag per orbit; the shares add up to 1.
#[derive(Clone, Debug)]
pub(super) struct Domain {
    pub flags: Vec<Flag>,
}

impl Domain {
    /// The domain of an element under a group of its symmetries.
    /// Points of two flags that coincide within 1e-8 are the same. `operators` contain the identity.
    pub fn new(element: Element, operators: &[Mat3]) -> Self {
        // Weights without symmetry give each flag a point that no operator but the identity keeps.
        let mut flags: Vec<([Vec3; 4], Vec3)> = all_flags(element)
            .into_iter()
            .map(|f| (f, f[1] * 0.5 + f[2] * 0.3 + f[3] * 0.2))
            .collect();
        // The first flag of an orbit is the one that reaches farthest along x, then y, then z.
        flags.sort_by(|(_, a), (_, b)| {
            let differs = (0..3).find(|&i| (a[i] - b[i]).abs() > 1e-9);
            differs.map_or(std::cmp::Ordering::Equal, |i| b[i].total_cmp(&a[i]))
        });
        // One flag of each orbit: the others are images of it.
        let mut chosen: Vec<([Vec3; 4], Vec3)> = Vec::new();
        for (corners, interior_point) in flags {
            let seen = chosen.iter().any(|(_, other)| {
                operators
                    .iter()
                    .any(|q| (q * other - interior_point).norm_squared() < 1e-16)
            });
            if !seen {
                chosen.push((corners, interior_point));
            }
        }
        let total: f64 = all_flags(element)
            .iter()
            .map(|f| measure(f, element.dimension()))
            .sum();
        // Each flag of the domain stands for as many flags as the group has operators.
        let images = operators.len() as f64 / total;
        Self {
            flags: chosen
                .into_iter()
                .map(|(corners, _)| Flag {
                    share: measure(&corners, element.dimension()) * images,
                    corners,
                    round: element == Element::Ball,
                })
                .collect(),
        }
    }

    /// The domain for volumes. For a planar element it is that of the prism of height 1 over the element,
    /// under the group extended by the reflection of z.
    /// Shares add up to 1 here too.
    pub fn solid(element: Element, operators: &[Mat3]) -> Self {
        let prism = match element {
            Element::Tri => Element::Wedge,
            Element::Quad => Element::Hex,
            _ => return Self::new(element, operators),
        };
        let flip = Mat3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0));
        let mut all = operators.to_vec();
        all.extend(operators.iter().map(|q| q * flip));
        Self::new(prism, &all)
    }
}

/// Area or volume of a flag.
/// The last corner does not count in the plane. Reference lengths squared or cubed.
fn measure(c: &[Vec3; 4], dimension: usize) -> f64 {
    let edges = [c[1] - c[0], c[2] - c[0], c[3] - c[0]];
    if dimension == 2 {
        edges[0].cross(&edges[1]).norm() / 2.0
    } else {
        edges[0].cross(&edges[1]).dot(&edges[2]).abs() / 6.0
    }
}

/// Every flag of an element.
/// Each as centroid, vertex, edge midpoint and face centre, two for each edge of each face.
pub(super) fn all_flags(element: Element) -> Vec<[Vec3; 4]> {
    let vertices = element.vertices();
    let centre = element.centroid().0;
    let middle =
        |of: &[usize]| -> Vec3 { of.iter().map(|&i| vertices[i]).sum::<Vec3>() / of.len() as f64 };
    let edges = element.edges();
    let mut flags = Vec::new();
    for face in element.faces() {
        let corners = element.face_vertices(&face);
        let on_face = |e: &&[usize; 2]| e.iter().all(|v| corners.contains(v));
        for edge in edges.iter().filter(on_face) {
            for &v in edge {
                flags.push([centre, vertices[v], middle(edge), middle(&corners)]);
            }
        }
    }
    flags
}

/// The point with ordered coordinates (a, b, c) in a flag.
/// 1 >= a >= b >= c >= 0 gives the points of the flag.
pub(super) fn point(flag: &[Vec3; 4], [a, b, c]: [f64; 3]) -> CellPoint<3> {
    CellPoint(flag[0] + (flag[1] - flag[0]) * a + (flag[2] - flag[1]) * b + (flag[3] - flag[2]) * c)
}

/// The lattice of points (i, j, k)/n, n >= i >= j >= k >= 0, of the simplex 1 >= a >= b >= c >= 0.
#[derive(Clone, Debug)]
pub(super) struct SimplexGrid {
    n: usize,
}

/// The six tetrahedra of a cube around its diagonal, each as the order of unit steps along the axes.
const CUBE_TETRAHEDRA: [[usize; 3]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

impl SimplexGrid {
    /// The lattice that divides each edge into `n` parts.
    pub fn new(n: usize) -> Self {
        Self { n }
    }

    /// Ordered coordinates of all points, in the order of [`SimplexGrid::index`].
    pub fn coordinates(&self) -> Vec<[f64; 3]> {
        let step = 1.0 / self.n as f64;
        let mut all = Vec::with_capacity(Self::index([self.n + 1, 0, 0]));
        for i in 0..=self.n {
            for j in 0..=i {
                for k in 0..=j {
                    all.push([i, j, k].map(|c| c as f64 * step));
                }
            }
        }
        all
    }

    /// The position of the point (i, j, k)/n in that order.
    /// Points with smaller i, then smaller j, come first.
    pub fn index([i, j, k]: [usize; 3]) -> usize {
        i * (i + 1) * (i + 2) / 6 + j * (j + 1) / 2 + k
    }

    /// Calls `visit` with the corners, in multiples of 1/n, of each of the n^3 tetrahedra.
    pub fn tetrahedra(&self, mut visit: impl FnMut([[usize; 3]; 4])) {
        for i in 0..self.n {
            Self::layer(i, &mut visit);
        }
    }

    /// The tetrahedra between a = i/n and (i + 1)/n; all have the same volume.
    pub fn layer(i: usize, mut visit: impl FnMut([[usize; 3]; 4])) {
        for j in 0..=i {
            for k in 0..=j {
                Self::cube([i, j, k], &mut visit);
            }
        }
    }

    /// The tetrahedra of the cube whose lowest corner is (i, j, k)/n. There are six if i > j > k;
    /// otherwise those outside the simplex are omitted.
    pub fn cube(least: [usize; 3], mut visit: impl FnMut([[usize; 3]; 4])) {
        let ordered = |c: &[usize; 3]| c[0] >= c[1] && c[1] >= c[2];
        for path in CUBE_TETRAHEDRA {
            let mut corners = [least; 4];
            for step in 0..3 {
                corners[step + 1] = corners[step];
                corners[step + 1][path[step]] += 1;
            }
            if corners.iter().all(ordered) {
                visit(corners);
            }
        }
    }

    /// Parts per edge.
    pub fn parts(&self) -> usize {
        self.n
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{default_group, groups, operators_of};

    fn operators(element: Element, group: &str) -> Vec<Mat3> {
        operators_of(element, group).unwrap()
    }

    #[test]
    fn flags_and_their_images_fill_the_element() {
        for element in Element::SCAFFOLD_ELEMENTS {
            for &name in groups(element) {
                let operators = operators(element, name);
                let domain = Domain::new(element, &operators);
                let total: f64 = domain.flags.iter().map(|f| f.share).sum();
                assert!((total - 1.0).abs() < 1e-12, "{element:?} {name}: {total}");
                for f in &domain.flags {
                    for c in &f.corners[1..] {
                        assert!(element.face_distance(CellPoint(*c)).abs() < 1e-12);
                    }
                }
                let solid = Domain::solid(element, &operators);
                let total: f64 = solid.flags.iter().map(|f| f.share).sum();
                assert!((total - 1.0).abs() < 1e-12, "{element:?} {name}: {total}");
            }
        }
        for (element, count) in [
            (Element::Tet, 1),
            (Element::Hex, 1),
            (Element::Wedge, 3),
            (Element::Pyramid, 4),
        ] {
            let whole = operators(element, default_group(element));
            assert_eq!(whole.len(), element.symmetry_order());
            assert_eq!(Domain::new(element, &whole).flags.len(), count);
        }
    }

    #[test]
    fn equal_parts_of_the_ball_have_equal_volumes() {
        let group = operators(Element::Ball, "Ih");
        assert_eq!(group.len(), 120);
        let domain = Domain::new(Element::Ball, &group);
        let [flag] = domain.flags.as_slice() else {
            panic!("{} flags", domain.flags.len());
        };
        assert!((flag.share - 1.0).abs() < 1e-12);
        let volume = |from: [f64; 3], step: f64| {
            let edge = |axis: usize| {
                let mut to = from;
                to[axis] += step;
                (flag.point(to).0 - flag.point(from).0) / step
            };
            edge(0).cross(&edge(1)).dot(&edge(2)).abs()
        };
        // A sixth of the unit cube is mapped onto the flag.
        let exact = 6.0 * Element::Ball.measure() / 120.0;
        for from in [
            [0.9, 0.5, 0.2],
            [0.6, 0.55, 0.1],
            [0.99, 0.98, 0.9],
            [0.5, 0.2, 0.19],
        ] {
            assert!((volume(from, 1e-6) / exact - 1.0).abs() < 1e-4, "{from:?}");
        }
        for (corner, at) in [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0; 3]].iter().zip(1..) {
            let direction = flag.corners[at].normalize();
            assert!((flag.point(*corner).0 - direction * 0.5).norm() < 1e-12);
        }
    }

    #[test]
    fn small_tetrahedra_fill_the_simplex() {
        let grid = SimplexGrid::new(5);
        let mut count = 0;
        grid.tetrahedra(|_| count += 1);
        assert_eq!(count, 125);
        for (n, c) in grid.coordinates().into_iter().enumerate() {
            let i = c.map(|v| (v * 5.0).round() as usize);
            assert_eq!(SimplexGrid::index(i), n);
        }
    }
}
