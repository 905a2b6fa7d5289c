//! The requirements of `[require]`, judged on the finished part.
//!
//! Every requirement is judged by a number of the report. Gaps, cavities and mass are measured here, and
//! only where a requirement needs them.

use super::cavities;
use super::file_measures::{cavities_of, file_context, level_set_layers};
use super::least_wall::{MAX_BRICK_WALL, Phase};
use super::thickness::{SolidGeometry, sampled_walls};
use crate::frame::{Aabb, LengthUnit};
use crate::mesh::TriMesh;
use crate::pipeline::base::context::{StageContext, VoxelLattice};
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::layer_facts::BuildReport;
use crate::pipeline::base::report::{Report, SolidReport};
use crate::pipeline::base::requirement::Requirement;
use crate::pipeline::base::void_facts::CavitiesReport;
use crate::progress::{Progress, Threads};
use crate::recipe::{RequireFile, RequireSection, Scale, Size};
use crate::vdb::{LevelSet, Session};

/// Relative excess of a part over the box that it must fit, up to which it is rounding.
const SIZE_TOLERANCE: f64 = 1e-6;

/// Measures what only requirements need of a solid in memory, cavities and gaps, and enters it in `report`.
pub(crate) fn measure(
    require: &RequireSection,
    context: StageContext,
    solid: &LevelSet,
    mesh: &TriMesh,
    geometry: SolidGeometry,
    report: &mut SolidReport,
) -> Result<(), RunError> {
    if require.escape_radius.is_some() {
        let reach = cavities::reach(require, context.scale);
        let found = cavities_of(context, solid, reach)?;
        report.closed_cavities = require.closed_cavities.map(|_| found.closed);
        report.cavities = Some(found);
    } else if require.closed_cavities.is_some() {
        context.progress.stage("cavities", None);
        let cavities = solid.voids(context.session());
        let cavities = cavities.map_err(RunError::level_set("cavities"))?;
        report.closed_cavities = Some(cavities.len() as u64);
    }
    if require.least_gap.is_some() {
        report.add_gaps(sampled_walls(context, mesh, geometry, Phase::Void)?);
    }
    Ok(())
}

/// Mass in grams of a solid whose lengths are in `unit`; `None` without a density, which is in grams per cubic
/// centimetre.
pub(crate) fn mass(r: &RequireSection, solid: &SolidReport, unit: LengthUnit) -> Option<f64> {
    let density = r.density?.0;
    Some(density * solid.volume * unit.to(LengthUnit::Centimetre).powi(3))
}

/// Judges all requirements by a run's report; lengths are in the unit of `scale`.
pub(crate) fn judge(require: &RequireSection, report: &Report, scale: Scale) -> Vec<Requirement> {
    let mut judge = Judge {
        scale,
        // A run in bricks measures walls up to this thickness only. Thicker ones satisfy any limit below
        // it.
        wall_limit: report
            .bricks
            .map(|_| f64::from(MAX_BRICK_WALL) * scale.voxel_size),
        list: Vec::new(),
    };
    judge.solid(require, &report.solid);
    if let Some(most) = require.value_jump_max {
        let jump = report.continuity.as_ref();
        let value = jump.map(|c| c.value_jump_max);
        // Without shared faces there is no jump.
        let met = value.is_none_or(|v| v <= most.0);
        judge.list.push(Requirement {
            name: "value_jump_max",
            required: format!("at most {}", short_number(most.0)),
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
            "cells without group have the full symmetry of their element and match on shared faces",
        );
    }
    judge.list
}

/// Judges the level set of a file; `unit` is that of its lengths.
///
/// # Errors
/// [`RunError`]: a level set without a surface or too large, an invalid `[build]`, an error of OpenVDB, or cancellation.
pub fn judge_level_set(
    file: &RequireFile,
    solid: &LevelSet,
    unit: LengthUnit,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Vec<Requirement>, RunError> {
    let session = Session::new(threads, progress);
    let failed = RunError::level_set("measure");
    let voxel_size = solid.voxel_size();
    let context = file_context(solid, unit, threads, progress);
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
    // The sampling of walls follows the voxels of the file.
    let geometry = SolidGeometry {
        lattice: VoxelLattice {
            origin: solid.origin(),
            voxel_size,
        },
        active_voxels: solid.active_voxels().map_err(&failed)?,
        extent: found.bounds.size().max() / voxel_size,
    };
    if file.section.least_wall.is_some() {
        let wall = sampled_walls(context, &mesh, geometry, Phase::Solid)?.least();
        report.least_wall = wall.map(|w| w.thickness);
        report.least_wall_place = wall.map(|w| w.centre.into());
    }
    measure(&file.section, context, solid, &mesh, geometry, &mut report)?;
    // Layers take a second pass over the voxels, so only requirements on the build lead to it.
    if let Some(section) = file
        .build
        .as_ref()
        .filter(|_| !file.section.of_builds().is_empty())
    {
        report.build = Some(level_set_layers(
            section, file.unit, solid, unit, threads, progress,
        )?);
    }
    Ok(judge_file(file, report, unit, voxel_size))
}

/// Judges the closed mesh of a file; `unit` is that of its lengths and of volume and bounds. `components` and
/// `cavities` are those that the shells of the mesh bound.
pub fn judge_mesh(
    file: &RequireFile,
    volume: f64,
    bounds: Aabb,
    unit: LengthUnit,
    components: u64,
    cavities: u64,
) -> Vec<Requirement> {
    let report = SolidReport {
        volume,
        bounds: Some(bounds),
        components,
        closed_cavities: Some(cavities),
        ..SolidReport::default()
    };
    // A mesh has no voxels, so that their size is not a number.
    judge_file(file, report, unit, f64::NAN)
}

/// Judges the measures of a file, which are in the file's unit `unit` with voxels of `voxel_size`. Verdicts are in
/// the unit of the requirements.
fn judge_file(
    file: &RequireFile,
    mut report: SolidReport,
    unit: LengthUnit,
    voxel_size: f64,
) -> Vec<Requirement> {
    report.mass = mass(&file.section, &report, unit);
    // Limits are in the unit of the requirements, so the measures are converted to it.
    let factor = unit.to(file.unit);
    let scaled = |v: Option<f64>| v.map(|v| v * factor);
    let moved = |p: Option<[f64; 3]>| p.map(|p| p.map(|c| c * factor));
    report.cavities = report.cavities.map(|c| c.scaled(factor));
    report.build = report.build.map(|b| b.scaled(factor));
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

/// What a number of parts may be.
#[derive(Clone, Copy)]
enum CountLimit {
    Exactly(u64),
    AtMost(u64),
}

/// Collects verdicts; lengths are in the unit of `scale`.
struct Judge {
    scale: Scale,
    /// Greatest diameter of walls and gaps that was measured, if it is limited.
    wall_limit: Option<f64>,
    list: Vec<Requirement>,
}

impl Judge {
    /// Judges the measures of the solid, requirement by requirement in a fixed order; each verdict is added to the
    /// list, with a hint where it is not met.
    fn solid(&mut self, r: &RequireSection, solid: &SolidReport) {
        if let Some(least) = r.least_wall {
            // No wall up to the limit in bricks: it is thicker than that.
            let found = solid.least_wall.or(self.wall_limit);
            self.at_least("least_wall", least, found, solid.least_wall_place);
            self.advise("make walls thicker there: thickness, or dilate");
        }
        if let Some(least) = r.least_gap {
            let found = solid.least_gap;
            // No two surfaces face each other across the void.
            if found.is_none() {
                self.no_gap(least);
            } else {
                self.at_least("least_gap", least, found, solid.least_gap_place);
            }
            self.advise("widen gaps there: larger cells, less thickness, or close them with close");
        }
        if let Some(count) = r.components {
            self.count(
                "components",
                CountLimit::Exactly(count),
                Some(solid.components),
            );
            self.advise("keep_largest = true keeps one component");
        }
        if let Some(most) = r.closed_cavities {
            self.count(
                "closed_cavities",
                CountLimit::AtMost(most),
                solid.closed_cavities,
            );
            self.advise("fill_voids = true fills them; open cells drain them");
        }
        if let Some(least) = r.escape_radius {
            self.escape(least, solid.cavities.as_ref());
            self.advise("widen the way out, or drill one: subtract a cylinder there");
        }
        if let Some(build) = &solid.build {
            self.build(r, build);
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

    /// A length with its unit, for messages.
    fn length(&self, v: f64) -> String {
        format!("{} {}", short_number(v), self.scale.unit)
    }

    /// Enters the requirement that a length is at least `least`. A value without a place is the end of the measured
    /// range, beyond which the length lies.
    fn at_least(
        &mut self,
        name: &'static str,
        least: Size,
        value: Option<f64>,
        place: Option<[f64; 3]>,
    ) {
        let limit = least.resolve(self.scale);
        // A missing value does not meet it: there is nothing to judge.
        let met = value.is_some_and(|v| v >= limit);
        self.list.push(Requirement {
            name,
            required: format!("at least {}", self.length(limit)),
            found: match (value, place) {
                (Some(v), Some(_)) => self.length(v),
                (Some(v), None) => {
                    format!(
                        "more than {}, the greatest that is measured",
                        self.length(v)
                    )
                }
                (None, _) => "no opposite walls".into(),
            },
            value,
            met,
            place: place.filter(|_| !met),
            hint: None,
        });
    }

    /// Enters the requirement on gaps of a solid without any measured gap. It is met unless the measured range
    /// ends below the limit.
    fn no_gap(&mut self, least: Size) {
        let limit = least.resolve(self.scale);
        // Gaps wider than the limit may exist.
        let unmeasured_from = self.wall_limit.filter(|&measured| measured < limit);
        self.list.push(Requirement {
            name: "least_gap",
            required: format!("at least {}", self.length(limit)),
            found: match unmeasured_from {
                Some(measured) => format!(
                    "none up to {}, the greatest that is measured",
                    self.length(measured)
                ),
                None => "no gap".into(),
            },
            value: None,
            met: unmeasured_from.is_none(),
            place: None,
            hint: None,
        });
    }

    /// Enters the requirement on the radius of a ball that can leave every cavity. Without a cavity all ways out
    /// are wider than the measured range.
    fn escape(&mut self, least: Size, cavities: Option<&CavitiesReport>) {
        let limit = least.resolve(self.scale);
        let narrowest = cavities.and_then(|c| c.list.first());
        let value = narrowest.map(|c| c.escape_radius);
        let measured = cavities.map_or(0.0, |c| c.limit);
        self.list.push(Requirement {
            name: "escape_radius",
            required: format!("at least {}", self.length(limit)),
            found: match narrowest {
                Some(c) if c.throat.is_none() => "a closed cavity".into(),
                Some(c) => self.length(c.escape_radius),
                None => format!(
                    "no cavity that a ball of {} cannot leave",
                    self.length(measured)
                ),
            },
            value,
            met: value.unwrap_or(measured) >= limit,
            place: narrowest
                .filter(|c| c.escape_radius < limit)
                .map(|c| c.throat.unwrap_or(c.place)),
            hint: None,
        });
    }

    /// Judges the layers of the build: numbers of islands and cups, and the area of overhangs.
    fn build(&mut self, r: &RequireSection, build: &BuildReport) {
        for (name, most, found, list) in [
            ("islands", r.islands, build.islands, &build.island_list),
            ("cups", r.cups, build.cups, &build.cup_list),
        ] {
            let Some(most) = most else { continue };
            self.count(name, CountLimit::AtMost(most), Some(found));
            // The lowest of them is named.
            if let Some(last) = self.list.last_mut().filter(|r| !r.met) {
                last.place = list.first().map(|s| s.place);
            }
            self.advise(match name {
                "islands" => "another build.up, or supports there",
                _ => "another build.up, or drain = { radius = ... } for closed ones",
            });
        }
        if let Some(most) = r.overhang_area {
            let unit = self.scale.unit;
            let area = |v: f64| format!("{} {unit}^2", short_number(v));
            self.list.push(Requirement {
                name: "overhang_area",
                required: format!("at most {}", area(most)),
                found: area(build.overhang_area),
                value: Some(build.overhang_area),
                met: build.overhang_area <= most,
                place: None,
                hint: None,
            });
            self.advise("another build.up, steeper walls, or supports");
        }
    }

    /// Enters the requirement on a number of parts; a number that was not counted does not meet it.
    fn count(&mut self, name: &'static str, limit: CountLimit, found: Option<u64>) {
        let met = found.is_some_and(|n| match limit {
            CountLimit::Exactly(limit) => n == limit,
            CountLimit::AtMost(limit) => n <= limit,
        });
        self.list.push(Requirement {
            name,
            required: match limit {
                CountLimit::Exactly(limit) => format!("exactly {limit}"),
                CountLimit::AtMost(limit) => format!("at most {limit}"),
            },
            found: found.map_or("not counted".into(), |n| n.to_string()),
            value: found.map(|n| n as f64),
            met,
            place: None,
            hint: None,
        });
    }

    /// Enters the requirement that a number lies in a range, ends included; `unit` is text behind the numbers.
    fn within(&mut self, name: &'static str, range: [f64; 2], unit: &str, value: Option<f64>) {
        let [low, high] = range;
        self.list.push(Requirement {
            name,
            required: format!("from {} to {}{unit}", short_number(low), short_number(high)),
            found: value.map_or("not measured".into(), |v| {
                format!("{}{unit}", short_number(v))
            }),
            value,
            met: value.is_some_and(|v| (low..=high).contains(&v)),
            place: None,
            hint: None,
        });
    }

    /// Enters the requirement that the part fits a box of these sizes along x, y and z.
    fn fits(&mut self, sizes: [Size; 3], bounds: Aabb) {
        let size: [f64; 3] = bounds.size().into();
        let limit = sizes.map(|s| s.resolve(self.scale));
        let met = size
            .iter()
            .zip(limit)
            .all(|(s, r)| *s <= r * (1.0 + SIZE_TOLERANCE));
        let size_text = |v: [f64; 3]| v.map(short_number).join(" x ");
        let unit = self.scale.unit;
        self.list.push(Requirement {
            name: "fits",
            required: format!("at most {} {unit}", size_text(limit)),
            found: format!("{} {unit}", size_text(size)),
            value: None,
            met,
            place: None,
            hint: None,
        });
    }
}
