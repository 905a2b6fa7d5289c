//! Measurements that need a process of their own.

use super::w1::W1;
use std::path::Path;
use std::process::Command;

/// Seconds of W1 in a fresh process, pass by pass.
#[derive(Clone, Copy)]
pub struct Passes {
    pub first: f64,
    /// Median of the later ones.
    pub later: f64,
}

const LATER: usize = 7;

/// Runs W1 in a child: this program or another build of it.
pub fn w1(program: &Path, full: bool) -> Result<Passes, Box<dyn std::error::Error>> {
    let mut command = Command::new(program);
    command.args(["--child", if full { "full" } else { "quick" }]);
    let output = command.output()?;
    let text = String::from_utf8(output.stdout)?;
    let mut numbers = text.split_whitespace().map(str::parse::<f64>);
    match (numbers.next(), numbers.next()) {
        (Some(Ok(first)), Some(Ok(later))) => Ok(Passes { first, later }),
        _ => Err(format!(
            "{}: found {text:?}; expected two numbers",
            program.display()
        )
        .into()),
    }
}

/// The child's part.
pub fn run(mut arguments: impl Iterator<Item = String>) -> Result<(), Box<dyn std::error::Error>> {
    let full = arguments.next().as_deref() == Some("full");
    let w1 = W1::new(full)?;
    let pass = || super::clock::in_turn(1, &mut [&mut || w1.read()])[0][0];
    let first = pass();
    let later: Vec<f64> = (0..LATER).map(|_| pass()).collect();
    println!("{first} {}", super::clock::Spread::of(&later).median);
    Ok(())
}
