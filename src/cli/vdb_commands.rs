//! Commands on `.vdb` files, run as recipes with the same sections, keys and parser: their flags become a draft in
//! memory, a table of TOML, which is read like a file.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::LengthUnit;
use crate::pipeline::{Report, RunOptions, run};
use crate::recipe::{Length, Onto, Recipe, Size};
use crate::vdb::subprocess::PrefetchedGrid;
use clap::Args;
use std::path::Path;
use toml::{Table, Value};

/// The surface of an OpenVDB file to use.
#[derive(Args, Clone, Default)]
pub(super) struct GridChoice {
    /// Name of the grid [default: "surface", the only level set, or the only grid of floats].
    #[arg(long, value_name = "NAME")]
    pub grid: Option<String>,
    /// The isovalue of a grid that is not a level set [default: of a fog that was made of a level set its surface, of
    /// another fog 0.5].
    #[arg(long, value_name = "NUMBER", allow_hyphen_values = true)]
    pub value: Option<f64>,
    /// Unit of the file's lengths [default: the file's, else m].
    #[arg(long)]
    pub unit: Option<LengthUnit>,
    /// Resample a grid that is rotated, mirrored, sheared, stretched or a frustum onto cubic voxels: as fine as its
    /// own, or of this edge, as in --resample=0.1mm (a bare number is in the file's unit).
    #[arg(long, value_name = "LENGTH", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub resample: Option<Onto>,
    /// Exchange inside and outside of a level set that is negative outside.
    #[arg(long)]
    pub invert: bool,
}

/// A recipe under construction.
pub(super) struct Draft {
    sections: Table,
    operations: Vec<Value>,
    outputs: Vec<Value>,
    /// The initial grid, read once for its voxel size and for the run.
    pub opened: Option<PrefetchedGrid>,
}

/// A TOML table of the entries that have a value.
pub(super) fn toml_table<'a>(entries: impl IntoIterator<Item = (&'a str, Option<Value>)>) -> Value {
    let kept = entries.into_iter();
    Value::Table(
        kept.filter_map(|(k, v)| v.map(|v| (k.to_owned(), v)))
            .collect(),
    )
}

/// A path as a TOML string.
pub(super) fn path_value(path: &Path) -> Result<Value, Failure> {
    let text = path.to_str().ok_or_else(|| {
        Failure::usage(format!(
            "{}: the path is not UTF-8; rename the file",
            path.display()
        ))
    })?;
    Ok(Value::String(text.to_owned()))
}

impl Draft {
    /// A draft without operations and outputs; `half_width` is in voxels.
    pub fn new(unit: LengthUnit, voxel_size: Value, half_width: f64) -> Self {
        let band = toml_table([
            ("voxel_size", Some(voxel_size)),
            ("half_width", Some(Value::Float(half_width))),
        ]);
        let mut sections = Table::new();
        sections.insert("druse".into(), Value::Integer(1));
        sections.insert("unit".into(), Value::String(unit.symbol().into()));
        sections.insert("band".into(), band);
        Self {
            sections,
            operations: Vec::new(),
            outputs: Vec::new(),
            opened: None,
        }
    }

    /// A draft that starts from a grid of a file, in the file's own unit and voxels.
    pub fn of_file(path: &Path, choice: &GridChoice) -> Result<(Self, LengthUnit), Failure> {
        let name = choice.grid.as_deref();
        let volume = super::vdb::reader()?.fetch(path, name)?;
        // As a flag, as the file's tag, or metres.
        let tagged = || volume.meta("druse.unit").and_then(|u| u.parse().ok());
        let unit = choice.unit.or_else(tagged).unwrap_or(LengthUnit::Metre);
        // Edge of a voxel in the file's unit, and half width of the band in voxels.
        let (edge, width) = volume.voxels();
        // For a band of a width that recipes refuse, the usual 3 voxels.
        let width = if (1.5..=64.0).contains(&width) {
            width
        } else {
            3.0
        };
        let voxel = match choice.resample {
            Some(Onto::Edge(size)) => length_value(size),
            _ => Value::Float(edge),
        };
        let mut draft = Self::new(unit, voxel.clone(), width);
        let resample = choice.resample.map(|onto| match onto {
            Onto::Edge(_) => voxel,
            Onto::Recipe(is_wanted) => Value::Boolean(is_wanted),
        });
        let source = toml_table([
            ("path", Some(path_value(path)?)),
            ("grid", choice.grid.clone().map(Value::String)),
            ("value", choice.value.map(Value::Float)),
            ("unit", Some(Value::String(unit.symbol().into()))),
            ("resample", resample),
            ("invert", choice.invert.then_some(Value::Boolean(true))),
        ]);
        draft.operation("union", toml_table([("vdb", Some(source))]));
        // The grid is read already; the run takes it from here.
        draft.opened = Some(PrefetchedGrid::new(path, name, volume));
        Ok((draft, unit))
    }

    /// Adds an operation by its name, with its value as in a recipe.
    pub fn operation(&mut self, name: &str, value: Value) {
        self.operations.push(toml_table([(name, Some(value))]));
    }

    /// Adds an output by its keys; those without a value are left out.
    pub fn output(&mut self, entries: Vec<(&str, Option<Value>)>) {
        self.outputs.push(toml_table(entries));
    }

    /// Parses the draft like any recipe.
    pub fn recipe(mut self) -> Result<Recipe, Failure> {
        let lists = [("op", self.operations), ("output", self.outputs)];
        for (name, list) in lists {
            self.sections.insert(name.into(), Value::Array(list));
        }
        Ok(Recipe::parse(&self.sections.to_string(), &[])?)
    }

    /// Parses and runs the draft like a recipe, without requirements and walls. Shows its warnings and returns the
    /// report and a line for each file.
    pub fn run(
        mut self,
        session: &Session,
        threads: usize,
    ) -> Result<(Report, Vec<String>), Failure> {
        let opened = self.opened.take();
        let recipe = self.recipe()?;
        let options = RunOptions {
            // These commands report no walls.
            brief: true,
            opened,
            ..super::vdb::run_options(threads, session)?
        };
        let report = run(&recipe, &options, session)?;
        session.finish();
        for warning in &report.warnings {
            session.warn(warning);
        }
        let lines = report.outputs.iter().map(|o| {
            let unit = o.unit.as_deref().unwrap_or("");
            format!(
                "{}  {}  {unit}",
                super::terminal::line(&o.path),
                super::numbers::size(o.bytes)
            )
            .trim_end()
            .to_owned()
        });
        let lines = lines.collect();
        Ok((report, lines))
    }
}

/// A length as a recipe writes it.
pub(super) fn length_value(size: Size) -> Value {
    match size.0 {
        Length::Bare(v) => Value::Float(v),
        _ => Value::String(size.to_string()),
    }
}

/// The key of an output by the extension of its path.
pub(super) fn output_key(path: &Path) -> &'static str {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    match extension.as_str() {
        "stl" | "ply" | "obj" | "3mf" => "mesh",
        "png" => "picture",
        "inp" => "fe",
        _ => "vdb",
    }
}

/// The longest edge of the solid's box in a unit and, where they differ, in another, in five significant digits:
/// "0.06 m -> 60 mm"; empty without a box.
pub(super) fn longest_edge_text(report: &Report, from: LengthUnit, to: LengthUnit) -> String {
    let Some(bounds) = report.solid.bounds else {
        return String::new();
    };
    let longest = bounds.size().max();
    let show = |v: f64, unit: LengthUnit| {
        let digits = (4 - v.abs().log10().floor() as i32).clamp(0, 12) as usize;
        let text = format!("{v:.digits$}");
        let text = if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.')
        } else {
            &text
        };
        format!("{text} {unit}")
    };
    if from == to {
        show(longest, from)
    } else {
        format!(
            "{} -> {}",
            show(longest, from),
            show(longest * from.to(to), to)
        )
    }
}

/// The text that a command on a file prints.
pub(super) fn answer(report: &Report, lines: &[String]) -> Answer {
    let json = serde_json::to_value(report).unwrap_or_default();
    Answer::new(lines.join("\n"), json)
}
