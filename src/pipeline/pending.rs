//! Stand-ins for what the readers and writers of meshes and the level set's pieces will offer.

use crate::frame::LengthUnit;
use crate::io::atomic::write_bytes;
use crate::io::{Place, ReadError, WriteError};
use crate::mesh::TriMesh;
use std::path::Path;

pub(super) struct MeshFile {
    pub mesh: TriMesh,
    pub unit: Option<LengthUnit>,
}

pub(super) fn read_mesh(path: &Path) -> Result<MeshFile, ReadError> {
    Err(ReadError::data(path, Place::File, "a mesh", "no mesh"))
}

pub(super) fn write_mesh(path: &Path, mesh: &TriMesh, _: LengthUnit) -> Result<u64, WriteError> {
    let mut bytes = vec![0u8; 80];
    bytes.extend((mesh.triangles().len() as u32).to_le_bytes());
    for corners in mesh.iter_corners() {
        bytes.extend([0u8; 12]);
        for c in corners {
            for v in c.iter() {
                bytes.extend((*v as f32).to_le_bytes());
            }
        }
        bytes.extend([0u8; 2]);
    }
    write_bytes(path, &bytes)
}
