//! Merges of one plan at the same time, and plans that are made twice.

use super::stops::{done, druse, hash, place, refused};
use std::fs;
use std::path::Path;
use std::process::Child;

/// Plans the part in bricks of two blocks and makes all of them.
fn planned(place: &Path) {
    done(place, "plan r.toml -o p.json --bricks 2");
    done(place, "run p.json --brick 0-7");
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_second_merge_is_refused_while_one_works() {
    let place = place();
    let place = place.path();
    planned(place);
    let bricks = place.join("p.bricks");
    let before = names(&bricks);
    // The lock of a merge, held as by another program.
    let lock = fs::File::create(bricks.join("lock")).unwrap();
    lock.lock().unwrap();
    let (code, error) = refused(place, "merge p.json");
    assert_eq!(code, 73, "{error}");
    assert!(error.contains("another run uses these bricks"), "{error}");
    assert!(!place.join("a.vdb").exists());
    // A brick that is there may be requested meanwhile.
    done(place, "run p.json --brick 3");
    drop(lock);
    done(place, "merge p.json");
    assert_eq!(names(&bricks), before, "bricks stay, and nothing else");
}

#[test]
fn merges_at_once_are_refused_or_right() {
    let place = place();
    let place = place.path();
    done(place, "run r.toml --out whole");
    planned(place);
    let bricks = place.join("p.bricks");
    let before = names(&bricks);
    for _ in 0..2 {
        let begin = |_| druse(place, "merge p.json --quiet").spawn().unwrap();
        let all: Vec<Child> = (0..3).map(begin).collect();
        let mut succeeded = 0;
        for child in all {
            let output = child.wait_with_output().unwrap();
            let error = String::from_utf8(output.stderr).unwrap();
            match output.status.code() {
                Some(0) => succeeded += 1,
                Some(73) => assert!(error.contains("another run"), "{error}"),
                code => panic!("{code:?}: {error}"),
            }
        }
        assert!(succeeded > 0);
        assert_eq!(hash(place, "a.vdb"), hash(place, "whole/a.vdb"));
        assert_eq!(names(&bricks), before);
    }
}

#[test]
fn a_merge_beside_a_brick_that_is_made_names_it_or_is_right() {
    let place = place();
    let place = place.path();
    done(place, "run r.toml --out whole");
    planned(place);
    for _ in 0..2 {
        fs::remove_file(place.join("p.bricks/brick-000005.leaves")).unwrap();
        let job = druse(place, "run p.json --brick 0-7").spawn().unwrap();
        let merged = druse(place, "merge p.json").output().unwrap();
        let made = job.wait_with_output().unwrap();
        assert!(made.status.success(), "{made:?}");
        let error = String::from_utf8(merged.stderr).unwrap();
        match merged.status.code() {
            Some(0) => {}
            Some(65) => assert!(error.contains("missing: 5"), "{error}"),
            code => panic!("{code:?}: {error}"),
        }
        done(place, "merge p.json");
        assert_eq!(hash(place, "a.vdb"), hash(place, "whole/a.vdb"));
    }
}

#[test]
fn runs_at_once_with_the_same_bricks_are_refused_or_right() {
    let place = place();
    let place = place.path();
    done(place, "run r.toml --out whole");
    for _ in 0..2 {
        let begin = |_| {
            druse(place, "run r.toml --bricks 2 --quiet")
                .spawn()
                .unwrap()
        };
        let all: Vec<Child> = (0..3).map(begin).collect();
        let codes = all.into_iter().map(|child| {
            let output = child.wait_with_output().unwrap();
            let error = String::from_utf8(output.stderr).unwrap();
            let code = output.status.code();
            assert!(matches!(code, Some(0 | 73)), "{code:?}: {error}");
            code == Some(0)
        });
        assert!(codes.filter(|is_done| *is_done).count() > 0);
        assert_eq!(hash(place, "a.vdb"), hash(place, "whole/a.vdb"));
        assert!(!place.join(".a.vdb.bricks").exists());
    }
}

#[test]
fn plans_of_the_same_input_are_the_same_bytes() {
    let place = place();
    let place = place.path();
    fs::write(
        place.join("s.toml"),
        "druse = 1\nunit = \"mm\"\n[cell.c]\nsurface = \"gyroid\"\nelement = \"hex\"\n\
         [scaffold]\nbox = { size = [6, 6, 6], cell_size = 1 }\n[tiling]\ncell = \"c\"\n[band]\nvoxel_size = 0.05\n\
         [[op]]\nintersect = { mesh = \"whole/a.stl\" }\n[[output]]\nvdb = \"b.vdb\"\n",
    )
    .unwrap();
    done(place, "run r.toml --out whole");
    for recipe in ["r.toml", "s.toml"] {
        let plan = |name: &str| {
            done(place, &format!("plan {recipe} -o {name}"));
            fs::read(place.join(name)).unwrap()
        };
        let first = plan("p.json");
        let again = if crate::is_full() { 3 } else { 1 };
        for name in ["q.json", "r.json", "s.json"].into_iter().take(again) {
            assert_eq!(plan(name), first, "{recipe}, {name}");
        }
    }
}
