//! Connected components of a mesh with their volumes, and whether it is closed, in one pass over large meshes.
//!
//! Triangles are of one component if they share a vertex, by its number: vertices at one place with two numbers do not
//! join them. Orientation is taken as it is. Self-intersections are not found.

use super::TriMesh;
use crate::frame::Aabb;
use crate::union_find::UnionFind;
use rayon::prelude::*;

/// A connected component of a mesh.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct MeshComponent {
    /// Number of its triangles.
    #[doc(hidden)]
    pub triangles: usize,
    /// Signed volume; negative for the surface of a cavity. Without meaning where the component is open.
    #[doc(hidden)]
    pub volume: f64,
    /// Its box.
    #[doc(hidden)]
    pub bounds: Aabb,
}

/// The components of a mesh, the largest volume in magnitude first, and the number of the component of each vertex in
/// that order. A vertex without triangles counts for the first one; its label has no meaning.
#[doc(hidden)]
pub fn mesh_components(mesh: &TriMesh) -> (Vec<MeshComponent>, Vec<u32>) {
    let mut sets = UnionFind::new(mesh.vertices().len());
    for &[a, b, c] in mesh.triangles() {
        sets.union(a as usize, b as usize);
        sets.union(b as usize, c as usize);
    }
    let used = mesh.triangles().iter().flatten().map(|&v| v as usize);
    let (labels, count) = sets.labels(used);
    let none = MeshComponent {
        triangles: 0,
        volume: 0.0,
        bounds: Aabb::EMPTY,
    };
    let mut components = vec![none; count];
    // Volumes about a point of the mesh, whose sums lose fewer digits than about a far origin.
    let origin = mesh.vertices().first().copied().unwrap_or_default();
    for (t, corners) in mesh.triangles().iter().zip(mesh.iter_corners()) {
        let component = &mut components[labels[t[0] as usize] as usize];
        let [a, b, c] = corners.map(|p| p - origin);
        component.triangles += 1;
        component.volume += a.dot(&b.cross(&c)) / 6.0;
        component.bounds = component.bounds.union(Aabb::of(corners));
    }
    // By volume, largest first; the sort is stable, so that equal ones keep their order.
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| {
        components[b]
            .volume
            .abs()
            .total_cmp(&components[a].volume.abs())
    });
    let mut rank = vec![0; count];
    for (place, &component) in order.iter().enumerate() {
        rank[component] = place as u32;
    }
    let labels = labels.into_iter();
    let labels = labels.map(|l| rank.get(l as usize).copied().unwrap_or(0));
    let labels = labels.collect();
    (order.into_iter().map(|c| components[c]).collect(), labels)
}

/// Whether every edge of a mesh has as many triangles that run along it one way as the other, so that a cut can be
/// filled. An empty mesh is not closed, nor one with a triangle that repeats a vertex.
#[doc(hidden)]
pub fn is_closed(mesh: &TriMesh) -> bool {
    let mut sides: Vec<(u64, i32)> = Vec::with_capacity(3 * mesh.triangles().len());
    for &[a, b, c] in mesh.triangles() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let key = u64::from(from.min(to)) << 32 | u64::from(from.max(to));
            sides.push((key, if from < to { 1 } else { -1 }));
        }
    }
    sides.par_sort_unstable();
    let edges = sides.chunk_by(|a, b| a.0 == b.0);
    let balanced = |e: &[(u64, i32)]| e.iter().map(|s| s.1).sum::<i32>() == 0;
    !mesh.is_empty() && edges.into_iter().all(balanced)
}
