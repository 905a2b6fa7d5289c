//! Files: what is written comes back; what is damaged is an error and nothing worse.

use super::{Stop, THREADS, cube, level_set, session, sphere, sphere_at, union};
use druse::field::BoxSolid;
use druse::frame::{Aabb, Coord, LengthUnit, Vec3};
use druse::progress::Threads;
use druse::vdb::subprocess::{Limits, inspect, report};
use druse::vdb::{self, Compression, FileError, LevelSet, Session, VdbWriter, WrittenFile};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

fn write(path: &Path, level_set: &LevelSet, compression: Compression) -> WrittenFile {
    let mut file = VdbWriter::new(path, session())
        .unwrap()
        .compression(compression);
    file.level_set("surface", level_set).unwrap();
    file.write().unwrap()
}

#[test]
fn a_file_comes_back_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let s = sphere(10.0, 0.5);
    for compression in [Compression::None, Compression::Zip, Compression::Blosc] {
        let path = dir.path().join("s.vdb");
        let written = write(&path, &s, compression);
        assert_eq!(written.bytes, std::fs::metadata(&path).unwrap().len());
        assert_eq!(written.content_hash, s.content_hash("surface").unwrap());
        let info = vdb::info(&path).unwrap();
        assert_eq!((info.version, info.grids.len()), (224, 1));
        assert_eq!(info.content_hash.as_ref(), Some(&written.content_hash));
        assert_eq!(info.meta("druse.content_hash"), Some(written.content_hash));
        let back = LevelSet::read(&path, None, session()).unwrap();
        assert_eq!(
            back.content_hash("surface").unwrap(),
            s.content_hash("surface").unwrap()
        );
        assert_eq!(back.tiles().unwrap(), s.tiles().unwrap());
        assert_eq!((back.voxel_size(), back.half_width()), (0.5, 3.0));
        assert_eq!(back.origin(), Vec3::zeros());
    }
}

#[test]
fn the_hash_is_of_the_content_alone() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] = ["a.vdb", "b.vdb"].map(|n| dir.path().join(n));
    let s = sphere(6.0, 0.5);
    let one = write(&a, &s, Compression::Blosc);
    let two = write(&b, &s, Compression::None);
    // Random identifiers in the headers differ, hashes do not.
    assert_ne!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    assert_eq!(one.content_hash, two.content_hash);
    assert_eq!(one.content_hash.len(), 64);
    let hash = |s: &LevelSet, name| s.content_hash(name).unwrap();
    assert_ne!(hash(&s, "surface"), hash(&s, "other"));
    assert_ne!(hash(&s, "surface"), hash(&sphere(6.0, 0.25), "surface"));
    let moved = sphere_at(Vec3::new(0.5, 0.0, 0.0), 6.0, 0.5);
    assert_ne!(hash(&s, "surface"), hash(&moved, "surface"));
}

/// A file that is written leaf by leaf is made under another name: all the same its mode is that of a new file.
#[test]
fn a_file_of_a_band_is_as_readable_as_any_new_file() {
    use druse::field::Sphere;
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().unwrap();
    let [path, plain] = ["band.vdb", "plain"].map(|n| dir.path().join(n));
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 5.0,
    };
    let extent = Aabb::of([Vec3::repeat(-7.0), Vec3::repeat(7.0)]);
    let band = druse::band::Band::new(&ball, extent, 0.5).unwrap();
    let file = vdb::LevelSetFile::create(&path, band.transform, band.half_width).unwrap();
    band.evaluate(&THREADS, &druse::progress::Silent, &file)
        .unwrap();
    file.finish(session()).unwrap();
    std::fs::write(&plain, "").unwrap();
    let mode = |p: &Path| std::fs::metadata(p).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&plain));
}

#[test]
fn metadata_and_names_are_as_readers_expect() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    let s = sphere(6.0, 0.5);
    let fog = s.to_fog(session()).unwrap();
    let mut file = VdbWriter::new(&path, session()).unwrap();
    file.level_set("surface", &s).unwrap();
    file.fog("density", &fog, true).unwrap();
    file.tag("druse.unit", "mm").unwrap();
    file.tag("druse.recipe", "first").unwrap();
    file.tag("druse.recipe", "line 1\nline 2 \u{b5}m").unwrap();
    for name in ["", "surface", "a[1]"] {
        assert!(file.level_set(name, &s).is_err(), "{name:?}");
    }
    for key in [
        "",
        "creator",
        "class",
        "name",
        "file_voxel_count",
        "druse.version",
    ] {
        assert!(file.tag(key, "x").is_err(), "{key:?}");
    }
    file.write().unwrap();

    let info = vdb::info(&path).unwrap();
    let [density, surface] = &info.grids[..] else {
        panic!("{info:?}")
    };
    assert_eq!((&*surface.name, &*surface.class), ("surface", "level set"));
    assert_eq!((&*density.name, &*density.class), ("density", "fog volume"));
    assert_eq!((surface.half, density.half), (false, true));
    assert_eq!(
        (surface.background, density.background),
        (Some(1.5), Some(0.0))
    );
    assert_eq!(
        surface.compression.as_deref(),
        Some("blosc + active values")
    );
    assert_eq!(surface.bbox, Some([[-14; 3], [14; 3]]));
    let creator = format!("druse/{}", env!("CARGO_PKG_VERSION"));
    for meta in [
        info.meta("creator"),
        surface.meta("creator"),
        density.meta("creator"),
    ] {
        assert_eq!(meta, Some(creator.clone()));
    }
    assert_eq!(info.meta("druse.recipe").unwrap(), "line 1\nline 2 \u{b5}m");
    assert_eq!(surface.meta("druse.unit").unwrap(), "mm");
    // The file's bytes say so too: magic number, format.
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(
        bytes[..12],
        [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0, 224, 0, 0, 0]
    );
    let read = LevelSet::read(&path, Some("surface"), session()).unwrap();
    assert_eq!(
        read.content_hash("surface").unwrap(),
        s.content_hash("surface").unwrap()
    );
}

#[test]
fn fog_is_full_inside_and_a_ramp_at_the_surface() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("fog.vdb");
    let s = sphere(8.0, 0.5);
    let fog = s.to_fog(session()).unwrap();
    let mut file = VdbWriter::new(&path, session()).unwrap().scaled(0.001);
    file.fog("density", &fog, false).unwrap();
    file.write().unwrap();
    let info = vdb::info(&path).unwrap();
    assert_eq!(info.grids[0].voxel_size, [0.0005; 3]);
    // Active: all voxels inside.
    let inside = s.components(session()).unwrap()[0].voxels;
    assert_eq!(info.grids[0].active_voxels, inside);
    let error = LevelSet::read(&path, Some("density"), session())
        .err()
        .unwrap();
    assert!(
        error.to_string().contains("the class fog volume"),
        "{error}"
    );
    let error = LevelSet::read(&path, None, session()).err().unwrap();
    let text = error.to_string();
    assert!(
        text.contains("\"density\" has the class fog volume"),
        "{error}"
    );
}

#[test]
fn another_unit_scales_voxels_values_and_background() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.vdb");
    // Wide enough for inside tiles of both sizes.
    let s = level_set(&BoxSolid(cube(160.0)), cube(160.0), 1.0);
    let factor = LengthUnit::Millimetre.to(LengthUnit::Metre);
    let mut file = VdbWriter::new(&path, session()).unwrap().scaled(factor);
    file.level_set("surface", &s).unwrap();
    let written = file.write().unwrap();
    let back = LevelSet::read(&path, None, session()).unwrap();
    assert_eq!(back.voxel_size(), 0.001);
    assert!((back.half_width() - 3.0).abs() < 1e-6);
    assert_eq!(
        vdb::info(&path).unwrap().content_hash,
        Some(written.content_hash)
    );
    let voxels: Vec<Coord> = (150..170).map(|x| Coord::new(x, 3, -7)).collect();
    for (a, b) in s
        .values(&voxels)
        .unwrap()
        .iter()
        .zip(back.values(&voxels).unwrap())
    {
        assert!((a * 0.001 - b).abs() < 1e-9, "{a} {b}");
    }
    let tile = |s: &LevelSet| s.tiles().unwrap()[0].value;
    assert!((tile(&s) * 0.001 - tile(&back)).abs() < 1e-9);
    assert!(back.check(session()).unwrap().passed());
    // The original is what it was.
    assert_eq!(s.voxel_size(), 1.0);
}

#[test]
fn a_staged_path_carries_the_final_name_in_errors() {
    let s = sphere(4.0, 0.5);
    let mut file = VdbWriter::new(Path::new("final.vdb"), session()).unwrap();
    file.level_set("surface", &s).unwrap();
    let error = file.write_to(Path::new("/nonexistent/x")).unwrap_err();
    assert!(error.to_string().starts_with("final.vdb: "), "{error}");
}

#[test]
fn a_full_disk_is_an_error() {
    let path = Path::new("/dev/full");
    let s = sphere(20.0, 0.5);
    let mut file = VdbWriter::new(path, session()).unwrap();
    file.level_set("surface", &s).unwrap();
    match file.write().unwrap_err() {
        FileError::Io {
            path: named,
            source,
        } => {
            assert_eq!((named.as_path(), source.raw_os_error()), (path, Some(28)));
        }
        other => panic!("{other}"),
    }
}

#[test]
fn writing_can_be_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let stop = Stop(AtomicBool::new(true));
    let s = sphere(10.0, 0.5);
    let path = dir.path().join("s.vdb");
    let mut file = VdbWriter::new(&path, Session::new(&THREADS, &stop)).unwrap();
    file.level_set("surface", &s).unwrap();
    assert!(matches!(file.write(), Err(FileError::Cancelled(_))));
}

#[test]
fn what_is_no_vdb_is_said_so() {
    let dir = tempfile::tempdir().unwrap();
    let error = |bytes: &[u8]| {
        let path = dir.path().join("x.vdb");
        std::fs::write(&path, bytes).unwrap();
        vdb::info(&path).unwrap_err().to_string()
    };
    assert!(error(b"solid cube\n").contains("not those of a .vdb file"));
    assert!(error(b"").contains("not those of a .vdb file"));
    let magic = [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];
    assert!(error(&magic).contains("ends after 8 bytes"));
    let newer = [&magic[..], &225u32.to_le_bytes()].concat();
    assert!(error(&newer).contains("format 225"));
    let missing = vdb::info(&dir.path().join("none.vdb")).unwrap_err();
    assert!(matches!(missing, FileError::Io { .. }), "{missing}");
    assert!(matches!(vdb::info(dir.path()), Err(FileError::Io { .. })));
    let path = dir.path().join("s.vdb");
    write(&path, &sphere(4.0, 0.5), Compression::Blosc);
    let error = LevelSet::read(&path, Some("skin"), session())
        .err()
        .unwrap();
    assert!(
        error
            .to_string()
            .contains("no grid \"skin\"; it holds surface"),
        "{error}"
    );
}

#[test]
fn every_truncation_is_a_clean_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    write(&path, &sphere(10.0, 0.5), Compression::Blosc);
    let whole = std::fs::read(&path).unwrap();
    for n in 0..40 {
        let length = whole.len() * n / 40 + n % 7;
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = LevelSet::read(&path, None, session()).err().unwrap();
        assert!(
            matches!(error, FileError::Damaged { .. }),
            "{length}: {error}"
        );
    }
}

/// Not a law: what the child of the tests below runs.
#[test]
fn isolated_child() {
    let Some(path) = std::env::var_os("DRUSE_TEST_VDB") else {
        return;
    };
    let limits = std::env::var("DRUSE_TEST_LIMITS").unwrap();
    let limits: Limits = serde_json::from_str(&limits).unwrap();
    if path == "sleep" {
        std::thread::sleep(std::time::Duration::from_secs(60));
    }
    if path == "abort" {
        std::process::abort();
    }
    // The test harness has begun a line.
    println!("\n{}", report(&PathBuf::from(path), limits));
}

fn isolated(argument: &Path, path: &Path, limits: Limits) -> Result<vdb::FileInfo, FileError> {
    let mut child = Command::new(std::env::current_exe().unwrap());
    child
        .args(["vdb::files::isolated_child", "--exact", "--nocapture"])
        .env("DRUSE_TEST_VDB", argument)
        .env("DRUSE_TEST_LIMITS", serde_json::to_string(&limits).unwrap());
    inspect(child, path, limits)
}

#[test]
fn a_child_reports_what_it_reads_and_survives_nothing_of_ours() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    write(&path, &sphere(10.0, 0.5), Compression::Blosc);
    let limits = Limits::for_size(100_000);
    let info = isolated(&path, &path, limits).unwrap();
    assert_eq!(info, vdb::info(&path).unwrap());

    let missing = dir.path().join("none.vdb");
    let error = isolated(&missing, &missing, limits).unwrap_err();
    assert!(matches!(error, FileError::Io { .. }), "{error}");
    let error = isolated(Path::new("abort"), &path, limits).unwrap_err();
    assert!(error.to_string().contains("signal 6"), "{error}");
    let short = Limits {
        milliseconds: 300,
        ..limits
    };
    let error = isolated(Path::new("sleep"), &path, short).unwrap_err();
    assert!(
        error.to_string().contains("took more than 0.3 s"),
        "{error}"
    );
}

#[test]
fn damaged_files_never_end_the_process() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    let two = union(
        BoxSolid(cube(5.0)),
        BoxSolid(Aabb {
            min: Vec3::repeat(7.0),
            max: Vec3::repeat(12.0),
        }),
    );
    let written = write(&path, &level_set(&two, cube(12.0), 0.5), Compression::Blosc);
    let whole = std::fs::read(&path).unwrap();
    let count = if crate::is_full() { 500 } else { 50 };
    let mut random = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = move |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random % below as u64) as usize
    };
    let (mut clean, mut unnoticed, mut ended) = (0, 0, 0);
    for n in 0..count {
        let mut bytes = whole.clone();
        match n % 3 {
            0 => bytes[next(whole.len())] ^= 1 << next(8), // anywhere
            1 => bytes[next(2000)] ^= 1 << next(8),        // in the header
            _ => {
                let start = next(2000);
                bytes[start..start + 8].fill_with(|| next(256) as u8);
            }
        }
        let mutated = dir.path().join("mutated.vdb");
        std::fs::write(&mutated, &bytes).unwrap();
        match isolated(&mutated, &mutated, Limits::for_size(bytes.len() as u64)) {
            Ok(info) if info.content_hash.as_ref() == Some(&written.content_hash) => {}
            Ok(_) => unnoticed += 1,
            Err(error) if error.to_string().contains("ended the reader") => ended += 1,
            Err(_) => clean += 1,
        }
    }
    println!("figure: vdb mutated, clean errors | {clean} of {count} | no crash");
    println!("figure: vdb mutated, reader ended | {ended} of {count} | no crash");
    println!("figure: vdb mutated, hash tells | {unnoticed} of {count} | no crash");
    assert!(clean > 0);
}

#[test]
fn one_thread_writes_the_same_content() {
    let dir = tempfile::tempdir().unwrap();
    let one = Threads::new(1).unwrap();
    let s = sphere(10.0, 0.5);
    let hashes: Vec<String> = [&one, &*THREADS]
        .into_iter()
        .map(|threads| {
            let path = dir.path().join("s.vdb");
            let session = Session::new(threads, &druse::progress::Silent);
            let mut file = VdbWriter::new(&path, session).unwrap().scaled(0.1);
            file.level_set("surface", &s).unwrap();
            file.write().unwrap().content_hash
        })
        .collect();
    assert_eq!(hashes[0], hashes[1]);
}

#[test]
fn memory_is_reported() {
    let now = vdb::resident_memory().unwrap();
    let peak = vdb::peak_memory().unwrap();
    assert!(peak >= now && now > 1 << 20);
    let s = sphere(10.0, 0.5);
    let info = s.info().unwrap();
    // A leaf holds 2 KiB of values.
    assert!(s.bytes().unwrap() > info.leaves * 2048);
}
