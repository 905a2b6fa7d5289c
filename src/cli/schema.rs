//! `druse schema`: the recipe's JSON schema.

use super::{Answer, Failure, Session};
use clap::Args;

#[derive(Args)]
pub(super) struct Parameters {}

#[allow(clippy::unnecessary_wraps)] // every command answers alike
pub(super) fn answer(_: &Parameters, _: &Session) -> Result<Answer, Failure> {
    let schema = crate::recipe::schema();
    Ok(Answer::new(format!("{schema:#}"), schema))
}
