//! `--portable`: bytes that do not depend on what the processor has.

use super::{Place, json, text};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session, read};
use std::process::Command;

/// What hides from the C library, whose sines look for them too, the instructions that not all have.
const HIDDEN: &str = "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX";

/// A part of curved elements, filled by look-ups with a thickness by formula, and one of boxes along the
/// voxels.
const PARTS: [&str; 2] = [
    "sphere = { radius = 1.5, cell_size = 0.75 }\nthickness = \"0.16 + 0.02 * sin(2 * x) * exp(-y * y)\"",
    "box = { size = [3, 2, 2], cell_size = 1 }",
];

/// Runs the recipe; the file's content hash and its level set.
fn run(place: &Place, flags: &[&str], tunables: &str) -> (String, LevelSet) {
    let output = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["run", "r.toml", "--quiet"])
        .args(flags)
        .current_dir(&place.0)
        .env("GLIBC_TUNABLES", tunables)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let info = json(&place.run(&["info", "--json", "a.vdb"]));
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let level_set = read(&place.0.path().join("a.vdb"), None, session).unwrap();
    (info["content_hash"].as_str().unwrap().to_owned(), level_set)
}

#[test]
fn portable_runs_give_the_same_bytes_whatever_the_processor_has() {
    for part in PARTS {
        let (scaffold, tiling) = part.split_once('\n').unwrap_or((part, ""));
        let place = Place::with(&format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\nlevel = 0.5\n\
             [scaffold]\n{scaffold}\n[tiling]\ncell = \"p\"\n{tiling}\n[band]\nvoxel_size = 0.1\n\
             [[output]]\nvdb = \"a.vdb\"\n"
        ));
        let (hash, slow) = run(&place, &["--portable"], "");
        let (again, _) = run(&place, &["--portable", "--threads", "1"], HIDDEN);
        assert_eq!(hash, again, "{scaffold}");
        // Without it: the same but for rounding.
        let (_, fast) = run(&place, &[], "");
        let (slow, fast) = (slow.leaves().unwrap(), fast.leaves().unwrap());
        let both = || slow.iter().zip(fast.iter());
        let values = || both().flat_map(|(a, b)| a.values.iter().zip(b.values));
        assert!(both().all(|(a, b)| a.origin == b.origin));
        let half_width = values().fold(0f32, |m, (v, _)| m.max(v.abs()));
        assert!(values().count() > 25_000);
        // Three voxels of the band make its half width.
        let voxels = |of: f64| 3.0 * of / f64::from(half_width);
        let (mut squares, mut furthest) = (0.0, 0f64);
        for (v, w) in values() {
            let off = f64::from(v - w).abs();
            squares += off * off;
            furthest = furthest.max(off);
        }
        let rms = voxels((squares / values().count() as f64).sqrt());
        let furthest = voxels(furthest);
        println!("{scaffold}: {rms:.1e} voxels rms, {furthest:.1e} at most");
        assert!(
            rms < 1e-5 && furthest < 3e-4,
            "{scaffold}: {rms:e} {furthest:e}"
        );
    }
}
