//! Files beside OpenVDB's own writer.

use super::baselines::Box;
use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::filters::level_set;
use super::w1::Gyroid;
use crate::Setting;
use druse::band::{LeafFileHead, LeafFileWriter, LeafStore};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session, StoredGrid, VdbWriter};
use std::fs::File;

type Fault = std::boxed::Box<dyn std::error::Error>;

const ROUNDS: usize = 5;

/// P12: from leaf files to a `.vdb`, as a part larger than memory is written, against OpenVDB's archive
/// of the same level set in memory, blosc both. Either counts its content hash.
pub fn against_openvdb(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let gyroid = Gyroid::new(Box {
        cells: if setting.full { 10 } else { 5 },
        voxels: 40,
    })?;
    let one = Threads::new(1)?;
    let session = Session::new(&one, &Silent);
    let field = gyroid.tiled()?;
    let solid = level_set(&gyroid, &field, &one)?;
    let place = tempfile::tempdir()?;
    let [leaves, streamed, whole] =
        ["a.leaves", "streamed.vdb", "whole.vdb"].map(|name| place.path().join(name));
    let head = LeafFileHead {
        plan: [0; 32],
        brick: 0,
        background: solid.background() as f32,
    };
    let writer = LeafFileWriter::new(File::create(&leaves)?, &head)?;
    gyroid.sample(&field, 0.0, &one, &writer)?;
    writer.finish()?;
    let store = LeafStore::open(vec![(leaves, head)], &one, &Silent)?;
    let empty = LevelSet::empty(solid.transform(), solid.half_width(), session)?;
    let stream = || -> Result<u64, Fault> {
        let mut file = VdbWriter::new(&streamed, session)?;
        file.level_set("surface", &empty)?;
        Ok(file
            .write_streamed_to(&streamed, &[StoredGrid::Surface(&store)])?
            .bytes)
    };
    let archive = || -> Result<u64, Fault> {
        let mut file = VdbWriter::new(&whole, session)?;
        file.level_set("surface", &solid)?;
        Ok(file.write()?.bytes)
    };
    let (mut ours, mut theirs) = (0, 0);
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || ours = stream().expect("room on the disk"),
            &mut || theirs = archive().expect("room on the disk"),
        ],
    );
    let ratios = Spread::of_ratios(&seconds[0], &seconds[1]);
    let voxels = solid.active_voxels()? as f64;
    let each = |s: &[f64]| Spread::of(s).median * 1e9 / voxels;
    let note = format!(
        "{ratios}; {:.0} and {:.0} ns an active voxel",
        each(&seconds[0]),
        each(&seconds[1])
    );
    let size = format!("{ours} and {theirs} bytes");
    Ok(vec![
        Found::new("P12", ratios.median, note),
        Found::new("P12.size", ours as f64 / theirs as f64, size),
    ])
}
