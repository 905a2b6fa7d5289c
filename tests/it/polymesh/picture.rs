//! Pictures: what is hidden does not show, what shows has the colours of its groups.

use druse::frame::Vec3;
use druse::polymesh::{PolyMesh, group_color, seed};
use std::collections::BTreeSet;

const SIZE: (usize, usize) = (120, 90);

fn picture(mesh: &PolyMesh) -> Vec<[u8; 4]> {
    let bytes = mesh.picture(SIZE.0, SIZE.1).unwrap();
    let pixels = bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]);
    pixels.collect()
}

/// The mesh with the faces that look along a direction in another group.
fn with_group(mesh: &PolyMesh, along: [f64; 3], group: u32) -> PolyMesh {
    let towards = |f: usize| mesh.normal(f).dot(&Vec3::from(along)) > 0.5;
    let groups = (0..mesh.face_count()).map(|f| if towards(f) { group } else { 1 });
    mesh.clone().with_groups(groups.collect())
}

#[test]
fn a_convex_solid_shows_the_faces_that_look_at_the_eye() {
    let cube = seed::platonic("cube", 1.0).unwrap();
    let plain = picture(&cube);
    assert_eq!(plain.len(), SIZE.0 * SIZE.1);
    let white = plain.iter().filter(|p| **p == [255; 4]).count();
    assert!(
        white > plain.len() / 8 && white < plain.len() * 3 / 4,
        "{white}"
    );
    assert_eq!(plain[0], [255; 4]);
    for axis in 0..3 {
        let mut along = [0.0; 3];
        along[axis] = -1.0;
        // The eye is where x, y and z are positive: those that look away do not show.
        assert!(
            picture(&with_group(&cube, along, 2)) == plain,
            "axis {axis}"
        );
        along[axis] = 1.0;
        let changed = picture(&with_group(&cube, along, 2));
        let share = changed.iter().zip(&plain).filter(|(a, b)| a != b).count();
        assert!(share > plain.len() / 20, "axis {axis}: {share}");
    }
    // Three faces, three shades, and the edges between.
    let mut shades: Vec<usize> = Vec::new();
    for color in plain.iter().collect::<BTreeSet<_>>() {
        shades.push(plain.iter().filter(|p| *p == color).count());
    }
    shades.sort_unstable();
    let four: usize = shades.iter().rev().take(4).sum();
    assert!(four > plain.len() * 9 / 10, "{four}");
}

#[test]
fn pictures_do_not_depend_on_size_or_place() {
    let cube = seed::platonic("dodecahedron", 1.0).unwrap();
    let moved = cube
        .mapped(|v| 4.0 * v + Vec3::new(64.0, -32.0, 8.0))
        .unwrap();
    let (a, b) = (picture(&cube), picture(&moved));
    let off = a.iter().zip(&b).filter(|(a, b)| a != b).count();
    assert!(off < a.len() / 200, "{off}");
}

#[test]
fn groups_have_colours_apart() {
    for a in 1..13u32 {
        for b in 1..a {
            let (p, q) = (group_color(a), group_color(b));
            let apart = (0..3).map(|k| (p[k] - q[k]).abs()).fold(0.0, f64::max);
            assert!(apart > 0.1, "groups {a} and {b}: {apart}");
        }
    }
}
