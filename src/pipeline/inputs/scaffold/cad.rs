//! Parts of CAD (STEP, IGES, BREP), meshed by the program gmsh.
//!
//! Druse runs gmsh as a child and keeps the mesh under the hash of the part and the options, so that the next run
//! reads it at once: in `$XDG_CACHE_HOME/druse`, else `~/.cache/druse`, else the folder for temporary files.

use super::filling::{POOR, poor_elements, worst_quality};
use super::with_nodes;
use crate::frame::Vec3;
use crate::io::ReadError;
use crate::io::atomic::write_bytes;
use crate::pipeline::base::error::RunError;
use crate::progress::{Cancelled, Progress};
use crate::scaffold::Scaffold;
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
    /// Whether its tets are a scaffold: parts without solids are refused then, and smaller cells are tried around thin
    /// tets.
    pub is_scaffold: bool,
}

/// The mesh of a part.
pub(crate) struct CadMesh {
    pub path: PathBuf,
    /// The volume of the part's solids; 0 where it has none.
    pub volume: f64,
}

/// Edges around a full circle, at first and where gmsh fails then.
const CIRCLE: [u32; 2] = [10, 12];
/// How often smaller cells are tried around thin tets: each time a whole mesh.
const REFINEMENTS: usize = 3;
/// Most places of smaller cells: a part with more thin tets is damaged, and gmsh measures each edge against each.
const MAX_PLACES: usize = 200;
/// Least and greatest cells there, as shares of the cell.
const SIZES: [f64; 2] = [1e-3, 0.5];
/// Growth of cells beside such a place, per length.
const GROWTH: f64 = 0.5;
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
) -> Result<CadMesh, RunError> {
    let folder = cache_folder();
    let failed = |message: String| RunError::Scaffold {
        file: Some(part.to_owned()),
        element: None,
        message,
    };
    let io = |e: std::io::Error| failed(format!("{}: {e}", folder.display()));
    let bytes = std::fs::read(part).map_err(|e| ReadError::io(part, e))?;
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes);
    // This word changes with the way in which tets are made, so that none made in another way are taken.
    hash.update(format!("smaller cells, straight slivers {options:?}").as_bytes());
    let path = folder.join(format!("{}.msh", hash.finalize().to_hex()));
    let kept = path.with_extension("volume");
    // The volume is written first: without a number in it the mesh is made anew.
    let volume = std::fs::read_to_string(&kept).unwrap_or_default().parse();
    if let Some(volume) = volume.ok().filter(|_| path.is_file()) {
        return Ok(CadMesh { path, volume });
    }
    std::fs::create_dir_all(&folder).map_err(io)?;
    // gmsh works beside, so that a run which ends early leaves no half mesh.
    let work = tempfile::tempdir_in(&folder).map_err(io)?;
    let gmsh = Gmsh {
        folder: work.path(),
        failed: &failed,
        progress,
    };
    progress.stage("gmsh", None);
    let (script, volume) = gmsh.script(part, &bytes)?;
    if volume == 0.0 && options.is_scaffold {
        return Err(failed(
            "found no solids in it; expected some, or shell = { thickness = ... } in a recipe"
                .into(),
        ));
    }
    let mut circle = CIRCLE[0];
    let mut best = gmsh.tets(&script, options, circle, &[]);
    if best.is_err() && options.is_scaffold && !progress.cancelled() {
        circle = CIRCLE[1];
        best = gmsh.tets(&script, options, circle, &[]);
    }
    let mut best = best?;
    // Short edges of the part lie beside long ones of tets, and gmsh leaves slivers in thin plates: smaller cells
    // around the thin tets mend most of both.
    let mut places = best.places.clone();
    for _ in 0..REFINEMENTS {
        let is_worth_it = !places.is_empty() && places.len() <= MAX_PLACES;
        if best.quality > POOR || !is_worth_it || !options.is_scaffold {
            break;
        }
        let trial = gmsh.tets(&script, options, circle, &places);
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        let Ok(trial) = trial else { break };
        places.extend(&trial.places);
        if trial.quality > best.quality {
            best = trial;
        }
    }
    write_bytes(&kept, volume.to_string().as_bytes())?;
    write_bytes(&path, &best.bytes)?;
    Ok(CadMesh { path, volume })
}

/// Tets of a part.
struct Tets {
    /// Their worst quality.
    quality: f64,
    bytes: Vec<u8>,
    /// Places at which they are thin, with the sizes of cells that may help.
    places: Vec<(Vec3, f64)>,
}

/// Where the tets of a scaffold are thin, the worst first, with the sizes of cells that may help: twice the tet's least
/// edge, and at most half its longest one.
fn thin_places(scaffold: &Scaffold, cell: f64) -> Vec<(Vec3, f64)> {
    let mut thin = poor_elements(scaffold, POOR);
    thin.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut places: Vec<(Vec3, f64)> = Vec::new();
    for (element, _) in thin {
        let corners = &scaffold.connectivity().nodes(element)[..4];
        let corners = [0, 1, 2, 3].map(|k| scaffold.nodes()[corners[k] as usize]);
        let pairs = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
        let lengths: Vec<f64> = pairs
            .map(|(i, j)| (corners[i] - corners[j]).norm())
            .collect();
        let least = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        let size = (2.0 * least).min(longest / 2.0);
        let size = size.clamp(SIZES[0] * cell, SIZES[1] * cell);
        let place = corners.iter().sum::<Vec3>() / 4.0;
        // Two tets of one sliver are one place.
        let is_near = |p: &(Vec3, f64)| (p.0 - place).norm() < p.1 && p.1 <= 1.01 * size;
        if !places.iter().any(is_near) {
            places.push((place, size));
        }
    }
    places
}

/// The program gmsh, with a folder for its files.
struct Gmsh<'a> {
    folder: &'a Path,
    /// The error for the part.
    failed: &'a dyn Fn(String) -> RunError,
    progress: &'a dyn Progress,
}

impl Gmsh<'_> {
    fn io(&self, error: &std::io::Error) -> RunError {
        (self.failed)(format!("{}: {error}", self.folder.display()))
    }

    /// Runs a command that writes a file, until the file is written or the user cancels.
    fn write(&self, mut command: Command, output: &Path) -> Result<(), RunError> {
        let fault = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::NotFound => (self.failed)(
                "it is a CAD part, which the program gmsh meshes; gmsh is not on PATH: \
                 apt-get install gmsh, or pip install gmsh"
                    .into(),
            ),
            _ => (self.failed)(format!("gmsh does not start: {e}")),
        };
        // A file takes any number of words, where a pipe would fill.
        let words = self.folder.join("words.txt");
        let io = |e: std::io::Error| self.io(&e);
        let log = std::fs::File::create(&words).map_err(io)?;
        command
            .arg("-o")
            .arg(output)
            .stdin(Stdio::null())
            .stdout(log.try_clone().map_err(io)?)
            .stderr(log);
        let mut child = command.spawn().map_err(fault)?;
        let read_words = || {
            let bytes = std::fs::read(&words).map_err(io)?;
            Ok::<String, RunError>(String::from_utf8_lossy(&bytes).into_owned())
        };
        let mut shown = String::new();
        let status = loop {
            if let Some(status) = child.try_wait().map_err(io)? {
                break status;
            }
            let text = read_words()?;
            let mut begun = text.lines().rev().filter(|l| l.ends_with("..."));
            let stage = begun.find_map(|l| l.strip_prefix("Info    : Meshing "));
            if let Some(stage) = stage.filter(|s| *s != shown) {
                self.progress.stage(&format!("gmsh {stage}"), None);
                shown = stage.to_owned();
            }
            if self.progress.cancelled() {
                // A child that has ended by itself is no fault.
                let _ = child.kill();
                let _ = child.wait();
                return Err(Cancelled.into());
            }
            std::thread::sleep(POLL);
        };
        let words = read_words()?;
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
        Err((self.failed)(format!("gmsh cannot mesh the part: {cause}")))
    }

    /// A script that reads the part, of these bytes, and makes groups of its named solids; and the volume of its solids.
    fn script(&self, part: &Path, bytes: &[u8]) -> Result<(String, f64), RunError> {
        let io = |e: std::io::Error| self.io(&e);
        // A copy, because a script cannot hold every path.
        let extension = part.extension().unwrap_or_default().to_string_lossy();
        let copy = format!("part.{extension}");
        std::fs::write(self.folder.join(&copy), bytes).map_err(io)?;
        let file = self.folder.join("part.geo");
        let mut text = format!("Merge \"{copy}\";\n");
        let volumes = "v() = Volume{:};\nFor i In {0 : #v() - 1}\n\
                       Printf(\"%.17g\", Mass Volume{v(i)}) >> \"volumes.txt\";\nEndFor\n";
        let first = format!("SetFactory(\"OpenCASCADE\");\n{text}{volumes}");
        std::fs::write(&file, first).map_err(io)?;
        // -0 makes no mesh, -3 saves a set of nodes for each solid: empty, but with the name of the solid.
        let sets = self.folder.join("names.inp");
        let mut command = Command::new("gmsh");
        command
            .arg(&file)
            .args(["-0", "-format", "inp", "-v", "2"])
            .args(["-setnumber", "Mesh.SaveGroupsOfNodes", "-3"]);
        self.write(command, &sets)?;
        let sets = String::from_utf8_lossy(&std::fs::read(&sets).map_err(io)?).into_owned();
        for (name, solids) in groups(&sets) {
            let solids: Vec<String> = solids.iter().map(usize::to_string).collect();
            let _ = writeln!(
                text,
                "Physical Volume(\"{name}\") = {{{}}};",
                solids.join(", ")
            );
        }
        // Without solids there is no file.
        let volumes = self.folder.join("volumes.txt");
        let volumes = std::fs::read_to_string(volumes).unwrap_or_default();
        let volumes = volumes.split_whitespace().map(|v| v.parse().unwrap_or(0.0));
        Ok((text, volumes.map(f64::abs).sum()))
    }

    /// The tets of a script, unfolded, with so many edges around a full circle and smaller cells at some places.
    fn tets(
        &self,
        script: &str,
        options: CadOptions,
        circle: u32,
        places: &[(Vec3, f64)],
    ) -> Result<Tets, RunError> {
        let made = format!("{circle}_{}.msh", places.len());
        let made = self.folder.join(made);
        let file = self.folder.join("part.geo");
        let text = format!("{script}{}", sizes(places, options.cell));
        std::fs::write(&file, text).map_err(|e| self.io(&e))?;
        // Tets, also of no group. Curved tets are not mended by gmsh, which may take hours.
        let mut command = Command::new("gmsh");
        command
            .arg(&file)
            .args(["-3", "-format", "msh41", "-bin", "-v", "4", "-save_all"])
            .args(["-order", &options.order.to_string()])
            .args(["-clmax", &options.cell.to_string()])
            .args([
                "-setnumber",
                "Mesh.MeshSizeFromCurvature",
                &circle.to_string(),
            ])
            .args(["-setnumber", "Mesh.HighOrderOptimize", "0"]);
        self.write(command, &made)?;
        let mut bytes = std::fs::read(&made).map_err(|e| self.io(&e))?;
        // A file without solids has none to unfold, and is refused where it is read.
        let Ok(read) = crate::io::read_scaffold(&made) else {
            return Ok(Tets {
                quality: f64::INFINITY,
                bytes,
                places: Vec::new(),
            });
        };
        let nodes = read.scaffold.unfolded();
        let both = read.scaffold.nodes().iter().zip(&nodes);
        let moved: Vec<[Vec3; 2]> = both
            .map(|(a, b)| [*a, *b])
            .filter(|m| m[0] != m[1])
            .collect();
        if !moved.is_empty() && crate::io::move_nodes(&mut bytes, &moved).is_none() {
            return Err((self.failed)(format!(
                "{} middles of tets must move so that no tet folds or is a sliver, but gmsh wrote no binary file of version 4.1; \
                 expected gmsh 4.8 or later",
                moved.len()
            )));
        }
        let unfolded = with_nodes(&read.scaffold, nodes);
        let (quality, places) = match unfolded {
            Ok(s) => (worst_quality(&s), thin_places(&s, options.cell)),
            Err(_) => (-1.0, Vec::new()),
        };
        Ok(Tets {
            quality,
            bytes,
            places,
        })
    }
}

/// A script's lines for cells of some sizes at places: so large within a ball of this radius, and then growing up to
/// `cell`.
fn sizes(places: &[(Vec3, f64)], cell: f64) -> String {
    let mut text = String::new();
    for (n, (at, size)) in (1..).zip(places) {
        let layer = (cell - size) / GROWTH;
        let _ = writeln!(
            text,
            "Field[{n}] = Ball;\nField[{n}].XCenter = {};\nField[{n}].YCenter = {};\nField[{n}].ZCenter = {};\n\
             Field[{n}].Radius = {size};\nField[{n}].Thickness = {layer};\n\
             Field[{n}].VIn = {size};\nField[{n}].VOut = {cell};",
            at.x, at.y, at.z
        );
    }
    if !places.is_empty() {
        let (all, last) = (places.len(), places.len() + 1);
        let _ = writeln!(
            text,
            "Field[{last}] = Min;\nField[{last}].FieldsList = {{1:{all}}};\nBackground Field = {last};"
        );
    }
    text
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
        let expected = [("base_plate", vec![5]), ("nut", vec![1, 3])];
        let expected = expected.map(|(name, solids)| (name.to_owned(), solids));
        assert_eq!(groups(sets), BTreeMap::from(expected));
    }
}
