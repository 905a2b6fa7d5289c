//! Keywords that are not read: those whose geometry is not supported, misspelled ones, and all others, which cannot
//! change nodes or elements (materials, sections, constraints, steps, loads, outputs; of new versions too).

/// Keywords that make or move nodes or elements in unsupported ways.
const REFUSED_KEYWORDS: &[&str] = &[
    "NMAP",
    "IMPERFECTION",
    "IMPORT",
    "IMPORTELSET",
    "IMPORTNSET",
    "SYMMETRICMODELGENERATION",
    "MAPSOLUTION",
    "NODALDISPLACEMENT",
];

/// Keywords that are read, by which misspelled ones are found.
const READ_KEYWORDS: &[&str] = &[
    "NODE",
    "ELEMENT",
    "NSET",
    "ELSET",
    "SYSTEM",
    "NGEN",
    "NFILL",
    "NCOPY",
    "ELGEN",
    "ELCOPY",
    "PART",
    "ENDPART",
    "ASSEMBLY",
    "ENDASSEMBLY",
    "INSTANCE",
    "ENDINSTANCE",
    "INCLUDE",
];

/// Keywords without effect on geometry that look like misspelled ones.
const LOOKALIKES: &[&str] = &["ASSEMBLE"];

/// The class of a keyword that is not read.
pub(super) enum UnreadKeyword {
    /// Cannot change geometry.
    Skipped,
    /// Unsupported geometry.
    Refused,
    /// One edit away from this supported keyword.
    Misspelled(&'static str),
}

/// Classifies a keyword that is not read, in capitals without blanks and hyphens. Only keywords that are read count for
/// misspelling.
pub(super) fn classify(name: &str) -> UnreadKeyword {
    if REFUSED_KEYWORDS.contains(&name) {
        return UnreadKeyword::Refused;
    }
    let misspelled = READ_KEYWORDS.iter().find(|k| differs_by_one_edit(k, name));
    match misspelled {
        Some(near) if !LOOKALIKES.contains(&name) => UnreadKeyword::Misspelled(near),
        _ => UnreadKeyword::Skipped,
    }
}

/// Whether the words differ by one substituted, missing, added or transposed letter. The common start and end are cut
/// off; what remains is at most one letter of each, or two exchanged ones.
fn differs_by_one_edit(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let start = a.iter().zip(b).take_while(|(x, y)| x == y).count();
    let (a, b) = (&a[start..], &b[start..]);
    let end = a
        .iter()
        .rev()
        .zip(b.iter().rev())
        .take_while(|(x, y)| x == y)
        .count();
    let (a, b) = (&a[..a.len() - end], &b[..b.len() - end]);
    matches!((a, b), ([_] | [], [_] | [])) || matches!((a, b), ([p, q], [r, s]) if p == s && q == r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keywords_are_classified() {
        for name in [
            "SOLIDSECTION",
            "STEP",
            "NODEPRINT",
            "TRANSFORM",
            "ASSEMBLE",
            "EQUATION",
            "BANANA",
        ] {
            assert!(matches!(classify(name), UnreadKeyword::Skipped), "{name}");
        }
        for name in ["NMAP", "IMPERFECTION"] {
            assert!(matches!(classify(name), UnreadKeyword::Refused), "{name}");
        }
        for name in [
            "NODES",
            "NOED",
            "ELEMNT",
            "ELEMENTS",
            "ELSETS",
            "NOD",
            "INSTANCES",
            "ENDASEMBLY",
        ] {
            assert!(
                matches!(classify(name), UnreadKeyword::Misspelled(_)),
                "{name}"
            );
        }
    }
}
