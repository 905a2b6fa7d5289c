//! `druse man`: the manual pages, made from the grammar of the command line, one for each command and subcommand.

use super::context::Session;
use super::failure::Failure;
use super::grammar;
use super::output::Answer;
use crate::io::atomic::{require_directory, write_bytes};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// Directory to write one page per command into; without it the main page is printed.
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Writes the manual pages of all commands into a folder, or prints the main page without one.
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<Answer, Failure> {
    let Some(directory) = &p.out else {
        let page = String::from_utf8_lossy(&page(grammar())).into_owned();
        let json = json!({ "page": page });
        return Ok(Answer::new(page, json));
    };
    require_directory(directory)?;
    let mut all = grammar();
    all.build();
    let mut files = Vec::new();
    let mut commands = vec![all];
    while let Some(command) = commands.pop() {
        // Built commands are shown as "druse-cell-info".
        let name = command.get_display_name().unwrap_or(command.get_name());
        let path = directory.join(format!("{name}.1"));
        files.push(path.display().to_string());
        let subcommands = command.get_subcommands();
        let subcommands: Vec<_> = subcommands
            .filter(|s| s.get_name() != "help" && !s.is_hide_set())
            .cloned()
            .collect();
        write_bytes(&path, &page(command))?;
        commands.extend(subcommands);
    }
    files.sort();
    Ok(Answer::new(files.join("\n"), json!({ "pages": files })))
}

/// The manual page of a command, in roff.
fn page(command: clap::Command) -> Vec<u8> {
    let mut page = Vec::new();
    // Writing to memory does not fail.
    let _ = clap_mangen::Man::new(command).render(&mut page);
    page
}
