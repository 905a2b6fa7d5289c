//! Sources of cells: from the keys of a section to geometry in the reference frame of an element.

use super::crystals::Crystal;
use super::error::RunError;
use super::fit_options::fit_options;
use super::input_files::frame_map;
use super::report::Warning;
use crate::cell::{
    Caps, FitError, Placement, Skeleton, SkeletonError, Source, Surface, Voxels, fit_source,
    graphs, plate_sets,
};
use crate::cell::{Cell, CellError, default_group, operators_of};
use crate::field::Formula;
use crate::frame::{Aabb, Element, LengthUnit, Vec3};
use crate::io::{MeshFormat, Place, ReadError, TEXT_CLOUDS};
use crate::mesh::{CloudSolid, TriMesh};
use crate::recipe::{self, Brief, CellPlace, CellSection, FileFrame, Recipe, Short};
use crate::symmetry::GROUP_NAMES;
use crate::vdb::{LevelSet, Session};
use std::path::{Path, PathBuf};

/// Why a cell of a recipe cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CellFault {
    /// A level, a surface, a lattice.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The source or the fit to it.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A formula that is none.
    #[error(transparent)]
    Formula(#[from] crate::field::FormulaError),
    /// What the recipe asks for cannot be.
    #[error("{0}")]
    Rule(String),
}

impl From<SkeletonError> for CellFault {
    fn from(e: SkeletonError) -> Self {
        Self::Fit(e.into())
    }
}

/// Radius of struts, and thickness of plates, that say none: reference lengths.
const RADIUS: f64 = 0.1;
const THICKNESS: f64 = 0.1;
/// Share of a source's energy below which another origin is looked for.
const LITTLE: f64 = 0.9;

/// What reading a source found beside it.
#[derive(Default)]
pub(super) struct Found {
    /// What looked wrong.
    pub warnings: Vec<Warning>,
    /// The file, its key and its box in reference coordinates.
    pub file: Option<(&'static str, PathBuf, Aabb)>,
    /// The crystal and its box in reference coordinates.
    pub crystal: Option<(Crystal, Aabb)>,
}

impl Found {
    fn warn(&mut self, code: &'static str, messages: &[String]) {
        let coded = messages
            .iter()
            .cloned()
            .map(|message| Warning { code, message });
        self.warnings.extend(coded);
    }
}

/// The struts and plates of a cell of a recipe, in reference coordinates.
pub(super) fn skeleton(
    recipe: &Recipe,
    section: &CellSection,
    element: Element,
) -> Result<Skeleton, SourceFault> {
    skeleton_by(section, element, &|path| recipe.resolve(path))
}

/// The same, with paths as `resolve` finds them.
pub(super) fn skeleton_by(
    section: &CellSection,
    element: Element,
    resolve: &dyn Fn(&Path) -> PathBuf,
) -> Result<Skeleton, SourceFault> {
    let Some(f) = section.graph.as_ref().or(section.plates.as_ref()) else {
        return Ok(Skeleton::new());
    };
    let path = has_extension(&f.path, &GRAPH_FILES).then(|| resolve(&f.path));
    Ok(parts(section, f, element, path.as_deref())?.0)
}

/// What of the file of a cell's graph is not in the graph.
pub(super) fn skeleton_notes(
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

/// Struts or plates, by name or from a file, and what of the file is left out.
fn parts(
    section: &CellSection,
    f: &FileFrame,
    element: Element,
    path: Option<&Path>,
) -> Result<(Skeleton, Vec<String>), SourceFault> {
    let radius = section.radius.map(|r| r.0);
    let thickness = section.plate_thickness.map(|t| t.0);
    let name = f.path.to_string_lossy();
    let named = match path {
        Some(path) => {
            let (read, notes) = crate::io::read_skeleton_noted(path, radius, thickness)?;
            let map = frame_map(f, None, LengthUnit::default());
            return Ok((read.mapped(map, f.transform.scale.0), notes));
        }
        None if section.graph.is_some() => {
            Skeleton::graph(element, &name, radius.unwrap_or(RADIUS))?
        }
        None => Skeleton::plates_of(element, &name, thickness.unwrap_or(THICKNESS))?,
    };
    Ok((named, Vec::new()))
}

/// Where sources are read.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    /// The recipe of the section; without one, paths begin in the working directory.
    pub recipe: Option<&'a Recipe>,
    pub session: Session<'a>,
}

impl Reader<'_> {
    /// A path of the section as one that can be opened.
    pub(super) fn resolve(&self, path: &Path) -> PathBuf {
        self.recipe
            .map_or_else(|| path.to_owned(), |r| r.resolve(path))
    }

    /// The source that a section names, other than a surface, a file or a hybrid.
    pub fn source(
        &self,
        section: &CellSection,
        element: Element,
        found: &mut Found,
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
        let mut open = |key: &'static str, f: &FileFrame| {
            let path = self.resolve(&f.path);
            file = Some((key, path.clone()));
            path
        };
        let source = if let Some(f) = &section.mesh {
            let path = open("mesh", f);
            let read = crate::io::read_mesh(&path)?;
            found.warn(Warning::MESH, &read.warnings);
            let mesh = moved(&read.mesh, f);
            Source::mesh(element, &mesh, &place, caps).map_err(|e| in_file(&path, e))?
        } else if let Some(f) = &section.points {
            let path = open("points", f);
            let read = crate::io::read_points(&path)?;
            let map = frame_map(f, None, LengthUnit::default());
            let origin = map(Vec3::zeros());
            let points = read.points.into_iter().map(&map).collect();
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
                let mesh = moved(&mesh, f);
                Source::mesh(element, &mesh, &place, caps).map_err(|e| in_file(&path, e))?
            } else {
                let array = crate::io::read_npy(&path)?;
                let voxels = Voxels::new(&array.shape, array.values, array.binary)
                    .map_err(FitError::from)?;
                Source::voxels(element, &voxels, &place)?
            }
        } else if let Some(f) = section.graph.as_ref().or(section.plates.as_ref()) {
            let path = has_extension(&f.path, &GRAPH_FILES).then(|| open("graph", f));
            let (skeleton, notes) = parts(section, f, element, path.as_deref())?;
            found.warn(Warning::MESH, &notes);
            Source::skeleton(element, &skeleton, &place)?
        } else if let (Some(frame), Some(recipe)) = (&section.crystal, self.recipe) {
            let made = Crystal::make(recipe, frame).map_err(SourceFault::Run)?;
            let mesh = made.solid(recipe, frame).map_err(SourceFault::Run)?;
            crystal = Some(made);
            Source::mesh(element, &mesh, &place, caps)?
        } else {
            let text = section.formula.as_deref().unwrap_or_default();
            let formula = Formula::parse(text, &["x", "y", "z"]).map_err(CellFault::from)?;
            Source::formula(element, formula, &place)?
        };
        let report = source.report();
        found.warn(Warning::MESH, source.warnings());
        let bounds = Aabb {
            min: Vec3::from(report.box_min),
            max: Vec3::from(report.box_max),
        };
        found.file = file.map(|(key, path)| (key, path, bounds));
        found.crystal = crystal.map(|c| (c, bounds));
        Ok(source)
    }

    /// The cell that a section describes, before its level is found.
    pub fn cell(
        &self,
        name: &str,
        section: &CellSection,
        element: Element,
        found: &mut Found,
    ) -> Result<Cell, SourceFault> {
        if let Some(wanted) = &section.surface {
            return Ok(named_surface(wanted, element)?.named(name));
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
                    alone(cell.element())
                ))
                .into());
            }
            found.file = Some(("file", path, Aabb::of(element.vertices())));
            return Ok(cell.named(name));
        }
        let mut options = fit_options(section);
        if let Some(group) = &options.group {
            options.group = Some(self.group(group)?);
        }
        let of_samples = self.of_samples(name, section, (element, &options), found)?;
        let cell = if let Some(cell) = of_samples {
            cell
        } else {
            let source = self.source(section, element, found)?;
            if section.band_limit.is_none() && section.tolerance.is_none() {
                options.band_limit = options.band_limit.min(source.carried_band());
            }
            let fitted = fit_source(name, element, &source, &options, self.session.progress);
            let cell = match fitted {
                Err(e @ FitError::NoSymmetricPart { .. }) if element != Element::Ball => {
                    let advice = elsewhere(&source, element)?;
                    return Err(CellFault::Rule(format!("{e}: {advice}")).into());
                }
                other => other?,
            };
            // The ball has one centre.
            let movable = element != Element::Ball;
            if movable && cell.report().is_some_and(|r| r.kept_energy < LITTLE) {
                found.warn(Warning::CELL, &[elsewhere(&source, element)?]);
            }
            cell
        };
        found.warn(Warning::CELL, cell.report().map_or(&[], |r| &r.warnings));
        Ok(cell)
    }
}

impl Reader<'_> {
    /// The name of a group or its generators; those of a file if that is what the word names.
    fn group(&self, word: &str) -> Result<String, SourceFault> {
        let path = self.resolve(Path::new(word));
        if GROUP_NAMES.contains(&word) || word.contains(',') || !path.is_file() {
            return Ok(word.to_owned());
        }
        Ok(super::group::read_group(&path)?.line())
    }
}

/// About which origin most of a source would be kept, and how to place it there.
fn elsewhere(source: &Source, element: Element) -> Result<String, CellFault> {
    let operators = operators_of(element, default_group(element))?;
    let here = source.best_origin(element, &operators);
    let [x, y, z] = here.place;
    Ok(format!(
        "of 8 origins along each axis ({x}, {y}, {z}) keeps most, {:.3} of its energy{}",
        here.kept,
        if here.kept > LITTLE {
            format!(": place = {{ translate = [{}, {}, {}] }}", -x, -y, -z)
        } else {
            ", so that no placement makes it symmetric; a smaller group (C1 has none) keeps it, in \
             scaffolds whose elements are all turned alike"
                .to_owned()
        }
    ))
}

/// Why a source cannot be had: its keys and its geometry, or its file.
pub(super) enum SourceFault {
    Cell(CellFault),
    Run(RunError),
}

impl SourceFault {
    /// As an error of a run, about the cell of this key.
    pub fn of(self, key: &str) -> RunError {
        match self {
            Self::Run(e) => e,
            Self::Cell(CellFault::Fit(FitError::Cancelled(c))) => RunError::Cancelled(c),
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

/// What is wrong with a file's geometry, with the file.
pub(super) fn in_file(path: &Path, error: FitError) -> SourceFault {
    let expected = match &error {
        FitError::Mesh(_) => "triangles that bound a solid",
        _ => return error.into(),
    };
    ReadError::data(path, Place::File, error.to_string(), expected).into()
}

/// A mesh in the frame of its file's table: numbers are reference coordinates, whatever their unit.
fn moved(mesh: &TriMesh, file: &FileFrame) -> TriMesh {
    mesh.mapped(frame_map(file, None, LengthUnit::default()))
}

pub(super) fn has_extension(path: &Path, known: &[&str]) -> bool {
    let own = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    known.iter().any(|k| own.eq_ignore_ascii_case(k))
}

/// Why no scaffold takes a cell of this element, if none does.
pub(super) fn alone(element: Element) -> &'static str {
    match element {
        Element::Ball => {
            ": the icosahedral group has no lattice in space, so that cells of the ball stand alone and \
             fill no scaffold; an operation takes them, union = { cell = { name, size } }"
        }
        _ => "",
    }
}

/// A surface by its name.
pub(super) fn named_surface(name: &str, element: Element) -> Result<Cell, CellFault> {
    let surface = Surface::from_name(name).ok_or_else(|| {
        let known: Vec<&str> = Surface::ALL.iter().map(|s| s.name()).collect();
        CellFault::Rule(format!(
            "no surface is named {name:?}; expected one of {}",
            known.join(", ")
        ))
    })?;
    Ok(surface.cell(element)?)
}

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

/// Enters an argument of the command line as the source of a section: by the extension of a file, by
/// the name of a surface, strut graph or plate set, or as a formula.
///
/// # Errors
/// A sentence that says what was found and what an input may be.
pub fn enter_source(input: &Path, section: &mut CellSection) -> Result<(), ReadError> {
    let text = input.to_str().unwrap_or("");
    let file = || Some(Brief(FileFrame::short(input.to_owned())));
    let elements = section
        .own_element()
        .map_or(Element::ALL.to_vec(), |e| vec![e]);
    let plain = text.strip_suffix("_struts").unwrap_or(text);
    let offers = |names: fn(Element) -> &'static [&'static str]| {
        elements.iter().any(|e| names(*e).contains(&plain))
    };
    if Surface::from_name(text).is_some() {
        section.surface = Some(text.to_owned());
    } else if offers(graphs) {
        section.graph = file();
    } else if offers(plate_sets) {
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
        let hint = "examples/cad/step_to_stl.py makes triangles of it with gmsh";
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
        let surfaces: Vec<&str> = Surface::ALL.iter().map(|s| s.name()).collect();
        let known: Vec<&str> = elements
            .iter()
            .flat_map(|e| graphs(*e).iter().chain(plate_sets(*e)))
            .copied()
            .chain(surfaces.iter().copied())
            .collect();
        let meant = recipe::nearest(text, &known);
        let meant = meant.map_or_else(String::new, |m| format!("did you mean {m:?}? "));
        let hint = format!(
            "{meant}an input is a file, a formula in x, y, z, a surface ({}), a strut graph ({}) or plates ({})",
            surfaces.join(", "),
            names(graphs),
            names(plate_sets)
        );
        return Err(ReadError::io(input, std::io::ErrorKind::NotFound.into()).with_hint(hint));
    }
    Ok(())
}

/// Whether a file holds beams and no triangles; what cannot be read is an error where it is read.
fn is_strut_file(input: &Path) -> bool {
    crate::io::is_strut_file(input).unwrap_or(false)
}

/// Whether a text was probably meant as a formula, so that its own error helps more than "no such file".
fn looks_like_formula(text: &str) -> bool {
    let letters = ['x', 'y', 'z'];
    text.contains(['+', '*', '^', '(', ' ']) && text.contains(letters)
}
