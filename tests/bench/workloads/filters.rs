//! Filters and offsets of level sets beside OpenVDB's.

use super::baselines::Box;
use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::w1::Gyroid;
use super::w2;
use crate::Setting;
use druse::field::{Offset, WorldField};
use druse::frame::Transform;
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, LevelSetBuilder, Session, Tools};
use std::hint::black_box;

type Fault = std::boxed::Box<dyn std::error::Error>;

const ROUNDS: usize = 3;

/// The level set of a field over the gyroid's box.
pub fn level_set(
    gyroid: &Gyroid,
    field: &WorldField<'_>,
    threads: &Threads,
) -> Result<LevelSet, Fault> {
    let h = Transform::new(gyroid.voxel_size()).ok_or("no voxel size")?;
    let builder = LevelSetBuilder::new(h, 3.0)?;
    gyroid.sample(field, 0.0, threads, &builder)?;
    Ok(builder.finish(Session::new(threads, &Silent))?)
}

/// P13: a mean and a Gaussian of width 1 from level set to level set; and a dilation by a voxel,
/// sampled anew from the field against the level set's offset. One thread, schemes of first order.
pub fn against_openvdb(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let gyroid = Gyroid::new(Box {
        cells: if setting.full { 5 } else { 3 },
        voxels: 40,
    })?;
    let one = Threads::new(1)?;
    let own = Session::new(&one, &Silent);
    let theirs = own.with_tools(Tools::OpenVdb);
    let h = gyroid.voxel_size();
    let moved = Offset {
        field: std::boxed::Box::new(gyroid.tiled_as_far_as(4.0)?),
        by: h,
        half: None,
    };
    let solid = level_set(&gyroid, &gyroid.tiled()?, &one)?;
    let voxels = solid.active_voxels()? as f64;
    let copies = || solid.duplicate().expect("memory for a copy");
    let filtered = |session: Session<'_>, is_gaussian: bool| {
        let mut copy = copies();
        let done = if is_gaussian {
            copy.gaussian(1, 1, session)
        } else {
            copy.mean(1, 1, session)
        };
        done.expect("not cancelled");
        black_box(&copy);
    };
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || drop(black_box(level_set(&gyroid, &moved, &one).expect("a band"))),
            &mut || {
                let mut copy = copies();
                copy.dilate(h, theirs).expect("not cancelled");
                black_box(&copy);
            },
            &mut || filtered(own, false),
            &mut || filtered(theirs, false),
            &mut || filtered(own, true),
            &mut || filtered(theirs, true),
        ],
    );
    Ok(found(
        &["P13", "P13.mean", "P13.gaussian"],
        &seconds,
        voxels,
    ))
}

/// P13 of a lattice, whose field's distances do not hold a voxel beyond the band: from level set to level
/// set, by points of the surface against OpenVDB's offset, of first order on one thread; by one voxel and
/// by four.
pub fn moves(_: &Setting) -> Result<Vec<Found>, Fault> {
    let one = Threads::new(1)?;
    let own = Session::new(&one, &Silent);
    let theirs = own.with_tools(Tools::OpenVdb);
    let solid = w2::level_set(&one)?;
    let voxels = solid.active_voxels()? as f64;
    let moved = |by: f64, session: Session<'_>| {
        let mut copy = solid.duplicate().expect("memory for a copy");
        copy.dilate(by, session).expect("not cancelled");
        black_box(&copy);
    };
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || moved(1.0, own),
            &mut || moved(1.0, theirs),
            &mut || moved(4.0, own),
            &mut || moved(4.0, theirs),
        ],
    );
    Ok(found(&["P13.lattice", "P13.far"], &seconds, voxels))
}

/// Figures from times of pairs, ours and theirs in turn.
fn found(keys: &[&'static str], seconds: &[Vec<f64>], voxels: f64) -> Vec<Found> {
    let pairs = keys.iter().zip(seconds.chunks_exact(2));
    pairs
        .map(|(key, pair)| {
            let ratios = Spread::of_ratios(&pair[1], &pair[0]);
            let each = |s: &[f64]| Spread::of(s).median * 1e9 / voxels;
            let note = format!(
                "{ratios}; {:.0} and {:.0} ns an active voxel",
                each(&pair[0]),
                each(&pair[1])
            );
            Found::new(key, ratios.median, note)
        })
        .collect()
}
