//! The writer of tets as Gmsh 2.2 files in text, which every mesher and solver reads. Groups and fields are not
//! written. Nodes of a file of Gmsh itself are moved where they stand, so that the rest of it stays.

use crate::io::atomic::AtomicFile;
use crate::io::error::WriteError;
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::{Kind, Scaffold};
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

/// Writes a scaffold of tets of first or second order; returns the file's size in bytes. Coordinates are not
/// converted, since the format has no unit.
///
/// # Errors
/// When the file cannot be written, or an element is no tet.
pub fn write_msh(path: impl AsRef<Path>, scaffold: &Scaffold) -> Result<u64, WriteError> {
    let path = path.as_ref();
    let elements = scaffold.connectivity();
    let is_tet = |e: &usize| matches!(elements.kind(*e), Kind::Tet4 | Kind::Tet10);
    if let Some(other) = (0..elements.len()).find(|e| !is_tet(e)) {
        return Err(WriteError::Format {
            path: path.to_owned(),
            reason: format!(
                "element {other} is {}; expected tets",
                elements.kind(other).name()
            ),
        });
    }
    let mut file = AtomicFile::create(path)?;
    let written = write(&mut file, scaffold);
    written.map_err(|e| file.failed(e))?;
    file.commit()
}

/// Writes tets of first (code 4) or second order (code 11) in version 2.2. Each has two tags: no physical group, and
/// entity 1.
fn write(file: &mut impl Write, scaffold: &Scaffold) -> std::io::Result<()> {
    writeln!(
        file,
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}",
        scaffold.nodes().len()
    )?;
    for (n, p) in scaffold.nodes().iter().enumerate() {
        writeln!(file, "{} {} {} {}", n + 1, p.x, p.y, p.z)?;
    }
    writeln!(file, "$EndNodes\n$Elements\n{}", scaffold.len())?;
    for e in 0..scaffold.len() {
        let mut nodes = scaffold.connectivity().nodes(e).to_vec();
        let code = if nodes.len() == 4 { 4 } else { 11 };
        if code == 11 {
            // The middles of edges 1-3 and 2-3 (corners from 0) are the other way round than in VTK.
            nodes.swap(8, 9);
        }
        write!(file, "{} {code} 2 0 1", e + 1)?;
        for n in nodes {
            write!(file, " {}", n + 1)?;
        }
        writeln!(file)?;
    }
    writeln!(file, "$EndElements")
}

/// Moves nodes in a binary file of version 4.1 as Gmsh writes it; `moved` holds places before and after. Equal places
/// move together. `None` for another file, which may be changed in part.
pub fn move_nodes(file: &mut [u8], moved: &[[Vec3; 2]]) -> Option<()> {
    let bytes = |p: Vec3| [p.x, p.y, p.z].map(f64::to_le_bytes).concat();
    let new: HashMap<Vec<u8>, Vec<u8>> = moved.iter().map(|m| (bytes(m[0]), bytes(m[1]))).collect();
    let has_format = file.starts_with(b"$MeshFormat\n4.1 1 8\n");
    let title: &[u8] = b"\n$Nodes\n";
    let start = file.windows(title.len()).position(|w| w == title)?;
    let mut rest = file.get_mut(start + title.len()..).filter(|_| has_format)?;
    // The number of blocks; then the number of nodes, the least and the greatest of theirs.
    let blocks = u64::from_le_bytes(*rest.first_chunk()?);
    rest = rest.get_mut(32..)?;
    for _ in 0..blocks {
        // Dimension, entity, whether parameters follow a place; then the number of nodes, their numbers and places.
        let (head, tail) = rest.split_first_chunk_mut::<20>()?;
        let count = u64::from_le_bytes(*head.last_chunk()?) as usize;
        if head[8..12] != [0; 4] {
            return None;
        }
        let places = tail.get_mut(count.checked_mul(8)?..)?;
        let (places, tail) = places.split_at_mut_checked(count.checked_mul(24)?)?;
        for place in places.chunks_exact_mut(24) {
            if let Some(new) = new.get(place as &[u8]) {
                place.copy_from_slice(new);
            }
        }
        rest = tail;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_tets_are_read_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let straight = Scaffold::box_grid(Vec3::new(3.0, 2.0, 1.0), [2, 2, 1], Kind::Tet4);
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/scaffold");
        let curved = crate::io::read_scaffold(data.join("tet10_41_ascii.msh"));
        for made in [straight.unwrap(), curved.unwrap().scaffold] {
            let path = folder.path().join("tets.msh");
            write_msh(&path, &made).unwrap();
            let read = crate::io::read_scaffold(&path).unwrap().scaffold;
            assert_eq!(read.len(), made.len());
            // The reader numbers nodes as elements use them.
            for (own, other) in read.elements().zip(made.elements()) {
                assert_eq!(own.kind(), other.kind());
                for (m, n) in own.nodes().iter().zip(other.nodes()) {
                    assert_eq!(read.nodes()[*m as usize], made.nodes()[*n as usize]);
                }
            }
        }
    }
}
