//! Parts of CAD (STEP, IGES, BREP), meshed by the program gmsh.
//!
//! Druse runs gmsh as a child and keeps the mesh under the hash of the part and the options, so that the next run
//! reads it at once: in `$XDG_CACHE_HOME/druse`, else `~/.cache/druse`, else the folder for temporary files.

use crate::io::atomic::write_bytes;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// How a part is meshed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CadOptions {
    /// Edge of a tet, about, in the unit of the part.
    pub cell: f64,
    /// 1 or 2.
    pub order: u32,
}

/// Most lines of gmsh that an error repeats.
const MAX_LINES: usize = 3;

/// The path of a part's mesh (`.msh`), from the cache or made now. The part's file is not changed.
///
/// # Errors
/// Text: the part cannot be read, gmsh is not installed, or cannot mesh the part, in its own words.
pub(crate) fn cad_mesh(part: &Path, options: CadOptions) -> Result<PathBuf, String> {
    let shown = part.display();
    let bytes = std::fs::read(part).map_err(|e| format!("{shown}: {e}"))?;
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes);
    hash.update(format!("{options:?}").as_bytes());
    let folder = cache_folder();
    let mesh = folder.join(format!("{}.msh", hash.finalize().to_hex()));
    if mesh.is_file() {
        return Ok(mesh);
    }
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    // gmsh writes beside, so that a run which ends early leaves no half mesh.
    let work = tempfile::tempdir_in(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let made = work.path().join("part.msh");
    let size = options.cell.to_string();
    let order = options.order.to_string();
    let child = Command::new("gmsh")
        .arg(std::path::absolute(part).map_err(|e| format!("{shown}: {e}"))?)
        // Volumes (-3) as binary MSH 4.1, warnings only (-v 2); at least 6 elements on a full circle of a curved
        // face.
        .args(["-3", "-format", "msh41", "-bin", "-v", "2"])
        .args(["-order", &order, "-clmax", &size])
        .args(["-setnumber", "Mesh.MeshSizeFromCurvature", "6"])
        .args(["-setnumber", "Mesh.HighOrderOptimize", "1"])
        .arg("-o")
        .arg(&made)
        .stdin(Stdio::null())
        .output();
    let output = match child {
        Ok(output) => output,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!(
                "{shown} is a CAD part, which the program gmsh meshes; it is not on PATH: \
                 apt-get install gmsh, or pip install gmsh"
            ));
        }
        Err(e) => return Err(format!("gmsh does not start: {e}")),
    };
    let words = [&output.stdout[..], &output.stderr[..]].concat();
    let words = String::from_utf8_lossy(&words);
    let is_fault = |l: &&str| l.starts_with("Error") || l.starts_with("Fatal");
    let faults: Vec<&str> = words.lines().filter(is_fault).take(MAX_LINES).collect();
    if !output.status.success() || !faults.is_empty() || !made.is_file() {
        let cause = if faults.is_empty() {
            output.status.to_string()
        } else {
            faults.join("; ")
        };
        return Err(format!("gmsh cannot mesh {shown}: {cause}"));
    }
    let bytes = std::fs::read(&made).map_err(|e| format!("{}: {e}", made.display()))?;
    write_bytes(&mesh, &bytes).map_err(|e| e.to_string())?;
    Ok(mesh)
}

/// The folder of kept meshes, by the environment; it may not exist yet.
fn cache_folder() -> PathBuf {
    let set = |name: &str| {
        std::env::var_os(name)
            .filter(|v| !v.is_empty())
            .map(PathBuf::from)
    };
    let cache = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|h| h.join(".cache")));
    cache.unwrap_or_else(std::env::temp_dir).join("druse")
}
