//! The result of a command: text, JSON object and exit code. Commands return it and do not print; exactly one of
//! text and object goes to stdout.

use super::context::Session;
use super::failure::Failure;
use super::terminal;
use crate::io::atomic::require_writable;
use serde_json::Value;
use std::io;
use std::io::Write;
use std::path::Path;

/// The result of a command.
pub(super) struct Answer {
    text: String,
    json: Value,
    code: u8,
}

impl Answer {
    /// A result to be shown as text, or as an object with `--json`.
    pub(super) fn new(text: impl Into<String>, json: Value) -> Self {
        Self {
            text: text.into(),
            json,
            code: 0,
        }
    }

    /// The same result with the exit code of a check: 0 if it passed, else 1.
    pub(super) fn verdict(self, passed: bool) -> Self {
        Self {
            code: u8::from(!passed),
            ..self
        }
    }

    /// Whether its checks passed.
    pub(super) fn passed(&self) -> bool {
        self.code == 0
    }

    /// Its text and its object.
    pub(super) fn into_parts(self) -> (String, Value) {
        (self.text, self.json)
    }

    /// Prints the result and returns the exit code. A closed pipe is no error.
    pub(super) fn print(&self, session: &Session) -> u8 {
        let text = if session.json() {
            format!("{}\n", terminal::json(&self.json))
        } else if self.text.is_empty() || self.text.ends_with('\n') {
            terminal::lines(&self.text).into_owned()
        } else {
            format!("{}\n", terminal::lines(&self.text))
        };
        // The exit code is that of the checks, unless stdout cannot be written.
        match write_stdout(text.as_bytes()) {
            // EX_IOERR of sysexits.h.
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => 74,
            _ => self.code,
        }
    }
}

/// Refuses an output without one of some extensions, or that cannot be written.
pub(super) fn require_output(path: &Path, known: &[&str]) -> Result<(), Failure> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    if known.iter().any(|k| extension.eq_ignore_ascii_case(k)) {
        return Ok(require_writable(path)?);
    }
    let known: Vec<String> = known.iter().map(|k| format!(".{k}")).collect();
    Err(Failure::usage(format!(
        "found the output {}; expected a name with the extension {}",
        path.display(),
        known.join(" or ")
    )))
}

/// Writes bytes to stdout at once.
fn write_stdout(bytes: &[u8]) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes)?;
    out.flush()
}
