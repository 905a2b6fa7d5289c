//! What cannot be designed is refused with what was found and what was expected.

use super::{largest, short};
use druse::cell::{Solid, Surface};
use druse::frame::Element;
use druse::homogenize::Isotropic;
use druse::inverse::{Design, InverseError, Property, StartChoice, Target};
use druse::progress::Silent;

/// The message of a design that is refused, before or at its start.
fn refused(change: impl Fn(&mut Design)) -> String {
    let mut design = short(largest(Property::Bulk), 0.3);
    change(&mut design);
    let made = design.prepare().and_then(|p| p.search(None, &Silent));
    match made {
        Err(e) => e.to_string(),
        Ok(_) => panic!("the design was made"),
    }
}

#[test]
fn wrong_designs_are_refused() {
    let network = |surface: Surface, level: f64| {
        let cell = surface.cell(Element::Hex).unwrap();
        cell.with_solid(Solid::Below, level).unwrap()
    };
    for (message, words) in [
        (refused(|d| d.element = Element::Wedge), "wedge"),
        (refused(|d| d.element = Element::Quad), "quad"),
        (refused(|d| d.band_limit = 7.0), "Nyquist"),
        (refused(|d| d.band_limit = 0.5), "band_limit"),
        (refused(|d| d.volume_fraction = 1.0), "between 0 and 1"),
        (refused(|d| d.voxels = 13), "even number"),
        (refused(|d| d.starts = 0), "starts"),
        (refused(|d| d.evaluations = 2), "3 or more"),
        (refused(|d| d.min_feature = Some(0.6)), "0.5"),
        (
            refused(|d| d.target.min_opening = Some(0.48)),
            "below 0.472, which leaves room for its tube at volume fraction 0.3",
        ),
        (
            refused(|d| {
                d.solid = Solid::Sheet;
                d.target.min_opening = Some(0.34);
            }),
            "below 0.333",
        ),
        (
            refused(|d| d.target.min_permeability = Some(2.0)),
            "min_permeability 2",
        ),
        (
            refused(|d| {
                d.target.min_permeability = Some(2e-3);
                d.target.max_permeability = Some(1e-3);
            }),
            "min_permeability 0.002 above max_permeability 0.001",
        ),
        (
            refused(|d| {
                d.target = Target::default();
                d.target.min_opening = Some(0.1);
            }),
            "constraints alone",
        ),
        (refused(|d| d.solid = Solid::Above), "below"),
        (refused(|d| d.target = Target::default()), "empty target"),
        (refused(|d| d.target.poisson = Some(0.5)), "-1 and 0.5"),
        (
            refused(|d| {
                let stiff = Isotropic::new(0.9, 0.3).unwrap().stiffness();
                d.target.stiffness = Some((stiff, 1.0));
            }),
            "Hashin-Shtrikman bound at volume fraction 0.3",
        ),
        (
            refused(|d| d.start = StartChoice::Surface("schwartz".to_owned())),
            "schwarz_p",
        ),
        (
            refused(|d| d.start = StartChoice::Surface("gyroid".to_owned())),
            "symmetry",
        ),
        (
            refused(|d| {
                d.solid = Solid::Sheet;
                d.matched = vec![network(Surface::SchwarzP, 0.0)];
            }),
            "sheet",
        ),
        (
            refused(|d| {
                let both = [Surface::SchwarzP, Surface::Iwp];
                d.matched = both.map(|s| network(s, 0.0)).to_vec();
            }),
            "traces on the faces differ",
        ),
        (
            refused(|d| {
                d.band_limit = 1.5;
                d.matched = vec![network(Surface::Neovius, 0.0)];
            }),
            "band_limit",
        ),
        (
            refused(|d| {
                d.element = Element::Tet;
                d.group = Some("T".to_owned());
                d.band_limit = 1.5;
            }),
            "Td",
        ),
    ] {
        assert!(message.contains(words), "no {words:?} in {message}");
        assert!(message.contains("expected"), "{message}");
    }
}

#[test]
fn constraints_that_no_cell_meets_name_the_nearest_value() {
    // At half solid a tube of 0.38 has room, but the band holds no such network.
    let mut design = short(largest(Property::Bulk), 0.5);
    design.target.min_opening = Some(0.38);
    (design.evaluations, design.starts) = (4, 1);
    let made = design.prepare().unwrap().search(None, &Silent);
    let Err(e @ InverseError::Infeasible { .. }) = made else {
        panic!("expected a constraint that is missed");
    };
    let InverseError::Infeasible { misses, .. } = &e else {
        unreachable!()
    };
    let nearest = misses[0].found;
    assert!(nearest > 0.1 && nearest < 0.38, "{e}");
    let digits = e.to_string();
    assert!(digits.contains("expected at most 0."), "{digits}");
}

#[test]
fn balls_that_do_not_touch_are_no_result() {
    // At so little solid the wave along the axes alone makes balls.
    let design = Design {
        band_limit: 1.0,
        starts: 1,
        evaluations: 3,
        voxels: 8,
        ..Design::new("balls", Element::Hex, largest(Property::Bulk), 0.05)
    };
    // A band of one wave has no freedom.
    assert!(matches!(
        design.clone().prepare(),
        Err(InverseError::Target {
            what: "band_limit",
            ..
        })
    ));
    let design = Design {
        band_limit: 1.42,
        start: StartChoice::Surface("schwarz_p".to_owned()),
        ..design
    };
    let made = design.prepare().unwrap().search(None, &Silent);
    let Err(e @ InverseError::Disconnected(_)) = made else {
        panic!("expected a cell that is not connected");
    };
    assert!(e.to_string().contains("one component"), "{e}");
}
