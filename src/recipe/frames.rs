//! Frame tokens in the strings of a recipe, as `$F4`: they are replaced by the number of the run's frame before
//! the recipe is read into structs, and the texts with tokens are kept as templates by their key.

use crate::sequence::{TokenError, expand};
use serde_spanned::Spanned;
use std::collections::BTreeMap;
use toml::de::{DeTable, DeValue};

/// Key whose strings are scripts, in which `#` begins a comment.
const SCRIPT_KEY: &str = "steps";

/// Frame of a recipe without one.
pub(super) const DEFAULT_FRAME: i32 = 1;

/// Strings with tokens as they stand in the text, by key.
pub(super) type Templates = BTreeMap<String, String>;

/// Replaces the frame tokens of all strings but scripts, by the frame of the key `frame` (1 without one). Returns
/// what the strings were, by key.
///
/// # Errors
/// The key and its fault.
pub(super) fn expand_tokens(root: &mut DeTable) -> Result<Templates, (String, TokenError)> {
    let frame = root.iter().find(|(key, _)| key.get_ref() == "frame");
    let frame = frame.and_then(|(_, value)| match value.get_ref() {
        DeValue::Integer(number) => i32::from_str_radix(number.as_str(), number.radix()).ok(),
        _ => None,
    });
    let mut templates = Templates::new();
    let frame = frame.unwrap_or(DEFAULT_FRAME);
    in_table("", root, frame, &mut templates)?;
    Ok(templates)
}

/// Replaces the frame tokens below a table. `prefix` is its key with a dot behind it, empty for the whole
/// document.
fn in_table(
    prefix: &str,
    table: &mut DeTable,
    frame: i32,
    templates: &mut Templates,
) -> Result<(), (String, TokenError)> {
    for (key, value) in table.iter_mut() {
        if key.get_ref() != SCRIPT_KEY {
            in_value(
                format!("{prefix}{}", key.get_ref()),
                value,
                frame,
                templates,
            )?;
        }
    }
    Ok(())
}

/// Replaces the frame tokens in a value and below it. `key` is its place; `templates` receives the
/// texts with tokens by their places.
fn in_value(
    key: String,
    value: &mut Spanned<DeValue>,
    frame: i32,
    templates: &mut Templates,
) -> Result<(), (String, TokenError)> {
    match value.get_mut() {
        DeValue::Table(table) => in_table(&format!("{key}."), table, frame, templates),
        DeValue::Array(array) => {
            let mut items = array.as_mut().iter_mut().enumerate();
            items.try_for_each(|(n, item)| in_value(format!("{key}.{n}"), item, frame, templates))
        }
        DeValue::String(text) => {
            match expand(text, frame) {
                Ok(None) => {}
                Ok(Some(expanded)) => {
                    templates.insert(key, text.to_string());
                    *text = expanded.into();
                }
                Err(e) => return Err((key, e)),
            }
            Ok(())
        }
        _ => Ok(()),
    }
}
