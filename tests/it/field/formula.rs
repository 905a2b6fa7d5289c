//! Laws of formulas: what a text means, and that no text does harm.

use druse::field::Formula;
use proptest::prelude::*;

const NAMES: [&str; 3] = ["x", "y", "z"];

fn value(text: &str, at: [f64; 3]) -> f64 {
    Formula::parse(text, &NAMES)
        .unwrap_or_else(|e| panic!("{text}: {e}"))
        .value(&at)
}

#[test]
fn operators_bind_as_on_paper() {
    let at = [2.0, 3.0, 5.0];
    let expected = [
        ("1 + 2*3", 7.0),
        ("(1 + 2)*3", 9.0),
        ("8/4/2", 1.0),
        ("10 - 4 - 3", 3.0),
        ("2^3^2", 512.0),
        ("-2^2", -4.0),
        ("2^-1", 0.5),
        ("x**2", 4.0),
        ("2*-x", -4.0),
        ("x - -y", 5.0),
        ("1.5e-2*x", 0.03),
        (".5*x", 1.0),
        ("min(x, min(y, z))", 2.0),
        ("min(5, min(4, 3) + 2) + 10", 15.0),
        ("max(x, y, z, 4)", 5.0),
        ("hypot(x, y, 6)", 7.0),
        ("clamp(z, 0, 1) + mix(x, y, 0.25)", 3.25),
        ("smoothstep(0, 1, 0.5)", 0.5),
        ("step(3, x) + step(3, y)", 1.0),
        ("mod(-1, 3)", 2.0),
        ("atan2(1, 1) * 4 / pi", 1.0),
        ("ln(e) + sign(-x) + cos(tau)", 1.0),
        ("abs(-x)^2 + sqrt(4*y + 4)", 8.0),
    ];
    for (text, exact) in expected {
        let found = value(text, at);
        assert!((found - exact).abs() < 1e-14, "{text}: {found} {exact}");
    }
}

#[test]
fn errors_say_where_and_what() {
    let deep = format!("{}x{}", "(".repeat(200), ")".repeat(200));
    let long = format!("x{}", "+x".repeat(5000));
    for (text, column, word) in [
        ("", 1, "a number"),
        ("x +", 4, "the end"),
        ("x y", 3, "an operator"),
        ("2 * (x + 1", 11, ")"),
        ("r^2", 1, "x, y, z"),
        ("sine(x)", 1, "sinh"),
        ("sin(x, y)", 1, "1 argument"),
        ("min(x)", 1, "2 or more"),
        ("1.2.3", 1, "a number such as"),
        ("x + \u{3b1}", 5, "variables"),
        (&deep, 0, "nesting"),
        (&long, 1, "4096"),
    ] {
        let e = Formula::parse(text, &NAMES).unwrap_err();
        assert!(column == 0 || e.column == column, "{text}: {e}");
        assert!(e.to_string().contains(word), "{text}: {e}");
    }
}

proptest! {
    #[test]
    fn no_text_does_harm(text in "[xyz0-9.e()+*/^, -]{0,60}|\\PC{0,30}") {
        if let Ok(f) = Formula::parse(&text, &NAMES) {
            let _ = f.value(&[0.1, -2.0, 3.0]);
        }
    }

    #[test]
    fn a_sum_of_products_is_itself(a in -9.0..9.0f64, b in -9.0..9.0f64, c in 0.1..9.0f64) {
        let text = format!("{a:.6}*x + ({b:.6})/{c:.6} - y^2*z");
        let round = |v: f64| format!("{v:.6}").parse::<f64>().unwrap();
        let exact = round(a) * 2.0 + round(b) / round(c) - 9.0 * 5.0;
        prop_assert!((value(&text, [2.0, 3.0, 5.0]) - exact).abs() < 1e-9);
    }
}
