//! The command line program: parses arguments, shows progress, maps signals and errors to exit codes.
//!
//! A subcommand is one file here and one line in the table below. Flags map to the sections of a recipe, the
//! library does the work, and the result is an `Answer`, printed as text or, with `--json`, as exactly one
//! object. stdout carries results, stderr everything else.
//!
//! | code | meaning | code | meaning |
//! |---|---|---|---|
//! | 0 | done | 73 | output cannot be created |
//! | 1 | a check failed | 74 | input or output error, or no memory |
//! | 2 | usage | 75 | stopped and resumable |
//! | 65 | bad input data | 129 | terminal closed |
//! | 66 | input missing | 130, 143 | interrupted, terminated |
//! | 70 | a bug in Druse | 152 | no processor time |

use crate::vdb::subprocess::Program;
use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::OsString;
use std::io::Write;
use std::panic::AssertUnwindSafe;

mod cell;
mod cell_text;
mod check;
mod completions;
mod context;
mod crystal;
mod design;
mod eval;
mod excerpt;
mod failure;
mod filter;
mod fit;
mod frames;
mod grade;
mod homogenize;
mod html;
mod implicit;
mod info;
mod job;
mod kind;
mod layers;
mod library;
mod man;
mod merge;
mod mesh;
mod new;
mod new_part;
mod numbers;
mod output;
mod parent;
mod plan;
mod plot;
mod points;
mod preview;
mod progress;
mod repeat;
mod report;
mod require;
mod run;
mod run_text;
mod scaffold;
mod scaffold_make;
mod schema;
mod sequence_plan;
mod server;
mod signals;
mod slice;
mod solid_text;
mod sweep;
mod terminal;
mod vdb;
mod vdb_commands;
mod view;
mod voxelize;

use context::{GlobalOptions, Session};
pub use failure::Failure;
use output::Answer;
use parent::Role;

/// Symmetric implicit microstructures over unstructured meshes, as OpenVDB level sets.
#[derive(Parser)]
#[command(
    name = "druse",
    version,
    max_term_width = 100,
    arg_required_else_help = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    options: GlobalOptions,
}

/// The table of subcommands: name, parameters, and the function that runs it.
macro_rules! commands {
    ($($(#[$meta:meta])* $name:ident => $module:ident,)*) => {
        // Parsed once per process, so its size does not matter.
        #[allow(clippy::large_enum_variant)]
        #[derive(Subcommand)]
        enum Command { $($(#[$meta])* $name($module::Parameters),)* }

        impl Command {
            /// Whether a child of the process may be the program: not for a server, which has to outlive a file, nor
            /// for the child that judges one.
            fn may_fork(&self) -> bool {
                !matches!(self, Self::View(_) | Self::InspectVdb(_))
            }

            fn answer(self, session: &Session) -> Result<Answer, Failure> {
                match self { $(Self::$name(p) => $module::answer(&p, session),)* }
            }
        }
    };
}

commands! {
    /// Run a recipe: from its sources to its files.
    Run => run,
    /// Plan a run in bricks, for several machines or a queue.
    Plan => plan,
    /// Merge the bricks of a plan and write the recipe's files.
    Merge => merge,
    /// Run all combinations of values of a recipe's keys into one table.
    Sweep => sweep,
    /// Fit a symmetric cell to a mesh or a named surface.
    Fit => fit,
    /// Inspect, evaluate, plot or homogenize a cell.
    Cell => cell,
    /// Run a polygon modelling script, and write or draw its mesh.
    Crystal => crystal,
    /// Inspect or check a scaffold.
    Scaffold => scaffold,
    /// Grade a recipe's tiling by results of its finite-element deck.
    Grade => grade,
    /// Evaluate the tiled field of a recipe at given points.
    Eval => eval,
    /// Turn a closed or dirty mesh into a level set.
    Voxelize => voxelize,
    /// Apply level-set operations to an OpenVDB file, in order.
    Filter => filter,
    /// Turn the level set of an OpenVDB file into a mesh.
    Mesh => mesh,
    /// Cut a level set or a recipe's exact field into layers for printers.
    Slice => slice,
    /// Describe any file that Druse reads.
    Info => info,
    /// Check a mesh or a level set; exit code 1 if the check fails.
    Check => check,
    /// Make one HTML page of a run's report: requirements, walls, gaps, inputs and how to make it again.
    Report => report,
    /// Draw a shaded picture of a level set, mesh, cell or scaffold.
    Preview => preview,
    /// Show a recipe, level set, mesh, cell or scaffold in a browser, on a live page or in one file.
    View => view,
    /// Write a commented recipe to start from.
    New => new,
    /// Print the JSON schema of recipes.
    Schema => schema,
    /// Print completions for a shell.
    Completions => completions,
    /// Write the manual pages.
    Man => man,
    /// Read a .vdb within limits and describe it on one line.
    #[command(hide = true)]
    InspectVdb => vdb,
}

/// The whole grammar of the command line.
fn grammar() -> clap::Command {
    Cli::command()
}

/// Runs the program on its arguments (the first is its name), and ends the process with its exit code. Where they name
/// a `.vdb`, a child of the process is the program, so that a damaged file ends the child alone.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ! {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let run = || run_process(&arguments, Isolation::Fork);
    let code = std::panic::catch_unwind(AssertUnwindSafe(run));
    let code = code.unwrap_or_else(|_| Failure::bug().print_plain());
    exit(code)
}

/// Ends the process without exit handlers: those of libraries wait for their threads, which a forked process does not
/// have.
fn exit(code: u8) -> ! {
    let _ = std::io::stdout().flush();
    signal_hook::low_level::exit(i32::from(code))
}

/// As [`main`], for a program that is not this process's executable, and without its end: `reader` starts it as the
/// child that reads `.vdb` files.
pub fn run_program(arguments: impl IntoIterator<Item = OsString>, reader: Option<Program>) -> u8 {
    if let Some(reader) = reader {
        vdb::set_reader(reader);
    }
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    run_process(&arguments, Isolation::Verdict)
}

/// How a damaged `.vdb` is kept from ending the program.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Isolation {
    /// Where the arguments name one, the program is a child of this process; else as [`Isolation::Verdict`].
    Fork,
    /// A child reads each file first.
    Verdict,
}

/// Parses the arguments, runs the command, and prints its answer or failure. Returns the exit code.
fn run_process(arguments: &[OsString], isolation: Isolation) -> u8 {
    let json = arguments.iter().any(|a| a == "--json");
    Failure::print_on_exhaustion(None);
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(e) => {
            // The error quotes arguments: it is made again of what a terminal may show of them.
            let shown = arguments
                .iter()
                .map(|a| terminal::line(&a.to_string_lossy()).into_owned());
            let e = Cli::try_parse_from(shown).err().unwrap_or(e);
            return failure::usage(&e, json);
        }
    };
    let command = cli.command;
    let may_fork = isolation == Isolation::Fork && command.may_fork();
    let role = if may_fork && arguments.iter().any(parent::is_volume) {
        parent::split()
    } else {
        Role::Alone
    };
    let is_child = matches!(role, Role::Child(_));
    let relay = match role {
        Role::Alone => None,
        Role::Child(relay) => Some(relay),
        Role::Parent(parent) => {
            return parent.wait().unwrap_or_else(|failure| {
                let session = Session::new(cli.options, None);
                session.clear_bar();
                failure.print(&session)
            });
        }
    };
    let session = Session::new(cli.options, relay);
    failure::capture_panics();
    match command {
        // Its parent has the words for it.
        Command::InspectVdb(_) => crate::vdb::limits::end_silently(),
        _ => Failure::print_on_exhaustion(Some(&session)),
    }
    let answered = match session.color_grid() {
        Some(word) if !matches!(command, Command::Preview(_)) => Ok(Err(Failure::usage(format!(
            "found --color {word}; expected auto, always or never"
        )))),
        _ => std::panic::catch_unwind(AssertUnwindSafe(|| command.answer(&session))),
    };
    session.finish();
    let answered = answered.unwrap_or_else(|_| Err(Failure::bug()));
    // A signal during unwinding decides the exit code, whatever the error is, unless the run can be resumed.
    let code = match (&answered, session.signals.exit_code()) {
        (Ok(answer), _) => answer.print(&session),
        (Err(failure), Some(code)) if !failure.is_resumable() => {
            Failure::stopped(code).print(&session)
        }
        (Err(failure), _) => failure.print(&session),
    };
    // Nothing is freed after the words, since a file that destroyed the heap would end the program by a second error.
    if is_child {
        exit(code);
    }
    code
}
