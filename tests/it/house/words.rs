//! Words that the tree avoids: names, constants, text and file heads that a newcomer would stumble over.

use super::{files, root};
use regex::Regex;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Parts of names: metaphors, and verbs of speech for computation.
const NAME_PARTS: &str = "told asked asks ask stock desk fence shore shores stray strays astray seat seats \
    seated trail trails crowd crowded hope hopeless ears ear sieve sifted foretold foretell reckon hair \
    patience doubt vouch wish wished";

/// Bare adjectives, participles and numbers: a constant is a noun with its unit or role.
const CONSTANTS: &str = "MANY FEW FEWEST MOST LEAST LARGEST GREATEST SMALLEST LONGEST DEEPEST WIDEST THINNEST \
    SHARPEST STEEPEST FINEST FURTHEST FARTHEST NONE EACH EVERY ANY ALWAYS NOTHING NOWHERE TOGETHER APART \
    ASIDE AHEAD BEHIND BEYOND BESIDE BELOW ALONG ACROSS AROUND AGAIN WITHIN BETWEEN TOWARDS NEAR FAR FINE FLAT \
    FULL HALF WHOLE GOOD LITTLE MUCH MORE FURTHER EQUAL SAME FREE THIN WIDE FAST QUICK SMOOTH STRAIGHT \
    SUSPECT MISSING ABSENT LEFT LAST FIRST UPPER TOLD TRIED WORTH HOPE HOPELESS KEPT NAMED REFUSED SHORTENED \
    SETTLED SEARCHED SIFTED DROPPED DRAWN CROWDED UNTANGLED WATCHED WANTED REMEMBERED SHOWN READ MADE CUT \
    HALVED PASSED CHECKED SKIPPED UNLIKELY UNFOLDED TURNED ADDED MULTIPLE CLEAR CLOSE ROUNDED EXPECTED THREE \
    SINGLE OWN OTHERS OPPOSITE ABSOLUTE RELATIVE CONVERGED CONTINUOUS KNOWN PARALLEL SINGULAR IRREGULAR DOUBT \
    BULGE HAIR PATIENCE GRAIN SKY INK";

/// Prefixes of limits, and what to write instead.
const LIMIT_PREFIXES: [(&str, &str); 6] = [
    ("MOST_", "MAX_"),
    ("GREATEST_", "MAX_"),
    ("LARGEST_", "MAX_"),
    ("LEAST_", "MIN_"),
    ("FEWEST_", "MIN_"),
    ("SMALLEST_", "MIN_"),
];

/// Phrases of comments, documentation and messages.
const PHRASES: &[&str] = &[
    r"(is|are|be|was|were|been) told",
    r"told (by|apart|from|with)",
    r"tells? apart",
    r"asked",
    r"asks",
    r"look(s|ed|ing)? at",
    r"reckon\w*",
    r"fore(told|tell)",
    r"own hands?",
    r"strays?",
    r"shores?",
    r"seat(s|ed)?",
    r"crowd(s|ed)?",
    r"hope(s|d|less)?",
    r"trails?",
    r"fences?",
    r"desks?",
    r"in stock",
    r"of which",
    r"says",
    r"said",
    r"vouch\w*",
    r"nobody",
    r"somebody",
    r"hangs? together",
    r"serves again",
    r"put together",
    r"what came",
    r"what is left",
    r"sieved?",
    r"for ever",
    r"manners?",
    r"hair",
    r"patience",
];

/// Lines of a file head.
const MAX_HEAD_LINES: usize = 15;

/// The files whose words are checked; this one holds the words.
fn checked() -> Vec<PathBuf> {
    let mut all = Vec::new();
    for folder in ["src", "cpp", "tests/it", "tests/bench", "examples"] {
        all.extend(files(&root().join(folder), &["rs", "cc", "h", "py"]));
    }
    all.retain(|path| !path.ends_with("house/words.rs"));
    all
}

/// One line for each violation that `find` reports, with its place.
fn violations(paths: &[PathBuf], find: impl Fn(&Path, &str) -> Option<String>) -> Vec<String> {
    let mut all = Vec::new();
    for path in paths {
        let text = fs::read_to_string(path).unwrap();
        for (i, line) in text.lines().enumerate() {
            if let Some(word) = find(path, line) {
                let relative = path.strip_prefix(root()).unwrap().display();
                all.push(format!("{relative}:{}: {word}", i + 1));
            }
        }
    }
    all
}

/// The parts of a name: `take_seat` and `TakeSeat` are both take, seat.
fn parts(name: &str) -> Vec<String> {
    let mut all = vec![String::new()];
    let mut lower = false;
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && lower) {
            all.push(String::new());
        }
        lower = c.is_lowercase() || c.is_numeric();
        if c != '_' {
            all.last_mut().unwrap().extend(c.to_lowercase());
        }
    }
    all
}

#[test]
fn names_are_free_of_metaphors() {
    let banned: BTreeSet<&str> = NAME_PARTS.split_whitespace().collect();
    let literal = Regex::new(r#""([^"\\]|\\.)*""#).unwrap();
    let name = Regex::new("[A-Za-z_][A-Za-z0-9_]*").unwrap();
    let found = violations(&checked(), |_, line| {
        let code = line.split("//").next().unwrap();
        let code = literal.replace_all(code, "\"\"");
        let mut names = name.find_iter(&code).map(|m| m.as_str());
        let bad = |n: &&str| parts(n).iter().any(|p| banned.contains(p.as_str()));
        names.find(bad).map(str::to_owned)
    });
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn constants_are_nouns() {
    let banned: BTreeSet<&str> = CONSTANTS.split_whitespace().collect();
    let constant = Regex::new(r"\bconst ([A-Z][A-Z0-9_]*)\s*:").unwrap();
    let found = violations(&checked(), |_, line| {
        let name = constant.captures(line)?.get(1)?.as_str();
        if banned.contains(name) {
            return Some(name.to_owned());
        }
        let (old, new) = LIMIT_PREFIXES.iter().find(|(p, _)| name.starts_with(p))?;
        Some(format!("{name}; write {new} for {old}"))
    });
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn text_is_plain() {
    let phrases = Regex::new(&format!(r"(?i)\b({})\b", PHRASES.join("|"))).unwrap();
    let mut paths = checked();
    paths.extend(files(&root().join("src/guide"), &["md"]));
    paths.extend(files(&root().join("examples"), &["md"]));
    paths.extend(["README.md", "CHANGELOG.md"].map(|name| root().join(name)));
    // Keys of reports stay as users know them.
    let is_key = |line: &str| line.contains("serde(rename = ");
    let found = violations(&paths, |_, line| {
        let found = phrases.find(line).filter(|_| !is_key(line));
        found.map(|m| m.as_str().to_owned())
    });
    assert!(found.is_empty(), "{found:#?}");
}

/// Lines of a file head outside its examples.
fn head_lines(text: &str) -> usize {
    let mut in_example = false;
    let head = text.lines().take_while(|l| l.starts_with("//!"));
    head.filter(|l| {
        let is_fence = l.contains("```");
        in_example ^= is_fence;
        !in_example && !is_fence
    })
    .count()
}

#[test]
fn every_file_begins_with_its_purpose() {
    let mut wrong = Vec::new();
    for path in files(&root().join("src"), &["rs"]) {
        let text = fs::read_to_string(&path).unwrap();
        let first = text.lines().next().unwrap_or_default();
        let sentence = first.strip_prefix("//! ").unwrap_or_default();
        let head = head_lines(&text);
        let is_tour = path.ends_with("src/lib.rs") || path.ends_with("src/guide.rs");
        let long = head > MAX_HEAD_LINES && !is_tour;
        if sentence.split_whitespace().count() < 3 && !sentence.starts_with('`') || long {
            wrong.push(format!(
                "{}: {head} lines, begins {first:?}",
                path.display()
            ));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
