//! Binary arrays of `.vtu` files: headers, base64, zlib.
//!
//! An array is its length in bytes and the bytes; compressed, it is the number of blocks, the size
//! of a block, the size of the last one (0 if full), the compressed size of each, and the blocks.

use crate::io::scalar::Scalar;
use crate::io::source::quote;
use crate::io::unpack_limit::Allowance;
use flate2::read::ZlibDecoder;
use std::io::Read;

/// Damaged data: what was found, and what is expected in its place.
#[derive(Debug)]
pub(super) struct Damage(pub String, pub &'static str);

impl<T: Into<String>> From<T> for Damage {
    fn from(found: T) -> Self {
        Self(found.into(), "undamaged data")
    }
}

/// The layout of a file's binary arrays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Format {
    pub big_endian: bool,
    header: Scalar, // of the sizes before the data
    zlib: bool,
    /// Whether the root element has been read.
    pub known: bool,
}

impl Default for Format {
    fn default() -> Self {
        Self {
            big_endian: false,
            header: Scalar::U32,
            zlib: false,
            known: false,
        }
    }
}

/// The appended data section.
pub(super) struct Appended<'a> {
    base64: bool, // else raw bytes
    data: &'a [u8],
}

impl<'a> Appended<'a> {
    /// Splits a file before its appended data, which need not be XML; they begin after the first "_" of their element.
    pub fn split(file: &'a [u8]) -> (&'a [u8], Option<Self>) {
        let find = |what: &[u8], from: usize| {
            let rest = file.get(from..)?;
            let at = rest.windows(what.len()).position(|w| w == what)?;
            Some(from + at)
        };
        let Some(start) = find(b"<AppendedData", 0) else {
            return (file, None);
        };
        let cut = |tag_end: usize| {
            let tag = &file[start..tag_end];
            let data = find(b"_", tag_end).map_or(&file[file.len()..], |u| &file[u + 1..]);
            let base64 = tag.windows(6).any(|w| w.eq_ignore_ascii_case(b"base64"));
            Self { base64, data }
        };
        (&file[..start], find(b">", start).map(cut))
    }
}

impl Format {
    /// The layout from the root element's attributes.
    ///
    /// # Errors
    /// The found and the expected value.
    pub fn of(
        byte_order: Option<&str>,
        header: Option<&str>,
        compressor: Option<&str>,
    ) -> Result<Self, (String, &'static str)> {
        // Files of old versions leave out attributes that have these defaults.
        let big_endian = match byte_order {
            None | Some("LittleEndian") => false,
            Some("BigEndian") => true,
            Some(other) => {
                let found = format!("the byte order {}", quote(other));
                return Err((found, "LittleEndian or BigEndian"));
            }
        };
        let header = match header {
            None | Some("UInt32") => Scalar::U32,
            Some("UInt64") => Scalar::U64,
            Some(other) => {
                let found = format!("the header type {}", quote(other));
                return Err((found, "UInt32 or UInt64"));
            }
        };
        let zlib = match compressor {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let found = format!("the compressor {}", quote(other));
                return Err((found, "vtkZLibDataCompressor or none"));
            }
        };
        // `known` marks that this layout is the file's and not the default.
        Ok(Self {
            big_endian,
            header,
            zlib,
            known: true,
        })
    }

    /// The bytes of an array from the base64 text in its element.
    pub fn inline(self, text: &[u8], allowance: &Allowance) -> Result<Vec<u8>, Damage> {
        self.unpack(&base64(text)?, allowance)
    }

    /// The bytes of an array at an offset in the appended data.
    pub fn appended(
        self,
        appended: &Appended,
        offset: u64,
        allowance: &Allowance,
    ) -> Result<Vec<u8>, Damage> {
        let data = usize::try_from(offset)
            .ok()
            .and_then(|at| appended.data.get(at..))
            .ok_or_else(|| format!("the offset {offset} of {} bytes", appended.data.len()))?;
        if !appended.base64 {
            return self.unpack(data, allowance);
        }
        // Other arrays follow without separator: the header gives the length to decode.
        let head = self.header.size();
        let first = base64(&data[..data.len().min(encoded(head))])?;
        let text = if self.zlib {
            // The header is encoded separately from the blocks.
            let blocks = self.count(&first, 0)?;
            let head_text = encoded((3 + blocks).saturating_mul(head));
            let numbers = base64(data.get(..head_text).ok_or("the end inside a header")?)?;
            let mut sum = 0usize;
            for i in 0..blocks {
                sum = sum.saturating_add(self.count(&numbers, 3 + i)?);
            }
            head_text.saturating_add(encoded(sum))
        } else {
            encoded(self.count(&first, 0)?.saturating_add(head))
        };
        let text = data.get(..text).ok_or("the end inside an array")?;
        self.unpack(&base64(text)?, allowance)
    }

    /// Header number `i` of an array as a count.
    fn count(self, data: &[u8], i: usize) -> Result<usize, Damage> {
        let size = self.header.size();
        let bytes = i
            .checked_mul(size)
            .and_then(|at| data.get(at..at.checked_add(size)?))
            .ok_or("the end inside a header")?;
        usize::try_from(self.header.whole(bytes, self.big_endian))
            .map_err(|_| "a header beyond all sizes".into())
    }

    /// The bytes of an array from its stored form, within the allowance for unpacked sizes.
    fn unpack(self, data: &[u8], allowance: &Allowance) -> Result<Vec<u8>, Damage> {
        let head = self.header.size();
        if data.is_empty() {
            return Ok(Vec::new());
        }
        if !self.zlib {
            let length = self.count(data, 0)?;
            return data[head..]
                .get(..length)
                .map(<[u8]>::to_vec)
                .ok_or_else(|| {
                    let left = data.len() - head;
                    format!("a length of {length} bytes where {left} are left").into()
                });
        }
        let blocks = self.count(data, 0)?;
        if blocks == 0 {
            return Ok(Vec::new());
        }
        let (block_size, last_size) = (self.count(data, 1)?, self.count(data, 2)?);
        let mut at = blocks
            .checked_add(3)
            .and_then(|n| n.checked_mul(head))
            .filter(|at| *at <= data.len())
            .ok_or_else(|| format!("{blocks} blocks in {} bytes", data.len()))?;
        // All blocks but the last have the same size, so the total is known before unpacking.
        let rest = if last_size > 0 { last_size } else { block_size };
        let whole = (blocks - 1).saturating_mul(block_size).saturating_add(rest);
        allowance
            .take("data", whole as u64)
            .map_err(|e| Damage(e.found().to_owned(), Allowance::EXPECTED_SIZE))?;
        let mut bytes = Vec::new();
        // Each block is a zlib stream of its own.
        for block in 0..blocks {
            let packed = self.count(data, 3 + block)?;
            let packed_block = data[at..].get(..packed).ok_or_else(|| {
                format!(
                    "a block of {packed} bytes where {} are left",
                    data.len() - at
                )
            })?;
            at += packed;
            let size = if block + 1 == blocks && last_size > 0 {
                last_size
            } else {
                block_size
            };
            let before = bytes.len();
            ZlibDecoder::new(packed_block)
                .take(size as u64)
                .read_to_end(&mut bytes)
                .map_err(|e| format!("block {block}: {e}"))?;
            if bytes.len() - before != size {
                let found = bytes.len() - before;
                return Err(format!("block {block} of {found} bytes, not {size}").into());
            }
        }
        Ok(bytes)
    }
}

/// The length of the base64 text of this many bytes.
fn encoded(bytes: usize) -> usize {
    bytes.div_ceil(3).saturating_mul(4)
}

/// Decodes base64, ignoring white space. Padding may occur in the middle, since header and data are often
/// encoded separately, and may be missing at the end.
fn base64(text: &[u8]) -> Result<Vec<u8>, Damage> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count, mut padding) = (0u32, 0, 0);
    for &c in text {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                padding += 1;
                0
            }
            c if c.is_ascii_whitespace() => continue,
            c => return Err(format!("the character {:?} in base64", char::from(c)).into()),
        };
        if padding > 0 && c != b'=' && count > 0 {
            return Err("padding inside a group of base64".into());
        }
        bits = bits << 6 | u32::from(value);
        count += 1;
        // Four characters are three bytes, less one for each padding character.
        if count == 4 {
            if padding > 2 {
                return Err("a group of padding in base64".into());
            }
            bytes.extend_from_slice(&bits.to_be_bytes()[1..4 - padding]);
            (bits, count, padding) = (0, 0, 0);
        }
    }
    match count {
        // Some writers omit the padding.
        0 => {}
        2 => bytes.push((bits >> 4) as u8),
        3 => bytes.extend_from_slice(&((bits >> 2) as u16).to_be_bytes()),
        _ => return Err("a single character at the end of base64".into()),
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_decoded_with_padding_anywhere() {
        assert_eq!(base64(b"TWFu").unwrap(), b"Man");
        assert_eq!(base64(b" TWE=\nTQ==TWFu").unwrap(), b"MaMMan");
        assert_eq!(base64(b"TWE").unwrap(), b"Ma");
        assert_eq!(base64(b"TQ").unwrap(), b"M");
        for bad in [&b"T"[..], b"T===", b"TW?u", b"T=Fu", b"===="] {
            assert!(base64(bad).is_err(), "{bad:?}");
        }
    }
}
