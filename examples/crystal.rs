//! Makes a polygon mesh with a script and turns it into a level set.
//!
//! The script makes the form {110} of the cubic system, as garnet has it: a rhombic dodecahedron whose faces
//! are at distance 1 from its centre. Its volume is 4 sqrt 2.

use druse::band::Band;
use druse::mesh::MeshSolid;
use druse::polymesh::PolyMesh;
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session};
use std::error::Error;
use std::f64::consts::SQRT_2;
use std::path::PathBuf;

const SCRIPT: &str = "form cubic [1,1,0]=1";

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;

    let polygons = PolyMesh::from_script(SCRIPT)?;
    let solid = MeshSolid::new(polygons.triangulated()?.mesh);
    let band = Band::new(&solid, solid.bounds(), 0.02)?;
    let threads = Threads::new(0)?;
    let session = Session::new(&threads, &Silent);
    let level_set = LevelSet::from_band(&band, session)?;
    level_set.write(folder.join("crystal.vdb"), session)?;

    println!("faces                        {}", polygons.face_count());
    println!("volume of the polygons       {:.5}", polygons.volume());
    let volume = level_set.volume(session)?;
    println!("volume of the level set      {volume:.5}");
    let exact = 4.0 * SQRT_2;
    println!("exact                        {exact:.5}");
    println!("relative error               {:.1e}", volume / exact - 1.0);
    Ok(())
}
