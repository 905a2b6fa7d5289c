//! `--layer LENGTH` of `druse check`: the layers of a part, as a printer stacks them.
//!
//! An island is a component of a layer that lies over nothing, a cup a pocket that opens upwards or that the plate
//! closes, a sealed area one of holes that are closed within their layer, an overhang an area that needs support.
//! The flags become a section `[build]` of a recipe; its bare lengths are in the file's unit.

use super::failure::Failure;
use super::require::{MeasuredPart, length_unit, shown_unit};
use crate::frame::LengthUnit;
use crate::io::atomic::{require_writable, write_bytes};
use crate::pipeline::{BuildReport, SweepCurve, level_set_layers, sweep_picture};
use crate::progress::{Progress, Threads};
use crate::recipe::{BuildSection, Finite, Size};
use clap::Args;
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(Args)]
#[group(skip)] // the name of the struct is that of others in one command
pub(super) struct Parameters {
    /// List islands, cups, overhangs and cross-sections of a level set in layers of this height, as in 0.05mm.
    #[arg(long, value_name = "LENGTH")]
    layer: Option<Size>,
    /// With --layer: the direction in which layers are stacked [default: 0,0,1].
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        num_args = 1,
        requires = "layer",
        allow_hyphen_values = true
    )]
    up: Vec<f64>,
    /// With --layer: greatest angle between a wall and that direction that needs no support [default: 45].
    #[arg(long, value_name = "DEGREES", requires = "layer")]
    overhang: Option<f64>,
    /// With --layer: write a plot of the layers over height (.png).
    #[arg(long, value_name = "X.png", requires = "layer")]
    plot: Option<PathBuf>,
}

impl Parameters {
    /// Whether layers are requested: the other flags need `--layer`.
    pub(super) fn is_requested(&self) -> bool {
        self.layer.is_some()
    }

    /// The section of the flags, if layers are requested; an error of usage for a value out of range.
    fn section(&self) -> Result<Option<BuildSection>, Failure> {
        let Some(layer) = self.layer else {
            return Ok(None);
        };
        let mut section = BuildSection::new(layer);
        match self.up[..] {
            [] => {}
            [x, y, z] if [x, y, z].iter().all(|c| c.is_finite()) => {
                section.up = [x, y, z].map(Finite);
            }
            _ => {
                let found = format!("found --up with {:?}", self.up);
                return Err(Failure::usage(format!(
                    "{found}; expected three numbers, as in 0,0,1"
                )));
            }
        }
        if let Some(angle) = self.overhang {
            section.overhang = Finite(angle);
        }
        if let Some((key, message)) = section.fault() {
            return Err(Failure::usage(format!("--{key}: {message}")));
        }
        Ok(Some(section))
    }

    /// Refuses a plot that cannot be written, before the work.
    pub(super) fn require_writable(&self) -> Result<(), Failure> {
        Ok(self.plot.as_ref().map_or(Ok(()), require_writable)?)
    }

    /// Measures the layers of a level set and writes the plot, if one is requested. Returns text in a unit for
    /// people and an object in the file's unit; `None` without `--layer`.
    pub(super) fn list(
        &self,
        part: MeasuredPart,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Option<(String, Value)>, Failure> {
        let Some(section) = self.section()? else {
            return Ok(None);
        };
        let unit = length_unit(part.path, part.unit)?;
        // Bare lengths of the section and the results are both in the file's unit.
        let found = level_set_layers(&section, unit, part.solid, unit, threads, progress)?;
        let facts = json!(found);
        let shown = shown_unit(unit);
        let found = found.scaled(unit.to(shown));
        if let Some(plot) = &self.plot {
            write_bytes(plot, &picture(&found, shown).png()?)?;
        }
        Ok(Some((found.text(shown), facts)))
    }
}

/// The plot of layers over height; the report's lengths are in `unit`.
fn picture(report: &BuildReport, unit: LengthUnit) -> crate::vdb::Image {
    let curve = |name: &str, value: &dyn Fn(usize) -> f64| SweepCurve {
        name: format!("{name}, {unit}^2"),
        points: (0..report.profile.len())
            .map(|n| [report.profile[n].height, value(n)])
            .collect(),
    };
    let curves = [
        curve("section", &|n| report.profile[n].area),
        curve("overhang", &|n| report.profile[n].overhang),
        curve("sealed", &|n| report.profile[n].sealed),
    ];
    let title = format!(
        "{} layers, {} islands, {} cups",
        report.layers, report.islands, report.cups
    );
    sweep_picture(&title, &format!("height, {unit}"), &curves)
}
