//! Hexes, wedges, pyramids and tets in one mesh, with cells that agree on the faces they share.

use crate::strategy::{Noise, elevated, mixed};
use druse::cell::{
    Cell, FitOptions, Skeleton, Solid, Source, Surface, Table, fit_matched, fit_source,
};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::progress::Silent;
use druse::scaffold::{Kind, Neighbour, Scaffold};
use druse::tiling::{
    Blend, CellField, Certificate, Filling, Interpolation, Member, TilingError, certify,
};
use proptest::prelude::*;

const SHAPES: [Element; 4] = [Element::Hex, Element::Wedge, Element::Tet, Element::Pyramid];

/// A mesh of one kind, renumbered at random.
fn alike(kind: Kind, seed: u64) -> Scaffold {
    let (nodes, elements) = crate::strategy::mesh(kind, [2, 2, 2], 0.05, seed);
    Scaffold::new(nodes, elements).unwrap()
}

fn filled<'a, C: CellField>(s: &'a Scaffold, cells: &'a [C]) -> Blend<'a, C> {
    let member = Member {
        name: "own".into(),
        cells: cells.iter().collect(),
    };
    Blend::new(
        s,
        vec![member],
        vec![1.0; s.nodes().len()],
        Interpolation::Linear,
    )
    .unwrap()
}

fn certified<C: CellField>(s: &Scaffold, cells: &[C]) -> Certificate {
    let blend = filled(s, cells);
    blend.check(s).unwrap();
    certify(s, &blend)
}

fn options(band_limit: f64) -> FitOptions {
    FitOptions {
        band_limit,
        samples: 12,
        measure: false,
        ..FitOptions::default()
    }
}

/// Struts along every edge, fitted for each element by itself.
fn struts(band_limit: f64) -> Vec<Cell> {
    let fitted = SHAPES.map(|element| {
        let skeleton = Skeleton::graph(element, "edges", 0.12 * element.edge()).unwrap();
        let place = druse::cell::Placement::Reference;
        let source = Source::skeleton(element, &skeleton, &place).unwrap();
        let own = options(band_limit / element.edge());
        fit_source("edges", element, &source, &own, &Silent).unwrap()
    });
    fitted.to_vec()
}

#[test]
fn cells_of_a_mixed_mesh_meet_once_they_are_matched() {
    let s = mixed(0.08, 3);
    let cells = struts(5.0);
    let torn = filled(&s, &cells).check(&s);
    assert!(
        matches!(torn, Err(TilingError::Discontinuity { .. })),
        "{torn:?}"
    );
    let before = certify(&s, &filled(&s, &cells)).value_jump_max;
    let matched = fit_matched(&cells, &options(5.0), &Silent).unwrap();
    let c = certified(&s, &matched);
    assert!(
        c.value_jump_max < 1e-9 && before > 1e-2,
        "{} from {before}",
        c.value_jump_max
    );
    assert!(c.kinds.iter().all(|k| k.crossings > 0) && c.kinds.len() == 2);
    // The same on curved elements: what neighbours of second order share is one curved face.
    for full in [true, false] {
        let s = elevated(&s, full, 0.08, 6);
        assert!(s.validate().unwrap().warnings().is_empty());
        let c = certified(&s, &matched);
        assert!(c.value_jump_max < 1e-9, "{full} {}", c.value_jump_max);
    }
    let tables: Vec<Table> = matched
        .iter()
        .map(|c| Table::with_tolerance(c, 2e-5).unwrap())
        .collect();
    let c = certified(&s, &tables);
    assert!(c.value_jump_max < 1e-5, "{}", c.value_jump_max);
    for (own, cell) in matched.iter().zip(&cells) {
        let (rms, share) = (
            own.report().unwrap().rms,
            own.volume_fraction() - cell.volume_fraction(),
        );
        assert!(
            rms < 0.02 && share.abs() < 0.03,
            "{:?} {rms} {share}",
            own.element()
        );
    }
}

/// Every point of a shared face, by the map of either element, is one point.
#[test]
fn curved_faces_of_a_mixed_mesh_have_one_geometry_from_both_sides() {
    for (full, seed) in [(true, 1), (false, 2), (true, 3), (false, 4)] {
        let s = elevated(&mixed(0.1, seed), full, 0.16, seed);
        let mut noise = Noise::new(seed);
        let mut met = std::collections::BTreeSet::new();
        for f in (0..s.len()).flat_map(|e| s.faces_of(e)) {
            let Neighbour::Face(g) = s.neighbour(f) else {
                continue;
            };
            let (e, other) = (s.element(f.element as usize), s.element(g.element as usize));
            met.insert([e.kind(), other.kind()]);
            // The same shares of the corners, whatever their order, in both cells.
            let corners = e.kind().faces()[f.face as usize].corners;
            let turned = |n: u8| {
                let own = e.nodes()[usize::from(n)];
                let place = other.nodes().iter().position(|&m| m == own).unwrap();
                other.kind().reference_nodes()[place].0
            };
            for _ in 0..10 {
                let [u, v] = [0; 2].map(|_| f64::midpoint(noise.signed(), 1.0));
                let shares = if corners.len() == 3 {
                    [(1.0 - u) * (1.0 - v), u * (1.0 - v), v, 0.0]
                } else {
                    [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v]
                };
                let reference = e.kind().reference_nodes();
                let own = corners.iter().zip(shares);
                let here: Vec3 = own
                    .clone()
                    .map(|(&n, w)| reference[usize::from(n)].0 * w)
                    .sum();
                let there: Vec3 = own.map(|(&n, w)| turned(n) * w).sum();
                let gap = (e.map(CellPoint(here)).0 - other.map(CellPoint(there)).0).norm();
                assert!(gap < 1e-12, "{:?} {:?} {gap}", e.kind(), other.kind());
            }
        }
        let pyramid = if full {
            Kind::Pyramid14
        } else {
            Kind::Pyramid13
        };
        let hex = if full { Kind::Hex27 } else { Kind::Hex20 };
        assert!(met.contains(&[pyramid, hex]) && met.contains(&[pyramid, Kind::Tet10]));
    }
}

#[test]
fn wedges_and_pyramids_meet_among_themselves_once_they_are_matched() {
    for (kind, seed) in [(Kind::Wedge6, 1), (Kind::Pyramid5, 2)] {
        let s = alike(kind, seed);
        let own = Surface::SchwarzP.cell(kind.shape());
        let cell = own
            .unwrap_or_else(|_| struts(5.0).swap_remove(if kind == Kind::Wedge6 { 1 } else { 3 }));
        let sheet = cell.clone().sheet(0.2).unwrap();
        for cell in [cell, sheet] {
            let matched = fit_matched(std::slice::from_ref(&cell), &options(5.0), &Silent).unwrap();
            assert!(certified(&s, &matched).value_jump_max < 1e-9, "{kind:?}");
            assert_eq!(
                matched[0].solid() == Solid::Sheet,
                cell.solid() == Solid::Sheet
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4))]

    /// Of whatever elements, face-normal or not.
    #[test]
    fn matched_cells_are_continuous(seed: u64, amplitude in 0.0..0.1f64, face_normal: bool) {
        let s = mixed(amplitude, seed);
        let own = FitOptions { face_normal, ..options(4.0) };
        let random = SHAPES.map(|e| crate::certificate::random_cell(e, None, seed));
        let matched = fit_matched(&random, &own, &Silent);
        // Unlike cells may have no surface in common.
        let Ok(matched) = matched else { return Ok(()) };
        prop_assert!(certified(&s, &matched).value_jump_max < 1e-9);
        for cell in &matched {
            let residual = cell.report().unwrap().face_normal_residual;
            prop_assert!(residual < 1e-9 || !face_normal, "{}", residual);
        }
    }
}

#[test]
fn what_cannot_be_matched_is_refused() {
    let plane = Surface::SchwarzP
        .cell(Element::Quad)
        .or_else(|_| Surface::SchwarzP.cell(Element::Tri));
    if let Ok(plane) = plane {
        assert!(fit_matched(&[plane], &options(4.0), &Silent).is_err());
    }
    let hex = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let other = struts(3.0).swap_remove(1).sheet(0.1).unwrap();
    let e = fit_matched(&[hex.clone(), other], &options(4.0), &Silent).unwrap_err();
    assert!(e.to_string().contains("same side"), "{e}");
    let e = fit_matched(std::slice::from_ref(&hex), &options(60.0), &Silent).unwrap_err();
    assert!(e.to_string().contains("band limit"), "{e}");
    assert!(fit_matched(&[], &options(4.0), &Silent).unwrap().is_empty());
    // One hex cell is what it was: nothing forbids its own trace.
    let same = fit_matched(std::slice::from_ref(&hex), &options(1.0), &Silent).unwrap();
    for p in [Vec3::new(0.1, 0.2, 0.3), Vec3::new(-0.4, 0.0, 0.25)].map(CellPoint) {
        let wanted = Field::value(&hex, p) / hex.gamma();
        assert!(
            (Field::value(&same[0], p) - wanted).abs() < 1e-3,
            "{} {wanted}",
            Field::value(&same[0], p)
        );
    }
}
