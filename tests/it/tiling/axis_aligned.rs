//! Boxes of hexes along the voxels: the way through tables along the axes beside the general one.

use super::same_band_when_slow;
use crate::band::dense_region;
use druse::band::{Band, LeafMap};
use druse::cell::{Cell, Solid, Surface, Table};
use druse::field::{Field, Interval, Offset, SampleLattice};
use druse::frame::{Aabb, CellBox, CellPoint, Element, Transform, Vec3, WorldPoint};
use druse::progress::{Silent, Threads};
use druse::scaffold::{Kind, Scaffold};
use druse::tiling::{Boundary, CellField, Distance, TiledSolid, TilingOptions};

/// A table that does not tell that it is a short series.
struct Hidden<'a>(&'a Table);

impl Field for Hidden<'_> {
    type Point = CellPoint<3>;
    fn value(&self, p: CellPoint<3>) -> f64 {
        self.0.value(p)
    }
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        self.0.value_and_gradient(p)
    }
    fn bound(&self, region: &CellBox<3>) -> Interval {
        self.0.bound(region)
    }
}

impl CellField for Hidden<'_> {
    fn element(&self) -> Element {
        self.0.element()
    }
    fn fits_any_numbering(&self) -> bool {
        self.0.fits_any_numbering()
    }
    fn gradient_sup(&self) -> f64 {
        self.0.gradient_sup()
    }
    fn gradient_rms(&self) -> f64 {
        self.0.gradient_rms()
    }
}

fn cells() -> Vec<Cell> {
    let of = |s: Surface| s.cell(Element::Hex).unwrap();
    vec![
        of(Surface::Gyroid),
        of(Surface::SchwarzP).inverted(),
        of(Surface::Iwp).shifted(0.3).unwrap(),
        of(Surface::Diamond).with_solid(Solid::Sheet, 0.3).unwrap(),
        of(Surface::Neovius)
            .with_solid(Solid::Channels, 0.5)
            .unwrap(),
    ]
}

#[test]
fn distances_are_those_of_the_general_way() {
    // Anisotropic hexes of 40, 46 and 36 voxels.
    let size = Vec3::new(2.0, 2.3, 1.8);
    let scaffold = Scaffold::box_grid(size, [2, 2, 2], Kind::Hex8).unwrap();
    let h = 0.025;
    for (number, cell) in cells().iter().enumerate() {
        let table = Table::new(cell).unwrap();
        assert!(table.products().is_some(), "{}", cell.name());
        let hidden = Hidden(&table);
        for boundary in [Boundary::Cut, Boundary::Extend] {
            let options = TilingOptions {
                voxel_size: h,
                half_width: 3.0 * h,
                distance: Distance::Fast,
                boundary,
            };
            let fast = TiledSolid::new(&scaffold, &table, options).unwrap();
            let general = TiledSolid::new(&scaffold, &hidden, options).unwrap();
            let (mut squares, mut count) = (0.0, 0);
            for n in 0..30u32 {
                // Some of them reach out of the box.
                let spread = Vec3::new(0.819_17, 0.671_04, 0.549_70) * f64::from(n);
                let corner = spread
                    .map(f64::fract)
                    .component_mul(&size)
                    .add_scalar(-4.0 * h);
                let lattice = SampleLattice {
                    origin: WorldPoint(corner),
                    step: h,
                    counts: if n % 3 == 0 { [3, 2, 11] } else { [8; 3] },
                };
                let mut values = vec![0f32; lattice.len()];
                fast.fill(&lattice, &mut values);
                let bound = fast.bound(&lattice.span());
                for (m, &v) in values.iter().enumerate() {
                    let (v, p) = (f64::from(v), lattice.point(m));
                    let single = fast.value(p);
                    let off = ((v - single) / h).abs();
                    assert!(off < 0.1, "{number} {boundary:?} {p:?} {v} {single}");
                    squares += off * off;
                    count += 1;
                    // The table is off by its error, and so are kinks of sheets.
                    let other = general.value(p);
                    let slack = 4.0 * table.error_bound() / table.gradient_rms() + 0.02 * h;
                    assert!(
                        (single - other).abs() < slack,
                        "{number} {p:?} {single} {other}"
                    );
                    assert!(bound.lo - 1e-5 * h <= v && v <= bound.hi + 1e-5 * h);
                    assert!(bound.lo <= single + 1e-9 && single <= bound.hi + 1e-9);
                    assert!(single.abs() < 1e-4 * h || (v < 0.0) == (single < 0.0));
                }
            }
            let rms = f64::sqrt(squares / f64::from(count));
            assert!(rms < 0.005, "{number} {boundary:?}: {rms} voxels rms");
        }
    }
}

/// A lattice of 8^2 samples beside or within a leaf takes the leaf's values, wherever it begins.
#[test]
fn a_layer_has_the_values_of_its_leaf() {
    let scaffold = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
    let h = 0.025;
    let options = TilingOptions {
        voxel_size: h,
        half_width: 3.0 * h,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    };
    for cell in cells() {
        let table = Table::new(&cell).unwrap();
        let solid = TiledSolid::new(&scaffold, &table, options).unwrap();
        // On the voxels of a leaf at a corner of the box, at its far faces and inside; and between voxels.
        for first in [[-8.0; 3], [0.0; 3], [80.0, 72.0, 40.0], [16.3, 31.6, 50.5]] {
            let origin = WorldPoint(Vec3::from(first) * h);
            // Layers elsewhere have the values of another leaf, whose scales are interpolated from other places.
            let is_aligned = first.iter().all(|c| c % 8.0 == 0.0);
            let most = if is_aligned { 1e-3 } else { 0.1 };
            let mut leaf = [0.0; 512];
            let lattice = SampleLattice {
                origin,
                step: h,
                counts: [8; 3],
            };
            solid.fill(&lattice, &mut leaf);
            for (axis, side) in (0..6).map(|n| (n / 2, n % 2)) {
                let at = 7 * side;
                let mut layer = lattice;
                layer.origin.0[axis] += h * at as f64;
                layer.counts[axis] = 1;
                let mut values = [0.0; 64];
                solid.fill(&layer, &mut values);
                let own = (0..512).filter(|n| n >> (6 - 3 * axis) & 7 == at);
                for (value, n) in values.iter().zip(own) {
                    let error = (value - leaf[n]).abs() / h as f32;
                    assert!(error < most, "{}: {error} at {n}", cell.name());
                }
            }
        }
    }
}

#[test]
fn signs_are_those_of_the_values() {
    let size = Vec3::new(2.0, 2.3, 1.8);
    let hexes = Scaffold::box_grid(size, [2, 2, 2], Kind::Hex8).unwrap();
    let h = 0.025;
    for cell in cells() {
        let table = Table::new(&cell).unwrap();
        for boundary in [Boundary::Cut, Boundary::Extend] {
            let options = TilingOptions {
                boundary,
                ..super::options(h)
            };
            let solid = TiledSolid::new(&hexes, &table, options).unwrap();
            // Layers across each axis, a row, and a lattice too wide for the short way.
            let shapes = [
                [1, 10, 10],
                [10, 1, 10],
                [10, 10, 1],
                [1, 1, 16],
                [2, 3, 20],
            ];
            for n in 0..100u32 {
                let spread = Vec3::new(0.819_17, 0.671_04, 0.549_70) * f64::from(n);
                let corner = spread.map(f64::fract).component_mul(&size);
                let lattice = SampleLattice {
                    origin: WorldPoint(corner.add_scalar(-5.0 * h)),
                    step: h,
                    counts: shapes[n as usize % shapes.len()],
                };
                let mut values = vec![0f32; lattice.len()];
                let [nx, ny, nz] = lattice.counts;
                let mut rows = vec![0; nx * ny];
                solid.fill(&lattice, &mut values);
                let looked = solid.signs(&lattice, &vec![u64::MAX; nx * ny], &mut rows);
                assert_eq!(looked, lattice.len() as u64);
                assert!(rows.iter().all(|r| r >> nz == 0));
                for (m, &v) in values.iter().enumerate() {
                    let sign = rows[m / nz] >> (m % nz) & 1 == 1;
                    let is_clear = f64::from(v.abs()) > 1e-4 * h;
                    assert!(
                        !is_clear || (v < 0.0) == sign,
                        "{} {boundary:?} {:?}: {v}",
                        cell.name(),
                        lattice.point(m)
                    );
                }
            }
        }
    }
}

#[test]
fn eight_bounds_at_once_hold_and_are_as_sharp_as_single_ones() {
    let size = Vec3::new(2.0, 2.3, 1.8);
    let hexes = Scaffold::box_grid(size, [2, 2, 2], Kind::Hex8).unwrap();
    let h = 0.025;
    for cell in cells() {
        let table = Table::new(&cell).unwrap();
        for boundary in [Boundary::Cut, Boundary::Extend] {
            let options = TilingOptions {
                boundary,
                ..super::options(h)
            };
            let solid = TiledSolid::new(&hexes, &table, options).unwrap();
            for n in 0..60u32 {
                // Eight cubes of 1 to 12 voxels, some of them out of the box.
                let regions: [Aabb; 8] = std::array::from_fn(|m| {
                    let spread =
                        Vec3::new(0.819_17, 0.671_04, 0.549_70) * f64::from(8 * n + m as u32);
                    let min = spread.map(f64::fract).component_mul(&size.add_scalar(0.4));
                    let min = min.add_scalar(-0.2);
                    Aabb {
                        min,
                        max: min.add_scalar(h * f64::from(1 + n % 12)),
                    }
                });
                let bounds = Field::bounds(&solid, &regions).unwrap();
                for (region, bound) in regions.iter().zip(bounds) {
                    let single = solid.bound(region);
                    let apart = (bound.lo - single.lo)
                        .abs()
                        .max((bound.hi - single.hi).abs());
                    // At the half width a bound may leap by what interpolated scales are off.
                    assert!(apart < 0.065 * h, "{}: {bound:?} {single:?}", cell.name());
                    for m in 0..27u32 {
                        let at = [m / 9, m / 3 % 3, m % 3].map(|i| f64::from(i) / 2.0);
                        let p = region.min + Vec3::from(at).component_mul(&region.size());
                        let v = solid.value(WorldPoint(p));
                        let slack = 1e-9;
                        assert!(
                            bound.lo - slack <= v && v <= bound.hi + slack,
                            "{} {bound:?} {v}",
                            cell.name()
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn bounds_contain_what_the_box_cuts() {
    let scaffold = Scaffold::box_grid(Vec3::repeat(1.0), [1; 3], Kind::Hex8).unwrap();
    let table = Table::new(&Surface::Gyroid.cell(Element::Hex).unwrap()).unwrap();
    let h = 1.0 / 64.0;
    let options = TilingOptions {
        voxel_size: h,
        half_width: 3.0 * h,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    };
    let solid = TiledSolid::new(&scaffold, &table, options).unwrap();
    for n in 0..200u32 {
        let spread = Vec3::new(0.819_17, 0.671_04, 0.549_70) * f64::from(n);
        let min = spread.map(f64::fract) * 1.2 - Vec3::repeat(0.1);
        let region = Aabb {
            min,
            max: min.add_scalar(h * f64::from(n % 40)),
        };
        let bound = solid.bound(&region);
        for m in 0..64u32 {
            let at = [m / 16, m / 4 % 4, m % 4].map(|i| f64::from(i) / 3.0);
            let p = region.min + Vec3::from(at).component_mul(&region.size());
            let v = solid.value(WorldPoint(p));
            assert!(
                bound.lo - 1e-12 <= v && v <= bound.hi + 1e-12,
                "{bound:?} {v}"
            );
        }
    }
}

#[test]
fn a_band_is_the_same_without_what_the_field_knows_sooner() {
    // The second one is coarse, so that every sample has its own scale, and its band is narrow, so that
    // signs change next to inactive voxels. So they do in the third at the sides of the box, also of leaves
    // that lie inside the cells' solid.
    let bricks = Vec3::new(2.0, 2.3, 1.8);
    let cases = [
        (bricks, 0.025, 3.0),
        (bricks, 0.09, 1.0),
        (Vec3::repeat(2.0), 1.0 / 41.4, 1.0),
    ];
    for (size, h, half_width) in cases {
        let hexes = Scaffold::box_grid(size, [2, 2, 2], Kind::Hex8).unwrap();
        let mut by_signs = 0;
        for (number, cell) in cells().iter().enumerate() {
            let table = Table::new(cell).unwrap();
            let boundary = [Boundary::Cut, Boundary::Extend][number % 2];
            let options = TilingOptions {
                voxel_size: h,
                half_width: half_width * h,
                distance: Distance::Fast,
                boundary,
            };
            let tiled = TiledSolid::new(&hexes, &table, options).unwrap();
            let leaves = same_band_when_slow(&tiled, options, hexes.bounds());
            let beyond = |v: f32| v.abs() >= (half_width * h) as f32;
            for (mask, values) in leaves.values() {
                by_signs += (0..512)
                    .filter(|&n| mask[n >> 6] >> (n & 63) & 1 == 1 && beyond(values[n]))
                    .count();
            }
        }
        // Else the law would be an empty one.
        assert!(half_width > 1.0 || by_signs > 0);
    }
}

/// Moved fields fill leaves in bulk and are culled by cubes of leaves, which single values know nothing of.
#[test]
fn bands_of_moved_fields_are_those_of_their_values() {
    let scaffold = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
    let h = 0.03;
    let width = 3.0 * h;
    let transform = Transform::new(h).unwrap();
    // Not by whole voxels, which would put the walls of the box where the band ends.
    for (cell, by) in cells().iter().take(3).zip([0.93, -0.87, 0.7]) {
        let table = Table::new(cell).unwrap();
        let options = TilingOptions {
            voxel_size: h,
            // A little further than the band, moved, so that none of it lies where distances end.
            half_width: width + 1.1 * h,
            distance: Distance::Fast,
            boundary: Boundary::Cut,
        };
        let moved = Offset {
            field: Box::new(TiledSolid::new(&scaffold, &table, options).unwrap()),
            by: by * h,
            half: None,
        };
        let sink = LeafMap::default();
        let band = Band {
            field: &moved,
            transform,
            half_width: 3.0,
            extent: scaffold.bounds().dilated(2.0 * h),
        };
        let one = Threads::new(1).unwrap();
        let stats = band.evaluate(&one, &Silent, &sink).unwrap();
        let found = sink.into_leaves();
        let value = |c| moved.value(transform.world(c)) as f32;
        let expected = dense_region(value, width as f32, [-8; 3], [80; 3]);
        let (mut squares, mut count) = (0.0, 0u64);
        for (origin, (mask, values)) in &expected {
            let none = ([0; 8], [0.0; 512]);
            let leaf = found.get(origin).unwrap_or(&none);
            for (n, &v) in values.iter().enumerate() {
                // Scales between those of a table are not exact: voxels at the band's edge may be lost.
                let is_safe = f64::from(v.abs()) < width - 0.1 * h;
                if mask[n / 64] >> (n % 64) & 1 != 0 && is_safe {
                    assert!(leaf.0[n / 64] >> (n % 64) & 1 != 0, "{origin:?} {n} {v}");
                    let off = f64::from((leaf.1[n] - v).abs()) / h;
                    assert!(
                        off < 0.1,
                        "{} {origin:?} {n}: {v} {}",
                        cell.name(),
                        leaf.1[n]
                    );
                    squares += off * off;
                    count += 1;
                }
            }
        }
        let rms = f64::sqrt(squares / count as f64);
        assert!(
            count > 50_000 && rms < 0.01,
            "{}: {count} {rms}",
            cell.name()
        );
        let active = expected
            .values()
            .map(|(m, _)| m.iter().map(|w| w.count_ones()).sum::<u32>());
        let active = f64::from(active.sum::<u32>());
        assert!(
            (stats.active_voxels as f64 / active - 1.0).abs() < 0.01,
            "{}: {} {active}",
            cell.name(),
            stats.active_voxels
        );
    }
}
