//! `druse cell homogenize X.cell|NAME`: effective properties of a periodic cell.
//!
//! The results on two grids, one half as fine, give an estimate of the discretisation error. A sweep uses one grid
//! at each volume fraction and starts from the previous solution.

use super::context::Session;
use super::failure::Failure;
use super::output::{Answer, require_output};
use crate::frame::Element;
use crate::homogenize::{
    Control, HomogenizeError, Isotropic, Packing, Properties, Settings, compliance,
};
use crate::io::atomic::write_bytes;
use crate::pipeline;
use crate::pipeline::{CellPeriod, PropertyOptions, Warning};
use crate::progress::Threads;
use crate::recipe::{CellSection, Fraction, Positive, Recipe, Section};
use clap::{Args, ValueEnum};
use output::{Material, PeriodResults};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
pub(super) use sweep::Sweep;

mod output;
mod pareto;
mod sweep;

/// Residual for derivatives; their error is of the order of the residual itself.
const GRADIENT_RESIDUAL: f64 = 1e-7;

#[allow(clippy::struct_excessive_bools)] // Each is a flag of its own.
#[derive(Args)]
pub(super) struct Parameters {
    /// The .cell file, or any input of `druse fit`: a surface, struts, plates, a mesh, voxels, a formula; with
    /// --recipe the name of one of its cells. Struts and plates are round beams (--fitted for a series).
    cell: PathBuf,
    /// The results to write (.json or .csv); with --sweep the table [default: print only].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// A recipe that has the cell.
    #[arg(long, value_name = "RECIPE")]
    recipe: Option<PathBuf>,
    #[command(flatten)]
    section: CellSection,
    /// Treat struts of a graph and plates as a Fourier series instead of round beams.
    #[arg(long)]
    fitted: bool,
    /// Periodic packing of tets: twelve or six in a cube.
    #[arg(long, value_enum, default_value = "bcc")]
    tets: Tets,
    /// Voxels along the period, an even number.
    #[arg(long, value_name = "N", default_value_t = 64)]
    resolution: usize,
    /// Young's modulus of the solid [default: 1, so that results are relative to it].
    #[arg(long = "E", value_name = "MODULUS", allow_negative_numbers = true)]
    young: Option<f64>,
    /// Poisson's ratio of the solid.
    #[arg(
        long = "nu",
        value_name = "RATIO",
        default_value_t = 0.3,
        allow_negative_numbers = true
    )]
    poisson: f64,
    /// Conductivity of the solid, thermal or electric [default: 1].
    #[arg(long, value_name = "CONDUCTIVITY", allow_negative_numbers = true)]
    kappa: Option<f64>,
    /// Moduli and conductivity of the void over those of the solid.
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = 1e-4,
        allow_negative_numbers = true
    )]
    void: f64,
    /// Compute only these properties.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PROPERTY,...")]
    only: Vec<Property>,
    /// Round voxels to solid or void instead of using shares; results then satisfy all bounds.
    #[arg(long)]
    sharp: bool,
    /// Solve all load cases even where cubic symmetry needs fewer.
    #[arg(long)]
    all_loads: bool,
    /// Residual at which iterations end, over that of the load; the stiffness errs by about its square.
    #[arg(long, value_name = "SHARE", default_value_t = 1e-4)]
    residual: f64,
    /// Young's modulus by direction as a table (.csv).
    #[arg(long, value_name = "E.csv", conflicts_with = "sweep")]
    modulus: Option<PathBuf>,
    /// Young's modulus by direction as a picture (.png).
    #[arg(long, value_name = "E.png", conflicts_with = "sweep")]
    picture: Option<PathBuf>,
    /// Compute derivatives by the level and by every coefficient.
    #[arg(long, conflicts_with_all = ["sweep", "sharp"])]
    gradient: bool,
    /// A table over the volume fraction, as in `volume_fraction=0.1:0.6:0.05`.
    #[arg(long, value_name = "volume_fraction=FROM:TO:STEP")]
    sweep: Option<Sweep>,
    /// The sweep as a picture (.png).
    #[arg(long, value_name = "X.png", requires = "sweep")]
    plot: Option<PathBuf>,
    /// Bulk modulus over permeability as a picture (.png): of this cell, of those beside it and of named surfaces at
    /// its volume fraction, all of wholly solid or void voxels. With -o their table.
    #[arg(long, value_name = "X.png", conflicts_with_all = ["sweep", "gradient", "modulus", "picture", "only"])]
    pareto: Option<PathBuf>,
    /// A .cell file or a surface to show with --pareto. May be repeated.
    #[arg(long, value_name = "CELL", requires = "pareto")]
    beside: Vec<PathBuf>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// A packing of tets.
#[derive(Clone, Copy, ValueEnum)]
enum Tets {
    /// Twelve, between corners and centres of cubes: cubic symmetry.
    Bcc,
    /// Six around a diagonal: trigonal symmetry.
    Kuhn,
}

/// A property to compute.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Property {
    Stiffness,
    Conductivity,
    Permeability,
}

impl From<HomogenizeError> for Failure {
    fn from(e: HomogenizeError) -> Self {
        let hint = match &e {
            HomogenizeError::Cancelled(_) => return Self::stopped(130),
            HomogenizeError::Band { needed, .. } => {
                format!("--resolution {}", needed.next_multiple_of(2))
            }
            HomogenizeError::NotConverged { .. } => {
                "a larger --residual, or a void less weak: --void 1e-3".to_owned()
            }
            HomogenizeError::NoCoefficients => {
                "struts as a series: --fitted; leave out --gradient".to_owned()
            }
            HomogenizeError::NoWalls => "--only stiffness,conductivity".to_owned(),
            _ => return Self::usage(e.to_string()),
        };
        Self::usage(e.to_string()).hint(hint)
    }
}

/// Computes effective properties, a sweep of them, or a comparison with other cells.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let settings = settings(p)?;
    // The computation takes minutes: names are checked before it.
    for (path, extensions) in [
        (&p.output, &["json", "csv"][..]),
        (&p.modulus, &["csv"]),
        (&p.picture, &["png"]),
        (&p.plot, &["png"]),
        (&p.pareto, &["png"]),
    ] {
        if let Some(path) = path {
            require_output(path, extensions)?;
        }
    }
    // These keep the solutions, which need more memory.
    let keeps = p.gradient || p.sweep.is_some();
    if let Some(fault) = pipeline::resolution_fault(p.resolution, &settings, keeps) {
        return Err(Failure::usage(format!("--resolution: {fault}")));
    }
    let mut source = threads.install(|| period(p, &threads, session))?;
    for Warning { code, message } in std::mem::take(&mut source.warnings) {
        session.warn_of(code, message)?;
    }
    threads.install(|| match (&p.sweep, &p.pareto) {
        (Some(sweep), _) => sweep::answer(p, &source, sweep, &settings, session),
        (_, Some(picture)) => pareto::answer(p, &source, picture, &settings, session),
        _ => one(p, &source, &settings, session),
    })
}

/// The settings of the flags. Values out of range, and flags that need a property not in --only, are errors of usage.
fn settings(p: &Parameters) -> Result<Settings, Failure> {
    let refuse = |flag: &str, found: f64, expected: &str| {
        Failure::usage(format!("{flag}: found {found}; expected {expected}"))
    };
    let young = p.young.unwrap_or(1.0);
    if !(young.is_finite() && young > 0.0) {
        return Err(refuse("--E", young, "a positive modulus"));
    }
    let solid = Isotropic::new(young, p.poisson).map_err(|_| {
        refuse(
            "--nu",
            p.poisson,
            "a number between -1 and 0.5, both excluded",
        )
    })?;
    let kappa = p.kappa.unwrap_or(1.0);
    if !(kappa.is_finite() && kappa > 0.0) {
        return Err(refuse("--kappa", kappa, "a positive conductivity"));
    }
    if !(0.0..1.0).contains(&p.void) {
        return Err(refuse("--void", p.void, "a share from 0 on, below 1"));
    }
    if !(p.residual > 0.0 && p.residual < 1.0) {
        return Err(refuse("--residual", p.residual, "a share between 0 and 1"));
    }
    // Without --only all properties are wanted.
    let wants = |property| p.only.is_empty() || p.only.contains(&property);
    if p.gradient && !(wants(Property::Stiffness) && wants(Property::Conductivity)) {
        return Err(Failure::usage(
            "--gradient needs stiffness and conductivity; expected both in --only",
        ));
    }
    let needs_stiffness = p.modulus.is_some() || p.picture.is_some();
    if needs_stiffness && !wants(Property::Stiffness) {
        return Err(Failure::usage(
            "--modulus and --picture need the stiffness; expected it in --only",
        ));
    }
    Ok(Settings {
        solid,
        kappa,
        void: p.void,
        stiffness: wants(Property::Stiffness),
        conductivity: wants(Property::Conductivity),
        permeability: wants(Property::Permeability),
        all_loads: p.all_loads || p.gradient,
        control: Control {
            // The error of derivatives is of the order of the residual itself, not of its square.
            tolerance: if p.gradient {
                p.residual.min(GRADIENT_RESIDUAL)
            } else {
                p.residual
            },
            ..Control::default()
        },
        ..Settings::default()
    })
}

/// The period (repeating box) that the arguments name: of a recipe's cell, of struts as round beams, or of a
/// fitted cell.
fn period(p: &Parameters, threads: &Threads, session: &Session) -> Result<CellPeriod, Failure> {
    let packing = match p.tets {
        Tets::Bcc => Packing::Bcc,
        Tets::Kuhn => Packing::Kuhn,
    };
    let mut flags = p.section.clone();
    if p.fitted {
        flags.section = Some(Section::Fitted);
    }
    if let Some(sweep) = p.sweep.as_ref().filter(|_| flags.levels().is_empty()) {
        // The cell is made at the first fraction, since a sheet cannot be made without a thickness.
        flags.volume_fraction = Some(Fraction(sweep.first()));
    }
    if let Some(path) = &p.recipe {
        let recipe = Recipe::read(path, &[])?;
        let name = p.cell.to_string_lossy();
        let tools = crate::vdb::Session::new(threads, session);
        return Ok(pipeline::recipe_period(
            &recipe, &name, &flags, packing, tools,
        )?);
    }
    // A formula is not a path.
    let name = if p.cell.is_file() {
        super::cell_text::stem(&p.cell)
    } else {
        p.cell.to_string_lossy().into_owned()
    };
    // A hybrid is no round beams.
    if flags.hybrid().is_none() {
        let (section, element) = super::fit::section(&p.cell, &flags)?;
        if !matches!(element, Element::Hex | Element::Quad | Element::Tet) {
            let refused = HomogenizeError::Element(element.name());
            return Err(Failure::data(&p.cell, refused.to_string())
                .hint("wedges, pyramids, triangles and balls are not periodic"));
        }
        check_band_limit(&section, element, p.resolution)?;
        let beams = pipeline::beam_period(&name, &section, element, packing)
            .map_err(|e| super::fit::of_input(e, &p.cell))?;
        if let Some(found) = beams {
            return Ok(found);
        }
    }
    // All that are no beams are fitted.
    flags.section = None;
    let (cell, warnings) = super::fit::make(&name, &p.cell, &flags, threads, session)?;
    pipeline::cell_period(cell, packing, warnings).map_err(|e| super::fit::of_input(e, &p.cell))
}

/// Refuses a band limit above the grid's Nyquist frequency (half the voxels along the period) before the fit. Tets are
/// checked after it, since their period is not their edge.
fn check_band_limit(
    section: &CellSection,
    element: Element,
    resolution: usize,
) -> Result<(), HomogenizeError> {
    let nyquist = resolution as f64 / 2.0;
    match section.band_limit {
        Some(Positive(limit)) if element != Element::Tet && limit > nyquist => {
            Err(HomogenizeError::Band {
                limit,
                nyquist,
                needed: 2 * limit.ceil() as usize,
            })
        }
        _ => Ok(()),
    }
}

/// The properties of one cell on the requested grid and, if it holds the cell, on one half as fine: as the answer and
/// in the files that the flags name.
fn one(
    p: &Parameters,
    source: &CellPeriod,
    settings: &Settings,
    session: &Session,
) -> Result<Answer, Failure> {
    let options = PropertyOptions {
        resolution: p.resolution,
        is_sharp: p.sharp,
        with_gradient: p.gradient,
        settings: *settings,
    };
    let computed = pipeline::cell_properties(source, &options, session)?;
    let fine = &computed.fine;
    warn_of(source, fine, p.resolution, computed.level, session)?;
    let found = PeriodResults {
        source,
        material: Material {
            young: p.young,
            poisson: p.poisson,
            kappa: p.kappa,
            void: p.void,
        },
        is_sharp: p.sharp,
        computed: &computed,
    };
    let mut written = Vec::new();
    if let Some(path) = &p.output {
        let text = if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"))
        {
            found.csv()
        } else {
            format!("{:#}\n", found.json())
        };
        written.push((&**path, write_bytes(path, text.as_bytes())?));
    }
    if p.modulus.is_some() || p.picture.is_some() {
        // Young's modulus along n is 1 / (n n : S : n n), with the compliance S.
        let inverse = fine.stiffness.as_ref().and_then(compliance);
        let inverse = inverse.ok_or_else(|| {
            Failure::usage("the stiffness is singular; it has no directional modulus")
                .hint("a void with a small stiffness: --void 1e-4")
        })?;
        if let Some(path) = &p.modulus {
            let table = output::modulus_table(&inverse);
            written.push((&**path, write_bytes(path, table.as_bytes())?));
        }
        if let Some(path) = &p.picture {
            let (title, lines) = found.caption();
            let image = pipeline::modulus_picture(&inverse, &title, &lines);
            written.push((&**path, write_bytes(path, &image.png()?)?));
        }
    }
    Ok(with_files(found.text(), found.json(), &written))
}

/// Warns of disconnected phases and of beams that the grid of `n` voxels does not resolve; `level` is that of the
/// solid.
fn warn_of(
    source: &CellPeriod,
    found: &Properties,
    n: usize,
    level: f64,
    session: &Session,
) -> Result<(), Failure> {
    for warning in pipeline::period_warnings(source, found, n, level) {
        session.warn_of(warning.code, warning.message)?;
    }
    Ok(())
}

/// The answer with the written files and their sizes in bytes below its text and in its facts.
fn with_files(mut text: String, mut facts: serde_json::Value, files: &[(&Path, u64)]) -> Answer {
    for (path, bytes) in files {
        let (path, size) = (super::terminal::path(path), super::numbers::size(*bytes));
        let _ = writeln!(text, "{path}  {size}");
    }
    let list = files.iter();
    let list = list.map(
        |(path, bytes)| serde_json::json!({ "path": path.display().to_string(), "bytes": bytes }),
    );
    facts["files"] = list.collect();
    Answer::new(text, facts)
}
