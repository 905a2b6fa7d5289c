//! Laws of `symmetry`, and the tables of groups and orbits.

use druse::cell::Series;
use druse::field::Field;
use druse::frame::CellPoint;
use druse::symmetry::{
    Basis, GROUP_NAMES, GroupText, LATTICE_NAMES, Lattice, Operator, PointGroup, SymmetryError,
};
use proptest::prelude::*;
use serde_json::Value;
use std::collections::BTreeSet;

fn ints<const D: usize>(v: &Value) -> [i32; D] {
    std::array::from_fn(|i| v[i].as_i64().unwrap() as i32)
}

fn check_case<const D: usize>(case: &Value) {
    let id = case["id"].as_str().unwrap();
    let (name, lattice) = id.split_once('-').unwrap();
    let lattice = Lattice::<D>::named(lattice).unwrap();
    let group = PointGroup::named(name, &lattice).unwrap();
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
    let inversion = Operator::new(Operator::<D>::identity().rows().map(|r| r.map(|c| -c)));
    assert_eq!(
        group.operators().contains(&inversion),
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
        let rep = ints::<D>(&o["canonical_rep(lexicographic max)"]);
        assert_eq!(orbit.representative(), rep);
        assert_eq!(group.canonical(k), rep);
        assert_eq!(
            orbit.is_self_paired(),
            o["self_paired(-k in orbit)"].as_bool().unwrap(),
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
    // Every orbit meets the chamber exactly once.
    type Chamber = fn([i32; 3]) -> bool;
    let chambers: [(&str, &str, Chamber); 9] = [
        ("Td", "cubic", |[x, y, z]| x >= y && y >= z.abs()),
        ("Oh", "cubic", |[x, y, z]| x >= y && y >= z && z >= 0),
        ("D2h", "cubic", |[x, y, z]| x >= 0 && y >= 0 && z >= 0),
        ("D4h", "cubic", |[x, y, z]| x >= y && y >= 0 && z >= 0),
        ("C4v", "cubic", |[x, y, _]| x >= y && y >= 0),
        ("C3v", "cubic", |[x, y, z]| x >= y && y >= z),
        ("D3h", "hexprism", |[x, y, z]| x >= y && y >= 0 && z >= 0),
        ("C3v", "hexprism", |[x, y, _]| x >= y && y >= 0),
        ("C1", "cubic", |_| true),
    ];
    for (name, lattice, inside) in chambers {
        let lattice = Lattice::<3>::named(lattice).unwrap();
        let group = PointGroup::named(name, &lattice).unwrap();
        assert_ne!(group.frequency_domain(&lattice), "");
        for orbit in group.orbits(&lattice, 4.0) {
            let met = orbit.members.iter().filter(|k| inside(**k)).count();
            assert_eq!(met, 1, "{name} {:?}", orbit.representative());
        }
    }
    for (name, lattice) in [("D4", "square"), ("D3", "hex2")] {
        let lattice = Lattice::<2>::named(lattice).unwrap();
        let group = PointGroup::named(name, &lattice).unwrap();
        for orbit in group.orbits(&lattice, 9.0) {
            let met = orbit.members.iter().filter(|[x, y]| x >= y && *y >= 0);
            assert_eq!(met.count(), 1, "{name}");
        }
    }
}

/// Groups with the lattice in whose coordinates their operators are.
type Groups<const D: usize> = Vec<(PointGroup<D>, Lattice<D>)>;

/// Every named group on every named lattice that has it, in space and in the plane.
fn every_group() -> (Groups<3>, Groups<2>) {
    fn of<const D: usize>() -> Groups<D> {
        let mut names = GROUP_NAMES.to_vec();
        names.sort_unstable();
        names.dedup();
        let lattices = LATTICE_NAMES
            .iter()
            .filter_map(|l| Lattice::<D>::named(l).ok());
        lattices
            .flat_map(|l| {
                let group = |n: &&str| PointGroup::named(n, &l).ok().map(|g| (g, l.clone()));
                names.iter().filter_map(group).collect::<Vec<_>>()
            })
            .collect()
    }
    (of::<3>(), of::<2>())
}

fn group_laws<const D: usize>(group: &PointGroup<D>, lattice: &Lattice<D>) {
    let operators = group.operators();
    assert!(operators.contains(&Operator::identity()));
    for a in operators {
        assert_eq!(a.determinant().abs(), 1);
        let row: BTreeSet<Operator<D>> = operators.iter().map(|b| *a * *b).collect();
        let all: BTreeSet<Operator<D>> = operators.iter().copied().collect();
        // Closed, and multiplication by an element is one to one: there are inverses.
        assert_eq!(row, all, "{}", group.name());
    }
    for q in group.cartesian(lattice) {
        let miss = q.transpose() * q - nalgebra::SMatrix::<f64, D, D>::identity();
        assert!(miss.iter().all(|c| c.abs() < 1e-12), "{}", group.name());
    }
    let again = PointGroup::generated(group.name(), &group.generators()).unwrap();
    assert_eq!(again, *group);
    assert!(group.is_named(lattice));
}

#[test]
fn groups_are_groups_of_orthogonal_operators() {
    let (space, plane) = every_group();
    assert!(
        space.len() >= 30 && plane.len() >= 4,
        "{} {}",
        space.len(),
        plane.len()
    );
    for (group, lattice) in &space {
        group_laws(group, lattice);
    }
    for (group, lattice) in &plane {
        group_laws(group, lattice);
    }
}

/// Values of a function on the grid u = j / n of one period.
fn grid<const D: usize>(series: &Series<D>, n: usize) -> Vec<f64> {
    (0..n.pow(D as u32))
        .map(|m| {
            let u = nalgebra::SVector::<f64, D>::from_fn(|a, _| {
                (m / n.pow(a as u32) % n) as f64 / n as f64
            });
            series.value(CellPoint(series.lattice().columns() * u))
        })
        .collect()
}

fn basis_laws<const D: usize>(group: &PointGroup<D>, lattice: &Lattice<D>) {
    const RADIUS: f64 = 1.5;
    let basis = Basis::new(group.clone(), lattice.clone(), RADIUS);
    let largest = lattice.band(RADIUS).into_iter().flatten().max().unwrap();
    // Products of two functions of the band are integrated exactly.
    let n = 2 * largest as usize + 1;
    let function = |real: &[f64]| {
        Series::new(group.clone(), lattice.clone(), &basis.coefficients(real)).unwrap()
    };
    let unit = |i: usize| -> Vec<f64> {
        (0..basis.len())
            .map(|j| f64::from(u8::from(i == j)))
            .collect()
    };
    let values: Vec<Vec<f64>> = (0..basis.len())
        .map(|i| grid(&function(&unit(i)), n))
        .collect();
    let product = |a: &[f64], b: &[f64]| -> f64 {
        let sum: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
        sum * lattice.volume() / a.len() as f64
    };
    for i in 0..basis.len() {
        for j in 0..=i {
            let expected = f64::from(u8::from(i == j));
            let found = product(&values[i], &values[j]);
            assert!(
                (found - expected).abs() < 1e-12,
                "{} {i} {j}: {found}",
                group.name()
            );
        }
    }
    // Parseval, invariance and reality of a sum of all of them.
    let real: Vec<f64> = (0..basis.len())
        .map(|i| (i as f64 * 1.7).sin() + 0.3)
        .collect();
    let sum = function(&real);
    let energy: f64 = real.iter().map(|a| a * a).sum();
    let samples = grid(&sum, n);
    assert!((product(&samples, &samples) - energy).abs() < 1e-11 * energy);
    let x = nalgebra::SVector::<f64, D>::from_fn(|a, _| 0.13 + 0.29 * a as f64);
    let v = sum.value(CellPoint(x));
    for q in group.cartesian(lattice) {
        assert!((sum.value(CellPoint(q * x)) - v).abs() < 1e-12);
    }
    let exponentials: std::collections::BTreeMap<_, _> =
        sum.exponentials().iter().copied().collect();
    for (k, [re, im]) in &exponentials {
        assert_eq!(exponentials[&k.map(|c| -c)], [*re, -im]);
    }
}

#[test]
fn bases_are_orthonormal_invariant_and_real() {
    let (space, plane) = every_group();
    for (group, lattice) in &space {
        basis_laws(group, lattice);
    }
    for (group, lattice) in &plane {
        basis_laws(group, lattice);
    }
}

#[test]
fn groups_are_read_from_text() {
    let text = GroupText::parse(
        "# a turned brick\nname D2\n lattice cubic \n-x,-y,z # about z\n\nx,-y,-z\n",
    )
    .unwrap();
    let (group, lattice) = text.group::<3>("file", "fcc2").unwrap();
    assert_eq!(
        (group.name(), group.order(), lattice.name()),
        ("D2", 4, Some("cubic"))
    );
    assert!(!group.is_named(&lattice));
    assert_eq!(text.line(), "name D2; lattice cubic; -x,-y,z; x,-y,-z");
    let plain = GroupText::parse("-y,x").unwrap();
    assert_eq!(plain.group::<2>("turn", "square").unwrap().0.name(), "turn");
    assert!(
        plain
            .group::<3>("turn", "cubic")
            .unwrap_err()
            .reason
            .contains("expected 3")
    );
    let wrong = |text: &str| match GroupText::parse(text) {
        Ok(t) => t.group::<3>("x", "cubic").unwrap_err(),
        Err(e) => e,
    };
    for (text, line, words) in [
        ("", 1, "no generator"),
        ("x,y,z\nx+y,y,z", 2, "infinite"),
        ("x,y,z\n\n2x,y,z", 3, "determinant 2"),
        ("x,y,z\nx,y", 2, "expected 3"),
        ("x,y,w", 1, "unexpected 'w'"),
        ("lattice fcc2\nlattice cubic\nx,y,z", 2, "twice"),
        ("lattice\nx,y,z", 1, "one word"),
        ("spam", 1, "expected an operator"),
        ("lattice hexprism\ny,x,z\n-y,x,z", 2, "changes lengths"),
        ("lattice diamond\nx,y,z", 2, "unknown lattice"),
    ] {
        let e = wrong(text);
        assert!(e.line == line && e.reason.contains(words), "{text:?}: {e}");
    }
    // Each finite alone, together not.
    assert!(wrong("-y,x,z\n-x-y,x,z").reason.contains("infinite"));
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
    let unknown = PointGroup::named("D5", &cubic).unwrap_err().to_string();
    assert!(unknown.contains("Td, Oh"), "{unknown}");
    let icosahedral = PointGroup::named("Ih", &cubic).unwrap_err().to_string();
    assert!(icosahedral.contains("no lattice"), "{icosahedral}");
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
    fn stabilisers_are_counted_by_the_size_of_their_orbits(k in prop::array::uniform3(-9i32..=9)) {
        for name in ["Td", "Oh"] {
            for lattice in ["cubic", "fcc2"] {
                let group = PointGroup::named(name, &Lattice::named(lattice).unwrap()).unwrap();
                let orbit = group.orbit(k);
                let is_fixed = |op: &&Operator<3>| op.apply_to_frequency(k) == k;
                let fixed = group.operators().iter().filter(is_fixed).count();
                prop_assert_eq!(fixed, orbit.stabiliser_order);
                for q in &orbit.members {
                    prop_assert_eq!(group.canonical(*q), orbit.representative());
                }
            }
        }
    }
}
