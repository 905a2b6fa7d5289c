//! A failing certificate warns; defaults meet across faces.

use crate::strategy::Noise;
use druse::frame::{CellPoint, Vec3};
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use druse::scaffold::Kind;
use std::fmt::Write;

/// Two wedges that share a square, the axis of one across that of the other.
fn wedges() -> String {
    let h = 0.75f64.sqrt();
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.5, h, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [0.5, h, 1.0],
        [0.0, -h, 0.5],
        [1.0, -h, 0.5],
    ];
    let mut text = String::from(
        "# vtk DataFile Version 3.0\nwedges\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n",
    );
    for p in points {
        let _ = writeln!(text, "{} {} {}", 4.0 * p[0], 4.0 * p[1], 4.0 * p[2]);
    }
    text + "CELLS 2 14\n6 0 1 2 3 4 5\n6 0 6 3 1 7 4\nCELL_TYPES 2\n13\n13\n"
}

/// Two unit cubes, the second turned by a right angle about the axis through both.
const CUBES: &str = "# vtk DataFile Version 3.0\ncubes\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n\
    0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n2 0 0\n2 1 0\n2 0 1\n2 1 1\n\
    CELLS 2 18\n8 0 1 2 3 4 5 6 7\n8 2 9 11 6 1 8 10 5\nCELL_TYPES 2\n12\n12\n";

fn report(cell: &str, mesh: &str, strict: bool) -> Result<Report, String> {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("w.vtk"), mesh).unwrap();
    let text = format!(
        "druse = 1\n[cell.c]\n{cell}\n[scaffold]\nfile = {:?}\n[tiling]\ncell = \"c\"\ncertificate = true\n\
         [band]\nvoxel_size = 0.1\n",
        directory.path().join("w.vtk").display().to_string()
    );
    let options = RunOptions {
        strict,
        ..RunOptions::default()
    };
    let recipe = Recipe::parse(&text, &[]).unwrap();
    run(&recipe, &options, &Silent).map_err(|e| e.to_string())
}

#[test]
fn wedges_turned_against_each_other_meet() {
    for graph in ["edges", "spokes"] {
        let found = report(
            &format!("graph = {graph:?}\nband_limit = 6"),
            &wedges(),
            false,
        )
        .unwrap();
        let jump = found.continuity.unwrap().value_jump_max;
        assert!(jump <= 1e-5, "{graph}: {jump:e}");
        assert!(found.warnings.iter().all(|w| w.code != "W114"));
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn a_failing_certificate_warns_with_place_and_remedy() {
    // Of a cell without symmetry both sides of the shared face differ, by little: more is refused.
    let cell = "formula = \"hypot(x, y, z) - 0.6 + 0.0005 * (y * y - z * z)\"\ngroup = \"C1\"\nband_limit = 3";
    let found = report(cell, CUBES, false).unwrap();
    assert!(found.continuity.unwrap().value_jump_max > 1e-5);
    let warning = found.warnings.iter().find(|w| w.code == "W114").unwrap();
    for word in ["between elements 0 and 1", "(", "symmetry", "finer tables"] {
        assert!(warning.message.contains(word), "{}", warning.message);
    }
    assert!(
        report(cell, CUBES, true)
            .unwrap_err()
            .contains("not continuous")
    );
}

#[test]
fn shape_functions_of_planar_kinds_are_right_at_z_0() {
    let mut noise = Noise::new(5);
    for kind in Kind::ALL.into_iter().filter(|k| k.is_planar()) {
        for (i, node) in kind.reference_nodes().into_iter().enumerate() {
            assert!(node.0.z == 0.0, "{kind:?}");
            for (j, f) in kind.shape_functions(node).into_iter().enumerate() {
                assert!((f - f64::from(u8::from(i == j))).abs() < 1e-14, "{kind:?}");
            }
        }
        let nodes = kind.reference_nodes();
        for _ in 0..20 {
            let p = noise.vector();
            let xi = CellPoint(Vec3::new(p.x, p.y, 0.0));
            let values = kind.shape_functions(xi);
            assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-13);
            let mapped: Vec3 = nodes.iter().zip(&values).map(|(n, v)| n.0 * *v).sum();
            assert!((mapped - xi.0).norm() < 1e-13, "{kind:?}");
            let slopes = kind.shape_gradients(xi);
            for (a, axis) in [Vec3::x(), Vec3::y()].into_iter().enumerate() {
                let along: Vec3 = nodes.iter().zip(&slopes).map(|(n, g)| n.0 * g[a]).sum();
                assert!((along - axis).norm() < 1e-12, "{kind:?}");
            }
        }
    }
}
