//! A wish to stop: heard in every long call, soon, and with nothing half-done.

use super::{Stop, THREADS, ball, session, sphere, volume};
use druse::progress::Progress;
use druse::vdb::{LevelSet, Session, VdbError};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[test]
fn stopping_ends_a_filter_within_two_seconds() {
    // Half a minute of work.
    let mut s = sphere(50.0, 0.25);
    let stop = Stop(AtomicBool::new(false));
    let (cancelled_at, ended) = std::thread::scope(|scope| {
        let cancelled_at = scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(300));
            stop.0.store(true, Ordering::Relaxed);
            Instant::now()
        });
        let result = s.gaussian(2, 20, Session::new(&THREADS, &stop));
        assert!(matches!(result, Err(VdbError::Cancelled(_))), "{result:?}");
        (cancelled_at.join().unwrap(), Instant::now())
    });
    let late = ended.saturating_duration_since(cancelled_at);
    assert!(late < Duration::from_secs(2), "{late:?}");
    // Empty, not half-done; and OpenVDB's next loop runs as if nothing had happened.
    assert_eq!(s.active_voxels().unwrap(), 0);
    let mut other = sphere(10.0, 0.5);
    other.dilate(1.0, session()).unwrap();
    let found = (volume(&other) / ball(1.0)).cbrt();
    assert!((found - 11.0).abs() < 0.1, "{found}");
}

#[test]
fn every_long_call_listens() {
    let stop = Stop(AtomicBool::new(true));
    let stopped = Session::new(&THREADS, &stop);
    let s = sphere(10.0, 0.5);
    let cancelled = |r: Result<(), VdbError>| matches!(r, Err(VdbError::Cancelled(_)));
    let on_copy = |op: &dyn Fn(&mut LevelSet) -> Result<(), VdbError>| {
        cancelled(op(&mut s.duplicate().unwrap()))
    };
    assert!(on_copy(&|s| s.dilate(3.0, stopped)));
    assert!(on_copy(&|s| s.mean(1, 1, stopped)));
    assert!(on_copy(&|s| s.renormalise(3, stopped)));
    assert!(on_copy(&|s| s.keep_largest(stopped).map(drop)));
    // Without the merging of contacts a union is half-made.
    let mut union = s.duplicate().unwrap();
    assert!(cancelled(union.union(sphere(12.0, 0.5), stopped)));
    assert_eq!(union.active_voxels().unwrap(), 0);
    assert!(cancelled(s.to_mesh(stopped).map(drop)));
    assert!(cancelled(s.picture(100, 80, None, stopped).map(drop)));
    assert!(cancelled(s.check(stopped).map(drop)));
    let mesh = s.to_mesh(session()).unwrap();
    let from_mesh = LevelSet::from_mesh(&mesh, s.transform(), 3.0, stopped);
    assert!(cancelled(from_mesh.map(drop)));
    assert!(s.active_voxels().unwrap() > 0);
}

#[test]
fn a_panic_in_the_callback_cancels() {
    struct Panics;
    impl Progress for Panics {
        fn stage(&self, _: &str, _: Option<u64>) {}
        fn advance(&self, _: u64) {}
        fn cancelled(&self) -> bool {
            std::panic::panic_any("not from here into C++")
        }
    }
    let mut s = sphere(6.0, 0.5);
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        s.dilate(1.0, Session::new(&THREADS, &Panics))
    }));
    // The panic does not cross C++; called again on this side, it may surface.
    assert!(result.is_err() || result.is_ok_and(|r| r.is_err()));
}
