//! Elements with affine maps, and signs in bent ones: bulk evaluation equals evaluation at single points.

use super::options;
use crate::strategy::{self, Noise};
use druse::cell::{Surface, Table};
use druse::field::{Field, Interval, LeafParts, SampleLattice};
use druse::frame::{Aabb, Element, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, TiledSolid, TilingOptions};

/// Parallelepipeds, or tets of random shape.
fn straight(kind: Kind) -> Scaffold {
    if kind == Kind::Tet4 {
        return super::scaffold(kind, [2, 2, 2], 0.15, 11);
    }
    let (mut nodes, elements) = strategy::mesh(kind, [2, 3, 2], 0.0, 1);
    for p in &mut nodes {
        *p += Vec3::new(0.3 * p.y - 0.1 * p.z, 0.2 * p.z, 0.15 * p.x);
    }
    Scaffold::new(nodes, elements).unwrap()
}

/// A scaffold and the same again elsewhere, overlapping it or apart from it.
fn twice(once: &Scaffold, by: Vec3) -> Scaffold {
    let moved = once.nodes().iter().map(|p| p + by);
    let nodes: Vec<Vec3> = once.nodes().iter().copied().chain(moved).collect();
    let count = once.nodes().len() as u32;
    let mut elements = Connectivity::default();
    for shift in [0, count] {
        for e in 0..once.len() {
            let element = once.element(e);
            let own: Vec<u32> = element.nodes().iter().map(|n| n + shift).collect();
            elements.push(element.kind(), &own);
        }
    }
    Scaffold::new(nodes, elements).unwrap()
}

/// A bar of tets that winds once and a quarter around an axis and overlaps itself.
fn coil(kind: Kind) -> Scaffold {
    let (mut nodes, elements) = strategy::mesh(kind, [20, 2, 2], 0.0, 1);
    for p in &mut nodes {
        let (angle, radius) = (-p.x * std::f64::consts::PI / 8.0, 3.0 + p.y);
        *p = Vec3::new(radius * angle.cos(), radius * angle.sin(), p.z + 0.05 * p.x);
    }
    Scaffold::new(nodes, elements).unwrap()
}

/// A scaffold, bent where its kind can be, the same twice, and of tets one that overlaps itself.
fn overlapping(kind: Kind) -> Vec<Scaffold> {
    let mut once = straight(kind);
    if matches!(kind, Kind::Tet10 | Kind::Hex20) {
        let bent = |p: &Vec3| p + Vec3::new(0.1 * p.y * p.y, 0.08 * p.z * p.x, 0.1 * p.x * p.x);
        let nodes = once.nodes().iter().map(bent).collect();
        once = Scaffold::new(nodes, once.connectivity().clone()).unwrap();
    }
    let mut all = vec![twice(&once, Vec3::new(0.4, 0.3, 0.2)), once];
    if kind.shape() == Element::Tet {
        all.push(coil(kind));
    }
    all
}

/// For so many voxels a unit of length, and the half width of the band in voxels.
fn banded(voxels: f64, half_width: f64, boundary: Boundary) -> TilingOptions {
    let h = 1.0 / voxels;
    TilingOptions {
        boundary,
        half_width: half_width * h,
        ..options(h)
    }
}

fn table(kind: Kind) -> Table {
    let surface = if kind.shape() == Element::Hex {
        Surface::SchwarzP
    } else {
        Surface::Diamond
    };
    Table::new(&surface.cell(kind.shape()).unwrap()).unwrap()
}

/// A lattice whose first sample lies anywhere in the box of one of the elements or a little outside of it.
fn anywhere(
    scaffold: &Scaffold,
    counts: [usize; 3],
    h: f64,
    noise: &mut Noise,
) -> SampleLattice<WorldPoint> {
    let element = scaffold.element(noise.below(scaffold.len()));
    let bounds = element.bounds().dilated(6.0 * h);
    let share = noise.vector() * 0.5 + Vec3::repeat(0.5);
    SampleLattice {
        origin: WorldPoint(bounds.min + bounds.size().component_mul(&share)),
        step: h,
        counts,
    }
}

/// Bounds of the eight halves of a lattice's box, together and one by one, contain its values; the common
/// bound is at least as sharp.
fn bounds_hold(tiled: &TiledSolid, lattice: &SampleLattice<WorldPoint>, values: &[f32]) {
    let span = lattice.span();
    let half = span.size() / 2.0;
    let regions = std::array::from_fn(|n| {
        let shift = Vec3::new((n >> 2) as f64, (n >> 1 & 1) as f64, (n & 1) as f64);
        let min = span.min + half.component_mul(&shift);
        Aabb {
            min,
            max: min + half,
        }
    });
    let together = Field::bounds(tiled, &regions).unwrap();
    let hull = together.into_iter().reduce(Interval::hull).unwrap();
    for near in [1.0, 0.3].map(|share| share * 3.0 * lattice.step) {
        let parts = LeafParts {
            own: regions,
            wide: regions,
            step: lattice.step,
        };
        let joint = tiled.leaf_bound(&parts, near);
        assert!(
            joint == hull || hull.may_be_within(near),
            "{near}: {joint:?} {hull:?}"
        );
    }
    for (region, together) in regions.iter().zip(together) {
        let alone = tiled.bound(region);
        for (m, &v) in values.iter().enumerate() {
            let p = lattice.point(m);
            if region.contains(p) {
                let slack = 1e-5 * half.norm();
                let holds =
                    |b: Interval| b.lo - slack <= f64::from(v) && f64::from(v) <= b.hi + slack;
                assert!(
                    holds(alone) && holds(together),
                    "{p:?} {v} {alone:?} {together:?}"
                );
            }
        }
    }
}

/// The classification of a leaf holds for its samples and the signs around them. Returns whether the leaf is
/// classified as beyond the band, and whether its parts are.
fn leaf_holds(tiled: &TiledSolid, origin: WorldPoint, options: TilingOptions) -> [bool; 2] {
    let (step, near) = (options.voxel_size, options.half_width);
    let corner = |first: f64, edge: f64, n: usize| {
        let at = [n >> 2, n >> 1 & 1, n & 1].map(|i| i as f64 * edge);
        let min = origin.0 + (Vec3::repeat(first) + Vec3::from(at)) * step;
        Aabb {
            min,
            max: min + Vec3::repeat((edge - 1.0) * step),
        }
    };
    let parts = LeafParts {
        own: std::array::from_fn(|n| corner(0.0, 4.0, n)),
        wide: std::array::from_fn(|n| corner(-1.0, 5.0, n)),
        step,
    };
    let bound = tiled.leaf_bound(&parts, near);
    let around = SampleLattice {
        origin: WorldPoint(origin.0 - Vec3::repeat(step)),
        step,
        counts: [10; 3],
    };
    let mut values = vec![0f32; around.len()];
    tiled.fill(&around, &mut values);
    let is_beyond = !bound.may_be_within(near);
    for (n, &v) in values.iter().enumerate() {
        let is_own = [n / 100, n / 10 % 10, n % 10]
            .iter()
            .all(|i| (1..9).contains(i));
        let v = f64::from(v);
        let slack = 1e-5 * near;
        // A leaf in the band has no further bound.
        let holds = if is_own {
            bound.lo - slack <= v && v <= bound.hi + slack
        } else {
            (v < 0.0) == (bound.hi < 0.0)
        };
        assert!(
            holds || !is_beyond,
            "sample {n} of the leaf at {origin:?}: {v} {bound:?}"
        );
    }
    let by_parts = Field::bounds(tiled, &parts.wide).unwrap();
    let by_parts = by_parts.into_iter().reduce(Interval::hull).unwrap();
    [is_beyond, !by_parts.may_be_within(near)]
}

#[test]
fn leaves_are_culled_by_what_is_true_of_them() {
    let (mut beyond, mut by_parts) = (0, 0);
    for kind in [Kind::Tet4, Kind::Hex8] {
        let table = table(kind);
        let mut noise = Noise::new(43);
        for scaffold in &overlapping(kind) {
            // Bands that are narrower than a voxel's diagonal tell nothing of the samples around.
            for (voxels, half_width, boundary) in [
                (60.0, 3.0, Boundary::Cut),
                (150.0, 3.0, Boundary::Cut),
                (90.0, 3.0, Boundary::Extend),
                (90.0, 1.0, Boundary::Cut),
            ] {
                let options = banded(voxels, half_width, boundary);
                let tiled = TiledSolid::new(scaffold, &table, options).unwrap();
                for _ in 0..100 {
                    let lattice = anywhere(scaffold, [8; 3], options.voxel_size, &mut noise);
                    let [is_beyond, are_beyond] = leaf_holds(&tiled, lattice.origin, options);
                    assert!(is_beyond || !are_beyond, "{lattice:?}");
                    beyond += usize::from(is_beyond);
                    by_parts += usize::from(are_beyond);
                }
            }
        }
    }
    assert!(beyond > by_parts && by_parts > 100, "{beyond} {by_parts}");
}

/// Leaves that are proved to need no neighbours' signs, and those that are culled, are none that matter. Signs
/// change at the boundary, where a scaffold overlaps itself, and next to inactive voxels of narrow bands.
#[test]
fn a_band_is_the_same_without_what_the_field_knows_sooner() {
    for kind in [Kind::Tet4, Kind::Hex8, Kind::Tet10, Kind::Hex20] {
        let table = table(kind);
        for scaffold in &overlapping(kind) {
            let all = [
                (9.0, 1.0, Boundary::Cut),
                (11.0, 3.0, Boundary::Extend),
                (27.0, 1.5, Boundary::Cut),
                (34.0, 3.0, Boundary::Cut),
            ];
            let tried = if crate::is_full() { 4 } else { 2 };
            for (voxels, half_width, boundary) in all.into_iter().take(tried) {
                let options = banded(voxels, half_width, boundary);
                let tiled = TiledSolid::new(scaffold, &table, options).unwrap();
                super::same_band_when_slow(&tiled, options, scaffold.bounds());
            }
        }
    }
}

#[test]
fn values_and_signs_in_bulk_are_those_of_single_points() {
    let (mut inside, mut outside) = (0, 0);
    for kind in [Kind::Tet4, Kind::Hex8] {
        let once = straight(kind);
        let table = table(kind);
        let mut scaffolds = vec![
            twice(&once, Vec3::new(0.4, 0.3, 0.2)),
            twice(&once, Vec3::new(9.0, 0.0, 0.0)),
            once,
        ];
        if kind == Kind::Tet4 {
            scaffolds.push(coil(kind));
        }
        let mut noise = Noise::new(41);
        for (which, scaffold) in scaffolds.iter().enumerate() {
            // From many elements within a leaf to few leaves within an element.
            for (voxels, boundary) in [2.0, 9.0, 30.0]
                .into_iter()
                .flat_map(|v| [(v, Boundary::Cut), (v, Boundary::Extend)])
            {
                let h = 1.0 / voxels;
                // Steps across whole cells make much of single precision.
                let most = if voxels < 5.0 { 5e-3 } else { 1e-4 };
                let options = TilingOptions {
                    boundary,
                    ..options(h)
                };
                let tiled = TiledSolid::new(scaffold, &table, options).unwrap();
                for n in 0..40 {
                    let counts = [[8, 8, 8], [10, 1, 10], [5, 6, 7]][n % 3];
                    let lattice = anywhere(scaffold, counts, h, &mut noise);
                    let mut values = vec![0f32; lattice.len()];
                    let mut rows = vec![0; counts[0] * counts[1]];
                    tiled.fill(&lattice, &mut values);
                    tiled.signs(&lattice, &vec![u64::MAX; rows.len()], &mut rows);
                    for (m, &v) in values.iter().enumerate() {
                        let single = tiled.value(lattice.point(m));
                        let off = (f64::from(v) - single).abs() / h;
                        let at =
                            format!("{kind:?} {which} {voxels} {boundary:?} {m}: {v} {single}");
                        assert!(off < most, "{at}");
                        let sign = rows[m / counts[2]] >> (m % counts[2]) & 1 == 1;
                        assert!(single.abs() < 1e-4 * h || sign == (single < 0.0), "{at}");
                        inside += usize::from(single < 0.0);
                        outside += usize::from(single > 0.0);
                    }
                    bounds_hold(&tiled, &lattice, &values);
                }
            }
        }
    }
    assert!(inside > 10_000 && outside > 10_000, "{inside} {outside}");
}
