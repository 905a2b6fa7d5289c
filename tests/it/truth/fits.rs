//! Fits keep what lies below Nyquist; volume fractions count the element's map.

use crate::strategy::Noise;
use druse::cell::{
    Cell, FitOptions, Method, Series, Solid, Surface, fit_samples, fit_samples_least_squares,
    groups, lattices, symmetry,
};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use druse::symmetry::Basis;
use nalgebra::SVector;

/// Random points of an element.
fn points(element: Element, noise: &mut Noise, count: usize) -> Vec<Vec3> {
    let around = element.cell_box();
    let mut found = Vec::new();
    while found.len() < count {
        let t = noise.vector().map(|c| 0.5 * (c + 1.0));
        let mut p = around.min + (around.max - around.min).component_mul(&t);
        if element.dimension() == 2 {
            p.z = 0.0;
        }
        if element.face_distance(CellPoint(p)) <= 0.0 {
            found.push(p);
        }
    }
    found
}

/// The greatest difference of the fit of a random series from it, over the series' root mean square.
fn off_by<const D: usize>(
    element: Element,
    (group, lattice): (&str, &str),
    n: usize,
    method: Method,
) -> Option<f64> {
    let (own, vectors) = symmetry::<D>(element, Some(group), Some(lattice)).ok()?;
    let mut noise = Noise::new(n as u64);
    let basis = Basis::below(own.clone(), vectors.clone(), (n as i32 - 1) / 2);
    let mut real: Vec<f64> = (0..basis.len()).map(|_| noise.signed()).collect();
    let series = |real: &[f64]| {
        Series::new(own.clone(), vectors.clone(), &basis.coefficients(real)).unwrap()
    };
    let flat = |p: &Vec3| CellPoint(SVector::<f64, D>::from_fn(|a, _| p[a]));
    let places = points(element, &mut noise, 60);
    // Half of the element is solid: the constant comes first.
    let mut values: Vec<f64> = places
        .iter()
        .map(|p| series(&real).value(flat(p)))
        .collect();
    values.sort_by(f64::total_cmp);
    real[0] -= values[30] * vectors.volume().sqrt();
    let exact = series(&real);
    let samples: Vec<f64> = (0..n.pow(D as u32))
        .map(|place| {
            let u = SVector::<f64, D>::from_fn(|a, _| {
                let j = place / n.pow((D - 1 - a) as u32) % n;
                j as f64 / n as f64 - 0.5
            });
            exact.value(CellPoint(vectors.columns() * u))
        })
        .collect();
    let options = FitOptions {
        band_limit: f64::INFINITY,
        group: Some(group.to_owned()),
        lattice: Some(lattice.to_owned()),
        measure: false,
        ..FitOptions::default()
    };
    let fit = match method {
        Method::Lsq => fit_samples_least_squares,
        _ => fit_samples,
    };
    let cell = fit("x", element, &samples, n, &options, &Silent).unwrap();
    let square: f64 = values.iter().map(|v| v * v).sum();
    let scale = (square / values.len() as f64).sqrt();
    let gap = |p: &Vec3| (cell.expression().value(CellPoint(*p)) - exact.value(flat(p))).abs();
    Some(places.iter().map(gap).fold(0.0, f64::max) / scale)
}

#[test]
fn what_lies_below_nyquist_is_kept_for_every_group_and_lattice() {
    let mut count = 0;
    for element in Element::SCAFFOLD_ELEMENTS {
        if element == Element::Ball {
            continue;
        }
        for lattice in lattices(element) {
            for group in groups(element) {
                for (n, method) in [(7, Method::Fft), (8, Method::Lsq)] {
                    let pair = (*group, *lattice);
                    let found = match element.dimension() {
                        2 => off_by::<2>(element, pair, n, method),
                        _ => off_by::<3>(element, pair, n, method),
                    };
                    let Some(found) = found else { continue };
                    assert!(found < 1e-12, "{element:?} {pair:?} {n}: {found:e}");
                    count += 1;
                }
            }
        }
    }
    assert!(count >= 40, "{count}");
    // Larger grids, even and odd.
    for (n, group) in [(12, "Oh"), (13, "D4h"), (10, "D2h")] {
        let found = off_by::<3>(Element::Hex, (group, "cubic"), n, Method::Fft).unwrap();
        assert!(found < 1e-12, "{group} {n}: {found:e}");
    }
}

#[test]
fn a_band_limit_cuts_a_ball() {
    let n = 8;
    let mut noise = Noise::new(3);
    let samples: Vec<f64> = (0..n * n * n).map(|_| noise.signed()).collect();
    let fit = |band_limit: f64| {
        let options = FitOptions {
            band_limit,
            group: Some("C1".to_owned()),
            measure: false,
            ..FitOptions::default()
        };
        fit_samples("x", Element::Hex, &samples, n, &options, &Silent).unwrap()
    };
    let greatest = |cell: &Cell| cell.series().unwrap().band_limit();
    assert!((greatest(&fit(f64::INFINITY)) - 27f64.sqrt()).abs() < 1e-12);
    assert!((greatest(&fit(3.0)) - 3.0).abs() < 1e-12);
}

#[test]
fn closed_forms_have_their_volumes() {
    let of = |surface: Surface, element: Element, level: f64| {
        let cell = surface.cell(element).unwrap();
        cell.with_solid(Solid::Below, level)
            .unwrap()
            .volume_fraction()
    };
    for (surface, element, level, wanted, within) in [
        (Surface::SchwarzP, Element::Hex, -1.0, 0.213_329_554, 2e-6),
        (Surface::SchwarzP, Element::Hex, -0.5, 0.357_165_040, 2e-6),
        (Surface::SchwarzP, Element::Hex, 0.5, 0.642_834_960, 2e-6),
        (Surface::SchwarzP, Element::Hex, 1.0, 0.786_670_446, 2e-6),
        (Surface::SchwarzP, Element::Tet, 0.0, 0.204_044, 2e-6),
        (Surface::Gyroid, Element::Hex, 0.5, 0.661_781, 2e-6),
        (Surface::Gyroid, Element::Hex, 1.0, 0.829_725, 2e-6),
        (Surface::Diamond, Element::Hex, 0.3, 0.674_319, 2e-6),
        (Surface::Diamond, Element::Tet, 0.0, 0.332_660, 2e-6),
    ] {
        let found = of(surface, element, level);
        assert!(
            (found - wanted).abs() < within,
            "{surface:?} {element:?} {level}: {found:.9}, {wanted}"
        );
    }
    for (surface, fraction, wanted) in [
        (Surface::SchwarzP, 0.2, -1.051_850_062),
        (Surface::SchwarzP, 0.35, -0.525_019_980),
        (Surface::Gyroid, 0.35, -0.463_952),
    ] {
        let cell = surface.cell(Element::Hex).unwrap();
        let level = cell.level_for_volume_fraction(fraction).unwrap();
        assert!(
            (level - wanted).abs() < 6e-6,
            "{surface:?} {fraction}: {level:.9}, {wanted}"
        );
    }
}

#[test]
fn a_density_counts_volumes() {
    // The density grows along z: 1 + z, whose mean over the images of a symmetric cell is 1.
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let even = cell.density(&|p| 1.0 + p.0.z);
    let plain = cell.volume_fraction();
    assert!((cell.weighted_volume_fraction(&even) - plain).abs() < 1e-9);
    // x^2 + y^2 + z^2 over the solid cos x + cos y + cos z < 0, by midpoints.
    let round = cell.density(&|p| p.0.norm_squared());
    let (mut inside, mut all) = (0.0, 0.0);
    let n = 64;
    for place in 0..n * n * n {
        let at = [place / (n * n), place / n % n, place % n];
        let p = Vec3::from(at.map(|j| (j as f64 + 0.5) / n as f64 - 0.5));
        all += p.norm_squared();
        if cell.expression().value(CellPoint(p)) < 0.0 {
            inside += p.norm_squared();
        }
    }
    let found = cell.weighted_volume_fraction(&round);
    assert!(
        (found - inside / all).abs() < 2e-3,
        "{found}, {}",
        inside / all
    );
    let level = cell
        .level_for_weighted_volume_fraction(0.4, &round)
        .unwrap();
    let there = cell.with_solid(Solid::Below, level).unwrap();
    assert!((there.weighted_volume_fraction(&round) - 0.4).abs() < 1e-6);
}

fn report(text: &str) -> Report {
    let recipe = Recipe::parse(text, &[]).unwrap();
    run(&recipe, &RunOptions::default(), &Silent).unwrap()
}

#[test]
#[ignore = "long; tests/run full"]
fn a_part_of_distorted_hexes_has_the_target_fraction() {
    let text = |cell: &str, tiling: &str, voxel: f64| {
        format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\n{cell}\n[scaffold]\nbox = {{ size = [2, 2, 2], cell_size = 2, \
             kind = \"tet\" }}\nall_hex = true\n[tiling]\ncell = \"p\"\n{tiling}\n[band]\nvoxel_size = {voxel}\n"
        )
    };
    for (cell, tiling) in [
        ("volume_fraction = 0.3", ""),
        ("volume_fraction = 0.3\ninvert = true", ""),
        ("", "volume_fraction = 0.3"),
    ] {
        let at = |voxel: f64| report(&text(cell, tiling, voxel)).solid;
        let (coarse, fine) = (at(0.03), at(0.02));
        assert_eq!(fine.volume_fraction_target, Some(0.3));
        let own = fine.volume_fraction_cell.unwrap();
        assert!((own - 0.3).abs() < 3e-4, "{own}");
        // Triangles cut corners: what they lose falls with the square of the voxel.
        let [c, f] = [coarse, fine].map(|s| s.volume_fraction.unwrap());
        let part = f + (f - c) / (1.5f64.powi(2) - 1.0);
        assert!(
            (part - 0.3).abs() < 1e-3,
            "{part}, of {c} and {f}; {cell} {tiling}"
        );
    }
}
