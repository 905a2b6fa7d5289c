//! Fills a box of hexes with a cell and evaluates the tiling at points; writes a table of them.
//!
//! The cell is Schwarz P, cos X + cos Y + cos Z with X = 2 pi x / a, in a cube of 2^3 cells of edge a = 5 mm.
//! The values are compared with that formula. The distance is that to the surface, in world units.

use druse::cell::{Surface, Table};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::scaffold::{Kind, Scaffold};
use druse::tiling::{Distance, TiledSolid, TilingOptions};
use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;

    let edge = 5.0;
    let cell = Table::new(&Surface::SchwarzP.cell(Element::Hex)?)?;
    let scaffold = Scaffold::box_grid(Vec3::repeat(2.0 * edge), [2; 3], Kind::Hex8)?;
    let options = TilingOptions {
        distance: Distance::Exact,
        ..TilingOptions::new(0.1)
    };
    let tiling = TiledSolid::new(&scaffold, &cell, options)?;

    let (mut table, mut greatest) = (String::from("x,y,z,phi,distance\n"), 0.0f64);
    for n in 0..1000 {
        // Corners of a lattice of 10^3 points, none in a face of the box.
        let p = Vec3::new((n / 100) as f64, (n / 10 % 10) as f64, (n % 10) as f64).add_scalar(0.4);
        let sample = tiling.sample(WorldPoint(p)).ok_or("a point outside")?;
        // The cell's origin is the centre of its element.
        let exact: f64 = p.iter().map(|c| (TAU * (c / edge - 0.5)).cos()).sum();
        greatest = greatest.max((sample.phi - exact).abs());
        writeln!(
            table,
            "{},{},{},{},{}",
            p.x, p.y, p.z, sample.phi, sample.distance
        )?;
    }
    let file = folder.join("tiling.csv");
    std::fs::write(&file, table)?;
    println!("elements                     {}", scaffold.len());
    println!("greatest difference of phi   {greatest:.1e}");
    // All three cosines vanish a quarter of a period from the corner.
    let on_surface = tiling.sample(WorldPoint(Vec3::repeat(edge / 4.0)));
    let distance = on_surface.map_or(f64::NAN, |s| s.distance);
    println!("distance on the surface      {distance:.1e} mm");
    Ok(())
}
