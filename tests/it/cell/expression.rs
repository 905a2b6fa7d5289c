//! Laws of expressions and hybrids.

use super::{any_box, any_point, at, pairings, random_cell};
use druse::cell::{Cell, CellError, Expression, Join, Node, Series, Solid, Surface, Table};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use proptest::prelude::*;

/// A hybrid of two or three random cells of one element, which may differ in band, group and lattice.
pub fn any_hybrid() -> impl Strategy<Value = Cell> {
    let part = (
        prop::sample::select(pairings()),
        2.0f64..3.0,
        prop::collection::vec((-1.0f64..1.0, -1.0f64..1.0), 12),
        prop::sample::select(Solid::KINDS.to_vec()),
        0.05f64..0.3,
    );
    (
        prop::collection::vec(part, 2..4),
        0usize..4,
        prop::sample::select(vec![0.0, 0.1]),
    )
        .prop_filter_map("a part has no slope", |(parts, kind, radius)| {
            let element = parts[0].0.0;
            let cells: Vec<Cell> = parts
                .into_iter()
                .map(|(pairing, band, numbers, solid, level)| {
                    // The first cell's element, with the other's group and lattice where they fit.
                    let own = (element, pairing.1, pairing.2);
                    let fitting = if pairings().contains(&own) {
                        own
                    } else {
                        let all = pairings();
                        *all.iter().find(|p| p.0 == element).unwrap()
                    };
                    random_cell(fitting, band, &numbers, solid, level)
                })
                .collect();
            let references: Vec<&Cell> = cells.iter().collect();
            let join = [Join::Union, Join::Intersection, Join::Difference];
            if let Some(join) = join.get(kind) {
                return Cell::joined("hybrid", *join, &references, radius).ok();
            }
            let weighted: Vec<(f64, &Cell)> = references.into_iter().map(|c| (0.7, c)).collect();
            Cell::average("hybrid", &weighted).ok()
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(32)))]

    #[test]
    fn hybrids_are_invariant_under_their_operators(cell in any_hybrid(), p in any_point()) {
        let v = cell.value(p);
        prop_assert!(!cell.operators().is_empty());
        for q in cell.operators() {
            prop_assert!((cell.value(CellPoint(q * p.0)) - v).abs() < 1e-9 * (1.0 + v.abs()));
        }
    }

    #[test]
    fn bounds_of_hybrids_contain_every_sample(cell in any_hybrid(), (region, points) in any_box()) {
        let bound = cell.bound(&region);
        let table = Table::new(&cell).unwrap();
        let (of_table, steepest) = (table.bound(&region), table.gradient_bound(&region));
        for p in points {
            prop_assert!(bound.contains(cell.value(p)));
            let (v, g) = table.value_and_gradient(p);
            prop_assert!(of_table.contains(v), "{of_table:?} {v}");
            prop_assert!(g.norm() <= steepest, "{} {steepest}", g.norm());
            prop_assert!((v - cell.value(p)).abs() <= table.error_bound());
            if cell.element().face_distance(p) <= 0.0 {
                prop_assert!(g.norm() <= table.gradient_sup());
            }
        }
    }

    #[test]
    fn bounds_of_two_to_eight_rounded_operands_contain_every_sample(
        waves in prop::collection::vec((1i32..3, 0.2f64..1.0, -0.3f64..0.3), 2..9),
        radius in 0.05f64..0.6,
        (region, points) in any_box(),
    ) {
        let operands: Vec<Expression> = waves
            .iter()
            .map(|(k, c, by)| cosines([*k, 0, 0], *c).expression().shifted(*by))
            .collect();
        for extreme in [Expression::min, Expression::max] {
            let function = extreme(operands.clone(), radius).unwrap();
            let bound = function.bound(&region);
            for p in &points {
                prop_assert!(bound.contains(function.value(*p)));
            }
        }
    }

    #[test]
    fn gradients_of_hybrids_are_finite_differences(cell in any_hybrid(), p in any_point()) {
        const STEP: f64 = 1e-5;
        let (_, g) = cell.value_and_gradient(p);
        let slopes = Vec3::from_fn(|a, _| {
            let v = |s: f64| cell.value(CellPoint(p.0 + Vec3::ith(a, s * STEP)));
            let (up, down) = ((v(1.0) - v(0.0)) / STEP, (v(0.0) - v(-1.0)) / STEP);
            // At a kink the gradient is that of one side.
            if (g[a] - up).abs() < (g[a] - down).abs() { up } else { down }
        });
        // One-sided: half of the second derivative times the step.
        prop_assert!((g - slopes).norm() < 2e-2 * (1.0 + g.norm()), "{g} {slopes}");
    }

    #[test]
    fn files_give_hybrids_back(cell in any_hybrid(), p in any_point()) {
        let text = cell.to_json();
        let back = Cell::from_json(&text).unwrap();
        prop_assert_eq!(back.value(p), cell.value(p));
        prop_assert_eq!((back.group(), back.operators()), (cell.group(), cell.operators()));
        prop_assert_eq!(back.to_json(), text);
    }
}

fn cosines(k: [i32; 3], c: f64) -> Cell {
    let (group, lattice) = Cell::symmetry(Element::Hex, None).unwrap();
    let series = Series::new(group, lattice, &[(k, [c, 0.0])]).unwrap();
    Cell::new("cosines", Element::Hex, series).unwrap()
}

#[test]
fn sums_over_one_lattice_are_one_series() {
    // Weight 0.7 of cX + cY + cZ and 0.3 of 4 cX cY cZ.
    let (p, c) = (cosines([1, 0, 0], 0.5), cosines([1, 1, 1], 0.5));
    let sum = Expression::sum(vec![
        (0.7, p.expression().clone()),
        (0.3, c.expression().clone()),
    ])
    .unwrap();
    let cell = Cell::new("mean", Element::Hex, sum).unwrap();
    let found: Vec<_> = cell
        .series()
        .unwrap()
        .coefficients()
        .iter()
        .map(|t| (t.k, t.c))
        .collect();
    assert_eq!(found, [([1, 0, 0], [0.35, 0.0]), ([1, 1, 1], [0.15, 0.0])]);
    let cell = cell.with_solid(Solid::Below, 0.2).unwrap();
    // The limit of midpoint sums over 64^3, 128^3, 256^3 points, whose last step is 1.3e-4.
    assert!(
        (cell.volume_fraction() - 0.64465).abs() < 1.5e-4,
        "{}",
        cell.volume_fraction()
    );
    // Shift and negation stay series, and cancel.
    let same = p
        .expression()
        .shifted(0.3)
        .negated()
        .negated()
        .shifted(-0.3);
    let (a, b) = (same.value(at(0.1, 0.2, 0.3)), p.value(at(0.1, 0.2, 0.3)));
    assert!(same.series().is_some() && (a - b).abs() < 1e-14);
}

#[test]
fn averages_are_normalised_by_gamma() {
    let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let (group, lattice) = Cell::symmetry(Element::Hex, None).unwrap();
    let thousand = Series::new(group, lattice, &[([1, 0, 0], [500.0, 0.0])]).unwrap();
    let steep = Cell::new("steep", Element::Hex, thousand).unwrap();
    let half = Cell::average("half", &[(1.0, &p), (1.0, &steep)]).unwrap();
    // Both are the same surface, whatever their steepness: so is their average, with gamma 1.
    assert!((half.gamma() - 1.0).abs() < 1e-9);
    let v = p.value(at(0.1, 0.2, 0.05)) / p.gamma();
    assert!((half.value(at(0.1, 0.2, 0.05)) - v).abs() < 1e-12);
}

#[test]
fn joins_are_those_of_sets() {
    let (p, d) = (
        Surface::SchwarzP.cell(Element::Tet).unwrap(),
        Surface::Diamond.cell(Element::Tet).unwrap(),
    );
    let of = |join, radius| Cell::joined("x", join, &[&p, &d], radius).unwrap();
    let rounded = of(Join::Union, 0.2);
    assert!(matches!(rounded.expression().node(), Node::Min(_, r) if *r == 0.2));
    for i in 0..400 {
        let x = |k: i32| f64::from((i * k) % 97) / 97.0 - 0.5;
        let q = at(x(13), x(29), x(51));
        let (a, b) = (p.value(q) < 0.0, d.value(q) < 0.0);
        assert_eq!(of(Join::Union, 0.0).value(q) < 0.0, a || b);
        assert_eq!(of(Join::Intersection, 0.0).value(q) < 0.0, a && b);
        let minus = of(Join::Difference, 0.0).value(q);
        assert!((minus < 0.0) == (a && !b) || minus == 0.0);
        // Rounding fills the union's corner and nothing beyond a quarter of the radius.
        let fill = of(Join::Union, 0.0).value(q) - rounded.value(q);
        assert!((0.0..=0.05 + 1e-12).contains(&fill), "{fill}");
        let (u, v) = (p.value(q) / p.gamma(), d.value(q) / d.gamma());
        assert_eq!(fill > 0.0, (u - v).abs() < 0.2);
    }
    assert_eq!((rounded.group(), rounded.operators().len()), ("Td", 24));
}

#[test]
fn impossible_hybrids_are_refused() {
    let hex = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let tet = Surface::SchwarzP.cell(Element::Tet).unwrap();
    let words = |r: Result<Cell, CellError>| r.unwrap_err().to_string();
    assert!(words(Cell::average("x", &[])).contains("no cells"));
    assert!(words(Cell::average("x", &[(1.0, &hex), (1.0, &tet)])).contains("one element"));
    assert!(words(Cell::average("x", &[(0.0, &hex)])).contains("positive sum"));
    assert!(words(Cell::average("x", &[(f64::NAN, &hex)])).contains("NaN"));
    assert!(words(Cell::joined("x", Join::Difference, &[&hex], 0.0)).contains("at least two"));
    assert!(words(Cell::joined("x", Join::Union, &[&hex, &hex], -1.0)).contains("radius is -1"));
    let many = vec![&hex; 300];
    assert!(words(Cell::joined("x", Join::Union, &many, 0.0)).contains("nodes"));
}

#[test]
fn errors_in_expressions_name_the_line() {
    let hex = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let iwp = Surface::Iwp.cell(Element::Hex).unwrap();
    let text = Cell::joined("x", Join::Union, &[&hex, &iwp], 0.1)
        .unwrap()
        .to_json();
    for (from, to, words, on, nth) in [
        ("[2, 0, 0]", "[2, 0]", "expected 3", "[2, 0]", 0),
        ("[2, 0, 0]", "[0, 1, 1]", "listed twice", "[0, 1, 1]", 0),
        (
            "\"least\"",
            "\"lowest\"",
            "unknown variant `lowest`",
            "\"lowest\"",
            0,
        ),
        (
            "\"radius\": 0.1",
            "\"radius\": -0.1",
            "radius is -0.1",
            "\"expression\"",
            0,
        ),
        ("\"Oh\"", "\"D3h\"", "D3h", "\"group\"", 0),
        (
            "\"expression\"",
            "\"group\": \"Oh\", \"expression\"",
            "beside",
            "\"element\"",
            0,
        ),
    ] {
        let broken = text.replacen(from, to, 1);
        let error = Cell::from_json(&broken).unwrap_err();
        assert!(error.reason.contains(words), "{to}: {error}");
        let line = broken
            .lines()
            .enumerate()
            .filter(|l| l.1.contains(on))
            .nth(nth);
        assert_eq!(error.line, line.map(|l| l.0 + 1), "{to}: {error}");
    }
    // A fault of the second series is found there.
    let at = text.rfind("\"Oh\"").unwrap();
    let broken = format!("{}\"D3h\"{}", &text[..at], &text[at + 4..]);
    let error = Cell::from_json(&broken).unwrap_err();
    assert_eq!(
        error.line,
        Some(text[..at].matches('\n').count() + 1),
        "{error}"
    );
    assert!(
        Cell::from_json("{\"format\": \"druse-cell\", \"version\": 1, \"element\": \"hex\"}")
            .unwrap_err()
            .reason
            .contains("missing field `group`")
    );
}
