//! W4: a part larger than its memory, written as one `.vdb` by the program itself, in a child process
//! whose peak memory (`VmHWM`) its own report tells.

use super::figure::Found;
use crate::Setting;
use serde_json::Value;
use std::process::Command;

type Fault = Box<dyn std::error::Error>;

/// Struts along the axes, 5 x 5 x 5 cells of 100 mm, a tenth of the volume solid.
const W4: &str = "druse = 1\nunit = \"mm\"\n[cell.strut]\ngraph = \"axes\"\nvolume_fraction = 0.1\n[scaffold]\nbox = { size = [500, 500, 500], cell_size = 100 }\n[tiling]\ncell = \"strut\"\n[band]\nvoxel_size = 1\n[[output]]\nvdb = \"w4.vdb\"\n";
/// Voxels along the edge of a cell in the table's W4.
const VOXELS: u32 = 800;
const GIB: f64 = 1_073_741_824.0;

/// What a run of W4 figures.
struct RunFigures {
    /// Bytes.
    peak: f64,
    seconds: f64,
    active_voxels: u64,
    /// Leaves visited against leaves kept, and voxels evaluated against active ones.
    counts: [f64; 2],
}

/// Runs W4 with so many voxels along the edge of a cell within a budget.
fn written(voxels: u32, memory: &str) -> Result<RunFigures, Fault> {
    let place = tempfile::tempdir()?;
    std::fs::write(place.path().join("w4.toml"), W4)?;
    let size = format!("band.voxel_size={}", 100.0 / f64::from(voxels));
    let output = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["run", "w4.toml", "--json", "--quiet", "--threads", "2"])
        .args(["--set", &size, "--memory", memory])
        .current_dir(place.path())
        .output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into());
    }
    let report: Value = serde_json::from_slice(&output.stdout)?;
    let number = |v: &Value| v.as_f64().ok_or("a report without numbers");
    let stages = report["stages"]
        .as_array()
        .ok_or("a report without stages")?;
    let band = |key: &str| number(&report["band"][key]);
    let counts = [
        band("leaves_touched")? / band("leaves_kept")?,
        band("voxels_evaluated")? / band("active_voxels")?,
    ];
    Ok(RunFigures {
        counts,
        peak: number(&report["peak_memory_bytes"])?,
        seconds: stages.iter().filter_map(|s| s["seconds"].as_f64()).sum(),
        active_voxels: report["band"]["active_voxels"].as_u64().unwrap_or(0),
    })
}

/// P11: memory and time of W4, in full or at an eighth of its scale; P10.w4, its counts.
pub fn larger_than_memory(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let voxels = if setting.full { VOXELS } else { VOXELS / 8 };
    let figures = written(voxels, "1G")?;
    let million = figures.active_voxels as f64 / 1e6;
    let note = format!("{voxels} voxels a cell, {million:.0} M active voxels");
    let seconds = if setting.full {
        Found::new("P11.seconds", figures.seconds, note.clone())
    } else {
        Found::skipped(
            "P11.seconds",
            format!("--full; {:.1} s at {voxels} voxels a cell", figures.seconds),
        )
    };
    let [leaves, evaluated] = figures.counts;
    Ok(vec![
        Found::new("P11", figures.peak / GIB, note.clone()),
        seconds,
        Found::new("P10.w4", leaves, note.clone()),
        Found::new("P10.w4.evaluated", evaluated, note),
    ])
}

/// P11.growth: peak memory of a part of eight times the voxels, at the same budget.
pub fn growth(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let (voxels, budget) = if setting.full {
        (VOXELS / 8, "512M")
    } else {
        (VOXELS / 16, "384M")
    };
    let [small, large] = [written(voxels, budget)?, written(2 * voxels, budget)?];
    let note = format!(
        "--memory {budget}: {:.2} and {:.2} GiB at {voxels} and {} voxels a cell",
        small.peak / GIB,
        large.peak / GIB,
        2 * voxels
    );
    Ok(vec![Found::new(
        "P11.growth",
        large.peak / small.peak,
        note,
    )])
}
