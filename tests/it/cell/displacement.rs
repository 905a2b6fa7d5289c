//! Laws of tables made for voxels: how far they displace the surface, and what they leave out.

use super::{pairings, random_cell};
use crate::strategy::Noise;
use druse::cell::{
    Cell, FitOptions, Join, Placement, Skeleton, Solid, Source, Surface, Table, fit_source,
};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::progress::Silent;

/// A strut cell as recipes make it.
fn struts(element: Element, graph: &str, band_limit: f64) -> Cell {
    let skeleton = Skeleton::graph(element, graph, 0.08).unwrap();
    let source = Source::skeleton(element, &skeleton, &Placement::Reference).unwrap();
    let options = FitOptions {
        band_limit,
        measure: false,
        ..FitOptions::default()
    };
    fit_source("struts", element, &source, &options, &Silent).unwrap()
}

/// Points of a cell's surface in its element, with the slopes there.
fn surface(cell: &Cell, count: usize) -> Vec<(CellPoint<3>, f64)> {
    let mut noise = Noise::new(7);
    let mut found = Vec::new();
    while found.len() < count {
        let mut p = noise.vector() * 0.6;
        if cell.value(CellPoint(p)).abs() > 0.05 * cell.gamma() {
            continue;
        }
        for _ in 0..5 {
            let (v, g) = cell.value_and_gradient(CellPoint(p));
            p -= g * (v / g.norm_squared());
        }
        let p = CellPoint(p);
        let (v, g) = cell.value_and_gradient(p);
        if v.abs() < 1e-9 && cell.element().face_distance(p) <= 0.0 {
            found.push((p, g.norm()));
        }
    }
    found
}

#[test]
fn tables_displace_the_surface_by_at_most_the_tolerance() {
    const TOLERANCE: f64 = 0.01;
    let sheet = Surface::Neovius.cell(Element::Hex).unwrap();
    let cells = [
        struts(Element::Tet, "cross", 8.0),
        struts(Element::Hex, "octet", 10.0),
        sheet.with_solid(Solid::Sheet, 0.8).unwrap(),
        Surface::SchwarzP.cell(Element::Tet).unwrap(),
    ];
    let mut large = 0;
    for cell in cells {
        let points = surface(&cell, 500);
        let whole = Table::new(&cell).unwrap();
        let mut bytes = Vec::new();
        for voxels in [15.0, 60.0, 400.0] {
            let table = Table::for_displacement(&cell, TOLERANCE / voxels).unwrap();
            assert!(table.displacement().unwrap() <= TOLERANCE / voxels);
            let (mut sum, mut most) = (0.0, 0f64);
            for &(p, slope) in &points {
                let off = table.value(p) - cell.value(p);
                assert!(off.abs() <= table.error_bound());
                let off = off.abs() * voxels / slope.max(0.25 * cell.gamma());
                sum += off * off;
                most = most.max(off);
            }
            let rms = (sum / points.len() as f64).sqrt();
            let name = format!("{} in {voxels}: {most} {rms}", cell.element().name());
            // These are other points than the table was tried at: where the greatest is, they miss by
            // a fifth or so.
            assert!(most <= 1.25 * TOLERANCE && rms <= 0.5 * TOLERANCE, "{name}");
            bytes.push(table.bytes());
        }
        assert!(bytes.is_sorted() && bytes[0] <= whole.bytes(), "{bytes:?}");
        if cell.expression().exponentials() > 1000 {
            assert!(4 * bytes[1] <= whole.bytes(), "{bytes:?}");
            large += 1;
        }
    }
    assert!(large > 0);
}

#[test]
fn the_mean_square_is_the_sum_over_waves() {
    let numbers: Vec<_> = (0..12)
        .map(|n| (f64::from(n).sin(), f64::from(n).cos()))
        .collect();
    let mut count = 0;
    for pairing in pairings() {
        let cell = random_cell(pairing, 5.5, &numbers, Solid::Below, 0.1);
        let table = Table::for_displacement(&cell, 0.02).unwrap();
        if table.is_direct() {
            continue;
        }
        // Over many periods, whatever these are.
        let (mut noise, mut sum) = (Noise::new(5), 0.0);
        for _ in 0..4000 {
            let p = CellPoint(noise.vector() * 50.0);
            sum += (table.value(p) - cell.value(p)).powi(2);
        }
        let found = (sum / 4000.0).sqrt();
        let estimated = table.error_rms();
        // The mean over turned points takes away some of what aliases add, never more.
        let share = found / estimated;
        assert!((0.5..1.1).contains(&share), "{pairing:?}: {share}");
        count += u32::from(share > 0.9);
    }
    assert!(count > 3);
}

#[test]
fn waves_that_are_left_out_go_by_whole_orbits() {
    let band_limit = if crate::is_full() { 20.0 } else { 14.0 };
    for cell in [
        struts(Element::Tet, "cross", 12.0),
        struts(Element::Wedge, "edges", band_limit),
    ] {
        let table = Table::for_displacement(&cell, 0.03).unwrap();
        assert!(table.dropped() > 0 && table.dropped() < cell.expression().exponentials());
        let mut noise = Noise::new(3);
        for _ in 0..100 {
            let p = noise.vector();
            let (v, g) = cell.value_and_gradient(CellPoint(p));
            let (w, h) = table.value_and_gradient(CellPoint(p));
            assert!((v - w).abs() <= table.error_bound());
            assert!((g - h).amax() <= table.gradient_error_bound());
            for q in cell.operators() {
                let image = table.value(CellPoint(q * p));
                assert!((image - w).abs() < 3e-6 * cell.gamma(), "an orbit was torn");
            }
        }
    }
    // Nothing is left out, and next to nothing is off, where nothing may be.
    let parts = [Surface::SchwarzP, Surface::Iwp].map(|s| s.cell(Element::Hex).unwrap());
    let union = Cell::joined("union", Join::Union, &[&parts[0], &parts[1]], 0.1).unwrap();
    let best = Table::for_displacement(&union, 0.0).unwrap();
    assert!(best.dropped() == 0 && best.displacement().unwrap() < 4e-6 && best.samples() < 160);
}
