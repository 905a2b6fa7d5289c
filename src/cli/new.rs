//! `druse new NAME`: a commented recipe to start from, which runs as it is.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::io::atomic::write_bytes;
use crate::pipeline::shell_word;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// Name of the recipe: NAME.toml is written.
    name: PathBuf,
    /// Fill this part: a closed mesh (.stl .obj .ply .off .3mf), or .step, .iges, .brep; sizes suit it.
    #[arg(long, value_name = "FILE")]
    part: Option<PathBuf>,
    /// What fills the part: "edges" (struts along the edges of tets that keep the part's edges), or a named
    /// surface, as in gyroid, in cubes that the part cuts; of a part of CAD the surface is written beside the recipe.
    #[arg(long, value_name = "CELL", default_value = "edges", requires = "part")]
    cell: String,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

const STARTER: &str = include_str!("new.toml");

/// Writes the starter with the recipe's name in it, or with `--part` a recipe for that part.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let mut path = p.name.clone();
    if path.extension().is_none_or(|e| e != "toml") {
        path.as_mut_os_string().push(".toml");
    }
    if path.exists() && !p.force {
        return Err(Failure::usage(format!("{} exists already", path.display()))
            .hint("choose another name, or add --force"));
    }
    let stem = path
        .file_stem()
        .map_or_else(|| "part".into(), |s| s.to_string_lossy().into_owned());
    let text = match &p.part {
        Some(part) => {
            let lattice = super::new_part::Lattice {
                part,
                cell: &p.cell,
                name: &stem,
                path: &path,
                may_overwrite: p.force,
            };
            lattice.recipe(session)?
        }
        None => STARTER.replace("NAME", &stem),
    };
    write_bytes(&path, text.as_bytes())?;
    let shown = path.display().to_string();
    Ok(Answer::new(
        format!(
            "{}\nrun it with: druse run {}",
            super::terminal::line(&shown),
            super::terminal::line(&shell_word(&shown))
        ),
        json!({ "path": shown }),
    ))
}
