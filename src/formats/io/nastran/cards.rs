//! Cards of bulk data: physical lines in small, large or free field, joined by continuations.
//!
//! A line with a comma is in free field; a `*` after the name, or instead of the `+` of a
//! continuation, makes fields 16 columns wide. A continuation has a `+`, a `*` or nothing in its first
//! field. If both the tenth field of a line and the first field of the next have a name, they must be equal:
//! decks with continuations out of order are refused.

use crate::io::error::{Place, ReadError};
use crate::io::source::{Source, quote};
use std::path::{Path, PathBuf};

/// A card: its name in capitals and its fields from the second on.
#[derive(Default)]
pub(super) struct Card {
    pub name: String,
    text: String,
    /// The end of each field in the text.
    ends: Vec<usize>,
    pub path: PathBuf,
    /// The line of its name.
    pub line: u64,
    /// An error in its lines, reported only if the card is read.
    error: Option<(u64, String)>,
}

/// A reader of cards.
pub(super) struct Cards {
    source: Source,
    /// The first line of the next card.
    next_line: Option<String>,
    /// The quotation mark of a name of a file that runs on.
    open_mark: Option<char>,
}

/// A physical line in parts.
struct LineParts<'a> {
    head: &'a str,
    fields: Vec<&'a str>,
    /// The name of the continuation.
    tail: &'a str,
    error: Option<String>,
}

/// Greatest number of lines of a file name.
const MAX_NAME_LINES: usize = 16;

impl Cards {
    /// Opens a file before its first line. The error is that of the system.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Ok(Self {
            source: Source::open(path)?,
            next_line: None,
            open_mark: None,
        })
    }

    /// The next line with content: without comments, tabs expanded, non-ASCII characters replaced outside names
    /// of files: fields are columns of bytes.
    fn line(&mut self) -> Result<Option<String>, ReadError> {
        if let Some(line) = self.next_line.take() {
            return Ok(Some(line));
        }
        while let Some(line) = self.source.line()? {
            let text = line.trim_start();
            let name = match self.open_mark {
                Some(_) => Some(text),
                None => after_include(text),
            };
            let line = without_comment(line, name, self.open_mark).trim_end();
            if line.trim().is_empty() {
                continue;
            }
            // A tab goes to the next multiple of eight columns, the width of a field.
            let mut kept = String::with_capacity(line.len());
            for c in line.chars() {
                match c {
                    '\t' => {
                        kept.push(' ');
                        while !kept.len().is_multiple_of(8) {
                            kept.push(' ');
                        }
                    }
                    c if (c.is_ascii() || name.is_some()) && !c.is_control() => kept.push(c),
                    _ => kept.push('?'),
                }
            }
            return Ok(Some(kept));
        }
        Ok(None)
    }

    /// Reads the next card into `card`, with its continuations; false at the end of the file.
    pub fn next(&mut self, card: &mut Card) -> Result<bool, ReadError> {
        let Some(first) = self.line()? else {
            return Ok(false);
        };
        card.clear(self.source.path(), self.source.line_number());
        let upper = first.trim_start().to_ascii_uppercase();
        // `BEGIN BULK` and `INCLUDE` are statements: their words are no fields.
        if upper.split([' ', ',']).next() == Some("BEGIN") {
            let words: Vec<&str> = upper
                .split([' ', ',', '='])
                .filter(|w| !w.is_empty())
                .collect();
            "BEGIN".clone_into(&mut card.name);
            card.push(&words[1..].join(" "));
            return Ok(true);
        }
        if upper.starts_with("INCLUDE") {
            "INCLUDE".clone_into(&mut card.name);
            let name = self.file_name(first.trim_start()["INCLUDE".len()..].trim())?;
            card.push(&name);
            return Ok(true);
        }
        // A continuation belongs to the card before it. Errors are kept with the card: a card that is skipped
        // may be malformed.
        let parts = split(&first);
        if is_continuation(parts.head) {
            card.error = Some((card.line, "a continuation of no card".into()));
            card.name.push('+');
        } else {
            card.name.push_str(parts.head.trim_end_matches('*'));
            card.name.make_ascii_uppercase();
        }
        card.take(&parts);
        let mut tail = parts.tail.to_owned();
        // The first line that is no continuation begins the next card.
        while let Some(line) = self.line()? {
            let parts = split(&line);
            if !is_continuation(parts.head) {
                self.next_line = Some(line);
                break;
            }
            // The marks of the tenth and the first field join two lines; an empty one joins the next.
            let mark = |m: &str| m.trim_start_matches(['+', '*']).trim().to_ascii_uppercase();
            let (previous, current) = (mark(&tail), mark(parts.head));
            if !previous.is_empty()
                && !current.is_empty()
                && previous != current
                && card.error.is_none()
            {
                let text = format!(
                    "the continuation {} after {}",
                    quote(&current),
                    quote(&previous)
                );
                card.error = Some((self.source.line_number(), text));
            }
            card.take(&parts);
            parts.tail.clone_into(&mut tail);
        }
        Ok(true)
    }

    /// The name of a file, with or without quotes; a quoted name may extend over lines. `first` is the rest of the
    /// first line.
    fn file_name(&mut self, first: &str) -> Result<String, ReadError> {
        let quoted = first.chars().next().filter(|c| matches!(c, '\'' | '"'));
        let Some(mark) = quoted else {
            return Ok(first.to_owned());
        };
        let mut name = first[1..].to_owned();
        for _ in 0..MAX_NAME_LINES {
            if let Some(end) = name.find(mark) {
                name.truncate(end);
                return Ok(name);
            }
            self.open_mark = Some(mark);
            let line = self.line()?;
            self.open_mark = None;
            match line {
                Some(line) => name.push_str(line.trim()),
                None => break,
            }
        }
        let found = format!("INCLUDE of {}", quote(&name));
        Err(self.source.bad(found, "a quotation mark after the name"))
    }
}

/// What follows the word INCLUDE that begins a line.
fn after_include(text: &str) -> Option<&str> {
    let (word, rest) = text.split_at_checked("INCLUDE".len())?;
    let is_include = word.eq_ignore_ascii_case("INCLUDE");
    is_include.then(|| rest.trim_start())
}

/// A line up to its comment, which "$" begins, but not between the quotation marks of a name. `name` is the end of the
/// line from the name of a file on; `open` is the mark of a name that began in a line before.
fn without_comment<'a>(line: &'a str, name: Option<&str>, open: Option<char>) -> &'a str {
    let is_mark = |c: &char| matches!(c, '\'' | '"');
    let own = || name.and_then(|n| n.chars().next()).filter(is_mark);
    let begins_with_comment = line.trim_start().starts_with('$');
    let quoted_length = match (name, open.or_else(own)) {
        (Some(name), Some(mark)) if !begins_with_comment => {
            let first = line.len() - name.len() + usize::from(open.is_none());
            let closing = line[first..].find(mark);
            closing.map_or(line.len(), |at| first + at)
        }
        _ => 0,
    };
    let comment = line[quoted_length..].find('$');
    comment.map_or(line, |at| &line[..quoted_length + at])
}

/// Whether a line with this first field continues a card.
fn is_continuation(head: &str) -> bool {
    head.is_empty() || head.starts_with(['+', '*'])
}

/// The fields of a line: the first field, the data fields, and the mark of a continuation in the last 8 of 80 columns.
/// A wide line has four data fields of 16 columns, others eight of 8.
fn split(line: &str) -> LineParts<'_> {
    if line.contains(',') {
        return split_free(line);
    }
    let columns = |from: usize, to: usize| {
        let part = line.get(from..to.min(line.len())).unwrap_or("");
        part.trim()
    };
    let head = columns(0, 8);
    let width = if head.contains('*') { 16 } else { 8 };
    let fields = (8..72).step_by(width);
    LineParts {
        head,
        fields: fields.map(|from| columns(from, from + width)).collect(),
        tail: columns(72, 80),
        error: None,
    }
}

/// The fields of a line with commas: a name, 8 fields (4 where they are wide), a mark.
fn split_free(line: &str) -> LineParts<'_> {
    let mut words = line.split(',').map(str::trim);
    let head = words.next().unwrap_or("");
    let max_fields = if head.contains('*') { 4 } else { 8 };
    let mut fields: Vec<&str> = words.collect();
    while fields.last().is_some_and(|w| w.is_empty()) {
        fields.pop();
    }
    let mut tail = "";
    let mut error = None;
    // A mark begins with "+" or "*"; "+1.5" is a number.
    let mark = |w: &str| w.starts_with(['+', '*']) && real(w).is_none();
    // A full line has its mark in the tenth field, the sixth where fields are wide. A short line may end with one.
    if fields.len() > max_fields {
        tail = fields[max_fields];
        if fields.len() > max_fields + 1 {
            error = Some(format!("{} fields in a line", fields.len()));
        } else if !mark(tail) {
            error = Some(format!("{} in the tenth field", quote(tail)));
        }
        fields.truncate(max_fields);
    } else if fields.last().is_some_and(|w| mark(w)) {
        tail = fields.pop().unwrap_or("");
    }
    fields.resize(max_fields, "");
    LineParts {
        head,
        fields,
        tail,
        error,
    }
}

/// A real number in Nastran's notation: the E of an exponent may be a D or missing (`1.5-3` is 0.0015). `None` for
/// other text, also for words such as "inf".
pub(super) fn real(text: &str) -> Option<f64> {
    let known = |c: char| matches!(c, '0'..='9' | '+' | '-' | '.' | 'e' | 'E' | 'd' | 'D');
    if !text.starts_with(|c: char| matches!(c, '0'..='9' | '+' | '-' | '.'))
        || !text.chars().all(known)
    {
        return None;
    }
    let plain = text.replace(['D', 'd', 'E'], "e");
    if !plain.contains('e')
        && let Some(at) = plain.rfind(['+', '-']).filter(|at| *at > 0)
    {
        return format!("{}e{}", &plain[..at], &plain[at..]).parse().ok();
    }
    plain.parse().ok()
}

impl Card {
    fn clear(&mut self, path: &Path, line: u64) {
        self.name.clear();
        self.text.clear();
        self.ends.clear();
        if self.path != path {
            path.clone_into(&mut self.path);
        }
        self.line = line;
        self.error = None;
    }

    /// Appends a field.
    fn push(&mut self, field: &str) {
        self.text.push_str(field);
        self.ends.push(self.text.len());
    }

    /// Appends the fields of a line. Lines of wide fields come in pairs: a narrow line after a single one begins at a
    /// multiple of eight fields.
    fn take(&mut self, parts: &LineParts) {
        while parts.fields.len() == 8 && !self.ends.len().is_multiple_of(8) {
            self.push("");
        }
        for field in &parts.fields {
            self.push(field);
        }
        if let (Some(text), None) = (&parts.error, &self.error) {
            self.error = Some((self.line, text.clone()));
        }
    }

    /// Field `i`, counted from the second field of the card; empty if missing.
    pub fn field(&self, i: usize) -> &str {
        let start = if i == 0 {
            Some(&0)
        } else {
            self.ends.get(i - 1)
        };
        match (start, self.ends.get(i)) {
            (Some(&start), Some(&end)) => &self.text[start..end],
            _ => "",
        }
    }

    /// Checks that its lines are valid and continue each other.
    pub fn check(&self) -> Result<(), ReadError> {
        let Some((line, text)) = &self.error else {
            return Ok(());
        };
        let expected = "ten fields in a line, each line after the one that it continues";
        Err(ReadError::data(
            &self.path,
            Place::Line(*line),
            text.clone(),
            expected,
        ))
    }

    /// An error about the card.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.path, Place::Line(self.line), found, expected)
    }

    /// A non-negative integer of 32 bits in field `i`; `None` if the field is empty.
    pub fn number(&self, i: usize) -> Result<Option<u64>, ReadError> {
        let text = self.field(i);
        if text.is_empty() {
            return Ok(None);
        }
        match text.strip_prefix('+').unwrap_or(text).parse::<u32>() {
            Ok(n) => Ok(Some(u64::from(n))),
            Err(_) => Err(self.bad_field(i, "a whole number")),
        }
    }

    /// A positive integer in field `i`, which has to be given; `what` is expected there.
    pub fn needed(&self, i: usize, what: &str) -> Result<u64, ReadError> {
        match self.number(i)? {
            Some(n @ 1..) => Ok(n),
            _ => Err(self.bad_field(i, what)),
        }
    }

    /// A real number in field `i`; `None` if the field is empty.
    pub fn real(&self, i: usize) -> Result<Option<f64>, ReadError> {
        match self.field(i) {
            "" => Ok(None),
            text => real(text)
                .map(Some)
                .ok_or_else(|| self.bad_field(i, "a number")),
        }
    }

    /// An error about field `i`; messages count from the name of the card, which is field 1.
    fn bad_field(&self, i: usize, what: &str) -> ReadError {
        let found = format!(
            "{} in field {} of {}",
            quote(self.field(i)),
            i + 2,
            self.name
        );
        self.bad(found, what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_nastran_writes_them() {
        for (text, value) in [
            ("1.5-3", Some(1.5e-3)),
            ("-1.5+3", Some(-1500.0)),
            ("1.D+2", Some(100.0)),
            ("1.d2", Some(100.0)),
            (".5", Some(0.5)),
            ("7.", Some(7.0)),
            ("+3", Some(3.0)),
            ("-.25E-1", Some(-0.025)),
            ("1.0E", None),
            ("nan", None),
            ("inf", None),
            ("1 2", None),
            ("+E1", None),
            ("-", None),
        ] {
            assert_eq!(real(text), value, "{text}");
        }
    }

    #[test]
    fn fields_are_eight_or_sixteen_columns_or_between_commas() {
        let parts =
            split("GRID    12345678       11.0     2.0     3.0                             +A");
        assert_eq!(parts.fields[..5], ["12345678", "1", "1.0", "2.0", "3.0"]);
        assert_eq!((parts.head, parts.tail), ("GRID", "+A"));
        let parts =
            split("GRID*                  1                             1.5             2.5*A");
        assert_eq!(parts.fields, ["1", "", "1.5", "2.5"]);
        assert_eq!(parts.tail, "*A");
        let parts = split("chexa, 1,2,3 ,,5,6,7,8,+x");
        assert_eq!(parts.fields, ["1", "2", "3", "", "5", "6", "7", "8"]);
        assert_eq!((parts.head, parts.tail), ("chexa", "+x"));
        assert!(split("A,1,2,3,4,5,6,7,8,9").error.is_some());
    }
}
