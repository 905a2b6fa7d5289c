//! Grids of other programs: turned, mirrored, stretched and sheared ones on cubes, inside-out and torn ones by name.
//!
//! `tests/clients/foreign_grids.py --fixtures` made the files: a ball of radius 0.8 on voxels of 0.1 around the origin
//! or, where the transform is no plain one, around its voxel 32, 32, 32; and a box of half sizes 0.95, 0.75, 0.55.

use druse::frame::{Aabb, Mat3, Vec3};
use druse::progress::{Silent, Threads};
use druse::vdb::{Adopted, Cubes, FileError, GridReading, LevelSet, Session, Volume};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

static THREADS: LazyLock<Threads> = LazyLock::new(|| Threads::new(2).unwrap());

fn session() -> Session<'static> {
    Session::new(&THREADS, &Silent)
}

fn file(name: &str) -> PathBuf {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/grids");
    directory.join(format!("{name}.vdb"))
}

fn read(name: &str, how: &GridReading) -> Result<Adopted, FileError> {
    let path = file(name);
    Volume::read(&path, None)?.solid(&path, how, session())
}

/// The error of a grid, with its hint.
fn refused(name: &str, how: &GridReading) -> String {
    let error = read(name, how).err().unwrap();
    format!("{error}; {}", error.hint().unwrap_or_default())
}

const PLAIN: GridReading = GridReading {
    value: None,
    invert: false,
    cubes: Cubes::Refuse,
    half_width: 3.0,
    allow_torn: false,
};

/// The solid's volume and its mesh's, whose facets lie within the ball, its middle, and that all of it is sound.
fn is_right(solid: &LevelSet, volume: f64, centre: Vec3, what: &str) {
    let mesh = solid.to_mesh(session()).unwrap();
    let (own, faceted) = (solid.volume(session()).unwrap(), mesh.volume());
    assert!(
        (own / volume - 1.0).abs() < 0.015,
        "{what}: {own} for {volume}"
    );
    assert!(
        (faceted / volume - 1.0).abs() < 0.03,
        "{what}: {faceted} for {volume}"
    );
    let middle = mesh.bounds().centre().0;
    assert!(
        (middle - centre).amax() < 0.005,
        "{what}: {middle} for {centre}"
    );
    let check = solid.check(session()).unwrap();
    assert!(check.passed(), "{what}: {:?}", check.problems());
}

/// Root mean square of the distances' slopes less one.
fn slope_error(solid: &LevelSet) -> f64 {
    solid.check(session()).unwrap().gradient.rms
}

const BALL: f64 = 4.0 / 3.0 * PI * 0.512;
const BOX: f64 = 8.0 * 0.95 * 0.75 * 0.55;

/// The rotation of the files: 0.3 about x, then 0.5 about z.
fn turned() -> Mat3 {
    let (c, s) = (0.5f64.cos(), 0.5f64.sin());
    let about_z = Mat3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
    let (c, s) = (0.3f64.cos(), 0.3f64.sin());
    about_z * Mat3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

#[test]
fn grids_that_are_not_plain_stand_right_on_cubes() {
    let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
    let stretch = Mat3::from_diagonal(&Vec3::new(1.0, 0.8, 1.3));
    let shear = Mat3::new(1.0, 0.3, 0.0, 0.0, 1.0, 0.2, 0.0, 0.0, 1.0);
    let cases = [
        ("turned_ball", turned(), Vec3::new(1.0, 2.0, 3.0), BALL),
        ("mirrored_block", mirror, Vec3::new(1.0, 0.0, 0.0), BOX),
        ("stretched_ball", stretch, Vec3::zeros(), BALL),
        (
            "everything_ball",
            turned() * mirror * shear * stretch,
            Vec3::new(-1.0, 0.5, 2.0),
            BALL,
        ),
    ];
    for (name, edges, shift, volume) in cases {
        let centre = edges * Vec3::repeat(3.2) + shift;
        let error = refused(name, &PLAIN);
        assert!(
            error.contains("cubes along the axes")
                && error.contains("--resample")
                && error.contains("resample = true"),
            "{error}"
        );
        for edge in [0.1, 0.07] {
            let how = GridReading {
                cubes: Cubes::Edge(edge),
                ..PLAIN
            };
            let found = read(name, &how).unwrap();
            assert!(found.notes.is_empty(), "{:?}", found.notes);
            assert!((found.solid.voxel_size() - edge).abs() < 1e-12);
            is_right(&found.solid, volume, centre, name);
            assert!(slope_error(&found.solid) < 0.1, "{name}");
        }
    }
}

#[test]
fn a_frustum_stands_right_on_cubes() {
    let path = file("frustum_block");
    let volume = Volume::read(&path, None).unwrap();
    let info = volume.info().clone();
    assert!(info.shape().contains("of a frustum"), "{}", info.shape());
    // The frustum's middle axis is x = y = 30 voxels; the box stands at voxel 30, 30, 20.
    let map = info.index_map();
    let centre = map.world(Vec3::new(30.0, 30.0, 20.0));
    let (near, far) = (
        map.edges(Vec3::new(30.0, 30.0, 0.0)),
        map.edges(Vec3::new(30.0, 30.0, 40.0)),
    );
    assert!(far.column(0).norm() != near.column(0).norm());
    let how = GridReading {
        cubes: Cubes::Edge(0.1),
        ..PLAIN
    };
    let solid = volume.solid(&path, &how, session()).unwrap().solid;
    is_right(&solid, BOX, centre, "frustum");
}

#[test]
fn inside_out_grids_are_named_and_turned_on_request() {
    for name in ["inside_out", "inside_out_positive"] {
        let error = refused(name, &PLAIN);
        assert!(
            error.contains("inside out")
                && error.contains("--invert")
                && error.contains("invert = true"),
            "{error}"
        );
        let found = read(
            name,
            &GridReading {
                invert: true,
                ..PLAIN
            },
        )
        .unwrap();
        is_right(&found.solid, BALL, Vec3::zeros(), name);
    }
    let error = refused(
        "voxels",
        &GridReading {
            invert: true,
            ..PLAIN
        },
    );
    assert!(error.contains("leave out invert"), "{error}");
}

#[test]
fn torn_narrow_and_unsigned_grids_are_named() {
    let error = refused("torn", &PLAIN);
    assert!(
        error.contains("a torn surface") && error.contains("the first at ("),
        "{error}"
    );
    // The cube that is cut away reaches from 0.4 to 1.1 along y.
    let at: Vec<f64> = error
        .split("the first at (")
        .nth(1)
        .unwrap()
        .split(')')
        .next()
        .unwrap()
        .split(", ")
        .map(|c| c.parse().unwrap())
        .collect();
    let hole = Aabb {
        min: Vec3::new(-0.9, 0.3, -0.5),
        max: Vec3::new(0.1, 1.2, 0.5),
    };
    assert!(
        hole.contains(druse::frame::WorldPoint(Vec3::new(at[0], at[1], at[2]))),
        "{at:?}"
    );
    let error = refused("unsigned", &PLAIN);
    assert!(
        error.contains("an unsigned distance") && error.contains("--value"),
        "{error}"
    );
    let wall = read(
        "unsigned",
        &GridReading {
            value: Some(0.15),
            ..PLAIN
        },
    )
    .unwrap()
    .solid;
    let volume = wall.volume(session()).unwrap();
    let expected = 4.0 / 3.0 * PI * (0.95f64.powi(3) - 0.65f64.powi(3));
    assert!(
        (volume / expected - 1.0).abs() < 0.02,
        "{volume} for {expected}"
    );
    let error = refused("narrow", &PLAIN);
    assert!(
        error.contains("a band of 0.4 voxels") && error.contains("--value 0;"),
        "{error}"
    );
    let again = read(
        "narrow",
        &GridReading {
            value: Some(0.0),
            ..PLAIN
        },
    )
    .unwrap();
    let volume = again.solid.volume(session()).unwrap();
    assert!((volume / BALL - 1.0).abs() < 0.06, "{volume}");
    let error = refused("nan", &PLAIN);
    assert!(
        error.contains("NaN at voxel [32, 24, 24], (0.8, 0, 0), the first of 2"),
        "{error}"
    );
    let error = refused("mask", &PLAIN);
    assert!(error.contains("on or off only"), "{error}");
    let error = refused("two", &PLAIN);
    assert!(
        error.contains("left (") && error.contains("right (") && error.contains("--grid NAME"),
        "{error}"
    );
}

#[test]
fn what_leaves_the_surface_where_it_is_is_mended_with_a_note() {
    for (name, word) in [
        ("no_class", "read as a level set"),
        ("signs", "had the wrong sign"),
        ("voxels", "count voxels: multiplied by 0.1"),
        ("no_background", "its background is 0"),
    ] {
        let found = read(name, &PLAIN).unwrap();
        assert!(
            found.notes.iter().any(|n| n.contains(word)),
            "{name}: {:?}",
            found.notes
        );
        assert!(
            (found.solid.half_width() - 3.0).abs() < 0.2,
            "{name}: {}",
            found.solid.half_width()
        );
        let mut solid = found.solid;
        is_right(&solid, BALL, Vec3::zeros(), name);
        solid.dilate(0.1, session()).unwrap();
        let grown = solid.volume(session()).unwrap() / (4.0 / 3.0 * PI * 0.729);
        assert!((grown - 1.0).abs() < 0.015, "{name}: {grown}");
    }
}

#[test]
fn fogs_with_other_values_than_0_to_1_need_one() {
    let error = refused("fog255", &PLAIN);
    assert!(
        error.contains("a fog with values from 0 to 255") && error.contains("--value 127.5"),
        "{error}"
    );
    let found = read(
        "fog255",
        &GridReading {
            value: Some(127.5),
            ..PLAIN
        },
    )
    .unwrap();
    // A ramp of one voxel around the surface.
    is_right(&found.solid, BALL, Vec3::zeros(), "fog255");
    // A void stays a void.
    let found = read("hollow_fog", &PLAIN).unwrap();
    let hollow = BALL - 4.0 / 3.0 * PI * 0.064;
    let volume = found.solid.volume(session()).unwrap();
    assert!(
        (volume / hollow - 1.0).abs() < 0.02,
        "{volume} for {hollow}"
    );
    assert_eq!(found.solid.check(session()).unwrap().voids, 1);
}

fn druse(arguments: &[&str], name: &str, rest: &[&str], place: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_druse"))
        .current_dir(place)
        .args(arguments)
        .arg(file(name))
        .args(rest)
        .output()
        .unwrap()
}

/// The volume that a filter reports, m^3.
fn filtered(name: &str, rest: &[&str], place: &Path) -> f64 {
    let rest = [&["-o", "o.vdb", "--json"], rest].concat();
    let out = druse(&["filter"], name, &rest, place);
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(
        out.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    report["solid"]["volume"].as_f64().unwrap()
}

#[test]
fn commands_and_recipes_take_them_as_their_hints_say() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path();
    // The share of a ball of radius .8 that is lost. Linear interpolation of its distance in a cell of sides h_i lowers it
    // by h_i^2 / 8 times the second derivative, 2 / (3 R) in the mean of directions: sum(h_i^2) / (4 R^2) in all. The chords
    // of a mesh whose points are means of crossings lose 1.25 (h / R)^2. Both only ever shrink a ball.
    let radius: f64 = 0.8;
    let sides: [f64; 3] = [0.1, 0.083_522_454, 0.132_574_51];
    let interpolated = sides.map(|h| h * h).iter().sum::<f64>() / (4.0 * radius * radius);
    let lost = |name: &str, rest: &[&str]| 1.0 - filtered(name, rest, place) / BALL;
    let cases: [(&[&str], f64); 5] = [
        (&["resample=0.1"], 0.1),
        (&["resample=0.07"], 0.07),
        (&["--resample", "prune"], sides[1]),
        (&["--resample=0.05m", "prune"], 0.05),
        (&["--resample", "dilate=0.1", "erode=0.1"], sides[1]),
    ];
    let losses = cases.map(|(rest, h)| {
        let loss = lost("everything_ball", rest);
        let chords = 1.25 * (h / radius).powi(2);
        assert!(
            loss > 0.0 && loss < interpolated + chords,
            "{rest:?}: {loss}"
        );
        loss
    });
    // What the chords lose is of second order, so that two voxel sizes leave what the interpolation lost.
    let without_chords = (4.0 * losses[3] - losses[0]) / 3.0;
    assert!(
        without_chords > 0.0 && without_chords < interpolated,
        "{without_chords}"
    );
    let loss = lost("inside_out", &["--invert", "prune"]);
    assert!(loss > 0.0 && loss < 1.25 * (0.1 / radius).powi(2), "{loss}");
    let stderr = |out: Output| String::from_utf8(out.stderr).unwrap();
    let error = stderr(druse(&["mesh"], "turned_ball", &["-o", "o.stl"], place));
    assert!(
        error.contains("hint: --resample") && !place.join("o.stl").exists(),
        "{error}"
    );
    // A recipe in millimetres: cubes of 50 mm, which are its voxels.
    let recipe = |more: &str| {
        let path = file("turned_ball");
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 50\n[[op]]\nunion = {{ vdb = {{ path = \"{}\"{more} }} }}\n",
            path.display()
        );
        let recipe = druse::recipe::Recipe::parse(&text, &[]).unwrap();
        druse::pipeline::run(&recipe, &druse::pipeline::RunOptions::default(), &Silent)
    };
    for more in [
        ", resample = true",
        ", resample = 80",
        ", resample = \"0.1m\"",
    ] {
        let report = recipe(more).unwrap();
        let volume = report.solid.volume / 1e9;
        assert!((volume / BALL - 1.0).abs() < 0.015, "{more}: {volume}");
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    }
    assert!(recipe("").is_err() && recipe(", resample = false").is_err());
    // Checks and descriptions name what is wrong and go on.
    let output_of = |command: &str, name: &str| {
        let out = druse(&[command], name, &[], place);
        (out.status.code(), String::from_utf8(out.stdout).unwrap())
    };
    for (name, word) in [
        ("turned_ball", "turned, which are not cubes"),
        ("inside_out", "inside out"),
        ("torn", "the first torn pair is at"),
        ("unsigned", "an unsigned distance"),
        ("narrow", "a band of 0.4 voxels"),
    ] {
        let (code, text) = output_of("check", name);
        assert!(
            code == Some(1) && text.contains(word) && text.contains("NOT sound"),
            "{text}"
        );
    }
    let (code, text) = output_of("check", "voxels");
    assert!(code == Some(0) && text.contains("count voxels"), "{text}");
    for (name, word) in [
        ("turned_ball", "voxels of 0.1, turned"),
        ("inside_out", "inside out"),
        ("fog255", "active values 3.75"),
        ("fog255", "0 to 255"),
        ("nan", "NaN at voxel"),
        ("frustum_block", "of a frustum"),
    ] {
        let (code, text) = output_of("info", name);
        assert!(code == Some(0) && text.contains(word), "{name}: {text}");
    }
}
