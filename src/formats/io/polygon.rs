//! Triangulation of a polygon in space, which need not be planar or convex. The corners keep their orientation.
//! No points are added. Where nothing else works, the fan from the first corner may overlap itself.

use druse_geometry::frame::Vec3;

/// Greatest number of corners of a polygon that is tested for a fan from each corner: the cost grows with its square.
const MAX_FAN_SEARCH_CORNERS: usize = 32;

/// Triangulates a polygon of at least three corners into `out`: a quad along the diagonal that keeps both triangles
/// facing the front, larger polygons as a fan from a corner from which all sides are visible (tried up to 32 corners),
/// else by ear clipping in the plane of their area vector, and where that fails as a fan from the first corner.
pub(super) fn triangulate(polygon: &[u32], vertices: &[Vec3], out: &mut Vec<[u32; 3]>) {
    let n = polygon.len();
    let at = |i: usize| vertices[polygon[i % n] as usize];
    let o = at(0);
    // Twice the area vector.
    let mut normal = Vec3::zeros();
    for i in 1..n - 1 {
        normal += (at(i) - o).cross(&(at(i + 1) - o));
    }
    let orientation = |i: usize| (at(i + 1) - at(i)).cross(&(at(i + 2) - at(i))).dot(&normal);
    // `orientation(i)` is of corner i + 1: it is reflex or straight where that is not positive.
    let reflex = (0..n).find(|&i| orientation(i) <= 0.0).map(|i| (i + 1) % n);
    // Whether the fan from a corner faces the front.
    let is_star_centre = |from: usize| {
        (1..n - 1).all(|k| {
            let [a, b, c] = [at(from), at(from + k), at(from + k + 1)];
            (b - a).cross(&(c - a)).dot(&normal) > 0.0
        })
    };
    let fan = |from: usize, out: &mut Vec<[u32; 3]>| {
        let corner = |k: usize| polygon[(from + k) % n];
        out.extend((1..n - 1).map(|k| [corner(0), corner(k), corner(k + 1)]));
    };
    match reflex {
        None => fan(0, out),
        // In a quad, the diagonal from a reflex corner lies inside.
        Some(corner) if n == 4 => fan(corner, out),
        Some(_) => match (0..n).find(|&i| n <= MAX_FAN_SEARCH_CORNERS && is_star_centre(i)) {
            Some(corner) => fan(corner, out),
            None => match triangulate_in_plane(polygon, vertices, normal) {
                Some(triangles) => out.extend(triangles),
                None => fan(0, out),
            },
        },
    }
}

/// Triangles by ear clipping in the plane across `normal` (any length); `None` if they do not cover the polygon, for
/// example if it intersects itself.
fn triangulate_in_plane(polygon: &[u32], vertices: &[Vec3], normal: Vec3) -> Option<Vec<[u32; 3]>> {
    let at = |i: usize| vertices[polygon[i] as usize];
    let front = normal.try_normalize(0.0)?;
    // Axes of the plane, from the coordinate axis along which the normal is shortest: the product is not small.
    let order = |x: &f64, y: &f64| x.total_cmp(y);
    let least = front.iter().map(|c| c.abs()).enumerate();
    let axis = least.min_by(|x, y| order(&x.1, &y.1))?.0;
    let across = Vec3::ith(axis, 1.0).cross(&front).try_normalize(0.0)?;
    let up = front.cross(&across);
    let projected = (0..polygon.len()).map(|i| {
        let p = at(i) - at(0);
        [p.dot(&across), p.dot(&up)]
    });
    let mut corners: Vec<usize> = Vec::new();
    earcut::Earcut::new().earcut(projected, &[], &mut corners);
    // Signed area of the triangles, twice as in `normal`. It equals that of the polygon, up to rounding, only if the
    // triangles cover it without overlap.
    let area: f64 = corners
        .chunks_exact(3)
        .map(|t| {
            let [a, b, c] = [at(t[0]), at(t[1]), at(t[2])];
            (b - a).cross(&(c - a)).dot(&front)
        })
        .sum();
    let full_area = normal.norm();
    if corners.len() != 3 * (polygon.len() - 2) || (area.abs() - full_area).abs() > 1e-9 * full_area
    {
        return None;
    }
    // Ear clipping may reverse the orientation; the triangles get that of the polygon.
    let oriented = |t: &[usize]| {
        if area < 0.0 {
            [t[0], t[2], t[1]]
        } else {
            [t[0], t[1], t[2]]
        }
    };
    let triangles = corners.chunks_exact(3).map(oriented);
    Some(triangles.map(|t| t.map(|i| polygon[i])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangulation_is_valid_for_any_first_corner() {
        // An L and an arrow in a slanted plane: the area is preserved and every triangle faces the front.
        let l = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]].map(|p| p.map(f64::from));
        let arrow = [[0, 0], [3, 0], [1, 1], [0, 3]].map(|p| p.map(f64::from));
        for (shape, area) in [(&l[..], 3.0), (&arrow[..], 3.0)] {
            let vertices: Vec<Vec3> = shape
                .iter()
                .map(|p| Vec3::new(p[0], p[1], p[0] + 2.0 * p[1]))
                .collect();
            let stretch = 6f64.sqrt();
            for first in 0..shape.len() {
                let polygon: Vec<u32> = (0..shape.len())
                    .map(|i| ((i + first) % shape.len()) as u32)
                    .collect();
                let mut out = Vec::new();
                triangulate(&polygon, &vertices, &mut out);
                assert_eq!(out.len(), shape.len() - 2);
                let mut sum = 0.0;
                for t in out {
                    let [a, b, c] = t.map(|v| vertices[v as usize]);
                    let normal = (b - a).cross(&(c - a));
                    assert!(normal.z > 0.0, "first {first}");
                    sum += normal.norm() / 2.0;
                }
                assert!((sum - area * stretch).abs() < 1e-12, "first {first}: {sum}");
            }
        }
    }
}
