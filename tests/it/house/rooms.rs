//! Files of a folder point one way: what two files need of each other stands below both.
//!
//! The law draws the imports of each crate. In a folder, a file with the folder of its name is one node, and an arrow
//! leads from each node to those that it uses. The nodes are put in an order with few arrows from a lower one to a
//! higher one; any order with few of them is a proof.

use super::{code, root};
use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Greatest number of arrows up in a folder.
const MAX_ARROWS_UP: usize = 5;

/// A module's path in its crate.
type ModulePath = Vec<String>;
/// Arrows between the nodes of a folder.
type Arrows = BTreeSet<(String, String)>;

/// A module: its names in scope, each with the path that it stands for, and all paths in its code.
#[derive(Default)]
struct Module {
    names: BTreeMap<String, Vec<String>>,
    paths: Vec<Vec<String>>,
}

/// The modules of a crate.
struct Crate(BTreeMap<ModulePath, Module>);

/// The paths of a `use` tree such as `a::{b, c::d as e}`, each with its name in scope.
fn use_paths(prefix: &[String], tree: &str, found: &mut Vec<(String, Vec<String>)>) {
    let tree = tree.trim();
    let segments = |text: &str| -> Vec<String> {
        let parts = text.split("::").map(str::trim);
        parts.filter(|s| !s.is_empty()).map(str::to_owned).collect()
    };
    if let Some((head, rest)) = tree.split_once('{') {
        let prefix = [prefix, &segments(head)].concat();
        let (mut depth, mut start) = (0, 0);
        let body = &rest[..rest.rfind('}').unwrap_or(rest.len())];
        for (at, c) in body.char_indices().chain([(body.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    use_paths(&prefix, &body[start..at], found);
                    start = (at + 1).min(body.len());
                }
                _ => {}
            }
        }
        return;
    }
    let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
    let mut path = [prefix, &segments(path)].concat();
    if path.last().is_some_and(|s| s == "self") {
        path.pop();
    }
    if let Some(last) = path.last() {
        let name = if alias.is_empty() { last } else { alias.trim() };
        found.push((name.to_owned(), path));
    }
}

impl Crate {
    fn read(folder: &Path) -> Self {
        let mut modules = Self(BTreeMap::new());
        modules.add(&[], &folder.join("lib.rs"), folder);
        modules
    }

    /// Adds a module and those that it declares.
    fn add(&mut self, path: &[String], file: &Path, folder: &Path) {
        let text = code(file);
        // Unit tests may use what they test.
        let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        let mut module = Module::default();
        let uses = Regex::new(r"\buse ([^;]+);").unwrap();
        for tree in uses.captures_iter(text) {
            let mut found = Vec::new();
            use_paths(&[], &tree[1], &mut found);
            module.paths.extend(found.iter().map(|f| f.1.clone()));
            module.names.extend(found);
        }
        let rest = uses.replace_all(text, "");
        let inline = Regex::new(r"\b\w+(?:::\w+)+").unwrap();
        let inline = inline.find_iter(&rest).map(|m| m.as_str().split("::"));
        module
            .paths
            .extend(inline.map(|s| s.map(str::to_owned).collect()));
        self.0.insert(path.to_vec(), module);
        for declared in Regex::new(r"\bmod (\w+);").unwrap().captures_iter(text) {
            let name = &declared[1];
            let file = folder.join(format!("{name}.rs"));
            if file.exists() {
                let path = [path, &[name.to_owned()]].concat();
                self.add(&path, &file, &folder.join(name));
            }
        }
    }

    /// The module that defines what a path in a module leads to; `None` beyond the crate.
    fn resolve(&self, module: &[String], path: &[String], depth: usize) -> Option<ModulePath> {
        if depth > 12 {
            return None;
        }
        let mut at = module.to_vec();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|s| s == "super") {
                    at.pop();
                    rest = &rest[1..];
                }
            }
            name => {
                let child = [module, &[name.to_owned()]].concat();
                if !self.0.contains_key(&child) {
                    let known = self.0[module].names.get(name).filter(|p| *p != path)?;
                    let path = [known.as_slice(), &path[1..]].concat();
                    return self.resolve(module, &path, depth + 1);
                }
            }
        }
        while let Some(name) = rest.first() {
            let child = [at.as_slice(), std::slice::from_ref(name)].concat();
            if self.0.contains_key(&child) {
                (at, rest) = (child, &rest[1..]);
                continue;
            }
            // A name that the module exports on behalf of another one.
            if let Some(known) = self.0[&at].names.get(name) {
                let path = [known.as_slice(), &rest[1..]].concat();
                return self.resolve(&at, &path, depth + 1).or(Some(at));
            }
            break;
        }
        Some(at)
    }

    /// The arrows in each folder, between its own files and folders.
    fn arrows(&self) -> BTreeMap<ModulePath, Arrows> {
        let mut rooms: BTreeMap<ModulePath, Arrows> = BTreeMap::new();
        for (from, module) in &self.0 {
            for to in module.paths.iter().filter_map(|p| self.resolve(from, p, 0)) {
                let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
                // Between a folder's file and what is inside, either way, is no arrow.
                if let (Some(a), Some(b)) = (from.get(shared), to.get(shared)) {
                    let arrow = (a.clone(), b.clone());
                    rooms
                        .entry(from[..shared].to_vec())
                        .or_default()
                        .insert(arrow);
                }
            }
        }
        rooms
    }
}

/// The arrows up in an order of the nodes, users first, that has few of them.
fn arrows_up(arrows: &Arrows) -> Vec<(String, String)> {
    let up = |order: &[&String]| -> Vec<(String, String)> {
        let rank = |n: &String| order.iter().position(|o| *o == n);
        let wrong = arrows.iter().filter(|(a, b)| rank(a) > rank(b));
        wrong.cloned().collect()
    };
    let mut left: BTreeSet<&String> = arrows.iter().flat_map(|(a, b)| [a, b]).collect();
    let (mut first, mut last) = (Vec::new(), Vec::new());
    // Whatever uses nothing that is left goes to the end, whatever nothing left uses to the beginning; of a circle, the
    // node that uses most beyond what uses it goes to the beginning.
    while !left.is_empty() {
        let degree = |n: &String| {
            let inside = arrows
                .iter()
                .filter(|(a, b)| left.contains(a) && left.contains(b));
            let of = inside.filter(|(a, b)| a != b && (a == n || b == n));
            of.fold((0i32, 0i32), |(out, in_), (a, _)| {
                if a == n {
                    (out + 1, in_)
                } else {
                    (out, in_ + 1)
                }
            })
        };
        let degrees: Vec<_> = left.iter().map(|n| (*n, degree(n))).collect();
        let node = if let Some((n, _)) = degrees.iter().find(|d| d.1.0 == 0) {
            last.push(*n);
            *n
        } else {
            let n = degrees
                .iter()
                .max_by_key(|d| if d.1.1 == 0 { i32::MAX } else { d.1.0 - d.1.1 });
            let n = n.map(|d| d.0).unwrap();
            first.push(n);
            n
        };
        left.remove(node);
    }
    let mut order: Vec<&String> = first.into_iter().chain(last.into_iter().rev()).collect();
    // Moves single nodes as long as that helps.
    let mut best = up(&order);
    let mut improved = true;
    while improved && best.len() > MAX_ARROWS_UP {
        improved = false;
        for node in order.clone() {
            for place in 0..order.len() {
                let mut next: Vec<&String> = order.iter().copied().filter(|n| *n != node).collect();
                next.insert(place, node);
                let found = up(&next);
                if found.len() < best.len() {
                    (order, best, improved) = (next, found, true);
                }
            }
        }
    }
    best
}

#[test]
fn files_of_a_folder_point_one_way() {
    let source = root().join("src");
    let folders = fs::read_dir(&source)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let crates = folders.filter(|path| path.join("lib.rs").exists());
    let mut rooms = 0;
    for folder in crates.chain([source.clone()]) {
        for (room, arrows) in Crate::read(&folder).arrows() {
            rooms += 1;
            let up = arrows_up(&arrows);
            let place = folder.strip_prefix(root()).unwrap().join(room.join("/"));
            assert!(
                up.len() <= MAX_ARROWS_UP,
                "{}: {} arrows up; expected at most {MAX_ARROWS_UP}: move what two files need of each other below \
                 both: {up:#?}",
                place.display(),
                up.len()
            );
        }
    }
    assert!(rooms > 40, "{rooms} folders with arrows were found");
}

#[test]
fn a_circle_of_files_has_an_arrow_up() {
    let arrows = |pairs: &[(&str, &str)]| -> Arrows {
        pairs
            .iter()
            .map(|(a, b)| ((*a).to_owned(), (*b).to_owned()))
            .collect()
    };
    assert_eq!(
        arrows_up(&arrows(&[("a", "b"), ("b", "c"), ("a", "c")])).len(),
        0
    );
    assert_eq!(
        arrows_up(&arrows(&[("a", "b"), ("b", "c"), ("c", "a")])).len(),
        1
    );
    // All pairs of four nodes, both ways: half of the arrows.
    let names = ["a", "b", "c", "d"];
    let all = names
        .iter()
        .flat_map(|a| names.iter().map(move |b| (*a, *b)));
    let all: Vec<_> = all.filter(|(a, b)| a != b).collect();
    assert_eq!(arrows_up(&arrows(&all)).len(), 6);
}
