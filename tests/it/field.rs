//! Laws of `field`: one suite that every world field passes, and the algebra of combinations.

mod formula;

use druse::field::{
    BoxSolid, Complement, Field, Intersection, SampleLattice, Sphere, Union, WorldField,
};
use druse::frame::{Aabb, Vec3, WorldPoint};
use proptest::prelude::*;

/// What every world field promises, checked inside `region` on a lattice of 5^3 samples:
/// bulk equals single to f32, the bound contains every sample, the gradient is the central
/// difference wherever that is smooth (its one-sided differences agree to `kink`).
pub fn assert_field_laws(field: &WorldField, region: &Aabb, tolerance: f64) {
    let step = region.size().max() / 4.0;
    let lattice = SampleLattice {
        origin: WorldPoint(region.min),
        step,
        counts: [5; 3],
    };
    let span = lattice.span();
    let bound = field.bound(&span);
    let mut bulk = vec![0f32; lattice.len()];
    field.fill(&lattice, &mut bulk);
    let scale = region.size().max() + region.max.amax() + region.min.amax();
    for (n, &filled) in bulk.iter().enumerate() {
        let p = lattice.point(n);
        let (single, gradient) = field.value_and_gradient(p);
        assert!(
            (field.value(p) - single).abs() <= tolerance * scale,
            "value {p:?}"
        );
        assert!(
            (f64::from(filled) - single).abs() <= 1e-6 * scale + tolerance,
            "bulk at {p:?}: {filled} against {single}"
        );
        let slack = tolerance * scale;
        assert!(
            bound.lo - slack <= single && single <= bound.hi + slack,
            "{single} at {p:?} outside {bound:?}"
        );
        let h = 1e-5 * scale;
        for axis in 0..3 {
            let at = |s: f64| field.value(WorldPoint(p.0 + Vec3::ith(axis, s * h)));
            let (ahead, behind) = ((at(1.0) - single) / h, (single - at(-1.0)) / h);
            if (ahead - behind).abs() < 1e-3 {
                let central = f64::midpoint(ahead, behind);
                assert!(
                    (central - gradient[axis]).abs() < 2e-3,
                    "gradient at {p:?}: {gradient:?} against {central}"
                );
            }
        }
    }
}

fn any_region() -> impl Strategy<Value = Aabb> {
    (prop::array::uniform3(-3.0..3.0), 0.05..2.0).prop_map(|(c, edge)| Aabb {
        min: Vec3::from(c),
        max: Vec3::from(c).add_scalar(edge),
    })
}

fn ball(x: f64, radius: f64) -> Box<WorldField<'static>> {
    Box::new(Sphere {
        centre: Vec3::new(x, 0.0, 0.0),
        radius,
    })
}

fn block() -> Box<WorldField<'static>> {
    Box::new(BoxSolid(Aabb {
        min: Vec3::new(-1.0, -0.5, -0.7),
        max: Vec3::new(1.5, 0.5, 0.9),
    }))
}

proptest! {
    #[test]
    fn primitives_and_combinations_keep_the_laws(region in any_region()) {
        let fields: [Box<WorldField>; 5] = [
            ball(0.3, 1.1),
            block(),
            Box::new(Union(vec![ball(0.0, 1.0), block()])),
            Box::new(Intersection(vec![ball(0.2, 1.0), block(), Box::new(Complement(ball(0.0, 0.4)))])),
            Box::new(Complement(block())),
        ];
        for field in &fields {
            assert_field_laws(field.as_ref(), &region, 1e-12);
        }
    }

    #[test]
    fn combinations_of_two_to_eight_operands_keep_the_laws(
        region in any_region(),
        balls in prop::collection::vec((-2.0..2.0f64, 0.2..2.0f64), 2..9),
    ) {
        let operands = || balls.iter().map(|(x, r)| ball(*x, *r)).collect::<Vec<_>>();
        assert_field_laws(&Union(operands()), &region, 1e-12);
        assert_field_laws(&Intersection(operands()), &region, 1e-12);
    }

    #[test]
    fn union_and_intersection_are_dual(x in -2.0..2.0f64, y in -2.0..2.0f64, z in -2.0..2.0f64) {
        let p = WorldPoint(Vec3::new(x, y, z));
        let both = Union(vec![ball(0.5, 1.0), block()]);
        let dual = Intersection(vec![
            Box::new(Complement(ball(0.5, 1.0))),
            Box::new(Complement(block())),
        ]);
        prop_assert_eq!(both.value(p), -dual.value(p));
    }
}

#[test]
fn a_box_is_its_exact_distance() {
    let unit = BoxSolid(Aabb {
        min: Vec3::repeat(-1.0),
        max: Vec3::repeat(1.0),
    });
    let at = |x, y, z| unit.value(WorldPoint(Vec3::new(x, y, z)));
    assert_eq!(at(0.0, 0.0, 0.0), -1.0);
    assert_eq!(at(3.0, 0.0, 0.5), 2.0);
    assert!((at(2.0, 3.0, 0.0) - 5f64.sqrt()).abs() < 1e-15);
}
