//! Fields of files: missing values are errors with their place or take the recipe's value, and one rule holds in every
//! format where a name stands at points and at cells.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// Four hexes of 5 mm in a row.
const POINTS: &str = "0 0 0 5 0 0 10 0 0 15 0 0 20 0 0 0 5 0 5 5 0 10 5 0 15 5 0 20 5 0 \
                      0 0 5 5 0 5 10 0 5 15 0 5 20 0 5 0 5 5 5 5 5 10 5 5 15 5 5 20 5 5";
const CELLS: [&str; 4] = [
    "0 1 6 5 10 11 16 15",
    "1 2 7 6 11 12 17 16",
    "2 3 8 7 12 13 18 17",
    "3 4 9 8 13 14 19 18",
];

/// Arrays: name, numbers each, values.
type Arrays<'a> = &'a [(&'a str, usize, &'a str)];

/// The hexes as .vtu; `more` are points that no element uses.
fn vtu(points: Arrays, cells: Arrays, more: &str) -> String {
    let arrays = |list: Arrays| {
        list.iter().fold(String::new(), |mut text, (name, n, values)| {
            let _ = write!(
                text,
                "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{n}\" format=\"ascii\">{values}</DataArray>"
            );
            text
        })
    };
    let count = 20 + more.split_whitespace().count() / 3;
    format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
         <Piece NumberOfPoints=\"{count}\" NumberOfCells=\"4\"><PointData>{}</PointData><CellData>{}</CellData>\
         <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{POINTS} {more}</DataArray></Points>\
         <Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">{}</DataArray>\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">8 16 24 32</DataArray>\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">12 12 12 12</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>",
        arrays(points),
        arrays(cells),
        CELLS.join(" ")
    )
}

/// The same as legacy .vtk.
fn vtk(points: Arrays, cells: Arrays) -> String {
    let arrays = |list: Arrays| {
        list.iter()
            .fold(String::new(), |mut text, (name, n, values)| {
                let _ = write!(
                    text,
                    "SCALARS {name} double {n}\nLOOKUP_TABLE default\n{values}\n"
                );
                text
            })
    };
    let rows = CELLS.map(|c| format!("8 {c}")).join("\n");
    format!(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 20 double\n{POINTS}\nCELLS 4 36\n{rows}\n\
         CELL_TYPES 4\n12 12 12 12\nCELL_DATA 4\n{}POINT_DATA 20\n{}",
        arrays(cells),
        arrays(points)
    )
}

/// Twenty times a value.
fn all(value: &str) -> String {
    vec![value; 20].join(" ")
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.0.path().join(name), text).unwrap();
    }

    /// Weights of the first cell at the middles of the elements, whose own weight is that field; or the error.
    fn weights(&self, field: &str) -> Result<Vec<f64>, String> {
        self.at(
            field,
            "x,y,z\n2.5,2.5,2.5\n7.5,2.5,2.5\n12.5,2.5,2.5\n17.5,2.5,2.5\n",
        )
    }

    fn at(&self, field: &str, points: &str) -> Result<Vec<f64>, String> {
        self.write("p.csv", points);
        self.write(
            "r.toml",
            &format!(
                "druse = 1\nunit = \"mm\"\n[cell.a]\nsurface = \"schwarz_p\"\n[cell.b]\nsurface = \"schwarz_p\"\nlevel = 0.3\n[scaffold]\n\
                 box = {{ size = [20, 5, 5], cell_size = 5 }}\n[tiling]\n\
                 transition = [{{ cell = \"a\", weight = {field} }}, {{ cell = \"b\", weight = 1.0 }}]\n[band]\nvoxel_size = 0.5\n"
            ),
        );
        eval(&self.0.path().join("r.toml"), &self.0.path().join("p.csv"))
    }
}

/// The column before the last of what `druse eval` prints; its exit code must be 65 when it fails.
fn eval(recipe: &Path, points: &Path) -> Result<Vec<f64>, String> {
    let out = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args([
            "eval".as_ref(),
            recipe.as_os_str(),
            "--points".as_ref(),
            points.as_os_str(),
        ])
        .output()
        .unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    if !out.status.success() {
        let error = String::from_utf8(out.stderr).unwrap();
        assert_eq!(out.status.code(), Some(65), "{error}");
        return Err(error);
    }
    let column = |line: &str| line.rsplit(',').nth(1).unwrap().parse::<f64>().unwrap();
    Ok(text.lines().skip(1).map(column).collect())
}

fn close(found: &[f64], expected: [f64; 4]) {
    let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    assert!(
        worst.fold(0.0, f64::max) < 1e-6,
        "{found:?} for {expected:?}"
    );
}

const MAP: &str = "map = [[0, 0], [10, 1]]";
/// Weight 1 of 10 against 1.
const ONE: f64 = 0.1 / 1.1;

#[test]
fn a_missing_cell_value_is_an_error_with_its_place() {
    let place = Place::new();
    let values = [("t", 1, "1 1 nan 1")];
    place.write("c.vtu", &vtu(&[], &values, ""));
    place.write("c.vtk", &vtk(&[], &values));
    place.write("i.vtu", &vtu(&[], &[("t", 1, "1 1 -inf 1")], ""));
    for file in ["c.vtu", "c.vtk"] {
        let field = |more: &str| format!("{{ file = \"{file}\", field = \"t\", {MAP}{more} }}");
        let error = place.weights(&field("")).unwrap_err();
        assert!(
            error.contains("element 2: found NaN in the field \"t\"")
                && error.contains(file)
                && error.contains("outside = \"nearest\" or a number"),
            "{error}"
        );
        let error = place.weights(&field(", outside = \"error\"")).unwrap_err();
        assert!(error.contains("element 2"), "{error}");
        close(
            &place.weights(&field(", outside = \"nearest\"")).unwrap(),
            [ONE; 4],
        );
        close(&place.weights(&field(", outside = 1")).unwrap(), [ONE; 4]);
        // A node takes the mean of its two cells: 1, 3 (of 1 and 5), 3, 1.
        let high = 0.3 / 1.3;
        let mixed = f64::midpoint(ONE, high);
        close(
            &place.weights(&field(", outside = 5")).unwrap(),
            [ONE, mixed, high, mixed],
        );
    }
    let error = place
        .weights(&format!("{{ file = \"i.vtu\", field = \"t\", {MAP} }}"))
        .unwrap_err();
    assert!(error.contains("found -inf"), "{error}");
}

#[test]
fn a_missing_point_value_matters_where_the_part_meets_it() {
    let place = Place::new();
    let mut values: Vec<&str> = vec!["1"; 20];
    values[12] = "NaN";
    let values = values.join(" ");
    place.write("p.vtk", &vtk(&[("t", 1, &values)], &[]));
    let field = format!("{{ file = \"p.vtk\", field = \"t\", {MAP} }}");
    let error = place.weights(&field).unwrap_err();
    assert!(
        error.contains("node 12: found NaN in the field \"t\""),
        "{error}"
    );
    let near = format!("{{ file = \"p.vtk\", field = \"t\", {MAP}, outside = \"nearest\" }}");
    close(&place.weights(&near).unwrap(), [ONE; 4]);
    // Of a node that no element uses it does not matter, nor in another component.
    let unused = format!("{} nan", all("1"));
    place.write("u.vtu", &vtu(&[("t", 1, &unused)], &[], "90 90 90"));
    close(
        &place
            .weights(&format!("{{ file = \"u.vtu\", field = \"t\", {MAP} }}"))
            .unwrap(),
        [ONE; 4],
    );
    place.write("v.vtu", &vtu(&[("v", 3, &all("1 0 nan"))], &[], ""));
    let component =
        |c: &str| format!("{{ file = \"v.vtu\", field = \"v\", component = \"{c}\", {MAP} }}");
    close(&place.weights(&component("x")).unwrap(), [ONE; 4]);
    let error = place.weights(&component("magnitude")).unwrap_err();
    assert!(
        error.contains("NaN in the field \"v\", component magnitude"),
        "{error}"
    );
}

#[test]
fn tables_follow_the_same_rule() {
    let place = Place::new();
    let table = |third: &str| {
        format!("x,y,z,t\n2.5,2.5,2.5,1\n7.5,2.5,2.5,1\n12.5,2.5,2.5,{third}\n17.5,2.5,2.5,1\n")
    };
    let field = |more: &str| format!("{{ file = \"t.csv\", field = \"t\", {MAP}{more} }}");
    for word in ["nan", "", "inf", "NA"] {
        place.write("t.csv", &table(word));
        let error = place.weights(&field("")).unwrap_err();
        assert!(
            error.contains("t.csv:4") && error.contains("in the field \"t\""),
            "{error}"
        );
        close(&place.weights(&field(", outside = 1")).unwrap(), [ONE; 4]);
        close(
            &place.weights(&field(", outside = \"nearest\"")).unwrap(),
            [ONE; 4],
        );
    }
    place.write("t.csv", &table("much"));
    assert!(place.weights(&field("")).unwrap_err().contains("t.csv:4"));
    place.write("t.csv", &table("1"));
    let error = place.weights(&field(", at = \"cells\"")).unwrap_err();
    assert!(error.contains("without cells"), "{error}");
    close(
        &place.weights(&field(", at = \"points\"")).unwrap(),
        [ONE; 4],
    );
    let error = place
        .weights("{ file = \"t.csv\", field = \"tt\" }")
        .unwrap_err();
    assert!(
        error.contains("the columns x,y,z,t") && error.contains("did you mean \"t\""),
        "{error}"
    );
    place.write("t.csv", "x,y,z,t,t\n0,0,0,1,2\n");
    assert!(
        place
            .weights(&field(""))
            .unwrap_err()
            .contains("the column t once")
    );
}

#[test]
fn a_name_at_points_and_at_cells_needs_to_be_chosen() {
    let place = Place::new();
    let (points, cells) = (all("9"), "1 2 3 4");
    place.write("b.vtu", &vtu(&[("s", 1, &points)], &[("s", 1, cells)], ""));
    place.write("b.vtk", &vtk(&[("s", 1, &points)], &[("s", 1, cells)]));
    for file in ["b.vtu", "b.vtk"] {
        let field = |more: &str| format!("{{ file = \"{file}\", field = \"s\", {MAP}{more} }}");
        let error = place.weights(&field("")).unwrap_err();
        assert!(
            error.contains("\"s\" at the points and at the cells")
                && error.contains("at = \"points\" or at = \"cells\""),
            "{error}"
        );
        let nine = 0.9 / 1.9;
        close(
            &place.weights(&field(", at = \"points\"")).unwrap(),
            [nine; 4],
        );
        // Nodes take means: 1, 1.5, 2.5, 3.5, 4; weights are linear between them.
        let at = [1.0, 1.5, 2.5, 3.5, 4.0].map(|s| 0.1 * s / (1.0 + 0.1 * s));
        let expected = [0, 1, 2, 3].map(|n| f64::midpoint(at[n], at[n + 1]));
        close(
            &place.weights(&field(", at = \"cells\"")).unwrap(),
            expected,
        );
        let error = place.weights(&field(", at = \"nodes\"")).unwrap_err();
        assert!(
            error.contains("points") && error.contains("cells"),
            "{error}"
        );
    }
    place.write(
        "o.vtu",
        &vtu(
            &[("stress", 1, &points)],
            &[("t", 3, "1 1 1 1 1 1 1 1 1 1 1 1")],
            "",
        ),
    );
    let error = place
        .weights("{ file = \"o.vtu\", field = \"stres\" }")
        .unwrap_err();
    assert!(
        error.contains("stress (at the points), t (at the cells, 3 numbers each)")
            && error.contains("did you mean \"stress\""),
        "{error}"
    );
    let error = place
        .weights("{ file = \"o.vtu\", field = \"stress\", at = \"cells\" }")
        .unwrap_err();
    assert!(
        error.contains("is at the points: at = \"points\""),
        "{error}"
    );
    let twice = [("s", 1, &*points), ("s", 3, &*all("1 2 3"))];
    place.write("d.vtu", &vtu(&twice, &[], ""));
    let error = place
        .weights("{ file = \"d.vtu\", field = \"s\" }")
        .unwrap_err();
    assert!(
        error.contains("2 fields \"s\" at the points, of 1 and 3 numbers"),
        "{error}"
    );
}

#[test]
fn maps_are_finite_and_in_order() {
    let place = Place::new();
    place.write("t.csv", "x,y,z,t\n0,0,0,1\n");
    let map = |m: &str| place.weights(&format!("{{ file = \"t.csv\", field = \"t\", map = {m} }}"));
    let error = map("[[10, 0], [0, 1]]").unwrap_err();
    assert!(error.contains("ascending order"), "{error}");
    assert!(
        map("[[0, nan], [1, 1]]")
            .unwrap_err()
            .contains("finite numbers")
    );
    assert!(map("[[0, 0], [0, 1], [2, 1]]").is_ok());
}

#[test]
fn a_missing_voxel_is_an_error_with_its_place() {
    let place = Place::new();
    let grid = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/grids/nan.vdb");
    // NaN at (0.8, 0, 0) m, infinite at (0.8, 0, 0.1): ten millimetres a metre put a node on each voxel along x.
    let field = |shift: f64, more: &str| {
        format!(
            "{{ file = {{ path = \"{}\", unit = \"mm\", transform = {{ scale = 50, translate = [{shift}, 0, 0] }} }}, \
             field = \"surface\", map = [[-9, 1], [9, 1]]{more} }}",
            grid.display()
        )
    };
    let error = place.weights(&field(-35.0, "")).unwrap_err();
    assert!(
        error.contains("NaN in the field \"surface\" at voxel [32, 24, 24]"),
        "{error}"
    );
    close(
        &place.weights(&field(-35.0, ", outside = 1")).unwrap(),
        [0.5; 4],
    );
    close(
        &place
            .weights(&field(-35.0, ", outside = \"nearest\""))
            .unwrap(),
        [0.5; 4],
    );
    // Nodes elsewhere do not meet it.
    close(&place.weights(&field(-45.0, "")).unwrap(), [0.5; 4]);
}
