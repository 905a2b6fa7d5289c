//! How fast polygons are made: fractals of the thesis, step by step.
//!
//! `cargo bench --bench crystals`: for each number of steps the faces of the mesh, the time to make it from the
//! cube or tetrahedron, faces a second, and the time to cut it into triangles.

use druse::polymesh::{Interpreter, NoFiles, Script};
use std::time::Instant;

const SCRIPTS: [(&str, &str, usize); 3] = [
    (
        "pseudo-Menger",
        "cube; repeat k { remesh checkerboard t=1/3; extrude cubical group=1 dihedral=90 tiers=[-.9] }",
        5,
    ),
    (
        "pseudo-Sierpinski",
        "tetrahedron; repeat k { remesh loop_style; extrude tetrahedral group=1 dihedral=54.7 tiers=[-.5] }",
        7,
    ),
    (
        "dodecahedral",
        "dodecahedron; repeat k { extrude dodecahedral group=1 tiers=[.5, .5, .5]; assign all 1 }",
        4,
    ),
];

fn main() {
    println!("script             steps      faces   ms to make  faces a second  ms to triangles");
    for (name, text, most) in SCRIPTS {
        for k in [most - 2, most - 1, most] {
            let script = Script::parse(&format!("param k = {k}; {text}")).unwrap();
            // The best of three: others use the machine, too.
            let mut seconds = f64::INFINITY;
            let mut mesh = None;
            for _ in 0..3 {
                let start = Instant::now();
                let mut interpreter = Interpreter::new(&NoFiles);
                script.run(&mut interpreter, None).unwrap();
                seconds = seconds.min(start.elapsed().as_secs_f64());
                mesh = interpreter.shared_mesh();
            }
            let mesh = mesh.unwrap();
            let start = Instant::now();
            let triangles = mesh.triangulated().unwrap().mesh.triangles().len();
            let cut = start.elapsed().as_secs_f64();
            assert!(triangles >= mesh.face_count());
            let faces = mesh.face_count() as f64;
            println!(
                "{name:<18} {k:>5} {faces:>10} {:>12.1} {:>15.0} {:>16.1}",
                1e3 * seconds,
                faces / seconds,
                1e3 * cut
            );
        }
    }
}
