//! Vectors in single precision.
//!
//! Arrays rather than a matrix library: the kernels load their components into lanes. The dual basis of a, b, c is
//! (b x c, c x a, a x b) / (a . b x c): each of its vectors has the product 1 with one of them and 0 with the others.

/// Three components.
pub(super) type Vector = [f32; 3];

/// The dual basis of three unit vectors; none if they are nearly coplanar, with a volume of 0.05 or less: it would
/// magnify errors twenty times.
pub(super) fn dual([a, b, c]: [Vector; 3]) -> Option<[Vector; 3]> {
    let volume = dot(a, cross(b, c));
    (volume.abs() > 0.05)
        .then(|| [cross(b, c), cross(c, a), cross(a, b)].map(|v| v.map(|x| x / volume)))
}

pub(super) fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a + b.
pub(super) fn sum(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
#[doc(hidden)]
pub fn difference(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The vector product.
pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The unit vector in the same direction; none for a vector shorter than 0.9, which is no gradient of a distance.
pub(super) fn unit(v: Vector) -> Option<Vector> {
    let size = dot(v, v).sqrt();
    (size > 0.9).then(|| v.map(|c| c / size))
}
