//! The Delaunay tetrahedra of points, one point inserted after another (Bowyer 1981, Watson 1981).
//!
//! A point removes all tets whose circumsphere holds it, a cavity; its faces and the point make the new
//! tets. The signs of determinants are exact (Shewchuk 1997), so that the cavity is star-shaped and no
//! tet is flat, for points on a common plane or sphere too. Four far points enclose all others.

use druse_geometry::frame::{Aabb, Vec3};
use robust::{Coord3D, insphere, orient3d};

/// No neighbour, or a tet that was removed.
const NO_TET: u32 = u32::MAX;
/// Number of the far points that enclose all others; the first points.
const FAR_POINT_COUNT: u32 = 4;
/// Distance of the far points, half diagonals of the box: spheres through them are nearly planes there.
const FAR_DISTANCE: f64 = 1e3;

/// Tets of points. Those that have a far corner are left out of [`Delaunay::tets`].
pub(super) struct Delaunay {
    points: Vec<Vec3>,
    /// Corners, so that `orient3d` is positive; those of a removed tet are `NO_TET`.
    tets: Vec<[u32; 4]>,
    /// The tet beyond the face opposite to each corner.
    neighbours: Vec<[u32; 4]>,
    /// Numbers of removed tets.
    free: Vec<u32>,
    /// Where the next search starts.
    last: u32,
    /// The tets that the present point removes, marked by its number.
    marks: Vec<u32>,
}

fn coord(p: Vec3) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

impl Delaunay {
    /// No points yet; all of them must lie in the box. Four far corners enclose them in a first tet.
    pub(super) fn new(bounds: &Aabb) -> Self {
        let (centre, size) = (bounds.centre().0, FAR_DISTANCE * bounds.half_diagonal());
        let corners = [[1., 1., 1.], [-1., 1., -1.], [1., -1., -1.], [-1., -1., 1.]];
        let points: Vec<Vec3> = corners
            .map(|c| centre + Vec3::from(c) * size)
            .into_iter()
            .collect();
        let mut first = [0, 1, 2, 3];
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| coord(points[i]));
        if orient3d(a, b, c, d) < 0.0 {
            first.swap(2, 3);
        }
        Self {
            points,
            tets: vec![first],
            neighbours: vec![[NO_TET; 4]],
            free: Vec::new(),
            last: 0,
            marks: vec![NO_TET],
        }
    }

    /// The tets without far corners, of positive volume, by the numbers that [`Delaunay::insert`] returned.
    pub(super) fn tets(&self) -> impl Iterator<Item = [u32; 4]> + '_ {
        let near = self.tets.iter();
        // The exact sign is opposite to that of (b - a) x (c - a) . (d - a).
        near.filter(|t| t.iter().all(|&n| n != NO_TET && n >= FAR_POINT_COUNT))
            .map(|&[a, b, c, d]| {
                [
                    a - FAR_POINT_COUNT,
                    b - FAR_POINT_COUNT,
                    d - FAR_POINT_COUNT,
                    c - FAR_POINT_COUNT,
                ]
            })
    }

    /// Adds a point by Bowyer and Watson's method: the tets whose spheres hold it make room for tets from it to the
    /// faces around. Returns whether it is new. A point at the place of an earlier one changes nothing. The point gets
    /// the next number.
    pub(super) fn insert(&mut self, p: Vec3) -> bool {
        let start = self.locate(p);
        if self.tets[start as usize]
            .iter()
            .any(|&n| self.points[n as usize] == p)
        {
            return false;
        }
        let number = self.points.len() as u32;
        self.points.push(p);
        // The cavity grows from the tet that holds the point over neighbours in conflict.
        let mut cavity = vec![start];
        self.marks[start as usize] = number;
        let mut faces: Vec<(u32, usize)> = Vec::new();
        let mut next = 0;
        while next < cavity.len() {
            let tet = cavity[next];
            next += 1;
            for side in 0..4 {
                let beyond = self.neighbours[tet as usize][side];
                if beyond != NO_TET && self.marks[beyond as usize] == number {
                    continue;
                }
                if beyond != NO_TET && self.holds(beyond, p) {
                    self.marks[beyond as usize] = number;
                    cavity.push(beyond);
                } else {
                    faces.push((tet, side));
                }
            }
        }
        self.replace(number, &cavity, &faces);
        true
    }

    /// Whether the circumsphere of a tet holds a point.
    fn holds(&self, tet: u32, p: Vec3) -> bool {
        let [a, b, c, d] = self.tets[tet as usize].map(|n| coord(self.points[n as usize]));
        insphere(a, b, c, d, coord(p)) > 0.0
    }

    /// A tet that holds a point: from the last one through the faces that separate it from the point.
    fn locate(&self, p: Vec3) -> u32 {
        let p = coord(p);
        let mut tet = self.last;
        'walk: loop {
            let corners = self.tets[tet as usize].map(|n| coord(self.points[n as usize]));
            for side in 0..4 {
                let mut c = corners;
                c[side] = p;
                let beyond = self.neighbours[tet as usize][side];
                if beyond != NO_TET && orient3d(c[0], c[1], c[2], c[3]) < 0.0 {
                    tet = beyond;
                    continue 'walk;
                }
            }
            return tet;
        }
    }

    /// Replaces the tets of a cavity by those of its faces and the new point. `number` is that of the point; `faces`
    /// are sides of tets of the cavity with no tet of the cavity beyond.
    fn replace(&mut self, number: u32, cavity: &[u32], faces: &[(u32, usize)]) {
        // Before numbers are used again: the side of the tet beyond each face that faces the cavity.
        let mut made = Vec::with_capacity(faces.len());
        for &(tet, side) in faces {
            let beyond = self.neighbours[tet as usize][side];
            let back = self.neighbours.get(beyond as usize);
            let back = back.and_then(|b| b.iter().position(|&n| n == tet));
            let mut corners = self.tets[tet as usize];
            corners[side] = number;
            made.push((corners, side, beyond, back));
        }
        for &tet in cavity {
            self.tets[tet as usize] = [NO_TET; 4];
        }
        self.free.extend(cavity.iter().rev());
        // The two new tets at each edge of the cavity's surface are neighbours.
        // Three sides of each new tet touch other new tets; equal edges, sorted, are beside each other.
        let mut edges: Vec<([u32; 2], u32, usize)> = Vec::with_capacity(3 * made.len());
        for (corners, side, beyond, back) in made {
            let tet = self.free.pop().unwrap_or(self.tets.len() as u32);
            if tet as usize == self.tets.len() {
                self.tets.push([NO_TET; 4]);
                self.neighbours.push([NO_TET; 4]);
                self.marks.push(NO_TET);
            }
            self.tets[tet as usize] = corners;
            self.neighbours[tet as usize][side] = beyond;
            if let Some(back) = back {
                self.neighbours[beyond as usize][back] = tet;
            }
            for other in (0..4).filter(|&o| o != side) {
                // The corners 0 to 3 sum up to 6: two are left.
                let third = (0..4).find(|&k| k != side && k != other).unwrap_or(0);
                let ends = [third, 6 - side - other - third].map(|k| corners[k]);
                edges.push(([ends[0].min(ends[1]), ends[0].max(ends[1])], tet, other));
            }
            self.last = tet;
        }
        edges.sort_unstable();
        for pair in edges.chunks_exact(2) {
            let [(_, a, side_a), (_, b, side_b)] = [pair[0], pair[1]];
            self.neighbours[a as usize][side_a] = b;
            self.neighbours[b as usize][side_b] = a;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid has many points on common planes and spheres: the tets fill it, no circumsphere holds a point.
    #[test]
    fn tets_of_a_grid_fill_it_and_are_delaunay() {
        let bounds = Aabb::of([Vec3::zeros(), Vec3::repeat(3.0)]);
        let mut mesh = Delaunay::new(&bounds);
        let mut points = Vec::new();
        for i in 0..64 {
            // 27 is prime to 64: a fixed order that is not sorted.
            let n = i * 27 % 64;
            let p = Vec3::new(f64::from(n % 4), f64::from(n / 4 % 4), f64::from(n / 16));
            assert!(mesh.insert(p));
            points.push(p);
        }
        assert!(!mesh.insert(points[5]));
        let mut volume = 0.0;
        for t in mesh.tets() {
            let [a, b, c, d] = t.map(|n| points[n as usize]);
            let own = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
            assert!(own > 0.0);
            volume += own;
            let [a, b, c, d] = [a, b, d, c].map(coord);
            assert!(
                points
                    .iter()
                    .all(|p| insphere(a, b, c, d, coord(*p)) <= 0.0)
            );
        }
        assert!((volume - 27.0).abs() < 1e-9, "{volume}");
    }
}
