//! From the text of a formula to its program: precedence climbing over one character at a time.

use super::noise::noise;
use super::{DEEPEST, FormulaError, LONGEST, STACK, Step};

/// Functions by name.
#[derive(Clone, Copy)]
enum Function {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
    Three(fn(f64, f64, f64) -> f64),
    /// Two or more arguments, from the left.
    Many(fn(f64, f64) -> f64),
}

const FUNCTIONS: [(&str, Function); 30] = [
    ("sin", Function::One(libm::sin)),
    ("cos", Function::One(libm::cos)),
    ("tan", Function::One(libm::tan)),
    ("asin", Function::One(libm::asin)),
    ("acos", Function::One(libm::acos)),
    ("atan", Function::One(libm::atan)),
    ("sinh", Function::One(libm::sinh)),
    ("cosh", Function::One(libm::cosh)),
    ("tanh", Function::One(libm::tanh)),
    ("exp", Function::One(libm::exp)),
    ("ln", Function::One(libm::log)),
    ("sqrt", Function::One(f64::sqrt)),
    ("cbrt", Function::One(libm::cbrt)),
    ("abs", Function::One(f64::abs)),
    (
        "sign",
        Function::One(|x| if x == 0.0 { 0.0 } else { x.signum() }),
    ),
    ("floor", Function::One(f64::floor)),
    ("ceil", Function::One(f64::ceil)),
    ("round", Function::One(f64::round)),
    ("pow", Function::Two(libm::pow)),
    ("atan2", Function::Two(libm::atan2)),
    ("mod", Function::Two(|x, m| x - m * (x / m).floor())),
    (
        "step",
        Function::Two(|edge, x| f64::from(u8::from(x >= edge))),
    ),
    ("smoothstep", Function::Three(smoothstep)),
    (
        "ramp",
        Function::Three(|from, to, x| ((x - from) / (to - from)).clamp(0.0, 1.0)),
    ),
    ("noise", Function::Three(noise)),
    ("mix", Function::Three(|a, b, t| a + (b - a) * t)),
    ("clamp", Function::Three(|x, lo, hi| x.max(lo).min(hi))),
    ("min", Function::Many(f64::min)),
    ("max", Function::Many(f64::max)),
    ("hypot", Function::Many(f64::hypot)),
];

const CONSTANTS: [(&str, f64); 3] = [
    ("pi", std::f64::consts::PI),
    ("tau", std::f64::consts::TAU),
    ("e", std::f64::consts::E),
];

fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

struct Parser<'a> {
    text: &'a [char],
    at: usize,
    variables: &'a [&'a str],
    steps: Vec<Step>,
    /// Values on the stack after the steps so far.
    height: usize,
    depth: usize,
}

pub(super) fn steps(text: &str, variables: &[&str]) -> Result<Vec<Step>, FormulaError> {
    if text.len() > LONGEST {
        return Err(FormulaError {
            column: 1,
            found: format!("{} bytes", text.len()),
            expected: format!("at most {LONGEST}"),
        });
    }
    let characters: Vec<char> = text.chars().collect();
    let mut parser = Parser {
        text: &characters,
        at: 0,
        variables,
        steps: Vec::new(),
        height: 0,
        depth: 0,
    };
    parser.sum()?;
    parser.blank();
    if parser.at < parser.text.len() {
        return Err(parser.bad("an operator (+ - * / ^) or the end"));
    }
    Ok(parser.steps)
}

impl Parser<'_> {
    fn blank(&mut self) {
        while self.text.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
    }

    /// The next character that is not blank.
    fn peek(&mut self) -> Option<char> {
        self.blank();
        self.text.get(self.at).copied()
    }

    fn take(&mut self, c: char) -> bool {
        let found = self.peek() == Some(c);
        self.at += usize::from(found);
        found
    }

    fn bad(&self, expected: impl Into<String>) -> FormulaError {
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

    fn push(&mut self, step: Step) -> Result<(), FormulaError> {
        self.height = match step {
            Step::Number(_) | Step::Variable(_) => self.height + 1,
            Step::Negate | Step::Unary(_) => self.height,
            Step::Binary(_) => self.height - 1,
            Step::Ternary(_) => self.height - 2,
        };
        if self.height > STACK {
            return Err(self.bad(format!("at most {STACK} values at once")));
        }
        self.steps.push(step);
        Ok(())
    }

    fn deeper(&mut self) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.bad(format!("nesting of at most {DEEPEST} levels")));
        }
        Ok(())
    }

    fn sum(&mut self) -> Result<(), FormulaError> {
        self.deeper()?;
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

    fn signed(&mut self) -> Result<(), FormulaError> {
        self.deeper()?;
        if self.take('-') || self.take('\u{2212}') {
            self.signed()?;
            self.push(Step::Negate)?;
        } else if self.take('+') {
            self.signed()?;
        } else {
            self.power()?;
        }
        self.depth -= 1;
        Ok(())
    }

    fn power(&mut self) -> Result<(), FormulaError> {
        self.atom()?;
        self.blank();
        let double = self.text[self.at..].starts_with(&['*', '*']);
        if double || self.peek() == Some('^') {
            self.at += 1 + usize::from(double);
            // x^2 is by far the most frequent.
            self.signed()?;
            self.push(Step::Binary(
                |a, b| if b == 2.0 { a * a } else { libm::pow(a, b) },
            ))?;
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), FormulaError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                self.sum()?;
                self.close()
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            _ => Err(self.bad("a number, a name or \"(\"")),
        }
    }

    fn close(&mut self) -> Result<(), FormulaError> {
        if self.take(')') {
            return Ok(());
        }
        Err(self.bad("an operator, \",\" or \")\""))
    }

    fn number(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        let digit = |p: &Self| p.text.get(p.at).is_some_and(char::is_ascii_digit);
        while digit(self) || self.text.get(self.at) == Some(&'.') {
            self.at += 1;
        }
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
            return Err(self.bad("a number such as 0.25 or 1e-3"));
        };
        self.push(Step::Number(value))
    }

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
                return Err(self.bad(format!("a function: {}", known.join(", "))));
            };
            return self.call(&word, *function, start);
        }
        if let Some(n) = self.variables.iter().position(|v| *v == word) {
            return self.push(Step::Variable(n as u16));
        }
        if let Some((_, value)) = CONSTANTS.iter().find(|c| c.0 == word) {
            return self.push(Step::Number(*value));
        }
        self.at = start;
        let constants = CONSTANTS.map(|c| c.0).join(", ");
        Err(self.bad(format!(
            "one of the variables {}, or the constants {constants}",
            self.variables.join(", ")
        )))
    }

    fn call(&mut self, name: &str, function: Function, start: usize) -> Result<(), FormulaError> {
        self.at += 1;
        let mut count = 0;
        loop {
            self.sum()?;
            count += 1;
            if let (Function::Many(f), 2..) = (function, count) {
                self.push(Step::Binary(f))?;
            }
            if !self.take(',') {
                break;
            }
        }
        self.close()?;
        let wanted = match function {
            Function::One(_) => "1 argument",
            Function::Two(_) => "2 arguments",
            Function::Three(_) => "3 arguments",
            Function::Many(_) => "2 or more arguments",
        };
        match (function, count) {
            (Function::One(f), 1) => self.push(Step::Unary(f)),
            (Function::Two(f), 2) => self.push(Step::Binary(f)),
            (Function::Three(f), 3) => self.push(Step::Ternary(f)),
            (Function::Many(_), 2..) => Ok(()),
            _ => {
                self.at = start;
                Err(self.bad(format!("{name} with {wanted}, not {count}")))
            }
        }
    }
}
