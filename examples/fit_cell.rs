//! Fits a unit cell to a triangle mesh and writes it as a `.cell` file.
//!
//! The mesh is a ball of radius 0.3 in the unit cube. A fitted cell is a symmetric Fourier series: the volume
//! fraction of the solid below level 0 is compared with that of the ball, 4/3 pi r^3.

use druse::cell::{Caps, FitOptions, Placement, fit_mesh};
use druse::frame::{Element, LengthUnit, Vec3};
use druse::io::{read_cell, read_mesh, write_cell, write_mesh};
use druse::mesh::TriMesh;
use druse::progress::Silent;
use std::error::Error;
use std::f64::consts::PI;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;

    let radius = 0.3;
    let ball = TriMesh::ball(Vec3::zeros(), radius, 5);
    let file = folder.join("ball.stl");
    write_mesh(&file, &ball, LengthUnit::Millimetre)?;

    let mesh = read_mesh(&file)?.mesh;
    let options = FitOptions {
        band_limit: 6.0,
        ..FitOptions::default()
    };
    let cell = fit_mesh(
        "ball",
        Element::Hex,
        &mesh,
        &Placement::Reference,
        Caps::default(),
        &options,
        &Silent,
    )?;
    let report = cell.report().ok_or("a fitted cell has a report")?;
    println!("rms difference of distances  {:.5}", report.rms);

    let file = folder.join("ball.cell");
    write_cell(&file, &cell)?;
    let fraction = read_cell(&file)?.volume_fraction();
    let exact = 4.0 / 3.0 * PI * radius.powi(3);
    println!("volume fraction              {fraction:.5}");
    println!("exact                        {exact:.5}");
    println!(
        "relative error               {:.1e}",
        fraction / exact - 1.0
    );
    Ok(())
}
