//! Universal files of I-DEAS, `.unv`: datasets between lines of -1.
//!
//! Nodes (datasets 15, 781, 2411), elements (780, 2412) and groups (eight numbers from 2417 to 2477) are read; units
//! (164) produce a note. Old elements (71, 2410) are refused, other datasets ignored; lines, springs and masses are
//! counted and skipped. Where no group has elements each physical property from 1 on makes one. Coordinate systems are
//! ignored in 781 and 2411; dataset 15 takes the global one only. Second-order elements alternate corners and mids. A
//! dataset is a line of -1, its number, records and a line of -1; records are read by words, not by columns.

mod table;

use super::collector::{Collector, MAX_NODES};
use super::element_file::{ElementFile, KINDS_READ};
use super::error::{Place, ReadError};
use super::number;
use super::source::{Source, quote};
use std::collections::HashMap;
use std::path::Path;
use table::{BEAM_TYPES, ELEMENT_TYPES, LINE_TYPES};

/// Reads a universal file.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains elements of unsupported kinds.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut file = File {
        source: Source::open(path)?,
        collector: Collector::new(path),
        places: HashMap::new(),
        properties: Vec::new(),
        groups: Vec::new(),
    };
    let mut datasets = 0;
    while let Some(line) = file.line()? {
        if line.is_empty() {
            continue;
        }
        // Each dataset ends with the same line as it begins with; `dataset` reads up to it.
        if line != DELIMITER {
            let e = file
                .source
                .bad(quote(&line), "-1, which begins and ends every dataset");
            return Err(e.with_hint("is this a universal file of I-DEAS?"));
        }
        file.dataset()?;
        datasets += 1;
    }
    if datasets == 0 {
        let e = file
            .source
            .bad("an empty file", "datasets between lines of -1");
        return Err(e);
    }
    file.finish()
}

const DELIMITER: &str = "-1";

struct File<'a> {
    source: Source,
    collector: Collector<'a>,
    /// The index of each element by number.
    places: HashMap<u64, u32>,
    /// The physical property of each element; 0 for none.
    properties: Vec<u64>,
    /// Name and element numbers.
    groups: Vec<(String, Vec<u64>)>,
}

impl File<'_> {
    /// The next line, trimmed; `None` at the end of the file.
    fn line(&mut self) -> Result<Option<String>, ReadError> {
        Ok(self.source.line()?.map(|l| l.trim().to_owned()))
    }

    /// The next line; the end of the file is an error, where `what` is expected.
    fn needed(&mut self, what: &str) -> Result<String, ReadError> {
        match self.line()? {
            Some(line) => Ok(line),
            None => Err(self
                .source
                .bad("the end of the file", what)
                .with_hint("the file looks truncated")),
        }
    }

    /// The next line of a dataset; `None` at its end.
    fn record(&mut self, what: &str) -> Result<Option<String>, ReadError> {
        Ok(Some(self.needed(what)?).filter(|line| line != DELIMITER))
    }

    /// The integers of a line.
    fn whole(&self, line: &str, what: &str) -> Result<Vec<i64>, ReadError> {
        let parse = |w: &str| w.parse().map_err(|_| self.source.bad(quote(w), what));
        line.split_whitespace().map(parse).collect()
    }

    /// A point of three numbers, also with Fortran exponents.
    fn point<'w>(&self, words: impl Iterator<Item = &'w str>) -> Result<[f64; 3], ReadError> {
        let mut at = [0.0; 3];
        let mut count = 0;
        for word in words {
            let value = number::real(word.as_bytes())
                .ok_or_else(|| self.source.bad(quote(word), "a coordinate"))?;
            if let Some(c) = at.get_mut(count) {
                *c = value;
            }
            count += 1;
        }
        if count != 3 {
            return Err(self.source.bad(format!("{count} coordinates"), "3"));
        }
        Ok(at)
    }

    /// Reads a dataset by its number, up to its end; the line of -1 before it has been read.
    fn dataset(&mut self) -> Result<(), ReadError> {
        let line = self.needed("the number of a dataset")?;
        let code = line.split_whitespace().next().unwrap_or("");
        match code {
            "2411" | "781" => self.nodes(),
            "15" => self.nodes_on_one_line(),
            "2412" => self.elements(1),
            // Two numbers per property table: its bin and its own.
            "780" => self.elements(2),
            "164" => self.units(),
            "2435" | "2452" | "2467" | "2477" => self.groups(4),
            "2417" | "2429" | "2430" | "2432" => self.groups(2),
            "71" | "2410" => {
                let found = format!("the dataset {code}, elements of an old kind");
                Err(self.source.bad(found, "elements in a dataset 780 or 2412"))
            }
            _ if code.parse::<u32>().is_ok() => {
                while self.record("-1 at the end of a dataset")?.is_some() {}
                Ok(())
            }
            _ => Err(self
                .source
                .bad(quote(&line), "the number of a dataset of text")
                .with_hint("datasets with a letter, such as 58b, are binary; leave them out")),
        }
    }

    /// Nodes of datasets 781 and 2411: number and systems, which are ignored, on one line, coordinates on the next.
    fn nodes(&mut self) -> Result<(), ReadError> {
        while let Some(line) = self.record("a node or -1")? {
            let head = self.whole(&line, "a node's number and systems")?;
            let number = self.number(head.first(), "a node number")?;
            let line = self.needed("three coordinates")?;
            let at = self.point(line.split_whitespace())?;
            self.collector.point(number, at);
        }
        Ok(())
    }

    /// Nodes of dataset 15: number, systems (the first at most 1, the global one), colour and coordinates in one line.
    fn nodes_on_one_line(&mut self) -> Result<(), ReadError> {
        while let Some(line) = self.record("a node or -1")? {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [head @ .., x, y, z] = words.as_slice() else {
                return Err(self.source.bad(quote(&line), "a node and its coordinates"));
            };
            let head = self.whole(&head.join(" "), "a node's number and systems")?;
            let number = self.number(head.first(), "a node number")?;
            if head.get(1).is_some_and(|system| *system > 1) {
                let found = format!("node {number} in the coordinate system {}", head[1]);
                return Err(self.source.bad(found, "nodes in the global system"));
            }
            let at = self.point([*x, *y, *z].into_iter())?;
            self.collector.point(number, at);
        }
        Ok(())
    }

    /// A number from 1; a missing one is an error.
    fn number(&self, found: Option<&i64>, what: &str) -> Result<u64, ReadError> {
        let found = found.copied().unwrap_or(0);
        match u64::try_from(found) {
            Ok(number @ 1..) => Ok(number),
            _ => Err(self.source.bad(found.to_string(), what)),
        }
    }

    /// Elements, whose head has `width` numbers per property table: number, type, property, material, colour, number of
    /// nodes; their nodes follow on further lines.
    fn elements(&mut self, width: usize) -> Result<(), ReadError> {
        while let Some(line) = self.record("an element or -1")? {
            let head = self.whole(&line, "an element's head of whole numbers")?;
            if head.len() < 4 + 2 * width {
                let expected = "number, type, property, material, colour, number of nodes";
                return Err(self.source.bad(quote(&line), expected));
            }
            let number = self.number(head.first(), "an element number")?;
            let (code, property) = (head[1], head[1 + width]);
            let count = self.number(head.last(), "a number of nodes")?;
            let mut nodes: Vec<u64> = Vec::new();
            let mut orientation = BEAM_TYPES.contains(&code);
            while (nodes.len() as u64) < count {
                let line = self.needed("the nodes of an element")?;
                let words = self.whole(&line, "a node number")?;
                // Beams have a line of an orientation node and two sections; old rods do not.
                if orientation && words.len() == 3 {
                    orientation = false;
                    continue;
                }
                if words.is_empty() {
                    return Err(self.source.bad(quote(&line), "the nodes of an element"));
                }
                for word in &words {
                    nodes.push(self.number(Some(word), "a node number, from 1")?);
                }
            }
            self.element(number, code, property, &nodes)?;
        }
        Ok(())
    }

    /// Adds an element; `code` is its type in the file, `property` its physical property, `nodes` are in the file's
    /// order.
    fn element(
        &mut self,
        number: u64,
        code: i64,
        property: i64,
        nodes: &[u64],
    ) -> Result<(), ReadError> {
        let place = Place::ItemOnLine("element", number, self.source.line_number());
        let path = self.source.path();
        let Some((_, kind, order)) = ELEMENT_TYPES.iter().find(|row| row.0.contains(&code)) else {
            if LINE_TYPES.iter().any(|codes| codes.contains(&code)) {
                self.collector.skipped += 1;
                return Ok(());
            }
            let found = format!("the element type {code}");
            return Err(ReadError::data(path, place, found, KINDS_READ));
        };
        if nodes.len() != kind.node_count() {
            let found = format!("{} nodes", nodes.len());
            let expected = format!("{} for a {}", kind.node_count(), kind.name());
            return Err(ReadError::data(path, place, found, expected));
        }
        let count = self.places.len() as u32;
        if self.places.insert(number, count).is_some() {
            let found = "a second element of this number";
            return Err(ReadError::data(path, place, found, "every number once"));
        }
        // From corners and mid nodes in turn to the order of VTK; an empty `order` (linear kinds) keeps the file's.
        let mut ordered = [0; MAX_NODES];
        for (i, to) in ordered.iter_mut().take(nodes.len()).enumerate() {
            *to = nodes[order.get(i).map_or(i, |&o| usize::from(o))];
        }
        // `finish` adds the groups: they may follow the elements. A property below 1 makes none.
        self.collector
            .element(number, *kind, &ordered[..nodes.len()], &[]);
        self.properties.push(u64::try_from(property).unwrap_or(0));
        Ok(())
    }

    /// Notes the name of the units (dataset 164); nothing is converted.
    fn units(&mut self) -> Result<(), ReadError> {
        let Some(line) = self.record("units or -1")? else {
            return Ok(());
        };
        let name: String = line.chars().skip_while(char::is_ascii_digit).collect();
        let name = name.trim().trim_end_matches(|c: char| c.is_ascii_digit());
        self.collector.notes.push(format!(
            "the file's units are {}; coordinates are not converted (set the unit by unit =)",
            quote(name.trim())
        ));
        while self.record("units or -1")?.is_some() {}
        Ok(())
    }

    /// Groups; each member has `width` numbers, the first two of them type and number. Members of other types than
    /// elements are left out.
    fn groups(&mut self, width: usize) -> Result<(), ReadError> {
        /// The type of finite elements.
        const ELEMENT: i64 = 8;
        while let Some(line) = self.record("a group or -1")? {
            let head = self.whole(&line, "a group's head of whole numbers")?;
            // The group's number comes first, that of its members last; those between do not matter here.
            let number = head.first().copied().unwrap_or(0);
            let count = head.last().copied().unwrap_or(0);
            let Ok(count) = u64::try_from(count) else {
                return Err(self.source.bad(count.to_string(), "a number of members"));
            };
            let name = self.needed("a group's name")?;
            let mut members = Vec::new();
            let mut read = 0;
            while read < count {
                let line = self.needed("the members of a group")?;
                let words = self.whole(&line, "type and number of a group's member")?;
                if words.is_empty() || words.len() % width != 0 {
                    let expected = format!("{width} numbers for each member of a group");
                    return Err(self.source.bad(quote(&line), expected));
                }
                for member in words.chunks_exact(width) {
                    read += 1;
                    if member[0] == ELEMENT {
                        members.push(self.number(member.get(1), "an element number")?);
                    }
                }
            }
            let name = if name.is_empty() {
                number.to_string()
            } else {
                name
            };
            self.groups.push((name, members));
        }
        Ok(())
    }

    /// Adds the groups, or where none has elements one per physical property from 1 on, and builds the elements.
    fn finish(mut self) -> Result<ElementFile, ReadError> {
        if self.groups.iter().all(|(_, members)| members.is_empty()) {
            let mut by_property: HashMap<u64, Vec<u32>> = HashMap::new();
            for (place, &property) in self.properties.iter().enumerate() {
                by_property.entry(property).or_default().push(place as u32);
            }
            let mut numbers: Vec<u64> = by_property.keys().copied().filter(|&p| p > 0).collect();
            numbers.sort_unstable();
            for number in numbers {
                self.collector
                    .named_group(&number.to_string(), &by_property[&number]);
            }
        }
        for (name, members) in &self.groups {
            let places: Vec<u32> = members
                .iter()
                .filter_map(|number| self.places.get(number))
                .copied()
                .collect();
            self.collector.named_group(name, &places);
        }
        self.collector.finish(|_| None)
    }
}
