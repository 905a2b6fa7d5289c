//! Reads a level set, moves its surface, unites it with another one and makes a mesh of the result.
//!
//! A ball of radius 4 mm is written, read and dilated by 1 mm. Its union with a ball of radius 5 mm, 6 mm
//! away, has the volume of two balls without their lens, pi (4 r + d) (2 r - d)^2 / 12.

use druse::band::Band;
use druse::field::Sphere;
use druse::frame::{Aabb, LengthUnit, Vec3};
use druse::io::write_mesh;
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session};
use std::error::Error;
use std::f64::consts::PI;
use std::path::PathBuf;

fn ball(centre: Vec3, radius: f64, session: Session) -> Result<LevelSet, Box<dyn Error>> {
    let sphere = Sphere { centre, radius };
    let extent = Aabb::of([centre.add_scalar(-radius), centre.add_scalar(radius)]);
    let band = Band::new(&sphere, extent, 0.1)?;
    Ok(LevelSet::from_band(&band, session)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;
    let threads = Threads::new(0)?;
    let session = Session::new(&threads, &Silent);

    let path = folder.join("small_ball.vdb");
    ball(Vec3::zeros(), 4.0, session)?.write(&path, session)?;
    let mut solid = LevelSet::read(&path, None, session)?;
    solid.dilate(1.0, session)?;
    let dilated = solid.volume(session)?;
    let (radius, apart) = (5.0f64, 6.0);
    let exact = 4.0 / 3.0 * PI * radius.powi(3);
    println!("dilated ball                 {dilated:.2} mm^3, exact {exact:.2}");

    let other = ball(Vec3::new(apart, 0.0, 0.0), radius, session)?;
    solid.union(other, session)?;
    let mesh = solid.to_mesh(session)?;
    write_mesh(folder.join("union.ply"), &mesh, LengthUnit::Millimetre)?;
    let lens = PI * (4.0 * radius + apart) * (2.0 * radius - apart).powi(2) / 12.0;
    let exact = 2.0 * exact - lens;
    println!(
        "union                        {:.2} mm^3, exact {exact:.2}",
        solid.volume(session)?
    );
    println!("its mesh                     {:.2} mm^3", mesh.volume());
    println!(
        "relative error               {:.1e}",
        mesh.volume() / exact - 1.0
    );
    Ok(())
}
