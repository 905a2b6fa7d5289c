//! Finite-element decks of parts: counts and volumes in closed form, in memory and in bricks.

use druse::pipeline::{Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::collections::BTreeMap;
use std::path::Path;

fn make(text: &str, bricks: Option<u32>, out: &Path) -> Result<Report, RunError> {
    let recipe = Recipe::parse(text, &[])?;
    let options = RunOptions {
        out: Some(out.to_owned()),
        brief: true,
        threads: 2,
        bricks,
        ..RunOptions::default()
    };
    run(&recipe, &options, &Silent)
}

/// Nodes, elements and sets of a deck, by a parser of its own.
struct Deck {
    nodes: BTreeMap<u64, [f64; 3]>,
    elements: Vec<Vec<u64>>,
    sets: BTreeMap<String, Vec<u64>>,
}

fn parse(path: &Path) -> Deck {
    let text = std::fs::read_to_string(path).unwrap();
    let mut deck = Deck {
        nodes: BTreeMap::new(),
        elements: Vec::new(),
        sets: BTreeMap::new(),
    };
    let mut keyword = String::new();
    for line in text.lines() {
        if line.starts_with('*') {
            line.clone_into(&mut keyword);
            continue;
        }
        let words: Vec<&str> = line
            .split(',')
            .map(str::trim)
            .filter(|w| !w.is_empty())
            .collect();
        if keyword.starts_with("*NODE,") {
            let at = [1, 2, 3].map(|n| words[n].parse::<f64>().unwrap());
            deck.nodes.insert(words[0].parse().unwrap(), at);
        } else if keyword.starts_with("*ELEMENT,") {
            let nodes = words[1..].iter().map(|w| w.parse::<u64>().unwrap());
            deck.elements.push(nodes.collect());
        } else if let Some((_, name)) = keyword
            .split_once("SET=")
            .filter(|_| keyword.contains("SET, "))
        {
            let numbers = words.iter().map(|w| w.parse::<u64>().unwrap());
            deck.sets
                .entry(name.to_owned())
                .or_default()
                .extend(numbers);
        }
    }
    deck
}

/// Volume of an element by its corners: the determinant of its edges at node 1.
fn volume(deck: &Deck, element: &[u64]) -> f64 {
    let p = |n: usize| deck.nodes[&element[n]];
    let edge = |n: usize| [0, 1, 2].map(|a| p(n)[a] - p(0)[a]);
    let ([a, b, c], [d, e, f], [g, h, i]) = (edge(1), edge(3), edge(4));
    a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
}

const BLOCK: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.25\n\
                     [[op]]\nunion = { box = { size = [10, 4, 3], centre = [5, 2, 1.5] } }\n";

#[test]
fn a_box_gives_its_elements_with_nodes_and_sides() {
    let place = tempfile::tempdir().unwrap();
    let text = format!(
        "{BLOCK}[[output]]\nfe = \"a.inp\"\nkind = \"hex8\"\nelement_size = 0.5\nyoung = 2100\n"
    );
    let report = make(&text, None, place.path()).unwrap();
    let deck = parse(&place.path().join("a.inp"));
    assert_eq!(deck.elements.len(), 20 * 8 * 6);
    assert_eq!(deck.nodes.len(), 21 * 9 * 7);
    let facts = report.outputs[0].deck.unwrap();
    assert_eq!((facts.nodes, facts.elements), (21 * 9 * 7, 20 * 8 * 6));
    for element in &deck.elements {
        assert!((volume(&deck, element) - 0.125).abs() < 1e-9);
    }
    let ends = |axis: usize| {
        let along = deck.nodes.values().map(|p| p[axis]);
        along.fold([f64::MAX, f64::MIN], |r, x| [r[0].min(x), r[1].max(x)])
    };
    for (axis, size) in [10.0, 4.0, 3.0].into_iter().enumerate() {
        let [low, high] = ends(axis);
        assert!(
            (high - low - size).abs() < 1e-9 && low.abs() < 1e-9,
            "{axis}: {low} {high}"
        );
    }
    let counts = ["XMIN", "XMAX", "YMIN", "ZMAX"].map(|s| deck.sets[s].len());
    assert_eq!(counts, [9 * 7, 9 * 7, 21 * 7, 21 * 9]);
    assert_eq!(deck.sets["YMAX_ELEMENTS"].len(), 20 * 6);
    let low = ends(0)[0];
    assert!(
        deck.sets["XMIN"]
            .iter()
            .all(|n| (deck.nodes[n][0] - low).abs() < 1e-9)
    );
}

#[test]
fn a_ball_keeps_its_volume_and_bricks_change_nothing() {
    let ball = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n\
                [[op]]\nunion = { sphere = { centre = [1.03, 0.02, -0.05], radius = 4 } }\n";
    for (size, tolerance) in [(0.1, 1e-3), (0.3, 5e-3), (0.8, 0.05)] {
        let text = format!(
            "{ball}[[output]]\nfe = \"a.inp\"\nkind = \"hex8\"\nelement_size = {size}\nunit = \"cm\"\n"
        );
        let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let report = make(&text, None, whole.path()).unwrap();
        let facts = report.outputs[0].deck.unwrap();
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.4f64.powi(3);
        assert!(
            (facts.volume / exact - 1.0).abs() < tolerance,
            "{size}: {} for {exact}",
            facts.volume
        );
        assert_eq!(facts.dropped_elements, 0);
        make(&text, Some(1), parts.path()).unwrap();
        let read = |d: &tempfile::TempDir| std::fs::read(d.path().join("a.inp")).unwrap();
        assert!(
            read(&whole) == read(&parts),
            "{size}: bricks give other bytes"
        );
    }
}

#[test]
fn loose_components_are_left_out_with_a_warning() {
    let place = tempfile::tempdir().unwrap();
    let text = format!(
        "{BLOCK}[[op]]\nunion = {{ box = {{ size = [1, 1, 1], centre = [12.5, 0.5, 0.5] }} }}\n\
         [[output]]\nfe = \"a.inp\"\nkind = \"hex8\"\n"
    );
    let report = make(&text, None, place.path()).unwrap();
    let facts = report.outputs[0].deck.unwrap();
    assert_eq!(
        (facts.dropped_components, facts.dropped_elements > 0),
        (1, true)
    );
    let warning = report.warnings.iter().find(|w| w.code == "W118");
    assert!(
        warning.is_some_and(|w| w.message.contains("left out")),
        "{:?}",
        report.warnings
    );
}

#[test]
fn bad_keys_of_a_deck_are_refused() {
    for (keys, words) in [
        ("", "expected kind = \"hex8\""),
        (
            "kind = \"hex8\"\nelement_size = 0.3\n",
            "such as 0.25 or 0.5",
        ),
        (
            "kind = \"hex8\"\nelement_size = 0.1\n",
            "whole number of voxels",
        ),
        ("kind = \"hex8\"\npoisson = 0.6\n", "below 0.5"),
        ("kind = \"tet10\"\n", "hex8"),
        (
            "kind = \"hex8\"\nquads = true\n",
            "quads belongs to an output with mesh",
        ),
    ] {
        let text = format!("{BLOCK}[[output]]\nfe = \"a.inp\"\n{keys}");
        let error = Recipe::parse(&text, &[]).unwrap_err().to_string();
        assert!(error.contains(words), "{keys}: {error}");
    }
    let mesh = format!("{BLOCK}[[output]]\nmesh = \"a.stl\"\nelement_size = 0.5\n");
    let error = Recipe::parse(&mesh, &[]).unwrap_err().to_string();
    assert!(
        error.contains("element_size belongs to an output with fe"),
        "{error}"
    );
}
