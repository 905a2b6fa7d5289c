//! Reference elements: the domains of unit cells.
//!
//! Every element has unit edges, except the tet, which is inscribed in the unit cube (edge sqrt 2). The
//! origin is the fixed point of all symmetries of the element: the centroid, or for the pyramid the centre
//! of its base. The ball is not an element of scaffolds; it is the domain of isolated cells.

use super::{CellBox, CellPoint, Mat3, Vec3};
use std::sync::OnceLock;

/// sqrt(3)/2, the height of the equilateral triangle of edge 1.
const TRIANGLE_HEIGHT: f64 = 0.866_025_403_784_438_6;
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
const BALL_RADIUS: f64 = 0.5;

/// A kind of reference element. Second-order scaffold elements use the cell of their linear counterpart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Element {
    /// Equilateral triangle of edge 1.
    Tri,
    /// Unit square.
    Quad,
    /// Regular tetrahedron of edge sqrt 2.
    Tet,
    /// Unit cube.
    Hex,
    /// Right prism of height 1 over the triangle.
    Wedge,
    /// Half an octahedron of edge 1: the unit square at z = 0, the apex at z = 1/sqrt 2.
    Pyramid,
    /// Ball of diameter 1, the domain of a single isolated cell. Its vertices, edges and faces are those of the
    /// inscribed icosahedron; six of its edges cross the axes at right angles and are parallel to other axes.
    Ball,
}

/// A face of a reference element: the plane `normal . x = offset`, with outward normal. The faces of a
/// planar element are its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit outward normal.
    pub normal: Vec3,
    /// Distance of the plane from the origin.
    pub offset: f64,
}

impl Element {
    /// The elements of scaffolds.
    pub const SCAFFOLD_ELEMENTS: [Self; 6] = [
        Self::Tri,
        Self::Quad,
        Self::Tet,
        Self::Hex,
        Self::Wedge,
        Self::Pyramid,
    ];

    /// The name used on the command line and in files.
    #[inline]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tri => "tri",
            Self::Quad => "quad",
            Self::Tet => "tet",
            Self::Hex => "hex",
            Self::Wedge => "wedge",
            Self::Pyramid => "pyramid",
            Self::Ball => "ball",
        }
    }

    /// The element with the given name.
    #[inline]
    pub fn from_name(name: &str) -> Option<Self> {
        let mut all = Self::SCAFFOLD_ELEMENTS.into_iter().chain([Self::Ball]);
        all.find(|e| e.name() == name)
    }

    /// Dimension of the reference space.
    #[inline]
    pub const fn dimension(self) -> usize {
        match self {
            Self::Tri | Self::Quad => 2,
            Self::Tet | Self::Hex | Self::Wedge | Self::Pyramid | Self::Ball => 3,
        }
    }

    /// Vertices in VTK order; planar elements have z = 0. Coordinates are of the cell frame, in reference lengths;
    /// those of a ball are the twelve vertices of an icosahedron.
    pub fn vertices(self) -> Vec<Vec3> {
        let v = |x, y, z| Vec3::new(x, y, z);
        let triangle = |z| {
            [
                v(-0.5, -TRIANGLE_HEIGHT / 3.0, z),
                v(0.5, -TRIANGLE_HEIGHT / 3.0, z),
                v(0.0, TRIANGLE_HEIGHT * 2.0 / 3.0, z),
            ]
        };
        let square = |z| {
            [
                v(-0.5, -0.5, z),
                v(0.5, -0.5, z),
                v(0.5, 0.5, z),
                v(-0.5, 0.5, z),
            ]
        };
        match self {
            Self::Tri => triangle(0.0).to_vec(),
            Self::Quad => square(0.0).to_vec(),
            // Alternate corners of the cube.
            Self::Tet => {
                vec![
                    v(-0.5, -0.5, -0.5),
                    v(0.5, 0.5, -0.5),
                    v(-0.5, 0.5, 0.5),
                    v(0.5, -0.5, 0.5),
                ]
            }
            Self::Hex => [-0.5, 0.5].into_iter().flat_map(square).collect(),
            Self::Wedge => [-0.5, 0.5].into_iter().flat_map(triangle).collect(),
            Self::Pyramid => {
                let mut all = square(0.0).to_vec();
                all.push(v(0.0, 0.0, 0.5f64.sqrt()));
                all
            }
            Self::Ball => cyclic_permutations([0.0, 1.0, GOLDEN_RATIO])
                .map(|p| p.normalize() * BALL_RADIUS)
                .collect(),
        }
    }

    /// Bounding faces; for a planar element, its edges in the order of its vertices. The faces of a tet
    /// have no fixed relation to its vertices. Hex faces are in the order x-, x+, y-, y+, z-, z+. Wedge
    /// faces are both triangles, then the sides over the edges 01, 12, 20; pyramid faces are the base, then
    /// the triangles over the edges 01, 12, 23, 30 (VTK order).
    pub fn faces(self) -> Vec<Face> {
        let face = |n: Vec3, offset| Face {
            normal: n.normalize(),
            offset,
        };
        // The outward normals of the sides; `z` tilts those of a pyramid.
        let of_square = |z: f64, offset: f64| {
            [[0., -1.], [1., 0.], [0., 1.], [-1., 0.]]
                .map(|[x, y]| face(Vec3::new(x, y, z), offset))
        };
        let of_triangle = || {
            [[0., -1.], [TRIANGLE_HEIGHT, 0.5], [-TRIANGLE_HEIGHT, 0.5]]
                .map(|[x, y]| face(Vec3::new(x, y, 0.0), TRIANGLE_HEIGHT / 3.0))
        };
        match self {
            Self::Tri => of_triangle().to_vec(),
            Self::Quad => of_square(0.0, 0.5).to_vec(),
            // Four of the eight (+-1, +-1, +-1), on the planes n.x = 1/2.
            Self::Tet => [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]]
                .map(|n| face(Vec3::from(n), 0.5 / 3f64.sqrt()))
                .to_vec(),
            Self::Hex => (0..3)
                .flat_map(|a| [-1.0, 1.0].map(|s| face(Vec3::ith(a, s), 0.5)))
                .collect(),
            Self::Wedge => {
                let mut all = vec![face(-Vec3::z(), 0.5), face(Vec3::z(), 0.5)];
                all.extend(of_triangle());
                all
            }
            // The sides rise by sqrt(1/2) over half a base edge: 1/sqrt 6 from the base's centre.
            Self::Pyramid => {
                let mut all = vec![face(-Vec3::z(), 0.0)];
                all.extend(of_square(0.5f64.sqrt(), 6f64.sqrt().recip()));
                all
            }
            // The inradius of the icosahedron. Its normals are the vertices of a dodecahedron.
            Self::Ball => {
                let offset = BALL_RADIUS * GOLDEN_RATIO * GOLDEN_RATIO
                    / (3.0 * (1.0 + GOLDEN_RATIO * GOLDEN_RATIO)).sqrt();
                let corners = (0..8).map(|n| {
                    Vec3::from([1, 2, 4].map(|bit| if n & bit == 0 { 1.0 } else { -1.0 }))
                });
                let others = cyclic_permutations([0.0, GOLDEN_RATIO, GOLDEN_RATIO.recip()]);
                corners.chain(others).map(|n| face(n, offset)).collect()
            }
        }
    }

    /// Indices of the vertices of a face, ascending: those within 1e-9 reference lengths of its plane.
    #[inline]
    pub fn face_vertices(self, face: &Face) -> Vec<usize> {
        let on = |v: &Vec3| (face.normal.dot(v) - face.offset).abs() < 1e-9;
        let vertices = self.vertices();
        (0..vertices.len()).filter(|&i| on(&vertices[i])).collect()
    }

    /// The edges as pairs of vertex indices, the lower index first.
    #[inline]
    pub fn edges(self) -> Vec<[usize; 2]> {
        let faces: Vec<Vec<usize>> = self.faces().iter().map(|f| self.face_vertices(f)).collect();
        let shared = |i, j| {
            let both = |f: &&Vec<usize>| f.contains(&i) && f.contains(&j);
            faces.iter().filter(both).count()
        };
        // An edge lies in two faces of a solid element; of a planar one it is a face itself.
        let n = self.vertices().len();
        (0..n)
            .flat_map(|j| (0..j).map(move |i| [i, j]))
            .filter(|&[i, j]| shared(i, j) + 1 == self.dimension())
            .collect()
    }

    /// Area of a planar element, volume of a solid one.
    #[inline]
    pub fn measure(self) -> f64 {
        match self {
            Self::Tri | Self::Wedge => TRIANGLE_HEIGHT / 2.0,
            Self::Quad | Self::Hex => 1.0,
            Self::Tet => 1.0 / 3.0,
            Self::Pyramid => 2f64.sqrt() / 6.0,
            Self::Ball => std::f64::consts::PI / 6.0,
        }
    }

    /// Length of an edge; the circumradius of an icosahedron is sqrt(1 + phi^2) / 2 edges.
    #[inline]
    pub fn edge(self) -> f64 {
        match self {
            Self::Tet => 2f64.sqrt(),
            Self::Ball => 2.0 * BALL_RADIUS / (1.0 + GOLDEN_RATIO * GOLDEN_RATIO).sqrt(),
            _ => 1.0,
        }
    }

    /// The centroid: the origin, except for the pyramid, where it is a quarter of the height above it.
    #[inline]
    pub fn centroid(self) -> CellPoint<3> {
        CellPoint(match self {
            Self::Pyramid => Vec3::z() * (0.5f64.sqrt() / 4.0),
            _ => Vec3::zeros(),
        })
    }

    /// Number of orthogonal maps of the element onto itself; those of a planar element leave z unchanged, and those of a
    /// ball map its icosahedron onto itself.
    #[inline]
    pub const fn symmetry_order(self) -> usize {
        match self {
            Self::Tri => 6,
            Self::Quad | Self::Pyramid => 8,
            Self::Tet => 24,
            Self::Hex => 48,
            Self::Wedge => 12,
            Self::Ball => 120,
        }
    }

    /// Whether an orthogonal map about the origin maps the element's vertices (a ball's: its icosahedron's) onto
    /// themselves, within 1e-6 reference lengths.
    #[inline]
    pub fn is_invariant_under(self, map: &Mat3) -> bool {
        let vertices = self.vertices();
        vertices.iter().all(|v| {
            let image = map * v;
            vertices.iter().any(|w| (image - w).norm() < 1e-6)
        })
    }

    /// Bounding box: the unit cube for tet, hex and ball; flat, at z = 0, for planar elements.
    #[inline]
    pub fn cell_box(self) -> CellBox<3> {
        // The box is cached, since hot loops use it.
        static BOXES: [OnceLock<CellBox<3>>; 7] = [const { OnceLock::new() }; 7];
        *BOXES[self as usize].get_or_init(|| match self {
            Self::Ball => Self::Hex.cell_box(),
            _ => CellBox::of(self.vertices().into_iter().map(CellPoint)),
        })
    }

    /// Largest signed distance of a point to the planes of the faces, negative inside. Planar elements
    /// ignore z. For the ball it is the distance to the sphere.
    #[inline]
    pub fn face_distance(self, p: CellPoint<3>) -> f64 {
        let x = p.0;
        // This compiles to one instruction, unlike `f64::max`.
        let greater = |a: f64, b: f64| if a > b { a } else { b };
        // |x| stands for both upper sides of the triangle, -y for its base.
        let triangle =
            || (x.x.abs() * TRIANGLE_HEIGHT + x.y * 0.5).max(-x.y) - TRIANGLE_HEIGHT / 3.0;
        match self {
            Self::Tet => {
                let one = greater(x.x + x.y + x.z, x.x - x.y - x.z);
                let other = greater(-x.x + x.y - x.z, -x.x - x.y + x.z);
                (greater(one, other) - 0.5) / 3f64.sqrt()
            }
            Self::Hex => greater(greater(x.x.abs(), x.y.abs()), x.z.abs()) - 0.5,
            Self::Quad => x.x.abs().max(x.y.abs()) - 0.5,
            Self::Tri => triangle(),
            Self::Wedge => triangle().max(x.z.abs() - 0.5),
            Self::Ball => x.norm() - BALL_RADIUS,
            Self::Pyramid => {
                let across = x.x.abs().max(x.y.abs());
                ((2.0 * across + 2f64.sqrt() * x.z - 1.0) / 6f64.sqrt()).max(-x.z)
            }
        }
    }
}

/// The twelve points (0, +-b, +-c) in their three cyclic orders; `a` is 0.
fn cyclic_permutations([a, b, c]: [f64; 3]) -> impl Iterator<Item = Vec3> {
    (0..12).map(move |n| {
        let sign = |bit: i32| if n & bit == 0 { 1.0 } else { -1.0 };
        let p = [a, b * sign(1), c * sign(2)];
        let turn = n as usize / 4;
        Vec3::from_fn(|i, _| p[(i + turn) % 3])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_bound_the_vertices_and_agree_with_face_distance() {
        for e in Element::SCAFFOLD_ELEMENTS {
            let faces = e.faces();
            let mut points = e.vertices();
            points.extend([Vec3::new(0.1, -0.3, 0.2), Vec3::new(-0.9, 0.4, 0.6)]);
            for v in points {
                let d = faces
                    .iter()
                    .map(|f| f.normal.dot(&v) - f.offset)
                    .fold(f64::MIN, f64::max);
                assert!((e.face_distance(CellPoint(v)) - d).abs() < 1e-15, "{e:?}");
            }
            for f in &faces {
                assert!(e.face_vertices(f).len() >= e.dimension(), "{e:?} {f:?}");
            }
            assert!(e.face_distance(e.centroid()) < -0.1);
        }
    }

    #[test]
    fn vertices_and_faces_of_the_ball_are_those_of_an_icosahedron() {
        let vertices = Element::Ball.vertices();
        assert_eq!(vertices.len(), 12);
        assert!(vertices.iter().all(|v| (v.norm() - 0.5).abs() < 1e-15));
        let faces = Element::Ball.faces();
        assert_eq!(faces.len(), 20);
        for f in &faces {
            assert_eq!(Element::Ball.face_vertices(f).len(), 3, "{f:?}");
            assert!(vertices.iter().all(|v| f.normal.dot(v) <= f.offset + 1e-12));
        }
        assert_eq!(Element::from_name("ball"), Some(Element::Ball));
    }

    #[test]
    fn edges_have_the_expected_length_and_number() {
        let all = Element::SCAFFOLD_ELEMENTS
            .into_iter()
            .chain([Element::Ball]);
        for (e, count) in all.zip([3, 4, 6, 12, 9, 8, 30]) {
            let v = e.vertices();
            assert_eq!(e.edges().len(), count, "{e:?}");
            for [i, j] in e.edges() {
                assert!(((v[i] - v[j]).norm() - e.edge()).abs() < 1e-12, "{e:?}");
            }
        }
    }

    #[test]
    fn symmetries_permute_the_vertices() {
        // The reflection of x is a symmetry of all but the tet; the cyclic permutation of the axes, of tet and hex.
        let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let cycle = Mat3::new(0., 0., 1., 1., 0., 0., 0., 1., 0.);
        for e in Element::SCAFFOLD_ELEMENTS {
            assert_eq!(e.is_invariant_under(&mirror), e != Element::Tet);
            assert_eq!(
                e.is_invariant_under(&cycle),
                matches!(e, Element::Tet | Element::Hex)
            );
        }
    }
}
