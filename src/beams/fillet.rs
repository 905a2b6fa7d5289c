//! Rounded corners where beams and plates meet.
//!
//! Two parts at distances d1 and d2 below the radius R, with directions g1 and g2 away from them, are taken for
//! planes: a ball of radius R that touches both from outside has its centre at the displacement x with
//! x g1 = R - d1 and x g2 = R - d2, and the value is R - |x|. That is the exact distance to the rounded corner
//! of planes; nothing farther than R from either part changes. Where one plane alone holds the ball away, and
//! so along a straight strut, the union is left as it is. Of three and more parts the pair that fills most
//! counts.

use super::part::Part;
use crate::frame::Vec3;

/// Least sine squared of the angle between two directions that are taken for different.
const PARALLEL: f64 = 1e-9;

/// Value and gradient of the rounded union of two parts; `None` where it is the plain union.
fn corner([(d, g), (e, f)]: [(f64, Vec3); 2], radius: f64) -> Option<(f64, Vec3)> {
    let (a, b) = (radius - d, radius - e);
    let cosine = g.dot(&f);
    let square = 1.0 - cosine * cosine;
    let (u, v) = (a - b * cosine, b - a * cosine);
    if square <= PARALLEL || u <= 0.0 || v <= 0.0 {
        return None;
    }
    let x = (g * u + f * v) / square;
    let length = x.norm();
    // Between parts that face each other the ball never fits; no more than the radius is filled.
    let least = d.min(e) - radius;
    Some((
        (radius - length).max(least),
        x.try_normalize(0.0).unwrap_or_default(),
    ))
}

/// Value and gradient of the rounded union of some parts at a point, given those of the plain union.
pub(super) fn rounded<'a>(
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
            if let Some(found) = corner([first, second], radius).filter(|f| f.0 < best.0) {
                best = found;
            }
        }
    }
    best
}
