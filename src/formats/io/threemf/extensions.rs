//! Namespaces of 3MF and its extensions: supported ones, those without effect on shapes, and unsupported ones.
//! An extension that a file requires must be supported; one that it only uses may be ignored.

/// The meaning of a namespace.
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
    /// Ignored or unsupported content: colours, groups, unknown shapes.
    Other,
}

const CORE: &str = "http://schemas.microsoft.com/3dmanufacturing/core/"; // a version follows

/// Namespaces that are supported or do not affect the shape.
const KNOWN_NAMESPACES: [(&str, Space); 8] = [
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

/// Names of families of unsupported extensions, by a part of their namespaces.
const UNSUPPORTED_FAMILIES: [(&str, &str); 7] = [
    ("/securecontent/", "secure content (encrypted parts)"),
    ("/booleanoperations/", "boolean operations"),
    ("/displacement/", "displacement"),
    ("/volumetric/", "volumetric content"),
    ("/implicit/", "implicit shapes"),
    ("/beamlattice/", "a beam lattice of another version"),
    ("/slice/", "slices of another version"),
];

/// The meaning of a namespace; elements without namespace belong to the core format.
pub(super) fn space(namespace: Option<&[u8]>) -> Space {
    let Some(namespace) = namespace else {
        return Space::Core;
    };
    if namespace.starts_with(CORE.as_bytes()) {
        return Space::Core;
    }
    let known = KNOWN_NAMESPACES
        .iter()
        .find(|k| k.0.as_bytes() == namespace);
    known.map_or(Space::Other, |k| k.1)
}

/// The name of a required extension, by its namespace, that is not supported; `None` if it is supported.
pub(super) fn unsupported_extension(namespace: &str) -> Option<String> {
    if namespace.starts_with(CORE) || KNOWN_NAMESPACES.iter().any(|k| k.0 == namespace) {
        return None;
    }
    Some(extension_name(namespace))
}

/// The name of an unsupported extension, by its namespace, for messages.
pub(super) fn extension_name(namespace: &str) -> String {
    let family = UNSUPPORTED_FAMILIES
        .iter()
        .find(|r| namespace.contains(r.0));
    let words = family.map_or("an unknown extension", |r| r.1);
    format!("{words} ({})", super::display_name(namespace))
}

/// The supported extensions, for a message.
pub(super) const SUPPORTED_EXTENSIONS: &str = "the supported extensions: production, alternatives, beam lattice \
                               with balls, materials, triangle sets, slices beside a mesh";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_recognised_by_namespace() {
        assert_eq!(space(None), Space::Core);
        let core = b"http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
        assert_eq!(space(Some(core)), Space::Core);
        for (namespace, expected) in KNOWN_NAMESPACES {
            assert_eq!(space(Some(namespace.as_bytes())), expected);
            assert_eq!(unsupported_extension(namespace), None);
        }
        let later = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2031/01";
        assert_eq!(space(Some(later.as_bytes())), Space::Other);
        assert!(
            unsupported_extension(later)
                .unwrap()
                .contains("another version")
        );
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
            assert!(
                unsupported_extension(family).unwrap().contains(words),
                "{family}"
            );
        }
    }
}
