//! Collapse of edges: fewer triangles over the same vertices, of the same topology.
//!
//! A collapse moves a vertex onto a neighbour and removes the two triangles between them. Its cost is the quadric
//! error (Garland and Heckbert, *Surface Simplification Using Quadric Error Metrics*, 1997). It satisfies the link
//! condition (Dey, Edelsbrunner, Guha and Nekhayev, *Topology Preserving Edge Contraction*, 1999): the two vertices
//! have no common neighbours but the two opposite their edge. So each edge keeps its two triangles, and neither the
//! number of components nor the genus changes. No triangle turns over or loses its area, and none folds back onto a
//! neighbour unless one did there before.
//!
//! A pass determines the cheapest collapse of each vertex in parallel, then makes them in the order of their costs,
//! except those whose neighbourhood the pass has changed. The result does not depend on the number of threads.

use super::half_edges::HalfEdges;
use crate::frame::{Mat3, Vec3};
use rayon::prelude::*;

/// Least cosine between the normals of a triangle before and after a collapse: a turn of 76 degrees.
const MIN_TURN_COSINE: f64 = 0.25;
/// Least cosine between the normals of neighbours that a collapse makes (143 degrees), unless neighbours there are
/// folded more.
const MIN_FOLD_COSINE: f64 = -0.8;
/// Least ratio of a triangle's height to its longest edge: the normal of a thinner one is unreliable. A triangle that was
/// thin may become half as wide for its length, down to the second ratio.
const MIN_HEIGHT_RATIO: f64 = 1e-3;
const MIN_THIN_HEIGHT_RATIO: f64 = 1e-6;
/// Share of the squared length of an edge in its cost: in flat regions short edges collapse first.
const LENGTH_SHARE: f64 = 1e-6;
/// Greatest number of triangles about a vertex after a collapse, since the cost of a test grows with its square.
const MAX_VALENCE: usize = 64;
/// A pass that removes less than this share of the triangles is the last one.
const MIN_PASS_SHARE: f64 = 1e-3;

/// Where collapses end.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct CollapseGoal {
    /// Number of triangles.
    pub triangles: usize,
    /// Greatest distance, by root mean square weighted by area, of a moved vertex from the planes of its original
    /// triangles.
    pub error: Option<f64>,
}

/// About as many triangles as the goal, fewer by one at most and more where few can collapse within its error. Vertices
/// on open, non-manifold and misoriented edges, pinched ones and those of triangles that repeat a vertex stay, and no
/// new edge joins two of them. `triangles` index `vertices`; the result indexes the same vertices and may leave some
/// unused. Distances in the goal have the unit of the vertices.
#[doc(hidden)]
pub fn collapsed(vertices: &[Vec3], triangles: &[[u32; 3]], goal: CollapseGoal) -> Vec<[u32; 3]> {
    let mut surface = Surface::new(vertices, triangles);
    let max_squared_error = goal.error.map_or(f64::INFINITY, |e| e * e);
    while surface.triangles.len() > goal.triangles {
        let before = surface.triangles.len();
        // A collapse removes two triangles: passes and shares of triangles count half as many collapses.
        let remaining = (before - goal.triangles).div_ceil(2);
        let made = surface.pass(remaining, max_squared_error);
        surface.remove_collapsed();
        if made < remaining && (made as f64) <= MIN_PASS_SHARE / 2.0 * before as f64 {
            break;
        }
    }
    surface.triangles
}

/// The sum of the squared distances from planes, weighted by area, about a vertex.
#[derive(Clone, Copy)]
struct Quadric {
    /// Sum of w n n^T.
    normals: Mat3,
    /// Half the gradient at the vertex.
    half_gradient: Vec3,
    /// The value at the vertex.
    value: f64,
    /// Sum of the weights, twice the areas.
    weight: f64,
}

impl Quadric {
    const ZERO: Self = Self {
        normals: Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        half_gradient: Vec3::new(0.0, 0.0, 0.0),
        value: 0.0,
        weight: 0.0,
    };

    /// Adds the plane of a triangle at the vertex, by its area vector.
    fn add_plane(&mut self, area_vector: Vec3) {
        let weight = area_vector.norm();
        if weight > 0.0 {
            self.normals += area_vector * area_vector.transpose() / weight;
            self.weight += weight;
        }
    }

    /// The value at an offset r from the vertex: r^T N r + 2 g r + c.
    fn at_offset(&self, r: Vec3) -> f64 {
        let value = r.dot(&(self.normals * r)) + 2.0 * self.half_gradient.dot(&r) + self.value;
        value.max(0.0)
    }

    /// Adds the quadric of a vertex from which this one's lies at the offset `r`.
    fn add_moved(&mut self, other: &Self, r: Vec3) {
        self.value += other.at_offset(r);
        self.half_gradient += other.half_gradient + other.normals * r;
        self.normals += other.normals;
        self.weight += other.weight;
    }
}

/// The move of a vertex onto a neighbour.
#[derive(Clone, Copy)]
struct Collapse {
    cost: f64,
    from: u32,
    to: u32,
}

/// Triangles about each vertex: those of vertex v are numbers `starts[v]` to `starts[v + 1]`.
#[derive(Default)]
struct Stars {
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Stars {
    fn of(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let mut starts = vec![0u32; vertices + 1];
        for &v in triangles.as_flattened() {
            starts[v as usize + 1] += 1;
        }
        for v in 0..vertices {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut about = vec![0; 3 * triangles.len()];
        for (t, triangle) in (0..).zip(triangles) {
            for &v in triangle {
                about[next[v as usize] as usize] = t;
                next[v as usize] += 1;
            }
        }
        Self {
            starts,
            triangles: about,
        }
    }

    fn about(&self, v: u32) -> &[u32] {
        let [from, to] = [0, 1].map(|n| self.starts[v as usize + n] as usize);
        &self.triangles[from..to]
    }
}

/// A triangle from a vertex on: the other two corners in order.
fn from_corner(triangle: [u32; 3], v: u32) -> Option<[u32; 2]> {
    let [a, b, c] = triangle;
    match v {
        _ if a == v => Some([b, c]),
        _ if b == v => Some([c, a]),
        _ if c == v => Some([a, b]),
        _ => None,
    }
}

/// A surface while its edges collapse.
struct Surface<'a> {
    vertices: &'a [Vec3],
    /// Collapsed triangles repeat a vertex until the end of the pass.
    triangles: Vec<[u32; 3]>,
    /// The triangles about each vertex at the start of the pass.
    stars: Stars,
    quadrics: Vec<Quadric>,
    /// Vertices that stay: pinched, of triangles that repeat one, or on edges not of two triangles of one orientation.
    is_fixed: Vec<bool>,
}

impl<'a> Surface<'a> {
    /// The surface before the first pass, with the quadric and the fixed state of each vertex.
    fn new(vertices: &'a [Vec3], triangles: &[[u32; 3]]) -> Self {
        let mut surface = Self {
            vertices,
            triangles: triangles.to_vec(),
            stars: Stars::of(triangles, vertices.len()),
            quadrics: vec![Quadric::ZERO; vertices.len()],
            is_fixed: vec![false; vertices.len()],
        };
        // Vertices on an edge stay unless exactly two triangles of one orientation meet there.
        for edge in HalfEdges::of(triangles, vertices.len()).edges() {
            if !matches!(edge, [s, t] if s.is_forward() != t.is_forward()) {
                surface.is_fixed[edge[0].lo as usize] = true;
                surface.is_fixed[edge[0].hi as usize] = true;
            }
        }
        // A quadric is the squared distance to the planes around a vertex, weighted by their areas. Triangles that
        // repeat a vertex fix their corners.
        for &triangle in triangles {
            let area_vector = surface.area_vector(triangle);
            let repeats = triangle[0] == triangle[1] || triangle[1] == triangle[2];
            for v in triangle {
                surface.quadrics[v as usize].add_plane(area_vector);
                surface.is_fixed[v as usize] |= repeats || triangle[2] == triangle[0];
            }
        }
        for v in 0..vertices.len() as u32 {
            surface.is_fixed[v as usize] |= surface.is_pinched(v);
        }
        surface
    }

    /// Whether the triangles about a vertex are more than one fan.
    fn is_pinched(&self, v: u32) -> bool {
        let about = self.around(v);
        let Some(&[first, mut at]) = about.first() else {
            return false;
        };
        let mut steps = 1;
        while at != first && steps < about.len() {
            let Some(&[_, next]) = about.iter().find(|[from, _]| *from == at) else {
                return true;
            };
            at = next;
            steps += 1;
        }
        at != first || steps != about.len()
    }

    fn area_vector(&self, triangle: [u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|v| self.vertices[v as usize]);
        (b - a).cross(&(c - a))
    }

    fn offset(&self, from: u32, to: u32) -> Vec3 {
        self.vertices[to as usize] - self.vertices[from as usize]
    }

    /// The edges opposite a vertex, one per triangle about it.
    fn around(&self, v: u32) -> Vec<[u32; 2]> {
        let about = self.stars.about(v).iter();
        about
            .filter_map(|&t| from_corner(self.triangles[t as usize], v))
            .collect()
    }

    /// The triangle of a vertex's star with the directed edge from `a` to `b`.
    fn triangle_of(&self, star: u32, [a, b]: [u32; 2]) -> Option<[u32; 3]> {
        let about = self.stars.about(star).iter();
        let mut live = about.map(|&t| self.triangles[t as usize]);
        live.find(|t| from_corner(*t, a).is_some_and(|[next, _]| next == b))
    }

    fn are_neighbours(&self, a: u32, b: u32) -> bool {
        let mut about = self.stars.about(a).iter();
        about.any(|&t| {
            from_corner(self.triangles[t as usize], a).is_some_and(|others| others.contains(&b))
        })
    }

    /// The cheapest permitted collapse of a vertex onto a neighbour; `None` for a fixed vertex or if none is permitted.
    /// An error is the mean squared distance from the planes, times their weight; `max_squared_error` bounds it per unit
    /// of weight.
    fn cheapest(&self, from: u32, max_squared_error: f64) -> Option<Collapse> {
        if self.is_fixed[from as usize] {
            return None;
        }
        let around = self.around(from);
        let quadric = &self.quadrics[from as usize];
        let mut all: Vec<Collapse> = around
            .iter()
            .filter_map(|&[to, _]| {
                let r = self.offset(from, to);
                let error = quadric.at_offset(r);
                (error <= max_squared_error * quadric.weight).then(|| Collapse {
                    cost: error + LENGTH_SHARE * quadric.weight * r.norm_squared(),
                    from,
                    to,
                })
            })
            .collect();
        all.sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then(a.to.cmp(&b.to)));
        all.into_iter().find(|c| self.permits(*c, &around))
    }

    /// Whether a collapse keeps the topology and makes no bad triangle; `around` are the edges opposite its start, one
    /// per triangle.
    fn permits(&self, collapse: Collapse, around: &[[u32; 2]]) -> bool {
        let Collapse { from, to, .. } = collapse;
        // A collapse joins both stars and loses two triangles of each.
        if around.len() + self.stars.about(to).len() > MAX_VALENCE + 4 {
            return false;
        }
        // The link condition.
        let neighbours = around.iter().map(|e| e[0]).filter(|v| *v != to);
        let mut common = [u32::MAX; 2];
        let mut count = 0;
        for v in neighbours.clone().filter(|&v| self.are_neighbours(to, v)) {
            if count == 2 {
                return false;
            }
            common[count] = v;
            count += 1;
        }
        let [c, d] = common;
        // A vertex of three triangles is the tip of a tetrahedron, if its base exists.
        let is_tetrahedron = || {
            [[c, d], [d, c]]
                .iter()
                .any(|edge| self.triangle_of(c, *edge).is_some_and(|t| t.contains(&to)))
        };
        if count != 2 || around.len() == 3 && is_tetrahedron() {
            return false;
        }
        // The surface beyond a border may have the same new edge.
        let is_chord = |v: u32| !common.contains(&v) && self.is_fixed[v as usize];
        if self.is_fixed[to as usize] && neighbours.clone().any(is_chord) {
            return false;
        }
        let new: Vec<[u32; 3]> = around
            .iter()
            .filter(|e| !e.contains(&to))
            .map(|&[u, v]| [to, u, v])
            .collect();
        new.iter().all(|t| self.keeps_shape(*t, from)) && self.keeps_folds(&new, from, around)
    }

    /// Whether a triangle, whose first corner comes from another vertex, keeps its orientation and has an area: it is not
    /// thin, or more than half as wide for its length as it was.
    fn keeps_shape(&self, [to, u, v]: [u32; 3], from: u32) -> bool {
        let [before, after] = [from, to].map(|w| self.area_vector([w, u, v]));
        // Twice the area is height times edge.
        let height_ratio = |w: u32, size: f64| {
            let edges = [[w, u], [u, v], [v, w]];
            let squares = edges.map(|[a, b]| self.offset(a, b).norm_squared());
            size / squares.into_iter().fold(0.0, f64::max)
        };
        let size = after.norm();
        let half = height_ratio(from, before.norm()) / 2.0;
        let least = half.clamp(MIN_THIN_HEIGHT_RATIO, MIN_HEIGHT_RATIO);
        height_ratio(to, size) > least
            && before.dot(&after) >= MIN_TURN_COSINE * size * before.norm()
    }

    /// Whether no new triangle folds back onto a neighbour, or not more than one of `from` did.
    fn keeps_folds(&self, new: &[[u32; 3]], from: u32, around: &[[u32; 2]]) -> bool {
        let least = self.fold(new, Some(from));
        if least >= MIN_FOLD_COSINE {
            return true;
        }
        let old: Vec<[u32; 3]> = around.iter().map(|&[u, v]| [from, u, v]).collect();
        least >= self.fold(&old, None)
    }

    /// The least cosine between the normals of triangles and their neighbours; 1 without neighbours. A neighbour is
    /// sought among the triangles first, then on the surface without those of the vertex `without`.
    fn fold(&self, triangles: &[[u32; 3]], without: Option<u32>) -> f64 {
        let mut least = 1.0f64;
        for &triangle in triangles {
            let normal = self.area_vector(triangle);
            let [a, b, c] = triangle;
            // The neighbour over an edge has the edge in the other direction.
            for [u, v] in [[a, b], [b, c], [c, a]] {
                let has_edge = |t: &[u32; 3]| from_corner(*t, v).is_some_and(|[next, _]| next == u);
                let among = triangles.iter().copied().find(has_edge);
                let beyond = || {
                    [u, v]
                        .iter()
                        .filter_map(|&star| self.triangle_of(star, [v, u]))
                        .find(|t| without.is_none_or(|w| !t.contains(&w)))
                };
                let Some(neighbour) = among.or_else(beyond) else {
                    continue;
                };
                let other = self.area_vector(neighbour);
                let sizes = normal.norm() * other.norm();
                if sizes > 0.0 {
                    least = least.min(normal.dot(&other) / sizes);
                }
            }
        }
        least
    }

    /// Makes at most `remaining` collapses that do not touch each other, the cheapest first. Returns their number.
    /// None has a greater error than `max_squared_error` for each unit of weight.
    fn pass(&mut self, remaining: usize, max_squared_error: f64) -> usize {
        let vertices = 0..self.vertices.len() as u32;
        let mut candidates: Vec<Collapse> = vertices
            .into_par_iter()
            // A vertex is too little work for a task.
            .with_min_len(256)
            .filter_map(|v| self.cheapest(v, max_squared_error))
            .collect();
        candidates.par_sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then(a.from.cmp(&b.from)));
        // Costlier ones wait for the next pass, when cheaper ones may have appeared.
        candidates.truncate(remaining.min(candidates.len() / 2) + 1);
        let mut is_changed = vec![false; self.vertices.len()];
        let mut made = 0;
        for collapse in candidates {
            let [from, to] = [collapse.from, collapse.to].map(|v| v as usize);
            if made == remaining {
                break;
            }
            if is_changed[from] || is_changed[to] {
                continue;
            }
            let around = self.around(collapse.from);
            // Triangles beyond the neighbours may have moved.
            if !self.permits(collapse, &around) {
                continue;
            }
            let r = self.offset(collapse.from, collapse.to);
            let moved = self.quadrics[from];
            self.quadrics[to].add_moved(&moved, r);
            // The neighbours' stars have changed: they wait for the next pass.
            is_changed[from] = true;
            for edge in &around {
                is_changed[edge[0] as usize] = true;
            }
            for &t in self.stars.about(collapse.from) {
                let triangle = &mut self.triangles[t as usize];
                if triangle.contains(&collapse.to) {
                    *triangle = [0; 3];
                } else {
                    *triangle = triangle.map(|v| if v == collapse.from { collapse.to } else { v });
                }
            }
            made += 1;
        }
        made
    }

    /// Ends a pass: drops the triangles that repeat a vertex, and finds the stars of the remaining ones.
    fn remove_collapsed(&mut self) {
        self.triangles.retain(|t| t[0] != t[1]);
        self.stars = Stars::of(&self.triangles, self.vertices.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The chamfer around the top of a block, of triangles a ten thousandth as wide as long, collapses onto an edge.
    #[test]
    fn narrow_strips_collapse() {
        let w = 0.001;
        let ring = |inset: f64, z: f64| {
            let (low, high) = (inset, 10.0 - inset);
            [[low, low], [high, low], [high, high], [low, high]].map(|[x, y]| Vec3::new(x, y, z))
        };
        let corners = [ring(0.0, 0.0), ring(0.0, 4.0 - w), ring(w, 4.0)].concat();
        let mut triangles = vec![[0, 2, 1], [0, 3, 2], [8, 9, 10], [8, 10, 11]];
        for (from, i) in [0, 4].into_iter().flat_map(|f| (0..4).map(move |i| (f, i))) {
            let (a, b) = (from + i, from + (i + 1) % 4);
            triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
        let goal = CollapseGoal {
            triangles: 0,
            error: Some(2.0 * w),
        };
        let kept = collapsed(&corners, &triangles, goal);
        let volume = kept.iter().map(|t| {
            let [a, b, c] = t.map(|v: u32| corners[v as usize]);
            a.cross(&b).dot(&c) / 6.0
        });
        let share = volume.sum::<f64>() / 400.0;
        assert!(
            kept.len() == 12 && (share - 1.0).abs() < 1e-3,
            "{} {share}",
            kept.len()
        );
    }
}
