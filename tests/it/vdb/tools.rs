//! The same operations by OpenVDB's own command line tool: the same numbers.
//!
//! `vdb_tool` has no Laplacian or curvature flow; all else that both offer is compared.

use super::operations::Op;
use super::*;
use druse::vdb::{self, Scheme, Tools, VdbWriter};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Largest difference of two level sets in voxels, over the voxels that are active in either.
fn difference(a: &LevelSet, b: &LevelSet) -> f32 {
    let mut worst = 0f32;
    for (one, other) in [(a, b), (b, a)] {
        one.for_each_leaf(|leaf| {
            let active: Vec<usize> = (0..512).filter(|&n| leaf.is_active(n)).collect();
            let voxels: Vec<Coord> = active.iter().map(|&n| leaf.voxel(n)).collect();
            let theirs = other.values(&voxels).unwrap();
            for (&n, v) in active.iter().zip(theirs) {
                worst = worst.max((leaf.values[n] - v).abs());
            }
        })
        .unwrap();
    }
    worst / a.voxel_size() as f32
}

fn write(path: &Path, solid: &LevelSet) {
    let mut file = VdbWriter::new(path, session()).unwrap();
    file.level_set("surface", solid).unwrap();
    file.write().unwrap();
}

/// A part with edges, hollows and thin places.
fn part() -> LevelSet {
    let h = 0.5;
    let block = BoxSolid(Aabb {
        min: Vec3::new(-6.0, -5.0, -4.0),
        max: Vec3::new(6.0, 5.0, 4.0),
    });
    let hole = Sphere {
        centre: Vec3::new(4.0, 3.0, 3.0),
        radius: 4.0,
    };
    level_set(&intersection(block, complement(hole)), cube(6.0), h)
}

/// The tool, or none (with a note) where it is not installed.
fn tool() -> Option<Command> {
    let found = Command::new("vdb_tool")
        .arg("-version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    if found.is_err() {
        println!("vdb_tool is missing (Debian: libopenvdb-tools): nothing was compared");
        return None;
    }
    Some(Command::new("vdb_tool"))
}

#[test]
fn filters_give_what_vdb_tool_gives() {
    let Some(_) = tool() else { return };
    let directory = tempfile::tempdir().unwrap();
    let path = |n: &str| -> PathBuf { directory.path().join(n) };
    write(&path("in.vdb"), &part());
    let cases: [(&str, Op); 7] = [
        ("-mean iter=2 size=1", |s, c| s.mean(1, 2, c)),
        ("-gauss iter=1 size=2", |s, c| s.gaussian(2, 1, c)),
        ("-median iter=1 size=1", |s, c| s.median(1, 1, c)),
        ("-dilate radius=1.5", |s, c| s.dilate(0.75, c)),
        ("-erode radius=1.5", |s, c| s.erode(0.75, c)),
        ("-open radius=1", |s, c| s.open(0.5, c)),
        ("-close radius=1", |s, c| s.close(0.5, c)),
    ];
    for (space, scheme) in [(1, Scheme::First), (5, Scheme::Weno5)] {
        for (words, op) in &cases {
            let mut ours = LevelSet::read(&path("in.vdb"), None, session()).unwrap();
            // Own moves are other ones, and better.
            let tools = if words.contains("radius") {
                Tools::OpenVdb
            } else {
                Tools::Native
            };
            op(&mut ours, session().with_scheme(scheme).with_tools(tools)).unwrap();
            let mut call = Command::new("vdb_tool");
            call.arg("-quiet").arg("-read").arg(path("in.vdb"));
            call.args(words.split(' ')).arg(format!("space={space}"));
            call.arg("-write").arg(path("out.vdb"));
            assert!(call.output().unwrap().status.success(), "{words}");
            let name = only_name(&path("out.vdb"));
            let theirs = LevelSet::read(&path("out.vdb"), Some(&name), session()).unwrap();
            let d = difference(&ours, &theirs);
            assert!(d <= 1e-3, "{words} space={space}: {d} voxels");
        }
    }
}

/// The tool renames grids after what it did to them.
fn only_name(path: &Path) -> String {
    vdb::info(path).unwrap().grids[0].name.clone()
}

/// Combines a level set with another one.
type Join = fn(&mut LevelSet, LevelSet);

#[test]
fn boolean_operations_and_meshes_are_those_of_vdb_tool() {
    let Some(_) = tool() else { return };
    let directory = tempfile::tempdir().unwrap();
    let path = |n: &str| -> PathBuf { directory.path().join(n) };
    write(&path("a.vdb"), &part());
    let other = sphere_at(Vec3::new(-3.0, -2.0, -3.0), 4.0, 0.5);
    write(&path("b.vdb"), &other);
    let cases: [(&str, Join); 3] = [
        ("-union", |a, b| a.union(b, session()).unwrap()),
        ("-intersection", |a, b| a.intersect(b, session()).unwrap()),
        ("-difference", |a, b| a.subtract(b, session()).unwrap()),
    ];
    for (word, op) in cases {
        let mut ours = part();
        op(&mut ours, other.duplicate().unwrap());
        // The tool counts from the grid that was read last.
        let call = Command::new("vdb_tool")
            .args(["-quiet", "-read"])
            .arg(path("b.vdb"))
            .arg("-read")
            .arg(path("a.vdb"))
            .arg(word)
            .arg("-write")
            .arg(path("out.vdb"))
            .output()
            .unwrap();
        assert!(call.status.success(), "{word}");
        let name = only_name(&path("out.vdb"));
        let theirs = LevelSet::read(&path("out.vdb"), Some(&name), session()).unwrap();
        let d = difference(&ours, &theirs);
        assert!(d <= 1e-3, "{word}: {d} voxels");
    }
    let call = Command::new("vdb_tool")
        .args(["-quiet", "-read"])
        .arg(path("a.vdb"))
        .args(["-ls2mesh", "adapt=0", "-write"])
        .arg(path("out.ply"))
        .output()
        .unwrap();
    assert!(call.status.success());
    let theirs = druse::io::read_mesh(path("out.ply")).unwrap().mesh;
    let ours = part().to_quads(0.0, session()).unwrap().into_triangles();
    assert_eq!(ours.vertices().len(), theirs.vertices().len());
    // Its triangles are wound inward; the volumes are those of the same quadrilaterals, cut otherwise.
    let ratio = ours.volume() / theirs.volume().abs();
    assert!((ratio - 1.0).abs() < 1e-4, "{ratio}");
    // Ours lifts values within 1e-4 voxel of zero, which would make edges of more than two triangles.
    let [a, b] = [ours.bounds(), theirs.bounds()];
    let most = 1.1e-4 * part().voxel_size();
    let off = (a.min - b.min).amax().max((a.max - b.max).amax());
    assert!(off < most, "{off}");
}
