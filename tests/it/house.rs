//! The house's own rules: who may use whom, how long a file may be, where `unsafe` stands.

mod rooms;
mod words;

use regex::Regex;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The crates in folders of `src`. Cargo keeps the walls between them.
const CRATES: [&str; 7] = [
    "geometry",
    "cells",
    "tilings",
    "effective",
    "crystal",
    "formats",
    "solids",
];

/// Lines of Rust with comments that a folder of `src` may have. Who needs more raises its number in the same commit, and
/// gives the reason there.
const LINE_BUDGETS: [(&str, usize); 14] = [
    ("geometry", 13723),
    ("cells", 18315),
    ("tilings", 33525),
    ("effective", 8950),
    ("crystal", 8250),
    ("formats", 20626),
    ("solids", 5820),
    ("vdb", 12175),
    ("recipe", 5650),
    ("pipeline", 24171),
    ("cli", 15579),
    ("sequence", 350),
    ("python", 2550),
    ("", 1152),
];

/// Modules and what each may use; the first six use nothing.
const MAY_USE: &[(&str, &[&str])] = &[
    ("frame", &[]),
    ("progress", &[]),
    ("union_find", &[]),
    ("fourier", &[]),
    ("simd", &[]),
    ("sequence", &[]),
    ("field", &["frame", "simd"]),
    (
        "mesh",
        &["frame", "field", "simd", "progress", "union_find"],
    ),
    ("symmetry", &[]),
    (
        "cell",
        &[
            "symmetry",
            "field",
            "mesh",
            "frame",
            "progress",
            "union_find",
            "fourier",
            "simd",
        ],
    ),
    (
        "scaffold",
        &["frame", "simd", "mesh", "progress", "union_find"],
    ),
    (
        "tiling",
        &[
            "cell",
            "scaffold",
            "field",
            "frame",
            "mesh",
            "union_find",
            "simd",
        ],
    ),
    (
        "polymesh",
        &["mesh", "scaffold", "frame", "progress", "symmetry"],
    ),
    ("beams", &["field", "frame", "simd", "mesh", "scaffold"]),
    (
        "homogenize",
        &[
            "beams", "cell", "field", "fourier", "frame", "simd", "progress",
        ],
    ),
    (
        "inverse",
        &[
            "cell",
            "field",
            "frame",
            "homogenize",
            "progress",
            "symmetry",
        ],
    ),
    ("band", &["field", "frame", "progress", "simd"]),
    ("slice", &["field", "frame"]),
    ("voxel_mask", &["frame", "simd"]),
    ("leaf_source", &["band", "frame", "progress"]),
    ("dense", &["band", "frame", "leaf_source"]),
    (
        "cavities",
        &[
            "band",
            "dense",
            "frame",
            "leaf_source",
            "mesh",
            "progress",
            "simd",
            "union_find",
            "voxel_mask",
        ],
    ),
    (
        "layers",
        &[
            "band",
            "dense",
            "frame",
            "leaf_source",
            "progress",
            "union_find",
        ],
    ),
    (
        "mesher",
        &["field", "frame", "simd", "mesh", "band", "progress"],
    ),
    (
        "vdb",
        &[
            "frame",
            "field",
            "mesh",
            "mesher",
            "band",
            "simd",
            "progress",
            "union_find",
            "cavities",
            "dense",
            "layers",
            "leaf_source",
            "voxel_mask",
        ],
    ),
    ("io", &["mesh", "scaffold", "cell", "frame", "polymesh"]),
    (
        "recipe",
        &[
            "frame", "progress", "field", "mesh", "cell", "scaffold", "tiling", "band", "polymesh",
            "sequence",
        ],
    ),
    (
        "pipeline",
        &[
            "beams",
            "frame",
            "simd",
            "progress",
            "field",
            "mesh",
            "cell",
            "scaffold",
            "tiling",
            "homogenize",
            "inverse",
            "band",
            "mesher",
            "slice",
            "vdb",
            "io",
            "recipe",
            "symmetry",
            "polymesh",
            "sequence",
        ],
    ),
    (
        "cli",
        &[
            "frame",
            "simd",
            "progress",
            "field",
            "mesh",
            "cell",
            "scaffold",
            "slice",
            "vdb",
            "io",
            "recipe",
            "pipeline",
            "symmetry",
            "polymesh",
            "sequence",
            "homogenize",
            "inverse",
        ],
    ),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files below a folder with one of the extensions.
fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path
                .extension()
                .is_some_and(|e| extensions.iter().any(|x| e == *x))
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The text without comments and doc tests, where other modules may be named.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let kept = text.lines().filter(|l| !l.trim_start().starts_with("//"));
    kept.collect::<Vec<_>>().join("\n")
}

/// Names that follow `crate::` or the name of one of our crates, groups in braces included.
fn used(code: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let crates = Regex::new(r"\b(crate|druse_\w+)::").unwrap();
    for rest in crates.split(code).skip(1) {
        let word = |s: &str| -> String {
            s.trim_start()
                .chars()
                .take_while(|c| c.is_alphanumeric() || *c == '_')
                .collect()
        };
        if let Some(group) = rest.strip_prefix('{') {
            let group = &group[..group.find('}').unwrap_or(group.len())];
            names.extend(group.split(',').map(word));
        } else {
            names.insert(word(rest));
        }
    }
    names
}

#[test]
fn modules_use_only_what_stands_below_them() {
    let source = root().join("src");
    let mut wrong = Vec::new();
    for path in files(&source, &["rs"]) {
        let relative = path.strip_prefix(&source).unwrap();
        let mut folders = relative.iter().map(|part| part.to_str().unwrap());
        let mut first = folders.next().unwrap();
        if CRATES.contains(&first) {
            first = folders.next().unwrap();
        }
        let module = first.trim_end_matches(".rs");
        // The Python module is a crate of its own, which sees the public interface alone.
        if matches!(module, "lib" | "main" | "guide" | "python") {
            continue;
        }
        let (_, allowed) = MAY_USE
            .iter()
            .find(|(m, _)| *m == module)
            .unwrap_or_else(|| panic!("module {module} is not in the list"));
        for name in used(&code(&path)) {
            let module_name = MAY_USE.iter().any(|(m, _)| *m == name);
            if module_name && name != module && !allowed.contains(&name.as_str()) {
                wrong.push(format!("{} uses {name}", relative.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn folders_keep_their_budgets_of_lines() {
    let source = root().join("src");
    let mut total = 0;
    for (folder, budget) in LINE_BUDGETS {
        let paths = match folder {
            // The files beside the folders.
            "" => fs::read_dir(&source)
                .unwrap()
                .map(|e| e.unwrap().path())
                .filter(|p| p.is_file())
                .collect(),
            _ => files(&source.join(folder), &["rs"]),
        };
        let lines = |path: &PathBuf| fs::read_to_string(path).unwrap().lines().count();
        let lines: usize = paths.iter().map(lines).sum();
        assert!(
            lines <= budget,
            "src/{folder}: {lines} lines; expected at most {budget}"
        );
        total += lines;
    }
    let all: usize = files(&source, &["rs"])
        .iter()
        .map(|p| fs::read_to_string(p).unwrap().lines().count())
        .sum();
    assert_eq!(total, all, "a folder of src has no budget");
}

#[test]
fn files_have_at_most_800_lines() {
    let folders = ["src", "cpp", "tests", "examples"];
    let long: Vec<String> = folders
        .iter()
        .map(|f| root().join(f))
        .filter(|f| f.exists())
        .flat_map(|f| files(&f, &["rs", "cc", "h", "py", "js", "html", "css"]))
        .filter_map(|path| {
            let lines = fs::read_to_string(&path).unwrap().lines().count();
            (lines > 800).then(|| format!("{}: {lines}", path.display()))
        })
        .collect();
    assert!(long.is_empty(), "{long:#?}");
}

/// The Python module stands on the public interface, and its version is that of the library.
#[test]
fn the_python_module_is_a_crate_of_its_own() {
    let manifest = |path: &str| fs::read_to_string(root().join(path)).unwrap();
    let own = manifest("src/python/Cargo.toml");
    assert!(own.contains("version.workspace = true"), "{own}");
    assert!(own.contains("unsafe_code = \"deny\""), "{own}");
    for path in files(&root().join("src/python"), &["rs"]) {
        let hidden = ["druse::simd", "druse::slice"];
        let text = code(&path);
        assert!(
            hidden.iter().all(|name| !text.contains(name)),
            "{}",
            path.display()
        );
    }
}

/// A unit test is compiled with all that it reaches: of a run that is the whole program, a second time.
#[test]
fn unit_tests_run_no_recipes() {
    for path in files(&root().join("src"), &["rs"]) {
        let text = fs::read_to_string(&path).unwrap();
        let tests = text.split_once("#[cfg(test)]").map_or("", |(_, t)| t);
        for word in ["RunOptions", "cli::"] {
            assert!(
                !tests.contains(word),
                "{}: {word} in a unit test; put it in tests/it",
                path.display()
            );
        }
    }
}

#[test]
fn unsafe_stands_only_in_the_bridge() {
    for path in files(&root().join("src"), &["rs"]) {
        let bridge = path.ends_with("vdb/ffi.rs");
        let text = code(&path);
        let has = text.contains("unsafe ") || text.contains("allow(unsafe_code)");
        assert!(bridge || !has, "{}", path.display());
    }
}

#[test]
fn the_top_level_is_fixed() {
    let allowed = [
        "Cargo.toml",
        "Cargo.lock",
        "build.rs",
        "src",
        "cpp",
        "tests",
        "examples",
        "README.md",
        "CHANGELOG.md",
        "LICENSE",
        "pyproject.toml",
    ];
    // What users make beside it, such as the quickstart's `out`, is not part of the tree.
    let listing = std::process::Command::new("git")
        .args(["ls-files", "-z"])
        .current_dir(root())
        .output()
        .expect("git lists the tree");
    assert!(listing.status.success(), "git ls-files failed");
    let listing = String::from_utf8(listing.stdout).unwrap();
    assert!(!listing.is_empty(), "git lists no file");
    for path in listing.split_terminator('\0') {
        let name = path.split('/').next().unwrap();
        let dot = name.starts_with('.');
        assert!(dot || allowed.contains(&name), "{path}");
    }
}

#[test]
fn nothing_is_left_to_do() {
    let marks = [
        "TO".to_owned() + "DO",
        "FIX".to_owned() + "ME",
        "todo".to_owned() + "!(",
    ];
    for folder in ["src", "cpp", "tests"] {
        for path in files(&root().join(folder), &["rs", "cc", "h", "py"]) {
            let text = fs::read_to_string(&path).unwrap();
            for mark in &marks {
                assert!(!text.contains(mark.as_str()), "{}: {mark}", path.display());
            }
        }
    }
}
