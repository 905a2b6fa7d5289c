//! Numeric and logical expressions of scripts and selections.
//!
//! `or`, `and`, `not` (also `||`, `&&`, `!`, `|`, `&`), comparisons, `+ - * /`, `^`, brackets, functions, from the
//! loosest to the tightest; `^` groups to the right and `not` covers a comparison. Angles are in degrees, as everywhere
//! in scripts: `acos(1/3)` is 70.53. Both sides of `or` and `and` have to be conditions. Dividing by 0 is no error
//! here: the result is infinite or not a number. Arguments, counts, parameters and overrides refuse it; conditions do
//! not.

/// The value of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Truth(bool),
}

/// The error of an expression, and its byte position in the text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ExpressionError {
    pub at: usize,
    pub message: String,
}

type Parsed<T> = Result<T, ExpressionError>;

/// A parsed expression.
#[derive(Clone, Debug)]
pub(super) struct Expression(Node);

/// A parsed expression; each `usize` is a byte position in the text, for messages.
#[derive(Clone, Debug)]
enum Node {
    Number(f64),
    /// A name, with the arguments of its brackets if it has any.
    Name(usize, String, Option<Vec<Node>>),
    Not(usize, Box<Node>),
    Minus(usize, Box<Node>),
    Binary(usize, &'static str, Box<Node>, Box<Node>),
}

/// Maximum nesting depth; it bounds the recursion.
const MAX_DEPTH: usize = 100;

/// Gives the value of a name of the caller and its arguments; `None` as arguments means no brackets, `None` as result
/// that the caller has no such name.
pub(super) type Names<'a> = &'a dyn Fn(&str, Option<&[f64]>) -> Option<Value>;

impl Expression {
    /// Parses the whole text; the error names the first position that does not continue an expression.
    pub fn parse(text: &str) -> Parsed<Self> {
        let mut parser = Parser {
            text,
            at: 0,
            depth: 0,
        };
        let node = parser.level(0)?;
        parser.blank();
        if parser.at < text.len() {
            let rest: String = text[parser.at..].chars().take(20).collect();
            return Err(parser.fault(format!("found {rest:?}; expected an operator or the end")));
        }
        Ok(Self(node))
    }

    /// Its value, with names resolved by `names`.
    pub fn value(&self, names: Names) -> Parsed<Value> {
        self.0.value(names)
    }

    /// Its value as a number; an error at the start of the text where it is not finite.
    pub fn finite(&self, names: Names) -> Parsed<f64> {
        let value = self.0.number(names)?;
        if value.is_finite() {
            return Ok(value);
        }
        Err(ExpressionError {
            at: 0,
            message: format!("the value is {value}; expected a finite number"),
        })
    }

    /// Its logical value; an error where it is a number. The position is then the start of the text.
    pub fn truth(&self, names: Names) -> Parsed<bool> {
        match self.value(names)? {
            Value::Truth(t) => Ok(t),
            Value::Number(n) => Err(ExpressionError {
                at: 0,
                message: format!("found the number {n}; expected a condition such as sides == 5"),
            }),
        }
    }
}

/// Binary operators by precedence, lowest first.
const LEVELS: [&[&str]; 5] = [
    &["or", "||", "|"],
    &["and", "&&", "&"],
    &["==", "!=", "<=", ">=", "<", ">"],
    &["+", "-"],
    &["*", "/"],
];

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
    /// An error at the present position.
    fn fault(&self, message: impl Into<String>) -> ExpressionError {
        ExpressionError {
            at: self.at,
            message: message.into(),
        }
    }

    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    /// Skips white space.
    fn blank(&mut self) {
        self.at += self.rest().len() - self.rest().trim_start().len();
    }

    /// Consumes an operator or word if it comes next, after white space. A word is not taken from the front of a longer
    /// name.
    fn take(&mut self, sign: &str) -> bool {
        self.blank();
        let word = sign.chars().all(char::is_alphabetic);
        let Some(rest) = self.rest().strip_prefix(sign) else {
            return false;
        };
        if word && rest.starts_with(|c: char| c.is_alphanumeric() || c == '_') {
            return false;
        }
        self.at += sign.len();
        true
    }

    /// Reads the operators of one level of precedence, counting the nesting depth. Each pair of brackets passes all
    /// levels, one for `power` and one more, hence the factor of the limit.
    fn level(&mut self, level: usize) -> Parsed<Node> {
        self.depth += 1;
        if self.depth > MAX_DEPTH * (LEVELS.len() + 2) {
            return Err(self.fault(format!("nested more than {MAX_DEPTH} deep")));
        }
        let node = self.operators(level);
        self.depth -= 1;
        node
    }

    /// Reads a chain of operators of one level of precedence; higher levels bind more tightly.
    fn operators(&mut self, level: usize) -> Parsed<Node> {
        let Some(signs) = LEVELS.get(level) else {
            return self.power();
        };
        // `not` stands before a comparison, the third row of the table: not a == b is not (a == b).
        if level == 2 && (self.take("not") || (!self.rest().starts_with("!=") && self.take("!"))) {
            let at = self.at;
            return Ok(Node::Not(at, Box::new(self.level(2)?)));
        }
        let mut left = self.level(level + 1)?;
        loop {
            self.blank();
            let at = self.at;
            let Some(sign) = signs.iter().find(|s| self.take(s)) else {
                return Ok(left);
            };
            let right = self.level(level + 1)?;
            left = Node::Binary(at, sign, Box::new(left), Box::new(right));
        }
    }

    /// Reads a negation, or an atom with an optional power. -a^b is -(a^b), and a^-b is allowed.
    fn power(&mut self) -> Parsed<Node> {
        self.blank();
        let at = self.at;
        if self.take("-") {
            return Ok(Node::Minus(at, Box::new(self.level(LEVELS.len())?)));
        }
        let base = self.atom()?;
        self.blank();
        let at = self.at;
        if self.take("^") {
            let exponent = self.level(LEVELS.len())?;
            return Ok(Node::Binary(at, "^", Box::new(base), Box::new(exponent)));
        }
        Ok(base)
    }

    /// Reads a number, a bracket, a name, or a function with its arguments.
    fn atom(&mut self) -> Parsed<Node> {
        self.blank();
        let rest = self.rest();
        let at = self.at;
        if self.take("(") {
            let inner = self.level(0)?;
            return if self.take(")") {
                Ok(inner)
            } else {
                Err(self.fault("expected \")\""))
            };
        }
        let digits = |c: char| c.is_ascii_digit() || c == '.';
        if rest.starts_with(digits) {
            let mut end = rest.find(|c| !digits(c)).unwrap_or(rest.len());
            let tail = &rest[end..];
            // An "e" belongs to the number only if digits follow it; otherwise a name begins there.
            if let Some(power) = tail.strip_prefix(['e', 'E']) {
                let sign = usize::from(power.starts_with(['+', '-']));
                let digits = power[sign..].bytes().take_while(u8::is_ascii_digit).count();
                if digits > 0 {
                    end += 1 + sign + digits;
                }
            }
            let number: Option<f64> = rest[..end].parse().ok();
            let node = number.map(Node::Number);
            let node =
                node.ok_or_else(|| self.fault(format!("{:?} is not a number", &rest[..end])))?;
            self.at += end;
            return Ok(node);
        }
        let part = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
        let end = rest.find(|c| !part(c)).unwrap_or(rest.len());
        if end == 0 {
            let found = rest.chars().next();
            let found = found.map_or("the end".to_owned(), |c| format!("{c:?}"));
            return Err(self.fault(format!("found {found}; expected a number, a name or \"(\"")));
        }
        let name = rest[..end].to_owned();
        self.at += end;
        if !self.take("(") {
            return Ok(Node::Name(at, name, None));
        }
        let mut arguments = Vec::new();
        // Arguments are whole expressions between commas; there may be none.
        if !self.take(")") {
            loop {
                arguments.push(self.level(0)?);
                if self.take(")") {
                    break;
                }
                if !self.take(",") {
                    return Err(self.fault(format!("in {name}(...): expected \",\" or \")\"")));
                }
            }
        }
        Ok(Node::Name(at, name, Some(arguments)))
    }
}

// Each of these gives the value of a node, or the error at its position.
impl Node {
    fn number(&self, names: Names) -> Parsed<f64> {
        match self.value(names)? {
            Value::Number(n) => Ok(n),
            Value::Truth(t) => Err(self.fault(format!("found {t}; expected a number"))),
        }
    }

    fn truth(&self, names: Names) -> Parsed<bool> {
        match self.value(names)? {
            Value::Truth(t) => Ok(t),
            Value::Number(n) => Err(self.fault(format!("found {n}; expected a condition"))),
        }
    }

    /// An error at this node; plain numbers keep no position.
    fn fault(&self, message: String) -> ExpressionError {
        let at = match self {
            Self::Number(_) => 0,
            Self::Name(at, ..) | Self::Not(at, _) | Self::Minus(at, _) | Self::Binary(at, ..) => {
                *at
            }
        };
        ExpressionError { at, message }
    }

    /// The value, where `names` gives those of the caller's names and functions.
    fn value(&self, names: Names) -> Parsed<Value> {
        Ok(match self {
            Self::Number(n) => Value::Number(*n),
            Self::Not(_, inner) => Value::Truth(!inner.truth(names)?),
            Self::Minus(_, inner) => Value::Number(-inner.number(names)?),
            Self::Binary(_, sign, a, b) => match *sign {
                "or" | "||" | "|" => Value::Truth(a.truth(names)? || b.truth(names)?),
                "and" | "&&" | "&" => Value::Truth(a.truth(names)? && b.truth(names)?),
                sign => both(sign, a.number(names)?, b.number(names)?),
            },
            Self::Name(_, name, arguments) => {
                let numbers: Option<Vec<f64>> = match arguments {
                    Some(list) => Some(
                        list.iter()
                            .map(|a| a.number(names))
                            .collect::<Parsed<_>>()?,
                    ),
                    None => None,
                };
                // The names of the caller come first, so that a parameter may have the name of a function.
                let own = names(name, numbers.as_deref());
                let value = own.or_else(|| built_in(name, numbers.as_deref()));
                value.ok_or_else(|| {
                    let with = numbers.map_or(String::new(), |n| {
                        let plural = if n.len() == 1 { "" } else { "s" };
                        format!(" with {} argument{plural}", n.len())
                    });
                    self.fault(format!("nothing is named {name:?}{with}"))
                })?
            }
        })
    }
}

/// A comparison or an arithmetic operator on two numbers; `^` is the last case.
fn both(sign: &str, a: f64, b: f64) -> Value {
    match sign {
        "==" => Value::Truth(a == b),
        "!=" => Value::Truth(a != b),
        "<=" => Value::Truth(a <= b),
        ">=" => Value::Truth(a >= b),
        "<" => Value::Truth(a < b),
        ">" => Value::Truth(a > b),
        "+" => Value::Number(a + b),
        "-" => Value::Number(a - b),
        "*" => Value::Number(a * b),
        "/" => Value::Number(a / b),
        _ => Value::Number(a.powf(b)),
    }
}

/// A constant or function that every expression knows; angles are in degrees. `None` for other names and for other
/// numbers of arguments. `log` is natural, `mod` is never negative for positive divisors, `atan` takes (y, x) too.
fn built_in(name: &str, arguments: Option<&[f64]>) -> Option<Value> {
    let number = match (name, arguments) {
        ("pi", None) => std::f64::consts::PI,
        ("true", None) => return Some(Value::Truth(true)),
        ("false", None) => return Some(Value::Truth(false)),
        ("abs", Some([x])) => x.abs(),
        ("sqrt", Some([x])) => x.sqrt(),
        ("floor", Some([x])) => x.floor(),
        ("ceil", Some([x])) => x.ceil(),
        ("round", Some([x])) => x.round(),
        ("exp", Some([x])) => x.exp(),
        ("log", Some([x])) => x.ln(),
        ("sin", Some([x])) => x.to_radians().sin(),
        ("cos", Some([x])) => x.to_radians().cos(),
        ("tan", Some([x])) => x.to_radians().tan(),
        ("asin", Some([x])) => x.asin().to_degrees(),
        ("acos", Some([x])) => x.acos().to_degrees(),
        ("atan", Some([x])) => x.atan().to_degrees(),
        ("atan", Some([y, x])) => y.atan2(*x).to_degrees(),
        ("mod", Some([x, y])) => x.rem_euclid(*y),
        ("min", Some(list)) if !list.is_empty() => {
            list.iter().copied().fold(f64::INFINITY, f64::min)
        }
        ("max", Some(list)) if !list.is_empty() => {
            list.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        }
        _ => return None,
    };
    Some(Value::Number(number))
}
