//! Moduli of cut voxels: arithmetic means against sharp voxels, on a network.

use druse::cell::{Solid, Surface};
use druse::frame::Element;
use druse::homogenize::{Control, Elasticity, Isotropic, Packing, Period, Scheme, sharpened};
use druse::progress::Silent;

/// C11 and C44 of Schwarz P on a grid, with sharp voxels and arithmetic means.
fn both_ways(period: &Period, n: usize) -> [[f64; 2]; 2] {
    let samples = period.samples(n, 2, &Silent).unwrap();
    let (grid, shares) = (samples.grid(), samples.shares());
    let sharp = sharpened(&shares);
    let solid = Isotropic::new(1.0, 0.3).unwrap();
    let control = Control {
        tolerance: 1e-6,
        ..Control::default()
    };
    [&sharp, &shares].map(|shares| {
        let void = solid.scaled(1e-3);
        let mut medium = Elasticity::new(grid, shares, solid, void, Scheme::Rotated).unwrap();
        let found = medium.solve(&[0, 3], None, control, &Silent).unwrap();
        [found.matrix[0][0], found.matrix[3][3]]
    })
}

#[test]
#[ignore = "long; tests/run full"]
fn arithmetic_means_are_nearer_to_the_fine_grid_than_sharp_voxels() {
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let cell = cell.with_solid(Solid::Below, -0.45).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    let (finer, fine) = (both_ways(&period, 40)[1], both_ways(&period, 20)[1]);
    // As if the error fell with the edge of a voxel.
    let reference = [0, 1].map(|i| 2.0 * finer[i] - fine[i]);
    let mut sums = [0.0; 2];
    for n in [8, 10, 12, 14] {
        let found = both_ways(&period, n);
        for (sum, own) in sums.iter_mut().zip(found) {
            for i in 0..2 {
                *sum += (own[i] / reference[i] - 1.0).abs();
            }
        }
    }
    let [sharp, voigt] = sums;
    assert!(voigt < sharp, "{sums:?}");
}
