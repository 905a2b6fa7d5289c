//! Errors as the user sees them: one block on stderr, or one object with `--json`.
//!
//! Errors of the library are converted here, those of designs and of homogenisation beside their commands: message,
//! hint with flags and commands, place in a file, exit status. Nothing else in the commands writes errors.

use super::context::Session;
use super::{excerpt, terminal};
use crate::io::{ErrorClass, ReadError, WriteError};
use crate::pipeline::RunError;
use crate::polymesh::ScriptError;
use crate::recipe::{Place, RecipeError, RecipeFault};
use crate::vdb::{Exhausted, FileError, VdbError};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{ErrorKind, Write};
use std::sync::Mutex;

mod exhausted;

/// Exit codes of failures: 2 for usage, the others by `sysexits.h`.
pub(super) const USAGE: u8 = 2;
const EXIT_DATA: u8 = 65;
const EXIT_NO_INPUT: u8 = 66;
const EXIT_BUG: u8 = 70;
const EXIT_CREATE: u8 = 73;
const EXIT_IO: u8 = 74;
const EXIT_RESUMABLE: u8 = 75;

/// Why a command failed, ready to be shown: the words of the command line for every error of the library.
#[derive(Debug, Default)]
pub struct Failure {
    code: u8,
    message: String,
    file: Option<String>,
    line: Option<u64>,
    column: Option<u64>,
    excerpt: Option<String>,
    element: Option<u64>,
    hint: Option<String>,
}

impl Failure {
    /// The exit code of the program.
    pub fn code(&self) -> u8 {
        self.code
    }

    /// What was found and what was expected.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The file at fault.
    pub fn file(&self) -> Option<&str> {
        self.file.as_deref()
    }

    /// Line and column in it, from 1.
    pub fn place(&self) -> (Option<u64>, Option<u64>) {
        (self.line, self.column)
    }

    /// The element or other item at fault, in the file's numbering.
    pub fn element(&self) -> Option<u64> {
        self.element
    }

    /// What to do.
    pub fn advice(&self) -> Option<&str> {
        self.hint.as_deref()
    }

    /// A failure of bad data in a file.
    pub(super) fn data(file: &std::path::Path, message: impl Into<String>) -> Self {
        Self {
            code: EXIT_DATA,
            message: message.into(),
            file: Some(file.display().to_string()),
            ..Self::default()
        }
    }

    /// An output that cannot be written where it should be.
    pub(super) fn output(path: &std::path::Path, message: impl Into<String>) -> Self {
        Self {
            code: EXIT_CREATE,
            ..Self::data(path, message)
        }
    }

    /// A step of a script that cannot be read or carried out.
    pub(super) fn script(file: &std::path::Path, text: &str, e: &ScriptError) -> Self {
        Self {
            line: Some(e.line as u64),
            column: Some(e.column as u64),
            excerpt: text.lines().nth(e.line - 1).map(str::to_owned),
            hint: e.hint.clone(),
            ..Self::data(file, e.message.clone())
        }
    }

    /// The message and the hint on one line, for the interactive mode.
    pub(super) fn one_line(&self) -> String {
        let hint = self.hint.as_ref();
        hint.map_or_else(
            || self.message.clone(),
            |h| format!("{}; {h}", self.message),
        )
    }

    /// Arguments that parse but make no sense together.
    pub(super) fn usage(message: impl Into<String>) -> Self {
        Self {
            code: USAGE,
            message: message.into(),
            ..Self::default()
        }
    }

    /// The same failure with advice.
    pub(super) fn hint(self, hint: impl Into<String>) -> Self {
        Self {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// A caught panic.
    pub(super) fn bug() -> Self {
        // The hook of `capture_panics` has kept the message.
        let panic = PANIC.lock().ok().and_then(|mut p| p.take());
        if panic.as_deref().is_some_and(exhausted::is_panic) {
            return Self::exhausted(Exhausted::Threads);
        }
        Self {
            code: EXIT_BUG,
            message: format!(
                "this is a bug of druse {}: {}",
                env!("CARGO_PKG_VERSION"),
                panic.unwrap_or_else(|| "a panic without a message".into())
            ),
            hint: Some("please report it with the command and its inputs".into()),
            ..Self::default()
        }
    }

    /// The end of a run that a signal stopped; the code is 128 plus its number (130 is an interrupt).
    pub(super) fn stopped(code: u8) -> Self {
        Self {
            code,
            message: match code {
                129 => "the terminal was closed; nothing half-written remains".into(),
                143 => "terminated; nothing half-written remains".into(),
                152 => "the processor time that the program may use has passed (ulimit -t); nothing half-written remains"
                    .into(),
                _ => "interrupted; nothing half-written remains".into(),
            },
            ..Self::default()
        }
    }

    /// Work that stopped and has left what it made so far.
    pub(super) fn resumable(message: impl Into<String>) -> Self {
        Self {
            code: EXIT_RESUMABLE,
            message: message.into(),
            ..Self::default()
        }
    }

    /// Whether the data of a file are at fault.
    pub(super) fn is_of_data(&self) -> bool {
        self.code == EXIT_DATA
    }

    /// Whether the machine, not the input, is at fault.
    pub(super) fn is_of_machine(&self) -> bool {
        matches!(self.code, EXIT_CREATE | EXIT_IO)
    }

    /// Whether the same command goes on from here.
    pub(super) fn is_resumable(&self) -> bool {
        self.code == EXIT_RESUMABLE
    }

    /// The same with another exit code.
    pub(super) fn ending_with(self, code: u8) -> Self {
        Self { code, ..self }
    }

    /// The object that `--json` prints.
    fn json(&self) -> Value {
        json!({
            "code": self.code,
            "message": excerpt::short_numbers(&self.message),
            "file": self.file,
            "line": self.line,
            "element": self.element,
            "hint": self.hint,
        })
    }

    /// The error as text of several lines: message, place, excerpt of the file with a marker, element, hint.
    /// With colours of a terminal if `colored`.
    fn block(&self, colored: bool) -> String {
        let paint = |code: &str, text: &str| {
            if colored {
                format!("\x1b[{code}m{text}\x1b[0m")
            } else {
                text.to_owned()
            }
        };
        let message = excerpt::short_numbers(&self.message);
        let message = terminal::message(&message);
        let mut block = format!("{}: {message}\n", paint("1;31", "error"));
        if let Some(file) = self.file.as_deref().map(terminal::line) {
            // A column makes sense only behind a line.
            let line_and_column = [self.line, self.column]
                .iter()
                .map_while(|n| n.map(|n| format!(":{n}")))
                .collect::<String>();
            let _ = writeln!(block, "  {} {file}{line_and_column}", paint("1;34", "-->"));
        }
        if let Some(excerpt) = &self.excerpt {
            let (shown, marker) = excerpt::cut(excerpt, self.column);
            let _ = writeln!(block, "   {} {shown}", paint("1;34", "|"));
            if let Some(marker) = marker {
                let _ = writeln!(block, "   {} {marker}", paint("1;34", "|"));
            }
        }
        if let Some(element) = self.element {
            let _ = writeln!(block, "  {} element {element}", paint("1;34", "-->"));
        }
        if let Some(hint) = self.hint.as_deref().map(terminal::line) {
            let _ = writeln!(block, "  {} {hint}", paint("1;36", "hint:"));
        }
        block
    }

    /// Prints the failure without colours, where there is no session, and returns the exit code.
    pub(super) fn print_plain(&self) -> u8 {
        let _ = write!(std::io::stderr(), "{}", self.block(false));
        self.code
    }

    /// Prints the failure and returns the exit code.
    pub(super) fn print(&self, session: &Session) -> u8 {
        let _ = write!(std::io::stderr(), "{}", self.block(session.colored()));
        if session.json() {
            let _ = writeln!(std::io::stdout(), "{}", terminal::json(&self.json()));
        }
        self.code
    }
}

/// Prints arguments that do not parse, and returns the exit code. `--help` and `--version` arrive here too; they
/// are not errors.
pub(super) fn usage(error: &clap::Error, json: bool) -> u8 {
    let code = error.exit_code() as u8;
    let plain = error.render().to_string();
    let shown = excerpt::short_numbers(&plain);
    let printed = match &shown {
        // With long numbers cut short, and without the colours that `print` may add.
        Cow::Owned(text) => write!(std::io::stderr(), "{text}"),
        Cow::Borrowed(_) => error.print(),
    };
    let printed = printed.and_then(|()| std::io::stdout().flush());
    // Help that nowhere can be written is no help; a closed pipe is no error.
    if code == 0 && printed.is_err_and(|e| e.kind() != ErrorKind::BrokenPipe) {
        return EXIT_IO;
    }
    if json && code != 0 {
        let message = shown
            .lines()
            .next()
            .unwrap_or("")
            .trim_start_matches("error: ");
        let failure = Failure {
            hint: Some("druse --help lists commands and flags".into()),
            ..Failure::usage(message)
        };
        let _ = writeln!(std::io::stdout(), "{}", terminal::json(&failure.json()));
    }
    code
}

/// The message of the last panic, kept for [`Failure::bug`].
static PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Keeps panics off stderr, so that they are shown like any other error.
pub(super) fn capture_panics() {
    std::panic::set_hook(Box::new(|info| {
        let text = info
            .payload()
            .downcast_ref::<&str>()
            .map(|s| (*s).to_owned())
            .or_else(|| info.payload().downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "a panic without a message".into());
        let place = info
            .location()
            .map_or(String::new(), |l| format!(" ({}:{})", l.file(), l.line()));
        if let Ok(mut panic) = PANIC.lock() {
            panic.get_or_insert(format!("{text}{place}"));
        }
    }));
}

impl From<RecipeError> for Failure {
    fn from(e: RecipeError) -> Self {
        let code = match e.fault {
            RecipeFault::Missing => EXIT_NO_INPUT,
            RecipeFault::Unreadable => EXIT_IO,
            RecipeFault::Invalid => EXIT_DATA,
        };
        let mut failure = Self {
            code,
            message: excerpt::short(&e.to_string()),
            file: e.file.as_ref().map(|f| f.display().to_string()),
            hint: e.hint.map(|h| excerpt::short(&h)),
            ..Self::default()
        };
        match e.place {
            Some(Place::Line { line, column, text }) => {
                failure.line = Some(line as u64);
                failure.column = Some(column as u64);
                failure.excerpt = Some(text);
            }
            Some(Place::Override(text)) => failure.excerpt = Some(format!("--set {text}")),
            None => {}
        }
        failure
    }
}

impl From<ReadError> for Failure {
    fn from(e: ReadError) -> Self {
        let place = match e.place() {
            crate::io::Place::File | crate::io::Place::Line(_) => String::new(),
            place => format!("{place}: "),
        };
        Self {
            code: e.class().exit_code(),
            message: format!("{place}found {}; expected {}", e.found(), e.expected()),
            file: Some(e.path().display().to_string()),
            line: e.line(),
            element: e.item(),
            hint: e.hint().map(str::to_owned),
            ..Self::default()
        }
    }
}

impl From<FileError> for Failure {
    fn from(e: FileError) -> Self {
        let (message, hint) = (e.to_string(), e.hint());
        let (code, file) = match e {
            FileError::Cancelled(_) => return Self::stopped(130),
            // Threads are missing for any file.
            FileError::Io { source, .. }
                if exhausted::cause(&source) == Some(Exhausted::Threads) =>
            {
                return Self::exhausted(Exhausted::Threads);
            }
            FileError::Io { path, source } if exhausted::cause(&source).is_some() => {
                return Self {
                    file: Some(path.display().to_string()),
                    ..Self::exhausted(Exhausted::Memory)
                };
            }
            FileError::Io { path, source } if source.kind() == ErrorKind::NotFound => {
                (EXIT_NO_INPUT, path)
            }
            FileError::Io { path, .. } | FileError::OpenVdb { path, .. } => (EXIT_IO, path),
            e @ FileError::Leaves(_) => {
                return Self {
                    code: EXIT_IO,
                    message: e.to_string(),
                    ..Self::default()
                };
            }
            FileError::Damaged { path, .. }
            | FileError::NoGrid { path, .. }
            | FileError::NotALevelSet { path, .. }
            | FileError::Name { path, .. } => (EXIT_DATA, path),
        };
        Self {
            code,
            message: without(&file, message),
            file: Some(file.display().to_string()),
            hint,
            ..Self::default()
        }
    }
}

impl From<RunError> for Failure {
    fn from(e: RunError) -> Self {
        let message = e.to_string();
        let (code, hint) = match e {
            // Errors of files have places and hints of their own; the others get the hint of the command line.
            RunError::Recipe(e) => return e.into(),
            RunError::Read(e) => return e.into(),
            RunError::Write(e) => return e.into(),
            RunError::File(e) => return e.into(),
            RunError::Cancelled(_) => return Self::stopped(130),
            RunError::Memory { fitting, .. } => (
                EXIT_DATA,
                Some(format!(
                    "--set band.voxel_size={fitting}, or --memory SIZE if the machine can take it"
                )),
            ),
            RunError::BricksUnsupported { .. } => (EXIT_DATA, Some("druse run RECIPE, without bricks".to_owned())),
            RunError::Budget { .. } => (EXIT_DATA, Some("--memory SIZE, or larger voxels".to_owned())),
            RunError::BrickSize { fitting, .. } => (
                EXIT_DATA,
                Some(match fitting {
                    Some(edge) => format!("--bricks {edge}, or --memory SIZE"),
                    None => "--memory SIZE, or larger voxels".to_owned(),
                }),
            ),
            RunError::BrickSpan { fitting, .. } => (EXIT_DATA, Some(format!("--bricks {fitting}"))),
            RunError::Disk { .. } => (EXIT_IO, Some("--out DIR on another disk".to_owned())),
            RunError::Bricks { advice, .. } => (EXIT_DATA, Some(advice)),
            RunError::Stopped { .. } => (
                EXIT_RESUMABLE,
                Some("the same command goes on from there".to_owned()),
            ),
            RunError::Busy(_) => (
                EXIT_CREATE,
                Some("wait for it; druse run --out DIR and druse plan -o PLAN make another copy".to_owned()),
            ),
            RunError::Plan { .. } => (
                EXIT_DATA,
                Some("druse plan makes a plan of the recipe as it is here".to_owned()),
            ),
            RunError::Disjoint { .. } => (
                EXIT_DATA,
                Some("check the units and frames of both: unit, up, transform".to_owned()),
            ),
            RunError::Empty(_) => (
                EXIT_DATA,
                Some(
                    "check the level of the cell, walls thinner than a voxel, and distances larger than the part"
                        .into(),
                ),
            ),
            RunError::Refused { hint, .. } => (EXIT_DATA, Some(hint.into())),
            RunError::Unbounded(_) => (EXIT_DATA, Some("intersect or subtract it".into())),
            RunError::Scaffold { file, element, .. } => {
                return Self {
                    code: EXIT_DATA,
                    message,
                    file: file.map(|f| f.display().to_string()),
                    element,
                    ..Self::default()
                };
            }
            RunError::MixedElements(_) => (
                EXIT_DATA,
                Some("split the mesh by shape, or mesh it with one kind of element".into()),
            ),
            RunError::Misfit { misfit, .. } => (
                EXIT_DATA,
                (!misfit.edges.is_empty())
                    .then(|| "druse scaffold check RECIPE -o X.vtu writes the edges".into()),
            ),
            RunError::Cell { .. }
            | RunError::Tiling(_)
            | RunError::Decimate(_)
            | RunError::Slices(_) => (EXIT_DATA, None),
            RunError::ChangedInputs(_) => (
                EXIT_DATA,
                Some("restore these files, or name their folder with --from DIR".into()),
            ),
            RunError::Overwrite(_) => (EXIT_CREATE, Some("name it otherwise, or use --out DIR".into())),
            RunError::Threads(_) => (EXIT_IO, Some(exhausted::THREADS_HINT.into())),
            RunError::Outside { .. } => (
                EXIT_CREATE,
                Some("the recipe must name it within that folder, as in part.vdb or sub/part.vdb".into()),
            ),
            RunError::Band { .. } | RunError::LevelSet { .. } | RunError::Strict { .. } => {
                (EXIT_DATA, None)
            }
        };
        Self {
            code,
            message,
            hint,
            ..Self::default()
        }
    }
}

impl From<VdbError> for Failure {
    fn from(e: VdbError) -> Self {
        match e {
            VdbError::Cancelled(_) => Self::stopped(130),
            e => Self {
                code: EXIT_DATA,
                message: e.to_string(),
                ..Self::default()
            },
        }
    }
}

impl From<WriteError> for Failure {
    fn from(e: WriteError) -> Self {
        Self {
            code: e.class().exit_code(),
            message: without(e.path(), e.to_string()),
            file: Some(e.path().display().to_string()),
            hint: (e.class() == ErrorClass::Io).then(|| {
                if e.path().extension().is_some_and(|x| x == "leaves") {
                    "bricks that are whole are kept: with room on the disk the same command goes on"
                        .into()
                } else {
                    "nothing half-written stands under the final name".into()
                }
            }),
            ..Self::default()
        }
    }
}

/// A message without its leading file name, which is shown on its own line.
fn without(file: &std::path::Path, message: String) -> String {
    match message.strip_prefix(&format!("{}: ", file.display())) {
        Some(rest) => rest.to_owned(),
        None => message,
    }
}
