//! Crystals of a recipe as solids, skins, scaffolds and cells.

use super::recipe;
use druse::pipeline::{Report, RunOptions, run};
use druse::polymesh::{Interpreter, NoFiles, PolyMesh, Script};
use druse::progress::Silent;
use std::fmt::Write as _;

/// A run without measures of walls.
fn report(text: &str) -> Report {
    let options = RunOptions {
        brief: true,
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

fn error(text: &str) -> String {
    let found = run(&recipe(text), &RunOptions::default(), &Silent);
    found.err().map_or_else(String::new, |e| e.to_string())
}

fn polygons(script: &str) -> PolyMesh {
    let mut interpreter = Interpreter::new(&NoFiles);
    Script::parse(script)
        .unwrap()
        .run(&mut interpreter, None)
        .unwrap();
    interpreter.mesh().unwrap().clone()
}

/// A recipe with one crystal.
fn with(steps: &str, voxel: f64, rest: &str) -> String {
    format!("druse = 1\n[crystal.gem]\nsteps = \"{steps}\"\n{rest}\n[band]\nvoxel_size = {voxel}\n")
}

const GEM: &str = "form cubic [1,1,1]=5 [1,0,0]=6";
const UNION: &str = "[[op]]\nunion = { crystal = \"gem\" }";

/// The fractals at one and two steps, with walls between their pits: surfaces that touch no other part of
/// themselves, whose volumes are known from the polygons.
#[test]
fn level_sets_of_fractals_have_the_volume_of_their_polygons_within_a_share_of_a_voxel() {
    let menger = |k| {
        format!(
            "cube edge=6; repeat {k} {{ remesh checkerboard t=1/3; extrude cubical group=1 dihedral=90 tiers=[-.9] }}"
        )
    };
    let cubes = |k| {
        format!(
            "cube edge=6; repeat {k} {{ remesh checkerboard t=1/3; extrude cubical group=1 dihedral=90 tiers=[.9] }}"
        )
    };
    let sierpinski = |k| {
        format!(
            "tetrahedron edge=6; repeat {k} {{ remesh loop_style; extrude tetrahedral group=1 dihedral=atan(sqrt(2)) tiers=[-.9/sqrt(3)] }}"
        )
    };
    for script in [menger(1), menger(2), cubes(2), sierpinski(1), sierpinski(2)] {
        let mesh = polygons(&script);
        for voxel in [0.2, 0.1, 0.06] {
            let found = report(&with(&script, voxel, UNION)).solid.volume;
            // Edges are bevelled: less than a quarter of a voxel's layer over the whole surface.
            let off = (found - mesh.volume()).abs() / (mesh.area() * voxel);
            assert!(off < 0.25, "{script}: voxel {voxel}: {off}");
        }
    }
}

#[test]
fn a_crystal_is_placed_and_cuts_adds_and_skins() {
    let gem = polygons(GEM);
    let layer = gem.area() * 0.2;
    let whole = report(&with(GEM, 0.2, UNION));
    assert!((whole.solid.volume - gem.volume()).abs() < 0.1 * layer);
    assert_eq!(whole.inputs[0].key, "op.0.union.crystal");
    assert_eq!(whole.inputs[0].path, "crystal.gem");
    assert_eq!(whole.inputs[0].hash.len(), 64);
    // Twice as large and moved: eight times the volume.
    let placed = UNION.replace(
        "\"gem\"",
        "{ name = \"gem\", transform = { scale = 2, translate = [10, 0, 0] } }",
    );
    let large = report(&with(GEM, 0.4, &placed));
    assert!((large.solid.volume / whole.solid.volume - 8.0).abs() < 0.1);
    assert!((large.solid.bounds.unwrap().centre().0.x - 10.0).abs() < 0.05);
    // Cut out of a ball around it, and as an envelope of that ball.
    let ball = "[[op]]\nunion = { sphere = { radius = 8 } }\n";
    let solid = |op: &str| {
        let rest = format!("{ball}[[op]]\n{op} = {{ crystal = \"gem\" }}");
        report(&with(GEM, 0.2, &rest)).solid.volume
    };
    let volume = std::f64::consts::PI * 4.0 / 3.0 * 512.0;
    assert!((solid("intersect") - gem.volume()).abs() < 0.2 * layer);
    assert!((solid("subtract") - (volume - gem.volume())).abs() < 0.3 * layer);
    // A skin inside holds less than its area times its thickness, and more without its edges.
    let skin = "[[op]]\nunion = { skin = { crystal = \"gem\", thickness = 0.5 } }";
    let skin = report(&with(GEM, 0.2, skin)).solid;
    assert!(skin.volume < 0.5 * gem.area() && skin.volume > 0.4 * gem.area());
}

const CELL: &str = "[cell.p]\nsurface = \"schwarz_p\"\nlevel = 0\n[tiling]\ncell = \"p\"";

#[test]
fn a_crystal_is_a_shell_of_its_quads_and_triangles_or_is_filled() {
    let shell = format!("[scaffold]\ncrystal = \"gem\"\nshell = {{ thickness = 1 }}\n{CELL}");
    let quads = "cuboctahedron edge=8; remesh dual; remesh linear_vertex";
    let found = report(&with(quads, 0.15, &shell));
    let faces = polygons(quads).face_count() as u64;
    let scaffold = found.scaffold.as_ref().unwrap();
    assert_eq!(scaffold.elements, [("Hex8".to_owned(), faces)].into());
    let share = |report: &Report| report.solid.volume / report.scaffold.as_ref().unwrap().volume;
    assert!((share(&found) - 0.5).abs() < 0.05);
    let triangles = "octahedron edge=8; remesh loop_style";
    let shell = shell.replace(
        "surface = \"schwarz_p\"\nlevel = 0",
        "formula = \"hypot(x, y) - 0.25\"",
    );
    let found = report(&with(triangles, 0.3, &shell));
    let faces = polygons(triangles).face_count() as u64;
    assert_eq!(
        found.scaffold.unwrap().elements,
        [("Wedge6".to_owned(), faces)].into()
    );
    // Groups of faces are groups of elements: each its own cell.
    let groups = "cube edge=6; assign faces(normal.z > .5) 2";
    let shares = "[cell.q]\nsurface = \"schwarz_p\"\nlevel = -1.05\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = 0\n\
                  [scaffold]\ncrystal = \"gem\"\nshell = { thickness = 1 }\nrepeat = 4\n\
                  [tiling]\nassign = [{ cell = \"q\", group = \"group2\" }, { cell = \"p\" }]";
    assert_eq!(error(&with(groups, 0.2, shares)), "");
    let cell = CELL.replace("level = 0", "volume_fraction = 0.5");
    for kind in ["hex", "tet"] {
        let fill = format!(
            "[scaffold]\nfill = {{ crystal = \"gem\", cell_size = 2, kind = \"{kind}\" }}\n{cell}"
        );
        let share = report(&with(GEM, 0.2, &fill)).solid.volume / polygons(GEM).volume();
        assert!((share - 0.5).abs() < 0.05, "{kind}: {share}");
    }
}

/// Clusters with the element's own symmetry lose nothing when they are made symmetric, and a recipe's
/// crystal makes the cell that its file makes.
#[test]
fn clusters_are_cells_of_the_whole_group_of_their_element() {
    for (name, element, group, order) in [
        ("octahedral", "hex", "Oh", 48),
        ("tetrahedral", "tet", "Td", 24),
    ] {
        let file = format!("ROOT/examples/crystal/{name}_cluster.crystal");
        let mut text = format!("druse = 1\n[crystal.c]\nfile = \"{file}\"\n");
        for (cell, source) in [
            ("a", "crystal = \"c\"".to_owned()),
            ("b", format!("mesh = \"{file}\"")),
        ] {
            writeln!(
                text,
                "[cell.{cell}]\n{source}\nband_limit = 6\nelement = \"{element}\""
            )
            .unwrap();
        }
        let path = file.replace("ROOT", env!("CARGO_MANIFEST_DIR"));
        let mesh = druse::io::read_crystal(path).unwrap().0;
        assert_eq!(mesh.symmetries().len(), order, "{name}");
        let run_with = |cell: &str| {
            let kind = if element == "tet" {
                ", kind = \"tet\""
            } else {
                ""
            };
            report(&format!(
                "{text}[scaffold]\nbox = {{ size = [2, 2, 2], cell_size = 2{kind} }}\n[tiling]\ncell = \"{cell}\"\n[band]\nvoxel_size = 0.05\n"
            ))
        };
        let (a, b) = (run_with("a"), run_with("b"));
        let facts = &a.cells["a"];
        assert_eq!(facts["group"], group, "{facts}");
        assert!(
            facts["fit"]["kept_energy"].as_f64().unwrap() > 0.999,
            "{facts}"
        );
        assert_eq!(a.solid.volume, b.solid.volume);
    }
}

#[test]
fn wrong_crystals_are_refused_with_a_way_out() {
    let refuse = |text: &str| {
        let parsed = druse::recipe::Recipe::parse(text, &[]);
        parsed.map_or_else(
            |e| e.to_string() + e.hint.as_deref().unwrap_or(""),
            |_| "accepted".into(),
        )
    };
    let unknown = refuse(&with("cube", 0.1, &UNION.replace("\"gem\"", "\"gen\"")));
    assert!(
        unknown.contains("no crystal is named \"gen\"; the recipe has gem"),
        "{unknown}"
    );
    assert!(unknown.contains("did you mean \"gem\"?"), "{unknown}");
    let two = "[[op]]\nunion = { skin = { crystal = \"gem\", mesh = \"a.stl\", thickness = 1 } }";
    assert!(
        refuse(&with("cube", 0.1, two)).contains("exactly one of mesh and crystal; found both")
    );
    let none = "[[op]]\nunion = { skin = { thickness = 1 } }";
    assert!(refuse(&with("cube", 0.1, none)).contains("found none"));
    let thin = format!("[scaffold]\ncrystal = \"gem\"\n{CELL}");
    assert!(refuse(&with("cube", 0.1, &thin)).contains("expected its thickness: shell"));
    let shell = format!("[scaffold]\ncrystal = \"gem\"\nshell = {{ thickness = 1 }}\n{CELL}");
    let sides = error(&with("dodecahedron edge=5", 0.3, &shell));
    assert!(
        sides.contains("face 0 (group 1) has 5 corners; expected triangles and quads"),
        "{sides}"
    );
    let step = error(&with("cube; extrude cubical group=2", 0.1, UNION));
    assert!(
        step.contains("steps, line 1: extrude: group == (2) selects none"),
        "{step}"
    );
    let inside = error(&with("cube; save a.obj; polygon n=4", 0.1, UNION));
    assert!(
        inside.contains("expected a surface with outward normals"),
        "{inside}"
    );
    let set = with("cube", 0.1, UNION).replace("steps =", "set = { k = 2 }\nsteps =");
    assert!(
        error(&set).contains("no parameter is named \"k\""),
        "{}",
        error(&set)
    );
}
