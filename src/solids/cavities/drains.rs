//! Channels that drain cavities: the shortest straight ways through the solid that connect each with the outside.
//!
//! A *room* is a connected part of the void in which the centre of a ball of the channel's radius can move. A channel
//! leads from a voxel of a room to the nearest voxel of another one, or of the outside: a ball that stands at one end
//! has room along the whole channel and at its other end. Rooms that channels join continue as one, until all lead
//! outside: the channels are the edges of a minimum spanning tree. The cost of a channel is its length, or, with a
//! preferred direction, its length times 2 - cos(angle): 1 along it, 3 against it.
//!
//! In a *narrow* cavity no ball of the radius has room. Its channel begins where the largest ball that it holds has
//! room, so that this ball enters the channel, and leads to a room, the outside, or the beginning of another channel.
//! The law `the_channel_is_the_shortest_or_the_preferred_one` allows errors of two voxels in lengths.

use super::channels::{Search, SearchPlan};
use super::narrow::{Narrow, narrow_cavities};
use super::void_map::{VoidMap, VoxelSet};
use super::{Cavity, Measure, prepared};

use crate::Task;
use crate::leaf_source::LeafSource;
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::progress::Cancelled;

/// Loss of a channel's radius at voxels that may lie beside its axis (0.87, half the diagonal) and between the
/// distances there (0.5), rounded up, voxels.
const SAMPLING_LOSS: f64 = 1.5;

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

/// The ends of a channel's axis, voxels from voxel (0, 0, 0).
pub type Channel = [Vec3; 2];

/// The channels that drain a solid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DrainPlan {
    /// The channels; none without a cavity to drain.
    pub channels: Vec<Channel>,
    /// Voxels from which a ball of the radius gets outside once the channels are drilled.
    pub starts: Vec<Coord>,
}

/// The measure of a request, before the box of the leaves is known.
fn unbounded(voxel_size: f64, background: f32, request: &DrainRequest) -> Measure {
    Measure::new(voxel_size, background, request.radius.ceil() as i32 + 1)
}

/// The channels that drain the cavities of a solid. `voxel_size` and the half width `background` of the band are in
/// world units; `closed` are voxels in the closed cavities, used only without `request.narrow`.
///
/// # Errors
/// Cancellation, and errors of the source.
pub fn drain_plan<S: LeafSource>(
    source: &S,
    voxel_size: f64,
    background: f32,
    request: &DrainRequest,
    closed: &[Coord],
    task: Task<'_>,
) -> Result<DrainPlan, S::Error> {
    let measure = unbounded(voxel_size, background, request);
    let Some(measure) = prepared(source, measure) else {
        return Ok(DrainPlan::default());
    };
    let mut search = Search::new(source, measure, SearchPlan::of(request));
    let narrow: Vec<(Coord, f32)> = if request.narrow {
        let graph = super::blocks::VoidGraph::new(source, measure, task)?;
        // A cavity may have several rooms that are as narrow between one another.
        let is_wide = |depth: f32| depth >= request.radius as f32;
        let basins = graph.basins.iter().filter(|b| is_wide(b.depth));
        let rooms: Vec<Coord> = basins.map(|b| b.place).collect();
        let cavities = graph.cavities(measure, task.progress)?;
        task.progress.stage("drain", None);
        for room in rooms {
            search.add(room)?;
        }
        let radius = request.radius * measure.voxel_size;
        let is_narrow = |c: &&Cavity| c.throat.is_none() && c.radius < radius;
        let list = cavities.list.iter().filter(is_narrow);
        list.map(|c| (c.place, (c.radius / measure.voxel_size) as f32))
            .collect()
    } else {
        task.progress.stage("drain", None);
        closed_cavities(source, measure, closed, &mut search)?
    };
    let mut links = search.connected(task)?;
    let narrow: Vec<Narrow> = narrow_cavities(source, measure, narrow)?;
    links.extend(search.connected_narrow(narrow, task)?);
    // With the clearance 0 the map holds all voxels of the void; its complement is the solid.
    let mut solid = VoidMap::new(source, measure, 0.0);
    let mut starts = search.rooms();
    starts.extend(links.iter().map(|l| l.ends[0]));
    let channels = links.iter().map(|l| l.trimmed(&mut solid, request.radius));
    Ok(DrainPlan {
        channels: channels.collect::<Result<_, _>>()?,
        starts,
    })
}

/// Adds the rooms of the closed cavities around some voxels to the search. Returns the cavities without any: their
/// deepest voxel and its depth, voxels. Voxels of the solid, or of void that leads outside, add nothing.
fn closed_cavities<S: LeafSource>(
    source: &S,
    measure: Measure,
    closed: &[Coord],
    search: &mut Search<'_, S>,
) -> Result<Vec<(Coord, f32)>, S::Error> {
    let mut void = VoidMap::new(source, measure, 0.0);
    let mut narrow = Vec::new();
    for &place in closed {
        let (voxels, is_open) = void.flood(place, &VoxelSet::new())?;
        if is_open || voxels.is_empty() {
            continue;
        }
        if !search.add_rooms(&voxels)? {
            narrow.extend(super::narrow::deepest(source, measure, &voxels)?);
        }
    }
    Ok(narrow)
}

/// The first of `starts` from which a ball of the channels' radius, less the loss by sampling, does not get outside.
/// `voxel_size` and the half width `background` of the band are in world units.
///
/// # Errors
/// Cancellation, and errors of the source.
pub fn blocked_start<S: LeafSource>(
    source: &S,
    voxel_size: f64,
    background: f32,
    request: &DrainRequest,
    starts: &[Coord],
    task: Task<'_>,
) -> Result<Option<Coord>, S::Error> {
    let measure = unbounded(voxel_size, background, request);
    let Some(measure) = prepared(source, measure) else {
        return Ok(None);
    };
    task.progress.stage("drain", None);
    let clearance = (request.radius - SAMPLING_LOSS).max(0.0) as f32;
    let mut void = VoidMap::new(source, measure, clearance);
    let mut outside = VoxelSet::new();
    for &start in starts {
        if task.progress.cancelled() {
            return Err(Cancelled.into());
        }
        let (voxels, is_open) = void.flood(start, &outside)?;
        // A start outside the box of the solid has no voxels, and is open.
        if !is_open {
            return Ok(Some(start));
        }
        for (leaf, bits) in voxels {
            crate::voxel_mask::add(outside.entry(leaf).or_insert([0; 8]), &bits);
        }
    }
    Ok(None)
}
