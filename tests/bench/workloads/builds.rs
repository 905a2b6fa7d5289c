//! P18: the same work by code for any processor, and by a build for this processor alone.

use super::child::{self, Task};
use super::figure::Found;
use crate::Setting;
use druse::simd::InstructionSet;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

type Fault = Box<dyn std::error::Error>;

const ROUNDS: usize = 3;

/// P18 and P18.w2: portable code against that with AVX2, in fresh processes of this build.
pub fn portable(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let own = std::env::current_exe()?;
    let mut found = Vec::new();
    for (key, workload) in [("P18", "w1"), ("P18.w2", "w2")] {
        let [wide, narrow] = [InstructionSet::Avx2, InstructionSet::Portable].map(|code| Task {
            code,
            ..task(workload, setting)
        });
        let ratios = child::ratios(ROUNDS, (&own, narrow), (&own, wide))?;
        found.push(Found::new(key, ratios.median, ratios.to_string()));
    }
    Ok(found)
}

/// P18.native and P18.native.w2: this build against one for this processor, in fresh processes.
pub fn native(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let figures = [("P18.native", "w1"), ("P18.native.w2", "w2")];
    if !setting.builds_native {
        let why = "skipped: builds all again, some minutes; run it by its name: -- P18.native";
        return Ok(figures.map(|(key, _)| Found::skipped(key, why)).into());
    }
    let own = std::env::current_exe()?;
    let other = native_build(&own)?;
    let mut found = Vec::new();
    for (key, workload) in figures {
        let task = task(workload, setting);
        let ratios = child::ratios(ROUNDS, (&own, task), (&other, task))?;
        found.push(Found::new(key, ratios.median, ratios.to_string()));
    }
    Ok(found)
}

fn task(workload: &'static str, setting: &Setting) -> Task {
    Task {
        workload,
        full: setting.full,
        code: InstructionSet::Best,
    }
}

/// Builds this bench for this machine's processor, in a directory `native` beside those of the profiles;
/// gives the program.
fn native_build(own: &Path) -> Result<PathBuf, Fault> {
    // TARGET/PROFILE/deps/workloads-HASH
    let mut above = own.ancestors().skip(2);
    let (Some(profile), Some(target)) = (above.next().and_then(Path::file_name), above.next())
    else {
        return Err(format!("{} is in no target directory", own.display()).into());
    };
    let is_release = profile == "release";
    let flags = std::env::var("RUSTFLAGS").unwrap_or_default();
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let features = [
        ("vdb", cfg!(feature = "vdb")),
        ("cli", cfg!(feature = "cli")),
    ];
    let features: Vec<&str> = features.iter().filter(|f| f.1).map(|f| f.0).collect();
    let mut build = Command::new(cargo);
    build
        .args(["bench", "--bench", "workloads", "--no-run"])
        .args(["--message-format", "json", "--no-default-features"])
        .args(["--features", &features.join(",")])
        .arg("--profile")
        .arg(if is_release {
            "bench".as_ref()
        } else {
            profile
        })
        .env("RUSTFLAGS", format!("{flags} -C target-cpu=native"))
        .env("CARGO_TARGET_DIR", target.join("native"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stderr(Stdio::inherit());
    let output = build.output()?;
    if !output.status.success() {
        return Err(format!("building for this processor: {}", output.status).into());
    }
    let text = String::from_utf8(output.stdout)?;
    let messages = text
        .lines()
        .filter_map(|l| serde_json::from_str::<Value>(l).ok());
    let mut programs = messages.filter_map(|m| {
        let is_ours = m["target"]["name"] == "workloads";
        let path = m["executable"].as_str().filter(|_| is_ours)?;
        Some(PathBuf::from(path))
    });
    let program = programs.next();
    program.ok_or_else(|| "cargo built for this processor, and named no program".into())
}
