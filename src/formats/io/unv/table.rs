//! Element types of universal files and their node orders: corners and mid nodes alternate round each face.
//! A permutation lists, for each node in the order of VTK, its place in the file.

use druse_tilings::scaffold::Kind;

/// A row: types, kind, and the permutation from the file's node order to VTK order (empty for the identity).
type Row = (&'static [i64], Kind, &'static [u8]);

const TRI6: &[u8] = &[0, 2, 4, 1, 3, 5];
const QUAD8: &[u8] = &[0, 2, 4, 6, 1, 3, 5, 7];
const TET10: &[u8] = &[0, 2, 4, 9, 1, 3, 5, 6, 7, 8];
const WEDGE15: &[u8] = &[0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8];
const HEX20: &[u8] = &[
    0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11,
];

/// Plane stress, plane strain, plates, membranes, bodies of revolution, thin shells; thick shells, solids.
pub(super) const ELEMENT_TYPES: &[Row] = &[
    (&[41, 51, 61, 74, 81, 91], Kind::Tri3, &[]),
    (&[42, 52, 62, 72, 82, 92], Kind::Tri6, TRI6),
    (&[44, 54, 64, 71, 84, 94], Kind::Quad4, &[]),
    (&[45, 55, 65, 75, 85, 95], Kind::Quad8, QUAD8),
    (&[101, 112], Kind::Wedge6, &[]),
    (&[102, 113], Kind::Wedge15, WEDGE15),
    (&[104, 115], Kind::Hex8, &[]),
    (&[105, 116], Kind::Hex20, HEX20),
    (&[111], Kind::Tet4, &[]),
    (&[118], Kind::Tet10, TET10),
];

/// Types with an additional line for the orientation.
pub(super) const BEAM_TYPES: &[i64] = &[11, 21, 22, 23, 24];

/// Rods and beams; rigid elements, springs, dampers, gaps, masses; constraints and flow of plastics.
pub(super) const LINE_TYPES: &[std::ops::RangeInclusive<i64>] =
    &[11..=11, 21..=24, 121..=161, 171..=181, 191..=222];
