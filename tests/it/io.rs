//! Laws of `io`: what is written reads back; errors say where; outputs appear whole or not at all.

pub mod cubes;
mod legacy;
mod limits;
mod meshes;
mod stream;
mod tables;
mod threemf;
pub mod usda;

use druse::frame::{LengthUnit, Vec3};
use druse::io::atomic::{AtomicFile, StagedPath, write_bytes};
use druse::io::{ErrorClass, MeshFile, Place, ReadError, WriteError, read_mesh, write_mesh};
use druse::mesh::{TriMesh, check};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A ball off the origin with coordinates that have many digits.
fn ball() -> TriMesh {
    TriMesh::ball(Vec3::new(0.1, -2.0 / 3.0, 1e-3), 10.0, 3)
}

fn single(mesh: &TriMesh) -> TriMesh {
    mesh.mapped(|p| p.map(|c| f64::from(c as f32)))
}

fn file(directory: &TempDir, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = directory.path().join(name);
    fs::write(&path, content).unwrap();
    path
}

fn read(name: &str, content: impl AsRef<[u8]>) -> Result<MeshFile, ReadError> {
    let directory = tempfile::tempdir().unwrap();
    read_mesh(file(&directory, name, content))
}

/// The message without the directory, and the class.
fn failure(name: &str, content: impl AsRef<[u8]>) -> String {
    let e = read(name, content).unwrap_err();
    assert_eq!(e.class(), ErrorClass::Data);
    e.to_string()
        .rsplit_once(&format!("/{name}: "))
        .unwrap()
        .1
        .to_owned()
}

/// Names in a directory, sorted.
fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn every_format_reads_back_what_was_written() {
    let directory = tempfile::tempdir().unwrap();
    for (name, exact) in [
        ("a.stl", false),
        ("a.PLY", false),
        ("a.obj", true),
        ("a.3mf", false),
    ] {
        for unit in [
            LengthUnit::Millimetre,
            LengthUnit::Metre,
            LengthUnit::Micrometre,
        ] {
            let path = directory.path().join(name);
            let size = write_mesh(&path, &ball(), unit).unwrap();
            assert_eq!(size, fs::metadata(&path).unwrap().len());
            let back = read_mesh(&path).unwrap();
            let expected = if exact { ball() } else { single(&ball()) };
            let found = if exact {
                back.mesh.clone()
            } else {
                single(&back.mesh)
            };
            assert!(found.iter_corners().eq(expected.iter_corners()), "{name}");
            assert_eq!((back.unit, back.warnings.len()), (Some(unit), 0));
            assert!(check(&back.mesh).is_sound());
        }
    }
    assert_eq!(
        names(directory.path()),
        ["a.3mf", "a.PLY", "a.obj", "a.stl"]
    );
}

#[test]
fn extreme_numbers_survive() {
    let v = |x, y, z| Vec3::new(x, y, z);
    let vertices = vec![
        v(1e-300, -0.0, 9e17),
        v(f64::MIN_POSITIVE, 0.1 + 0.2, 1.0),
        v(3.0, 4.0, -1e-17),
    ];
    let mesh = TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.obj");
    write_mesh(&path, &mesh, LengthUnit::Inch).unwrap();
    assert_eq!(read_mesh(&path).unwrap().mesh, mesh);
}

#[test]
fn a_binary_file_that_begins_with_solid_is_binary() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.stl");
    write_mesh(&path, &ball(), LengthUnit::Millimetre).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    assert!(!bytes.starts_with(b"solid"));
    bytes[..11].copy_from_slice(b"solid facet");
    assert_eq!(read("x.stl", &bytes).unwrap().mesh.triangles().len(), 512);
    bytes.extend(b"more");
    assert_eq!(
        read("x.stl", &bytes).unwrap().warnings,
        ["4 bytes after the last triangle; ignored"]
    );
}

const TEXT_STL: &str = "solid one\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   VERTEX 1e0 0 0\n   vertex 0 1. +0\n  endloop\n endfacet\nendsolid one\n";

#[test]
fn text_stl_is_read_and_its_faults_named_by_line() {
    let one = read("x.stl", TEXT_STL).unwrap().mesh;
    assert_eq!((one.area(), one.vertices().len()), (0.5, 3));
    // Windows line ends, and two solids in one file.
    let two = TEXT_STL.replace('\n', "\r\n") + TEXT_STL;
    assert_eq!(read("x.stl", two).unwrap().mesh.triangles().len(), 2);
    assert_eq!(
        failure("x.stl", TEXT_STL.replace("1e0", "one")),
        "line 5: found \"   VERTEX one 0 0\"; expected \"vertex\" and three finite numbers below 1e18"
    );
    assert!(failure("x.stl", TEXT_STL.replace("1e0", "nan")).starts_with("line 5: "));
    assert!(
        failure("x.stl", TEXT_STL.replace("   vertex 0 1. +0\n", ""))
            .starts_with("line 6: found 2 vertices")
    );
    let cut = &TEXT_STL[..TEXT_STL.find("  endloop").unwrap()];
    assert!(failure("x.stl", cut).contains("truncated"));
}

#[test]
fn obj_statements_of_every_kind_are_understood() {
    // An L of six corners, concave at the fifth; backward numbers, slashes, a continued line.
    let text = "# unit=in\nmtllib none\no l\nv 0 0 0 1\nv 2 0 0 0.5 0.5 0.5\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nvt 0 0\nvn 0 0 1\ng part\nusemtl no\ns off\nf -6/1/1 2//1 3/1 \\\n 4 5 6\nl 1 2\n";
    let l = read("x.obj", text).unwrap();
    assert_eq!(
        (l.mesh.area(), l.mesh.triangles().len(), l.unit),
        (3.0, 4, Some(LengthUnit::Inch))
    );
    assert!((0..4).all(|t| {
        let [a, b, c] = l.mesh.corners(t);
        (b - a).cross(&(c - a)).z > 0.0
    }));
    // From any first corner.
    for turn in 0..6 {
        let corners: Vec<String> = (0..6).map(|i| ((i + turn) % 6 + 1).to_string()).collect();
        let turned = text.replace(
            "f -6/1/1 2//1 3/1 \\\n 4 5 6",
            &format!("f {}", corners.join(" ")),
        );
        assert_eq!(
            read("x.obj", turned).unwrap().mesh.area(),
            3.0,
            "turn {turn}"
        );
    }
    assert_eq!(
        failure("x.obj", text.replace("4 5 6", "4 5 7")),
        "line 16: found vertex number 7; expected a number of a vertex in the file"
    );
    assert!(failure("x.obj", text.replace("-6/", "-7/")).starts_with("line 16: found \"-7/1/1\""));
    assert!(failure("x.obj", text.replace("v 1 2 0", "v 1 2")).starts_with("line 8: "));
    assert!(
        failure("x.obj", text.replace("g part", "nonsense"))
            .starts_with("line 12: found \"nonsense\"")
    );
    assert!(failure("x.obj", "v 0 0 0\n").contains("found no triangles"));
}

/// A square as PLY in each encoding, with properties and elements that say nothing to us.
fn ply(format: &str) -> Vec<u8> {
    let mut out = format!(
        "ply\nformat {format} 1.0\ncomment unit=m\nelement note 2\nproperty list uchar short what\n\
         element vertex 4\nproperty uchar red\nproperty double x\nproperty float y\nproperty short z\n\
         element face 1\nproperty float quality\nproperty list uint ushort vertex_index\nend_header\n"
    )
    .into_bytes();
    let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)];
    if format == "ascii" {
        out.extend(b"0\n2 7 8\n");
        for (x, y) in square {
            out.extend(format!("255 {x} {y} 3\n").bytes());
        }
        out.extend(b"0.5 4 0 1 2 3");
        return out;
    }
    let big = format.ends_with("big_endian");
    let mut push = |bytes: &[u8]| {
        let mut b = bytes.to_vec();
        if big {
            b.reverse();
        }
        out.extend(b);
    };
    push(&[0]);
    push(&[2]);
    for n in [7i16, 8] {
        push(&n.to_le_bytes());
    }
    for (x, y) in square {
        push(&[255]);
        push(&f64::to_le_bytes(x));
        push(&(y as f32).to_le_bytes());
        push(&3i16.to_le_bytes());
    }
    push(&0.5f32.to_le_bytes());
    push(&4u32.to_le_bytes());
    for n in 0..4u16 {
        push(&n.to_le_bytes());
    }
    out
}

#[test]
fn ply_is_read_in_all_three_encodings() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let square = read("x.ply", ply(format)).unwrap();
        assert_eq!(
            (square.mesh.area(), square.unit),
            (4.0, Some(LengthUnit::Metre)),
            "{format}"
        );
        assert_eq!(square.mesh.bounds().min, Vec3::new(0.0, 0.0, 3.0));
        let cut = ply(format);
        assert!(
            failure("x.ply", &cut[..cut.len() - 2]).contains("expected"),
            "{format}"
        );
    }
    let text = String::from_utf8(ply("ascii")).unwrap();
    assert_eq!(
        failure("x.ply", text.replace("255 2 0 3", "255 2 zero 3")),
        "line 18, vertex 2: found \"zero\"; expected a number"
    );
    assert_eq!(
        failure("x.ply", text.replace("4 0 1 2 3", "4 0 1 2 9")),
        "face 1: found vertex number 9, counted from 0; expected one of the 4 vertices of the file"
    );
    // A claim that the file cannot hold costs no memory.
    let giant = text.replace("element vertex 4", "element vertex 4000000000");
    assert!(failure("x.ply", giant).contains("a claim of 4000000000 vertex"));
    assert!(
        failure(
            "x.ply",
            text.replace("property short z", "property short w")
        )
        .contains("no property z of vertex")
    );
    assert!(
        failure("x.ply", text.replace("property float y", "property real y"))
            .starts_with("line 9: ")
    );
}

/// A 3MF of the given model, written by the zip crate itself.
fn zipped(model: &str) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    zip.start_file("3D/3dmodel.model", options).unwrap();
    zip.write_all(model.as_bytes()).unwrap();
    zip.finish().unwrap().into_inner()
}

const MODEL: &str = r#"<?xml version="1.0"?><model unit="inch"><resources>
<object id="3"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/></vertices>
<triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="3" v3="2"/><triangle v1="1" v2="2" v3="3"/></triangles></mesh></object>
<object id="7"><components><component objectid="3" transform="-2 0 0 0 1 0 0 0 1 5 0 0"/><component objectid="3"/></components></object>
</resources><build><item objectid="7" transform="1 0 0 0 1 0 0 0 1 0 0 10"/></build></model>"#;

#[test]
fn components_of_3mf_are_placed_and_mirrors_keep_their_inside() {
    let two = read("x.3mf", zipped(MODEL)).unwrap();
    assert_eq!(two.unit, Some(LengthUnit::Inch));
    let sixth = 1.0 / 6.0;
    assert!((two.mesh.volume() - 3.0 * sixth).abs() < 1e-15);
    let b = two.mesh.bounds();
    assert_eq!(
        (b.min, b.max),
        (Vec3::new(0., 0., 10.), Vec3::new(5., 1., 11.))
    );
    assert!(check(&two.mesh).is_sound());

    let fails = |from: &str, to: &str| failure("x.3mf", zipped(&MODEL.replace(from, to)));
    assert!(
        fails("v3=\"3\"", "v3=\"4\"")
            .contains("found triangle 2 of object 3 with vertices [0, 1, 4]")
    );
    assert!(fails("inch", "furlong").contains("unit=\"furlong\""));
    assert!(fails("y=\"1\"", "y=\"one\"").contains("y=\"one\""));
    assert!(fails("objectid=\"3\"/>", "objectid=\"7\"/>").contains("is a component of itself"));
    assert!(
        fails(
            "objectid=\"3\"/>",
            "objectid=\"3\" p:path=\"/3D/other.model\"/>"
        )
        .contains("production extension's namespace")
    );
    assert!(fails("</model>", "").contains("found the end of the model"));
    let whole = zipped(MODEL);
    assert!(failure("x.3mf", &whole[..whole.len() / 2]).contains("truncated"));
}

#[test]
fn errors_name_the_file_the_fault_and_the_way_out() {
    let e = read_mesh("/nowhere/part.stl").unwrap_err();
    assert_eq!(
        (e.class(), e.class().exit_code()),
        (ErrorClass::Missing, 66)
    );
    assert_eq!(
        e.to_string(),
        "/nowhere/part.stl: found no such file; expected an existing file"
    );
    let directory = tempfile::tempdir().unwrap();
    assert!(
        read_mesh(directory.path())
            .unwrap_err()
            .to_string()
            .contains("found a directory")
    );

    assert_eq!(
        failure("x.step", "ISO-10303-21;"),
        "found the extension .step; expected one of .stl, .ply, .obj, .3mf, .off, .vtp, .dlfl, .crystal, .msh, \
         .vtu, .vtk, .inp, .bdf, .nas, .mesh, .meshb, .unv, .usda\n  hint: its content is a STEP file: name it *.step"
    );
    assert_eq!(
        failure("x.ply", TEXT_STL),
        "found a text STL file; expected the content of a .ply file\n  hint: if the content is right, name the file *.stl"
    );
    assert!(failure("x.stl", ply("ascii")).contains("found a PLY file"));
    assert!(failure("x.obj", zipped("")).contains("found a zip archive"));
    assert!(failure("x", TEXT_STL).contains("found no extension"));
    assert!(failure("x.stl", "").contains("truncated"));
    assert!(failure("x.stl", b"\x1f\x8b\x08").contains("found a compressed file"));
    assert!(failure("x.obj", b"\x89PNG\r\n").contains("found a picture"));

    let path = directory.path().join("ball.stl");
    write_mesh(&path, &ball(), LengthUnit::Millimetre).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes.truncate(1000);
    let e = read("x.stl", &bytes).unwrap_err();
    assert_eq!(e.place(), Place::Byte(84));
    assert!(
        e.to_string()
            .contains("a claim of 512 triangles with 916 bytes left; expected at most 18"),
        "{e}"
    );
    bytes = fs::read(&path).unwrap();
    bytes[84 + 50 * 7 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(
        failure("x.stl", &bytes),
        "triangle 8: found the coordinate NaN; expected a finite number below 1e18"
    );
}

#[test]
fn outputs_appear_whole_or_not_at_all() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("part.stl");
    // Dropped: nothing. Dropped over an old file: the old file.
    for old in [None, Some("old")] {
        if let Some(old) = old {
            fs::write(&path, old).unwrap();
        }
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![1; 100_000]).unwrap();
        file.flush().unwrap();
        let staged = StagedPath::create(&path).unwrap();
        fs::write(staged.path(), "half").unwrap();
        assert_eq!(
            names(directory.path()).len(),
            2 + usize::from(old.is_some())
        );
        drop((file, staged));
        assert_eq!(fs::read_to_string(&path).ok().as_deref(), old);
        assert_eq!(names(directory.path()).len(), usize::from(old.is_some()));
    }
    let staged = StagedPath::create(&path).unwrap();
    assert_eq!(staged.path().extension().unwrap(), "stl");
    fs::write(staged.path(), "new").unwrap();
    assert_eq!(staged.commit().unwrap(), 3);
    assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    assert_eq!(names(directory.path()), ["part.stl"]);
}

#[test]
fn links_are_followed_and_modes_kept() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    fs::write(at("target"), "old").unwrap();
    fs::set_permissions(at("target"), fs::Permissions::from_mode(0o640)).unwrap();
    symlink("target", at("link")).unwrap();
    symlink("absent", at("dangling")).unwrap();
    write_bytes(at("link"), b"new").unwrap();
    write_bytes(at("dangling"), b"made").unwrap();
    assert_eq!(fs::read(at("target")).unwrap(), b"new");
    assert_eq!(fs::read(at("absent")).unwrap(), b"made");
    assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
    assert_eq!(
        fs::metadata(at("target")).unwrap().permissions().mode() & 0o777,
        0o640
    );
}

#[test]
fn places_that_cannot_be_written_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let create = |p: &Path| write_mesh(p, &ball(), LengthUnit::Millimetre).unwrap_err();
    let e = create(&directory.path().join("absent/part.stl"));
    assert_eq!(
        (
            e.class().exit_code(),
            e.to_string().contains("does not exist")
        ),
        (73, true)
    );
    fs::create_dir(directory.path().join("x.stl")).unwrap();
    assert!(
        create(&directory.path().join("x.stl"))
            .to_string()
            .contains("it is a directory")
    );
    let e = create(&directory.path().join("part.step"));
    assert!(
        e.to_string()
            .contains("found the extension .step; expected one of .stl, .ply, .obj, .3mf")
    );
    assert_eq!(names(directory.path()), ["x.stl"]);
}

#[test]
fn a_full_disk_is_an_error_with_path_and_bytes() {
    // The device is always full; a link gives it a name with an extension.
    let directory = tempfile::tempdir().unwrap();
    for name in ["full.stl", "full.ply", "full.obj"] {
        let path = directory.path().join(name);
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let e = write_mesh(&path, &ball(), LengthUnit::Millimetre).unwrap_err();
        let WriteError::Io { error, .. } = &e else {
            panic!("{e}")
        };
        assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
        assert_eq!(e.class().exit_code(), 74);
        let text = e.to_string();
        assert!(text.contains(name) && text.contains("bytes"), "{text}");
        assert!(
            name != "full.stl" || text.ends_with(" bytes of 25684"),
            "{text}"
        );
    }
    let path = directory.path().join("full.3mf");
    std::os::unix::fs::symlink("/dev/null", &path).unwrap();
    let e = write_mesh(&path, &ball(), LengthUnit::Millimetre).unwrap_err();
    assert!(e.to_string().contains("not a regular file"), "{e}");
    let path = directory.path().join("null.stl");
    std::os::unix::fs::symlink("/dev/null", &path).unwrap();
    assert_eq!(
        write_mesh(&path, &ball(), LengthUnit::Millimetre).unwrap(),
        25684
    );
}
