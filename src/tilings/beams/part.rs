//! Exact signed distances of a round beam and of a plate.
//!
//! A beam is a ball swept along a segment with a linear radius. With h the coordinate along the axis, q the
//! distance from it and s the decrease of the radius per unit of length, the ball nearest to a point has its
//! centre at t = h - q s / sqrt(1 - s^2), clamped to the segment. The distance is that to the centre minus
//! the radius there. A plate is a ball swept over a triangle with a linear radius: the beams along its edges,
//! and over its interior the two planes tangent to all balls.

use druse_geometry::frame::{Aabb, Vec3};

/// Largest change of a radius per unit of length; for a larger one, the ball of one end contains the other's.
const MAX_TAPER: f64 = 1.0 - 1e-9;

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

/// A beam in the form of its evaluation, lengths in world units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    /// The first centre.
    pub from: Vec3,
    /// Unit vector towards the second centre; zero for a ball.
    pub along: Vec3,
    pub length: f64,
    /// Radius at the first centre.
    pub radius: f64,
    /// Decrease of the radius per unit of length, s.
    pub slope: f64,
    /// s / sqrt(1 - s^2).
    pub shift: f64,
}

impl Axis {
    /// The axis of a beam. Where one end ball contains the other, it is that ball.
    pub fn new(beam: &Beam) -> Self {
        let [a, b] = beam.ends;
        let [ra, rb] = beam.radii;
        let length = (b - a).norm();
        if (ra - rb).abs() >= MAX_TAPER * length {
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

    /// The corresponding beam.
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

/// The interior of a plate, lengths in world units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slab {
    pub from: Vec3,
    pub normal: Vec3,
    /// Gradient of the radius in the plane, g.
    pub radius_gradient: Vec3,
    /// Radius at `from`.
    pub radius: f64,
    /// sqrt(1 - g^2).
    pub cosine: f64,
    /// Barycentric coordinates: gradients in the plane, and values at `from`.
    pub barycentric: [(Vec3, f64); 3],
}

impl Slab {
    /// The interior of a plate in the frame of its triangle. `None` for a triangle without area, or for a slope of the
    /// radius of 1 or more: then the edges alone bound the plate.
    fn new(plate: &Plate) -> Option<Self> {
        let [a, b, c] = plate.corners;
        let area = (b - a).cross(&(c - a));
        let longest = (b - a).norm_squared().max((c - a).norm_squared());
        let size = area.norm();
        if size <= 1e-9 * longest {
            return None;
        }
        let normal = area / size;
        // A barycentric coordinate rises at a right angle to the opposite side, by 1 over the triangle's height there.
        let barycentric = [
            (normal.cross(&(c - b)) / size, 1.0),
            (normal.cross(&(a - c)) / size, 0.0),
            (normal.cross(&(b - a)) / size, 0.0),
        ];
        // The radius is linear: its gradient is the sum of those of the barycentrics times the corners' radii.
        let radius_gradient = (0..3)
            .map(|n| barycentric[n].0 * plate.radii[n])
            .sum::<Vec3>();
        let square = radius_gradient.norm_squared();
        (square < MAX_TAPER).then(|| Self {
            from: a,
            normal,
            radius_gradient,
            radius: plate.radii[0],
            cosine: (1.0 - square).sqrt(),
            barycentric,
        })
    }

    /// Signed distance and the nearest centre, if that lies within the triangle.
    fn nearest(&self, p: Vec3) -> Option<(f64, Vec3)> {
        let x = p - self.from;
        // The nearest ball's centre is |h| g / sqrt(1 - g^2) beside the foot of p: the value is |h| sqrt(1 - g^2) - r.
        let h = x.dot(&self.normal);
        let foot = x - self.normal * h + self.radius_gradient * (h.abs() / self.cosine);
        let inside = self
            .barycentric
            .iter()
            .all(|(g, w)| g.dot(&foot) + w >= 0.0);
        let x = x - self.normal * h;
        let value = h.abs() * self.cosine - self.radius - self.radius_gradient.dot(&x);
        inside.then(|| (value, self.from + foot))
    }
}

/// A plate in the form of its evaluation: the beams along its edges, and its interior.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub edges: [Axis; 3],
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
            edges: [side(0), side(1), side(2)],
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
                let edges = facet.edges.iter().map(|axis| axis.nearest(p));
                let inside = facet.slab.as_ref().and_then(|slab| slab.nearest(p));
                let least = edges.chain(inside).min_by(|a, b| a.0.total_cmp(&b.0));
                least.unwrap_or((f64::INFINITY, p))
            }
        }
    }

    /// The box of the part with its radius, world units.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Beam(axis) => axis.bounds(),
            Self::Plate(f) => f.edges.iter().fold(Aabb::EMPTY, |b, a| b.union(a.bounds())),
        }
    }
}
