//! Closed forms: flow through slits and past cylinders, layers in the plane, volumes of struts, bounds.

use super::{difference, stiffness, voxels};
use druse::cell::Skeleton;
use druse::frame::{Element, Vec3};
use druse::homogenize::{
    Control, Grid, Isotropic, Packing, Period, Scheme, Settings, Stokes, properties,
};
use druse::progress::Silent;
use std::f64::consts::PI;

#[test]
fn a_slit_has_the_permeability_of_poiseuille() {
    // Of 12 layers across y 8 are open: the discrete flow is H^3 / 12 (1 + 2 / 8^2) along, nothing across.
    let grid = Grid::new([6, 12, 4], [1.0; 3]).unwrap();
    let is_open = |n: usize| (2..10).contains(&(n / 4 % 12));
    let mut flow = Stokes::new(grid, is_open).unwrap();
    let control = Control {
        tolerance: 1e-7,
        ..Control::default()
    };
    let k = flow.solve(&[0, 1, 2], control, &Silent).unwrap().matrix;
    let height: f64 = 8.0 / 12.0;
    let expected = height.powi(3) / 12.0 * (1.0 + 2.0 / 64.0);
    for (i, row) in k.iter().enumerate() {
        for (j, v) in row.iter().enumerate() {
            let expected = if i == j && i != 1 { expected } else { 0.0 };
            assert!(
                (v - expected).abs() < 1e-6 * height.powi(3),
                "{i} {j}: {v} {expected}"
            );
        }
    }
}

#[test]
fn a_square_array_of_cylinders_has_the_permeability_of_its_series() {
    // Across: Sangani and Acrivos (1982). Along: Drummond and Tahir (1984).
    let n = 96;
    let grid = Grid::square(n).unwrap();
    let share: f64 = 0.2;
    let radius = (share / PI).sqrt();
    let is_open = |v: usize| {
        let u = [v / n, v % n].map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
        u[0].hypot(u[1]) > radius
    };
    let mut flow = Stokes::new(grid, is_open).unwrap();
    let control = Control {
        tolerance: 1e-7,
        ..Control::default()
    };
    let k = flow.solve(&[0, 1, 2], control, &Silent).unwrap().matrix;
    let c = share;
    let drag = 4.0 * PI / (-0.5 * c.ln() - 0.738 + c - 0.887 * c * c + 2.038 * c.powi(3));
    let across = 1.0 / drag;
    assert!(
        (k[0][0] / across - 1.0).abs() < 0.02,
        "{} {across}",
        k[0][0]
    );
    assert!((k[1][1] / k[0][0] - 1.0).abs() < 1e-5);
    let along = (-c.ln() - 1.476 + 2.0 * c - 0.5 * c * c) / (4.0 * PI);
    assert!((k[2][2] / along - 1.0).abs() < 0.02, "{} {along}", k[2][2]);
}

#[test]
fn layers_in_the_plane_and_a_plate_have_their_closed_forms() {
    let n = 16;
    let grid = Grid::square(n).unwrap();
    let shares: Vec<f64> = (0..n * n).map(|v| f64::from(u8::from(v / n < 6))).collect();
    let settings = Settings {
        void: 0.25,
        permeability: false,
        control: Control {
            tolerance: 1e-9,
            ..Control::default()
        },
        ..Settings::default()
    };
    let found = properties(grid, &shares, &settings, &Silent).unwrap();
    // Along layers of one Poisson's ratio without stress across them: the mean modulus.
    let c = found.plane_stress.unwrap();
    let along = c[1][1] - c[0][1] * c[0][1] / c[0][0];
    let mean = (6.0 + 0.25 * 10.0) / 16.0;
    assert!((along - mean).abs() < 1e-7, "{along} {mean}");
    let k = found.conductivity.unwrap();
    assert!((k[1][1] - mean).abs() < 1e-7);
    // Solid throughout.
    let full = properties(grid, &vec![1.0; n * n], &settings, &Silent).unwrap();
    let c = full.plane_stress.unwrap();
    assert!((c[0][0] - 1.0 / 0.91).abs() < 1e-12 && (c[0][1] - 0.3 / 0.91).abs() < 1e-12);
    let c = full.plane_strain.unwrap();
    assert!((c[0][0] - 0.7 / (1.3 * 0.4)).abs() < 1e-12);
}

#[test]
fn a_plane_section_has_the_stiffness_of_the_prism_over_it() {
    let n = 12;
    let inside = |u: [f64; 3]| u[0].abs() < 0.2 || (u[1] - 0.1).abs() < 0.15 + 0.2 * u[0];
    let solid = voxels(n, inside);
    let plane: Vec<f64> = solid.iter().step_by(n).copied().collect();
    let material = Isotropic::new(1.0, 0.3).unwrap();
    let materials = [material, material.scaled(0.01)];
    let in_space = stiffness(
        Grid::cube(n).unwrap(),
        &solid,
        materials,
        Scheme::Rotated,
        1e-9,
    );
    let in_plane = stiffness(
        Grid::square(n).unwrap(),
        &plane,
        materials,
        Scheme::Rotated,
        1e-9,
    );
    assert!(
        difference(&in_space, &in_plane) < 1e-7,
        "{in_space:?} {in_plane:?}"
    );
}

#[test]
fn struts_along_axes_have_their_volume_and_carry_along_themselves() {
    let radius = 0.12;
    let skeleton = Skeleton::graph(Element::Hex, "axes", radius).unwrap();
    let period = Period::of_skeleton(Element::Hex, &skeleton, Packing::Bcc).unwrap();
    let samples = period.samples(32, 2, &Silent).unwrap();
    let shares = samples.shares();
    // Three cylinders that meet at right angles.
    let volume = 3.0 * PI * radius * radius - 8.0 * 2f64.sqrt() * radius.powi(3);
    let found = samples.volume_fraction();
    assert!((found / volume - 1.0).abs() < 2e-3, "{found} {volume}");
    let settings = Settings {
        permeability: false,
        ..Settings::default()
    };
    let found = properties(samples.grid(), &shares, &settings, &Silent).unwrap();
    let one = PI * radius * radius;
    // Nodes stiffen the struts, which carry nearly alone.
    let young = found.engineering.unwrap().young;
    assert!((1.0..1.15).contains(&(young[0] / one)), "{young:?} {one}");
    let k = found.conductivity.unwrap();
    assert!((1.0..1.15).contains(&(k[0][0] / one)), "{k:?} {one}");
    assert_eq!(
        (found.solid.components, found.solid.percolates),
        (1, [true; 3])
    );
    // Surface: three cylinders without what lies in the others.
    let surface = 6.0 * PI * radius - 24.0 * 2f64.sqrt() * radius * radius;
    let measured = samples.surface_per_volume();
    assert!(
        (measured / surface - 1.0).abs() < 0.03,
        "{measured} {surface}"
    );
}

#[test]
fn both_packings_of_a_tet_fill_the_cube_with_struts() {
    for (packing, name) in [(Packing::Bcc, "bcc"), (Packing::Kuhn, "kuhn")] {
        let skeleton = Skeleton::graph(Element::Tet, "edges", 0.15).unwrap();
        let period = Period::of_skeleton(Element::Tet, &skeleton, packing).unwrap();
        assert!(period.describe().contains(name));
        // Every edge of the packing lies in the solid.
        let samples = period.samples(24, 2, &Silent).unwrap();
        let fraction = samples.volume_fraction();
        assert!((0.02..0.8).contains(&fraction), "{packing:?}: {fraction}");
        let shares = samples.shares();
        let at = |p: Vec3| {
            let [i, j, k] = [p.x, p.y, p.z].map(|c| ((c + 0.5) * 24.0) as usize % 24);
            shares[(i * 24 + j) * 24 + k]
        };
        // Edges of both along the cube's, and through its middle along the diagonal.
        assert!(at(Vec3::new(-0.49, -0.49, 0.2)) > 0.9);
        assert!(at(Vec3::repeat(0.2)) > 0.9, "{packing:?}");
    }
}

#[test]
fn sharp_voxels_never_cross_the_bounds() {
    let settings = Settings {
        permeability: false,
        ..Settings::default()
    };
    for seed in 0..6 {
        let t = f64::from(seed);
        // Functions with the symmetry of the cube.
        let inside = |u: [f64; 3]| {
            let c = u.map(|c| (2.0 * PI * c).cos());
            let c2 = u.map(|c| (4.0 * PI * c).cos());
            let pairs = c[0] * c[1] + c[1] * c[2] + c[2] * c[0];
            (t * 1.3).sin() * (c[0] + c[1] + c[2])
                + (t * 2.1 + 1.0).cos() * pairs
                + (t * 0.7 + 0.4).sin() * (c2[0] + c2[1] + c2[2])
                < 0.2 * (t - 2.0)
        };
        let shares = voxels(16, inside);
        let found = properties(Grid::cube(16).unwrap(), &shares, &settings, &Silent).unwrap();
        if !(0.02..0.98).contains(&found.volume_fraction) {
            continue;
        }
        let e = found.engineering.unwrap();
        let k = found.conductivity.unwrap()[0][0];
        let slack = 1e-6;
        let within = |v: f64, [low, high]: [f64; 2]| low - slack <= v && v <= high + slack;
        assert!(
            within(e.bulk, found.bounds.bulk),
            "{seed}: {e:?} {:?}",
            found.bounds
        );
        assert!(
            within(k, found.bounds.conductivity),
            "{seed}: {k} {:?}",
            found.bounds
        );
        assert!(
            e.shear_reuss <= found.bounds.shear[1] + slack,
            "{seed}: {e:?}"
        );
        assert!(
            e.shear_voigt >= found.bounds.shear[0] - slack,
            "{seed}: {e:?}"
        );
        assert!(found.over_bounds.bulk.unwrap() <= 1.0 + slack);
    }
}
