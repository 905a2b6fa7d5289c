//! The Archimedean solids, made from Platonic ones, and the names of both.
//!
//! Each solid is an operator (truncate, rectify, ...) on a Platonic solid. Names are compared without case, blanks,
//! hyphens, underscores and "regular", and have synonyms; the canonical name is that of scripts.

use super::kind::{Kind, Operator};
use super::{PolyMesh, operator, seed};

/// Name, Platonic solid, kind of extrusion that makes the faces of that solid, operator.
const TABLE: [(&str, &str, Kind, Operator); 13] = {
    use Kind::{Cubical, Dodecahedral, Icosahedral, Octahedral, Tetrahedral};
    use Operator::{Cantellate, Omnitruncate, Rectify, Snub, Truncate};
    [
        (
            "truncated_tetrahedron",
            "tetrahedron",
            Tetrahedral,
            Truncate,
        ),
        ("truncated_cube", "cube", Cubical, Truncate),
        ("truncated_octahedron", "octahedron", Octahedral, Truncate),
        (
            "truncated_dodecahedron",
            "dodecahedron",
            Dodecahedral,
            Truncate,
        ),
        (
            "truncated_icosahedron",
            "icosahedron",
            Icosahedral,
            Truncate,
        ),
        ("cuboctahedron", "cube", Cubical, Rectify),
        ("icosidodecahedron", "dodecahedron", Dodecahedral, Rectify),
        ("small_rhombicuboctahedron", "cube", Cubical, Cantellate),
        (
            "small_rhombicosidodecahedron",
            "dodecahedron",
            Dodecahedral,
            Cantellate,
        ),
        ("great_rhombicuboctahedron", "cube", Cubical, Omnitruncate),
        (
            "great_rhombicosidodecahedron",
            "dodecahedron",
            Dodecahedral,
            Omnitruncate,
        ),
        ("snub_cube", "cube", Cubical, Snub),
        ("snub_dodecahedron", "dodecahedron", Dodecahedral, Snub),
    ]
};

/// Solids and their synonyms.
#[rustfmt::skip]
const SYNONYMS: [(&str, &[&str]); 16] = [
    ("tetrahedron", &["triangular pyramid"]),
    ("cube", &["hexahedron"]),
    ("octahedron", &["rectified tetrahedron", "tetratetrahedron", "square bipyramid"]),
    ("dodecahedron", &["pentagonal dodecahedron", "pentagondodecahedron"]),
    ("icosahedron", &["snub tetrahedron", "snub tetratetrahedron"]),
    ("truncated_cube", &["truncated hexahedron"]),
    ("truncated_octahedron", &[
        "omnitruncated tetrahedron", "cantitruncated tetrahedron", "truncated tetratetrahedron",
        "rhombitruncated tetratetrahedron", "bitruncated cube", "tetrakaidecahedron", "permutohedron",
    ]),
    ("truncated_icosahedron", &["buckyball", "soccer ball", "football", "buckminsterfullerene"]),
    ("cuboctahedron", &[
        "rectified cube", "rectified hexahedron", "rectified octahedron", "cantellated tetrahedron",
        "expanded tetrahedron", "rhombitetratetrahedron", "triangular gyrobicupola", "vector equilibrium",
    ]),
    ("icosidodecahedron", &[
        "rectified dodecahedron", "rectified icosahedron", "pentagonal gyrobirotunda",
    ]),
    ("small_rhombicuboctahedron", &[
        "rhombicuboctahedron", "cantellated cube", "cantellated hexahedron", "cantellated octahedron",
        "expanded cube", "expanded hexahedron", "expanded octahedron", "rectified cuboctahedron",
    ]),
    ("small_rhombicosidodecahedron", &[
        "rhombicosidodecahedron", "cantellated dodecahedron", "cantellated icosahedron",
        "expanded dodecahedron", "expanded icosahedron", "rectified icosidodecahedron",
    ]),
    ("great_rhombicuboctahedron", &[
        "truncated cuboctahedron", "rhombitruncated cuboctahedron", "omnitruncated cube",
        "omnitruncated hexahedron", "omnitruncated octahedron", "omnitruncated cuboctahedron",
        "cantitruncated cube", "cantitruncated hexahedron", "cantitruncated octahedron",
        "bevelled cube", "beveled cube",
    ]),
    ("great_rhombicosidodecahedron", &[
        "truncated icosidodecahedron", "rhombitruncated icosidodecahedron", "omnitruncated dodecahedron",
        "omnitruncated icosahedron", "omnitruncated icosidodecahedron", "cantitruncated dodecahedron",
        "cantitruncated icosahedron", "bevelled dodecahedron", "beveled dodecahedron",
    ]),
    ("snub_cube", &["snub cuboctahedron", "snub hexahedron"]),
    ("snub_dodecahedron", &["snub icosidodecahedron", "snub icosahedron"]),
];

/// Names of the Archimedean solids.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|row| row.0)
}

/// A name in a normal form: lower-case letters only, without "regular", and "rhombi" for "rhombo".
fn normal_form(name: &str) -> String {
    let letters = name.chars().filter(char::is_ascii_alphabetic);
    let letters: String = letters.map(|c| c.to_ascii_lowercase()).collect();
    let letters = letters
        .strip_prefix("regular")
        .map_or(letters.clone(), str::to_owned);
    letters.replace("rhombo", "rhombi")
}

/// All names of solids, each with its canonical name: canonical names first.
fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
    let own = seed::PLATONIC_SOLIDS.into_iter().chain(names());
    let others = SYNONYMS
        .iter()
        .flat_map(|(name, others)| others.iter().map(move |o| (*o, *name)));
    own.map(|n| (n, n)).chain(others)
}

/// The canonical name of a solid, from any of its names in any spelling; `None` for other words.
pub(super) fn canonical(name: &str) -> Option<&'static str> {
    // Digits and signs are no part of a name, though the normal form would drop them.
    let is_name = |c: char| c.is_ascii_alphabetic() || matches!(c, '_' | '-' | ' ');
    if !name.chars().all(is_name) {
        return None;
    }
    let target = normal_form(name);
    all()
        .find(|(known, _)| normal_form(known) == target)
        .map(|n| n.1)
}

/// The canonical name of the solid with the name most similar to a word; `None` where no name is within one edit and
/// one more per five letters.
pub(super) fn nearest(name: &str) -> Option<&'static str> {
    let target = normal_form(name);
    all()
        .map(|(known, own)| {
            (
                strsim::damerau_levenshtein(&normal_form(known), &target),
                known,
                own,
            )
        })
        .filter(|(distance, known, _)| *distance <= 1 + known.len() / 5)
        .min_by_key(|n| n.0)
        .map(|n| n.2)
}

/// An Archimedean solid centred on the origin with edges of this length, all faces in group 1; `None` for a name that
/// is not in the table or an edge that makes no finite mesh.
pub(super) fn solid(name: &str, edge: f64) -> Option<PolyMesh> {
    let (_, platonic, kind, operator) = TABLE.iter().find(|row| row.0 == name)?;
    let mesh = operator::on_solid(*operator, *kind, &seed::platonic(platonic, 1.0)?);
    let (a, b) = (mesh.face(0)[0] as usize, mesh.face(0)[1] as usize);
    let factor = edge / (mesh.vertices()[b] - mesh.vertices()[a]).norm();
    mesh.mapped(|v| v * factor).ok()
}
