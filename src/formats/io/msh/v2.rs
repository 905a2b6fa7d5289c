//! Sections of `.msh` versions 1 and 2.
//!
//! A count stands on a line of its own, in text too where the section is binary. Version 1 is always text. The first
//! tag of an element in version 2 is its physical group, 0 for none.

use super::{File, Type};
use crate::io::collector::MAX_NODES;
use crate::io::error::ReadError;
use crate::io::tokens::Encoding;

/// Nodes with or without an entity and their parameters on it.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum NodeForm {
    Plain,
    Parametric,
}

/// Reads nodes: number, three coordinates, and for parametric ones an entity with its parameters, which are ignored.
pub(super) fn nodes(file: &mut File, form: NodeForm) -> Result<(), ReadError> {
    let claimed = count_line(file, "the number of nodes")?;
    // From here to `lines` numbers are in the file's encoding. A node is 4 words, in binary at least 4 + 3 * 8 bytes.
    file.numbers();
    let count = file.tokens.count(claimed, 4, 28, "nodes")?;
    for _ in 0..count {
        let t = &mut file.tokens;
        let number = t.number("a node number")?;
        let mut at = [0.0; 3];
        for c in &mut at {
            *c = t.double("a coordinate")?;
        }
        if form == NodeForm::Parametric {
            let dimension = t.int("an entity's dimension")?;
            t.int("an entity's number")?;
            // Points and volumes have no parameters.
            let parameters = match dimension {
                0 | 3 => 0,
                1 | 2 => dimension,
                _ => return Err(t.bad(format!("the dimension {dimension}"), "0 to 3")),
            };
            for _ in 0..parameters {
                t.double("a parameter")?;
            }
        }
        file.point(number, at);
    }
    file.lines();
    Ok(())
}

/// Reads elements of version 1: number, type, group, entity, number of nodes, nodes.
pub(super) fn elements_of_version_1(file: &mut File) -> Result<(), ReadError> {
    let claimed = count_line(file, "the number of elements")?;
    // Number, type, group, entity, node count and a node, always as text; the bytes do not count.
    let count = file.tokens.count(claimed, 6, 24, "elements")?;
    for _ in 0..count {
        let t = &mut file.tokens;
        let number = t.number("an element number")?;
        let code = t.number("an element type")?;
        let group = t.int("a physical group")?;
        t.int("an entity's number")?;
        let nodes = t.number("a number of nodes")?;
        let kind = file.element_type(code, number)?;
        let expected = match kind {
            Type::Skipped(count) => count,
            Type::Known(kind) => kind.node_count(),
        };
        if nodes != expected as u64 {
            let found = format!("{nodes} nodes for the type {code}");
            return Err(file.tokens.bad(found, expected.to_string()));
        }
        element(file, number, kind, group)?;
    }
    Ok(())
}

/// Reads the elements of version 2.
pub(super) fn elements(file: &mut File) -> Result<(), ReadError> {
    let claimed = count_line(file, "the number of elements")?;
    file.numbers();
    // At least number, type, tag count and a node; in a binary run at least number and node, 4 bytes each.
    let count = file.tokens.count(claimed, 4, 8, "elements")?;
    let mut left = count;
    while left > 0 {
        // Number and type in `head`. Text repeats type and tag count for every element; binary gives them once per run.
        let (mut head, mut run, mut tags) = ([0; 2], 1, 0);
        let binary = file.tokens.encoding != Encoding::Text;
        if binary {
            head[1] = file.tokens.number("an element type")?;
            run = file.tokens.number("a number of elements")?;
            tags = file.tokens.number("a number of tags")?;
            if run == 0 || run > left as u64 {
                return Err(file
                    .tokens
                    .bad(format!("a run of {run} elements"), format!("1 to {left}")));
            }
        }
        for _ in 0..run {
            head[0] = file.tokens.number("an element number")?;
            if !binary {
                head[1] = file.tokens.number("an element type")?;
                tags = file.tokens.number("a number of tags")?;
            }
            tagged(file, head, tags)?;
            left -= 1;
        }
    }
    file.lines();
    Ok(())
}

/// Reads the tags and nodes of an element of version 2 with this number and type code.
fn tagged(file: &mut File, [number, code]: [u64; 2], tags: u64) -> Result<(), ReadError> {
    let kind = file.element_type(code, number)?;
    let t = &mut file.tokens;
    // Group, entity and partitions are a few.
    if tags > 64 {
        return Err(t.bad(format!("{tags} tags"), "at most 64"));
    }
    let mut group = 0;
    for i in 0..tags {
        let tag = t.int("a tag")?;
        if i == 0 {
            group = tag;
        }
    }
    element(file, number, kind, group)
}

/// Reads the nodes of an element in a group (0 for none).
fn element(file: &mut File, number: u64, kind: Type, group: i64) -> Result<(), ReadError> {
    let t = &mut file.tokens;
    let groups: &[i64] = if group == 0 { &[] } else { &[group] };
    let mut nodes = [0; MAX_NODES];
    match kind {
        Type::Skipped(count) => {
            for _ in 0..count {
                t.number("a node number")?;
            }
            file.collector.skipped += 1;
        }
        Type::Known(kind) => {
            let own = &mut nodes[..kind.node_count()];
            for n in own.iter_mut() {
                *n = t.number("a node number")?;
            }
            // An element of several groups is listed once per group; the collector merges them.
            file.add_element(number, kind, own, groups);
        }
    }
    Ok(())
}

/// A count on a line of its own.
fn count_line(file: &mut File, what: &str) -> Result<u64, ReadError> {
    let line = file.tokens.needed_line(what)?;
    if let Ok(count) = line.parse() {
        return Ok(count);
    }
    let found = crate::io::source::quote(line);
    Err(file.text_error(found, what))
}
