//! Decks of scaffolds with homogenised cells, results of `CalculiX`, and gradings by them.

use druse::io::{read_frd, read_scaffold};
use druse::pipeline::{
    GradeOptions, GradeReport, MacroDeckFacts, Report, RunError, RunOptions, grade, plan, run,
};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fmt::Write;
use std::path::Path;

const BAR: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n[cell.p]\nsurface = \"schwarz_p\"\n\
                   [scaffold]\nbox = { size = [8, 2, 2], cell_size = 2 }\n";

fn options(out: &Path, threads: usize) -> RunOptions {
    RunOptions {
        out: Some(out.to_owned()),
        brief: true,
        threads,
        ..RunOptions::default()
    }
}

fn made(text: &str, out: &Path) -> Result<Report, RunError> {
    run(&Recipe::parse(text, &[])?, &options(out, 2), &Silent)
}

fn facts(report: &Report) -> &MacroDeckFacts {
    report.outputs[0].macro_deck.as_ref().unwrap()
}

#[test]
fn a_graded_bar_has_a_material_for_each_fraction_and_its_mass() {
    let text = format!(
        "{BAR}[tiling]\ncell = \"p\"\nvolume_fraction = \"0.25 + 0.5*bx\"\n\
         [[output]]\nfe = \"a.inp\"\nresolution = 16\nyoung = 2100\ndensity = 2\nunit = \"cm\"\n"
    );
    let place = tempfile::tempdir().unwrap();
    let report = made(&text, place.path()).unwrap();
    let found = facts(&report);
    assert_eq!((found.elements, found.nodes), (4, 20));
    assert!((found.volume - 32e-3).abs() < 1e-12);
    // Fractions at the centres: 0.3125, 0.4375, 0.5625, 0.6875.
    assert!((found.solid_volume / 16e-3 - 1.0).abs() < 2e-3, "{found:?}");
    assert!((found.mass.unwrap() - 2.0 * found.solid_volume).abs() < 1e-12);
    let law = &found.laws[0];
    assert_eq!(
        (law.materials, law.points, law.quantity),
        (4, 9, "volume_fraction")
    );
    assert!((found.stretch - 1.0).abs() < 1e-9 && found.notes.is_empty());
    assert_eq!(report.band.active_voxels, 0);
    let deck = std::fs::read_to_string(place.path().join("a.inp")).unwrap();
    for words in [
        "*ELEMENT, TYPE=C3D8I",
        "*NSET, NSET=XMAX",
        "*SURFACE, NAME=ZMIN_FACE, TYPE=ELEMENT",
        "*ELSET, ELSET=P_HEX_4",
        "*ELASTIC, TYPE=ANISO",
        "ORIENTATION=FRAMES",
    ] {
        assert!(deck.contains(words), "{words}");
    }
    // Our own reader finds the scaffold again.
    let again = read_scaffold(place.path().join("a.inp")).unwrap();
    assert_eq!(again.scaffold.len(), 4);
    assert!((again.scaffold.bounds().size().x - 0.8).abs() < 1e-9);
}

#[test]
#[ignore = "long; tests/run full"]
fn threads_and_bricks_give_the_same_deck() {
    let deck = "[[output]]\nfe = \"a.inp\"\nresolution = 8\n";
    let text = format!("{BAR}[tiling]\ncell = \"p\"\nvolume_fraction = \"0.3 + 0.2*bx\"\n{deck}");
    let bytes = |threads: usize, bricks: Option<u32>, extra: &str| {
        let place = tempfile::tempdir().unwrap();
        let recipe = Recipe::parse(&(text.clone() + extra), &[]).unwrap();
        let options = RunOptions {
            bricks,
            ..options(place.path(), threads)
        };
        run(&recipe, &options, &Silent).unwrap();
        std::fs::read(place.path().join("a.inp")).unwrap()
    };
    let one = bytes(1, None, "");
    assert!(one == bytes(2, None, ""), "two threads give another deck");
    let with_part = "[[output]]\nvdb = \"a.vdb\"\n";
    assert!(
        one == bytes(2, Some(1), with_part),
        "bricks give another deck"
    );
}

#[test]
fn quadratic_and_mirrored_elements_keep_their_volume() {
    // One brick, numbered in mirror order, as Tet10 and Hex20 are in files.
    let mut text = String::from("*NODE\n");
    for n in 0..8 {
        let p = [n & 1, n >> 1 & 1, n >> 2];
        writeln!(text, "{}, {}, {}, {}", n + 1, p[0], p[1], p[2]).unwrap();
    }
    text += "*ELEMENT, TYPE=C3D8, ELSET=LEFT-HALF\n7, 1, 3, 4, 2, 5, 7, 8, 6\n";
    let place = tempfile::tempdir().unwrap();
    let mesh = place.path().join("m.inp");
    std::fs::write(&mesh, text).unwrap();
    let recipe = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = 9\n\
         [scaffold]\nfile = \"{}\"\n[tiling]\ncell = \"p\"\n\
         [[output]]\nfe = \"a.inp\"\nresolution = 8\n",
        mesh.display()
    );
    let report = made(&recipe, place.path()).unwrap();
    assert!((facts(&report).solid_volume - 1.0).abs() < 1e-9);
    let deck = std::fs::read_to_string(place.path().join("a.inp")).unwrap();
    assert!(deck.contains("*ELSET, ELSET=LEFT_HALF\n1,"), "{deck}");
    assert!(deck.contains("NSET=LEFT_HALF_NODES"));
    let line = deck
        .lines()
        .skip_while(|l| !l.starts_with("*ELEMENT"))
        .nth(1)
        .unwrap();
    let nodes: Vec<usize> = line
        .split(',')
        .skip(1)
        .map(|w| w.trim().parse().unwrap())
        .collect();
    let points: Vec<[f64; 3]> = deck
        .lines()
        .skip_while(|l| !l.starts_with("*NODE"))
        .skip(1)
        .take(8)
        .map(|l| {
            let words: Vec<f64> = l
                .split(',')
                .skip(1)
                .map(|w| w.trim().parse().unwrap())
                .collect();
            [words[0], words[1], words[2]]
        })
        .collect();
    let edge = |n: usize| -> [f64; 3] {
        std::array::from_fn(|a| points[nodes[n] - 1][a] - points[nodes[0] - 1][a])
    };
    let ([a, b, c], [d, e, f], [g, h, i]) = (edge(1), edge(3), edge(4));
    let volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    assert!((volume - 1.0).abs() < 1e-9, "{line}: {volume}");
}

/// Groups with the names of the deck's own sets get others.
#[test]
fn no_set_of_a_deck_is_written_twice() {
    let place = tempfile::tempdir().unwrap();
    let nodes = "1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n";
    let elements =
        "*ELEMENT, TYPE=C3D8, ELSET=ALL\n1,1,2,3,4,5,6,7,8\n*ELSET, ELSET=ALL_ELEMENTS\n1\n";
    let file = place.path().join("a.inp");
    std::fs::write(&file, format!("*NODE\n{nodes}{elements}")).unwrap();
    let text = format!(
        "druse = 1\n[band]\nvoxel_size = 0.1\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = {file:?}\n\
         [tiling]\ncell = \"p\"\n[[output]]\nfe = \"d.inp\"\nresolution = 8\n"
    );
    made(&text, place.path()).unwrap();
    let deck = std::fs::read_to_string(place.path().join("d.inp")).unwrap();
    let words = deck
        .lines()
        .filter(|l| l.starts_with('*'))
        .flat_map(|l| l.split(", "));
    let mut sets: Vec<&str> = words
        .filter(|w| w.starts_with("ELSET=") || w.starts_with("NSET="))
        .collect();
    // The section names its set again.
    assert_eq!(sets.pop(), Some("ELSET=P_HEX_1"));
    let count = sets.len();
    sets.sort_unstable();
    sets.dedup();
    assert_eq!(sets.len(), count, "{sets:?}");
    assert!(
        sets.contains(&"ELSET=ALL_2") && sets.contains(&"ELSET=ALL_ELEMENTS_2"),
        "{sets:?}"
    );
}

#[test]
fn what_has_no_homogenised_cell_is_refused() {
    let fe = "[[output]]\nfe = \"a.inp\"\n";
    let tiling = "[tiling]\ncell = \"p\"\nvolume_fraction = 0.3\n";
    let wedges = BAR.replace("cell_size = 2 }", "cell_size = 2, kind = \"wedge\" }");
    let place = tempfile::tempdir().unwrap();
    for (text, words) in [
        (
            format!("{BAR}{tiling}{fe}resolution = 9\n"),
            "even number from 8 to 256",
        ),
        (
            format!("{BAR}{tiling}{fe}element_size = 1\n"),
            "expected kind = \"hex8\"",
        ),
        (
            format!("{BAR}{tiling}{fe}kind = \"hex8\"\nresolution = 8\n"),
            "without kind",
        ),
        (
            format!(
                "{}{tiling}{fe}",
                wedges.replace(
                    "surface = \"schwarz_p\"",
                    "formula = \"hypot(x, y) - 0.2\"\nelement = \"wedge\""
                )
            ),
            "all_hex = true",
        ),
    ] {
        let error = made(&text, place.path()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    let text = format!("{BAR}{tiling}[[op]]\nkeep_largest = true\n{fe}resolution = 8\n");
    let report = made(&text, place.path()).unwrap();
    assert!(facts(&report).notes[0].contains("op.0.keep_largest"));
    assert!(
        report.warnings.iter().any(|w| w.code == "W118"),
        "{:?}",
        report.warnings
    );
}

#[test]
fn the_dry_run_names_homogenised_cells_without_voxels() {
    let text = format!(
        "{BAR}[tiling]\ncell = \"p\"\nlevel = \"0.3 + 0.2*by\"\n[[output]]\nfe = \"a.inp\"\n"
    );
    // All elements have the mean of their corners: one value.
    let recipe = Recipe::parse(&text, &[]).unwrap();
    let found = plan(&recipe, &RunOptions::default(), &Silent).unwrap();
    assert_eq!(
        (found.homogenised_cells, found.leaves, found.elements),
        (1, 0, 4)
    );
    let graded = Recipe::parse(&text.replace("by", "bx"), &[]).unwrap();
    let found = plan(&graded, &RunOptions::default(), &Silent).unwrap();
    assert_eq!(found.homogenised_cells, 9);
    assert!(found.seconds > 0.0 && found.disk_bytes > 0);
}

/// A file of results as `CalculiX` writes it, of the bar's nodes, with stresses along x that depend on x.
fn results(path: &Path, stress: impl Fn(f64) -> f64) {
    let mut nodes = Vec::new();
    for k in 0..2 {
        for j in 0..2 {
            for i in 0..5 {
                nodes.push([2.0 * f64::from(i), 2.0 * f64::from(j), 2.0 * f64::from(k)]);
            }
        }
    }
    let mut text = String::from(
        "    1C\n    2C                            20                                     1\n",
    );
    for (n, [x, y, z]) in nodes.iter().enumerate() {
        writeln!(text, " -1{:10}{x:12.5E}{y:12.5E}{z:12.5E}", n + 1).unwrap();
    }
    text +=
        " -3\n    3C                             4                                     1\n -3\n";
    text += "    1PSTEP                         1           1           1\n";
    text += "  100CL  101 1.000000000          20                     0    1           1\n";
    text += " -4  STRESS      6    1\n";
    for name in ["SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"] {
        writeln!(text, " -5  {name:8}    1    4    1    1").unwrap();
    }
    for (n, p) in nodes.iter().enumerate() {
        // Numbers of twelve columns touch.
        write!(text, " -1{:10}{:12.5E}", n + 1, stress(p[0])).unwrap();
        text += &"-0.00000E+00".repeat(5);
        text.push('\n');
    }
    std::fs::write(path, text + " -3\n 9999\n").unwrap();
}

fn graded(
    text: &str,
    results: &Path,
    change: impl Fn(&mut GradeOptions),
) -> Result<GradeReport, RunError> {
    let mut options = GradeOptions {
        results: results.to_owned(),
        field: "S".to_owned(),
        rule: None,
        limit: None,
        mass: None,
        bounds: None,
        filter: Some(0.0),
        step: 2.0,
        exponent: None,
        unit: None,
    };
    change(&mut options);
    let recipe = Recipe::parse(text, &[])?;
    grade(
        &recipe,
        &RunOptions::default(),
        &options,
        &results.with_file_name("field.vtu"),
        &Silent,
    )
}

#[test]
fn a_grading_keeps_the_mass_and_moves_solid_to_the_stress() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.frd");
    let text = format!(
        "{BAR}[tiling]\ncell = \"p\"\nvolume_fraction = 0.4\n[[output]]\nfe = \"a.inp\"\nresolution = 8\n"
    );
    // Stresses of 1, 3, 5, 7 in the elements.
    results(&file, |x| x);
    let kept = graded(&text, &file, |_| {}).unwrap();
    assert!((kept.greatest - 7.0 / 0.4).abs() < 1e-9 && (kept.mean - 10.0).abs() < 1e-9);
    assert!(
        (kept.new_solid_volume / kept.solid_volume - 1.0).abs() < 1e-5,
        "{kept:?}"
    );
    assert!(
        kept.new_range[0] < 0.3 && kept.new_range[1] > 0.5,
        "{kept:?}"
    );
    let field = read_scaffold(place.path().join("field.vtu")).unwrap();
    let names: Vec<&str> = field.fields.iter().map(|f| f.name.as_str()).collect();
    assert!(
        names.contains(&"volume_fraction") && names.contains(&"stress_in_solid"),
        "{names:?}"
    );
    // Fully stressed: a stress of s needs the fraction s / limit, here the same everywhere.
    results(&file, |_| 2.0);
    let full = graded(&text, &file, |o| o.limit = Some(8.0)).unwrap();
    assert_eq!((full.above_limit, full.target), (Some(0), 8.0));
    assert!((full.new_range[0] - 0.25).abs() < 1e-9 && (full.new_range[1] - 0.25).abs() < 1e-9);
    // Without a stress there is no ratio to grow by.
    results(&file, |_| 0.0);
    let error = graded(&text, &file, |_| {}).unwrap_err().to_string();
    assert!(error.contains("with 0 in all elements"), "{error}");
    // The next run takes the field.
    let next = text.replace(
        "volume_fraction = 0.4",
        &format!(
            "volume_fraction = {{ file = \"{}\", field = \"volume_fraction\" }}",
            place.path().join("field.vtu").display()
        ),
    );
    let report = made(&next, place.path()).unwrap();
    // The deck counts the solid of a coarse homogenisation.
    assert!(
        (facts(&report).solid_volume - 8.0).abs() < 0.08,
        "{:?}",
        facts(&report)
    );
}

#[test]
fn diameters_of_round_struts_are_graded_in_units_of_length() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.frd");
    results(&file, |_| 2.0);
    let text = BAR.replace("surface = \"schwarz_p\"", "graph = \"sc\"")
        + "[tiling]\ncell = \"p\"\nthickness = 0.5\n[[output]]\nfe = \"a.inp\"\nresolution = 16\n";
    let report = made(&text, place.path()).unwrap();
    // Struts along the edges of cubes of 2 mm: 3 half struts' worth of length 2 each, less their overlap.
    let (d, l) = (0.5f64, 2.0);
    let exact = 3.0 * std::f64::consts::PI / 4.0 * d * d * l - 2f64.sqrt() * d.powi(3);
    let found = facts(&report).solid_volume / 4.0;
    assert!((found / exact - 1.0).abs() < 0.02, "{found} {exact}");
    let kept = graded(&text, &file, |_| {}).unwrap();
    assert_eq!(kept.quantity, "thickness");
    assert!(
        (kept.new_range[0] - 0.5).abs() < 2e-3 && (kept.new_range[1] - 0.5).abs() < 2e-3,
        "{kept:?}"
    );
}

#[test]
fn bad_results_are_refused_with_their_place() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.frd");
    results(&file, |x| x);
    let good = std::fs::read_to_string(&file).unwrap();
    let text = format!("{BAR}[tiling]\ncell = \"p\"\nvolume_fraction = 0.4\n");
    let refused = |content: &str, change: &dyn Fn(&mut GradeOptions), words: &[&str]| {
        std::fs::write(&file, content).unwrap();
        let error = graded(&text, &file, change).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "{word}: {error}");
        }
    };
    refused(
        &good,
        &|o| o.field = "ENER".into(),
        &["no field \"ENER\"", "one of STRESS"],
    );
    refused("solid x\n", &|_| {}, &["line 1", "begins with 1C"]);
    refused(&good[..good.len() - 200], &|_| {}, &["truncated"]);
    refused(
        &good.replace(
            "20                                     1",
            "20                                     2",
        ),
        &|_| {},
        &["binary"],
    );
    refused(
        &good.replacen("0.00000E+00", "0.0000xE+00", 1),
        &|_| {},
        &["line 35", "12 columns"],
    );
    refused(
        &good.replacen(" 8.00000E0", " 9.00000E0", 1),
        &|_| {},
        &["node 5", "its place", "solve that deck again"],
    );
    let first = good.lines().nth(2).unwrap();
    refused(
        &good.replacen(&format!("{first}\n"), "", 1),
        &|_| {},
        &["19 nodes", "20"],
    );
    refused(
        &good,
        &|o| o.mass = Some(30.0),
        &["30.0000 times", "--bounds"],
    );
    results(&file, |_| 0.0);
    let error = graded(&text, &file, |_| {}).unwrap_err().to_string();
    assert!(error.contains("0 in all elements"), "{error}");
    let error = read_frd(place.path().join("none.frd")).unwrap_err();
    assert_eq!(error.class().exit_code(), 66);
}
