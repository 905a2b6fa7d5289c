//! The search for channels between rooms of the void.
//!
//! A room is a connected part of the void in which a ball of the channel's radius can move. Links are found from each
//! cluster of rooms to the cheapest voxel of another one, or outside, and chosen as a minimum spanning tree. The result
//! depends neither on threads nor on the order of the rooms' leaves: equal costs are ordered by their ends. Lengths are
//! in voxels.

use super::Measure;
use super::drains::{Channel, DrainRequest};
use super::narrow::{Narrow, voxels_of};
use super::void_map::{VoidMap, VoxelSet};
use crate::leaf_source::LeafSource;
use crate::voxel_mask::Bits;
use crate::voxel_mask::offset;
use crate::{Task, voxel_mask};
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::progress::Cancelled;
use druse_geometry::union_find::UnionFind;
use druse_tilings::band::{LEAF, Region};
use std::collections::{BTreeMap, HashMap};

/// First distance up to which a cavity's surroundings are searched, voxels.
const FIRST_REACH: i32 = 16;
/// The number of a room that is not to be drained.
const OTHER: u32 = u32::MAX;
/// The number of the outside; rooms follow from 1.
const OUTSIDE: u32 = 0;
/// Rooms of a closed cavity are one where the way between them is narrower by no more than this, voxels: distances at
/// voxels vary by so much along a straight way.
const NECK: f64 = 0.5;

/// Radius of the channels, voxels, and their preferred direction.
#[derive(Clone, Copy)]
pub(super) struct SearchPlan {
    radius: f64,
    toward: Option<[f64; 3]>,
}

impl SearchPlan {
    /// The plan of a request, whose radius is in voxels.
    pub fn of(request: &DrainRequest) -> Self {
        Self {
            radius: request.radius,
            toward: request.toward.map(Into::into),
        }
    }
}

/// The cheapest way from some rooms to another one: cost, ends, and the number of that room.
#[derive(Clone)]
pub(super) struct Link {
    cost: f64,
    pub ends: [Coord; 2],
    to: u32,
}

/// Voxels from which ways are compared: those at the surface of a set by leaf, with the leaf's cube.
type Sources = Vec<(Region, Vec<Coord>)>;

impl Link {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let order = self.cost.total_cmp(&other.cost);
        order.then(self.ends.cmp(&other.ends))
    }

    /// The channel without the parts at its ends around which there is no solid within the radius: drilling these
    /// removes nothing. `solid` holds the voxels that are not solid, of clearance 0; `radius` is in voxels. The result
    /// is the axis from end to end, from the first solid voxel less one to the last plus one.
    pub fn trimmed<S: LeafSource>(
        &self,
        solid: &mut VoidMap<'_, S>,
        radius: f64,
    ) -> Result<Channel, S::Error> {
        let [from, to] = self.ends.map(|c| Vec3::from(c.0.map(f64::from)));
        let length = (to - from).norm();
        let along = (to - from) / length;
        // A solid voxel within half a voxel of the channel may have its surface in it.
        let wide = radius + 0.5;
        // Position along the axis, and distance from the axis where beside it.
        let position = |voxel: Coord| {
            let way = Vec3::from(voxel.0.map(f64::from)) - from;
            let t = way.dot(&along);
            (t, (way.norm_squared() - t * t).max(0.0).sqrt())
        };
        let corner = |choose: fn(i32, i32) -> i32| {
            Coord([0, 1, 2].map(|a| choose(self.ends[0][a], self.ends[1][a])))
        };
        let hull = Region {
            min: corner(i32::min),
            max: corner(i32::max),
        };
        // Half the diagonal of a leaf, and its middle voxel: leaves farther from the axis hold no voxel near it.
        let half_leaf = f64::from(LEAF) / 2.0 * 3f64.sqrt();
        let middle = LEAF / 2;
        let mut ends: Option<[f64; 2]> = None;
        for leaf in hull.grown(wide.ceil() as i32).cubes(LEAF) {
            if position(leaf.offset(middle, middle, middle)).1 > wide + half_leaf {
                continue;
            }
            let bits = solid.leaf(leaf)?.map(|w| !w);
            for voxel in voxels_of(leaf, &bits) {
                let (t, beside) = position(voxel);
                if beside <= wide && (0.0..=length).contains(&t) {
                    let [low, high] = ends.unwrap_or([t, t]);
                    ends = Some([low.min(t), high.max(t)]);
                }
            }
        }
        let [low, high] = ends.unwrap_or([0.0, length]);
        // The surface lies within a voxel of the first and the last solid voxel.
        let at = |t: f64| from + along * t.clamp(0.0, length);
        Ok([at(low - 1.0), at(high + 1.0)])
    }
}

/// The rooms, and what is known of the void around them.
pub(super) struct Search<'a, S> {
    source: &'a S,
    measure: Measure,
    plan: SearchPlan,
    /// Voxels at which a ball of the radius has room.
    map: VoidMap<'a, S>,
    /// Voxels of each room; none at number 0.
    rooms: Vec<BTreeMap<Coord, Bits>>,
    /// A voxel of each room.
    places: Vec<Coord>,
    /// Numbers of the rooms in a leaf.
    labels: HashMap<Coord, Vec<(u32, Bits)>>,
    /// Voxels that are known to lead outside.
    outside: VoxelSet,
    sets: UnionFind,
}

impl<'a, S: LeafSource> Search<'a, S> {
    /// A search without rooms. Set 0 and place 0 stand for the outside.
    pub fn new(source: &'a S, measure: Measure, plan: SearchPlan) -> Self {
        Self {
            source,
            measure,
            plan,
            map: VoidMap::new(source, measure, plan.radius as f32),
            rooms: vec![BTreeMap::new()],
            places: vec![Coord([0; 3])],
            labels: HashMap::new(),
            outside: HashMap::new(),
            sets: UnionFind::new(1),
        }
    }

    /// A voxel of each room.
    pub fn rooms(&self) -> Vec<Coord> {
        self.places[1..].to_vec()
    }

    /// The channels that connect the rooms with the outside. Rooms for which no link is found stay unconnected.
    pub fn connected(&mut self, task: Task<'_>) -> Result<Vec<Link>, S::Error> {
        let mut channels = Vec::new();
        // In each round every cluster of rooms gets its cheapest link to another cluster or to the outside (Boruvka),
        // until no cluster finds one.
        loop {
            let mut clusters: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
            for n in 1..self.rooms.len() {
                let root = self.sets.find(n);
                if root != OUTSIDE as usize {
                    clusters.entry(root).or_default().push(n as u32);
                }
            }
            // Clusters in order of their roots, so that the result does not depend on the threads.
            let mut links = Vec::new();
            for (root, members) in clusters {
                if task.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                let rooms = members.iter().map(|&n| &self.rooms[n as usize]);
                let sources: Sources = rooms.flat_map(sources).collect();
                links.extend(self.link(root, &sources)?.map(|link| (root, link)));
            }
            if links.is_empty() {
                return Ok(channels);
            }
            links.sort_by(|(_, a), (_, b)| a.order(b));
            // Two clusters may choose each other: the second link would close a loop.
            for (root, link) in links {
                if self.sets.find(root) != self.sets.find(link.to as usize) {
                    self.sets.union(root, link.to as usize);
                    channels.push(link);
                }
            }
        }
    }

    /// The channels that connect narrow cavities with the rooms, the outside, and the beginnings of one another,
    /// cheapest first. A cavity without any way gets no channel.
    pub fn connected_narrow(
        &mut self,
        cavities: Vec<Narrow>,
        task: Task<'_>,
    ) -> Result<Vec<Link>, S::Error> {
        let mut open: Vec<(Sources, Link)> = Vec::new();
        for cavity in cavities {
            if task.progress.cancelled() {
                return Err(Cancelled.into());
            }
            let sources = sources(&cavity);
            // No room belongs to this cluster: every room is a target.
            let link = self.link(usize::MAX, &sources)?;
            open.extend(link.map(|link| (sources, link)));
        }
        let mut channels = Vec::new();
        // The cheapest link becomes a channel, whose beginning is a target for the others.
        while let Some(next) = (0..open.len()).min_by(|&a, &b| open[a].1.order(&open[b].1)) {
            let (_, link) = open.swap_remove(next);
            let [begin, _] = link.ends;
            let cube = Region {
                min: begin,
                max: begin,
            };
            // The ball of the channel has room at its beginning.
            for (sources, best) in &mut open {
                for (from, list) in sources.iter() {
                    if self.least_cost(*from, cube) > best.cost {
                        continue;
                    }
                    for &p in list {
                        let other = Link {
                            cost: self.cost(p, begin),
                            ends: [p, begin],
                            to: OUTSIDE,
                        };
                        if other.order(best).is_lt() {
                            *best = other;
                        }
                    }
                }
            }
            channels.push(link);
        }
        Ok(channels)
    }

    /// Adds the room around a voxel; `None` if it leads outside, or is known. `None` also where no ball of the radius
    /// has room. The result is the room's number, from 1.
    pub fn add(&mut self, place: Coord) -> Result<Option<usize>, S::Error> {
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
            let in_leaf = self.labels.entry(leaf).or_default();
            in_leaf.push((number as u32, bits));
        }
        self.rooms.push(voxels);
        self.places.push(place);
        Ok(Some(number))
    }

    /// Adds the rooms of a closed cavity, and returns whether it added any. `cavity` has its voxels by leaf. Rooms
    /// between which the neck is wide become one set. A cavity in which no ball of the radius has room has none.
    pub fn add_rooms(&mut self, cavity: &BTreeMap<Coord, Bits>) -> Result<bool, S::Error> {
        let first = self.rooms.len();
        for (&leaf, voxels) in cavity {
            let wide = self.map.leaf(leaf)?;
            let mut rest: Bits = std::array::from_fn(|x| voxels[x] & wide[x]);
            // Each room that is added labels at least one voxel of the rest.
            loop {
                for (_, bits) in self.labels.get(&leaf).into_iter().flatten() {
                    rest = std::array::from_fn(|x| rest[x] & !bits[x]);
                }
                let Some(&place) = voxels_of(leaf, &rest).first() else {
                    break;
                };
                // Never for a closed cavity, since no part of it leads outside; else the loop would not end.
                if self.add(place)?.is_none() {
                    break;
                }
            }
        }
        if self.rooms.len() > first + 1 {
            self.join_rooms(first)?;
        }
        Ok(self.rooms.len() > first)
    }

    /// Makes one of the rooms from a number on that wide necks connect.
    fn join_rooms(&mut self, first: usize) -> Result<(), S::Error> {
        let clearance = (self.plan.radius - NECK) as f32;
        let mut map = VoidMap::new(self.source, self.measure, clearance);
        let mut is_joined = vec![false; self.rooms.len()];
        for n in first..self.rooms.len() {
            if is_joined[n] {
                continue;
            }
            let (voxels, _) = map.flood(self.places[n], &VoxelSet::new())?;
            for m in n + 1..self.rooms.len() {
                let place = self.places[m];
                let leaf = voxels.get(&place.aligned(LEAF));
                if leaf.is_some_and(|bits| voxel_mask::contains(bits, offset(place))) {
                    is_joined[m] = true;
                    self.sets.union(n, m);
                }
            }
        }
        Ok(())
    }

    /// Remembers voxels that lead outside.
    fn open(&mut self, voxels: BTreeMap<Coord, Bits>) {
        for (leaf, bits) in voxels {
            voxel_mask::add(self.outside.entry(leaf).or_insert([0; 8]), &bits);
        }
    }

    /// The number of the room that holds a voxel; [`OTHER`] in a pocket that is not to be drained.
    fn label(&self, voxel: Coord) -> Option<u32> {
        let own = self.labels.get(&voxel.aligned(LEAF))?;
        let holds = |bits: &Bits| voxel_mask::contains(bits, offset(voxel));
        own.iter().find(|(_, bits)| holds(bits)).map(|l| l.0)
    }

    /// The cheapest way from a set to a room of another set, or outside. `root` is the cluster's representative,
    /// `sources` its voxels at the surface. `None` if there is no other room and no outside within the box of the
    /// solid, grown by the reach and a leaf.
    fn link(
        &mut self,
        root: usize,
        sources: &[(Region, Vec<Coord>)],
    ) -> Result<Option<Link>, S::Error> {
        loop {
            let Some(mut link) = self.nearest(root, sources)? else {
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
                let in_leaf = self.labels.entry(leaf).or_default();
                // A pocket that is not to be drained: it is marked, so that the search passes it, and the search goes
                // on.
                in_leaf.push((OTHER, bits));
            }
        }
    }

    /// The cheapest way to a voxel at which the ball has room, but for those of the set and of known pockets. The
    /// region grows by doubled steps around the sources. `None` without sources or without any such voxel.
    fn nearest(
        &mut self,
        root: usize,
        sources: &[(Region, Vec<Coord>)],
    ) -> Result<Option<Link>, S::Error> {
        let Some(hull) = sources.iter().map(|s| s.0).reduce(|a, b| Region {
            min: Coord([0, 1, 2].map(|i| a.min[i].min(b.min[i]))),
            max: Coord([0, 1, 2].map(|i| a.max[i].max(b.max[i]))),
        }) else {
            return Ok(None);
        };
        // Beside the solid the ball has room no nearer than its radius.
        let everything = self.measure.bounds.grown(self.measure.reach + LEAF);
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
                self.try_leaf(root, sources, leaf, &mut best)?;
            }
            // A voxel costs at least its distance, and those not searched are farther than the reach.
            let is_found = best.as_ref().is_some_and(|b| b.cost <= f64::from(reach));
            if is_found || is_whole {
                return Ok(best);
            }
            // Leaves at the end are searched again with the next region.
            searched = Some(region.grown(-LEAF));
            reach *= 2;
        }
    }

    /// Compares the ways to the voxels of a leaf with the best one. `best` is replaced by a cheaper way. `root` is the
    /// set of the cluster, whose voxels are in `sources`. The room of the target is not found here: `to` is the outside
    /// until the caller knows it.
    fn try_leaf(
        &mut self,
        root: usize,
        sources: &[(Region, Vec<Coord>)],
        leaf: Coord,
        best: &mut Option<Link>,
    ) -> Result<(), S::Error> {
        let mut bits = self.map.surface(leaf)?;
        // Voxels of the cluster itself, and of pockets that are not to be drained, are no targets.
        for (number, own) in self.labels.get(&leaf).into_iter().flatten() {
            if *number == OTHER || self.sets.find(*number as usize) == root {
                bits = std::array::from_fn(|x| bits[x] & !own[x]);
            }
        }
        if voxel_mask::is_empty(&bits) {
            return Ok(());
        }
        let targets = voxels_of(leaf, &bits);
        let to = Region::cube(leaf, LEAF);
        for (from, list) in sources {
            // A lower bound over the region saves the comparison of all pairs.
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

    /// The cost of a channel, voxels: its length, times 2 - cos of the angle to a preferred direction.
    fn cost(&self, from: Coord, to: Coord) -> f64 {
        let way = [0, 1, 2].map(|a| f64::from(to[a]) - f64::from(from[a]));
        let length = way.iter().map(|d| d * d).sum::<f64>().sqrt();
        match self.plan.toward {
            Some(t) => 2.0 * length - (way[0] * t[0] + way[1] * t[1] + way[2] * t[2]),
            None => length,
        }
    }

    /// A lower bound of the cost of channels between two boxes. Never more than the cost of any pair of voxels in them.
    fn least_cost(&self, from: Region, to: Region) -> f64 {
        let range = |a: usize| {
            let low = f64::from(to.min[a]) - f64::from(from.max[a]);
            let high = f64::from(to.max[a]) - f64::from(from.min[a]);
            [low, high]
        };
        let ranges = [0, 1, 2].map(range);
        let nearest = ranges.map(|[low, high]| low.max(-high).max(0.0));
        let length = nearest.iter().map(|d| d * d).sum::<f64>().sqrt();
        match self.plan.toward {
            Some(t) => {
                let along = |a: usize| (ranges[a][0] * t[a]).max(ranges[a][1] * t[a]);
                length.max(2.0 * length - (along(0) + along(1) + along(2)))
            }
            None => length,
        }
    }
}

/// The voxels at the surface of a set by leaf.
fn sources(set: &BTreeMap<Coord, Bits>) -> Sources {
    let at_surface = |(&leaf, bits): (&Coord, &Bits)| {
        let rim = super::void_map::rim(leaf, bits, |n| set.get(&n).copied().unwrap_or([0; 8]));
        (Region::cube(leaf, LEAF), voxels_of(leaf, &rim))
    };
    let all = set.iter().map(at_surface);
    all.filter(|(_, list)| !list.is_empty()).collect()
}
