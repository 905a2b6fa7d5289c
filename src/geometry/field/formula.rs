//! Formulas: real functions of named variables in text form.
//!
//! Examples are `x^2 + y^2 + z^2 - 0.16` and `min(hypot(x, y), 0.2) - 0.1`. In order of precedence: `^` (also
//! `**`, right-associative), the minus sign, `*` `/`, `+` `-`. Functions take their arguments in parentheses.
//! The constants are `pi`, `tau`, `e`. All numbers are `f64`. Outside a function's domain the value is NaN or
//! infinite, and the caller must reject it. [`Formula`] lists the functions.

mod noise;
mod parse;

/// Maximal length of the text in bytes.
const MAX_LENGTH: usize = 4096;
/// Maximal nesting depth, since the parser recurses: the text and each pair of parentheses count twice, a sign or an
/// exponent once.
const MAX_DEPTH: usize = 128;
/// Maximal number of intermediate values: an evaluation keeps them in an array of this size.
const STACK_SIZE: usize = 96;

/// Why a text is not a formula.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("formula, column {column}: found {found}; expected {expected}")]
pub struct FormulaError {
    /// The position, in characters from 1.
    pub column: usize,
    /// The text at that position.
    pub found: String,
    /// The expected text.
    pub expected: String,
}

/// One instruction of the stack program.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Pushes a number.
    Number(f64),
    /// Pushes a variable.
    Variable(u16),
    /// Negates the top.
    Negate,
    /// Replaces the two top values by a function of them.
    Binary(fn(f64, f64) -> f64),
    /// Replaces the top value by a function of it.
    Unary(fn(f64) -> f64),
    /// Replaces the three top values by a function of them.
    Ternary(fn(f64, f64, f64) -> f64),
}

/// A parsed formula of named variables.
///
/// | functions | arguments |
/// |---|---|
/// | `sin cos tan asin acos atan sinh cosh tanh exp ln sqrt cbrt abs sign floor ceil round` | one, angles
/// in radians |
/// | `pow atan2 mod` | two: `atan2(y, x)`; `mod` has the sign of its second argument |
/// | `step smoothstep mix clamp` | `step(edge, x)`: 1 from `edge` on; `smoothstep(from, to, x)`; `mix(a, b, t)`:
/// a + (b - a) t; `clamp(x, least, greatest)` |
/// | `ramp` | `ramp(from, to, x)`: 0 at `from` and before, 1 at `to` and beyond, linear in between; may fall |
/// | `noise` | `noise(x, y, z)`: smooth, between -1.04 and 1.04, features of size one, deterministic |
/// | `min max hypot` | two or more |
///
/// The text is compiled once to a stack program; an evaluation takes some nanoseconds per operation.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::field::Formula;
/// let f = Formula::parse("min(x, min(2y, 1e-1)) - -z^2", &["x", "y", "z"]);
/// assert_eq!(f.unwrap_err().column, 13); // 2y: a factor needs its *
/// let f = Formula::parse("min(x, min(2*y, 1e-1)) - -z^2", &["x", "y", "z"]).unwrap();
/// assert_eq!(f.value(&[3.0, 4.0, 2.0]), 4.1);
/// ```
#[derive(Clone, Debug)]
pub struct Formula {
    text: String,
    steps: Vec<Step>,
    variables: usize,
}

impl Formula {
    /// Parses a text. `variables` are the names that it may use, in the order of the values in [`Formula::value`].
    ///
    /// # Errors
    /// [`FormulaError`]: a syntax error, an unknown name, a wrong number of arguments, more than 4096 bytes, more than
    /// 63 nested parentheses (fewer with signs or powers of powers), or more than 96 values on the stack.
    pub fn parse(text: &str, variables: &[&str]) -> Result<Self, FormulaError> {
        Self::with_constants(text, variables, &[])
    }

    /// As [`Formula::parse`], with more constants than `pi`, `tau` and `e`: names and values.
    ///
    /// # Errors
    /// As [`Formula::parse`].
    pub fn with_constants(
        text: &str,
        variables: &[&str],
        constants: &[(&str, f64)],
    ) -> Result<Self, FormulaError> {
        let steps = parse::steps(text, variables, constants)?;
        Ok(Self {
            text: text.to_owned(),
            steps,
            variables: variables.len(),
        })
    }

    /// The source text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The value of the formula.
    ///
    /// # Panics
    /// If there are fewer values than variables.
    pub fn value(&self, variables: &[f64]) -> f64 {
        assert!(variables.len() >= self.variables, "a value for every name");
        // Operands lie on a stack, the last on top. The parser has checked its height.
        let mut stack = [0.0; STACK_SIZE];
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
