//! Recipes whose cells need turned elements.

use super::recipe;
use crate::strategy::{Noise, renumberings};
use druse::frame::{Coord, Vec3};
use druse::io::write_vtu;
use druse::pipeline::{Probe, Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::vdb::Volume;
use std::path::Path;

/// The scaffold with the nodes of every hex in one of the 48 orders.
fn renumbered(scaffold: &Scaffold, seed: u64) -> Scaffold {
    let orders = renumberings(Kind::Hex8);
    let mut noise = Noise::new(seed);
    let mut mixed = Connectivity::default();
    for e in 0..scaffold.len() {
        let own = scaffold.connectivity().nodes(e);
        let order = &orders[noise.below(orders.len())];
        let turned: Vec<u32> = order.iter().map(|&n| own[n]).collect();
        mixed.push(Kind::Hex8, &turned);
    }
    Scaffold::new(scaffold.nodes().to_vec(), mixed).unwrap()
}

/// The scaffold with its nodes moved.
fn moved(scaffold: &Scaffold, map: impl Fn(&Vec3) -> Vec3) -> Scaffold {
    let nodes = scaffold.nodes().iter().map(map).collect();
    Scaffold::new(nodes, scaffold.connectivity().clone()).unwrap()
}

/// A warped grid of hexes, and the same with other orders of nodes.
fn grids(counts: [usize; 3]) -> [Scaffold; 2] {
    let size = Vec3::from(counts.map(|n| n as f64));
    let grid = Scaffold::box_grid(size, counts, Kind::Hex8).unwrap();
    let bend = |p: &Vec3| p + Vec3::new(0.2 * p.y.sin(), 0.1 * p.z.cos(), 0.15 * (p.x + p.y).sin());
    let warped = moved(&grid, bend);
    let mixed = renumbered(&warped, 7);
    [warped, mixed]
}

fn text(file: &Path, orient: &str) -> String {
    format!(
        "druse = 1\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nfile = \"{}\"\n\
         [tiling]\ncell = \"g\"\ncertificate = true\n{orient}[band]\nvoxel_size = 0.05\n[[output]]\nvdb = \"a.vdb\"\n",
        file.display()
    )
}

fn report(text: &str, folder: &Path, bricks: Option<u32>) -> Report {
    let options = RunOptions {
        out: Some(folder.to_owned()),
        bricks,
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

/// Origin and values of the leaves of a file.
fn leaves(path: &Path) -> Vec<(Coord, Vec<f32>)> {
    let volume = Volume::read(path, None).unwrap();
    let leaves = volume.leaves().unwrap();
    leaves
        .iter()
        .map(|l| (l.origin, l.values.to_vec()))
        .collect()
}

#[test]
fn a_gyroid_on_a_shuffled_grid_is_that_on_the_ordered_one() {
    let place = tempfile::tempdir().unwrap();
    let [ordered, mixed] = grids([4, 4, 4]);
    let files = ["ordered.vtu", "mixed.vtu"].map(|n| place.path().join(n));
    write_vtu(&files[0], &ordered, &[]).unwrap();
    write_vtu(&files[1], &mixed, &[]).unwrap();
    let folders = ["one", "two"].map(|n| place.path().join(n));
    // Ten voxels along an element.
    let text = |file: &Path, orient: &str| {
        text(file, orient).replace("voxel_size = 0.05", "voxel_size = 0.1")
    };
    let [one, two] = [0, 1].map(|n| report(&text(&files[n], ""), &folders[n], None));
    let continuity = [&one, &two].map(|r| r.continuity.clone().unwrap());
    assert_eq!(continuity[0].turned_elements, 0);
    assert!(continuity[1].turned_elements > 40);
    assert!(
        continuity[1].value_jump_max < 1e-5,
        "{:?}",
        continuity[1].worst
    );
    // A file's nodes are numbered in the order of their use, and so the triangles of the boundary: distances to it are
    // rounded otherwise here and there.
    let [a, b] = folders.each_ref().map(|f| leaves(&f.join("a.vdb")));
    assert_eq!(a.len(), b.len());
    let mut other = 0;
    for ((at, own), (place, theirs)) in a.iter().zip(&b) {
        assert_eq!(at, place);
        for (v, w) in own.iter().zip(theirs) {
            // A millionth of a voxel, in metres.
            assert!((v - w).abs() <= 1e-10, "{at:?}: {v} {w}");
            other += usize::from(v != w);
        }
    }
    assert!(other < 20, "{other}");
    let bricks = report(&text(&files[1], ""), &folders[1], Some(1));
    assert_eq!(two.outputs[0].content_hash, bricks.outputs[0].content_hash);
    // A direction chooses another of the ways in which the gyroid continues.
    let along = "orient = { toward = [\"-1\", 0, 0], up = [0, 0, 1] }\n";
    let along = report(&text(&files[1], along), place.path(), None);
    assert!(along.continuity.unwrap().value_jump_max < 1e-5);
    assert_ne!(one.outputs[0].content_hash, along.outputs[0].content_hash);
}

/// Values of the gyroid at reference points of the ordered grid, where the closed form is known.
#[test]
fn a_gyroid_on_a_shuffled_grid_has_the_values_of_its_formula() {
    let place = tempfile::tempdir().unwrap();
    let [ordered, mixed] = grids([3, 3, 3]);
    let file = place.path().join("mixed.vtu");
    write_vtu(&file, &mixed, &[]).unwrap();
    let recipe = recipe(&text(&file, "").replace("level = -0.3\n", ""));
    let options = RunOptions::default();
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let mut noise = Noise::new(3);
    let (mut points, mut expected) = (Vec::new(), Vec::new());
    for element in ordered.elements() {
        let xi = noise.vector() * 0.49;
        points.push(element.map(druse::frame::CellPoint(xi)).0.into());
        let [(sx, cx), (sy, cy), (sz, cz)] =
            [xi.x, xi.y, xi.z].map(|c| (std::f64::consts::TAU * c).sin_cos());
        expected.push(sx * cy + sy * cz + sz * cx);
    }
    for (found, value) in probe.evaluate(&points, true).unwrap().iter().zip(expected) {
        assert!((found.phi - value).abs() < 1e-9, "{} {value}", found.phi);
    }
}

/// Cylinders with four hexes around every inner edge: an O-grid around a bore, and a square grid swept along the axis.
#[test]
fn a_gyroid_continues_in_cylinders_of_hexes_in_any_numbering() {
    let place = tempfile::tempdir().unwrap();
    let grid = Scaffold::box_grid(Vec3::new(2.0, 2.0, 2.0), [4, 4, 3], Kind::Hex8).unwrap();
    // A square becomes a disc by x = u sqrt(1 - v^2 / 2), whose corners would be flat; nine tenths of it are taken.
    let round = |p: &Vec3| {
        let [u, v] = [p.x - 1.0, p.y - 1.0];
        let squeeze = |t: f64| 0.1 + 0.9 * (1.0 - t * t / 2.0).sqrt();
        Vec3::new(u * squeeze(v), v * squeeze(u), p.z)
    };
    let tube = Scaffold::tube(0.5, 1.5, 2.0, 0.7).unwrap();
    for (n, cylinder) in [tube, moved(&grid, round)].iter().enumerate() {
        let file = place.path().join(format!("{n}.vtu"));
        write_vtu(&file, &renumbered(cylinder, 5), &[]).unwrap();
        let recipe = text(&file, "").replace("voxel_size = 0.05", "voxel_size = 0.1");
        let found = report(&recipe, place.path(), None).continuity.unwrap();
        assert!(found.turned_elements > cylinder.len() / 2);
        assert!(found.value_jump_max < 1e-5, "{:?}", found.worst);
    }
}

/// A cube blown up to a sphere around a void: an edge with three hexes from each of its corners outwards.
fn hollow_sphere(layers: u32) -> Scaffold {
    let corners = druse::frame::Element::Hex.vertices();
    let radius = |layer: u32| 2.0 + 2.0 * f64::from(layer) / f64::from(layers);
    let shell = |layer: u32| corners.iter().map(move |c| c.normalize() * radius(layer));
    let nodes = (0..=layers).flat_map(shell).collect();
    let mut elements = Connectivity::default();
    for layer in 0..layers {
        for face in Kind::Hex8.faces() {
            let at = |layer: u32| face.corners.iter().map(move |&c| u32::from(c) + 8 * layer);
            let own: Vec<u32> = at(layer).chain(at(layer + 1)).collect();
            elements.push(Kind::Hex8, &own);
        }
    }
    Scaffold::new(nodes, elements).unwrap()
}

#[test]
fn a_gyroid_in_a_hollow_sphere_is_refused_by_its_eight_edges_and_one_body_when_mixed() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("sphere.vtu");
    write_vtu(&file, &renumbered(&hollow_sphere(1), 2), &[]).unwrap();
    let coarse = text(&file, "").replace("voxel_size = 0.05", "voxel_size = 0.2");
    let error = run(&recipe(&coarse), &RunOptions::default(), &Silent)
        .err()
        .unwrap();
    let words = error.to_string();
    assert!(words.contains("8 inner edges in 8 lines"), "{words}");
    assert_eq!(words.matches("with 3 elements").count(), 8, "{words}");
    write_vtu(&file, &renumbered(&hollow_sphere(2), 2), &[]).unwrap();
    for width in ["", ", width = 1", ", width = \"0.5\""] {
        let orient = format!("orient = {{ mismatch = \"blend\"{width} }}\n");
        let mesh = "[[op]]\nkeep_largest = true\n[[output]]\nmesh = \"a.ply\"\n";
        let recipe = coarse.replace("certificate", &format!("{orient}certificate")) + mesh;
        let found = report(&recipe, place.path(), None);
        let continuity = found.continuity.as_ref().unwrap();
        assert_eq!(continuity.blended_elements, 12);
        assert!(continuity.value_jump_max < 1e-5, "{:?}", continuity.worst);
        let written = druse::io::read_mesh(place.path().join("a.ply")).unwrap();
        let check = druse::mesh::check(&written.mesh);
        assert_eq!(
            (check.open_edges.count, check.components),
            (0, 1),
            "{check:?}"
        );
        // Bricks know nothing of widths.
        if !width.is_empty() && !crate::is_full() {
            continue;
        }
        let bricks = report(&recipe, place.path(), Some(1));
        let [own, same] = [&found, &bricks].map(|r| r.outputs[0].content_hash.clone());
        assert_eq!(own, same);
    }
    let errors = [
        ("mismatch = \"blend\", width = 0", "above 0 and at most 1"),
        ("mismatch = \"blend\", width = 1.5", "above 0 and at most 1"),
        ("width = 0.3", "mismatch"),
    ];
    for (orient, expected) in errors {
        let text = text(&file, &format!("orient = {{ {orient} }}\n"));
        let error = druse::recipe::Recipe::parse(&text, &[])
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// A bar of struts along one axis of the cell.
fn struts(file: &Path, orient: &str) -> String {
    text(file, orient).replace(
        "surface = \"gyroid\"\nlevel = -0.3",
        "formula = \"-cos(2*pi*x) - cos(2*pi*y)\"\nelement = \"hex\"\ngroup = \"D4h\"\nband_limit = 1.5",
    )
}

/// Values of the exact field of a recipe.
fn values(text: &str, points: &[Vec3]) -> Vec<f64> {
    let recipe = recipe(text);
    let options = RunOptions::default();
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let points: Vec<[f64; 3]> = points.iter().map(|p| (*p).into()).collect();
    let found = probe.evaluate(&points, true).unwrap();
    found.iter().map(|f| f.phi).collect()
}

#[test]
fn struts_along_a_direction_follow_the_helix_of_a_twisted_bar() {
    let place = tempfile::tempdir().unwrap();
    let bar = Scaffold::box_grid(Vec3::new(2.0, 2.0, 8.0), [2, 2, 16], Kind::Hex8).unwrap();
    let turned = |x: f64, y: f64, z: f64| {
        let (sin, cos) = (0.25 * z).sin_cos();
        Vec3::new(x * cos - y * sin, x * sin + y * cos, z)
    };
    let file = place.path().join("bar.vtu");
    let twisted = moved(&bar, |p| turned(p.x - 1.0, p.y - 1.0, p.z));
    write_vtu(&file, &renumbered(&twisted, 4), &[]).unwrap();
    let heights = || (1..160).map(|n| f64::from(n) * 0.05);
    let helix: Vec<Vec3> = heights().map(|z| turned(0.5, -0.5, z)).collect();
    let line: Vec<Vec3> = heights().map(|z| Vec3::new(0.5, -0.5, z)).collect();
    let along = struts(&file, "orient = { toward = [0, 0, 1] }\n");
    // Between the nodes of a hex its edges are straight, at most 0.01 off the helix.
    assert!(values(&along, &helix).iter().all(|v| *v < -1.9));
    // Between four struts the line meets the middle of a side: -cos(0.41 pi) + 1.
    assert!(values(&along, &line).iter().any(|v| *v > 0.7));
    let across = struts(&file, "orient = { toward = [1, 0, 0] }\n");
    assert!(values(&across, &helix).iter().any(|v| *v > -0.1));
}

/// A .vtu of hexes with fields of several numbers, at the cells or the points, the same everywhere.
fn write_fields(path: &Path, scaffold: &Scaffold, fields: &[(&str, bool, &[f64])]) {
    let all = |rows: &mut dyn Iterator<Item = String>| rows.collect::<Vec<_>>().join(" ");
    let array = |name: &str, kind: &str, numbers: usize, values: String| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{numbers}\" format=\"ascii\">\
             {values}</DataArray>\n"
        )
    };
    let data = |is_at_cells: bool, count: usize| {
        let own = fields.iter().filter(|f| f.1 == is_at_cells);
        let arrays = own.map(|(name, _, v)| {
            let row = all(&mut v.iter().map(f64::to_string));
            array(name, "Float64", v.len(), vec![row; count].join("\n"))
        });
        arrays.collect::<String>()
    };
    let (nodes, count) = (scaffold.nodes(), scaffold.len());
    let connectivity = scaffold.connectivity();
    let text = format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
         <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{count}\">\n<Points>{}</Points><Cells>{}{}{}</Cells>\
         <PointData>{}</PointData><CellData>{}</CellData></Piece></UnstructuredGrid></VTKFile>\n",
        nodes.len(),
        array(
            "p",
            "Float64",
            3,
            all(&mut nodes.iter().map(|p| format!("{} {} {}", p.x, p.y, p.z)))
        ),
        array(
            "connectivity",
            "Int64",
            1,
            all(&mut (0..count).map(|e| all(&mut connectivity.nodes(e).iter().map(u32::to_string)))),
        ),
        array(
            "offsets",
            "Int64",
            1,
            all(&mut (1..=count).map(|e| (8 * e).to_string()))
        ),
        array("types", "UInt8", 1, vec!["12"; count].join(" ")),
        data(false, nodes.len()),
        data(true, count),
    );
    std::fs::write(path, text).unwrap();
}

/// A block turned by 45 degrees about x, so that y + z and z - y are axes of its elements.
#[test]
fn directions_of_files_are_those_of_their_vectors_and_stresses() {
    let place = tempfile::tempdir().unwrap();
    let block = Scaffold::box_grid(Vec3::repeat(2.0), [2, 2, 2], Kind::Hex8).unwrap();
    let s = std::f64::consts::FRAC_1_SQRT_2;
    let axes = [[1.0, 0.0, 0.0], [0.0, s, s], [0.0, -s, s]].map(Vec3::from);
    let turn = |p: &Vec3| axes[0] * p.x + axes[1] * p.y + axes[2] * p.z;
    let file = place.path().join("block.vtu");
    let vector = [0.2, 3.0, 2.5];
    let at_nodes = [-0.1, -1.0, 1.2];
    let six = [0.5, 0.5, 0.5, 0.0, -0.9, 0.0];
    let nine = [0.5, 0.0, 0.0, 0.0, 0.5, 0.9, 0.0, 0.9, 0.5];
    let pressed = [-5.0, 1.0, 1.0, 0.0, 0.3, 0.0];
    let fields: [(&str, bool, &[f64]); 10] = [
        ("vector", true, &vector),
        ("at_nodes", false, &at_nodes),
        ("six", true, &six),
        ("nine", true, &nine),
        ("pressed", true, &pressed),
        // In a file whose y axis points up, (x, y, z) is (x, -z, y) in the recipe.
        ("standing", true, &[0.0, 1.0, -1.0]),
        ("standing_six", true, &[0.0, 1.0, 1.0, 0.0, -2.0, 0.0]),
        ("one", true, &[1.0]),
        ("two", true, &[1.0, 2.0]),
        ("zero", true, &[0.0; 6]),
    ];
    write_fields(&file, &renumbered(&moved(&block, turn), 6), &fields);
    let principal = |name: &str| format!("{{ field = \"{name}\", component = \"principal\" }}");
    let standing = |rest: &str| {
        format!(
            "{{ file = {{ path = \"{}\", up = \"y\" }}, {rest} }}",
            file.display()
        )
    };
    let expected = [
        ("{ field = \"vector\" }".to_owned(), 1),
        ("{ field = \"at_nodes\" }".to_owned(), 2),
        (principal("six"), 2),
        (principal("nine"), 1),
        (principal("pressed"), 0),
        (standing("field = \"standing\""), 1),
        (
            standing("field = \"standing_six\", component = \"principal\""),
            1,
        ),
    ];
    let centres = || {
        block
            .elements()
            .map(|e| e.map(druse::frame::CellPoint(Vec3::zeros())).0)
    };
    for (toward, axis) in expected {
        let text = struts(&file, &format!("orient = {{ toward = {toward} }}\n"));
        let [a, b, c] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|n| axes[n]);
        let within = centres().map(|p| turn(&p) + a * 0.45);
        let beside = centres().map(|p| turn(&p) + (b + c) * 0.45);
        let found = values(&text, &within.chain(beside).collect::<Vec<_>>());
        let (within, beside) = found.split_at(block.len());
        assert!(within.iter().all(|v| *v < -1.9), "{toward}: {within:?}");
        assert!(beside.iter().all(|v| *v > 1.5), "{toward}: {beside:?}");
    }
    let errors = [
        (
            "{ field = \"one\" }".to_owned(),
            "\"one\" has 1 number for each place; expected 3",
        ),
        ("{ field = \"two\" }".to_owned(), "has 2 numbers"),
        (
            "{ field = \"six\" }".to_owned(),
            "component = \"principal\"",
        ),
        (
            principal("vector"),
            "has 3 numbers for each place; expected 6 or 9",
        ),
        (principal("zero"), "length 0 at (0.5, "),
        (principal("none"), "no field \"none\""),
    ];
    for (toward, expected) in errors {
        let text = struts(&file, &format!("orient = {{ toward = {toward} }}\n"));
        let error = run(&recipe(&text), &RunOptions::default(), &Silent)
            .err()
            .unwrap();
        assert!(error.to_string().contains(expected), "{error}");
        assert!(
            error.to_string().contains("orient.toward") || expected.contains("none"),
            "{error}"
        );
    }
    let one = "orient = { toward = { field = \"vector\", component = \"x\" } }\n";
    let error = druse::recipe::Recipe::parse(&text(&file, one), &[])
        .err()
        .unwrap();
    assert!(error.to_string().contains("principal"), "{error}");
}

#[test]
fn a_misspelt_field_of_a_gmsh_file_gets_the_nearest_name() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("a.msh");
    let msh = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n\
        5 0 0 1\n6 1 0 1\n7 1 1 1\n8 0 1 1\n$EndNodes\n$Elements\n1\n1 5 2 1 1 1 2 3 4 5 6 7 8\n$EndElements\n\
        $ElementData\n1\n\"vector\"\n1\n0\n3\n0\n3\n1\n1 0 0 1\n$EndElementData\n";
    std::fs::write(&file, msh).unwrap();
    let toward = |name: &str| {
        let text = format!("orient = {{ toward = {{ field = \"{name}\" }} }}\n");
        run(
            &recipe(&struts(&file, &text)),
            &RunOptions::default(),
            &Silent,
        )
    };
    let Err(RunError::Read(error)) = toward("vectr").map(|_| ()) else {
        panic!("no error of reading");
    };
    assert_eq!(error.hint(), Some("did you mean \"vector\"?"));
}

#[test]
fn a_gyroid_in_a_ball_is_refused_with_the_edges_and_a_bad_direction_with_its_place() {
    let error = |text: &str| {
        let options = RunOptions::default();
        run(&recipe(text), &options, &Silent).err().unwrap()
    };
    let ball = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\nsphere = { radius = 6, cell_size = 4 }\n\
                [tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.5\n";
    let found = error(ball);
    let RunError::Misfit { misfit, .. } = &found else {
        panic!("{found}");
    };
    // The edges of the core and those from its corners outwards.
    assert_eq!(misfit.lines, 20, "{found}");
    assert!(misfit.edges.iter().all(|e| e.elements == 3));
    assert!(found.to_string().contains("with 3 elements"), "{found}");
    assert!(found.to_string().contains("mismatch"), "{found}");
    let block = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\nbox = { size = [2, 2, 2], cell_size = 1 }\n\
                 [tiling]\ncell = \"g\"\norient = { toward = [\"x - 0.5\", 0, 0] }\n[band]\nvoxel_size = 0.1\n";
    let found = error(block).to_string();
    assert!(
        found.contains("tiling.orient.toward") && found.contains("0.5, 0.5, 0.5"),
        "{found}"
    );
    let field = block.replace(
        "[\"x - 0.5\", 0, 0]",
        "{ field = \"u\", component = \"principal\" }",
    );
    assert!(error(&field).to_string().contains("a field needs a file"));
}

/// The cost of turning the elements alone; the time is printed, not judged.
#[test]
#[ignore = "long; tests/run full"]
fn a_million_hexes_are_turned() {
    use druse::tiling::{Aim, Member, Mismatch, orient};
    let [ordered, mixed] = grids([100, 100, 100]);
    let mut mixed = std::sync::Arc::new(mixed);
    let gyroid = druse::cell::Surface::Gyroid
        .cell(druse::frame::Element::Hex)
        .unwrap();
    let members = [Member {
        name: String::new(),
        cells: vec![&gyroid],
    }];
    let start = std::time::Instant::now();
    orient(&mut mixed, &members, &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    println!(
        "figure: turning {} hexes, seconds | {:.2} | 3",
        mixed.len(),
        start.elapsed().as_secs_f64()
    );
    assert_eq!(mixed.connectivity(), ordered.connectivity());
}

/// Around edges with three hexes the cell is mixed from its turns: one closed body, the same in bricks.
#[test]
fn a_gyroid_in_a_ball_is_one_body_where_its_turns_are_mixed() {
    let place = tempfile::tempdir().unwrap();
    let ball = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nsphere = { radius = 6, cell_size = 3 }\n\
                [tiling]\ncell = \"g\"\ncertificate = true\norient = { mismatch = \"blend\" }\n[band]\nvoxel_size = 0.2\n\
                [[op]]\nkeep_largest = true\n[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.ply\"\n";
    let whole = report(ball, place.path(), None);
    let continuity = whole.continuity.as_ref().unwrap();
    assert!(continuity.blended_elements > 0);
    assert!(continuity.value_jump_max < 1e-5, "{:?}", continuity.worst);
    let file = druse::io::read_mesh(place.path().join("a.ply")).unwrap();
    let check = druse::mesh::check(&file.mesh);
    assert_eq!(
        (check.open_edges.count, check.components),
        (0, 1),
        "{check:?}"
    );
    let bricks = report(ball, place.path(), Some(2));
    let hashes = [&whole, &bricks].map(|r| r.outputs[0].content_hash.clone());
    assert_eq!(hashes[0], hashes[1]);
    // Thin walls around its mid-surface are mixed likewise.
    let sheet = ball
        .replace("level = -0.3", "solid = \"sheet\"")
        .replace("certificate = true", "thickness = \"0.5\"");
    assert!(
        report(&sheet, place.path(), None).outputs[0]
            .content_hash
            .is_some()
    );
    let words = [
        ("mismatch = \"mix\"", "blend"),
        ("up = [1, 0, 0]", "toward"),
    ];
    for (wrong, expected) in words {
        let text = ball.replace("mismatch = \"blend\"", wrong);
        let error = druse::recipe::Recipe::parse(&text, &[])
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}
