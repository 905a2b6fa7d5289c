//! `druse schema`: the recipe's JSON schema, or its reference for people. Both are made from the types of the
//! recipe's keys.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use clap::Args;

#[derive(Args)]
pub(super) struct Parameters {
    /// Print the recipe reference as Markdown instead.
    #[arg(long)]
    reference: bool,
}

/// The schema or the reference, as text and as an object.
#[allow(clippy::unnecessary_wraps)] // all commands have one signature
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<Answer, Failure> {
    if p.reference {
        let text = crate::recipe::reference();
        let json = serde_json::json!({ "reference": text });
        return Ok(Answer::new(text, json));
    }
    let schema = crate::recipe::schema();
    Ok(Answer::new(format!("{schema:#}"), schema))
}
