//! Warnings on a period: disconnected phases, beams that the grid does not resolve.

use crate::cli::{Failure, Session};
use crate::homogenize::{Period, Properties};
use crate::pipeline::{CellPeriod, Warning};

/// Minimum number of voxels across the thinnest beam without a warning.
const MIN_VOXELS_PER_DIAMETER: f64 = 3.0;

/// Warns of disconnected phases and of beams that the grid does not resolve.
pub(super) fn warn_of(
    source: &CellPeriod,
    found: &Properties,
    n: usize,
    growth: f64,
    session: &Session,
) -> Result<(), Failure> {
    if let Some(message) = disconnected(&source.period, found) {
        session.warn_of(Warning::DISCONNECTED, format!("{}: {message}", source.name))?;
    }
    if let Some(diameter) = source.period.least_diameter() {
        let diameter = diameter + 2.0 * growth;
        let across = diameter * n as f64;
        if across < MIN_VOXELS_PER_DIAMETER {
            let message = format!(
                "{}: struts of diameter {diameter:.4} are {across:.1} voxels wide; {MIN_VOXELS_PER_DIAMETER} or more resolve \
                 them: --resolution {}",
                source.name,
                (MIN_VOXELS_PER_DIAMETER / diameter.max(1e-9))
                    .ceil()
                    .min(1e6) as usize
                    / 2
                    * 2
                    + 2
            );
            session.warn_of(Warning::THIN_WALLS, message)?;
        }
    }
    Ok(())
}

/// A description of phases that are disconnected or missing.
fn disconnected(period: &Period, found: &Properties) -> Option<String> {
    let axes = |percolates: [bool; 3]| -> Vec<&str> {
        let used = if period.element().dimension() == 2 {
            2
        } else {
            3
        };
        let names = ["x", "y", "z"].into_iter().zip(percolates).take(used);
        names.filter(|a| !a.1).map(|a| a.0).collect()
    };
    let mut all = Vec::new();
    if found.solid.voxels == 0 {
        return Some("no voxel is solid".to_owned());
    }
    let ends = axes(found.solid.percolates);
    if !ends.is_empty() {
        all.push(format!(
            "the solid does not go on along {}: its stiffness and conductivity there are those of the void",
            ends.join(", ")
        ));
    }
    if found.solid.components > 1 {
        all.push(format!(
            "the solid falls into {} components per period, the largest with {:.1} % of it",
            found.solid.components,
            found.solid.largest_per_mille as f64 / 10.0
        ));
    }
    let ends = axes(found.void.percolates);
    if found.permeability.is_some() && !ends.is_empty() {
        all.push(format!(
            "the void does not go on along {}: nothing flows there",
            ends.join(", ")
        ));
    }
    (!all.is_empty()).then(|| all.join("; "))
}
