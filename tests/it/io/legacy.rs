//! Legacy VTK files: keywords in any case, and arrays that are no numbers.

use super::file;
use druse::io::{ElementFile, read_elements, read_mesh};

/// A tetrahedron with arrays of strings, bits and numbers, in text or binary.
fn tetrahedron(is_binary: bool) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::new();
    let floats = |numbers: &[f32]| -> Vec<u8> {
        if is_binary {
            return numbers.iter().flat_map(|x| x.to_be_bytes()).collect();
        }
        let words: Vec<String> = numbers.iter().map(f32::to_string).collect();
        words.join(" ").into_bytes()
    };
    let whole = |numbers: &[i32]| -> Vec<u8> {
        if is_binary {
            return numbers.iter().flat_map(|x| x.to_be_bytes()).collect();
        }
        let words: Vec<String> = numbers.iter().map(i32::to_string).collect();
        words.join(" ").into_bytes()
    };
    // Of binary strings the two highest bits tell the size of the length: 1, 2 and 4 bytes here.
    let strings = |texts: &[&str]| -> Vec<u8> {
        if !is_binary {
            return texts.join("\n").into_bytes();
        }
        let one = |(n, text): (usize, &&str)| {
            let length = text.len() as u32;
            let head = match n % 3 {
                0 => vec![0xc0 | length as u8],
                1 => (0x8000 | length as u16).to_be_bytes().to_vec(),
                _ => (0x4000_0000 | length).to_be_bytes().to_vec(),
            };
            [head, text.as_bytes().to_vec()].concat()
        };
        texts.iter().enumerate().flat_map(one).collect()
    };
    let bits: Vec<u8> = if is_binary {
        vec![0b0110_0000]
    } else {
        b"0 1 1 0".to_vec()
    };
    let colours: [&[u8]; 2] = [b"1 1 1 1 0 0.5 0 1", &[255; 8]];
    let form = if is_binary { "Binary" } else { "Ascii" };
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let force = [1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0, 4.0, 0.0, 0.0];
    for (line, content) in [
        (
            format!(
                "# vtk DataFile Version 3.0\ntitle\n{form}\ndataset Unstructured_Grid\nField data 2\n\
                 label 1 2 string"
            ),
            strings(&["first%20one", ""]),
        ),
        ("step 1 1 float".into(), floats(&[0.5])),
        (
            "METADATA\nINFORMATION 0\n\npoints 4 float".into(),
            floats(&corners),
        ),
        ("Cells 1 5".into(), whole(&[4, 0, 1, 2, 3])),
        ("cell_types 1".into(), whole(&[10])),
        (
            "Point_Data 4\nscalars flag bit 1\nlookup_table default".into(),
            bits,
        ),
        (
            "Scalars temperature float\nLookup_Table default".into(),
            floats(&[1.0, 2.0, 3.0, 4.0]),
        ),
        (
            "Lookup_Table mine 2".into(),
            colours[usize::from(is_binary)].to_vec(),
        ),
        (
            "FIELD more 2\nnames 1 4 string".into(),
            strings(&["a", "b", "", "d"]),
        ),
        ("force 3 4 float".into(), floats(&force)),
    ] {
        out.extend(line.as_bytes());
        out.push(b'\n');
        out.extend(content);
        out.push(b'\n');
    }
    out
}

#[test]
fn strings_and_bits_are_left_out_with_a_note() {
    let place = tempfile::tempdir().unwrap();
    for is_binary in [false, true] {
        let path = file(&place, "part.vtk", tetrahedron(is_binary));
        let ElementFile::Solids(read) = read_elements(&path).unwrap() else {
            panic!("a tetrahedron is a solid");
        };
        assert_eq!(read.scaffold.len(), 1);
        let fields: Vec<_> = read
            .fields
            .iter()
            .map(|f| (f.name.as_str(), f.components))
            .collect();
        assert_eq!(fields, [("temperature", 1), ("force", 3)], "{is_binary}");
        assert_eq!(read.fields[0].values, [1.0, 2.0, 3.0, 4.0]);
        let along_x: Vec<f64> = read.fields[1].values.iter().step_by(3).copied().collect();
        assert_eq!(along_x, [1.0, 2.0, 3.0, 4.0]);
        let notes: Vec<_> = read
            .notes
            .iter()
            .filter(|n| n.contains("left out"))
            .collect();
        assert_eq!(notes.len(), 3, "{:?}", read.notes);
        for word in [
            "\"label\" of string",
            "\"flag\" of bit",
            "\"names\" of string",
        ] {
            assert!(notes.iter().any(|n| n.contains(word)), "{word}: {notes:?}");
        }
    }
}

#[test]
fn polygons_have_keywords_in_any_case() {
    let place = tempfile::tempdir().unwrap();
    let upper = super::cubes::vtk();
    for word in [
        "ASCII",
        "DATASET",
        "POLYDATA",
        "POINTS",
        "LINES",
        "POLYGONS",
        "TRIANGLE_STRIPS",
        "CELL_DATA",
        "SCALARS",
        "LOOKUP_TABLE",
    ] {
        let lower = upper.replace(word, &word.to_lowercase());
        let read =
            read_mesh(file(&place, "x.vtk", &lower)).unwrap_or_else(|e| panic!("{word}: {e}"));
        assert!((read.mesh.volume() - 1000.0).abs() < 1e-9, "{word}");
    }
    let labelled = upper.replace(
        "CELL_DATA 7\n",
        "CELL_DATA 7\nSCALARS label string\nLOOKUP_TABLE default\na\n\nc\nd\ne\nf\ng\n",
    );
    let read = read_mesh(file(&place, "x.vtk", labelled)).unwrap();
    assert!(
        read.warnings
            .iter()
            .any(|w| w.contains("\"label\" of string; left out")),
        "{:?}",
        read.warnings
    );
    let unknown = format!("{upper}EDGE_DATA 2\n");
    let warnings = read_mesh(file(&place, "x.vtk", unknown)).unwrap().warnings;
    assert_eq!(warnings[0], "all data from \"EDGE_DATA 2\" on; left out");
}
