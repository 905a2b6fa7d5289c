//! Effective properties: oracles, closed forms, bounds, symmetry, derivatives.

mod cells;
mod closed_forms;
mod mixing;
mod oracles;

use druse::homogenize::{Control, Elasticity, Grid, Isotropic, Scheme, Voigt};
use druse::progress::Silent;

/// The stiffness of two materials with all load cases solved to a residual.
fn stiffness(
    grid: Grid,
    shares: &[f64],
    [solid, void]: [Isotropic; 2],
    scheme: Scheme,
    tolerance: f64,
) -> Voigt {
    let control = Control {
        tolerance,
        ..Control::default()
    };
    let mut medium = Elasticity::new(grid, shares, solid, void, scheme).unwrap();
    let all = [0, 1, 2, 3, 4, 5];
    let found = medium.solve(&all, None, control, &Silent);
    found.unwrap().matrix
}

/// The greatest difference of two matrices.
fn difference(a: &Voigt, b: &Voigt) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()))
}

/// Voxels of a unit cube around the origin, by their middles.
fn voxels(n: usize, inside: impl Fn([f64; 3]) -> bool) -> Vec<f64> {
    (0..n * n * n)
        .map(|v| {
            let place = [v / (n * n), v / n % n, v % n];
            let u = place.map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
            f64::from(u8::from(inside(u)))
        })
        .collect()
}
