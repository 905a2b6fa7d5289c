//! Several cells over one scaffold.

use crate::certificate::random_cell;
use crate::strategy::{Noise, cell_point, mesh};
use druse::cell::{Cell, Surface};
use druse::field::{Field, Interval};
use druse::frame::{CellBox, CellPoint, Element, Vec3};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{
    Blend, Boundary, CellField, Distance, Filling, Interpolation, Member, TiledSolid, TilingError,
    TilingOptions, certify,
};
use proptest::prelude::*;

/// A cell whose mean slope is taken as given.
struct Scaled(Cell, f64);

impl Field for Scaled {
    type Point = CellPoint<3>;
    fn value(&self, p: CellPoint<3>) -> f64 {
        Field::value(&self.0, p)
    }
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        Field::value_and_gradient(&self.0, p)
    }
    fn bound(&self, b: &CellBox<3>) -> Interval {
        Field::bound(&self.0, b)
    }
}

impl CellField for Scaled {
    fn element(&self) -> Element {
        self.0.element()
    }
    fn gradient_sup(&self) -> f64 {
        CellField::gradient_sup(&self.0)
    }
    fn gradient_rms(&self) -> f64 {
        self.1
    }
}

fn single(element: Element) -> Scaffold {
    let kind = if element == Element::Tet {
        Kind::Tet4
    } else {
        Kind::Hex8
    };
    let nodes = element.vertices();
    let mut elements = Connectivity::default();
    elements.push(kind, &(0..nodes.len() as u32).collect::<Vec<_>>());
    Scaffold::new(nodes, elements).unwrap()
}

fn members<C: CellField>(cells: &[C]) -> Vec<Member<'_, C>> {
    cells
        .iter()
        .enumerate()
        .map(|(i, c)| Member {
            name: format!("cell {i}"),
            cells: vec![c],
        })
        .collect()
}

#[test]
fn blends_agree_with_the_reference_numbers() {
    let text = include_str!("../data/transition.json");
    let cases: serde_json::Value = serde_json::from_str(text).unwrap();
    let find = |id: &str| {
        cases
            .as_array()
            .unwrap()
            .iter()
            .find(|c| c["id"] == id)
            .unwrap()
            .clone()
    };
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let list = |v: &serde_json::Value| v.as_array().unwrap().iter().map(number).collect::<Vec<_>>();

    let case = find("hex-two-cells");
    let scale = list(&case["scale_exact"]);
    let cells = [Surface::SchwarzP, Surface::Iwp].map(|s| s.cell(Element::Hex).unwrap());
    let [p, iwp] = cells;
    let cells = [Scaled(p, scale[0]), Scaled(iwp, scale[1])];
    let s = single(Element::Hex);
    let weights: Vec<f64> = list(&case["vertex_weight_of_second_cell"])
        .into_iter()
        .flat_map(|w| [1.0 - w, w])
        .collect();
    for (how, word) in [
        (Interpolation::Linear, "linear"),
        (Interpolation::Smoothstep, "smoothstep3"),
    ] {
        let blend = Blend::new(&s, members(&cells), weights.clone(), how).unwrap();
        for point in case["points"].as_array().unwrap() {
            let r = list(&point["r"]);
            let xi = CellPoint(Vec3::new(r[0], r[1], r[2]).add_scalar(-0.5));
            let w = blend.weights(0, xi)[1];
            assert!((w - number(&point[format!("W_{word}")])).abs() < 1e-9);
            let phi = Filling::value(&blend, 0, xi);
            assert!(
                (phi - number(&point[format!("Phi_{word}")])).abs() < 1e-8,
                "{word}"
            );
        }
    }

    let tet = |surface: Surface| Scaled(surface.cell(Element::Tet).unwrap(), 1.0);
    let v = Element::Tet.vertices();
    let s = single(Element::Tet);
    let case = find("tet-two-cells");
    let cells = [tet(Surface::Diamond), tet(Surface::SchwarzP)];
    let weights: Vec<f64> = list(&case["vertex_weight_of_second_cell"])
        .into_iter()
        .flat_map(|w| [1.0 - w, w])
        .collect();
    for point in case["points"].as_array().unwrap() {
        let l = list(&point["lambda"]);
        let xi = CellPoint((0..4).map(|i| v[i] * l[i]).sum::<Vec3>());
        for (how, word) in [
            (Interpolation::Linear, "W_linear"),
            (Interpolation::Smoothstep, "W_smooth"),
        ] {
            let blend = Blend::new(&s, members(&cells), weights.clone(), how).unwrap();
            assert!((blend.weights(0, xi)[1] - number(&point[word])).abs() < 1e-9);
            if how == Interpolation::Linear {
                let phi = Filling::value(&blend, 0, xi);
                assert!((phi - number(&point["Phi_linear"])).abs() < 1e-8);
            }
        }
    }

    let case = find("tet-three-cells");
    let cells = [
        tet(Surface::SchwarzP),
        tet(Surface::Iwp),
        tet(Surface::Diamond),
    ];
    let weights: Vec<f64> = case["vertex_weights"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(list)
        .collect();
    let r = list(&case["r"]);
    let l = [1.0 - r[0] - r[1] - r[2], r[0], r[1], r[2]];
    let xi = CellPoint((0..4).map(|i| v[i] * l[i]).sum::<Vec3>());
    let blend = Blend::new(&s, members(&cells), weights, Interpolation::Linear).unwrap();
    for (w, expected) in blend
        .weights(0, xi)
        .into_iter()
        .zip(list(&case["weights_at_r"]))
    {
        assert!((w - expected).abs() < 1e-9);
    }
    assert!((Filling::value(&blend, 0, xi) - number(&case["Phi"])).abs() < 1e-8);
}

fn kinds() -> impl Strategy<Value = Kind> {
    proptest::sample::select(vec![
        Kind::Tet4,
        Kind::Tet10,
        Kind::Hex8,
        Kind::Hex20,
        Kind::Hex27,
        Kind::Wedge6,
        Kind::Wedge18,
        Kind::Pyramid5,
        Kind::Pyramid13,
        Kind::Pyramid14,
    ])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(24)))]

    #[test]
    fn transitions_are_continuous_bounded_and_smooth_inside(kind in kinds(), seed: u64, how in 0..3) {
        let (nodes, elements) = mesh(kind, [2, 1, 2], 0.06, seed);
        let s = Scaffold::new(nodes, elements).unwrap();
        prop_assume!(s.validate().is_ok());
        let shape = kind.shape();
        let how = match how {
            0 => Interpolation::Smooth,
            1 if shape != Element::Pyramid => Interpolation::Smoothstep,
            _ => Interpolation::Linear,
        };
        let cells = [1, 2, 3].map(|i| random_cell(shape, None, seed.wrapping_add(i)));
        let mut noise = Noise::new(seed);
        let count = how.places(&s).len();
        let weights: Vec<f64> = (0..3 * count).map(|_| noise.signed() + 0.8).collect();
        prop_assume!(weights.chunks(3).all(|w| w.iter().any(|w| *w > 0.1)));
        let grading = (0..count).map(|_| 0.1 * noise.signed()).collect();
        let blend = Blend::new(&s, members(&cells), weights, how)
            .unwrap()
            .with_interpolated_volumes()
            .graded(grading)
            .unwrap();
        prop_assert!(blend.check(&s).is_ok());
        let c = certify(&s, &blend);
        prop_assert!(c.value_jump_max < 1e-9, "{:?}", c.worst);
        for e in 0..s.len() {
            let xi = cell_point(shape, &mut noise);
            let size = 0.02 + 0.2 * (noise.signed() + 1.0);
            let hull = shape.cell_box();
            let region = CellBox {
                min: xi.0.add_scalar(-size).sup(&hull.min),
                max: xi.0.add_scalar(size).inf(&hull.max),
            };
            let b = blend.bound(e, &region);
            let sup = blend.gradient_sup(e);
            let weights: f64 = blend.weights(e, xi).iter().sum();
            prop_assert!((weights - 1.0).abs() < 1e-12);
            for _ in 0..20 {
                let at = noise.vector().add_scalar(1.0) / 2.0;
                let p = CellPoint(region.min + (region.max - region.min).component_mul(&at));
                if shape.face_distance(p) > 0.0 {
                    continue;
                }
                let (value, slope) = Filling::value_and_gradient(&blend, e, p);
                prop_assert!(b.contains(value), "{value} in {b:?}");
                prop_assert!(slope.norm() <= sup, "{} {sup}", slope.norm());
            }
            let (_, slope) = Filling::value_and_gradient(&blend, e, xi);
            let h = 1e-6;
            for axis in 0..3 {
                let at = |s: f64| Filling::value(&blend, e, CellPoint(xi.0 + Vec3::ith(axis, s * h)));
                let d = (slope[axis] - (at(1.0) - at(-1.0)) / (2.0 * h)).abs();
                prop_assert!(d < 1e-4 * (1.0 + slope.norm()), "{d}");
            }
        }
    }
}

/// The share of an element that is solid, from a grid.
fn share(shape: Element, value: impl Fn(CellPoint<3>) -> f64) -> f64 {
    let hull = shape.cell_box();
    let n = 40;
    let (mut inside, mut solid) = (0, 0);
    for i in 0..n * n * n {
        let at = [i / (n * n), i / n % n, i % n].map(|i| (f64::from(i) + 0.5) / f64::from(n));
        let p = CellPoint(hull.min + (hull.max - hull.min).component_mul(&Vec3::from(at)));
        if shape.face_distance(p) <= 0.0 {
            inside += 1;
            solid += i32::from(value(p) < 0.0);
        }
    }
    f64::from(solid) / f64::from(inside)
}

#[test]
fn volumes_are_interpolated_along_a_transition() {
    for element in [Element::Hex, Element::Tet] {
        let level = |s: Surface, f: f64| {
            let cell = s.cell(element).unwrap();
            let level = cell.level_for_volume_fraction(f).unwrap();
            cell.with_solid(druse::cell::Solid::Below, level).unwrap()
        };
        let cells = [level(Surface::SchwarzP, 0.2), level(Surface::Neovius, 0.5)];
        let s = single(element);
        let weights = vec![0.5; 2 * s.nodes().len()];
        let blend = Blend::new(&s, members(&cells), weights, Interpolation::Linear)
            .unwrap()
            .with_interpolated_volumes();
        for w in [0.0, 0.125, 0.3, 0.5, 0.77, 1.0] {
            let found = share(element, |p| blend.uniform(element, &[1.0 - w, w], p));
            let expected = 0.2 * (1.0 - w) + 0.5 * w;
            assert!(
                (found - expected).abs() < 0.015,
                "{element:?} {w}: {found} {expected}"
            );
        }
    }
}

#[test]
fn bad_weights_and_elements_are_named() {
    let s = Scaffold::box_grid(Vec3::new(2.0, 1.0, 1.0), [2, 1, 1], Kind::Hex8).unwrap();
    let cells = [Surface::SchwarzP.cell(Element::Hex).unwrap()];
    let mut weights = vec![1.0; 12];
    weights[7] = -2.0;
    let e = Blend::new(&s, members(&cells), weights.clone(), Interpolation::Linear)
        .err()
        .unwrap();
    assert!(
        matches!(e, TilingError::Weights { sum, .. } if sum == 0.0),
        "{e}"
    );
    let e = Blend::new(
        &s,
        members(&cells),
        weights[..5].to_vec(),
        Interpolation::Linear,
    )
    .err()
    .unwrap();
    assert!(
        matches!(
            e,
            TilingError::WeightCount {
                found: 5,
                expected: 12
            }
        ),
        "{e}"
    );
    let whole = Blend::new(&s, members(&cells), vec![1.0; 12], Interpolation::Linear).unwrap();
    let e = whole.graded(vec![0.0; 5]).err().unwrap();
    assert!(
        matches!(e, TilingError::WeightCount { found: 5, .. }),
        "{e}"
    );
    let nine = [(); 9].map(|()| Surface::SchwarzP.cell(Element::Hex).unwrap());
    let e = Blend::new(&s, members(&nine), vec![1.0; 9 * 12], Interpolation::Linear);
    let e = e.err().unwrap();
    assert!(e.to_string().contains("at most 8"), "{e}");
    let tets = Scaffold::box_grid(Vec3::repeat(1.0), [1, 1, 1], Kind::Tet4).unwrap();
    let tets = tets.with_numbers((101..107).collect());
    let weights = vec![1.0; tets.nodes().len()];
    let blend = Blend::new(&tets, members(&cells), weights, Interpolation::Linear).unwrap();
    let e = blend.check(&tets).unwrap_err();
    assert!(
        matches!(
            e,
            TilingError::Shape {
                cell: "hex",
                number: 101,
                found: "tet"
            }
        ),
        "{e}"
    );
}

/// A blend of one cell with itself is that cell; its distances are the same.
#[test]
fn a_transition_between_equals_changes_nothing() {
    let (nodes, elements) = mesh(Kind::Hex8, [2, 1, 1], 0.1, 3);
    let s = Scaffold::new(nodes, elements).unwrap();
    let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let cells = [p.clone(), p.clone()];
    let weights = (0..2 * s.nodes().len())
        .map(|i| 0.1 + (i % 3) as f64)
        .collect();
    let blend = Blend::new(&s, members(&cells), weights, Interpolation::Smoothstep)
        .unwrap()
        .with_interpolated_volumes();
    let options = TilingOptions {
        voxel_size: 0.05,
        half_width: 0.15,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    };
    let [one, two] = [
        TiledSolid::new(&s, &p, options)
            .map(|t| sampled(&t))
            .unwrap(),
        TiledSolid::new(&s, &blend, options)
            .map(|t| sampled(&t))
            .unwrap(),
    ];
    for (a, b) in one.iter().zip(&two) {
        assert!((a - b).abs() < 1e-3 * options.half_width, "{a} {b}");
    }
    assert!(one.iter().any(|d| *d < 0.0) && one.iter().any(|d| *d > 0.0));
}

fn sampled(t: &TiledSolid) -> Vec<f64> {
    let mut noise = Noise::new(1);
    (0..300)
        .map(|_| {
            let p =
                noise.vector().component_mul(&Vec3::new(1.0, 0.5, 0.5)) + Vec3::new(1.0, 0.5, 0.5);
            t.value(druse::frame::WorldPoint(p))
        })
        .collect()
}

/// Weights with a kink in space crease the surface where they are interpolated along edges, and do
/// not where they are smooth; where they are linear, smooth ones are the same.
#[test]
fn smooth_weights_leave_no_crease() {
    let s = Scaffold::box_grid(Vec3::new(6.0, 2.0, 2.0), [6, 2, 2], Kind::Hex8).unwrap();
    let cells = [Surface::SchwarzP, Surface::Neovius].map(|c| c.cell(Element::Hex).unwrap());
    let blend = |how: Interpolation, weight: fn(f64) -> f64| {
        let places = how.places(&s);
        let weights = places.iter().flat_map(|p| [1.0 - weight(p.x), weight(p.x)]);
        Blend::new(&s, members(&cells), weights.collect(), how)
            .unwrap()
            .with_interpolated_volumes()
    };
    let kinked = |x: f64| 0.2 + 0.2 * (x - 3.0).abs().min(2.0);
    let creased = certify(&s, &blend(Interpolation::Linear, kinked));
    assert!(
        creased.crease_degrees_max > 0.5,
        "{}",
        creased.crease_degrees_max
    );
    let smooth = certify(&s, &blend(Interpolation::Smooth, kinked));
    assert!(smooth.kinds[0].crossings > 100);
    assert!(
        smooth.crease_degrees_max < 1e-4,
        "{}",
        smooth.crease_degrees_max
    );
    let linear = |x: f64| 0.1 + 0.1 * x;
    let [a, b] = [Interpolation::Linear, Interpolation::Smooth].map(|how| blend(how, linear));
    for (element, xi) in [
        (0, [0.1, 0.2, -0.3]),
        (7, [-0.4, 0.0, 0.2]),
        (23, [0.5, 0.5, 0.5]),
    ] {
        let xi = CellPoint(Vec3::from(xi));
        let difference = Filling::value(&a, element, xi) - Filling::value(&b, element, xi);
        assert!(difference.abs() < 1e-9, "{difference}");
    }
}
