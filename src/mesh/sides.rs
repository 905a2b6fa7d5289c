//! Half-edges of triangles, sorted by edge: the basis of connectivity, closedness and orientation.

/// One side of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct HalfEdge {
    /// The lesser vertex.
    pub(crate) lo: u32,
    /// The greater vertex.
    pub(crate) hi: u32,
    /// Twice the triangle's number, plus 1 where the side runs from `lo` to `hi`.
    code: u32,
}

impl HalfEdge {
    /// The triangle's number.
    pub(crate) fn triangle(self) -> u32 {
        self.code >> 1
    }

    /// Whether the side runs from the lesser vertex to the greater.
    pub(crate) fn is_forward(self) -> bool {
        self.code & 1 == 1
    }
}

/// All sides of some triangles, grouped by edge; sides from a vertex to itself are left out.
pub(crate) struct HalfEdges(Vec<HalfEdge>);

impl HalfEdges {
    /// The half-edges of triangles over `vertices` vertices. A counting sort by vertex suffices, since
    /// vertices have few edges.
    pub(crate) fn of(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let sides = || {
            (0u32..)
                .zip(triangles)
                .flat_map(|(t, &[a, b, c])| [(a, b, t), (b, c, t), (c, a, t)])
                .filter(|(a, b, _)| a != b)
        };
        let mut start = vec![0usize; vertices + 1];
        for (a, b, _) in sides() {
            start[a.min(b) as usize + 1] += 1;
        }
        for v in 0..vertices {
            start[v + 1] += start[v];
        }
        let empty = HalfEdge {
            lo: 0,
            hi: 0,
            code: 0,
        };
        let mut all = vec![empty; start[vertices]];
        let mut next = start.clone();
        for (a, b, t) in sides() {
            let (lo, hi) = (a.min(b), a.max(b));
            let slot = &mut next[lo as usize];
            all[*slot] = HalfEdge {
                lo,
                hi,
                code: t << 1 | u32::from(a < b),
            };
            *slot += 1;
        }
        for v in 0..vertices {
            all[start[v]..start[v + 1]].sort_unstable();
        }
        Self(all)
    }

    /// The half-edges of each edge, edges in ascending order of their vertices.
    pub(crate) fn edges(&self) -> impl Iterator<Item = &[HalfEdge]> {
        self.0.chunk_by(|s, t| (s.lo, s.hi) == (t.lo, t.hi))
    }

    /// The boundary of the triangles as a chain: half-edges without an opposite one.
    pub(crate) fn boundary(&self) -> Vec<BoundaryEdge> {
        let mut boundary = Vec::new();
        for edge in self.edges() {
            let forward = edge.iter().filter(|s| s.is_forward()).count() as i64;
            let net = 2 * forward - edge.len() as i64;
            let HalfEdge { lo, hi, .. } = edge[0];
            let (from, to) = if net > 0 { (lo, hi) } else { (hi, lo) };
            if net != 0 {
                boundary.push(BoundaryEdge {
                    from,
                    to,
                    multiplicity: net.unsigned_abs() as u32,
                });
            }
        }
        boundary
    }
}

/// A boundary edge: from one vertex to another, with its multiplicity in the boundary chain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundaryEdge {
    pub(crate) from: u32,
    pub(crate) to: u32,
    pub(crate) multiplicity: u32,
}
