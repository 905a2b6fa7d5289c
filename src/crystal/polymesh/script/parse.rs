//! The parser of scripts: a single pass over the text, without a mesh.
//!
//! It checks brackets, keywords and the names of steps. Arguments stay words; the steps read them when they run.

use super::argument::{Statement, Word};
use super::{Expression, Item, Script, ScriptError, VERBS, is_verb, nearest, seed};

/// Maximum nesting depth of loops.
const MAX_DEPTH: usize = 20;

/// Parses a whole script.
pub(super) fn script(text: &str) -> Result<Script, ScriptError> {
    let mut reader = Reader {
        text,
        at: 0,
        line: 1,
        line_start: 0,
    };
    let items = reader.items(0, None)?;
    Ok(Script { items })
}

/// A place in a script; lines and columns count from 1.
#[derive(Clone, Copy)]
struct Position {
    line: usize,
    column: usize,
}

fn fault(place: Position, message: impl Into<String>) -> ScriptError {
    ScriptError {
        line: place.line,
        column: place.column,
        message: message.into(),
        hint: None,
    }
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    line: usize,
    line_start: usize,
}

impl Reader<'_> {
    fn place(&self) -> Position {
        Position {
            line: self.line,
            column: self.text[self.line_start..self.at].chars().count() + 1,
        }
    }

    fn peek(&self) -> Option<char> {
        self.text[self.at..].chars().next()
    }

    fn bump(&mut self) -> Option<char> {
        let c = self.peek()?;
        self.at += c.len_utf8();
        if c == '\n' {
            self.line += 1;
            self.line_start = self.at;
        }
        Some(c)
    }

    fn comment(&mut self) {
        while self.peek().is_some_and(|c| c != '\n') {
            self.bump();
        }
    }

    /// Items up to the end, or to the "}" of a block opened at `opened`; `depth` is the number of blocks around it.
    fn items(&mut self, depth: usize, opened: Option<Position>) -> Result<Vec<Item>, ScriptError> {
        let mut items = Vec::new();
        loop {
            // A "}" ends the block that was opened, and is an error outside blocks; the end of the text is the reverse.
            match self.peek() {
                None => {
                    return match opened {
                        None => Ok(items),
                        Some(place) => Err(fault(place, "\"{\" without its \"}\"")),
                    };
                }
                Some('}') => {
                    let place = self.place();
                    self.bump();
                    return match opened {
                        Some(_) => Ok(items),
                        None => Err(fault(place, "\"}\" without its \"{\"")),
                    };
                }
                Some('#') => self.comment(),
                Some(c) if c.is_whitespace() || c == ';' => drop(self.bump()),
                Some(_) => items.push(self.item(depth)?),
            }
        }
    }

    /// The next parameter, loop or step; `depth` is the number of blocks around it.
    fn item(&mut self, depth: usize) -> Result<Item, ScriptError> {
        let place = self.place();
        let start = self.at;
        let first = self.word()?;
        match first.text.as_str() {
            "param" => {
                let rest = self.raw(&['\n', ';', '}'])?;
                let Some((name, value)) = rest.text.split_once('=') else {
                    return Err(fault(place, "expected param NAME = VALUE"));
                };
                let name = name.trim();
                let good = name.starts_with(|c: char| c.is_ascii_alphabetic())
                    && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
                if !good {
                    return Err(fault(
                        place,
                        format!("{name:?} is not a valid name of a parameter"),
                    ));
                }
                // Columns of errors in the value count from the "=" on.
                let column = rest.column + rest.text.find('=').unwrap_or(0) + 1;
                Ok(Item::Parameter {
                    name: name.to_owned(),
                    value: parsed(value, rest.line, column)?,
                    line: place.line,
                    column,
                })
            }
            "repeat" => {
                if depth >= MAX_DEPTH {
                    return Err(fault(
                        place,
                        format!("loops nest more than {MAX_DEPTH} deep"),
                    ));
                }
                let count = self.raw(&['{', '\n', ';'])?;
                if self.peek() != Some('{') {
                    return Err(fault(place, "expected repeat COUNT { ... }"));
                }
                let opened = self.place();
                self.bump();
                let (line, column) = (count.line, count.column);
                Ok(Item::Repeat {
                    count: parsed(&count.text, line, column)?,
                    body: self.items(depth + 1, Some(opened))?,
                    line,
                    column,
                })
            }
            verb => {
                // The name of a solid alone is a step that makes it.
                let verb = if is_verb(verb) {
                    verb
                } else {
                    self.solid(verb)
                        .ok_or_else(|| unknown(place, verb, &self.full_name(verb)))?
                };
                let mut words = Vec::new();
                // Blanks separate words; a step ends with its line, a semicolon, a comment or the end of its block.
                loop {
                    match self.peek() {
                        None | Some('\n' | ';' | '}' | '#') => break,
                        Some(c) if c.is_whitespace() => drop(self.bump()),
                        Some(_) => words.push(self.word()?),
                    }
                }
                Ok(Item::Step(Statement {
                    verb: verb.to_owned(),
                    words,
                    text: self.text[start..self.at].trim_end().to_owned(),
                    line: place.line,
                    column: place.column,
                }))
            }
        }
    }

    /// The solid whose name begins with the word just read; the longest name wins, and the reader goes behind it.
    /// `None` leaves the reader where it is.
    fn solid(&mut self, first: &str) -> Option<&'static str> {
        let mut name = first.to_owned();
        let mut found = seed::canonical(&name).map(|n| (n, self.at));
        let rest = &self.text[self.at..];
        let line = rest.split(['\n', ';', '#', '{', '}']).next().unwrap_or("");
        let mut at = self.at;
        for word in line.split_inclusive(char::is_whitespace) {
            at += word.len();
            if word.trim().is_empty() {
                continue;
            }
            name.push(' ');
            name.push_str(word.trim());
            if let Some(solid) = seed::canonical(&name) {
                found = Some((solid, at - (word.len() - word.trim_end().len())));
            }
        }
        let (solid, end) = found?;
        self.at = end;
        Some(solid)
    }

    /// The word just read, with up to three words after it that may belong to a name; for messages.
    fn full_name(&self, first: &str) -> String {
        let rest = &self.text[self.at..];
        let line = rest.split(['\n', ';', '#', '{', '}']).next().unwrap_or("");
        let is_word = |w: &&str| {
            w.chars()
                .all(|c| c.is_ascii_alphabetic() || "_-".contains(c))
        };
        let more = line.split_whitespace().take_while(is_word).take(3);
        let words: Vec<&str> = std::iter::once(first).chain(more).collect();
        words.join(" ")
    }

    /// The next word: up to a blank, `;`, `{`, `}` or `#` outside brackets and quotes. Brackets have to close within
    /// the line.
    fn word(&mut self) -> Result<Word, ScriptError> {
        let place = self.place();
        let start = self.at;
        let mut open: Vec<char> = Vec::new();
        // Blanks inside brackets belong to the word: a list or a condition is one word.
        while let Some(c) = self.peek() {
            let ends = c.is_whitespace() || matches!(c, ';' | '{' | '}' | '#');
            if open.is_empty() && ends {
                break;
            }
            match c {
                '"' => {
                    self.bump();
                    while self.peek().is_some_and(|c| c != '"' && c != '\n') {
                        self.bump();
                    }
                    if self.peek() != Some('"') {
                        return Err(fault(place, "a quotation mark is not closed"));
                    }
                }
                '(' => open.push(')'),
                '[' => open.push(']'),
                ')' | ']' if open.pop() != Some(c) => {
                    return Err(fault(
                        self.place(),
                        format!("{c:?} without an opening bracket"),
                    ));
                }
                '\n' | ';' | '#' => break,
                _ => {}
            }
            self.bump();
        }
        if let Some(c) = open.pop() {
            return Err(fault(
                place,
                format!("a bracket is not closed; expected {c:?}"),
            ));
        }
        if self.at == start {
            let found = self.peek().map_or("the end".into(), |c| format!("{c:?}"));
            return Err(fault(place, format!("found {found}; expected a step")));
        }
        Ok(Word {
            text: self.text[start..self.at].to_owned(),
            line: place.line,
            column: place.column,
        })
    }

    /// Text up to one of the characters `ends`, or to a comment; an error where there is none.
    fn raw(&mut self, ends: &[char]) -> Result<Word, ScriptError> {
        while self.peek().is_some_and(|c| c == ' ' || c == '\t') {
            self.bump();
        }
        let place = self.place();
        let start = self.at;
        while self.peek().is_some_and(|c| c != '#' && !ends.contains(&c)) {
            self.bump();
        }
        let text = self.text[start..self.at].trim_end().to_owned();
        if text.is_empty() {
            return Err(fault(place, "found nothing; expected a value"));
        }
        Ok(Word {
            text,
            line: place.line,
            column: place.column,
        })
    }
}

/// The error for a word that begins no step; `name` includes the words after it.
fn unknown(place: Position, word: &str, name: &str) -> ScriptError {
    let mut known: Vec<&str> = VERBS[1..].iter().map(|v| v.0).collect();
    known.extend(["param", "repeat"]);
    let solid = seed::nearest_solid(name).or_else(|| seed::nearest_solid(word));
    let meant = nearest(word, &known).or(solid);
    let meant = meant.map(|w| format!("did you mean {w:?}?"));
    let lower = name.to_ascii_lowercase();
    let is_solid = solid.is_some() || lower.contains("hedron") || lower.contains("cube");
    let list = is_solid.then(|| format!("the solids are {}", seed::solids().join(", ")));
    let hints: Vec<String> = meant.into_iter().chain(list).collect();
    let mut error = fault(place, format!("no step is called {word:?}"));
    error.hint = (!hints.is_empty()).then(|| hints.join(" "));
    error
}

/// An expression whose text begins at a place.
fn parsed(text: &str, line: usize, column: usize) -> Result<Expression, ScriptError> {
    Expression::parse(text).map_err(|e| ScriptError {
        line,
        column: column + text[..e.at.min(text.len())].chars().count(),
        message: format!("in {:?}: {}", text.trim(), e.message),
        hint: None,
    })
}
