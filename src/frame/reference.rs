//! Reference elements: the shapes a unit cell lives in.
//!
//! Every element has unit edges, but for the tet, which is inscribed in the unit cube (edge sqrt 2).
//! The origin is the point that all symmetries of the element keep: the centroid, but for the
//! pyramid, whose origin is the centre of its base. The ball is no element of any scaffold: cells
//! that stand alone live in it.

use super::{CellBox, CellPoint, Mat3, Vec3};
use std::sync::OnceLock;

/// sqrt(3)/2, the height of the equilateral triangle of edge 1.
const H: f64 = 0.866_025_403_784_438_6;
/// The golden ratio.
const GOLDEN: f64 = 1.618_033_988_749_895;
/// Radius of the ball.
const RADIUS: f64 = 0.5;

/// A kind of reference element. Second-order scaffold elements share their linear one's cell.
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
    /// Ball of diameter 1, of which one stands alone. Its vertices, edges and faces are those of the
    /// icosahedron inscribed in it, whose edges are parallel to the axes where these meet them.
    Ball,
}

/// A face of a reference element: the plane `normal . x = offset`, normal pointing out. The faces of
/// a planar element are its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit outward normal.
    pub normal: Vec3,
    /// Distance of the plane from the origin.
    pub offset: f64,
}

impl Element {
    /// Every element that scaffolds are made of.
    pub const ALL: [Self; 6] = [
        Self::Tri,
        Self::Quad,
        Self::Tet,
        Self::Hex,
        Self::Wedge,
        Self::Pyramid,
    ];

    /// The name used on the command line and in files.
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

    /// The element of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        let mut all = Self::ALL.into_iter().chain([Self::Ball]);
        all.find(|e| e.name() == name)
    }

    /// Dimension of the reference space.
    pub const fn dimension(self) -> usize {
        match self {
            Self::Tri | Self::Quad => 2,
            Self::Tet | Self::Hex | Self::Wedge | Self::Pyramid | Self::Ball => 3,
        }
    }

    /// Vertices in VTK order; planar elements have z = 0.
    pub fn vertices(self) -> Vec<Vec3> {
        let v = |x, y, z| Vec3::new(x, y, z);
        let triangle = |z| {
            [
                v(-0.5, -H / 3.0, z),
                v(0.5, -H / 3.0, z),
                v(0.0, H * 2.0 / 3.0, z),
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
            Self::Ball => cycled([0.0, 1.0, GOLDEN])
                .map(|p| p.normalize() * RADIUS)
                .collect(),
        }
    }

    /// Bounding faces, of a planar element its edges in the order of its vertices. Face `i` of a tet
    /// lies opposite no particular vertex; hex faces come in the order x-, x+, y-, y+, z-, z+; wedge
    /// and pyramid faces in VTK order: both triangles, then the sides over the edges 01, 12, 20; the
    /// base, then the triangles over the edges 01, 12, 23, 30.
    pub fn faces(self) -> Vec<Face> {
        let face = |n: Vec3, offset| Face {
            normal: n.normalize(),
            offset,
        };
        let of_square = |z: f64, offset: f64| {
            [[0., -1.], [1., 0.], [0., 1.], [-1., 0.]]
                .map(|[x, y]| face(Vec3::new(x, y, z), offset))
        };
        let of_triangle =
            || [[0., -1.], [H, 0.5], [-H, 0.5]].map(|[x, y]| face(Vec3::new(x, y, 0.0), H / 3.0));
        match self {
            Self::Tri => of_triangle().to_vec(),
            Self::Quad => of_square(0.0, 0.5).to_vec(),
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
            Self::Pyramid => {
                let mut all = vec![face(-Vec3::z(), 0.0)];
                all.extend(of_square(0.5f64.sqrt(), 6f64.sqrt().recip()));
                all
            }
            Self::Ball => {
                let offset = RADIUS * GOLDEN * GOLDEN / (3.0 * (1.0 + GOLDEN * GOLDEN)).sqrt();
                let corners = (0..8).map(|n| {
                    Vec3::from([1, 2, 4].map(|bit| if n & bit == 0 { 1.0 } else { -1.0 }))
                });
                let others = cycled([0.0, GOLDEN, GOLDEN.recip()]);
                corners.chain(others).map(|n| face(n, offset)).collect()
            }
        }
    }

    /// Vertices of a face, by their numbers in ascending order.
    pub fn face_vertices(self, face: &Face) -> Vec<usize> {
        let on = |v: &Vec3| (face.normal.dot(v) - face.offset).abs() < 1e-9;
        let vertices = self.vertices();
        (0..vertices.len()).filter(|&i| on(&vertices[i])).collect()
    }

    /// Pairs of vertices that an edge joins, the lower number first.
    pub fn edges(self) -> Vec<[usize; 2]> {
        let faces: Vec<Vec<usize>> = self.faces().iter().map(|f| self.face_vertices(f)).collect();
        let shared = |i, j| {
            let both = |f: &&Vec<usize>| f.contains(&i) && f.contains(&j);
            faces.iter().filter(both).count()
        };
        let n = self.vertices().len();
        (0..n)
            .flat_map(|j| (0..j).map(move |i| [i, j]))
            .filter(|&[i, j]| shared(i, j) + 1 == self.dimension())
            .collect()
    }

    /// Area or volume of the element in its own dimension.
    pub fn measure(self) -> f64 {
        match self {
            Self::Tri | Self::Wedge => H / 2.0,
            Self::Quad | Self::Hex => 1.0,
            Self::Tet => 1.0 / 3.0,
            Self::Pyramid => 2f64.sqrt() / 6.0,
            Self::Ball => std::f64::consts::PI / 6.0,
        }
    }

    /// Length of an edge.
    pub fn edge(self) -> f64 {
        match self {
            Self::Tet => 2f64.sqrt(),
            Self::Ball => 2.0 * RADIUS / (1.0 + GOLDEN * GOLDEN).sqrt(),
            _ => 1.0,
        }
    }

    /// Centroid: the origin, of the pyramid a quarter of its height above it.
    pub fn centroid(self) -> CellPoint<3> {
        CellPoint(match self {
            Self::Pyramid => Vec3::z() * (0.5f64.sqrt() / 4.0),
            _ => Vec3::zeros(),
        })
    }

    /// How many orthogonal maps take the element to itself; a planar element's leave z in place.
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

    /// Whether an orthogonal map about the origin takes the element to itself.
    pub fn is_kept_by(self, map: &Mat3) -> bool {
        let vertices = self.vertices();
        vertices.iter().all(|v| {
            let image = map * v;
            vertices.iter().any(|w| (image - w).norm() < 1e-6)
        })
    }

    /// Bounding box: the unit cube for tet, hex and ball.
    pub fn cell_box(self) -> CellBox<3> {
        // Asked for in every image of a box.
        static BOXES: [OnceLock<CellBox<3>>; 7] = [const { OnceLock::new() }; 7];
        *BOXES[self as usize].get_or_init(|| match self {
            Self::Ball => Self::Hex.cell_box(),
            _ => CellBox::of(self.vertices().into_iter().map(CellPoint)),
        })
    }

    /// Largest signed distance of a point to the planes of the faces: <= 0 inside. Planar elements
    /// do not regard z; that of the ball is the distance to the sphere.
    #[inline]
    pub fn face_distance(self, p: CellPoint<3>) -> f64 {
        let x = p.0;
        // One instruction, unlike `f64::max`.
        let greater = |a: f64, b: f64| if a > b { a } else { b };
        let triangle = || (x.x.abs() * H + x.y * 0.5).max(-x.y) - H / 3.0;
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
            Self::Ball => x.norm() - RADIUS,
            Self::Pyramid => {
                let across = x.x.abs().max(x.y.abs());
                ((2.0 * across + 2f64.sqrt() * x.z - 1.0) / 6f64.sqrt()).max(-x.z)
            }
        }
    }
}

/// The twelve points (0, +-b, +-c) and those with the coordinates in turn.
fn cycled([a, b, c]: [f64; 3]) -> impl Iterator<Item = Vec3> {
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
        for e in Element::ALL {
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
    fn the_ball_holds_an_icosahedron() {
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
    fn edges_have_their_length_and_number() {
        let all = Element::ALL.into_iter().chain([Element::Ball]);
        for (e, count) in all.zip([3, 4, 6, 12, 9, 8, 30]) {
            let v = e.vertices();
            assert_eq!(e.edges().len(), count, "{e:?}");
            for [i, j] in e.edges() {
                assert!(((v[i] - v[j]).norm() - e.edge()).abs() < 1e-12, "{e:?}");
            }
        }
    }

    #[test]
    fn symmetries_keep_the_vertices() {
        // The reflection that exchanges x and -x keeps all but the tet, whose are cyclic.
        let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let cycle = Mat3::new(0., 0., 1., 1., 0., 0., 0., 1., 0.);
        for e in Element::ALL {
            assert_eq!(e.is_kept_by(&mirror), e != Element::Tet);
            assert_eq!(
                e.is_kept_by(&cycle),
                matches!(e, Element::Tet | Element::Hex)
            );
        }
    }
}
