//! 3MF: archives and the models in them.

use super::Refusal;
use druse::io::read_solid;
use std::fs;
use std::io::{Read, Write};
use std::path::Path;

/// Damage done to the XML within a 3MF rather than to the archive, whose checksum would notice.
pub(super) fn threemf_model(path: &Path) -> Result<(), Refusal> {
    let model = fs::read(path).unwrap();
    let mut zip = zip::ZipWriter::new(fs::File::create(path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    zip.start_file("3D/3dmodel.model", options).unwrap();
    zip.write_all(&model).unwrap();
    zip.finish().unwrap();
    solid(path)
}

/// Triangles and beams.
pub(super) fn solid(path: &Path) -> Result<(), Refusal> {
    Ok(read_solid(path).map(drop)?)
}

/// Archives with parts, beams, clips and balls.
pub(super) fn archives() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/threemf");
    [
        "production.3mf",
        "beams_and_mesh.3mf",
        "caps.3mf",
        "clipped.3mf",
        "balls.3mf",
    ]
    .map(|name| fs::read(folder.join(name)).unwrap())
    .to_vec()
}

/// The models of those, the last one in UTF-16.
pub(super) fn models() -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = archives().into_iter().skip(1).map(model_of).collect();
    let wide = String::from_utf8(all[1].clone()).unwrap();
    let wide = wide.encode_utf16().flat_map(u16::to_le_bytes);
    all.push([0xff, 0xfe].into_iter().chain(wide).collect());
    all
}

pub(super) fn model_of(archive: Vec<u8>) -> Vec<u8> {
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(archive)).unwrap();
    let mut model = Vec::new();
    let mut part = zip.by_name("3D/3dmodel.model").unwrap();
    part.read_to_end(&mut model).unwrap();
    model
}
