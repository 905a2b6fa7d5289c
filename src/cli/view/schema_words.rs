//! What the schema of recipes states about a key: its description, its words, and whether it takes integers. Keys are
//! written with dots and numbers, as `op.2.dilate`; the schema is followed through alternatives and references.

use serde_json::Value;

/// Depth of references that are followed.
const MAX_DEPTH: usize = 24;

/// The schema of recipes, and the cells of one recipe.
pub(super) struct SchemaWords {
    schema: Value,
    cells: Vec<String>,
}

impl SchemaWords {
    /// The schema, for a recipe with these cells.
    pub fn new(cells: Vec<String>) -> Self {
        Self {
            schema: crate::recipe::schema(),
            cells,
        }
    }

    /// The description of a key, or of the nearest of two keys above it, on one line; empty without one.
    pub fn description(&self, key: &str) -> String {
        let parts: Vec<&str> = key.split('.').collect();
        let text = (1..=parts.len()).rev().take(3).find_map(|count| {
            let found = self.at(&self.schema, &parts[..count], 0);
            let described = found.iter().find_map(|v| v["description"].as_str());
            described.map(str::to_owned)
        });
        let text = text.unwrap_or_default();
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Whether a key takes integers only.
    pub fn is_integer(&self, key: &str) -> bool {
        let parts: Vec<&str> = key.split('.').collect();
        let found = self.at(&self.schema, &parts, 0);
        let has = |name: &str| found.iter().any(|v| is_type(&v["type"], name));
        has("integer") && !has("number")
    }

    /// The words that a key takes; empty for other values. Cells and surfaces are named here, as the schema does
    /// not list them.
    pub fn choices(&self, key: &str) -> Vec<String> {
        let parts: Vec<&str> = key.split('.').collect();
        match (parts[0], parts[parts.len() - 1]) {
            ("cell", "surface") => {
                let all = crate::cell::Surface::CATALOGUE.iter();
                return all.map(|s| s.name().to_owned()).collect();
            }
            ("tiling", "cell") => return self.cells.clone(),
            _ => {}
        }
        let mut words = Vec::new();
        for value in self.at(&self.schema, &parts, 0) {
            let listed = value["enum"].as_array().into_iter().flatten();
            let single = value.get("const");
            words.extend(listed.chain(single).filter_map(Value::as_str));
        }
        words.into_iter().map(str::to_owned).collect()
    }

    /// All schemas of a key below a node; alternatives and references are followed. `parts` are the
    /// words of the key that are still to follow, `depth` limits references to themselves.
    fn at<'a>(&'a self, node: &'a Value, parts: &[&str], depth: usize) -> Vec<&'a Value> {
        let mut found = Vec::new();
        if depth > MAX_DEPTH {
            return found;
        }
        if let Some((first, rest)) = parts.split_first() {
            let property = &node["properties"][*first];
            // A number is an index of an array, whose entries are alike; a word is a property or the name of any entry.
            let children = if first.parse::<usize>().is_ok() {
                [&node["items"], &node["prefixItems"][0]]
            } else if property.is_object() {
                [property, &Value::Null]
            } else {
                [&node["additionalProperties"], &Value::Null]
            };
            for child in children.into_iter().filter(|c| c.is_object()) {
                found.extend(self.at(child, rest, depth + 1));
            }
        } else {
            found.push(node);
        }
        for alternative in ["anyOf", "oneOf", "allOf"] {
            for value in node[alternative].as_array().into_iter().flatten() {
                found.extend(self.at(value, parts, depth + 1));
            }
        }
        let reference = node["$ref"]
            .as_str()
            .and_then(|r| r.strip_prefix("#/$defs/"));
        if let Some(name) = reference {
            found.extend(self.at(&self.schema["$defs"][name], parts, depth + 1));
        }
        found
    }
}

/// Whether a schema's type is, or contains, a name.
fn is_type(types: &Value, name: &str) -> bool {
    types == name
        || types
            .as_array()
            .is_some_and(|list| list.iter().any(|t| t == name))
}
