//! A midpoint rule over every reference cell.

use druse::frame::{CellPoint, Element, Vec3};

/// Centres of equal parts of the cell: cubes; for the tetrahedron those of the six Kuhn simplices of
/// each cube of a grid that fold into it; for the wedge those of half cubes; for the pyramid frusta of
/// equal height cubed.
pub fn centres(shape: Element, n: usize) -> Vec<CellPoint<3>> {
    let mut found = Vec::new();
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                let at = |c: usize, f: f64| (c as f64 + f) / n as f64;
                if shape == Element::Hex {
                    let p = Vec3::new(at(i, 0.5), at(j, 0.5), at(k, 0.5));
                    found.push(CellPoint(p.add_scalar(-0.5)));
                    continue;
                }
                if shape == Element::Pyramid {
                    let h = at(k, 0.5).cbrt();
                    let [x, y] = [i, j].map(|c| (at(c, 0.5) - 0.5) * h);
                    found.push(CellPoint(Vec3::new(x, y, (1.0 - h) / 2f64.sqrt())));
                    continue;
                }
                if shape == Element::Wedge {
                    for (f, g) in [(2.0 / 3.0, 1.0 / 3.0), (1.0 / 3.0, 2.0 / 3.0)] {
                        let (a, b) = (at(i, f), at(j, g));
                        if a > b {
                            let v = shape.vertices();
                            let flat = v[0] * (1.0 - a) + v[1] * (a - b) + v[2] * b;
                            found.push(CellPoint(flat + Vec3::z() * at(k, 0.5)));
                        }
                    }
                    continue;
                }
                for [x, y, z] in [
                    [1, 2, 3],
                    [1, 3, 2],
                    [2, 1, 3],
                    [2, 3, 1],
                    [3, 1, 2],
                    [3, 2, 1],
                ] {
                    let c = [
                        at(i, x as f64 / 4.0),
                        at(j, y as f64 / 4.0),
                        at(k, z as f64 / 4.0),
                    ];
                    // The simplex 1 > x > y > z > 0 of the unit cube is a union of such parts.
                    if c[0] > c[1] && c[1] > c[2] {
                        let l = [1.0 - c[0], c[0] - c[1], c[1] - c[2], c[2]];
                        let v = shape.vertices();
                        found.push(CellPoint((0..4).map(|a| v[a] * l[a]).sum()));
                    }
                }
            }
        }
    }
    found
}
