//! Sections of version 4.1.

use super::{File, Type};
use crate::io::ReadError;
use std::collections::BTreeMap;

/// Physical groups of each volume.
pub(super) type Volumes = BTreeMap<i64, Vec<i64>>;

pub(super) fn entities(file: &mut File, volumes: &mut Volumes) -> Result<(), ReadError> {
    file.numbers();
    let counts = entity_counts(file)?;
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag = file.tokens.int("an entity's number")?;
            entity(file, dimension, tag, volumes)?;
        }
    }
    file.lines();
    Ok(())
}

pub(super) fn partitioned_entities(
    file: &mut File,
    volumes: &mut Volumes,
) -> Result<(), ReadError> {
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
            entity(file, dimension, tag, volumes)?;
        }
    }
    file.lines();
    Ok(())
}

fn entity_counts(file: &mut File) -> Result<[usize; 4], ReadError> {
    let mut counts = [0; 4];
    for count in &mut counts {
        let claimed = file.tokens.size("a number of entities")?;
        *count = file.tokens.count(claimed, 5, 36, "entities")?;
    }
    Ok(counts)
}

/// What follows an entity's number: its box (a point has a place), physical groups, boundary.
fn entity(
    file: &mut File,
    dimension: usize,
    tag: i64,
    volumes: &mut Volumes,
) -> Result<(), ReadError> {
    for _ in 0..if dimension == 0 { 3 } else { 6 } {
        file.tokens.double("a coordinate")?;
    }
    let groups = ints(file, "physical groups")?;
    if dimension > 0 {
        ints(file, "bounding entities")?;
    }
    if dimension == 3 && !groups.is_empty() {
        volumes.insert(tag, groups);
    }
    Ok(())
}

fn ints(file: &mut File, what: &str) -> Result<Vec<i64>, ReadError> {
    let claimed = file.tokens.size(what)?;
    let count = file.tokens.count(claimed, 1, 4, what)?;
    (0..count).map(|_| file.tokens.int(what)).collect()
}

pub(super) fn nodes(file: &mut File) -> Result<(), ReadError> {
    file.numbers();
    let t = &mut file.tokens;
    let blocks = t.size("the number of node blocks")?;
    let claimed = t.size("the number of nodes")?;
    t.count(claimed, 4, 32, "nodes")?;
    t.size("the least node number")?;
    t.size("the greatest node number")?;
    let mut left = claimed;
    let mut numbers = Vec::new();
    for _ in 0..t.count(blocks, 4, 20, "node blocks")? {
        let dimension = t.int("an entity's dimension")?;
        t.int("an entity's number")?;
        let parametric = t.int("0 or 1 for parametric nodes")?;
        let in_block = t.size("a number of nodes")?;
        if !(0..=3).contains(&dimension) {
            return Err(t.bad(format!("the dimension {dimension}"), "0 to 3"));
        }
        if in_block > left {
            return Err(t.bad(
                format!("a block of {in_block} nodes"),
                format!("at most the {left} left of {claimed}"),
            ));
        }
        left -= in_block;
        numbers.clear();
        for _ in 0..in_block {
            numbers.push(t.size("a node number")?);
        }
        let parameters = if parametric == 0 { 0 } else { dimension };
        for &number in &numbers {
            let mut at = [0.0; 3];
            for c in &mut at {
                *c = t.double("a coordinate")?;
            }
            for _ in 0..parameters {
                t.double("a parameter")?;
            }
            file.collector.point(number, at);
        }
    }
    if left > 0 {
        return Err(t.bad(
            format!("{} nodes", claimed - left),
            format!("{claimed} nodes"),
        ));
    }
    file.lines();
    Ok(())
}

pub(super) fn elements(file: &mut File, volumes: &Volumes) -> Result<(), ReadError> {
    file.numbers();
    let t = &mut file.tokens;
    let blocks = t.size("the number of element blocks")?;
    let claimed = t.size("the number of elements")?;
    t.count(claimed, 2, 16, "elements")?;
    t.size("the least element number")?;
    t.size("the greatest element number")?;
    let mut left = claimed;
    for _ in 0..t.count(blocks, 4, 20, "element blocks")? {
        let t = &mut file.tokens;
        t.int("an entity's dimension")?;
        let entity = t.int("an entity's number")?;
        let code = t.number("an element type")?;
        let in_block = t.size("a number of elements")?;
        if in_block > left {
            return Err(t.bad(
                format!("a block of {in_block} elements"),
                format!("at most the {left} left of {claimed}"),
            ));
        }
        left -= in_block;
        block(file, code, in_block, volumes.get(&entity))?;
    }
    if left > 0 {
        return Err(file.tokens.bad(
            format!("{} elements", claimed - left),
            format!("{claimed} elements"),
        ));
    }
    file.lines();
    Ok(())
}

fn block(
    file: &mut File,
    code: u64,
    in_block: u64,
    groups: Option<&Vec<i64>>,
) -> Result<(), ReadError> {
    let groups = groups.map_or(&[][..], |g| g);
    for _ in 0..in_block {
        let number = file.tokens.size("an element number")?;
        match file.element_type(code, number)? {
            Type::Flat(count) => {
                for _ in 0..count {
                    file.tokens.size("a node number")?;
                }
                file.collector.skipped += 1;
            }
            Type::Known(kind) => {
                let mut nodes = [0; 27];
                let own = &mut nodes[..kind.node_count()];
                for n in own.iter_mut() {
                    *n = file.tokens.size("a node number")?;
                }
                file.take(number, kind, own, groups);
            }
        }
    }
    Ok(())
}
