//! The recipe: what it accepts, and that each error gives place, found and expected.

use druse::frame::LengthUnit;
use druse::recipe::{
    Brief, CellPlace, Length, Op, Operand, PictureSize, Place, Recipe, RecipeError, RecipeFault,
    Scale, Short, Side, Size, schema,
};
use proptest::prelude::*;

const SPHERE: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 5 } }\n";

fn parse(text: &str) -> Result<Recipe, RecipeError> {
    Recipe::parse(text, &[])
}

fn refuse(text: &str) -> RecipeError {
    match parse(text) {
        Err(e) => e,
        Ok(_) => panic!("accepted:\n{text}"),
    }
}

fn line_of(e: &RecipeError) -> usize {
    match e.place {
        Some(Place::Line { line, .. }) => line,
        _ => panic!("no line in {e:?}"),
    }
}

/// The contract's own sketch, as far as this version goes.
const FULL_RECIPE: &str = r#"druse = 1
unit = "mm"
[cell.strut]
mesh = "strut.stl"
band_limit = 8
samples = 48
place = { scale = 2, rotate = [0, 0, 90] }
[cell.plate]
surface = "schwarz_p"
volume_fraction = 0.3
solid = "below"
[scaffold]
file = { path = "bracket.msh", unit = "in", up = "y", transform = { scale = 2 } }
boundary = "extend"
[tiling]
cell = "strut"
[band]
voxel_size = "100um"
half_width = 4
distance = "exact"
[[op]]
intersect = { mesh = "bracket.stl" }
[[op]]
union = { skin = { mesh = "bracket.stl", thickness = 0.8, side = "both" } }
[[op]]
gaussian = { width = 2, iterations = 3 }
[[op]]
dilate = "3vx"
[[op]]
median = 1
[[op]]
keep_largest = true
[[output]]
vdb = "bracket.vdb"
unit = "m"
fog = true
[[output]]
picture = "bracket.png"
size = "640x480"
cut = "x=1.5"
"#;

#[test]
fn reads_every_section() {
    let recipe = parse(FULL_RECIPE).unwrap();
    let s = recipe.sections();
    assert!((recipe.scale().voxel_size - 0.1).abs() < 1e-15);
    assert_eq!(s.cell.len(), 2);
    assert!(matches!(
        s.cell["strut"].place,
        Some(CellPlace::Similarity(_))
    ));
    let file = s.scaffold.as_ref().unwrap().file.as_ref().unwrap();
    assert_eq!(file.unit.unwrap().0, LengthUnit::Inch);
    assert_eq!(s.op.len(), 6);
    let Op::Union(Operand::Skin(skin)) = &s.op[1] else {
        panic!("{:?}", s.op[1]);
    };
    assert_eq!(skin.side, Side::Both);
    let Op::Gaussian(kernel) = &s.op[2] else {
        panic!("{:?}", s.op[2]);
    };
    assert_eq!(
        (kernel.width.voxels(recipe.scale()), kernel.iterations.0),
        (2.0, 3)
    );
    let Op::Dilate(d) = &s.op[3] else {
        panic!("{:?}", s.op[3]);
    };
    assert!((d.distance.resolve(recipe.scale()) - 0.3).abs() < 1e-15);
    assert_eq!(s.output[1].size, Some(PictureSize(640, 480)));
    assert_eq!(
        s.output[0].unit_or_default(recipe.unit()),
        LengthUnit::Metre
    );
}

#[test]
fn unknown_words_name_the_nearest_known_one_and_their_line() {
    let cases = [
        ("voxel_size", "voxelsize", "voxel_size"),
        ("[band]", "[bnad]", "band"),
        ("union", "unoin", "union"),
        ("sphere", "spher", "sphere"),
        ("radius", "raduis", "radius"),
    ];
    for (from, to, nearest) in cases {
        let text = SPHERE.replace(from, to);
        let error = refuse(&text);
        let line = text.lines().position(|l| l.contains(to)).unwrap() + 1;
        assert_eq!(line_of(&error), line, "{error:?}");
        let hint = format!("did you mean \"{nearest}\"?");
        assert_eq!(error.hint, Some(hint.into()), "{error:?}");
    }
}

#[test]
fn unknown_sources_of_a_cell_list_the_known_ones() {
    let error = refuse(&FULL_RECIPE.replace("surface = \"schwarz_p\"", "level = 0"));
    assert_eq!(line_of(&error), 8);
    for word in ["mesh", "surface", "graph", "formula", "file"] {
        assert!(error.message.contains(word), "{}", error.message);
    }
}

#[test]
fn keys_of_struts_and_formulas_belong_to_them() {
    let cases = [
        ("graph = \"octet\"\nradius = 0", "positive"),
        ("surface = \"iwp\"\nradius = 0.1", "graph"),
        ("graph = \"octet\"\nplate_thickness = 0.1", "plates"),
        ("formula = \"x +\"", "column 4"),
        ("graph = \"octet\"\nformula = \"x\"", "found formula, graph"),
    ];
    for (text, word) in cases {
        let error = refuse(&FULL_RECIPE.replace("surface = \"schwarz_p\"", text));
        assert!(error.message.contains(word), "{text}: {}", error.message);
    }
}

#[test]
fn sizes_must_be_positive_and_finite() {
    for (key, line) in [("voxel_size = 0.2", 4), ("radius = 5", 6)] {
        let name = key.split(' ').next().unwrap();
        for bad in [
            "-1",
            "0",
            "nan",
            "inf",
            "-0.0",
            "\"-2mm\"",
            "\"nan mm\"",
            "\"5 parsec\"",
            "\"\"",
            "true",
        ] {
            let error = refuse(&SPHERE.replace(key, &format!("{name} = {bad}")));
            assert_eq!(line_of(&error), line, "{bad}: {error:?}");
            assert!(error.key.as_deref().unwrap().ends_with(name), "{error:?}");
            assert!(error.message.contains("expected"), "{bad}: {error}");
        }
    }
}

#[test]
fn tolerances_are_voxels_from_none_to_one() {
    let text = "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nbox = { size = [9, 9, 9], cell_size = 3 }\n[tiling]\ncell = \"p\"\ntolerance = 0.02\n[band]\nvoxel_size = 0.2\n";
    assert!(parse(text).is_ok());
    assert!(parse(&text.replace("0.02", "0")).is_ok());
    for bad in ["-0.01", "nan", "1.5", "inf", "\"fine\""] {
        let error = refuse(&text.replace("0.02", bad));
        assert_eq!(line_of(&error), 8, "{bad}: {error:?}");
        assert_eq!(error.key.as_deref(), Some("tiling.tolerance"));
        assert!(error.message.contains("between 0 and 1"), "{bad}: {error}");
    }
}

#[test]
fn rules_between_keys_are_checked_at_their_place() {
    let cases: &[(&str, &str, usize, &str)] = &[
        ("druse = 1", "druse = 2", 1, "recipe version 2"),
        (
            "cell = \"strut\"",
            "cell = \"strat\"",
            16,
            "no cell is named",
        ),
        (
            "volume_fraction = 0.3",
            "level = 0\nvolume_fraction = 0.3",
            11,
            "one of level",
        ),
        (
            "volume_fraction = 0.3",
            "volume_fraction = 1.3",
            10,
            "between 0 and 1",
        ),
        (
            "mesh = \"strut.stl\"",
            "mesh = \"strut.stl\"\nfile = \"a.cell\"",
            3,
            "exactly one source",
        ),
        ("solid = \"below\"", "solid = \"belwo\"", 11, "unknown word"),
        (
            "volume_fraction = 0.3\nsolid = \"below\"",
            "solid = \"sheet\"",
            10,
            "a sheet needs",
        ),
        (
            "vdb = \"bracket.vdb\"",
            "vdb = \"bracket.stl\"",
            34,
            "extension",
        ),
        ("fog = true", "cut = \"y=0\"", 36, "picture"),
        ("cut = \"x=1.5\"", "cut = \"w=1.5\"", 40, "as in \"x=0\""),
        ("size = \"640x480\"", "size = \"640\"", 39, "1000x800"),
        ("size = \"640x480\"", "size = [640, 4]", 39, "16 to 16384"),
        (
            "voxel_size = \"100um\"",
            "voxel_size = \"1vx\"",
            18,
            "voxels",
        ),
        (
            "dilate = \"3vx\"",
            "dilate = \"3vx\"\nerode = 1",
            27,
            "exactly one",
        ),
        ("iterations = 3", "iterations = 0", 26, "1 to 1000"),
        ("half_width = 4", "half_width = 1", 19, "1.5"),
        (
            "rotate = [0, 0, 90]",
            "vertices = [[0, 0, 0]]",
            7,
            "stands alone",
        ),
    ];
    for (from, to, line, words) in cases {
        assert!(FULL_RECIPE.contains(from), "{from}");
        let error = refuse(&FULL_RECIPE.replacen(from, to, 1));
        assert!(error.to_string().contains(words), "{to}: {error}");
        assert_eq!(line_of(&error), *line, "{to}: {error:?}");
    }
}

#[test]
fn a_recipe_without_a_solid_says_so() {
    let error = refuse("druse = 1\n[band]\nvoxel_size = 1\n");
    assert!(error.message.contains("makes no solid"));
    let error = refuse("druse = 1\n[band]\nvoxel_size = 1\n[[op]]\ndilate = 1\n");
    assert!(error.message.contains("nothing to dilate"));
    assert_eq!(line_of(&error), 4);
}

#[test]
fn overrides_replace_add_and_are_validated() {
    let set = |overrides: &[&str]| {
        let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
        Recipe::parse(FULL_RECIPE, &overrides)
    };
    let recipe = set(&[
        "op.3.dilate=0.2",
        "tiling.cell=plate",
        "unit=\"cm\"",
        "cell.plate.volume_fraction=0.4",
        "output.2.report=r.json",
        "op.2.gaussian.width=3",
    ])
    .unwrap();
    let s = recipe.sections();
    assert_eq!(
        s.op[3],
        Op::Dilate(Brief(Short::short(Size(Length::Bare(0.2)))))
    );
    assert_eq!(s.tiling.as_ref().unwrap().cells(), ["plate"]);
    assert_eq!(recipe.unit(), LengthUnit::Centimetre);
    assert_eq!(s.output.len(), 3);
    assert!(
        recipe
            .source()
            .text()
            .ends_with("# --set op.2.gaussian.width=3\n")
    );

    for (bad, words, hint) in [
        ("band.voxl_size=1", "unknown key", "voxel_size"),
        ("band.voxel_size=-1", "positive", ""),
        ("band.voxel_size", "no \"=\"", "KEY=VALUE"),
        ("op.17.dilate=1", "there is no 17", ""),
        ("op.x.dilate=1", "expected an index", ""),
        ("band.voxel_size.deep=1", "has no key", ""),
        ("tiling.cell=plat", "no cell is named", "plate"),
    ] {
        let error = set(&["unit=m", bad]).unwrap_err();
        assert_eq!(
            error.place,
            Some(Place::Override(bad.to_owned())),
            "{error:?}"
        );
        assert!(error.to_string().contains(words), "{bad}: {error}");
        assert!(error.hint.unwrap_or_default().contains(hint), "{bad}");
    }
}

#[test]
fn broken_toml_has_its_line() {
    let error = refuse("druse = 1\n[band\nvoxel_size = 1\n");
    assert_eq!(line_of(&error), 2);
    assert_eq!(error.fault, RecipeFault::Invalid);
}

#[test]
fn a_missing_recipe_is_missing() {
    let error = Recipe::read(std::path::Path::new("no/such.toml"), &[]).unwrap_err();
    assert_eq!(error.fault, RecipeFault::Missing);
}

#[test]
fn the_schema_knows_every_section() {
    let schema = schema();
    for key in [
        "druse", "unit", "cell", "scaffold", "tiling", "band", "op", "output",
    ] {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
    assert_eq!(schema["additionalProperties"], false);
    assert!(schema.to_string().contains("Edge of a voxel."));
}

proptest! {
    #[test]
    fn lengths_print_as_they_parse(v in 1e-6..1e6f64, n in 0usize..7) {
        let units = ["", "um", "mm", "cm", "m", "in", "vx"];
        let text = format!("{v}{}", units[n]);
        let length: Length = text.parse().unwrap();
        prop_assert_eq!(length.to_string(), text);
        let scale = Scale { unit: LengthUnit::Millimetre, voxel_size: 0.5 };
        let expected = v * [1.0, 1e-3, 1.0, 10.0, 1000.0, 25.4, 0.5][n];
        prop_assert!((length.resolve(scale) - expected).abs() <= 1e-12 * expected);
    }

    #[test]
    fn no_text_panics_the_reader(text in "[a-z0-9_=\\.\\[\\]\\{\\}\", \n-]{0,80}", set in ".{0,20}") {
        let _ = Recipe::parse(&text, std::slice::from_ref(&set));
        let _ = Recipe::parse(SPHERE, &[set]);
    }
}

#[test]
fn shipped_recipes_are_valid() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let mut count = 0;
    let mut folders = vec![root];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "toml")
                && !path.ends_with("blender_manifest.toml")
            {
                Recipe::read(&path, &[]).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
                count += 1;
            }
        }
    }
    assert!(count >= 2);
}

#[test]
fn voxels_that_openvdb_takes_for_nothing_are_refused() {
    let output = |unit: &str| format!("[[output]]\nvdb = \"a.vdb\"{unit}\n");
    let fine = SPHERE.replace("voxel_size = 0.2", "voxel_size = 0.005");
    let e = refuse(&(fine.clone() + &output("")));
    assert!(e.message.contains("5e-6 m") && line_of(&e) == 7, "{e:?}");
    assert!(parse(&(fine + &output("\nunit = \"mm\""))).is_ok());
    let e = refuse(&SPHERE.replace("voxel_size = 0.2", "voxel_size = 5e-6"));
    assert!(e.message.contains("5e-6 mm") && line_of(&e) == 4, "{e:?}");
}
