//! The documents that users read: complete recipes in them run, the reference is current, lengths are kept.

use druse::pipeline::{RunOptions, plan, run};
use druse::progress::Silent;
use druse::recipe::{Recipe, reference};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn pages() -> Vec<PathBuf> {
    let folder = fs::read_dir(root().join("src/guide")).unwrap();
    let mut pages: Vec<PathBuf> = folder.map(|e| e.unwrap().path()).collect();
    pages.push(root().join("README.md"));
    pages.sort();
    pages
}

/// Fenced blocks of TOML that are whole recipes.
fn recipes(text: &str) -> Vec<String> {
    let blocks = text.split("```toml\n").skip(1);
    let blocks = blocks.filter_map(|b| b.split_once("```"));
    blocks
        .map(|b| b.0.to_owned())
        .filter(|b| b.starts_with("druse = 1"))
        .collect()
}

#[test]
fn recipes_of_the_guide_run() {
    for page in pages() {
        for text in recipes(&fs::read_to_string(&page).unwrap()) {
            let context = format!("{}:\n{text}", page.display());
            let recipe = Recipe::parse(&text, &[]).unwrap_or_else(|e| panic!("{context}\n{e}"));
            // What reads files of the user is only parsed.
            if text.contains("file = ") || text.contains("mesh = {") {
                continue;
            }
            // What is planned is run below, on larger voxels.
            if crate::is_full() {
                let options = RunOptions::default();
                plan(&recipe, &options, &Silent).unwrap_or_else(|e| panic!("{context}\n{e}"));
            }
            let place = tempfile::tempdir().unwrap();
            // Elements of a deck are whole voxels, which are twice as large here.
            let is_deck = text.contains("element_size");
            let factor = if is_deck || !crate::is_full() {
                2.0
            } else {
                1.5
            };
            let coarse = recipe.sections().band.voxel_size.resolve(recipe.scale()) * factor;
            let overrides = [format!("band.voxel_size={coarse}")];
            let recipe = Recipe::parse(&text, &overrides).unwrap();
            let options = RunOptions {
                out: Some(place.path().to_owned()),
                ..RunOptions::default()
            };
            let report =
                run(&recipe, &options, &Silent).unwrap_or_else(|e| panic!("{context}\n{e}"));
            assert!(report.solid.volume > 0.0, "{context}");
            assert!(
                report.meets_requirements(),
                "{context}\n{:#?}",
                report.requirements
            );
            let files = recipe.sections().output.len();
            assert!(
                fs::read_dir(place.path()).unwrap().count() >= files,
                "{context}"
            );
        }
    }
}

#[test]
fn every_page_of_the_guide_has_a_recipe_and_is_shown() {
    let shown = fs::read_to_string(root().join("src/guide.rs")).unwrap();
    for page in pages() {
        let name = page.file_name().unwrap().to_str().unwrap();
        if name == "README.md" {
            continue;
        }
        let text = fs::read_to_string(&page).unwrap();
        assert!(shown.contains(&format!("guide/{name}")), "{name}");
        assert!(
            ["recipe.md", "formats.md"].contains(&name) || !recipes(&text).is_empty(),
            "{name}"
        );
    }
}

#[test]
fn the_recipe_reference_is_current() {
    let path = root().join("src/guide/recipe.md");
    let (kept, made) = (fs::read_to_string(&path).unwrap(), reference());
    assert!(
        kept.trim_end() == made.trim_end(),
        "src/guide/recipe.md is not what `druse schema --reference` prints"
    );
}

#[test]
fn links_between_documents_lead_somewhere() {
    let mut documents = pages();
    documents.push(root().join("examples/README.md"));
    for page in documents {
        let text = fs::read_to_string(&page).unwrap();
        for link in text.split("](").skip(1).filter_map(|l| l.split(')').next()) {
            if link.starts_with("http") || link.starts_with('#') {
                continue;
            }
            let target = page.parent().unwrap().join(link);
            assert!(target.exists(), "{}: {link}", page.display());
        }
    }
}

#[test]
fn first_documents_are_short() {
    for (name, most) in [("README.md", 150), ("CHANGELOG.md", 60)] {
        let lines = fs::read_to_string(root().join(name))
            .unwrap()
            .lines()
            .count();
        assert!(lines <= most, "{name}: {lines} lines; at most {most}");
    }
}
