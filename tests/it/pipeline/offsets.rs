//! Offsets of what is still a field: against closed forms, and when they are not to be had.

use super::recipe;
use druse::frame::Vec3;
use druse::mesh::MeshSolid;
use druse::pipeline::{OffsetMethod, Report, RunOptions, run};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session};

/// Runs a recipe on voxels of 0.25; its report and level set.
fn made(ops: &str, options: RunOptions) -> (Report, LevelSet) {
    let place = tempfile::tempdir().unwrap();
    let text = format!(
        "druse = 1\n[band]\nvoxel_size = 0.25\n{ops}[[output]]\nvdb = \"a.vdb\"\nunit = \"mm\"\n"
    );
    let options = RunOptions {
        out: Some(place.path().to_owned()),
        brief: true,
        ..options
    };
    let report = run(&recipe(&text), &options, &Silent).unwrap();
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let solid = LevelSet::read(&place.path().join("a.vdb"), None, session).unwrap();
    (report, solid)
}

/// Root mean square and greatest difference of the active values from a distance, voxels.
fn errors(solid: &LevelSet, exact: impl Fn(Vec3) -> f64) -> (f64, f64) {
    errors_where(solid, |p| Some(exact(p)))
}

/// The same where there is a distance.
fn errors_where(solid: &LevelSet, exact: impl Fn(Vec3) -> Option<f64>) -> (f64, f64) {
    let (mut sum, mut count, mut most) = (0.0, 0.0, 0f64);
    solid
        .for_each_leaf(|leaf| {
            for (n, &v) in leaf.values.iter().enumerate() {
                if leaf.is_active(n) {
                    let p = solid.transform().world(leaf.voxel(n)).0;
                    let Some(exact) = exact(p) else { continue };
                    let e = (f64::from(v) - exact).abs() / 0.25;
                    sum += e * e;
                    count += 1.0;
                    most = most.max(e);
                }
            }
        })
        .unwrap();
    ((sum / count).sqrt(), most)
}

/// A signed distance in closed form.
type Distance = Box<dyn Fn(Vec3) -> f64>;

const BALL: &str = "[[op]]\nunion = { sphere = { radius = 5 } }\n";

#[test]
fn offsets_of_fields_are_those_of_closed_forms() {
    let half_ball = format!(
        "{BALL}[[op]]\nintersect = {{ plane = {{ point = [0.1, 0, 0], normal = [1, 0, 0] }} }}\n"
    );
    let ball = |grown: f64| move |p: Vec3| p.norm() - 5.0 - grown;
    // Beyond the rim of the half ball the distance is that to the rim.
    let half = |grown: f64| {
        move |p: Vec3| {
            let (x, across) = (p.x - 0.1, p.yz().norm());
            let rim = (25.0f64 - 0.01).sqrt();
            let edge = x > 0.0 && across > rim && p.x > 0.1 * across / rim;
            let plain = (p.norm() - 5.0).max(x);
            (if edge { x.hypot(across - rim) } else { plain }) - grown
        }
    };
    // Shrunk, it is the half of a smaller ball.
    let smaller = |p: Vec3| {
        let (x, across) = (p.x + 0.4, p.yz().norm());
        let rim = (4.5f64 * 4.5 - 0.16).sqrt();
        // The rim's normals lie between those of the plane and of the ball.
        if across > rim && p.x > -0.4 * across / rim {
            x.hypot(across - rim)
        } else {
            (p.norm() - 4.5).max(x)
        }
    };
    let wall = |p: Vec3| (p.norm() - 4.75).abs() - 0.25;
    let cases: [(String, Distance); 6] = [
        (format!("{BALL}[[op]]\ndilate = 0.5\n"), Box::new(ball(0.5))),
        (
            format!("{BALL}[[op]]\nerode = \"3vx\"\n"),
            Box::new(ball(-0.75)),
        ),
        (
            format!("{BALL}[[op]]\ndilate = 0.5\n[[op]]\ndilate = 0.25\n"),
            Box::new(ball(0.75)),
        ),
        (
            format!("{half_ball}[[op]]\ndilate = 0.5\n"),
            Box::new(half(0.5)),
        ),
        (
            format!("{half_ball}[[op]]\nerode = 0.5\n"),
            Box::new(smaller),
        ),
        (format!("{BALL}[[op]]\nhollow = 0.5\n"), Box::new(wall)),
    ];
    for (ops, exact) in cases {
        let (report, solid) = made(&ops, RunOptions::default());
        assert!(
            report.offsets.iter().all(|o| o.re_evaluated),
            "{ops} {:?}",
            report.offsets
        );
        assert_eq!(
            report.offsets.len(),
            ops.matches("late").count().max(1),
            "{ops}"
        );
        let (rms, most) = errors(&solid, exact);
        assert!(rms < 0.05 && most < 0.5, "{ops}: {rms} {most} voxels");
    }
}

#[test]
fn surfaces_that_meet_have_their_distance_rebuilt() {
    // Two plates, 2 voxels between them, and grown by 2; a plate of 2 voxels shrunk by as much.
    let plate = |z: f64, thick: f64| {
        format!("[[op]]\nunion = {{ box = {{ size = [8, 8, {thick}], centre = [0, 0, {z}] }} }}\n")
    };
    let two = format!("{}{}", plate(1.3, 2.0), plate(-1.2, 2.0));
    let (report, solid) = made(
        &format!("{two}[[op]]\ndilate = 0.5\n"),
        RunOptions::default(),
    );
    assert!(!report.offsets[0].re_evaluated && report.offsets[0].why.contains("gaps"));
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    assert_eq!(solid.components(session).unwrap().len(), 1);
    // The other way: an erosion after a dilation leaves closed what that has closed.
    let back = "[[op]]\ndilate = 0.5\n[[op]]\nerode = 0.5\n";
    let (_, closed) = made(&format!("{two}{back}"), RunOptions::default());
    let whole = 8.0 * 8.0 * 4.5;
    let volume = closed.volume(session).unwrap();
    assert!((volume / whole - 1.0).abs() < 0.05, "{volume}");
    // In one direction moves add up, and what goes back is done on the level set.
    let (report, solid) = made(&format!("{BALL}{back}"), RunOptions::default());
    let ways: Vec<OffsetMethod> = report.offsets.iter().map(|o| o.method).collect();
    assert_eq!(ways, [OffsetMethod::Field, OffsetMethod::Points]);
    let (rms, _) = errors(&solid, |p| p.norm() - 5.0);
    assert!(rms < 0.1, "{rms}");
}

/// A lattice: its cell, scaffold, and size in voxels of 0.25; a ball that it is cut out of.
struct Lattice {
    cell: &'static str,
    scaffold: &'static str,
    ball: ([f64; 3], f64),
}

impl Lattice {
    fn recipe(&self) -> String {
        let ([x, y, z], r) = self.ball;
        format!(
            "[cell.c]\n{}\n[scaffold]\n{}\nboundary = \"extend\"\n[tiling]\ncell = \"c\"\n[[op]]\nintersect = {{ sphere = {{ centre = [{x}, {y}, {z}], radius = {r} }} }}\n",
            self.cell, self.scaffold
        )
    }

    /// The surface by voxels of half the size.
    fn surface(&self) -> MeshSolid {
        let place = tempfile::tempdir().unwrap();
        let text = format!(
            "druse = 1\n[band]\nvoxel_size = {}\n{}[[output]]\nmesh = \"m.stl\"\n",
            0.25 / 2.0,
            self.recipe()
        );
        let options = RunOptions {
            out: Some(place.path().to_owned()),
            brief: true,
            ..RunOptions::default()
        };
        run(&recipe(&text), &options, &Silent).unwrap();
        MeshSolid::new(
            druse::io::read_mesh(place.path().join("m.stl"))
                .unwrap()
                .mesh,
        )
    }
}

const GYROID: &str = "surface = \"gyroid\"";
const DIAMOND: &str = "surface = \"diamond\"\nvolume_fraction = 0.4";
const STRUTS: &str = "graph = \"bcc\"\nradius = 0.16\nband_limit = 7";
const BOX: &str = "box = { size = [10, 10, 10], cell_size = 10 }";
const TETS: &str = "box = { size = [10, 10, 10], cell_size = 10, kind = \"tet\" }";
const TUBE: &str = "cylinder = { radius = 16, inner_radius = 4, height = 12, cell_size = 12 }";

#[test]
fn lattices_move_by_the_requested_distance() {
    let in_box = ([5.0, 5.0, 5.0], 4.75);
    let in_tube = ([0.0, 10.0, 6.0], 4.75);
    let lattices = [
        (GYROID, BOX),
        (STRUTS, BOX),
        (DIAMOND, TETS),
        (STRUTS, TETS),
        (GYROID, TUBE),
        (STRUTS, TUBE),
    ];
    let mut taken = Vec::new();
    for (n, (cell, scaffold)) in lattices.into_iter().enumerate() {
        let ball = if scaffold == TUBE { in_tube } else { in_box };
        let lattice = Lattice {
            cell,
            scaffold,
            ball,
        };
        let surface = lattice.surface();
        let moves = [("erode", -0.5), ("dilate", 0.75)];
        // The long series tries both of every lattice.
        let is_full = crate::is_full();
        if !is_full && n % 3 == 2 {
            continue;
        }
        let tried = if is_full {
            &moves[..]
        } else {
            &moves[n % 2..][..1]
        };
        for &(op, grown) in tried {
            let ops = format!("{}[[op]]\n{op} = {}\n", lattice.recipe(), f64::abs(grown));
            let (report, found) = made(&ops, RunOptions::default());
            let w = found.background();
            // Near the ball's own surface the solid has edges.
            let (centre, radius) = (Vec3::from(ball.0), ball.1);
            let far = radius - grown.abs() - w - 0.25;
            let exact = |p: Vec3| {
                let is_inside = (p - centre).norm() < far;
                is_inside.then(|| (surface.signed_distance(p) - grown).clamp(-w, w))
            };
            let (rms, _) = errors_where(&found, exact);
            assert!(rms < 0.05, "{cell} {scaffold} {op}: {rms} voxels");
            taken.push(report.offsets[0].method);
            if n != 1 || grown < 0.0 {
                continue;
            }
            // The same in bricks.
            let bricks = RunOptions {
                bricks: Some(1),
                ..RunOptions::default()
            };
            let (parts, _) = made(&ops, bricks);
            assert_eq!(parts.offsets, report.offsets);
            assert_eq!(
                parts.outputs[0].content_hash,
                report.outputs[0].content_hash
            );
        }
    }
    // Both ways are tried.
    assert!(taken.contains(&OffsetMethod::Field) && taken.contains(&OffsetMethod::Points));
}
