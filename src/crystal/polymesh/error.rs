//! Errors of polygon meshes and of extrusions: what was found, where, and what is expected. Messages are fragments
//! that follow the name of a file or step.

/// Why vertices and loops do not make a closed oriented 2-manifold. Numbers count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PolyError {
    /// No face at all.
    #[error("no faces; expected a closed surface")]
    Empty,
    /// A face of one or two corners.
    #[error("face {face} has {corners} corners; expected at least 3")]
    TooFewCorners {
        /// The face.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}; expected one of 0 to {}", *count as i64 - 1)]
    NoSuchVertex {
        /// The face.
        face: usize,
        /// The number that does not exist.
        vertex: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// A face contains a vertex twice.
    #[error("face {face} contains vertex {vertex} twice; expected each corner once")]
    RepeatedVertex {
        /// The face.
        face: usize,
        /// The vertex.
        vertex: u32,
    },
    /// Two faces run along an edge in the same direction.
    #[error(
        "faces {first} and {second} both run along the edge from vertex {from} to {to}; expected opposite directions \
         and two faces an edge: one face is flipped, or the surface is not a manifold"
    )]
    SameDirection {
        /// One face.
        first: usize,
        /// Another face.
        second: usize,
        /// Start of the edge.
        from: u32,
        /// End of the edge.
        to: u32,
    },
    /// An edge with a face on one side only.
    #[error(
        "the edge of face {face} from vertex {from} to {to} has no face on its other side; expected a closed surface"
    )]
    Open {
        /// The face.
        face: usize,
        /// Start of the edge.
        from: u32,
        /// End of the edge.
        to: u32,
    },
    /// Faces round a vertex that make more than one fan.
    #[error(
        "vertex {vertex} joins {fans} separate fans of faces; expected one: give each its own vertex"
    )]
    Pinched {
        /// The vertex.
        vertex: u32,
        /// Number of fans, 255 for more.
        fans: usize,
    },
    /// A vertex of no face.
    #[error("vertex {0} belongs to no face; expected every vertex in use")]
    Unused(u32),
    /// A coordinate that is infinite, not a number or too large (1e18).
    #[error("vertex {vertex} has the coordinate {value}; expected a finite number")]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// The coordinate.
        value: f64,
    },
    /// Counts of faces and groups that differ.
    #[error("{groups} groups for {faces} faces; expected one a face")]
    GroupCount {
        /// How many groups.
        groups: usize,
        /// How many faces.
        faces: usize,
    },
    /// A face in group 0.
    #[error("face {0} is in group 0; groups count from 1")]
    GroupZero(usize),
    /// A result with too many corners.
    #[error("the mesh would have {0} corners or more; expected at most {max}", max = super::MAX_CORNERS)]
    TooLarge(u64),
    /// More corners than a 32-bit index can hold.
    #[error("{0} corners; expected at most 4294967295")]
    TooMany(u64),
}

impl PolyError {
    /// The face that the error concerns, from 0.
    pub fn face(&self) -> Option<usize> {
        match self {
            Self::TooFewCorners { face, .. }
            | Self::NoSuchVertex { face, .. }
            | Self::RepeatedVertex { face, .. }
            | Self::SameDirection { second: face, .. }
            | Self::Open { face, .. }
            | Self::GroupZero(face) => Some(*face),
            _ => None,
        }
    }
}

/// Why a face cannot be extruded. Faces count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExtrudeError {
    /// An angle out of range.
    #[error("a dihedral angle of {0} degrees; expected more than 0 and less than 180")]
    Angle(f64),
    /// A number of tiers that differs from that of the kind.
    #[error("{found} tiers; {kind} takes exactly {expected}")]
    Tiers {
        /// The extrusion.
        kind: String,
        /// How many were given.
        found: usize,
        /// How many it has.
        expected: usize,
    },
    /// A tier that is not finite.
    #[error("tier {index} is {value}; expected a finite ratio of the mean edge length")]
    Tier {
        /// The tier, from 1.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A number of iterations out of range.
    #[error("{0} iterations; expected 1 to 1000")]
    Iterations(usize),
    /// A result with too many corners.
    #[error("the mesh would have {0} corners or more; expected at most {max}", max = super::MAX_CORNERS)]
    TooMany(u64),
    /// Numbers of groups beyond 32 bits.
    #[error("the greatest group number is {0}; new faces need numbers above it, up to {max}", max = u32::MAX)]
    Groups(u32),
    /// A face that cannot be extruded so.
    #[error("face {face}: {reason}")]
    Face {
        /// The face.
        face: usize,
        /// What was found and expected.
        reason: String,
    },
    /// The result is not a valid mesh.
    #[error("the result is not a valid mesh: {0}")]
    Result(#[from] PolyError),
    /// No face is chosen.
    #[error("no face is selected")]
    Nothing,
}
