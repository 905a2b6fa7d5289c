//! The arguments of a step: words in order, and `key=value`.
//!
//! A step takes its arguments from [`Arguments`] one by one, in any order of keys. What no step has taken is an error
//! at the end. Lines and columns count from 1, columns in characters.

use super::super::expression::{ExpressionError, Value};
use super::super::select::Scene;
use super::{Expression, Interpreter, ScriptError, nearest};
use druse_geometry::frame::Vec3;

/// A word of a script and its place.
#[derive(Clone, Debug)]
pub(super) struct Word {
    pub text: String,
    pub line: usize,
    pub column: usize,
}

/// A step as written in the script.
#[derive(Clone, Debug)]
pub(super) struct Statement {
    pub verb: String,
    pub words: Vec<Word>,
    pub text: String,
    pub line: usize,
    pub column: usize,
}

impl Statement {
    /// An error about word `n` of the arguments, from 1; 0 is the step itself.
    pub fn fault(&self, n: usize, message: impl Into<String>) -> ScriptError {
        let word = n.checked_sub(1).and_then(|n| self.words.get(n));
        let (line, column) = word.map_or((self.line, self.column), |w| (w.line, w.column));
        let message = message.into();
        ScriptError {
            line,
            column,
            message: format!("{}: {message}", self.verb),
            hint: None,
        }
    }
}

/// The value of an expression, which may name parameters; an error where it is not finite. `line` and `column` are
/// the place of the expression.
pub(super) fn number(
    expression: &Expression,
    interpreter: &Interpreter,
    line: usize,
    column: usize,
) -> Result<f64, ScriptError> {
    // A parameter is a name without arguments.
    let parameters = |name: &str, arguments: Option<&[f64]>| match arguments {
        None => interpreter.parameters.get(name).copied().map(Value::Number),
        Some(_) => None,
    };
    // The column of an error counts from the start of the expression.
    expression.finite(&parameters).map_err(|e| ScriptError {
        line,
        column: column + e.at,
        message: e.message,
        hint: None,
    })
}

/// The arguments of a statement, consumed one by one; an unused one is an error.
pub(super) struct Arguments<'s, 'w> {
    pub statement: &'s Statement,
    interpreter: &'s Interpreter<'w>,
    used: Vec<bool>,
    requested: Vec<&'static str>,
}

impl<'s, 'w> Arguments<'s, 'w> {
    /// The arguments of a statement, none of them used yet.
    pub fn new(statement: &'s Statement, interpreter: &'s Interpreter<'w>) -> Self {
        Self {
            statement,
            interpreter,
            used: vec![false; statement.words.len()],
            requested: Vec::new(),
        }
    }

    /// An error at the step itself, with this message.
    pub fn fault(&self, message: impl Into<String>) -> ScriptError {
        self.statement.fault(0, message)
    }

    /// The next word without a key; `None` if all are taken.
    pub fn positional(&mut self) -> Option<&'s Word> {
        let n = (0..self.used.len())
            .find(|&n| !self.used[n] && split(&self.statement.words[n].text).is_none())?;
        self.used[n] = true;
        Some(&self.statement.words[n])
    }

    /// The next word without a key; an error if there is none.
    pub fn required(&mut self, what: &str) -> Result<&'s Word, ScriptError> {
        self.positional()
            .ok_or_else(|| self.fault(format!("expected {what}")))
    }

    /// The value of a key, as a word; `None` if the key is missing. A key that is given twice is an error.
    pub fn value(&mut self, key: &'static str) -> Result<Option<Word>, ScriptError> {
        self.requested.push(key);
        let mut found = None;
        for (n, word) in self.statement.words.iter().enumerate() {
            let Some((name, value)) = split(&word.text).filter(|kv| kv.0 == key) else {
                continue;
            };
            if found.is_some() {
                return Err(self.statement.fault(n + 1, format!("{key} is given twice")));
            }
            self.used[n] = true;
            found = Some(Word {
                text: value.to_owned(),
                line: word.line,
                column: word.column + name.chars().count() + 1,
            });
        }
        Ok(found)
    }

    /// Planes [h,k,l] as keys, with their distances as values.
    pub fn planes(&mut self) -> Result<Vec<([i32; 3], f64)>, ScriptError> {
        let mut planes = Vec::new();
        for (n, word) in self.statement.words.iter().enumerate() {
            let Some((key, value)) = split(&word.text).filter(|kv| kv.0.starts_with('[')) else {
                continue;
            };
            self.used[n] = true;
            let key = Word {
                text: key.to_owned(),
                ..word.clone()
            };
            let column = word.column + key.text.chars().count() + 1;
            let value = self.evaluate(&Word {
                text: value.to_owned(),
                line: word.line,
                column,
            })?;
            planes.push((self.indices(&key)?, value));
        }
        Ok(planes)
    }

    /// Three whole numbers in square brackets, the indices of a plane, each at most 1000 in absolute value.
    pub fn indices(&self, word: &Word) -> Result<[i32; 3], ScriptError> {
        let list = self.list_of(word)?;
        let whole = |x: &f64| (x.fract() == 0.0 && x.abs() <= 1000.0).then_some(*x as i32);
        let indices: Option<Vec<i32>> = list.iter().map(whole).collect();
        indices
            .and_then(|i| <[i32; 3]>::try_from(i).ok())
            .ok_or_else(|| {
                let message = format!("{} is not a plane; expected [h,k,l]", word.text);
                self.at(word, message)
            })
    }

    fn at(&self, word: &Word, message: impl Into<String>) -> ScriptError {
        let message = message.into();
        ScriptError {
            line: word.line,
            column: word.column,
            message: format!("{}: {message}", self.statement.verb),
            hint: None,
        }
    }

    /// A word as a number: an expression, which may name parameters.
    pub fn evaluate(&self, word: &Word) -> Result<f64, ScriptError> {
        let fault = |e: ExpressionError| ScriptError {
            column: word.column + e.at,
            ..self.at(word, format!("in {:?}: {}", word.text, e.message))
        };
        let parsed = Expression::parse(&word.text).map_err(fault)?;
        number(&parsed, self.interpreter, word.line, word.column).map_err(|e| ScriptError {
            message: format!("{}: in {:?}: {}", self.statement.verb, word.text, e.message),
            ..e
        })
    }

    /// The number of a key, if it is given.
    pub fn number(&mut self, key: &'static str) -> Result<Option<f64>, ScriptError> {
        match self.value(key)? {
            Some(word) => self.evaluate(&word).map(Some),
            None => Ok(None),
        }
    }

    /// The whole number of a key, from 0 to 1e9; `None` if the key is missing.
    pub fn count(&mut self, key: &'static str) -> Result<Option<usize>, ScriptError> {
        let Some(word) = self.value(key)? else {
            return Ok(None);
        };
        let value = self.evaluate(&word)?;
        self.whole(&word, value).map(Some)
    }

    /// The value of a word as a whole number from 0 to 1e9.
    pub fn whole(&self, word: &Word, value: f64) -> Result<usize, ScriptError> {
        if value.fract() == 0.0 && (0.0..=1e9).contains(&value) {
            return Ok(value as usize);
        }
        let message = format!("{} is {value}; expected a whole number from 0", word.text);
        Err(self.at(word, message))
    }

    /// A logical value of a key; false if the key is missing.
    pub fn flag(&mut self, key: &'static str) -> Result<bool, ScriptError> {
        match self.value(key)? {
            None => Ok(false),
            Some(word) => match word.text.as_str() {
                "true" | "1" => Ok(true),
                "false" | "0" => Ok(false),
                other => {
                    let message = format!("{key} = {other:?}; expected true or false");
                    Err(self.at(&word, message))
                }
            },
        }
    }

    /// Numbers in square brackets.
    pub fn list(&mut self, key: &'static str) -> Result<Option<Vec<f64>>, ScriptError> {
        match self.value(key)? {
            Some(word) => self.list_of(&word).map(Some),
            None => Ok(None),
        }
    }

    /// The numbers of a list in brackets.
    pub fn list_of(&self, word: &Word) -> Result<Vec<f64>, ScriptError> {
        let inner = word
            .text
            .strip_prefix('[')
            .and_then(|t| t.strip_suffix(']'));
        let Some(inner) = inner else {
            let message = format!("found {}; expected a list such as [1, 0.5]", word.text);
            return Err(self.at(word, message));
        };
        if inner.trim().is_empty() {
            return Ok(Vec::new());
        }
        let mut column = word.column + 1;
        commas(inner)
            .map(|part| {
                let at = column;
                column += part.chars().count() + 1;
                self.evaluate(&Word {
                    text: part.to_owned(),
                    line: word.line,
                    column: at,
                })
            })
            .collect()
    }

    /// A list of three numbers in brackets as a vector.
    pub fn vector_of(&self, word: &Word) -> Result<Vec3, ScriptError> {
        match self.list_of(word)?[..] {
            [x, y, z] => Ok(Vec3::new(x, y, z)),
            ref list => {
                let message = format!("found {} numbers; expected [x, y, z]", list.len());
                Err(self.at(word, message))
            }
        }
    }

    /// One flag per face of the current mesh: those that the statement selects by `group=N`, `faces(...)`, `all`,
    /// `top`, `last`, `near(...)`, `ray(...)`. A selection without faces is an error.
    pub fn faces(&mut self) -> Result<Vec<bool>, ScriptError> {
        let model = self.interpreter.model();
        let Some(mesh) = &model.mesh else {
            return Err(self.fault("there is no mesh yet; begin with a solid such as cube"));
        };
        // A group number is a short form of a condition on the face's group. `shift` moves columns of errors
        // from the condition back to the word of the script.
        let (word, text, shift) = if let Some(word) = self.value("group")? {
            let text = format!("group == ({})", word.text);
            (word, text, -("group == (".len() as i64))
        } else {
            let word = self.positional().cloned();
            let message = "expected its faces: group=N, faces(...), all, top or last";
            let word = word.ok_or_else(|| self.fault(message))?;
            let inner = word
                .text
                .strip_prefix("faces(")
                .and_then(|t| t.strip_suffix(')'));
            if let Some(inner) = inner.map(str::to_owned) {
                (word, inner, "faces(".len() as i64)
            } else {
                (word.clone(), word.text, 0)
            }
        };
        let fault = |e: ExpressionError| ScriptError {
            column: (word.column as i64 + shift + e.at as i64).max(1) as usize,
            ..self.at(&word, format!("in {text:?}: {}", e.message))
        };
        let condition = Expression::parse(&text).map_err(fault)?;
        let scene = Scene {
            mesh,
            last: model.last,
            tops: &model.tops,
            parameters: &|name| self.interpreter.parameters.get(name).copied(),
        };
        let chosen = scene.choose(&condition).map_err(fault)?;
        if chosen.contains(&true) {
            return Ok(chosen);
        }
        // An empty selection is nearly always a mistake: the first groups in use help to find it.
        let groups: Vec<String> = mesh
            .group_counts()
            .keys()
            .take(20)
            .map(u32::to_string)
            .collect();
        Err(ScriptError {
            hint: Some(format!("groups in use: {}", groups.join(", "))),
            ..self.at(
                &word,
                format!("{text} selects none of the {} faces", mesh.face_count()),
            )
        })
    }

    /// Refuses unused arguments; the hint names a similar key that the step has.
    pub fn finish(&self) -> Result<(), ScriptError> {
        let Some(n) = self.used.iter().position(|u| !u) else {
            return Ok(());
        };
        let word = &self.statement.words[n];
        let (message, hint) = match split(&word.text) {
            Some((key, _)) => {
                let known = if self.requested.is_empty() {
                    "none".to_owned()
                } else {
                    self.requested.join(", ")
                };
                (
                    format!("unknown argument {key:?}; expected one of {known}"),
                    nearest(key, &self.requested).map(|w| format!("did you mean {w:?}?")),
                )
            }
            None => (format!("unexpected {:?}", word.text), None),
        };
        Err(ScriptError {
            hint,
            ..self.at(word, message)
        })
    }
}

/// A word as key and value; an `=` of a comparison or within brackets does not separate them, and `None` is a word
/// without a key.
fn split(word: &str) -> Option<(&str, &str)> {
    let mut depth = 0;
    let bytes = word.as_bytes();
    for (n, &b) in bytes.iter().enumerate() {
        match b {
            b'(' | b'[' => depth += 1,
            b')' | b']' => depth -= 1,
            b'=' if depth == 0 => {
                let compares = bytes.get(n + 1) == Some(&b'=')
                    || n.checked_sub(1)
                        .is_some_and(|k| b"<>!=".contains(&bytes[k]));
                return (!compares && n > 0).then(|| (&word[..n], &word[n + 1..]));
            }
            _ => {}
        }
    }
    None
}

/// Parts between commas outside brackets.
fn commas(text: &str) -> impl Iterator<Item = &str> {
    let mut depth = 0;
    text.split(move |c| {
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            _ => {}
        }
        c == ',' && depth == 0
    })
}
