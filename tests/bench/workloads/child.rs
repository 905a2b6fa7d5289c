//! Measurements that need a process of their own.

use super::clock::{Spread, in_turn};
use super::{w1, w2};
use druse::simd::{InstructionSet, use_instruction_set};
use std::path::Path;
use std::process::Command;

type Fault = Box<dyn std::error::Error>;

/// What a child does.
#[derive(Clone, Copy)]
pub struct Task {
    /// W1 or W2.
    pub workload: &'static str,
    /// At the sizes of the README's table.
    pub full: bool,
    /// What it may ask of the processor.
    pub code: InstructionSet,
}

/// Processor seconds of a workload in a fresh process, on one thread.
#[derive(Clone, Copy)]
pub struct Passes {
    pub first: f64,
    /// Median of the later ones.
    pub later: f64,
}

/// Passes after the first: of W1, and of W2, which takes longer.
const LATER: [usize; 2] = [7, 2];
const SIZES: [&str; 2] = ["quick", "full"];
const CODES: [(&str, InstructionSet); 3] = [
    ("portable", InstructionSet::Portable),
    ("avx2", InstructionSet::Avx2),
    ("best", InstructionSet::Best),
];

/// Runs a task in a child: this program or another build of it.
pub fn passes(program: &Path, task: Task) -> Result<Passes, Fault> {
    let words = [
        task.workload,
        SIZES[usize::from(task.full)],
        CODES[task.code as usize].0,
    ];
    let output = Command::new(program).arg("--child").args(words).output()?;
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

/// Ratios, round by round, of the later passes of a task and another, each of its own program.
pub fn ratios(rounds: usize, a: (&Path, Task), b: (&Path, Task)) -> Result<Spread, Fault> {
    let (mut own, mut other) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        own.push(passes(a.0, a.1)?.later);
        other.push(passes(b.0, b.1)?.later);
    }
    Ok(Spread::of_ratios(&own, &other))
}

/// The child's part.
pub fn run(arguments: impl Iterator<Item = String>) -> Result<(), Fault> {
    let words: Vec<String> = arguments.collect();
    let has = |word: &str| words.iter().any(|w| w == word);
    for (word, code) in CODES {
        if has(word) {
            use_instruction_set(code);
        }
    }
    let (full, is_w2) = (has(SIZES[1]), has("w2"));
    let mut work: Box<dyn FnMut()> = if is_w2 {
        w2::one_pass(full)?
    } else {
        let w1 = w1::W1::new(full)?;
        Box::new(move || w1.read())
    };
    let mut pass = || in_turn(1, &mut [&mut *work])[0][0];
    let first = pass();
    let later: Vec<f64> = (0..LATER[usize::from(is_w2)]).map(|_| pass()).collect();
    println!("{first} {}", Spread::of(&later).median);
    Ok(())
}
