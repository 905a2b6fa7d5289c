//! `[require]`: whether the finished part fulfils what the recipe requires of it.
//!
//! Every requirement is judged by a number of the report. Those that the report does not always hold
//! (gaps, cavities, mass) are measured here, only where they are required.

use super::error::{RunError, short};
use super::least_wall::{Phase, REACH};
use super::level_set_ops::Bench;
use super::report::{Report, SolidReport};
use super::thickness::{Lattice, Measured, sampled_walls};
use crate::frame::{Aabb, LengthUnit};
use crate::mesh::TriMesh;
use crate::progress::{Progress, Threads};
use crate::recipe::{RequireFile, RequireSection, Scale, Size};
use crate::vdb::{LevelSet, Session};
use serde::Serialize;

/// Sizes of a part that exceed the box it must fit by less than this share are rounding.
const ROUNDING: f64 = 1e-6;

/// One requirement and what was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Requirement {
    /// Its key in `[require]`.
    pub name: &'static str,
    /// What is required, with its unit.
    pub required: String,
    /// What was found, with its unit.
    pub found: String,
    /// The same as a number, where there is one: lengths in the unit of the requirement, mass in grams.
    pub value: Option<f64>,
    /// Whether it is met.
    pub met: bool,
    /// Where the worst place is, in the unit of the requirement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 3]>,
    /// What to do where it is not met.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<&'static str>,
}

impl std::fmt::Display for Requirement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verdict = if self.met { "met" } else { "NOT met" };
        let Self {
            name,
            required,
            found,
            ..
        } = self;
        write!(f, "require {name}: {verdict}: {required}, found {found}")?;
        if let Some([x, y, z]) = self.place.map(|p| p.map(short)) {
            write!(f, " at ({x}, {y}, {z})")?;
        }
        if let Some(hint) = self.hint {
            write!(f, "; {hint}")?;
        }
        Ok(())
    }
}

/// Measures what only requirements need of a solid in memory: cavities and gaps.
pub(super) fn measure(
    require: &RequireSection,
    bench: Bench,
    (solid, mesh, measured): (&LevelSet, &TriMesh, Measured),
    report: &mut SolidReport,
) -> Result<(), RunError> {
    if require.closed_cavities.is_some() {
        bench.progress.stage("cavities", None);
        let cavities = solid.voids(bench.session());
        let cavities = cavities.map_err(RunError::level_set("cavities"))?;
        report.closed_cavities = Some(cavities.len() as u64);
    }
    if require.least_gap.is_some() {
        report.add_gaps(sampled_walls(bench, mesh, measured, Phase::Void)?);
    }
    Ok(())
}

/// Grams of a solid whose lengths are in `unit`.
pub(super) fn mass(r: &RequireSection, solid: &SolidReport, unit: LengthUnit) -> Option<f64> {
    let density = r.density?.0;
    Some(density * solid.volume * unit.to(LengthUnit::Centimetre).powi(3))
}

/// Judges all requirements by a run's report; lengths are in the unit of `scale`.
pub(super) fn judge(require: &RequireSection, report: &Report, scale: Scale) -> Vec<Requirement> {
    let mut judge = Judge {
        scale,
        wall_limit: report.bricks.map(|_| f64::from(REACH) * scale.voxel_size),
        list: Vec::new(),
    };
    judge.solid(require, &report.solid);
    if let Some(most) = require.value_jump_max {
        let jump = report.continuity.as_ref();
        let value = jump.map(|c| c.value_jump_max);
        let met = value.is_none_or(|v| v <= most.0);
        judge.list.push(Requirement {
            name: "value_jump_max",
            required: format!("at most {}", short(most.0)),
            found: value.map_or("no shared faces".into(), |v| format!("{v:.3e}")),
            value,
            met,
            place: jump
                .and_then(|c| c.worst.first())
                .map(|w| w.at)
                .filter(|_| !met),
            hint: None,
        });
        judge.advise(
            "cells without group have their element's whole symmetry and agree on shared faces",
        );
    }
    judge.list
}

/// Judges a level set of a file; `unit` is that of its lengths.
///
/// # Errors
/// [`RunError`]: a requirement that only a run can judge, a file too large, or the user stopped it.
pub fn judge_level_set(
    file: &RequireFile,
    (solid, unit): (&LevelSet, LengthUnit),
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Vec<Requirement>, RunError> {
    let session = Session::new(threads, progress);
    let failed = RunError::level_set("measure");
    let voxel_size = solid.voxel_size();
    let bench = Bench {
        threads,
        progress,
        scale: Scale { unit, voxel_size },
        half_width: solid.half_width(),
        region: None,
    };
    let mesh = solid.to_mesh(session).map_err(&failed)?;
    if mesh.is_empty() {
        return Err(RunError::Empty("reading".into()));
    }
    let found = threads.install(|| mesh.measures());
    let mut report = SolidReport {
        volume: found.volume,
        bounds: Some(found.bounds),
        components: solid.components(session).map_err(&failed)?.len() as u64,
        ..SolidReport::default()
    };
    let measured = Measured {
        lattice: Lattice {
            origin: solid.origin(),
            voxel_size,
        },
        active_voxels: solid.active_voxels().map_err(&failed)?,
        extent: found.bounds.size().max() / voxel_size,
    };
    if file.section.least_wall.is_some() {
        let wall = sampled_walls(bench, &mesh, measured, Phase::Solid)?.least();
        report.least_wall = wall.map(|w| w.thickness);
        report.least_wall_place = wall.map(|w| w.place.into());
    }
    measure(&file.section, bench, (solid, &mesh, measured), &mut report)?;
    Ok(judge_file(file, report, unit, voxel_size))
}

/// Judges a closed mesh of a file; `unit` is that of its lengths. `components` and `cavities` are what the
/// shells of the mesh bound.
pub fn judge_mesh(
    file: &RequireFile,
    (volume, bounds, unit): (f64, Aabb, LengthUnit),
    (components, cavities): (u64, u64),
) -> Vec<Requirement> {
    let report = SolidReport {
        volume,
        bounds: Some(bounds),
        components,
        closed_cavities: Some(cavities),
        ..SolidReport::default()
    };
    judge_file(file, report, unit, f64::NAN)
}

/// Judges what was measured of a file in its own unit.
fn judge_file(
    file: &RequireFile,
    mut report: SolidReport,
    unit: LengthUnit,
    voxel_size: f64,
) -> Vec<Requirement> {
    report.mass = mass(&file.section, &report, unit);
    let factor = unit.to(file.unit);
    let scaled = |v: Option<f64>| v.map(|v| v * factor);
    let moved = |p: Option<[f64; 3]>| p.map(|p| p.map(|c| c * factor));
    report.least_wall = scaled(report.least_wall);
    report.least_gap = scaled(report.least_gap);
    report.least_wall_place = moved(report.least_wall_place);
    report.least_gap_place = moved(report.least_gap_place);
    report.bounds = report.bounds.map(|b| Aabb {
        min: b.min * factor,
        max: b.max * factor,
    });
    let mut judge = Judge {
        scale: Scale {
            unit: file.unit,
            voxel_size: voxel_size * factor,
        },
        wall_limit: None,
        list: Vec::new(),
    };
    judge.solid(&file.section, &report);
    judge.list
}

/// Collects verdicts.
struct Judge {
    scale: Scale,
    /// Diameter up to which walls and gaps were looked for, if there is an end.
    wall_limit: Option<f64>,
    list: Vec<Requirement>,
}

impl Judge {
    /// What the solid's own measures tell.
    fn solid(&mut self, r: &RequireSection, solid: &SolidReport) {
        if let Some(least) = r.least_wall {
            let found = solid.least_wall.or(self.wall_limit);
            self.at_least("least_wall", least, (found, solid.least_wall_place));
            self.advise("make walls thicker there: thickness, or dilate");
        }
        if let Some(least) = r.least_gap {
            let found = solid.least_gap;
            if found.is_none() {
                self.no_gap(least);
            } else {
                self.at_least("least_gap", least, (found, solid.least_gap_place));
            }
            self.advise("widen gaps there: larger cells, less thickness, or close them with close");
        }
        if let Some(count) = r.components {
            self.count("components", ("exactly", count), Some(solid.components));
            self.advise("keep_largest = true keeps one component");
        }
        if let Some(most) = r.closed_cavities {
            self.count("closed_cavities", ("at most", most), solid.closed_cavities);
            self.advise("fill_voids = true fills them; open cells drain them");
        }
        if let Some(range) = r.volume_fraction {
            self.within("volume_fraction", range, "", solid.volume_fraction);
            self.advise("volume_fraction, level or thickness of the cell change it");
        }
        if let Some(range) = r.mass {
            self.within("mass", range, " g", solid.mass);
        }
        if let (Some(sizes), Some(bounds)) = (r.fits, solid.bounds) {
            self.fits(sizes, bounds);
        }
    }

    /// Adds a hint to the last requirement if it is not met.
    fn advise(&mut self, hint: &'static str) {
        if let Some(last) = self.list.last_mut().filter(|r| !r.met) {
            last.hint = Some(hint);
        }
    }

    fn length(&self, v: f64) -> String {
        format!("{} {}", short(v), self.scale.unit)
    }

    fn at_least(
        &mut self,
        name: &'static str,
        least: Size,
        (value, place): (Option<f64>, Option<[f64; 3]>),
    ) {
        let wanted = least.resolve(self.scale);
        let met = value.is_some_and(|v| v >= wanted);
        self.list.push(Requirement {
            name,
            required: format!("at least {}", self.length(wanted)),
            found: match (value, place) {
                (Some(v), Some(_)) => self.length(v),
                (Some(v), None) => {
                    format!("more than {}, the widest that is measured", self.length(v))
                }
                (None, _) => "no opposite walls".into(),
            },
            value,
            met,
            place: place.filter(|_| !met),
            hint: None,
        });
    }

    fn no_gap(&mut self, least: Size) {
        let wanted = least.resolve(self.scale);
        // Wider gaps than are looked for may be there.
        let limit = self.wall_limit.filter(|&limit| limit < wanted);
        self.list.push(Requirement {
            name: "least_gap",
            required: format!("at least {}", self.length(wanted)),
            found: match limit {
                Some(limit) => format!(
                    "none up to {}, the widest that is measured",
                    self.length(limit)
                ),
                None => "no gap".into(),
            },
            value: None,
            met: limit.is_none(),
            place: None,
            hint: None,
        });
    }

    fn count(&mut self, name: &'static str, (how, wanted): (&str, u64), found: Option<u64>) {
        let met = found.is_some_and(|n| match how {
            "exactly" => n == wanted,
            _ => n <= wanted,
        });
        self.list.push(Requirement {
            name,
            required: format!("{how} {wanted}"),
            found: found.map_or("not counted".into(), |n| n.to_string()),
            value: found.map(|n| n as f64),
            met,
            place: None,
            hint: None,
        });
    }

    fn within(&mut self, name: &'static str, range: [f64; 2], unit: &str, value: Option<f64>) {
        let [low, high] = range;
        self.list.push(Requirement {
            name,
            required: format!("from {} to {}{unit}", short(low), short(high)),
            found: value.map_or("not measured".into(), |v| format!("{}{unit}", short(v))),
            value,
            met: value.is_some_and(|v| (low..=high).contains(&v)),
            place: None,
            hint: None,
        });
    }

    fn fits(&mut self, sizes: [Size; 3], bounds: Aabb) {
        let size: [f64; 3] = bounds.size().into();
        let room = sizes.map(|s| s.resolve(self.scale));
        let met = size
            .iter()
            .zip(room)
            .all(|(s, r)| *s <= r * (1.0 + ROUNDING));
        let show = |v: [f64; 3]| v.map(short).join(" x ");
        let unit = self.scale.unit;
        self.list.push(Requirement {
            name: "fits",
            required: format!("at most {} {unit}", show(room)),
            found: format!("{} {unit}", show(size)),
            value: None,
            met,
            place: None,
            hint: None,
        });
    }
}
