//! Laws of `symmetry`, and the tables of groups and orbits.

use druse::symmetry::{Basis, Lattice, Operator, PointGroup, SymmetryError};
use proptest::prelude::*;
use serde_json::Value;

/// The generators of groups that the library does not name, in Cartesian or prism coordinates.
const OTHERS: [(&str, &[&str]); 9] = [
    ("O", &["z,x,y", "-y,x,z"]),
    ("T", &["z,x,y", "-x,-y,z"]),
    ("Th", &["z,x,y", "-x,-y,z", "-x,-y,-z"]),
    ("D2h", &["-x,y,z", "x,-y,z", "x,y,-z"]),
    ("D4h", &["-y,x,z", "-x,y,z", "x,y,-z"]),
    ("C4v", &["-y,x,z", "-x,y,z"]),
    ("D3h", &["-x-y,x,z", "-x-y,y,z", "x,y,-z"]),
    ("C3v", &["-x-y,x,z", "-x-y,y,z"]),
    ("Oh", &["z,x,y", "y,x,z", "-x,y,z"]),
];

fn group<const D: usize>(name: &str, lattice: &Lattice<D>) -> PointGroup<D> {
    if let Ok(known) = PointGroup::named(name, lattice) {
        return known;
    }
    let generators = OTHERS.iter().find(|o| o.0 == name).unwrap().1;
    let generators: Vec<Operator<D>> = generators.iter().map(|g| g.parse().unwrap()).collect();
    PointGroup::generated(name, &generators).unwrap()
}

fn ints<const D: usize>(v: &Value) -> [i32; D] {
    std::array::from_fn(|i| v[i].as_i64().unwrap() as i32)
}

fn check_case<const D: usize>(case: &Value) {
    let id = case["id"].as_str().unwrap();
    let (name, lattice) = id.split_once('-').unwrap();
    let lattice = Lattice::<D>::named(lattice).unwrap();
    let group = group(name, &lattice);
    assert_eq!(
        group.order() as i64,
        case["order"].as_i64().unwrap(),
        "{id}"
    );
    assert!((lattice.volume() - case["cell_volume"].as_f64().unwrap()).abs() < 1e-12);
    let mut expected: Vec<Operator<D>> = case["integer_matrices_M_on_u_sorted_desc"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| Operator::new(std::array::from_fn(|i| ints::<D>(&m[i]))))
        .collect();
    expected.sort_by(|a, b| b.cmp(a));
    assert_eq!(group.operators(), expected, "{id}");
    assert_eq!(
        group.contains_inversion(),
        case["contains_inversion"].as_bool().unwrap()
    );
    for (trace, count) in case["trace_histogram"].as_object().unwrap() {
        let found = group
            .operators()
            .iter()
            .filter(|op| op.trace().to_string() == *trace)
            .count();
        assert_eq!(found as u64, count.as_u64().unwrap(), "{id} trace {trace}");
    }
    for o in case["orbits"].as_array().unwrap() {
        let k = ints::<D>(&o["k"]);
        let orbit = group.orbit(k);
        assert_eq!(
            orbit.members.len() as u64,
            o["size_m"].as_u64().unwrap(),
            "{id} {k:?}"
        );
        // Large orbits are given by their size alone.
        if let Some(members) = o["members"].as_array() {
            let members: Vec<[i32; D]> = members.iter().map(ints::<D>).collect();
            assert_eq!(orbit.members, members, "{id} {k:?}");
        }
        assert_eq!(
            orbit.stabiliser_order as u64,
            o["stabiliser_order"].as_u64().unwrap()
        );
        assert_eq!(group.stabiliser(k).len(), orbit.stabiliser_order);
        let rep = ints::<D>(&o["canonical_rep(lexicographic max)"]);
        assert_eq!(orbit.representative(), rep);
        assert_eq!(group.canonical(k), rep);
        assert_eq!(
            orbit.is_self_paired(),
            o["self_paired(-k in orbit)"].as_bool().unwrap(),
            "{id} {k:?}"
        );
        let factor = o["K_f (paper Eq.5)"].as_f64().unwrap();
        assert!(
            (orbit.normalisation(&lattice) - factor).abs() < 1e-12,
            "{id} {k:?}"
        );
        let length = o["abs_f_cartesian"].as_f64().unwrap();
        assert!((lattice.frequency_norm(k) - length).abs() < 1e-12);
    }
    for c in case["counts"].as_array().unwrap() {
        let number = |key: &str| c[key].as_u64().unwrap() as usize;
        let radius = c["R"].as_f64().unwrap();
        assert_eq!(
            lattice.band(radius).len(),
            number("n_frequencies_|f|<=R"),
            "{id}"
        );
        assert_eq!(
            group.orbits(&lattice, radius).len(),
            number("n_orbits"),
            "{id}"
        );
        let basis = Basis::new(group.clone(), lattice.clone(), radius);
        assert_eq!(basis.len(), number("real_dof"), "{id}");
        let paired = basis.harmonics().iter().filter(|h| h.self_paired).count();
        assert_eq!(paired, number("n_self_paired"), "{id}");
        assert_eq!(
            basis.harmonics().len() - paired,
            number("n_complex_pairs"),
            "{id}"
        );
    }
}

#[test]
fn groups_and_orbits_are_those_of_the_tables() {
    let data: Value = serde_json::from_str(include_str!("../data/groups.json")).unwrap();
    let cases = data["cases"].as_array().unwrap();
    for case in cases {
        match case["lattice_columns_L"].as_array().unwrap().len() {
            2 => check_case::<2>(case),
            _ => check_case::<3>(case),
        }
    }
    assert_eq!(cases.len(), 14);
}

#[test]
fn frequency_domains_of_the_reflection_groups_are_their_chambers() {
    // Td: f_x >= f_y >= |f_z| on h = 2f; Oh: f_x >= f_y >= f_z >= 0: each orbit meets them once.
    let cubic = Lattice::<3>::named("cubic").unwrap();
    let chamber = |name: &str, inside: fn([i32; 3]) -> bool| {
        let group = PointGroup::named(name, &cubic).unwrap();
        for orbit in group.orbits(&cubic, 6.0) {
            let met = orbit.members.iter().filter(|k| inside(**k)).count();
            assert_eq!(met, 1, "{name} {:?}", orbit.representative());
        }
    };
    chamber("Td", |[x, y, z]| x >= y && y >= z.abs());
    chamber("Oh", |[x, y, z]| x >= y && y >= z && z >= 0);
    let square = Lattice::<2>::named("square").unwrap();
    for orbit in PointGroup::named("D4", &square)
        .unwrap()
        .orbits(&square, 9.0)
    {
        let met = orbit
            .members
            .iter()
            .filter(|[x, y]| x >= y && *y >= 0)
            .count();
        assert_eq!(met, 1);
    }
}

#[test]
fn products_of_operators_stay_in_the_group() {
    let fcc = Lattice::<3>::named("fcc2").unwrap();
    for name in ["Td", "Oh"] {
        let group = PointGroup::named(name, &fcc).unwrap();
        for a in group.operators() {
            for b in group.operators() {
                assert!(group.operators().contains(&(*a * *b)));
            }
        }
        assert!(group.operators().contains(&Operator::identity()));
    }
}

#[test]
fn generators_of_no_finite_group_are_refused() {
    let generated = |texts: &[&str]| {
        let ops: Vec<Operator<3>> = texts.iter().map(|t| t.parse().unwrap()).collect();
        PointGroup::generated("test", &ops).unwrap_err()
    };
    assert!(matches!(
        generated(&["x+y,y,z"]),
        SymmetryError::Infinite { limit: 48, .. }
    ));
    // Entries that grow beyond the range of integers before the count does.
    assert!(matches!(
        generated(&["900x+y,x,z"]),
        SymmetryError::Infinite { .. }
    ));
    assert!(matches!(
        generated(&["2x,y,z"]),
        SymmetryError::Determinant { determinant: 2, .. }
    ));
    assert!(matches!(
        PointGroup::named("D3", &Lattice::<2>::named("square").unwrap()),
        Err(SymmetryError::Unfitting { .. })
    ));
    let cubic = Lattice::<3>::named("cubic").unwrap();
    let unknown = PointGroup::named("Ih", &cubic).unwrap_err().to_string();
    assert!(unknown.contains("Td, Oh"), "{unknown}");
    assert!(matches!(
        Lattice::new([[1., 0., 0.], [0., 1., 0.], [1., 1., 0.]]),
        Err(SymmetryError::Flat { .. })
    ));
}

#[test]
fn malformed_operators_are_refused() {
    for text in [
        "",
        "x,y",
        "x,y,z,x",
        "x,,z",
        "x,y,w",
        "x,y,2",
        "x,y,+",
        "x,y,--z",
        "9999x,y,z",
    ] {
        let found = text.parse::<Operator<3>>();
        assert!(
            matches!(found, Err(SymmetryError::Operator { .. })),
            "{text:?} -> {found:?}"
        );
    }
    assert!("x,z".parse::<Operator<2>>().is_err());
}

proptest! {
    #[test]
    fn operators_print_what_they_parse(m in prop::array::uniform3(prop::array::uniform3(-3i32..=3))) {
        prop_assume!(m.iter().all(|r| r.iter().any(|c| *c != 0)));
        let op = Operator::<3>::new(m);
        prop_assert_eq!(op.to_string().parse::<Operator<3>>().unwrap(), op);
    }

    #[test]
    fn composing_a_wave_moves_its_index(k in prop::array::uniform3(-6i32..=6),
                                        u in prop::array::uniform3(-1.0f64..1.0), n in 0usize..48) {
        let group = PointGroup::named("Oh", &Lattice::named("fcc2").unwrap()).unwrap();
        let op = group.operators()[n];
        let phase = |k: [i32; 3], u: [f64; 3]| -> f64 {
            k.iter().zip(u).map(|(&a, b)| f64::from(a) * b).sum()
        };
        let moved = phase(k, op.apply(u)) - phase(op.apply_to_frequency(k), u);
        prop_assert!(moved.abs() < 1e-12);
    }

    #[test]
    fn orbit_size_times_stabiliser_is_the_order(k in prop::array::uniform3(-9i32..=9)) {
        for name in ["Td", "Oh"] {
            for lattice in ["cubic", "fcc2"] {
                let group = PointGroup::named(name, &Lattice::named(lattice).unwrap()).unwrap();
                let orbit = group.orbit(k);
                prop_assert_eq!(orbit.members.len() * group.stabiliser(k).len(), group.order());
                for q in &orbit.members {
                    prop_assert_eq!(group.canonical(*q), orbit.representative());
                }
            }
        }
    }
}
