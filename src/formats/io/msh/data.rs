//! Data at nodes and elements: `$NodeData` and `$ElementData`, equal in versions 2 and 4.
//!
//! A section has three lists of tags (text, reals, integers), then a number and its values per node or element. The
//! last of several time steps is used. Missing values are NaN. `$ElementNodeData` is ignored, and
//! so is a field with too few values. Notes report each case; a field of skipped elements is left out without one.

use super::File;
use crate::io::collector::Collector;
use crate::io::element_file::{DataField, ElementFile, FieldAt};
use crate::io::error::ReadError;
use crate::io::source::quote;
use std::collections::HashMap;

/// The fields read so far.
#[derive(Default)]
pub(super) struct Sections {
    fields: Vec<Field>,
    notes: Vec<String>,
}

struct Field {
    name: String,
    at: FieldAt,
    components: usize,
    time: f64, // of the last step read
    step: i64,
    /// The number of time steps read.
    steps: usize,
    /// The start in `values` for each node or element number.
    places: HashMap<u64, usize>,
    values: Vec<f64>,
}

/// The head of a section.
struct Head {
    name: String,
    time: f64,
    step: i64,
    components: usize,
    count: u64,
}

/// A field must have values for at least one in this many nodes or elements; a full array of a sparser one would be
/// mostly NaN.
const MAX_SPARSITY: usize = 64;
/// Greatest number of components of a value: a tensor has nine.
const MAX_COMPONENTS: i64 = 64;

/// Greatest number of tags in a list; programs write one to four.
const MAX_TAGS: u64 = 64;

/// Reads the section named `section` of data at nodes or elements, from the line after its name, without its end.
pub(super) fn section(file: &mut File, section: &str) -> Result<(), ReadError> {
    let head = head(file)?;
    let each = head.components as u64;
    file.numbers();
    // An entry is a number and `each` values or more, in binary of 4 and 8 bytes.
    let count = file
        .tokens
        .count(head.count, 1 + each, 4 + 8 * each, "values")?;
    let at = match section {
        "$NodeData" => FieldAt::Points,
        "$ElementData" => FieldAt::Cells,
        _ => {
            for _ in 0..count {
                file.tokens.number("an element number")?;
                let nodes = file.tokens.number("a number of nodes")?;
                for _ in 0..nodes.saturating_mul(each) {
                    file.tokens.double("a value")?;
                }
            }
            file.lines();
            file.data.notes.push(format!(
                "field {} has values at the nodes of each element and is ignored",
                quote(&head.name)
            ));
            return Ok(());
        }
    };
    let place = file.data.begin(&head, at);
    // A value is found by the number of its node or element: sections list them in any order.
    for _ in 0..count {
        let number = file.tokens.number("a number of a node or element")?;
        let field = &mut file.data.fields[place];
        let start = field.values.len();
        for _ in 0..each {
            field.values.push(file.tokens.double("a value")?);
        }
        field.places.insert(number, start);
    }
    file.lines();
    Ok(())
}

/// The tags of a section: text, real numbers, whole numbers, each list after its length.
fn head(file: &mut File) -> Result<Head, ReadError> {
    let mut tags: [Vec<String>; 3] = Default::default();
    let kinds = ["string tags", "real tags", "integer tags"];
    // Name; time; time step, components, number of values.
    for (tag_list, what) in tags.iter_mut().zip(kinds) {
        let what = format!("the number of {what}");
        let line = file.tokens.needed_line(&what)?;
        let Ok(count @ 0..=MAX_TAGS) = line.parse::<u64>() else {
            let found = quote(line);
            return Err(file.text_error(found, what + ", at most 64"));
        };
        for _ in 0..count {
            tag_list.push(file.tokens.needed_line("a tag")?.to_owned());
        }
    }
    let [names, times, integers] = tags;
    let bad = |text: &str, what: &str| file.tokens.source.bad(quote(text), what);
    let time = match times.first() {
        None => 0.0,
        Some(t) => t.parse().map_err(|_| bad(t, "a time"))?,
    };
    let parse = |t: &String| t.parse::<i64>().map_err(|_| bad(t, "a whole number"));
    let numbers: Vec<i64> = integers.iter().map(parse).collect::<Result<_, _>>()?;
    // More tags may follow (the partition).
    let counts = match numbers[..] {
        [_, components @ 1..=MAX_COMPONENTS, count, ..] => {
            u64::try_from(count).ok().map(|n| (components, n))
        }
        _ => None,
    };
    let Some((components, count)) = counts else {
        let found = format!("the integer tags {numbers:?}");
        let expected = "time step, numbers per value (1 to 64), number of values";
        return Err(file.text_error(found, expected));
    };
    let name = names.first().map_or("", |n| n.trim_matches('"'));
    Ok(Head {
        name: name.to_owned(),
        time,
        step: numbers[0],
        components: components as usize,
        count,
    })
}

impl Sections {
    /// The index of the field for a section: a new field, a continued one, or one replaced by a later step.
    fn begin(&mut self, head: &Head, at: FieldAt) -> usize {
        let same = |f: &Field| f.name == head.name && f.at == at;
        let new_field = |steps| Field {
            name: head.name.clone(),
            at,
            components: head.components,
            time: head.time,
            step: head.step,
            steps,
            places: HashMap::new(),
            values: Vec::new(),
        };
        let Some(place) = self.fields.iter().position(same) else {
            self.fields.push(new_field(1));
            return self.fields.len() - 1;
        };
        let field = &mut self.fields[place];
        let is_same_step = field.components == head.components && field.step == head.step;
        if !is_same_step {
            *field = new_field(field.steps + 1);
        }
        place
    }

    /// Passes the fields at nodes to the collector, and all notes; `numbers` are those of the nodes in file order.
    pub fn at_points(&mut self, numbers: &[u64], collector: &mut Collector) {
        for field in &mut self.fields {
            if field.at == FieldAt::Points && field.is_too_sparse(numbers.len()) {
                self.notes.push(field.sparse_note());
            } else if field.at == FieldAt::Points {
                let (values, missing) = field.values_of(numbers);
                collector.field(&field.name, field.at, field.components, values);
                self.notes.extend(field.gap_note(missing, numbers.len()));
            }
            if field.steps > 1 {
                self.notes.push(format!(
                    "field {} has {} time steps; the last one, at {}, is used",
                    quote(&field.name),
                    field.steps,
                    field.time
                ));
            }
        }
        for note in self.notes.drain(..) {
            collector.notes.push(note);
        }
    }

    /// Adds the fields at elements to the result, whose elements have the file's numbers.
    pub fn at_elements(&self, read: &mut ElementFile) {
        let (fields, notes, numbers): (_, _, Vec<u64>) = match read {
            ElementFile::Solids(f) => {
                let numbers = (0..f.scaffold.len()).map(|e| f.scaffold.number(e));
                (&mut f.fields, &mut f.notes, numbers.collect())
            }
            ElementFile::Surface(f) => {
                let numbers = (0..f.surface.len()).map(|e| f.surface.number(e));
                (&mut f.fields, &mut f.notes, numbers.collect())
            }
        };
        for field in self.fields.iter().filter(|f| f.at == FieldAt::Cells) {
            // Data of skipped elements, for example of the surface of a solid.
            if !numbers.iter().any(|n| field.places.contains_key(n)) {
                continue;
            }
            if field.is_too_sparse(numbers.len()) {
                notes.push(field.sparse_note());
                continue;
            }
            let (values, missing) = field.values_of(&numbers);
            notes.extend(field.gap_note(missing, numbers.len()));
            fields.push(DataField {
                name: field.name.clone(),
                at: FieldAt::Cells,
                components: field.components,
                values,
            });
        }
    }
}

impl Field {
    /// Whether a full array would be far longer than the values in the file.
    fn is_too_sparse(&self, count: usize) -> bool {
        count / MAX_SPARSITY > self.places.len()
    }

    /// The note on a field that is ignored.
    fn sparse_note(&self) -> String {
        format!(
            "field {} has only {} values and is ignored",
            quote(&self.name),
            self.places.len()
        )
    }

    /// The values for these node or element numbers, NaN where missing, and the number of missing ones.
    fn values_of(&self, numbers: &[u64]) -> (Vec<f64>, usize) {
        let mut values = Vec::with_capacity(numbers.len() * self.components);
        let mut missing = 0;
        for number in numbers {
            if let Some(&at) = self.places.get(number) {
                values.extend(&self.values[at..at + self.components]);
            } else {
                values.resize(values.len() + self.components, f64::NAN);
                missing += 1;
            }
        }
        (values, missing)
    }

    /// The note on missing values, if there are any.
    fn gap_note(&self, missing: usize, of: usize) -> Option<String> {
        let what = match self.at {
            FieldAt::Points => "nodes",
            FieldAt::Cells => "elements",
        };
        (missing > 0).then(|| {
            let name = quote(&self.name);
            format!("field {name} has no value at {missing} of {of} {what}")
        })
    }
}
