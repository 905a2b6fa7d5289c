//! A program that reads a `.vdb` is the child of a process that waits for it: signals, ends, damaged files.

use super::limits::{lattice, lattice_of, wait_until_idle};
use super::{Place, json, text};
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The program as the child of a process: it reads a `.vdb`. Waits for it.
pub(super) fn child_of(parent: u32) -> u32 {
    let path = format!("/proc/{parent}/task/{parent}/children");
    let end = Instant::now() + Duration::from_secs(60);
    loop {
        let children = fs::read_to_string(&path).unwrap();
        if let Some(id) = children.split_whitespace().next() {
            return id.parse().unwrap();
        }
        assert!(Instant::now() < end, "process {parent} has no child");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends a signal to a process, or with a minus sign to a group of them.
pub(super) fn send(signal: &str, id: &str) {
    let kill = Command::new("kill")
        .args([&format!("-{signal}"), "--", id])
        .status();
    assert!(kill.unwrap().success());
}

/// A long filter of a `.vdb`, in a group of its own, once it filters; and what it printed later.
fn long_filter(place: &Place) -> (Child, JoinHandle<String>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["filter", "a.vdb", "gaussian={width=3,iterations=1000}"])
        .args(["-o", "f.vdb", "--progress=plain"])
        .current_dir(&place.0)
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.any(|l| l.unwrap().starts_with("gaussian")));
    let rest = std::thread::spawn(move || {
        let lines: Vec<String> = lines.map(Result::unwrap).collect();
        lines.join("\n")
    });
    (child, rest)
}

/// A program that reads a `.vdb` is the child of a process that passes signals on. One interrupt of a terminal reaches
/// both, and is one all the same.
#[test]
fn signals_reach_a_program_with_a_parent_once() {
    let place = lattice_of(0.04);
    for (signal, code, is_of_group) in [
        ("INT", 130, false),
        ("TERM", 143, false),
        ("INT", 130, true),
    ] {
        let (mut parent, rest) = long_filter(&place);
        let id = parent.id();
        let group = format!("-{id}");
        send(signal, if is_of_group { &group } else { &group[1..] });
        assert_eq!(parent.wait().unwrap().code(), Some(code));
        let printed = rest.join().unwrap();
        assert!(
            printed.contains("nothing half-written remains"),
            "{printed}"
        );
        assert!(!place.files().iter().any(|f| f.starts_with('f')));
    }
}

/// A program that waits for a reader of its pipe, idle, in a group of its own.
fn waiting_program(place: &Place) -> Child {
    let pipe = place.0.path().join("pipe.stl");
    let made = Command::new("mkfifo").arg(pipe).status();
    assert!(made.unwrap().success());
    let parent = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["mesh", "a.vdb", "-o", "pipe.stl"])
        .current_dir(&place.0)
        .process_group(0)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_until_idle(child_of(parent.id()));
    parent
}

/// The words of a program that one signal has cancelled, and that still waits two seconds later.
const IDLE_WORDS: &str = "stopped while waiting";

#[test]
fn further_interrupts_of_the_parent_end_the_program_at_once() {
    let place = lattice_of(0.1);
    let mut parent = waiting_program(&place);
    let start = Instant::now();
    // Within half a second two are one.
    for _ in 0..2 {
        send("INT", &parent.id().to_string());
        std::thread::sleep(Duration::from_millis(800));
    }
    while parent.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(10));
    }
    let output = parent.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    // After two seconds a program that one has cancelled has words.
    assert!(!text(&output.stderr).contains(IDLE_WORDS));
}

/// One of a terminal reaches both processes, and is passed on all the same; `timeout` sends its signal to the process
/// and to its group.
#[test]
fn a_signal_to_both_processes_is_one() {
    for is_of_timeout in [false, true] {
        let place = lattice_of(0.1);
        let parent = waiting_program(&place);
        let id = parent.id();
        let (process, group) = (id.to_string(), format!("-{id}"));
        let mut kill = Command::new("kill");
        kill.args(["-TERM", "--"]);
        kill.args(is_of_timeout.then_some(process)).arg(group);
        assert!(kill.status().unwrap().success());
        let output = parent.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(143));
        assert!(text(&output.stderr).contains(IDLE_WORDS));
    }
}

/// Whether a process has ended, whoever is to bury it.
fn has_ended(id: u32) -> bool {
    fs::read_to_string(format!("/proc/{id}/stat"))
        .ok()
        .and_then(|s| Some(s.rsplit_once(')')?.1.trim_start().starts_with('Z')))
        .unwrap_or(true)
}

#[test]
fn a_killed_parent_takes_the_program_along_and_a_killed_program_its_parent() {
    let place = lattice_of(0.04);
    let (mut parent, rest) = long_filter(&place);
    let program = child_of(parent.id());
    parent.kill().unwrap();
    parent.wait().unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while !has_ended(program) {
        assert!(Instant::now() < end, "the program goes on");
        std::thread::sleep(Duration::from_millis(5));
    }
    rest.join().unwrap();
    let (mut parent, rest) = long_filter(&place);
    send("KILL", &child_of(parent.id()).to_string());
    assert_eq!(parent.wait().unwrap().signal(), Some(9));
    assert_eq!(rest.join().unwrap(), "");
}

/// A sound file is not at fault.
#[test]
fn a_crash_after_a_sound_file_was_read_is_passed_on() {
    let place = lattice_of(0.04);
    for (signal, number) in [("ABRT", 6), ("ILL", 4)] {
        let (mut parent, rest) = long_filter(&place);
        send(signal, &child_of(parent.id()).to_string());
        assert_eq!(parent.wait().unwrap().signal(), Some(number));
        assert_eq!(rest.join().unwrap(), "");
    }
}

/// One that is damaged is: here because it is another one by now.
#[test]
fn a_crash_after_a_damaged_file_was_read_is_the_error_of_the_file() {
    let place = lattice_of(0.04);
    let (mut parent, rest) = long_filter(&place);
    place.write("a.vdb", include_bytes!("../../data/crash.vdb"));
    send("ABRT", &child_of(parent.id()).to_string());
    assert_eq!(parent.wait().unwrap().code(), Some(65));
    let error = rest.join().unwrap();
    assert!(
        error.starts_with("error: reading it ") && error.ends_with("--> a.vdb"),
        "{error}"
    );
}

/// A length of text of 4 GiB, which the library allocates before it reads.
#[test]
fn a_file_that_needs_much_memory_is_one_error() {
    let place = lattice();
    let mut bytes = fs::read(place.0.path().join("a.vdb")).unwrap();
    // Behind the magic number, three versions, a flag, an identifier of 36 letters, and the number of the tags.
    bytes[61..65].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    place.write("m.vdb", &bytes);
    for arguments in [&["info", "m.vdb"][..], &["mesh", "m.vdb", "-o", "m.stl"]] {
        let output = place.run(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{error}");
        assert!(
            error.starts_with("error: reading it needs more than 20"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 2, "{error}");
    }
}

/// Of the libraries' own words nothing is shown.
#[test]
fn a_file_that_crashes_its_reader_is_one_error() {
    let place = Place::new();
    place.write("crash.vdb", include_bytes!("../../data/crash.vdb"));
    for arguments in [
        &["info", "crash.vdb"][..],
        &["mesh", "crash.vdb", "-o", "m.stl"],
        &["check", "crash.vdb", "--json"],
    ] {
        let output = place.run(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{error}");
        assert!(error.starts_with("error: reading it "), "{error}");
        assert_eq!(error.lines().count(), 2, "{error}");
        if arguments.contains(&"--json") {
            assert_eq!(json(&output)["file"], "crash.vdb");
        }
    }
    assert_eq!(place.files(), ["crash.vdb"]);
}

/// OpenVDB's own tags have its own types, or are none.
#[test]
fn tags_of_another_type_are_no_failure_of_openvdb() {
    let place = lattice();
    let whole = fs::read(place.0.path().join("a.vdb")).unwrap();
    for name in [
        "class",
        "file_compression",
        "file_bbox_min",
        "druse.version",
    ] {
        let mut bytes = whole.clone();
        // A name, the length of its type's name, and that name.
        let mut found = 0;
        for at in 0..bytes.len() - name.len() - 8 {
            if bytes[at..].starts_with(name.as_bytes()) {
                let first = at + name.len() + 4;
                if [&b"string"[..], b"vec3i"]
                    .iter()
                    .any(|t| bytes[first..].starts_with(t))
                {
                    bytes[first] = b'x';
                    found += 1;
                }
            }
        }
        assert!(found > 0, "{name}");
        place.write("m.vdb", &bytes);
        let output = place.run(&["filter", "m.vdb", "prune", "-o", "f.vdb"]);
        let error = text(&output.stderr);
        assert!(output.status.success(), "{name}: {error}");
    }
}
