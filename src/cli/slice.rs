//! `druse slice IN.vdb|RECIPE -o X --layer LENGTH`: a part as pictures or outlines of its layers. Files are
//! complete or absent; an interrupted stack of pictures is removed.

use super::context::Session;
use super::failure::Failure;
use super::kind::FileKind;
use super::output::Answer;
use super::vdb_commands::{Draft, GridChoice};
use crate::frame::{Aabb, LengthUnit, Vec3};
use crate::io::atomic::{AtomicFile, require_directory, require_writable, write_bytes};
use crate::io::{SliceStackWriter, WriteError};
use crate::pipeline::{RunError, RunOptions, SliceOptions, SliceSummary, slice};
use crate::recipe::{Length, Recipe, Size};
use crate::sequence::FrameList;
use crate::slice::{Layer, cli_head, cli_layer, cli_tail, grey_png, svg_head, svg_layer, svg_tail};
use clap::{Args, ValueEnum};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Args, Clone)]
pub(super) struct Parameters {
    /// An OpenVDB file, or a recipe; the exact field of a recipe is cut without making a volume.
    file: PathBuf,
    /// The output: a directory of pictures (png), one drawing (svg) or one stack of outlines (cli, 3mf).
    #[arg(short, long, value_name = "X")]
    output: PathBuf,
    /// Height of a layer, as in 0.05mm; each layer is cut at its mid-height.
    #[arg(long, value_name = "LENGTH")]
    layer: Size,
    /// Axis normal to the layers.
    #[arg(long, value_enum, default_value = "z")]
    axis: Axis,
    /// Kind of file [default: by the extension, else png].
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Edge of a pixel, and of the squares of the contouring [default: a voxel].
    #[arg(long, value_name = "LENGTH")]
    pixel: Option<Size>,
    #[command(flatten)]
    choice: GridChoice,
    /// Override a key of the recipe, as in `band.voxel_size=0.2`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Frames, as in 1001-1240, 1-24x2 or 1,5,9-20x2: the layers of each, with a frame token ($F4,
    /// $F, ####, %04d) in the name of the output; a recipe takes its frame, a .vdb has a token too.
    #[arg(long, value_name = "FRAMES", value_parser = super::frames::parse, allow_hyphen_values = true)]
    frames: Option<FrameList>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

#[derive(Clone, Copy, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
}

/// The format of layers.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Grey pictures with smooth edges.
    Png,
    /// One drawing with a group per layer.
    Svg,
    /// Common Layer Interface, text, millimetres.
    Cli,
    /// 3MF with a slice stack, millimetres.
    #[value(name = "3mf")]
    ThreeMf,
}

/// Slices a part, or each frame of a sequence.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let Some(frames) = &p.frames else {
        return one_stack(p, session);
    };
    super::frames::check_paths(frames, [&p.file], [&p.output])?;
    super::frames::each(frames, session, |frame| {
        let file = super::frames::path_at(&p.file, frame)?;
        let is_recipe = file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let frame_parameters = Parameters {
            file,
            output: super::frames::path_at(&p.output, frame)?,
            set: if is_recipe {
                super::frames::overrides(&p.set, frame)
            } else {
                p.set.clone()
            },
            ..p.clone()
        };
        one_stack(&frame_parameters, session)
    })
}

/// Slices a part into pictures, or into one file of outlines. A plan has at least one layer, so that the head of a
/// file is written before its tail.
fn one_stack(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    // A level set is sliced as the recipe that reads it.
    let (recipe, opened) = match FileKind::of(&p.file, &[FileKind::Vdb, FileKind::Recipe])? {
        FileKind::Vdb => {
            let (mut draft, _) = Draft::of_file(&p.file, &p.choice)?;
            let opened = draft.opened.take();
            (draft.recipe()?, opened)
        }
        _ => (Recipe::read(&p.file, &p.set)?, None),
    };
    let extension = p.output.extension().and_then(|e| e.to_str());
    let format = p.format.unwrap_or(match extension {
        Some("svg") => Format::Svg,
        Some("cli") => Format::Cli,
        Some("3mf") => Format::ThreeMf,
        _ => Format::Png,
    });
    let options = RunOptions {
        opened,
        ..super::vdb::run_options(p.threads, session)?
    };
    let how = SliceOptions {
        axis: p.axis as usize,
        layer: p.layer.0,
        pixel: p.pixel.map(|s| -> Length { s.0 }),
    };
    if format == Format::ThreeMf && p.axis as usize != 2 {
        return Err(Failure::usage(
            "found --axis for a 3MF, whose slices lie along z; expected --axis z",
        )
        .hint("druse filter turns a part: 'resample={rotate=[90,0,0]}'"));
    }
    // An existing folder must take files. One that does not exist is not made yet: its name must be one that can
    // be made, which the test for files finds out too.
    if format == Format::Png && p.output.is_dir() {
        require_directory(&p.output)?;
    } else {
        require_writable(&p.output)?;
    }
    let to_mm = recipe.unit().to(LengthUnit::Millimetre);
    let mut bytes = 0;
    let sliced = if format == Format::Png {
        let mut pictures = Pictures::in_folder(&p.output);
        let sliced = slice(&recipe, &options, &how, session, |s, n, layer| {
            // The folder is made when the first layer is there, not for a run that fails.
            if n == 0 {
                require_directory(&p.output)?;
            }
            // PNG states its resolution in pixels per metre, 1000 mm.
            let per_metre = 1000.0 / (s.plan.pixel * to_mm);
            let png = grey_png(&s.plan, layer, per_metre)
                // Encoding into memory has no file and no kind of error of its own.
                .map_err(|e| RunError::Empty(format!("encoding a picture: {e}")))?;
            let path = p.output.join(format!("{:05}.png", n + 1));
            bytes += write_bytes(&path, &png)?;
            pictures.files.push(path);
            Ok::<(), Failure>(())
        })?;
        pictures.keep();
        sliced
    } else if format == Format::ThreeMf {
        let mut file = AtomicFile::create_seekable(&p.output)?;
        let sliced = stack(&mut file, p, |take| {
            slice(&recipe, &options, &how, session, take)
        })?;
        bytes = file.commit()?;
        sliced
    } else {
        let mut file = AtomicFile::create(&p.output)?;
        let put = |file: &mut AtomicFile, text: &str| {
            let written = file.write_all(text.as_bytes());
            written.map_err(|e| Failure::from(file.failed(e)))
        };
        let sliced = slice(&recipe, &options, &how, session, |s, n, layer| {
            if n == 0 {
                put(&mut file, &head(format, s, to_mm))?;
            }
            put(&mut file, &body(format, s, n, layer, to_mm))
        })?;
        let end = if format == Format::Svg {
            svg_tail()
        } else {
            cli_tail()
        };
        put(&mut file, end)?;
        bytes = file.commit()?;
        sliced
    };
    Ok(report_answer(p, &sliced, bytes))
}

/// The pictures of a stack, which go with the folder made for them unless the whole stack is kept.
struct Pictures<'a> {
    folder: &'a Path,
    is_new: bool,
    files: Vec<PathBuf>,
}

impl<'a> Pictures<'a> {
    /// No pictures yet; the folder may not exist.
    fn in_folder(folder: &'a Path) -> Self {
        Self {
            folder,
            is_new: !folder.exists(),
            files: Vec::new(),
        }
    }

    /// Keeps the pictures and the folder.
    fn keep(mut self) {
        self.files.clear();
        self.is_new = false;
    }
}

impl Drop for Pictures<'_> {
    fn drop(&mut self) {
        for file in &self.files {
            let _ = std::fs::remove_file(file);
        }
        if self.is_new {
            let _ = std::fs::remove_dir(self.folder);
        }
    }
}

/// Writes a slice stack (3MF) in millimetres; `cut` slices the part and passes the layers, in order, to its argument.
fn stack(
    file: &mut AtomicFile,
    p: &Parameters,
    cut: impl FnOnce(
        &mut dyn FnMut(&SliceSummary, usize, &Layer) -> Result<(), Failure>,
    ) -> Result<SliceSummary, Failure>,
) -> Result<SliceSummary, Failure> {
    let failed = |error| {
        Failure::from(WriteError::Io {
            path: p.output.clone(),
            written: 0,
            needed: None,
            error,
        })
    };
    let mut out = Some(file);
    let mut writer = None;
    let sliced = cut(&mut |s, n, layer| {
        let to_mm = s.unit.to(LengthUnit::Millimetre);
        if let Some(file) = out.take() {
            let plan = &s.plan;
            let [u, v] = [0, 1].map(|k| plan.corner[k] + plan.pixels[k] as f64 * plan.pixel);
            let bounds = Aabb {
                min: Vec3::new(plan.corner[0], plan.corner[1], plan.start) * to_mm,
                max: Vec3::new(u, v, plan.bottom(plan.layers())) * to_mm,
            };
            let unit = LengthUnit::Millimetre;
            writer = Some(SliceStackWriter::new(file, unit, bounds).map_err(failed)?);
        }
        // The first layer has made the writer.
        let Some(writer) = &mut writer else {
            return Ok(());
        };
        let mut outlines = layer.outlines();
        for c in outlines.iter_mut().flatten().flatten() {
            *c *= to_mm;
        }
        let top = (s.plan.bottom(n) + s.plan.height) * to_mm;
        writer.layer(top, &outlines).map_err(failed)
    })?;
    if let Some(writer) = writer {
        writer.finish().map_err(failed)?;
    }
    Ok(sliced)
}

/// The text before the layers of a drawing (.svg) or of a file of outlines (.cli).
fn head(format: Format, s: &SliceSummary, to_mm: f64) -> String {
    match format {
        Format::Svg => svg_head(&s.plan, to_mm),
        _ => cli_head(&s.plan),
    }
}

/// The text of layer `n`; `to_mm` converts the recipe's unit to millimetres.
fn body(format: Format, s: &SliceSummary, n: usize, layer: &Layer, to_mm: f64) -> String {
    match format {
        Format::Svg => svg_layer(&s.plan, n, layer, to_mm),
        _ => cli_layer(&s.plan, n, &layer.outlines(), to_mm),
    }
}

/// The answer: where the layers are, their number and size, and the volume of the part.
fn report_answer(p: &Parameters, s: &SliceSummary, bytes: u64) -> Answer {
    let shown = p.output.display().to_string();
    let (unit, plan) = (s.unit, &s.plan);
    let text = format!(
        "{}  {} layers of {} {unit}, {}x{} pixels of {} {unit}, volume {} {unit}^3, {}",
        super::terminal::line(&shown),
        plan.layers(),
        plan.height,
        plan.pixels[0],
        plan.pixels[1],
        plan.pixel,
        crate::frame::figures(s.volume),
        super::numbers::size(bytes)
    );
    let axis = ["x", "y", "z"][plan.axis];
    let json = json!({
        "path": shown, "layers": plan.layers(), "layer": plan.height, "pixel": plan.pixel,
        "pixels": plan.pixels, "axis": axis, "unit": unit.symbol(),
        "start": plan.start, "corner": plan.corner, "volume": s.volume, "bytes": bytes,
    });
    Answer::new(text, json)
}
