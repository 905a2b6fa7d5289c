//! Implements [`Field`] for a torus, samples its narrow band and writes a level set and a mesh.
//!
//! The volume, 2 pi^2 R r^2, and the area, 4 pi^2 R r, of the torus are compared with those of the level set.

use druse::band::Band;
use druse::field::{Field, Interval};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session};
use std::error::Error;
use std::f64::consts::PI;
use std::path::PathBuf;

/// A torus about the z axis.
struct Torus {
    major: f64,
    minor: f64,
}

impl Field for Torus {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        let across = p.0.xy().norm() - self.major;
        across.hypot(p.0.z) - self.minor
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let radial = Vec3::new(p.0.x, p.0.y, 0.0);
        let radial = radial.try_normalize(0.0).unwrap_or(Vec3::x());
        (self.value(p), (p.0 - radial * self.major).normalize())
    }

    /// A distance changes by at most the distance from the centre of the box.
    fn bound(&self, region: &Aabb) -> Interval {
        let (middle, reach) = (self.value(region.centre()), region.half_diagonal());
        Interval::new(middle - reach, middle + reach)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("out".into()));
    std::fs::create_dir_all(&folder)?;

    let (major, minor) = (8.0, 2.0);
    let torus = Torus { major, minor };
    let half = Vec3::new(10.0, 10.0, 2.0);
    let band = Band::new(&torus, Aabb::of([-half, half]), 0.1)?;
    let threads = Threads::new(0)?;
    let session = Session::new(&threads, &Silent);
    let solid = LevelSet::from_band(&band, session)?;
    solid.write(folder.join("torus.vdb"), session)?;

    let (volume, area) = (solid.volume(session)?, solid.area(session)?);
    let exact_area = 4.0 * PI.powi(2) * major * minor;
    let exact = exact_area * minor / 2.0;
    println!("volume                       {volume:.2}, exact {exact:.2}");
    println!("area                         {area:.2}, exact {exact_area:.2}");
    Ok(())
}
