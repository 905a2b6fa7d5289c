//! What killed programs leave is removed by the next that writes there, and nothing that a living one writes.

use super::druse;
use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Bricks of one block; the mesh is written from the first brick to the last.
const RECIPE: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n[[op]]\n\
     union = { sphere = { radius = 14, centre = [1, 2, 3] } }\n[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n";

/// Hidden names in a folder that begin so.
fn hidden(folder: &Path, start: &str) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    names.filter(|n| n.starts_with(start)).collect()
}

/// Waits until a child has a file with such a hidden name.
fn wait_for(child: &mut Child, folder: &Path, start: &str) -> String {
    let begin = Instant::now();
    loop {
        if let Some(name) = hidden(folder, start).pop() {
            return name;
        }
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        assert!(begin.elapsed() < Duration::from_secs(120));
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args([name, &id])
            .status()
            .unwrap()
            .success()
    );
}

fn killed(child: &mut Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn files_of_killed_runs_go_and_those_of_living_ones_stay() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    fs::write(place.join("r.toml"), RECIPE).unwrap();
    // Of the same part in another folder for bricks, so that the runs do not wait for each other.
    let line = "run r.toml --bricks 1 --quiet";
    let mut child = druse(place, line).spawn().unwrap();
    let left = wait_for(&mut child, place, ".a.stl.");
    killed(&mut child);
    assert!(place.join(&left).exists());
    let mut child = druse(place, line).spawn().unwrap();
    let working = wait_for_other(&mut child, place, &left);
    assert!(!place.join(&left).exists());
    signal(&child, "-STOP");
    // Another program writes the same file meanwhile.
    fs::write(
        place.join("tetrahedron.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .unwrap();
    let other = druse(place, "crystal tetrahedron.obj -o a.stl")
        .output()
        .unwrap();
    let is_there = place.join(&working).exists();
    signal(&child, "-CONT");
    let ended = child.wait().unwrap();
    assert!(other.status.success() && is_there && ended.success());
    assert_eq!(hidden(place, "."), [""; 0]);
}

/// Waits until a child has a partial file of the mesh that is not this one.
fn wait_for_other(child: &mut Child, folder: &Path, left: &str) -> String {
    loop {
        let name = wait_for(child, folder, ".a.stl.");
        if name != left {
            return name;
        }
    }
}

#[test]
fn the_folder_of_a_killed_repetition_goes() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    fs::write(place.join("r.toml"), RECIPE).unwrap();
    assert!(
        druse(place, "run r.toml")
            .output()
            .unwrap()
            .status
            .success()
    );
    let mut child = druse(place, "run a.vdb").spawn().unwrap();
    let left = wait_for(&mut child, place, ".druse-repeat.");
    // A repetition at the same time leaves it alone.
    let other = druse(place, "run a.vdb").output().unwrap();
    assert!(other.status.success());
    if child.try_wait().unwrap().is_none() {
        assert!(place.join(&left).exists());
    }
    killed(&mut child);
    assert!(druse(place, "run a.vdb").output().unwrap().status.success());
    assert_eq!(hidden(place, "."), [""; 0]);
}
