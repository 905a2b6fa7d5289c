//! Lists of frames, tokens in names, and the clock of formulas.

use druse::field::Formula;
use druse::recipe::Recipe;
use druse::sequence::{Clock, FrameList, expand, frames_on_disk, nearest_frames, without_token};

#[test]
fn lists_of_frames_are_read_and_written() {
    for (text, frames, shown) in [
        ("7", vec![7], "7"),
        ("1001-1004", vec![1001, 1002, 1003, 1004], "1001-1004"),
        ("1,5,9-20x5", vec![1, 5, 9, 14, 19], "1,5,9,14,19"),
        ("-2-1", vec![-2, -1, 0, 1], "-2-1"),
        ("-4--2", vec![-4, -3, -2], "-4--2"),
        ("1-3x9", vec![1], "1"),
    ] {
        let list: FrameList = text.parse().unwrap();
        assert_eq!(list.frames(), frames, "{text}");
        assert_eq!(list.to_string(), shown);
    }
    for (text, words) in [
        ("1-9x0", "a step of 0"),
        ("1-9x-2", "a step of -2"),
        ("9-1", "runs backwards"),
        ("5,3", "expected frames in rising order"),
        ("1-5,5-7", "expected frames in rising order"),
        ("", "expected frames such as"),
        ("1-", "expected frames such as"),
        ("1.5", "expected frames such as"),
        ("0-2000000000", "at most 100000"),
    ] {
        let error = text.parse::<FrameList>().unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn tokens_are_replaced_by_the_frame() {
    for (text, frame, name) in [
        ("a.$F4.vdb", 12, "a.0012.vdb"),
        ("a.$F.vdb", 12, "a.12.vdb"),
        ("a_####.vdb", 12, "a_0012.vdb"),
        ("a.%04d.vdb", 12345, "a.12345.vdb"),
        ("%d/a.%d", 3, "3/a.3"),
        ("a.$F4.vdb", -3, "a.-0003.vdb"),
        ("$F3/a.###", 3, "003/a.003"),
    ] {
        assert_eq!(expand(text, frame).unwrap().as_deref(), Some(name));
    }
    for text in ["a.vdb", "a#1.vdb", "100 %.vdb", "$FPS.vdb", "$HIP/a.vdb"] {
        assert_eq!(expand(text, 1).unwrap(), None, "{text}");
    }
    for digits in ["13", "99999999999999999999999"] {
        assert!(expand(&format!("a.$F{digits}.vdb"), 1).is_err(), "{digits}");
    }
    let error = expand("$F4/a.###.vdb", 1).unwrap_err().to_string();
    assert!(error.contains("$F4 and ###, which disagree"), "{error}");
    assert_eq!(without_token("part.$F4.vdb"), "part.vdb");
    assert_eq!(without_token("part_####.vdb"), "part.vdb");
}

#[test]
fn frames_of_a_series_are_found_on_disk() {
    let place = tempfile::tempdir().unwrap();
    for name in [
        "b.0009.vtu",
        "b.0010.vtu",
        "b.12345.vtu",
        "b.11.vtu",
        "c.0001.vtu",
        "b.0003.obj",
    ] {
        std::fs::write(place.path().join(name), "").unwrap();
    }
    let frames = frames_on_disk(&place.path().join("b.$F4.vtu"));
    assert_eq!(frames, [9, 10, 12345]);
    assert_eq!(nearest_frames(&frames, 11), (Some(10), Some(12345)));
    assert_eq!(nearest_frames(&frames, 1), (None, Some(9)));
}

#[test]
fn the_clock_is_that_of_houdini() {
    let clock = Clock {
        frame: 13,
        fps: 24.0,
    };
    assert_eq!(clock.time(), 0.5);
    let f = Formula::with_constants("x + frame + 2*time + fps", &["x"], &clock.constants());
    assert_eq!(f.unwrap().value(&[1.0]), 1.0 + 13.0 + 1.0 + 24.0);
    let error = Formula::parse("frame", &["x"]).unwrap_err().to_string();
    assert!(error.contains("one of the variables x"), "{error}");
}

#[test]
fn recipes_have_a_frame() {
    let text = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { mesh = \"in.$F4.stl\" }\n[[output]]\nvdb = \"a.####.vdb\"\n";
    let recipe = Recipe::parse(text, &["frame=7".into()]).unwrap();
    assert_eq!(
        recipe.clock(),
        Clock {
            frame: 7,
            fps: 24.0
        }
    );
    let named = recipe.sections().output[0].named();
    assert_eq!(named[0].1.to_str(), Some("a.0007.vdb"));
    assert_eq!(
        recipe.source().template("op.0.union.mesh"),
        Some("in.$F4.stl")
    );
    for (set, words) in [
        ("output.0.vdb=$F4/a.$F2.vdb", "which disagree"),
        ("fps=0", "fps"),
        ("frame=1.5", "frame"),
    ] {
        let error = Recipe::parse(text, &[set.into()]).unwrap_err();
        let shown = format!("{error} {:?}", error.place);
        assert!(shown.contains(words), "{set}: {shown}");
    }
}
