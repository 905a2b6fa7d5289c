//! How much a packed file may unpack to: enough for every mesh, too little for a file made to fill the memory.

use super::{Place, ReadError};
use std::cell::Cell;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// A file may always unpack to this many bytes.
const ALWAYS: u64 = 64 << 20;
/// Beyond, to at most this many times its size: numbers in XML shrink to a tenth or a twentieth.
const TIMES: u64 = 64;

/// What is left of the bytes that a file may unpack to in all.
pub(super) struct Allowance {
    path: PathBuf,
    packed: u64,
    left: Cell<u64>,
}

impl Allowance {
    /// What is expected of a file that unpacks to more than it may.
    pub const EXPECTED: &str = "at most 64 times the file's size in all";

    /// That of a file of so many bytes.
    pub fn new(path: &Path, packed: u64) -> Self {
        Self {
            path: path.to_owned(),
            packed,
            left: Cell::new(packed.saturating_mul(TIMES).max(ALWAYS)),
        }
    }

    /// Takes bytes that a part of the file says it unpacks to, before any is unpacked.
    ///
    /// # Errors
    /// When it is more than is left.
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
            ReadError::data(&self.path, Place::File, found, Self::EXPECTED).with_hint(
                "the file is damaged, or made to fill the memory; if it is neither, pack it less",
            ),
        )
    }

    /// A part that says it unpacks to so many bytes: its reader fails where there are more.
    ///
    /// # Errors
    /// As [`Allowance::take`].
    pub fn part<R: Read>(&self, name: &str, bytes: u64, part: R) -> Result<Part<R>, ReadError> {
        self.take(&format!("the part {name}"), bytes)?;
        Ok(Part { part, left: bytes })
    }
}

/// A part of an archive that may not be longer than it says.
pub(super) struct Part<R> {
    part: R,
    left: u64,
}

impl<R: Read> Read for Part<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.part.read(buffer)?;
        self.left = self.left.checked_sub(n as u64).ok_or_else(|| {
            let text = "the part is longer than the archive says";
            io::Error::new(io::ErrorKind::InvalidData, text)
        })?;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_unpacks_to_so_much_in_all() {
        let path = Path::new("a.3mf");
        let allowance = Allowance::new(path, 5 << 20);
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
