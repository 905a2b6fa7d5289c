//! Offsets of solids with sharp corners: no band has gaps, and values are distances in closed form.

use druse::frame::{LengthUnit, Mat3, Vec3};
use druse::io::write_mesh;
use druse::mesh::TriMesh;
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session};
use std::path::Path;
use std::sync::LazyLock;

static THREADS: LazyLock<Threads> = LazyLock::new(|| Threads::new(2).unwrap());

fn session() -> Session<'static> {
    Session::new(&THREADS, &Silent)
}

/// A convex polyhedron on voxels of edge 1.
struct Polyhedron {
    corners: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

impl Polyhedron {
    /// Rotated about its centroid by angles without symmetry, with no corner at a voxel.
    fn rotated(corners: &[[f64; 3]], faces: &[[u32; 3]]) -> Self {
        let rotation = |axis: usize, angle: f64| {
            let (s, c) = angle.sin_cos();
            let mut r = Mat3::identity();
            let [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
            (r[(i, i)], r[(j, j)]) = (c, c);
            (r[(i, j)], r[(j, i)]) = (-s, s);
            r
        };
        let r = rotation(2, 1.13) * rotation(1, -0.61) * rotation(0, 0.37);
        let centroid = corners.iter().map(|c| Vec3::from(*c)).sum::<Vec3>() / corners.len() as f64;
        let place = |c: &[f64; 3]| r * (Vec3::from(*c) - centroid) + Vec3::new(0.31, 0.17, -0.23);
        Self {
            corners: corners.iter().map(place).collect(),
            faces: faces.to_vec(),
        }
    }

    /// A quarter of a cube's corner: three edges of 48 voxels along the axes.
    fn tetrahedron() -> Self {
        let axis = |a: usize| Vec3::ith(a, 48.0);
        Self {
            corners: vec![Vec3::zeros(), axis(0), axis(1), axis(2)],
            faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    fn rotated_tetrahedron() -> Self {
        let own = Self::tetrahedron();
        let corners: Vec<[f64; 3]> = own.corners.iter().map(|c| (*c).into()).collect();
        Self::rotated(&corners, &own.faces)
    }

    /// Inscribed ball of a radius of 8 voxels.
    fn regular_tetrahedron() -> Self {
        let c = 8.0 * 3.0f64.sqrt();
        Self::rotated(
            &[[c, c, c], [c, -c, -c], [-c, c, -c], [-c, -c, c]],
            &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
        )
    }

    fn cube() -> Self {
        let corner = |n: u32| [n & 1, n >> 1 & 1, n >> 2].map(|b| f64::from(b) * 40.0);
        let corners: Vec<[f64; 3]> = (0..8).map(corner).collect();
        let squares = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let halves = squares
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        Self::rotated(&corners, &halves.collect::<Vec<_>>())
    }

    fn octahedron() -> Self {
        let r = 24.0;
        let corners = [
            [r, 0.0, 0.0],
            [-r, 0.0, 0.0],
            [0.0, r, 0.0],
            [0.0, -r, 0.0],
            [0.0, 0.0, r],
            [0.0, 0.0, -r],
        ];
        let faces = [
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ];
        Self::rotated(&corners, &faces)
    }

    fn level_set(&self) -> LevelSet {
        let place = tempfile::tempdir().unwrap();
        made(place.path(), &self.source(place.path()), None);
        read(place.path())
    }

    /// Writes its mesh; the operation that adds it.
    fn source(&self, directory: &Path) -> String {
        let path = directory.join("a.stl");
        let mesh = TriMesh::new(self.corners.clone(), self.faces.clone()).unwrap();
        write_mesh(&path, &mesh, LengthUnit::Millimetre).unwrap();
        format!(
            "[[op]]\nunion = {{ mesh = {{ path = \"{}\", unit = \"mm\" }} }}\n",
            path.display()
        )
    }

    /// The signed distance: to the nearest face, edge or corner.
    fn distance(&self, p: Vec3) -> f64 {
        let (mut nearest, mut plane) = (f64::INFINITY, f64::NEG_INFINITY);
        for face in &self.faces {
            let [a, b, c] = face.map(|v| self.corners[v as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            let height = normal.dot(&(p - a));
            plane = plane.max(height);
            let foot = p - normal * height;
            let edges = [[a, b], [b, c], [c, a]];
            if edges
                .iter()
                .all(|[u, v]| normal.cross(&(v - u)).dot(&(foot - u)) >= 0.0)
            {
                nearest = nearest.min(height.abs());
            }
            for [u, v] in edges {
                let along = v - u;
                let share = (along.dot(&(p - u)) / along.norm_squared()).clamp(0.0, 1.0);
                nearest = nearest.min((p - u - along * share).norm());
            }
        }
        nearest.copysign(plane)
    }
}

/// Runs operations on voxels of edge 1 and writes `a.vdb`.
fn made(directory: &Path, ops: &str, bricks: Option<u32>) -> Report {
    made_with(3.0, directory, ops, bricks)
}

/// The same with a half width in voxels.
fn made_with(half_width: f64, directory: &Path, ops: &str, bricks: Option<u32>) -> Report {
    let text = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 1\nhalf_width = {half_width}\n{ops}[[output]]\nvdb = \"a.vdb\"\nunit = \"mm\"\n"
    );
    let options = RunOptions {
        out: Some(directory.to_owned()),
        bricks,
        brief: true,
        ..RunOptions::default()
    };
    run(&Recipe::parse(&text, &[]).unwrap(), &options, &Silent).unwrap()
}

fn read(directory: &Path) -> LevelSet {
    LevelSet::read(&directory.join("a.vdb"), None, session()).unwrap()
}

/// Offsets a solid outwards by a distance, inwards if it is negative, and asserts that its band has no gaps.
fn moved(name: &str, solid: &LevelSet, by: f64) -> LevelSet {
    let mut moved = solid.duplicate().unwrap();
    if by > 0.0 {
        moved.dilate(by, session()).unwrap();
    } else {
        moved.erode(-by, session()).unwrap();
    }
    let check = moved.check(session()).unwrap();
    assert!(check.passed(), "{name} by {by}: {:?}", check.problems());
    moved
}

/// Greatest error of every seventh active value, and the root mean square, voxels.
fn errors(solid: &LevelSet, exact: impl Fn(Vec3) -> f64) -> [f64; 2] {
    let (mut most, mut sum, mut count) = (0f64, 0.0, 0usize);
    solid
        .for_each_leaf(|leaf| {
            for n in (0..512).filter(|&n| leaf.is_active(n)).step_by(7) {
                let p = solid.transform().world(leaf.voxel(n)).0;
                let error = (f64::from(leaf.values[n]) - exact(p)).abs();
                most = most.max(error);
                sum += error * error;
                count += 1;
            }
        })
        .unwrap();
    assert!(count > 100, "{count} values");
    [most, (sum / count as f64).sqrt()]
}

#[test]
fn moved_polyhedra_have_distances_in_closed_form() {
    // A corner of four faces is as far as the last crossing of a lattice edge before it.
    for (name, body, moves, limits) in [
        (
            "tetrahedron",
            Polyhedron::tetrahedron(),
            &[5.0, 20.0, 44.0, 60.0][..],
            // Its corner lies at a voxel, whose value is zero: no crossing determines a corner there.
            [1.2, 0.15],
        ),
        (
            "rotated tetrahedron",
            Polyhedron::rotated_tetrahedron(),
            &[5.0, 20.0, 44.0][..],
            [1.2, 0.06],
        ),
        (
            "regular tetrahedron",
            Polyhedron::regular_tetrahedron(),
            &[5.0, 20.0, 44.0][..],
            [1.2, 0.06],
        ),
        (
            "cube",
            Polyhedron::cube(),
            &[5.0, 20.0, -5.0][..],
            [0.6, 0.03],
        ),
        (
            "octahedron",
            Polyhedron::octahedron(),
            &[5.0, 20.0, -5.0][..],
            [1.6, 0.25],
        ),
    ] {
        let solid = body.level_set();
        // The first and the last; all in the long series.
        let every = if crate::is_full() { 1 } else { moves.len() - 1 };
        for &by in moves.iter().step_by(every) {
            let moved = moved(name, &solid, by);
            let [most, rms] = errors(&moved, |p| body.distance(p) - by);
            assert!(
                most < limits[0] && rms < limits[1],
                "{name} by {by}: {most} {rms} voxels"
            );
        }
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn moved_solids_have_no_gaps() {
    let boxes = |size: [f64; 3], centre: [f64; 3]| {
        format!("[[op]]\nunion = {{ box = {{ size = {size:?}, centre = {centre:?} }} }}\n")
    };
    let capsule =
        "[[op]]\nunion = { capsule = { from = [0.3, 0.2, 0.1], to = [28, 16, 12], radius = 8 } }\n";
    let overlapping = boxes([32.0, 24.0, 20.0], [16.0, 12.0, 10.0])
        + &boxes([36.0, 28.0, 32.0], [30.3, 22.1, 20.7]);
    let bracket = boxes([60.0, 30.0, 18.0], [30.0, 15.0, 9.0])
        + &boxes([18.0, 30.0, 60.0], [9.0, 15.0, 30.0]);
    for (name, source) in [
        ("capsule", capsule),
        ("overlapping boxes", overlapping.as_str()),
        ("bracket", bracket.as_str()),
    ] {
        let place = tempfile::tempdir().unwrap();
        made(place.path(), source, None);
        let solid = read(place.path());
        for by in [5.0, 20.0, -5.0] {
            moved(name, &solid, by);
        }
        for closes in [true, false] {
            let mut twice = solid.duplicate().unwrap();
            if closes {
                twice.close(12.0, session()).unwrap();
            } else {
                twice.open(5.0, session()).unwrap();
            }
            let check = twice.check(session()).unwrap();
            assert!(check.passed(), "{name} {closes}: {:?}", check.problems());
        }
    }
}

#[test]
fn offsets_agree_in_bricks_and_are_read_again() {
    let place = tempfile::tempdir().unwrap();
    let source = Polyhedron::regular_tetrahedron().source(place.path());
    // The solid is a level set at that step.
    let ops = format!("{source}[[op]]\nprune = true\n[[op]]\ndilate = 12\n[[op]]\nerode = 8\n");
    let hash = |bricks| {
        let report = made(place.path(), &ops, bricks);
        report.outputs[0].content_hash.clone().unwrap()
    };
    assert_eq!(hash(None), hash(Some(1)));
    let own = place.path().join("own.vdb");
    std::fs::rename(place.path().join("a.vdb"), &own).unwrap();
    let again = format!(
        "[[op]]\nunion = {{ vdb = {{ path = \"{}\", unit = \"mm\" }} }}\n",
        own.display()
    );
    made(place.path(), &again, None);
}

/// Bands narrower than the stencils of surface points are widened for the offset.
#[test]
#[ignore = "long; tests/run full"]
fn narrow_bands_move_like_wide_ones() {
    let body = Polyhedron::cube();
    let place = tempfile::tempdir().unwrap();
    let source = body.source(place.path());
    for half_width in [1.5, 2.0] {
        made_with(half_width, place.path(), &source, None);
        let solid = read(place.path());
        for by in [5.0, 20.0, -5.0] {
            let moved = moved("cube", &solid, by);
            assert!((moved.half_width() - half_width).abs() < 1e-6);
            let [most, rms] = errors(&moved, |p| body.distance(p) - by);
            assert!(
                most < 0.8 && rms < 0.1,
                "{half_width} by {by}: {most} {rms} voxels"
            );
        }
        let ops = format!("{source}[[op]]\nprune = true\n[[op]]\ndilate = 6\n[[op]]\nerode = 4\n");
        let hash = |bricks| {
            let report = made_with(half_width, place.path(), &ops, bricks);
            report.outputs[0].content_hash.clone().unwrap()
        };
        assert_eq!(hash(None), hash(Some(1)));
    }
}
