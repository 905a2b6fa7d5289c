//! Placement of USD prims: their transform operations, and the values of properties at a time code.
//! Matrices act on column vectors, while USD writes them for row vectors. Angles are in degrees.

use super::text::{Prim, Property, Value};
use druse_geometry::frame::Vec3;
use nalgebra::{Matrix4, Quaternion, Rotation3, UnitQuaternion};

/// The value of a property at a time code: linear between samples of equal length, constant beyond them; tokens,
/// strings and samples of different lengths keep the sample before. Without a time code the default, else the first
/// sample. `None` for a property without value and samples.
pub(super) fn value_at(property: &Property, time: Option<f64>) -> Option<Value> {
    let samples = &property.samples;
    let (Some(t), Some(first), Some(last)) = (time, samples.first(), samples.last()) else {
        let first = samples.first().map(|s| &s.1);
        return property.value.as_ref().or(first).cloned();
    };
    let after = samples.partition_point(|s| s.0 < t);
    if after == 0 {
        return Some(first.1.clone());
    }
    let Some((t1, next)) = samples.get(after) else {
        return Some(last.1.clone());
    };
    let (t0, previous) = &samples[after - 1];
    let (a, b) = (previous.numbers(), next.numbers());
    if a.is_empty() || a.len() != b.len() {
        // The word that holds up to the next sample.
        return Some(if *t1 == t {
            next.clone()
        } else {
            previous.clone()
        });
    }
    let share = (t - t0) / (t1 - t0);
    let mixed = a.iter().zip(b).map(|(a, b)| a + (b - a) * share);
    Some(Value::Numbers(mixed.collect()))
}

/// The map from a prim's coordinates to those of its parent (on column vectors), and whether it ignores its parent's
/// map; or what is wrong with it. A prim without `xformOpOrder` has the identity.
pub(super) fn local(prim: &Prim, time: Option<f64>) -> Result<(Matrix4<f64>, bool), String> {
    let mut map = Matrix4::identity();
    let mut is_reset = false;
    let order = prim
        .properties
        .get("xformOpOrder")
        .and_then(|p| value_at(p, time));
    // Operations apply from the last to the first, as products of matrices do. A reset ignores those of the parents.
    for word in order.iter().flat_map(Value::words) {
        if word == "!resetXformStack!" {
            (map, is_reset) = (Matrix4::identity(), true);
            continue;
        }
        let name = word.strip_prefix("!invert!").unwrap_or(word);
        let value = prim.properties.get(name).and_then(|p| value_at(p, time));
        let value = value.ok_or_else(|| format!("no value of {name}"))?;
        let operation = operation(name, value.numbers())
            .ok_or_else(|| format!("{name} with {} numbers", value.numbers().len()))?;
        // `!invert!` before a name applies the inverse operation.
        map *= if name.len() == word.len() {
            operation
        } else {
            operation
                .try_inverse()
                .ok_or_else(|| format!("{name}, which has no inverse"))?
        };
    }
    Ok((map, is_reset))
}

/// The matrix of an operation such as `xformOp:rotateXYZ:pivot`, which acts on column vectors; angles are in degrees.
/// `None` for an unknown operation or another number of numbers than it takes.
fn operation(name: &str, numbers: &[f64]) -> Option<Matrix4<f64>> {
    // The kind stands between the prefix and an optional suffix, which only distinguishes operations of one kind.
    let kind = name.strip_prefix("xformOp:")?.split(':').next()?;
    let turn = |axis: u8, degrees: f64| {
        let axis = match axis {
            b'X' => Vec3::x_axis(),
            b'Y' => Vec3::y_axis(),
            _ => Vec3::z_axis(),
        };
        Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
    };
    match (kind, numbers) {
        ("translate", &[x, y, z]) => Some(Matrix4::new_translation(&Vec3::new(x, y, z))),
        ("scale", &[x, y, z]) => Some(Matrix4::new_nonuniform_scaling(&Vec3::new(x, y, z))),
        ("rotateX" | "rotateY" | "rotateZ", &[angle]) => Some(turn(kind.as_bytes()[6], angle)),
        (
            "rotateXYZ" | "rotateXZY" | "rotateYXZ" | "rotateYZX" | "rotateZXY" | "rotateZYX",
            &[x, y, z],
        ) => {
            // The first axis of the name turns first.
            let axes = &kind.as_bytes()[6..];
            let turns = axes
                .iter()
                .map(|&a| turn(a, [x, y, z][usize::from(a - b'X')]));
            Some(turns.fold(Matrix4::identity(), |map, next| next * map))
        }
        // USD lists the real part first. A quaternion of any length is a rotation, but for one near 0.
        ("orient", &[w, x, y, z]) => {
            let q = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12)?;
            Some(q.to_homogeneous())
        }
        // The file's matrices act on row vectors, so that its rows are the columns here.
        ("transform", rows) if rows.len() == 16 => Some(Matrix4::from_column_slice(rows)),
        _ => None,
    }
}

/// The image of a point.
pub(super) fn image(map: &Matrix4<f64>, p: Vec3) -> Vec3 {
    map.transform_point(&p.into()).coords
}
