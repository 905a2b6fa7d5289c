//! Fillets at the corners where beams and plates meet.
//!
//! Two parts at distances d1 and d2 below the radius R, with directions g1 and g2 from them, are approximated by
//! planes. A ball of radius R that touches both from outside has its centre at the displacement x with x g1 = R - d1
//! and x g2 = R - d2, and the value is R - |x|. This is the exact distance to the rounded corner of the planes. Points
//! farther than R from either part keep their values. Where one plane alone supports the ball, and along a straight
//! strut, the union is unchanged. Of three and more parts, the pair with the smallest value counts.

use super::part::Part;
use druse_geometry::frame::Vec3;

/// Smallest squared sine of the angle between two distinct directions.
const MIN_SINE_SQUARED: f64 = 1e-9;

/// Value and gradient of the rounded union of two parts; `None` where it equals the plain union.
fn pair_fillet([(d, g), (e, f)]: [(f64, Vec3); 2], radius: f64) -> Option<(f64, Vec3)> {
    let (a, b) = (radius - d, radius - e);
    let cosine = g.dot(&f);
    let square = 1.0 - cosine * cosine;
    let (u, v) = (a - b * cosine, b - a * cosine);
    if square <= MIN_SINE_SQUARED || u <= 0.0 || v <= 0.0 {
        return None;
    }
    let x = (g * u + f * v) / square;
    let length = x.norm();
    // Between parts that face each other the ball never fits; the decrease is limited to the radius.
    let least = d.min(e) - radius;
    Some((
        (radius - length).max(least),
        x.try_normalize(0.0).unwrap_or_default(),
    ))
}

/// Value and gradient of the rounded union of parts at a point `p`, from those of the plain `union`. `near` is a
/// buffer. Lengths are in world units. Parts at least `radius` away make no fillet; of all pairs the least value
/// counts.
pub(super) fn with_fillets<'a>(
    parts: impl Iterator<Item = &'a Part>,
    p: Vec3,
    radius: f64,
    union: (f64, Vec3),
    near: &mut Vec<(f64, Vec3)>,
) -> (f64, Vec3) {
    near.clear();
    near.extend(parts.filter_map(|part| {
        let (d, centre) = part.nearest(p);
        let direction = (p - centre).try_normalize(0.0)?;
        (d < radius).then_some((d, direction))
    }));
    let mut best = union;
    for (n, &first) in near.iter().enumerate() {
        for &second in &near[n + 1..] {
            if let Some(found) = pair_fillet([first, second], radius).filter(|f| f.0 < best.0) {
                best = found;
            }
        }
    }
    best
}
