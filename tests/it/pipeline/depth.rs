//! The variable d of formulas: the signed distance to the envelope, negative inside, wherever formulas stand.

use super::recipe;
use druse::frame::{Aabb, LengthUnit, Vec3};
use druse::io::write_mesh;
use druse::mesh::TriMesh;
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use std::path::Path;

/// A recipe of hexes of 5 mm in a cube of 20 mm, which cuts them.
fn text(cell: &str, tiling: &str, folder: &Path) -> String {
    let cube = Aabb {
        min: Vec3::zeros(),
        max: Vec3::repeat(20.0),
    };
    let path = folder.join("cube.stl");
    write_mesh(&path, &TriMesh::cuboid(&cube), LengthUnit::Millimetre).unwrap();
    format!(
        "druse = 1\nunit = \"mm\"\n[cell.a]\n{cell}\n[scaffold]\nbox = {{ size = [20, 20, 20], cell_size = 5 }}\n\
         [tiling]\n{tiling}\n[band]\nvoxel_size = 0.5\n[[op]]\nintersect = {{ mesh = \"{}\" }}\n",
        path.display()
    )
}

fn outcome(cell: &str, tiling: &str) -> Result<Report, String> {
    let place = tempfile::tempdir().unwrap();
    let recipe = recipe(&text(cell, tiling, place.path()));
    run(&recipe, &RunOptions::default(), &Silent).map_err(|e| e.to_string())
}

const STRUTS: &str = "element = \"hex\"\ngraph = \"bcc\"";
const SHEETS: &str =
    "element = \"hex\"\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\nthickness = \"1mm\"";

#[test]
fn thickness_grows_inwards_with_minus_d() {
    for cell in [STRUTS, SHEETS] {
        let report = outcome(cell, "cell = \"a\"\nthickness = \"1.2 - 0.1*d\"").unwrap();
        let [low, high] = [0, 1].map(|n| report.cells["a"]["thickness"][n].as_f64().unwrap());
        // d is 0 at the faces and -10 in the middle.
        assert!(
            (low - 1.2).abs() < 1e-3 && (high - 2.2).abs() < 1e-3,
            "{low} {high}"
        );
    }
}

#[test]
fn what_becomes_negative_says_that_d_is() {
    let cells = [STRUTS, SHEETS, "element = \"hex\"\nsurface = \"schwarz_p\""];
    for cell in cells {
        let error = outcome(cell, "cell = \"a\"\nthickness = \"0.25 + 0.1*d\"").unwrap_err();
        assert!(
            error.contains("d is negative inside the envelope"),
            "{error}"
        );
        assert!(
            error.contains("tiling.thickness") && error.contains(" at ("),
            "{error}"
        );
        let error = outcome(cell, "cell = \"a\"\nthickness = \"0.25 - 0.1*x\"").unwrap_err();
        assert!(!error.contains("d is negative"), "{error}");
    }
    let fraction = "cell = \"a\"\nvolume_fraction = \"0.3 + 0.1*d\"";
    let error = outcome(cells[2], fraction).unwrap_err();
    assert!(
        error.contains("d is negative inside the envelope"),
        "{error}"
    );
}

#[test]
fn regions_and_weights_have_the_same_sign() {
    // Elements whose centres lie deeper than 5 mm: the 2^3 in the middle of 4^3.
    let assigned = "assign = [{ cell = \"a\" }, { cell = \"a\", where = \"-5 - d\" }]";
    assert!(outcome(STRUTS, &format!("{assigned}\nthickness = 1")).is_ok());
    let nowhere = "assign = [{ cell = \"a\" }, { cell = \"a\", where = \"d - 0.1\" }]";
    let error = outcome(STRUTS, &format!("{nowhere}\nthickness = 1")).unwrap_err();
    assert!(error.contains("no element is in it"), "{error}");
    let weights =
        "transition = [{ cell = \"a\", weight = \"1 + d\" }, { cell = \"a\", weight = 1 }]";
    let report = outcome("element = \"hex\"\nsurface = \"schwarz_p\"", weights);
    let warnings = report.map(|r| r.warnings);
    let text = format!("{warnings:?}");
    assert!(text.contains("d is negative inside the envelope"), "{text}");
}
