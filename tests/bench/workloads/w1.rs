//! W1: a gyroid in a box, and W1s: one of its cells, large.

use super::baselines::{self, Box};
use super::child::{self, Task};
use super::clock::{Spread, in_turn};
use super::figure::Found;
use super::reader::Reader;
use super::threads::one_against_two;
use crate::Setting;
use druse::band::{Band, BandStats, LeafSink};
use druse::cell::{Surface, Table};
use druse::field::WorldField;
use druse::frame::{Aabb, Element, Transform, Vec3};
use druse::progress::{Silent, Threads};
use druse::scaffold::{Kind, Scaffold};
use druse::simd::InstructionSet;
use druse::tiling::{Boundary, Distance, TiledSolid, TilingOptions};
use std::hint::black_box;

type Fault = std::boxed::Box<dyn std::error::Error>;

const ROUNDS: usize = 5;

/// A box of gyroid cells with edges of 1, as the pipeline samples it.
pub struct Gyroid {
    at: Box,
    scaffold: Scaffold,
    table: Table,
}

impl Gyroid {
    pub fn new(at: Box) -> Result<Self, Fault> {
        let size = Vec3::repeat(at.cells as f64);
        Ok(Self {
            at,
            scaffold: Scaffold::box_grid(size, [at.cells; 3], Kind::Hex8)?,
            table: Table::new(&Surface::Gyroid.cell(Element::Hex)?)?,
        })
    }

    pub fn voxel_size(&self) -> f64 {
        1.0 / self.at.voxels as f64
    }

    pub fn tiled(&self) -> Result<TiledSolid<'_>, Fault> {
        self.tiled_as_far_as(3.0)
    }

    /// With distances that hold so many voxels from the surface.
    pub fn tiled_as_far_as(&self, half_width: f64) -> Result<TiledSolid<'_>, Fault> {
        let h = self.voxel_size();
        let options = TilingOptions {
            voxel_size: h,
            half_width: half_width * h,
            distance: Distance::Fast,
            boundary: Boundary::Cut,
        };
        Ok(TiledSolid::new(&self.scaffold, &self.table, options)?)
    }

    /// Samples the band over a box that is larger by `padding` world units.
    pub fn sample(
        &self,
        field: &WorldField<'_>,
        padding: f64,
        threads: &Threads,
        sink: &dyn LeafSink,
    ) -> Result<BandStats, Fault> {
        let band = Band {
            field,
            transform: Transform::new(self.voxel_size()).ok_or("no voxel size")?,
            half_width: 3.0,
            extent: Aabb {
                min: Vec3::zeros(),
                max: Vec3::repeat(self.at.cells as f64 + padding),
            },
        };
        Ok(band.evaluate(threads, &Silent, sink)?)
    }
}

/// Workload W1 on one thread.
pub struct W1 {
    gyroid: &'static Gyroid,
    field: TiledSolid<'static>,
    one: Threads,
}

impl W1 {
    /// In full 10^3 cells, else 5^3.
    pub fn new(full: bool) -> Result<Self, Fault> {
        let at = Box {
            cells: if full { 10 } else { 5 },
            voxels: 40,
        };
        let gyroid: &'static Gyroid = std::boxed::Box::leak(std::boxed::Box::new(Gyroid::new(at)?));
        Ok(Self {
            gyroid,
            field: gyroid.tiled()?,
            one: Threads::new(1)?,
        })
    }

    fn to(&self, sink: &dyn LeafSink, threads: &Threads) -> BandStats {
        self.gyroid
            .sample(&self.field, 0.0, threads, sink)
            .expect("the field is finite and the sinks take all")
    }

    /// Its level set in OpenVDB.
    #[cfg(feature = "vdb")]
    pub fn level_set(&self) -> Result<druse::vdb::LevelSet, Fault> {
        let transform = Transform::new(self.gyroid.voxel_size()).ok_or("no voxel size")?;
        let builder = druse::vdb::LevelSetBuilder::new(transform, 3.0)?;
        self.to(&builder, &self.one);
        Ok(builder.finish(druse::vdb::Session::new(&self.one, &Silent))?)
    }

    /// One pass, every value read.
    pub fn read(&self) {
        let reader = Reader::default();
        self.to(&reader, &self.one);
        black_box(reader.totals());
    }
}

/// P1 to P4.
pub fn against_baselines(_: &Setting) -> Result<Vec<Found>, Fault> {
    let w1 = W1::new(true)?;
    let at = w1.gyroid.at;
    let stats = w1.to(&Reader::default(), &w1.one);
    let voxels = at.edge().pow(3) as f64;
    // A buffer beyond all caches; only the part that the leaves would fill is counted.
    let mut bytes = vec![0u8; 1 << 28];
    let share = (stats.leaves_kept * 2048) as f64 / bytes.len() as f64;
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || w1.read(),
            &mut || baselines::callback_f64(at, &Reader::default()),
            &mut || baselines::leafwise_f32(at, &Reader::default()),
            &mut || drop(black_box(baselines::dense_tables(at))),
            &mut || baselines::write(&mut bytes),
            &mut baselines::fuse,
        ],
    );
    let [ours, callback, leafwise, tables, writing, fusing] = &seconds[..] else {
        return Ok(Vec::new());
    };
    let writing: Vec<f64> = writing.iter().map(|s| s * share).collect();
    let note = |of: &[f64], ratios: Spread| {
        let each = |s: &[f64]| Spread::of(s).median * 1e9 / voxels;
        format!("{ratios}; {:.2} and {:.2} ns a voxel", each(ours), each(of))
    };
    let mut found = Vec::new();
    for (key, other) in [("P1", callback), ("P2", leafwise), ("P3", tables)] {
        let ratios = Spread::of_ratios(other, ours);
        found.push(Found::new(key, ratios.median, note(other, ratios)));
    }
    found.push(small()?);
    let ratios = Spread::of_ratios(ours, &writing);
    let peak = baselines::fused_per_nanosecond(Spread::of(fusing).median);
    let note = format!("{}; {peak:.0} GFMA/s", note(&writing, ratios));
    found.push(Found::new("P4", ratios.median, note));
    Ok(found)
}

/// P4.small: of a box whose sides count for more.
fn small() -> Result<Found, Fault> {
    let w1 = W1::new(false)?;
    let stats = w1.to(&Reader::default(), &w1.one);
    let mut bytes = vec![0u8; 1 << 28];
    let share = (stats.leaves_kept * 2048) as f64 / bytes.len() as f64;
    let seconds = in_turn(
        ROUNDS,
        &mut [&mut || w1.read(), &mut || baselines::write(&mut bytes)],
    );
    let writing: Vec<f64> = seconds[1].iter().map(|s| s * share).collect();
    let ratios = Spread::of_ratios(&seconds[0], &writing);
    Ok(Found::new("P4.small", ratios.median, ratios.to_string()))
}

/// P1.bridge: both into a flood-filled level set; and that the reader of P1 saw what arrives there.
#[cfg(feature = "vdb")]
pub fn through_the_bridge(setting: &Setting) -> Result<Vec<Found>, Fault> {
    use druse::vdb::{LevelSet, LevelSetBuilder, Session};
    let w1 = W1::new(setting.full)?;
    let h = w1.gyroid.voxel_size();
    let session = Session::new(&w1.one, &Silent);
    let ours = || w1.level_set();
    let theirs = || -> Result<LevelSet, Fault> {
        let transform = Transform::new(h).ok_or("no voxel size")?;
        let builder = LevelSetBuilder::new(transform, 3.0)?;
        baselines::callback_to_sink(w1.gyroid.at, h as f32, &builder)?;
        Ok(builder.finish(session)?)
    };
    let reader = Reader::default();
    w1.to(&reader, &w1.one);
    let level_set = ours()?;
    let arrived = Reader::default();
    for leaf in level_set
        .leaves()?
        .iter()
        .filter(druse::vdb::LeafView::any_active)
    {
        arrived.enter(leaf.origin, &leaf.mask, leaf.values);
    }
    if arrived.totals() != reader.totals() {
        return Err("the level set holds other leaves than the reader saw".into());
    }
    theirs()?;
    let seconds = in_turn(
        ROUNDS,
        &mut [&mut || drop(black_box(ours())), &mut || {
            drop(black_box(theirs()));
        }],
    );
    let ratios = Spread::of_ratios(&seconds[1], &seconds[0]);
    Ok(vec![Found::new(
        "P1.bridge",
        ratios.median,
        format!("{ratios}; the same leaves as the reader's"),
    )])
}

/// P5, in a fresh process.
pub fn first_pass(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let program = std::env::current_exe()?;
    let task = Task {
        workload: "w1",
        full: setting.full,
        code: InstructionSet::Best,
    };
    let mut ratios = Vec::new();
    for _ in 0..ROUNDS {
        let passes = child::passes(&program, task)?;
        ratios.push(passes.first / passes.later);
    }
    let ratios = Spread::of(&ratios);
    Ok(vec![Found::new("P5", ratios.median, ratios.to_string())])
}

/// P9 and P10: one cell, coarse and fine, and in a larger box.
pub fn growth(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let coarse = if setting.full { 200 } else { 100 };
    let cells = [coarse, 2 * coarse].map(|voxels| Gyroid::new(Box { cells: 1, voxels }));
    let [coarse, fine] = cells;
    let (coarse, fine) = (coarse?, fine?);
    let (coarse_field, fine_field) = (coarse.tiled()?, fine.tiled()?);
    let one = Threads::new(1)?;
    let read = |gyroid: &Gyroid, field: &TiledSolid<'_>, padding: f64| {
        let reader = Reader::default();
        let stats = gyroid.sample(field, padding, &one, &reader);
        (stats, reader.totals())
    };
    let stats = read(&fine, &fine_field, 0.0).0?;
    let seconds = in_turn(
        2 * ROUNDS,
        &mut [
            &mut || drop(black_box(read(&coarse, &coarse_field, 0.0))),
            &mut || drop(black_box(read(&fine, &fine_field, 0.0))),
            &mut || drop(black_box(read(&fine, &fine_field, 1.0))),
        ],
    );
    let growth = Spread::of_ratios(&seconds[1], &seconds[0]);
    let padding = Spread::of_ratios(&seconds[2], &seconds[1]);
    let touched = stats.leaves_evaluated as f64 / stats.leaves_kept as f64;
    let evaluated = stats.samples_evaluated as f64 / stats.active_voxels as f64;
    let voxels = format!("{} voxels per cell", fine.at.voxels);
    Ok(vec![
        Found::new("P9", growth.median, growth.to_string()),
        Found::new("P9.padding", padding.median, padding.to_string()),
        Found::new("P10", touched, voxels.clone()),
        Found::new("P10.evaluated", evaluated, voxels),
    ])
}

/// P17.w1.
pub fn threads(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let w1 = W1::new(setting.full)?;
    let two = Threads::new(2)?;
    let on = |threads: &Threads| {
        w1.to(&Reader::default(), threads);
    };
    Ok(vec![one_against_two(
        "P17.w1",
        &mut || on(&w1.one),
        &mut || on(&two),
    )])
}
