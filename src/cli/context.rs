//! The context of one invocation: output style, progress, colour and treatment of warnings. Results go to stdout,
//! everything else to stderr; a session is also the progress that the library reports to and cancels by.

use super::failure::Failure;
use super::progress::{Display, Style};
use super::signals::{Relay, Signals};
use super::terminal;
use crate::pipeline::{RunError, Warning};
use crate::progress::{Progress, Threads};
use clap::{Args, ValueEnum};
use std::convert::Infallible;
use std::io::{IsTerminal, Write};
use std::str::FromStr;
use std::sync::Arc;

/// Removes the progress bar from a terminal.
pub(super) const CLEAR_LINE: &str = "\r\x1b[2K";

/// Flags that every command understands.
#[allow(clippy::struct_excessive_bools)] // Each is a flag of its own.
#[derive(Args)]
pub(super) struct GlobalOptions {
    /// Print exactly one JSON object on stdout.
    #[arg(long, global = true, help_heading = "Global options")]
    pub(super) json: bool,
    /// No progress, no notes on stderr.
    #[arg(short, long, global = true, help_heading = "Global options")]
    quiet: bool,
    /// How progress is shown on stderr [default: a bar on a terminal, nothing elsewhere].
    #[arg(long, global = true, value_enum, help_heading = "Global options")]
    progress: Option<Style>,
    /// When to colour messages: auto, always or never; `NO_COLOR` is honoured. For preview also the grid of
    /// floats of a .vdb that colours the surface, as in `cell_id`.
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        default_value = "auto",
        help_heading = "Global options"
    )]
    color: Color,
    /// Show records of decisions on stderr: kernels, tables, bricks or memory, repairs.
    #[arg(
        long,
        global = true,
        value_enum,
        value_name = "LEVEL",
        default_value = "off",
        help_heading = "Global options"
    )]
    log: LogLevel,
    /// Print more on stderr: the time of every stage.
    #[arg(short, long, global = true, action = clap::ArgAction::Count, help_heading = "Global options")]
    verbose: u8,
    /// Treat warnings as errors.
    #[arg(long, global = true, help_heading = "Global options")]
    strict: bool,
    /// Use only instructions that all processors have, so that the same .cell gives the same bytes on all of
    /// them; slower.
    #[arg(long, global = true, help_heading = "Global options")]
    portable: bool,
}

/// Which records of decisions are shown: those of a level and of all levels before it.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LogLevel {
    /// None.
    Off,
    /// Repairs of inputs.
    Info,
    /// Choices of kernels, tables, methods and memory too.
    Debug,
}

/// Prints records of the library on stderr, above the progress.
struct Log(Arc<Display>);

impl log::Log for Log {
    fn enabled(&self, record: &log::Metadata<'_>) -> bool {
        // Other libraries keep records too.
        record.target().starts_with("druse")
    }
    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            let level = record.level().as_str().to_lowercase();
            self.0.line(&format!(
                "{level}: {}",
                terminal::message(&record.args().to_string())
            ));
        }
    }
    fn flush(&self) {}
}

impl LogLevel {
    /// Has records of this level printed.
    fn show(self, display: &Arc<Display>) {
        let most = match self {
            Self::Off => return,
            Self::Info => log::LevelFilter::Info,
            Self::Debug => log::LevelFilter::Debug,
        };
        // A program that the command line runs in may have a logger of its own, which then has the records.
        if log::set_boxed_logger(Box::new(Log(Arc::clone(display)))).is_ok() {
            log::set_max_level(most);
        }
    }
}

/// When to colour messages.
#[derive(Clone, PartialEq, Eq)]
enum Color {
    /// On a terminal, unless `NO_COLOR` is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
    /// As `Auto`; a preview is also coloured by the grid of this name.
    Grid(String),
}

impl FromStr for Color {
    type Err = Infallible;
    fn from_str(word: &str) -> Result<Self, Infallible> {
        Ok(match word {
            "auto" => Self::Auto,
            "always" => Self::Always,
            "never" => Self::Never,
            grid => Self::Grid(grid.to_owned()),
        })
    }
}

/// A running invocation.
pub(super) struct Session {
    options: GlobalOptions,
    display: Arc<Display>,
    /// Signals received so far.
    pub(super) signals: Signals,
}

impl Session {
    /// Starts an invocation: sets the instructions of the process (`--portable`), the logger, and the handlers of
    /// signals. A parent passes its own on through `relay`.
    pub(super) fn new(options: GlobalOptions, relay: Option<Relay>) -> Self {
        if options.portable {
            crate::simd::use_instruction_set(crate::simd::InstructionSet::Portable);
        }
        let terminal = std::io::stderr().is_terminal();
        let style = match options.progress {
            _ if options.quiet => Style::None,
            Some(style) => style,
            None if terminal => Style::Bar,
            None => Style::None,
        };
        let display = Arc::new(Display::new(style));
        options.log.show(&display);
        Self {
            options,
            display,
            signals: Signals::listen(relay),
        }
    }

    /// Whether stdout is one JSON object.
    pub(super) fn json(&self) -> bool {
        self.options.json
    }

    /// Whether warnings are errors.
    pub(super) fn strict(&self) -> bool {
        self.options.strict
    }

    /// Whether a bar shows the progress.
    pub(super) fn shows_bar(&self) -> bool {
        self.display.is_bar()
    }

    /// Removes the bar that a program left on the terminal when it ended.
    pub(super) fn clear_bar(&self) {
        if self.shows_bar() {
            let _ = write!(std::io::stderr(), "{CLEAR_LINE}");
        }
    }

    /// Whether more details are printed.
    pub(super) fn verbose(&self) -> bool {
        self.options.verbose > 0
    }

    /// Whether stderr is coloured.
    pub(super) fn colored(&self) -> bool {
        match &self.options.color {
            Color::Always => true,
            Color::Never => false,
            Color::Auto | Color::Grid(_) => {
                let no_color = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
                !no_color && std::io::stderr().is_terminal()
            }
        }
    }

    /// The grid that colours a picture, if `--color` names one.
    pub(super) fn color_grid(&self) -> Option<&str> {
        match &self.options.color {
            Color::Grid(name) => Some(name),
            _ => None,
        }
    }

    /// A line for the user on stderr, unless quiet.
    pub(super) fn note(&self, text: &str) {
        if !self.options.quiet {
            self.display.line(&terminal::message(text));
        }
    }

    /// An error after which the command goes on, on stderr; quiet does not hide it.
    pub(super) fn error(&self, text: &str) {
        self.display.line(&terminal::lines(text));
    }

    /// A warning on stderr; quiet does not hide it.
    pub(super) fn warn(&self, warning: &Warning) {
        let (on, off) = if self.colored() {
            ("\x1b[1;33m", "\x1b[0m")
        } else {
            ("", "")
        };
        self.display.line(&format!(
            "{on}warning[{}]{off}: {}",
            warning.code,
            terminal::message(&warning.message)
        ));
    }

    /// Prints a warning of one command; with `--strict` it is an error and nothing is printed.
    pub(super) fn warn_of(&self, code: &'static str, message: String) -> Result<(), Failure> {
        if self.strict() {
            return Err(RunError::Strict { code, message }.into());
        }
        self.warn(&Warning { code, message });
        Ok(())
    }

    /// Stops a command of several steps after a signal, between two of them.
    pub(super) fn require_running(&self) -> Result<(), Failure> {
        self.signals
            .exit_code()
            .map_or(Ok(()), |code| Err(Failure::stopped(code)))
    }

    /// Removes the progress display from the terminal.
    pub(super) fn finish(&self) {
        self.display.finish();
    }
}

/// A pool of `count` threads; 0 means one per core.
pub(super) fn threads(count: usize) -> Result<Threads, Failure> {
    Threads::new(count).map_err(|e| RunError::Threads(e.to_string()).into())
}

impl Progress for Session {
    fn stage(&self, name: &str, total: Option<u64>) {
        self.display.stage(name, total);
    }
    fn advance(&self, n: u64) {
        self.display.advance(n);
    }
    fn cancelled(&self) -> bool {
        self.signals.stopped()
    }
}
