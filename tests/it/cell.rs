//! Laws of `cell`, and the closed forms and reference values it has to meet.

mod direct;
mod displacement;
mod expression;
mod face_normal;
mod figures;
mod file;
mod fit;
mod fourier;
mod icosahedral;
mod minkowski;
mod random;
mod solvers;
mod source;
mod table;

use druse::cell::{Cell, CellError, Series, Solid, Surface, Table};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use proptest::prelude::*;
use serde_json::Value;
use std::f64::consts::TAU;

use random::{any_box, any_cell, any_point, pairings, random_cell};

/// A signed distance in the reference frame.
type Shape = fn(CellPoint<3>) -> f64;

fn at(x: f64, y: f64, z: f64) -> CellPoint<3> {
    CellPoint(Vec3::new(x, y, z))
}

/// That two cells have the same values, and gradients to a hundred times the tolerance.
fn assert_meet(a: &Cell, b: &Cell, tolerance: f64) {
    for p in [
        at(0.1, 0.2, -0.05),
        at(0.31, 0.27, -0.12),
        at(0.02, -0.2, 0.13),
    ] {
        let (v, g) = a.value_and_gradient(p);
        let (w, h) = b.value_and_gradient(p);
        assert!((v - w).abs() < tolerance, "{}: {}", a.name(), v - w);
        assert!((g - h).norm() < 100.0 * tolerance, "{}", a.name());
    }
}

fn vec3(v: &Value) -> Vec3 {
    Vec3::from_fn(|i, _| v[i].as_f64().unwrap())
}

#[test]
fn surfaces_are_their_formulas() {
    let formula = |s: Surface, p: Vec3| {
        let (c, s1) = (p.map(|v| (TAU * v).cos()), p.map(|v| (TAU * v).sin()));
        let [c2, s2] = [
            p.map(|v| (2.0 * TAU * v).cos()),
            p.map(|v| (2.0 * TAU * v).sin()),
        ];
        let [c3, s3] = [
            p.map(|v| (3.0 * TAU * v).cos()),
            p.map(|v| (3.0 * TAU * v).sin()),
        ];
        // Sums over the cyclic order of the axes.
        let cyclic = |f: &dyn Fn(usize, usize, usize) -> f64| f(0, 1, 2) + f(1, 2, 0) + f(2, 0, 1);
        let twice = cyclic(&|i, j, k| s2[i] * c[j] * s1[k]);
        let pairs = cyclic(&|i, j, _| c2[i] * c2[j]);
        match s {
            Surface::SchwarzP => c.sum(),
            Surface::Diamond => c.product() - s1.product(),
            Surface::Iwp => 2.0 * (c.x * c.y + c.y * c.z + c.z * c.x) - c2.sum(),
            Surface::Neovius => 3.0 * c.sum() + 4.0 * c.product(),
            Surface::FRd => 4.0 * c.product() - (c2.x * c2.y + c2.y * c2.z + c2.z * c2.x),
            Surface::Gyroid => s1.x * c.y + s1.y * c.z + s1.z * c.x,
            Surface::Lidinoid => {
                let waves = s2.x * c.y * s1.z + s2.y * c.z * s1.x + s2.z * c.x * s1.y;
                (waves - (c2.x * c2.y + c2.y * c2.z + c2.z * c2.x)) / 2.0 + 0.15
            }
            Surface::DoubleGyroid => 2.75 * twice - pairs,
            Surface::FischerKochS => cyclic(&|i, j, k| c2[i] * s1[j] * c[k]),
            Surface::CY => {
                let sines = cyclic(&|i, j, k| s2[i] * s1[j] + s2[i] * c[k]);
                sines - s1.product() - c.product()
            }
            Surface::CS => {
                let first = cyclic(&|i, j, k| s3[i] * s2[j] * c[k]);
                c2.sum() + 2.0 * first + 2.0 * cyclic(&|i, j, k| s2[i] * c3[j] * s1[k])
            }
            Surface::SplitP => 1.1 * twice - 0.2 * pairs - 0.4 * c2.sum(),
        }
    };
    for surface in Surface::CATALOGUE {
        for element in [Element::Tet, Element::Hex] {
            let Ok(cell) = surface.cell(element) else {
                let lacks = match surface {
                    Surface::Gyroid
                    | Surface::Lidinoid
                    | Surface::DoubleGyroid
                    | Surface::FischerKochS
                    | Surface::CY
                    | Surface::CS
                    | Surface::SplitP => Element::Tet,
                    _ => panic!("{surface:?} has every form"),
                };
                assert_eq!(element, lacks, "{surface:?}");
                continue;
            };
            for p in [
                at(0.1, -0.23, 0.31),
                at(0.0, 0.2, -0.47),
                at(1.3, 0.9, -2.2),
            ] {
                assert!(
                    (cell.value(p) - formula(surface, p.0)).abs() < 1e-13,
                    "{surface:?}"
                );
            }
        }
        assert_eq!(Surface::from_name(surface.name()), Some(surface));
    }
}

#[test]
fn the_gyroid_has_the_solid_shares_of_its_literature() {
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    assert!(!gyroid.fits_any_numbering());
    let level = gyroid.level_for_volume_fraction(0.35).unwrap();
    assert!((level + 0.463_952).abs() < 2e-3, "{level}");
    // No cubic group leaves anything of it about the usual origin.
    let source = |p: CellPoint<3>| gyroid.expression().value(p);
    let options = druse::cell::FitOptions {
        band_limit: 2.0,
        ..Default::default()
    };
    let silent = &druse::progress::Silent;
    let refused = druse::cell::fit("g", Element::Hex, &source, &options, silent).unwrap_err();
    assert!(
        refused.to_string().contains("no part with the symmetry Oh"),
        "{refused}"
    );
}

/// The cells of the reference numbers for gradients, each with its case.
pub fn reference_cells() -> Vec<(Value, Cell)> {
    let data: Value = serde_json::from_str(include_str!("../data/gradients.json")).unwrap();
    let made = [
        ("tet4", Element::Tet, "fcc2"),
        ("hex8", Element::Hex, "cubic"),
    ]
    .map(|(id, element, lattice)| {
        let cases = data["cases"].as_array().unwrap();
        let case = cases.iter().find(|c| c["id"] == id).unwrap();
        let (group, lattice) = Cell::symmetry(element, Some(lattice)).unwrap();
        let mut terms = Vec::new();
        for c in case["coefficients"].as_array().unwrap() {
            let k: [i32; 3] = std::array::from_fn(|i| c[0][i].as_i64().unwrap() as i32);
            // The reference lists both orbits of a pair, a cell the greater one.
            if group.canonical(k.map(|v| -v)) <= k {
                terms.push((k, [c[1][0].as_f64().unwrap(), c[1][1].as_f64().unwrap()]));
            }
        }
        let series = Series::new(group, lattice, &terms).unwrap();
        (case.clone(), Cell::new(id, element, series).unwrap())
    });
    made.to_vec()
}

#[test]
fn values_gradients_and_bounds_are_those_of_the_reference() {
    for (case, cell) in reference_cells() {
        let (id, element) = (cell.name(), cell.element());
        let series = cell.series().unwrap();
        for p in case["points"].as_array().unwrap() {
            let (v, g) = series.value_and_gradient(CellPoint(vec3(&p["xi"])));
            assert!((v - p["Phi"].as_f64().unwrap()).abs() < 1e-9, "{id}");
            assert!((g - vec3(&p["grad_xi"])).norm() < 1e-9, "{id}");
        }
        let bounds = &case["bounds"];
        let number = |key: &str| bounds[key].as_f64().unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9 * b;
        assert!(close(
            series.amplitude() + series.mean().abs(),
            number("sum|C|")
        ));
        let l1 = number("L_coefficient_bound sum|C|2pi|f|");
        assert!(close(series.gradient_bound(), l1));
        assert!(close(
            series.hessian_bound(),
            number("M2_coefficient_bound")
        ));
        let table = Table::new(&cell).unwrap();
        let found = number("max|grad| found by 60000 random points (<= L_rigorous)");
        assert!(table.gradient_sup() < l1);
        // The random points fill the period, and a tet is a part of it; a hex is all of it.
        if element == Element::Hex {
            assert!(
                table.gradient_sup() > found,
                "{} {found}",
                table.gradient_sup()
            );
            // Nor is the bound much more than what there is.
            assert!(
                table.gradient_sup() < 1.15 * found,
                "{} {found}",
                table.gradient_sup()
            );
        }
    }
}

#[test]
fn volume_fractions_are_those_of_the_element() {
    let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let fraction = |cell: &Cell, t: f64| {
        let cell = cell.clone().with_solid(Solid::Below, t).unwrap();
        cell.volume_fraction()
    };
    for (t, v) in [
        (-1.0, 0.213329553535693),
        (-0.5, 0.357165040387709),
        (0.0, 0.5),
        (0.5, 0.642834959612291),
        (1.0, 0.786670446464307),
    ] {
        assert!(
            (fraction(&p, t) - v).abs() < 3e-6,
            "{t} {}",
            fraction(&p, t) - v
        );
    }
    for (f, t) in [
        (0.2, -1.05185006173631),
        (0.35, -0.525019980107021),
        (0.5, 0.0),
    ] {
        let found = p.level_for_volume_fraction(f).unwrap();
        assert!((found - t).abs() < 1e-6, "{f}: {found} {t}");
    }
    for (w, v) in [(0.3, 0.171277237123831), (0.6, 0.342976711625292)] {
        let sheet = p.clone().sheet(w).unwrap();
        assert!((sheet.volume_fraction() - v).abs() < 3e-6);
        assert!((sheet.level_for_volume_fraction(v).unwrap() - w).abs() < 1e-5);
    }
    let (p, d) = (
        Surface::SchwarzP.cell(Element::Tet).unwrap(),
        Surface::Diamond.cell(Element::Tet).unwrap(),
    );
    for (cell, t, v) in [
        (&p, -0.5, 0.140294556),
        (&p, 0.0, 0.204044522),
        (&p, 0.5, 0.291710738),
        (&d, -0.5, 0.078861107),
        (&d, 0.0, 0.332659562),
        (&d, 0.5, 0.683673318),
    ] {
        assert!(
            (fraction(cell, t) - v).abs() < 6e-6,
            "{t} {}",
            fraction(cell, t) - v
        );
    }
}

#[test]
fn gamma_is_the_root_mean_square_over_the_surface() {
    // Where cX + cY + cZ = 2.9, with q_i = 1 - c_i: sum q = 0.1 and |grad|^2 = 4 pi^2 sum (2 q - q^2),
    // the sum of q^2 between 0.01/3 and 0.01.
    let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let cell = p.with_solid(Solid::Above, 2.9).unwrap();
    let square = (cell.gamma() / TAU).powi(2);
    assert!((0.19..0.2 - 0.01 / 3.0).contains(&square), "{square}");
}

#[test]
#[ignore = "long; tests/run full"]
fn every_pairing_fits_and_knows_whether_numbering_matters() {
    let numbers: Vec<_> = (0..12)
        .map(|n| (f64::from(n).sin(), f64::from(n).cos()))
        .collect();
    for pairing in pairings() {
        let cell = random_cell(pairing, 2.5, &numbers, Solid::Below, 0.0);
        let (element, group, _) = pairing;
        assert_eq!(cell.group(), group);
        let whole = group == druse::cell::default_group(element);
        assert_eq!(cell.fits_any_numbering(), whole, "{pairing:?}");
        assert_eq!(cell.operators().len() == element.symmetry_order(), whole);
        // The domain's flags and their images are the element.
        let (fraction, share) = (cell.volume_fraction(), grid_share(&cell));
        assert!(
            (fraction - share).abs() < 0.025,
            "{pairing:?}: {fraction} {share}"
        );
    }
}

/// Share of the element's points on a coarse grid that are solid.
fn grid_share(cell: &Cell) -> f64 {
    let (mut inside, mut solid) = (0, 0);
    let n = 44;
    let place = |i: i32| (f64::from(i) + 0.5) / f64::from(n) - 0.5;
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                // The pyramid reaches up to 0.71, the triangle to 0.58.
                let p = at(place(i), 1.2 * place(j), 1.25 * place(k) + 0.125);
                if cell.element().face_distance(p) <= 0.0 {
                    inside += 1;
                    solid += i32::from(cell.value(p) < 0.0);
                }
            }
        }
    }
    f64::from(solid) / f64::from(inside)
}

#[test]
fn planar_cells_do_not_depend_on_height() {
    let (group, lattice) = druse::cell::symmetry::<2>(Element::Quad, None, None).unwrap();
    let series = Series::new(group, lattice, &[([1, 0], [0.5, 0.0])]).unwrap();
    let cell = Cell::new("cosines", Element::Quad, series).unwrap();
    // cos X + cos Y < 0 fills half of the square; its gradient at x = y = 1/4 is -2 pi in both.
    let (v, g) = cell.value_and_gradient(at(0.25, 0.25, 7.0));
    assert!(v.abs() < 1e-12 && (g - Vec3::new(-TAU, -TAU, 0.0)).norm() < 1e-12);
    assert!((cell.volume_fraction() - 0.5).abs() < 1e-6);
    // On the lines |x| + |y| = 1/2 the squared gradient is 8 pi^2 sin^2 X, half of it on average.
    assert!((cell.gamma() - TAU).abs() < 1e-2 * TAU, "{}", cell.gamma());
}

#[test]
fn wrong_cells_are_refused() {
    let (group, lattice) = Cell::symmetry(Element::Tet, None).unwrap();
    let series =
        |terms: &[([i32; 3], [f64; 2])]| Series::new(group.clone(), lattice.clone(), terms);
    let place = |e: Result<Series<3>, CellError>| match e {
        Err(CellError::Coefficient { place, .. }) => place,
        _ => usize::MAX,
    };
    assert_eq!(
        place(series(&[
            ([0; 3], [1.0, 0.0]),
            ([1, 0, 0], [f64::NAN, 0.0])
        ])),
        1
    );
    assert_eq!(
        place(series(&[([1, 0, 0], [1.0, 0.0]), ([-1, 0, 0], [1.0, 0.0])])),
        1
    );
    assert_eq!(place(series(&[([0; 3], [1.0, 0.5])])), 0);
    assert_eq!(place(series(&[([i32::MIN, 0, 0], [1.0, 0.0])])), 0);
    let fine = series(&[([1, 0, 0], [1.0, 0.5])]).unwrap();
    assert!(matches!(
        Cell::new("x", Element::Hex, fine),
        Err(CellError::Unfitting {
            what: "lattice",
            ..
        })
    ));
    assert!(Cell::symmetry(Element::Hex, Some("fcc2")).is_err());
    for (element, group, what) in [
        (Element::Tet, "Oh", "group"),
        (Element::Pyramid, "D4h", "group"),
        (Element::Quad, "D4", "dimension"),
    ] {
        let lattice = (element == Element::Tet).then_some("cubic");
        let lattice = lattice.or((element == Element::Pyramid).then_some("tetragonal"));
        match druse::cell::symmetry::<3>(element, Some(group), lattice) {
            Err(CellError::Unfitting { what: found, .. }) => assert_eq!(found, what),
            other => panic!("{element:?} {group}: {other:?}"),
        }
    }
    let icosahedral = druse::cell::symmetry::<3>(Element::Hex, Some("Ih"), None).unwrap_err();
    assert!(
        icosahedral.to_string().contains("no lattice"),
        "{icosahedral}"
    );
    let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
    assert!(p.clone().with_solid(Solid::Sheet, -0.1).is_err());
    assert!(p.clone().with_solid(Solid::Below, f64::NAN).is_err());
    for f in [0.0, 1.0, -1.0, f64::NAN] {
        assert!(p.level_for_volume_fraction(f).is_err());
    }
    let empty = p.clone().with_solid(Solid::Below, -3.5).unwrap();
    let message = empty.check_surface().unwrap_err().to_string();
    assert!(message.contains("nothing solid inside the hex") && message.contains("-3.5"));
    assert!(p.check_surface().is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(48)))]

    #[test]
    fn value_is_invariant_under_every_operator(cell in any_cell(), p in any_point()) {
        let v = cell.value(p);
        for q in cell.operators() {
            prop_assert!((cell.value(CellPoint(q * p.0)) - v).abs() < 1e-11);
        }
    }

    #[test]
    fn gradient_equals_finite_difference(cell in any_cell(), p in any_point()) {
        const STEP: f64 = 1e-6;
        let (v, g) = cell.value_and_gradient(p);
        prop_assert!((v - cell.value(p)).abs() < 1e-12);
        prop_assume!(cell.expression().value(p).abs() > 1e-3);
        let difference = Vec3::from_fn(|a, _| {
            let e = Vec3::ith(a, STEP);
            (cell.value(CellPoint(p.0 + e)) - cell.value(CellPoint(p.0 - e))) / (2.0 * STEP)
        });
        // Second order: a third of the third derivative, below 2e3 here, times the step squared.
        prop_assert!((g - difference).norm() < 1e-6);
    }

    #[test]
    fn bound_contains_every_sample(cell in any_cell(), (region, points) in any_box()) {
        let bound = cell.bound(&region);
        for p in points {
            prop_assert!(bound.contains(cell.value(p)));
        }
    }

    #[test]
    fn shift_lowers_and_inversion_negates(cell in any_cell(), p in any_point(), by in -0.04f64..0.5) {
        let v = cell.value(p);
        let shifted = cell.clone().shifted(by);
        // What a sheet leaves out can be widened only until the sheet is gone.
        if let Ok(shifted) = shifted {
            prop_assert!((shifted.value(p) - (v - by)).abs() < 1e-12);
        } else {
            prop_assert!(cell.solid().is_symmetric() && cell.level() <= by.abs());
        }
        prop_assert_eq!(cell.clone().inverted().value(p), -v);
        if !cell.solid().is_symmetric() {
            let sheet = cell.sheet(0.1).unwrap();
            prop_assert!((sheet.value(p) - (v.abs() - 0.1)).abs() < 1e-12);
        }
    }
}
