//! Channels that drain cavities: the shortest straight ways through the solid that connect each with the outside.
//!
//! A channel leads from a voxel of a cavity to the nearest voxel of another void. Cavities that channels join
//! continue as one, until all lead outside: the channels are the edges of a minimum spanning tree. The cost of
//! a channel is its length, or, with a preferred direction, its length times 2 - cos(angle): 1 along it, 3
//! against it. No cheaper way bends, and no other void lies on the cheapest.

use super::blocks::VoidGraph;
use super::void_map::{VoidMap, VoxelSet};
use super::{Cavity, LeafSource, Measure, MemorySource, prepared};
use crate::band::{LEAF, LeafStore, Region};
use crate::frame::{Coord, Vec3};
use crate::progress::Cancelled;
use crate::union_find::UnionFind;
use crate::vdb::index::{LeafIndex, offset};
use crate::vdb::on_disk::stored_voids;
use crate::vdb::voxel_mask::{self, Bits};
use crate::vdb::{FileError, LevelSet, Session, VdbError};
use std::collections::{BTreeMap, HashMap};

/// First distance up to which a cavity's surroundings are searched, voxels.
const FIRST_REACH: i32 = 16;
/// The number of what is no cavity but rounding.
const ROUNDING: u32 = u32::MAX;
/// The number of the outside; cavities follow from 1.
const OUTSIDE: u32 = 0;

/// What is to be drained.
#[derive(Clone, Copy, Debug)]
pub struct DrainRequest {
    /// Radius of the channels, voxels: at least 1, at most [`super::MAX_CAVITY_REACH`] - 2.
    pub radius: f64,
    /// Whether cavities with a way out that is narrower than the channel are drained too, if a ball of the
    /// radius fits in.
    pub narrow: bool,
    /// The preferred direction, a unit vector.
    pub toward: Option<Vec3>,
}

/// A channel: a voxel of a cavity, and the voxel of another void to which it leads.
pub type Channel = [Coord; 2];

impl LevelSet {
    /// The channels that drain the cavities, cheapest first in each round; none without a cavity.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn drain_channels(
        &self,
        request: &DrainRequest,
        session: Session<'_>,
    ) -> Result<Vec<Channel>, VdbError> {
        let closed = if request.narrow {
            Vec::new()
        } else {
            self.voids(session)?
        };
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        let measure = Measure {
            voxel_size: self.voxel_size(),
            background: self.background() as f32,
            reach: reach(request),
            bounds: Region::EVERYWHERE,
        };
        let closed = closed.iter().map(|c| c.place).collect();
        channels(
            &MemorySource::new(&index),
            measure,
            (request, closed),
            session,
        )
    }
}

/// The channels that drain a solid on disk, as [`LevelSet::drain_channels`] returns them.
///
/// # Errors
/// As there, and a changed leaf file.
pub fn stored_drain_channels(
    store: &LeafStore,
    voxel_size: f64,
    request: &DrainRequest,
    session: Session<'_>,
) -> Result<Vec<Channel>, FileError> {
    let closed = if request.narrow {
        Vec::new()
    } else {
        stored_voids(store, voxel_size, session)?
    };
    let measure = Measure {
        voxel_size,
        background: store.background(),
        reach: reach(request),
        bounds: Region::EVERYWHERE,
    };
    let closed = closed.iter().map(|c| c.place).collect();
    channels(store, measure, (request, closed), session)
}

fn reach(request: &DrainRequest) -> i32 {
    request.radius.ceil() as i32 + 1
}

/// The channels of a request; `closed` are places in the closed cavities, if only these count.
fn channels<S: LeafSource>(
    source: &S,
    measure: Measure,
    (request, closed): (&DrainRequest, Vec<Coord>),
    session: Session<'_>,
) -> Result<Vec<Channel>, S::Error> {
    let Some(measure) = prepared(source, measure) else {
        return Ok(Vec::new());
    };
    let new = |clearance| Search::new(source, measure, clearance, request.toward);
    if !request.narrow {
        session.progress.stage("drain", None);
        return new(0.0).connected(&closed, &[], session);
    }
    let graph = VoidGraph::new(source, measure, session)?;
    // A cavity may have several rooms that are as narrow between one another.
    let is_wide = |depth: f32| depth >= request.radius as f32;
    let basins = graph.basins.iter().filter(|b| is_wide(b.depth));
    let rooms: Vec<Coord> = basins.map(|b| b.place).collect();
    let found = graph.cavities(measure, session.progress)?;
    session.progress.stage("drain", None);
    let radius = request.radius * measure.voxel_size;
    let places = |is_wanted: &dyn Fn(&Cavity) -> bool| -> Vec<Coord> {
        let wanted = found.list.iter().filter(|c| is_wanted(c));
        wanted.map(|c| c.place).collect()
    };
    let is_room = |c: &Cavity| c.radius >= radius;
    let is_closed = |c: &Cavity| c.throat.is_none();
    let small = places(&|c| is_closed(c) && !is_room(c));
    let settled = places(&|c| is_closed(c) && is_room(c));
    let mut channels = new(0.0).connected(&small, &settled, session)?;
    // Points at which a ball of the radius has room.
    channels.extend(new(request.radius as f32).connected(&rooms, &[], session)?);
    Ok(channels)
}

/// The cheapest way from some cavities to another void: cost, ends, and the number of that void.
struct Link {
    cost: f64,
    ends: Channel,
    to: u32,
}

impl Link {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let order = self.cost.total_cmp(&other.cost);
        order.then(self.ends.cmp(&other.ends))
    }
}

struct Search<'a, S> {
    map: VoidMap<'a, S>,
    bounds: Region,
    toward: Option<[f64; 3]>,
    /// Voxels of each cavity; none at number 0.
    cavities: Vec<BTreeMap<Coord, Bits>>,
    /// Numbers of the cavities in a leaf.
    labels: HashMap<Coord, Vec<(u32, Bits)>>,
    /// Voxels that are known to lead outside.
    outside: VoxelSet,
    sets: UnionFind,
}

impl<'a, S: LeafSource> Search<'a, S> {
    fn new(source: &'a S, measure: Measure, clearance: f32, toward: Option<Vec3>) -> Self {
        Self {
            map: VoidMap::new(source, measure, clearance),
            bounds: measure.bounds,
            toward: toward.map(Into::into),
            cavities: vec![BTreeMap::new()],
            labels: HashMap::new(),
            outside: HashMap::new(),
            sets: UnionFind::new(1),
        }
    }

    /// Connects the cavities around some places with the outside; the cavities around `settled` ones count as
    /// outside.
    fn connected(
        mut self,
        places: &[Coord],
        settled: &[Coord],
        session: Session<'_>,
    ) -> Result<Vec<Channel>, S::Error> {
        for (n, &place) in places.iter().chain(settled).enumerate() {
            let Some(number) = self.add(place)? else {
                continue;
            };
            if n >= places.len() {
                self.sets.union(number, OUTSIDE as usize);
            }
        }
        let mut channels = Vec::new();
        loop {
            let mut clusters: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
            for n in 1..self.cavities.len() {
                let root = self.sets.find(n);
                if root != OUTSIDE as usize {
                    clusters.entry(root).or_default().push(n as u32);
                }
            }
            let mut links = Vec::new();
            for (root, members) in clusters {
                if session.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                links.extend(self.link(root, &members)?.map(|link| (root, link)));
            }
            if links.is_empty() {
                return Ok(channels);
            }
            links.sort_by(|(_, a), (_, b)| a.order(b));
            for (root, link) in links {
                if self.sets.find(root) != self.sets.find(link.to as usize) {
                    self.sets.union(root, link.to as usize);
                    channels.push(link.ends);
                }
            }
        }
    }

    /// Adds the cavity around a place; `None` if it leads outside, or is known.
    fn add(&mut self, place: Coord) -> Result<Option<usize>, S::Error> {
        if self.label(place).is_some() {
            return Ok(None);
        }
        let (voxels, is_open) = self.map.flood(place, &self.outside)?;
        if is_open {
            self.open(voxels);
            return Ok(None);
        }
        if voxels.is_empty() {
            return Ok(None);
        }
        let number = self.sets.extend(1);
        for (&leaf, &bits) in &voxels {
            let own = self.labels.entry(leaf).or_default();
            own.push((number as u32, bits));
        }
        self.cavities.push(voxels);
        Ok(Some(number))
    }

    /// Remembers voxels that lead outside.
    fn open(&mut self, voxels: BTreeMap<Coord, Bits>) {
        for (leaf, bits) in voxels {
            voxel_mask::add(self.outside.entry(leaf).or_insert([0; 8]), &bits);
        }
    }

    /// The number of the cavity that holds a voxel.
    fn label(&self, voxel: Coord) -> Option<u32> {
        let own = self.labels.get(&voxel.aligned(LEAF))?;
        let holds = |bits: &Bits| voxel_mask::contains(bits, offset(voxel));
        own.iter().find(|(_, bits)| holds(bits)).map(|l| l.0)
    }

    /// The cheapest way from the cavities of a set to another void.
    fn link(&mut self, root: usize, members: &[u32]) -> Result<Option<Link>, S::Error> {
        loop {
            let Some(mut link) = self.nearest(root, members)? else {
                return Ok(None);
            };
            let target = link.ends[1];
            if let Some(number) = self.label(target) {
                link.to = number;
                return Ok(Some(link));
            }
            let (voxels, is_open) = self.map.flood(target, &self.outside)?;
            if is_open {
                self.open(voxels);
                return Ok(Some(link));
            }
            for (leaf, bits) in voxels {
                let own = self.labels.entry(leaf).or_default();
                own.push((ROUNDING, bits));
            }
        }
    }

    /// The cheapest way to a voxel of any other void.
    fn nearest(&mut self, root: usize, members: &[u32]) -> Result<Option<Link>, S::Error> {
        let mut sources: Vec<(Region, Vec<Coord>)> = Vec::new();
        for &n in members {
            for (&leaf, own) in &self.cavities[n as usize] {
                let surface = self.map.surface(leaf)?;
                let list = voxels(leaf, &std::array::from_fn(|x| own[x] & surface[x]));
                if !list.is_empty() {
                    sources.push((Region::cube(leaf, LEAF), list));
                }
            }
        }
        let Some(hull) = sources.iter().map(|s| s.0).reduce(|a, b| Region {
            min: Coord([0, 1, 2].map(|i| a.min[i].min(b.min[i]))),
            max: Coord([0, 1, 2].map(|i| a.max[i].max(b.max[i]))),
        }) else {
            return Ok(None);
        };
        let everything = self.bounds.grown(LEAF);
        let mut best: Option<Link> = None;
        let mut searched: Option<Region> = None;
        let mut reach = FIRST_REACH;
        loop {
            let region = hull.grown(reach);
            let is_whole = (0..3)
                .all(|a| region.min[a] <= everything.min[a] && region.max[a] >= everything.max[a]);
            let is_new = |leaf: &Coord| !searched.is_some_and(|r| r.meets(*leaf, LEAF));
            let mut leaves: Vec<(f64, Coord)> = region
                .common(everything)
                .cubes(LEAF)
                .filter(is_new)
                .map(|leaf| (self.least_cost(hull, Region::cube(leaf, LEAF)), leaf))
                .collect();
            leaves.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for (least, leaf) in leaves {
                if best.as_ref().is_some_and(|b| least > b.cost) {
                    break;
                }
                self.try_leaf(root, &sources, leaf, &mut best)?;
            }
            // A voxel that is farther away costs more than its distance.
            let is_found = best.as_ref().is_some_and(|b| b.cost <= f64::from(reach));
            if is_found || is_whole {
                return Ok(best);
            }
            // Leaves at the end are searched again with the next region.
            searched = Some(region.grown(-LEAF));
            reach *= 2;
        }
    }

    /// Compares the ways to the voxels of a leaf with the best one.
    fn try_leaf(
        &mut self,
        root: usize,
        sources: &[(Region, Vec<Coord>)],
        leaf: Coord,
        best: &mut Option<Link>,
    ) -> Result<(), S::Error> {
        let mut bits = self.map.surface(leaf)?;
        for (number, own) in self.labels.get(&leaf).into_iter().flatten() {
            if *number == ROUNDING || self.sets.find(*number as usize) == root {
                bits = std::array::from_fn(|x| bits[x] & !own[x]);
            }
        }
        if voxel_mask::is_empty(&bits) {
            return Ok(());
        }
        let targets = voxels(leaf, &bits);
        let to = Region::cube(leaf, LEAF);
        for (from, list) in sources {
            let least = self.least_cost(*from, to);
            if best.as_ref().is_some_and(|b| least > b.cost) {
                continue;
            }
            for &p in list {
                for &q in &targets {
                    let link = Link {
                        cost: self.cost(p, q),
                        ends: [p, q],
                        to: OUTSIDE,
                    };
                    if best.as_ref().is_none_or(|b| link.order(b).is_lt()) {
                        *best = Some(link);
                    }
                }
            }
        }
        Ok(())
    }

    /// The cost of a channel, voxels.
    fn cost(&self, from: Coord, to: Coord) -> f64 {
        let way = [0, 1, 2].map(|a| f64::from(to[a]) - f64::from(from[a]));
        let length = way.iter().map(|d| d * d).sum::<f64>().sqrt();
        match self.toward {
            Some(t) => 2.0 * length - (way[0] * t[0] + way[1] * t[1] + way[2] * t[2]),
            None => length,
        }
    }

    /// A lower bound of the cost of channels between two boxes.
    fn least_cost(&self, from: Region, to: Region) -> f64 {
        let range = |a: usize| {
            let low = f64::from(to.min[a]) - f64::from(from.max[a]);
            let high = f64::from(to.max[a]) - f64::from(from.min[a]);
            [low, high]
        };
        let ranges = [0, 1, 2].map(range);
        let nearest = ranges.map(|[low, high]| low.max(-high).max(0.0));
        let length = nearest.iter().map(|d| d * d).sum::<f64>().sqrt();
        match self.toward {
            Some(t) => {
                let along = |a: usize| (ranges[a][0] * t[a]).max(ranges[a][1] * t[a]);
                length.max(2.0 * length - (along(0) + along(1) + along(2)))
            }
            None => length,
        }
    }
}

/// The voxels of a set.
fn voxels(leaf: Coord, bits: &Bits) -> Vec<Coord> {
    let all = (0..512i32).filter(|&n| voxel_mask::contains(bits, n as usize));
    all.map(|n| leaf.offset(n >> 6, n >> 3 & 7, n & 7))
        .collect()
}
