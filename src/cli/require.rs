//! `--require FILE` of `druse check`: a part against requirements. Bare lengths of the requirements are in the
//! unit of their file, to which measures of the part are converted. Refused with a hint are requirements that only a
//! run can judge and, of a mesh, those that need voxels.

use super::failure::Failure;
use super::output::Answer;
use crate::frame::LengthUnit;
use crate::io::SolidFile;
use crate::mesh::{MeshReport, count_bodies};
use crate::pipeline::{Requirement, judge_level_set, judge_mesh, level_set_cavities};
use crate::progress::{Progress, Threads};
use crate::recipe::RequireFile;
use crate::vdb::LevelSet;
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Args)]
#[group(skip)] // the name of the struct is that of others in one command
pub(super) struct Parameters {
    /// Check the part against the [require] section of this file, a recipe or a part of one.
    #[arg(long, value_name = "TOML")]
    require: Option<PathBuf>,
    /// Unit of a mesh whose file states none; requirements need one.
    #[arg(long, value_name = "UNIT", requires = "require")]
    unit: Option<LengthUnit>,
}

impl Parameters {
    /// The requirements of the file, if one is given. Refuses those that only a run can judge, and those on layers
    /// without `[build]`.
    pub(super) fn read(&self) -> Result<Option<RequireFile>, Failure> {
        let Some(path) = &self.require else {
            return Ok(None);
        };
        let file = RequireFile::read(path)?;
        let unknown = file.section.of_runs_only();
        if !unknown.is_empty() {
            let found = format!("found {}, which a file does not tell", unknown.join(", "));
            return Err(
                Failure::data(path, format!("{found}; expected requirements on the part"))
                    .hint("druse run RECIPE judges these"),
            );
        }
        if let Some(name) = file.section.of_builds().first()
            && file.build.is_none()
        {
            let found = format!("found {name} without [build]; expected its layers");
            return Err(Failure::data(path, found).hint("add [build] with layer = \"0.05mm\""));
        }
        Ok(Some(file))
    }

    /// Checks the mesh of the file `path` against requirements. `report` is that of the solid's mesh, which must
    /// bound a solid. Requirements that need voxels, beams, and a mesh without a unit are refused.
    pub(super) fn judge_mesh(
        &self,
        require: &RequireFile,
        path: &Path,
        solid: &SolidFile,
        report: &MeshReport,
    ) -> Result<Vec<Requirement>, Failure> {
        let Some(unit) = self.unit.or(solid.file.unit) else {
            return Err(Failure::data(
                path,
                "found no unit of length; expected one, since requirements are lengths",
            )
            .hint("name it: --unit mm"));
        };
        let r = &require.section;
        for (name, needs) in [
            ("least_wall", r.least_wall.is_some()),
            ("least_gap", r.least_gap.is_some()),
            ("escape_radius", r.escape_radius.is_some()),
            ("islands", r.islands.is_some()),
            ("cups", r.cups.is_some()),
            ("overhang_area", r.overhang_area.is_some()),
        ] {
            if needs {
                let message =
                    format!("found {name} required of a mesh; expected a level set for it");
                return Err(Failure::data(path, message).hint(
                    "druse voxelize MESH -o PART.vdb makes one, with voxels of a third of the wall",
                ));
            }
        }
        if !solid.beams.is_empty() {
            let found = "found a beam lattice; expected a mesh alone, or a level set";
            return Err(
                Failure::data(path, found).hint("druse voxelize FILE -o PART.vdb makes one")
            );
        }
        if !report.is_solid() {
            return Err(Failure::data(
                path,
                "found a mesh that bounds no solid; expected a closed one without self-intersections",
            )
            .hint("druse check without --require lists the places; druse voxelize repairs it"));
        }
        let (components, cavities) = count_bodies(&solid.file.mesh);
        Ok(judge_mesh(
            require,
            report.volume,
            report.bounds,
            unit,
            components,
            cavities,
        ))
    }
}

/// A level set of a file that is measured.
#[derive(Clone, Copy)]
pub(super) struct MeasuredPart<'a> {
    pub path: &'a Path,
    pub solid: &'a LevelSet,
    /// Name of the unit of its lengths, as the file states it.
    pub unit: &'a str,
}

/// Checks a level set against requirements; the file states its unit.
pub(super) fn of_level_set(
    require: &RequireFile,
    part: MeasuredPart,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Vec<Requirement>, Failure> {
    let unit = length_unit(part.path, part.unit)?;
    Ok(judge_level_set(
        require, part.solid, unit, threads, progress,
    )?)
}

/// The unit of a file's lengths.
pub(super) fn length_unit(path: &Path, unit: &str) -> Result<LengthUnit, Failure> {
    unit.parse().map_err(|_| {
        Failure::data(
            path,
            format!("found the unit {unit:?}; expected one of length"),
        )
    })
}

/// Lists the cavities of a level set as text and as an object.
pub(super) fn list_cavities(
    part: MeasuredPart,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(String, Value), Failure> {
    let unit = length_unit(part.path, part.unit)?;
    let found = level_set_cavities(part.solid, unit, threads, progress)?;
    let facts = json!(found);
    let shown = shown_unit(unit);
    Ok((found.scaled(unit.to(shown)).text(shown), facts))
}

/// The unit of text: parts in metres are shown in millimetres, the unit of printers.
pub(super) fn shown_unit(unit: LengthUnit) -> LengthUnit {
    match unit {
        LengthUnit::Metre => LengthUnit::Millimetre,
        other => other,
    }
}

/// Lines of text about requirements.
pub(super) fn lines(requirements: &[Requirement]) -> String {
    let lines: Vec<String> = requirements.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

/// Adds requirements to an answer; the exit code is 0 if all are met and the other checks have `passed`.
pub(super) fn add(
    mut text: String,
    mut facts: Value,
    passed: bool,
    requirements: &[Requirement],
) -> Answer {
    if !requirements.is_empty() {
        if !text.ends_with('\n') {
            text.push('\n');
        }
        text.push_str(&lines(requirements));
        facts["requirements"] = json!(requirements);
    }
    let met = requirements.iter().all(|r| r.met);
    facts["passed"] = json!(passed && met);
    Answer::new(text, facts).verdict(passed && met)
}
