//! Half-edge topology: twins of corners, the order round a vertex, and the checks of a manifold.
//!
//! A corner c stands for the half-edge from its vertex to the next vertex of its face; corners count through all faces.
//! Its twin is the corner of the half-edge that runs the other way, in the face beyond the edge. After `twins` has
//! checked a mesh every corner has one, and the corners of a vertex form a single ring.

use super::{Faces, PolyError, PolyMesh};
use druse_geometry::frame::{Vec3, is_in_range};

/// Checks vertices, faces and groups, and computes the twin of each corner. The error is the first rule that is
/// broken: sizes, groups, coordinates, loops, edges, vertices.
pub(super) fn twins(
    vertices: &[Vec3],
    faces: &Faces,
    groups: &[u32],
) -> Result<Vec<u32>, PolyError> {
    let count = vertices.len();
    if faces.is_empty() {
        return Err(PolyError::Empty);
    }
    if faces.corners.len() >= u32::MAX as usize || count >= u32::MAX as usize {
        return Err(PolyError::TooMany(faces.corners.len().max(count) as u64));
    }
    if groups.len() != faces.len() {
        return Err(PolyError::GroupCount {
            groups: groups.len(),
            faces: faces.len(),
        });
    }
    if let Some(face) = groups.iter().position(|&g| g == 0) {
        return Err(PolyError::GroupZero(face));
    }
    // Each check relies on those before it: indices in range, edges shared by two faces, one fan per vertex.
    finite(vertices)?;
    loops(count, faces)?;
    let twins = pair(count, faces)?;
    fans(count, faces, &twins)?;
    Ok(twins)
}

/// Checks that all coordinates are finite and below the limit of coordinates (1e18).
pub(super) fn finite(vertices: &[Vec3]) -> Result<(), PolyError> {
    for (vertex, v) in vertices.iter().enumerate() {
        if let Some(&value) = v.iter().find(|c| !is_in_range(**c)) {
            return Err(PolyError::NotFinite { vertex, value });
        }
    }
    Ok(())
}

/// Checks every loop: enough corners, existing vertices, none twice.
fn loops(count: usize, faces: &Faces) -> Result<(), PolyError> {
    // The last face that contained each vertex.
    let mut seen = vec![u32::MAX; count];
    for (f, face) in faces.iter().enumerate() {
        if face.len() < 3 {
            return Err(PolyError::TooFewCorners {
                face: f,
                corners: face.len(),
            });
        }
        for &v in face {
            let Some(last) = seen.get_mut(v as usize) else {
                return Err(PolyError::NoSuchVertex {
                    face: f,
                    vertex: v,
                    count,
                });
            };
            if *last == f as u32 {
                return Err(PolyError::RepeatedVertex { face: f, vertex: v });
            }
            *last = f as u32;
        }
    }
    Ok(())
}

/// The face of each corner.
fn owners(faces: &Faces) -> Vec<u32> {
    let mut owner = Vec::with_capacity(faces.corners.len());
    for (f, face) in faces.iter().enumerate() {
        owner.resize(owner.len() + face.len(), f as u32);
    }
    owner
}

/// The vertex after that of each corner.
fn ends(faces: &Faces) -> Vec<u32> {
    let mut ends = Vec::with_capacity(faces.corners.len());
    for face in faces.iter() {
        ends.extend_from_slice(&face[1..]);
        ends.push(face[0]);
    }
    ends
}

/// Finds the opposite half-edge of each half-edge of faces over `count` vertices.
fn pair(count: usize, faces: &Faces) -> Result<Vec<u32>, PolyError> {
    let starts = &faces.corners;
    let ends = ends(faces);
    // Half-edges grouped by their lower vertex, in the order of corners.
    let mut first = vec![0u32; count + 1];
    for (a, b) in starts.iter().zip(&ends) {
        first[*a.min(b) as usize + 1] += 1;
    }
    for v in 0..count {
        first[v + 1] += first[v];
    }
    let mut slot = first.clone();
    let mut by_vertex = vec![0u32; starts.len()];
    for (c, (a, b)) in starts.iter().zip(&ends).enumerate() {
        let place = &mut slot[*a.min(b) as usize];
        by_vertex[*place as usize] = c as u32;
        *place += 1;
    }
    drop(slot);
    let mut twins = vec![u32::MAX; starts.len()];
    // The first fault in the order of corners, so that the message does not depend on the search; open
    // edges come last because they often follow from other faults.
    let mut fault: Option<(u32, Option<u32>)> = None;
    let mut worse = |c: u32, other: Option<u32>| {
        let rank = |c: u32, other: Option<u32>| (other.is_none(), c);
        if fault.is_none_or(|(d, known)| rank(c, other) < rank(d, known)) {
            fault = Some((c, other));
        }
    };
    for v in 0..count {
        let list = &mut by_vertex[first[v] as usize..first[v + 1] as usize];
        let key = |c: u32| {
            let (a, b) = (starts[c as usize], ends[c as usize]);
            (a.max(b), a > b, c)
        };
        list.sort_unstable_by_key(|&c| key(c));
        for edge in list.chunk_by(|&c, &d| key(c).0 == key(d).0) {
            let forward = edge.partition_point(|&c| !key(c).1);
            let back = edge.len() - forward;
            for run in [&edge[..forward], &edge[forward..]] {
                if let [c, d, ..] = *run {
                    worse(d, Some(c));
                }
            }
            match (forward, back) {
                (1, 1) => {
                    twins[edge[0] as usize] = edge[1];
                    twins[edge[1] as usize] = edge[0];
                }
                (1, 0) | (0, 1) => worse(edge[0], None),
                _ => {}
            }
        }
    }
    let Some((corner, other)) = fault else {
        return Ok(twins);
    };
    let owner = owners(faces);
    let (from, to) = (starts[corner as usize], ends[corner as usize]);
    let face = owner[corner as usize] as usize;
    Err(match other {
        Some(other) => PolyError::SameDirection {
            first: owner[other as usize] as usize,
            second: face,
            from,
            to,
        },
        None => PolyError::Open { face, from, to },
    })
}

/// Checks that every one of `count` vertices is in use, by one fan of faces; `twins` are those of all corners.
fn fans(count: usize, faces: &Faces, twins: &[u32]) -> Result<(), PolyError> {
    // The corner before each corner in its face.
    let mut before = Vec::with_capacity(twins.len());
    for f in 0..faces.len() {
        let span = faces.span(f);
        before.push(span.end as u32 - 1);
        before.extend(span.start as u32..span.end as u32 - 1);
    }
    let mut visited = vec![false; twins.len()];
    let mut fans = vec![0u8; count];
    for corner in 0..twins.len() {
        if visited[corner] {
            continue;
        }
        let v = faces.corners[corner] as usize;
        fans[v] = fans[v].saturating_add(1);
        // Around a vertex: from a corner over the edge before it to the next face, until the fan is closed.
        let mut c = corner;
        while !visited[c] {
            visited[c] = true;
            c = twins[before[c] as usize] as usize;
        }
    }
    if let Some(v) = fans.iter().position(|&n| n != 1) {
        return Err(match fans[v] {
            0 => PolyError::Unused(v as u32),
            n => PolyError::Pinched {
                vertex: v as u32,
                fans: usize::from(n),
            },
        });
    }
    Ok(())
}

/// The connectivity of a mesh by corner, computed once for an operation.
pub(crate) struct Ring<'a> {
    mesh: &'a PolyMesh,
    /// The corner after each one in its face.
    pub next: Vec<u32>,
    /// The corner before each one in its face.
    pub before: Vec<u32>,
    /// The face of each corner.
    pub face: Vec<u32>,
    /// A corner of each vertex, in its lowest face.
    pub corner: Vec<u32>,
    /// The edge of each corner, numbered as first seen.
    pub edge: Vec<u32>,
    /// The first corner of each edge.
    pub edges: Vec<u32>,
}

// Orders are those of the faces, so that results built from them are the same each time.
impl<'a> Ring<'a> {
    /// The connectivity of all corners of a mesh.
    pub fn new(mesh: &'a PolyMesh) -> Self {
        let faces = &mesh.faces;
        let corners = faces.corners.len();
        let mut ring = Self {
            mesh,
            next: Vec::with_capacity(corners),
            before: Vec::with_capacity(corners),
            face: owners(faces),
            corner: vec![u32::MAX; mesh.vertex_count()],
            edge: vec![u32::MAX; corners],
            edges: Vec::with_capacity(corners / 2),
        };
        // Corners of a face are consecutive and close to a ring.
        for f in 0..faces.len() {
            let (start, end) = (faces.span(f).start as u32, faces.span(f).end as u32);
            ring.next.extend(start + 1..end);
            ring.next.push(start);
            ring.before.push(end - 1);
            ring.before.extend(start..end - 1);
        }
        // An edge is numbered at the first of its two corners.
        for c in 0..corners {
            let v = faces.corners[c] as usize;
            if ring.corner[v] == u32::MAX {
                ring.corner[v] = c as u32;
            }
            let twin = mesh.twin(c);
            ring.edge[c] = if twin < c {
                ring.edge[twin]
            } else {
                ring.edges.push(c as u32);
                ring.edges.len() as u32 - 1
            };
        }
        ring
    }

    /// The vertex of a corner.
    pub fn vertex(&self, corner: usize) -> usize {
        self.mesh.faces.corners[corner] as usize
    }

    /// The position of a corner.
    pub fn at(&self, corner: usize) -> Vec3 {
        self.mesh.vertices[self.vertex(corner)]
    }

    /// The corner after one in its face.
    pub fn after(&self, corner: usize) -> usize {
        self.next[corner] as usize
    }

    /// The corner before one in its face.
    pub fn prior(&self, corner: usize) -> usize {
        self.before[corner] as usize
    }

    /// The corners round a vertex, counter-clockwise seen from outside, from its lowest face.
    pub fn around(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        let first = self.corner[vertex] as usize;
        let mut corner = Some(first);
        std::iter::from_fn(move || {
            let c = corner?;
            let following = self.mesh.twin(self.prior(c));
            corner = (following != first).then_some(following);
            Some(c)
        })
    }
}
