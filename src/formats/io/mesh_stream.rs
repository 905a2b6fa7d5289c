//! Streaming mesh output: vertices and faces arrive in parts that are not kept in memory.
//!
//! STL is written triangle by triangle. The other formats list all vertices first, so vertices and faces are
//! spooled to unnamed temporary files in the output directory and merged at the end. A stream that is not committed
//! leaves no file.

use super::atomic::{AtomicFile, BUFFER_BYTES};
use super::error::WriteError;
use super::mesh_format::MeshFormat;
use super::mesh_view::{Faces, Rows, VisitVertex};
use super::stl::StlStream;
use super::{obj, ply, threemf};
use druse_geometry::frame::{LengthUnit, Vec3};
use std::fs::File;
use std::io;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Some faces of a mesh with their vertices.
#[derive(Clone, Copy, Debug)]
pub struct MeshPart<'a> {
    /// The vertices of the part, new ones first.
    pub vertices: &'a [Vec3],
    /// The number of new vertices, which continue the numbering of the whole mesh.
    pub owned: usize,
    /// Faces over the vertices of the part, counter-clockwise seen from outside; STL is written from these.
    pub faces: Faces<'a>,
    /// The same faces with vertex numbers of the whole mesh, for the other formats.
    pub numbered: Faces<'a>,
    /// The attributes of the new vertices, vertex by vertex, one number per attribute name of the file.
    pub numbers: &'a [f32],
    /// A factor on every coordinate.
    pub factor: f64,
}

/// A mesh file during writing; it appears complete or not at all.
pub struct MeshStream {
    path: PathBuf,
    unit: LengthUnit,
    backend: Backend,
}

enum Backend {
    Stl(StlStream),
    Spooled(MeshFormat, Spool),
}

/// Vertices (three `f64`, then the attributes as `f32`) and faces (`u32` each) in little-endian order.
struct Spool {
    vertices: BufWriter<File>,
    faces: BufWriter<File>,
    /// The number of corners stored per face.
    corners: usize,
    /// Numbers of vertices and faces.
    counts: [u64; 2],
    names: Vec<String>,
    is_double: bool,
}

impl MeshStream {
    /// Sets whether PLY and 3MF store coordinates in double precision.
    #[must_use]
    pub fn in_double(mut self, is_double: bool) -> Self {
        if let Backend::Spooled(_, spool) = &mut self.backend {
            spool.is_double = is_double;
        }
        self
    }

    /// Creates a file in the format of its extension, for triangles only or also for quads, with the names of
    /// the vertex attributes.
    ///
    /// # Errors
    /// [`WriteError`] when the extension is unknown, the format does not support attributes or quadrilaterals,
    /// or the directory is not writable.
    pub fn create(
        path: &Path,
        unit: LengthUnit,
        has_quads: bool,
        names: Vec<String>,
    ) -> Result<Self, WriteError> {
        let format_error = |reason: &str| WriteError::Format {
            path: path.to_owned(),
            reason: reason.to_owned(),
        };
        let Some(format) = MeshFormat::of(path) else {
            return Err(format_error(
                "no extension of a mesh; expected .stl, .ply, .obj or .3mf",
            ));
        };
        if !names.is_empty() && format != MeshFormat::Ply {
            return Err(format_error(
                "numbers at the vertices; expected .ply for them",
            ));
        }
        if has_quads && !matches!(format, MeshFormat::Ply | MeshFormat::Obj) {
            return Err(format_error(
                "quadrilaterals; expected .ply or .obj for them",
            ));
        }
        let backend = if format == MeshFormat::Stl {
            Backend::Stl(StlStream::create(path, unit)?)
        } else {
            let corners = if has_quads { 4 } else { 3 };
            Backend::Spooled(format, Spool::create(path, corners, names)?)
        };
        Ok(Self {
            path: path.to_owned(),
            unit,
            backend,
        })
    }

    /// Adds a part: its new vertices get the next numbers of the whole mesh.
    ///
    /// # Errors
    /// [`WriteError::Io`], and [`WriteError::Format`] for quadrilaterals in a file of triangles.
    pub fn add(&mut self, part: MeshPart) -> Result<(), WriteError> {
        let max_corners = match &self.backend {
            Backend::Stl(_) => 3,
            Backend::Spooled(_, spool) => spool.corners,
        };
        let has_quads = |f: Faces| matches!(f, Faces::Quads(_));
        if max_corners < 4 && (has_quads(part.faces) || has_quads(part.numbered)) {
            return Err(WriteError::Format {
                path: self.path.clone(),
                reason: "quadrilaterals; the file was created for triangles".into(),
            });
        }
        match &mut self.backend {
            Backend::Stl(file) => (0..part.faces.len()).try_for_each(|face| {
                let corners = part.faces.corners(face);
                let corner = |n: usize| part.vertices[corners[n] as usize] * part.factor;
                file.add([0, 1, 2].map(corner))
            }),
            Backend::Spooled(_, spool) => spool
                .add(part)
                .map_err(|e| spool_error(&self.path, spool.bytes(), e)),
        }
    }

    /// Completes the file; returns its size in bytes.
    ///
    /// # Errors
    /// [`WriteError`] for too many triangles for the format, or when writing fails.
    pub fn commit(self) -> Result<u64, WriteError> {
        let (format, spool) = match self.backend {
            Backend::Stl(file) => return file.commit(),
            Backend::Spooled(format, spool) => (format, spool),
        };
        let bytes = spool.bytes();
        let mut rows = spool
            .into_rows()
            .map_err(|e| spool_error(&self.path, bytes, e))?;
        let mut file = match format {
            MeshFormat::ThreeMf => AtomicFile::create_seekable(&self.path)?,
            _ => AtomicFile::create(&self.path)?,
        };
        let written = match format {
            MeshFormat::Obj => obj::write(&mut file, &mut rows, self.unit),
            MeshFormat::ThreeMf => threemf::write(&mut file, &mut rows, self.unit),
            // STL has no spool.
            MeshFormat::Ply | MeshFormat::Stl => ply::write(&mut file, &mut rows, self.unit),
        };
        written.map_err(|e| file.failed(e))?;
        file.commit()
    }
}

/// An error in the spool files.
fn spool_error(path: &Path, written: u64, error: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        written,
        needed: None,
        error,
    }
}

impl Spool {
    /// A spool in the directory of the output, for faces of at most `corners` corners and vertices with the
    /// attributes `names`.
    fn create(path: &Path, corners: usize, names: Vec<String>) -> Result<Self, WriteError> {
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
        let directory = parent.unwrap_or(Path::new("."));
        let file = || {
            let file = tempfile::tempfile_in(directory).map_err(|e| WriteError::Create {
                path: path.to_owned(),
                reason: format!("no spool in {}: {e}", directory.display()),
            })?;
            Ok(BufWriter::with_capacity(BUFFER_BYTES, file))
        };
        Ok(Self {
            vertices: file()?,
            faces: file()?,
            corners,
            counts: [0; 2],
            names,
            is_double: false,
        })
    }

    /// Bytes that the spool holds: numbers of 8 and 4 bytes, as [`Spool`] has them.
    fn bytes(&self) -> u64 {
        (24 + 4 * self.names.len() as u64) * self.counts[0]
            + 4 * self.corners as u64 * self.counts[1]
    }

    /// Appends a part to the spool.
    fn add(&mut self, part: MeshPart) -> io::Result<()> {
        let width = self.names.len();
        for (n, v) in part.vertices[..part.owned].iter().enumerate() {
            for c in v {
                self.vertices.write_all(&(c * part.factor).to_le_bytes())?;
            }
            for number in &part.numbers[n * width..(n + 1) * width] {
                self.vertices.write_all(&number.to_le_bytes())?;
            }
        }
        for face in 0..part.numbered.len() {
            // The last corner is repeated if there are fewer.
            let corners = part.numbered.corners(face);
            for n in 0..self.corners {
                let corner = corners[n.min(corners.len() - 1)];
                self.faces.write_all(&corner.to_le_bytes())?;
            }
        }
        self.counts[0] += part.owned as u64;
        self.counts[1] += part.numbered.len() as u64;
        Ok(())
    }

    /// The spool files from their beginning, for one reading.
    fn into_rows(self) -> io::Result<SpooledRows> {
        let reopened = |file: BufWriter<File>| {
            let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
            file.seek(SeekFrom::Start(0))?;
            Ok::<_, io::Error>(BufReader::with_capacity(BUFFER_BYTES, file))
        };
        Ok(SpooledRows {
            vertices: reopened(self.vertices)?,
            faces: reopened(self.faces)?,
            corners: self.corners,
            counts: self.counts,
            names: self.names,
            is_double: self.is_double,
        })
    }
}

/// The spool files, read back once.
struct SpooledRows {
    vertices: BufReader<File>,
    faces: BufReader<File>,
    corners: usize,
    counts: [u64; 2],
    names: Vec<String>,
    is_double: bool,
}

/// Reads `N` items of `M` bytes each.
fn read_array<const N: usize, const M: usize>(from: &mut impl Read) -> io::Result<[[u8; M]; N]> {
    let mut bytes = [[0; M]; N];
    from.read_exact(bytes.as_flattened_mut())?;
    Ok(bytes)
}

impl Rows for SpooledRows {
    fn counts(&self) -> [u64; 2] {
        self.counts
    }
    fn names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }
    fn is_double(&self) -> bool {
        self.is_double
    }
    fn each_vertex(&mut self, visit: &mut VisitVertex) -> io::Result<()> {
        let mut numbers = vec![0.0; self.names.len()];
        for _ in 0..self.counts[0] {
            let [x, y, z] = read_array(&mut self.vertices)?.map(f64::from_le_bytes);
            for number in &mut numbers {
                let [own] = read_array(&mut self.vertices)?.map(f32::from_le_bytes);
                *number = own;
            }
            visit(Vec3::new(x, y, z), &numbers)?;
        }
        Ok(())
    }
    fn each_face(&mut self, visit: &mut dyn FnMut(&[u32]) -> io::Result<()>) -> io::Result<()> {
        let from = &mut self.faces;
        for _ in 0..self.counts[1] {
            if self.corners == 3 {
                visit(&read_array::<3, 4>(from)?.map(u32::from_le_bytes))?;
            } else {
                let quad = read_array::<4, 4>(from)?.map(u32::from_le_bytes);
                visit(Faces::Quads(&[quad]).corners(0))?;
            }
        }
        Ok(())
    }
}
