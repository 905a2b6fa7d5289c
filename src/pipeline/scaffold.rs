//! Scaffolds of a recipe: from a file or a shape to elements that can be filled.

use super::error::RunError;
use super::input_files::{Inputs, frame_map};
use super::report::{ScaffoldReport, Warning};
use crate::frame::{Aabb, Vec3};
use crate::io::{ElementFile, Group};
use crate::mesh::MeshSolid;
use crate::recipe::{
    BoxKind, BoxScaffold, CrystalFrame, FillKind, FillScaffold, ScaffoldSection, Scale,
};
use crate::scaffold::{Connectivity, Divided, InvalidScaffold, Kind, Scaffold, ScaffoldError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most hexes that fill a mesh.
const MOST: f64 = 2e7;

/// A scaffold, and what is known of it from its source.
pub(super) struct Loaded {
    pub scaffold: Scaffold,
    pub report: ScaffoldReport,
    /// Named sets of its elements.
    pub groups: Vec<Group>,
    /// The mesh that ends the solid of a filled one.
    pub envelope: Option<Arc<MeshSolid>>,
}

/// What a source gave, before it is divided.
struct Raw {
    scaffold: Scaffold,
    path: Option<PathBuf>,
    groups: Vec<Group>,
    envelope: Option<Arc<MeshSolid>>,
    /// What its file's reader merged or left out.
    notes: Vec<String>,
}

impl Raw {
    fn plain(scaffold: Scaffold) -> Self {
        Self {
            scaffold,
            path: None,
            groups: Vec::new(),
            envelope: None,
            notes: Vec::new(),
        }
    }

    /// The same with the scaffold's elements replaced by parts of them.
    fn divided(self, cut: Divided) -> Self {
        let parents = cut.parents;
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
            scaffold: cut.scaffold,
            ..self
        }
    }
}

/// Reads or makes the scaffold that a section describes, and judges it.
pub(super) fn load(inputs: &mut Inputs, section: &ScaffoldSection) -> Result<Loaded, RunError> {
    let mut raw = source(inputs, section)?;
    let path = raw.path.clone();
    let fail = |e: ScaffoldError| failed(path.as_deref(), &e);
    if section.skip_inverted {
        raw = without_inverted(inputs, raw)?;
    }
    if section.all_quad {
        let cut = raw.scaffold.all_quad().map_err(fail)?;
        raw = raw.divided(cut);
    }
    if section.all_hex {
        let cut = raw.scaffold.all_hex().map_err(fail)?;
        raw = raw.divided(cut);
    }
    for _ in 0..section.refine {
        let cut = raw.scaffold.refined().map_err(fail)?;
        raw = raw.divided(cut);
    }
    if let Some(times) = section.repeat {
        let cut = raw.scaffold.repeated(times).map_err(fail)?;
        raw = raw.divided(cut);
    }
    let mut report = judge(inputs, &raw.scaffold, path.as_deref())?;
    report.notes = raw.notes;
    Ok(Loaded {
        scaffold: raw.scaffold,
        report,
        groups: raw.groups,
        envelope: raw.envelope,
    })
}

fn failed(path: Option<&Path>, error: &ScaffoldError) -> RunError {
    RunError::Scaffold {
        file: path.map(Path::to_owned),
        element: None,
        message: error.to_string(),
    }
}

fn source(inputs: &mut Inputs, section: &ScaffoldSection) -> Result<Raw, RunError> {
    let scale = inputs.recipe.scale();
    let made = |s: Result<Scaffold, ScaffoldError>| s.map(Raw::plain).map_err(|e| failed(None, &e));
    let at = |o: &[crate::recipe::Length; 3]| Vec3::from(o.map(|o| o.resolve(scale)));
    if let Some(block) = &section.block {
        return made(box_scaffold(block, scale));
    }
    if let Some(c) = &section.cylinder {
        let [radius, height, cell] = [c.radius, c.height, c.cell_size].map(|s| s.resolve(scale));
        let shift = at(&c.origin);
        let scaffold = match c.inner_radius {
            Some(inner) => Scaffold::tube(inner.resolve(scale), radius, height, cell),
            None => Scaffold::cylinder(radius, height, cell),
        };
        return made(scaffold.and_then(|s| moved(&s, |v| v + shift)));
    }
    if let Some(c) = &section.sphere {
        let [radius, cell] = [c.radius, c.cell_size].map(|s| s.resolve(scale));
        let shift = at(&c.centre);
        return made(Scaffold::ball(radius, cell).and_then(|s| moved(&s, |v| v + shift)));
    }
    if let Some(fill) = &section.fill {
        let Some(surface) = fill.surface() else {
            return Err(RunError::Empty("no mesh to fill".into()));
        };
        let key = format!("scaffold.fill.{}", surface.word());
        let solid = Arc::new(inputs.solid(&key, surface)?);
        let scaffold = filled(&solid, fill, scale).map_err(|e| failed(None, &e))?;
        // The mesh cuts the cubes; tets end at it.
        let envelope = (fill.kind == FillKind::Hex).then_some(solid);
        return Ok(Raw {
            envelope,
            ..Raw::plain(scaffold)
        });
    }
    if let (Some(frame), Some(shell)) = (&section.crystal, &section.shell) {
        return crystal_shell(inputs, frame, shell.thickness.resolve(scale));
    }
    let Some(file) = &section.file else {
        return Err(RunError::Empty("no scaffold".into()));
    };
    let path = inputs.recipe.resolve(&file.path);
    let fail = |e: ScaffoldError| failed(Some(&path), &e);
    let map = frame_map(file, file.unit.map(|u| u.0), inputs.recipe.unit());
    let read = crate::io::read_elements(&path)?;
    for warning in read.warnings() {
        inputs.warn(Warning::SCAFFOLD, format!("scaffold: {warning}"))?;
    }
    let notes = read.notes().to_vec();
    let raw = match read {
        ElementFile::Solids(file) => {
            if section.shell.is_some() || section.plate.is_some() {
                return Err(RunError::Scaffold {
                    file: Some(path),
                    element: None,
                    message: "shell and plate belong to a surface; the file has solid elements"
                        .into(),
                });
            }
            let scaffold = moved(&file.scaffold, map).map_err(fail)?;
            Raw {
                scaffold,
                groups: file.groups,
                path: Some(path.clone()),
                envelope: None,
                notes,
            }
        }
        ElementFile::Surface(file) => {
            let surface = file.surface.mapped(map).map_err(fail)?;
            let scaffold = match (&section.shell, &section.plate) {
                (Some(shell), _) => surface.shell(shell.thickness.resolve(scale)),
                (_, Some(plate)) => {
                    let size = surface.bounds().half_diagonal();
                    if surface.unevenness() > 1e-6 * size {
                        inputs.warn(
                            Warning::SCAFFOLD,
                            format!(
                                "scaffold: the mesh is not in a plane of constant z but up to {:.3e} \
                                 off; the plate follows it (shell = has its thickness along normals)",
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
            Raw {
                scaffold: scaffold.map_err(fail)?,
                groups: file.groups,
                path: Some(path.clone()),
                envelope: None,
                notes,
            }
        }
    };
    inputs.record("scaffold.file", &path, raw.scaffold.bounds())?;
    Ok(raw)
}

/// The shell of a crystal's faces, which keep their groups.
fn crystal_shell(
    inputs: &mut Inputs,
    frame: &CrystalFrame,
    thickness: f64,
) -> Result<Raw, RunError> {
    let mesh = inputs.crystal("scaffold.crystal", frame)?.mesh;
    let wrong = |message: String| RunError::Scaffold {
        file: None,
        element: None,
        message: format!("crystal {}: {message}", frame.name),
    };
    let surface = mesh.surface().map_err(|e| wrong(e.to_string()))?;
    let scaffold = surface.shell(thickness).map_err(|e| wrong(e.to_string()))?;
    let groups = mesh.group_counts().into_keys().map(|group| {
        let elements =
            (0..mesh.face_count() as u32).filter(|&f| mesh.groups()[f as usize] == group);
        Group {
            name: format!("group{group}"),
            elements: elements.collect(),
        }
    });
    Ok(Raw {
        groups: groups.collect(),
        ..Raw::plain(scaffold)
    })
}

/// Leaves out elements whose Jacobian changes its sign or vanishes, with a warning.
fn without_inverted(inputs: &mut Inputs, raw: Raw) -> Result<Raw, RunError> {
    let found = raw.scaffold.report();
    let mut bad: Vec<u32> = found
        .folded
        .iter()
        .chain(&found.degenerate)
        .map(|b| b.element)
        .collect();
    if bad.is_empty() {
        return Ok(raw);
    }
    bad.sort_unstable();
    let numbers: Vec<String> = bad
        .iter()
        .take(5)
        .map(|&e| raw.scaffold.number(e as usize).to_string())
        .collect();
    inputs.warn(
        Warning::SCAFFOLD,
        format!(
            "scaffold: {} inverted elements are left out: elements {}",
            bad.len(),
            numbers.join(", ")
        ),
    )?;
    let whole = &raw.scaffold;
    let keeps = |e: &usize| bad.binary_search(&(*e as u32)).is_err();
    let kept: Vec<usize> = (0..whole.len()).filter(keeps).collect();
    let mut elements = Connectivity::default();
    for &e in &kept {
        elements.push(whole.connectivity().kind(e), whole.connectivity().nodes(e));
    }
    let numbers = kept.iter().map(|&e| whole.number(e)).collect();
    let scaffold = Scaffold::new(whole.nodes().to_vec(), elements)
        .map_err(|e| failed(raw.path.as_deref(), &e))?
        .with_numbers(numbers);
    let parents = kept.iter().map(|&e| e as u32).collect();
    Ok(raw.divided(Divided { scaffold, parents }))
}

/// Refuses scaffolds that cannot be filled and warns of those with defects.
fn judge(
    inputs: &mut Inputs,
    scaffold: &Scaffold,
    path: Option<&Path>,
) -> Result<ScaffoldReport, RunError> {
    let found = scaffold.validate().map_err(|e| {
        let (element, message) = match &e {
            InvalidScaffold::Folded(bad, _) | InvalidScaffold::Degenerate(bad, _) => (
                bad.number,
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
        inputs.warn(Warning::SCAFFOLD, format!("scaffold: {warning}"))?;
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

/// A structured box: whole numbers of cells, as near to the asked size as possible.
fn box_scaffold(block: &BoxScaffold, scale: Scale) -> Result<Scaffold, ScaffoldError> {
    let size = Vec3::from(block.size.map(|s| s.resolve(scale)));
    let cell = block.cell_size.resolve(scale);
    let counts = [size.x, size.y, size.z].map(|s| (s / cell).round().max(1.0) as usize);
    let origin = Vec3::from(block.origin.map(|o| o.resolve(scale)));
    let kind = match block.kind {
        BoxKind::Hex => Kind::Hex8,
        BoxKind::Tet => Kind::Tet4,
        BoxKind::Wedge => Kind::Wedge6,
    };
    let scaffold = Scaffold::box_grid(size, counts, kind)?;
    if origin == Vec3::zeros() {
        return Ok(scaffold);
    }
    moved(&scaffold, |v| v + origin)
}

/// The cubes of a grid that meet a solid, or tets that fill it.
fn filled(solid: &MeshSolid, fill: &FillScaffold, scale: Scale) -> Result<Scaffold, ScaffoldError> {
    let cell = fill.cell_size.resolve(scale);
    let bounds = solid.bounds();
    if fill.kind == FillKind::Tet {
        return Scaffold::stuffed(bounds, cell, |p| solid.signed_distance(p));
    }
    let counts = bounds.size().map(|s| (s / cell).ceil().max(1.0));
    let found = counts.product();
    if !found.is_finite() || found > MOST {
        return Err(ScaffoldError::TooMany {
            found: found.min(1e18) as usize,
            what: "elements",
        });
    }
    // The grid is centred on the solid.
    let origin = bounds.centre().0 - counts * (cell / 2.0);
    let counts = [counts.x, counts.y, counts.z].map(|c| c as usize);
    let grid = Scaffold::box_grid(
        Vec3::from(counts.map(|c| c as f64 * cell)),
        counts,
        Kind::Hex8,
    )?;
    let mut elements = Connectivity::default();
    for e in 0..grid.len() {
        let own = grid.connectivity().nodes(e);
        let at = Aabb::of(own.iter().map(|&n| grid.nodes()[n as usize] + origin));
        // The distance decides but for cubes that the solid touches from within the half diagonal.
        let d = solid.signed_distance(at.centre().0);
        if d <= at.half_diagonal() {
            elements.push(Kind::Hex8, own);
        }
    }
    let nodes: Vec<Vec3> = grid.nodes().iter().map(|v| v + origin).collect();
    used_only(&nodes, &elements)
}

/// A scaffold without the nodes that no element uses.
fn used_only(nodes: &[Vec3], elements: &Connectivity) -> Result<Scaffold, ScaffoldError> {
    let mut new_number = vec![u32::MAX; nodes.len()];
    let mut kept = Vec::new();
    let mut renumbered = Connectivity::default();
    for e in 0..elements.len() {
        let own: Vec<u32> = elements
            .nodes(e)
            .iter()
            .map(|&n| {
                if new_number[n as usize] == u32::MAX {
                    new_number[n as usize] = kept.len() as u32;
                    kept.push(nodes[n as usize]);
                }
                new_number[n as usize]
            })
            .collect();
        renumbered.push(elements.kind(e), &own);
    }
    Scaffold::new(kept, renumbered)
}

/// A scaffold with its nodes moved; its elements keep their numbers.
fn moved(scaffold: &Scaffold, map: impl Fn(Vec3) -> Vec3) -> Result<Scaffold, ScaffoldError> {
    let nodes = scaffold.nodes().iter().map(|&v| map(v)).collect();
    let numbers = (0..scaffold.len()).map(|e| scaffold.number(e)).collect();
    let elements = scaffold.connectivity().clone();
    Ok(Scaffold::new(nodes, elements)?.with_numbers(numbers))
}
