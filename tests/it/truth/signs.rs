//! Parts whose faces lie in planes of voxels: the report, the written mesh and the level set agree with closed forms.

use crate::mesh::signs::{Part, random_part};
use druse::io::read_mesh;
use druse::mesh::{MeshSolid, TriMesh, check};
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Writes a mesh with all digits of its coordinates.
fn write_obj(path: &Path, part: &Part) {
    let mut text = String::new();
    for p in part.mesh.vertices() {
        let _ = writeln!(text, "v {:?} {:?} {:?}", p.x, p.y, p.z);
    }
    for [a, b, c] in part.mesh.triangles() {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    std::fs::write(path, text).unwrap();
}

fn made(directory: &Path, voxel: f64, ops: &str) -> Result<Report, String> {
    let text = format!("druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n{ops}");
    let recipe = Recipe::parse(&text, &[]).map_err(|e| e.to_string())?;
    let options = RunOptions {
        out: Some(directory.to_owned()),
        ..RunOptions::default()
    };
    run(&recipe, &options, &Silent).map_err(|e| e.to_string())
}

/// The number of shells of a mesh with a positive volume.
fn bodies(mesh: &TriMesh) -> u64 {
    fn find(root: &mut [usize], mut v: usize) -> usize {
        while root[v] != v {
            root[v] = root[root[v]];
            v = root[v];
        }
        v
    }
    let mut root: Vec<usize> = (0..mesh.vertices().len()).collect();
    for &[a, b, c] in mesh.triangles() {
        for other in [b, c] {
            let (a, other) = (find(&mut root, a as usize), find(&mut root, other as usize));
            root[a] = other;
        }
    }
    let mut volumes: BTreeMap<usize, f64> = BTreeMap::new();
    let origin = mesh.bounds().min;
    for (corners, tri) in mesh.iter_corners().zip(mesh.triangles()) {
        let [a, b, c] = corners.map(|p| p - origin);
        *volumes.entry(find(&mut root, tri[0] as usize)).or_default() += a.dot(&b.cross(&c));
    }
    volumes.values().filter(|volume| **volume > 0.0).count() as u64
}

/// What is wrong with a part that is an operand.
fn wrong_result(part: &Part, h: f64, role: u64) -> Result<(), String> {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path();
    let source = place.join("part.obj");
    write_obj(&source, part);
    let bounds = part.mesh.bounds();
    let operand = format!(
        "{{ mesh = {{ path = \"{}\", unit = \"mm\" }} }}",
        source.display()
    );
    let around = bounds.dilated(4.0 * h);
    let (size, centre) = (around.size(), around.centre().0);
    let block = format!(
        "[[op]]\nunion = {{ box = {{ size = {:?}, centre = {:?} }} }}\n",
        <[f64; 3]>::from(size),
        <[f64; 3]>::from(centre)
    );
    let ops = match role {
        0 => format!("[[op]]\nunion = {operand}\n"),
        1 => format!("{block}[[op]]\nintersect = {operand}\n"),
        _ => format!("{block}[[op]]\nsubtract = {operand}\n"),
    };
    let outputs = "[[output]]\nmesh = \"made.stl\"\n[[output]]\nvdb = \"made.vdb\"\n";
    let report = made(place, h, &format!("{ops}{outputs}"))?;
    // A bar of two voxels square becomes a diamond: exactly this loss. The margins that vertices keep from voxels take a
    // hundredth of a voxel from the corners of a frame.
    let (inside, mut edge_loss) = (
        part.volume(h),
        0.25 * h * part.mesh.area() + 0.01 * h.powi(3),
    );
    let found = report.solid.volume;
    let right = if role == 2 {
        edge_loss += 2.0 * h * h * size.sum();
        size.product() - inside
    } else {
        inside
    };
    // Edges are rounded within a voxel.
    if (found - right).abs() > edge_loss {
        return Err(format!(
            "volume {found}, expected {right} within {edge_loss}"
        ));
    }
    let mesh = read_mesh(place.join("made.stl"))
        .map_err(|e| e.to_string())?
        .mesh;
    let checked = check(&mesh);
    if !checked.is_sound() {
        return Err(format!("not sound: {checked}"));
    }
    let limits =
        if role == 2 { around } else { bounds }.dilated(0.01 * h + 1e-6 * around.max.amax());
    let written = mesh.bounds();
    if (0..3).any(|a| written.min[a] < limits.min[a] || written.max[a] > limits.max[a]) {
        return Err(format!("{written:?} leaves {limits:?}"));
    }
    // Vertices of the file keep four roundings to single precision from voxels, and are rounded themselves.
    let rounding =
        checked.area * 4.5 * f64::from(f32::EPSILON) * written.min.amax().max(written.max.amax());
    if (checked.volume - found).abs() > 1e-4 * right + rounding {
        return Err(format!("mesh of {}, report of {found}", checked.volume));
    }
    let (bodies, counted) = (bodies(&mesh), report.solid.components);
    if bodies != counted {
        return Err(format!(
            "{bodies} bodies in the mesh, {counted} in the report"
        ));
    }
    // What is written can be read.
    let (_, repairs) = MeshSolid::repaired(mesh).map_err(|e| e.to_string())?;
    if !repairs.is_empty() {
        return Err(format!("repairs {repairs:?}"));
    }
    let again = format!(
        "[[op]]\nunion = {{ vdb = \"{}\" }}\n",
        place.join("made.vdb").display()
    );
    let again = made(place, h, &again)?;
    if (again.solid.volume - found).abs() > 1e-5 * found
        || again.solid.components != report.solid.components
    {
        return Err(format!(
            "read as {} in {}",
            again.solid.volume, again.solid.components
        ));
    }
    Ok(())
}

#[test]
fn parts_in_planes_of_voxels_are_made_right_in_each_role() {
    crate::each_case(42, &[112, 231, 1115, 1827, 1908, 3311, 4585], |case| {
        let (part, h) = random_part(case);
        let result = wrong_result(&part, h, case / 7 % 3);
        result.err().map(|what| format!("voxels of {h}: {what}"))
    });
}
