//! A limit on the unpacked size of a compressed file, against files made to exhaust the memory. All parts of a file
//! share one allowance.

use super::error::{Place, ReadError};
use std::cell::Cell;
use std::io;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The limit for small files.
const MIN_LIMIT_BYTES: u64 = 64 << 20;
/// Greatest ratio of unpacked to packed size for larger files: numbers in XML compress by a factor of 10 to 20.
const MAX_EXPANSION_RATIO: u64 = 64;

/// The remaining number of bytes that a file may unpack to.
pub(super) struct Allowance {
    path: PathBuf,
    packed: u64,
    left: Cell<u64>,
}

impl Allowance {
    /// The expectation in errors about the limit.
    pub const EXPECTED_SIZE: &str =
        "at most 64 times the file's size in all, or 64 MiB where that is more";

    /// The allowance of a file of `packed` bytes.
    pub fn new(path: &Path, packed: u64) -> Self {
        Self {
            path: path.to_owned(),
            packed,
            left: Cell::new(
                packed
                    .saturating_mul(MAX_EXPANSION_RATIO)
                    .max(MIN_LIMIT_BYTES),
            ),
        }
    }

    /// Reserves the declared unpacked size of a part, before it is unpacked.
    ///
    /// # Errors
    /// When the size exceeds the remaining allowance.
    pub fn take(&self, what: &str, bytes: u64) -> Result<(), ReadError> {
        if let Some(left) = self.left.get().checked_sub(bytes) {
            self.left.set(left);
            return Ok(());
        }
        let found = format!(
            "{what} that unpacks to {bytes} bytes in a file of {} bytes",
            self.packed
        );
        Err(
            ReadError::data(&self.path, Place::File, found, Self::EXPECTED_SIZE).with_hint(
                "the file is damaged, or made to fill the memory; if it is neither, pack it less",
            ),
        )
    }

    /// A reader of a part with a declared unpacked size, which fails beyond that size.
    ///
    /// # Errors
    /// As [`Allowance::take`].
    pub fn part<R: Read>(
        &self,
        name: &str,
        bytes: u64,
        part: R,
    ) -> Result<LimitedReader<R>, ReadError> {
        self.take(&format!("the part {name}"), bytes)?;
        Ok(LimitedReader { part, left: bytes })
    }
}

/// A reader that fails beyond a declared size.
pub(super) struct LimitedReader<R> {
    part: R,
    left: u64,
}

impl<R: Read> Read for LimitedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.part.read(buffer)?;
        self.left = self.left.checked_sub(n as u64).ok_or_else(|| {
            let text = "the part is longer than the archive declares";
            io::Error::new(io::ErrorKind::InvalidData, text)
        })?;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_unpacked_size_is_limited() {
        let path = Path::new("a.3mf");
        let allowance = Allowance::new(path, 5 << 20); // for 320 MiB
        assert!(allowance.take("a", 300 << 20).is_ok());
        let e = allowance.take("b", 21 << 20).unwrap_err().to_string();
        assert!(
            e.contains("b that unpacks to 22020096 bytes in a file of 5242880"),
            "{e}"
        );
        assert!(Allowance::new(path, 1000).take("c", 64 << 20).is_ok());
        assert!(
            Allowance::new(path, 1000)
                .take("c", (64 << 20) + 1)
                .is_err()
        );
        let mut part = Allowance::new(path, 9).part("d", 4, &b"12345"[..]).unwrap();
        assert!(part.read_to_end(&mut Vec::new()).is_err());
        let mut part = Allowance::new(path, 9).part("d", 5, &b"12345"[..]).unwrap();
        assert_eq!(part.read_to_end(&mut Vec::new()).unwrap(), 5);
    }
}
