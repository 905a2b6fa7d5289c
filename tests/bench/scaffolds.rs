//! What point location and inverse maps cost beside the cell itself.
//!
//! `cargo bench --bench scaffolds`: for each kind of element, nanoseconds of a value of the cell's table,
//! and per voxel of a tiling's narrow band, whose distance takes two values with gradients. The ratio
//! is what the scaffold adds: inverse maps, owners, neighbours, the boundary.

use druse::cell::{Surface, Table};
use druse::field::{Field, SampleLattice};
use druse::frame::{CellPoint, Element, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, Distance, TiledSolid, TilingOptions};
use std::hint::black_box;
use std::time::Instant;

/// A block of one kind, its nodes bent, so that maps of all but Tet4 are curved.
fn block(kind: Kind) -> Scaffold {
    let linear = match kind.shape() {
        Element::Tet => Kind::Tet4,
        _ => Kind::Hex8,
    };
    let grid = Scaffold::box_grid(Vec3::repeat(4.0), [4, 4, 4], linear).unwrap();
    let bent =
        |p: Vec3| p + Vec3::new((p.y * 0.8).sin(), (p.z * 0.7).sin(), (p.x * 0.9).sin()) * 0.2;
    let mut nodes: Vec<Vec3> = Vec::new();
    let mut elements = Connectivity::default();
    let mut known: std::collections::HashMap<[i64; 3], u32> = std::collections::HashMap::new();
    for e in grid.elements() {
        let own: Vec<u32> = kind
            .reference_nodes()
            .into_iter()
            .map(|xi| {
                let p = e.map(xi).0;
                let name = [p.x, p.y, p.z].map(|c| (c * 64.0).round() as i64);
                *known.entry(name).or_insert_with(|| {
                    nodes.push(bent(p));
                    nodes.len() as u32 - 1
                })
            })
            .collect();
        elements.push(kind, &own);
    }
    Scaffold::new(nodes, elements).unwrap()
}

fn main() {
    println!("kind      ns per cell value  ns per band voxel  ratio to value with gradient, twice");
    for kind in Kind::solids().filter(|k| matches!(k.shape(), Element::Tet | Element::Hex)) {
        let scaffold = block(kind);
        let surface = if kind.shape() == Element::Tet {
            Surface::Diamond
        } else {
            Surface::Neovius
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let count = 400_000u32;
        let points: Vec<CellPoint<3>> = (0..count)
            .map(|i| {
                let f = f64::from(i);
                CellPoint(
                    Vec3::new(
                        (f * 0.618).fract(),
                        (f * 0.414).fract(),
                        (f * 0.732).fract(),
                    )
                    .add_scalar(-0.5),
                )
            })
            .collect();
        let start = Instant::now();
        let sum: f64 = points.iter().map(|&p| table.value(p)).sum();
        let value = start.elapsed().as_secs_f64() / f64::from(count);
        black_box(sum);
        let start = Instant::now();
        let sum: f64 = points.iter().map(|&p| table.value_and_gradient(p).0).sum();
        let slope = start.elapsed().as_secs_f64() / f64::from(count);
        black_box(sum);
        let h = 0.04;
        let options = TilingOptions {
            voxel_size: h,
            half_width: 3.0 * h,
            distance: Distance::Fast,
            boundary: Boundary::Cut,
        };
        let tiled = TiledSolid::new(&scaffold, &table, options).unwrap();
        let (mut seconds, mut band) = (0.0, 0usize);
        let mut out = vec![0f32; 512];
        for i in 0..1000u32 {
            let at = Vec3::new(
                f64::from(i % 10),
                f64::from(i / 10 % 10),
                f64::from(i / 100),
            ) * (8.0 * h);
            let lattice = SampleLattice {
                origin: WorldPoint(at.add_scalar(0.4)),
                step: h,
                counts: [8, 8, 8],
            };
            let start = Instant::now();
            tiled.fill(&lattice, &mut out);
            seconds += start.elapsed().as_secs_f64();
            band += out.iter().filter(|v| v.abs() < (3.0 * h) as f32).count();
        }
        let voxel = seconds / band as f64;
        println!(
            "{:8} {:18.0} {:18.0} {:6.2}",
            kind.name(),
            value * 1e9,
            voxel * 1e9,
            voxel / (2.0 * slope)
        );
    }
}
