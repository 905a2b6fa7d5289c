//! Streams the narrow band of a field into a `.vdb` file, block by block: the level set is never in memory.
//!
//! The field is a ball of 400 voxels across. Its band is a shell of volume 4 pi (r^2 + w^2 / 3) 2 w, which the
//! number of active voxels is compared with.

use druse::band::Band;
use druse::field::Sphere;
use druse::frame::{Aabb, Vec3};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSetFile, Session, info};
use std::error::Error;
use std::f64::consts::PI;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;

    let (radius, voxel_size) = (10.0, 0.05);
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius,
    };
    let extent = Aabb::of([Vec3::repeat(-radius), Vec3::repeat(radius)]);
    let band = Band::new(&ball, extent, voxel_size)?;
    let threads = Threads::new(0)?;
    let path = folder.join("ball.vdb");
    let file = LevelSetFile::create(&path, band.transform, band.half_width)?;
    let stats = band.evaluate(&threads, &Silent, &file)?;
    let written = file.finish(Session::new(&threads, &Silent))?;

    let found = info(&path)?;
    let width = band.half_width * voxel_size;
    let shell = 4.0 * PI * (radius.powi(2) + width.powi(2) / 3.0) * 2.0 * width;
    let exact = shell / voxel_size.powi(3);
    let active = found.grids[0].active_voxels;
    println!("bytes                        {}", written.bytes);
    println!("leaves                       {}", stats.leaves_kept);
    println!("active voxels                {active}");
    println!("shell in voxels              {exact:.0}");
    println!(
        "relative error               {:.1e}",
        active as f64 / exact - 1.0
    );
    Ok(())
}
