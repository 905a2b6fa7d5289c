//! Saving from the live page where the file cannot be completed.

use super::super::limits::limited;
use super::super::{BALL, Place};
use super::Served;
use std::fs;

#[test]
fn a_recipe_that_cannot_be_completed_leaves_no_name() {
    // Longer than the file that the system allows.
    let place = Place::with(&format!("{}{BALL}", "# a long comment\n".repeat(400)));
    let served = Served::of(&place, &mut limited("ulimit -f 4", &["view", "r.toml"]));
    served.at_rest();
    for _ in 0..2 {
        let (status, body) = served.post("save", "copy.toml");
        let text = String::from_utf8(body).unwrap();
        assert_eq!(status, 422, "{text}");
        assert!(
            text.contains("copy.toml") && text.contains("too large"),
            "{text}"
        );
        assert_eq!(place.files(), ["r.toml"]);
    }
    served.quit();
    let served = Served::new(&place, &["view", "r.toml"]);
    served.at_rest();
    assert_eq!(served.post("save", "copy.toml").0, 200);
    assert_eq!(served.post("save", "copy.toml").0, 409);
    let [own, copy] =
        ["r.toml", "copy.toml"].map(|name| fs::read(place.0.path().join(name)).unwrap());
    assert!(own == copy);
    served.quit();
}
