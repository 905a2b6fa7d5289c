//! Recipes with scaffolds of every kind and with several cells.

use super::recipe;
use druse::pipeline::{Probe, Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::f64::consts::PI;
use std::fmt::Write as _;

fn report(text: &str) -> Report {
    run(&recipe(text), &RunOptions::default(), &Silent).unwrap()
}

fn error(text: &str) -> String {
    let options = RunOptions::default();
    run(&recipe(text), &options, &Silent)
        .err()
        .map_or_else(String::new, |e: RunError| e.to_string())
}

fn parse_error(text: &str) -> String {
    Recipe::parse(text, &[]).unwrap_err().to_string()
}

/// A recipe of a scaffold and a tiling, with two cells of known volume fractions: 0.2 and 0.5.
fn with(scaffold: &str, tiling: &str, voxel: f64) -> String {
    format!(
        "druse = 1\n[cell.thin]\nsurface = \"schwarz_p\"\nlevel = -1.05185006\n\
         [cell.thick]\nsurface = \"schwarz_p\"\nlevel = 0\n\
         [scaffold]\n{scaffold}\n[tiling]\n{tiling}\n[band]\nvoxel_size = {voxel}\n"
    )
}

const BLOCK: &str = "box = { size = [6, 2, 2], cell_size = 1 }";

/// Volume fraction of a solid. The mesh bevels the rims where the scaffold ends, so that a law compares
/// solids on the same voxels, not with the target fraction.
fn share(text: &str) -> f64 {
    brief(text).solid.volume_fraction.unwrap()
}

/// A run without measures of walls.
fn brief(text: &str) -> Report {
    let options = RunOptions {
        brief: true,
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

/// Mean of the fractions that both cells alone have on these voxels.
fn halfway(voxel: f64) -> f64 {
    let alone = |cell: &str| share(&with(BLOCK, &format!("cell = \"{cell}\""), voxel));
    f64::midpoint(alone("thin"), alone("thick"))
}

#[test]
fn volumes_follow_a_transition() {
    let tiling = "transition = [{ cell = \"thin\", weight = \"1 - bx\" }, { cell = \"thick\", weight = \"bx\" }]\ncertificate = true";
    let found = report(&with(BLOCK, tiling, 0.06));
    let fraction = found.solid.volume_fraction.unwrap();
    assert!((fraction - halfway(0.06)).abs() < 0.01, "{fraction}");
    let continuity = found.continuity.unwrap();
    assert!(continuity.value_jump_max < 1e-5);
    assert_eq!(continuity.faces[0].kind, "quad");
    assert!(continuity.faces[0].crossings > 100);
    assert_eq!(found.cells.len(), 2);
}

#[test]
fn assigned_cells_fill_their_elements_and_pass_between() {
    let tiling = "assign = [{ cell = \"thin\" }, { cell = \"thick\", where = \"x - 3\" }]";
    let fraction = share(&with(BLOCK, tiling, 0.08));
    assert!((fraction - halfway(0.08)).abs() < 0.015, "{fraction}");
    let text = error(&with(
        BLOCK,
        "assign = [{ cell = \"thin\", where = \"x - 3\" }]",
        0.2,
    ));
    assert!(text.contains("has no cell"), "{text}");
    let text = error(&with(
        BLOCK,
        "assign = [{ cell = \"thin\", group = \"left\" }]",
        0.2,
    ));
    assert!(text.contains("no group \"left\""), "{text}");
}

#[test]
fn cells_and_cuts_that_do_not_go_with_the_scaffold_are_named() {
    let transition =
        "transition = [{ cell = \"thin\", weight = 1 }, { cell = \"thick\", weight = 1 }]";
    let of_tet = with(BLOCK, transition, 0.2).replacen(
        "[cell.thick]\n",
        "[cell.thick]\nelement = \"tet\"\n",
        1,
    );
    let text = error(&of_tet);
    assert!(
        text.contains("cell.thick") && text.contains("made for a tet"),
        "{text}"
    );
    let nowhere = "assign = [{ cell = \"thin\" }, { cell = \"thick\", where = \"x - 99\" }]";
    let text = error(&with(BLOCK, nowhere, 0.2));
    assert!(
        text.contains("tiling.assign.1: no element is in it"),
        "{text}"
    );
    let quads = format!("{BLOCK}\nall_quad = true");
    let text = parse_error(&with(&quads, "cell = \"thin\"", 0.2));
    assert!(text.contains("expected shell or plate"), "{text}");
}

#[test]
fn graded_volumes_match_their_targets() {
    let graded = |cell: &str, rule: &str| {
        let tiling = format!("cell = \"{cell}\"\nvolume_fraction = {rule}");
        share(&with(BLOCK, &tiling, 0.06))
    };
    let fraction = graded("thin", "\"0.2 + 0.3 * bx\"");
    assert!((fraction - halfway(0.06)).abs() < 0.01, "{fraction}");
    // A constant grading is the cell with that fraction.
    let (constant, plain) = (
        graded("thick", "0.2"),
        share(&with(BLOCK, "cell = \"thin\"", 0.06)),
    );
    assert!((constant - plain).abs() < 1e-4, "{constant} {plain}");
}

/// A constant thickness is that of the sheet made with it, whatever the size of the elements.
#[test]
fn graded_thickness_is_in_the_recipes_unit() {
    for size in [1.0, 2.0] {
        let sheet = |own: f64, graded: &str| {
            format!(
                "druse = 1\n[cell.a]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\nthickness = {own}\n\
                 [scaffold]\nbox = {{ size = [4, 2, 2], cell_size = {size} }}\n\
                 [tiling]\ncell = \"a\"\n{graded}\n[band]\nvoxel_size = 0.05\n"
            )
        };
        let (graded, plain) = (
            share(&sheet(0.1, "thickness = 0.24")),
            share(&sheet(0.24 / size, "")),
        );
        assert!((graded - plain).abs() < 1e-4, "{size}: {graded} {plain}");
    }
}

#[test]
fn bad_weights_are_named() {
    let tiling = |weight: &str| {
        format!(
            "transition = [{{ cell = \"thin\", weight = {weight} }}, {{ cell = \"thick\", weight = 0 }}]"
        )
    };
    let text = error(&with(BLOCK, &tiling("\"1 - bq\""), 0.2));
    assert!(
        text.contains("tiling.transition.0.weight") && text.contains("bq"),
        "{text}"
    );
    let text = error(&with(BLOCK, &tiling("\"x - 3\""), 0.2));
    assert!(text.contains("sum to 0"), "{text}");
    let text = error(&with(BLOCK, &tiling("\"1 / x\""), 0.2));
    assert!(text.contains("inf"), "{text}");
    let text = error(&with(BLOCK, &tiling("\"d\""), 0.2));
    assert!(text.contains("envelope"), "{text}");
    let text = error(&with(BLOCK, &tiling("{ field = \"stress\" }"), 0.2));
    assert!(text.contains("needs a file"), "{text}");
    let warned = report(&with(
        BLOCK,
        "transition = [{ cell = \"thin\", weight = \"3 - x\" }, { cell = \"thick\", weight = 1 }]",
        0.2,
    ));
    assert!(
        warned.warnings.iter().any(|w| w.code == "W109"),
        "{:?}",
        warned.warnings
    );
}

#[test]
#[ignore = "long; tests/run full"]
fn round_scaffolds_and_filled_meshes_have_their_share() {
    let ball = with(
        "sphere = { radius = 3, cell_size = 1.5 }",
        "cell = \"thick\"",
        0.12,
    );
    let found = report(&ball);
    // The share is the element's own where maps are affine; here they are not.
    let share = found.solid.volume / (4.0 / 3.0 * PI * 27.0);
    assert!((share - 0.5).abs() < 0.06, "{share}");
    assert_eq!(found.scaffold.unwrap().elements["Hex27"], 32);
    let rod = with(
        "cylinder = { radius = 2, height = 3, cell_size = 1 }",
        "cell = \"thick\"",
        0.12,
    );
    let found = report(&rod);
    assert!((found.solid.volume / (PI * 12.0) - 0.5).abs() < 0.06);

    let fill = "fill = { mesh = \"ROOT/examples/bracket/bracket.stl\", cell_size = 8 }";
    let found = report(&with(fill, "cell = \"thick\"", 1.0));
    let share = found.solid.volume_fraction.unwrap();
    assert!((share - 0.5).abs() < 0.12, "{share}");

    let tets = "druse = 1\n[cell.a]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.5\n\
        [scaffold]\nfill = { mesh = \"ROOT/examples/bracket/bracket.stl\", cell_size = 8, kind = \"tet\" }\n\
        [tiling]\ncell = \"a\"\n[band]\nvoxel_size = 1\n";
    let found = report(tets);
    let scaffold = found.scaffold.unwrap();
    let [least, greatest] = scaffold.dihedral_degrees.unwrap();
    assert!(least > 10.7 && greatest < 164.8, "{least} {greatest}");
    assert!((found.solid.volume / scaffold.volume - 0.5).abs() < 0.1);
}

#[test]
fn elements_can_be_cut_up() {
    let whole = brief(&with(BLOCK, "cell = \"thick\"", 0.1)).solid;
    let halves = share(&with(
        "box = { size = [6, 2, 2], cell_size = 0.5 }",
        "cell = \"thick\"",
        0.05,
    ));
    for (extra, count) in [
        ("refine = 1", 24 * 8),
        ("repeat = 2", 24 * 8),
        ("all_hex = true", 24 * 8),
    ] {
        let found = brief(&with(
            &format!("{BLOCK}\n{extra}"),
            "cell = \"thick\"",
            0.05,
        ));
        assert_eq!(found.scaffold.unwrap().elements["Hex8"], count, "{extra}");
        let fraction = found.solid.volume_fraction.unwrap();
        assert!((fraction - halves).abs() < 0.01, "{fraction}");
        // Half the size of cells: twice the surface, but for the outside.
        assert!(found.solid.area > 1.4 * whole.area);
    }
    let text = error(&with(
        "box = { size = [2, 2, 2], cell_size = 1, kind = \"tet\" }\nrepeat = 2",
        "cell = \"thick\"",
        0.2,
    ));
    assert!(text.contains("Tet4"), "{text}");
}

#[test]
fn shells_and_plates_come_from_surfaces() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.off");
    std::fs::write(
        &path,
        "OFF\n6 2 0\n0 0 0\n1 0 0\n2 0 0\n0 1 0\n1 1 0\n2 1 0\n4 0 1 4 3\n4 1 2 5 4\n",
    )
    .unwrap();
    let file = format!("file = \"{}\"", path.display());
    for thickness in ["shell = { thickness = 1 }", "plate = { height = 1 }"] {
        let found = report(&with(
            &format!("{file}\n{thickness}"),
            "cell = \"thick\"",
            0.05,
        ));
        let block = with(
            "box = { size = [2, 1, 1], cell_size = 1 }",
            "cell = \"thick\"",
            0.05,
        );
        let (volume, expected) = (found.solid.volume, report(&block).solid.volume);
        assert!(
            (volume / expected - 1.0).abs() < 0.01,
            "{volume} {expected}"
        );
        assert_eq!(found.scaffold.unwrap().elements["Hex8"], 2);
    }
    let text = error(&with(&file, "cell = \"thick\"", 0.2));
    assert!(text.contains("shell = "), "{text}");
}

#[test]
fn fields_of_files_set_weights() {
    let directory = tempfile::tempdir().unwrap();
    let csv = directory.path().join("w.csv");
    let mut text = String::from("x,y,z,w\n");
    for i in 0..=6 {
        for (y, z) in [(0, 0), (2, 0), (0, 2), (2, 2)] {
            writeln!(text, "{i},{y},{z},{}", f64::from(i) / 6.0).unwrap();
        }
    }
    std::fs::write(&csv, text).unwrap();
    let tiling = |outside: &str| {
        let field = format!("{{ file = \"{}\", field = \"w\"{outside} }}", csv.display());
        format!(
            "transition = [{{ cell = \"thin\", weight = \"1 - bx\" }}, {{ cell = \"thick\", weight = {field} }}]"
        )
    };
    let (plain, mean) = (share(&with(BLOCK, &tiling(""), 0.08)), halfway(0.08));
    assert!((plain - mean).abs() < 0.015, "{plain} {mean}");
    // Mapped to a constant: more of the thick cell.
    let mapped = tiling(", map = [[0, 1], [1, 1]]");
    let more = share(&with(BLOCK, &mapped, 0.08));
    assert!(more > mean + 0.01, "{more} {mean}");
    let missing = tiling("").replace("field = \"w\"", "field = \"v\"");
    assert!(error(&with(BLOCK, &missing, 0.2)).contains("x,y,z,v"));
}

#[test]
fn points_are_probed_inside_and_outside() {
    let text = with(
        BLOCK,
        "transition = [{ cell = \"thin\", weight = \"1 - bx\" }, { cell = \"thick\", weight = \"bx\" }]",
        0.1,
    );
    let recipe = recipe(&text);
    let options = RunOptions::default();
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    assert_eq!(probe.cells(), ["thin", "thick"]);
    let points = [[1.5, 0.5, 0.5], [9.0, 0.0, 0.0], [4.7, 1.3, 0.2]];
    let [tables, exact] = [false, true].map(|e| probe.evaluate(&points, e).unwrap());
    assert_eq!([tables[0].element, tables[1].element], [1, -1]);
    assert!(tables[1].phi.is_nan() && tables[1].distance > 0.0);
    for (t, e) in tables.iter().zip(&exact).filter(|p| p.0.element >= 0) {
        assert!((t.phi - e.phi).abs() < 1e-3, "{} {}", t.phi, e.phi);
    }
    assert!((tables[0].weights[1] - 0.25).abs() < 1e-12);
    assert!(tables[0].reference.iter().all(|c| c.abs() < 1e-12));
    let picture = tempfile::tempdir().unwrap();
    let path = picture.path().join("a.vtu");
    let found = probe.certificate(Some(&path)).unwrap();
    assert!(found.value_jump_max < 1e-5);
    let druse::io::ElementFile::Solids(file) = druse::io::read_elements(&path).unwrap() else {
        panic!("solids");
    };
    let names: Vec<&str> = file.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "quality",
            "value_jump",
            "crease_degrees",
            "weight_thin",
            "weight_thick"
        ]
    );
}

#[test]
#[ignore = "long; tests/run full"]
fn smooth_transitions_have_their_share_whatever_says_the_weights() {
    let shares = "transition = [{ cell = \"thin\", weight = \"1 - bx\" }, { cell = \"thick\", weight = \"bx\" }]";
    let halves = "assign = [{ cell = \"thin\" }, { cell = \"thick\", where = \"x - 3\" }]";
    for tiling in [shares, halves] {
        let smooth = format!("{tiling}\ninterpolation = \"smooth\"\ncertificate = true");
        let found = report(&with(BLOCK, &smooth, 0.1));
        let jump = found.continuity.as_ref().unwrap().value_jump_max;
        assert!(jump < 1e-5, "{jump}");
        let mean = halfway(0.1);
        let own = found.solid.volume_fraction.unwrap();
        assert!((own - mean).abs() < 0.015, "{own} {mean}");
    }
    let graded =
        "cell = \"thin\"\nvolume_fraction = \"0.2 + 0.3 * bx\"\ninterpolation = \"smooth\"";
    let own = share(&with(BLOCK, graded, 0.1));
    assert!((own - halfway(0.1)).abs() < 0.02, "{own}");
}

/// Weights from an OpenVDB grid; the recipe chooses the value where the grid has no voxels.
#[test]
fn volumes_set_weights() {
    let directory = tempfile::tempdir().unwrap();
    // Distances of a half space's side: positive on the right, negative on the left.
    let text = "druse = 1\n[band]\nvoxel_size = 0.5\nhalf_width = 10\n[[op]]\nunion = { box = { size = [12, 4, 4], centre = [-3, 1, 1] } }\n\
                [[output]]\nvdb = \"side.vdb\"\nunit = \"mm\"\n";
    let options = RunOptions {
        out: Some(directory.path().to_owned()),
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap();
    let tiling = |more: &str| {
        let path = directory.path().join("side.vdb");
        let field = format!(
            "{{ file = \"{}\", field = \"surface\"{more} }}",
            path.display()
        );
        format!(
            "transition = [{{ cell = \"thin\", weight = 0 }}, {{ cell = \"thin\", weight = 1 }}, {{ cell = \"thick\", weight = {field} }}]"
        )
    };
    // Mapped to an even share on both sides of the plane x = 3, or to all of the thick cell.
    let even = share(&with(BLOCK, &tiling(", map = [[-0.1, 0], [0.1, 1]]"), 0.1));
    let all = share(&with(BLOCK, &tiling(", map = [[-9, 9]]"), 0.1));
    assert!(all > even + 0.05, "{all} {even}");
    let short = with(
        "box = { size = [30, 2, 2], cell_size = 1 }",
        &tiling(", outside = \"error\""),
        0.2,
    );
    let text = error(&short);
    assert!(
        text.contains("lies outside") && text.contains("outside = 0.5"),
        "{text}"
    );
    for outside in ["\"nearest\"", "2.5"] {
        let text = short.replace("\"error\"", outside);
        assert!(error(&text).is_empty(), "{}", error(&text));
    }
    let text = parse_error(&short.replace("\"error\"", "\"far\""));
    assert!(text.contains("nearest"), "{text}");
    let text = error(&short.replace("\"surface\"", "\"temperature\""));
    assert!(text.contains("temperature"), "{text}");
}

#[test]
fn disconnected_cells_are_reported_by_name() {
    let palette = "druse = 1\n[cell.loose]\nsurface = \"schwarz_p\"\nlevel = -1.25\n\
                   [cell.sound]\nsurface = \"schwarz_p\"\nlevel = -0.35\n\
                   [cell.thick]\nsurface = \"schwarz_p\"\nlevel = 0.35\n\
                   [scaffold]\nbox = { size = [6, 2, 2], cell_size = 1 }\n[band]\nvoxel_size = 0.2\n[tiling]\n";
    let tiling = |cells: &[&str]| {
        let share = |c: &&str| format!("{{ cell = \"{c}\", weight = 1 }}");
        let shares: Vec<String> = cells.iter().map(share).collect();
        format!("{palette}transition = [{}]\n", shares.join(", "))
    };
    let warnings_of = |cells: &[&str]| -> Vec<String> {
        let warnings = report(&tiling(cells)).warnings;
        let own = warnings.into_iter().filter(|w| w.code == "W110");
        own.map(|w| w.message).collect()
    };
    assert!(warnings_of(&["sound", "thick"]).is_empty());
    let messages = warnings_of(&["loose", "thick", "sound"]);
    assert_eq!(messages.len(), 2, "{messages:?}");
    let first = &messages[0];
    assert!(
        first.contains("\"loose\" itself is not connected"),
        "{first}"
    );
    assert!(
        first.contains("weight 0;") && first.contains("\"sound\""),
        "{first}"
    );
}

/// A hex with a wedge on one of its faces.
const HEX_AND_WEDGE: &str = "# vtk DataFile Version 3.0\nmixed\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 double\n\
    0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1 -1 0.5 0 -1 0.5 1\nCELLS 2 16\n\
    8 0 1 2 3 4 5 6 7\n6 0 3 8 4 7 9\nCELL_TYPES 2\n12\n13\n";

#[test]
fn a_mixed_scaffold_is_filled_without_a_seam_and_tells_of_every_shape() {
    let place = tempfile::tempdir().unwrap();
    let mesh = place.path().join("mixed.vtk");
    std::fs::write(&mesh, HEX_AND_WEDGE).unwrap();
    let found = report(&format!(
        "druse = 1\n[cell.c]\ngraph = \"edges\"\nradius = 0.2\nband_limit = 3\n[scaffold]\nfile = {mesh:?}\n\
         [tiling]\ncell = \"c\"\ncertificate = true\n[band]\nvoxel_size = 0.08\n"
    ));
    assert_eq!(found.solid.components, 1);
    let continuity = found.continuity.unwrap();
    assert!(continuity.value_jump_max < 1e-5 && continuity.faces[0].crossings > 0);
    let cell = &found.cells["c"];
    for shape in ["hex", "wedge"] {
        let facts = &cell["elements"][shape];
        assert_eq!(facts["element"], shape);
        let share = facts["volume_fraction"].as_f64().unwrap();
        assert!(share > 0.05 && share < 0.8, "{shape}: {share}");
    }
    assert_eq!(cell["element"], "hex");
    let alone = report(&with(BLOCK, "cell = \"thin\"", 0.2));
    assert!(alone.cells["thin"].get("elements").is_none());
}
