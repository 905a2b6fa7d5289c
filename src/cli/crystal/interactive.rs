//! The interactive mode: steps from stdin, results on stdout.

use super::super::terminal;
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::polymesh::{Interpreter, PolyMesh, Script, VERBS};
use std::io::{BufRead, IsTerminal, Write};
use std::path::Path;

const HELP: &str = "undo [N], redo [N]   back and forward
show                 counts, planarity, edges, groups
steps                what made the model
draw X.png           a picture; any other output (.obj, .dlfl, .stl, .vdb) as well
help, quit
Steps may be several on a line (;) and loops may run over lines:";

/// Reads steps and commands until stdin ends or the command `quit`; those with open braces go on in the next line. A
/// step that fails changes nothing. `draw` writes a mesh and returns the bytes of the file; `intersections` describes
/// where a mesh meets itself, if it does.
pub(super) fn run_session(
    interpreter: &mut Interpreter,
    session: &Session,
    draw: &dyn Fn(&PolyMesh, &Path) -> Result<u64, Failure>,
    intersections: &dyn Fn(&PolyMesh) -> Option<String>,
) -> Result<(), Failure> {
    let prompt = std::io::stdin().is_terminal();
    let mut pending = String::new();
    let mut lines = std::io::stdin().lock().lines();
    loop {
        if prompt {
            let sign = if pending.is_empty() { "> " } else { "| " };
            let _ = write!(std::io::stderr(), "{sign}");
        }
        match lines.next() {
            Some(line) => {
                let line = line.map_err(|e| crate::io::ReadError::io("-", e))?;
                pending.push_str(&line);
                pending.push('\n');
                let open = |c| pending.matches(c).count();
                if open('{') > open('}') {
                    continue;
                }
            }
            None if pending.is_empty() => return Ok(()),
            // A block that the input leaves open is run, which names the missing brace.
            None => {}
        }
        let text = std::mem::take(&mut pending);
        match reply(text.trim(), interpreter, draw, intersections) {
            None => return Ok(()),
            // With --json stdout is one object, which the caller writes: errors go to stderr.
            Some(answer) if session.json() || answer.is_empty() => {
                if let Some(at) = answer.find("error: ") {
                    session.error(&answer[at..]);
                }
            }
            Some(answer) => {
                if writeln!(std::io::stdout(), "{}", terminal::lines(&answer)).is_err() {
                    return Ok(());
                }
            }
        }
    }
}

/// The reply to a line; `None` ends the session. `undo x` and `redo x` without a number x run as steps, which fail.
fn reply(
    text: &str,
    interpreter: &mut Interpreter,
    draw: &dyn Fn(&PolyMesh, &Path) -> Result<u64, Failure>,
    intersections: &dyn Fn(&PolyMesh) -> Option<String>,
) -> Option<String> {
    let mut words = text.split_whitespace();
    let first = words.next().unwrap_or_default();
    let second = words.next();
    let times = || second.map_or(Some(1), |w| w.parse::<usize>().ok());
    Some(match (first, times()) {
        ("", _) => String::new(),
        ("quit" | "exit", _) => return None,
        ("help", _) => {
            let verbs = VERBS
                .iter()
                .map(|(name, what)| format!("\n{name:<12} {what}"));
            format!("{HELP}{}", verbs.collect::<String>())
        }
        ("undo" | "redo", Some(times)) => {
            let mut lines = Vec::new();
            for _ in 0..times {
                let history = interpreter.history();
                let step = if first == "undo" {
                    history.undo()
                } else {
                    history.redo()
                };
                let Some(step) = step else {
                    lines.push(format!("nothing to {first}"));
                    break;
                };
                lines.push(format!("{first}: {step}"));
            }
            lines.push(state(interpreter));
            lines.join("\n")
        }
        ("show", _) => state(interpreter),
        ("steps", _) => interpreter.steps().join("\n"),
        ("draw", _) => match (second, interpreter.mesh()) {
            (Some(_), Some(mesh)) => {
                // The rest of the line up to a comment; it may have blanks.
                let rest = &text["draw".len()..];
                let path = rest.split(" #").next().unwrap_or(rest).trim();
                match draw(mesh, Path::new(path)) {
                    Ok(bytes) => format!("{path}  {}", crate::cli::numbers::size(bytes)),
                    Err(e) => format!("error: {}", e.one_line()),
                }
            }
            (None, _) => "error: draw needs a file, as in draw x.png".into(),
            (_, None) => "error: there is no mesh yet".into(),
        },
        _ => {
            let done = Script::parse(text).and_then(|script| script.run(interpreter, None));
            let mut lines: Vec<String> = interpreter
                .take_notes()
                .iter()
                .map(|n| format!("note: {}", n.text))
                .collect();
            match done {
                Ok(()) => {
                    lines.push(state(interpreter));
                    lines.extend(interpreter.mesh().and_then(intersections));
                }
                Err(e) => lines.push(format!("error: {e}")),
            }
            lines.join("\n")
        }
    })
}

fn state(interpreter: &Interpreter) -> String {
    interpreter
        .mesh()
        .map_or_else(|| "no mesh yet".into(), |m| m.summary().to_string())
}
