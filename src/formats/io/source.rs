//! Buffered input files with line and byte positions for errors, and checks of counts against the size.
//!
//! A line ends with LF, CR LF or CR. If the first line ends with a lone CR, all lines do, so that the byte
//! after a text header is data even if it is an LF. A byte order mark before the first line is ignored;
//! UTF-16 is refused.

use super::error::{Place, ReadError};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Greatest length of a line of text.
const MAX_LINE_BYTES: usize = 1 << 20;
/// Number of bytes read at once.
const BUFFER_BYTES: usize = 1 << 18;

/// A buffered file that counts bytes and lines, so that every error has a place.
pub struct Source {
    path: PathBuf,
    file: File,
    size: u64,
    buffer: Vec<u8>,
    /// The unread range of the buffer.
    start: usize,
    end: usize,
    /// The offset of the next byte in the file.
    byte: u64,
    /// The number of the current line, from 1.
    line: u64,
    /// The range of the current line in the buffer.
    current: Range<usize>,
    /// The current statement, if joined from several lines.
    joined: Option<Vec<u8>>,
    /// Whether the first line ended with a lone CR.
    has_cr_line_ends: bool,
    text: String,
}

/// Whether text begins as UTF-16 does: with its byte order mark, or with zeros between letters.
pub(super) fn is_utf16(head: &[u8]) -> bool {
    let letter = |b: u8| b.is_ascii_graphic() || b.is_ascii_whitespace();
    match *head {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => true,
        [a, 0, b, 0, ..] | [0, a, 0, b, ..] => letter(a) && letter(b),
        _ => false,
    }
}

/// The refusal of UTF-16.
pub(super) fn utf16_error(path: &Path) -> ReadError {
    ReadError::data(path, Place::Byte(0), "UTF-16 text", "UTF-8 text")
        .with_hint("save the file again as UTF-8")
}

impl Source {
    /// Opens a file.
    ///
    /// # Errors
    /// When the file does not exist, is a directory or is not readable.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        let path = path.as_ref();
        let fail = |e| ReadError::io(path, e);
        let file = File::open(path).map_err(fail)?;
        let meta = file.metadata().map_err(fail)?;
        if meta.is_dir() {
            return Err(fail(ErrorKind::IsADirectory.into()));
        }
        let size = if meta.is_file() { meta.len() } else { u64::MAX };
        Ok(Self {
            path: path.to_owned(),
            file,
            size,
            buffer: Vec::new(),
            start: 0,
            end: 0,
            byte: 0,
            line: 0,
            current: 0..0,
            joined: None,
            has_cr_line_ends: false,
            text: String::new(),
        })
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The size of the file in bytes; `u64::MAX` for a pipe.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// The number of unread bytes.
    pub fn remaining(&self) -> u64 {
        self.size.saturating_sub(self.byte)
    }

    /// Reads more bytes into the buffer, which grows if full; returns their number, 0 at the end. Unread bytes move to
    /// the start of the buffer.
    fn fill(&mut self) -> Result<usize, ReadError> {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            let size = (2 * self.buffer.len()).max(BUFFER_BYTES);
            self.buffer.resize(size, 0);
        }
        loop {
            match self.file.read(&mut self.buffer[self.end..]) {
                Ok(n) => {
                    self.end += n;
                    return Ok(n);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(ReadError::io(&self.path, e)),
            }
        }
    }

    /// Marks bytes of the buffer as read.
    fn consume(&mut self, bytes: usize) {
        self.start += bytes;
        self.byte += bytes as u64;
    }

    /// The next bytes without consuming them: at least `n` unless the file ends first.
    ///
    /// # Errors
    /// When the system fails.
    pub fn peek(&mut self, n: usize) -> Result<&[u8], ReadError> {
        while self.end - self.start < n && self.fill()? > 0 {}
        Ok(&self.buffer[self.start..self.end])
    }

    /// The error that the file ends where `what` is expected.
    fn too_short(&self, what: &str) -> ReadError {
        let place = Place::Byte(self.byte);
        ReadError::data(&self.path, place, "the end of the file", what.to_owned())
            .with_hint("the file looks truncated")
    }

    /// Fills the whole `buffer`; `what` is expected at the end of the file.
    ///
    /// # Errors
    /// When the file ends first, or the system fails.
    pub fn exact(&mut self, buffer: &mut [u8], what: &str) -> Result<(), ReadError> {
        let known = buffer.len().min(self.end - self.start);
        buffer[..known].copy_from_slice(&self.buffer[self.start..self.start + known]);
        self.file.read_exact(&mut buffer[known..]).map_err(|e| {
            if e.kind() == ErrorKind::UnexpectedEof {
                self.too_short(what)
            } else {
                ReadError::io(&self.path, e)
            }
        })?;
        self.start += known;
        self.byte += buffer.len() as u64;
        Ok(())
    }

    /// The next `n` bytes; they are buffered as a whole.
    ///
    /// # Errors
    /// As [`Source::exact`].
    pub fn bytes(&mut self, n: usize, what: &str) -> Result<&[u8], ReadError> {
        if self.end - self.start < n && self.peek(n)?.len() < n {
            return Err(self.too_short(what));
        }
        self.consume(n);
        Ok(&self.buffer[self.start - n..self.start])
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// As [`Source::exact`].
    pub fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.bytes(N, what)?);
        Ok(bytes)
    }

    /// Skips a byte order mark; refuses UTF-16.
    fn skip_byte_order_mark(&mut self) -> Result<(), ReadError> {
        let head = self.peek(4)?;
        if is_utf16(head) {
            return Err(utf16_error(&self.path));
        }
        if head.starts_with(&[0xef, 0xbb, 0xbf]) {
            self.consume(3);
        }
        Ok(())
    }

    /// Reads the next line, for [`Source::current`]; `false` at the end.
    ///
    /// # Errors
    /// When a line is longer than a mebibyte, the text is UTF-16, or the system fails.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        self.joined = None;
        let first = self.byte == 0;
        if first {
            self.skip_byte_order_mark()?;
        }
        let mut seen = 0;
        // The line may extend over several fills of the buffer; `seen` bytes of it have no line end.
        let ended = loop {
            let rest = &self.buffer[self.start + seen..self.end];
            let at = rest.iter().position(|&b| b == b'\n' || b == b'\r');
            if let Some(at) = at {
                seen += at;
                break true;
            }
            seen += rest.len();
            if seen >= MAX_LINE_BYTES {
                self.line += 1;
                return Err(self.bad("a line of more than 1048576 bytes", "lines of text"));
            }
            if self.fill()? == 0 {
                break false;
            }
        };
        // The last line may lack its end.
        if !ended && seen == 0 {
            return Ok(false);
        }
        self.line += 1;
        // The length of the line end: 0 to 3 bytes.
        let end = if ended {
            self.line_end(seen, first)?
        } else {
            0
        };
        self.consume(seen + end);
        let from = self.start - seen - end;
        self.current = from..from + seen;
        Ok(true)
    }

    /// The length of the line end at an offset from the unread bytes; `first` is for the first line, whose end decides
    /// whether lines end with CR alone.
    fn line_end(&mut self, at: usize, first: bool) -> Result<usize, ReadError> {
        if self.buffer[self.start + at] == b'\n' {
            return Ok(1);
        }
        let has_cr_line_ends = self.has_cr_line_ends;
        let end = match self.peek(at + 3)?[at..] {
            _ if has_cr_line_ends => 1,
            [_, b'\n', ..] => 2,
            // Line ends that were converted to CR LF twice.
            [_, b'\r', b'\n', ..] => 3,
            _ => 1,
        };
        self.has_cr_line_ends |= first && end == 1;
        Ok(end)
    }

    /// The current line, without its end.
    pub fn current(&self) -> &[u8] {
        let line = &self.buffer[self.current.clone()];
        self.joined.as_deref().unwrap_or(line)
    }

    /// The next line without its end, as text (bytes outside UTF-8 are replaced); `None` at the end.
    ///
    /// # Errors
    /// As [`Source::advance`].
    pub fn line(&mut self) -> Result<Option<&str>, ReadError> {
        if !self.advance()? {
            return Ok(None);
        }
        let bytes = &self.buffer[self.current.clone()];
        if let Ok(text) = std::str::from_utf8(bytes) {
            return Ok(Some(text));
        }
        self.text = String::from_utf8_lossy(bytes).into_owned();
        Ok(Some(&self.text))
    }

    /// Reads the next statement: a line with those that a backslash at its end joins to it, unless it is
    /// a comment. `false` at the end. [`Source::current`] is then the whole statement.
    ///
    /// # Errors
    /// When the joined lines are longer than a mebibyte, and as [`Source::advance`].
    pub fn advance_joined(&mut self) -> Result<bool, ReadError> {
        // The line without the backslash at its end; comments are not continued.
        fn continued(line: &[u8]) -> Option<&[u8]> {
            let line = line.trim_ascii_end();
            line.strip_suffix(b"\\")
                .filter(|l| !l.trim_ascii_start().starts_with(b"#"))
        }
        if !self.advance()? {
            return Ok(false);
        }
        if continued(self.current()).is_none() {
            return Ok(true);
        }
        let mut joined: Vec<u8> = Vec::new();
        // A blank takes the place of each line end.
        while let Some(line) = continued(self.current()) {
            joined.extend_from_slice(line);
            joined.push(b' ');
            if joined.len() > MAX_LINE_BYTES {
                let found = format!("a statement of more than {MAX_LINE_BYTES} bytes");
                return Err(self.bad(found, "lines of text"));
            }
            if !self.advance()? {
                self.joined = Some(joined);
                return Ok(true);
            }
        }
        joined.extend_from_slice(self.current());
        self.joined = Some(joined);
        Ok(true)
    }

    /// The number of lines after the current one, including blank ones. The file is opened a second time, so that the
    /// position stays.
    ///
    /// # Errors
    /// When the system fails.
    pub fn lines_left(&self) -> Result<u64, ReadError> {
        let fail = |e| ReadError::io(&self.path, e);
        let mut file = File::open(&self.path).map_err(fail)?;
        file.seek(SeekFrom::Start(self.byte)).map_err(fail)?;
        let mut buffer = vec![0; BUFFER_BYTES];
        let (mut lines, mut last) = (0, b'\n');
        loop {
            let n = file.read(&mut buffer).map_err(fail)?;
            if n == 0 {
                return Ok(lines + u64::from(!matches!(last, b'\n' | b'\r')));
            }
            for &b in &buffer[..n] {
                lines += u64::from(b == b'\r' || (b == b'\n' && last != b'\r'));
                last = b;
            }
        }
    }

    /// The number of the current line, from 1; 0 before the first.
    pub fn line_number(&self) -> u64 {
        self.line
    }

    /// The offset of the next byte.
    pub fn byte(&self) -> u64 {
        self.byte
    }

    /// An error at the current line.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.path, Place::Line(self.line), found, expected)
    }

    /// An error at the next byte.
    pub fn bad_byte(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.path, Place::Byte(self.byte), found, expected)
    }

    /// A count of items from a header as a `usize`, checked against the remaining size of the file at `min_bytes` each
    /// and against 32 bits.
    ///
    /// # Errors
    /// When the file is too short for the count, or the count beyond 32 bits.
    pub fn count(&self, claimed: u64, min_bytes: u64, what: &str) -> Result<usize, ReadError> {
        let room = self.remaining() / min_bytes.max(1);
        if claimed > room || claimed > u64::from(u32::MAX) {
            return Err(self
                .bad_byte(
                    format!(
                        "a claim of {claimed} {what} with {} bytes left",
                        self.remaining()
                    ),
                    format!("at most {} {what}", room.min(u64::from(u32::MAX))),
                )
                .with_hint("the header is damaged or the file is truncated"));
        }
        Ok(claimed as usize)
    }
}

/// A quotation of text for a message: at most 40 characters, escaped.
pub fn quote(text: &str) -> String {
    let short: String = text.chars().take(40).collect();
    let more = if short.len() < text.len() { "..." } else { "" };
    format!("{short:?}{more}")
}
