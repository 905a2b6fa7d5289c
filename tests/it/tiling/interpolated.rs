//! Leaves interpolated from a few nodes: within the tolerance of evaluation at single points, and only where
//! the field is smooth.

use super::{Cosines, options, scaffold};
use crate::strategy::Noise;
use druse::cell::{FitOptions, Solid, Surface, Table, fit_samples};
use druse::field::{Field, SampleLattice};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::progress::Silent;
use druse::scaffold::{Kind, Scaffold};
use druse::simd::{InstructionSet, use_instruction_set};
use druse::tiling::{
    Blend, Boundary, Distance, Filling, Interpolation, Member, TiledSolid, TilingOptions, Visits,
};

/// Voxel size: elements have edges of about 125 voxels.
const H: f64 = 0.004;

fn table(surface: Surface, element: Element) -> Table {
    Table::for_displacement(&surface.cell(element).unwrap(), 0.005 * H).unwrap()
}

/// A leaf anywhere in the scaffold's box.
fn leaf(scaffold: &Scaffold, noise: &mut Noise) -> SampleLattice<WorldPoint> {
    let bounds = scaffold.bounds();
    let share = noise.vector() * 0.5 + Vec3::repeat(0.5);
    SampleLattice {
        origin: WorldPoint(bounds.min + bounds.size().component_mul(&share)),
        step: H,
        counts: [8; 3],
    }
}

/// Fills random leaves with the surface near their middle. Returns how many were interpolated, and the number of
/// evaluated points with and without interpolation. Checks every value against evaluation at its point.
fn interpolated_leaves<F: Filling>(
    scaffold: &Scaffold,
    filling: &F,
    (options, tolerance): (TilingOptions, f64),
    leaves: usize,
) -> (u64, [u64; 2]) {
    let visits = Visits::new(scaffold.len());
    let plain = TiledSolid::new(scaffold, filling, options).unwrap();
    let tiled = TiledSolid::new(scaffold, filling, options).unwrap();
    let tiled = tiled.with_visits(&visits).with_interpolation(tolerance * H);
    let mut noise = Noise::new(17);
    let mut evaluated = [0; 2];
    for _ in 0..leaves {
        let lattice = loop {
            let lattice = leaf(scaffold, &mut noise);
            if plain.value(lattice.span().centre()).abs() < 3.0 * H {
                break lattice;
            }
        };
        let before = visits.interpolated_leaves();
        let [mut a, mut b] = [[0f32; 512]; 2];
        let own = tiled.fill_counting(&lattice, &mut a);
        let all = plain.fill_counting(&lattice, &mut b);
        if visits.interpolated_leaves() == before {
            assert_eq!(a, b);
            continue;
        }
        evaluated[0] += own;
        evaluated[1] += all;
        for (n, (&a, &b)) in a.iter().zip(&b).enumerate() {
            let (a, b) = (f64::from(a) / H, f64::from(b) / H);
            let most = 2.0 * tolerance + 0.02 * b.abs();
            assert!(
                (a - b).abs() <= most,
                "{:?}: {a} {b} voxels",
                lattice.point(n)
            );
            // By itself the point has the same value.
            if n % 37 == 0 {
                let alone = tiled.value(lattice.point(n)) / H;
                assert!((alone - b).abs() < 1e-4, "{alone} {b}");
            }
        }
    }
    (visits.interpolated_leaves(), evaluated)
}

#[test]
#[ignore = "long; tests/run full"]
fn what_nodes_tell_is_within_the_tolerance() {
    for (kind, surface) in [
        (Kind::Tet4, Surface::Diamond),
        (Kind::Tet10, Surface::SchwarzP),
        (Kind::Hex8, Surface::SchwarzP),
        (Kind::Hex20, Surface::Iwp),
        (Kind::Hex27, Surface::SchwarzP),
    ] {
        let scaffold = scaffold(kind, [2, 2, 2], 0.1, 3);
        let table = table(surface, kind.shape());
        for tolerance in [0.005, 0.05] {
            let (interpolated, evaluated) =
                interpolated_leaves(&scaffold, &table, (options(H), tolerance), 250);
            println!(
                "{} {}: {interpolated} of 250 leaves, {evaluated:?}",
                kind.name(),
                surface.name()
            );
            assert!(
                interpolated > 8,
                "{} {}: {interpolated}",
                kind.name(),
                surface.name()
            );
            assert!(evaluated[0] < evaluated[1], "{evaluated:?}");
        }
    }
}

#[test]
fn fitted_cells_take_more_nodes() {
    const SAMPLES: usize = 40;
    let place = |j: usize| j as f64 / SAMPLES as f64 - 0.5;
    let samples: Vec<f64> = (0..SAMPLES.pow(3))
        .map(|n| {
            let p = [n / (SAMPLES * SAMPLES), n / SAMPLES % SAMPLES, n % SAMPLES].map(place);
            Vec3::from(p).norm() - 0.32
        })
        .collect();
    let options = FitOptions {
        band_limit: 7.0,
        measure: false,
        ..FitOptions::default()
    };
    let ball = fit_samples("ball", Element::Hex, &samples, SAMPLES, &options, &Silent).unwrap();
    let table = Table::for_displacement(&ball, 0.01 * H).unwrap();
    for (kind, bent) in [(Kind::Hex8, 0.0), (Kind::Hex8, 0.1)] {
        let scaffold = scaffold(kind, [2, 2, 2], bent, 3);
        let [coarse, fine] = [0.005, 0.0005].map(|tolerance| {
            let how = (super::options(H), tolerance);
            let (interpolated, evaluated) = interpolated_leaves(&scaffold, &table, how, 250);
            println!("{interpolated} of 250 leaves within {tolerance}, {evaluated:?}");
            assert!(
                interpolated > 40 && evaluated[0] < evaluated[1],
                "{interpolated} {evaluated:?}"
            );
            evaluated[0] as f64 / interpolated as f64
        });
        // 4^3 nodes and 16 trials, or 6^3 as well.
        assert!(coarse >= 80.0 && fine > 1.5 * coarse, "{coarse} {fine}");
    }
}

#[test]
fn sheets_are_interpolated_before_folding() {
    for (solid, half) in [(Solid::Sheet, 0.15), (Solid::Channels, 0.4)] {
        let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
        let cell = cell.with_solid(solid, half).unwrap();
        let table = Table::for_displacement(&cell, 0.005 * H).unwrap();
        assert_eq!(
            f64::from(table.smooth().unwrap().fold.unwrap().half),
            f64::from(half as f32)
        );
        for kind in [Kind::Hex8, Kind::Hex20] {
            let scaffold = scaffold(kind, [2, 2, 2], 0.1, 3);
            let (interpolated, evaluated) =
                interpolated_leaves(&scaffold, &table, (options(H), 0.005), 250);
            println!("{solid:?}: {interpolated} of 250 leaves, {evaluated:?}");
            assert!(
                interpolated > 20 && evaluated[0] < evaluated[1],
                "{interpolated} {evaluated:?}"
            );
        }
    }
}

#[test]
fn blends_are_interpolated_too() {
    let scaffold = scaffold(Kind::Hex8, [2, 2, 2], 0.1, 5);
    let tables = [Surface::SchwarzP, Surface::Iwp].map(|s| table(s, Element::Hex));
    let mut noise = Noise::new(2);
    let weights: Vec<f64> = scaffold
        .nodes()
        .iter()
        .flat_map(|_| {
            let w = noise.vector().x.abs();
            [1.0 - w, w]
        })
        .collect();
    for how in [Interpolation::Linear, Interpolation::Smoothstep] {
        let members = tables.iter().enumerate().map(|(n, t)| Member {
            name: n.to_string(),
            cells: vec![t],
        });
        let blend = Blend::new(&scaffold, members.collect(), weights.clone(), how).unwrap();
        let (interpolated, evaluated) =
            interpolated_leaves(&scaffold, &blend, (options(H), 0.005), 250);
        assert!(
            interpolated > 20 && evaluated[0] < evaluated[1],
            "{interpolated} {evaluated:?}"
        );
    }
}

#[test]
fn nodes_do_not_tell_what_is_not_smooth_or_not_a_leaf() {
    let scaffold = scaffold(Kind::Hex8, [2, 2, 2], 0.1, 3);
    // Of this nothing is known but values.
    let unknown = Cosines::schwarz_p(Element::Hex, 0.1);
    let how = (options(H), 0.005);
    assert_eq!(interpolated_leaves(&scaffold, &unknown, how, 20).0, 0);
    let plain = table(Surface::SchwarzP, Element::Hex);
    assert!((plain.smooth().unwrap().frequency - 1.0).abs() < 1e-12);
    // Nor where that is not wanted, distances are exact, or waves are short against voxels.
    let exact = TilingOptions {
        distance: Distance::Exact,
        ..options(H)
    };
    assert_eq!(
        interpolated_leaves(&scaffold, &plain, (options(H), 0.0), 60).0,
        0
    );
    assert_eq!(
        interpolated_leaves(&scaffold, &plain, (exact, 0.005), 6).0,
        0
    );
    let visits = Visits::new(scaffold.len());
    let coarse = TiledSolid::new(&scaffold, &plain, options(0.06)).unwrap();
    let coarse = coarse.with_visits(&visits).with_interpolation(0.1);
    let tiled = TiledSolid::new(&scaffold, &plain, options(H)).unwrap();
    let tiled = tiled.with_visits(&visits).with_interpolation(0.005 * H);
    let mut noise = Noise::new(1);
    for _ in 0..60 {
        let leaf = leaf(&scaffold, &mut noise);
        coarse.fill(&SampleLattice { step: 0.06, ..leaf }, &mut [0.0; 512]);
        tiled.fill(
            &SampleLattice {
                counts: [10, 10, 1],
                ..leaf
            },
            &mut [0.0; 100],
        );
    }
    assert_eq!(visits.interpolated_leaves(), 0);
}

#[test]
fn wide_bands_are_interpolated_no_worse_near_their_ends() {
    // What is moved by as much as the band is wide has its surface there.
    let scaffold = scaffold(Kind::Hex20, [2, 2, 2], 0.1, 3);
    let table = table(Surface::SchwarzP, Element::Hex);
    let wide = TilingOptions {
        half_width: 12.0 * H,
        boundary: Boundary::Extend,
        ..options(H)
    };
    let visits = Visits::new(scaffold.len());
    let plain = TiledSolid::new(&scaffold, &table, wide).unwrap();
    let interpolated = TiledSolid::new(&scaffold, &table, wide).unwrap();
    let interpolated = interpolated
        .with_visits(&visits)
        .with_interpolation(0.005 * H);
    let mut noise = Noise::new(7);
    for _ in 0..400 {
        let lattice = leaf(&scaffold, &mut noise);
        let [mut a, mut b] = [[0f32; 512]; 2];
        interpolated.fill(&lattice, &mut a);
        plain.fill(&lattice, &mut b);
        for (a, b) in a.iter().zip(&b) {
            let (a, b) = (f64::from(*a) / H, f64::from(*b) / H);
            assert!((a - b).abs() <= 0.01 * b.abs().max(1.0), "{a} {b} voxels");
        }
    }
    println!("{} leaves", visits.interpolated_leaves());
    assert!(visits.interpolated_leaves() > 0);
}

#[test]
fn the_widest_registers_tell_the_same_bits() {
    let scaffold = scaffold(Kind::Hex8, [2, 2, 2], 0.1, 3);
    let table = table(Surface::SchwarzP, Element::Hex);
    let visits = Visits::new(scaffold.len());
    let interpolated = TiledSolid::new(&scaffold, &table, options(H)).unwrap();
    let interpolated = interpolated
        .with_visits(&visits)
        .with_interpolation(0.005 * H);
    let mut noise = Noise::new(3);
    for _ in 0..200 {
        let lattice = leaf(&scaffold, &mut noise);
        // Other laws that run meanwhile see no difference if this one holds.
        let [narrow, wide] = [InstructionSet::Avx2, InstructionSet::Best].map(|code| {
            let mut out = [0f32; 512];
            use_instruction_set(code);
            interpolated.fill(&lattice, &mut out);
            out.map(f32::to_bits)
        });
        assert_eq!(narrow, wide);
    }
    use_instruction_set(InstructionSet::Best);
    assert!(
        visits.interpolated_leaves() > 40,
        "{}",
        visits.interpolated_leaves()
    );
}
