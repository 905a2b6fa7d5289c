//! Parts of CAD (STEP, IGES, BREP), meshed by the program gmsh.
//!
//! Druse runs gmsh as a child and keeps the mesh under the hash of the part and the options, so that the next run
//! reads it at once: in `$XDG_CACHE_HOME/druse`, else `~/.cache/druse`, else the folder for temporary files.

use crate::io::ReadError;
use crate::io::atomic::write_bytes;
use crate::pipeline::base::error::RunError;
use crate::progress::{Cancelled, Progress};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

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
/// How often the end of gmsh and a cancellation are looked for.
const POLL: Duration = Duration::from_millis(20);

/// The mesh of a part, from the cache or made now. Solids with names are its groups.
///
/// # Errors
/// The part cannot be read, gmsh is not installed, or cannot mesh the part, in its own words; a file cannot be written;
/// cancellation.
pub(crate) fn cad_mesh(
    part: &Path,
    options: CadOptions,
    progress: &dyn Progress,
) -> Result<PathBuf, RunError> {
    let shown = part.display();
    let failed = |message: String| RunError::Scaffold {
        file: Some(part.to_owned()),
        element: None,
        message,
    };
    let bytes = std::fs::read(part).map_err(|e| ReadError::io(part, e))?;
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes);
    hash.update(format!("unfolded {options:?}").as_bytes());
    let folder = cache_folder();
    let mesh = folder.join(format!("{}.msh", hash.finalize().to_hex()));
    if mesh.is_file() {
        return Ok(mesh);
    }
    let io = |e: std::io::Error| failed(format!("{}: {e}", folder.display()));
    std::fs::create_dir_all(&folder).map_err(io)?;
    // gmsh writes beside, so that a run which ends early leaves no half mesh.
    let work = tempfile::tempdir_in(&folder).map_err(io)?;
    let gmsh = Gmsh {
        folder: work.path(),
        progress,
    };
    progress.stage("gmsh", None);
    let source = std::path::absolute(part).map_err(io)?;
    let named = gmsh.with_groups(&source).map_err(|e| e.of(part))?;
    let made = work.path().join("part.msh");
    // Tets, also of no group, without messages below warnings; 10 elements or more around a full circle. Curved tets
    // are not mended by gmsh, which may take hours.
    let mut command = Command::new("gmsh");
    command
        .arg(named.as_ref().unwrap_or(&source))
        .args(["-3", "-format", "msh41", "-bin", "-v", "2", "-save_all"])
        .args(["-order", &options.order.to_string()])
        .args(["-clmax", &options.cell.to_string()])
        .args(["-setnumber", "Mesh.MeshSizeFromCurvature", "10"])
        .args(["-setnumber", "Mesh.HighOrderOptimize", "0"]);
    gmsh.write(command, &made).map_err(|e| e.of(part))?;
    let mut bytes = std::fs::read(&made).map_err(|e| failed(format!("{shown}: {e}")))?;
    // A file without solids is refused where it is read.
    let moved = crate::io::read_scaffold(&made).map_or(Vec::new(), |r| r.scaffold.unfolded());
    if !moved.is_empty() && crate::io::move_nodes(&mut bytes, &moved).is_none() {
        return Err(failed(format!(
            "{} middles of tets must move so that no tet folds, but gmsh wrote no binary file of version 4.1; \
             expected gmsh 4.8 or later",
            moved.len()
        )));
    }
    write_bytes(&mesh, &bytes)?;
    Ok(mesh)
}

/// Why gmsh wrote no file.
enum GmshFault {
    Cancelled,
    Failed(String),
}

impl GmshFault {
    fn of(self, part: &Path) -> RunError {
        match self {
            Self::Cancelled => Cancelled.into(),
            Self::Failed(message) => RunError::Scaffold {
                file: Some(part.to_owned()),
                element: None,
                message,
            },
        }
    }
}

/// The program gmsh, with a folder for its files.
struct Gmsh<'a> {
    folder: &'a Path,
    progress: &'a dyn Progress,
}

impl Gmsh<'_> {
    /// Runs a command that writes a file, until the file is written or the user cancels.
    fn write(&self, mut command: Command, output: &Path) -> Result<(), GmshFault> {
        let fault = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::NotFound => GmshFault::Failed(
                "it is a CAD part, which the program gmsh meshes; gmsh is not on PATH: \
                 apt-get install gmsh, or pip install gmsh"
                    .into(),
            ),
            _ => GmshFault::Failed(format!("gmsh does not start: {e}")),
        };
        // A file takes any number of words, where a pipe would fill.
        let words = self.folder.join("words.txt");
        let io = |e: std::io::Error| GmshFault::Failed(format!("{}: {e}", words.display()));
        let log = std::fs::File::create(&words).map_err(io)?;
        command
            .arg("-o")
            .arg(output)
            .stdin(Stdio::null())
            .stdout(log.try_clone().map_err(io)?)
            .stderr(log);
        let mut child = command.spawn().map_err(fault)?;
        let status = loop {
            if let Some(status) = child.try_wait().map_err(io)? {
                break status;
            }
            if self.progress.cancelled() {
                // A child that has ended by itself is no fault.
                let _ = child.kill();
                let _ = child.wait();
                return Err(GmshFault::Cancelled);
            }
            std::thread::sleep(POLL);
        };
        let words = String::from_utf8_lossy(&std::fs::read(&words).map_err(io)?).into_owned();
        let is_fault = |l: &&str| l.starts_with("Error") || l.starts_with("Fatal");
        let faults: Vec<&str> = words.lines().filter(is_fault).take(MAX_LINES).collect();
        if status.success() && faults.is_empty() && output.is_file() {
            return Ok(());
        }
        let cause = if faults.is_empty() {
            status.to_string()
        } else {
            faults.join("; ")
        };
        Err(GmshFault::Failed(format!(
            "gmsh cannot mesh the part: {cause}"
        )))
    }

    /// A file that reads the part and makes groups of its named solids; `None` where none has a name, or a script
    /// cannot hold the path.
    fn with_groups(&self, part: &Path) -> Result<Option<PathBuf>, GmshFault> {
        // -0 makes no mesh, -3 saves a set of nodes for each solid: empty, but with the name of the solid.
        let sets = self.folder.join("names.inp");
        let mut command = Command::new("gmsh");
        command
            .arg(part)
            .args(["-0", "-format", "inp", "-v", "2"])
            .args(["-setnumber", "Mesh.SaveGroupsOfNodes", "-3"]);
        self.write(command, &sets)?;
        let io = |e: std::io::Error| GmshFault::Failed(format!("{}: {e}", sets.display()));
        let sets = String::from_utf8_lossy(&std::fs::read(&sets).map_err(io)?).into_owned();
        let groups = groups(&sets);
        let path = part.to_str().filter(|p| !p.contains(['"', '\n']));
        let Some(path) = path.filter(|_| !groups.is_empty()) else {
            return Ok(None);
        };
        let mut text = format!("Merge \"{path}\";\n");
        for (name, solids) in groups {
            let solids: Vec<String> = solids.iter().map(usize::to_string).collect();
            let _ = writeln!(
                text,
                "Physical Volume(\"{name}\") = {{{}}};",
                solids.join(", ")
            );
        }
        let file = self.folder.join("part.geo");
        std::fs::write(&file, text).map_err(io)?;
        Ok(Some(file))
    }
}

/// The numbers of the solids of each name. A solid in an assembly has a path of names, the last one is its own;
/// gmsh may add a material.
fn groups(sets: &str) -> BTreeMap<String, Vec<usize>> {
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    let names = sets.lines().filter_map(|l| l.strip_prefix("*NSET,NSET="));
    for (number, path) in (1..).zip(names) {
        let own = path.split("_&_").next().unwrap_or(path);
        let name = own.rsplit('/').next().unwrap_or(own);
        // Without a name gmsh writes the number.
        let is_named = own.contains('/') && !name.is_empty() && !name.contains(['"', '\\']);
        if is_named {
            groups.entry(name.to_owned()).or_default().push(number);
        }
    }
    groups
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_of_one_name_are_one_group() {
        let sets = "*Heading\n x\n*NSET,NSET=Shapes/as1/NUT::1/nut\n\n*NSET,NSET=Volume2\n\n\
                    *NSET,NSET=Shapes/as1/NUT::2/nut_&_steel\n\n*NSET,NSET=Shapes/\n*NSET,NSET=Shapes/base_plate\n";
        let found: Vec<(String, Vec<usize>)> = groups(sets).into_iter().collect();
        assert_eq!(
            found,
            [
                ("base_plate".to_owned(), vec![5]),
                ("nut".to_owned(), vec![1, 3])
            ]
        );
    }
}
