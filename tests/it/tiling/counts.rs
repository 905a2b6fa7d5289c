//! What a band costs, in counts: leaves visited, points evaluated.

use super::{options, scaffold};
use crate::strategy::Noise;
use druse::band::{Band, LeafCounter, LeafMap};
use druse::cell::{Surface, Table};
use druse::field::Field;
use druse::frame::{Coord, Element, Transform};
use druse::progress::{Silent, Threads};
use druse::scaffold::Kind;
use druse::tiling::TiledSolid;

#[test]
fn few_points_are_looked_at_for_each_active_voxel_and_give_what_single_points_do() {
    for kind in [Kind::Tet4, Kind::Tet10, Kind::Hex8] {
        let scaffold = scaffold(kind, [2, 2, 2], 0.15, 5);
        let surface = if kind == Kind::Hex8 {
            Surface::SchwarzP
        } else {
            Surface::Diamond
        };
        let cell = surface.cell(kind.shape()).unwrap();
        let table = Table::new(&cell).unwrap();
        // Voxels along an edge of the grid.
        let voxels = if crate::is_full() { 80.0 } else { 56.0 };
        let h = 1.0 / voxels;
        let tiled = TiledSolid::new(&scaffold, &table, options(h)).unwrap();
        let transform = Transform::new(h).unwrap();
        let found = [1, 2].map(|threads| {
            let sink = LeafMap::default();
            let band = Band {
                field: &tiled,
                transform,
                half_width: 3.0,
                extent: scaffold.bounds(),
            };
            let threads = Threads::new(threads).unwrap();
            (
                band.evaluate(&threads, &Silent, &sink).unwrap(),
                sink.into_leaves(),
            )
        });
        let [(stats, leaves), (again, same)] = found;
        assert_eq!(stats, again);
        assert!(leaves == same);
        let evaluated = stats.samples_evaluated as f64 / stats.active_voxels as f64;
        let touched = stats.leaves_evaluated as f64 / stats.leaves_kept as f64;
        println!(
            "{}: {evaluated:.2} evaluated, {touched:.2} touched",
            kind.name()
        );
        assert!(evaluated <= 4.0, "{}: {evaluated}", kind.name());
        assert!(touched <= 1.4, "{}: {touched}", kind.name());
        let mut noise = Noise::new(3);
        for (origin, (mask, values)) in leaves.iter().step_by(37) {
            let n = noise.below(512);
            if mask[n >> 6] >> (n & 63) & 1 == 0 {
                continue;
            }
            let voxel = Coord::new(
                origin[0] + (n >> 6) as i32,
                origin[1] + (n >> 3 & 7) as i32,
                origin[2] + (n & 7) as i32,
            );
            let single = tiled.value(transform.world(voxel));
            assert!(
                (f64::from(values[n]) - single).abs() < 1e-4 * h,
                "{voxel:?}"
            );
        }
    }
}

/// Memory is allocated by blocks, not by leaves: what a pass takes again, once its buffers are there.
#[test]
fn memory_is_allocated_by_blocks() {
    let one = Threads::new(1).unwrap();
    let many = if crate::is_full() { 5 } else { 3 };
    let all = [
        // Many elements are near a leaf.
        (Kind::Tet4, 0.15, (many, 20.0)),
        (Kind::Tet10, 0.15, (many, 20.0)),
        (Kind::Hex8, 0.15, (2, 60.0)),
        (Kind::Hex8, 0.0, (2, 60.0)),
        (Kind::Tet4, 0.15, (2, 60.0)),
        (Kind::Tet10, 0.15, (2, 60.0)),
        (Kind::Hex27, 0.15, (2, 60.0)),
    ];
    let tried = if crate::is_full() { all.len() } else { 3 };
    for (kind, noise, (cubes, voxels)) in all.into_iter().take(tried) {
        let scaffold = scaffold(kind, [cubes; 3], noise, 5);
        let surface = if kind.shape() == Element::Hex {
            Surface::SchwarzP
        } else {
            Surface::Diamond
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let h = 1.0 / voxels;
        let tiled = TiledSolid::new(&scaffold, &table, options(h)).unwrap();
        let pass = || {
            let band = Band {
                field: &tiled,
                transform: Transform::new(h).unwrap(),
                half_width: 3.0,
                extent: scaffold.bounds(),
            };
            band.evaluate(&one, &Silent, &LeafCounter::default())
                .unwrap()
        };
        let (stats, allocated) = one.install(|| {
            let stats = pass();
            let allocated = allocation_counter::measure(|| {
                pass();
            });
            (stats, allocated)
        });
        let each = allocated.count_total as f64 / stats.leaves_evaluated as f64;
        println!(
            "{} {noise}: {each:.2} allocations for each of {} leaves, {} bytes at most",
            kind.name(),
            stats.leaves_evaluated,
            allocated.bytes_max
        );
        // Leaves on an outer face evaluate the samples beyond it.
        assert!(each <= 0.1, "{} {noise}: {each}", kind.name());
        // Buffers are there already.
        assert!(allocated.bytes_max < 1 << 20, "{allocated:?}");
    }
}
