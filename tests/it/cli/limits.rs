//! Limits of the process and the machine: memory, files, signals, folders. Each ends in one clear error.

use super::parent::{child_of, send};
use super::{BALL, FILES, Place, json, refuse, text};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The program under limits that a shell sets.
pub(super) fn limited(limits: &str, arguments: &[&str]) -> Command {
    let mut shell = Command::new("bash");
    shell
        .args(["-c", &format!("{limits} && exec \"$0\" \"$@\"")])
        .arg(env!("CARGO_BIN_EXE_druse"))
        .args(arguments);
    shell
}

fn run(place: &Place, limits: &str, arguments: &[&str]) -> Output {
    let mut program = limited(limits, arguments);
    program.current_dir(&place.0).stdin(Stdio::null());
    program.output().unwrap()
}

pub(super) fn lattice() -> Place {
    lattice_of(0.4)
}

/// The files of a ball with these voxels.
pub(super) fn lattice_of(voxel_size: f64) -> Place {
    let ball = BALL.replace("0.4", &voxel_size.to_string());
    let place = Place::with(&format!("{ball}{FILES}"));
    assert!(place.run(&["run", "r.toml"]).status.success());
    place
}

/// From a limit that the program hardly starts with to one that suffices.
#[test]
fn memory_that_runs_out_ends_in_one_error() {
    let place = lattice();
    fs::create_dir(place.0.path().join("out")).unwrap();
    let commands: [&[&str]; 7] = [
        &["run", "r.toml", "--out", "out"],
        &["mesh", "a.vdb", "-o", "out/m.stl"],
        &["filter", "a.vdb", "dilate=0.5mm", "-o", "out/f.vdb"],
        &[
            "voxelize",
            "a.stl",
            "--voxel-size",
            "0.2",
            "-o",
            "out/v.vdb",
        ],
        &["preview", "a.vdb", "-o", "out/p.png"],
        &["check", "a.vdb"],
        &["sweep", "r.toml", "band.voxel_size=0.2", "-o", "out/s.csv"],
    ];
    let mut failures = 0;
    for arguments in commands {
        for mebibytes in [160, 220, 320] {
            let start = Instant::now();
            let limits = format!("ulimit -c 0 && ulimit -v {}", mebibytes << 10);
            let output = run(&place, &limits, arguments);
            let error = text(&output.stderr);
            let shown = format!(
                "{arguments:?} in {mebibytes} MiB: {:?}: {error}",
                output.status
            );
            // Allocations that fail again and again would take minutes.
            assert!(start.elapsed() < Duration::from_secs(60), "{shown}");
            if output.status.success() {
                continue;
            }
            failures += 1;
            // A sweep goes on where a run is refused beforehand.
            let expected = if arguments[0] == "sweep" {
                [74, 1]
            } else {
                [74, 65]
            };
            assert!(
                output.status.code().is_some_and(|c| expected.contains(&c)),
                "{shown}"
            );
            assert!(
                !error.contains("backtrace") && !error.contains("bug"),
                "{shown}"
            );
            assert!(
                error.to_lowercase().contains("memory") || error.contains("thread"),
                "{shown}"
            );
            for name in ["m.stl", "f.vdb", "v.vdb", "p.png"] {
                assert!(!place.0.path().join("out").join(name).exists(), "{shown}");
            }
        }
        fs::remove_dir_all(place.0.path().join("out")).unwrap();
        fs::create_dir(place.0.path().join("out")).unwrap();
    }
    assert!(failures > 0, "no limit was too small");
}

#[test]
fn a_limit_of_file_size_is_the_error_of_a_full_disk() {
    let place = lattice();
    let before = place.files();
    for arguments in [
        &["run", "r.toml"][..],
        &["mesh", "a.vdb", "-o", "m.stl"],
        // The library of the archive prints nothing of its own.
        &["mesh", "a.vdb", "-o", "m.3mf"],
        &["filter", "a.vdb", "dilate=0.5mm", "-o", "f.vdb"],
        &["preview", "a.vdb", "-o", "p.png"],
        &["sweep", "r.toml", "band.voxel_size=0.8", "-o", "s.csv"],
        &["new", "n.toml"],
        &["man", "--out", "."],
    ] {
        // The size is in kibibytes; any file needs a byte.
        let size = match arguments[0] {
            "run" => 8,
            "mesh" => 2,
            _ => 0,
        };
        let output = run(&place, &format!("ulimit -f {size}"), arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{arguments:?}: {error}");
        assert!(
            error.contains("error: ") && error.contains("large"),
            "{arguments:?}: {error}"
        );
        // A sweep shows its progress first.
        let is_alone = error.starts_with("error: ") || arguments[0] == "sweep";
        assert!(is_alone, "{arguments:?}: {error}");
        assert!(
            !error.contains(".partial") && !error.contains('{'),
            "{error}"
        );
        assert_eq!(place.files(), before, "{arguments:?}");
        // What the system took, not what still waited in memory.
        if let Some((_, rest)) = error.split_once(" after ") {
            let bytes = rest.split_once(" bytes").unwrap().0;
            assert_eq!(bytes.parse(), Ok(size << 10), "{error}");
        }
    }
}

/// The layers of a stack that fails go, and the folder made for them; one that was there stays.
#[test]
fn layers_of_a_stack_that_fails_do_not_stay() {
    let place = lattice();
    let slice = ["slice", "a.vdb", "--layer", "1mm", "-o", "layers"];
    assert!(place.run(&slice).status.success());
    let folder = place.0.path().join("layers");
    let count = fs::read_dir(&folder).unwrap().count();
    assert!(count > 5, "{count}");
    fs::remove_dir_all(&folder).unwrap();
    fs::create_dir_all(folder.join("00004.png")).unwrap();
    refuse(&place, &slice, 73, &["directory"]);
    let left: Vec<_> = fs::read_dir(&folder).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

/// Each process and thread of an ordinary user counts. The libraries start four threads before the program does anything,
/// and a child of it reads OpenVDB files.
#[test]
fn threads_that_the_system_refuses_are_the_error() {
    let place = lattice();
    let is_root = rustix::process::getuid().is_root();
    let program = place.0.path().join("program");
    fs::copy(env!("CARGO_BIN_EXE_druse"), &program).unwrap();
    for path in [place.0.path(), &program] {
        fs::set_permissions(path, fs::Permissions::from_mode(0o777)).unwrap();
    }
    // Limits hold for no superuser: this one becomes a user without other processes.
    let user = if is_root {
        "setpriv --reuid=61234 --clear-groups "
    } else {
        ""
    };
    let mut failures = 0;
    for limit in [1, 3, 5, 7, 10] {
        for arguments in ["info a.vdb", "mesh a.vdb -o m.stl", "info a.stl --json"] {
            let command = format!("{user}prlimit --nproc={limit} ./program {arguments}");
            let mut shell = Command::new("bash");
            shell.args(["-c", &command]).current_dir(&place.0);
            let output = shell.output().unwrap();
            if output.status.success() {
                continue;
            }
            failures += 1;
            let error = text(&output.stderr);
            let shown = format!("{command}: {:?}: {error}", output.status);
            assert_eq!(output.status.code(), Some(74), "{shown}");
            assert!(error.starts_with("error: not enough threads"), "{shown}");
            assert!(error.contains("ulimit -u"), "{shown}");
            if arguments.ends_with("--json") {
                assert_eq!(json(&output)["code"], 74);
            }
        }
    }
    assert!(failures > 4, "{failures}");
}

#[test]
fn help_that_cannot_be_written_is_an_error() {
    let place = Place::new();
    for arguments in ["--help", "--version", "mesh --help"] {
        let druse = env!("CARGO_BIN_EXE_druse");
        let command = format!("{druse} {arguments} > /dev/full");
        let mut shell = Command::new("bash");
        let output = shell.args(["-c", &command]).current_dir(&place.0).output();
        assert_eq!(output.unwrap().status.code(), Some(74), "{arguments}");
    }
}

/// One vertex far away makes a needle of billions of voxels, whose band no machine holds.
#[test]
fn a_vertex_far_away_is_refused_or_foreseen_without_the_work() {
    let place = Place::new();
    let far = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 10 10 0\nv 0 0 10\nv 10 0 10\nv 0 10 10\nv 1e9 10 10\n\
               f 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 5 7\nf 1 7 3\n\
               f 2 4 8\nf 2 8 6\n";
    place.write("far.obj", far);
    place.write(
        "r.toml",
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 1\n[[op]]\nunion = { mesh = \"far.obj\" }\n\
         [[output]]\nvdb = \"x.vdb\"\n",
    );
    assert!(place.run(&["run", "r.toml", "--dry-run"]).status.success());
    refuse(&place, &["run", "r.toml"], 65, &["memory"]);
    // A tetrahedron is a solid at any length, as long as doubles can tell its sides apart.
    let needle = |far: &str| {
        format!("v 0 0 0\nv 10 0 0\nv 0 10 0\nv {far}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    };
    for far in ["0 0 1e9", "1e8 10 10"] {
        place.write("far.obj", needle(far));
        refuse(&place, &["run", "r.toml"], 65, &["memory"]);
    }
    place.write("far.obj", needle("1e12 10 10"));
    refuse(
        &place,
        &["run", "r.toml"],
        65,
        &["no volume beyond the rounding of its coordinates"],
    );
}

/// A plot that cannot be written is refused before the file is read.
#[test]
fn a_plot_that_cannot_be_written_is_refused_first() {
    let place = Place::new();
    place.write("bad.vdb", "no grid");
    let check = [
        "check",
        "bad.vdb",
        "--layer",
        "1mm",
        "--plot",
        "missing/p.png",
    ];
    refuse(&place, &check, 73, &["missing"]);
}

/// One content has one volume, with a mesh among the outputs or without.
#[test]
fn a_filter_measures_the_same_for_each_kind_of_output() {
    let place = lattice();
    let measured = |output: &str, more: &[&str]| {
        let arguments = ["filter", "a.vdb", "dilate=0.5mm", "--json", "-o", output];
        let report = json(&place.run(&[&arguments, more].concat()));
        [0, 1].map(|n| report["solid"][["volume", "area"][n]].as_f64().unwrap())
    };
    let [volume, area] = measured("f.vdb", &[]);
    assert_eq!([volume, area], measured("f.stl", &[]));
}

/// Waits until a process has worked and then used no processor time for half a second, however busy the machine is.
pub(super) fn wait_until_idle(id: u32) {
    // Fields 14 and 15 of `stat`, user and system time in ticks; the name before them may hold spaces.
    let ticks = || -> Vec<u64> {
        let stat = fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
        let rest = stat.rsplit(')').next().unwrap();
        let fields = rest.split_whitespace().skip(11).take(2);
        fields.map(|f| f.parse().unwrap()).collect()
    };
    // A thread that is ready to run and has to wait for a processor is not idle.
    let is_asleep = || {
        let threads = fs::read_dir(format!("/proc/{id}/task")).unwrap().flatten();
        let mut stats = threads.filter_map(|t| fs::read_to_string(t.path().join("stat")).ok());
        stats.all(|s| s.rsplit(')').next().unwrap().trim().starts_with('S'))
    };
    let end = Instant::now() + Duration::from_secs(60);
    let (mut before, mut quiet) = (vec![0, 0], 0);
    while quiet < 5 {
        assert!(Instant::now() < end, "process {id} is never idle");
        std::thread::sleep(Duration::from_millis(100));
        let now = ticks();
        let is_quiet = now == before && now != [0, 0] && is_asleep();
        quiet = if is_quiet { quiet + 1 } else { 0 };
        before = now;
    }
}

#[test]
fn one_signal_ends_a_run_that_waits_for_a_reader() {
    // Of voxels that take some processor time.
    let place = lattice_of(0.1);
    let made = Command::new("mkfifo")
        .arg(place.0.path().join("pipe.stl"))
        .status();
    assert!(made.unwrap().success());
    for (signal, code) in [("TERM", 143), ("INT", 130), ("HUP", 129)] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(["mesh", "a.vdb", "-o", "pipe.stl"])
            .current_dir(&place.0)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        wait_until_idle(child_of(child.id()));
        assert!(child.try_wait().unwrap().is_none());
        send(signal, &child.id().to_string());
        let end = Instant::now() + Duration::from_secs(60);
        while child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < end, "{signal} did not end it");
            std::thread::sleep(Duration::from_millis(50));
        }
        assert_eq!(child.wait().unwrap().code(), Some(code));
    }
}

#[test]
fn processor_time_that_runs_out_stops_a_run_as_a_signal_does() {
    // The filter takes some 100 s of processor time, until the ball has vanished; of a coarser ball only 2 s.
    let recipe = format!(
        "{}[[op]]\ngaussian = {{ width = 3, iterations = 1000 }}\n{FILES}",
        BALL.replace("0.4", "0.04")
    );
    let place = Place::with(&recipe);
    let output = run(&place, "ulimit -t 3", &["run", "r.toml"]);
    assert_eq!(output.status.code(), Some(152), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("processor time"));
    assert_eq!(place.files(), ["r.toml"]);
}

/// A folder that is missing, a file in place of a folder, and one that takes no files, also of the superuser.
#[test]
fn folders_that_take_no_files_are_refused_before_the_work() {
    let place = lattice();
    place.write("c.crystal", "cube\n");
    let commands: [(&[&str], &str); 12] = [
        (&["mesh", "a.vdb", "-o"], "x.stl"),
        (&["filter", "a.vdb", "dilate=0.5mm", "-o"], "x.vdb"),
        (&["voxelize", "a.stl", "--voxel-size", "0.2", "-o"], "x.vdb"),
        (&["preview", "a.vdb", "-o"], "x.png"),
        (&["view", "a.vdb", "-o"], "x.html"),
        (&["slice", "a.vdb", "--layer", "0.5", "-o"], "x.svg"),
        (&["slice", "a.vdb", "--layer", "0.5", "-o"], "layers"),
        (&["sweep", "r.toml", "band.voxel_size=0.2", "-o"], "x.csv"),
        (&["plan", "r.toml", "--memory", "1G", "-o"], "x.json"),
        (&["crystal", "c.crystal", "-o"], "x.obj"),
        (
            &[
                "cell",
                "homogenize",
                "schwarz_p",
                "--volume-fraction",
                "0.3",
                "-o",
            ],
            "x.json",
        ),
        (&["fit", "a.stl", "--element", "hex", "-o"], "x.cell"),
    ];
    for folder in ["r.toml", "/proc"] {
        for (arguments, name) in commands {
            let output = format!("{folder}/{name}");
            let mut all = arguments.to_vec();
            all.extend([output.as_str(), "--progress=plain"]);
            let made = place.run(&all);
            let error = text(&made.stderr);
            assert_eq!(made.status.code(), Some(73), "{all:?}: {error}");
            // The first stage of work on a level set, a mesh, a cell or a table.
            for stage in [
                "evaluat",
                "mesh\n",
                "meshing",
                "render",
                "slic",
                "stiffness",
            ] {
                assert!(!error.contains(stage), "{all:?}: {error}");
            }
            assert!(!error.contains(".partial"), "{error}");
        }
        refuse(
            &place,
            &["run", "r.toml", "--out", &format!("{folder}/x")],
            73,
            &["/x"],
        );
    }
}

/// Formats of the standard library have widths of 16 bits.
#[test]
fn long_recipes_take_overrides() {
    let comment = format!("# {}\n", "x".repeat(100));
    let place = Place::with(&format!("{}{BALL}", comment.repeat(10_000)));
    let report = json(&place.run(&["run", "r.toml", "--set", "band.voxel_size=0.8", "--json"]));
    assert_eq!(report["band"]["voxel_size"], 0.8);
    let made = place.run(&["sweep", "r.toml", "band.voxel_size=0.8,1.0", "-o", "s.csv"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    refuse(
        &place,
        &["run", "r.toml", "--set", "band.voxel_size=wide"],
        65,
        &["--set band.voxel_size=wide"],
    );
}

#[test]
fn names_reach_no_terminal_as_they_are() {
    const BAD: &str = "x\u{1b}[31m\u{7}\u{9b}2J\u{202e}y\nz";
    // As a string of TOML.
    let quoted = serde_json::to_string(BAD).unwrap();
    let place = Place::with(&format!(
        "{BALL}[cell.{quoted}]\nsurface = \"schwarz_p\"\nelement = \"hex\"\nlevel = 0\n"
    ));
    place.write("steps.crystal", "cube\nassign faces(\u{1b}[31m) 2\n");
    let name = format!("{BAD}.toml");
    place.write(&name, BALL);
    let is_shown = |bytes: &[u8]| {
        let shown = text(bytes);
        let bad = ['\u{1b}', '\u{7}', '\u{9b}', '\u{202e}', '\r', '\u{7f}'];
        !shown.contains(bad) && !shown.contains("y\nz")
    };
    let missing = format!("{BAD}.vdb");
    let bad_key = format!("{quoted}=1");
    let bad_flag = format!("--{BAD}");
    let solid = format!("{BAD}.obj");
    place.write(
        &solid,
        "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    );
    let made = format!("{BAD}.ply");
    let voxelize = ["voxelize", &solid, "--voxel-size", "0.25", "-o", &made];
    let commands: [&[&str]; 11] = [
        &["info", "r.toml"],
        &["info", "r.toml", "--json"],
        &["run", "r.toml", "--progress=plain", "-v"],
        &["info", &name],
        &["info", &missing],
        &["info", &missing, "--json"],
        &["run", "r.toml", "--set", &bad_key],
        &["run", "r.toml", &bad_flag],
        &["crystal", "steps.crystal", "--progress=plain"],
        &["view", &solid, "--dry-run"],
        &voxelize,
    ];
    for arguments in commands {
        let output = place.run(arguments);
        assert!(
            is_shown(&output.stdout),
            "{arguments:?}: {}",
            text(&output.stdout)
        );
        assert!(
            is_shown(&output.stderr),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
    }
    // The object has the name itself.
    let facts = json(&place.run(&["info", "r.toml", "--json"]));
    assert_eq!(facts["cells"][0], BAD);
}
