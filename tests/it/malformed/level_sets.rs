//! Damaged level sets, which the program opens in a child process.

use super::Refusal;
use druse::frame::{Transform, Vec3};
use druse::mesh::TriMesh;
use druse::progress::{Silent, Threads};
use druse::vdb::{Compression, LevelSet, Session, VdbWriter};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Level sets of a ball, in every compression, and one with its fog.
pub fn seeds() -> Vec<Vec<u8>> {
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let ball = TriMesh::ball(Vec3::new(0.1, 0.2, 0.3), 4.0, 3);
    let solid = LevelSet::from_mesh(&ball, Transform::new(0.5).unwrap(), 3.0, session).unwrap();
    let fog = solid.to_fog(session).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("ball.vdb");
    [
        (Compression::None, false),
        (Compression::Zip, true),
        (Compression::Blosc, false),
    ]
    .map(|(compression, foggy)| {
        let mut file = VdbWriter::new(&path, session)
            .unwrap()
            .compression(compression);
        file.level_set("surface", &solid).unwrap();
        if foggy {
            file.fog("density", &fog, true).unwrap();
        }
        file.write().unwrap();
        fs::read(&path).unwrap()
    })
    .to_vec()
}

/// What `druse info` and, of every other file, `druse check` make of it: whatever happens to the child that reads the
/// file, the program answers.
pub fn read(path: &Path) -> Result<(), Refusal> {
    let name = path.file_stem().unwrap().to_string_lossy();
    let is_checked = crate::is_full() || name.ends_with(['0', '2', '4', '6', '8']);
    let commands = &["info", "check"][..=usize::from(is_checked)];
    for &command in commands {
        let output = Command::new(env!("CARGO_BIN_EXE_druse"))
            .args([command, "--color=never"])
            .arg(path)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        match output.status.code() {
            Some(0) if text.is_empty() => {}
            // Read, but no sound level set.
            Some(1) if command == "check" && text.is_empty() => {}
            code => {
                let one = text.starts_with("error: ") && text.matches("error: ").count() == 1;
                return Err(Refusal {
                    clear: code == Some(65) && one && output.stdout.is_empty(),
                    text: text.replace("\n  --> ", " --> "),
                });
            }
        }
    }
    Ok(())
}
