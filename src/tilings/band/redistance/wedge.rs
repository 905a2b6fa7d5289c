//! Sharp edges and corners of the surface: points with the planes that meet there.
//!
//! A crossing of a lattice edge lies up to a voxel beside a sharp edge of the surface, and differences of values across
//! the edge do not determine its planes. Such a point takes its planes from voxels up to [`WINDOW`] voxels away whose
//! differences do not cross the edge. Two or three planes, all convex or all concave, have a distance in closed form.
//! In all other cases (a round edge, a thin wall, a saddle) the point has no wedge. A corner with three planes becomes
//! a point too. With exact planes a distance errs by at most 1e-4 voxel (unit test); in
//! `moved_polyhedra_have_distances_in_closed_form` by 0.25 voxel root mean square.

use super::super::smooth::LeafRef;
use super::BandLengths;
use super::block::MAX_SHORTFALL;
use super::corner::Corner;
use super::surface_points::Point;
use super::vector::{Vector, difference, dot, dual, sum, unit};
use druse_geometry::frame::{Coord, Vec3};

/// Greatest distance at which planes are searched, voxels along each axis.
const WINDOW: f32 = 3.0;
/// Voxels that are read beyond each face of a leaf: the window, and one for differences.
const PADDING: i32 = 4;
/// Voxels along a leaf with its padding, and one more above, as points lie up to a voxel beyond the leaf.
const EDGE: usize = 17;
const STRIDES: [usize; 3] = [EDGE * EDGE, EDGE, 1];
/// Second differences of a point on or beside an edge are at least this, voxels.
const MIN_BEND: f32 = 0.15;
/// The norm of the second differences of voxels that define planes is at most this, voxels: those of a surface
/// of a radius of 40 voxels.
const MAX_PLANE_BEND: f32 = 0.025;
/// Farthest that voxels which define planes lie from the surface, voxels.
const MAX_DISTANCE: f32 = 1.2;
/// Farthest that such points lie from their plane, voxels.
const MAX_RESIDUAL: f32 = 0.05;
/// Cosine between normals of one plane, at least.
const MIN_SAME_PLANE_COSINE: f32 = 0.96;
/// Cosine between normals of two planes, at most: 32 degrees; and at least, since opposite walls have no edge.
const OTHER_PLANE_COSINES: [f32; 2] = [-0.93, 0.85];
/// Farthest that a point lies from the surface of its wedge, voxels: where it crosses an edge of the lattice is
/// found from distances to another plane.
const MAX_SURFACE_DISTANCE: f32 = 0.5;
/// Distance along each axis, voxels, within which values are compared with those of a wedge; and the tolerance.
const CHECK_RADIUS: f32 = 1.5;
const MAX_ERROR: f32 = 0.1;
/// Farthest that a point lies from the edge or corner, voxels.
const MAX_OFFSET: f32 = 12.0;
/// Half the length of an edge with two planes, voxels: other points continue it, and its ends are unknown.
const HALF_LENGTH: f32 = 1.5;
/// Range of the distance from a point to its corner, voxels, for which the corner is a point of its own: nearer
/// points represent it, and values around a more distant one are unknown.
const CORNER_OFFSETS: [f32; 2] = [0.3, MAX_CORNER_OFFSET];
/// Greatest distance of a corner that is a point of its own from the point that determines it, voxels.
pub(super) const MAX_CORNER_OFFSET: f32 = 4.0;

/// Planes that meet at an edge or a corner, all convex or all concave.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wedge {
    /// Normals; those of a concave wedge point inwards.
    normals: [Vector; 3],
    /// Dual basis of the normals; only for a corner.
    dual: Option<[Vector; 3]>,
    /// 1 if the solid is convex, else -1.
    sign: f32,
    /// Vector from the nearest point of the edge, or from the corner, to the surface point of this wedge.
    offset: Vector,
}

impl Wedge {
    /// Signed distance, voxels, of the position at displacement `away` from the point. It is negative inside.
    pub fn distance(&self, away: Vector) -> f32 {
        // y is the displacement from the edge or corner, `heights` those over the planes.
        let y = sum(away, self.offset);
        let heights = self.normals.map(|n| dot(n, y));
        // With y = s n_i + t n_j + the part along the edge, the edge is nearest where s, t > 0, at sqrt(u s + v t);
        // else it is the plane of the greater height.
        let of_pair = |i: usize, j: usize| {
            let (u, v) = (heights[i], heights[j]);
            let c = dot(self.normals[i], self.normals[j]);
            let square = 1.0 - c * c;
            let (s, t) = ((u - c * v) / square, (v - c * u) / square);
            if s > 0.0 && t > 0.0 {
                (u * s + v * t).max(0.0).sqrt()
            } else {
                u.max(v)
            }
        };
        let Some(dual) = self.dual else {
            let (u, v) = (heights[0], heights[1]);
            let c = dot(self.normals[0], self.normals[1]);
            // An edge with two planes ends after its half length: beyond that its end is nearest.
            let size = of_pair(0, 1);
            if u <= c * v || v <= c * u {
                return self.sign * size;
            }
            let square = dot(y, y) - size * size;
            let beyond = (square.max(0.0).sqrt() - HALF_LENGTH).max(0.0);
            return self.sign * (size * size + beyond * beyond).sqrt();
        };
        // The dual basis gives y's coefficients by the normals: all positive where the corner itself is nearest.
        let size = if dual.iter().all(|d| dot(*d, y) > 0.0) {
            dot(y, y).sqrt()
        } else {
            of_pair(0, 1).max(of_pair(1, 2)).max(of_pair(0, 2))
        };
        self.sign * size
    }

    /// The unsigned distance, voxels, of the position at displacement `away` from the point, and the unit vector
    /// away from the surface.
    pub fn distance_and_direction(&self, away: Vec3) -> (f64, Vec3) {
        const STEP: f64 = 1e-2; // Voxels: long, since distances are in single precision.
        let at = |p: Vec3| f64::from(self.distance(p.map(|c| c as f32).into()));
        let slope = |axis| {
            let step = Vec3::ith(axis, STEP);
            at(away + step) - at(away - step)
        };
        let d = at(away);
        let slope = Vec3::new(slope(0), slope(1), slope(2)) * 1f64.copysign(d);
        let least = away.norm() - f64::from(MAX_SHORTFALL);
        let direction = slope.try_normalize(1e-9).unwrap_or(Vec3::x());
        (d.abs().max(least), direction)
    }

    /// The outward normal of one of its planes.
    pub fn normal(&self) -> Vector {
        self.normals[0].map(|n| n * self.sign)
    }

    /// The corner as a point of its own; `p` is the surface point of this wedge. None for two planes, too near `p` or
    /// too far, or where values disagree: other planes may end its edges before the corner.
    fn corner(&self, p: Vector, v: &[f32]) -> Option<Corner> {
        self.dual?;
        let square = dot(self.offset, self.offset);
        let at = difference(p, self.offset);
        let known = [
            CHECK_RADIUS - PADDING as f32,
            (EDGE as i32 - PADDING - 1) as f32 - CHECK_RADIUS,
        ];
        let is_known = |c: &f32| (known[0]..=known[1]).contains(c);
        let is_apart = (CORNER_OFFSETS[0].powi(2)..CORNER_OFFSETS[1].powi(2)).contains(&square);
        let is_corner = is_apart
            && at.iter().all(is_known)
            && values_around(at, v).all(|(place, value)| {
                // Level sets of intersections hold less than the distance on the convex side, and a voxel at the
                // corner, whose sign is ambiguous, may hold the distance to other voxels.
                let away = difference(place, p);
                let value = value * self.sign;
                let least = self.farthest_plane(away);
                let most = self.distance(away) * self.sign;
                let apart = difference(place, at);
                dot(apart, apart) < MAX_ERROR.powi(2)
                    || (least - MAX_ERROR..=most + MAX_ERROR).contains(&value)
            });
        let offset = [0.0; 3];
        is_corner.then_some(Corner {
            at,
            wedge: Self { offset, ..*self },
        })
    }

    /// Greatest of the distances to the planes, positive on the convex side.
    fn farthest_plane(&self, away: Vector) -> f32 {
        let y = sum(away, self.offset);
        let heights = self.normals.map(|n| dot(n, y));
        heights.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }

    /// Whether the values about a point are those of its wedge: inside a convex one, outside a concave one, where
    /// also the larger or lesser of two distances is that of the planes. A round edge has others.
    fn agrees(&self, p: Vector, v: &[f32]) -> bool {
        values_around(p, v).all(|(at, value)| {
            value * self.sign > 0.0
                || value.abs() > MAX_DISTANCE
                || (self.distance(difference(at, p)) - value).abs() <= MAX_ERROR
        })
    }
}

/// The voxels within [`CHECK_RADIUS`] of a position along each axis, and their values.
fn values_around(p: Vector, v: &[f32]) -> impl Iterator<Item = (Vector, f32)> {
    let range = |c: f32| {
        let first = (c - CHECK_RADIUS).ceil() as i32;
        first..=(c + CHECK_RADIUS).floor() as i32
    };
    let [xs, ys, zs] = p.map(range);
    let rows = xs.flat_map(move |x| ys.clone().map(move |y| (x, y)));
    let voxels = rows.flat_map(move |(x, y)| zs.clone().map(move |z| [x, y, z]));
    voxels.map(|voxel| {
        let [i, j, k] = voxel.map(|c| (c + PADDING) as usize);
        let value = v[i * STRIDES[0] + j * STRIDES[1] + k];
        (voxel.map(|c| c as f32), value)
    })
}

/// A point that may define a plane.
#[derive(Clone, Copy)]
struct Sample {
    at: Vector,
    normal: Vector,
}

/// A plane through points.
#[derive(Clone, Copy)]
struct Plane {
    at: Vector,
    normal: Vector,
}

/// Assigns wedges to the points of a leaf at sharp edges, numbered from the end of `wedges`; returns corners that are
/// points of their own. Points come from [`Stencils`](super::surface_points::Stencils); `values` finds a leaf's values
/// by its origin. Only points whose second differences exceed [`MIN_BEND`] are tried.
pub(super) fn find<'a>(
    points: &mut [Point],
    wedges: &mut Vec<Wedge>,
    leaf: &LeafRef<'a>,
    values: impl Fn(Coord) -> Option<&'a [f32]>,
    lengths: BandLengths,
) -> Vec<Corner> {
    let mut corners = Vec::new();
    if !points.iter().any(is_bent) {
        return corners;
    }
    let all = gather(leaf, values, 1.0 / lengths.voxel_size, lengths.background);
    // Voxels whose feet may lie in a window, and that have neighbours on all sides.
    let mut ends = [[EDGE, 0]; 3];
    for point in points.iter().filter(|p| is_bent(p)) {
        for (end, c) in ends.iter_mut().zip(point.at) {
            let at = c + PADDING as f32;
            let reach = WINDOW + MAX_DISTANCE;
            end[0] = end[0].min((at - reach).max(1.0) as usize);
            end[1] = end[1].max(((at + reach) as usize + 1).min(EDGE - 1));
        }
    }
    let samples = samples(&all, ends);
    for point in points.iter_mut().filter(|p| is_bent(p)) {
        if let Some(wedge) = wedge(point.at, &samples).filter(|w| w.agrees(point.at, &all)) {
            point.wedge = wedges.len() as u32;
            wedges.push(wedge);
            let corner = wedge.corner(point.at, &all);
            corners.extend(corner.filter(|c| !corners.iter().any(|other| c.is_at(other))));
        }
    }
    corners
}

/// Whether the second differences of a point indicate an edge.
fn is_bent(point: &Point) -> bool {
    point.hessian.iter().any(|b| b.abs() > MIN_BEND)
}

/// The voxels of a leaf and those about it, in voxels; what no leaf holds has the sign of the leaf's nearest voxel.
/// `background` is in world units; the result is in order (x, y, z), 17 a side.
fn gather<'a>(
    leaf: &LeafRef<'a>,
    values: impl Fn(Coord) -> Option<&'a [f32]>,
    per_voxel: f32,
    background: f32,
) -> Vec<f32> {
    let mut all = vec![0.0; EDGE * EDGE * EDGE];
    let parts = [(-8, -PADDING..0), (0, 0..8), (8, 8..EDGE as i32 - PADDING)];
    let offset = |[x, y, z]: [i32; 3]| (x << 6 | y << 3 | z) as usize;
    // The leaf and the 26 around it.
    for (dx, xs) in &parts {
        for (dy, ys) in &parts {
            for (dz, zs) in &parts {
                let other = match [*dx, *dy, *dz] {
                    [0, 0, 0] => Some(leaf.values),
                    [x, y, z] => values(leaf.origin.offset(x, y, z)),
                };
                for x in xs.clone() {
                    for y in ys.clone() {
                        for z in zs.clone() {
                            let value = other.map_or_else(
                                || {
                                    let near = [x, y, z].map(|c| c.clamp(0, 7));
                                    background.copysign(leaf.values[offset(near)])
                                },
                                |other| other[offset([x - dx, y - dy, z - dz])],
                            );
                            let to = [x, y, z].map(|c| (c + PADDING) as usize);
                            all[to[0] * STRIDES[0] + to[1] * STRIDES[1] + to[2]] =
                                value * per_voxel;
                        }
                    }
                }
            }
        }
    }
    all
}

/// Feet of the voxels in a range that lie next to the surface and whose differences reach across no edge. Ranges are
/// offsets in the gathered cube; positions of samples count from the leaf's least voxel.
fn samples(v: &[f32], [xs, ys, zs]: [[usize; 2]; 3]) -> Vec<Sample> {
    let mut found = Vec::new();
    for x in xs[0]..xs[1] {
        for y in ys[0]..ys[1] {
            for z in zs[0]..zs[1] {
                let at = x * STRIDES[0] + y * STRIDES[1] + z;
                let distance = v[at];
                // Far from the surface, or next to an edge, a voxel defines no plane.
                if distance.abs() > MAX_DISTANCE {
                    continue;
                }
                if bend_squared(v, at) > MAX_PLANE_BEND.powi(2) {
                    continue;
                }
                let Some(normal) = unit(STRIDES.map(|s| 0.5 * (v[at + s] - v[at - s]))) else {
                    continue;
                };
                // The foot: the voxel less its distance along the normal.
                let place = [x, y, z].map(|c| (c as i32 - PADDING) as f32);
                found.push(Sample {
                    at: difference(place, normal.map(|n| n * distance)),
                    normal,
                });
            }
        }
    }
    found
}

/// The square of the norm of the second differences at a voxel: what bends along a diagonal shows in the mixed ones.
fn bend_squared(v: &[f32], at: usize) -> f32 {
    let pure = STRIDES.map(|s| v[at + s] - 2.0 * v[at] + v[at - s]);
    let [x, y, z] = STRIDES;
    let mixed = [(x, y), (y, z), (z, x)]
        .map(|(s, t)| (v[at + s + t] - v[at + s - t] - v[at - s + t] + v[at - s - t]) / 4.0);
    dot(pure, pure) + 2.0 * dot(mixed, mixed)
}

/// The planes that meet near the point `p`, relative to the leaf's least voxel; `None` where they are not two or three,
/// bend, make no clear edge, or are far from `p`. The first normal differs most from that of some point nearby, the
/// second most from the first, the third most from both.
fn wedge(p: Vector, samples: &[Sample]) -> Option<Wedge> {
    let is_near = |s: &&Sample| (0..3).all(|a| (s.at[a] - p[a]).abs() <= WINDOW);
    let near: Vec<Sample> = samples.iter().filter(is_near).copied().collect();
    let farthest = |from: Vector| {
        let cosine = |s: &Sample| dot(s.normal, from);
        let all = near.iter();
        all.min_by(|a, b| cosine(a).total_cmp(&cosine(b)))
            .map(|s| s.normal)
    };
    let one = farthest(near.first()?.normal)?;
    let two = farthest(one)?;
    let is_other = |c: f32| (OTHER_PLANE_COSINES[0]..=OTHER_PLANE_COSINES[1]).contains(&c);
    if !is_other(dot(one, two)) {
        return None;
    }
    let nearness = |s: &Sample| dot(s.normal, one).max(dot(s.normal, two));
    let all = near.iter();
    let three = all
        .min_by(|a, b| nearness(a).total_cmp(&nearness(b)))
        .filter(|s| nearness(s) < OTHER_PLANE_COSINES[1])
        .map(|s| s.normal);
    let (a, count_a) = plane_of(one, &near)?;
    let (b, count_b) = plane_of(two, &near)?;
    // A distant corner may have too few points for its third plane.
    let third = three.and_then(|about| plane_of(about, &near));
    let (c, count_c) = third.map_or((None, 0), |(plane, count)| (Some(plane), count));
    // At least four fifths of the points around must lie on these planes.
    if 5 * (count_a + count_b + count_c) < 4 * near.len() {
        return None;
    }
    let mut sign = 0.0;
    let pairs = [(Some(a), Some(b)), (Some(b), c), (Some(a), c)];
    for pair in pairs {
        let (Some(a), Some(b)) = pair else { continue };
        if !is_other(dot(a.normal, b.normal)) {
            return None;
        }
        let between = difference(b.at, a.at);
        // Each plane's mean point behind the other plane: convex; before it: concave.
        let ends = [dot(a.normal, between), -dot(b.normal, between)];
        let own = match ends {
            [u, v] if u < -MAX_RESIDUAL && v < -MAX_RESIDUAL => 1.0,
            [u, v] if u > MAX_RESIDUAL && v > MAX_RESIDUAL => -1.0,
            _ => return None,
        };
        if sign != 0.0 && sign != own {
            return None;
        }
        sign = own;
    }
    let normals = [a, b, c.unwrap_or(a)].map(|plane| plane.normal.map(|n| n * sign));
    let height = |n: usize, plane: Plane| dot(normals[n], difference(p, plane.at));
    let (offset, dual) = if let Some(c) = c {
        let dual = dual(normals)?;
        // The point from the corner, y with n_i . y = h_i: y = sum h_i d_i with the dual basis d.
        let heights = [height(0, a), height(1, b), height(2, c)];
        let mut offset = [0.0; 3];
        for (d, h) in dual.iter().zip(heights) {
            offset = sum(offset, d.map(|d| d * h));
        }
        (offset, Some(dual))
    } else {
        // The point from the edge, y = s n_0 + t n_1 with n_0 . y = u and n_1 . y = v.
        let (u, v) = (height(0, a), height(1, b));
        let c = dot(normals[0], normals[1]);
        let square = 1.0 - c * c;
        let (s, t) = ((u - c * v) / square, (v - c * u) / square);
        let offset = sum(normals[0].map(|n| n * s), normals[1].map(|n| n * t));
        (offset, None)
    };
    let wedge = Wedge {
        normals,
        dual,
        sign,
        offset,
    };
    let is_on = wedge.distance([0.0; 3]).abs() < MAX_SURFACE_DISTANCE
        && dot(offset, offset) < MAX_OFFSET.powi(2);
    is_on.then_some(wedge)
}

/// The plane of the points whose normals are about the same, and how many they are; none if they bend or are few.
fn plane_of(about: Vector, near: &[Sample]) -> Option<(Plane, usize)> {
    let own = || {
        near.iter()
            .filter(|s| dot(s.normal, about) > MIN_SAME_PLANE_COSINE)
    };
    let count = own().count();
    if count < 3 {
        return None;
    }
    let (mut at, mut normal) = ([0.0; 3], [0.0; 3]);
    for s in own() {
        at = sum(at, s.at);
        normal = sum(normal, s.normal);
    }
    let at = at.map(|c| c / count as f32);
    let normal = unit(normal)?;
    let is_flat = |s: &Sample| dot(normal, difference(s.at, at)).abs() < MAX_RESIDUAL;
    own().all(is_flat).then_some((Plane { at, normal }, count))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of the planes of an orthogonal corner at the origin, `count` of them, convex or concave.
    fn corner(count: usize, sign: f32) -> Vec<Sample> {
        let mut samples = Vec::new();
        for axis in 0..count {
            let mut normal = [0.0; 3];
            normal[axis] = sign;
            for n in 1..9 {
                let mut at = [-0.4 - 0.3 * n as f32, -0.4 - 0.3 * (n * 5 % 8) as f32, -0.5];
                if count == 2 {
                    at[2] = n as f32 * 0.3 - 1.0;
                }
                at[axis] = 0.0;
                samples.push(Sample { at, normal });
            }
        }
        samples
    }

    #[test]
    fn edges_and_corners_have_distances_in_closed_form() {
        let p = [-0.5, 0.0, 0.1];
        let at = |x: Vector| difference(x, p);
        for sign in [1.0, -1.0] {
            let edge = wedge(p, &corner(2, sign)).unwrap();
            for (x, d) in [
                ([3.0, 4.0, 1.0], 5.0),
                ([-2.0, 1.0, 0.0], 1.0),
                ([-2.0, -3.0, 0.0], -2.0),
            ] {
                assert!((edge.distance(at(x)) - sign * d).abs() < 1e-4, "{x:?}");
            }
        }
        let p = [0.0, -0.4, -0.4];
        let corner = wedge(p, &corner(3, 1.0)).unwrap();
        let at = |x: Vector| difference(x, p);
        assert!((corner.distance(at([2.0, 3.0, 6.0])) - 7.0).abs() < 1e-4);
        assert!((corner.distance(at([3.0, 4.0, -1.0])) - 5.0).abs() < 1e-4);
        assert!((corner.distance(at([-1.0, -3.0, -2.0])) + 1.0).abs() < 1e-4);
    }

    #[test]
    fn a_round_surface_has_no_wedge() {
        let ball = |n: usize| {
            let (a, b) = (n as f32 * 0.35, (n * 7 % 11) as f32 * 0.25 - 1.0);
            let normal = [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()];
            let at = normal.map(|c| 2.0 * c);
            Sample { at, normal }
        };
        let samples: Vec<Sample> = (0..40).map(ball).collect();
        assert!(wedge([2.0, 0.0, 0.0], &samples).is_none());
    }
}
