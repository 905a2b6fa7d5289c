//! STL: triangles without sharing, as 50 bytes each or as text.
//!
//! Whether a file is binary is decided by its size (84 + 50 n), then by its text, never by the word
//! `solid` alone, which many binary files begin with. Where the header's count is not what the size says, the
//! size decides if triangles fill it: if there are fewer than counted, they must close. The header of ours
//! reads `druse unit=mm`.

mod text;

use super::atomic::AtomicFile;
use super::mesh_file::MeshFile;
use super::{MeshView, Place, ReadError, Source, WriteError};
use crate::frame::{LengthUnit, Vec3};
use crate::mesh::{Merger, TriMesh};
use std::collections::HashMap;
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};

/// Bytes of the header and the count.
const HEAD: u64 = 84;
/// Bytes of a triangle.
const TRIANGLE: u64 = 50;
/// Triangles that are read at once.
const BATCH: usize = 1 << 11;

/// Reads either kind.
pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let size = source.size();
    let head = source.peek(4096)?;
    let claimed = head
        .get(80..84)
        .map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let fits = claimed.is_some_and(|n| HEAD + TRIANGLE * n == size);
    if !fits && text::is_text(&head[..head.len().min(4096)]) {
        text::read(source)
    } else {
        read_binary(source)
    }
}

fn read_binary(mut source: Source) -> Result<MeshFile, ReadError> {
    let header: [u8; 80] = source.array("the 80 bytes of an STL header")?;
    let claimed = u64::from(u32::from_le_bytes(source.array("the number of triangles")?));
    let mut warnings = Vec::new();
    let left = source.remaining();
    let held = left / TRIANGLE;
    let full = source.size() != u64::MAX && held > 0 && left.is_multiple_of(TRIANGLE);
    let lies = full && claimed != held;
    let count = if lies {
        warnings.push(format!(
            "the header counts {claimed} triangles where the file has {held}; all of them are read"
        ));
        source.count(held, TRIANGLE, "triangles")?
    } else {
        source.count(claimed, TRIANGLE, "triangles")?
    };
    let extra = left - TRIANGLE * count as u64;
    if extra > 0 && source.size() != u64::MAX {
        warnings.push(format!(
            "{extra} bytes after the last triangle; passed over"
        ));
    }
    let mut builder = Builder::default();
    let mut n = 0;
    while n < count {
        let batch = (count - n).min(BATCH);
        let bytes = source.bytes(batch * TRIANGLE as usize, "a triangle of 50 bytes")?;
        let mut bad = None;
        for own in bytes.as_chunks::<{ TRIANGLE as usize }>().0 {
            let (numbers, _) = own[12..].as_chunks::<4>();
            let number = |i: usize| f64::from(f32::from_le_bytes(numbers[i]));
            let corners = [0, 3, 6].map(|i| Vec3::new(number(i), number(i + 1), number(i + 2)));
            n += 1;
            bad = corners.iter().flatten().copied().find(|c| !c.is_finite());
            if bad.is_some() {
                break;
            }
            builder.add(corners);
        }
        if let Some(bad) = bad {
            let place = Place::Item("triangle", n as u64);
            return Err(ReadError::data(
                source.path(),
                place,
                format!("the coordinate {bad}"),
                "a finite number",
            ));
        }
    }
    if lies && claimed > held && claimed != u64::from(u32::MAX) && !builder.closes() {
        let found = format!("a claim of {claimed} triangles where the file has {held}");
        let expected = "as many triangles as the header counts, or a closed surface";
        return Err(
            ReadError::data(source.path(), Place::Byte(80), found, expected)
                .with_hint("the file looks truncated"),
        );
    }
    let unit = stated_unit(&String::from_utf8_lossy(&header));
    builder.finish(&source, unit, warnings)
}

/// The unit in a header such as `druse unit=mm`.
fn stated_unit(header: &str) -> Option<LengthUnit> {
    let rest = &header[header.find("unit=")? + 5..];
    let end = rest
        .find(|c: char| !c.is_ascii_alphabetic())
        .unwrap_or(rest.len());
    rest[..end].parse().ok()
}

#[derive(Default)]
struct Builder {
    merger: Merger,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    fn add(&mut self, corners: [Vec3; 3]) {
        self.triangles.push(corners.map(|p| self.merger.add(p)));
    }

    /// Whether every edge is passed as often forward as backward.
    fn closes(&self) -> bool {
        let mut passes: HashMap<[u32; 2], i64> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let way = if from < to { 1 } else { -1 };
                *passes.entry([from.min(to), from.max(to)]).or_default() += way;
            }
        }
        passes.into_iter().all(|([a, b], n)| n == 0 || a == b)
    }

    fn finish(
        self,
        source: &Source,
        unit: Option<LengthUnit>,
        warnings: Vec<String>,
    ) -> Result<MeshFile, ReadError> {
        let mesh = TriMesh::new(self.merger.vertices, self.triangles)
            .map_err(|e| ReadError::data(source.path(), Place::File, e.to_string(), "a mesh"))?;
        Ok(MeshFile {
            mesh,
            unit,
            warnings,
        })
    }
}

/// Bytes of the file that [`write`] makes.
pub(super) fn size(mesh: &MeshView) -> u64 {
    HEAD + TRIANGLE * mesh.faces.len() as u64
}

/// The title of binary STL, and the number of its triangles.
fn head(triangles: u32, unit: LengthUnit) -> [u8; HEAD as usize] {
    let mut head = [b' '; HEAD as usize];
    let title = format!("druse unit={unit}");
    head[..title.len()].copy_from_slice(title.as_bytes());
    head[80..].copy_from_slice(&triangles.to_le_bytes());
    head
}

fn facet([a, b, c]: [Vec3; 3]) -> [u8; TRIANGLE as usize] {
    let n = (b - a)
        .cross(&(c - a))
        .try_normalize(0.0)
        .unwrap_or_default();
    let mut bytes = [0u8; TRIANGLE as usize];
    let places = bytes.as_chunks_mut().0;
    for (v, places) in [n, a, b, c].iter().zip(places.as_chunks_mut::<3>().0) {
        *places = [v.x, v.y, v.z].map(|c| (c as f32).to_le_bytes());
    }
    bytes
}

/// Writes binary STL.
pub(super) fn write(out: &mut dyn Write, mesh: &MeshView, unit: LengthUnit) -> io::Result<()> {
    out.write_all(&head(mesh.faces.len() as u32, unit))?;
    let mut batch = Vec::with_capacity(BATCH * TRIANGLE as usize);
    for corners in mesh.triangle_corners() {
        batch.extend_from_slice(&facet(corners));
        if batch.len() == batch.capacity() {
            out.write_all(&batch)?;
            batch.clear();
        }
    }
    out.write_all(&batch)
}

/// Binary STL whose triangles come bit by bit; it appears whole or not at all.
pub struct StlStream {
    file: AtomicFile,
    path: PathBuf,
    unit: LengthUnit,
    triangles: u64,
}

impl StlStream {
    /// Begins a file.
    ///
    /// # Errors
    /// As [`AtomicFile::create_seekable`].
    pub fn create(path: &Path, unit: LengthUnit) -> Result<Self, WriteError> {
        let mut file = AtomicFile::create_seekable(path)?;
        let begun = file.write_all(&head(0, unit));
        begun.map_err(|e| file.failed(e))?;
        Ok(Self {
            file,
            path: path.to_owned(),
            unit,
            triangles: 0,
        })
    }

    /// Adds a triangle, counter-clockwise seen from outside, in the file's unit.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn add(&mut self, corners: [Vec3; 3]) -> Result<(), WriteError> {
        self.triangles += 1;
        let written = self.file.write_all(&facet(corners));
        written.map_err(|e| self.file.failed(e))
    }

    /// Completes the file; gives its size.
    ///
    /// # Errors
    /// [`WriteError::Format`] for more triangles than 32 bits count, [`WriteError::Io`].
    pub fn commit(mut self) -> Result<u64, WriteError> {
        let count = u32::try_from(self.triangles).map_err(|_| WriteError::Format {
            path: self.path.clone(),
            reason: format!(
                "{} triangles; STL counts up to {}",
                self.triangles,
                u32::MAX
            ),
        })?;
        let patched = self
            .file
            .seek(io::SeekFrom::Start(0))
            .and_then(|_| self.file.write_all(&head(count, self.unit)));
        patched.map_err(|e| self.file.failed(e))?;
        self.file.commit()
    }
}
