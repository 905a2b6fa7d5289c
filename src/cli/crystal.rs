//! `druse crystal NAME.crystal -o X`: polygon modelling without a recipe.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::{LengthUnit, Transform, figures};
use crate::io::atomic::{StagedPath, require_writable, write_bytes};
use crate::io::{
    DiskFiles, read_polymesh, read_script, write_legacy_obj, write_mesh, write_polymesh,
};
use crate::mesh::{MeshReport, SelfIntersections, check_with};
use crate::pipeline::{clock_parameters, crystal_script};
use crate::polymesh::{Interpreter, LoadOptions, PolyMesh, Script, Triangulated};
use crate::recipe::{Length, PictureSize, Recipe};
use crate::sequence::{Clock, FrameList};
use crate::vdb;
use crate::vdb::{Image, LevelSet, VdbWriter};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

mod interactive;
mod view;

#[derive(Args, Clone)]
pub(super) struct Parameters {
    /// A script (.crystal), a recipe with [crystal.NAME] (.toml), or a polygon mesh (.obj, .dlfl, .stl, .ply);
    /// optional with --interactive and with --view, which then starts from a cube.
    #[arg(required_unless_present_any = ["interactive", "view"])]
    input: Option<PathBuf>,
    /// What to write, any number of times: .obj and .dlfl keep polygons and groups; .stl, .ply, .3mf
    /// (triangles); .vdb (a level set); .png (a picture).
    #[arg(short, long, value_name = "X")]
    output: Vec<PathBuf>,
    /// The crystal of a recipe that has several.
    #[arg(long, value_name = "CRYSTAL")]
    name: Option<String>,
    /// Set a parameter of the script, as in t=1/4; with a dot, a key of the recipe.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Run the script up to and including this line.
    #[arg(long, value_name = "LINE")]
    until: Option<usize>,
    /// Read steps from stdin, one line at a time, after the script: undo, redo, show, draw, help.
    #[arg(long)]
    interactive: bool,
    /// How a mesh is read, in the words of the step load: `weld=0.01 flip=true allow_open=true`, or
    /// `group_by=color color_tol=0.02`.
    #[arg(long, value_name = "WORDS", allow_hyphen_values = true)]
    load: Option<String>,
    /// Write groups of an .obj as colours ("c r g b" lines) instead of materials.
    #[arg(long)]
    legacy_colors: bool,
    /// Edit the model in a browser, on a page that only this machine reaches: clicks extrude faces. Files are
    /// saved beside the script.
    #[arg(long, conflicts_with_all = ["interactive", "output", "until"])]
    view: bool,
    /// Port of the page [default: a free one].
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        hide_default_value = true,
        requires = "view"
    )]
    port: u16,
    /// Voxels of a .vdb; a bare number is in the crystal's unit [default: 1/200 of its longest side, or
    /// the smallest that OpenVDB supports].
    #[arg(long, value_name = "LENGTH")]
    voxel_size: Option<Length>,
    /// Unit of the crystal's numbers [default: the recipe's, else mm].
    #[arg(long, value_name = "UNIT")]
    unit: Option<LengthUnit>,
    /// Width and height of a picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "1000x800")]
    size: PictureSize,
    /// Frames, as in 1001-1240, 1-24x2 or 1,5,9-20x2: the outputs of each, with a frame token ($F4,
    /// $F, ####, %04d) in their names; parameters of the script that are named frame, time or fps are set.
    #[arg(long, value_name = "FRAMES", value_parser = super::frames::parse, allow_hyphen_values = true)]
    frames: Option<FrameList>,
    /// The frame of one run of several.
    #[arg(skip)]
    frame: Option<i32>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Frames per second of a script without a recipe.
const SCRIPT_FPS: f64 = 24.0;
/// Default number of voxels along the longest side.
const DEFAULT_RESOLUTION: f64 = 200.0;
/// Half width of the band, voxels.
const BAND_HALF_WIDTH: f64 = 3.0;
/// Maximum number of triangles that are checked for self-intersections; the check dominates the time.
const MAX_CHECKED_TRIANGLES: usize = 200_000;

/// A script with its place and the unit of its numbers.
struct Source {
    path: PathBuf,
    text: String,
    directory: PathBuf,
    parameters: Vec<String>,
    unit: LengthUnit,
}

/// Makes one crystal, or one for each frame.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let Some(frames) = &p.frames else {
        return one_crystal(p, session);
    };
    if p.interactive || p.view {
        return Err(Failure::usage(
            "found --frames with --interactive or --view; expected one of them",
        ));
    }
    super::frames::check_paths(frames, &p.input, &p.output)?;
    super::frames::each(frames, session, |frame| {
        let at = |path: &PathBuf| super::frames::path_at(path, frame);
        let input = p.input.as_ref().map(at).transpose()?;
        let own = Parameters {
            frame: Some(frame),
            output: p.output.iter().map(at).collect::<Result<_, _>>()?,
            input,
            ..p.clone()
        };
        one_crystal(&own, session)
    })
}

/// Runs a script, describes its mesh and writes the outputs; with `--view` serves the page instead.
fn one_crystal(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let source = source(p)?;
    if p.view {
        return view::serve(p, &source, session);
    }
    for path in &p.output {
        require_writable(path)?;
    }
    let files = DiskFiles::new(&source.directory, true);
    // Steps that can be undone, each with its model in memory: only the interactive mode undoes any.
    let mut interpreter = Interpreter::with_history(&files, if p.interactive { 200 } else { 1 });
    interpreter = interpreter.with_progress(session);
    begin(&mut interpreter, &source, p.until, session)?;
    let tools = vdb::Session::new(&threads, session);
    if p.interactive {
        files.open();
        let draw = |mesh: &PolyMesh, path: &Path| write(p, mesh, path, source.unit, tools);
        let met = |mesh: &PolyMesh| {
            self_intersections(mesh, session)
                .ok()
                .flatten()
                .map(|m| m.0)
        };
        interactive::run_session(&mut interpreter, session, &draw, &met)?;
    }
    let Some(mesh) = interpreter.shared_mesh() else {
        if p.interactive {
            return Ok(Answer::new("", json!({ "kind": "crystal" })));
        }
        return Err(Failure::data(
            &source.path,
            "found no step that makes a mesh; expected one such as cube",
        ));
    };
    let mut facts = serde_json::to_value(mesh.summary()).unwrap_or_default();
    facts["kind"] = json!("crystal");
    let mut text = mesh.summary().to_string();
    if let Some((line, found)) = self_intersections(&mesh, session)? {
        let _ = write!(text, "\n{line}");
        facts["self_intersections"] = found;
    }
    let mut outputs = Vec::new();
    for path in &p.output {
        let bytes = write(p, &mesh, path, source.unit, tools)?;
        outputs.push((path.clone(), bytes));
    }
    outputs.extend(files.saved());
    for (path, bytes) in &outputs {
        let _ = write!(
            text,
            "\n{}  {}",
            super::terminal::path(path),
            super::numbers::size(*bytes)
        );
        if p.voxel_size.is_none() && is_volume(path) {
            let voxel = voxel_size(p, &mesh, source.unit)?;
            let _ = write!(text, "  voxels of {voxel} {}", source.unit.symbol());
            facts["voxel_size"] = json!(voxel);
        }
    }
    let list: Vec<Value> = outputs
        .iter()
        .map(|(path, bytes)| json!({ "path": path.display().to_string(), "bytes": bytes }))
        .collect();
    facts["outputs"] = json!(list);
    facts["steps"] = json!(interpreter.steps());
    Ok(Answer::new(text, facts))
}

/// Runs a script, up to and including a line if one is given, and prints the notes of its steps.
fn begin(
    interpreter: &mut Interpreter,
    source: &Source,
    until: Option<usize>,
    session: &Session,
) -> Result<(), Failure> {
    for pair in &source.parameters {
        let Some((name, value)) = pair.split_once('=') else {
            return Err(Failure::usage(format!("--set {pair}: expected KEY=VALUE")));
        };
        let set = interpreter.set(name.trim(), value);
        set.map_err(|e| Failure::usage(format!("--set {pair}: {e}")))?;
    }
    let script = Script::parse(&source.text);
    let script = script.map_err(|e| Failure::script(&source.path, &source.text, &e))?;
    session.finish();
    let done = script.run(interpreter, until);
    done.map_err(|e| Failure::script(&source.path, &source.text, &e))?;
    for note in interpreter.take_notes() {
        session.note(&format!(
            "{}:{}: {}",
            source.path.display(),
            note.line,
            note.text
        ));
    }
    Ok(())
}

/// The script that the arguments name; without one an empty script, or a cube for the page.
fn source(p: &Parameters) -> Result<Source, Failure> {
    let unit = p.unit.unwrap_or_default();
    let Some(path) = &p.input else {
        return Ok(Source {
            path: "stdin".into(),
            text: if p.view { "cube\n" } else { "" }.into(),
            directory: PathBuf::new(),
            parameters: p.set.clone(),
            unit,
        });
    };
    let directory = path.parent().unwrap_or(Path::new("")).to_owned();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("crystal") => {
            let text = read_script(path)?;
            let clock = p.frame.map(|frame| Clock {
                frame,
                fps: SCRIPT_FPS,
            });
            let clock = clock.map(|clock| clock_parameters(&text, clock));
            let pairs = clock.into_iter().flatten().map(|(k, v)| format!("{k}={v}"));
            Ok(Source {
                path: path.clone(),
                // What the user sets comes last and holds.
                parameters: pairs.chain(p.set.iter().cloned()).collect(),
                text,
                directory,
                unit,
            })
        }
        Some("toml") => of_recipe(p, path),
        _ => {
            // A mesh is a script of one step; reading it here gives the better error.
            let words = p.load.as_deref().unwrap_or_default();
            if words.is_empty() {
                read_polymesh(path, &LoadOptions::default())?;
            }
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            Ok(Source {
                path: path.clone(),
                text: format!("load \"{name}\" {words}\n"),
                directory,
                parameters: p.set.clone(),
                unit,
            })
        }
    }
}

/// The script of a recipe's crystal. Pairs of `--set` with a dot in the key, and the frame, change the recipe; the others
/// are parameters of the script.
fn of_recipe(p: &Parameters, path: &Path) -> Result<Source, Failure> {
    let dotted = |pair: &&String| pair.split('=').next().is_some_and(|key| key.contains('.'));
    let frame = p.frame.map(|frame| format!("frame={frame}"));
    let overrides: Vec<String> = p.set.iter().filter(dotted).cloned().chain(frame).collect();
    let recipe = Recipe::read(path, &overrides)?;
    let crystals = &recipe.sections().crystal;
    let names: Vec<&String> = crystals.keys().collect();
    let name = match (&p.name, &names[..]) {
        (Some(name), _) => name,
        (None, [only]) => only,
        (None, list) => {
            let words = list
                .iter()
                .map(|n| n.as_str())
                .collect::<Vec<_>>()
                .join(", ");
            let found = if list.is_empty() {
                "no [crystal.NAME]".into()
            } else {
                words
            };
            let message = format!("found {found}; expected one crystal, or --name CRYSTAL");
            return Err(Failure::data(path, message));
        }
    };
    let script = crystal_script(&recipe, name)?;
    let mut parameters: Vec<String> = script.set.iter().map(|(k, v)| format!("{k}={v}")).collect();
    parameters.extend(p.set.iter().filter(|pair| !dotted(pair)).cloned());
    Ok(Source {
        path: script.file.unwrap_or_else(|| path.to_owned()),
        text: script.text,
        directory: script.directory,
        parameters,
        unit: p.unit.unwrap_or(recipe.unit()),
    })
}

fn cut(mesh: &PolyMesh) -> Result<Triangulated, Failure> {
    mesh.triangulated()
        .map_err(|e| Failure::usage(e.to_string()))
}

/// Self-intersections of the surface, as text and as an object; `None` without any. Surfaces of too many triangles get
/// a note that they were not searched.
fn self_intersections(
    mesh: &PolyMesh,
    session: &Session,
) -> Result<Option<(String, Value)>, Failure> {
    let cut = cut(mesh)?;
    let triangles = cut.mesh.triangles().len();
    if triangles > MAX_CHECKED_TRIANGLES {
        let line = format!(
            "note: self-intersections are not checked for {triangles} triangles; druse check FILE checks them"
        );
        return Ok(Some((line, json!({ "searched": false }))));
    }
    let report: MeshReport = check_with(&cut.mesh, SelfIntersections::Search, session)
        .map_err(|_| Failure::stopped(130))?;
    session.finish();
    let shared_edges = report.nonmanifold_edges.count;
    let finding = report.self_intersections.unwrap_or_default();
    if shared_edges + finding.count == 0 {
        return Ok(None);
    }
    let place = finding
        .places
        .first()
        .or(report.nonmanifold_edges.places.first());
    let mut faces: Vec<u32> = place
        .iter()
        .flat_map(|d| d.triangles.iter().map(|&t| cut.faces[t as usize]))
        .collect();
    faces.dedup();
    let named: Vec<String> = faces
        .iter()
        .map(|&f| format!("{f} (group {})", mesh.groups()[f as usize]))
        .collect();
    let line = format!(
        "note: the surface intersects itself: at least {} pairs of triangles touch or cross, {shared_edges} edges are shared by more \
         than two faces in space; first at faces {}",
        finding.count,
        named.join(", ")
    );
    let facts = json!({ "pairs": finding.count, "shared_edges": shared_edges, "faces": faces });
    Ok(Some((line, facts)))
}

fn is_volume(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vdb"))
}

/// Edge of a voxel in the crystal's unit: as given, else a share of its longest side, or where that is too small the
/// least that OpenVDB holds, rounded up to two digits.
fn voxel_size(p: &Parameters, mesh: &PolyMesh, unit: LengthUnit) -> Result<f64, Failure> {
    if let Some(given) = p.voxel_size {
        return given.in_unit(unit, unit).ok_or_else(|| {
            Failure::usage(format!(
                "--voxel-size {given}; expected a length, as in 0.1mm"
            ))
        });
    }
    let least = Transform::MIN_VOXEL_SIZE / unit.to(LengthUnit::Metre);
    let target = mesh.bounds().size().max() / DEFAULT_RESOLUTION;
    if target >= least {
        return Ok(target);
    }
    let digit = 10f64.powf(least.log10().floor() - 1.0);
    Ok((least / digit).ceil() * digit)
}

/// Writes a mesh in the format of a path's extension, a level set in metres, and returns the bytes of the file.
fn write(
    p: &Parameters,
    mesh: &PolyMesh,
    path: &Path,
    unit: LengthUnit,
    tools: vdb::Session,
) -> Result<u64, Failure> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("vdb") => {
            let voxel = voxel_size(p, mesh, unit)?;
            let factor = unit.to(LengthUnit::Metre);
            if voxel * factor < Transform::MIN_VOXEL_SIZE {
                let message = format!(
                    "a voxel of {:e} m; OpenVDB holds none under {:e}: expected larger voxels, or a larger \
                     unit of the crystal, as in --unit cm",
                    voxel * factor,
                    Transform::MIN_VOXEL_SIZE
                );
                return Err(Failure::data(path, message));
            }
            let solid = voxelized(mesh, path, voxel, tools)?;
            let staged = StagedPath::create(path)?;
            let mut file = VdbWriter::new(path, tools)?.scaled(factor);
            file.level_set("surface", &solid)?;
            file.tag("druse.unit", LengthUnit::Metre.symbol())?;
            file.tag("druse.voxel_size", &(voxel * factor).to_string())?;
            file.write_to(staged.path())?;
            staged.commit()?;
            let size = std::fs::metadata(path).map_err(|e| crate::io::ReadError::io(path, e))?;
            Ok(size.len())
        }
        Some("png") => {
            let (width, height) = (p.size.0 as usize, p.size.1 as usize);
            let rgba = mesh.picture(width, height);
            let rgba = rgba.map_err(|e| Failure::usage(e.to_string()))?;
            Ok(write_bytes(
                path,
                &Image {
                    width,
                    height,
                    rgba,
                }
                .png()?,
            )?)
        }
        Some("obj") if p.legacy_colors => Ok(write_legacy_obj(path, mesh)?),
        Some("stl" | "ply" | "3mf") => Ok(write_mesh(path, &cut(mesh)?.mesh, unit)?),
        _ => Ok(write_polymesh(path, mesh)?),
    }
}

/// The level set of a crystal. Refuses inward normals, and so many voxels along a side that a surface fills the memory.
fn voxelized(
    mesh: &PolyMesh,
    path: &Path,
    voxel: f64,
    tools: vdb::Session,
) -> Result<LevelSet, Failure> {
    let volume = mesh.volume();
    if volume <= 0.0 {
        let message = format!(
            "the crystal's volume is {}; expected a surface with outward normals",
            figures(volume)
        );
        return Err(Failure::data(path, message));
    }
    let transform = Transform::new(voxel)
        .filter(|_| mesh.bounds().size().max() / voxel < 20_000.0)
        .ok_or_else(|| {
            Failure::data(
                path,
                format!("a voxel size of {voxel}; expected 1/20000 of the crystal or more"),
            )
        })?;
    Ok(LevelSet::from_mesh(
        &cut(mesh)?.mesh,
        transform,
        BAND_HALF_WIDTH,
        tools,
    )?)
}
