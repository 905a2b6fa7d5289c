//! Element types of Abaqus and `CalculiX`, as tables.
//!
//! A type consists of a stem, the number of nodes and letters for integration and material, such as
//! C3D 20 R. Solids and faces are read; lines, points, springs, masses, connectors, rigid lines and
//! the generators of axisymmetric shells are counted and skipped; every other type is refused.

use druse_tilings::scaffold::Kind;

/// The meaning of an element type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// One of these kinds, by the number of nodes, ascending.
    Shape(&'static [Kind]),
    /// Elements without volume or surface.
    NonVolume,
}

/// The number in a type's name, and its kinds.
type Sizes = &'static [(u32, &'static [Kind])];

const SOLIDS: Sizes = &[
    (4, &[Kind::Tet4]),
    (5, &[Kind::Pyramid5]),
    (13, &[Kind::Pyramid13]),
    (6, &[Kind::Wedge6]),
    (8, &[Kind::Hex8]),
    (10, &[Kind::Tet10]),
    (15, &[Kind::Wedge15]),
    (20, &[Kind::Hex20]),
    (27, &[Kind::Hex27]),
];
/// Continuum shells, whose nodes define the thickness.
const CONTINUUM_SHELLS: Sizes = &[(6, &[Kind::Wedge6]), (8, &[Kind::Hex8])];
const FACES: Sizes = &[
    (3, &[Kind::Tri3]),
    (4, &[Kind::Quad4]),
    (6, &[Kind::Tri6]),
    (8, &[Kind::Quad8]),
    (9, &[Kind::Quad9]),
];

/// Stems, and kinds by number of nodes.
const FAMILIES: &[(&[&str], Sizes)] = &[
    (
        &[
            "C3D", "DC3D", "DCC3D", "AC3D", "FC3D", "EC3D", "EMC3D", "Q3D",
        ],
        SOLIDS,
    ),
    // F3D4 is a tetrahedron in CalculiX, but a face of a cavity in Abaqus: refused.
    (&["F3D"], CONTINUUM_SHELLS),
    (&["SC", "CSS"], CONTINUUM_SHELLS),
    (
        &[
            "S", "DS", "US", "M3D", "SFM3D", "R3D", "CPS", "CPE", "CPEG", "CAX", "CGAX", "DC2D",
            "DCC2D", "DCAX", "DCCAX", "AC2D", "ACAX", "EMC2D",
        ],
        FACES,
    ),
];

/// Names that do not follow the scheme.
const IRREGULAR_NAMES: &[(&str, &[Kind])] = &[
    ("STRI3", &[Kind::Tri3]),
    ("STRI65", &[Kind::Tri6]),
    ("S4R5", &[Kind::Quad4]),
    ("S8R5", &[Kind::Quad8]),
    ("S9R5", &[Kind::Quad9]),
    ("C3D15V", &[Kind::Wedge15, Kind::Wedge18]),
    ("C3D15VH", &[Kind::Wedge15, Kind::Wedge18]),
];

/// Types without volume or surface.
const NON_VOLUME_TYPES: &[&str] = &[
    "D", "MASS", "ROTARYI", "HEATCAP", "SPRINGA", "DASHPOTA", "GAPUNI", "GAPUNIT", "GAPCYL",
    "GAPSPHER", "DGAP", "DCOUP2D", "DCOUP3D", "DRAG2D", "DRAG3D", "JOINTC", "JOINT2D", "JOINT3D",
    "FLINK", "R2D2", "RAX2", "RB2D2", "RB3D2", "PC3D", "PD3D", "LS6", "LS3S", "DCCAX2", "DCCAX2D",
];
/// Stems of such types, followed by digits.
const NON_VOLUME_STEMS: &[&str] = &[
    "B", "PIPE", "ELBOW", "FRAME", "T2D", "T3D", "CONN2D", "CONN3D", "SPRING", "DASHPOT", "DC1D",
    "DCC1D", "AC1D", "SAX", "SAXA", "DSAX", "MAX", "MGAX", "SFMAX", "SFMGAX", "ASI", "PSI", "ITT",
    "ITS", "ISL", "IRS", "ISP", "FP2D", "FP3D", "FPC2D", "FPC3D",
];

/// The meaning of a type in capitals; `None` if unknown. Irregular names come before the scheme of stem, number and
/// letters.
pub(super) fn meaning(name: &str) -> Option<Meaning> {
    if let Some((_, kinds)) = IRREGULAR_NAMES.iter().find(|row| row.0 == name) {
        return Some(Meaning::Shape(kinds));
    }
    if NON_VOLUME_TYPES.contains(&name) {
        return Some(Meaning::NonVolume);
    }
    let front = name.trim_end_matches(|c: char| c.is_ascii_uppercase());
    let stem = front.trim_end_matches(|c: char| c.is_ascii_digit());
    let nodes: Option<u32> = front[stem.len()..].parse().ok();
    for (stems, sizes) in FAMILIES {
        if stems.contains(&stem)
            && let Some((_, kinds)) = sizes.iter().find(|s| Some(s.0) == nodes)
        {
            return Some(Meaning::Shape(kinds));
        }
    }
    let digit_follows = |rest: &str| rest.starts_with(|c: char| c.is_ascii_digit());
    let is_non_volume = NON_VOLUME_STEMS
        .iter()
        .any(|s| name.strip_prefix(s).is_some_and(digit_follows));
    is_non_volume.then_some(Meaning::NonVolume)
}

/// The permutation from Abaqus' node order to VTK order, where they differ: place i in VTK's order is the node at
/// place `order[i]` of the deck. In C3D27 the centre precedes the faces, which follow in the order bottom, top, front,
/// right, back, left.
pub(super) fn node_order(kind: Kind) -> Option<&'static [u8]> {
    const HEX27: [u8; 27] = [
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 26, 24, 23, 25, 21,
        22, 20,
    ];
    (kind == Kind::Hex27).then_some(&HEX27)
}

/// Examples of supported types for error messages.
pub(super) const KNOWN_TYPES: &str =
    "types such as C3D4, C3D10, C3D8, C3D20, C3D6, C3D15, SC8R, S3, S4, S8";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn element_types_have_their_kinds() {
        for (name, kind) in [
            ("C3D4", Kind::Tet4),
            ("C3D10M", Kind::Tet10),
            ("C3D10MHT", Kind::Tet10),
            ("C3D8R", Kind::Hex8),
            ("C3D8I", Kind::Hex8),
            ("C3D20RH", Kind::Hex20),
            ("C3D15", Kind::Wedge15),
            ("C3D6", Kind::Wedge6),
            ("DC3D8", Kind::Hex8),
            ("SC8R", Kind::Hex8),
            ("SC8RT", Kind::Hex8),
            ("SC6R", Kind::Wedge6),
            ("CSS8", Kind::Hex8),
            ("F3D8", Kind::Hex8),
            ("S4R", Kind::Quad4),
            ("S3", Kind::Tri3),
            ("S6", Kind::Tri6),
            ("S8R", Kind::Quad8),
            ("S4R5", Kind::Quad4),
            ("S9R5", Kind::Quad9),
            ("STRI65", Kind::Tri6),
            ("CGAX4R", Kind::Quad4),
            ("CPS4", Kind::Quad4),
            ("CPE6M", Kind::Tri6),
            ("M3D9R", Kind::Quad9),
            ("US3", Kind::Tri3),
        ] {
            let Some(Meaning::Shape(kinds)) = meaning(name) else {
                panic!("{name} has no shape");
            };
            assert_eq!(kinds[0], kind, "{name}");
        }
        for name in [
            "B31", "B32OS", "T3D2", "SPRINGA", "MASS", "D", "CONN3D2", "SAX1", "DASHPOT1",
        ] {
            assert_eq!(meaning(name), Some(Meaning::NonVolume), "{name}");
        }
        for name in [
            "COH3D8", "CIN3D8", "F3D4", "U1", "Z1", "GK3D8", "BANANA", "C3D", "S", "",
        ] {
            assert_eq!(meaning(name), None, "{name}");
        }
    }

    #[test]
    fn the_order_of_27_nodes_is_a_permutation() {
        let mut order = node_order(Kind::Hex27).unwrap().to_vec();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, n)| i == *n as usize));
    }
}
