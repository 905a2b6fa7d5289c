//! Cracks: edges that are open only because single precision rounded one vertex to several places.

use super::TriMesh;
use super::half_edges::BoundaryEdge;
use super::shells::COPLANAR_TOLERANCE_RATIO;
use crate::frame::Vec3;
use std::collections::HashMap;

/// The mesh with vertices of its open edges moved onto one another where they are less than two roundings of single
/// precision apart; `None` where none are. `merged` numbers the vertices of the edges.
pub(super) fn without_cracks(
    mesh: &TriMesh,
    merged: &TriMesh,
    boundary: &[BoundaryEdge],
) -> Option<TriMesh> {
    let mut open: Vec<u32> = boundary.iter().flat_map(|e| [e.from, e.to]).collect();
    open.sort_unstable();
    open.dedup();
    let greatest = merged.vertices().iter().map(Vec3::amax).fold(0.0, f64::max);
    let tolerance = COPLANAR_TOLERANCE_RATIO * greatest;
    // Boxes of the tolerance: near vertices are in neighbouring ones.
    let bin = |p: Vec3| [p.x, p.y, p.z].map(|c| (c / tolerance).floor() as i64);
    let mut kept: HashMap<[i64; 3], Vec<Vec3>> = HashMap::new();
    let mut moved: HashMap<[u64; 3], Vec3> = HashMap::new();
    for p in open.into_iter().map(|n| merged.vertices()[n as usize]) {
        let [x, y, z] = bin(p);
        let around = (0..27).map(|n| [x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1]);
        let mut near = around.filter_map(|b| kept.get(&b)).flatten();
        // The first vertex stays, so that the order of the file decides alone.
        match near.find(|q| (*q - p).norm() <= tolerance) {
            Some(&q) => {
                moved.insert(key(p), q);
            }
            None => kept.entry(bin(p)).or_default().push(p),
        }
    }
    (!moved.is_empty()).then(|| mesh.mapped(|p| moved.get(&key(p)).copied().unwrap_or(p)))
}

/// The bits of a place; adding zero makes -0 equal to 0.
fn key(p: Vec3) -> [u64; 3] {
    [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits())
}
