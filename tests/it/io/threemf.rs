//! 3MF: parts, beams, types, extensions, encodings, placements.

use druse::io::{ErrorClass, SolidFile, read_mesh, read_solid};
use std::io::Write;
use std::path::{Path, PathBuf};

mod beams;

fn stored(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/threemf");
    folder.join(name)
}

const RELATIONS: &str = r#"<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/3dmodel.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>"#;
const CORE: &str = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
const PRODUCTION: &str = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06";

/// Reads an archive of some parts.
fn parts(parts: &[(&str, &[u8])]) -> Result<SolidFile, String> {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("part.3mf");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    for (name, content) in parts {
        zip.start_file(*name, options).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap();
    read_solid(&path).map_err(|e| {
        assert_eq!(e.class(), ErrorClass::Data);
        e.to_string()
    })
}

/// Reads an archive of one model.
fn model(text: &str) -> Result<SolidFile, String> {
    parts(&[
        ("_rels/.rels", RELATIONS.as_bytes()),
        ("3D/3dmodel.model", text.as_bytes()),
    ])
}

/// A cube of edge 10 whose first corner is at (x, 0, 0).
fn cube(x: f64) -> String {
    let corner = |n: usize| {
        let [i, j, k] = [0, 1, 2].map(|a| 10.0 * (n >> a & 1) as f64);
        format!("<vertex x=\"{}\" y=\"{j}\" z=\"{k}\"/>", x + i)
    };
    let faces = [
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    let face = |[a, b, c]: [u8; 3]| format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>");
    format!(
        "<mesh><vertices>{}</vertices><triangles>{}</triangles></mesh>",
        (0..8).map(corner).collect::<String>(),
        faces.map(face).concat()
    )
}

fn document(attributes: &str, resources: &str, build: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model unit=\"millimeter\" xmlns=\"{CORE}\" {attributes}>\
         <resources>{resources}</resources><build>{build}</build></model>"
    )
}

/// One cube, built once with these attributes of its item.
fn one(attributes: &str, item: &str) -> String {
    let object = format!("<object id=\"1\" type=\"model\">{}</object>", cube(0.0));
    document(
        attributes,
        &object,
        &format!("<item objectid=\"1\" {item}/>"),
    )
}

fn refused(text: &str, words: &[&str]) {
    let error = model(text).unwrap_err();
    for word in words {
        assert!(error.contains(word), "{word:?} is not in {error}");
    }
}

#[test]
fn parts_of_the_production_extension_are_found_by_path() {
    let file = read_mesh(stored("production.3mf")).unwrap();
    assert!((file.mesh.volume() - 1000.0).abs() < 1e-9);
    let bounds = file.mesh.bounds();
    assert_eq!(<[f64; 3]>::from(bounds.min), [5.0, 0.0, 0.0]);
    assert_eq!(<[f64; 3]>::from(bounds.max), [15.0, 10.0, 10.0]);
    assert!(file.warnings.is_empty());
    // Items with paths, under another prefix, in another case, with an escaped blank; each part has its own
    // numbers.
    let spaces = format!("xmlns:prod=\"{PRODUCTION}\" requiredextensions=\"prod\"");
    let own = format!("<object id=\"7\" prod:UUID=\"1\">{}</object>", cube(0.0));
    let items = "<item objectid=\"7\" prod:UUID=\"2\"/><item objectid=\"7\" prod:path=\"/3d/Objects/Part%20B.model\"/>";
    let root = document(&spaces, &own, items);
    let other = document("", &format!("<object id=\"7\">{}</object>", cube(20.0)), "");
    let two = |other: &str, root: &str| {
        parts(&[
            ("3D/3dmodel.model", root.as_bytes()),
            ("3D/Objects/Part B.model", other.as_bytes()),
        ])
    };
    let solid = two(&other, &root).unwrap();
    assert!((solid.file.mesh.volume() - 2000.0).abs() < 1e-9);
    assert_eq!(solid.bounds().max.x, 30.0);
    // A part in another unit is scaled, with a note.
    let inches = other.replace("millimeter", "centimeter");
    let solid = two(&inches, &root).unwrap();
    assert_eq!(solid.bounds().max.x, 300.0);
    assert!(
        solid.file.warnings[0].contains("centimeter"),
        "{:?}",
        solid.file.warnings
    );
    // The note has the unit of the part that refers to it, here not that of the root.
    let held = "<components><component objectid=\"7\" prod:path=\"/3D/C.model\"/></components>";
    let middle = document(&spaces, &format!("<object id=\"7\">{held}</object>"), "");
    let middle = middle.replace("millimeter", "meter");
    let archive = [
        ("3D/3dmodel.model", root.as_bytes()),
        ("3D/Objects/Part B.model", middle.as_bytes()),
        ("3D/C.model", inches.as_bytes()),
    ];
    let notes = parts(&archive).unwrap().file.warnings;
    assert!(
        notes
            .iter()
            .any(|n| n.contains("C.model is in centimeter and was scaled to meter")),
        "{notes:?}"
    );
    // A path without its namespace is none, and a part that is missing is named.
    let missing = root.replace("Part%20B", "C");
    let error = two(&other, &missing).unwrap_err();
    assert!(
        error.contains("a reference to the part \"/3d/Objects/C.model\""),
        "{error}"
    );
    // Parts that hold each other.
    let loops = "<object id=\"7\"><components><component objectid=\"7\" prod:path=\"/3D/3dmodel.model\"/></components></object>".to_owned();
    let other = document(&spaces, &loops, "");
    let loops = loops.replace("/3D/3dmodel.model", "/3D/Objects/Part B.model");
    let root = document(&spaces, &loops, "<item objectid=\"7\"/>");
    let error = two(&other, &root).unwrap_err();
    assert!(error.contains("which is a component of itself"), "{error}");
}

#[test]
fn what_is_not_printed_is_left_out_and_counted() {
    let file = read_mesh(stored("t07_support.3mf")).unwrap();
    assert!((file.mesh.volume() - 1000.0).abs() < 1e-9);
    assert_eq!(file.mesh.bounds().max.x, 10.0);
    assert_eq!(
        file.warnings,
        ["1 object of type support is left out: object 9"]
    );
    let objects: Vec<String> = ["model", "solidsupport", "surface", "other", "model"]
        .iter()
        .enumerate()
        .map(|(n, kind)| {
            let mesh = cube(20.0 * n as f64);
            format!("<object id=\"{}\" type=\"{kind}\">{mesh}</object>", n + 1)
        })
        .collect();
    let items: Vec<String> = (1..=4)
        .map(|n| format!("<item objectid=\"{n}\"/>"))
        .collect();
    let (objects, items) = (objects.concat(), items.concat());
    let build = format!("{items}<item objectid=\"5\" printable=\"0\"/><item objectid=\"2\"/>");
    let solid = model(&document("", &objects, &build)).unwrap();
    assert!((solid.file.mesh.volume() - 1000.0).abs() < 1e-9);
    assert_eq!(
        solid.file.warnings,
        [
            "1 item not printable, left out: object 5",
            "1 object of type other is left out: object 4",
            "1 object of type surface is left out: object 3",
            "2 objects of type solidsupport are left out: objects 2, 2",
        ]
    );
    let none = document(
        "",
        &objects,
        "<item objectid=\"2\"/><item objectid=\"5\" printable=\"0\"/>",
    );
    refused(
        &none,
        &[
            "nothing to print",
            "type solidsupport (object 2)",
            "not printable (object 5)",
        ],
    );
    // Without items every object counts once, however often another one holds it.
    let held = format!("<object id=\"1\">{}</object>", cube(0.0))
        + "<object id=\"2\"><components><component objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 0 5 0\"/></components></object>";
    let solid = model(&document("", &held, "")).unwrap();
    assert!((solid.file.mesh.volume() - 1000.0).abs() < 1e-9);
    assert_eq!(solid.bounds().max.y, 15.0);
    assert_eq!(
        solid.file.warnings,
        ["no item to build; every object is taken"]
    );
}

#[test]
fn modifiers_of_slicers_are_no_part_of_the_solid() {
    // Two cubes as one mesh, as PrusaSlicer writes them, and its list of triangle roles.
    let two = cube(0.0).replace(
        "</vertices>",
        "<vertex x=\"20\" y=\"0\" z=\"0\"/><vertex x=\"21\" y=\"0\" z=\"0\"/>\
        <vertex x=\"20\" y=\"1\" z=\"0\"/><vertex x=\"20\" y=\"0\" z=\"1\"/></vertices>",
    );
    let tet = [[8, 10, 9], [8, 9, 11], [9, 10, 11], [8, 11, 10]];
    let tet = tet.map(|[a, b, c]| format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>"));
    let two = two.replace("</triangles>", &format!("{}</triangles>", tet.concat()));
    let root = document(
        "",
        &format!("<object id=\"1\">{two}</object>"),
        "<item objectid=\"1\"/>",
    );
    let read = |kind: &str, last: usize| {
        let list = format!(
            "<config><object id=\"1\"><volume firstid=\"0\" lastid=\"11\"/><volume firstid=\"12\" lastid=\"{last}\">\
             <metadata type=\"volume\" key=\"volume_type\" value=\"{kind}\"/></volume></object></config>"
        );
        parts(&[
            ("3D/3dmodel.model", root.as_bytes()),
            ("Metadata/Slic3r_PE_model.config", list.as_bytes()),
        ])
    };
    let whole = read("ModelPart", 15).unwrap();
    assert!((whole.file.mesh.volume() - 1000.0 - 1.0 / 6.0).abs() < 1e-9);
    let part = read("ParameterModifier", 15).unwrap();
    assert!((part.file.mesh.volume() - 1000.0).abs() < 1e-9);
    let note = "4 triangles of object 1 are a ParameterModifier of the slicer and left out";
    assert_eq!(part.file.warnings, [note]);
    let error = read("NegativeVolume", 15).unwrap_err();
    assert!(
        error.contains("a negative volume in object 1 (triangles 12 to 15)"),
        "{error}"
    );
    let error = read("SupportBlocker", 16).unwrap_err();
    assert!(error.contains("expected triangles from 0 to 15"), "{error}");
}

#[test]
fn models_in_utf_16_are_read_and_other_encodings_named() {
    let text = one("", "").replace("UTF-8", "UTF-16");
    for big in [false, true] {
        for marked in [false, true] {
            let mut bytes = Vec::new();
            let mark = marked.then_some(0xfeff);
            for unit in mark.into_iter().chain(text.encode_utf16()) {
                bytes.extend(if big {
                    unit.to_be_bytes()
                } else {
                    unit.to_le_bytes()
                });
            }
            let solid = parts(&[("3D/3dmodel.model", &bytes)]).unwrap();
            assert!(
                (solid.file.mesh.volume() - 1000.0).abs() < 1e-9,
                "{big} {marked}"
            );
        }
    }
    let marked = format!("\u{feff}{}", one("", ""));
    assert!((model(&marked).unwrap().file.mesh.volume() - 1000.0).abs() < 1e-9);
    let latin = one("", "").replace("UTF-8", "ISO-8859-1");
    refused(
        &latin,
        &["the encoding \"ISO-8859-1\"", "expected UTF-8 or UTF-16"],
    );
}

#[test]
fn required_extensions_are_read_or_refused_by_name() {
    let family = "http://schemas.microsoft.com/3dmanufacturing";
    let young = "http://schemas.3mf.io/3dmanufacturing";
    for (namespace, word) in [
        (
            format!("{family}/securecontent/2019/04"),
            "secure content (encrypted parts)",
        ),
        (
            format!("{young}/booleanoperations/2023/07"),
            "boolean operations",
        ),
        (format!("{young}/displacement/2023/10"), "displacement"),
        (format!("{young}/volumetric/2022/01"), "volumetric content"),
        (format!("{young}/implicit/2023/12"), "implicit shapes"),
        ("http://example.com/own".into(), "http://example.com/own"),
    ] {
        let required = one(
            &format!("xmlns:z=\"{namespace}\" requiredextensions=\"z\""),
            "",
        );
        refused(
            &required,
            &[
                "a model that requires",
                word,
                "expected the supported extensions",
            ],
        );
        // One that is not required may be passed over.
        assert!(model(&one(&format!("xmlns:z=\"{namespace}\""), "")).is_ok());
    }
    let known = format!(
        "xmlns:m=\"{family}/material/2015/02\" xmlns:t=\"{family}/trianglesets/2021/07\" xmlns:s=\"{family}/slice/2015/07\" \
         xmlns:pa=\"{family}/production/alternatives/2021/04\" xmlns:p=\"{PRODUCTION}\" requiredextensions=\"m t  s pa p\""
    );
    assert!((model(&one(&known, "")).unwrap().file.mesh.volume() - 1000.0).abs() < 1e-9);
    refused(
        &one("requiredextensions=\"nix\"", ""),
        &["the required extension \"nix\" without a namespace"],
    );
    // Shapes that are nothing which is read.
    let boolean = format!("xmlns:bo=\"{young}/booleanoperations/2023/07\"");
    let shape =
        "<object id=\"1\"><bo:booleanshape objectid=\"2\" operation=\"difference\"/></object>";
    refused(
        &document(&boolean, shape, "<item objectid=\"1\"/>"),
        &["object 1, whose shape is made of <booleanshape> of boolean operations"],
    );
    let slices = format!("xmlns:s=\"{family}/slice/2015/07\"");
    let sliced = "<object id=\"1\" s:slicestackid=\"3\"/>";
    refused(
        &document(&slices, sliced, "<item objectid=\"1\"/>"),
        &["object 1, whose shape is made of slices"],
    );
    let coarse = format!(
        "<object id=\"1\" s:slicestackid=\"3\" s:meshresolution=\"lowres\">{}</object>",
        cube(0.0)
    );
    let solid = model(&document(&slices, &coarse, "<item objectid=\"1\"/>")).unwrap();
    assert_eq!(
        solid.file.warnings,
        ["the mesh of object 1 is coarse, and its slices are not read"]
    );
}

#[test]
fn crafted_models_of_many_attributes_and_levels_are_read_or_refused() {
    // Comparing each name with all before it would take minutes.
    let repeated =
        |word: &dyn Fn(i32) -> String| (0..60_000).map(word).collect::<Vec<_>>().concat();
    let many = repeated(&|n| format!("a{n}=\"\" "));
    let solid = model(&one("", &many)).unwrap();
    assert!((solid.file.mesh.volume() - 1000.0).abs() < 1e-9);
    let twice = format!("{many} a7=\"\"");
    refused(
        &one("", &twice),
        &["attributes that fail", "well-formed XML"],
    );
    let spaces = repeated(&|n| format!("xmlns:p{n}=\"u\" "));
    refused(&one(&spaces, ""), &["XML that fails", "well-formed XML"]);
    let deep = format!("{}{}", "<a>".repeat(70_000), "</a>".repeat(70_000));
    let text = one("", "").replace("<build>", &format!("{deep}<build>"));
    refused(&text, &["nested more than 64 deep"]);
}

#[test]
fn placements_turn_mirror_and_are_never_flat() {
    let mirrored = model(&one("", "transform=\"-1 0 0 0 2 0 0 0 1 3 0 0\"")).unwrap();
    assert!(
        (mirrored.file.mesh.volume() - 2000.0).abs() < 1e-9,
        "mirrored solids keep their sign"
    );
    assert_eq!(
        (mirrored.bounds().min.x, mirrored.bounds().max.x),
        (-7.0, 3.0)
    );
    for flat in [
        "0 0 0 0 0 0 0 0 0 0 0 0",
        "1 0 0 0 1 0 1 1 0 0 0 0",
        "1 0 0 0 1 0 0 0 1e-12 0 0 0",
    ] {
        let text = one("", &format!("transform=\"{flat}\""));
        let error = model(&text).unwrap_err();
        assert!(error.contains("which is singular"), "{error}");
        assert!(
            error.contains("byte") && error.contains("3D/3dmodel.model"),
            "{error}"
        );
    }
    for bad in [
        "1 0 0 0 1 0 0 0 1 0 0",
        "1 0 0 0 1 0 0 0 1 0 0 0 x",
        "1 0 0 0 1 0 0 0 inf 0 0 0",
    ] {
        refused(
            &one("", &format!("transform=\"{bad}\"")),
            &["expected twelve finite numbers"],
        );
    }
    let twice = format!(
        "<object id=\"1\">{0}</object><object id=\"1\">{0}</object>",
        cube(0.0)
    );
    refused(
        &document("", &twice, "<item objectid=\"1\"/>"),
        &["a second object 1"],
    );
    refused(
        "<html xmlns=\"http://www.w3.org/1999/xhtml\"></html>",
        &["the element \"html\"", "<model> of 3MF"],
    );
}
