//! `drain`: the shortest channels by closed forms, parts without closed cavities, bricks, and bad input.

use super::recipe;
use druse::frame::Coord;
use druse::pipeline::{DrainReport, Report, RunOptions, run};
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// A box of 20 x 20 x 20 with a ball of radius 3 nearer to its upper face, and a small one beside it.
const PART: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.25\n\
    [[op]]\nunion = { box = { size = [20, 20, 20] } }\n\
    [[op]]\nsubtract = { sphere = { radius = 3, centre = [0, 0, 2] } }\n";

fn made(text: &str, bricks: Option<u32>) -> Report {
    let place = tempfile::tempdir().unwrap();
    let options = RunOptions {
        bricks,
        out: Some(place.path().to_owned()),
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

fn drained(extra: &str) -> (Vec<DrainReport>, Report) {
    let report = made(
        &format!("{PART}{extra}[require]\nclosed_cavities = 0\n"),
        None,
    );
    assert_eq!(report.solid.closed_cavities, Some(0), "{extra}");
    (report.solid.drains.clone(), report)
}

#[test]
fn the_channel_is_the_shortest_or_the_preferred_one() {
    // From the ball's top at z = 5 to the face at z = 10; ends lie at voxels on both sides of the walls.
    let (up, before) = drained("[[op]]\ndrain = 0.5\n");
    let [channel] = up[..] else { panic!("{up:?}") };
    assert!((channel.length - 5.0).abs() <= 0.5, "{channel:?}");
    assert!(
        channel.from[2] > 4.5 && channel.to[2] >= 10.0,
        "{channel:?}"
    );
    // Of the bore of radius 0.5 about pi / 4 * 5 mm^3 is gone.
    let (_, whole) = (0, made(PART, None));
    let bore = std::f64::consts::PI * 0.25 * 5.0;
    let removed = whole.solid.volume - before.solid.volume;
    assert!((removed / bore - 1.0).abs() < 0.15, "{removed} {bore}");
    // Down, 9 mm of solid cost less than 5 mm up, which count three times.
    let (down, _) = drained("[[op]]\ndrain = { radius = 0.5, toward = [0, 0, -2] }\n");
    let [channel] = down[..] else {
        panic!("{down:?}")
    };
    assert!((channel.length - 9.0).abs() <= 0.5, "{channel:?}");
    assert!(channel.to[2] <= -10.0, "{channel:?}");
    // The second cavity drains into the first, 1 mm away, instead of through 3 mm to the side.
    let second = "[[op]]\nsubtract = { sphere = { radius = 1.5, centre = [5.5, 0, 2] } }\n";
    let (both, _) = drained(&format!(
        "{second}[[op]]\ndrain = {{ radius = 0.5, at_most = 2 }}\n"
    ));
    let mut lengths: Vec<f64> = both.iter().map(|c| c.length).collect();
    lengths.sort_by(f64::total_cmp);
    assert!(
        (lengths[0] - 1.0).abs() <= 0.5 && (lengths[1] - 3.0).abs() <= 0.5,
        "{both:?}"
    );
}

#[test]
fn a_narrow_way_out_is_widened_only_on_request() {
    // The ball of radius 3 has a bore of radius 0.5 through the thick side.
    let bore =
        "[[op]]\nsubtract = { cylinder = { from = [0, 0, 2], to = [0, 0, -11], radius = 0.5 } }\n";
    let check = "[require]\nescape_radius = 1.2\n";
    let escape = |op: &str| {
        let report = made(&format!("{PART}{bore}{op}{check}"), None);
        (
            report.solid.drains.len(),
            report.solid.cavities.unwrap().escape_radius,
        )
    };
    let (none, narrow) = escape("[[op]]\ndrain = 1.5\n");
    assert!(
        none == 0 && (narrow.unwrap() - 0.5).abs() < 0.25,
        "{narrow:?}"
    );
    let (one, wide) = escape("[[op]]\ndrain = { radius = 1.5, cavities = \"all\" }\n");
    assert!(one == 1 && wide.unwrap() > 1.2, "{wide:?}");
}

/// Whether each voxel of a cube of `count` voxels along an edge, its middle at the origin, is solid; from a file.
fn dense(path: &Path, count: usize) -> Vec<bool> {
    let threads = Threads::new(1).unwrap();
    let solid = LevelSet::read(path, None, Session::new(&threads, &Silent)).unwrap();
    let half = count as i32 / 2;
    let voxels: Vec<Coord> = (0..count.pow(3))
        .map(|n| Coord([n / count / count, n / count % count, n % count].map(|c| c as i32 - half)))
        .collect();
    solid
        .values(&voxels)
        .unwrap()
        .iter()
        .map(|v| *v < 0.0)
        .collect()
}

/// Squared distance of each voxel from the nearest solid voxel, axis by axis.
fn squares(solid: &[bool], count: usize) -> Vec<f64> {
    let mut found: Vec<f64> = solid.iter().map(|s| if *s { 0.0 } else { 1e9 }).collect();
    for stride in [1, count, count * count] {
        let before = found.clone();
        for (n, value) in found.iter_mut().enumerate() {
            let at = n / stride % count;
            let line = (0..count).map(|k| {
                let step = k as f64 - at as f64;
                before[n + k * stride - at * stride] + step * step
            });
            *value = line.fold(1e9, f64::min);
        }
    }
    found
}

/// The voxels that a ball of a radius (voxels) reaches from the first voxel, which is outside.
fn reached(squares: &[f64], count: usize, radius: f64) -> Vec<bool> {
    let mut seen = vec![false; squares.len()];
    let mut stack = vec![0];
    while let Some(n) = stack.pop() {
        if seen[n] || squares[n].sqrt() < radius {
            continue;
        }
        seen[n] = true;
        for stride in [1, count, count * count] {
            let at = n / stride % count;
            stack.extend((at > 0).then(|| n - stride));
            stack.extend((at + 1 < count).then(|| n + stride));
        }
    }
    seen
}

#[test]
fn a_ball_of_the_radius_gets_out_of_cavities_of_any_shape() {
    const COUNT: usize = 72;
    // In a box of 12 x 12 x 12: cavities, the radius of the ball that gets out, and where it stands.
    let cube = |centre: &str| format!("box = {{ size = [3, 3, 3], centre = {centre} }}");
    let with = |list: &[String]| {
        let one = |c: &String| format!("[[op]]\nsubtract = {{ {c} }}\n");
        list.iter().map(one).collect::<String>()
    };
    let slot = |size: &str| with(&[format!("box = {{ size = {size}, centre = [0.4, 0.2, 2] }}")]);
    let cases: Vec<(String, &str, f64, Vec<[f64; 3]>)> = vec![
        (
            with(&[cube("[-3, 0.5, 0.5]")]),
            "",
            1.0,
            vec![[-3.0, 0.5, 0.5]],
        ),
        (
            with(&[cube("[3.5, 3.5, 3.5]")]),
            "",
            1.0,
            vec![[3.5, 3.5, 3.5]],
        ),
        (
            with(&[cube("[-3, 0.5, 0.5]")]),
            ", toward = [1, 0.3, -0.2]",
            1.0,
            vec![[-3.0, 0.5, 0.5]],
        ),
        (
            with(&[cube("[-1.75, 0, 0]"), cube("[1.75, 0.5, 0]")]),
            "",
            1.0,
            vec![[-1.75, 0.0, 0.0], [1.75, 0.5, 0.0]],
        ),
        // Two rooms with a way between them that is too narrow.
        (
            with(&[
                cube("[-2.5, 0, 0]"),
                cube("[2.5, 0, 0]"),
                "box = { size = [5, 0.8, 0.8] }".into(),
            ]),
            "",
            1.0,
            vec![[-2.5, 0.0, 0.0], [2.5, 0.0, 0.0]],
        ),
        // Slots that are thinner than the channel: their own ball gets out.
        (
            slot("[6, 6, 1.5]"),
            "",
            0.75,
            vec![[0.4, 0.2, 2.0], [2.0, -1.5, 2.0]],
        ),
        (
            slot("[1.5, 6, 6]"),
            "",
            0.75,
            vec![[0.4, 0.2, 2.0], [0.4, 2.0, 3.5]],
        ),
        (
            slot("[5, 1.25, 1.25]"),
            "",
            0.6,
            vec![[0.4, 0.2, 2.0], [-1.0, 0.2, 2.0]],
        ),
        // A cross of three bars.
        (
            with(
                &["[7, 2.5, 2.5]", "[2.5, 7, 2.5]", "[2.5, 2.5, 7]"]
                    .map(|s| format!("box = {{ size = {s} }}")),
            ),
            "",
            1.0,
            vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -2.0, 0.0]],
        ),
        // A ball behind one that is smaller than the channel.
        (
            with(&[
                "sphere = { radius = 0.8, centre = [3.5, 0, 0] }".into(),
                "sphere = { radius = 1.6, centre = [0, 0, 0] }".into(),
            ]),
            "",
            0.8,
            vec![[3.5, 0.0, 0.0], [0.0, 0.0, 0.0]],
        ),
    ];
    for (n, (cavities, options, ball, places)) in cases.into_iter().enumerate() {
        // The short series changes between the two.
        let kinds = match n % 2 {
            _ if crate::is_full() => &["closed", "all"][..],
            0 => &["closed"],
            _ => &["all"],
        };
        for which in kinds {
            let text = format!(
                "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = {{ box = {{ size = [12, 12, 12] }} }}\n\
                 {cavities}[[op]]\ndrain = {{ radius = 1, cavities = \"{which}\"{options} }}\n\
                 [[output]]\nvdb = \"a.vdb\"\n"
            );
            let directory = tempfile::tempdir().unwrap();
            let options = RunOptions {
                out: Some(directory.path().to_owned()),
                ..RunOptions::default()
            };
            let report = run(&recipe(&text), &options, &Silent).unwrap();
            let squares = squares(&dense(&directory.path().join("a.vdb"), COUNT), COUNT);
            // Voxels may lie beside the axis of a channel.
            let seen = reached(&squares, COUNT, ball / 0.2 - 1.0);
            for place in &places {
                let voxel = place.map(|c| ((c / 0.2).round() + COUNT as f64 / 2.0) as usize);
                let n = (voxel[0] * COUNT + voxel[1]) * COUNT + voxel[2];
                assert!(seen[n], "{place:?} of {text}: {:?}", report.solid.drains);
            }
        }
    }
}

/// Numbers that look random (splitmix64), from 0 to 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
}

#[test]
fn drained_parts_have_no_closed_cavity_in_memory_and_in_bricks() {
    let count = if crate::is_full() { 60 } else { 4 };
    let mut drilled = 0;
    for seed in 0..count {
        let mut state = seed;
        let mut text = String::from(
            "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { box = { size = [40, 18, 18] } }\n",
        );
        for _ in 0..9 {
            let mut within = |a: f64| (2.0 * random(&mut state) - 1.0) * a;
            let [x, y, z, r] = [within(18.0), within(7.5), within(7.5), 2.4 + within(1.4)];
            let _ = writeln!(
                text,
                "[[op]]\nsubtract = {{ sphere = {{ radius = {r}, centre = [{x}, {y}, {z}] }} }}"
            );
        }
        let toward = ["", ", toward = [0, 0, -1]", ", toward = [1, 2, 0.5]"][seed as usize % 3];
        let which = ["closed", "all"][seed as usize % 2];
        let _ = write!(
            text,
            "[[op]]\ndrain = {{ radius = 0.75, cavities = \"{which}\"{toward} }}\n\
             [require]\nclosed_cavities = 0\nescape_radius = 0.75\n"
        );
        let one = made(&text, None);
        assert_eq!(one.solid.closed_cavities, Some(0), "{seed}");
        if which == "all" {
            let cavities = one.solid.cavities.clone().unwrap();
            // Cavities in which a ball of the radius fits let it out, within the sampling of distances.
            let is_left = |c: &druse::pipeline::CavityReport| {
                c.radius >= 0.75 && c.escape_radius < 0.75 - 0.5
            };
            assert!(!cavities.list.iter().any(is_left), "{seed}: {cavities:?}");
        }
        let two = made(&text, Some(1));
        assert_eq!(one.solid.drains, two.solid.drains, "{seed}");
        drilled += one.solid.drains.len();
    }
    assert!(drilled > 0);
}

#[test]
#[ignore = "long; tests/run full"]
fn channels_through_bricks_without_surface_make_the_same_file() {
    // The channel crosses blocks of voxels that lie wholly inside the solid. Down it is 338 long, level 188; aslant, to
    // the nearest face, the sum of both costs is least.
    let text = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 1\n\
        [[op]]\nunion = { box = { size = [400, 400, 660] } }\n\
        [[op]]\nsubtract = { sphere = { radius = 12, centre = [0, 0, 20] } }\n\
        [[op]]\ndrain = { radius = 3, toward = [0, 0, -1] }\n[[op]]\ndilate = 0.5\n\
        [[output]]\nvdb = \"a.vdb\"\n";
    let directory = tempfile::tempdir().unwrap();
    let make = |bricks: Option<u32>| {
        let options = RunOptions {
            bricks,
            brief: true,
            out: Some(directory.path().to_owned()),
            ..RunOptions::default()
        };
        let report = run(&Recipe::parse(text, &[]).unwrap(), &options, &Silent).unwrap();
        (report.outputs[0].content_hash.clone(), report.solid.drains)
    };
    let one = make(None);
    let [channel] = &one.1[..] else {
        panic!("{one:?}")
    };
    assert!((188.0..250.0).contains(&channel.length), "{one:?}");
    assert!(channel.to[2] < channel.from[2] - 50.0, "{one:?}");
    assert_eq!(one, make(Some(1)));
}

fn druse(directory: &Path, arguments: &str) -> (Option<i32>, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(arguments.split(' '))
        .current_dir(directory)
        .output()
        .unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code(), text(&out.stdout), text(&out.stderr))
}

#[test]
fn files_are_drained_and_bad_drains_are_refused() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(
        place.path().join("r.toml"),
        format!("{PART}[[output]]\nvdb = \"a.vdb\"\n"),
    )
    .unwrap();
    assert_eq!(druse(place.path(), "run r.toml").0, Some(0));
    let line = "filter a.vdb -o b.vdb drain={radius=\"0.5mm\",toward=[0,0,-1]} --json";
    let (code, json, error) = druse(place.path(), line);
    assert_eq!(code, Some(0), "{error}");
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(report["solid"]["drains"].as_array().map(Vec::len), Some(1));
    let (_, text, _) = druse(place.path(), "check b.vdb --cavities");
    assert!(!text.contains("closed\n"), "{text}");
    for (op, words) in [
        ("drain=0", "positive"),
        ("drain=-1mm", "positive"),
        ("drain=0.1mm", "0.4 voxels"),
        ("drain=40mm", "160 voxels"),
        ("drain={radius=\"1mm\",toward=[0,0,0]}", "length 0"),
        ("drain={radius=\"1mm\",at_most=0}", "at least 1"),
        ("drain={radius=\"1mm\",cavities=\"some\"}", "closed"),
    ] {
        let (code, _, error) = druse(place.path(), &format!("filter a.vdb -o none.vdb {op}"));
        assert!(code >= Some(2) && error.contains(words), "{op}: {error}");
        assert!(!place.path().join("none.vdb").exists(), "{op}");
    }
    // Two cavities and one channel.
    let two = format!(
        "{PART}[[op]]\nsubtract = {{ sphere = {{ radius = 1, centre = [-6, -6, -6] }} }}\n\
         [[op]]\ndrain = {{ radius = 0.5, at_most = 1 }}\n"
    );
    let failed = run(&recipe(&two), &RunOptions::default(), &Silent).unwrap_err();
    let message = failed.to_string();
    assert!(
        message.contains("they need 2 channels") && message.contains("op.3.drain"),
        "{message}"
    );
}
