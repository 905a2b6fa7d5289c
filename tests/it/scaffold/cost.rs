//! What maps and boxes cost and how tight they are: printed in the long series, with wide limits
//! on tightness only (seconds depend on the machine).

use super::single;
use crate::strategy::{Noise, cell_point, element_nodes};
use druse::frame::{Aabb, CellBox};
use druse::scaffold::Kind;
use std::hint::black_box;
use std::time::Instant;

/// Nanoseconds per call.
fn time(calls: usize, mut work: impl FnMut(usize)) -> f64 {
    let start = Instant::now();
    (0..calls).for_each(&mut work);
    start.elapsed().as_secs_f64() * 1e9 / calls as f64
}

#[test]
fn cell_boxes_of_small_world_boxes_are_tight_and_cheap() {
    let long = crate::is_full();
    let calls = if long { 20_000 } else { 500 };
    for (kind, amplitude) in [
        (Kind::Tet4, 0.0),
        (Kind::Tet10, 0.04),
        (Kind::Hex8, 0.08),
        (Kind::Hex20, 0.05),
        (Kind::Hex27, 0.05),
        (Kind::Pyramid5, 0.08),
        (Kind::Pyramid13, 0.05),
        (Kind::Pyramid14, 0.05),
    ] {
        let scaffold = single(kind, &element_nodes(kind, amplitude, 11));
        let e = scaffold.element(0);
        let mut noise = Noise::new(3);
        // A leaf of 8 voxels where an edge has 80.
        let size = e.stretch().1 / 10.0;
        let places: Vec<_> = (0..calls)
            .map(|_| cell_point(kind.shape(), &mut noise))
            .collect();
        let images: Vec<_> = places.iter().map(|xi| e.map(*xi)).collect();
        let world = |i: usize| Aabb::of([images[i].0]).dilated(size / 2.0);
        let boxed = time(calls, |i| {
            black_box(e.cell_box(&world(i)));
        });
        let inverted = time(calls, |i| {
            black_box(e.inverse(images[i]).unwrap());
        });
        let mapped = time(calls, |i| {
            black_box(e.map_and_jacobian(places[i]));
        });
        let located = time(calls, |i| {
            black_box(scaffold.locate(images[i]).unwrap());
        });
        if long {
            let name = kind.name();
            println!("figure: {name} map and Jacobian, ns | {mapped:.0} | -");
            println!("figure: {name} inverse, ns | {inverted:.0} | -");
            println!("figure: {name} locate, ns | {located:.0} | -");
            println!("figure: {name} cell box of a leaf, ns | {boxed:.0} | 5000");
        }
        // Against the linear preimage of the same box around its centre, confined to the cell.
        let mut ratio = 0.0;
        for i in 0..calls {
            let found = e.cell_box(&world(i)).unwrap();
            let reach = e.jacobian(places[i]).try_inverse().unwrap().abs() * world(i).size() / 2.0;
            let linear = CellBox {
                min: places[i].0 - reach,
                max: places[i].0 + reach,
            };
            ratio += (found.max - found.min).amax() / (linear.max - linear.min).amax();
        }
        ratio /= calls as f64;
        assert!(ratio < 1.5, "{kind:?}: {ratio}");
        if long {
            println!(
                "figure: {} cell box over linear preimage | {ratio:.3} | 1.5",
                kind.name()
            );
        }
    }
}
