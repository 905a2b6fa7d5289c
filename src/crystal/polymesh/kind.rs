//! The table of extrusions: topology as data, positions as rules of tiers; their operators, dihedral angles and names.
//!
//! New vertices form rings with one vertex per corner of the base; the tetrahedral apex is one vertex. A side
//! face is a list of `(ring, shift)`: ring 0 is the base, and `shift` is added to the number of the corner.
//! Rows of side faces go from the base upward, each round the base from its start vertex.

use super::tier::TierRule;
use std::fmt;
use std::str::FromStr;

/// The seven extrusions, named after the solid that each makes on a face of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A pyramid.
    Tetrahedral,
    /// A prism or frustum.
    Cubical,
    /// An antiprism.
    Octahedral,
    /// Two rows of pentagons.
    Dodecahedral,
    /// Five rows of triangles.
    Icosahedral,
    /// Triangles, quads, triangles.
    Cuboctahedral,
    /// Quads and triangles in three tiers.
    SmallRhombicuboctahedral,
}

/// An operator on the extrusion of a derived polygon; the image keeps the base polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operator {
    /// Corners cut off; needs an even number of corners, taken in pairs.
    Truncate,
    /// Corners cut off to the midpoints of the edges.
    Rectify,
    /// Faces shrunk; edges become quads.
    Cantellate,
    /// Corners and edges cut; needs an even number of corners.
    Omnitruncate,
    /// Faces shrunk and rotated, left-handed or right-handed.
    Snub,
}

/// How the dihedral angle is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Dihedral {
    /// That of the regular solid.
    #[default]
    Regular,
    /// The angle that makes all edges equal for this number of corners, where there is one; else as `Regular`.
    Auto,
    /// An angle in degrees, more than 0 and less than 180.
    Degrees(f64),
}

/// A corner of a side face: ring, and shift of the corner's number.
pub(super) type CornerRef = (usize, i32);

/// A row of the table.
pub(super) struct Row {
    pub kind: Kind,
    pub name: &'static str,
    /// Corners of the regular solid's faces.
    pub corners: usize,
    /// Cosine of the regular solid's dihedral angle: (numerator, square of the denominator).
    cosine: (f64, f64),
    /// One rule per tier.
    pub tiers: &'static [TierRule],
    /// Rings of new vertices.
    pub rings: &'static [Ring],
    /// Rows of side faces; the faces of one row alternate.
    pub rows: &'static [&'static [&'static [CornerRef]]],
    /// The ring of the top face.
    pub top: Option<usize>,
}

/// Position of a ring's vertices in the list of new vertices: vertex i has the index `n first + i stride + offset`.
#[derive(Clone, Copy)]
pub(super) struct Ring {
    pub first: usize,
    pub stride: usize,
    pub offset: usize,
}

const fn ring(first: usize) -> Ring {
    Ring {
        first,
        stride: 1,
        offset: 0,
    }
}

/// One ring of a pair whose vertices alternate in two blocks of n: `offset` 0 is the left one, 1 the right one.
const fn half(first: usize, offset: usize) -> Ring {
    Ring {
        first,
        stride: 2,
        offset,
    }
}

/// The kinds, in the order of [`Kind`].
#[rustfmt::skip]
const TABLE: [Row; 7] = [
    Row { kind: Kind::Tetrahedral, name: "tetrahedral", corners: 3, cosine: (1.0, 9.0),
        tiers: &[TierRule::Apex], rings: &[Ring { first: 0, stride: 0, offset: 0 }],
        rows: &[&[&[(0, 0), (0, 1), (1, 0)]]], top: None },
    Row { kind: Kind::Cubical, name: "cubical", corners: 4, cosine: (0.0, 1.0),
        tiers: &[TierRule::Ridge], rings: &[ring(0)],
        rows: &[&[&[(0, 0), (0, 1), (1, 1), (1, 0)]]], top: Some(1) },
    Row { kind: Kind::Octahedral, name: "octahedral", corners: 3, cosine: (-1.0, 9.0),
        tiers: &[TierRule::Slope], rings: &[ring(0)],
        rows: &[&[&[(0, 0), (0, 1), (1, 0)]], &[&[(0, 1), (1, 1), (1, 0)]]], top: Some(1) },
    Row { kind: Kind::Dodecahedral, name: "dodecahedral", corners: 5, cosine: (-1.0, 5.0),
        tiers: &[TierRule::Ridge, TierRule::Roof, TierRule::Crest], rings: &[ring(0), ring(1), ring(2)],
        rows: &[&[&[(0, 0), (0, 1), (1, 1), (2, 0), (1, 0)]],
                &[&[(1, 1), (2, 1), (3, 1), (3, 0), (2, 0)]]], top: Some(3) },
    Row { kind: Kind::Icosahedral, name: "icosahedral", corners: 3, cosine: (-5.0, 45.0),
        tiers: &[TierRule::Slope, TierRule::LowEdgePlane, TierRule::HighEdgePlane], rings: &[ring(0), ring(1), ring(2)],
        rows: &[&[&[(0, 0), (0, 1), (1, 0)]],
                &[&[(0, 0), (1, 0), (2, 0)], &[(0, 0), (2, 0), (1, -1)]],
                &[&[(1, 0), (3, 0), (2, 0)], &[(1, 0), (2, 1), (3, 0)]],
                &[&[(2, 0), (3, 0), (3, -1)]]], top: Some(3) },
    Row { kind: Kind::Cuboctahedral, name: "cuboctahedral", corners: 4, cosine: (-1.0, 3.0),
        tiers: &[TierRule::Slope, TierRule::Flank], rings: &[ring(0), ring(1)],
        rows: &[&[&[(0, 0), (0, 1), (1, 0)]],
                &[&[(0, 0), (1, 0), (2, 0), (1, -1)]],
                &[&[(1, 0), (2, 1), (2, 0)]]], top: Some(2) },
    Row { kind: Kind::SmallRhombicuboctahedral, name: "small_rhombicuboctahedral", corners: 4, cosine: (-1.0, 2.0),
        tiers: &[TierRule::Fold, TierRule::Refold, TierRule::Close],
        rings: &[half(0, 0), half(0, 1), half(2, 0), half(2, 1), ring(4)],
        rows: &[&[&[(0, 0), (0, 1), (1, 1), (2, 0)]],
                &[&[(0, 0), (2, 0), (1, 0)]],
                &[&[(2, 0), (1, 1), (3, 1), (4, 0)]],
                &[&[(1, 0), (2, 0), (4, 0), (3, 0)]],
                &[&[(4, 0), (3, 1), (5, 1), (5, 0)]],
                &[&[(3, 0), (4, 0), (5, 0)]]], top: Some(5) },
];

impl Kind {
    /// All kinds, in the order of the table.
    pub const ALL: [Self; TABLE.len()] = {
        let mut all = [Self::Tetrahedral; TABLE.len()];
        let mut i = 0;
        while i < TABLE.len() {
            all[i] = TABLE[i].kind;
            i += 1;
        }
        all
    };

    /// The properties of the kind.
    pub(super) fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// Its name in scripts.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Number of tiers.
    pub fn tiers(self) -> usize {
        self.row().tiers.len()
    }

    /// Corners of the faces of its regular solid.
    pub fn corners(self) -> usize {
        self.row().corners
    }

    /// Whether it has a top face.
    pub fn has_top(self) -> bool {
        self.row().top.is_some()
    }

    /// The dihedral angle of the regular solid in radians, exact up to rounding.
    pub fn regular_dihedral(self) -> f64 {
        let (over, square) = self.row().cosine;
        (over / square.sqrt()).acos()
    }

    /// The dihedral angle in radians, by choice, on a polygon of `n` corners.
    ///
    /// `Auto` gives equilateral pyramids acos(cot(pi/n)/sqrt 3) for n up to 5 and uniform antiprisms
    /// acos(-tan(pi/2n)/sqrt 3) for any n; elsewhere it is the regular solid's.
    pub fn dihedral(self, choice: Dihedral, n: usize) -> f64 {
        let part = std::f64::consts::PI / n as f64;
        match (choice, self) {
            (Dihedral::Degrees(degrees), _) => degrees.to_radians(),
            (Dihedral::Auto, Self::Tetrahedral) if n <= 5 => {
                (1.0 / part.tan() / 3f64.sqrt()).acos()
            }
            (Dihedral::Auto, Self::Octahedral) => (-(part / 2.0).tan() / 3f64.sqrt()).acos(),
            _ => self.regular_dihedral(),
        }
    }

    /// Corners of the new faces, for each corner of the polygon.
    pub(super) fn cap_corners(self) -> usize {
        let row = self.row();
        let sides = row.rows.iter().flat_map(|faces| faces.iter());
        sides.map(|side| side.len()).sum::<usize>() + usize::from(row.top.is_some())
    }

    /// Numbers of new vertices and of new faces on a polygon of `n` corners, without an operator.
    pub fn counts(self, n: usize) -> (usize, usize) {
        let row = self.row();
        let vertices = row.rings.iter().map(|r| match r.stride {
            0 => 1,
            _ => n,
        });
        let sides: usize = row.rows.iter().map(|faces| faces.len() * n).sum();
        (vertices.sum(), sides + usize::from(row.top.is_some()))
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Operator {
    /// All operators with their prefixes in scripts.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Truncate, "truncated"),
        (Self::Rectify, "rectified"),
        (Self::Cantellate, "cantellated"),
        (Self::Omnitruncate, "omnitruncated"),
        (Self::Snub, "snub"),
    ];

    /// The prefix of its name in scripts.
    pub fn prefix(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// All names of extrusions in scripts: the kinds, then each operator on the five kinds of Platonic solids.
pub fn names() -> Vec<String> {
    let mut names: Vec<String> = Kind::ALL.iter().map(|k| k.name().to_owned()).collect();
    for (_, prefix) in Operator::ALL {
        names.extend(Kind::ALL[..5].iter().map(|k| format!("{prefix}_{k}")));
    }
    names
}

/// The kind and operator of an extrusion's name; `None` for other words, and for an operator on one of the last two
/// kinds, which are results of operators themselves.
pub fn from_name(name: &str) -> Option<(Kind, Option<Operator>)> {
    if let Ok(kind) = Kind::from_str(name) {
        return Some((kind, None));
    }
    let (prefix, rest) = name.split_once('_')?;
    let (operator, _) = Operator::ALL.iter().find(|row| row.1 == prefix)?;
    let kind = Kind::from_str(rest).ok()?;
    Kind::ALL[..5]
        .contains(&kind)
        .then_some((kind, Some(*operator)))
}

/// A word that names no extrusion.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no extrusion is named {0:?}")]
pub struct UnknownKind(pub String);

impl FromStr for Kind {
    type Err = UnknownKind;
    fn from_str(s: &str) -> Result<Self, UnknownKind> {
        let row = TABLE.iter().find(|row| row.name == s);
        row.map(|r| r.kind).ok_or_else(|| UnknownKind(s.to_owned()))
    }
}
