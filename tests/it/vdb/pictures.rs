//! Pictures: what they show, not how it looks.

use super::{complement, cube, intersection, level_set, session, sphere};
use druse::field::{BoxSolid, Sphere};
use druse::frame::{Transform, Vec3};
use druse::vdb::{Image, LevelSet, Picture};

fn pixel(image: &Image, x: usize, y: usize) -> [u8; 4] {
    let n = 4 * (y * image.width + x);
    image.rgba[n..n + 4].try_into().unwrap()
}

#[test]
fn a_sphere_fills_the_frame_but_for_its_margin() {
    let s = sphere(10.0, 0.5);
    for perspective in [false, true] {
        let picture = Picture {
            width: 120,
            height: 90,
            perspective,
            transparent: true,
            ..Picture::default()
        };
        let image = s.render(&picture, session()).unwrap();
        assert_eq!(pixel(&image, 0, 0), [0; 4]);
        assert_eq!(pixel(&image, 60, 45)[3], 255);
        let covered = image.rgba.chunks(4).filter(|p| p[3] > 127).count();
        // A disc that leaves a twentieth of the height free on both sides; the first look, by which the
        // frame is fitted, has coarse pixels.
        let share = covered as f64 / (120.0 * 90.0);
        let disc = std::f64::consts::PI / 4.0 * (0.9 * 90.0f64).powi(2) / (120.0 * 90.0);
        assert!((share / disc - 1.0).abs() < 0.15, "{share} {disc}");
        // Light comes from above.
        let sum = |p: [u8; 4]| p[..3].iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(sum(pixel(&image, 60, 30)) > sum(pixel(&image, 60, 65)) + 60);
        assert_eq!(image, s.render(&picture, session()).unwrap());
    }
}

#[test]
fn a_cut_opens_the_side_of_the_eye() {
    let hollow = intersection(
        BoxSolid(cube(8.0)),
        complement(Sphere {
            centre: Vec3::zeros(),
            radius: 6.0,
        }),
    );
    let s = level_set(&hollow, cube(8.0), 0.25);
    let picture = Picture {
        width: 160,
        height: 120,
        cut: Some((1, 0.0)),
        ..Picture::default()
    };
    let reddish = |image: &Image| {
        let red = |p: &&[u8]| p[0] > p[2].saturating_add(40);
        image.rgba.chunks(4).filter(red).count()
    };
    let whole = Picture {
        cut: None,
        ..picture
    };
    assert_eq!(reddish(&s.render(&whole, session()).unwrap()), 0);
    let cut = s.render(&picture, session()).unwrap();
    assert!(reddish(&cut) > 1000, "{}", reddish(&cut));
}

#[test]
fn sizes_and_cuts_out_of_range_are_refused() {
    let s = sphere(5.0, 1.0);
    assert!(s.picture(0, 10, None, session()).is_err());
    assert!(s.picture(1 << 20, 1 << 20, None, session()).is_err());
    assert!(s.picture(10, 10, Some((3, 0.0)), session()).is_err());
    assert!(s.picture(10, 10, Some((0, f64::NAN)), session()).is_err());
    let png = s.picture(33, 21, Some((2, 0.5)), session()).unwrap();
    let reader = png::Decoder::new(std::io::Cursor::new(png))
        .read_info()
        .unwrap();
    assert_eq!((reader.info().width, reader.info().height), (33, 21));
    let nothing = LevelSet::empty(Transform::new(1.0).unwrap(), 3.0, session()).unwrap();
    let blank = nothing.render(&Picture::default(), session()).unwrap();
    assert!(blank.rgba.iter().all(|&c| c == 255));
}
