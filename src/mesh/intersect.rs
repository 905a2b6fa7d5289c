//! Whether triangles of a mesh meet where they should not, decided exactly.
//!
//! Two triangles may share a corner or a side and nothing else. Signs of volumes and areas come from
//! adaptive exact arithmetic (Shewchuk 1997), so that the answer does not depend on a tolerance;
//! touching counts as meeting.

use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// Sign of the volume of the tetrahedron a, b, c, d.
fn side(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> i8 {
    let at = |p: Vec3| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    sign(orient3d(at(a), at(b), at(c), at(d)))
}

fn sign(x: f64) -> i8 {
    i8::from(x > 0.0) - i8::from(x < 0.0)
}

/// A projection along an axis, for figures that lie in one plane.
#[derive(Clone, Copy)]
struct Plan(usize);

impl Plan {
    /// A projection in which the triangle keeps an area; `None` if it has none.
    fn of(&[a, b, c]: &[Vec3; 3]) -> Option<Self> {
        let n = (b - a).cross(&(c - a));
        let first = n.iamax();
        [first, (first + 1) % 3, (first + 2) % 3]
            .map(Self)
            .into_iter()
            .find(|plan| plan.turn(a, b, c) != 0)
    }

    /// Sign of the area of a, b, c in the projection.
    fn turn(self, a: Vec3, b: Vec3, c: Vec3) -> i8 {
        let at = |p: Vec3| Coord {
            x: p[(self.0 + 1) % 3],
            y: p[(self.0 + 2) % 3],
        };
        sign(orient2d(at(a), at(b), at(c)))
    }

    /// Whether `p`, on the line of a and b, lies between them, the ends included.
    fn between(self, a: Vec3, b: Vec3, p: Vec3) -> bool {
        [(self.0 + 1) % 3, (self.0 + 2) % 3]
            .into_iter()
            .all(|k| a[k].min(b[k]) <= p[k] && p[k] <= a[k].max(b[k]))
    }

    /// Whether two closed segments meet.
    fn cross(self, [a, b]: [Vec3; 2], [c, d]: [Vec3; 2]) -> bool {
        let (sc, sd) = (self.turn(a, b, c), self.turn(a, b, d));
        let (sa, sb) = (self.turn(c, d, a), self.turn(c, d, b));
        if sc * sd < 0 && sa * sb < 0 {
            return true;
        }
        (sc == 0 && self.between(a, b, c))
            || (sd == 0 && self.between(a, b, d))
            || (sa == 0 && self.between(c, d, a))
            || (sb == 0 && self.between(c, d, b))
    }

    /// Whether the closed triangle holds the point.
    fn holds(self, &[a, b, c]: &[Vec3; 3], p: Vec3) -> bool {
        let s = [self.turn(a, b, p), self.turn(b, c, p), self.turn(c, a, p)];
        s.iter().all(|&x| x >= 0) || s.iter().all(|&x| x <= 0)
    }

    /// Whether a closed segment meets a closed triangle.
    fn reaches(self, [p, q]: [Vec3; 2], t: &[Vec3; 3]) -> bool {
        self.holds(t, p) || (0..3).any(|i| self.cross([p, q], [t[i], t[(i + 1) % 3]]))
    }
}

/// Whether a triangle has no area, exactly.
pub(crate) fn is_flat(t: &[Vec3; 3]) -> bool {
    Plan::of(t).is_none()
}

/// Whether the closed segment meets the closed triangle; `sides` are those of its ends.
fn pierces([p, q]: [Vec3; 2], sides: [i8; 2], t: &[Vec3; 3]) -> bool {
    if sides[0] * sides[1] > 0 {
        return false;
    }
    if sides == [0, 0] {
        return Plan::of(t).is_some_and(|plan| plan.reaches([p, q], t));
    }
    let s = [0, 1, 2].map(|i| side(p, q, t[i], t[(i + 1) % 3]));
    s.iter().all(|&x| x >= 0) || s.iter().all(|&x| x <= 0)
}

/// Whether triangles with area meet beyond the corners they share; equal corners are shared ones.
pub(crate) fn meet(t: &[Vec3; 3], u: &[Vec3; 3]) -> bool {
    let same = |p: &Vec3, q: &Vec3| p == q;
    let free = |a: &[Vec3; 3], b: &[Vec3; 3]| -> Vec<usize> {
        (0..3)
            .filter(|&i| !b.iter().any(|q| same(&a[i], q)))
            .collect()
    };
    let turned = |a: &[Vec3; 3], i: usize| [a[i], a[(i + 1) % 3], a[(i + 2) % 3]];
    let (ft, fu) = (free(t, u), free(u, t));
    match (ft.len(), fu.len()) {
        // The same triangle twice.
        (0, _) | (_, 0) => true,
        // A common side: they meet only folded flat onto each other.
        (1, _) | (_, 1) => {
            let ([c, a, b], d) = (turned(t, ft[0]), u[fu[0]]);
            side(a, b, c, d) == 0
                && Plan::of(t).is_some_and(|plan| plan.turn(a, b, c) == plan.turn(a, b, d))
        }
        // A common corner: what they share reaches the side opposite to it in one of them.
        (2, _) | (_, 2) => {
            let opposite = |a: &[Vec3; 3], f: &[usize]| [a[f[0]], a[f[1]]];
            let (of_t, of_u) = (opposite(t, &ft), opposite(u, &fu));
            let sides = |e: [Vec3; 2], f: &[Vec3; 3]| e.map(|p| side(f[0], f[1], f[2], p));
            pierces(of_u, sides(of_u, t), t) || pierces(of_t, sides(of_t, u), u)
        }
        _ => {
            let of_u = u.map(|p| side(t[0], t[1], t[2], p));
            if of_u == [1; 3] || of_u == [-1; 3] {
                return false;
            }
            let of_t = t.map(|p| side(u[0], u[1], u[2], p));
            if of_t == [1; 3] || of_t == [-1; 3] {
                return false;
            }
            let edge = |i: usize| [i, (i + 1) % 3];
            (0..3).any(|i| {
                let e = edge(i);
                pierces(e.map(|k| u[k]), e.map(|k| of_u[k]), t)
                    || pierces(e.map(|k| t[k]), e.map(|k| of_t[k]), u)
            }) || (of_u == [0; 3]
                && Plan::of(u).is_some_and(|plan| plan.holds(u, t[0]) || plan.holds(t, u[0])))
        }
    }
}

/// Pairs of triangle numbers that meet, one for every triangle that meets a later one, sorted.
/// Triangles without area are passed by.
pub(crate) fn meeting_pairs(
    soup: &Soup,
    progress: &dyn Progress,
) -> Result<Vec<[u32; 2]>, Cancelled> {
    let flat: Vec<bool> = soup.corners.par_iter().map(is_flat).collect();
    let chunks: Vec<Vec<[u32; 2]>> = (0..soup.corners.len())
        .collect::<Vec<_>>()
        .par_chunks(4096)
        .map(|slots| {
            if progress.cancelled() {
                return Vec::new();
            }
            let pairs = slots
                .iter()
                .filter(|&&s| !flat[s])
                .filter_map(|&s| first_later(soup, &flat, s));
            let pairs = pairs.collect();
            progress.advance(slots.len() as u64);
            pairs
        })
        .collect();
    if progress.cancelled() {
        return Err(Cancelled);
    }
    let mut pairs: Vec<[u32; 2]> = chunks.into_iter().flatten().collect();
    pairs.par_sort_unstable();
    Ok(pairs)
}

/// The triangle in slot `s` and one in a later slot that meets it.
fn first_later(soup: &Soup, flat: &[bool], s: usize) -> Option<[u32; 2]> {
    let t = &soup.corners[s];
    let region = Aabb::of(*t);
    let mut found = None;
    soup.bvh.overlapping(&region, |other| {
        let u = &soup.corners[other];
        if other > s && !flat[other] && region.meets(Aabb::of(*u)) && meet(t, u) {
            found = Some(other);
        }
        found.is_none()
    });
    found.map(|other| {
        let (a, b) = (soup.number[s], soup.number[other]);
        [a.min(b), a.max(b)]
    })
}
