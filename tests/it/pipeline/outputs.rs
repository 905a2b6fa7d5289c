//! Laws of outputs: grids to shade by, pieces, coarser copies, NanoVDB, USD, meshes as wished.

use druse::io::read_mesh;
use druse::mesh::check;
use druse::pipeline::{Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use druse::vdb::{self, Volume};
use std::path::Path;

fn make(text: &str, out: &Path) -> Result<Report, RunError> {
    let recipe = Recipe::parse(text, &[])?;
    let options = RunOptions {
        out: Some(out.to_owned()),
        brief: true,
        threads: 2,
        ..RunOptions::default()
    };
    run(&recipe, &options, &Silent)
}

/// Two cells along x in eight cubes, intersected with the solid; then any outputs.
fn lattice(outputs: &str) -> String {
    format!(
        "druse = 1\n[cell.a]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.4\n\
         [cell.b]\nsurface = \"iwp\"\nvolume_fraction = 0.4\n\
         [scaffold]\nbox = {{ size = [4, 2, 2], cell_size = 1 }}\n\
         [tiling]\ntransition = [{{ cell = \"a\", weight = \"1 - bx\" }}, {{ cell = \"b\", weight = \"bx\" }}]\n\
         [band]\nvoxel_size = 0.05\n{outputs}"
    )
}

/// Numbers of a PLY's vertices by property, as the file gives them: names and rows.
pub(super) fn ply_rows(path: &Path) -> (Vec<String>, Vec<Vec<f32>>) {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut names = Vec::new();
    let mut count = 0;
    for line in head.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["element", "vertex", n] => count = n.parse().unwrap(),
            ["property", "float", name] => names.push(name.to_owned()),
            _ => {}
        }
    }
    let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let rows = (0..count).map(|r: usize| {
        let start = end + 4 * names.len() * r;
        (0..names.len()).map(|c| number(start + 4 * c)).collect()
    });
    let rows = rows.collect();
    (names, rows)
}

#[test]
fn grids_and_vertex_attributes_say_the_same_of_a_place() {
    let words = "[\"cell_id\", \"element_id\", \"weight_b\", \"thickness\", \"uvw\", \"fold\"]";
    let text = lattice(&format!(
        "[[output]]\nvdb = \"a.vdb\"\nunit = \"mm\"\ngrids = {}\n[[output]]\nmesh = \"a.ply\"\ngrids = {words}\n",
        words.replacen('[', "[\"surface\", \"density\", ", 1)
    ));
    let place = tempfile::tempdir().unwrap();
    make(&text, place.path()).unwrap();
    let (names, rows) = ply_rows(&place.path().join("a.ply"));
    let expected =
        "x y z cell_id element_id weight_b thickness uvw_x uvw_y uvw_z fold_x fold_y fold_z";
    assert_eq!(names.join(" "), expected);
    // The box stands at the origin: its least corner gives the place.
    let least: Vec<f32> = (0..3)
        .map(|a| rows.iter().map(|r| r[a]).fold(f32::MAX, f32::min))
        .collect();
    let mut off_face = 0;
    for r in &rows {
        let along = (r[0] - least[0]) / 4.0;
        assert!((r[5] - along).abs() < 0.02, "weight {} at {along}", r[5]);
        assert_eq!(r[3], f32::from(r[5] > 0.5), "{r:?}");
        assert!(r[6] > 0.0 && r[6] < 2.0, "thickness {}", r[6]);
        let mut folded = [r[7].abs(), r[8].abs(), r[9].abs()];
        folded.sort_by(|a, b| b.total_cmp(a));
        assert_eq!(folded, [r[10], r[11], r[12]]);
        // Where in its cube a vertex is, from its place alone.
        for a in 0..3 {
            let u = (r[a] - least[a]).fract() - 0.5;
            if u.abs() < 0.45 && r[7 + a].abs() < 0.45 {
                assert!((u - r[7 + a]).abs() < 0.02, "{r:?} {u}");
                off_face += 1;
            }
        }
    }
    assert!(off_face > rows.len());

    let path = place.path().join("a.vdb");
    let info = vdb::info(&path).unwrap();
    let found: Vec<&str> = info.grids.iter().map(|g| g.name.as_str()).collect();
    for name in [
        "surface",
        "density",
        "cell_id",
        "element_id",
        "weight_b",
        "thickness",
        "uvw",
        "fold",
    ] {
        assert!(found.contains(&name), "{name} is not in {found:?}");
    }
    let weight = Volume::read(&path, Some("weight_b")).unwrap();
    let points: Vec<druse::frame::WorldPoint> = rows
        .iter()
        .map(|r| druse::frame::WorldPoint([r[0].into(), r[1].into(), r[2].into()].into()))
        .collect();
    let sampled = weight.samples(&points).unwrap();
    let worst = sampled.iter().zip(&rows).map(|(s, r)| (s - r[5]).abs());
    assert!(worst.fold(0.0, f32::max) < 0.02);
}

#[test]
fn pieces_become_grids_or_files_and_copies_grow_coarser() {
    let balls = "druse = 1\n[band]\nvoxel_size = 0.1\n\
        [[op]]\nunion = { sphere = { radius = 2 } }\n\
        [[op]]\nunion = { sphere = { radius = 1, centre = [5, 0, 0] } }\n";
    let place = tempfile::tempdir().unwrap();
    let outputs = "[[output]]\nvdb = \"g.vdb\"\nunit = \"mm\"\nsegments = \"grids\"\nusda = true\n\
        [[output]]\nvdb = \"f.vdb\"\nunit = \"mm\"\nsegments = \"files\"\n\
        [[output]]\nvdb = \"l.vdb\"\nunit = \"mm\"\nlod = 2\n";
    let report = make(&format!("{balls}{outputs}"), place.path()).unwrap();
    let names: Vec<String> = report
        .outputs
        .iter()
        .map(|o| {
            Path::new(&o.path)
                .file_name()
                .unwrap()
                .to_string_lossy()
                .into()
        })
        .collect();
    assert_eq!(names, ["g.vdb", "g.usda", "f_1.vdb", "f_2.vdb", "l.vdb"]);
    let grids = |name: &str| vdb::info(&place.path().join(name)).unwrap().grids;
    let of = |name: &str| -> Vec<(String, u64)> {
        let all = grids(name).into_iter();
        all.map(|g| (g.name, g.active_voxels)).collect()
    };
    let pieces = of("g.vdb");
    assert_eq!(pieces.len(), 2);
    assert_eq!(
        (of("f_1.vdb")[0].1, of("f_2.vdb")[0].1),
        (pieces[0].1, pieces[1].1)
    );
    // Areas go as the squares of the radii.
    let ratio = pieces[0].1 as f64 / pieces[1].1 as f64;
    assert!((ratio / 4.0 - 1.0).abs() < 0.1, "{ratio}");
    let copies = of("l.vdb");
    let found: Vec<&str> = copies.iter().map(|c| c.0.as_str()).collect();
    assert_eq!(found, ["surface", "surface_lod_1", "surface_lod_2"]);
    let ratio = copies[0].1 as f64 / copies[1].1 as f64;
    assert!((ratio / 4.0 - 1.0).abs() < 0.2, "{ratio}");
    let scene = std::fs::read_to_string(place.path().join("g.usda")).unwrap();
    for word in [
        "#usda 1.0",
        "metersPerUnit = 0.001",
        "def Volume \"g\"",
        "rel field:surface_2 = </g/surface_2>",
        "asset filePath = @./g.vdb@",
        "token fieldClass = \"levelSet\"",
    ] {
        assert!(scene.contains(word), "{word}: {scene}");
    }
}

#[test]
fn meshes_follow_the_options_of_their_outputs() {
    let text = "druse = 1\n[band]\nvoxel_size = 0.2\n\
        [[op]]\nunion = { box = { size = [4, 4, 4] } }\n\
        [[op]]\nsubtract = { cylinder = { from = [0, 0, -9], to = [0, 0, 9], radius = 1.23 } }\n\
        [[output]]\nmesh = \"plain.ply\"\n\
        [[output]]\nmesh = \"quads.obj\"\nquads = true\n\
        [[output]]\nmesh = \"sharp.stl\"\nsharp = true\n\
        [[output]]\nmesh = \"few.ply\"\ndecimate = 0.1\n\
        [[output]]\nmesh = \"few_sharp.3mf\"\nsharp = true\ndecimate = { share = 0.01, error = 0.01 }\n\
        [[output]]\nmesh = \"flat.ply\"\nadaptivity = 0.5\n";
    let place = tempfile::tempdir().unwrap();
    let report = make(text, place.path()).unwrap();
    let exact = 4.0 * (16.0 - std::f64::consts::PI * 1.23f64.powi(2));
    let faces: Vec<u64> = report
        .outputs
        .iter()
        .filter_map(|o| Some(o.mesh?.faces))
        .collect();
    let (plain, few, flat) = (faces[0], faces[3], faces[5]);
    assert_eq!(2 * faces[1], plain, "quads");
    assert!(
        (few as f64 / plain as f64 - 0.1).abs() < 0.01,
        "{few} of {plain}"
    );
    assert!(flat < plain / 2, "{flat} of {plain}");
    // A coordinate of f32 for each sharp edge: the volume is the exact solid's but for the bore's chords.
    for (name, tolerance) in [
        ("plain.ply", 0.05),
        ("quads.obj", 0.05),
        ("sharp.stl", 2e-3),
        ("few.ply", 0.05),
        ("few_sharp.3mf", 4e-3),
    ] {
        let mesh = read_mesh(place.path().join(name)).unwrap().mesh;
        let found = check(&mesh);
        let sound = found.is_closed() && found.is_oriented() && found.is_manifold();
        assert!(sound, "{name}: {found}");
        assert!(
            (found.volume / exact - 1.0).abs() < tolerance,
            "{name}: {found} {exact}"
        );
    }
    let sharp = report.outputs[2].mesh.unwrap();
    assert!(
        sharp.creased.unwrap() > 100 && sharp.error.unwrap() < 1e-3,
        "{sharp:?}"
    );
}

#[test]
fn wishes_that_cannot_be_met_are_refused_with_the_reason() {
    let ball = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 2 } }\n";
    let cases = [
        (
            "[[output]]\nmesh = \"a.stl\"\nquads = true\n",
            "triangles only",
        ),
        (
            "[[output]]\nmesh = \"a.ply\"\nquads = true\ndecimate = 0.5\n",
            "without quads",
        ),
        (
            "[[op]]\ngaussian = 1\n[[output]]\nmesh = \"a.ply\"\nproject = true\n",
            "op.1.gaussian",
        ),
        (
            "[[output]]\nmesh = \"a.ply\"\nsharp = true\nadaptivity = 0.1\n",
            "exact field",
        ),
        (
            "[[output]]\nmesh = \"a.ply\"\ndecimate = 1.5\n",
            "between 0 and 1",
        ),
        (
            "[[output]]\nvdb = \"a.vdb\"\nsharp = true\n",
            "belongs to an output with mesh",
        ),
        (
            "[[output]]\nvdb = \"a.vdb\"\ngrids = [\"uvw\"]\n",
            "needs a [scaffold]",
        ),
        (
            "[[output]]\nvdb = \"a.vdb\"\ngrids = [\"uwv\"]\n",
            "expected one of surface",
        ),
        (
            "[[output]]\nmesh = \"a.stl\"\ngrids = [\"thickness\"]\n",
            "with a .ply mesh",
        ),
        (
            "[[output]]\nmesh = \"a.ply\"\ngrids = [\"density\"]\n",
            "no value at a vertex",
        ),
        (
            "[[output]]\nvdb = \"a.vdb\"\ngrids = [\"surface\", \"surface\"]\n",
            "twice",
        ),
        ("[[output]]\nvdb = \"a.vdb\"\nlod = 9\n", "1 to 8"),
        (
            "[[output]]\nvdb = \"a.nvdb\"\nhalf = true\n",
            "32-bit floats",
        ),
        (
            "[[output]]\nvdb = \"a.nvdb\"\nusda = true\n",
            "a .usda names",
        ),
    ];
    let place = tempfile::tempdir().unwrap();
    for (output, word) in cases {
        let error = make(&format!("{ball}{output}"), place.path())
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{output}: {error}");
    }
    let weight = lattice("[[output]]\nvdb = \"a.vdb\"\ngrids = [\"weight_c\"]\n");
    let error = make(&weight, place.path()).unwrap_err().to_string();
    assert!(error.contains("no cell \"c\"; it has a, b"), "{error}");
}

/// NanoVDB's own validator, where it is installed, reads what is written.
#[test]
fn nanovdb_files_are_what_nanovdb_reads() {
    let text = lattice(
        "[[output]]\nvdb = \"a.nvdb\"\ngrids = [\"surface\", \"density\", \"cell_id\", \"uvw\"]\n\
         [[output]]\nvdb = \"z.nvdb\"\ncompression = \"zip\"\n",
    );
    let place = tempfile::tempdir().unwrap();
    make(&text, place.path()).unwrap();
    for name in ["a.nvdb", "z.nvdb"] {
        let path = place.path().join(name);
        let head = std::fs::read(&path).unwrap();
        assert_eq!(&head[..8], b"NanoVDB0", "{name}");
        let validator = std::process::Command::new("nanovdb_validate")
            .arg("-v")
            .arg(&path)
            .output();
        let Ok(found) = validator else {
            println!("no nanovdb_validate here: {name} was not read");
            continue;
        };
        assert!(found.status.success(), "{name}: {found:?}");
    }
}

#[test]
fn beams_are_the_struts_of_every_element_once() {
    let text = |ops: &str, scaffold: &str| {
        format!(
            "druse = 1\n[cell.c]\ngraph = \"bcc\"\nradius = 0.1\n[scaffold]\n{scaffold}\n[tiling]\ncell = \"c\"\n\
             [band]\nvoxel_size = 0.2\n{ops}[[output]]\nmesh = \"b.3mf\"\nbeams = true\n"
        )
    };
    let place = tempfile::tempdir().unwrap();
    let block = "box = { size = [4, 4, 2], cell_size = 2 }";
    let report = make(&text("", block), place.path()).unwrap();
    // Four cubes, each with eight halves of its space diagonals or four whole ones.
    let beams = report.outputs[0].mesh.unwrap().faces;
    assert!(beams == 16 || beams == 32, "{beams}");
    let file = std::fs::File::open(place.path().join("b.3mf")).unwrap();
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let mut model = String::new();
    let mut entry = archive.by_name("3D/3dmodel.model").unwrap();
    std::io::Read::read_to_string(&mut entry, &mut model).unwrap();
    assert_eq!(model.matches("<b:beam v1=").count() as u64, beams);
    // Twice as large as the reference cube, and so is the radius.
    assert_eq!(model.matches("r1=\"0.2\" r2=\"0.2\"").count() as u64, beams);
    assert!(model.contains("requiredextensions=\"b\"") && model.contains("cap=\"sphere\""));
    for (ops, scaffold, word) in [
        ("[[op]]\ndilate = 0.1\n", block, "op.0.dilate"),
        ("", "sphere = { radius = 3, cell_size = 2 }", "beams"),
    ] {
        let error = make(&text(ops, scaffold), place.path())
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{error}");
    }
}
