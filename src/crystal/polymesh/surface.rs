//! Faces as the elements of a surface scaffold: triangles and quads only, without their groups.
//! A face is one element, so that larger faces have to be divided before.

use super::PolyMesh;
use druse_tilings::scaffold::{Connectivity, Kind, ScaffoldError, Surface};

/// Why faces cannot be elements of a surface.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// A face with more than four corners.
    #[error(
        "face {face} (group {group}) has {corners} corners; expected triangles and quads only: \
         remesh triangulate, stellate or linear_vertex makes them"
    )]
    Corners {
        /// The face.
        face: usize,
        /// Its group.
        group: u32,
        /// Its corners.
        corners: usize,
    },
    /// An error of the surface scaffold.
    #[error(transparent)]
    Scaffold(#[from] ScaffoldError),
}

impl PolyMesh {
    /// The triangles and quads as elements in the order of the faces, each from its start vertex.
    ///
    /// # Errors
    /// [`SurfaceError`] names the first face with more corners.
    pub fn surface(&self) -> Result<Surface, SurfaceError> {
        let mut elements = Connectivity::default();
        for (face, own) in self.faces().iter().enumerate() {
            let kind = match own.len() {
                3 => Kind::Tri3,
                4 => Kind::Quad4,
                corners => {
                    let group = self.groups()[face];
                    return Err(SurfaceError::Corners {
                        face,
                        group,
                        corners,
                    });
                }
            };
            elements.push(kind, own);
        }
        Ok(Surface::new(self.vertices().to_vec(), elements)?)
    }
}
