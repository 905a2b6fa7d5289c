//! The program among broken files, full disks and sudden ends; lattices drawn at random.
//!
//! Short in every run, long with `DRUSE_FULL=1`.

mod partial_files;

use druse::mesh::check;
use druse::pipeline::{RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Numbers that are the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n as u64) as usize
    }
}

fn druse(place: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command
        .args(line.split(' '))
        .current_dir(place)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// A part as a `.vdb` of a few blocks.
fn part(place: &Path, voxel: &str) {
    let recipe = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n[[op]]\nunion = {{ sphere = {{ radius = 5 }} }}\n\
         [[op]]\nsubtract = {{ capsule = {{ radius = 2, from = [-9, 0, 0], to = [9, 1, 2] }} }}\n\
         [[output]]\nvdb = \"a.vdb\"\n"
    );
    fs::write(place.join("r.toml"), recipe).unwrap();
    let made = druse(place, "run r.toml -q").output().unwrap();
    assert!(made.status.success());
}

#[test]
fn no_damaged_file_ends_the_program_and_all_damage_is_found() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    part(place, "0.4");
    let whole = fs::read(place.join("a.vdb")).unwrap();
    let good = druse(place, "info a.vdb --json").output().unwrap();
    let good: serde_json::Value = serde_json::from_slice(&good.stdout).unwrap();
    let count = if crate::is_full() { 2400 } else { 24 };
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let (mut refused, mut detected, mut harmless) = (0, 0, 0);
    for n in 0..count {
        let mut bytes = whole.clone();
        match n % 4 {
            0 => bytes.truncate(dice.below(whole.len())),
            1 => bytes[dice.below(whole.len())] ^= 1 << dice.below(8),
            2 => {
                let start = dice.below(1500);
                bytes[start..start + 8].fill_with(|| dice.below(256) as u8);
            }
            _ => {
                let start = dice.below(whole.len() - 64);
                let length = 1 + dice.below(64);
                bytes[start..start + length].fill(0xff);
            }
        }
        fs::write(place.join("m.vdb"), &bytes).unwrap();
        let start = Instant::now();
        let checked = druse(place, "check m.vdb --json").output().unwrap();
        let code = checked.status.code();
        let answer: serde_json::Value = serde_json::from_slice(&checked.stdout)
            .unwrap_or_else(|e| panic!("case {n}: {e}, code {code:?}"));
        assert!(start.elapsed() < Duration::from_secs(120), "case {n} hung");
        match code {
            Some(65) => refused += 1,
            Some(1) => detected += 1,
            // The content is unchanged: the damage is in its identifier or its comments.
            Some(0) => {
                assert_eq!(answer["content_hash"], good["content_hash"], "case {n}");
                harmless += 1;
            }
            _ => panic!("case {n}: code {code:?}, {answer}"),
        }
        assert!(
            n % 4 != 0 || code == Some(65),
            "case {n}: a truncated file passed"
        );
        // Whatever is done with it, the program goes on or reports why not.
        if n % 8 == 1 {
            let filtered = druse(place, "filter m.vdb -o f.vdb dilate=0.0004").output();
            let code = filtered.unwrap().status.code();
            assert!(matches!(code, Some(0 | 65)), "case {n}: {code:?}");
        }
    }
    println!("figure: damaged vdb refused | {refused} of {count} | no crash, no hang");
    println!("figure: damaged vdb detected by hash or check | {detected} of {count} | all");
    println!("figure: damage without effect on the grids | {harmless} of {count} | same hash");
}

#[test]
fn a_killed_program_leaves_the_old_file_or_the_new_one() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    part(place, if crate::is_full() { "0.15" } else { "0.25" });
    let line = "filter a.vdb -o out.vdb renormalise=1 -q";
    let start = Instant::now();
    assert!(druse(place, line).output().unwrap().status.success());
    let whole = start.elapsed();
    let hash = |name: &str| {
        let info = druse(place, &format!("info {name} --json"))
            .output()
            .unwrap();
        assert!(info.status.success(), "a partial {name}");
        let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
        info["content_hash"].clone()
    };
    let wanted = hash("out.vdb");
    let count = if crate::is_full() { 200 } else { 12 };
    let mut dice = Dice(42);
    let mut finished = 0;
    for _ in 0..count {
        let _ = fs::remove_file(place.join("out.vdb"));
        let mut child = druse(place, line).spawn().unwrap();
        // Most of the moments fall into the writing, which comes last.
        let share = 0.5 + 0.6 * dice.below(1000) as f64 / 1000.0;
        std::thread::sleep(whole.mul_f64(share));
        child.kill().unwrap();
        child.wait().unwrap();
        if place.join("out.vdb").exists() {
            assert_eq!(hash("out.vdb"), wanted);
            finished += 1;
        }
    }
    // The next run completes over what the killed ones left.
    assert!(druse(place, line).output().unwrap().status.success());
    println!("figure: kill -9 while writing | 0 partial of {count}, {finished} whole | 0 partial");
}

#[test]
fn a_full_disk_is_reported_with_path_and_bytes() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    part(place, "0.4");
    let disk = place.join("disk");
    fs::create_dir(&disk).unwrap();
    let size = fs::metadata(place.join("a.vdb")).unwrap().len();
    let sizes = if crate::is_full() { 20 } else { 3 };
    for n in 1..=sizes {
        // Less than the output needs, in pages.
        let room = (size * n / (sizes + 1)) & !4095;
        let mounted = Command::new("mount")
            .args([
                "-t",
                "tmpfs",
                "-o",
                &format!("size={}", room.max(4096)),
                "druse-test",
            ])
            .arg(&disk)
            .stderr(Stdio::null())
            .status();
        if !mounted.is_ok_and(|s| s.success()) {
            println!("no right to mount a small disk: not tried");
            return;
        }
        let output = druse(place, "filter a.vdb -o disk/b.vdb prune").output();
        let names: Vec<_> = fs::read_dir(&disk)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        let unmounted = Command::new("umount").arg(&disk).status().unwrap();
        assert!(unmounted.success());
        let output = output.unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{room} bytes: {error}");
        assert!(
            error.contains("b.vdb") && error.contains("No space left"),
            "{error}"
        );
        assert!(names.is_empty(), "{room} bytes left {names:?}");
    }
}

/// Lattices of smooth cells, half of them cut by walls that lie in planes of voxels or slant.
#[test]
fn random_lattices_have_closed_manifold_meshes() {
    let count = if crate::is_full() { 1000 } else { 6 };
    let kinds = [
        ("hex", ["schwarz_p", "iwp", "neovius", "f_rd"]),
        ("tet", ["diamond", "schwarz_p", "iwp", "neovius"]),
    ];
    let walls = [
        "",
        "intersect = { box = { size = [9, 0.6, 9] } }",
        "intersect = { box = { size = [0.7, 0.9, 1.1], centre = [0.05, 0.02, 0] } }",
        "subtract = { cylinder = { from = [0, 0, -9], to = [0, 0, 9], radius = 0.37 } }",
        "intersect = { plane = { point = [0, 0, 0.1], normal = [0.3, 0.4, 1] } }",
        "union = { box = { size = [3, 0.1, 0.4] } }",
        "intersect = { sphere = { radius = 0.61 } }",
    ];
    let wishes = ["", "sharp = true", "project = true", "quads = true"];
    let mut dice = Dice(7);
    let (mut crossed, mut walled, mut sharp) = (0, 0, 0);
    for n in 0..count {
        let (kind, surfaces) = kinds[dice.below(kinds.len())];
        let surface = surfaces[dice.below(surfaces.len())];
        let share = 0.2 + 0.5 * dice.below(100) as f64 / 100.0;
        let solid = ["below", "above", "sheet"][dice.below(3)];
        let size = [(); 3].map(|()| 1 + dice.below(2));
        let mut ops = String::new();
        for _ in 0..dice.below(3) {
            let wall = walls[dice.below(walls.len())];
            if !wall.is_empty() {
                ops = format!("{ops}[[op]]\n{wall}\n");
            }
        }
        // Exact fields cost most: of every twelfth lattice only.
        let option = if n % 12 == 0 {
            wishes[dice.below(4)]
        } else {
            ""
        };
        walled += usize::from(!ops.is_empty());
        sharp += usize::from(option == "sharp = true");
        let recipe = format!(
            "druse = 1\n[cell.c]\nsurface = \"{surface}\"\nelement = \"{kind}\"\nvolume_fraction = {share}\nsolid = \"{solid}\"\n\
             [scaffold]\nbox = {{ size = {size:?}, cell_size = 1, kind = \"{kind}\" }}\n[tiling]\ncell = \"c\"\n\
             [band]\nvoxel_size = {}\n{ops}[[output]]\nmesh = \"m.ply\"\n{option}\n",
            0.07 + 0.02 * dice.below(3) as f64
        );
        let place = tempfile::tempdir().unwrap();
        let options = RunOptions {
            out: Some(place.path().into()),
            brief: true,
            ..RunOptions::default()
        };
        match run(&Recipe::parse(&recipe, &[]).unwrap(), &options, &Silent) {
            Ok(_) => {}
            // A box may miss the struts.
            Err(RunError::Empty(_) | RunError::Disjoint { .. }) => continue,
            Err(e) => panic!("lattice {n}: {e}\n{recipe}"),
        }
        let mesh = druse::io::read_mesh(place.path().join("m.ply")).unwrap();
        let report = check(&mesh.mesh);
        for (word, answer) in report.properties() {
            if word.contains("intersect") {
                crossed += u32::from(answer == Some(false));
            } else {
                assert!(
                    answer != Some(false),
                    "lattice {n} is not {word}:\n{recipe}{report}"
                );
            }
        }
    }
    println!(
        "figure: random lattices, {walled} with walls, {sharp} sharp, that intersect themselves | {crossed} of \
         {count} | printed"
    );
}
