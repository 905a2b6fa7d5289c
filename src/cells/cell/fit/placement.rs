//! Placement of a source: the map from its own coordinates to the reference frame of its element.
//!
//! Every placement is an affine map. Uniform ones keep distances up to a factor; vertices may shear, after which values
//! are no distances any more. A map may mirror: triangles are reversed then.

use super::FitError;
use druse_geometry::frame::{Aabb, Element, Mat3, Vec3};
use druse_geometry::mesh::TriMesh;

/// The map from source coordinates to reference coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Placement {
    /// The identity.
    #[default]
    Reference,
    /// Uniform scaling of the source's bounding box onto the element's (the unit cube for tet and hex):
    /// centre onto centre, longest edge onto longest edge.
    Fit,
    /// x -> R (scale x) + translate.
    Similarity {
        /// The scale factor, applied first.
        scale: f64,
        /// Rotations about x, then y, then z, in degrees.
        rotate: [f64; 3],
        /// The translation, applied last, in reference units.
        translate: Vec3,
    },
    /// The element's vertices in source coordinates, in VTK order.
    Vertices(Vec<Vec3>),
}

/// x -> linear x + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::cell) struct Affine {
    linear: Mat3,
    offset: Vec3,
}

impl Affine {
    /// The image of a point.
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.linear * p + self.offset
    }

    /// The bounding box of the image of a box; empty for an empty one.
    pub fn bounds(&self, b: Aabb) -> Aabb {
        if b.is_empty() {
            return b;
        }
        let pick =
            |i: usize| Vec3::from_fn(|a, _| if i >> a & 1 == 1 { b.max[a] } else { b.min[a] });
        Aabb::of((0..8).map(|i| self.point(pick(i))))
    }

    /// The inverse map; placements are never singular.
    /// The map is checked when it is made, so that the identity in place of an inverse does not occur.
    pub fn inverse(&self) -> Self {
        let linear = self.linear.try_inverse().unwrap_or_else(Mat3::identity);
        Self {
            linear,
            offset: -(linear * self.offset),
        }
    }

    /// The factor of lengths: exact for a similarity, else the geometric mean.
    pub fn factor(&self) -> f64 {
        self.linear.determinant().abs().cbrt()
    }

    /// Whether all distances change by the same factor.
    /// The limit 1e-9 is relative to the squared factor.
    pub fn is_similarity(&self) -> bool {
        let f2 = self.factor().powi(2);
        (self.linear.tr_mul(&self.linear) - Mat3::from_diagonal_element(f2)).norm() < 1e-9 * f2
    }

    /// The mapped mesh. The orientation of triangles is reversed if the map mirrors.
    pub fn mesh(&self, mesh: &TriMesh) -> TriMesh {
        let moved = mesh.mapped(|p| self.linear * p + self.offset);
        if self.linear.determinant() < 0.0 {
            moved.flipped()
        } else {
            moved
        }
    }
}

impl Placement {
    /// The map for a source with these bounds.
    /// `bounds` is the source's box, which only [`Placement::Fit`] uses. An error for a box without size, numbers that
    /// are not finite, a scale that is not positive, and vertices that give no map.
    pub(in crate::cell) fn affine(
        &self,
        element: Element,
        bounds: Aabb,
    ) -> Result<Affine, FitError> {
        let fail = |text: String| Err(FitError::Placement(text));
        let (linear, offset) = match self {
            Self::Reference => (Mat3::identity(), Vec3::zeros()),
            Self::Fit => {
                // The longest edge of the source's box becomes that of the element's box, with equal centres.
                let longest = bounds.size().max();
                if !(longest.is_finite() && longest > 0.0) {
                    return fail(format!("the source's box has the longest edge {longest}"));
                }
                let element_box = element.cell_box();
                let scale = (element_box.max - element_box.min).max() / longest;
                let centre = (element_box.min + element_box.max) / 2.0;
                (
                    Mat3::from_diagonal_element(scale),
                    centre - bounds.centre().0 * scale,
                )
            }
            Self::Similarity {
                scale,
                rotate,
                translate,
            } => {
                if !(scale.is_finite() && *scale > 0.0) {
                    return fail(format!("scale is {scale}; expected a positive number"));
                }
                // x' = s Rz Ry Rx x + t: the rotation about x comes first.
                let angles = rotate.map(f64::to_radians);
                let [x, y, z] = [Vec3::x_axis(), Vec3::y_axis(), Vec3::z_axis()];
                let turn = nalgebra::Rotation3::from_axis_angle(&z, angles[2])
                    * nalgebra::Rotation3::from_axis_angle(&y, angles[1])
                    * nalgebra::Rotation3::from_axis_angle(&x, angles[0]);
                (turn.matrix() * *scale, *translate)
            }
            Self::Vertices(vertices) => return from_vertices(element, vertices),
        };
        let finite = linear.iter().chain(offset.iter()).all(|c| c.is_finite());
        if !finite {
            return fail("rotation and translation must be finite numbers".to_owned());
        }
        Ok(Affine { linear, offset })
    }
}

/// The affine map that takes the given vertices to those of the element.
/// Three edges from the first vertex give the map. Their determinant must exceed 1e-9 of the cubed size, and the other
/// vertices must lie within 1e-6 reference lengths. A planar element and another number of vertices are errors.
fn from_vertices(element: Element, vertices: &[Vec3]) -> Result<Affine, FitError> {
    let fail = |text: String| Err(FitError::Placement(text));
    let reference = element.vertices();
    if element.dimension() == 2 {
        return fail(format!(
            "the vertices of a {} span no volume; give scale, rotate and translate",
            element.name()
        ));
    }
    if vertices.len() != reference.len() {
        return fail(format!(
            "{} vertices for a {}; expected {}",
            vertices.len(),
            element.name(),
            reference.len()
        ));
    }
    // The edges from vertex 0 span the space.
    let edges: [usize; 3] = match element {
        Element::Hex | Element::Pyramid => [1, 3, 4],
        _ => [1, 2, 3],
    };
    // linear = E V^-1 for the edges V of the given and E of the reference vertices.
    let frame = |v: &[Vec3]| Mat3::from_columns(&edges.map(|e| v[e] - v[0]));
    let given = frame(vertices);
    let size = given.norm();
    let Some(inverse) = given
        .try_inverse()
        .filter(|_| given.determinant().abs() > 1e-9 * size.powi(3))
    else {
        return fail(format!(
            "the vertices span no volume (determinant {:e})",
            given.determinant()
        ));
    };
    let linear = frame(&reference) * inverse;
    let map = Affine {
        linear,
        offset: reference[0] - linear * vertices[0],
    };
    // Further vertices, as those of a hex, have to follow from the same map.
    for (i, (v, o)) in vertices.iter().zip(&reference).enumerate() {
        let miss = (map.linear * v + map.offset - o).norm();
        if miss.is_nan() || miss > 1e-6 {
            return fail(format!(
                "vertex {i} is off by {miss:e} reference units from where vertices 0, {}, {} and {} put it",
                edges[0], edges[1], edges[2]
            ));
        }
    }
    Ok(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placement_by_vertices_inverts_a_map() {
        for element in [Element::Tet, Element::Hex] {
            let m = Mat3::new(2.0, 0.3, 0.0, -0.1, -1.5, 0.2, 0.4, 0.0, 3.0);
            let t = Vec3::new(5.0, -6.0, 7.0);
            let moved: Vec<Vec3> = element.vertices().iter().map(|v| m * v + t).collect();
            let bounds = Aabb::of(moved.iter().copied());
            let back = Placement::Vertices(moved).affine(element, bounds).unwrap();
            assert!((back.linear * m - Mat3::identity()).norm() < 1e-12);
            assert!((back.linear * t + back.offset).norm() < 1e-12);
        }
    }

    #[test]
    fn rotations_apply_in_the_order_x_y_z() {
        let place = Placement::Similarity {
            scale: 2.0,
            rotate: [90.0, 90.0, 0.0],
            translate: Vec3::new(1.0, 0.0, 0.0),
        };
        let map = place.affine(Element::Hex, Aabb::EMPTY).unwrap();
        // y -> z (about x) -> x (about y), doubled and moved.
        let image = map.linear * Vec3::y() + map.offset;
        assert!((image - Vec3::new(3.0, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn singular_placements_are_errors() {
        let bounds = Aabb::of([Vec3::zeros(), Vec3::repeat(1.0)]);
        let flat = Element::Tet
            .vertices()
            .iter()
            .map(|v| Vec3::new(v.x, v.y, 0.0))
            .collect();
        let mut bent = Element::Hex.vertices();
        bent[6] *= 1.1;
        for (element, place) in [
            (Element::Tet, Placement::Vertices(flat)),
            (Element::Tet, Placement::Vertices(vec![Vec3::zeros(); 3])),
            (Element::Hex, Placement::Vertices(bent)),
        ] {
            assert!(matches!(
                place.affine(element, bounds),
                Err(FitError::Placement(_))
            ));
        }
        let point = Aabb::of([Vec3::zeros()]);
        assert!(Placement::Fit.affine(Element::Hex, point).is_err());
    }
}
