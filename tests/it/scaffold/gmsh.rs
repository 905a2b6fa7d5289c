//! Gmsh meshes of versions 1, 2, 4.0 and 4.1, text and binary, with data.

use super::zoo::{ELEMENTS, LINEAR, NODES, VOLUME, check, data, facts, read};
use druse::io::{ElementFile, FieldAt, read_elements};

#[test]
fn versions_that_gmsh_writes_hold_the_same_mesh() {
    for (name, two) in [
        ("zoo_1.msh", "2"),
        ("zoo_22.msh", "wedge it"),
        ("zoo_40.msh", "wedge it"),
    ] {
        let file = read_elements(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let mut groups = ["1", two, "3", "4"];
        groups.sort_unstable();
        check(name, &file, &LINEAR, VOLUME, &groups);
    }
}

/// How a file is written.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Form {
    Text,
    Little,
    Big,
}

/// A writer of Gmsh's numbers.
struct Out(Form, Vec<u8>);

impl Out {
    fn put<const N: usize>(&mut self, text: &str, mut bytes: [u8; N]) -> &mut Self {
        match self.0 {
            Form::Text => self.1.extend(format!("{text} ").bytes()),
            Form::Little => self.1.extend(bytes),
            Form::Big => {
                bytes.reverse();
                self.1.extend(bytes);
            }
        }
        self
    }
    fn int(&mut self, n: i32) -> &mut Self {
        self.put(&n.to_string(), n.to_le_bytes())
    }
    fn size(&mut self, n: u64) -> &mut Self {
        self.put(&n.to_string(), n.to_le_bytes())
    }
    fn double(&mut self, x: f64) -> &mut Self {
        self.put(&format!("{x:?}"), x.to_le_bytes())
    }
    fn line(&mut self, text: &str) -> &mut Self {
        self.1.extend(format!("{text}\n").bytes());
        self
    }
    fn end(&mut self, text: &str) -> &mut Self {
        self.1.push(b'\n');
        self.line(text)
    }
    /// The format section.
    fn new(version: &str, form: Form) -> Self {
        let mut out = Self(form, Vec::new());
        let binary = i32::from(form != Form::Text);
        out.line("$MeshFormat")
            .line(&format!("{version} {binary} 8"));
        if form == Form::Text {
            out.line("$EndMeshFormat");
        } else {
            out.int(1).end("$EndMeshFormat");
        }
        out
    }
}

/// The mesh in 4.0 or 4.1: an entity for each element, with its physical group; nodes on a curve with
/// parameters.
fn version_4(version: &str, form: Form, partitioned: bool) -> Vec<u8> {
    let old = version == "4";
    let mut out = Out::new(version, form);
    out.line("$Entities").size(1).size(1).size(2).size(4);
    out.int(1);
    for _ in 0..if old { 6 } else { 3 } {
        out.double(0.5);
    }
    out.size(0);
    for dimension in 1..=3 {
        for (tag, _) in (1..).zip(ELEMENTS).filter(|e| e.1.1 == dimension) {
            out.int(tag);
            for _ in 0..6 {
                out.double(0.25);
            }
            // A turned surface, and a body in two groups.
            let groups: &[i32] = match tag {
                1 => &[1, 8],
                5 => &[-5],
                _ => &[tag],
            };
            out.size(groups.len() as u64);
            for g in groups {
                out.int(*g);
            }
            out.size(2).int(1).int(-2);
        }
    }
    out.end("$EndEntities");
    // Bodies of two parts, entity 101 of partition 1.
    if partitioned {
        out.line("$PartitionedEntities")
            .size(2)
            .size(1)
            .int(9)
            .int(1);
        out.size(0).size(0).size(0).size(1);
        out.int(101).int(3).int(1).size(1).int(1);
        for _ in 0..6 {
            out.double(0.25);
        }
        out.size(2).int(1).int(8).size(0);
        out.end("$EndPartitionedEntities");
    }
    out.line("$Periodic").line("0\n$EndPeriodic");
    out.line("$Nodes").size(2).size(12);
    if !old {
        out.size(1).size(12);
    }
    // Two nodes on the curve 7, with their parameters, then the others in the body 1.
    for (dimension, tag, parametric, range) in [(1, 7, 1, 0..2), (3, 1, 0, 2..12)] {
        let count = range.len() as u64;
        if old {
            out.int(tag).int(dimension);
        } else {
            out.int(dimension).int(tag);
        }
        out.int(parametric).size(count);
        if !old {
            for n in range.clone() {
                out.size(n as u64 + 1);
            }
        }
        for n in range {
            if old {
                out.int(n as i32 + 1);
            }
            for c in NODES[n] {
                out.double(c);
            }
            if parametric == 1 {
                out.double(0.75);
            }
        }
    }
    out.end("$EndNodes");
    out.line("$Elements").size(7).size(7);
    if !old {
        out.size(1).size(7);
    }
    for (number, (code, dimension, nodes)) in (1..).zip(ELEMENTS) {
        let entity = if partitioned && number == 1 {
            101
        } else {
            number
        };
        if old {
            out.int(entity).int(dimension).int(code).size(1).int(number);
        } else {
            out.int(dimension).int(entity).int(code).size(1);
            out.size(number as u64);
        }
        for n in nodes {
            if old {
                out.int(*n);
            } else {
                out.size(*n as u64);
            }
        }
    }
    out.end("$EndElements");
    out.1
}

#[test]
fn versions_4_are_read_in_every_encoding() {
    for version in ["4", "4.1"] {
        for form in [Form::Text, Form::Little, Form::Big] {
            for partitioned in [false, true] {
                let name = format!("{version} {form:?} {partitioned}");
                let bytes = version_4(version, form, partitioned);
                let file = read("a.msh", &bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
                check(&name, &file, &LINEAR, VOLUME, &["1", "2", "3", "4", "8"]);
            }
        }
    }
    let mut three = version_4("4", Form::Text, false);
    three[12] = b'3';
    let e = read("a.msh", &three).unwrap_err();
    assert!(e.found().contains("\"3\""), "{e}");
    assert!(e.hint().unwrap().contains("msh41"), "{e}");
}

#[test]
fn surfaces_keep_their_groups_in_every_version() {
    let surface = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 7 \"skin\"\n3 7 \"body\"\n\
        $EndPhysicalNames\n$Entities\n0 0 2 1\n1 0 0 0 1 1 0 1 -7 0\n2 0 0 0 1 1 0 0 0\n1 0 0 0 1 1 1 1 7 0\n\
        $EndEntities\n$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n\
        $Elements\n2 2 1 2\n2 1 2 1\n1 1 2 3\n2 2 2 1\n2 1 3 4\n$EndElements\n";
    let ElementFile::Surface(file) = read("a.msh", surface).unwrap() else {
        panic!("a surface");
    };
    let groups: Vec<_> = file
        .groups
        .iter()
        .map(|g| (&*g.name, &*g.elements))
        .collect();
    assert_eq!(groups, [("skin", &[0][..])]);
}

const PARAMETRIC: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$ParametricNodes\n5\n1 0 0 0 0 1\n\
    2 10 0 0 1 4 0.5\n3 0 10 0 2 7 0.25 0.75\n4 0 0 10 2 7 1 1\n5 10 10 10 3 1\n$EndParametricNodes\n\
    $Elements\n2\n1 4 2 0 1 1 2 3 4\n2 4 2 0 1 2 3 4 5\n$EndElements\n";

#[test]
fn parametric_nodes_are_nodes() {
    let mut binary = Vec::new();
    for form in [Form::Little, Form::Big] {
        let mut out = Out::new("2.2", form);
        out.line("$ParametricNodes").line("5");
        let p = [
            [0., 0., 0.],
            [10., 0., 0.],
            [0., 10., 0.],
            [0., 0., 10.],
            [10., 10., 10.],
        ];
        for (n, (at, dimension)) in (1..).zip(p.into_iter().zip([0, 1, 2, 2, 3])) {
            out.int(n);
            for c in at {
                out.double(c);
            }
            out.int(dimension).int(4);
            for _ in 0..if dimension == 3 { 0 } else { dimension } {
                out.double(0.5);
            }
        }
        out.end("$EndParametricNodes").line("$Elements").line("2");
        out.int(4).int(2).int(2);
        for (n, nodes) in [(1, [1, 2, 3, 4]), (2, [2, 3, 4, 5])] {
            out.int(n).int(0).int(1);
            for n in nodes {
                out.int(n);
            }
        }
        out.end("$EndElements");
        binary.push(out.1);
    }
    for bytes in binary.into_iter().chain([PARAMETRIC.into()]) {
        let file = read("a.msh", bytes).unwrap();
        let found = facts(&file);
        assert_eq!(found.kinds["Tet4"], 2);
        assert!((found.volume - 500.0).abs() < 1e-9, "{found:?}");
    }
    let e = read("a.msh", PARAMETRIC.replace("2 7 1 1", "9 7 1 1")).unwrap_err();
    assert!(e.found().contains("dimension 9"), "{e}");
}

/// Data as Gmsh writes them.
fn section(out: &mut Out, name: &str, field: &str, time: f64, step: i32, values: &[(i32, &[f64])]) {
    let each = values[0].1.len();
    out.line(name)
        .line(&format!("1\n\"{field}\"\n1\n{time}\n3\n{step}\n{each}"));
    out.line(&values.len().to_string());
    for (number, values) in values {
        out.int(*number);
        if name == "$ElementNodeData" {
            out.int(1);
        }
        for v in *values {
            out.double(*v);
        }
        if out.0 == Form::Text {
            out.line("");
        }
    }
    if out.0 == Form::Text {
        out.line(&format!("$End{}", &name[1..]));
    } else {
        out.end(&format!("$End{}", &name[1..]));
    }
}

#[test]
fn data_sections_are_fields_in_every_version() {
    for version in ["2.2", "4", "4.1"] {
        for form in [Form::Text, Form::Little, Form::Big] {
            if version == "2.2" && form != Form::Text {
                continue;
            }
            let name = format!("{version} {form:?}");
            let bytes = match version {
                "2.2" => std::fs::read(data("zoo_22.msh")).unwrap(),
                _ => version_4(version, form, false),
            };
            let mut out = Out(form, bytes);
            let at = |time: f64| (1..=12).map(move |n| (n, [f64::from(n) * time]));
            for (step, time) in [(0, 0.0), (1, 2.5)] {
                let all: Vec<(i32, [f64; 1])> = at(time).collect();
                let values: Vec<(i32, &[f64])> = all.iter().map(|(n, v)| (*n, &v[..])).collect();
                section(&mut out, "$NodeData", "t", time, step, &values);
            }
            // In another order, and none for the hex.
            let stress: [(i32, &[f64]); 4] = [
                (4, &[4., 40., 400.]),
                (2, &[2., 20., 200.]),
                (3, &[3., 30., 300.]),
                (7, &[9., 9., 9.]),
            ];
            section(&mut out, "$ElementData", "s", 0.0, 0, &stress);
            section(
                &mut out,
                "$ElementNodeData",
                "corners",
                0.0,
                0,
                &[(4, &[1.])],
            );
            // An unknown section, with a line that looks like an end.
            out.line("$Own").int(1).end("$EndOther").line("$EndOwn");
            let file = read("a.msh", &out.1).unwrap_or_else(|e| panic!("{name}: {e}"));
            let notes = facts(&file).notes.join("\n");
            assert!(notes.contains("\"t\" has 2 time steps"), "{name}: {notes}");
            assert!(notes.contains("\"corners\""), "{name}: {notes}");
            let gaps = "\"s\" has no value at 1 of 4 elements";
            assert!(notes.contains(gaps), "{name}: {notes}");
            let ElementFile::Solids(file) = file else {
                panic!("solids");
            };
            let field = |n: &str| file.fields.iter().find(|f| f.name == n).unwrap();
            let t = field("t");
            assert_eq!((t.at, t.components), (FieldAt::Points, 1));
            for (node, value) in file.scaffold.nodes().iter().zip(&t.values) {
                let number = NODES.iter().position(|p| *p == [node.x, node.y, node.z]);
                assert_eq!(*value, 2.5 * (number.unwrap() + 1) as f64, "{name}");
            }
            let s = field("s");
            assert_eq!((s.at, s.components), (FieldAt::Cells, 3));
            assert!(s.values[..3].iter().all(|v| v.is_nan()), "{name}");
            assert_eq!(s.values[3..], [2., 20., 200., 3., 30., 300., 4., 40., 400.]);
        }
    }
}

#[test]
fn damaged_sections_are_refused() {
    let text = std::fs::read_to_string(data("zoo_40.msh")).unwrap();
    let refusal = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        read("a.msh", text.replacen(from, to, 1)).unwrap_err()
    };
    let e = refusal("$EndElements", "");
    assert!(e.hint().unwrap().contains("truncated"), "{e}");
    let e = refusal("$EndNodes", "$EndNod");
    assert!(e.expected().contains("$EndNodes"), "{e}");
    let e = refusal("$Elements\n7 7", "$Elements\n7 6");
    assert!(e.found().contains("block of"), "{e}");
    let one = std::fs::read_to_string(data("zoo_1.msh")).unwrap();
    let e = read("a.msh", one.replacen(" 5 1 1 8 ", " 5 1 1 7 ", 1)).unwrap_err();
    assert!(e.found().contains("7 nodes"), "{e}");
    let data = "$NodeData\n1\n\"t\"\n1\n0\n3\n0\n99\n1\n1 5\n$EndNodeData\n";
    let e = read("a.msh", text.clone() + data).unwrap_err();
    assert!(e.found().contains("99"), "{e}");
    let data = "$NodeData\n1\n\"t\"\n1\n0\n3\n0\n1\n99999999\n1 5\n$EndNodeData\n";
    let e = read("a.msh", text.clone() + data).unwrap_err();
    assert!(e.found().contains("99999999"), "{e}");
}

#[test]
fn outer_faces_of_every_format_are_meshes() {
    for name in [
        "zoo_1.msh",
        "zoo_40.msh",
        "zoo.mesh",
        "zoo.meshb",
        "zoo_small.bdf",
    ] {
        let file = druse::io::read_mesh(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let gap = (file.mesh.volume() - VOLUME).abs();
        assert!(gap < 1e-9, "{name}: {}", file.mesh.volume());
    }
}
