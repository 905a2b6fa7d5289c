//! Scaffolds of a recipe, from a file or a parametric shape.
//!
//! A scaffold is made in this order: source (a file in its pose, a parametric shape, a filled mesh, the shell of a
//! crystal), then without inverted elements, then divided and repeated as the section requests. It is validated once:
//! folded, degenerate and overlapping elements are refused, other defects become warnings. Numbers of elements and
//! nodes are those of the file, also after a division.

use super::input_files::InputFiles;
use super::motion::{FileNodes, NodeMotion, NumberedScaffold, Pose, deformed, node_motion};
use super::run_cache::file_key;
use crate::frame::Vec3;
use crate::io::{ElementFile, Group};
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::report::ScaffoldReport;
use crate::pipeline::base::warning::Warning;
use crate::progress::Progress;
use crate::recipe::{CrystalFrame, FillKind, Recipe, ScaffoldSection, is_cad};
use crate::scaffold::{
    Connectivity, Divided, FillOptions, InvalidScaffold, Scaffold, ScaffoldError, Surface,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;

mod cad;
mod filling;
mod generated;

pub(crate) use cad::{CadMesh, CadOptions, cad_mesh};
pub(crate) use filling::{TetFilling, outer_mesh};
use generated::{box_scaffold, filling_cubes};

/// Chordal error of the scaffold's curved outer faces, voxels.
const CHORDAL_ERROR: f64 = 0.05;

/// The outer faces of the scaffold's components as solids, one each; curved faces to a chordal error of
/// `CHORDAL_ERROR` voxels of `voxel_size` (world units).
pub(crate) fn outer_faces(scaffold: &Scaffold, voxel_size: f64) -> Vec<MeshSolid> {
    let error = CHORDAL_ERROR * voxel_size;
    let components = 0..scaffold.components().len();
    let outer = components.map(|n| scaffold.boundary(n, error).mesh);
    outer.map(MeshSolid::new).collect()
}

/// A scaffold with the data of its source.
pub(crate) struct LoadedScaffold {
    pub scaffold: Arc<Scaffold>,
    pub report: ScaffoldReport,
    /// Named sets of its elements.
    pub groups: Vec<Group>,
    /// The mesh that bounds the solid, where cubes fill it.
    pub envelope: Option<Arc<MeshSolid>>,
    /// Velocity and place at rest of its nodes, where an output needs them.
    pub motion: NodeMotion,
}

/// A scaffold as its source describes it, before subdivision; `path` is its file, `envelope` the mesh that cuts it.
struct SourceScaffold {
    scaffold: Scaffold,
    path: Option<PathBuf>,
    /// The file's number of each node (of a shell or plate: of its surface's nodes); empty without a file.
    node_numbers: Vec<u64>,
    groups: Vec<Group>,
    envelope: Option<Arc<MeshSolid>>,
    /// What its file's reader merged or left out.
    notes: Vec<String>,
}

impl SourceScaffold {
    /// A scaffold that no file holds, without groups and notes.
    fn generated(scaffold: Scaffold) -> Self {
        Self {
            scaffold,
            path: None,
            node_numbers: Vec::new(),
            groups: Vec::new(),
            envelope: None,
            notes: Vec::new(),
        }
    }

    /// Replaces the scaffold's elements by parts of them and updates the groups.
    fn divided(self, divided: Divided) -> Self {
        let parents = divided.parents;
        let groups = self.groups.into_iter().map(|g| {
            let is_in = |p: &u32| g.elements.binary_search(p).is_ok();
            let parts = (0..parents.len() as u32).filter(|&e| is_in(&parents[e as usize]));
            Group {
                elements: parts.collect(),
                name: g.name,
            }
        });
        Self {
            groups: groups.collect(),
            scaffold: divided.scaffold,
            ..self
        }
    }
}

/// A valid scaffold.
#[derive(Clone)]
pub(crate) struct CheckedScaffold {
    scaffold: Arc<Scaffold>,
    report: ScaffoldReport,
    node_numbers: Vec<u64>,
    groups: Vec<Group>,
    envelope: Option<Arc<MeshSolid>>,
}

/// Reads or makes the scaffold that a section describes, and validates it. A scaffold of an unchanged file is
/// taken from the session's cache. Warnings and files go to `files`.
///
/// # Errors
/// [`RunError::Scaffold`] for folded, degenerate or overlapping elements, and errors of files.
pub(crate) fn load(
    files: &mut InputFiles,
    section: &ScaffoldSection,
    progress: &dyn Progress,
) -> Result<LoadedScaffold, RunError> {
    let key = cache_key(files.recipe, section);
    let checked = files.kept(
        |cache| &cache.scaffolds,
        key,
        |files| {
            let source = divided_scaffold(files, section, &Pose::current(files.recipe), progress)?;
            let mut report = validate(files, &source.scaffold, source.path.as_deref())?;
            for note in &source.notes {
                log::info!(target: "druse::scaffold", "scaffold: {note}");
            }
            report.notes = source.notes;
            Ok(CheckedScaffold {
                scaffold: Arc::new(source.scaffold),
                report,
                node_numbers: source.node_numbers,
                groups: source.groups,
                envelope: source.envelope,
            })
        },
    )?;
    let here = NumberedScaffold {
        scaffold: &checked.scaffold,
        node_numbers: &checked.node_numbers,
    };
    // Velocity and place at rest need the scaffold at other frames, read and divided in the same way.
    let motion = node_motion(files, section, here, |files, pose| {
        let other = divided_scaffold(files, section, pose, progress)?;
        Ok((other.scaffold, other.node_numbers))
    })?;
    Ok(LoadedScaffold {
        scaffold: checked.scaffold,
        report: checked.report,
        groups: checked.groups,
        envelope: checked.envelope,
        motion,
    })
}

/// All that the scaffold of a file depends on; `None` for one that moves, or that has no file.
fn cache_key(recipe: &Recipe, section: &ScaffoldSection) -> Option<(String, String)> {
    let file = section.file.as_ref().filter(|_| section.motion.is_none())?;
    let file = file_key(&recipe.resolve(&file.path))?;
    // Lengths may be given in voxels.
    let has_lengths =
        section.shell.is_some() || section.plate.is_some() || section.cell_size.is_some();
    let scale = has_lengths.then(|| recipe.scale());
    let key = format!("{section:?} {:?} {scale:?} {file}", recipe.unit());
    Some(("scaffold".into(), key))
}

/// The scaffold of a section in a pose (its nodes at a frame), with its elements divided as the section wants
/// them. It is not validated.
fn divided_scaffold(
    files: &mut InputFiles,
    section: &ScaffoldSection,
    pose: &Pose,
    progress: &dyn Progress,
) -> Result<SourceScaffold, RunError> {
    let mut source = source_scaffold(files, section, pose, progress)?;
    let path = source.path.clone();
    let fail = |e: ScaffoldError| failed(path.as_deref(), &e);
    // Files are deformed where they are read; here generated shapes are.
    if source.path.is_none() && section.motion.is_some() {
        let nodes = source.scaffold.nodes().to_vec();
        let nodes = deformed(files.recipe, section, pose, nodes)?;
        source.scaffold = with_nodes(&source.scaffold, nodes).map_err(fail)?;
    }
    // Inverted elements go first, because division would multiply them.
    if section.skip_inverted {
        source = without_inverted(files, source)?;
    }
    if section.all_quad {
        let divided = source.scaffold.all_quad().map_err(fail)?;
        source = source.divided(divided);
    }
    if section.all_hex {
        let divided = source.scaffold.all_hex().map_err(fail)?;
        source = source.divided(divided);
    }
    for _ in 0..section.refine {
        let divided = source.scaffold.refined().map_err(fail)?;
        source = source.divided(divided);
    }
    if let Some(times) = section.repeat {
        let divided = source.scaffold.repeated(times).map_err(fail)?;
        source = source.divided(divided);
    }
    Ok(source)
}

/// The error for a scaffold of a file, or of none.
fn failed(path: Option<&Path>, error: &ScaffoldError) -> RunError {
    RunError::Scaffold {
        file: path.map(Path::to_owned),
        element: None,
        message: error.to_string(),
    }
}

/// The scaffold of a section in a pose: a parametric shape, a filled mesh, the shell of a crystal,
/// or a file. Lengths are in the recipe's unit.
fn source_scaffold(
    files: &mut InputFiles,
    section: &ScaffoldSection,
    pose: &Pose,
    progress: &dyn Progress,
) -> Result<SourceScaffold, RunError> {
    let scale = files.recipe.scale();
    let made = |s: Result<Scaffold, ScaffoldError>| {
        s.map(SourceScaffold::generated)
            .map_err(|e| failed(None, &e))
    };
    let resolved = |o: &[crate::recipe::Length; 3]| Vec3::from(o.map(|o| o.resolve(scale)));
    if let Some(block) = &section.block {
        return made(box_scaffold(block, scale));
    }
    if let Some(c) = &section.cylinder {
        let [radius, height, cell] = [c.radius, c.height, c.cell_size].map(|s| s.resolve(scale));
        let shift = resolved(&c.origin);
        let scaffold = match c.inner_radius {
            Some(inner) => Scaffold::tube(inner.resolve(scale), radius, height, cell),
            None => Scaffold::cylinder(radius, height, cell),
        };
        return made(scaffold.and_then(|s| moved(&s, |v| v + shift)));
    }
    if let Some(c) = &section.sphere {
        let [radius, cell] = [c.radius, c.cell_size].map(|s| s.resolve(scale));
        let shift = resolved(&c.centre);
        return made(Scaffold::ball(radius, cell).and_then(|s| moved(&s, |v| v + shift)));
    }
    if let Some(fill) = &section.fill {
        let Some(surface) = fill.surface() else {
            // The recipe's check requires a surface in `fill`, and below a source in the section.
            return Err(RunError::Empty("no mesh to fill".into()));
        };
        let key = format!("scaffold.fill.{}", surface.word());
        let solid = files.solid(&key, surface)?;
        if fill.kind == FillKind::Tet {
            let options = FillOptions {
                cell: fill.cell_size.resolve(scale),
                order: fill.order.map(|o| o.0),
            };
            let filling = TetFilling::new(&solid, options, progress)?;
            for message in filling.warnings {
                files.warn(TetFilling::CODE, message)?;
            }
            return Ok(SourceScaffold::generated(filling.scaffold));
        }
        let scaffold = filling_cubes(&solid, fill, scale).map_err(|e| failed(None, &e))?;
        // The mesh cuts the cubes.
        return Ok(SourceScaffold {
            envelope: Some(solid),
            ..SourceScaffold::generated(scaffold)
        });
    }
    if let (Some(frame), Some(shell)) = (&section.crystal, &section.shell) {
        return crystal_shell(files, frame, shell.thickness.resolve(scale));
    }
    let Some(file) = &section.file else {
        return Err(RunError::Empty("no scaffold".into()));
    };
    let path = pose.path(files.recipe, file);
    let fail = |e: ScaffoldError| failed(Some(&path), &e);
    let (read, volume) = read_part(&path, section, files.recipe, progress)?;
    for warning in read.warnings() {
        files.warn(Warning::SCAFFOLD, format!("scaffold: {warning}"))?;
    }
    let notes = read.notes().to_vec();
    let source = match read {
        ElementFile::Solids(read) => {
            // Elements that are left out need no check.
            if is_cad(&path) && !section.skip_inverted {
                let found = TetFilling::of_cad(&read.scaffold, volume);
                for message in found.map_err(|message| RunError::Scaffold {
                    file: Some(path.clone()),
                    element: None,
                    message,
                })? {
                    files.warn(TetFilling::CODE, message)?;
                }
            }
            if section.shell.is_some() || section.plate.is_some() {
                return Err(RunError::Scaffold {
                    file: Some(path),
                    element: None,
                    message: "shell and plate belong to a surface; the file has solid elements"
                        .into(),
                });
            }
            let nodes = FileNodes {
                nodes: read.scaffold.nodes(),
                numbers: &read.node_numbers,
                unused: read.unused_nodes,
                fields: &read.fields,
            };
            let nodes = nodes.posed(files, section, pose, file, &path)?;
            let scaffold = with_nodes(&read.scaffold, nodes).map_err(fail)?;
            SourceScaffold {
                scaffold,
                node_numbers: read.node_numbers,
                groups: read.groups,
                path: Some(path.clone()),
                envelope: None,
                notes,
            }
        }
        ElementFile::Surface(read) => {
            let nodes = FileNodes {
                nodes: read.surface.nodes(),
                numbers: &read.node_numbers,
                unused: read.unused_nodes,
                fields: &read.fields,
            };
            // The surface moves before it gets its thickness, which stays the same.
            let nodes = nodes.posed(files, section, pose, file, &path)?;
            let surface = read.surface.with_nodes(nodes).map_err(fail)?;
            let scaffold = match (&section.shell, &section.plate) {
                (Some(shell), _) => {
                    warn_thin_walls(files, &surface)?;
                    surface.shell(shell.thickness.resolve(scale))
                }
                (_, Some(plate)) => {
                    let size = surface.bounds().half_diagonal();
                    // Below that the deviation from a plane is rounding.
                    if surface.unevenness() > 1e-6 * size {
                        files.warn(
                            Warning::SCAFFOLD,
                            format!(
                                "scaffold: the mesh deviates from a plane of constant z by up to {:.3e}; \
                                 the plate follows it (shell = has its thickness along normals)",
                                surface.unevenness()
                            ),
                        )?;
                    }
                    surface.plate(plate.height.resolve(scale))
                }
                (None, None) => {
                    return Err(RunError::Scaffold {
                        file: Some(path),
                        element: None,
                        message: format!(
                            "found only {} surface elements; expected solids, or a thickness for the \
                             surface: shell = {{ thickness = ... }}, plate = {{ height = ... }}",
                            surface.len()
                        ),
                    });
                }
            };
            SourceScaffold {
                scaffold: scaffold.map_err(fail)?,
                node_numbers: read.node_numbers,
                groups: read.groups,
                path: Some(path.clone()),
                envelope: None,
                notes,
            }
        }
    };
    let key = pose.key();
    // A file is recorded once, also if the velocity reads it again.
    if files.inputs.iter().all(|i| i.key != key) {
        files.record(&key, &path, source.scaffold.bounds())?;
    }
    Ok(source)
}

/// The elements of a file; a CAD part is meshed first, if `cell_size` gives the edge of its tets, of order 2 by
/// default. Then its volume, else 0.
fn read_part(
    path: &Path,
    section: &ScaffoldSection,
    recipe: &Recipe,
    progress: &dyn Progress,
) -> Result<(ElementFile, f64), RunError> {
    let Some(cell) = section.cell_size.filter(|_| is_cad(path)) else {
        return Ok((crate::io::read_elements(path)?, 0.0));
    };
    let options = CadOptions {
        cell: cell.resolve(recipe.scale()),
        order: section.order.map_or(2, |o| o.0),
        is_scaffold: section.shell.is_none() && section.plate.is_none(),
    };
    let mesh = cad_mesh(path, options, progress)?;
    Ok((crate::io::read_elements(mesh.path)?, mesh.volume))
}

/// Warns of a shell whose walls are thinner than its thickness.
fn warn_thin_walls(files: &mut InputFiles, surface: &Surface) -> Result<(), RunError> {
    // A surface without a common outside is refused where its shell is made.
    let Ok(Some(wall)) = surface.thinnest_wall() else {
        return Ok(());
    };
    files.warn(
        Warning::SCAFFOLD,
        format!(
            "scaffold: at {} nodes the walls of the shell are too thin, at ({}) {} of its thickness: \
             creases that turn by more than 150 degrees get no longer mitre",
            wall.count,
            [wall.place.x, wall.place.y, wall.place.z].map(short_number).join(", "),
            short_number(wall.fraction)
        ),
    )
}

/// The shell of a crystal's faces, of a thickness in recipe units. Face groups become element
/// groups, because each face becomes one element.
fn crystal_shell(
    files: &mut InputFiles,
    frame: &CrystalFrame,
    thickness: f64,
) -> Result<SourceScaffold, RunError> {
    let mesh = files.crystal("scaffold.crystal", frame)?.mesh;
    let invalid = |message: String| RunError::Scaffold {
        file: None,
        element: None,
        message: format!("crystal {}: {message}", frame.name),
    };
    let surface = mesh.surface().map_err(|e| invalid(e.to_string()))?;
    warn_thin_walls(files, &surface)?;
    let scaffold = surface
        .shell(thickness)
        .map_err(|e| invalid(e.to_string()))?;
    // Face n of the mesh is element n of the shell.
    let groups = mesh.group_counts().into_keys().map(|group| {
        let elements =
            (0..mesh.face_count() as u32).filter(|&f| mesh.groups()[f as usize] == group);
        Group {
            name: format!("group{group}"),
            elements: elements.collect(),
        }
    });
    Ok(SourceScaffold {
        groups: groups.collect(),
        ..SourceScaffold::generated(scaffold)
    })
}

/// Removes elements whose Jacobian changes its sign or vanishes, with a warning; the others keep their numbers and
/// groups.
fn without_inverted(
    files: &mut InputFiles,
    source: SourceScaffold,
) -> Result<SourceScaffold, RunError> {
    let found = source.scaffold.report();
    let mut inverted: Vec<u32> = found
        .folded
        .iter()
        .chain(&found.degenerate)
        .map(|b| b.element)
        .collect();
    if inverted.is_empty() {
        return Ok(source);
    }
    inverted.sort_unstable();
    // The first five show where to search in the file.
    let numbers: Vec<String> = inverted
        .iter()
        .take(5)
        .map(|&e| source.scaffold.number(e as usize).to_string())
        .collect();
    files.warn(
        Warning::SCAFFOLD,
        format!(
            "scaffold: {} inverted elements are left out: elements {}",
            inverted.len(),
            numbers.join(", ")
        ),
    )?;
    let whole = &source.scaffold;
    let keeps = |e: &usize| inverted.binary_search(&(*e as u32)).is_err();
    let kept: Vec<usize> = (0..whole.len()).filter(keeps).collect();
    let mut elements = Connectivity::default();
    for &e in &kept {
        elements.push(whole.connectivity().kind(e), whole.connectivity().nodes(e));
    }
    // The elements that stay keep their numbers of the file.
    let numbers = kept.iter().map(|&e| whole.number(e)).collect();
    let scaffold = Scaffold::new(whole.nodes().to_vec(), elements)
        .map_err(|e| failed(source.path.as_deref(), &e))?
        .with_numbers(numbers);
    let parents = kept.iter().map(|&e| e as u32).collect();
    Ok(source.divided(Divided { scaffold, parents }))
}

/// Refuses scaffolds with folded, degenerate or overlapping elements, warns of other defects, and returns the
/// report's entry. `path` is the file that an error names.
fn validate(
    files: &mut InputFiles,
    scaffold: &Scaffold,
    path: Option<&Path>,
) -> Result<ScaffoldReport, RunError> {
    let found = scaffold.validate().map_err(|e| {
        // Of two that overlap the second is named as the wrong one.
        let (element, message) = match &e {
            InvalidScaffold::Folded(inverted, _) | InvalidScaffold::Degenerate(inverted, _) => (
                inverted.number,
                format!("{e}; skip_inverted = true leaves such elements out"),
            ),
            InvalidScaffold::Overlap([_, second], _) => (*second, e.to_string()),
        };
        RunError::Scaffold {
            file: path.map(Path::to_owned),
            element: Some(element),
            message,
        }
    })?;
    for warning in found.warnings() {
        files.warn(Warning::SCAFFOLD, format!("scaffold: {warning}"))?;
    }
    let kinds = found.kinds.iter();
    Ok(ScaffoldReport {
        elements: kinds
            .map(|(kind, n)| (kind.name().to_owned(), *n as u64))
            .collect(),
        inverted: found.folded.len() as u64,
        hanging: found.defects.hanging.len() as u64,
        components: found.components as u64,
        volume: found.volume,
        notes: Vec::new(),
        dihedral_degrees: scaffold.dihedral_range(),
    })
}

/// A scaffold with its nodes moved; its elements keep their numbers.
fn moved(scaffold: &Scaffold, map: impl Fn(Vec3) -> Vec3) -> Result<Scaffold, ScaffoldError> {
    with_nodes(scaffold, scaffold.nodes().iter().map(|&v| map(v)).collect())
}

/// A scaffold with other nodes; its elements keep their numbers.
fn with_nodes(scaffold: &Scaffold, nodes: Vec<Vec3>) -> Result<Scaffold, ScaffoldError> {
    let numbers = (0..scaffold.len()).map(|e| scaffold.number(e)).collect();
    let elements = scaffold.connectivity().clone();
    Ok(Scaffold::new(nodes, elements)?.with_numbers(numbers))
}
