//! What the cells' fits reach and what they cost: `cargo bench --bench cells`; with `-- speed` only what
//! they cost.
//!
//! Accuracy: four cells of the reference tetrahedron fitted with about 240 coefficients, by least
//! squares over the element and by the mirror extension of the literature, without and with a right
//! angle at the faces; lengths in reference units (edge sqrt 2). Speed: the least squares with 1,500
//! unknowns, the winding number of 8,192 loose triangles, and look-ups in tables along the rows of turned
//! leaves, 40 voxels to the unit.

use druse::cell::{Cell, FitOptions, Method, Solver, Table, fit};
use druse::field::{Field, SampleLattice};
use druse::frame::{CellPoint, Element, Vec3, WorldPoint};
use druse::mesh::{MeshSolid, TriMesh};
use druse::progress::{Silent, Threads};
use std::hint::black_box;
use std::time::Instant;

fn segment(x: Vec3, a: Vec3, b: Vec3) -> f64 {
    let d = b - a;
    let t = ((x - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
    (x - a - d * t).norm()
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

/// A ball of radius 0.15 with struts of radius 0.07 to the vertices.
fn sphere_struts(p: CellPoint<3>) -> f64 {
    let ends = Element::Tet.vertices().into_iter();
    let struts = least(ends.map(|v| segment(p.0, Vec3::zeros(), v)));
    (p.0.norm() - 0.15).min(struts - 0.07)
}

/// Struts of radius 0.08 along the edges.
fn edge_frame(p: CellPoint<3>) -> f64 {
    let v = Element::Tet.vertices();
    let pairs = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
    least(pairs.map(|(i, j)| segment(p.0, v[i], v[j]))) - 0.08
}

/// Plates of thickness 0.05 inside the faces.
fn face_plates(p: CellPoint<3>) -> f64 {
    -Element::Tet.face_distance(p) - 0.05
}

/// Cylinders of radius 0.1 about the three axes.
fn cross(p: CellPoint<3>) -> f64 {
    let s = p.0.component_mul(&p.0);
    (s.sum() - s.max()).max(0.0).sqrt() - 0.1
}

type Shape = fn(CellPoint<3>) -> f64;

fn accuracy() {
    println!(
        "{:<19}{:<24}{:>4} {:>8} {:>8} {:>8}  {:>15} {:>8} {:>8} {:>9}",
        "cell",
        "method",
        "dof",
        "rms",
        "face",
        "edge",
        "Hausdorff (two)",
        "|grad|in",
        "out",
        "normal"
    );
    let shapes: [(&str, Shape); 4] = [
        ("sphere and struts", sphere_struts),
        ("edge frame", edge_frame),
        ("face plates", face_plates),
        ("cross", cross),
    ];
    for (name, shape) in shapes {
        for face_normal in [false, true] {
            for (label, method, band_limit) in [
                ("least squares", Method::Lsq, 7.8),
                ("mirror extension", Method::Paper, 10.0),
            ] {
                let options = FitOptions {
                    method,
                    band_limit,
                    face_normal,
                    ..FitOptions::default()
                };
                let label = format!("{label}{}", if face_normal { ", normal" } else { "" });
                match fit(name, Element::Tet, &shape, &options, &Silent) {
                    Ok(cell) => row(name, &label, &cell),
                    Err(error) => println!("{name:<19}{label:<24}{error}"),
                }
            }
        }
    }
}

fn row(name: &str, label: &str, cell: &Cell) {
    let Some(r) = cell.report() else { return };
    let h = r.hausdorff.unwrap_or_default();
    println!(
        "{name:<19}{label:<24}{:>4} {:>8.5} {:>8.5} {:>8.5}  {:>7.4}/{:<7.4} {:>8.2} {:>8.2} {:>9.1e}",
        r.degrees_of_freedom,
        r.rms,
        r.face_max,
        r.edge_max,
        h.cell_to_source,
        h.source_to_cell,
        r.gradient_inside,
        r.gradient_outside,
        r.face_normal_residual
    );
}

/// Least of several times, in seconds.
fn seconds(times: usize, mut work: impl FnMut()) -> f64 {
    (0..times)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// The least squares with 1,500 unknowns, by both solvers.
fn many_unknowns() {
    for (label, solver) in [("dense", Solver::Dense), ("iterative", Solver::Iterative)] {
        let options = FitOptions {
            band_limit: 14.4,
            solver,
            measure: false,
            ..FitOptions::default()
        };
        let start = Instant::now();
        match fit("struts", Element::Tet, &sphere_struts, &options, &Silent) {
            Ok(cell) => {
                let report = cell.report().cloned().unwrap_or_default();
                println!(
                    "least squares with {} unknowns, {label} ({}): {:.2} s (at most 5), rms {:.5}",
                    report.degrees_of_freedom,
                    report.solver,
                    start.elapsed().as_secs_f64(),
                    report.rms
                );
            }
            Err(error) => println!("least squares, {label}: {error}"),
        }
    }
}

/// The winding number of the loose triangles of a ball at 64^3 points of the unit cube, one core.
fn winding_numbers() {
    let mesh = TriMesh::ball(Vec3::zeros(), 0.4, 5);
    let n = 64;
    let step = 1.0 / n as f64;
    let lattice = SampleLattice {
        origin: WorldPoint(Vec3::repeat(step / 2.0 - 0.5)),
        step,
        counts: [n; 3],
    };
    let each = |start: Instant| start.elapsed().as_secs_f64() * 1e6 / lattice.len() as f64;
    let Ok(loose) = loosened(&mesh) else {
        return println!("no loose mesh");
    };
    let triangles = loose.triangles().len();
    let solid = MeshSolid::new(loose);
    let start = Instant::now();
    let inside = (0..lattice.len()).filter(|&m| solid.contains(lattice.point(m).0));
    let inside = inside.count();
    println!(
        "winding number of {triangles} loose triangles: {:.2} us a point; {inside} points inside",
        each(start)
    );
}

/// The triangles of a mesh by themselves, their corners a little jittered, one in fifty left out.
fn loosened(mesh: &TriMesh) -> Result<TriMesh, druse::mesh::MeshError> {
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
    };
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for corners in mesh.iter_corners() {
        let first = vertices.len() as u32;
        if random() < 0.48 {
            let jittered = |p: Vec3, r: [f64; 3]| p + Vec3::from(r) * 4e-4;
            vertices.extend(corners.map(|p| jittered(p, [random(), random(), random()])));
            triangles.push([first, first + 1, first + 2]);
        }
    }
    TriMesh::new(vertices, triangles)
}

/// Look-ups in the table of a fitted cell, one thread.
fn look_ups() {
    let cell = match fit(
        "struts",
        Element::Tet,
        &sphere_struts,
        &FitOptions::default(),
        &Silent,
    ) {
        Ok(cell) => cell,
        Err(error) => return println!("P6: {error}"),
    };
    let table = match Table::new(&cell) {
        Ok(table) => table,
        Err(error) => return println!("P6: {error}"),
    };
    // 400 leaves of 8^3 voxels, turned, spread over the element.
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, 0.7, 1.1);
    let points: Vec<CellPoint<3>> = (0..400 * 512usize)
        .map(|n| {
            let leaf = (n / 512) as f64;
            let corner = Vec3::new(leaf * 0.819_17, leaf * 0.671_04, leaf * 0.549_70);
            let voxel = Vec3::new((n / 64 % 8) as f64, (n / 8 % 8) as f64, (n % 8) as f64);
            CellPoint(corner.map(|c| c.fract() - 0.5) + turn * voxel / 40.0)
        })
        .collect();
    let each = |seconds: f64| seconds * 1e9 / points.len() as f64;
    let value = each(seconds(9, || {
        for p in &points {
            black_box(table.value(*p));
        }
    }));
    let slope = each(seconds(9, || {
        for p in &points {
            black_box(table.sample(*p));
        }
    }));
    println!(
        "P6 look-up in a table of {}^3 samples, {} MiB: value {value:.1} ns (at most 10, aim 6), with \
         gradient {slope:.1} ns (at most 18, aim 10)",
        table.samples(),
        table.bytes() >> 20
    );
}

fn main() {
    // Cargo adds an argument of its own.
    if !std::env::args().any(|a| a == "speed") {
        accuracy();
    }
    match Threads::new(1) {
        Ok(one) => one.install(|| {
            look_ups();
            winding_numbers();
        }),
        Err(error) => println!("{error}"),
    }
    many_unknowns();
}
