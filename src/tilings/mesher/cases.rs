//! The 256 cases of a cell: which corners are inside, and the loops of crossed edges.
//!
//! Corner `4 x + 2 y + z` of the unit cube; edge `4 axis + 2 u + v`, where `(u, v)` is its position on the
//! other two axes in ascending order. Loops run counter-clockwise seen from outside the solid. The table
//! is derived from the faces of the cell.

use std::sync::LazyLock;

/// Number of edges of a cell.
pub(super) const CELL_EDGES: usize = 12;

/// A cycle of crossed edges.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Loop {
    /// Number of edges.
    pub len: u8,
    /// The edges in order.
    pub edges: [u8; 7],
    /// Bits of the edges that may be the apex of a fan; of several with equal fans only the first.
    pub apexes: u8,
}

impl Loop {
    /// The edges in order.
    pub fn edges(&self) -> &[u8] {
        &self.edges[..usize::from(self.len)]
    }
}

/// The loops of one case.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Case {
    loops: [Loop; 4],
    count: u8,
    /// Triangles of all loops.
    pub triangles: u8,
}

impl Case {
    /// The loops.
    pub fn loops(&self) -> &[Loop] {
        &self.loops[..usize::from(self.count)]
    }
}

/// All cases, by the bits of the corners that are inside.
pub(super) static CASES: LazyLock<Box<[Case; 256]>> = LazyLock::new(|| {
    let mut cases = Box::new([Case::default(); 256]);
    for (bits, case) in cases.iter_mut().enumerate() {
        *case = derive(bits);
    }
    cases
});

/// The start of an edge (offsets along x, y, z) and its axis.
pub(super) const fn edge_base(edge: usize) -> ([usize; 3], usize) {
    let (axis, u, v) = (edge >> 2, edge >> 1 & 1, edge & 1);
    let base = match axis {
        0 => [0, u, v],
        1 => [u, 0, v],
        _ => [u, v, 0],
    };
    (base, axis)
}

/// The edge between two corners that differ in one coordinate.
fn edge_between(a: usize, b: usize) -> usize {
    let low = a & b;
    let axis = match a ^ b {
        4 => 0,
        2 => 1,
        _ => 2,
    };
    let [x, y, z] = [low >> 2, low >> 1 & 1, low & 1];
    let across = [2 * y + z, 2 * x + z, 2 * x + y];
    4 * axis + across[axis]
}

/// Corners of each face, counter-clockwise seen from outside the cell.
fn faces() -> [[usize; 4]; 6] {
    std::array::from_fn(|face| {
        let (axis, high) = (face / 2, face % 2);
        let weight = |a: usize| 4 >> (a % 3);
        let (u, v) = (weight(axis + 1), weight(axis + 2));
        let at = high * weight(axis);
        let ring = [at, at + u, at + u + v, at + v];
        if high == 1 {
            ring
        } else {
            [ring[0], ring[3], ring[2], ring[1]]
        }
    })
}

/// Whether two edges of a cell lie in one of its faces.
fn share_a_face(a: usize, b: usize) -> bool {
    faces().iter().any(|ring| {
        let has = |e: usize| (0..4).any(|i| edge_between(ring[i], ring[(i + 1) % 4]) == e);
        has(a) && has(b)
    })
}

/// The loops of a cell whose inside corners are these bits: each is the border of a part of the surface in the cell.
/// Corner n is bit n. On a face with two opposite inside corners each is separated for itself, so that both cells at
/// the face agree.
fn derive(bits: usize) -> Case {
    let inside = |corner: usize| bits >> corner & 1 == 1;
    // For each crossed edge the next one of its loop, across a face of the cell.
    let mut next = [None; CELL_EDGES];
    for ring in faces() {
        for i in 0..4 {
            let (before, first) = (ring[i], ring[(i + 1) % 4]);
            if inside(before) || !inside(first) {
                continue;
            }
            // A run of inside corners on this face: one segment separates it from the rest.
            let mut last = (i + 1) % 4;
            while inside(ring[(last + 1) % 4]) {
                last = (last + 1) % 4;
            }
            let entry = edge_between(before, first);
            next[entry] = Some(edge_between(ring[last], ring[(last + 1) % 4]));
        }
    }
    let mut case = Case::default();
    // The edges are followed until they close; each is taken once.
    for start in 0..CELL_EDGES {
        let mut found = Loop::default();
        let mut at = start;
        while let Some(following) = next[at].take() {
            found.edges[usize::from(found.len)] = at as u8;
            found.len += 1;
            at = following;
        }
        if found.len > 0 {
            found.apexes = apexes(found.edges());
            case.loops[usize::from(case.count)] = found;
            case.count += 1;
            case.triangles += found.len - 2;
        }
    }
    case
}

/// Vertices of a loop without a diagonal in a face of the cell. Opposite vertices of a quad share their
/// diagonal, so that only two of them differ.
fn apexes(edges: &[u8]) -> u8 {
    let n = edges.len();
    let distinct = if n == 4 { 2 } else { n };
    let is_apex = |apex: usize| {
        (2..n - 1).all(|i| !share_a_face(edges[apex].into(), edges[(apex + i) % n].into()))
    };
    (0..distinct).filter(|&a| is_apex(a)).map(|a| 1 << a).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a fan over positions in the loop.
    fn fan(n: usize, apex: usize) -> impl Iterator<Item = [usize; 3]> {
        (1..n - 1).map(move |i| [apex, (apex + i) % n, (apex + i + 1) % n])
    }

    #[test]
    fn every_case_has_loops_over_all_crossed_edges_and_fans_without_diagonals_in_faces() {
        for (bits, case) in CASES.iter().enumerate() {
            let mut used = [0; CELL_EDGES];
            for l in case.loops() {
                assert!((3..=7).contains(&l.len), "{bits}: {l:?}");
                assert!(l.apexes != 0, "{bits}: {l:?}");
                l.edges().iter().for_each(|&e| used[usize::from(e)] += 1);
            }
            for edge in 0..CELL_EDGES {
                let (base, axis) = edge_base(edge);
                let low = 4 * base[0] + 2 * base[1] + base[2];
                let crossed = (bits >> low ^ bits >> (low + (4 >> axis))) & 1;
                assert_eq!(used[edge], crossed, "{bits}: edge {edge}");
                assert_eq!(edge_between(low, low + (4 >> axis)), edge);
            }
        }
    }

    /// Segments of a case's loops that lie in a face, from edge to edge.
    fn segments(bits: usize, ring: [usize; 4]) -> Vec<[usize; 2]> {
        let in_face =
            |e: u8| (0..4).any(|i| edge_between(ring[i], ring[(i + 1) % 4]) == usize::from(e));
        let mut found = Vec::new();
        for l in CASES[bits].loops() {
            let e = l.edges();
            for i in 0..e.len() {
                let segment = [e[i], e[(i + 1) % e.len()]];
                if segment.iter().all(|&e| in_face(e)) {
                    found.push(segment.map(usize::from));
                }
            }
        }
        found.sort_unstable();
        found
    }

    #[test]
    fn neighbours_have_opposite_segments_on_their_common_face() {
        for axis in 0..3 {
            let weight = 4 >> axis;
            let [low, high] = [faces()[2 * axis], faces()[2 * axis + 1]];
            // Corners of the upper face of one cell are those of the lower face of the next.
            let moved = |e: usize| {
                let (mut base, along) = edge_base(e);
                base[axis] = 1 - base[axis];
                let c = 4 * base[0] + 2 * base[1] + base[2];
                edge_between(c, c + (4 >> along))
            };
            for one in 0..256usize {
                let mut expected: Vec<[usize; 2]> = segments(one, high)
                    .into_iter()
                    .map(|[a, b]| [moved(b), moved(a)])
                    .collect();
                expected.sort_unstable();
                for other in 0..256usize {
                    let agree = (0..8)
                        .filter(|c| c & weight == 0)
                        .all(|c| (one >> (c + weight) & 1) == (other >> c & 1));
                    if agree {
                        assert_eq!(expected, segments(other, low), "{one} {other}");
                    }
                }
            }
        }
    }

    #[test]
    fn fans_of_a_cell_meet_only_in_common_edges_for_any_vertex_positions() {
        use druse_geometry::frame::Vec3;
        use druse_geometry::mesh::{TriMesh, check};
        // A linear congruential generator suffices for positions on edges.
        let mut state = 7u64;
        let mut random = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let rounds = if std::env::var_os("DRUSE_FULL").is_some() {
            200
        } else {
            4
        };
        for bits in 0..256 {
            let loops = CASES[bits].loops();
            for _ in 0..rounds {
                // As often near the ends as in between; at an end only where no other edge of it is crossed.
                let crossed = |corner: usize| {
                    [1, 2, 4].map(|step| (bits >> corner ^ bits >> (corner ^ step)) & 1 == 1)
                };
                let is_alone = |corner| crossed(corner).iter().filter(|c| **c).count() == 1;
                let mut position = |low: usize, high: usize| {
                    let margin = |corner| if is_alone(corner) { 0.0 } else { 1e-3 };
                    match random() {
                        r if r < 0.25 => margin(low),
                        r if r < 0.5 => 1.0 - margin(high),
                        _ => 1e-3 + (1.0 - 2e-3) * random(),
                    }
                };
                let vertices: Vec<Vec3> = (0..CELL_EDGES)
                    .map(|e| {
                        let (base, axis) = edge_base(e);
                        let low = 4 * base[0] + 2 * base[1] + base[2];
                        let mut p = Vec3::from(base.map(|c| c as f64));
                        p[axis] = position(low, low + (4 >> axis));
                        p
                    })
                    .collect();
                // Every apex of one loop, with the first apex of the others.
                for (varied, l) in loops.iter().enumerate() {
                    for apex in (0..7).filter(|a| l.apexes >> a & 1 == 1) {
                        let mut triangles = Vec::new();
                        for (n, l) in loops.iter().enumerate() {
                            let first = l.apexes.trailing_zeros() as usize;
                            let apex = if n == varied { apex } else { first };
                            let corners = |t: [usize; 3]| t.map(|i| u32::from(l.edges[i]));
                            triangles.extend(fan(l.edges().len(), apex).map(corners));
                        }
                        let mesh = TriMesh::new(vertices.clone(), triangles).unwrap();
                        let report = check(&mesh);
                        assert_eq!(report.self_intersections.unwrap().count, 0, "{bits} {apex}");
                        assert_eq!(report.degenerate.count, 0, "{bits} {apex}");
                        assert_eq!(report.pinched_vertices.count, 0, "{bits} {apex}");
                    }
                }
            }
        }
    }
}
