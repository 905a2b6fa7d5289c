//! The nodes of a filling: on corners, along creases, on faces, and inside on a body-centred lattice.
//!
//! Nodes are about h(x) apart, `h(x) = min(cell, min s_i + |x - x_i| / 2)` over the crease nodes i, where `s_i`
//! is the distance of a crease node from its neighbours. It is less than the cell where creases are
//! short or bend, or come near to each other. Along creases no other crease's node lies in the ball over an
//! edge, on faces nodes keep a distance of 0.8 h, as far as they lie on one side of the part: then Delaunay
//! tets contain the creases and the faces wherever two parts of the surface are not much nearer than h.

use super::creases::{Creases, normal};
use druse_geometry::frame::{Aabb, Vec3};
use druse_geometry::mesh::{Bvh, MeshSolid};
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::HashMap;

/// How fast sizes grow with the distance from a small one.
const GROWTH: f64 = 0.5;
/// Number of halvings of a cell that sizes distinguish.
const LEVELS: usize = 6;
/// Greatest turn of a crease between two of its nodes: 36 degrees.
const MAX_TURN: f64 = std::f64::consts::PI / 5.0;
/// Greatest length of an edge along a crease, as a share of h: a cell's own edges are never halved for it.
const MAX_PART_LENGTH: f64 = 1.2;
/// Least distance of nodes on faces, as a share of h.
const FACE_SPACING: f64 = 0.8;
/// Least distance of inner nodes from others (0.87 in the lattice) and from the surface, as shares of h.
const INNER_SPACING: f64 = 0.7;
const INNER_DEPTH: f64 = 0.55;
/// Nodes of faces whose normals have a lesser cosine lie on different sides of the part.
const SAME_SIDE_COSINE: f64 = 0.3;
/// Distance of places on a face that may become nodes, as a share of h.
const CANDIDATE_STEP: f64 = 0.2;

/// Triangles of more steps along their longest side than this are needles where they are narrower than one.
const MIN_NEEDLE_COUNT: usize = 40;
/// Triangles of so many steps are narrow where their height is less than this share of their longest side.
const NARROW: f64 = 0.25;

/// What a node lies on, and so where it may move to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Site {
    Corner,
    /// The crease of this number.
    Crease(u32),
    Face,
    Inside,
}

/// A node to be.
#[derive(Clone, Copy)]
pub(super) struct Node {
    pub place: Vec3,
    pub site: Site,
}

/// An edge along a crease: between two nodes, from one length along its line to another.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub line: u32,
    pub ends: [u32; 2],
    pub span: [f64; 2],
}

/// Nodes by place, in boxes of one cell, of half a cell, and so on: where nodes are dense a search goes to small boxes.
pub(super) struct Bins {
    size: f64,
    levels: [HashMap<[i64; 3], Vec<u32>>; LEVELS],
}

impl Bins {
    /// Empty bins whose largest have this edge, world units.
    pub fn new(size: f64) -> Self {
        Self {
            size,
            levels: Default::default(),
        }
    }

    /// The bin of a place on a level, by rounding down.
    fn bin(&self, level: usize, p: Vec3) -> [i64; 3] {
        let size = self.size / (1 << level) as f64;
        [p.x, p.y, p.z].map(|c| (c / size).floor() as i64)
    }

    /// Adds a node at its place; nodes at one place are kept apart.
    pub fn add(&mut self, p: Vec3, node: u32) {
        for level in 0..LEVELS {
            let bin = self.bin(level, p);
            self.levels[level].entry(bin).or_default().push(node);
        }
    }

    /// Whether a node fits the test among those at most `radius` from a place, and some beyond. A radius is at most the
    /// edge of the largest bins.
    pub fn any(&self, p: Vec3, radius: f64, mut test: impl FnMut(u32) -> bool) -> bool {
        // The smallest bins whose 27 around a place hold the ball: size / 2^level >= radius.
        let level = (self.size / radius).log2().floor();
        let level = level.clamp(0.0, (LEVELS - 1) as f64) as usize;
        let [x, y, z] = self.bin(level, p);
        let around = (x - 1..=x + 1).flat_map(|i| {
            (y - 1..=y + 1).flat_map(move |j| (z - 1..=z + 1).map(move |k| [i, j, k]))
        });
        let bins = around.filter_map(|b| self.levels[level].get(&b));
        bins.flatten().any(|&n| test(n))
    }
}

/// The size h(x) of cells.
pub(super) struct Sizes {
    cell: f64,
    /// Places by size, each rounded down to a power of two of the cell.
    levels: Vec<(f64, Vec<Vec3>, Bvh)>,
}

impl Sizes {
    pub fn new(cell: f64, sources: &[(Vec3, f64)]) -> Self {
        let mut levels: Vec<Vec<Vec3>> = vec![Vec::new(); LEVELS];
        for &(place, size) in sources {
            // Rounded down to a power of two of the cell, so that few trees hold all.
            let level = (cell / size).log2().ceil().clamp(0.0, (LEVELS - 1) as f64);
            levels[level as usize].push(place);
        }
        let levels = levels.into_iter().enumerate().skip(1);
        let levels = levels.filter(|(_, p)| !p.is_empty()).map(|(n, places)| {
            let tree = Bvh::new(places.len(), |i| Aabb::of([places[i]]));
            (cell / (1 << n) as f64, places, tree)
        });
        Self {
            cell,
            levels: levels.collect(),
        }
    }

    /// The size at a place.
    pub fn at(&self, p: Vec3) -> f64 {
        let mut size = self.cell;
        for (least, places, tree) in &self.levels {
            // Only nearer places make the size less.
            let mut best = (size - least) / GROWTH;
            tree.nearest(p, best, |slot| {
                let distance = (places[tree.order()[slot] as usize] - p).norm();
                (distance < best).then(|| {
                    best = distance;
                    distance
                })
            });
            size = size.min(least + GROWTH * best);
        }
        size
    }
}

/// The nodes of a filling.
pub(super) struct Nodes {
    pub all: Vec<Node>,
    /// The edges along creases.
    pub parts: Vec<Part>,
    /// The distances of nodes that were wanted.
    pub sizes: Sizes,
}

impl Nodes {
    /// Places nodes about `cell` apart, nearer around the places of `finer`, which have sizes.
    pub(super) fn of(
        solid: &MeshSolid,
        creases: &Creases,
        cell: f64,
        finer: &[(Vec3, f64)],
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let mut nodes = Self {
            all: Vec::new(),
            parts: Vec::new(),
            sizes: Sizes::new(cell, finer),
        };
        nodes.add_creases(creases, cell);
        nodes.separate_creases(creases, cell);
        let sources = nodes
            .parts
            .iter()
            .flat_map(|p| p.ends.map(|n| (nodes.place(n), p.span[1] - p.span[0])));
        let sources: Vec<(Vec3, f64)> = sources.chain(finer.iter().copied()).collect();
        let sizes = Sizes::new(cell, &sources);
        let mut bins = Bins::new(cell);
        for n in 0..nodes.all.len() as u32 {
            bins.add(nodes.place(n), n);
        }
        nodes.add_faces((solid, creases), &sizes, &mut bins, progress)?;
        nodes.add_inside(solid, &sizes, &mut bins, progress)?;
        nodes.sizes = sizes;
        Ok(nodes)
    }

    /// The place of a node, world coordinates.
    pub fn place(&self, n: u32) -> Vec3 {
        self.all[n as usize].place
    }

    /// Adds a node; returns its number.
    pub fn push(&mut self, place: Vec3, site: Site) -> u32 {
        self.all.push(Node { place, site });
        self.all.len() as u32 - 1
    }

    /// Halves an edge along a crease; the first half stays in its place. Returns the new node.
    pub fn halve(&mut self, part: usize, creases: &Creases) -> u32 {
        let Part { line, ends, span } = self.parts[part];
        let middle = f64::midpoint(span[0], span[1]);
        let node = self.push(creases.lines[line as usize].at(middle), Site::Crease(line));
        self.parts[part] = Part {
            line,
            ends: [ends[0], node],
            span: [span[0], middle],
        };
        self.parts.push(Part {
            line,
            ends: [node, ends[1]],
            span: [middle, span[1]],
        });
        node
    }

    /// Adds the nodes on corners and along creases, about a `cell` apart or nearer where a crease turns. Lengths are in
    /// world units; nodes and parts are appended.
    fn add_creases(&mut self, creases: &Creases, cell: f64) {
        let mut corner_at = HashMap::new();
        for &place in &creases.corners {
            let n = self.push(place, Site::Corner);
            corner_at.insert([place.x, place.y, place.z].map(f64::to_bits), n);
        }
        for (number, line) in (0u32..).zip(&creases.lines) {
            // Each part of the line counts as its length over the cell, or as its share of the turns at its
            // ends over the greatest turn, whichever is more.
            let turn = |i: usize| {
                let count = line.points.len();
                let (before, after) = match i {
                    _ if i > 0 && i + 1 < count => (i - 1, i + 1),
                    _ if line.is_closed => (count - 2, 1),
                    _ => return 0.0,
                };
                let (u, v) = (
                    line.points[i] - line.points[before],
                    line.points[after] - line.points[i],
                );
                u.angle(&v)
            };
            // Sums along the line: nodes are spread evenly over them.
            let mut sums = vec![0.0];
            for i in 1..line.points.len() {
                let length = line.lengths[i] - line.lengths[i - 1];
                let turns = f64::midpoint(turn(i - 1), turn(i)) / MAX_TURN;
                sums.push(sums[i - 1] + (length / cell).max(turns));
            }
            let whole = sums[sums.len() - 1];
            // A closed line of fewer than four edges would be flat.
            let least = if line.is_closed { 4.0 } else { 1.0 };
            // A sum that exceeds a whole number by rounding adds no edge.
            let count = (whole - 1e-6).ceil().max(least) as usize;
            let at = |k: usize| {
                let sum = whole * k as f64 / count as f64;
                let i = sums.partition_point(|&s| s < sum).clamp(1, sums.len() - 1);
                let share = ((sum - sums[i - 1]) / (sums[i] - sums[i - 1])).clamp(0.0, 1.0);
                line.lengths[i - 1] + (line.lengths[i] - line.lengths[i - 1]) * share
            };
            let end = |p: Vec3| corner_at.get(&[p.x, p.y, p.z].map(f64::to_bits)).copied();
            // A closed line without corner begins with a node at its first point.
            let first = match end(line.points[0]) {
                Some(corner) => corner,
                None => self.push(line.points[0], Site::Crease(number)),
            };
            let mut before = (first, 0.0);
            for k in 1..=count {
                let after = if k == count {
                    let last = line.points[line.points.len() - 1];
                    (end(last).unwrap_or(first), line.length())
                } else {
                    let length = at(k);
                    (self.push(line.at(length), Site::Crease(number)), length)
                };
                self.parts.push(Part {
                    line: number,
                    ends: [before.0, after.0],
                    span: [before.1, after.1],
                });
                before = after;
            }
        }
    }

    /// Halves edges along creases whose ball holds another node, or that are too long for the sizes, in at most
    /// [`LEVELS`] passes. Edges of at most twice the least size stay.
    fn separate_creases(&mut self, creases: &Creases, cell: f64) {
        let least = cell / (1 << (LEVELS - 1)) as f64;
        for _ in 0..LEVELS {
            let mut bins = Bins::new(cell);
            for n in 0..self.all.len() as u32 {
                bins.add(self.place(n), n);
            }
            let is_encroached = |p: &Part| {
                let [a, b] = p.ends.map(|n| self.place(n));
                let (middle, radius) = ((a + b) / 2.0, (b - a).norm() / 2.0);
                // Nodes on the sphere itself do not count.
                let limit = radius * (1.0 - 1e-9);
                let length = p.span[1] - p.span[0];
                let is_beside =
                    |n: u32| !p.ends.contains(&n) && (self.place(n) - middle).norm() < limit;
                length > 2.0 * least
                    && (length > MAX_PART_LENGTH * self.sizes.at(middle)
                        || bins.any(middle, radius, is_beside))
            };
            let encroached: Vec<bool> = self.parts.par_iter().map(is_encroached).collect();
            for part in (0..encroached.len()).filter(|&p| encroached[p]) {
                self.halve(part, creases);
            }
            if !encroached.contains(&true) {
                break;
            }
        }
    }

    /// Nodes on faces: places in layers from the creases inward, unless a node of their side is too near.
    fn add_faces(
        &mut self,
        (solid, creases): (&MeshSolid, &Creases),
        sizes: &Sizes,
        bins: &mut Bins,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let triangles: Vec<[Vec3; 3]> = solid.surface().map(|(c, _)| c).collect();
        progress.stage("faces", Some(triangles.len() as u64));
        let seed = solid.bounds().min;
        let (nodes, crease_bins) = (&*self, &*bins);
        let mut candidates: Vec<FacePlace> = triangles
            .par_iter()
            .flat_map_iter(|&corners| {
                let n = normal(corners);
                let step = CANDIDATE_STEP * sizes.at(corners.iter().sum::<Vec3>() / 3.0);
                let is_skipped = n == Vec3::zeros() || progress.cancelled();
                progress.advance(1);
                let places = (!is_skipped).then(|| candidates_on(corners, step));
                places.into_iter().flatten().filter_map(move |p| {
                    let size = sizes.at(p);
                    // Beside the nodes of creases there is never room: most places of long thin triangles end here.
                    let spacing = FACE_SPACING * size;
                    let is_near = |n: u32| (nodes.place(n) - p).norm() < spacing;
                    if crease_bins.any(p, spacing, is_near) {
                        return None;
                    }
                    // Without creases the first place decides: layers grow from it.
                    let layer = if creases.is_empty() {
                        (p - seed).norm()
                    } else {
                        (creases.nearest(p, None) - p).norm()
                    };
                    Some(FacePlace {
                        layer,
                        at: p,
                        normal: n,
                        size,
                    })
                })
            })
            .collect();
        // In order of the layers; the sort is stable, so that the result does not depend on threads.
        candidates.par_sort_by(|a, b| a.layer.total_cmp(&b.layer));
        let mut normals: HashMap<u32, Vec3> = HashMap::new();
        // Nodes of creases are far from all candidates.
        let mut face_bins = Bins::new(bins.size);
        for place in candidates {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let FacePlace {
                at, normal, size, ..
            } = place;
            let spacing = FACE_SPACING * size;
            let is_taken = face_bins.any(at, spacing, |node| {
                (self.place(node) - at).norm() < spacing
                    && normals[&node].dot(&normal) > SAME_SIDE_COSINE
            });
            if !is_taken {
                let node = self.push(at, Site::Face);
                normals.insert(node, normal);
                face_bins.add(at, node);
                bins.add(at, node);
            }
        }
        Ok(())
    }

    /// Inner nodes: points of body-centred lattices, of halved edges where sizes are less.
    fn add_inside(
        &mut self,
        solid: &MeshSolid,
        sizes: &Sizes,
        bins: &mut Bins,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let bounds = solid.bounds();
        let cell = sizes.cell;
        let counts = bounds.size().map(|s| (s / cell).ceil() + 1.0);
        let origin = bounds.centre().0 - counts * (cell / 2.0);
        let counts = [counts.x, counts.y, counts.z].map(|c| c as usize);
        progress.stage("inside", Some((counts[0] * counts[1]) as u64));
        let cubes = (0..counts[0]).into_par_iter().flat_map_iter(|i| {
            (0..counts[1]).flat_map(move |j| (0..counts[2]).map(move |k| [i, j, k]))
        });
        let mut places: Vec<InnerPlace> = cubes
            .flat_map_iter(|cube| {
                let low = origin + Vec3::from(cube.map(|c| c as f64)) * cell;
                let mut found = Vec::new();
                if !progress.cancelled() {
                    let first = LatticeCube {
                        low,
                        edge: cell,
                        level: 0,
                    };
                    lattice_points(solid, sizes, first, &mut found);
                }
                progress.advance(u64::from(cube[2] == 0));
                found
            })
            .collect();
        // Large cells first: they keep their lattice.
        places.sort_by_key(|p| p.level);
        for InnerPlace { at: p, size, .. } in places {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let limit = INNER_SPACING * size;
            if !bins.any(p, limit, |node| (self.place(node) - p).norm() < limit) {
                let node = self.push(p, Site::Inside);
                bins.add(p, node);
            }
        }
        Ok(())
    }
}

/// Places on a triangle about a step apart: centroids of small triangles, so that none lies on a side. On a long needle
/// those along its middle, on a narrow triangle those of rows along its longest side, but none in tips narrower than a
/// step: so their number is that of its area, not that of its length squared.
fn candidates_on([a, b, c]: [Vec3; 3], step: f64) -> impl Iterator<Item = Vec3> {
    let (u, v) = (b - a, c - a);
    let sides = [(u.norm(), a, b), ((c - b).norm(), b, c), (v.norm(), c, a)];
    let (longest, from, to) = sides
        .into_iter()
        .fold(sides[0], |l, s| if s.0 > l.0 { s } else { l });
    // 4096 bounds the candidates of one large triangle.
    let count = (longest / step).ceil().clamp(1.0, 4096.0) as usize;
    let height = u.cross(&v).norm() / longest;
    let is_needle = height < step && count > MIN_NEEDLE_COUNT;
    let is_narrow = height < NARROW * longest && count > MIN_NEEDLE_COUNT;
    let apex = a + b + c - from - to;
    let middle = (a + b + c) / 3.0;
    let along = move |k: usize| {
        // From one end of the longest side to the centre, and on to the other end.
        let t = 2.0 * (k as f64 + 0.5) / count as f64;
        from + (middle - from) * t.min(1.0) + (to - middle) * (t - 1.0).max(0.0)
    };
    let within = move |i: usize, j: usize| {
        let [s, t] = [i, j].map(|k| (k as f64 + 1.0 / 3.0) / count as f64);
        a + u * s + v * t
    };
    let rows = match (is_needle, is_narrow) {
        (true, _) => 1,
        (_, true) => (height / step).ceil() as usize,
        _ => count,
    };
    (0..rows).flat_map(move |i| {
        // The height of a row, as a share of the apex's; rows are shorter there.
        let t = (i as f64 + 1.0 / 3.0) / rows as f64;
        let in_row = if is_narrow && !is_needle {
            (count as f64 * (1.0 - t)).ceil() as usize
        } else {
            count - i
        };
        (0..in_row).map(move |j| {
            if is_needle {
                return along(j);
            }
            if is_narrow {
                let s = (j as f64 + 0.5) / in_row as f64;
                return from + (to - from) * (s * (1.0 - t)) + (apex - from) * t;
            }
            within(i, j)
        })
    })
}

/// A place for a node on a face.
struct FacePlace {
    /// Distance from the nearest crease, or from the box's least corner if there is none: nodes are added in this
    /// order.
    layer: f64,
    at: Vec3,
    /// Unit normal of the face.
    normal: Vec3,
    /// Length of the edges wanted there, world units.
    size: f64,
}

/// A cube of the lattice of inner nodes.
#[derive(Clone, Copy)]
struct LatticeCube {
    /// Its least corner, and the length of its edges, world units.
    low: Vec3,
    edge: f64,
    /// How often the first cube was halved.
    level: usize,
}

/// A place for an inner node.
struct InnerPlace {
    level: usize,
    at: Vec3,
    /// Length of the edges wanted there, world units.
    size: f64,
}

/// Adds the points of a cube's body-centred lattice that lie deep enough inside where sizes are about its edge (0.6 to
/// 1.3 of it, so that lattices overlap); where sizes may be less than 0.65 of it, those of its eighths too.
fn lattice_points(
    solid: &MeshSolid,
    sizes: &Sizes,
    cube: LatticeCube,
    found: &mut Vec<InnerPlace>,
) {
    let LatticeCube { low, edge, level } = cube;
    let centre = low.add_scalar(edge / 2.0);
    let size = sizes.at(centre);
    // The lattice of this size is the corner and the centre of each cube.
    for p in [low, centre] {
        let size = sizes.at(p);
        if size > 0.6 * edge && (level == 0 || size < 1.3 * edge) {
            let depth = -solid.signed_distance(p);
            if depth > INNER_DEPTH * size {
                found.push(InnerPlace { level, at: p, size });
            }
        }
    }
    // Sizes grow by at most GROWTH per length: this is the least in the cube, to corners sqrt(3/4) edges away.
    let min_size = size - GROWTH * edge * 0.75f64.sqrt();
    if level + 1 < LEVELS && min_size < 0.65 * edge {
        let near = solid.signed_distance(centre);
        // No point of the cube is inside: its corners are sqrt(3/4) edges from the centre.
        if near > edge {
            return;
        }
        for n in 0..8 {
            let shift = [n & 1, n >> 1 & 1, n >> 2].map(|c| f64::from(c) * edge / 2.0);
            let eighth = LatticeCube {
                low: low + Vec3::from(shift),
                edge: edge / 2.0,
                level: level + 1,
            };
            lattice_points(solid, sizes, eighth, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Facets of cylinders are needles, and nodes are dense where parts are narrow: neither may make a filling slow.
    #[test]
    fn needles_and_dense_nodes_cost_little() {
        let needle = [[0.0, 0.0], [100.0, 0.0], [100.0, 0.05]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let places: Vec<Vec3> = candidates_on(needle, 0.1).collect();
        assert!((1000..1010).contains(&places.len()));
        assert!(places.iter().all(|p| p.y > 0.0 && p.y < 0.0005 * p.x));
        let gaps = places.windows(2).map(|w| (w[1] - w[0]).norm());
        assert!(gaps.fold(0.0, f64::max) < 0.15);
        // Half a million places before; ten in each square of side sqrt(0.1) now, as on other triangles.
        let narrow = [[0.0, 0.0], [100.0, 0.0], [100.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let places: Vec<Vec3> = candidates_on(narrow, 0.1).collect();
        assert!((5000..6000).contains(&places.len()), "{}", places.len());
        assert!(
            places
                .iter()
                .all(|p| p.y > 0.0 && p.y < 0.01 * p.x && p.x < 100.0)
        );
        // The tip is narrower than a step: triangles beside it have places there.
        for k in 20..200 {
            let x = 0.5 * f64::from(k) + 0.25;
            let p = Vec3::new(x, 0.01 * x * f64::from(k * 37 % 200) / 200.0, 0.0);
            let near = places.iter().map(|q| (p - q).norm());
            assert!(near.fold(f64::INFINITY, f64::min) < 0.12, "{p}");
        }
        let mut bins = Bins::new(1.0);
        for n in 0..10_000 {
            bins.add(Vec3::new(f64::from(n) / 1e4, 0.5, 0.5), n);
        }
        let mut visited = 0;
        let found = bins.any(Vec3::new(0.5, 0.5, 0.5), 0.01, |n| {
            visited += 1;
            n == 4901
        });
        assert!(found && visited < 1000, "{visited}");
    }
}
