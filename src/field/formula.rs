//! Formulas: real functions of named variables, as people write them.
//!
//! `x^2 + y^2 + z^2 - 0.16`, `min(hypot(x, y), 0.2) - 0.1`. In order of binding: `^` (also `**`, to the
//! right), the minus sign, `*` `/`, `+` `-`; functions with their arguments in parentheses; the
//! constants `pi`, `tau`, `e`. Everything is `f64`; outside a function's domain the value is NaN or
//! infinite, which is for the user of the formula to refuse.
//!
//! | functions | of |
//! |---|---|
//! | `sin cos tan asin acos atan sinh cosh tanh exp ln sqrt cbrt abs sign floor ceil round` | one argument, angles in radians |
//! | `pow atan2 mod` | two: `atan2(y, x)`; `mod` has the sign of its second argument |
//! | `step smoothstep mix clamp` | `step(edge, x)`, `smoothstep(from, to, x)`, `mix(a, b, t)`, `clamp(x, least, greatest)` |
//! | `ramp` | `ramp(from, to, x)`: 0 before, 1 behind, linear between |
//! | `noise` | `noise(x, y, z)`: smooth, between -1 and 1, features one unit apart, the same in every run |
//! | `min max hypot` | two or more |
//!
//! A text becomes a short program over a stack once; a point costs some nanoseconds per operation.
//!
//! ```
//! use druse::field::Formula;
//! let f = Formula::parse("min(x, min(2y, 1e-1)) - -z^2", &["x", "y", "z"]);
//! assert_eq!(f.unwrap_err().column, 13); // 2y: a factor needs its *
//! let f = Formula::parse("min(x, min(2*y, 1e-1)) - -z^2", &["x", "y", "z"]).unwrap();
//! assert_eq!(f.value(&[3.0, 4.0, 2.0]), 4.1);
//! ```

mod noise;
mod parse;

/// Longest text, in bytes.
const LONGEST: usize = 4096;
/// Deepest nesting; parentheses count twice, signs once.
const DEEPEST: usize = 128;
/// Most intermediate values at once.
const STACK: usize = 96;

/// Why a text is no formula.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("formula, column {column}: found {found}; expected {expected}")]
pub struct FormulaError {
    /// Where, in characters from 1.
    pub column: usize,
    /// What stands there.
    pub found: String,
    /// What should.
    pub expected: String,
}

/// One step of the program.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Puts a number on the stack.
    Number(f64),
    /// Puts a variable on the stack.
    Variable(u16),
    /// Replaces the top by its negative.
    Negate,
    /// Replaces the two on top by one.
    Binary(fn(f64, f64) -> f64),
    /// Replaces the top by its image.
    Unary(fn(f64) -> f64),
    /// Replaces the three on top by one.
    Ternary(fn(f64, f64, f64) -> f64),
}

/// A parsed formula of named variables.
#[derive(Clone, Debug)]
pub struct Formula {
    text: String,
    steps: Vec<Step>,
    variables: usize,
}

impl Formula {
    /// Parses a text; `variables` are the names it may use, in the order in which their values are
    /// given later.
    ///
    /// # Errors
    /// [`FormulaError`]: no formula, an unknown name, a wrong number of arguments, more than 4096
    /// bytes, or nested more than 64 parentheses deep.
    pub fn parse(text: &str, variables: &[&str]) -> Result<Self, FormulaError> {
        let steps = parse::steps(text, variables)?;
        Ok(Self {
            text: text.to_owned(),
            steps,
            variables: variables.len(),
        })
    }

    /// The text it was parsed from.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its value.
    ///
    /// # Panics
    /// When there are fewer values than it was parsed with names.
    pub fn value(&self, variables: &[f64]) -> f64 {
        assert!(variables.len() >= self.variables, "a value for every name");
        let mut stack = [0.0; STACK];
        let mut top = 0;
        for step in &self.steps {
            match *step {
                Step::Number(c) => {
                    stack[top] = c;
                    top += 1;
                }
                Step::Variable(v) => {
                    stack[top] = variables[v as usize];
                    top += 1;
                }
                Step::Negate => stack[top - 1] = -stack[top - 1],
                Step::Unary(f) => stack[top - 1] = f(stack[top - 1]),
                Step::Binary(f) => {
                    top -= 1;
                    stack[top - 1] = f(stack[top - 1], stack[top]);
                }
                Step::Ternary(f) => {
                    top -= 2;
                    stack[top - 1] = f(stack[top - 1], stack[top], stack[top + 1]);
                }
            }
        }
        stack[0]
    }
}
