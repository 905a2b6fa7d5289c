//! The Archimedean solids as operators on Platonic ones, with edges of equal length.

use super::kind::{Kind, Operator};
use super::{PolyMesh, operator, seed};

/// Name, Platonic solid, the kind that makes it, operator.
const TABLE: [(&str, &str, Kind, Operator); 15] = {
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
        ("rhombicuboctahedron", "cube", Cubical, Cantellate),
        (
            "small_rhombicosidodecahedron",
            "dodecahedron",
            Dodecahedral,
            Cantellate,
        ),
        (
            "rhombicosidodecahedron",
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

/// Names of the Archimedean solids; two have a short form as well.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|row| row.0)
}

/// An Archimedean solid about the origin.
pub(super) fn solid(name: &str, edge: f64) -> Option<PolyMesh> {
    let (_, platonic, kind, operator) = TABLE.iter().find(|row| row.0 == name)?;
    let mesh = operator::on_solid(*operator, *kind, &seed::platonic(platonic, 1.0)?);
    let (a, b) = (mesh.face(0)[0] as usize, mesh.face(0)[1] as usize);
    let factor = edge / (mesh.vertices()[b] - mesh.vertices()[a]).norm();
    mesh.mapped(|v| v * factor).ok()
}
