//! STL: triangles without shared vertices, binary with 50 bytes each or as text.
//!
//! The size (84 + 50 n bytes) decides whether a file is binary, then the presence of text keywords; the
//! word `solid` does not suffice, since many binary files begin with it. If the header's count contradicts a
//! size of whole triangles, the size decides; fewer triangles than counted must form a closed surface. Druse
//! writes a header such as `druse unit=mm`.

mod text;

use super::atomic::AtomicFile;
use super::error::{Place, ReadError, WriteError};
use super::mesh_format::MeshFile;
use super::mesh_view::MeshView;
use super::source::Source;
use druse_geometry::frame::{LengthUnit, Vec3, is_in_range};
use druse_geometry::mesh::{TriMesh, VertexMerger};
use std::collections::HashMap;
use std::io;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

/// Size of the header and the count.
const HEADER_BYTES: u64 = 84;
/// Size of a triangle.
const TRIANGLE_BYTES: u64 = 50;
/// Number of triangles read or written at once, about 100 kB.
const BATCH_TRIANGLES: usize = 1 << 11;

/// Reads binary or text STL.
pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let size = source.size();
    // Keywords of text stand within its first lines.
    let head = source.peek(4096)?;
    let claimed = head
        .get(80..84)
        .map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let is_exact_size = claimed.is_some_and(|n| HEADER_BYTES + TRIANGLE_BYTES * n == size);
    if !is_exact_size && text::is_text(&head[..head.len().min(4096)]) {
        text::read(source)
    } else {
        read_binary(source)
    }
}

/// Reads the binary form: 80 bytes of header, the count, then 50 bytes per triangle.
fn read_binary(mut source: Source) -> Result<MeshFile, ReadError> {
    let header: [u8; 80] = source.array("the 80 bytes of an STL header")?;
    let claimed = u64::from(u32::from_le_bytes(source.array("the number of triangles")?));
    let mut warnings = Vec::new();
    let left = source.remaining();
    let actual = left / TRIANGLE_BYTES;
    // Of a pipe the size is unknown. Otherwise a size of whole triangles is more reliable than the count.
    let full = source.size() != u64::MAX && actual > 0 && left.is_multiple_of(TRIANGLE_BYTES);
    let is_count_wrong = full && claimed != actual;
    let count = if is_count_wrong {
        warnings.push(format!(
            "the header counts {claimed} triangles where the file has {actual}; all of them are read"
        ));
        source.count(actual, TRIANGLE_BYTES, "triangles")?
    } else {
        source.count(claimed, TRIANGLE_BYTES, "triangles")?
    };
    let extra = left - TRIANGLE_BYTES * count as u64;
    if extra > 0 && source.size() != u64::MAX {
        warnings.push(format!("{extra} bytes after the last triangle; ignored"));
    }
    let mut builder = Builder::default();
    let mut n = 0;
    while n < count {
        let batch = (count - n).min(BATCH_TRIANGLES);
        let bytes = source.bytes(batch * TRIANGLE_BYTES as usize, "a triangle of 50 bytes")?;
        let mut bad = None;
        // Bytes 0 to 11 are the normal, which the corners define; 12 to 47 the corners, 48 and 49 an attribute.
        for record in bytes.as_chunks::<{ TRIANGLE_BYTES as usize }>().0 {
            let (numbers, _) = record[12..].as_chunks::<4>();
            let number = |i: usize| f64::from(f32::from_le_bytes(numbers[i]));
            let corners = [0, 3, 6].map(|i| Vec3::new(number(i), number(i + 1), number(i + 2)));
            n += 1;
            bad = corners.iter().flatten().copied().find(|c| !is_in_range(*c));
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
                "a finite number below 1e18",
            ));
        }
    }
    // Fewer triangles than counted may be a truncated file; a closed surface is complete. The largest count
    // stands in files of programs that write without knowing it.
    if is_count_wrong && claimed > actual && claimed != u64::from(u32::MAX) && !builder.is_closed()
    {
        let found = format!("a claim of {claimed} triangles where the file has {actual}");
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

/// Triangles under construction; corners of equal coordinates become one vertex.
#[derive(Default)]
struct Builder {
    merger: VertexMerger,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    fn add(&mut self, corners: [Vec3; 3]) {
        self.triangles.push(corners.map(|p| self.merger.add(p)));
    }

    /// Whether every edge is traversed as often forward as backward.
    fn is_closed(&self) -> bool {
        let mut balance: HashMap<[u32; 2], i64> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let sign = if from < to { 1 } else { -1 };
                *balance.entry([from.min(to), from.max(to)]).or_default() += sign;
            }
        }
        balance.into_iter().all(|([a, b], n)| n == 0 || a == b)
    }

    /// The mesh with the metadata of its file.
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

/// The size of the file that [`write`] produces.
pub(super) fn size(mesh: &MeshView) -> u64 {
    HEADER_BYTES + TRIANGLE_BYTES * mesh.faces.len() as u64
}

/// The header of binary STL with the number of triangles.
fn head(triangles: u32, unit: LengthUnit) -> [u8; HEADER_BYTES as usize] {
    let mut head = [b' '; HEADER_BYTES as usize];
    let title = format!("druse unit={unit}");
    head[..title.len()].copy_from_slice(title.as_bytes());
    head[80..].copy_from_slice(&triangles.to_le_bytes());
    head
}

/// A triangle of 50 bytes: unit normal (0 without area), three corners, two bytes of 0.
fn facet([a, b, c]: [Vec3; 3]) -> [u8; TRIANGLE_BYTES as usize] {
    let n = (b - a)
        .cross(&(c - a))
        .try_normalize(0.0)
        .unwrap_or_default();
    let mut bytes = [0u8; TRIANGLE_BYTES as usize];
    let places = bytes.as_chunks_mut().0;
    for (v, places) in [n, a, b, c].iter().zip(places.as_chunks_mut::<3>().0) {
        *places = [v.x, v.y, v.z].map(|c| (c as f32).to_le_bytes());
    }
    bytes
}

/// Writes binary STL.
pub(super) fn write(out: &mut dyn Write, mesh: &MeshView, unit: LengthUnit) -> io::Result<()> {
    out.write_all(&head(mesh.faces.len() as u32, unit))?;
    let mut batch = Vec::with_capacity(BATCH_TRIANGLES * TRIANGLE_BYTES as usize);
    for corners in mesh.triangle_corners() {
        batch.extend_from_slice(&facet(corners));
        if batch.len() == batch.capacity() {
            out.write_all(&batch)?;
            batch.clear();
        }
    }
    out.write_all(&batch)
}

/// Streaming output of binary STL; the file appears complete or not at all.
pub struct StlStream {
    file: AtomicFile,
    path: PathBuf,
    unit: LengthUnit,
    triangles: u64,
}

impl StlStream {
    /// Creates a file.
    ///
    /// # Errors
    /// As [`AtomicFile::create_seekable`].
    pub fn create(path: &Path, unit: LengthUnit) -> Result<Self, WriteError> {
        let mut file = AtomicFile::create_seekable(path)?;
        let written = file.write_all(&head(0, unit));
        written.map_err(|e| file.failed(e))?;
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

    /// Completes the file; returns its size in bytes.
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
