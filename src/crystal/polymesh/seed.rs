//! Initial meshes: Platonic and Archimedean solids, polygons, prisms, antiprisms, pyramids, grids, tori.
//!
//! Solids are centred on the origin, a pyramid with its base; all faces are in group 1. Lengths are in the model's unit.

use super::{Faces, PolyError, PolyMesh, archimedean};
use druse_geometry::frame::Vec3;
use std::f64::consts::{PI, TAU};

/// Names of the Platonic solids.
pub const PLATONIC_SOLIDS: [&str; 5] = [
    "tetrahedron",
    "cube",
    "octahedron",
    "dodecahedron",
    "icosahedron",
];

/// Maximum number of corners of a seed over a polygon, and of squares of a grid or torus.
const MAX_CORNERS: usize = 1 << 24;

/// Why a seed cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SeedError {
    /// A length that is not positive or not finite.
    #[error("{name} = {value}; expected a finite number more than 0")]
    Length {
        /// Which one.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A count out of range.
    #[error("{name} = {value}; expected {expected}")]
    Count {
        /// Which one.
        name: &'static str,
        /// Its value.
        value: usize,
        /// The range.
        expected: &'static str,
    },
    /// A loop of points that is no mesh.
    #[error(transparent)]
    Mesh(#[from] PolyError),
}

/// Names of all solids: Platonic, then Archimedean.
pub fn solids() -> Vec<&'static str> {
    PLATONIC_SOLIDS
        .into_iter()
        .chain(archimedean::names())
        .collect()
}

/// The name in [`solids`] of a solid by any of its names, whatever its capitals, hyphens and blanks:
/// "Truncated cuboctahedron" is the `great_rhombicuboctahedron`.
pub fn canonical(name: &str) -> Option<&'static str> {
    archimedean::canonical(name)
}

/// The solid with the name most similar to a word, if any is similar.
pub(super) fn nearest_solid(name: &str) -> Option<&'static str> {
    archimedean::nearest(name)
}

/// A Platonic or Archimedean solid by any of its names, with its edge length; `None` for an unknown name or an edge
/// that makes no finite mesh.
pub fn solid(name: &str, edge: f64) -> Option<PolyMesh> {
    let name = canonical(name)?;
    platonic(name, edge).or_else(|| archimedean::solid(name, edge))
}

/// A Platonic solid by its canonical name, with its edge length; the cube's edges and the octahedron's diagonals run
/// along the axes, and so do twofold axes of the others. `None` for other names and for an edge without finite mesh.
pub fn platonic(name: &str, edge: f64) -> Option<PolyMesh> {
    let g = f64::midpoint(1.0, 5f64.sqrt());
    let h = 1.0 / g;
    // Bit a of n is the sign along axis a: the corners of a cube.
    let signs = |n: usize| [0, 1, 2].map(|a| if n >> a & 1 == 0 { -1.0 } else { 1.0 });
    // A rectangle in the plane of two axes, its corners by sign of the first, then of the second.
    let rectangle = |first: usize, second: usize, a: f64, b: f64| {
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(s, t)| {
            let mut p = [0.0; 3];
            p[first] = s * a;
            p[second] = t * b;
            p
        })
    };
    // Corners, faces by number counter-clockwise from outside, and the edge length in these coordinates.
    let (points, lists, long): (Vec<[f64; 3]>, &[&[u32]], f64) = match name {
        "tetrahedron" => (
            vec![
                [1.0; 3],
                [1.0, -1.0, -1.0],
                [-1.0, 1.0, -1.0],
                [-1.0, -1.0, 1.0],
            ],
            &[&[0, 1, 2], &[0, 3, 1], &[0, 2, 3], &[1, 3, 2]],
            8f64.sqrt(),
        ),
        "cube" => (
            (0..8).map(signs).collect(),
            &[
                &[0, 2, 3, 1],
                &[0, 1, 5, 4],
                &[0, 4, 6, 2],
                &[1, 3, 7, 5],
                &[2, 6, 7, 3],
                &[4, 5, 7, 6],
            ],
            2.0,
        ),
        "octahedron" => (
            (0..6)
                .map(|n| {
                    let mut p = [0.0; 3];
                    p[n / 2] = if n % 2 == 0 { 1.0 } else { -1.0 };
                    p
                })
                .collect(),
            &[
                &[0, 2, 4],
                &[0, 5, 2],
                &[0, 4, 3],
                &[0, 3, 5],
                &[1, 4, 2],
                &[1, 2, 5],
                &[1, 3, 4],
                &[1, 5, 3],
            ],
            2f64.sqrt(),
        ),
        // A cube, the last axis fastest, and three rectangles, g^2 times as long as they are wide.
        "dodecahedron" => {
            let corner = |n: usize| [2, 1, 0].map(|a| signs(n)[a]);
            let mut p: Vec<[f64; 3]> = (0..8).map(corner).collect();
            p.extend(rectangle(1, 2, h, g));
            p.extend(rectangle(0, 1, h, g));
            p.extend(rectangle(0, 2, g, h));
            (
                p,
                &[
                    &[0, 12, 1, 17, 16],
                    &[0, 16, 2, 10, 8],
                    &[0, 8, 4, 14, 12],
                    &[1, 9, 11, 3, 17],
                    &[1, 12, 14, 5, 9],
                    &[2, 16, 17, 3, 13],
                    &[2, 13, 15, 6, 10],
                    &[3, 11, 7, 15, 13],
                    &[4, 18, 19, 5, 14],
                    &[4, 8, 10, 6, 18],
                    &[5, 19, 7, 11, 9],
                    &[6, 15, 7, 19, 18],
                ],
                2.0 * h,
            )
        }
        "icosahedron" => {
            let mut p = rectangle(1, 2, 1.0, g).to_vec();
            p.extend(rectangle(0, 1, 1.0, g));
            p.extend(rectangle(0, 2, g, 1.0));
            (
                p,
                &[
                    &[0, 8, 2],
                    &[0, 2, 10],
                    &[0, 6, 4],
                    &[0, 4, 8],
                    &[0, 10, 6],
                    &[1, 3, 9],
                    &[1, 11, 3],
                    &[1, 4, 6],
                    &[1, 9, 4],
                    &[1, 6, 11],
                    &[2, 5, 7],
                    &[2, 8, 5],
                    &[2, 7, 10],
                    &[3, 7, 5],
                    &[3, 5, 9],
                    &[3, 11, 7],
                    &[4, 9, 8],
                    &[5, 8, 9],
                    &[6, 10, 11],
                    &[7, 11, 10],
                ],
                2.0,
            )
        }
        _ => return None,
    };
    let vertices = points
        .into_iter()
        .map(|p| Vec3::from(p) * (edge / long))
        .collect();
    PolyMesh::from_lists(vertices, lists.iter().copied()).ok()
}

/// The value, if it is finite and more than 0.
fn positive(name: &'static str, value: f64) -> Result<f64, SeedError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(SeedError::Length { name, value })
    }
}

/// The number of corners of a polygon, if it is in range. An antiprism has eight times as many corners.
fn corners(n: usize) -> Result<usize, SeedError> {
    if (3..=MAX_CORNERS / 8).contains(&n) {
        Ok(n)
    } else {
        Err(SeedError::Count {
            name: "n",
            value: n,
            expected: "3 to 2097152 corners",
        })
    }
}

/// Corners of a regular n-gon at height z with edges of this length; the first is on the x axis, rotated by the angle
/// `turn` in radians.
fn ring(n: usize, edge: f64, z: f64, turn: f64) -> Vec<Vec3> {
    let radius = edge / (2.0 * (PI / n as f64).sin());
    (0..n)
        .map(|i| {
            let angle = TAU * i as f64 / n as f64 + turn;
            Vec3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
        .collect()
}

/// A regular n-gon with two sides: the normal of face 0 is +z, that of face 1 is -z.
///
/// # Errors
/// Fewer than 3 or more than 2^21 corners, an edge that is not positive and finite.
pub fn polygon(n: usize, edge: f64) -> Result<PolyMesh, SeedError> {
    two_sided(ring(corners(n)?, positive("edge", edge)?, 0.0, 0.0))
}

/// Any polygon with two sides: face 0 runs through the points in their order, face 1 back.
///
/// # Errors
/// Fewer than 3 points, or one that is not finite or beyond 1e18.
pub fn two_sided(points: Vec<Vec3>) -> Result<PolyMesh, SeedError> {
    let n = points.len() as u32;
    let mut faces = Faces::default();
    faces.push(0..n);
    faces.push((0..n).rev());
    Ok(PolyMesh::in_one_group(points, faces)?)
}

/// Two regular n-gons at the heights -z and z, the upper one turned by `turn` radians, with the faces that `side` makes
/// of the corners over each edge: lower start, lower end, upper end, upper start.
fn between(
    n: usize,
    edge: f64,
    [z, turn]: [f64; 2],
    side: impl Fn([u32; 4], &mut Faces),
) -> Result<PolyMesh, SeedError> {
    let mut points = ring(n, edge, -z, 0.0);
    points.extend(ring(n, edge, z, turn));
    let n = n as u32;
    let mut faces = Faces::default();
    faces.push(n..2 * n);
    faces.push((0..n).rev());
    for i in 0..n {
        let j = (i + 1) % n;
        side([i, j, n + j, n + i], &mut faces);
    }
    Ok(PolyMesh::in_one_group(points, faces)?)
}

/// A prism over a regular n-gon: top, bottom, sides.
///
/// # Errors
/// As [`polygon`], and a height that is not positive.
pub fn prism(n: usize, edge: f64, height: f64) -> Result<PolyMesh, SeedError> {
    let (n, edge) = (corners(n)?, positive("edge", edge)?);
    let z = positive("height", height)? / 2.0;
    between(n, edge, [z, 0.0], |[a, b, c, d], faces| {
        faces.push([a, b, c, d]);
    })
}

/// An antiprism over a regular n-gon; without a height its triangles are equilateral.
///
/// # Errors
/// As [`prism`].
pub fn antiprism(n: usize, edge: f64, height: Option<f64>) -> Result<PolyMesh, SeedError> {
    let (n, edge) = (corners(n)?, positive("edge", edge)?);
    // Edges of length `edge` between both n-gons, which are turned by pi / n.
    let part = PI / n as f64;
    let uniform = edge * (1.0 - 0.25 / (part / 2.0).cos().powi(2)).sqrt();
    let z = positive("height", height.unwrap_or(uniform))? / 2.0;
    between(n, edge, [z, part], |[a, b, c, d], faces| {
        faces.push([a, b, d]);
        faces.push([b, c, d]);
    })
}

/// A pyramid over a regular n-gon: base, then sides. Without a height its triangles are equilateral for n up
/// to 5, and its height is the edge length for larger n.
///
/// # Errors
/// As [`prism`].
pub fn pyramid(n: usize, edge: f64, height: Option<f64>) -> Result<PolyMesh, SeedError> {
    let (n, edge) = (corners(n)?, positive("edge", edge)?);
    let radius = 0.5 / (PI / n as f64).sin();
    let regular = if n < 6 {
        (1.0 - radius * radius).sqrt()
    } else {
        1.0
    };
    let z = positive("height", height.unwrap_or(edge * regular))?;
    let mut points = ring(n, edge, 0.0, 0.0);
    points.push(Vec3::new(0.0, 0.0, z));
    let n = n as u32;
    let mut faces = Faces::default();
    faces.push((0..n).rev());
    for i in 0..n {
        faces.push([i, (i + 1) % n, n]);
    }
    Ok(PolyMesh::in_one_group(points, faces)?)
}

/// The surface of a block of cubes, as many along each axis as `counts`, about the origin.
///
/// # Errors
/// An edge that is not positive, a count of 0, more than 16 million squares.
pub fn grid(counts: [usize; 3], edge: f64) -> Result<PolyMesh, SeedError> {
    let edge = positive("edge", edge)?;
    // Squares of the surface; sums that overflow stay beyond the limit.
    let squares: usize = [(0, 1), (1, 2), (2, 0)]
        .iter()
        .map(|&(a, b)| counts[a].saturating_mul(counts[b]).saturating_mul(2))
        .fold(0, usize::saturating_add);
    if let Some(&value) = counts
        .iter()
        .find(|&&c| c == 0 || c > MAX_CORNERS || squares > MAX_CORNERS)
    {
        return Err(SeedError::Count {
            name: "counts",
            value,
            expected: "1 or more cubes along each axis, at most 16 million squares together",
        });
    }
    // Points on an edge of the block belong to several squares; each is made once.
    let mut number = std::collections::HashMap::new();
    let mut points = Vec::new();
    let mut vertex = |p: [usize; 3]| {
        *number.entry(p).or_insert_with(|| {
            points.push(Vec3::from(
                [0, 1, 2].map(|a| (p[a] as f64 - counts[a] as f64 / 2.0) * edge),
            ));
            points.len() as u32 - 1
        })
    };
    let mut faces = Faces::default();
    // Both ends along each axis. On the lower one the order is reversed, so that the normal points outward.
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for end in [0, counts[axis]] {
            for i in 0..counts[u] {
                for j in 0..counts[v] {
                    let mut at = |di: usize, dj: usize| {
                        let mut p = [0; 3];
                        p[axis] = end;
                        p[u] = i + di;
                        p[v] = j + dj;
                        vertex(p)
                    };
                    let mut square = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                    if end == 0 {
                        square[1..].reverse();
                    }
                    faces.push(square);
                }
            }
        }
    }
    Ok(PolyMesh::in_one_group(points, faces)?)
}

/// A torus of quads about the z axis: `counts[0]` along the great circle, `counts[1]` along the small.
///
/// # Errors
/// Radii that are not positive or do not leave a hole, fewer than 3 quads either way, more than 2^24 in all.
pub fn torus(major: f64, minor: f64, counts: [usize; 2]) -> Result<PolyMesh, SeedError> {
    let major = positive("major", major)?;
    let minor = positive("minor", minor)?;
    if minor >= major {
        return Err(SeedError::Length {
            name: "major - minor",
            value: major - minor,
        });
    }
    let [n, m] = counts;
    for value in counts {
        if value < 3 || n.saturating_mul(m) > MAX_CORNERS {
            return Err(SeedError::Count {
                name: "counts",
                value,
                expected: "3 or more, at most 16 million quads",
            });
        }
    }
    let mut points = Vec::with_capacity(n * m);
    for i in 0..n {
        let a = TAU * i as f64 / n as f64;
        for j in 0..m {
            let b = TAU * j as f64 / m as f64;
            let r = major + minor * b.cos();
            points.push(Vec3::new(r * a.cos(), r * a.sin(), minor * b.sin()));
        }
    }
    // Indices wrap around both circles.
    let at = |i: usize, j: usize| ((i % n) * m + j % m) as u32;
    let quads = (0..n).flat_map(|i| {
        (0..m).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
    });
    let faces: Faces = quads.collect();
    Ok(PolyMesh::in_one_group(points, faces)?)
}
