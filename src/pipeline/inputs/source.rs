//! Sources of cells: geometry in the reference frame of an element, from the keys of a section.
//!
//! Exactly one key names the source: a mesh, points, voxels, a graph, plates, a formula, a crystal, a named surface or
//! a cell file. The last two are cells already; all others are fitted, or transformed where voxels sample a period.
//! What the reading finds out (boxes, warnings, the file) goes into a record for the report. The level is not set here.

use super::crystals::Crystal;
use super::fit_options::fit_options;
use super::input_files::frame_map;
use crate::cell::{
    Caps, Cell, FitError, Placement, Skeleton, Source, Surface, Voxels, default_group, fit_source,
    graphs, operators_of, plate_sets,
};
use crate::field::Formula;
use crate::frame::{Aabb, Element, LengthUnit, Vec3};
use crate::io::{MeshFormat, Place, ReadError, TEXT_CLOUDS};
use crate::mesh::{CloudSolid, TriMesh};
use crate::pipeline::base::error::{CellFault, RunError};
use crate::pipeline::base::warning::Warning;
use crate::recipe;
use crate::recipe::{Brief, CellPlace, CellSection, FileFrame, Recipe, Short};
use crate::symmetry::GROUP_NAMES;
use crate::vdb::{LevelSet, Session};
use std::path::{Path, PathBuf};

/// Default radius of struts, and default thickness of plates, reference lengths.
const DEFAULT_RADIUS: f64 = 0.1;
const DEFAULT_THICKNESS: f64 = 0.1;
/// Kept share of a source's energy below which Druse looks for a better origin.
const MIN_KEPT_ENERGY: f64 = 0.9;

/// Warnings and files of a source.
#[derive(Default)]
pub(crate) struct SourceRecord {
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// The file, its key and its box in reference coordinates.
    pub file: Option<(&'static str, PathBuf, Aabb)>,
    /// The crystal and its box in reference coordinates.
    pub crystal: Option<(Crystal, Aabb)>,
}

impl SourceRecord {
    fn warn(&mut self, code: &'static str, messages: &[String]) {
        let coded = messages
            .iter()
            .cloned()
            .map(|message| Warning { code, message });
        self.warnings.extend(coded);
    }
}

/// The struts and plates of a cell of a recipe, in reference coordinates; none for a cell of another source.
pub(crate) fn skeleton(
    recipe: &Recipe,
    section: &CellSection,
    element: Element,
) -> Result<Skeleton, SourceFault> {
    skeleton_by(section, element, &|path| recipe.resolve(path))
}

/// The struts and plates of a cell; `resolve` makes paths absolute.
pub(crate) fn skeleton_by(
    section: &CellSection,
    element: Element,
    resolve: &dyn Fn(&Path) -> PathBuf,
) -> Result<Skeleton, SourceFault> {
    let Some(f) = section.graph.as_ref().or(section.plates.as_ref()) else {
        return Ok(Skeleton::new());
    };
    let path = has_extension(&f.path, &GRAPH_FILES).then(|| resolve(&f.path));
    Ok(struts_and_plates(section, f, element, path.as_deref())?.0)
}

/// Notes on the parts of a graph's file that are not read.
pub(crate) fn skeleton_notes(
    recipe: &Recipe,
    section: &CellSection,
) -> Result<Vec<String>, ReadError> {
    let graph = section.graph.as_ref().or(section.plates.as_ref());
    match graph.filter(|f| has_extension(&f.path, &["3mf"])) {
        Some(f) => {
            let read = crate::io::read_skeleton_noted(&recipe.resolve(&f.path), None, None)?;
            Ok(read.1)
        }
        None => Ok(Vec::new()),
    }
}

/// Extensions of graphs in files.
const GRAPH_FILES: [&str; 3] = ["toml", "json", "3mf"];

/// Struts or plates, by name or from the file `path`, and notes on parts of the file that are not read. `f` gives
/// the name, or the frame of the file. Radii of the section replace those of a file.
fn struts_and_plates(
    section: &CellSection,
    f: &FileFrame,
    element: Element,
    path: Option<&Path>,
) -> Result<(Skeleton, Vec<String>), SourceFault> {
    let radius = section.radius.map(|r| r.0);
    let thickness = section.plate_thickness.map(|t| t.0);
    let name = f.path.to_string_lossy();
    let skeleton = match path {
        Some(path) => {
            let (read, notes) = crate::io::read_skeleton_noted(path, radius, thickness)?;
            let map = frame_map(f, None, LengthUnit::default());
            return Ok((read.mapped(map, f.transform.scale.0), notes));
        }
        None if section.graph.is_some() => {
            Skeleton::graph(element, &name, radius.unwrap_or(DEFAULT_RADIUS))?
        }
        None => Skeleton::plates_of(element, &name, thickness.unwrap_or(DEFAULT_THICKNESS))?,
    };
    Ok((skeleton, Vec::new()))
}

/// Reads sources and makes cells of them.
#[derive(Clone, Copy)]
pub(crate) struct SourceReader<'a> {
    /// The recipe of the section; without one, paths are relative to the working directory.
    pub recipe: Option<&'a Recipe>,
    pub session: Session<'a>,
}

impl SourceReader<'_> {
    /// Resolves a path of the section.
    pub(crate) fn resolve(&self, path: &Path) -> PathBuf {
        self.recipe
            .map_or_else(|| path.to_owned(), |r| r.resolve(path))
    }

    /// The source that a section names, unless it is a surface, a cell file or a hybrid. Its file, box and
    /// warnings go to `record`.
    pub fn source(
        &self,
        section: &CellSection,
        element: Element,
        record: &mut SourceRecord,
    ) -> Result<Source, SourceFault> {
        let place = section
            .place
            .as_ref()
            .map_or(Placement::Reference, placement);
        let caps = match section.caps.unwrap_or_default() {
            recipe::Caps::Exclude => Caps::Exclude,
            recipe::Caps::Keep => Caps::Keep,
        };
        let mut file: Option<(&'static str, PathBuf)> = None;
        let mut crystal = None;
        // Exactly one key is present, as the recipe's check requires; the first that is found decides.
        let mut open = |key: &'static str, f: &FileFrame| {
            let path = self.resolve(&f.path);
            file = Some((key, path.clone()));
            path
        };
        let source = if let Some(f) = &section.mesh {
            let path = open("mesh", f);
            let read = crate::io::read_mesh(&path)?;
            record.warn(Warning::MESH, &read.warnings);
            let mesh = placed(&read.mesh, f);
            Source::mesh(element, &mesh, &place, caps).map_err(|e| in_file(&path, e))?
        } else if let Some(f) = &section.points {
            let path = open("points", f);
            let read = crate::io::read_points(&path)?;
            let map = frame_map(f, None, LengthUnit::default());
            let origin = map(Vec3::zeros());
            let points = read.points.into_iter().map(&map).collect();
            // Normals are turned, but not translated.
            let normals: Vec<Vec3> = read.normals.into_iter().map(|n| map(n) - origin).collect();
            let cloud = CloudSolid::new(points, &normals)
                .map_err(|e| ReadError::data(&path, Place::File, e.to_string(), "a solid"))?;
            Source::points(element, cloud, &place)?
        } else if let Some(f) = &section.voxels {
            let path = open("voxels", f);
            if has_extension(&path, &["vdb"]) {
                let set = LevelSet::read(&path, None, self.session)
                    .map_err(|e| SourceFault::Run(e.into()))?;
                let mesh = set.to_mesh(self.session).map_err(|error| {
                    SourceFault::Run(RunError::LevelSet {
                        stage: path.display().to_string(),
                        error,
                    })
                })?;
                let mesh = placed(&mesh, f);
                Source::mesh(element, &mesh, &place, caps).map_err(|e| in_file(&path, e))?
            } else {
                let array = crate::io::read_npy(&path)?;
                let voxels = Voxels::new(&array.shape, array.values, array.binary)
                    .map_err(FitError::from)?;
                Source::voxels(element, &voxels, &place)?
            }
        } else if let Some(f) = section.graph.as_ref().or(section.plates.as_ref()) {
            // A graph is a file, or a name of the library.
            let key = if section.graph.is_some() {
                "graph"
            } else {
                "plates"
            };
            let path = has_extension(&f.path, &GRAPH_FILES).then(|| open(key, f));
            let (skeleton, notes) = struts_and_plates(section, f, element, path.as_deref())?;
            record.warn(Warning::MESH, &notes);
            Source::skeleton(element, &skeleton, &place)?
        } else if let (Some(frame), Some(recipe)) = (&section.crystal, self.recipe) {
            let made = Crystal::make(recipe, frame).map_err(SourceFault::Run)?;
            let mesh = made.solid(recipe, frame).map_err(SourceFault::Run)?;
            crystal = Some(made);
            Source::mesh(element, &mesh, &place, caps)?
        } else {
            // A section without any source is refused by the recipe's check; here its empty formula is.
            let text = section.formula.as_deref().unwrap_or_default();
            // Formulas may depend on the frame and the time of a sequence.
            let clock = self.recipe.map(|r| r.clock().constants());
            let constants = clock.as_ref().map_or(&[][..], |c| c);
            let formula = Formula::with_constants(text, &["x", "y", "z"], constants)
                .map_err(CellFault::from)?;
            Source::formula(element, formula, &place)?
        };
        let report = source.report();
        record.warn(Warning::MESH, source.warnings());
        let bounds = Aabb {
            min: Vec3::from(report.box_min),
            max: Vec3::from(report.box_max),
        };
        record.file = file.map(|(key, path)| (key, path, bounds));
        record.crystal = crystal.map(|c| (c, bounds));
        Ok(source)
    }

    /// The cell that a section describes, before its level is set: a named surface, a cell file, a sampled period,
    /// or a fit to a source.
    pub fn cell(
        &self,
        name: &str,
        section: &CellSection,
        element: Element,
        record: &mut SourceRecord,
    ) -> Result<Cell, SourceFault> {
        if let Some(surface) = &section.surface {
            return Ok(named_surface(surface, element)?.named(name));
        }
        if let Some(file) = &section.file {
            let path = self.resolve(&file.path);
            let cell = crate::io::read_cell(&path)?;
            if cell.element() != element {
                return Err(CellFault::Rule(format!(
                    "{} is a cell for a {}; expected one for a {}{}",
                    path.display(),
                    cell.element().name(),
                    element.name(),
                    scaffold_hint(cell.element())
                ))
                .into());
            }
            record.file = Some(("file", path, Aabb::of(element.vertices())));
            return Ok(cell.named(name));
        }
        let mut options = fit_options(section);
        if let Some(group) = &options.group {
            options.group = Some(self.group(group)?);
        }
        let cell_from_samples = self.cell_from_samples(name, section, element, &options, record)?;
        let cell = if let Some(cell) = cell_from_samples {
            cell
        } else {
            let source = self.source(section, element, record)?;
            // Frequencies beyond what the samples hold would fit noise.
            if section.band_limit.is_none() && section.tolerance.is_none() {
                options.band_limit = options.band_limit.min(source.max_band_limit());
            }
            let fitted = fit_source(name, element, &source, &options, self.session.progress);
            let cell = match fitted {
                // A source beside its centre of symmetry has none of the group's; another origin helps.
                Err(e @ FitError::NoSymmetricPart { .. }) if element != Element::Ball => {
                    let advice = origin_advice(&source, element)?;
                    return Err(CellFault::Rule(format!("{e}: {advice}")).into());
                }
                other => other?,
            };
            // The ball has a fixed centre.
            let movable = element != Element::Ball;
            if movable
                && cell
                    .report()
                    .is_some_and(|r| r.kept_energy < MIN_KEPT_ENERGY)
            {
                record.warn(Warning::CELL, &[origin_advice(&source, element)?]);
            }
            cell
        };
        record.warn(Warning::CELL, cell.report().map_or(&[], |r| &r.warnings));
        Ok(cell)
    }
}

impl SourceReader<'_> {
    /// The name of a group or its generators. A word that names a file stands for the generators in the
    /// file.
    fn group(&self, word: &str) -> Result<String, SourceFault> {
        let path = self.resolve(Path::new(word));
        if GROUP_NAMES.contains(&word) || word.contains(',') || !path.is_file() {
            return Ok(word.to_owned());
        }
        Ok(super::group::read_group(&path)?.line())
    }
}

/// Advice on a source that its group changes much: the origin about which the symmetric part keeps most of it, and
/// the placement that moves the source there.
fn origin_advice(source: &Source, element: Element) -> Result<String, CellFault> {
    let operators = operators_of(element, default_group(element))?;
    let best = source.best_origin(element, &operators);
    let [x, y, z] = best.place;
    Ok(format!(
        "of 8 origins along each axis, ({x}, {y}, {z}) keeps most of its energy, {:.3}{}",
        best.kept,
        if best.kept > MIN_KEPT_ENERGY {
            format!(": place = {{ translate = [{}, {}, {}] }}", -x, -y, -z)
        } else {
            ", so no placement makes it symmetric; a smaller group (C1 has none) keeps it, in \
             scaffolds whose elements all have the same orientation"
                .to_owned()
        }
    ))
}

/// Why a source cannot be read: a fault of the cell, or of the run.
pub(crate) enum SourceFault {
    Cell(CellFault),
    Run(RunError),
}

impl SourceFault {
    /// The error of a run for the cell of this key.
    pub fn of(self, key: &str) -> RunError {
        match self {
            Self::Run(e) => e,
            Self::Cell(CellFault::Fit(FitError::Cancelled(c))) => RunError::Cancelled(c),
            Self::Cell(CellFault::Target(e)) if e.is_cancelled() => {
                RunError::Cancelled(crate::progress::Cancelled)
            }
            Self::Cell(fault) => RunError::Cell {
                key: key.to_owned(),
                fault,
            },
        }
    }
}

impl<E: Into<CellFault>> From<E> for SourceFault {
    fn from(e: E) -> Self {
        Self::Cell(e.into())
    }
}

impl From<ReadError> for SourceFault {
    fn from(e: ReadError) -> Self {
        Self::Run(e.into())
    }
}

/// An error of a file's geometry, with the file.
pub(crate) fn in_file(path: &Path, error: FitError) -> SourceFault {
    let expected = match &error {
        FitError::Mesh(_) => "triangles that bound a solid",
        _ => return error.into(),
    };
    ReadError::data(path, Place::File, error.to_string(), expected).into()
}

/// A mesh placed by its section. Its coordinates are reference coordinates, whatever their unit.
fn placed(mesh: &TriMesh, file: &FileFrame) -> TriMesh {
    mesh.mapped(frame_map(file, None, LengthUnit::default()))
}

/// Whether a path has one of some extensions, in any case of letters.
pub(crate) fn has_extension(path: &Path, known: &[&str]) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    known.iter().any(|k| extension.eq_ignore_ascii_case(k))
}

/// The hint for a cell that no scaffold can take; empty for other cells.
pub(crate) fn scaffold_hint(element: Element) -> &'static str {
    match element {
        Element::Ball => {
            ": the icosahedral group has no lattice in space, so cells of the ball stand alone and \
             cannot fill a scaffold; use them in an operation: union = { cell = { name, size } }"
        }
        _ => "",
    }
}

/// A surface by its name.
pub(crate) fn named_surface(name: &str, element: Element) -> Result<Cell, CellFault> {
    let surface = Surface::from_name(name).ok_or_else(|| {
        let known: Vec<&str> = Surface::CATALOGUE.iter().map(|s| s.name()).collect();
        CellFault::Rule(format!(
            "no surface is named {name:?}; expected one of {}",
            known.join(", ")
        ))
    })?;
    Ok(surface.cell(element)?)
}

/// The placement of a source, from a section's key `place`.
fn placement(place: &CellPlace) -> Placement {
    match place {
        CellPlace::Reference => Placement::Reference,
        CellPlace::Fit => Placement::Fit,
        CellPlace::Similarity(s) => Placement::Similarity {
            scale: s.scale.0,
            rotate: s.rotate.map(|r| r.0),
            translate: Vec3::from(s.translate.map(|t| t.0)),
        },
        CellPlace::Vertices(v) => Placement::Vertices(v.iter().map(|p| Vec3::from(*p)).collect()),
    }
}

/// Sets an argument of the command line as the source of a section: by the extension of a file, the name
/// of a surface, strut graph or plate set, or as a formula.
///
/// # Errors
/// An input that is none of these; the hint lists the names. Also a CAD file, and a file that cannot be read.
pub fn set_source(input: &Path, section: &mut CellSection) -> Result<(), ReadError> {
    let text = input.to_str().unwrap_or("");
    let file = || Some(Brief(FileFrame::short(input.to_owned())));
    // Without an element, names of all elements are accepted; the element is then chosen by the caller.
    let elements = section
        .own_element()
        .map_or(Element::SCAFFOLD_ELEMENTS.to_vec(), |e| vec![e]);
    // Names before files: a file of such a name is reached as `./name`.
    let name = text.strip_suffix("_struts").unwrap_or(text);
    let is_offered = |names: fn(Element) -> &'static [&'static str]| {
        elements.iter().any(|e| names(*e).contains(&name))
    };
    if Surface::from_name(text).is_some() {
        section.surface = Some(text.to_owned());
    } else if is_offered(graphs) {
        section.graph = file();
    } else if is_offered(plate_sets) {
        section.plates = file();
    } else if has_extension(input, &["cell"]) {
        section.file = file();
    } else if has_extension(input, &["npy", "vdb"]) {
        section.voxels = file();
    } else if has_extension(input, &["toml", "json"]) || is_strut_file(input) {
        section.graph = file();
    } else if has_extension(input, &TEXT_CLOUDS) || crate::io::is_point_cloud(input)? {
        section.points = file();
    } else if has_extension(input, &["step", "stp", "iges", "igs", "brep"]) {
        let hint = "examples/cad/step_to_stl.py converts it to triangles with gmsh";
        let found = "a CAD file of exact surfaces";
        return Err(ReadError::data(input, Place::File, found, "triangles").with_hint(hint));
    } else if MeshFormat::of(input).is_some() || input.is_file() {
        section.mesh = file();
    } else if Formula::parse(text, &["x", "y", "z"]).is_ok() || looks_like_formula(text) {
        section.formula = Some(text.to_owned());
    } else {
        let names = |of: fn(Element) -> &'static [&'static str]| {
            let mut all: Vec<&str> = elements.iter().flat_map(|e| of(*e)).copied().collect();
            all.sort_unstable();
            all.dedup();
            all.join(", ")
        };
        let surfaces: Vec<&str> = Surface::CATALOGUE.iter().map(|s| s.name()).collect();
        let known: Vec<&str> = elements
            .iter()
            .flat_map(|e| graphs(*e).iter().chain(plate_sets(*e)))
            .copied()
            .chain(surfaces.iter().copied())
            .collect();
        let suggestion = recipe::nearest(text, &known);
        let suggestion = suggestion.map_or_else(String::new, |m| format!("did you mean {m:?}? "));
        let hint = format!(
            "{suggestion}an input is a file, a formula in x, y, z, a surface ({}), a strut graph ({}) or plates ({})",
            surfaces.join(", "),
            names(graphs),
            names(plate_sets)
        );
        return Err(ReadError::io(input, std::io::ErrorKind::NotFound.into()).with_hint(hint));
    }
    Ok(())
}

/// Whether a file holds beams and no triangles. Read errors appear where the file is read.
fn is_strut_file(input: &Path) -> bool {
    crate::io::is_strut_file(input).unwrap_or(false)
}

/// Whether a text is probably a formula, so that its syntax error helps more than "no such file".
fn looks_like_formula(text: &str) -> bool {
    let letters = ['x', 'y', 'z'];
    text.contains(['+', '*', '^', '(', ' ']) && text.contains(letters)
}
