//! Cells of VTK and pyramids in every format: what becomes of each type, and what is refused by name.

use super::pyramids::QUADRATIC;
use crate::strategy::element_nodes;
use druse::frame::Vec3;
use druse::io::{ElementFile, read_elements, read_scaffold, write_vtu};
use druse::scaffold::{Connectivity, ElementMap, Kind, Orientation, Scaffold};
use std::fmt::Write as _;
use std::path::Path;

/// The pyramid of the report: base 2 x 2, height 1, its edges bulging by `bulge` along x and z.
fn points(count: usize, bulge: f64) -> Vec<Vec3> {
    let v = Vec3::new;
    let mut p = vec![
        v(-1., -1., 0.),
        v(1., -1., 0.),
        v(1., 1., 0.),
        v(-1., 1., 0.),
        v(0., 0., 1.),
    ];
    let ends = Kind::Pyramid13.edges().to_vec();
    p.extend(
        ends.iter()
            .map(|[a, b]| (p[usize::from(*a)] + p[usize::from(*b)]) / 2.0)
            .collect::<Vec<_>>(),
    );
    p.push(v(0., 0., 0.));
    p.extend(
        (0..4)
            .map(|i| (p[i] + p[(i + 1) % 4] + p[4]) / 3.0)
            .collect::<Vec<_>>(),
    );
    p.push(v(0., 0., 0.25));
    let bent = |p: &Vec3| p + v(p.y * p.y, 0.0, p.x * p.y) * bulge;
    p[..count].iter().map(bent).collect()
}

fn numbers(count: usize, first: usize) -> String {
    let all: Vec<String> = (first..first + count).map(|n| n.to_string()).collect();
    all.join(" ")
}

fn lines(points: &[Vec3], number: bool, separator: &str) -> String {
    let mut text = String::new();
    for (i, p) in points.iter().enumerate() {
        if number {
            let _ = write!(text, "{}{separator}", i + 1);
        }
        let _ = writeln!(text, "{}{separator}{}{separator}{}", p.x, p.y, p.z);
    }
    text
}

fn vtu(cell_type: u8, points: &[Vec3], version: &str, cell_data: &str) -> String {
    let n = points.len();
    let array = |name: &str, kind: &str, text: &str| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"1\" format=\"ascii\">{text}</DataArray>"
        )
    };
    format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"{version}\" byte_order=\"LittleEndian\">\
         <UnstructuredGrid><Piece NumberOfPoints=\"{n}\" NumberOfCells=\"1\">{cell_data}<Points>\
         <DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{}</DataArray></Points>\
         <Cells>{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
        lines(points, false, " "),
        array("connectivity", "Int64", &numbers(n, 0)),
        array("offsets", "Int64", &n.to_string()),
        array("types", "UInt8", &cell_type.to_string()),
    )
}

fn vtk(cell_type: u8, points: &[Vec3], version: &str) -> String {
    let n = points.len();
    format!(
        "# vtk DataFile Version {version}\npyramid\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {n} double\n{}\
         CELLS 1 {}\n{n} {}\nCELL_TYPES 1\n{cell_type}\n",
        lines(points, false, " "),
        n + 1,
        numbers(n, 0)
    )
}

/// Nodes in the order that Gmsh numbers them, edges by their lower ends.
fn msh(element_type: u32, points: &[Vec3], version: u32) -> String {
    let mut edges: Vec<usize> = (0..8).collect();
    let ends = |e: &usize| {
        let mut ends = Kind::Pyramid13.edges()[*e];
        ends.sort_unstable();
        ends
    };
    edges.sort_by_key(ends);
    let mut order: Vec<usize> = (1..=5).collect();
    order.extend(edges.iter().map(|e| e + 6));
    order.extend(14..=points.len());
    let order: Vec<String> = order.iter().map(usize::to_string).collect();
    let (n, own) = (points.len(), order.join(" "));
    if version == 2 {
        let nodes = lines(points, true, " ");
        return format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{n}\n{nodes}$EndNodes\n\
             $Elements\n1\n1 {element_type} 2 0 1 {own}\n$EndElements\n"
        );
    }
    let nodes = lines(points, false, " ");
    format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {n} 1 {n}\n3 1 0 {n}\n{}\n{nodes}$EndNodes\n\
         $Elements\n1 1 1 1\n3 1 {element_type} 1\n1 {own}\n$EndElements\n",
        numbers(n, 1).replace(' ', "\n")
    )
}

fn inp(points: &[Vec3]) -> String {
    let nodes = lines(points, true, ", ");
    let own = numbers(points.len(), 1).replace(' ', ", ");
    format!("*NODE\n{nodes}*ELEMENT, TYPE=C3D13\n1, {own}\n")
}

fn read(name: &str, text: &str) -> Result<Scaffold, druse::io::ReadError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    read_scaffold(&path).map(|f| f.scaffold)
}

#[test]
fn every_format_has_the_pyramid_of_the_report() {
    for bulge in [0.0, 0.2] {
        let [p13, p14, p19] = [13, 14, 19].map(|n| points(n, bulge));
        let cases = [
            (Kind::Pyramid13, "a.vtu", vtu(27, &p13, "0.1", "")),
            (Kind::Pyramid14, "a.vtu", vtu(37, &p19, "0.1", "")),
            (Kind::Pyramid14, "a.vtu", vtu(74, &p14, "2.3", "")),
            (Kind::Pyramid13, "a.vtk", vtk(27, &p13, "3.0")),
            (Kind::Pyramid14, "a.vtk", vtk(37, &p19, "3.0")),
            (Kind::Pyramid13, "a.msh", msh(19, &p13, 2)),
            (Kind::Pyramid14, "a.msh", msh(14, &p14, 2)),
            (Kind::Pyramid13, "a.msh", msh(19, &p13, 4)),
            (Kind::Pyramid14, "a.msh", msh(14, &p14, 4)),
            (Kind::Pyramid13, "a.inp", inp(&p13)),
        ];
        for (kind, name, text) in cases {
            let s = read(name, &text).unwrap_or_else(|e| panic!("{kind:?} {name}: {e}"));
            let e = s.element(0);
            assert_eq!((s.len(), e.kind()), (1, kind), "{name}");
            // Shears: they keep the volume.
            assert!(
                (e.volume() - 4.0 / 3.0).abs() < 1e-12,
                "{name} {}",
                e.volume()
            );
            assert_eq!(e.is_affine(), bulge == 0.0, "{name}");
            assert_eq!(e.orientation(), Orientation::Positive, "{name}");
            assert_eq!(s.outer_faces().count(), 5);
        }
    }
    for name in ["pyramid13.msh", "pyramid13.vtu"] {
        let s = read_scaffold(data(name)).unwrap().scaffold;
        assert!((s.element(0).volume() - 4.0 / 3.0).abs() < 1e-12, "{name}");
    }
}

#[test]
fn pyramids_whose_triangles_are_no_quadratic_faces_are_refused() {
    let mut p = points(19, 0.1);
    // The innermost node moves no face.
    p[18] += Vec3::new(0.05, 0.0, 0.02);
    assert!(read("a.vtu", &vtu(37, &p, "2.3", "")).is_ok());
    p[15] += Vec3::new(0.01, 0.0, 0.0);
    for (name, text) in [
        ("a.vtu", vtu(37, &p, "2.3", "")),
        ("a.vtk", vtk(37, &p, "3.0")),
    ] {
        let e = read(name, &text).unwrap_err();
        assert!(
            e.found().contains("triquadratic pyramid") && e.found().contains("1.000e-2"),
            "{e}"
        );
        assert!(e.hint().unwrap().contains("13 or 14 nodes"), "{e}");
        assert_eq!(e.item(), Some(0), "{e}");
    }
    let e = read("a.vtk", &vtk(37, &p[..14], "3.0")).unwrap_err();
    assert!(
        e.expected().contains("19 for a triquadratic pyramid"),
        "{e}"
    );
}

#[test]
fn written_pyramids_read_back_the_same() {
    let dir = tempfile::tempdir().unwrap();
    for kind in QUADRATIC {
        let (nodes, elements) = crate::strategy::mesh(kind, [2, 1, 1], 0.1, 9);
        let s = Scaffold::new(nodes, elements).unwrap();
        let path = dir.path().join("again.vtu");
        let values = vec![1.5; s.len()];
        write_vtu(&path, &s, &[("value", &values)]).unwrap();
        let again = read_scaffold(&path).unwrap();
        assert_eq!(again.fields[0].values, values);
        let again = again.scaffold;
        assert_eq!(again.len(), s.len());
        for (e, f) in s.elements().zip(again.elements()) {
            assert_eq!(e.kind(), f.kind());
            let own = |s: &Scaffold, e: &ElementMap| -> Vec<Vec3> {
                e.nodes().iter().map(|&n| s.nodes()[n as usize]).collect()
            };
            assert_eq!(own(&s, &e), own(&again, &f));
        }
    }
}

fn data(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/scaffold")
        .join(name)
}

/// Kinds and node coordinates of every element, and what was passed over.
fn content(name: &str) -> (Vec<(Kind, Vec<Vec3>)>, usize) {
    let of = |elements: &Connectivity, nodes: &[Vec3]| {
        let own = |e| {
            elements
                .nodes(e)
                .iter()
                .map(|&n| nodes[n as usize])
                .collect()
        };
        (0..elements.len())
            .map(|e| (elements.kind(e), own(e)))
            .collect()
    };
    match read_elements(data(name)).unwrap_or_else(|e| panic!("{e}")) {
        ElementFile::Solids(f) => (of(f.scaffold.connectivity(), f.scaffold.nodes()), f.skipped),
        ElementFile::Surface(f) => (of(f.surface.connectivity(), f.surface.nodes()), f.skipped),
    }
}

#[test]
fn lagrange_cells_of_order_1_and_2_are_the_classic_ones() {
    for (name, kinds) in [
        (
            "solids1",
            [Kind::Tet4, Kind::Hex8, Kind::Wedge6, Kind::Pyramid5].to_vec(),
        ),
        (
            "solids2",
            [Kind::Tet10, Kind::Hex27, Kind::Wedge18, Kind::Pyramid14].to_vec(),
        ),
        ("surface1", [Kind::Tri3, Kind::Quad4].to_vec()),
        ("surface2", [Kind::Tri6, Kind::Quad9].to_vec()),
    ] {
        let classic = content(&format!("classic_{name}.vtu"));
        let found: Vec<Kind> = classic.0.iter().map(|e| e.0).collect();
        assert_eq!(found, kinds);
        // A curve in every file of solids.
        assert_eq!(classic.1, usize::from(name.starts_with("solids")));
        for extension in ["vtu", "vtk"] {
            assert_eq!(
                content(&format!("lagrange_{name}.{extension}")),
                classic,
                "{name}.{extension}"
            );
        }
    }
}

/// Files older than VTK 9 number two edges of the quadratic Lagrange hexahedron the other way round.
#[test]
fn old_lagrange_hexes_have_two_edges_changed() {
    let nodes = element_nodes(Kind::Hex27, 0.05, 4);
    let mut old = nodes.clone();
    old.swap(18, 19);
    for (name, text, expected) in [
        ("a.vtu", vtu(72, &nodes, "2.1", ""), &nodes),
        ("a.vtu", vtu(72, &nodes, "2.3", ""), &nodes),
        ("a.vtu", vtu(72, &nodes, "2.0", ""), &old),
        ("a.vtu", vtu(72, &nodes, "0.1", ""), &old),
        ("a.vtu", vtu(29, &nodes, "0.1", ""), &nodes),
        ("a.vtk", vtk(72, &nodes, "4.2"), &old),
        ("a.vtk", vtk(29, &nodes, "4.2"), &nodes),
    ] {
        let s = read(name, &text).unwrap();
        let own = s.element(0).nodes().iter().map(|&n| s.nodes()[n as usize]);
        assert!(own.eq(expected.iter().copied()), "{name}");
    }
}

#[test]
fn cells_of_other_orders_are_refused_by_name() {
    let many: Vec<Vec3> = (0..64)
        .map(|i| Vec3::new(f64::from(i), f64::from(i * i % 7), f64::from(i % 5)))
        .collect();
    for (cell_type, nodes, name) in [
        (69, 10, "Lagrange triangle"),
        (70, 16, "Lagrange quadrilateral"),
        (71, 20, "Lagrange tetrahedron"),
        (72, 64, "Lagrange hexahedron"),
        (72, 12, "Lagrange hexahedron"),
        (73, 21, "Lagrange wedge"),
        (74, 30, "Lagrange pyramid"),
        (76, 6, "Bezier triangle"),
        (77, 9, "Bezier quadrilateral"),
        (78, 10, "Bezier tetrahedron"),
        (79, 27, "Bezier hexahedron"),
        (80, 18, "Bezier wedge"),
        (81, 14, "Bezier pyramid"),
        (67, 27, "higher-order hexahedron"),
        (42, 8, "polyhedron"),
    ] {
        let own = &many[..nodes];
        for (file, text) in [
            ("a.vtu", vtu(cell_type, own, "2.3", "")),
            ("a.vtk", vtk(cell_type, own, "3.0")),
        ] {
            let e = read(file, &text).unwrap_err();
            assert!(e.found().contains(name), "{e}");
            assert!(e.hint().unwrap().contains("order 1 or 2"), "{e}");
        }
    }
    let degrees = |d: &str, name: &str| {
        format!(
            "<CellData HigherOrderDegrees=\"{name}\"><DataArray type=\"Float64\" Name=\"degrees\" \
             NumberOfComponents=\"3\" format=\"ascii\">{d}</DataArray></CellData>"
        )
    };
    let wedge = element_nodes(Kind::Wedge18, 0.0, 1);
    let file = |d: &str, name: &str| read("a.vtu", &vtu(73, &wedge, "2.3", &degrees(d, name)));
    assert!(file("2 2 2", "degrees").is_ok());
    assert!(file("1 1 5", "other").is_ok());
    let e = file("1 1 5", "degrees").unwrap_err();
    assert!(
        e.found().contains("Lagrange wedge") && e.found().contains("1, 1, 5"),
        "{e}"
    );
}

#[test]
fn pixels_and_voxels_are_quads_and_hexes() {
    let p = |x: u8, y: u8, z: u8| Vec3::new(f64::from(x), f64::from(y), f64::from(z));
    let corners: Vec<Vec3> = (0..8u8).map(|i| p(i & 1, i >> 1 & 1, i >> 2)).collect();
    for (name, text) in [
        ("a.vtu", vtu(11, &corners, "0.1", "")),
        ("a.vtk", vtk(11, &corners, "3.0")),
    ] {
        let s = read(name, &text).unwrap();
        assert_eq!(s.element(0).kind(), Kind::Hex8);
        assert!((s.element(0).volume() - 1.0).abs() < 1e-15);
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vtu");
    std::fs::write(&path, vtu(8, &corners[..4], "0.1", "")).unwrap();
    let ElementFile::Surface(f) = read_elements(&path).unwrap() else {
        panic!("a surface");
    };
    let solid = f.surface.plate(2.0).unwrap();
    assert!((solid.element(0).volume() - 2.0).abs() < 1e-15);
}
