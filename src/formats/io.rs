//! Readers and writers of files; outputs appear atomically. `mesh_file`, `polymesh` and `scaffold` choose a reader by
//! the extension: a new format is an arm there. Each format has a module; others (`source`, `tokens`, ...) are shared.
//!
//! Readers take a path and return the object with the file's metadata. Every failure is a [`ReadError`]: it
//! gives the file, the place, what was found, what was expected, and often a hint. Counts in a header are
//! checked against the file's size before memory is allocated. Writers stream into any [`std::io::Write`];
//! [`atomic`] moves the finished file to its name. Not promised: lengths are not converted ([`stated_unit`] names a
//! file's unit), and what a reader skips (materials, loads, textures) is lost when its object is written again.
//!
//! ```
//! # extern crate druse_formats as druse;
//! use druse::io::{ErrorClass, Place, ReadError};
//! let e = ReadError::data("part.ply", Place::Line(7), "\"abc\"", "a number");
//! assert_eq!(e.to_string(), "part.ply: line 7: found \"abc\"; expected a number");
//! assert_eq!(e.class().exit_code(), 65);
//! ```

pub mod atomic;
mod beam_parts;
mod beams;
mod cell;
mod cloud;
mod collector;
mod confine;
mod crystal;
mod dlfl;
mod element_file;
mod error;
mod fe_deck;
mod frd;
mod graph;
mod inp;
mod macro_deck;
mod medit;
mod mesh_file;
mod mesh_format;
mod mesh_stream;
mod mesh_view;
mod msh;
mod mtl;
mod nastran;
mod npy;
mod number;
mod obj;
mod obj_groups;
mod off;
mod outer_faces;
mod partial;
mod pc2;
mod ply;
mod point_cache;
mod polygon;
mod polygon_draft;
mod polygons;
mod polymesh;
mod scaffold;
mod scalar;
mod source;
mod stl;
mod table;
mod threemf;
mod tokens;
mod unpack_limit;
mod unv;
mod usda;
mod vtk;

pub use beam_parts::{Beam, BeamCap, BeamClip, BeamLattice, BeamPart, FileBeam, SolidFile};
#[doc(hidden)]
pub use beams::is_strut_file;
pub use beams::{read_solid, write_beams};
pub use cell::{read_cell, write_cell};
#[doc(hidden)]
pub use cloud::TEXT_CLOUDS;
pub use cloud::{PointFile, read_points};
#[doc(hidden)]
pub use confine::leads_out;
pub use crystal::read_crystal;
#[doc(hidden)]
pub use crystal::{DiskFiles, read_script, run_script, script_error};
pub use element_file::{
    DataField, ELEMENT_FORMATS, ElementFile, FieldAt, Group, ScaffoldFile, SurfaceFile,
};
pub use error::{ErrorClass, Place, ReadError, WriteError};
#[doc(hidden)]
pub use fe_deck::{DeckMaterial, VoxelMesh, write_voxel_deck};
pub use frd::{FrdField, FrdFile, read_frd};
pub use graph::read_skeleton;
#[doc(hidden)]
pub use graph::read_skeleton_noted;
pub use macro_deck::{DeckClass, ElementDeck, write_element_deck};
#[doc(hidden)]
pub use mesh_file::is_point_cloud;
pub use mesh_file::{read_mesh, stated_unit, write_mesh};
pub use mesh_format::{MeshFile, MeshFormat};
pub use mesh_stream::{MeshPart, MeshStream};
pub use mesh_view::{Faces, MeshView, VertexAttribute};
#[doc(hidden)]
pub use msh::{move_nodes, write_msh};
pub use npy::{NpyArray, read_npy};
#[doc(hidden)]
pub use partial::PartialFolder;
pub use point_cache::PointCache;
pub use polymesh::{read_polymesh, write_legacy_obj, write_polymesh};
pub use scaffold::{read_elements, read_scaffold};
pub use source::Source;
pub use table::read_columns;
#[doc(hidden)]
pub use table::{column_names, read_scattered, table_text};
pub use threemf::{ImplicitPart, SliceStackWriter};
pub use vtk::{write_vtu, write_vtu_edges, write_vtu_fields};
