//! Long series: what the cells cost and how well they meet real sources (`DRUSE_FULL=1`).

use super::at;
use druse::cell::{FitOptions, Surface, Table, fit};
use druse::field::Field;
use druse::frame::{CellBox, CellPoint, Element, Vec3};
use druse::progress::Silent;
use std::hint::black_box;
use std::time::Instant;

/// Time this thread spent on a core, in nanoseconds: other programs do not count.
fn on_core() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let first = text.split(' ').next().and_then(|n| n.parse().ok());
    first.unwrap_or_default()
}

/// Nanoseconds per call of a function on points along a line through the element: the least of
/// several batches, since a shared machine only ever adds.
fn nanoseconds(mut call: impl FnMut(CellPoint<3>)) -> f64 {
    const CALLS: usize = 400_000;
    let batch = |b: usize| {
        let start = on_core();
        for n in 0..CALLS {
            let t = (n + b * CALLS) as f64 / 4000.0;
            call(at(t - t.floor() - 0.5, 0.31 * t, 0.17 * t));
        }
        (on_core() - start) / CALLS as f64
    };
    (0..8).map(batch).fold(f64::INFINITY, f64::min)
}

fn struts(p: CellPoint<3>) -> f64 {
    let ends = Element::Tet.vertices();
    let reach = |v: Vec3| (p.0 - v * (p.0.dot(&v) / v.norm_squared()).clamp(0.0, 1.0)).norm();
    ends.into_iter().map(reach).fold(f64::INFINITY, f64::min) - 0.08
}

#[test]
fn costs() {
    if !crate::is_full() {
        return;
    }
    let start = Instant::now();
    let cell = fit(
        "struts",
        Element::Tet,
        &struts,
        &FitOptions::default(),
        &Silent,
    )
    .unwrap();
    println!(
        "figure: fit with 258 unknowns, measured | {:.2} s | ",
        start.elapsed().as_secs_f64()
    );
    let start = Instant::now();
    let large = FitOptions {
        band_limit: 14.9,
        measure: false,
        ..FitOptions::default()
    };
    let many = fit("struts", Element::Tet, &struts, &large, &Silent).unwrap();
    println!(
        "figure: fit with {} unknowns | {:.2} s | 5 s",
        many.report().unwrap().degrees_of_freedom,
        start.elapsed().as_secs_f64()
    );
    let start = Instant::now();
    let table = Table::new(&cell).unwrap();
    println!(
        "figure: table of {}^3 samples, {} MiB | {:.2} s | ",
        table.samples(),
        table.bytes() >> 20,
        start.elapsed().as_secs_f64()
    );
    println!(
        "figure: error bound of the table over its gamma | {:.1e} | ",
        table.error_bound() / table.gradient_rms()
    );
    println!(
        "figure: gradient bound over the element | {:.3} | ",
        table.gradient_sup()
    );
    let show = |what: &str, ns: f64, goal: &str| println!("figure: {what} | {ns:.1} ns | {goal}");
    show(
        "exact value, 258 unknowns",
        nanoseconds(|p| {
            black_box(cell.value(p));
        }),
        "",
    );
    show(
        "table value",
        nanoseconds(|p| {
            black_box(table.value(p));
        }),
        "",
    );
    show(
        "table value and gradient",
        nanoseconds(|p| {
            black_box(table.value_and_gradient(p));
        }),
        "40 ns",
    );
    let p = Table::new(&Surface::SchwarzP.cell(Element::Hex).unwrap()).unwrap();
    show(
        "small table value and gradient",
        nanoseconds(|q| {
            black_box(p.value_and_gradient(q));
        }),
        "40 ns",
    );
    for edge in [0.02, 0.1, 0.2, 0.5, 1.0] {
        let region = |p: CellPoint<3>| CellBox {
            min: p.0,
            max: p.0.add_scalar(edge),
        };
        show(
            &format!("table bound, box of edge {edge}"),
            nanoseconds(|p| {
                black_box(table.bound(&region(p)));
            }),
            "",
        );
        // How much wider than the values on a grid the bound is.
        let (mut wide, mut true_wide) = (0.0, 0.0);
        for n in 0..40 {
            let t = f64::from(n) * 0.0731;
            let b = region(at(t - t.floor() - 0.5, 0.4 * t - 0.5, 0.1 * t - 0.3));
            let bound = table.bound(&b);
            let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
            for i in 0..9 {
                for j in 0..9 {
                    for k in 0..9 {
                        let v = table.value(CellPoint(
                            b.min
                                + Vec3::new(f64::from(i), f64::from(j), f64::from(k))
                                    * (edge / 8.0),
                        ));
                        lo = v.min(lo);
                        hi = v.max(hi);
                    }
                }
            }
            wide += bound.hi - bound.lo;
            true_wide += hi - lo;
        }
        println!(
            "figure: width of the bound over the values' own, edge {edge} | {:.2} | ",
            wide / true_wide
        );
    }
}
