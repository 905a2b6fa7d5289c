//! One invocation: how it talks, and what it is told to do about progress, colour and warnings.

use super::Failure;
use super::progress::{Display, Style};
use super::signals::Signals;
use crate::pipeline::{RunError, Warning};
use crate::progress::{Progress, Threads};
use clap::Args;
use std::convert::Infallible;
use std::io::IsTerminal;
use std::str::FromStr;

/// Flags that every command understands.
#[allow(clippy::struct_excessive_bools)] // Each is a flag of its own.
#[derive(Args)]
pub(super) struct Manners {
    /// Print exactly one JSON object on stdout.
    #[arg(long, global = true, help_heading = "Manners")]
    pub(super) json: bool,
    /// No progress, no notes on stderr.
    #[arg(short, long, global = true, help_heading = "Manners")]
    quiet: bool,
    /// How progress is shown on stderr [default: a bar on a terminal, nothing elsewhere].
    #[arg(long, global = true, value_enum, help_heading = "Manners")]
    progress: Option<Style>,
    /// When to colour messages: auto, always or never; `NO_COLOR` is honoured. For preview also the grid of
    /// floats of a .vdb that colours the surface, as in `cell_id`.
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        default_value = "auto",
        help_heading = "Manners"
    )]
    color: Color,
    /// Say more on stderr: the time of every stage.
    #[arg(short, long, global = true, action = clap::ArgAction::Count, help_heading = "Manners")]
    verbose: u8,
    /// Treat warnings as errors.
    #[arg(long, global = true, help_heading = "Manners")]
    strict: bool,
    /// Use no instructions that only some processors have: the same bytes from the same .cell on all of
    /// them, more slowly.
    #[arg(long, global = true, help_heading = "Manners")]
    portable: bool,
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
    /// As by itself; something else is coloured by a grid of this name.
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
    manners: Manners,
    display: Display,
    /// Signals that have come.
    pub(super) signals: Signals,
}

impl Session {
    pub(super) fn new(manners: Manners) -> Self {
        if manners.portable {
            crate::simd::use_code(crate::simd::Code::Portable);
        }
        let terminal = std::io::stderr().is_terminal();
        let style = match manners.progress {
            _ if manners.quiet => Style::None,
            Some(style) => style,
            None if terminal => Style::Bar,
            None => Style::None,
        };
        Self {
            manners,
            display: Display::new(style),
            signals: Signals::listen(),
        }
    }

    /// Whether stdout shall be one JSON object.
    pub(super) fn json(&self) -> bool {
        self.manners.json
    }

    /// Whether warnings are errors.
    pub(super) fn strict(&self) -> bool {
        self.manners.strict
    }

    /// Whether more shall be said.
    pub(super) fn verbose(&self) -> bool {
        self.manners.verbose > 0
    }

    /// Whether stderr is coloured.
    pub(super) fn colored(&self) -> bool {
        match &self.manners.color {
            Color::Always => true,
            Color::Never => false,
            Color::Auto | Color::Grid(_) => {
                let asked_not = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
                !asked_not && std::io::stderr().is_terminal()
            }
        }
    }

    /// The grid that colours a picture, if `--color` names one.
    pub(super) fn color_grid(&self) -> Option<&str> {
        match &self.manners.color {
            Color::Grid(name) => Some(name),
            _ => None,
        }
    }

    /// A line for the user on stderr, unless quiet.
    pub(super) fn note(&self, text: &str) {
        if !self.manners.quiet {
            self.display.line(text);
        }
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
            warning.code, warning.message
        ));
    }

    /// A warning of a command's own; an error with `--strict`.
    pub(super) fn warn_of(&self, code: &'static str, message: String) -> Result<(), Failure> {
        if self.strict() {
            return Err(RunError::Strict { code, message }.into());
        }
        self.warn(&Warning { code, message });
        Ok(())
    }

    /// Takes the progress display off the terminal.
    pub(super) fn finish(&self) {
        self.display.finish();
    }
}

/// A pool of so many threads; 0 means one per core.
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
