//! Decoding of a part's text to UTF-8: from UTF-8 or UTF-16, with or without a byte order mark.
//! A part is decoded in chunks while it is read, so that memory does not grow with its size.

use std::io::{self, BufRead, BufReader, Read};

/// Number of bytes decoded at a time.
const CHUNK_BYTES: usize = 1 << 15;

/// The encoding of characters.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Utf8,
    /// UTF-16, little-endian.
    Little,
    /// UTF-16, big-endian.
    Big,
}

/// The encoding by the first bytes, and the length of the byte order mark.
fn encoding(head: &[u8]) -> (Encoding, usize) {
    match head {
        [0xef, 0xbb, 0xbf, ..] => (Encoding::Utf8, 3),
        [0xff, 0xfe, ..] => (Encoding::Little, 2),
        [0xfe, 0xff, ..] => (Encoding::Big, 2),
        // Every model begins with "<".
        [b'<', 0, ..] => (Encoding::Little, 0),
        [0, b'<', ..] => (Encoding::Big, 0),
        _ => (Encoding::Utf8, 0),
    }
}

/// A part's text as UTF-8, without a byte order mark; decoded while it is read.
pub(super) fn decode<'a>(mut part: impl Read + 'a) -> io::Result<Box<dyn BufRead + 'a>> {
    let mut head = [0; 3];
    let mut held = 0;
    while held < 3 {
        let n = part.read(&mut head[held..])?;
        if n == 0 {
            break;
        }
        held += n;
    }
    let (encoding, mark) = encoding(&head[..held]);
    let start = io::Cursor::new(head[mark..held].to_vec());
    let whole = start.chain(part);
    Ok(match encoding {
        Encoding::Utf8 => Box::new(BufReader::with_capacity(2 * CHUNK_BYTES, whole)),
        _ => Box::new(Utf16Reader {
            part: whole,
            is_big: encoding == Encoding::Big,
            pending_bytes: Vec::new(),
            text: Vec::new(),
            at: 0,
        }),
    })
}

/// A reader that converts UTF-16 to UTF-8.
struct Utf16Reader<R> {
    part: R,
    is_big: bool,
    /// The bytes of an incomplete unit or surrogate pair.
    pending_bytes: Vec<u8>,
    text: Vec<u8>,
    at: usize, // where unread text begins
}

impl<R: Read> Utf16Reader<R> {
    /// Decodes the next part of UTF-16 text into UTF-8; an empty text is the end. Invalid units become U+FFFD.
    fn refill(&mut self) -> io::Result<()> {
        self.text.clear();
        self.at = 0;
        // A chunk may decode to nothing yet: the bytes are kept and more are read.
        while self.text.is_empty() {
            let held = self.pending_bytes.len();
            let mut bytes = std::mem::take(&mut self.pending_bytes);
            bytes.resize(held + CHUNK_BYTES, 0);
            let read = self.part.read(&mut bytes[held..])?;
            bytes.truncate(held + read);
            if bytes.is_empty() {
                return Ok(());
            }
            let unit = |pair: &[u8]| {
                let pair = [pair[0], pair[1]];
                if self.is_big {
                    u16::from_be_bytes(pair)
                } else {
                    u16::from_le_bytes(pair)
                }
            };
            // An odd byte and the first half of a surrogate pair wait for the next chunk, except at the end.
            let mut whole = bytes.len() / 2 * 2;
            let is_high = |u: u16| (0xd800..0xdc00).contains(&u);
            if read > 0 && whole > 0 && is_high(unit(&bytes[whole - 2..])) {
                whole -= 2;
            }
            let units = bytes[..whole].chunks_exact(2).map(unit);
            for c in char::decode_utf16(units) {
                let c = c.unwrap_or(char::REPLACEMENT_CHARACTER);
                let mut utf8 = [0; 4];
                self.text.extend(c.encode_utf8(&mut utf8).bytes());
            }
            // A last odd byte is half a unit.
            if read == 0 {
                if whole < bytes.len() {
                    self.text.extend("\u{fffd}".bytes());
                }
                return Ok(());
            }
            self.pending_bytes = bytes[whole..].to_vec();
        }
        Ok(())
    }
}

impl<R: Read> BufRead for Utf16Reader<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.text.len() {
            self.refill()?;
        }
        Ok(&self.text[self.at..])
    }

    fn consume(&mut self, amount: usize) {
        self.at = (self.at + amount).min(self.text.len());
    }
}

impl<R: Read> Read for Utf16Reader<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let text = self.fill_buf()?;
        let n = text.len().min(out.len());
        out[..n].copy_from_slice(&text[..n]);
        self.consume(n);
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns one byte at a time, so that every character is split.
    struct Slow<'a>(&'a [u8]);

    impl Read for Slow<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let n = self.0.len().min(out.len()).min(1);
            out[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    #[test]
    fn every_encoding_gives_the_same_text() {
        let text = "<?xml version=\"1.0\"?><a b=\"\u{e4}\u{20ac}\u{1f48e}\"/>";
        let units = |f: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(f).collect::<Vec<u8>>();
        let (little, big) = (units(u16::to_le_bytes), units(u16::to_be_bytes));
        let cases: [(&[u8], &[u8]); 6] = [
            (&[], text.as_bytes()),
            (&[0xef, 0xbb, 0xbf], text.as_bytes()),
            (&[], &little),
            (&[0xff, 0xfe], &little),
            (&[], &big),
            (&[0xfe, 0xff], &big),
        ];
        for (mark, body) in cases {
            let bytes = [mark, body].concat();
            let mut found = String::new();
            let mut part = decode(Slow(&bytes)).unwrap();
            part.read_to_string(&mut found).unwrap();
            assert_eq!(found, text);
            let mut cut = String::new();
            let mut part = decode(&bytes[..bytes.len() - 1]).unwrap();
            // The text without its last byte is decoded up to an incomplete character.
            let _ = part.read_to_string(&mut cut);
            assert!(text.starts_with(cut.trim_end_matches('\u{fffd}')));
        }
        assert_eq!(decode(&b""[..]).unwrap().read(&mut [0; 4]).unwrap(), 0);
    }
}
