//! Offsets of level sets move every wall by the requested distance, and edges and corners as in closed form.

use druse::frame::{LengthUnit, Vec3};
use druse::io::write_mesh;
use druse::mesh::TriMesh;
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A directory of files.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs operations on voxels of an edge and writes `name`, in bricks or at once.
    fn made(&self, name: &str, voxel: f64, ops: &str, bricks: Option<u32>) -> Report {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n{ops}[[output]]\nvdb = \"{name}\"\nunit = \"mm\"\n"
        );
        let options = RunOptions {
            out: Some(self.0.path().to_owned()),
            bricks,
            brief: true,
            ..RunOptions::default()
        };
        run(&Recipe::parse(&text, &[]).unwrap(), &options, &Silent).unwrap()
    }

    /// What `ops` make of a file of a solid, and its mesh.
    fn on_file(&self, voxel: f64, solid: &str, ops: &str) -> (TriMesh, LevelSet) {
        self.made("a.vdb", voxel, solid, None);
        let path = self.path("a.vdb").display().to_string();
        let source =
            format!("[[op]]\nunion = {{ vdb = {{ path = \"{path}\", unit = \"mm\" }} }}\n");
        self.made("b.vdb", voxel, &(source + ops), None);
        let solid = read(&self.path("b.vdb"));
        let threads = Threads::new(1).unwrap();
        let mesh = solid.to_mesh(Session::new(&threads, &Silent)).unwrap();
        (mesh, solid)
    }
}

fn read(path: &Path) -> LevelSet {
    let threads = Threads::new(1).unwrap();
    LevelSet::read(path, None, Session::new(&threads, &Silent)).unwrap()
}

fn block(size: [f64; 3]) -> String {
    let centre = size.map(|s| s / 2.0);
    format!("[[op]]\nunion = {{ box = {{ size = {size:?}, centre = {centre:?} }} }}\n")
}

/// Signed distance to a box from the origin to `size`.
fn to_block(size: [f64; 3], p: Vec3) -> f64 {
    let half = Vec3::from(size) / 2.0;
    let q = (p - half).abs() - half;
    q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
}

/// Greatest error of the values of a box, voxels, where its foot lies on a wall, and anywhere.
fn block_errors(solid: &LevelSet, size: [f64; 3], moved: f64) -> [f64; 2] {
    let h = solid.voxel_size();
    let mut most = [0.0f64; 2];
    solid
        .for_each_leaf(|leaf| {
            for (n, &v) in leaf
                .values
                .iter()
                .enumerate()
                .filter(|(n, _)| leaf.is_active(*n))
            {
                let p = solid.transform().world(leaf.voxel(n)).0;
                let beyond = (0..3)
                    .filter(|&a| p[a] < -0.5 * h || p[a] > size[a] + 0.5 * h)
                    .count();
                let error = (f64::from(v) - (to_block(size, p) - moved)).abs() / h;
                most[1] = most[1].max(error);
                // One coordinate beyond the old box, the others well within.
                let is_wall = beyond == 1
                    && (0..3).all(|a| {
                        p[a] < 0.0 || p[a] > size[a] || (p[a] > 3.0 * h && p[a] < size[a] - 3.0 * h)
                    });
                if is_wall {
                    most[0] = most[0].max(error);
                }
            }
        })
        .unwrap();
    most
}

#[test]
fn dilated_boxes_follow_steiner() {
    let place = Place::new();
    let h = 0.25;
    for size in [[10.0, 10.0, 10.0], [9.1, 7.3, 5.7]] {
        for voxels in [2.0, 5.0, 12.0, 40.0, 16.49] {
            let d = voxels * h;
            let (mesh, solid) = place.on_file(h, &block(size), &format!("[[op]]\ndilate = {d}\n"));
            let [a, b, c] = size;
            let faces = 2.0 * (a * b + b * c + a * c);
            let exact =
                a * b * c + faces * d + PI * (a + b + c) * d * d + 4.0 / 3.0 * PI * d.powi(3);
            let found = mesh.volume() / exact;
            assert!((found - 1.0).abs() < 0.004, "{size:?} {voxels}: {found}");
            let bounds = mesh.bounds();
            for axis in 0..3 {
                let off =
                    [bounds.min[axis] + d, bounds.max[axis] - size[axis] - d].map(|e| e.abs() / h);
                assert!(off.iter().all(|e| *e < 0.02), "{size:?} {voxels}: {off:?}");
            }
            let [wall, most] = block_errors(&solid, size, d);
            assert!(
                wall < 0.02 && most < 0.3,
                "{size:?} {voxels}: {wall} {most}"
            );
        }
    }
}

/// Farther than a surface is moved at once.
#[test]
fn a_long_way_is_gone_in_steps() {
    let place = Place::new();
    let (edge, d): (f64, f64) = (3.0, 15.0);
    let ops = format!("[[op]]\ndilate = {d}\n");
    let (mesh, _) = place.on_file(0.25, &block([edge; 3]), &ops);
    let exact = edge.powi(3)
        + 6.0 * edge.powi(2) * d
        + 3.0 * PI * edge * d.powi(2)
        + 4.0 / 3.0 * PI * d.powi(3);
    let found = mesh.volume() / exact;
    assert!((found - 1.0).abs() < 0.002, "{found}");
    let bounds = mesh.bounds();
    for axis in 0..3 {
        let off = [bounds.min[axis] + d, bounds.max[axis] - edge - d];
        assert!(off.iter().all(|e| e.abs() < 0.01), "{off:?}");
    }
}

#[test]
fn a_dilated_tetrahedron_follows_steiner() {
    let place = Place::new();
    let corners = [
        [0.0, 0.0, 0.0],
        [12.0, 0.0, 0.0],
        [0.0, 12.0, 0.0],
        [0.0, 0.0, 12.0],
    ]
    .map(Vec3::from);
    let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mesh = TriMesh::new(corners.to_vec(), faces.clone()).unwrap();
    write_mesh(place.path("t.stl"), &mesh, LengthUnit::Millimetre).unwrap();
    let source = format!(
        "[[op]]\nunion = {{ mesh = {{ path = \"{}\", unit = \"mm\" }} }}\n",
        place.path("t.stl").display()
    );
    // Half the sum over edges of length times the angle between the normals.
    let normal = |f: [u32; 3]| {
        let [a, b, c] = f.map(|v| corners[v as usize]);
        (b - a).cross(&(c - a)).normalize()
    };
    let mut bend = 0.0;
    for (n, f) in faces.iter().enumerate() {
        for g in &faces[n + 1..] {
            let shared: Vec<Vec3> = f
                .iter()
                .filter(|v| g.contains(v))
                .map(|v| corners[*v as usize])
                .collect();
            let angle = normal(*f).dot(&normal(*g)).clamp(-1.0, 1.0).acos();
            bend += (shared[0] - shared[1]).norm() * angle / 2.0;
        }
    }
    for voxels in [2.0, 5.0, 12.0, 40.0] {
        let d = voxels * 0.25;
        let (made, _) = place.on_file(0.25, &source, &format!("[[op]]\ndilate = {d}\n"));
        let exact = mesh.volume() + mesh.area() * d + bend * d * d + 4.0 / 3.0 * PI * d.powi(3);
        let found = made.volume() / exact;
        assert!((found - 1.0).abs() < 0.006, "{voxels}: {found}");
    }
}

#[test]
fn opening_closing_and_eroding_a_cube_leave_its_walls() {
    let place = Place::new();
    let size = [10.0; 3];
    let rounded = |r: f64| {
        let s = 10.0 - 2.0 * r;
        s.powi(3) + 6.0 * s * s * r + 3.0 * PI * s * r * r + 4.0 / 3.0 * PI * r.powi(3)
    };
    for (op, exact) in [
        ("open = 1.0", rounded(1.0)),
        ("close = 1.0", 1000.0),
        ("fillet = 2.0", 1000.0),
        ("erode = 4.0", 8.0),
        ("erode = 0.3", 9.4f64.powi(3)),
        ("hollow = 1.0", 1000.0 - 512.0),
    ] {
        let (mesh, _) = place.on_file(0.1, &block(size), &format!("[[op]]\n{op}\n"));
        let found = mesh.volume() / exact;
        // A mesh of voxels bevels edges and corners.
        let bevel = if op == "erode = 4.0" { 0.02 } else { 0.002 };
        assert!((found - 1.0).abs() < bevel, "{op}: {found}");
        let bounds = mesh.bounds();
        let by = op
            .strip_prefix("erode = ")
            .map_or(0.0, |d| d.parse().unwrap());
        for axis in 0..3 {
            let off = [bounds.min[axis] - by, bounds.max[axis] - 10.0 + by].map(|e| e.abs() / 0.1);
            assert!(off.iter().all(|e| *e < 0.02), "{op}: {off:?}");
        }
    }
}

#[test]
fn a_fillet_rounds_the_concave_edge_alone() {
    let place = Place::new();
    let two = |op: &str| {
        let one = block([20.0, 10.0, 6.0]);
        let other = "[[op]]\nunion = { box = { size = [6, 10, 20], centre = [3, 5, 10] } }\n";
        place.on_file(0.2, &(one + other), op).0
    };
    let plain = two("");
    let exact = 20.0 * 10.0 * 6.0 + 6.0 * 10.0 * 14.0;
    for radius in [1.0, 3.0] {
        let filled = two(&format!("[[op]]\nfillet = {radius}\n"));
        let added = filled.volume() - plain.volume();
        let expected_volume = (1.0 - PI / 4.0) * radius * radius * 10.0;
        assert!(
            (added / expected_volume - 1.0).abs() < 0.06,
            "{radius}: {added} for {expected_volume}"
        );
        assert!((plain.volume() / exact - 1.0).abs() < 0.003);
        let [a, b] = [&plain, &filled].map(TriMesh::bounds);
        assert!((a.min - b.min).amax() < 0.004 && (a.max - b.max).amax() < 0.004);
    }
}

#[test]
fn files_and_recipes_memory_and_bricks_agree() {
    let place = Place::new();
    let solid = block([9.1, 7.3, 5.7]);
    place.made("a.vdb", 0.25, &solid, None);
    let path = place.path("a.vdb").display().to_string();
    let file = format!("[[op]]\nunion = {{ vdb = {{ path = \"{path}\", unit = \"mm\" }} }}\n");
    let hash = |source: &str, ops: &str, brick| {
        let report = place.made("b.vdb", 0.25, &format!("{source}{ops}"), brick);
        report.outputs[0].content_hash.clone().unwrap()
    };
    for op in [
        "dilate = 1.3",
        "erode = 0.9",
        "open = 0.8",
        "close = 1.1",
        "hollow = 0.7",
        "fillet = 0.8",
    ] {
        let op = format!("[[op]]\n{op}\n");
        let own = hash(&file, &op, None);
        assert_eq!(own, hash(&file, &op, Some(1)), "{op}");
        // A recipe whose solid is a level set by then.
        assert_eq!(
            own,
            hash(&solid, &format!("[[op]]\nprune = true\n{op}"), None),
            "{op}"
        );
    }
}
