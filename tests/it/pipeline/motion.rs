//! Scaffolds that move, against closed forms: velocities, places at rest, and what is refused.

use super::{recipe, run};
use druse::frame::Vec3;
use druse::io::write_vtu;
use druse::pipeline::RunOptions;
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::vdb::{LeafView, LevelSet, Session};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Height of the bar, and radians per second of its top.
const HEIGHT: f64 = 12.0;
const RATE: f64 = 1.5;

/// A bar of tets, twisted about z in proportion to the height.
fn twisting(outputs: &str) -> String {
    let angle = format!("{RATE}*time*z/{HEIGHT}");
    format!(
        "druse = 1\nunit = \"mm\"\nframe = 13\n[cell.p]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.4\n\
         [scaffold]\nbox = {{ size = [6, 6, {HEIGHT}], cell_size = 1, origin = [-3, -3, 0], kind = \"tet\" }}\n\
         [scaffold.motion]\n\
         deform = [\"x*cos({angle}) - y*sin({angle})\", \"x*sin({angle}) + y*cos({angle})\", \"z\"]\n\
         [tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.2\n{outputs}"
    )
}

fn into(out: &Path) -> RunOptions {
    RunOptions {
        out: Some(out.to_owned()),
        brief: true,
        ..RunOptions::default()
    }
}

/// The rows of a binary .ply of doubles or floats, by way of its own reader of text.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let (_, rows) = super::outputs::ply_rows(path);
    rows.into_iter()
        .map(|r| r.into_iter().map(f64::from).collect())
        .collect()
}

#[test]
fn a_twisted_bar_has_the_velocity_of_its_closed_form() {
    let place = tempfile::tempdir().unwrap();
    let grids = "[[output]]\nmesh = \"a.ply\"\ngrids = [\"vel\", \"rest\"]\n";
    run(&recipe(&twisting(grids)), &into(place.path()), &Silent).unwrap();
    let (mut error, mut whole, mut count) = (0.0, 0.0, 0);
    let turn = RATE * 0.5; // at frame 13 of 24 a second
    for r in rows(&place.path().join("a.ply")) {
        let p = Vec3::new(r[0], r[1], r[2]);
        let (vel, rest) = (Vec3::new(r[3], r[4], r[5]), Vec3::new(r[6], r[7], r[8]));
        let exact = Vec3::new(-p.y, p.x, 0.0) * (RATE * p.z / HEIGHT);
        error += (vel - exact).norm_squared();
        whole += exact.norm_squared();
        let (s, c) = (turn * p.z / HEIGHT).sin_cos();
        let back = Vec3::new(c * p.x + s * p.y, c * p.y - s * p.x, p.z);
        // Between its nodes, 1 apart, an element does not twist.
        assert!((back - rest).norm() < 0.1, "{rest} at {p}");
        count += 1;
    }
    let rms = (error / whole).sqrt();
    println!("figure: velocity of a twisted bar, rms error at {count} points | {rms:.5} | 0.01");
    assert!(rms < 0.01, "{rms}");
}

#[test]
fn velocities_in_bricks_are_those_of_memory_and_follow_the_unit() {
    let place = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| place.path().join(n));
    let grids = "[[output]]\nvdb = \"a.vdb\"\ngrids = [\"surface\", \"vel\", \"rest\", \"uvw\"]\n";
    let recipe = recipe(&twisting(grids).replace("[6, 6,", "[3, 3,"));
    let one = run(&recipe, &into(&whole), &Silent).unwrap();
    let bricks = RunOptions {
        bricks: Some(1),
        ..into(&parts)
    };
    let two = run(&recipe, &bricks, &Silent).unwrap();
    assert!(one.outputs[0].content_hash.is_some());
    assert_eq!(one.outputs[0].content_hash, two.outputs[0].content_hash);
}

/// A series of .vtu files of a bar of hexes that moves along x by `shift(frame)`.
fn series(folder: &Path, frames: &[i32], shift: impl Fn(i32) -> f64) {
    let bar = Scaffold::box_grid(Vec3::new(4.0, 2.0, 2.0), [2, 1, 1], Kind::Hex8).unwrap();
    for &frame in frames {
        let moved = bar.nodes().iter().map(|p| p + Vec3::x() * shift(frame));
        let moved = Scaffold::new(moved.collect(), bar.connectivity().clone()).unwrap();
        write_vtu(folder.join(format!("bar.{frame:04}.vtu")), &moved, &[]).unwrap();
    }
}

fn of_series(folder: &Path, frame: i32, more: &str) -> Recipe {
    let text = format!(
        "druse = 1\nframe = {frame}\nfps = 10\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = \"{}/bar.$F4.vtu\"\n{more}\
         [tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.25\n[[output]]\nmesh = \"a.ply\"\ngrids = [\"vel\", \"rest\"]\n",
        folder.display()
    );
    recipe(&text)
}

#[test]
fn a_series_of_files_has_central_and_one_sided_differences() {
    let place = tempfile::tempdir().unwrap();
    // Frames 1, 2, 4 at 10 a second: x = 0, 1, 9.
    series(place.path(), &[1, 2, 4], |f| f64::from((f - 1) * (f - 1)));
    for (frame, velocity) in [(1, 10.0), (2, 30.0), (4, 40.0)] {
        let recipe = of_series(place.path(), frame, "");
        run(&recipe, &into(place.path()), &Silent).unwrap();
        let shift = f64::from((frame - 1) * (frame - 1));
        for r in rows(&place.path().join("a.ply")) {
            assert!((r[3] - velocity).abs() < 1e-3 && r[4].abs() < 1e-3, "{r:?}");
            assert!(
                (r[0] - shift - r[6]).abs() < 1e-3 || r[6] < 0.0 || r[6] > 3.9,
                "{r:?}"
            );
        }
    }
}

#[test]
fn what_does_not_move_alike_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let error = |frame, more: &str| {
        let recipe = of_series(place.path(), frame, more);
        let e = run(&recipe, &into(place.path()), &Silent).unwrap_err();
        format!("{e} {e:?}")
    };
    series(place.path(), &[1], f64::from);
    let alone = error(1, "");
    assert!(alone.contains("a time step of zero"), "{alone}");
    series(place.path(), &[2, 5], f64::from);
    let missing = error(3, "");
    for words in [
        "no file for frame 3",
        "the nearest frames that exist are 2 and 5",
    ] {
        assert!(missing.contains(words), "{missing}");
    }
    let rest = error(2, "[scaffold.motion]\nrest_frame = 9\n");
    assert!(rest.contains("no file for the rest frame 9"), "{rest}");
    // Frame 3 has its second element turned.
    let bar = Scaffold::box_grid(Vec3::new(4.0, 2.0, 2.0), [2, 1, 1], Kind::Hex8).unwrap();
    let mut elements = Connectivity::default();
    elements.push(Kind::Hex8, bar.connectivity().nodes(0));
    let n = bar.connectivity().nodes(1);
    elements.push(
        Kind::Hex8,
        &[n[1], n[2], n[3], n[0], n[5], n[6], n[7], n[4]],
    );
    let turned = Scaffold::new(bar.nodes().to_vec(), elements).unwrap();
    write_vtu(place.path().join("bar.0003.vtu"), &turned, &[]).unwrap();
    let changed = error(2, "");
    for words in ["frame 2", "frame 3", "element 1", "same connectivity"] {
        assert!(changed.contains(words), "{changed}");
    }
}

/// A point cache of the nodes of a scaffold.
fn cache(path: &Path, nodes: &[Vec3], step: f32, samples: &[f64]) {
    let mut bytes = b"POINTCACHE2\0".to_vec();
    bytes.extend(1i32.to_le_bytes());
    bytes.extend((nodes.len() as i32).to_le_bytes());
    bytes.extend(1f32.to_le_bytes());
    bytes.extend(step.to_le_bytes());
    bytes.extend((samples.len() as i32).to_le_bytes());
    for shift in samples {
        for p in nodes {
            bytes.extend(
                [p.x as f32, (p.y + shift) as f32, p.z as f32]
                    .map(f32::to_le_bytes)
                    .concat(),
            );
        }
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn point_caches_move_the_nodes_of_a_file() {
    let place = tempfile::tempdir().unwrap();
    let bar = Scaffold::box_grid(Vec3::new(4.0, 2.0, 2.0), [2, 1, 1], Kind::Hex8).unwrap();
    write_vtu(place.path().join("bar.vtu"), &bar, &[]).unwrap();
    let path = place.path().join("bar.pc2");
    let at = |frame: i32, points: &str| {
        let text = format!(
            "druse = 1\nframe = {frame}\nfps = 10\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = \"{0}/bar.vtu\"\n\
             [scaffold.motion]\npoints = \"{0}/{points}\"\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.25\n\
             [[output]]\nmesh = \"a.ply\"\ngrids = [\"vel\"]\n",
            place.path().display()
        );
        Recipe::parse(&text, &[]).map_err(|e| format!("{e} {:?}", e.hint))
    };
    cache(&path, bar.nodes(), 1.0, &[0.0, 1.0, 3.0]);
    for (frame, velocity) in [(1, 10.0), (2, 15.0), (3, 20.0)] {
        run(&at(frame, "bar.pc2").unwrap(), &into(place.path()), &Silent).unwrap();
        for r in rows(&place.path().join("a.ply")) {
            assert!(r[3].abs() < 1e-3 && (r[4] - velocity).abs() < 1e-3, "{r:?}");
        }
    }
    let fails = |frame: i32| {
        let e = run(&at(frame, "bar.pc2").unwrap(), &into(place.path()), &Silent).unwrap_err();
        format!("{e} {e:?}")
    };
    assert!(fails(7).contains("the nearest is frame 3"), "{}", fails(7));
    cache(&path, bar.nodes(), 0.0, &[0.0, 1.0]);
    assert!(fails(1).contains("a time step of 0"), "{}", fails(1));
    cache(&path, &bar.nodes()[1..], 1.0, &[0.0, 1.0]);
    assert!(fails(1).contains("as many as the scaffold's file has nodes"));
    let alembic = at(1, "bar.abc").unwrap_err();
    assert!(
        alembic.contains("Alembic") && alembic.contains("Point Cache"),
        "{alembic}"
    );
}

/// The leaves whose voxels all lie below a height in voxels, with their values and masks.
fn leaves_below(path: &Path, height: i32) -> BTreeMap<[i32; 3], (Vec<u32>, [u64; 8])> {
    let threads = Threads::new(2).unwrap();
    let solid = LevelSet::read(path, None, Session::new(&threads, &Silent)).unwrap();
    let mut found = BTreeMap::new();
    let keep = |leaf: LeafView| {
        if leaf.origin.0[2] + 7 < height {
            let bits = leaf.values.iter().map(|v| v.to_bits()).collect();
            found.insert(leaf.origin.0, (bits, leaf.mask));
        }
    };
    solid.for_each_leaf(keep).unwrap();
    found
}

#[test]
fn still_regions_of_a_moving_part_do_not_flicker() {
    let place = tempfile::tempdir().unwrap();
    // Nodes above z = 6 move, and with them the tets above z = 5, at 40 voxels; filters reach a few voxels farther.
    let at = |frame: i32| {
        let text = format!(
            "druse = 1\nunit = \"mm\"\nframe = {frame}\n[cell.p]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.4\n\
             [scaffold]\nbox = {{ size = [6, 6, 12], cell_size = 2, kind = \"tet\" }}\n[scaffold.motion]\n\
             deform = [\"x + 0.2*frame*max(z - 6, 0)\", \"y\", \"z\"]\n[tiling]\ncell = \"p\"\n\
             [band]\nvoxel_size = 0.125\n[[op]]\ndilate = 0.05\n[[op]]\ngaussian = 1\n[[output]]\nvdb = \"{frame}.vdb\"\n"
        );
        run(&recipe(&text), &into(place.path()), &Silent).unwrap();
        leaves_below(&place.path().join(format!("{frame}.vdb")), 32)
    };
    let (first, second) = (at(1), at(2));
    assert!(first.len() > 50, "{}", first.len());
    assert!(first == second);
}

/// Writes a scaffold with a point field of three components.
fn write_with_vectors(
    path: &Path,
    scaffold: &Scaffold,
    name: &str,
    at: impl Fn(&Vec3) -> [f64; 3],
) {
    write_vtu(path, scaffold, &[]).unwrap();
    let mut field = format!(
        "<PointData><DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"3\" format=\"ascii\">"
    );
    for p in scaffold.nodes() {
        let [x, y, z] = at(p);
        let _ = write!(field, " {x} {y} {z}");
    }
    field.push_str("</DataArray></PointData>");
    // Binary data follow the text.
    let mut bytes = std::fs::read(path).unwrap();
    let place = bytes.windows(8).position(|w| w == b"<Points>").unwrap();
    bytes.splice(place..place, field.into_bytes());
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn displacements_of_a_solver_move_the_nodes_of_a_series() {
    let place = tempfile::tempdir().unwrap();
    let bar = Scaffold::box_grid(Vec3::new(4.0, 2.0, 2.0), [2, 1, 1], Kind::Hex8).unwrap();
    for (frame, moved) in [(1, 0.0), (2, 0.25), (4, 1.0)] {
        let path = place.path().join(format!("bar.{frame:04}.vtu"));
        write_with_vectors(&path, &bar, "u", |_| [0.0, moved, 0.0]);
    }
    let text = |frame: i32, name: &str| {
        format!(
            "druse = 1\nframe = {frame}\nfps = 10\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\n\
             file = \"{}/bar.$F4.vtu\"\n[scaffold.motion]\ndisplacement = \"{name}\"\n[tiling]\ncell = \"p\"\n\
             [band]\nvoxel_size = 0.25\n[[output]]\nmesh = \"a.ply\"\ngrids = [\"vel\", \"rest\"]\n",
            place.path().display()
        )
    };
    // Central differences over the frames that exist on both sides; rest is without the displacement.
    for (frame, velocity, moved) in [(1, 2.5, 0.0), (2, 10.0 / 3.0, 0.25), (4, 3.75, 1.0)] {
        let recipe = Recipe::parse(&text(frame, "u"), &[]).unwrap();
        run(&recipe, &into(place.path()), &Silent).unwrap();
        for r in rows(&place.path().join("a.ply")) {
            assert!(r[3].abs() < 1e-3 && (r[4] - velocity).abs() < 1e-3, "{r:?}");
            let rest = [r[6], r[7], r[8]];
            let error = (0..3).map(|a| (r[a] - rest[a] - [0.0, moved, 0.0][a]).abs());
            assert!(error.fold(0.0, f64::max) < 2e-2, "{frame}: {r:?}");
        }
    }
    let recipe = Recipe::parse(&text(2, "w"), &[]).unwrap();
    let e = run(&recipe, &into(place.path()), &Silent).unwrap_err();
    assert!(e.to_string().contains("the point fields u"), "{e}");
}

#[test]
fn a_velocity_field_of_the_file_is_taken_as_it_is() {
    let place = tempfile::tempdir().unwrap();
    let bar = Scaffold::box_grid(Vec3::new(4.0, 2.0, 2.0), [2, 1, 1], Kind::Hex8).unwrap();
    let path = place.path().join("bar.vtu");
    write_with_vectors(&path, &bar, "v", |p| [p.x, 0.0, 2.0 * p.y]);
    let of_field = |name: &str| {
        recipe(&format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = {{ path = \"{}\", unit = \"cm\" }}\nrefine = 1\n\
             [scaffold.motion]\nvelocity = \"{name}\"\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 1\n\
             [[output]]\nmesh = \"a.ply\"\ngrids = [\"vel\"]\n",
            path.display()
        ))
    };
    run(&of_field("v"), &into(place.path()), &Silent).unwrap();
    for r in rows(&place.path().join("a.ply")) {
        let inside = |v: f64, end: f64| v.clamp(0.0, end);
        let exact = [inside(r[0], 40.0), 0.0, 2.0 * inside(r[1], 20.0)];
        for a in 0..3 {
            assert!((r[3 + a] - exact[a]).abs() < 0.1, "{r:?} {exact:?}");
        }
    }
    let e = run(&of_field("u"), &into(place.path()), &Silent).unwrap_err();
    assert!(e.to_string().contains("the point fields v"), "{e}");
}
