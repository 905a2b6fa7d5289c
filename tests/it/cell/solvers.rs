//! Laws of the least squares: the two solvers, truncation, tolerance, symmetrisation.

use super::at;
use druse::cell::{Cell, FitOptions, Method, Solver, Symmetrise, fit};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::progress::Silent;

fn struts(p: CellPoint<3>) -> f64 {
    let reach = |v: Vec3| (p.0 - v * (p.0.dot(&v) / v.norm_squared()).clamp(0.0, 1.0)).norm();
    let ends = Element::Tet.vertices();
    let nearest = ends.into_iter().map(reach).fold(f64::INFINITY, f64::min);
    (p.0.norm() - 0.15).min(nearest - 0.07)
}

fn options(band_limit: f64) -> FitOptions {
    FitOptions {
        band_limit,
        measure: false,
        ..FitOptions::default()
    }
}

fn norm(cell: &Cell) -> f64 {
    let all = cell.series().unwrap().exponentials().iter();
    all.map(|(_, c)| c[0].hypot(c[1]).powi(2)).sum::<f64>()
}

#[test]
fn the_two_solvers_agree_on_the_element() {
    for face_normal in [false, true] {
        let run = |solver| {
            let own = FitOptions {
                solver,
                face_normal,
                ..options(5.0)
            };
            fit("x", Element::Tet, &struts, &own, &Silent).unwrap()
        };
        let (dense, iterative) = (run(Solver::Dense), run(Solver::Iterative));
        let report = iterative.report().unwrap();
        println!("{}", report.solver);
        assert!(report.solver.starts_with("iterative"));
        // Other samples of the same integrals.
        let ratio = report.rms / dense.report().unwrap().rms;
        assert!((0.9..1.1).contains(&ratio), "{ratio}");
        for p in [
            at(0.0, 0.0, 0.0),
            at(0.1, 0.05, -0.02),
            at(0.45, 0.45, -0.45),
        ] {
            let gap = (dense.value(p) - iterative.value(p)).abs();
            assert!(gap < 2e-3, "{gap}");
        }
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn every_element_is_fitted_by_every_way_it_has() {
    for element in Element::SCAFFOLD_ELEMENTS {
        let centre = element.centroid().0;
        // A ball that reaches no face: smooth but for its centre.
        let ball = |p: CellPoint<3>| (p.0 - centre).norm() - 0.15;
        let planar = |p: CellPoint<3>| ball(at(p.0.x, p.0.y, 0.0));
        for (solver, method) in [
            (Solver::Dense, Method::Lsq),
            (Solver::Iterative, Method::Lsq),
            (Solver::Auto, Method::Fft),
        ] {
            let own = FitOptions {
                solver,
                method,
                measure: true,
                ..options(5.0)
            };
            let source: &druse::cell::Distance = if element.dimension() == 2 {
                &planar
            } else {
                &ball
            };
            let fitted = fit("ball", element, source, &own, &Silent);
            if (element, method) == (Element::Pyramid, Method::Fft) {
                assert!(fitted.unwrap_err().to_string().contains("use method lsq"));
                continue;
            }
            let cell = fitted.unwrap();
            let report = cell.report().unwrap();
            println!(
                "{element:?} {} {:?} {:?}",
                report.solver, report.rms, report.hausdorff
            );
            assert!(report.rms < 0.01, "{element:?} {report:?}");
            assert!(
                report.hausdorff.unwrap().max() < 0.02,
                "{element:?} {report:?}"
            );
            assert!(
                (report.kept_energy - 1.0).abs() < 1e-9,
                "{element:?} {report:?}"
            );
            let pieces = report.components.unwrap();
            assert_eq!(
                (pieces.source_solid, pieces.cell_solid),
                (1, 1),
                "{element:?}"
            );
            assert_eq!(
                (pieces.source_void, pieces.cell_void),
                (1, 1),
                "{element:?}"
            );
        }
    }
    // Balls at the vertices are as many pieces.
    for (element, pieces) in [
        (Element::Tet, 4),
        (Element::Hex, 8),
        (Element::Wedge, 6),
        (Element::Tri, 3),
    ] {
        let corners = element.vertices();
        let balls = |p: CellPoint<3>| {
            let p = if element.dimension() == 2 {
                at(p.0.x, p.0.y, 0.0)
            } else {
                p
            };
            corners
                .iter()
                .map(|v| (p.0 - v).norm())
                .fold(f64::INFINITY, f64::min)
                - 0.3
        };
        let own = FitOptions {
            measure: true,
            ..options(6.0)
        };
        let cell = fit("balls", element, &balls, &own, &Silent).unwrap();
        let found = cell.report().unwrap().components.unwrap();
        assert_eq!(
            (found.source_solid, found.cell_solid),
            (pieces, pieces),
            "{element:?}"
        );
        assert_eq!((found.source_void, found.cell_void), (1, 1), "{element:?}");
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn truncation_keeps_the_largest_and_fits_them_again() {
    let full = fit("x", Element::Tet, &struts, &options(7.8), &Silent).unwrap();
    for solver in [Solver::Dense, Solver::Iterative] {
        let own = FitOptions {
            keep: Some(120),
            solver,
            ..options(7.8)
        };
        let cell = fit("x", Element::Tet, &struts, &own, &Silent).unwrap();
        let report = cell.report().unwrap();
        assert!(
            (118..=120).contains(&report.degrees_of_freedom),
            "{report:?}"
        );
        // Better than as many coefficients of the ball, worse than all of them.
        let ball = fit("x", Element::Tet, &struts, &options(6.0), &Silent).unwrap();
        let ball = ball.report().unwrap();
        assert!(ball.degrees_of_freedom >= 118);
        assert!(report.rms < ball.rms, "{} {}", report.rms, ball.rms);
        assert!(report.rms > full.report().unwrap().rms);
    }
    // Of an orthonormal expansion the tail that is dropped is what is lost.
    let transform = |keep| FitOptions {
        method: Method::Fft,
        keep,
        ..options(8.0)
    };
    let ball = |p: CellPoint<3>| p.0.norm() - 0.3;
    let whole = fit("x", Element::Hex, &ball, &transform(None), &Silent).unwrap();
    let part = fit("x", Element::Hex, &ball, &transform(Some(30)), &Silent).unwrap();
    assert!(norm(&part) < norm(&whole) && norm(&part) > 0.9999 * norm(&whole));
    assert_eq!(part.report().unwrap().degrees_of_freedom, 30);
}

#[test]
fn a_tolerance_raises_the_band_limit_until_it_is_met() {
    let own = |tolerance, band_limit| FitOptions {
        tolerance: Some(tolerance),
        band_limit,
        ..FitOptions::default()
    };
    let cell = fit("x", Element::Tet, &struts, &own(0.01, 12.0), &Silent).unwrap();
    let report = cell.report().unwrap();
    assert!(report.hausdorff.unwrap().max() <= 0.01, "{report:?}");
    assert!(
        report.band_limit > 4.0 && report.band_limit < 12.0,
        "{report:?}"
    );
    assert!(report.warnings.is_empty());
    let cell = fit("x", Element::Tet, &struts, &own(1e-4, 4.5), &Silent).unwrap();
    let report = cell.report().unwrap();
    assert_eq!(report.band_limit, 4.5);
    assert!(report.warnings[0].contains("tolerance"), "{report:?}");
    assert!(fit("x", Element::Tet, &struts, &own(-1.0, 4.0), &Silent).is_err());
}

#[test]
fn images_are_united_intersected_or_averaged() {
    // A rod along z: its images under Oh are the three axes' rods.
    let rod = |p: CellPoint<3>| p.0.x.hypot(p.0.y) - 0.15;
    let run = |symmetrise| {
        let own = FitOptions {
            symmetrise,
            ..options(8.0)
        };
        fit("rod", Element::Hex, &rod, &own, &Silent).unwrap()
    };
    let (average, union, intersection) = (
        run(Symmetrise::Average),
        run(Symmetrise::Union),
        run(Symmetrise::Intersection),
    );
    let p = at(0.3, 0.1, -0.2);
    let three = [p.0.x.hypot(p.0.y), p.0.y.hypot(p.0.z), p.0.z.hypot(p.0.x)].map(|d| d - 0.15);
    let [least, greatest] = [
        three.iter().copied().fold(1.0, f64::min),
        three.iter().copied().fold(-1.0, f64::max),
    ];
    assert!((union.value(p) - least).abs() < 0.01);
    assert!((intersection.value(p) - greatest).abs() < 0.01);
    assert!((average.value(p) - three.iter().sum::<f64>() / 3.0).abs() < 0.01);
    // The union holds the source.
    for z in [-0.4, -0.1, 0.3] {
        assert!(union.value(at(0.0, 0.0, z)) < -0.1);
    }
}
