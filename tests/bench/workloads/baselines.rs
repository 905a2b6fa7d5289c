//! What others do, and what the machine can do at most.

use super::clock::Spread;
use super::figure::Found;
use super::reader::Reader;
#[cfg(feature = "vdb")]
use druse::band::{LeafBatch, LeafSink, SinkError};
use druse::frame::Coord;
use std::f64::consts::TAU;
use std::hint::black_box;

/// A box of `cells` gyroid cells of `voxels` each, along every axis.
#[derive(Clone, Copy)]
pub struct Box {
    pub cells: usize,
    pub voxels: usize,
}

impl Box {
    /// Voxels along an edge.
    pub fn edge(self) -> usize {
        self.cells * self.voxels
    }
}

/// Half width of the band in voxels.
const HALF_WIDTH: f64 = 3.0;

/// A user's function in f64, lengths in voxels: the gyroid scaled to its mean slope, cut by the box.
pub fn scalar_f64(at: Box, p: [f64; 3]) -> f64 {
    let w = TAU / at.voxels as f64;
    let [x, y, z] = p.map(|c| c * w);
    let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
    let edge = at.edge() as f64;
    let outside = p.map(|c| (c - edge / 2.0).abs() - edge / 2.0);
    let wall = outside.into_iter().fold(f64::NEG_INFINITY, f64::max);
    (gyroid / (1.3 * w)).max(wall)
}

fn scalar_f32(at: Box, p: [f32; 3]) -> f32 {
    let w = std::f32::consts::TAU / at.voxels as f32;
    let [x, y, z] = p.map(|c| c * w);
    let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
    let edge = at.edge() as f32;
    let outside = p.map(|c| (c - edge / 2.0).abs() - edge / 2.0);
    let wall = outside.into_iter().fold(f32::NEG_INFINITY, f32::max);
    (gyroid / (1.3 * w)).max(wall)
}

/// What takes a leaf: its origin, mask and values.
type Taker<'a> = &'a dyn Fn(Coord, &[u64; 8], &[f32; 512]);

/// Leaves of the box from a function of voxels, one leaf after the other: every value stored, the
/// mask set where it lies in the band, read by the same reader.
fn by_leaves(at: Box, reader: Taker<'_>, value: impl Fn([i32; 3]) -> f32) {
    let leaves = (at.edge() as i32 + 8) / 8;
    let w = HALF_WIDTH as f32;
    let mut values = [0f32; 512];
    for l in 0..leaves * leaves * leaves {
        let origin = [l / (leaves * leaves), l / leaves % leaves, l % leaves].map(|c| 8 * c);
        let (mut mask, mut any) = ([0u64; 8], 0);
        for n in 0..512 {
            let at = [n >> 6, n >> 3 & 7, n & 7];
            let v = value([0, 1, 2].map(|a| origin[a] + at[a] as i32));
            mask[n >> 6] |= u64::from(v.abs() < w) << (n & 63);
            values[n] = v.clamp(-w, w);
        }
        for word in mask {
            any |= word;
        }
        if any != 0 {
            reader(Coord(origin), &mask, &values);
        }
    }
}

/// B0: a callback in f64 per voxel of the box, through a pointer that nothing looks into.
pub fn callback_f64(at: Box, reader: &Reader) {
    let function: fn(Box, [f64; 3]) -> f64 = black_box(scalar_f64);
    by_leaves(at, &|o, m, v| reader.enter(o, m, v), |p| {
        function(at, p.map(f64::from)) as f32
    });
}

/// B1: the same in f32, the function compiled in.
pub fn leafwise_f32(at: Box, reader: &Reader) {
    by_leaves(at, &|o, m, v| reader.enter(o, m, v), |p| {
        scalar_f32(at, p.map(|c| c as f32))
    });
}

/// B0 delivered to a sink in batches.
#[cfg(feature = "vdb")]
pub fn callback_to_sink(at: Box, scale: f32, sink: &dyn LeafSink) -> Result<(), SinkError> {
    let function: fn(Box, [f64; 3]) -> f64 = black_box(scalar_f64);
    let batches = std::cell::RefCell::new(std::collections::BTreeMap::<Coord, LeafBatch>::new());
    by_leaves(
        at,
        &|origin, mask, values| {
            let mut batches = batches.borrow_mut();
            let batch = batches.entry(origin.aligned(128)).or_default();
            batch.push(origin, *mask, values);
        },
        |p| function(at, p.map(f64::from)) as f32,
    );
    for (block, mut batch) in batches.into_inner() {
        for v in batch.values.as_flattened_mut() {
            *v *= scale;
        }
        sink.block(block, &batch)?;
    }
    Ok(())
}

/// B2: dense arrays from 1-D tables, as numpy's broadcasting makes them: the sines and cosines along
/// each axis once, products of two axes as planes, and one array of the whole box per sum.
pub fn dense_tables(at: Box) -> Vec<f32> {
    let n = at.edge() + 1;
    let w = std::f32::consts::TAU / at.voxels as f32;
    let (sin, cos): (Vec<f32>, Vec<f32>) = (0..n).map(|i| (w * i as f32).sin_cos()).unzip();
    let plane = |a: &[f32], b: &[f32]| -> Vec<f32> {
        a.iter()
            .flat_map(|&a| b.iter().map(move |&b| a * b))
            .collect()
    };
    let (xy, yz, zx) = (plane(&sin, &cos), plane(&sin, &cos), plane(&cos, &sin));
    let mut first = Vec::with_capacity(n * n * n);
    for x in 0..n {
        for y in 0..n {
            let a = xy[x * n + y];
            first.extend(yz[y * n..][..n].iter().map(|b| a + b));
        }
    }
    let first = black_box(first);
    let mut sum = Vec::with_capacity(n * n * n);
    for x in 0..n {
        for y in 0..n {
            let row = &first[(x * n + y) * n..][..n];
            sum.extend(row.iter().zip(&zx[x * n..][..n]).map(|(a, b)| a + b));
        }
    }
    sum
}

/// B4: writes bytes into memory that is there.
pub fn write(bytes: &mut [u8]) {
    bytes.fill(black_box(0x40));
    black_box(bytes);
}

const TIMES: usize = 4_000_000;
const CHAINS: usize = 12;
/// Fused multiplications a nanosecond of the machine that goals in seconds were set on.
const REFERENCE: f64 = 58.6;

/// A loop that is compiled for the processor only where it is part of the function with that attribute: a
/// closure may be left outside, where each of its multiplications is a call.
struct Fusing;

#[allow(clippy::inline_always)]
impl pulp::NullaryFnOnce for Fusing {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut sums = [[1.0f32; 8]; CHAINS];
        let (a, b) = black_box((0.999_9f32, 1e-4f32));
        for _ in 0..TIMES {
            for sum in &mut sums {
                for lane in sum {
                    *lane = lane.mul_add(a, b);
                }
            }
        }
        black_box(sums);
    }
}

/// B5: fused multiplications of 8 lanes, as many as the processor can.
pub fn fuse() {
    match pulp::x86::V3::try_new() {
        Some(v3) => v3.vectorize(Fusing),
        None => pulp::NullaryFnOnce::call(Fusing),
    }
}

/// Fused multiplications a nanosecond, from the seconds that [`fuse`] took.
pub fn fused_per_nanosecond(seconds: f64) -> f64 {
    (TIMES * CHAINS * 8) as f64 * 1e-9 / seconds
}

/// Times per piece of work as the machine would have taken them that their goal was set on: round by round,
/// by how fast this one fused in the same round.
pub fn at_reference(key: &'static str, each: &[f64], fusing: &[f64], note: &str) -> Found {
    let speeds = fusing.iter().map(|&s| fused_per_nanosecond(s) / REFERENCE);
    let speeds: Vec<f64> = speeds.collect();
    let there: Vec<f64> = each.iter().zip(&speeds).map(|(e, s)| e * s).collect();
    let (there, here) = (Spread::of(&there), Spread::of(each));
    let speed = Spread::of(&speeds).median;
    let note = format!(
        "{there}; here {:.2}, {here}, at {speed:.2} of the speed the goal was set at{note}",
        here.median
    );
    Found::new(key, there.median, note)
}

/// The processor, by family and model as its maker counts them, and the widest code that it runs: goals were
/// set on a Zen 4, with AVX-512 and 1 MiB of its own cache for each core.
pub fn processor() -> String {
    let [name, family, model] = ["model name", "cpu family", "model"].map(of_processor);
    let code = widest_code();
    format!("{name}, family {family}, model {model}, {code}")
}

/// The processor's family and the widest code that it runs.
pub fn processor_family() -> String {
    format!("family {}, {}", of_processor("cpu family"), widest_code())
}

/// A property of the processor by its name in the system's list.
fn of_processor(name: &str) -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |line: &str| {
        let rest = line.strip_prefix(name)?.trim_start();
        Some(rest.strip_prefix(':')?.trim().to_owned())
    };
    let word = info.lines().find_map(value);
    word.unwrap_or_else(|| "unknown".into())
}

fn widest_code() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f") {
        return "AVX-512";
    } else if is_x86_feature_detected!("avx2") {
        return "AVX2";
    }
    "portable"
}
