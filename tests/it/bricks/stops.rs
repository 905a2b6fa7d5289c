//! Runs in bricks that are stopped, killed, or out of room: whatever happened, the next one completes,
//! with the same hash, and nothing half-written stands under a final name.

use super::super::malformed::damage::Dice;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A hollow ball across the origin that is smoothed: 64 bricks of one block with a halo, and two passes.
const RECIPE: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { centre = [0.3, 0.1, 0], radius = 7 } }\n[[op]]\nmean = 1\n[[op]]\nkeep_largest = true\n[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n";

pub(super) fn druse(place: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command
        .args(line.split(' '))
        .current_dir(place)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

pub(super) fn done(place: &Path, line: &str) -> Output {
    let output = druse(place, line).output().unwrap();
    assert!(output.status.success(), "{line}: {output:?}");
    output
}

/// Code and message of a command that must fail.
pub(super) fn refused(place: &Path, line: &str) -> (i32, String) {
    let output = druse(place, line).output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success(), "{line}");
    (output.status.code().unwrap(), error)
}

pub(super) fn hash(place: &Path, name: &str) -> String {
    let info = done(place, &format!("info {name} --json"));
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    info["content_hash"].as_str().unwrap().to_owned()
}

pub(super) fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("r.toml"), RECIPE).unwrap();
    place
}

fn hidden(place: &Path) -> Vec<String> {
    let entries = fs::read_dir(place).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    names.filter(|n| n.starts_with('.')).collect()
}

/// Runs a command, killing it at random moments, until it completes; checks the output after each.
fn killed_again_and_again(place: &Path, line: &str, kills: usize, wanted: &str) {
    let mut dice = Dice(7);
    let start = Instant::now();
    done(place, line);
    let whole = start.elapsed();
    for _ in 0..kills {
        let _ = fs::remove_file(place.join("a.vdb"));
        let mut child = druse(place, line).spawn().unwrap();
        std::thread::sleep(whole.mul_f64(dice.below(1000) as f64 / 1000.0));
        child.kill().unwrap();
        child.wait().unwrap();
        if place.join("a.vdb").exists() {
            assert_eq!(hash(place, "a.vdb"), wanted);
        }
    }
    done(place, line);
    assert_eq!(hash(place, "a.vdb"), wanted);
}

#[test]
fn a_killed_run_or_merge_is_completed_by_the_next() {
    let kills = if crate::is_full() { 60 } else { 3 };
    let place = place();
    let place = place.path();
    done(place, "run r.toml");
    let wanted = hash(place, "a.vdb");
    killed_again_and_again(place, "run r.toml --bricks 1", kills, &wanted);
    // What the killed ones had begun is gone too.
    assert_eq!(hidden(place), [""; 0]);
    done(place, "plan r.toml -o p.json --bricks 2");
    let bricks = fs::read_to_string(place.join("p.json")).unwrap();
    let bricks: serde_json::Value = serde_json::from_str(&bricks).unwrap();
    let last = bricks["bricks"].as_array().unwrap().len() - 1;
    done(place, &format!("run p.json --brick 0-{last}"));
    killed_again_and_again(place, "merge p.json", kills, &wanted);
}

/// Waits until a file is there.
fn wait_for(child: &mut Child, path: &Path) {
    let start = Instant::now();
    while !path.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_stopped_run_says_that_it_can_go_on() {
    let place = place();
    let place = place.path();
    let line = "run r.toml --bricks 1";
    let mut child = druse(place, line).spawn().unwrap();
    wait_for(&mut child, &place.join(".a.vdb.bricks/brick-000001.leaves"));
    // Meanwhile no other process may work there.
    let (code, error) = refused(place, line);
    assert_eq!(code, 73, "{error}");
    assert!(error.contains("another run"), "{error}");
    let id = child.id().to_string();
    let kill = Command::new("kill").args(["-TERM", &id]).status();
    assert!(kill.unwrap().success());
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(75), "{error}");
    assert!(
        error.contains("of 64 bricks") && error.contains("goes on"),
        "{error}"
    );
    let report = done(place, &format!("{line} --json"));
    let report: serde_json::Value = serde_json::from_slice(&report.stdout).unwrap();
    assert!(report["bricks"]["found_whole"].as_u64().unwrap() > 1);
    assert_eq!(hidden(place), [""; 0]);
}

#[test]
fn missing_and_damaged_bricks_are_named_with_what_makes_them() {
    let place = place();
    let place = place.path();
    done(place, "plan r.toml -o p.json --bricks 2");
    done(place, "run p.json --brick 0-7");
    let brick = |n: u32| place.join(format!("p.bricks/brick-{n:06}.leaves"));
    fs::remove_file(brick(5)).unwrap();
    let mut bytes = fs::read(brick(3)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(brick(3), bytes).unwrap();
    let (code, error) = refused(place, "merge p.json");
    assert_eq!(code, 65, "{error}");
    let advice = "druse run p.json --brick 3 --brick 5";
    for word in ["missing: 5", "damaged or of another plan: 3", advice] {
        assert!(error.contains(word), "{word:?} in {error}");
    }
    done(place, &advice["druse ".len()..]);
    done(place, "merge p.json");
    done(place, "run r.toml --out whole");
    assert_eq!(hash(place, "a.vdb"), hash(place, "whole/a.vdb"));
    // Bits of any processor and those of this one are not mixed.
    for line in ["merge p.json --portable", "run p.json --brick 1 --portable"] {
        let (code, error) = refused(place, line);
        assert_eq!(code, 65, "{error}");
        assert!(error.contains("--portable"), "{error}");
    }
    // More than any disk has room for is refused, not added up beyond the largest number.
    let mut vast: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(place.join("p.json")).unwrap()).unwrap();
    vast["leaf_bytes"] = u64::MAX.into();
    fs::write(place.join("vast.json"), vast.to_string()).unwrap();
    for line in ["merge vast.json", "run vast.json --brick 1"] {
        let (code, error) = refused(place, line);
        assert_eq!(code, 74, "{error}");
        assert!(error.contains("free"), "{error}");
    }
    // Made by another version.
    let plan = fs::read_to_string(place.join("p.json")).unwrap();
    let other = plan.replacen(env!("CARGO_PKG_VERSION"), "0.0.7", 1);
    fs::write(place.join("p.json"), other).unwrap();
    for line in ["merge p.json", "run p.json --brick 1"] {
        let (code, error) = refused(place, line);
        assert_eq!(code, 65, "{error}");
        assert!(error.contains("druse 0.0.7 made the plan"), "{error}");
    }
}

#[test]
fn a_full_disk_keeps_the_bricks_that_are_whole() {
    let place = place();
    let place = place.path();
    // One brick holds nearly all: more than the mean that the check of the disk assumes.
    let uneven = RECIPE.replace("[0.3, 0.1, 0], radius = 7", "[10, 10, 10], radius = 9");
    fs::write(place.join("r.toml"), uneven).unwrap();
    done(place, "run r.toml");
    let wanted = hash(place, "a.vdb");
    let disk = place.join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = |size: u64| {
        let options = format!("size={size}");
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &options, "druse-test"]);
        let mounted = mount.arg(&disk).stderr(Stdio::null()).status();
        mounted.is_ok_and(|s| s.success())
    };
    let unmount = || {
        Command::new("umount")
            .arg(&disk)
            .status()
            .unwrap()
            .success()
    };
    // Too small for all of it: told before anything is made.
    if !mount(1 << 18) {
        println!("no right to mount a small disk: not tried");
        return;
    }
    let (code, error) = refused(place, "run r.toml --bricks 1 --out disk");
    let left = fs::read_dir(&disk).unwrap().count();
    assert!(unmount());
    assert_eq!((code, left), (74, 0), "{error}");
    assert!(error.contains("are free"), "{error}");
    // Enough for the mean brick, not for the fullest.
    assert!(mount(1 << 19));
    done(place, "plan r.toml -o disk/p.json --bricks 1");
    let plan = fs::read_to_string(disk.join("p.json")).unwrap();
    let plan: serde_json::Value = serde_json::from_str(&plan).unwrap();
    let count = plan["bricks"].as_array().unwrap().len();
    let (code, error) = refused(place, &format!("run disk/p.json --brick 0-{}", count - 1));
    let names = fs::read_dir(disk.join("p.bricks")).unwrap();
    let names: Vec<_> = names.map(|e| e.unwrap().file_name()).collect();
    assert!(unmount());
    assert_eq!(code, 74, "{error}");
    if !error.contains("are free") {
        assert!(error.contains("No space left"), "{error}");
        assert!(
            error.contains("brick-") && error.contains("goes on"),
            "{error}"
        );
        assert!(
            names
                .iter()
                .all(|n| n.to_string_lossy().ends_with(".leaves")),
            "{names:?}"
        );
    }
    assert_eq!(hash(place, "a.vdb"), wanted);
}

#[test]
fn bricks_too_wide_to_be_operated_on_say_which_are_not() {
    let place = place();
    let place = place.path();
    for line in [
        "run r.toml --bricks 64",
        "plan r.toml -o p.json --bricks 64",
    ] {
        let (code, error) = refused(place, line);
        assert_eq!(code, 65, "{error}");
        assert!(error.contains("--bricks 31"), "{error}");
    }
    done(place, "run r.toml --bricks 31 --out out");
}

#[test]
fn a_budget_too_small_says_the_least_that_works() {
    let place = place();
    let place = place.path();
    let line = |memory: &str| format!("run r.toml --memory {memory} --out out");
    let (code, error) = refused(place, &line("32M"));
    assert_eq!(code, 65, "{error}");
    let least: u64 = error
        .split("at least ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next()?.parse().ok())
        .unwrap_or_else(|| panic!("no least budget in {error}"));
    // What the program holds before it counts differs by some pages from run to run.
    done(place, &line(&format!("{}M", least + 4)));
}
