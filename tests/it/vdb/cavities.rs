//! Cavities: escape radii against closed forms, and against a flood with a heap on dense voxels.

use super::{cube, intersection, level_set, session};
use druse::field::{BoxSolid, Complement, Field, Sphere, Union};
use druse::frame::{Coord, Vec3, WorldPoint};
use druse::vdb::{Cavity, LevelSet};
use std::collections::{BTreeMap, BinaryHeap};

type Solid = Box<dyn Field<Point = WorldPoint>>;

fn ball(centre: [f64; 3], radius: f64) -> Solid {
    Box::new(Sphere {
        centre: centre.into(),
        radius,
    })
}

fn block(min: [f64; 3], max: [f64; 3]) -> Solid {
    let (min, max) = (Vec3::from(min), Vec3::from(max));
    Box::new(BoxSolid(druse::frame::Aabb { min, max }))
}

/// A cube of the given half edge without some solids, at voxels of 1.
fn cube_without(half_edge: f64, solids: Vec<Solid>) -> LevelSet {
    let hole = Complement(Box::new(Union(solids)));
    let whole = BoxSolid(cube(half_edge));
    level_set(&intersection(whole, hole), cube(half_edge), 1.0)
}

/// The cavity whose deepest point is near a point.
fn at(list: &[Cavity], place: [f64; 3]) -> Cavity {
    let distance = |c: &&Cavity| (Vec3::from(c.place.0.map(f64::from)) - Vec3::from(place)).norm();
    let nearest = list
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let nearest = nearest.unwrap_or_else(|| panic!("no cavity for {place:?}"));
    assert!(distance(&nearest) < 3.0, "{place:?}: {nearest:?}");
    *nearest
}

#[test]
fn a_room_with_a_square_duct_lets_out_a_ball_of_half_its_width() {
    // A room of 21^3, and a duct of 7 x 7 to the side.
    let solid = cube_without(
        30.0,
        vec![
            block([-10.5; 3], [10.5; 3]),
            block([0.0, -3.5, -3.5], [40.0, 3.5, 3.5]),
        ],
    );
    let found = solid.cavities(32, session()).unwrap();
    assert_eq!(
        (found.list.len(), found.closed(), found.limit),
        (1, 0, 32.0)
    );
    let room = found.list[0];
    assert!((room.escape_radius - 3.5).abs() < 0.1, "{room:?}");
    assert!((room.radius - 10.5).abs() < 0.1, "{room:?}");
    assert!((0.97..1.12).contains(&(room.volume / 9261.0)), "{room:?}");
    let throat = room.throat.unwrap();
    assert!((7..32).contains(&throat[0]), "{room:?}");
}

#[test]
fn a_labyrinth_of_three_rooms_has_the_least_of_its_doors() {
    // Rooms of 17^3 in a row: doors of 6 and 10 between them, a door of 8 to the outside.
    let room = |x: f64| block([x - 8.5, -8.5, -8.5], [x + 8.5, 8.5, 8.5]);
    let door = |x: f64, width: f64| {
        let half = width / 2.0;
        block([x, -half, -half], [x + 10.0, half, half])
    };
    let solid = cube_without(
        40.0,
        vec![
            room(-22.0),
            room(0.0),
            room(22.0),
            door(-16.0, 6.0),
            door(6.0, 10.0),
            door(28.0, 8.0),
            door(32.0, 8.0),
        ],
    );
    let found = solid.cavities(32, session()).unwrap();
    // The room at the end lets out a ball of 3; the two others, with a wider door between them, of 4.
    assert_eq!(found.list.len(), 2, "{found:#?}");
    let [inner, outer] = [found.list[0], found.list[1]];
    assert!((inner.escape_radius - 3.0).abs() < 0.1, "{inner:?}");
    assert!((outer.escape_radius - 4.0).abs() < 0.1, "{outer:?}");
    assert!((0.95..1.1).contains(&(inner.volume / 4913.0)), "{inner:?}");
    assert!((0.95..1.2).contains(&(outer.volume / 9826.0)), "{outer:?}");
}

#[test]
fn a_funnel_lets_out_a_ball_of_its_neck() {
    // A room of radius 10, and a channel that narrows to a radius of 3 at x = 16 and widens outwards.
    let channel = (8..=40).map(|x| {
        let x = f64::from(x);
        ball([x, 0.0, 0.0], 3.0 + (x - 16.0).abs() / 4.0)
    });
    let solids = channel.chain([ball([0.0; 3], 10.0)]).collect();
    let found = cube_without(30.0, solids).cavities(32, session()).unwrap();
    assert_eq!((found.list.len(), found.closed()), (1, 0), "{found:#?}");
    let room = found.list[0];
    assert!((room.escape_radius - 3.0).abs() < 0.3, "{room:?}");
    assert!((room.radius - 10.0).abs() < 0.3, "{room:?}");
    let throat = room.throat.unwrap();
    assert!((14..=18).contains(&throat[0]), "{room:?}");
}

#[test]
fn closed_cavities_are_the_voids_and_tubes_and_wide_bays_are_open() {
    // Two closed balls, a straight tube of radius 5 through the cube, and a bay that widens outwards.
    let tube = (-40..=40).map(|z| ball([18.0, 18.0, f64::from(z)], 5.0));
    let funnel = (0..30).map(|n| {
        let t = f64::from(n);
        ball([-18.0, -18.0, 10.0 + t], 3.0 + t / 3.0)
    });
    let mut holes: Vec<Solid> = tube.chain(funnel).collect();
    holes.push(ball([-15.0, 15.0, 0.0], 6.0));
    holes.push(ball([15.0, -15.0, 0.0], 4.0));
    let solid = cube_without(30.0, holes);
    let found = solid.cavities(32, session()).unwrap();
    let voids = solid.voids(session()).unwrap();
    assert_eq!((found.list.len(), found.closed()), (2, 2), "{found:#?}");
    for (cavity, void) in found.list.iter().zip(&voids) {
        assert_eq!((cavity.voxels, cavity.escape_radius), (void.voxels, 0.0));
    }
    let large = at(&found.list, [-15.0, 15.0, 0.0]);
    assert!((large.radius - 6.0).abs() < 0.3, "{large:?}");
}

/// Rooms that are wider than what is measured, on several blocks of voxels: a closed one, and one with a bore.
#[test]
fn rooms_wider_than_the_reach_have_their_volume_and_their_bore() {
    let holes = |bore: f64| {
        vec![
            ball([-50.0, 3.0, 5.0], 40.0),
            ball([50.0, 0.0, 0.0], 35.0),
            block([50.0, -bore, -bore], [120.0, bore, bore]),
        ]
    };
    for reach in [8, 9, 16, 21] {
        let solid = cube_without(100.0, holes(5.5));
        let found = solid.cavities(reach, session()).unwrap();
        let limit = f64::from(reach);
        assert_eq!((found.list.len(), found.closed()), (2, 1), "{found:#?}");
        let [closed, bored] = [found.list[0], found.list[1]];
        let void = solid.voids(session()).unwrap()[0];
        assert_eq!((closed.voxels, closed.radius), (void.voxels, limit));
        assert!((bored.escape_radius - 5.5).abs() < 0.1, "{bored:?}");
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 35f64.powi(3);
        assert!((0.97..1.05).contains(&(bored.volume / volume)), "{bored:?}");
    }
    // A bore as wide as the reach is no throat.
    let found = cube_without(100.0, holes(9.0))
        .cavities(8, session())
        .unwrap();
    assert_eq!((found.list.len(), found.closed()), (1, 1), "{found:#?}");
}

/// Three rooms in small blocks that beams connect, at several places on the grid of blocks: most of the void is open,
/// and the rest of it is measured.
#[test]
fn rooms_far_apart_are_found_wherever_they_lie() {
    let rooms_at = |shift: [f64; 3]| {
        let moved = |p: [f64; 3]| [0, 1, 2].map(|a| p[a] + shift[a]);
        let part = |min, max| block(moved(min), moved(max));
        let solids = vec![
            part([-130.0, -20.0, -20.0], [-90.0, 20.0, 20.0]),
            part([-20.0, 40.0, -20.0], [20.0, 80.0, 20.0]),
            part([90.0, -20.0, 10.0], [130.0, 20.0, 50.0]),
            part([-100.0, -4.0, -4.0], [100.0, 4.0, 4.0]),
            part([-4.0, 0.0, -4.0], [4.0, 50.0, 4.0]),
            part([92.0, -4.0, -4.0], [100.0, 4.0, 20.0]),
        ];
        let holes = vec![
            ball(moved([-110.0, 0.0, 0.0]), 12.0),
            ball(moved([0.0, 60.0, 0.0]), 12.0),
            part([-4.5, 60.0, -4.5], [4.5, 90.0, 4.5]),
            ball(moved([110.0, 0.0, 30.0]), 12.0),
            part([107.5, -2.5, 30.0], [112.5, 2.5, 60.0]),
        ];
        let field = intersection(Union(solids), Complement(Box::new(Union(holes))));
        let extent = druse::frame::Aabb {
            min: moved([-140.0, -30.0, -30.0]).into(),
            max: moved([140.0, 90.0, 60.0]).into(),
        };
        let found = level_set(&field, extent, 1.0);
        let voids = found.voids(session()).unwrap();
        (found.cavities(16, session()).unwrap(), voids)
    };
    let first = rooms_at([0.0; 3]).0;
    for shift in [[0.0; 3], [37.0, -51.0, 90.0], [64.0, 64.0, -64.0]] {
        let (found, voids) = rooms_at(shift);
        assert_eq!((found.list.len(), found.closed()), (3, 1), "{found:#?}");
        for ((c, other), escape) in found.list.iter().zip(&first.list).zip([0.0, 2.5, 4.5]) {
            assert!((c.escape_radius - escape).abs() < 0.1, "{shift:?}: {c:?}");
            assert!((c.radius - 12.0).abs() < 0.3, "{shift:?}: {c:?}");
            let share = c.voxels as f64 / other.voxels as f64;
            assert!((0.98..1.02).contains(&share), "{shift:?}: {c:?} {other:?}");
        }
        assert_eq!(found.list[0].voxels, voids[0].voxels);
    }
}

/// Numbers that look random (splitmix64).
pub(super) struct Random(pub u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A cube with balls cut out, some of them linked by channels.
pub(super) fn network(random: &mut Random) -> LevelSet {
    let mut holes: Vec<Solid> = Vec::new();
    let mut centres: Vec<[f64; 3]> = Vec::new();
    for _ in 0..7 {
        let centre = [0; 3].map(|_| random.within(-10.0, 10.0));
        holes.push(ball(centre, random.within(1.5, 4.5)));
        centres.push(centre);
    }
    for _ in 0..6 {
        let pick = |random: &mut Random| centres[(random.unit() * 7.0) as usize];
        let from = pick(random);
        let to = if random.unit() < 0.4 {
            [0; 3].map(|_| random.within(-20.0, 20.0))
        } else {
            pick(random)
        };
        let radius = random.within(0.8, 3.0);
        for n in 0..=60 {
            let t = f64::from(n) / 60.0;
            holes.push(ball(
                [0, 1, 2].map(|a| from[a] + t * (to[a] - from[a])),
                radius,
            ));
        }
    }
    cube_without(14.0, holes)
}

/// Voxels along an edge of the dense grid, and half of it.
const DENSE_EDGE: usize = 48;
const DENSE_HALF: i32 = 24;
const REACH: f64 = 8.0;
/// Greatest excess of a distance, voxels.
const DISTANCE_TOLERANCE: f64 = 0.3;

fn neighbours(n: usize) -> impl Iterator<Item = usize> {
    [DENSE_EDGE * DENSE_EDGE, DENSE_EDGE, 1]
        .into_iter()
        .flat_map(move |step| {
            let at = n / step % DENSE_EDGE;
            let before = (at > 0).then(|| n - step);
            let after = (at + 1 < DENSE_EDGE).then(|| n + step);
            before.into_iter().chain(after)
        })
}

fn dense_voxel(n: usize) -> Coord {
    let at = [
        n / (DENSE_EDGE * DENSE_EDGE),
        n / DENSE_EDGE % DENSE_EDGE,
        n % DENSE_EDGE,
    ];
    Coord(at.map(|c| c as i32 - DENSE_HALF))
}

/// Steps from a voxel to others: along edges of the lattice, and along all edges of the six tetrahedra around the
/// diagonal of a cube of eight voxels.
const LATTICE_EDGES: [[i32; 3]; 3] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const TETRAHEDRA_EDGES: [[i32; 3]; 7] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, 0, 1],
    [0, 1, 1],
    [1, 1, 1],
];

/// Distances of all void voxels by comparison with every point of the surface on some edges; -1 in the solid.
fn dense_distances(solid: &LevelSet, edges: &[[i32; 3]]) -> Vec<f64> {
    let voxels: Vec<Coord> = (0..DENSE_EDGE.pow(3)).map(dense_voxel).collect();
    let values = solid.values(&voxels).unwrap();
    let mut bins: BTreeMap<[i32; 3], Vec<Vec3>> = BTreeMap::new();
    for (n, &v) in values.iter().enumerate() {
        for &[x, y, z] in edges {
            let beside = voxels[n].offset(x, y, z);
            let at = beside.0.map(|c| (c + DENSE_HALF) as usize);
            if at.iter().any(|c| *c >= DENSE_EDGE) {
                continue;
            }
            let m = (at[0] * DENSE_EDGE + at[1]) * DENSE_EDGE + at[2];
            if (values[m] < 0.0) == (v < 0.0) {
                continue;
            }
            let [p, q] = [n, m].map(|k| Vec3::from(voxels[k].0.map(f64::from)));
            let t = f64::from(v.abs() / (v.abs() + values[m].abs()));
            let point = p + t * (q - p);
            let bin: [i32; 3] = point.map(|c| (c / REACH).floor() as i32).into();
            bins.entry(bin).or_default().push(point);
        }
    }
    let distance = |(&voxel, &v): (&Coord, &f32)| {
        if v < 0.0 {
            return -1.0;
        }
        let p = Vec3::from(voxel.0.map(f64::from));
        let bin = p.map(|c| (c / REACH).floor() as i32);
        let mut least = REACH;
        for k in 0..27 {
            let near = [bin.x + k / 9 - 1, bin.y + k / 3 % 3 - 1, bin.z + k % 3 - 1];
            for q in bins.get(&near).into_iter().flatten() {
                least = least.min((q - p).norm());
            }
        }
        least
    };
    voxels.iter().zip(&values).map(distance).collect()
}

/// The escape radius of every void voxel, by a flood from the outside in falling radius; -1 in the solid.
fn flooded(distances: &[f64]) -> Vec<f64> {
    let mut escape = vec![-1.0f64; distances.len()];
    let mut heap: BinaryHeap<(u64, usize)> = BinaryHeap::new();
    heap.push((REACH.to_bits(), 0));
    while let Some((bits, n)) = heap.pop() {
        let radius = f64::from_bits(bits);
        if escape[n] >= 0.0 {
            continue;
        }
        escape[n] = radius;
        for m in neighbours(n).filter(|&m| distances[m] >= 0.0 && escape[m] < 0.0) {
            heap.push((radius.min(distances[m]).to_bits(), m));
        }
    }
    for (e, &d) in escape.iter_mut().zip(distances) {
        if d >= 0.0 && *e < 0.0 {
            *e = 0.0;
        }
    }
    escape
}

/// The deepest voxels of the cavities: connected voxels that are deeper than their escape radius.
fn cavities_by_flood(distances: &[f64], escape: &[f64]) -> Vec<usize> {
    let is_deeper = |n: usize| distances[n] > escape[n];
    let mut is_seen = vec![false; distances.len()];
    let mut found = Vec::new();
    for start in 0..distances.len() {
        if is_seen[start] || !is_deeper(start) {
            continue;
        }
        let (mut stack, mut deepest) = (vec![start], start);
        is_seen[start] = true;
        while let Some(n) = stack.pop() {
            if distances[n] > distances[deepest] {
                deepest = n;
            }
            for m in neighbours(n) {
                if is_deeper(m) && !is_seen[m] {
                    is_seen[m] = true;
                    stack.push(m);
                }
            }
        }
        let (depth, is_closed) = (distances[deepest], escape[deepest] == 0.0);
        if depth - escape[deepest] >= 1.0 || (is_closed && depth >= 1e-3) {
            found.push(deepest);
        }
    }
    found
}

#[test]
fn random_networks_have_the_cavities_of_a_flood() {
    let count = if crate::is_full() { 200 } else { 3 };
    let (mut all, mut closed) = (0, 0);
    for seed in 0..count {
        let solid = network(&mut Random(seed));
        let distances = dense_distances(&solid, &TETRAHEDRA_EDGES);
        let escape = flooded(&distances);
        // Ways out are searched with points on edges of the lattice, whose distances are greater. The narrowest voxel of
        // the way that is found is then measured by triangles.
        let coarse_escape = flooded(&dense_distances(&solid, &LATTICE_EDGES));
        let found = solid.cavities(REACH as i32, session()).unwrap();
        let is_near = |a: f64, b: f64| (a - b).abs() < DISTANCE_TOLERANCE;
        let is_escape = |radius: f64, n: usize| {
            let most = coarse_escape[n] + DISTANCE_TOLERANCE;
            // Of ways narrower than a voxel only that is known.
            let is_resolved = coarse_escape[n] >= 1.0 + DISTANCE_TOLERANCE;
            let least = if is_resolved { escape[n] } else { 0.0 };
            (least - DISTANCE_TOLERANCE..most).contains(&radius)
        };
        for c in &found.list {
            let at = c.place.0.map(|c| (c + DENSE_HALF) as usize);
            let n = (at[0] * DENSE_EDGE + at[1]) * DENSE_EDGE + at[2];
            let is_same = is_escape(c.escape_radius, n) && is_near(c.radius, distances[n]);
            let ruler = [escape[n], coarse_escape[n], distances[n]];
            assert!(is_same, "{seed}: {c:?} {ruler:?}");
        }
        // Two cavities whose ways out are about as wide may count as one, with the depth of the deeper one.
        for n in cavities_by_flood(&distances, &escape) {
            let (radius, depth) = (escape[n], distances[n]);
            let is_it =
                |c: &Cavity| is_escape(c.escape_radius, n) && c.radius > depth - DISTANCE_TOLERANCE;
            // A prominence near the limit of one voxel may count on one side only.
            let is_shallow = depth - radius < 1.0 + 2.0 * DISTANCE_TOLERANCE;
            assert!(
                is_shallow || found.list.iter().any(is_it),
                "{seed}: {radius} {depth} {found:#?}"
            );
        }
        let voids = solid.voids(session()).unwrap();
        assert_eq!(found.closed(), voids.len(), "{seed}");
        let sum = |list: &[u64]| list.iter().sum::<u64>();
        let own: Vec<u64> = found.list.iter().map(|c| c.voxels).collect();
        let closed_voxels: Vec<u64> = voids.iter().map(|v| v.voxels).collect();
        assert_eq!(sum(&own[..found.closed()]), sum(&closed_voxels), "{seed}");
        all += found.list.len();
        closed += found.closed();
    }
    assert!(closed > 0 && all > closed, "{all} {closed}");
}
