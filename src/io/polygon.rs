//! A polygon as triangles.

use crate::frame::Vec3;

/// Polygons of more corners are not tried as a fan from each.
const STAR: usize = 32;

/// Cuts a polygon of at least three corners into triangles: a quad along the diagonal that keeps both
/// halves on its front, larger ones as a fan from a corner that sees all sides, else by their ears in the
/// plane of their area.
pub(super) fn cut(polygon: &[u32], vertices: &[Vec3], out: &mut Vec<[u32; 3]>) {
    let n = polygon.len();
    let at = |i: usize| vertices[polygon[i % n] as usize];
    let o = at(0);
    // Twice the area vector; quadratic in the size, so a NaN-free sum for finite corners in range.
    let mut normal = Vec3::zeros();
    for i in 1..n - 1 {
        normal += (at(i) - o).cross(&(at(i + 1) - o));
    }
    let turn = |i: usize| (at(i + 1) - at(i)).cross(&(at(i + 2) - at(i))).dot(&normal);
    let reflex = (0..n).find(|&i| turn(i) <= 0.0).map(|i| (i + 1) % n);
    // Whether the triangles from a corner to all sides face the front.
    let sees = |from: usize| {
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
        // Of a quad with a reflex corner the diagonal from there lies inside.
        Some(corner) if n == 4 => fan(corner, out),
        Some(_) => match (0..n).find(|&i| n <= STAR && sees(i)) {
            Some(corner) => fan(corner, out),
            None => match ears(polygon, vertices, normal) {
                Some(triangles) => out.extend(triangles),
                None => fan(0, out),
            },
        },
    }
}

/// The ears of a polygon; `None` where they do not cover it, as where it crosses itself.
fn ears(polygon: &[u32], vertices: &[Vec3], normal: Vec3) -> Option<Vec<[u32; 3]>> {
    let at = |i: usize| vertices[polygon[i] as usize];
    let front = normal.try_normalize(0.0)?;
    let longest = |x: &f64, y: &f64| x.total_cmp(y);
    let least = front.iter().map(|c| c.abs()).enumerate();
    let axis = least.min_by(|x, y| longest(&x.1, &y.1))?.0;
    let across = Vec3::ith(axis, 1.0).cross(&front).try_normalize(0.0)?;
    let up = front.cross(&across);
    let flat = (0..polygon.len()).map(|i| {
        let p = at(i) - at(0);
        [p.dot(&across), p.dot(&up)]
    });
    let mut ears: Vec<usize> = Vec::new();
    earcut::Earcut::new().earcut(flat, &[], &mut ears);
    let area: f64 = ears
        .chunks_exact(3)
        .map(|t| {
            let [a, b, c] = [at(t[0]), at(t[1]), at(t[2])];
            (b - a).cross(&(c - a)).dot(&front)
        })
        .sum();
    let whole = normal.norm();
    if ears.len() != 3 * (polygon.len() - 2) || (area.abs() - whole).abs() > 1e-9 * whole {
        return None;
    }
    let turned = |t: &[usize]| {
        if area < 0.0 {
            [t[0], t[2], t[1]]
        } else {
            [t[0], t[1], t[2]]
        }
    };
    let triangles = ears.chunks_exact(3).map(turned);
    Some(triangles.map(|t| t.map(|i| polygon[i])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_corner_may_come_first() {
        // An L and an arrow in a slanted plane: their area is kept and every triangle faces the front.
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
                cut(&polygon, &vertices, &mut out);
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
