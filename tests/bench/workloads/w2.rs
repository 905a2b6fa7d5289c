//! W2: struts in the tets of an ellipsoid, and W3: two cells blended over bent hexes.

use super::baselines;
use super::clock::{Spread, in_turn};
use super::dense::Products;
use super::figure::Found;
use super::reader::Reader;
use super::threads::one_against_two;
use crate::Setting;
use druse::band::{Band, BandStats};
use druse::cell::{Cell, FitOptions, Surface, Table, fit_samples};
use druse::field::WorldField;
use druse::frame::{Aabb, CellPoint, Element, Transform, Vec3};
use druse::progress::{Silent, Threads};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{
    Blend, Boundary, Distance, Filling, Interpolation, Member, TiledSolid, TilingOptions, Visits,
};
use std::collections::HashMap;

type Fault = Box<dyn std::error::Error>;

const ROUNDS: usize = 5;
/// The longest axis of W2's ellipsoid, voxels: at half of that its struts are too thin for a band.
const MAX_LENGTH: f64 = 1000.0;
/// Between the points of its body-centred lattice, along an edge, as a share of that.
const PITCH: f64 = 0.067;
/// Large tets: the ellipsoid's longest axis and the lattice's edge, voxels.
const LARGE: [f64; 2] = [2000.0, 800.0];
/// Of a voxel, how far nodes may displace the surface: half of what tables may.
const NODES: f64 = 0.005;
/// Lattice points along an axis of the period of a strut cell.
const SAMPLES: usize = 80;
/// Band limits of strut cells: 20 orbits, 2000 and 5984.
const FEW_SAMPLES: f64 = 3.2;
const SOME: f64 = 17.0;
const MANY_SAMPLES: f64 = 24.5;

/// Tets between the points of a body-centred lattice, those with their middle in an ellipsoid, by
/// the longest axis and the lattice's edge in voxels.
fn ellipsoid(longest: f64, pitch: f64) -> Result<Scaffold, Fault> {
    let axes = Vec3::new(0.5, 0.3, 0.2) * longest;
    let (mut nodes, mut elements) = (Vec::new(), Connectivity::default());
    let mut known: HashMap<[i32; 3], u32> = HashMap::new();
    let reach = (axes.x / pitch) as i32 + 2;
    // Points in halves of the pitch: corners are even, middles odd.
    let point = |k: [i32; 3]| Vec3::from(k.map(f64::from)) * (pitch / 2.0);
    for n in 0..(2 * reach + 1).pow(3) {
        let side = 2 * reach + 1;
        let corner = [n / (side * side), n / side % side, n % side].map(|i| 2 * (i - reach));
        for axis in 0..3 {
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut end = corner;
            end[axis] += 2;
            let middle = |turn: usize| {
                let mut m = corner;
                m[axis] += 1;
                m[next] += [-1, 1, 1, -1][turn % 4];
                m[last] += [-1, -1, 1, 1][turn % 4];
                m
            };
            for turn in 0..4 {
                let own = [corner, middle(turn), end, middle(turn + 1)];
                let centre = own.iter().map(|&k| point(k)).sum::<Vec3>() / 4.0;
                if centre.component_div(&axes).norm_squared() >= 1.0 {
                    continue;
                }
                let own = own.map(|k| {
                    *known.entry(k).or_insert_with(|| {
                        nodes.push(point(k));
                        nodes.len() as u32 - 1
                    })
                });
                elements.push(Kind::Tet4, &own);
            }
        }
    }
    Ok(Scaffold::new(nodes, elements)?)
}

/// Four struts from the middle of a tet to its faces, with the waves up to a band limit.
fn struts(band_limit: f64) -> Result<Cell, Fault> {
    const RADIUS: f64 = 0.09;
    let arms = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]];
    let arms = arms.map(|n| Vec3::from(n) / 5.0);
    let to_arm = |p: Vec3, arm: Vec3| {
        let along = (p.dot(&arm) / arm.norm_squared()).clamp(0.0, 1.0);
        (p - arm * along).norm()
    };
    let mut samples = Vec::with_capacity(SAMPLES.pow(3));
    let place = |j: usize| j as f64 / SAMPLES as f64 - 0.5;
    for n in 0..SAMPLES.pow(3) {
        let [u, v, w] = [n / (SAMPLES * SAMPLES), n / SAMPLES % SAMPLES, n % SAMPLES].map(place);
        let mut nearest = f64::INFINITY;
        for image in 0..27 {
            let [a, b, c] = [image / 9, image / 3 % 3, image % 3].map(|i| f64::from(i) - 1.0);
            let (u, v, w) = (u + a, v + b, w + c);
            let p = Vec3::new(v + w, u + w, u + v);
            nearest = arms.iter().fold(nearest, |d, &arm| d.min(to_arm(p, arm)));
        }
        samples.push(nearest - RADIUS);
    }
    let options = FitOptions {
        band_limit,
        measure: false,
        ..FitOptions::default()
    };
    Ok(fit_samples(
        "struts",
        Element::Tet,
        &samples,
        SAMPLES,
        &options,
        &Silent,
    )?)
}

/// The table that the pipeline would make of a cell for voxels of 1.
fn table_for(scaffold: &Scaffold, band_limit: f64) -> Result<Table, Fault> {
    const TOLERANCE: f64 = 0.01;
    let most = TOLERANCE / scaffold.stretch().1;
    Ok(Table::for_displacement(&struts(band_limit)?, most)?)
}

/// As the pipeline samples a tiling.
fn tiled<'a>(scaffold: &'a Scaffold, filling: &'a dyn Filling) -> Result<TiledSolid<'a>, Fault> {
    let options = TilingOptions {
        voxel_size: 1.0,
        half_width: 3.0,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    };
    Ok(TiledSolid::new(scaffold, filling, options)?.with_interpolation(NODES))
}

/// One pass over the band of a field in voxels, every value read.
fn pass(field: &WorldField, extent: Aabb, threads: &Threads) -> Result<BandStats, Fault> {
    let band = Band {
        field,
        transform: Transform::new(1.0).ok_or("no voxel size")?,
        half_width: 3.0,
        extent,
    };
    let reader = Reader::default();
    let stats = band.evaluate(threads, &Silent, &reader)?;
    std::hint::black_box(reader.totals());
    Ok(stats)
}

/// W2's tets where only ratios count: half as long, unless they are wanted in full.
fn w2(full: bool) -> Result<Scaffold, Fault> {
    let longest = if full { MAX_LENGTH } else { MAX_LENGTH / 2.0 };
    ellipsoid(longest, longest * PITCH)
}

/// Keys of a workload's counts.
struct Keys {
    leaves: &'static str,
    evaluated: &'static str,
}

/// Counts of a pass.
fn counts(keys: &Keys, stats: &BandStats) -> Vec<Found> {
    let leaves = stats.leaves_evaluated as f64 / stats.leaves_kept as f64;
    let evaluated = stats.samples_evaluated as f64 / stats.active_voxels as f64;
    vec![
        Found::new(
            keys.leaves,
            leaves,
            format!("{} of {}", stats.leaves_evaluated, stats.leaves_kept),
        ),
        Found::new(
            keys.evaluated,
            evaluated,
            format!("{} for {}", stats.samples_evaluated, stats.active_voxels),
        ),
    ]
}

/// What two threads make of a pass's time.
fn two_threads(key: &'static str, field: &WorldField, extent: Aabb) -> Result<Found, Fault> {
    let [one, two] = [Threads::new(1)?, Threads::new(2)?];
    let on = |threads: &Threads| {
        pass(field, extent, threads).expect("the field is finite");
    };
    let (mut single, mut double) = (|| on(&one), || on(&two));
    Ok(one_against_two(key, &mut single, &mut double))
}

const W2: Keys = Keys {
    leaves: "P10.w2",
    evaluated: "P10.w2.evaluated",
};
const LARGE_TETS: Keys = Keys {
    leaves: "P10.tets",
    evaluated: "P10.tets.evaluated",
};
const W3: Keys = Keys {
    leaves: "P10.w3",
    evaluated: "P10.w3.evaluated",
};

/// The struts of W2, a quarter as long, as a level set on voxels of 1.
#[cfg(feature = "vdb")]
pub fn level_set(threads: &Threads) -> Result<druse::vdb::LevelSet, Fault> {
    let scaffold = ellipsoid(250.0, 250.0 * PITCH)?;
    let table = table_for(&scaffold, FEW_SAMPLES)?;
    let transform = Transform::new(1.0).ok_or("no voxel size")?;
    let builder = druse::vdb::LevelSetBuilder::new(transform, 3.0)?;
    let band = Band {
        field: &tiled(&scaffold, &table)?,
        transform,
        half_width: 3.0,
        extent: scaffold.bounds(),
    };
    band.evaluate(threads, &Silent, &builder)?;
    Ok(builder.finish(druse::vdb::Session::new(threads, &Silent))?)
}

/// P8, what the series itself would take, and the counts of W2.
pub fn struts_in_tets(_: &Setting) -> Result<Vec<Found>, Fault> {
    const POINTS: usize = 4096;
    let pitch = MAX_LENGTH * PITCH;
    let scaffold = ellipsoid(MAX_LENGTH, pitch)?;
    let extent = scaffold.bounds();
    let table = table_for(&scaffold, SOME)?;
    let products = Products::of(&struts(SOME)?)?;
    let points = &walk()[..POINTS];
    let one = Threads::new(1)?;
    let field = tiled(&scaffold, &table)?;
    let stats = pass(&field, extent, &one)?;
    let run: &mut dyn FnMut() = &mut || {
        pass(&field, extent, &one).expect("the field is finite");
    };
    let seconds = in_turn(
        ROUNDS,
        &mut [run, &mut baselines::fuse, &mut || products.all(points)],
    );
    let active = stats.active_voxels as f64;
    let each: Vec<f64> = seconds[0].iter().map(|s| s * 1e9 / active).collect();
    let note = format!(
        "; {} tets, {} active voxels, {:.1} MiB of table",
        scaffold.len(),
        stats.active_voxels,
        table.bytes() as f64 / 1048576.0
    );
    let mut found = vec![baselines::at_reference("P8", &each, &seconds[1], &note)];
    // Twelve tets fill a cube of the lattice.
    let voxels = scaffold.len() as f64 * pitch.powi(3) / 12.0;
    let dense = seconds[2].iter().map(|s| s * voxels / POINTS as f64);
    let dense: Vec<f64> = dense.collect();
    let ratios = Spread::of_ratios(&dense, &seconds[0]);
    let note = format!(
        "{ratios}; {:.0} M voxels, {:.0} % of them active, {} products, {:.0} ns each",
        voxels / 1e6,
        1e2 * active / voxels,
        products.terms(),
        Spread::of(&dense).median * 1e9 / voxels
    );
    found.push(Found::new("P8.dense", ratios.median, note));
    found.extend(counts(&W2, &stats));
    Ok(found)
}

/// P8.nodes, what it gains to tell leaves of large cells by nodes, and their counts.
pub fn struts_in_large_tets(_: &Setting) -> Result<Vec<Found>, Fault> {
    let [longest, pitch] = LARGE;
    let scaffold = ellipsoid(longest, pitch)?;
    let extent = scaffold.bounds();
    let table = table_for(&scaffold, SOME)?;
    let visits = Visits::new(scaffold.len());
    let field = tiled(&scaffold, &table)?.with_visits(&visits);
    let plain = tiled(&scaffold, &table)?.with_interpolation(0.0);
    let one = Threads::new(1)?;
    let stats = pass(&field, extent, &one)?;
    let interpolated = visits.interpolated_leaves();
    let run = |field: &WorldField| {
        pass(field, extent, &one).expect("the field is finite");
    };
    let seconds = in_turn(ROUNDS, &mut [&mut || run(&plain), &mut || run(&field)]);
    let ratios = Spread::of_ratios(&seconds[0], &seconds[1]);
    let note = format!(
        "{ratios}; {interpolated} of {} leaves interpolated",
        stats.leaves_evaluated
    );
    let mut found = vec![Found::new("P8.nodes", ratios.median, note)];
    found.extend(counts(&LARGE_TETS, &stats));
    Ok(found)
}

/// P7, and what two threads make of W2's time: ratios, for which a smaller one will do.
pub fn orbits_and_threads(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let scaffold = w2(setting.full)?;
    let extent = scaffold.bounds();
    let [few, some, many] =
        [FEW_SAMPLES, SOME, MANY_SAMPLES].map(|limit| table_for(&scaffold, limit));
    let (few, some, many) = (few?, some?, many?);
    let one = Threads::new(1)?;
    let run = |field: &WorldField| {
        pass(field, extent, &one).expect("the field is finite");
    };
    let (small, large) = (tiled(&scaffold, &few)?, tiled(&scaffold, &many)?);
    let seconds = in_turn(ROUNDS, &mut [&mut || run(&large), &mut || run(&small)]);
    let ratios = Spread::of_ratios(&seconds[0], &seconds[1]);
    Ok(vec![
        Found::new("P7", ratios.median, ratios.to_string()),
        two_threads("P17", &tiled(&scaffold, &some)?, extent)?,
    ])
}

/// A pass over W2 on one thread, for a process that does nothing else.
pub fn one_pass(full: bool) -> Result<Box<dyn FnMut()>, Fault> {
    let scaffold: &'static Scaffold = Box::leak(Box::new(w2(full)?));
    let table: &'static Table = Box::leak(Box::new(table_for(scaffold, SOME)?));
    let field = tiled(scaffold, table)?;
    let one = Threads::new(1)?;
    Ok(Box::new(move || {
        pass(&field, scaffold.bounds(), &one).expect("the field is finite");
    }))
}

/// A block of hexes, bent so that no map is affine, `cell` voxels an edge.
fn bent_hexes(cell: f64) -> Result<Scaffold, Fault> {
    let counts = [20usize, 12, 8];
    let size = Vec3::from(counts.map(|n| n as f64 * cell));
    let grid = Scaffold::box_grid(size, counts, Kind::Hex8)?;
    let waves = |p: Vec3| {
        let q = p / (3.0 * cell);
        p + Vec3::new(q.y.sin() * q.z.cos(), q.z.sin(), (q.x + q.y).sin()) * (0.25 * cell)
    };
    let nodes = grid.nodes().iter().map(|&p| waves(p)).collect();
    Ok(Scaffold::new(nodes, grid.connectivity().clone())?)
}

/// The counts of W3.
pub fn blend_in_hexes(setting: &Setting) -> Result<Vec<Found>, Fault> {
    let scaffold = bent_hexes(if setting.full { 50.0 } else { 25.0 })?;
    let extent = scaffold.bounds();
    let tables = [Surface::SchwarzP, Surface::Iwp]
        .map(|s| -> Result<Table, Fault> { Ok(Table::new(&s.cell(Element::Hex)?)?) });
    let [first, second] = tables;
    let (first, second) = (first?, second?);
    let members = [("a", &first), ("b", &second)].map(|(name, table)| Member {
        name: name.to_owned(),
        cells: vec![table],
    });
    let span = extent.size().x;
    let shares = scaffold.nodes().iter().flat_map(|p| {
        let share = ((p.x - extent.min.x) / span).clamp(0.0, 1.0);
        [1.0 - share, share]
    });
    let weights = shares.collect();
    let blend = Blend::new(&scaffold, members.into(), weights, Interpolation::Linear)?;
    let field = tiled(&scaffold, &blend)?;
    let stats = pass(&field, extent, &Threads::new(1)?)?;
    let mut found = counts(&W3, &stats);
    found.push(two_threads("P17.w3", &field, extent)?);
    Ok(found)
}

/// Points of a walk through many cells, as a tilted lattice of 40 points an edge meets them.
pub fn walk() -> Vec<CellPoint<3>> {
    let ([ca, sa], [cb, sb]) = ([0.6f64.cos(), 0.6f64.sin()], [0.35f64.cos(), 0.35f64.sin()]);
    let steps = [
        Vec3::new(ca * cb, sa * cb, -sb),
        Vec3::new(-sa, ca, 0.0),
        Vec3::new(ca * sb, sa * sb, cb),
    ]
    .map(|v| v / 40.0);
    // Leaf by leaf.
    let place = |n: usize, leaf: [usize; 3]| {
        let own = [n >> 6 & 7, n >> 3 & 7, n & 7];
        let at = |a: usize| steps[a] * (8 * leaf[a] + own[a]) as f64;
        CellPoint(Vec3::new(0.13, 0.57, 0.91) + at(0) + at(1) + at(2))
    };
    (0..1 << 18)
        .map(|n| place(n & 511, [n >> 15, n >> 12 & 7, n >> 9 & 7]))
        .collect()
}
