//! Gradients of whole problems against central differences.

use super::largest;
use druse::cell::{Solid, Surface, symmetry};
use druse::frame::Element;
use druse::homogenize::{Control, Isotropic, Voigt};
use druse::inverse::{
    Interface, Medium, Objective, Problem, Property, SampledBasis, Space, Target, Tube,
    UpperBounds, ways,
};
use druse::progress::Silent;
use druse::symmetry::Basis;

/// One case: what is new in it beside the target.
struct Case {
    target: Target,
    element: Element,
    group: Option<&'static str>,
    solid: Solid,
    erosions: Vec<f64>,
    is_matched: bool,
    /// Radius of the barrier around the way through the void of `schwarz_p`.
    barrier: Option<f64>,
}

impl Case {
    fn network(target: Target) -> Self {
        Self {
            target,
            element: Element::Hex,
            group: None,
            solid: Solid::Below,
            erosions: vec![0.0],
            is_matched: false,
            barrier: None,
        }
    }
}

fn agrees(case: &Case) {
    let solid = Isotropic::new(1.0, 0.3).unwrap();
    let (fraction, void) = (0.35, 1e-2);
    let (group, lattice) = symmetry::<3>(case.element, case.group, None).unwrap();
    let band_limit = match (case.element, case.is_matched) {
        (Element::Tet, _) => 1.9,
        (_, true) => 3.2,
        (_, false) => 2.3,
    };
    let basis = Basis::new(group, lattice, band_limit);
    let sampled = SampledBasis::new(case.element, &basis, 8).unwrap();
    let matched = if case.is_matched {
        let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
        vec![cell.with_solid(Solid::Below, -0.4).unwrap()]
    } else {
        Vec::new()
    };
    let space = Space::new(case.element, &basis, &sampled, case.solid, false, &matched).unwrap();
    let objective = Objective::new(case.target.clone(), UpperBounds::new(solid, void, fraction));
    let tube = case.barrier.map(|radius| {
        let plain = Surface::SchwarzP.cell(Element::Hex).unwrap();
        let (_, ways) = ways(&plain.with_solid(case.solid, 0.2).unwrap(), 8).unwrap();
        Tube::new(&sampled, &ways, radius)
    });
    let problem = Problem {
        sampled: &sampled,
        space: &space,
        objective: &objective,
        solid: case.solid,
        fraction,
        interface: Interface {
            width: 0.15,
            power: 2.0,
        },
        erosions: case.erosions.clone(),
        tube,
    };
    let control = Control {
        tolerance: 1e-10,
        ..Control::default()
    };
    let evaluated = |unknowns: &[f64]| {
        let medium = || Medium::new(sampled.grid(), solid, void, sampled.is_cubic(), control);
        let mut media: Vec<Medium> = case.erosions.iter().map(|_| medium()).collect();
        let found = problem.evaluate(unknowns, &mut media, &Silent);
        found.unwrap().unwrap()
    };
    // The first unknown beside the constant is the wave along the axes.
    let mut unknowns: Vec<f64> = (0..space.unknowns_count())
        .map(|n| 0.1 * (0.7 * n as f64 + 0.3).sin())
        .collect();
    unknowns[usize::from(case.solid == Solid::Sheet)] += 1.0;
    let own = evaluated(&unknowns);
    let greatest = own.gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
    let tried = if crate::is_full() { 12 } else { 2 };
    let every = space.unknowns_count().div_ceil(tried);
    for n in (0..space.unknowns_count()).step_by(every) {
        // The flow is known to fewer digits.
        let is_flow =
            case.target.maximise == Some(Property::Permeability) || case.target.bounds_flow();
        let h = if is_flow { 2e-3 } else { 5e-4 };
        let moved = |by: f64| {
            let mut unknowns = unknowns.clone();
            unknowns[n] += by;
            evaluated(&unknowns).cost
        };
        let wide = (moved(2.0 * h) - moved(-2.0 * h)) / (4.0 * h);
        let narrow = (moved(h) - moved(-h)) / (2.0 * h);
        // The error of the differences falls with the square of the step.
        let expected = (4.0 * narrow - wide) / 3.0;
        let off = (own.gradient[n] - expected).abs();
        assert!(
            off < 1e-5 * greatest,
            "{:?} {:?} unknown {n}: {} {expected}, greatest {greatest}",
            case.target,
            case.solid,
            own.gradient[n]
        );
    }
}

#[test]
fn every_objective_has_the_gradient_of_central_differences() {
    for property in [
        Property::Bulk,
        Property::Shear,
        Property::Young,
        Property::Conductivity,
        Property::Permeability,
    ] {
        agrees(&Case::network(largest(property)));
    }
    let wanted: Voigt = Isotropic::new(0.12, 0.2).unwrap().stiffness();
    for target in [
        Target {
            zener: Some(1.0),
            ..largest(Property::Bulk)
        },
        Target {
            poisson: Some(-0.2),
            ..Target::default()
        },
        Target {
            stiffness: Some((wanted, 3.0)),
            ..Target::default()
        },
    ] {
        agrees(&Case::network(target));
    }
}

#[test]
fn constraints_have_it_too() {
    let bulk = || Case::network(largest(Property::Bulk));
    // The tubes of the surface are narrower than the barrier, so that it acts.
    for solid in [Solid::Below, Solid::Sheet] {
        agrees(&Case {
            solid,
            barrier: Some(0.3),
            erosions: vec![0.02, -0.02],
            ..bulk()
        });
    }
    agrees(&Case {
        is_matched: true,
        barrier: Some(0.4),
        ..bulk()
    });
    for (min_permeability, max_permeability) in [(Some(1e-1), None), (None, Some(1e-4))] {
        agrees(&Case::network(Target {
            min_permeability,
            max_permeability,
            ..largest(Property::Bulk)
        }));
    }
}

#[test]
fn sheets_moved_surfaces_given_traces_and_other_groups_have_it_too() {
    let bulk = || Case::network(largest(Property::Bulk));
    agrees(&Case {
        solid: Solid::Sheet,
        ..bulk()
    });
    agrees(&Case {
        erosions: vec![0.03, -0.03],
        ..bulk()
    });
    agrees(&Case {
        solid: Solid::Sheet,
        erosions: vec![0.02, -0.02],
        ..Case::network(largest(Property::Young))
    });
    agrees(&Case {
        is_matched: true,
        ..bulk()
    });
    agrees(&Case {
        group: Some("D4h"),
        ..Case::network(largest(Property::Young))
    });
    agrees(&Case {
        group: Some("D4h"),
        ..Case::network(largest(Property::Conductivity))
    });
    agrees(&Case {
        element: Element::Tet,
        ..bulk()
    });
}
