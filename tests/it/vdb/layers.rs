//! Layers of a build: against plain loops over dense arrays, and against closed forms.

use super::cavities::{Random, network};
use super::{cube, intersection, level_set, session};
use druse::field::{BoxSolid, Complement, Field, HalfSpace, Sphere, Union};
use druse::frame::{Aabb, Coord, Vec3, WorldPoint};
use druse::vdb::{BuildLayers, BuildRequest, LevelSet};
use std::f64::consts::PI;

/// Edge of the dense array, and half of it.
const EDGE: usize = 44;
const HALF_EDGE: i32 = 22;

type Dense = Vec<Vec<Vec<bool>>>;

/// Sections at every second plane of voxels along an axis of a lattice, from below: layers of two voxels, whose
/// mid-heights are odd.
fn dense(solid: &LevelSet, axis: usize, sign: i32) -> Dense {
    let plane = |height: i32| {
        let row = |u: usize| {
            let voxels: Vec<Coord> = (0..EDGE)
                .map(|v| {
                    let mut at = [0; 3];
                    at[axis] = sign * height;
                    at[(axis + 1) % 3] = u as i32 - HALF_EDGE;
                    at[(axis + 2) % 3] = v as i32 - HALF_EDGE;
                    Coord(at)
                })
                .collect();
            let values = solid.values(&voxels).unwrap();
            values.iter().map(|v| *v < 0.0).collect()
        };
        (0..EDGE).map(row).collect()
    };
    let all: Dense = (0..HALF_EDGE)
        .map(|n| plane(2 * n - HALF_EDGE + 1))
        .collect();
    let is_empty = |p: &Vec<Vec<bool>>| !p.iter().flatten().any(|v| *v);
    let first = all.iter().position(|p| !is_empty(p)).unwrap();
    all[first..].to_vec()
}

/// Pixels of the connected parts of a plane.
fn parts(plane: &[Vec<bool>], wanted: bool) -> Vec<Vec<[usize; 2]>> {
    let mut seen = vec![vec![false; EDGE]; EDGE];
    let mut found = Vec::new();
    for u in 0..EDGE {
        for v in 0..EDGE {
            if seen[u][v] || plane[u][v] != wanted {
                continue;
            }
            seen[u][v] = true;
            let mut part = Vec::new();
            let mut stack = vec![[u, v]];
            while let Some([a, b]) = stack.pop() {
                part.push([a, b]);
                for [c, d] in beside([a, b]) {
                    if !seen[c][d] && plane[c][d] == wanted {
                        seen[c][d] = true;
                        stack.push([c, d]);
                    }
                }
            }
            found.push(part);
        }
    }
    found
}

fn beside([a, b]: [usize; 2]) -> Vec<[usize; 2]> {
    let mut all = vec![[a + 1, b], [a, b + 1]];
    all.extend((a > 0).then(|| [a - 1, b]));
    all.extend((b > 0).then(|| [a, b - 1]));
    all.retain(|p| p[0] < EDGE && p[1] < EDGE);
    all
}

/// Area, overhanging area, islands, cups and sealed area of each layer, in pixels.
fn by_loops(planes: &Dense, overhang: f64) -> Vec<[usize; 5]> {
    let step = 2.0 * overhang.to_radians().tan();
    let lookback = (1.0 / step).ceil() as usize;
    let mut rows = Vec::new();
    for (n, plane) in planes.iter().enumerate() {
        let mut row = [0; 5];
        row[0] = plane.iter().flatten().filter(|v| **v).count();
        let lies_over = |part: &Vec<[usize; 2]>, wanted: bool| {
            n > 0 && part.iter().any(|&[a, b]| planes[n - 1][a][b] == wanted)
        };
        if n > 0 {
            let back = lookback.min(n);
            let limit = back as f64 * step + 0.5;
            let is_supported = |a: usize, b: usize| {
                let all = (0..EDGE * EDGE).map(|k| [k / EDGE, k % EDGE]);
                let mut low = all.filter(|&[c, d]| planes[n - back][c][d]);
                low.any(|[c, d]| {
                    let [x, y] = [c as f64 - a as f64, d as f64 - b as f64];
                    (x * x + y * y).sqrt() <= limit
                })
            };
            for a in 0..EDGE {
                for b in 0..EDGE {
                    let is_new = plane[a][b] && !planes[n - 1][a][b];
                    row[1] += usize::from(is_new && !is_supported(a, b));
                }
            }
            row[2] = parts(plane, true)
                .iter()
                .filter(|p| !lies_over(p, true))
                .count();
        }
        let holes = parts(plane, false);
        let is_hole = |p: &&Vec<[usize; 2]>| !p.contains(&[0, 0]);
        row[3] = holes
            .iter()
            .filter(is_hole)
            .filter(|p| !lies_over(p, false))
            .count();
        // What a flood through all layers so far does not reach from outside is sealed.
        let mut seen = vec![vec![vec![false; EDGE]; EDGE]; n + 1];
        let mut stack: Vec<[usize; 3]> = (0..=n).map(|k| [k, 0, 0]).collect();
        while let Some([k, a, b]) = stack.pop() {
            if seen[k][a][b] || planes[k][a][b] {
                continue;
            }
            seen[k][a][b] = true;
            stack.extend(beside([a, b]).into_iter().map(|[c, d]| [k, c, d]));
            stack.extend((k > 0).then(|| [k - 1, a, b]));
            stack.extend((k < n).then(|| [k + 1, a, b]));
        }
        for a in 0..EDGE {
            for b in 0..EDGE {
                row[4] += usize::from(!plane[a][b] && !seen[n][a][b]);
            }
        }
        rows.push(row);
    }
    rows
}

#[test]
fn layers_are_those_of_loops_over_dense_arrays() {
    let count = if crate::is_full() { 60 } else { 6 };
    let mut sums = [0; 5];
    for seed in 0..count {
        let solid = network(&mut Random(seed));
        let (axis, sign) = (seed as usize % 3, [1, -1][seed as usize / 3 % 2]);
        let overhang = [45.0, 20.0, 70.0][seed as usize / 2 % 3];
        let mut up = Vec3::zeros();
        up[axis] = f64::from(sign);
        let request = BuildRequest {
            up,
            layer_height: 2.0,
            overhang_angle: overhang,
        };
        let found = solid.build_layers(&request, session()).unwrap();
        let expected = by_loops(&dense(&solid, axis, sign), overhang);
        assert!(found.layers.len() <= expected.len(), "{seed}");
        for (layer, row) in found.layers.iter().zip(&expected) {
            let counts = [layer.island_count as usize, layer.cup_count as usize];
            assert_eq!(counts, [row[2], row[3]], "{seed} {axis} {sign}: {layer:?}");
            // Areas are within outlines between the pixels, so that they differ by parts of the pixels there: by less in
            // sum than along one outline.
            let areas = [layer.area, layer.overhang_area, layer.sealed_area];
            for (area, pixels) in areas.into_iter().zip([row[0], row[1], row[4]]) {
                let pixels = pixels as f64;
                let within = 6.0 + 2.5 * pixels.sqrt();
                assert!(
                    (area - pixels).abs() <= within,
                    "{seed} {axis} {sign}: {layer:?} {row:?}"
                );
            }
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum += value;
            }
        }
        assert_eq!(
            found.islands.len() as u64,
            found.layers.iter().map(|l| l.island_count).sum::<u64>()
        );
    }
    let [area, overhang, _, cups, sealed] = sums;
    assert!(area.min(overhang).min(cups).min(sealed) > 0, "{sums:?}");
}

/// A block, moved by a part of a voxel so that no face lies at a plane of voxels or at the middle of a layer.
fn block(min: [f64; 3], max: [f64; 3]) -> Box<dyn Field<Point = WorldPoint>> {
    let place = |c: [f64; 3]| Vec3::from(c) + Vec3::new(0.25, 0.25, 0.3);
    Box::new(BoxSolid(Aabb {
        min: place(min),
        max: place(max),
    }))
}

fn built(solid: &LevelSet, up: Vec3, layer: f64, overhang: f64) -> BuildLayers {
    let request = BuildRequest {
        up,
        layer_height: layer,
        overhang_angle: overhang,
    };
    solid.build_layers(&request, session()).unwrap()
}

fn total(found: &BuildLayers, value: fn(&druse::vdb::LayerFacts) -> f64) -> f64 {
    found.layers.iter().map(value).sum()
}

#[test]
fn a_mushroom_a_bowl_and_a_hanging_block_have_their_closed_forms() {
    // A cap of 24 x 24 on a stem of 8 x 8; voxels of 0.5, layers of a third of a voxel.
    let mushroom = Union(vec![
        block([-4.0, -4.0, 0.0], [4.0, 4.0, 10.0]),
        block([-12.0, -12.0, 10.0], [12.0, 12.0, 14.0]),
    ]);
    let solid = level_set(&mushroom, cube(15.0), 0.5);
    let found = built(&solid, Vec3::z(), 1.0 / 6.0, 45.0);
    assert_eq!((found.islands.len(), found.cups.len()), (0, 0));
    // A strip of one step around the stem is supported.
    let exact = 24.0 * 24.0 - 9.0 * 9.0;
    let area = total(&found, |l| l.overhang_area);
    assert!((area / exact - 1.0).abs() < 0.05, "{area} {exact}");
    let volume = total(&found, |l| l.area) / 6.0;
    assert!((volume / (640.0 + 2304.0) - 1.0).abs() < 0.03, "{volume}");
    // Upside down it stands on its cap.
    let found = built(&solid, -Vec3::z(), 1.0 / 6.0, 45.0);
    assert_eq!(
        (total(&found, |l| l.overhang_area), found.islands.len()),
        (0.0, 0)
    );

    // A box with a pocket from above, a tube on the plate, and a block in the air.
    let parts = Union(vec![
        block([-12.0, -12.0, 0.0], [-2.0, -2.0, 10.0]),
        block([2.0, 2.0, 0.0], [12.0, 12.0, 10.0]),
        block([2.0, -12.0, 4.0], [12.0, -2.0, 8.0]),
    ]);
    let holes = Complement(Box::new(Union(vec![
        block([-9.0, -9.0, 3.0], [-5.0, -5.0, 20.0]),
        block([5.0, 5.0, -20.0], [9.0, 9.0, 20.0]),
    ])));
    let solid = level_set(&intersection(parts, holes), cube(15.0), 0.5);
    let found = built(&solid, Vec3::z(), 0.25, 45.0);
    let places: Vec<[f64; 3]> = found.islands.iter().map(|s| s.place.into()).collect();
    assert_eq!(found.islands.len(), 1, "{places:?}");
    assert!(
        (places[0][2] - 4.0).abs() < 0.5 && places[0][0] > 2.0,
        "{places:?}"
    );
    assert!((found.islands[0].area - 100.0).abs() < 12.0);
    assert_eq!(found.cups.len(), 2, "{:?}", found.cups);
    // The plate closes the tube, the box its pocket.
    assert!(found.cups[0].place.z.abs() < 0.5 && (found.cups[1].place.z - 3.0).abs() < 0.5);
    let sealed = found
        .layers
        .iter()
        .map(|l| l.sealed_area)
        .fold(0.0, f64::max);
    assert!((sealed - 32.0).abs() < 6.0, "{sealed}");
    // The block is the only part in the air.
    assert!((total(&found, |l| l.overhang_area) - 100.0).abs() < 12.0);
    // On its side the pocket and the tube are open.
    assert_eq!(built(&solid, Vec3::x(), 0.25, 45.0).layers[0].cup_count, 0);
}

#[test]
fn areas_are_those_of_boxes_on_the_voxels_and_beside_them() {
    // Offsets of the faces from planes of voxels, in parts of a voxel of 0.2.
    for offset in [0.0, 0.01, 0.25, 0.45, 0.77] {
        let shift = Vec3::repeat(0.2 * offset);
        let slab = |min: [f64; 3], max: [f64; 3]| -> Box<dyn Field<Point = WorldPoint>> {
            Box::new(BoxSolid(Aabb {
                min: Vec3::from(min) + shift,
                max: Vec3::from(max) + shift,
            }))
        };
        let parts = Union(vec![
            slab([-5.0, -5.0, 0.0], [5.0, 5.0, 4.0]),
            slab([-8.0, -8.0, 4.0], [8.0, 8.0, 8.0]),
            slab([10.0, -2.0, 5.0], [13.0, 1.0, 7.0]),
        ]);
        // A cup from above, and its sealed lower end.
        let hole = Complement(slab([-2.0, -2.0, 2.0], [2.0, 2.0, 20.0]));
        let solid = level_set(&intersection(parts, hole), cube(14.0), 0.2);
        let found = built(&solid, Vec3::z(), 0.2, 45.0);
        let at = |height: f64| {
            let number = ((height + shift.z) / 0.2).floor() as i64;
            found.layers.iter().find(|l| l.number == number).unwrap()
        };
        let near = |area: f64, exact: f64, part: f64| {
            assert!(
                (area / exact - 1.0).abs() < part,
                "{offset}: {area} {exact}"
            );
        };
        near(at(1.0).area, 100.0, 2e-3);
        near(at(3.0).area, 84.0, 3e-3);
        near(at(6.0).area, 256.0 - 16.0 + 9.0, 2e-3);
        near(at(6.0).sealed_area, 16.0, 0.01);
        // Layers at a face have it with the voxels' own error near edges.
        near(found.islands[0].area, 9.0, 0.15);
        near(found.cups[0].area, 16.0, 0.12);
        // Of the overhang the strip of one step is supported; the first layer of the slab has rounded edges.
        let overhang = total(&found, |l| l.overhang_area);
        near(overhang, 256.0 - 10.4 * 10.4 + 9.0, 0.08);
    }
}

#[test]
fn walls_need_support_beyond_the_angle_only() {
    // A block that leans by 45 degrees over x > 0: z > x.
    let lean = |slope: f64| {
        let half = HalfSpace {
            point: Vec3::zeros(),
            normal: Vec3::new(1.0, 0.0, -slope).normalize(),
        };
        let whole = BoxSolid(Aabb {
            min: Vec3::new(-10.0, -8.0, 0.0),
            max: Vec3::new(10.0, 8.0, 10.0),
        });
        level_set(&intersection(whole, half), cube(12.0), 0.5)
    };
    for (layer, slope) in [(0.1, 1.0), (0.5, 1.0), (1.3, 1.0), (0.2, 0.5)] {
        let solid = lean(slope);
        let angle = f64::atan(slope).to_degrees();
        let steep = total(&built(&solid, Vec3::z(), layer, angle + 8.0), |l| {
            l.overhang_area
        });
        let shallow = total(
            &built(&solid, Vec3::z(), layer, (angle - 20.0).max(2.0)),
            |l| l.overhang_area,
        );
        assert!(steep < 2.0, "{layer} {slope}: {steep}");
        // The leaning wall is 16 wide. Of each step over the layer below, the part within the angle is supported, and
        // half a pixel, which is half a voxel.
        let exact = 16.0 * 10.0 * slope;
        let admitted = (angle - 20.0).max(2.0).to_radians().tan();
        assert!(
            shallow > 0.8 * (exact - 160.0 * admitted) && shallow < 1.1 * exact,
            "{layer} {slope}: {shallow} {exact}"
        );
    }
}

#[test]
fn any_direction_is_up() {
    let ball = Sphere {
        centre: Vec3::new(1.3, -0.4, 2.1),
        radius: 9.0,
    };
    let solid = level_set(&ball, cube(14.0), 0.5);
    for up in [[1.0, 2.0, 3.0], [-1.0, 0.2, 0.0], [0.0, -1.0, 1.0]] {
        let up = Vec3::from(up).normalize();
        let found = built(&solid, up, 0.3, 45.0);
        let volume = 0.3 * total(&found, |l| l.area);
        assert!(
            (volume / (4.0 / 3.0 * PI * 729.0) - 1.0).abs() < 0.01,
            "{volume}"
        );
        assert_eq!((found.islands.len(), found.cups.len()), (0, 0), "{up}");
        let greatest = found
            .layers
            .iter()
            .max_by(|a, b| a.area.total_cmp(&b.area))
            .unwrap();
        assert!((greatest.area / (PI * 81.0) - 1.0).abs() < 0.01);
        let middle = 0.3 * (greatest.number as f64 + 0.5);
        assert!((middle - ball.centre.dot(&up)).abs() < 1.5, "{middle}");
        // The lower cap beyond 45 degrees: its projection is a disc of half the area.
        let area = total(&found, |l| l.overhang_area);
        // A strip of a pixel around what lies below is missing.
        assert!((0.5..1.1).contains(&(area / (PI * 40.5))), "{area}");
    }
}
