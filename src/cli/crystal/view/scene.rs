//! The binary form of a model for the page in the browser: JSON text, then arrays.
//!
//! Little-endian: the length of the padded JSON text as u32; the text, padded with blanks to a multiple of 4; then
//! positions (f32, 3 a vertex), triangles (u32, 3 each), the face of each triangle (u32), the two vertices of
//! each edge (u32) and the group of each face (u32). The text has their counts, and colours of the groups.

use crate::polymesh::{PolyMesh, group_color};
use serde_json::{Value, json};

/// Maximum number of triangles that are drawn.
const MAX_DRAWN_TRIANGLES: usize = 2_000_000;

/// A model with its description.
pub(super) fn pack(mesh: Option<&PolyMesh>, mut about: Value) -> Vec<u8> {
    let cut = mesh.and_then(|m| m.triangulated().ok());
    let cut = cut.filter(|c| c.mesh.triangles().len() <= MAX_DRAWN_TRIANGLES);
    about["drawn"] = json!(cut.is_some());
    let (mut positions, mut numbers) = (Vec::new(), Vec::new());
    if let (Some(mesh), Some(cut)) = (mesh, &cut) {
        let points = cut.mesh.vertices();
        positions.extend(
            points
                .iter()
                .flat_map(|p| [p.x, p.y, p.z].map(|c| c as f32)),
        );
        numbers.extend(cut.mesh.triangles().iter().flatten().copied());
        numbers.extend(cut.faces.iter().copied());
        let mut edges = 0;
        // The mesh is closed: each edge occurs once in each direction.
        for face in mesh.faces().iter() {
            let next = face.iter().cycle().skip(1);
            for (&a, &b) in face.iter().zip(next).filter(|(a, b)| a < b) {
                numbers.extend([a, b]);
                edges += 1;
            }
        }
        numbers.extend(mesh.groups());
        let groups = mesh.group_counts().into_iter();
        let groups: Vec<Value> = groups
            .map(|(g, faces)| json!({ "group": g, "faces": faces, "color": group_color(g) }))
            .collect();
        about["groups"] = json!(groups);
        about["sides"] = json!(mesh.faces().iter().map(<[u32]>::len).collect::<Vec<_>>());
        about["counts"] = json!({
            "vertices": points.len(),
            "triangles": cut.mesh.triangles().len(),
            "edges": edges,
            "faces": mesh.face_count(),
        });
    }
    let mut bytes = crate::cli::server::headed(&about);
    bytes.extend(positions.iter().flat_map(|c| c.to_le_bytes()));
    bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    bytes
}
