//! `druse completions SHELL`.

use super::context::Session;
use super::failure::Failure;
use super::grammar;
use super::output::Answer;
use clap::Args;
use clap_complete::{Shell, generate};
use serde_json::json;

#[derive(Args)]
pub(super) struct Parameters {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// The script of the shell, made from the grammar of the command line.
#[allow(clippy::unnecessary_wraps)] // all commands have one signature
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<Answer, Failure> {
    let mut script = Vec::new();
    generate(p.shell, &mut grammar(), "druse", &mut script);
    let script = String::from_utf8_lossy(&script).into_owned();
    let json = json!({ "shell": p.shell.to_string(), "script": script });
    Ok(Answer::new(script, json))
}
