//! Data at nodes and elements: `$NodeData` and `$ElementData`, alike in versions 2 and 4.
//!
//! Of several time steps the last is taken. Where a field gives no value to a node or an element it is
//! NaN there. `$ElementNodeData` is passed over. Notes say all this.

use super::File;
use crate::io::scaffold::{DataField, ElementFile, FieldAt};
use crate::io::{ReadError, collector::Collector, quote};
use std::collections::HashMap;

/// Fields as the file has given them so far.
#[derive(Default)]
pub(super) struct Sections {
    fields: Vec<Field>,
    notes: Vec<String>,
}

struct Field {
    name: String,
    at: FieldAt,
    components: usize,
    time: f64,
    step: i64,
    /// Time steps seen.
    steps: usize,
    /// Where each number's values begin in `values`.
    places: HashMap<u64, usize>,
    values: Vec<f64>,
}

/// Numbers of a section after its name.
struct Head {
    name: String,
    time: f64,
    step: i64,
    components: usize,
    count: u64,
}

/// The least share of nodes or elements that a field must have: one in so many.
const THINNEST: usize = 64;
/// Most numbers of one node or element: a tensor has nine.
const COMPONENTS: i64 = 64;

pub(super) fn section(file: &mut File, section: &str) -> Result<(), ReadError> {
    let head = head(file)?;
    let each = head.components as u64;
    file.numbers();
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
                "field {} has values at the nodes of each element and is passed over",
                quote(&head.name)
            ));
            return Ok(());
        }
    };
    let place = file.data.begin(&head, at);
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

/// The tags of a section: text, real numbers, whole numbers.
fn head(file: &mut File) -> Result<Head, ReadError> {
    let mut tags: [Vec<String>; 3] = Default::default();
    let kinds = ["string tags", "real tags", "integer tags"];
    for (own, what) in tags.iter_mut().zip(kinds) {
        let what = format!("the number of {what}");
        let line = file.tokens.needed_line(&what)?;
        let Ok(count @ 0..=64) = line.parse::<u64>() else {
            let found = quote(line);
            return Err(file.text_error(found, what + ", at most 64"));
        };
        for _ in 0..count {
            own.push(file.tokens.needed_line("a tag")?.to_owned());
        }
    }
    let [names, times, whole] = tags;
    let bad = |text: &str, what: &str| file.tokens.source.bad(quote(text), what);
    let time = match times.first() {
        None => 0.0,
        Some(t) => t.parse().map_err(|_| bad(t, "a time"))?,
    };
    let parse = |t: &String| t.parse::<i64>().map_err(|_| bad(t, "a whole number"));
    let numbers: Vec<i64> = whole.iter().map(parse).collect::<Result<_, _>>()?;
    let counts = match numbers[..] {
        [_, components @ 1..=COMPONENTS, count, ..] => {
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
    /// The field that a section adds to: a new one, the same of another part, or of a later time.
    fn begin(&mut self, head: &Head, at: FieldAt) -> usize {
        let same = |f: &Field| f.name == head.name && f.at == at;
        let fresh = |steps| Field {
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
            self.fields.push(fresh(1));
            return self.fields.len() - 1;
        };
        let field = &mut self.fields[place];
        let part = field.components == head.components && field.step == head.step;
        if !part {
            *field = fresh(field.steps + 1);
        }
        place
    }

    /// Gives the fields at nodes to the collector.
    pub fn at_points(&mut self, numbers: &[u64], collector: &mut Collector) {
        for field in &mut self.fields {
            if field.at == FieldAt::Points && field.is_too_thin(numbers.len()) {
                self.notes.push(field.too_thin());
            } else if field.at == FieldAt::Points {
                let (values, missing) = field.values_of(numbers);
                collector.field(&field.name, field.at, field.components, values);
                self.notes.extend(field.gaps(missing, numbers.len()));
            }
            if field.steps > 1 {
                self.notes.push(format!(
                    "field {} has {} time steps; the last one, at {}, is taken",
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

    /// Adds the fields at elements to what was read, whose elements have the file's numbers.
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
            // Data of elements that are not kept, say of the surface of a solid.
            if !numbers.iter().any(|n| field.places.contains_key(n)) {
                continue;
            }
            if field.is_too_thin(numbers.len()) {
                notes.push(field.too_thin());
                continue;
            }
            let (values, missing) = field.values_of(&numbers);
            notes.extend(field.gaps(missing, numbers.len()));
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
    /// Whether a list of all would be far longer than what the file holds.
    fn is_too_thin(&self, count: usize) -> bool {
        count / THINNEST > self.places.len()
    }

    fn too_thin(&self) -> String {
        format!(
            "field {} has only {} values and is passed over",
            quote(&self.name),
            self.places.len()
        )
    }

    /// The values of these numbers, one after the other, NaN where there are none; and how many those
    /// are.
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

    fn gaps(&self, missing: usize, of: usize) -> Option<String> {
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
