//! Continuation of a source from its element over the whole period, for fits by Fourier transform.
//!
//! | element | lattice | continued by | result |
//! |---|---|---|---|
//! | quad, hex | square, cubic | nothing: the element is the period | |
//! | tri, wedge | hex2, hexprism | reflection in the sides | continuous |
//! | tet | fcc2 | reflection in the cube's faces, then in the tet's | continuous, space group Fm-3m |
//! | tet | cubic | nothing: the source is given in the whole cube | |
//! | tet, method `paper` | cubic | reflection of the cube's corners in the tet's faces | jumps where opposite faces of the cube meet |

use super::FitError;
use druse_geometry::frame::{Element, Vec3};

/// The map from points of the period to points at which the source is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cell) enum Extension {
    /// The identity.
    Natural,
    /// Reflection into the triangle; the third coordinate stays unchanged.
    Triangle,
    /// Reflection of the corners of the unit cube in the faces of the tet, into the tet.
    Mirror,
    /// Reflection of all of space into the tet, with period 2.
    Fold,
}

impl Extension {
    /// The extension of an element's source over the period of a lattice.
    pub fn of(element: Element, lattice: &str, paper: bool) -> Result<Self, FitError> {
        match (element, lattice) {
            (Element::Tet, "cubic") if paper => Ok(Self::Mirror),
            (Element::Quad | Element::Hex, _) | (Element::Tet, "cubic") => Ok(Self::Natural),
            (Element::Tet, "fcc2") if !paper => Ok(Self::Fold),
            (Element::Tri, "hex2") | (Element::Wedge, "hexprism") => Ok(Self::Triangle),
            _ => Err(FitError::NoExtension {
                element: element.name(),
                lattice: lattice.to_owned(),
                method: if paper { "paper" } else { "fft" },
            }),
        }
    }

    /// An orthogonal periodic box of an element's cell about the origin, and the extension over it.
    pub fn box_of(element: Element) -> Result<(Vec3, Self), FitError> {
        Ok(match element {
            Element::Hex => (Vec3::new(1.0, 1.0, 1.0), Self::Natural),
            Element::Tet => (Vec3::new(2.0, 2.0, 2.0), Self::Fold),
            Element::Wedge => (Vec3::new(1.0, 3f64.sqrt(), 1.0), Self::Triangle),
            _ => {
                return Err(FitError::NoExtension {
                    element: element.name(),
                    lattice: "any".to_owned(),
                    method: "minkowski",
                });
            }
        })
    }

    /// The point at which the source is evaluated.
    pub fn inner(self, x: Vec3) -> Vec3 {
        match self {
            Self::Natural => x,
            Self::Triangle => fold_triangle(x),
            Self::Mirror => mirror(x),
            Self::Fold => fold(x),
        }
    }
}

/// Reflects the corners of the unit cube in the faces n.x = 1/2 of the tet, |n|^2 = 3. Points on a face stay, up to
/// rounding.
fn mirror(mut x: Vec3) -> Vec3 {
    for n in [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]].map(Vec3::from) {
        let excess = x.dot(&n) - 0.5;
        if excess > 1e-14 {
            x -= n * (2.0 / 3.0 * excess);
        }
    }
    x
}

/// Reflects space in the faces of the unit cubes into the cube at the origin, then into the tet.
fn fold(x: Vec3) -> Vec3 {
    mirror(x.map(|c| {
        let y = (c + 0.5).rem_euclid(2.0);
        if y > 1.0 { 1.5 - y } else { y - 0.5 }
    }))
}

/// Reflects the plane in the sides of the triangles of edge 1 into the triangle at the origin.
fn fold_triangle(x: Vec3) -> Vec3 {
    let corners = Element::Tri.vertices();
    let height = 3f64.sqrt() / 2.0;
    let b = (x.y - corners[0].y) / height;
    let a = (x.x - corners[0].x) - b / 2.0;
    let (a, b) = (a.rem_euclid(1.0), b.rem_euclid(1.0));
    let weights = if a + b <= 1.0 {
        [1.0 - a - b, a, b]
    } else {
        [a + b - 1.0, 1.0 - b, 1.0 - a]
    };
    let folded: Vec3 = corners.iter().zip(weights).map(|(c, w)| c * w).sum();
    Vec3::new(folded.x, folded.y, x.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::frame::CellPoint;
    use serde_json::Value;

    fn vec3(v: &Value) -> Vec3 {
        Vec3::from_fn(|i, _| v[i].as_f64().unwrap())
    }

    #[test]
    fn extensions_agree_with_the_reference() {
        let data: Value =
            serde_json::from_str(include_str!("../../../../tests/data/tet_fit.json")).unwrap();
        let case = &data["cases"][0];
        let vertices = Element::Tet.vertices();
        let struts = |p: Vec3| {
            let reach = |v: &Vec3| (p - v * (p.dot(v) / v.norm_squared()).clamp(0.0, 1.0)).norm();
            let nearest = vertices.iter().map(reach).fold(f64::INFINITY, f64::min);
            (p.norm() - 0.15).min(nearest - 0.07)
        };
        for (n, p) in case["fold_points"].as_array().unwrap().iter().enumerate() {
            let inner = fold(vec3(p));
            assert!((inner - vec3(&case["folded"][n])).norm() < 1e-12);
            assert!((struts(inner) - case["fold_value"][n].as_f64().unwrap()).abs() < 1e-12);
        }
        for (n, xy) in case["xy"].as_array().unwrap().iter().enumerate() {
            let at = |z: f64| Vec3::new(xy[0].as_f64().unwrap(), xy[1].as_f64().unwrap(), z);
            let number = |key: &str| case[key][n].as_f64().unwrap();
            let (top, bottom) = (struts(mirror(at(0.5))), struts(mirror(at(-0.5))));
            assert!((top - number("mirror_at_z=+1/2")).abs() < 1e-12);
            assert!((bottom - number("mirror_at_z=-1/2")).abs() < 1e-12);
            assert!(((top - bottom).abs() - number("jump")).abs() < 1e-12);
            let folded = number("fold_values_continuous_at_z=1/2");
            assert!((struts(fold(at(0.5))) - folded).abs() < 2e-9);
        }
    }

    #[test]
    fn folded_points_are_inside_and_inside_points_stay_fixed() {
        for n in 0..500u32 {
            let t = f64::from(n);
            let x = Vec3::new((t * 0.618).sin(), (t * 0.414).cos(), (t * 0.732).sin()) * 3.0;
            let inner = fold(x);
            assert!(Element::Tet.face_distance(CellPoint(inner)) < 1e-12);
            assert!((fold(inner) - inner).norm() < 1e-12);
            let flat = fold_triangle(x);
            assert!((fold_triangle(flat) - flat).norm() < 1e-12 && flat.z == x.z);
        }
    }
}
