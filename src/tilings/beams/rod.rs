//! Rods: beams with a linear radius and flat or hemispherical ends.
//!
//! In the half plane through the axis, with h along it and q away from it, a rod is bounded by a slanted side
//! and at each end by a straight line or a quarter circle. The distance is that to the nearest of the three,
//! exact inside and outside of one rod. Of several rods the minimum counts, as in [`super::Beams`].

use super::Beam;
use druse_geometry::field::{Field, Interval, SampleLattice};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use druse_geometry::mesh::Bvh;

/// A truncated cone with flat or hemispherical ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod {
    /// Its ends and the radii there, world units.
    pub beam: Beam,
    /// Whether an end is a hemisphere; else it is flat.
    pub is_round: [bool; 2],
}

/// A rod in the form of its evaluation.
struct Axis {
    from: Vec3,
    along: Vec3,
    length: f64,
    radii: [f64; 2],
    is_round: [bool; 2],
}

/// A union of rods.
pub struct Rods {
    /// In the order of the tree's slots.
    axes: Vec<Axis>,
    tree: Bvh,
    bounds: Aabb,
}

/// The point of a planar segment nearest to a point.
fn on_segment(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let d = [b[0] - a[0], b[1] - a[1]];
    let square = d[0] * d[0] + d[1] * d[1];
    let t = if square > 0.0 {
        (((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    [a[0] + d[0] * t, a[1] + d[1] * t]
}

impl Axis {
    fn new(rod: &Rod) -> Self {
        let [a, b] = rod.beam.ends;
        Self {
            from: a,
            along: (b - a).try_normalize(0.0).unwrap_or_else(Vec3::z),
            length: (b - a).norm(),
            radii: rod.beam.radii,
            is_round: rod.is_round,
        }
    }

    /// The point of an end's boundary nearest to (h, q), with h measured outwards from the end.
    fn on_cap(&self, end: usize, [h, q]: [f64; 2]) -> [f64; 2] {
        let r = self.radii[end];
        if !self.is_round[end] {
            return on_segment([h, q], [0.0, 0.0], [0.0, r]);
        }
        let d = h.hypot(q);
        if h <= 0.0 {
            [0.0, r]
        } else {
            [h * r / d, q * r / d]
        }
    }

    /// Signed distance and its gradient at a point, world units. Exact inside and outside of this rod.
    fn value(&self, p: Vec3) -> (f64, Vec3) {
        // h along the axis, q away from it.
        let x = p - self.from;
        let h = x.dot(&self.along);
        let across = x - self.along * h;
        let q = across.norm();
        let [r, s] = self.radii;
        let point = [h, q];
        let first = self.on_cap(0, [-h, q]);
        let last = self.on_cap(1, [h - self.length, q]);
        // The nearest points of the side and both ends. `on_cap` measures h outwards.
        let nearest = [
            on_segment(point, [0.0, r], [self.length, s]),
            [-first[0], first[1]],
            [self.length + last[0], last[1]],
        ];
        let mut best = (f64::INFINITY, [0.0; 2]);
        for c in nearest {
            let d = (h - c[0]).hypot(q - c[1]);
            if d < best.0 {
                best = (d, c);
            }
        }
        let (distance, c) = best;
        // Beyond an end only a hemisphere is inside; between the ends, q is compared with the radius there.
        let is_inside = if h < 0.0 {
            self.is_round[0] && h.hypot(q) < r
        } else if h > self.length {
            self.is_round[1] && (h - self.length).hypot(q) < s
        } else {
            q < r + (s - r) * h / self.length.max(f64::MIN_POSITIVE)
        };
        let sign = if is_inside { -1.0 } else { 1.0 };
        let outward = across.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        // (p - c) / distance, outwards; on the surface itself, the direction away from the axis.
        let gradient = if distance > 0.0 {
            (self.along * (h - c[0]) + outward * (q - c[1])) * (sign / distance)
        } else {
            outward
        };
        (sign * distance, gradient)
    }

    fn bounds(&self) -> Aabb {
        let ball = |c: Vec3, r: f64| Aabb { min: c, max: c }.dilated(r);
        let to = self.from + self.along * self.length;
        // A flat end is a disc.
        let disc = self.along.map(|a| (1.0 - a * a).max(0.0).sqrt());
        let end = |c: Vec3, n: usize| {
            if self.is_round[n] {
                return ball(c, self.radii[n]);
            }
            Aabb {
                min: c - disc * self.radii[n],
                max: c + disc * self.radii[n],
            }
        };
        end(self.from, 0).union(end(to, 1))
    }
}

impl Rods {
    /// The union of rods; `None` without any.
    pub fn new(rods: &[Rod]) -> Option<Self> {
        let bounds = |n: usize| Axis::new(&rods[n]).bounds();
        let whole = (0..rods.len()).fold(Aabb::EMPTY, |b, n| b.union(bounds(n)));
        if whole.is_empty() {
            return None;
        }
        let tree = Bvh::new(rods.len(), bounds);
        let axes = tree.order().iter().map(|&n| Axis::new(&rods[n as usize]));
        Some(Self {
            axes: axes.collect(),
            tree,
            bounds: whole,
        })
    }

    /// The bounding box of the solid.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }
}

impl Field for Rods {
    type Point = WorldPoint;

    fn value(&self, p: WorldPoint) -> f64 {
        self.value_and_gradient(p).0
    }

    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let mut best = (f64::INFINITY, Vec3::zeros());
        self.tree.nearest(p.0, f64::INFINITY, |slot| {
            let found = self.axes[slot].value(p.0);
            (found.0 < best.0).then(|| {
                best = found;
                // Inside the solid, all rods whose boxes contain the point are candidates.
                best.0.max(0.0)
            })
        });
        best
    }

    fn bound(&self, region: &Aabb) -> Interval {
        let (value, radius) = (self.value(region.centre()), region.half_diagonal());
        Interval::new(value - radius, value + radius)
    }

    /// The values at the samples of a lattice, z fastest, world units: at each the least signed distance to a rod.
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let span = lattice.span();
        let (centre, radius) = (span.centre(), span.half_diagonal());
        // A rod whose distance from the centre exceeds the smallest one by the ball's diameter is never nearest.
        let reach = self.value(centre) + 2.0 * radius * (1.0 + 1e-9);
        let mut near = Vec::new();
        let around = Aabb {
            min: centre.0,
            max: centre.0,
        };
        self.tree
            .overlapping(&around.dilated(reach.max(0.0)), |slot| {
                if self.axes[slot].value(centre.0).0 <= reach {
                    near.push(slot);
                }
                true
            });
        for (n, v) in out.iter_mut().enumerate() {
            let p = lattice.point(n).0;
            let values = near.iter().map(|&slot| self.axes[slot].value(p).0);
            *v = values.fold(f64::INFINITY, f64::min) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rod(radii: [f64; 2], is_round: [bool; 2]) -> Rods {
        let ends = [Vec3::zeros(), Vec3::new(0.0, 0.0, 4.0)];
        let beam = Beam { ends, radii };
        Rods::new(&[Rod { beam, is_round }]).unwrap()
    }

    fn at(rods: &Rods, q: f64, h: f64) -> f64 {
        rods.value(WorldPoint(Vec3::new(0.6 * q, 0.8 * q, h)))
    }

    #[test]
    fn flat_cylinders_have_the_distances_of_cylinders() {
        let rods = rod([1.0, 1.0], [false, false]);
        for (q, h, expected) in [
            (0.0, 2.0, -1.0),
            (0.0, 0.25, -0.25),
            (3.0, 2.0, 2.0),
            (0.5, -2.0, 2.0),
            (4.0, 8.0, 5.0),
            (0.0, 4.5, 0.5),
        ] {
            assert!((at(&rods, q, h) - expected).abs() < 1e-12, "{q} {h}");
        }
        assert_eq!(rods.bounds().max.z, 4.0);
    }

    #[test]
    fn distances_of_hemispherical_ends_and_cones() {
        let rods = rod([1.0, 1.0], [true, false]);
        assert!((at(&rods, 0.0, -2.0) - 1.0).abs() < 1e-12);
        assert!(
            (at(&rods, 0.0, 0.5) + 1.0).abs() < 1e-12,
            "no wall at the seam"
        );
        assert!((at(&rods, 0.0, 5.0) - 1.0).abs() < 1e-12);
        // A cone whose side falls by 3 over 4: the unit normal of the side is (3/5, 4/5).
        let cone = rod([4.0, 1.0], [false, false]);
        let (q, h) = (2.5 + 0.8, 2.0 + 0.6);
        assert!((at(&cone, q, h) - 1.0).abs() < 1e-12);
        assert!((at(&cone, 2.5 - 0.4, 2.0 - 0.3) + 0.5).abs() < 1e-12);
        assert!((at(&cone, 5.0, -0.75) - 1.25).abs() < 1e-12, "to the rim");
    }

    #[test]
    fn gradients_match_differences_and_fill_matches_values() {
        let ends = [Vec3::new(0.3, -0.2, 0.1), Vec3::new(2.0, 1.0, 1.5)];
        let both = [
            Rod {
                beam: Beam {
                    ends,
                    radii: [0.4, 0.9],
                },
                is_round: [true, false],
            },
            Rod {
                beam: Beam {
                    ends: [ends[1], Vec3::new(3.0, -1.0, 0.5)],
                    radii: [0.7, 0.2],
                },
                is_round: [false, true],
            },
        ];
        let rods = Rods::new(&both).unwrap();
        let lattice = SampleLattice {
            origin: WorldPoint(Vec3::new(-0.9, -1.9, -0.7)),
            step: 0.31,
            counts: [14, 13, 9],
        };
        let mut values = vec![0.0; lattice.len()];
        rods.fill(&lattice, &mut values);
        for (n, v) in values.iter().enumerate() {
            let p = lattice.point(n);
            let (value, gradient) = rods.value_and_gradient(p);
            assert!((f64::from(*v) - value).abs() < 1e-5);
            let by = |d: Vec3| rods.value(WorldPoint(p.0 + d * 1e-5));
            let slope = Vec3::from_fn(|a, _| {
                let d = Vec3::ith(a, 1.0);
                (by(d) - by(-d)) / 2e-5
            });
            // At creases the one-sided derivatives differ.
            if (slope.norm() - 1.0).abs() < 1e-4 {
                assert!((slope - gradient).norm() < 1e-3, "{p:?}");
            }
        }
    }
}
