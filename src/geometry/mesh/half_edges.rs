//! Lists the half-edges of triangles sorted by edge: the basis of connectivity, closedness and orientation.
//!
//! A half-edge is one of the three directed edges of a triangle, in the triangle's orientation. The half-edges between
//! the same two vertices, of one direction or the other, form an edge.

/// A half-edge of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct HalfEdge {
    /// The lesser vertex.
    pub(crate) lo: u32,
    /// The greater vertex.
    pub(crate) hi: u32,
    /// Twice the triangle's number, plus 1 for the direction from `lo` to `hi`: in a word, to keep the list small.
    code: u32,
}

/// Number of triangles that the codes can hold.
const MAX_TRIANGLES: usize = 1 << 31;

impl HalfEdge {
    /// The triangle's number.
    pub(crate) fn triangle(self) -> u32 {
        self.code >> 1
    }

    /// Whether the direction is from the lesser vertex to the greater.
    pub(crate) fn is_forward(self) -> bool {
        self.code & 1 == 1
    }
}

/// All half-edges of some triangles, in ascending order of `lo`, `hi` and triangle. Half-edges from a vertex to itself,
/// of degenerate triangles, are left out.
pub(crate) struct HalfEdges(Vec<HalfEdge>);

impl HalfEdges {
    /// The half-edges of triangles, given by their vertices, which are less than `vertex_count`.
    ///
    /// # Panics
    /// With more than 2^31 triangles.
    pub(crate) fn of(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        assert!(triangles.len() <= MAX_TRIANGLES, "numbers of 31 bits");
        let directed = || {
            (0u32..)
                .zip(triangles)
                .flat_map(|(t, &[a, b, c])| [(a, b, t), (b, c, t), (c, a, t)])
                .filter(|(a, b, _)| a != b)
        };
        // A counting sort by the lesser vertex, then a sort of each vertex's few half-edges. `starts[v]` becomes the
        // position of the first half-edge with `lo` = v, and its last entry their number.
        let mut starts = vec![0usize; vertex_count + 1];
        for (a, b, _) in directed() {
            starts[a.min(b) as usize + 1] += 1;
        }
        for v in 0..vertex_count {
            starts[v + 1] += starts[v];
        }
        let placeholder = HalfEdge {
            lo: 0,
            hi: 0,
            code: 0,
        };
        let mut all = vec![placeholder; starts[vertex_count]];
        let mut next = starts.clone();
        for (a, b, t) in directed() {
            let (lo, hi) = (a.min(b), a.max(b));
            let slot = &mut next[lo as usize];
            all[*slot] = HalfEdge {
                lo,
                hi,
                code: t << 1 | u32::from(a < b),
            };
            *slot += 1;
        }
        for v in 0..vertex_count {
            all[starts[v]..starts[v + 1]].sort_unstable();
        }
        Self(all)
    }

    /// The half-edges of each edge, edges in ascending order of their vertices.
    pub(crate) fn edges(&self) -> impl Iterator<Item = &[HalfEdge]> {
        self.0.chunk_by(|g, h| (g.lo, g.hi) == (h.lo, h.hi))
    }

    /// The boundary of the triangles as a chain: for each edge the half-edges of one direction that exceed those of the
    /// other. It is empty for a closed, consistently oriented surface.
    pub(crate) fn boundary(&self) -> Vec<BoundaryEdge> {
        let mut boundary = Vec::new();
        for edge in self.edges() {
            let forward = edge.iter().filter(|h| h.is_forward()).count() as i64;
            // Half-edges from `lo` to `hi` minus those from `hi` to `lo`.
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

/// A directed edge of the boundary chain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundaryEdge {
    /// The vertex at its start.
    pub(crate) from: u32,
    /// The vertex at its end.
    pub(crate) to: u32,
    /// Number of half-edges in its direction minus those in the other; at least 1.
    pub(crate) multiplicity: u32,
}
