//! Sections of `.msh` versions 4.0 and 4.1.
//!
//! In 4.0 an entity's number precedes its dimension, points have a bounding box, every node follows its
//! number, and numbers of nodes and elements have 32 bits.

use super::{File, Type, Version};
use crate::io::collector::MAX_NODES;
use crate::io::error::ReadError;
use std::collections::BTreeMap;

/// Physical groups of surfaces and volumes, by dimension and number.
pub(super) type Entities = BTreeMap<(i64, i64), Vec<i64>>;

/// Greatest number of physical groups of one entity: each of its elements joins them all.
const MAX_GROUPS_PER_ENTITY: usize = 256;

/// Reads the entities (points, curves, surfaces, volumes) and keeps their physical groups.
pub(super) fn entities(file: &mut File) -> Result<(), ReadError> {
    file.numbers();
    let counts = entity_counts(file)?;
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag = file.tokens.int("an entity's number")?;
            entity(file, dimension, tag)?;
        }
    }
    file.lines();
    Ok(())
}

/// Reads the entities of a partitioned mesh; ghost entities do not affect the shape.
pub(super) fn partitioned_entities(file: &mut File) -> Result<(), ReadError> {
    file.numbers();
    file.tokens.size("the number of partitions")?;
    let claimed = file.tokens.size("the number of ghost entities")?;
    for _ in 0..file.tokens.count(claimed, 2, 8, "ghost entities")? {
        file.tokens.int("a ghost entity's number")?;
        file.tokens.int("a partition")?;
    }
    let counts = entity_counts(file)?;
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag = file.tokens.int("an entity's number")?;
            file.tokens.int("a parent's dimension")?;
            file.tokens.int("a parent's number")?;
            ints(file, "partitions")?;
            entity(file, dimension, tag)?;
        }
    }
    file.lines();
    Ok(())
}

/// The numbers of points, curves, surfaces and volumes.
fn entity_counts(file: &mut File) -> Result<[usize; 4], ReadError> {
    let mut counts = [0; 4];
    for count in &mut counts {
        let claimed = file.tokens.size("a number of entities")?;
        // The least is a point of 4.1: a number, a position, a count of groups; 4 + 3 * 8 + 8 bytes.
        *count = file.tokens.count(claimed, 5, 36, "entities")?;
    }
    Ok(counts)
}

/// Reads the data of an entity of this dimension and number: its bounding box (the position of a point), physical
/// groups, boundary.
fn entity(file: &mut File, dimension: usize, tag: i64) -> Result<(), ReadError> {
    let is_position = dimension == 0 && file.version != Version::Four0;
    for _ in 0..if is_position { 3 } else { 6 } {
        file.tokens.double("a coordinate")?;
    }
    let groups = ints(file, "physical groups")?;
    if groups.len() > MAX_GROUPS_PER_ENTITY {
        let found = format!("{} physical groups of an entity", groups.len());
        return Err(file
            .tokens
            .bad(found, format!("at most {MAX_GROUPS_PER_ENTITY}")));
    }
    if dimension > 0 {
        ints(file, "bounding entities")?;
    }
    if dimension >= 2 && !groups.is_empty() {
        file.entities.insert((dimension as i64, tag), groups);
    }
    Ok(())
}

/// A list of whole numbers after its length.
fn ints(file: &mut File, what: &str) -> Result<Vec<i64>, ReadError> {
    let claimed = file.tokens.size(what)?;
    let count = file.tokens.count(claimed, 1, 4, what)?;
    (0..count).map(|_| file.tokens.int(what)).collect()
}

/// An entity's dimension and number, in the order of the version.
fn entity_of_block(file: &mut File) -> Result<(i64, i64), ReadError> {
    let number_first = file.version == Version::Four0;
    let t = &mut file.tokens;
    let first = t.int("an entity's dimension and number")?;
    let second = t.int("an entity's dimension and number")?;
    let (dimension, entity) = if number_first {
        (second, first)
    } else {
        (first, second)
    };
    if !(0..=3).contains(&dimension) {
        return Err(t.bad(format!("the dimension {dimension}"), "0 to 3"));
    }
    Ok((dimension, entity))
}

/// The number of a node or an element, of 32 or 64 bits.
fn item_number(file: &mut File, what: &str) -> Result<u64, ReadError> {
    match file.version {
        Version::Four0 => file.tokens.number(what),
        _ => file.tokens.size(what),
    }
}

/// The number of items in a block; subtracted from `left`.
fn block_count(file: &mut File, left: &mut u64, what: &str) -> Result<u64, ReadError> {
    let t = &mut file.tokens;
    let count = t.size(what)?;
    if count > *left {
        let found = format!("a block of {count} {what}");
        return Err(t.bad(found, format!("at most the {left} left")));
    }
    *left -= count;
    Ok(count)
}

/// The number of blocks and the total number of items; 4.1 adds the least and the greatest item number. `words` is the
/// least number of numbers of an item, for the check against the size of the file.
fn block_counts(file: &mut File, what: &str, words: u64) -> Result<(usize, u64), ReadError> {
    let bytes = 4 * words;
    let t = &mut file.tokens;
    let blocks = t.size("a number of blocks")?;
    let claimed = t.size(what)?;
    t.count(claimed, words, bytes, what)?;
    if file.version == Version::Four1 {
        t.size("the least number")?;
        t.size("the greatest number")?;
    }
    // Two numbers of an entity, one of parameters or type, a count: 3 * 4 + 8 bytes.
    Ok((t.count(blocks, 4, 20, "blocks")?, claimed))
}

/// Checks that the blocks hold as many items as the section claims; `left` are missing.
fn check_complete(file: &File, left: u64, claimed: u64, what: &str) -> Result<(), ReadError> {
    if left == 0 {
        return Ok(());
    }
    let found = format!("{} {what}", claimed - left);
    Err(file.tokens.bad(found, format!("{claimed} {what}")))
}

/// Reads the nodes, block by block of entities.
pub(super) fn nodes(file: &mut File) -> Result<(), ReadError> {
    file.numbers();
    let (blocks, claimed) = block_counts(file, "nodes", 4)?;
    let mut left = claimed;
    let mut numbers = Vec::new();
    for _ in 0..blocks {
        let (dimension, _) = entity_of_block(file)?;
        let parametric = file.tokens.int("0 or 1 for parametric nodes")?;
        let count = block_count(file, &mut left, "nodes")?;
        let parameters = if parametric == 0 { 0 } else { dimension };
        // Version 4.1 lists all numbers of a block before its coordinates; version 4.0 has each number before
        // its point.
        let listed = file.version == Version::Four1;
        numbers.clear();
        for _ in 0..if listed { count } else { 0 } {
            numbers.push(file.tokens.size("a node number")?);
        }
        for i in 0..count as usize {
            let number = match numbers.get(i) {
                Some(&number) => number,
                None => file.tokens.number("a node number")?,
            };
            let mut at = [0.0; 3];
            for c in &mut at {
                *c = file.tokens.double("a coordinate")?;
            }
            // Parameters follow the point, as many as the entity has dimensions, and are not needed.
            for _ in 0..parameters {
                file.tokens.double("a parameter")?;
            }
            file.point(number, at);
        }
    }
    check_complete(file, left, claimed, "nodes")?;
    file.lines();
    Ok(())
}

/// Reads the elements, block by block of one entity and one type.
pub(super) fn elements(file: &mut File) -> Result<(), ReadError> {
    file.numbers();
    let (blocks, claimed) = block_counts(file, "elements", 2)?;
    let mut left = claimed;
    for _ in 0..blocks {
        let entity = entity_of_block(file)?;
        let code = file.tokens.number("an element type")?;
        let count = block_count(file, &mut left, "elements")?;
        let groups = file.entities.get(&entity).cloned().unwrap_or_default();
        block_elements(file, code, count, &groups)?;
    }
    check_complete(file, left, claimed, "elements")?;
    file.lines();
    Ok(())
}

/// Reads `count` elements of the type `code`, which belong to `groups`.
fn block_elements(file: &mut File, code: u64, count: u64, groups: &[i64]) -> Result<(), ReadError> {
    for _ in 0..count {
        let number = item_number(file, "an element number")?;
        match file.element_type(code, number)? {
            Type::Skipped(nodes) => {
                for _ in 0..nodes {
                    item_number(file, "a node number")?;
                }
                file.collector.skipped += 1;
            }
            Type::Known(kind) => {
                let mut nodes = [0; MAX_NODES];
                let own = &mut nodes[..kind.node_count()];
                for n in own.iter_mut() {
                    *n = item_number(file, "a node number")?;
                }
                file.add_element(number, kind, own, groups);
            }
        }
    }
    Ok(())
}
