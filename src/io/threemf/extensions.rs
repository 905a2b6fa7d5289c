//! Namespaces of 3MF and its extensions: what is read, what does not change a shape, what is refused.

/// What a namespace stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    /// The format itself.
    Core,
    /// References to other parts of the archive.
    Production,
    /// Several resolutions of one object.
    Alternatives,
    /// Beams, and the balls of their later version.
    Beams,
    /// Layers instead of a mesh.
    Slices,
    /// Nothing that is read: colours, groups, or a shape that is unknown.
    Other,
}

const CORE: &str = "http://schemas.microsoft.com/3dmanufacturing/core/";

/// Namespaces that are read, or that leave the shape as it is.
const KNOWN: [(&str, Space); 8] = [
    (
        "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
        Space::Production,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/production/alternatives/2021/04",
        Space::Alternatives,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02",
        Space::Beams,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07",
        Space::Beams,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07",
        Space::Slices,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
        Space::Other,
    ),
    (
        "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
        Space::Other,
    ),
    ("http://www.w3.org/XML/1998/namespace", Space::Other),
];

/// Words for families of extensions that are not read, by what their namespaces contain.
const REFUSED: [(&str, &str); 7] = [
    ("/securecontent/", "secure content (encrypted parts)"),
    ("/booleanoperations/", "boolean operations"),
    ("/displacement/", "displacement"),
    ("/volumetric/", "volumetric content"),
    ("/implicit/", "implicit shapes"),
    ("/beamlattice/", "a beam lattice of another version"),
    ("/slice/", "slices of another version"),
];

/// What a namespace stands for; elements without one are taken for the format's own.
pub(super) fn space(namespace: Option<&[u8]>) -> Space {
    let Some(namespace) = namespace else {
        return Space::Core;
    };
    if namespace.starts_with(CORE.as_bytes()) {
        return Space::Core;
    }
    let known = KNOWN.iter().find(|k| k.0.as_bytes() == namespace);
    known.map_or(Space::Other, |k| k.1)
}

/// Why a model that requires this namespace is not read: the extension in words; `None` if it is read.
pub(super) fn refusal(namespace: &str) -> Option<String> {
    if namespace.starts_with(CORE) || KNOWN.iter().any(|k| k.0 == namespace) {
        return None;
    }
    Some(named(namespace))
}

/// An extension that is not read, in words.
pub(super) fn named(namespace: &str) -> String {
    let family = REFUSED.iter().find(|r| namespace.contains(r.0));
    let words = family.map_or("an unknown extension", |r| r.1);
    format!("{words} ({})", super::short(namespace))
}

/// The extensions that are read, for a message.
pub(super) const READ: &str = "the extensions that are read: production, alternatives, beam lattice \
                               with balls, materials, triangle sets, slices beside a mesh";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_told_by_namespace_not_by_prefix() {
        assert_eq!(space(None), Space::Core);
        let core = b"http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
        assert_eq!(space(Some(core)), Space::Core);
        for (namespace, expected) in KNOWN {
            assert_eq!(space(Some(namespace.as_bytes())), expected);
            assert_eq!(refusal(namespace), None);
        }
        let later = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2031/01";
        assert_eq!(space(Some(later.as_bytes())), Space::Other);
        assert!(refusal(later).unwrap().contains("another version"));
        for (family, words) in [
            (
                "http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07",
                "boolean",
            ),
            (
                "http://schemas.3mf.io/3dmanufacturing/displacement/2023/10",
                "displacement",
            ),
            (
                "http://schemas.microsoft.com/3dmanufacturing/securecontent/2019/07",
                "encrypted",
            ),
            (
                "http://schemas.3mf.io/3dmanufacturing/implicit/2023/12",
                "implicit",
            ),
            ("http://example.com/q", "http://example.com/q"),
        ] {
            assert!(refusal(family).unwrap().contains(words), "{family}");
        }
    }
}
