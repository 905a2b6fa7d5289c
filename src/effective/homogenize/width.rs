//! The least width of a phase of a period, solid or void.
//!
//! The width is the least of three:
//! - the first percentile over the phase's wall of the diameters of the greatest inscribed balls that hold a point of
//!   it, as `least_wall` of a part's report is: edges count with their rounding;
//! - the greatest diameter whose balls reach every point of the wall with sqrt(3) of their radius, the corner of a
//!   cube: it sees a thin member between thick ones, however small its share of the wall;
//! - the diameter of the ball that travels through the phase to the next period: it sees necks that are shorter than
//!   they are wide.
//!
//! Centres of balls lie on the edges between nodes, where distances to opposite walls are equal. Walls are sampled
//! where edges cross them; a member between two nodes is not seen.

use super::opening::{Distances, Nodes, distances, opening_of, steps};
use rayon::prelude::*;

/// How far a ball reaches to see thin members, over its radius: sqrt(3), the corner of a cube.
const REACH: f64 = 1.732_050_807_568_877_2;
/// Node distances by which a point may lie outside the ball that holds it: half of one.
const SLACK: f64 = 0.5;
/// Share of the wall that may be narrower.
const NARROW_SHARE: f64 = 0.01;
/// Points of the wall that are measured, about.
const MAX_POINTS: usize = 4000;
/// A ball counts as inside one beside it if their radii differ by this share of the distance of their centres: exactly
/// it would be 1, the rest is for errors of distances.
const CONTAINED: f64 = 0.9;

/// An inscribed ball, in node distances.
#[derive(Clone, Copy)]
struct Ball {
    centre: [f64; 3],
    radius: f64,
}

fn distance(a: [f64; 3], b: [f64; 3], period: f64) -> f64 {
    let square = |axis: usize| {
        let off = a[axis] - b[axis];
        (off - period * (off / period).round()).powi(2)
    };
    (square(0) + square(1) + square(2)).sqrt()
}

/// Points of the wall that no ball holds or reaches so far.
struct Waiting {
    points: Vec<[f64; 3]>,
    /// Number of points that may be left.
    allowed: usize,
    /// Diameter of the last ball that was needed, node distances.
    least: f64,
}

impl Waiting {
    fn is_over(&self) -> bool {
        self.points.len() <= self.allowed
    }

    /// Removes the points near a ball.
    fn take(&mut self, ball: &Ball, reach: f64, period: f64) {
        let before = self.points.len();
        if self.is_over() {
            return;
        }
        self.points
            .retain(|p| distance(*p, ball.centre, period) > reach);
        if self.points.len() < before {
            self.least = 2.0 * ball.radius;
        }
    }
}

/// The greatest ball with its centre at a node or on an edge that starts there.
fn ball_at(nodes: Nodes, found: &Distances, node: usize, steps: &[[i32; 3]]) -> Ball {
    let from = nodes.place(node).map(|c| c as f64);
    let mut ball = Ball {
        centre: from,
        radius: found.signed[node],
    };
    let rise = |node: usize, along: [f64; 3]| -> f64 {
        // The slope of the distance is the unit vector from the nearest point of the wall.
        let (at, to) = (nodes.place(node), found.walls[found.nearest[node] as usize]);
        let period = nodes.0 as f64;
        let off: [f64; 3] = std::array::from_fn(|a| {
            let off = at[a] as f64 - to[a];
            off - period * (off / period).round()
        });
        let sum: f64 = (0..3).map(|a| along[a] * off[a]).sum();
        sum / found.signed[node]
    };
    for step in steps {
        let (other, _) = nodes.beside(node, *step);
        let (here, there) = (found.signed[node], found.signed[other]);
        if here <= 0.0 || there <= 0.0 || !here.is_finite() {
            continue;
        }
        let along = step.map(f64::from);
        // d_a + t s_a = d_b + (1 - t) s_b, where the distances from both ends are equal.
        let (up, down) = (rise(node, along), rise(other, along.map(|c| -c)));
        let t = (there + down - here) / (up + down);
        let radius = here + t * up;
        if up > 0.0 && down > 0.0 && (0.0..=1.0).contains(&t) && radius > ball.radius {
            ball = Ball {
                centre: std::array::from_fn(|a| from[a] + t * along[a]),
                radius,
            };
        }
    }
    ball
}

/// Balls that do not lie in one beside them, the greatest first.
fn ridge(nodes: Nodes, balls: &[Option<Ball>], steps: &[[i32; 3]]) -> Vec<Ball> {
    let is_ridge = |(node, ball): (usize, &Option<Ball>)| {
        let own = (*ball)?;
        let is_within = steps.iter().any(|step| {
            balls[nodes.beside(node, *step).0].is_some_and(|other| {
                let apart = distance(own.centre, other.centre, nodes.0 as f64);
                other.radius - own.radius > CONTAINED * apart
            })
        });
        (!is_within).then_some(own)
    };
    let mut ridge: Vec<Ball> = balls.par_iter().enumerate().filter_map(is_ridge).collect();
    // The sort is stable: of equals the lesser node comes first.
    ridge.sort_by(|a, b| b.radius.total_cmp(&a.radius));
    ridge
}

/// The least width of the phase where `values` at the `n`^3 nodes of a period are positive and `belongs` is true, in
/// periods; 0 where it does not continue along all axes.
pub fn width(n: usize, values: &[f64], belongs: &(dyn Fn(usize) -> bool + Sync)) -> f64 {
    let (nodes, period, steps) = (Nodes(n), n as f64, steps());
    let found = distances(nodes, values);
    let balls: Vec<Option<Ball>> = (0..values.len())
        .into_par_iter()
        .map(|v| (values[v] > 0.0 && belongs(v)).then(|| ball_at(nodes, &found, v, &steps)))
        .collect();
    let radii: Vec<f64> = balls.iter().map(|b| b.map_or(-1.0, |b| b.radius)).collect();
    let passage = opening_of(nodes, &radii, |v| radii[v] > 0.0);
    let walls = found.walls.iter().zip(&found.inside);
    let own = walls.filter(|(_, v)| belongs(**v as usize)).map(|w| *w.0);
    let own: Vec<[f64; 3]> = own.collect();
    // An odd step through the points keeps out of the pattern of even symmetries.
    let stride = own.len() / MAX_POINTS / 2 * 2 + 1;
    let own: Vec<[f64; 3]> = own.into_iter().step_by(stride).collect();
    let waiting = |allowed: f64| Waiting {
        points: own.clone(),
        allowed: (allowed * own.len() as f64).floor() as usize,
        least: f64::INFINITY,
    };
    let (mut held, mut reached) = (waiting(NARROW_SHARE), waiting(0.0));
    for ball in ridge(nodes, &balls, &steps) {
        if held.is_over() && reached.is_over() {
            break;
        }
        held.take(&ball, ball.radius + SLACK, period);
        reached.take(&ball, REACH * ball.radius, period);
    }
    let least = held.least.min(reached.least);
    // Widths of balls are in distances of nodes, the passage is in periods already.
    (least / period).min(2.0 * passage.radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn width_of(n: usize, value: impl Fn([f64; 3]) -> f64) -> f64 {
        let nodes = Nodes(n);
        let place = |v| nodes.place(v).map(|c| c as f64 / n as f64 - 0.5);
        let values: Vec<f64> = (0..n * n * n).map(|v| value(place(v))).collect();
        width(n, &values, &|_| true)
    }

    /// Round bars of this radius along the axes, shifted off the nodes, and a plate across z of half this thickness.
    fn bars(radius: f64, plate: f64) -> impl Fn([f64; 3]) -> f64 {
        move |p: [f64; 3]| {
            let p = p.map(|c| c - 0.0037);
            let bar = |a: usize| radius - p[(a + 1) % 3].hypot(p[(a + 2) % 3]);
            bar(0).max(bar(1)).max(bar(2)).max(plate - p[2].abs())
        }
    }

    #[test]
    fn bars_have_their_diameter_and_thin_plates_their_thickness() {
        let plain = width_of(48, bars(0.11, -1.0));
        assert!((plain - 0.22).abs() < 4e-3, "{}", plain);
        let thin = width_of(48, bars(0.11, 0.03));
        assert!((thin - 0.06).abs() < 3e-3, "{}", thin);
    }

    #[test]
    fn a_thin_rod_counts_however_small_its_share_of_the_wall() {
        let rod = |p: [f64; 3]| {
            let rod = 0.025 - (p[0] - 0.2537).hypot(p[1] - 0.2463);
            bars(0.2, -1.0)(p).max(rod)
        };
        let found = width_of(64, rod);
        assert!((found - 0.05).abs() < 8e-3, "{}", found);
    }

    #[test]
    fn short_necks_count_by_the_ball_that_passes() {
        // Balls of radius 0.52 around the corners of the period overlap in necks of radius sqrt(0.52^2 - 0.25).
        let balls = |p: [f64; 3]| 0.52 - p.map(|c| c * c).iter().sum::<f64>().sqrt();
        let found = width_of(40, balls);
        let neck = 2.0 * (0.52f64.powi(2) - 0.25).sqrt();
        assert!((found - neck).abs() < 0.02, "{} {neck}", found);
        // Balls that do not touch have no width.
        let apart = |p: [f64; 3]| 0.4 - p.map(|c| c * c).iter().sum::<f64>().sqrt();
        assert_eq!(width_of(40, apart), 0.0);
    }
}
