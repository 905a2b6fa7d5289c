//! Parser of formulas: recursive descent over single characters, into steps in reverse Polish notation.
//!
//! One function reads each level of precedence: `sum`, `product`, `signed`, `power`, `atom`. Each leaves exactly one
//! value more on the stack. An error names the column of the first character that does not fit, or of the name at
//! fault, and what would fit there; the steps read so far are dropped.

use super::noise::noise;
use super::{FormulaError, MAX_DEPTH, MAX_LENGTH, STACK_SIZE, Step};

/// A function by number of arguments.
#[derive(Clone, Copy)]
enum Function {
    Unary(fn(f64) -> f64),
    Binary(fn(f64, f64) -> f64),
    Ternary(fn(f64, f64, f64) -> f64),
    /// Two or more arguments, folded from the left.
    Fold(fn(f64, f64) -> f64),
}

/// The functions by name; those of `libm` give the same bits on every platform.
const FUNCTIONS: [(&str, Function); 30] = [
    ("sin", Function::Unary(libm::sin)),
    ("cos", Function::Unary(libm::cos)),
    ("tan", Function::Unary(libm::tan)),
    ("asin", Function::Unary(libm::asin)),
    ("acos", Function::Unary(libm::acos)),
    ("atan", Function::Unary(libm::atan)),
    ("sinh", Function::Unary(libm::sinh)),
    ("cosh", Function::Unary(libm::cosh)),
    ("tanh", Function::Unary(libm::tanh)),
    ("exp", Function::Unary(libm::exp)),
    ("ln", Function::Unary(libm::log)),
    ("sqrt", Function::Unary(f64::sqrt)),
    ("cbrt", Function::Unary(libm::cbrt)),
    ("abs", Function::Unary(f64::abs)),
    (
        "sign",
        Function::Unary(|x| if x == 0.0 { 0.0 } else { x.signum() }),
    ),
    ("floor", Function::Unary(f64::floor)),
    ("ceil", Function::Unary(f64::ceil)),
    ("round", Function::Unary(f64::round)),
    ("pow", Function::Binary(libm::pow)),
    ("atan2", Function::Binary(libm::atan2)),
    ("mod", Function::Binary(|x, m| x - m * (x / m).floor())),
    (
        "step",
        Function::Binary(|edge, x| f64::from(u8::from(x >= edge))),
    ),
    ("smoothstep", Function::Ternary(smoothstep)),
    (
        "ramp",
        Function::Ternary(|from, to, x| ((x - from) / (to - from)).clamp(0.0, 1.0)),
    ),
    ("noise", Function::Ternary(noise)),
    ("mix", Function::Ternary(|a, b, t| a + (b - a) * t)),
    ("clamp", Function::Ternary(|x, lo, hi| x.max(lo).min(hi))),
    ("min", Function::Fold(f64::min)),
    ("max", Function::Fold(f64::max)),
    ("hypot", Function::Fold(libm::hypot)),
];

const CONSTANTS: [(&str, f64); 3] = [
    ("pi", std::f64::consts::PI),
    ("tau", std::f64::consts::TAU),
    ("e", std::f64::consts::E),
];

/// 0 below `from`, 1 above `to`, and 3 t^2 - 2 t^3 between them.
fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

struct Parser<'a> {
    text: &'a [char],
    at: usize,
    variables: &'a [&'a str],
    constants: &'a [(&'a str, f64)],
    steps: Vec<Step>,
    /// Height of the stack after the steps so far.
    height: usize,
    depth: usize,
}

/// The steps of a formula in reverse Polish notation. `constants` are named numbers beside pi, tau and e.
pub(super) fn steps(
    text: &str,
    variables: &[&str],
    constants: &[(&str, f64)],
) -> Result<Vec<Step>, FormulaError> {
    if text.len() > MAX_LENGTH {
        return Err(FormulaError {
            column: 1,
            found: format!("{} bytes", text.len()),
            expected: format!("at most {MAX_LENGTH}"),
        });
    }
    let characters: Vec<char> = text.chars().collect();
    let mut parser = Parser {
        text: &characters,
        at: 0,
        variables,
        constants,
        steps: Vec::new(),
        height: 0,
        depth: 0,
    };
    parser.sum()?;
    parser.skip_white_space();
    if parser.at < parser.text.len() {
        return Err(parser.error("an operator (+ - * / ^) or the end"));
    }
    Ok(parser.steps)
}

impl Parser<'_> {
    fn skip_white_space(&mut self) {
        while self.text.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
    }

    /// The next character that is not white space.
    fn peek(&mut self) -> Option<char> {
        self.skip_white_space();
        self.text.get(self.at).copied()
    }

    /// Skips the character if it comes next, after white space; returns whether it did.
    fn accept(&mut self, c: char) -> bool {
        let found = self.peek() == Some(c);
        self.at += usize::from(found);
        found
    }

    /// The error at the current position: the text found there, and what was expected.
    fn error(&self, expected: impl Into<String>) -> FormulaError {
        let rest = &self.text[self.at.min(self.text.len())..];
        let found = match rest.first() {
            None => "the end".to_owned(),
            Some(_) => format!("{:?}", rest.iter().take(12).collect::<String>()),
        };
        FormulaError {
            column: self.at + 1,
            found,
            expected: expected.into(),
        }
    }

    /// Adds a step and counts the height of the stack after it; an error where the stack would exceed its size.
    fn push(&mut self, step: Step) -> Result<(), FormulaError> {
        self.height = match step {
            Step::Number(_) | Step::Variable(_) => self.height + 1,
            Step::Negate | Step::Unary(_) => self.height,
            Step::Binary(_) => self.height - 1,
            Step::Ternary(_) => self.height - 2,
        };
        if self.height > STACK_SIZE {
            return Err(self.error(format!("at most {STACK_SIZE} values at once")));
        }
        self.steps.push(step);
        Ok(())
    }

    /// Counts one more level of nesting; an error beyond the limit, which protects the stack of the thread.
    fn enter(&mut self) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(self.error(format!("nesting of at most {MAX_DEPTH} levels")));
        }
        Ok(())
    }

    /// Reads products joined by + and -, from the left.
    fn sum(&mut self) -> Result<(), FormulaError> {
        self.enter()?;
        self.product()?;
        loop {
            let step: fn(f64, f64) -> f64 = match self.peek() {
                Some('+') => |a, b| a + b,
                Some('-' | '\u{2212}') => |a, b| a - b,
                _ => break,
            };
            self.at += 1;
            self.product()?;
            self.push(Step::Binary(step))?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Reads signed factors joined by * and /, from the left.
    fn product(&mut self) -> Result<(), FormulaError> {
        self.signed()?;
        loop {
            let step: fn(f64, f64) -> f64 = match self.peek() {
                Some('*') => |a, b| a * b,
                Some('/') => |a, b| a / b,
                _ => return Ok(()),
            };
            self.at += 1;
            self.signed()?;
            self.push(Step::Binary(step))?;
        }
    }

    /// Reads signs, then a power. A sign binds weaker than a power: `-x^2` is -(x^2). The long minus sign of word
    /// processors counts as well.
    fn signed(&mut self) -> Result<(), FormulaError> {
        self.enter()?;
        if self.accept('-') || self.accept('\u{2212}') {
            self.signed()?;
            self.push(Step::Negate)?;
        } else if self.accept('+') {
            self.signed()?;
        } else {
            self.power()?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Reads an atom with an optional exponent after `^` or `**`. The exponent is read as `signed`, so that powers
    /// group from the right and `x^-2` needs no parentheses.
    fn power(&mut self) -> Result<(), FormulaError> {
        self.atom()?;
        self.skip_white_space();
        let double = self.text[self.at..].starts_with(&['*', '*']);
        if double || self.peek() == Some('^') {
            self.at += 1 + usize::from(double);
            self.signed()?;
            // The square is by far the most frequent power.
            self.push(Step::Binary(
                |a, b| if b == 2.0 { a * a } else { libm::pow(a, b) },
            ))?;
        }
        Ok(())
    }

    /// Reads a formula in parentheses, a number, or a name.
    fn atom(&mut self) -> Result<(), FormulaError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                self.sum()?;
                self.close()
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            _ => Err(self.error("a number, a name or \"(\"")),
        }
    }

    /// Reads a closing parenthesis.
    fn close(&mut self) -> Result<(), FormulaError> {
        if self.accept(')') {
            return Ok(());
        }
        Err(self.error("an operator, \",\" or \")\""))
    }

    /// Reads digits, a point and an exponent.
    fn number(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        let digit = |p: &Self| p.text.get(p.at).is_some_and(char::is_ascii_digit);
        while digit(self) || self.text.get(self.at) == Some(&'.') {
            self.at += 1;
        }
        // An e without digits after it is no exponent.
        if matches!(self.text.get(self.at), Some('e' | 'E')) {
            let before = self.at;
            self.at += 1;
            if matches!(self.text.get(self.at), Some('+' | '-')) {
                self.at += 1;
            }
            if digit(self) {
                while digit(self) {
                    self.at += 1;
                }
            } else {
                self.at = before;
            }
        }
        let word: String = self.text[start..self.at].iter().collect();
        let Ok(value) = word.parse() else {
            self.at = start;
            return Err(self.error("a number such as 0.25 or 1e-3"));
        };
        self.push(Step::Number(value))
    }

    /// Reads a name: a function if a parenthesis follows, else a variable or a constant.
    fn name(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        while self
            .text
            .get(self.at)
            .is_some_and(|c| c.is_alphanumeric() || *c == '_')
        {
            self.at += 1;
        }
        let word: String = self.text[start..self.at].iter().collect();
        if self.peek() == Some('(') {
            let Some((_, function)) = FUNCTIONS.iter().find(|f| f.0 == word) else {
                self.at = start;
                let known: Vec<&str> = FUNCTIONS.iter().map(|f| f.0).collect();
                return Err(self.error(format!("a function: {}", known.join(", "))));
            };
            return self.call(&word, *function, start);
        }
        // A variable may have the name of a constant, and hides it.
        if let Some(n) = self.variables.iter().position(|v| *v == word) {
            return self.push(Step::Variable(n as u16));
        }
        let mut constants = CONSTANTS.iter().chain(self.constants);
        if let Some((_, value)) = constants.find(|c| c.0 == word) {
            return self.push(Step::Number(*value));
        }
        self.at = start;
        let constants = CONSTANTS.iter().chain(self.constants).map(|c| c.0);
        let constants = constants.collect::<Vec<_>>().join(", ");
        Err(self.error(format!(
            "one of the variables {}, or the constants {constants}",
            self.variables.join(", ")
        )))
    }

    /// Reads the arguments of a function whose name begins at `start`. The parenthesis comes next. `name` is for
    /// messages.
    fn call(&mut self, name: &str, function: Function, start: usize) -> Result<(), FormulaError> {
        self.at += 1;
        let mut count = 0;
        loop {
            self.sum()?;
            count += 1;
            // A fold of n arguments is n - 1 steps of two operands.
            if let (Function::Fold(f), 2..) = (function, count) {
                self.push(Step::Binary(f))?;
            }
            if !self.accept(',') {
                break;
            }
        }
        // The number of arguments is checked after all are read, so that the message can give both numbers.
        self.close()?;
        let expected = match function {
            Function::Unary(_) => "1 argument",
            Function::Binary(_) => "2 arguments",
            Function::Ternary(_) => "3 arguments",
            Function::Fold(_) => "2 or more arguments",
        };
        match (function, count) {
            (Function::Unary(f), 1) => self.push(Step::Unary(f)),
            (Function::Binary(f), 2) => self.push(Step::Binary(f)),
            (Function::Ternary(f), 3) => self.push(Step::Ternary(f)),
            (Function::Fold(_), 2..) => Ok(()),
            _ => {
                self.at = start;
                Err(self.error(format!("{name} with {expected}, not {count}")))
            }
        }
    }
}
