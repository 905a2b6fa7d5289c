//! USD as text: meshes and tets under transforms of every kind, with values that follow from the text.

use super::{failure, file};
use druse::frame::Vec3;
use druse::io::{ElementFile, FieldAt, PointCache, read_elements, read_mesh, read_scaffold};
use druse::mesh::check;

const CUBE: &str = "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0),\n\
    (0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)]\n\
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]\n\
    int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]";

fn layer(prims: &str) -> String {
    format!("#usda 1.0\n(\n    metersPerUnit = 0.01\n    upAxis = \"Z\"\n)\n{prims}\n")
}

fn mesh(properties: &str) -> String {
    format!("def Mesh \"cube\"\n{{\n{CUBE}\n{properties}\n}}")
}

/// Volume and least and greatest corner of a file of polygons.
fn facts(text: &str) -> (f64, Vec3, Vec3) {
    let directory = tempfile::tempdir().unwrap();
    let read =
        read_mesh(file(&directory, "a.usda", text)).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert!(check(&read.mesh).is_sound(), "{text}");
    let bounds = read.mesh.bounds();
    (read.mesh.volume(), bounds.min, bounds.max)
}

fn is(text: &str, volume: f64, min: [f64; 3], max: [f64; 3]) {
    let (v, low, high) = facts(text);
    let error =
        (v - volume).abs() + (low - Vec3::from(min)).norm() + (high - Vec3::from(max)).norm();
    assert!(error < 1e-6, "volume {v} of {low:?} to {high:?}\n{text}");
}

#[test]
fn transforms_place_a_cube() {
    let ops = |order: &str, values: &str| {
        layer(&mesh(&format!(
            "{values}\nuniform token[] xformOpOrder = [{order}]"
        )))
    };
    is(&layer(&mesh("")), 1.0, [0.0; 3], [1.0; 3]);
    let placed = "double3 xformOp:translate = (1, 2, 3)\nfloat3 xformOp:scale = (2, 3, 4)";
    let order = "\"xformOp:translate\", \"xformOp:scale\"";
    is(&ops(order, placed), 24.0, [1.0, 2.0, 3.0], [3.0, 5.0, 7.0]);
    // The first operation of the order is the outermost.
    let order = "\"xformOp:scale\", \"xformOp:translate\"";
    is(
        &ops(order, placed),
        24.0,
        [2.0, 6.0, 12.0],
        [4.0, 9.0, 16.0],
    );
    let turned = "float3 xformOp:rotateXYZ = (90, 90, 0)";
    // About x first: (x, y, z) to (x, -z, y), then about y: to (y, -z, -x).
    is(
        &ops("\"xformOp:rotateXYZ\"", turned),
        1.0,
        [0.0, -1.0, -1.0],
        [1.0, 0.0, 0.0],
    );
    let turned = "float3 xformOp:rotateYXZ = (90, 90, 0)";
    // About y first: (x, y, z) to (z, y, -x), then about x: to (z, x, y).
    is(
        &ops("\"xformOp:rotateYXZ\"", turned),
        1.0,
        [0.0; 3],
        [1.0; 3],
    );
    is(
        &ops("\"xformOp:rotateZ:a\"", "float xformOp:rotateZ:a = 90"),
        1.0,
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 1.0],
    );
    let orient = "quatf xformOp:orient = (0.70710678, 0, 0, 0.70710678)";
    let (v, low, high) = facts(&ops("\"xformOp:orient\"", orient));
    assert!(
        (v - 1.0).abs() < 1e-6 && (low - Vec3::new(-1.0, 0.0, 0.0)).norm() < 1e-6 && high.z > 0.999
    );
    let matrix =
        "matrix4d xformOp:transform = ( (0, 2, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1) )";
    // Rows are the images of the axes: x goes to (0, 2, 0), y to (-1, 0, 0).
    is(
        &ops("\"xformOp:transform\"", matrix),
        2.0,
        [4.0, 6.0, 7.0],
        [5.0, 8.0, 8.0],
    );
    let pivot = "double3 xformOp:translate:pivot = (1, 1, 0)\nfloat xformOp:rotateZ = 180";
    let order =
        "\"xformOp:translate:pivot\", \"xformOp:rotateZ\", \"!invert!xformOp:translate:pivot\"";
    is(&ops(order, pivot), 1.0, [1.0, 1.0, 0.0], [2.0, 2.0, 1.0]);
    // A mirror keeps the inside.
    is(
        &ops("\"xformOp:scale\"", "float3 xformOp:scale = (-1, 1, 1)"),
        1.0,
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 1.0],
    );
    let parent = |child: &str| {
        layer(&format!(
            "def Xform \"a\"\n{{\n double3 xformOp:translate = (10, 0, 0)\n \
             uniform token[] xformOpOrder = [\"xformOp:translate\"]\n {child}\n}}"
        ))
    };
    is(&parent(&mesh("")), 1.0, [10.0, 0.0, 0.0], [11.0, 1.0, 1.0]);
    let reset = mesh("uniform token[] xformOpOrder = [\"!resetXformStack!\"]");
    is(&parent(&reset), 1.0, [0.0; 3], [1.0; 3]);
}

#[test]
fn every_way_to_write_a_layer_is_read() {
    let plain = layer(&mesh("uniform token subdivisionScheme = \"none\""));
    is(&plain.replace('\n', "\r\n"), 1.0, [0.0; 3], [1.0; 3]);
    is(
        &plain.replace("(0, 1, 1)", "(0,1,1)"),
        1.0,
        [0.0; 3],
        [1.0; 3],
    );
    let rich = layer(&format!(
        "# a comment with {{ and \"\nclass \"_base\" {{ int a = 1 }}\nover \"b\" {{ def Mesh \"c\" {{ }} }}\n\
         def Scope \"looks\" {{ def Material \"m\" {{ token outputs:surface.connect = </looks/m/s.outputs:out> }} }}\n\
         def Mesh \"guide\" {{ uniform token purpose = \"guide\"\n{CUBE}\n}}\n\
         def \"x\" (\n  \"\"\"words on\n  two lines {{\"\"\"\n  kind = \"component\"\n  customData = {{ string s = \"}}\" }}\n\
           prepend apiSchemas = [\"MaterialBindingAPI\"]\n)\n{{\n  token visibility = \"inherited\"\n  \
         rel material:binding = </looks/m> ( bindMaterialAs = \"weakerThanDescendants\" )\n  \
         custom asset file = @a}}b.usd@\n  {}\n}}\n\
         def Mesh \"off\" ( active = false ) {{ }}\ndef Mesh \"unseen\" {{ token visibility = \"invisible\"\n{CUBE}\n}}",
        mesh("color3f[] primvars:displayColor = [(1, 0, 0)] ( interpolation = \"constant\" )")
    ));
    is(&rich, 1.0, [0.0; 3], [1.0; 3]);
    let left = mesh("uniform token orientation = \"leftHanded\"");
    let turned = left.replace(
        "0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5",
        "1, 3, 2, 0, 6, 7, 5, 4, 4, 5, 1, 0, 3, 7, 6, 2, 2, 6, 4, 0, 5, 7, 3, 1",
    );
    is(&layer(&turned), 1.0, [0.0; 3], [1.0; 3]);
    // Without a default the first sample counts.
    let sampled = plain
        .replace(
            "points = [(0, 0, 0)",
            "points.timeSamples = { 2: [(0, 0, 0)",
        )
        .replace(
            "(1, 1, 1)]",
            "(1, 1, 1)], 1.5: [(0, 0, 0), (2, 0, 0), (0, 2, 0), (2, 2, 0), (0, 0, 2), (2, 0, 2), \
                  (0, 2, 2), (2, 2, 2)], }",
        );
    is(&sampled, 8.0, [0.0; 3], [2.0; 3]);
}

const TETS: &str = "def TetMesh \"a\"\n{\n\
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (9, 9, 9)]\n\
    int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 4)]\n\
    int3[] surfaceFaceVertexIndices = [(0, 2, 1)]\n\
    vector3f[] velocities = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 0)]\n\
    float[] primvars:size = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6] ( interpolation = \"vertex\" )\n\
    float[] primvars:load = [7, 8] ( interpolation = \"uniform\" )\n\
    float[] primvars:odd = [7, 8] ( interpolation = \"faceVarying\" )\n\
    def GeomSubset \"inner\"\n{\n uniform token elementType = \"tetrahedron\"\n int[] indices = [1]\n}\n\
    float xformOp:rotateZ = 90\n uniform token[] xformOpOrder = [\"xformOp:rotateZ\"]\n}";

/// A layer of two tets with groups and fields.
pub fn tets() -> String {
    layer(TETS)
}

#[test]
fn tets_have_groups_and_fields() {
    let directory = tempfile::tempdir().unwrap();
    let read = read_scaffold(file(&directory, "a.usda", layer(TETS))).unwrap();
    let volume: f64 = read.scaffold.elements().map(|e| e.volume()).sum();
    // A corner of the unit cube and the regular tet in it.
    assert!((volume - (1.0 / 6.0 + 1.0 / 3.0)).abs() < 1e-7, "{volume}");
    assert_eq!((read.scaffold.len(), read.unused_nodes), (2, 1));
    let groups: Vec<(&str, &[u32])> = read
        .groups
        .iter()
        .map(|g| (&*g.name, &*g.elements))
        .collect();
    assert_eq!(groups, [("a", &[0, 1][..]), ("inner", &[1])]);
    let field = |name: &str| read.fields.iter().find(|f| f.name == name).unwrap();
    assert_eq!(field("size").values, [0.1, 0.2, 0.3, 0.4, 0.5]);
    assert_eq!(
        (field("load").at, &*field("load").values),
        (FieldAt::Cells, &[7.0, 8.0][..])
    );
    // Velocities turn with the mesh.
    let v = &field("velocities").values;
    assert!(
        v[0].abs() < 1e-7 && (v[1] - 1.0).abs() < 1e-7 && (v[13] - 2.0).abs() < 1e-7,
        "{v:?}"
    );
    assert!(read.fields.iter().all(|f| f.name != "odd"));
    assert!(
        read.notes.iter().any(|n| n.contains("0.01 m")),
        "{:?}",
        read.notes
    );
    // Two prims are one scaffold; faces that they share are shared by place only.
    let two = layer(&format!(
        "{TETS}\n{}",
        TETS.replace("\"a\"", "\"b\"").replace("= 90", "= -90")
    ));
    let read = read_scaffold(file(&directory, "b.usda", two)).unwrap();
    assert_eq!(read.scaffold.len(), 4);
    assert_eq!(read.fields.len(), 3);
    let surface = read_elements(file(&directory, "c.usda", layer(&mesh("")))).unwrap();
    assert!(matches!(surface, ElementFile::Surface(s) if s.surface.len() == 6));
    // Tets serve as a solid by their outer faces.
    let solid = read_mesh(file(&directory, "d.usda", layer(TETS))).unwrap();
    assert!((solid.mesh.volume() - volume).abs() < 1e-7);
}

#[test]
fn time_samples_are_points_that_move() {
    let directory = tempfile::tempdir().unwrap();
    let moving = TETS.replace(
        "float xformOp:rotateZ = 90",
        "float xformOp:rotateZ.timeSamples = { 1: 0, 3: 180 }",
    );
    let cache = PointCache::open(&file(&directory, "a.usda", layer(&moving))).unwrap();
    assert_eq!(
        (cache.samples(), cache.frame(0), cache.frame(1)),
        (2, 1.0, 3.0)
    );
    let points = cache.read(cache.sample_at(3.0).unwrap()).unwrap();
    assert!((points[1] - Vec3::new(-1.0, 0.0, 0.0)).norm() < 1e-7 && points.len() == 6);
    let missing = cache.sample_at(2.0).unwrap_err().to_string();
    assert!(missing.contains("frame 2"), "{missing}");
    let still = PointCache::open(&file(&directory, "b.usda", layer(TETS))).unwrap_err();
    assert!(still.to_string().contains("no time samples"), "{still}");
}

#[test]
fn faults_have_a_line_and_a_way_out() {
    let cases = [
        ("PXR-USDC\0\0".to_owned(), "a binary USD file", "usdcat"),
        ("solid".to_owned(), "another kind of file", "#usda 1.0"),
        (
            layer("def Mesh \"a\" ( references = @b.usd@ ) { }"),
            "line 6: found references",
            "usdcat --flatten",
        ),
        (
            layer("def Xform \"a\" {\n variantSet \"v\" = { \"x\" { } }\n}"),
            "line 7: found variantSet",
            "flat",
        ),
        (
            "#usda 1.0\n( subLayers = [ @a.usda@ ] )\n".to_owned(),
            "line 2: found subLayers",
            "flat",
        ),
        (layer("def Xform \"a\" { }"), "no meshes", "TetMesh or Mesh"),
        (
            layer("def Mesh \"a\" {\n\n"),
            "the end of the file",
            "a word",
        ),
        (
            layer("def Mesh \"a\" { string s = \"x"),
            "a string without an end",
            "quotes",
        ),
        (
            layer(&mesh("").replace("7, 5]", "8, 5]")),
            "line 11: found the number 8",
            "from 0 to 7",
        ),
        (
            layer(&mesh("").replace("7, 5]", "7]")),
            "23 corners of 6 elements",
            "24 corners",
        ),
        (
            layer(&mesh("").replace("(1, 1, 1)]", "(1, nan, 1)]")),
            "point 7",
            "finite",
        ),
        (
            layer(&mesh("").replace("(1, 1, 1)]", "(1, 1)]")),
            "23 coordinates",
            "three",
        ),
        (
            layer(&mesh(
                "float2 xformOp:scale = (1, 2)\nuniform token[] xformOpOrder = [\"xformOp:scale\"]",
            )),
            "xformOp:scale with 2 numbers",
            "UsdGeomXformable",
        ),
        (
            layer(&mesh("uniform token[] xformOpOrder = [\"xformOp:scale\"]")),
            "no value of xformOp:scale",
            "line 6",
        ),
    ];
    for (text, found, advice) in cases {
        let message = failure("a.usda", &text);
        assert!(message.contains(found), "{message}\n{text}");
        assert!(message.contains(advice), "{message}\n{text}");
    }
    let no_faces = "def Mesh \"a\" {\npoint3f[] points = [(0, 0, 0)]\nint[] faceVertexCounts = []\n\
        int[] faceVertexIndices = []\nfloat[] primvars:x = [1] ( interpolation = \"uniform\" )\n}";
    assert!(failure("a.usda", layer(no_faces)).contains("no triangles"));
    let deep = format!(
        "{}{}",
        "def Xform \"a\" { ".repeat(200_000),
        "}".repeat(200_000)
    );
    assert!(failure("a.usda", layer(&deep)).contains("hundred"));
    let lists = layer(&format!(
        "def Mesh \"a\" {{ int[] x = {} }}",
        "[".repeat(200_000)
    ));
    assert!(failure("a.usda", lists).contains("hundred"));
}
