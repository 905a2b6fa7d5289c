//! Laws of the `.cell` file.

use super::{any_cell, any_point};
use druse::cell::{Cell, FitOptions, Series, Surface, fit};
use druse::field::Field;
use druse::frame::Element;
use druse::io::{Place, read_cell, write_cell};
use druse::progress::Silent;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(24)))]

    #[test]
    fn reading_undoes_writing(cell in any_cell(), p in any_point()) {
        let text = cell.to_json();
        let back = Cell::from_json(&text).unwrap();
        prop_assert_eq!(
            back.series().map(Series::coefficients),
            cell.series().map(Series::coefficients)
        );
        prop_assert_eq!(
            back.planar().map(Series::coefficients),
            cell.planar().map(Series::coefficients)
        );
        prop_assert_eq!((back.group(), back.operators()), (cell.group(), cell.operators()));
        prop_assert_eq!(back.value(p), cell.value(p));
        prop_assert_eq!(back.gamma(), cell.gamma());
        prop_assert_eq!(back.to_json(), text);
    }

    #[test]
    fn mutated_files_give_a_cell_or_one_error(at in 0usize..400, byte in 0u8..128, cut in 0usize..600) {
        let mut text = Surface::Iwp.cell(Element::Tet).unwrap().to_json().into_bytes();
        let n = text.len();
        text[at % n] = byte;
        text.truncate(n - cut % n.min(200));
        if let Ok(text) = String::from_utf8(text)
            && let Err(e) = Cell::from_json(&text) {
                prop_assert!(!e.reason.is_empty());
            }
    }
}

#[test]
fn files_keep_the_report() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("ball.cell");
    let options = FitOptions {
        band_limit: 3.0,
        ..FitOptions::default()
    };
    let ball = fit(
        "a \"ball\"",
        Element::Hex,
        &|p| p.0.norm() - 0.3,
        &options,
        &Silent,
    )
    .unwrap();
    let bytes = write_cell(&path, &ball).unwrap();
    assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
    let back = read_cell(&path).unwrap();
    assert_eq!(back.report(), ball.report());
    assert_eq!(back.name(), ball.name());
    assert_eq!(back.to_json(), ball.to_json());
}

#[test]
fn errors_name_the_line() {
    let text = Surface::Iwp.cell(Element::Hex).unwrap().to_json();
    let line_with =
        |text: &str, what: &str| 1 + text.lines().position(|l| l.contains(what)).unwrap();
    for (from, to, words, on) in [
        (
            "druse-cell",
            "druse-sell",
            "unknown format \"druse-sell\"",
            "druse-sell",
        ),
        (
            "\"version\": 1",
            "\"version\": 2",
            "version 2",
            "\"version\"",
        ),
        (
            "\"hex\"",
            "\"hax\"",
            "tri, quad, tet, hex, wedge, pyramid",
            "\"hax\"",
        ),
        ("\"hex\"", "\"tet\"", "expected Td", "\"group\""),
        ("\"Oh\"", "\"Ih\"", "not crystallographic", "\"group\""),
        ("[2, 0, 0]", "[2, 0, -1.5]", "i32", "-1.5"),
        ("[2, 0, 0]", "[0, 1, 1]", "listed twice", "[0, 1, 1]"),
        (
            "[-0.5, 0.0]",
            "[-0.5, 0.25]",
            "must be 0, found 0.25",
            "0.25",
        ),
        ("[-0.5, 0.0]", "[-0.5, 1e999]", "out of range", "1e999"),
        (
            "\"below\"",
            "\"beneath\"",
            "below, above, sheet or channels",
            "beneath",
        ),
        ("\"below\"", "\"sheet\"", "positive", "\"level\""),
        (
            "\"gamma\": ",
            "\"gamma\": -",
            "expected a number between 1e-18 and 1e18",
            "\"gamma\"",
        ),
        (
            "\"gamma\": ",
            "\"gamma\": 1e-308, \"x\": ",
            "expected a number between 1e-18 and 1e18",
            "\"gamma\"",
        ),
        (
            "\"face_normal\"",
            "\"face_nomal\"",
            "unknown field `face_nomal`",
            "face_nomal",
        ),
        (
            "[0.0, 1.0, 0.0]",
            "[0.0, 0.0, 1.0]",
            "volume",
            "\"lattice\"",
        ),
        (
            "[0.0, 1.0, 0.0]",
            "[0.0, 1.5, 0.0]",
            "expected cubic",
            "\"lattice\"",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let broken = text.replacen(from, to, 1);
        let error = Cell::from_json(&broken).unwrap_err();
        assert!(error.reason.contains(words), "{to}: {error}");
        assert_eq!(error.line, Some(line_with(&broken, on)), "{to}: {error}");
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("broken.cell");
    std::fs::write(&path, text.replace("[2, 0, 0]", "[0, 1, 1]")).unwrap();
    let error = read_cell(&path).unwrap_err();
    assert!(matches!(error.place(), Place::Line(n) if n > 1), "{error}");
    assert!(read_cell(directory.path().join("none.cell")).is_err());
    std::fs::write(&path, [0xff, 0xfe]).unwrap();
    assert!(read_cell(&path).is_err());
}
