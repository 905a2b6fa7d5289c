//! Cavities of the void around a solid, and the largest ball that can leave each.
//!
//! The **escape radius** of a point of the void is the greatest r for which a ball of radius r moves from
//! there to the outside: the maximin of the distance to the surface over all paths. It is found by uniting
//! voxels in falling distance, from which the outside grows inwards. A component that meets the outside at
//! the level s, and is deeper than s, is a cavity with escape radius s; a component that never meets it is
//! closed. Each voxel belongs to the cavity that its steepest ascent ends in. Not promised: ways narrower than a
//! voxel, which may count as closed, and voids that a ball of the reach can leave, however long the way.
//!
//! ```
//! # mod druse { pub use druse_geometry::*; pub use druse_solids::*; pub use druse_tilings::*; }
//! use druse::{Task, band::*, cavities::*, field::*, frame::*, progress::*};
//! let ball = |radius| Sphere { centre: Vec3::zeros(), radius };
//! let hollow = Intersection(vec![Box::new(ball(12.0)), Box::new(Complement(Box::new(ball(6.0))))]);
//! let extent = Aabb { min: Vec3::repeat(-12.0), max: Vec3::repeat(12.0) };
//! let threads = Threads::new(1).unwrap();
//! let file = std::env::temp_dir().join(format!("druse-hollow-{}", std::process::id()));
//! let head = LeafFileHead { plan: [0; 32], brick: 0, background: 3.0 };
//! let sink = LeafFileWriter::new(std::fs::File::create(&file).unwrap(), &head).unwrap();
//! Band::new(&hollow, extent, 1.0).unwrap().evaluate(&threads, &Silent, &sink).unwrap();
//! sink.finish().unwrap();
//! let store = LeafStore::open(vec![(file.clone(), head)], &threads, &Silent).unwrap();
//! let task = Task { threads: &threads, progress: &Silent };
//! let found = find_cavities(&store, Measure::new(1.0, 3.0, DEFAULT_CAVITY_REACH), task).unwrap();
//! // One that nothing leaves; 4/3 pi 6^3 in volume.
//! assert!(found.closed() == 1 && (found.list[0].volume / 904.8 - 1.0).abs() < 0.05);
//! # std::fs::remove_file(file).unwrap();
//! ```
//! Most of the void is found to be open from signs alone (`open_void`), and is not measured.
//!
//! Blocks of 128^3 voxels are processed separately, with a halo as wide as the greatest distance. A block keeps its
//! local maxima and the edges of its maximum spanning forest; faces of blocks add edges. A solid in memory and a solid
//! on disk have the same blocks, and so the same cavities. The law `random_networks_have_the_cavities_of_a_flood`
//! allows radii to differ by 0.3 voxel from those of a flood of all voxels.

use super::Task;
use super::leaf_source::LeafSource;
use druse_geometry::frame::Coord;
use druse_geometry::progress::{Cancelled, Progress};
use druse_geometry::union_find::UnionFind;
use druse_tilings::band::Region;

mod ascent;
mod basins;
mod blocks;
mod channels;
mod distances;
mod drains;
mod grid;
mod leaf_set;
mod line_distances;
mod narrow;
mod open_void;
mod refine;
mod samples;
mod slopes;
mod void_map;

pub use drains::{Channel, DrainPlan, DrainRequest, blocked_start, drain_plan};

use basins::{Basin, Edge};
use blocks::VoidGraph;

/// Default of the greatest distance that is measured, voxels.
pub const DEFAULT_CAVITY_REACH: i32 = 32;
/// Greatest distance that can be measured, voxels: a block's halo stays within the blocks beside it.
pub const MAX_CAVITY_REACH: i32 = 96;
/// Least excess of a cavity's inscribed ball over its escape radius, voxels. Distances at voxels vary by up to
/// half of this along a straight channel.
const MIN_PROMINENCE: f32 = 1.0;
/// Least depth of a closed cavity, voxels, as for components.
const MIN_DEPTH: f32 = 1e-3;

/// A cavity. Radii are in world units, sampled at voxel centres, so that they are up to 0.9 voxels (half the diagonal
/// of one) less than those of the continuous void. Ways narrower than a voxel are not resolved: their radius is only
/// known to be less than about one voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cavity {
    /// Number of voxels.
    pub voxels: u64,
    /// Volume of the voxels, world units cubed.
    pub volume: f64,
    /// The voxel farthest from the solid.
    pub place: Coord,
    /// Distance of that voxel from the solid, at most the limit of [`Cavities`].
    pub radius: f64,
    /// Radius of the largest ball that can leave; 0 for a closed cavity.
    pub escape_radius: f64,
    /// The narrowest voxel on the widest way out; `None` for a closed cavity.
    pub throat: Option<Coord>,
}

/// The cavities of a solid, narrowest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Cavities {
    /// Cavities with a smaller escape radius, by escape radius, then falling volume, then place.
    pub list: Vec<Cavity>,
    /// The greatest distance that was measured, world units. A void that a ball of this radius can leave
    /// is no cavity.
    pub limit: f64,
}

impl Cavities {
    /// Number of closed cavities.
    pub fn closed(&self) -> usize {
        self.list.iter().filter(|c| c.throat.is_none()).count()
    }

    /// The cavity with the least escape radius.
    pub fn narrowest(&self) -> Option<&Cavity> {
        self.list.first()
    }
}

/// Voxel size and half width of a band, and the greatest distance to measure, in voxels.
#[derive(Clone, Copy)]
pub struct Measure {
    voxel_size: f64,
    background: f32,
    reach: i32,
    /// The box of all leaves.
    bounds: Region,
}

impl Measure {
    /// The measure of a band: its voxel size and half width, world units, and the greatest distance to measure, voxels.
    pub fn new(voxel_size: f64, background: f32, reach: i32) -> Self {
        Self {
            voxel_size,
            background,
            reach,
            bounds: Region::EVERYWHERE,
        }
    }
}

/// The measure with the box of all leaves; `None` without any.
fn prepared<S: LeafSource>(source: &S, measure: Measure) -> Option<Measure> {
    Some(Measure {
        reach: measure.reach.clamp(1, MAX_CAVITY_REACH),
        bounds: source.bounds()?,
        ..measure
    })
}

/// Sorts cavities by escape radius, falling size and place.
fn sort(list: &mut [Cavity]) {
    list.sort_by(|a, b| {
        let size = b.voxels.cmp(&a.voxels).then(a.place.cmp(&b.place));
        a.escape_radius.total_cmp(&b.escape_radius).then(size)
    });
}

/// The cavities of the void that a ball of the measure's reach cannot leave, narrowest first. The reach is at most
/// [`MAX_CAVITY_REACH`]. Leaves are read block by block and not kept; the source does not change. Radii of the
/// narrowest thousand are measured again with triangles; the others are those of points on lattice edges.
///
/// # Errors
/// Cancellation, and errors of the source.
pub fn find_cavities<S: LeafSource>(
    source: &S,
    measure: Measure,
    task: Task<'_>,
) -> Result<Cavities, S::Error> {
    let Some(measure) = prepared(source, measure) else {
        return Ok(Cavities {
            list: Vec::new(),
            limit: f64::from(measure.reach.clamp(1, MAX_CAVITY_REACH)) * measure.voxel_size,
        });
    };
    let graph = VoidGraph::new(source, measure, task)?;
    let mut found = graph.cavities(measure, task.progress)?;
    sort(&mut found.list);
    refine::refine(source, measure, &mut found.list, task)?;
    sort(&mut found.list);
    Ok(found)
}

/// No owner yet.
const UNOWNED: u32 = u32::MAX;
/// The owner of basins that open to the outside; cavities follow from 1.
const OUTSIDE: u32 = 0;

/// Components of basins while edges are added in falling level.
struct Growth {
    sets: UnionFind,
    basins: Vec<Basin>,
    /// Members of a component, by its representative.
    members: Vec<Vec<u32>>,
    /// The deepest basin of a component, by its representative.
    deepest: Vec<u32>,
    /// [`OUTSIDE`] or the cavity of each basin, or [`UNOWNED`].
    owner: Vec<u32>,
    /// Level and place at which each cavity meets the outside, and its deepest basin.
    throats: Vec<(f32, Option<Coord>, u32)>,
}

impl Growth {
    /// Each basin by itself; the first one is the outside.
    fn new(basins: Vec<Basin>) -> Self {
        let count = basins.len();
        let mut owner = vec![UNOWNED; count];
        if let Some(first) = owner.first_mut() {
            *first = OUTSIDE;
        }
        Self {
            sets: UnionFind::new(count),
            basins,
            members: (0..count as u32).map(|n| vec![n]).collect(),
            deepest: (0..count as u32).collect(),
            owner,
            throats: Vec::new(),
        }
    }

    /// The deeper of two basins; of equal ones that with the lower place.
    fn deeper(&self, a: u32, b: u32) -> u32 {
        let [x, y] = [a, b].map(|n| &self.basins[n as usize]);
        let order = x.depth.total_cmp(&y.depth).then(y.place.cmp(&x.place));
        if order.is_ge() { a } else { b }
    }

    /// Joins the ends of an edge. Where one of them is connected with the outside, the component of the other is now
    /// open, at the level and place of the edge.
    fn join(&mut self, edge: &Edge) {
        let [a, b] = [edge.ends[0] as usize, edge.ends[1] as usize];
        let (ra, rb) = (self.sets.find(a), self.sets.find(b));
        if ra == rb {
            return;
        }
        let outside = self.sets.find(0);
        if ra == outside {
            self.open(rb, a, edge);
        } else if rb == outside {
            self.open(ra, b, edge);
        }
        self.sets.union(ra, rb);
        let root = self.sets.find(ra);
        // The representative that lost; the smaller list of members is moved.
        let other = ra + rb - root;
        let mut moved = std::mem::take(&mut self.members[other]);
        if moved.len() > self.members[root].len() {
            std::mem::swap(&mut moved, &mut self.members[root]);
        }
        self.members[root].extend(moved);
        self.deepest[root] = self.deeper(self.deepest[root], self.deepest[other]);
    }

    /// Gives the basins of a component that meets the outside at a basin their owner.
    fn open(&mut self, component: usize, outer: usize, edge: &Edge) {
        let deepest = self.deepest[component];
        let is_cavity = self.basins[deepest as usize].depth - edge.level >= MIN_PROMINENCE;
        let owner = if is_cavity {
            self.throats.push((edge.level, Some(edge.place), deepest));
            self.throats.len() as u32
        } else {
            self.owner[outer]
        };
        for &n in &self.members[component] {
            self.owner[n as usize] = owner;
        }
    }

    /// Makes cavities of the components that have not met the outside.
    fn close(&mut self) {
        let outside = self.sets.find(0);
        for root in 0..self.basins.len() {
            if self.sets.find(root) != root || root == outside {
                continue;
            }
            let deepest = self.deepest[root];
            let is_cavity = self.basins[deepest as usize].depth >= MIN_DEPTH;
            if is_cavity {
                self.throats.push((0.0, None, deepest));
                for &n in &self.members[root] {
                    self.owner[n as usize] = self.throats.len() as u32;
                }
            }
        }
    }
}

impl VoidGraph {
    /// The cavities: edges are added in falling level. A component that meets the outside at least [`MIN_PROMINENCE`]
    /// below its depth is one, and so is one of at least [`MIN_DEPTH`] that never meets it. Sizes are in world units.
    fn cavities(
        mut self,
        measure: Measure,
        progress: &dyn Progress,
    ) -> Result<Cavities, Cancelled> {
        // Edges by falling level (bits of positive numbers ascend with them): as if the void were filled from its
        // deepest points.
        let order = |e: &Edge| (std::cmp::Reverse(e.level.to_bits()), e.ends);
        self.edges.sort_unstable_by_key(order);
        let mut growth = Growth::new(self.basins);
        for (n, edge) in self.edges.iter().enumerate() {
            // Joins are fast: a check now and then suffices.
            if n.is_multiple_of(1 << 16) && progress.cancelled() {
                return Err(Cancelled);
            }
            growth.join(edge);
        }
        growth.close();
        // Voxels of a basin count for the cavity that owns it, if there is one; number 0 is the outside.
        let mut voxels = vec![0u64; growth.throats.len() + 1];
        for (basin, &owner) in growth.basins.iter().zip(&growth.owner) {
            if let Some(sum) = voxels.get_mut(owner as usize) {
                *sum += basin.voxels;
            }
        }
        let h = measure.voxel_size;
        let cavities = growth.throats.iter().zip(&voxels[1..]);
        let list: Vec<Cavity> = cavities
            .map(|(&(level, throat, deepest), &voxels)| {
                let basin = &growth.basins[deepest as usize];
                Cavity {
                    voxels,
                    volume: voxels as f64 * h.powi(3),
                    place: basin.place,
                    radius: f64::from(basin.depth) * h,
                    escape_radius: f64::from(level) * h,
                    throat,
                }
            })
            .collect();
        Ok(Cavities {
            list,
            limit: f64::from(measure.reach) * h,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::progress::Silent;

    #[test]
    fn a_room_escapes_by_its_widest_way_or_not_at_all() {
        // Outside; a room of 11^3 voxels with a way of 1.5, and one of 2.5 by a niche; a closed room of 6^3; a duct.
        let place = Coord([0; 3]);
        let basins = [(9.0, 1), (5.5, 1331), (4.0, 10), (3.0, 216), (3.2, 50)];
        let basins = basins.map(|(depth, voxels)| Basin {
            voxels,
            depth,
            place,
        });
        let edges = [([0, 1], 1.5), ([2, 0], 3.5), ([1, 2], 2.5), ([0, 4], 3.0)];
        let edges = edges.map(|(ends, level)| Edge { ends, level, place });
        let (basins, edges) = (basins.into(), edges.into());
        let (graph, measure) = (VoidGraph { basins, edges }, Measure::new(0.5, 1.0, 8));
        let found = graph.cavities(measure, &Silent).unwrap().list;
        let facts = found.iter().map(|c| (c.volume, c.radius, c.escape_radius));
        let expected = [(1331.0 / 8.0, 2.75, 1.25), (27.0, 1.5, 0.0)];
        assert_eq!(facts.collect::<Vec<_>>(), expected);
    }
}
