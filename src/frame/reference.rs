//! Reference elements: the shapes a unit cell lives in (mathematics.md 2.2).
//!
//! Origin at the centroid, hexes with edge 1, tets with edge sqrt 2 (inscribed in the unit cube).

use super::{CellBox, CellPoint, Vec3};

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
}

/// A face of a solid reference element: the plane `normal . x = offset`, normal pointing out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit outward normal.
    pub normal: Vec3,
    /// Distance of the plane from the centroid.
    pub offset: f64,
}

impl Element {
    /// Every reference element.
    pub const ALL: [Self; 4] = [Self::Tri, Self::Quad, Self::Tet, Self::Hex];

    /// The name used on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tri => "tri",
            Self::Quad => "quad",
            Self::Tet => "tet",
            Self::Hex => "hex",
        }
    }

    /// The element of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name)
    }

    /// Dimension of the reference space.
    pub const fn dimension(self) -> usize {
        match self {
            Self::Tri | Self::Quad => 2,
            Self::Tet | Self::Hex => 3,
        }
    }

    /// Vertices in VTK order; planar elements have z = 0.
    pub fn vertices(self) -> Vec<Vec3> {
        let s = 3f64.sqrt();
        let v = |x, y, z| Vec3::new(x, y, z);
        match self {
            Self::Tri => vec![
                v(-0.5, -s / 6.0, 0.0),
                v(0.5, -s / 6.0, 0.0),
                v(0.0, s / 3.0, 0.0),
            ],
            Self::Quad => {
                vec![
                    v(-0.5, -0.5, 0.0),
                    v(0.5, -0.5, 0.0),
                    v(0.5, 0.5, 0.0),
                    v(-0.5, 0.5, 0.0),
                ]
            }
            Self::Tet => {
                vec![
                    v(-0.5, -0.5, -0.5),
                    v(0.5, 0.5, -0.5),
                    v(-0.5, 0.5, 0.5),
                    v(0.5, -0.5, 0.5),
                ]
            }
            Self::Hex => [-0.5, 0.5]
                .into_iter()
                .flat_map(|z| {
                    [
                        v(-0.5, -0.5, z),
                        v(0.5, -0.5, z),
                        v(0.5, 0.5, z),
                        v(-0.5, 0.5, z),
                    ]
                })
                .collect(),
        }
    }

    /// Bounding faces of a solid element (empty for planar ones). Face `i` of a tet lies opposite
    /// no particular vertex; hex faces come in the order x-, x+, y-, y+, z-, z+.
    pub fn faces(self) -> Vec<Face> {
        let face = |n: Vec3, offset| Face {
            normal: n.normalize(),
            offset,
        };
        match self {
            Self::Tri | Self::Quad => Vec::new(),
            Self::Tet => [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]]
                .map(|n| face(Vec3::from(n), 0.5 / 3f64.sqrt()))
                .to_vec(),
            Self::Hex => (0..3)
                .flat_map(|a| [-1.0, 1.0].map(|s| face(Vec3::ith(a, s), 0.5)))
                .collect(),
        }
    }

    /// Length, area or volume of the element in its own dimension.
    pub fn measure(self) -> f64 {
        match self {
            Self::Tri => 3f64.sqrt() / 4.0,
            Self::Quad | Self::Hex => 1.0,
            Self::Tet => 1.0 / 3.0,
        }
    }

    /// Length of an edge.
    pub fn edge(self) -> f64 {
        if self == Self::Tet { 2f64.sqrt() } else { 1.0 }
    }

    /// Bounding box of a solid element: the unit cube for both.
    pub fn cell_box(self) -> CellBox<3> {
        CellBox::of(self.vertices().into_iter().map(CellPoint))
    }

    /// Largest signed distance of a point to the face planes of a solid element: <= 0 inside.
    pub fn face_distance(self, p: CellPoint<3>) -> f64 {
        let x = p.0;
        match self {
            Self::Tet => {
                let sums = [
                    x.x + x.y + x.z,
                    x.x - x.y - x.z,
                    -x.x + x.y - x.z,
                    -x.x - x.y + x.z,
                ];
                (sums.into_iter().fold(f64::NEG_INFINITY, f64::max) - 0.5) / 3f64.sqrt()
            }
            _ => x.amax() - 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_bound_the_vertices_and_agree_with_face_distance() {
        for e in [Element::Tet, Element::Hex] {
            let faces = e.faces();
            for v in e.vertices() {
                let d = faces
                    .iter()
                    .map(|f| f.normal.dot(&v) - f.offset)
                    .fold(f64::MIN, f64::max);
                assert!(d.abs() < 1e-15);
                assert!((e.face_distance(CellPoint(v)) - d).abs() < 1e-15);
            }
            let centroid: Vec3 = e.vertices().iter().sum();
            assert!(centroid.norm() < 1e-15);
        }
    }
}
