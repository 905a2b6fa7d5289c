//! One round beam, one plate: exact signed distances.
//!
//! A beam is a ball swept along a segment while its radius changes linearly. With h the coordinate along
//! the axis, q the distance from it and s the loss of radius per unit of length, the ball nearest to a point
//! has its centre at t = h - q s / sqrt(1 - s^2), clamped to the segment; the distance is that to the centre
//! minus the radius there. A plate is a ball swept over a triangle, its radius linear: the beams along its
//! sides, and over its inside the two planes that touch all balls.

use crate::frame::{Aabb, Vec3};

/// Largest change of a radius per unit of length: beyond it one end's ball holds the other's.
const STEEPEST: f64 = 1.0 - 1e-9;

/// A round beam: a ball swept along a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Centres of the balls at the ends, world units.
    pub ends: [Vec3; 2],
    /// Radii at the ends, world units; not negative.
    pub radii: [f64; 2],
}

/// A plate: a ball swept over a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// Corners of the middle surface, world units.
    pub corners: [Vec3; 3],
    /// Half the thickness at the corners, world units; not negative.
    pub radii: [f64; 3],
}

/// A beam as it is evaluated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    /// The first centre.
    pub from: Vec3,
    /// Unit vector towards the second one; zero for a ball.
    pub along: Vec3,
    pub length: f64,
    /// At the first centre.
    pub radius: f64,
    /// Loss of radius per unit of length, s.
    pub slope: f64,
    /// s / sqrt(1 - s^2).
    pub shift: f64,
}

impl Axis {
    pub fn new(beam: &Beam) -> Self {
        let [a, b] = beam.ends;
        let [ra, rb] = beam.radii;
        let length = (b - a).norm();
        if (ra - rb).abs() >= STEEPEST * length {
            return Self {
                from: if ra >= rb { a } else { b },
                along: Vec3::zeros(),
                length: 0.0,
                radius: ra.max(rb),
                slope: 0.0,
                shift: 0.0,
            };
        }
        let slope = (ra - rb) / length;
        Self {
            from: a,
            along: (b - a) / length,
            length,
            radius: ra,
            slope,
            shift: slope / (1.0 - slope * slope).sqrt(),
        }
    }

    /// The beam that it is of.
    pub fn beam(&self) -> Beam {
        Beam {
            ends: [self.from, self.from + self.along * self.length],
            radii: [self.radius, self.radius - self.slope * self.length],
        }
    }

    /// Signed distance and the centre of the nearest ball.
    pub fn nearest(&self, p: Vec3) -> (f64, Vec3) {
        let x = p - self.from;
        let h = x.dot(&self.along);
        let q = (x - self.along * h).norm();
        let t = (h - q * self.shift).clamp(0.0, self.length);
        let centre = self.from + self.along * t;
        ((p - centre).norm() - (self.radius - self.slope * t), centre)
    }

    fn bounds(&self) -> Aabb {
        let Beam { ends, radii } = self.beam();
        let ball = |c, r: f64| Aabb { min: c, max: c }.dilated(r.max(0.0));
        ball(ends[0], radii[0]).union(ball(ends[1], radii[1]))
    }
}

/// The inside of a plate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slab {
    pub from: Vec3,
    pub normal: Vec3,
    /// Gradient of the radius in the plane, g.
    pub rise: Vec3,
    /// At `from`.
    pub radius: f64,
    /// sqrt(1 - g^2).
    pub cosine: f64,
    /// Barycentric coordinates: gradients in the plane, and values at `from`.
    pub sides: [(Vec3, f64); 3],
}

impl Slab {
    /// `None` for a triangle without area, or one whose radius changes faster than the place.
    fn new(plate: &Plate) -> Option<Self> {
        let [a, b, c] = plate.corners;
        let area = (b - a).cross(&(c - a));
        let longest = (b - a).norm_squared().max((c - a).norm_squared());
        let size = area.norm();
        if size <= 1e-9 * longest {
            return None;
        }
        let normal = area / size;
        let sides = [
            (normal.cross(&(c - b)) / size, 1.0),
            (normal.cross(&(a - c)) / size, 0.0),
            (normal.cross(&(b - a)) / size, 0.0),
        ];
        let rise = (0..3).map(|n| sides[n].0 * plate.radii[n]).sum::<Vec3>();
        let square = rise.norm_squared();
        (square < STEEPEST).then(|| Self {
            from: a,
            normal,
            rise,
            radius: plate.radii[0],
            cosine: (1.0 - square).sqrt(),
            sides,
        })
    }

    /// Signed distance and the nearest centre, where that lies within the triangle.
    fn nearest(&self, p: Vec3) -> Option<(f64, Vec3)> {
        let x = p - self.from;
        let h = x.dot(&self.normal);
        let foot = x - self.normal * h + self.rise * (h.abs() / self.cosine);
        let inside = self.sides.iter().all(|(g, w)| g.dot(&foot) + w >= 0.0);
        let x = x - self.normal * h;
        let value = h.abs() * self.cosine - self.radius - self.rise.dot(&x);
        inside.then(|| (value, self.from + foot))
    }
}

/// A plate as it is evaluated: the beams along its sides, and its inside.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub rim: [Axis; 3],
    pub slab: Option<Slab>,
}

/// A beam or a plate.
#[derive(Clone, Debug)]
pub(super) enum Part {
    Beam(Axis),
    Plate(Box<Facet>),
}

impl From<&Plate> for Part {
    fn from(plate: &Plate) -> Self {
        let side = |n: usize| {
            let m = (n + 1) % 3;
            Axis::new(&Beam {
                ends: [plate.corners[n], plate.corners[m]],
                radii: [plate.radii[n], plate.radii[m]],
            })
        };
        Self::Plate(Box::new(Facet {
            rim: [side(0), side(1), side(2)],
            slab: Slab::new(plate),
        }))
    }
}

impl Part {
    /// Signed distance and the centre of the nearest ball.
    pub fn nearest(&self, p: Vec3) -> (f64, Vec3) {
        match self {
            Self::Beam(axis) => axis.nearest(p),
            Self::Plate(facet) => {
                let rim = facet.rim.iter().map(|axis| axis.nearest(p));
                let inside = facet.slab.as_ref().and_then(|slab| slab.nearest(p));
                let least = rim.chain(inside).min_by(|a, b| a.0.total_cmp(&b.0));
                least.unwrap_or((f64::INFINITY, p))
            }
        }
    }

    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Beam(axis) => axis.bounds(),
            Self::Plate(f) => f.rim.iter().fold(Aabb::EMPTY, |b, a| b.union(a.bounds())),
        }
    }
}
