//! Files of level sets from other programs, and what is made of files, have the right values.

use druse::band::{LeafBatch, LeafSink};
use druse::frame::{Coord, LengthUnit, Transform, Vec3};
use druse::pipeline::{Report, RunOptions, SliceOptions, run, slice};
use druse::progress::{Silent, Threads};
use druse::recipe::{Length, Recipe};
use druse::vdb::{GridReading, LevelSetBuilder, Session, VdbWriter, Volume};
use std::path::Path;
use std::process::Command;

fn made(directory: &Path, text: &str) -> Report {
    let options = RunOptions {
        out: Some(directory.to_owned()),
        ..RunOptions::default()
    };
    run(&Recipe::parse(text, &[]).unwrap(), &options, &Silent).unwrap()
}

/// Writes a box of 2 x 1.6 x 1.2 on voxels of 0.1 whose distances are cut off at so many voxels inside and at
/// 3 outside; all voxels of its leaves are active where `is_dense`.
fn write_box(path: &Path, inside: f64, is_dense: bool) {
    write_cut_box(path, |_| inside, is_dense);
}

/// The same, cut off inside at a number of voxels that depends on the position.
fn write_cut_box(path: &Path, inside: impl Fn(Vec3) -> f64, is_dense: bool) {
    let h = 0.1;
    let transform = Transform::new(h).unwrap();
    let builder = LevelSetBuilder::new(transform, 3.0).unwrap();
    let half = Vec3::new(1.0, 0.8, 0.6);
    let mut batch = LeafBatch::default();
    for n in 0..64 {
        let origin = Coord::new(8 * (n >> 4) - 16, 8 * (n >> 2 & 3) - 16, 8 * (n & 3) - 16);
        let (mut values, mut mask) = ([0.0; 512], [0u64; 8]);
        for m in 0..512usize {
            let at = origin.offset((m >> 6) as i32, (m >> 3 & 7) as i32, (m & 7) as i32);
            let q = transform.world(at).0.abs() - half;
            let d = q.sup(&Vec3::zeros()).norm() + q.max().min(0.0);
            let cut = d.clamp(-inside(transform.world(at).0) * h, 3.0 * h);
            values[m] = cut as f32;
            if is_dense || cut == d {
                mask[m >> 6] |= 1 << (m & 63);
            } else {
                values[m] = if d < 0.0 { -0.3 } else { 0.3 };
            }
        }
        batch.push(origin, mask, &values);
    }
    // One block after another, as the band gives them.
    let blocks: std::collections::BTreeSet<Coord> =
        batch.origins.iter().map(|o| o.aligned(128)).collect();
    for block in blocks {
        let mut own = LeafBatch::default();
        for (n, &origin) in batch.origins.iter().enumerate() {
            if origin.aligned(128) == block {
                own.push(origin, batch.masks[n], &batch.values[n]);
            }
        }
        builder.block(block, &own).unwrap();
    }
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let solid = builder.finish(session).unwrap();
    let mut file = VdbWriter::new(path, session).unwrap();
    file.level_set("surface", &solid).unwrap();
    file.write().unwrap();
}

#[test]
fn torn_files_of_druse_are_refused_like_others() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("torn.vdb");
    write_cut_box(&path, |p| if p.x > 0.5 { 0.01 } else { 3.0 }, false);
    let volume = Volume::read(&path, None).unwrap();
    assert!(volume.meta("druse.content_hash").is_some());
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let error = volume.solid(&path, &GridReading::default(), session);
    let error = error.err().unwrap().to_string();
    assert!(error.contains("a torn surface"), "{error}");
}

#[test]
fn bands_that_are_narrower_inside_are_rebuilt_first() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    write_box(&path("even.vdb"), 3.0, true);
    write_box(&path("narrow.vdb"), 1.0, true);
    write_box(&path("sparse.vdb"), 1.05, false);
    let eroded = |name: &str| {
        let source = path(name).display().to_string();
        let text = format!(
            "druse = 1\nunit = \"m\"\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = {{ vdb = {{ path = \"{source}\", unit = \"m\" }} }}\n[[op]]\nerode = 0.2\n"
        );
        made(directory.path(), &text).solid.volume
    };
    let even = eroded("even.vdb");
    // The mesher bevels the edges of a box that ends in planes of voxels by half a square of them.
    let bevelled = 1.536 - 0.5 * 0.01 * 4.0 * (1.6 + 1.2 + 0.8);
    assert!((even / bevelled - 1.0).abs() < 0.005, "{even}");
    for name in ["narrow.vdb", "sparse.vdb"] {
        let narrow = eroded(name);
        assert!(
            (narrow / even - 1.0).abs() < 0.01,
            "{name}: {narrow} for {even}"
        );
        let check = Command::new(env!("CARGO_BIN_EXE_druse"))
            .arg("check")
            .arg(path(name))
            .output()
            .unwrap();
        let text = String::from_utf8(check.stdout).unwrap();
        assert!(
            text.contains("3.000 outside: operations rebuild it first"),
            "{text}"
        );
    }
}

#[test]
fn layers_of_a_file_are_those_of_the_recipe() {
    let directory = tempfile::tempdir().unwrap();
    let count = |text: &str, layer: f64, unit: LengthUnit| {
        let how = SliceOptions {
            axis: 2,
            layer: Length::In(layer, unit),
            pixel: None,
        };
        let mut areas = Vec::new();
        let recipe = Recipe::parse(text, &[]).unwrap();
        let sliced = slice(
            &recipe,
            &RunOptions::default(),
            &how,
            &Silent,
            |_, _, layer| {
                areas.push(layer.area());
                Ok::<(), druse::pipeline::RunError>(())
            },
        )
        .unwrap();
        (sliced.plan.start, areas)
    };
    // On and beside the voxels' planes.
    for (voxel, lift) in [(0.25, 0.0), (0.25, 0.1), (0.3, 0.0)] {
        let solid = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n[[op]]\nunion = {{ box = {{ size = [10, 10, 10], centre = [0, 0, {}] }} }}\n",
            5.0 + lift
        );
        made(
            directory.path(),
            &(solid.clone() + "[[output]]\nvdb = \"box.vdb\"\n"),
        );
        let path = directory.path().join("box.vdb").display().to_string();
        let file = format!(
            "druse = 1\nunit = \"m\"\n[band]\nvoxel_size = {}\n[[op]]\nunion = {{ vdb = {{ path = \"{path}\", unit = \"m\" }} }}\n",
            voxel / 1000.0
        );
        let (own, layers) = count(&solid, 1.0, LengthUnit::Millimetre);
        let (start, of_file) = count(&file, 1.0, LengthUnit::Millimetre);
        assert_eq!([layers.len(), of_file.len()], [10, 10], "{voxel} {lift}");
        assert!((start * 1000.0 - own).abs() < 1e-3 * voxel, "{start}");
        assert!(of_file.iter().all(|a| *a > 0.95e-4), "{of_file:?}");
    }
}
