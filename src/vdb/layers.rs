//! Layers of a solid as a printer makes them: islands, overhangs, cups and cross-sections.
//!
//! A layer is the plane section at its mid-height, on square pixels of one voxel, by trilinear interpolation of
//! the level set; a pixel is inside where the value at its centre is negative. The ends of layers are
//! multiples of their height along `up`. Pixels are connected over edges. One layer is compared with those below
//! it, so that memory holds a few layers only.
//!
//! - An **island** is a component of a layer that lies over no pixel of the layer below.
//! - The **overhanging** area of a layer is that of its pixels that are over nothing, and farther from what lies
//!   below than the angle admits. Since a pixel may be wider than the admitted step of one layer, the layer below
//!   is one from which the step is at least a pixel.
//! - A **cup** is a hole of a layer that lies over no hole of the layer below: a pocket that opens upwards, or in
//!   the first layer, against the plate. It is sealed until it meets the outside.

use super::cavities::{LeafSource, MemorySource};
use super::index::LeafIndex;
use super::{FileError, LevelSet, Session, VdbError};
use crate::band::LeafStore;
use crate::frame::{Coord, Vec3};
use crate::union_find::UnionFind;
use std::collections::VecDeque;

mod raster;
mod sections;

use raster::{Components, Raster};
use sections::{Frame, sections};

/// How a solid is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildRequest {
    /// The direction in which layers are stacked, a unit vector.
    pub up: Vec3,
    /// Height of a layer, world units.
    pub layer: f64,
    /// Greatest angle between a wall and `up` that needs no support, degrees: more than 0, less than 90.
    pub overhang: f64,
}

/// A layer; areas are in world units squared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerFacts {
    /// Its number; its lower end lies at this multiple of the layer height along `up`.
    pub number: i64,
    /// Area of the section.
    pub area: f64,
    /// Area that needs support.
    pub overhang: f64,
    /// Number of islands.
    pub islands: u64,
    /// Number of cups that begin.
    pub cups: u64,
    /// Area of the holes that are sealed.
    pub sealed: f64,
}

/// A component that begins in a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// A point of it, world units, in the frame of voxel (0, 0, 0).
    pub place: Vec3,
    /// Its area.
    pub area: f64,
}

/// The layers of a solid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildLayers {
    /// From the first layer with a pixel to the last.
    pub layers: Vec<LayerFacts>,
    /// The islands, from below.
    pub islands: Vec<Start>,
    /// The cups, from below.
    pub cups: Vec<Start>,
}

impl LevelSet {
    /// The layers of the solid. Values of `origin` do not matter: layers count from voxel (0, 0, 0).
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn build_layers(
        &self,
        request: &BuildRequest,
        session: Session<'_>,
    ) -> Result<BuildLayers, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        let voxels = (self.voxel_size(), self.background() as f32);
        layers(&MemorySource::new(&index), voxels, request, session)
    }
}

/// The layers of a solid on disk, as [`LevelSet::build_layers`] returns them.
///
/// # Errors
/// As there, and a changed leaf file.
pub fn stored_build_layers(
    store: &LeafStore,
    voxel_size: f64,
    request: &BuildRequest,
    session: Session<'_>,
) -> Result<BuildLayers, FileError> {
    layers(store, (voxel_size, store.background()), request, session)
}

fn layers<S: LeafSource>(
    source: &S,
    (voxel_size, background): (f64, f32),
    request: &BuildRequest,
    session: Session<'_>,
) -> Result<BuildLayers, S::Error> {
    let Some(bounds) = source.bounds() else {
        return Ok(BuildLayers::default());
    };
    let frame = Frame::new(request.up, request.layer / voxel_size, bounds);
    let mut analysis = Analysis::new(request, voxel_size, &frame);
    sections(source, &frame, background, session, |number, raster| {
        analysis.add(number, raster);
    })?;
    let mut found = analysis.found;
    let used = found.layers.iter().rposition(|l| l.area > 0.0);
    found.layers.truncate(used.map_or(0, |n| n + 1));
    Ok(found)
}

/// The layer below the one that is added.
struct Below {
    solid: Components,
    void: Components,
    /// Class of each component of the void: the pocket that it belongs to.
    class: Vec<u32>,
    /// Whether each component of the void leads outside.
    is_vented: Vec<bool>,
}

struct Analysis<'a> {
    frame: &'a Frame,
    voxel_size: f64,
    /// Admitted step per layer, pixels.
    step: f64,
    /// Number of layers by which the step is at least a pixel.
    lookback: usize,
    /// Offsets of pixels with squared distance, nearest first.
    disc: Vec<(f64, [i32; 2])>,
    /// The last layers, the latest last.
    rasters: VecDeque<Raster>,
    below: Option<Below>,
    found: BuildLayers,
}

impl<'a> Analysis<'a> {
    fn new(request: &BuildRequest, voxel_size: f64, frame: &'a Frame) -> Self {
        let step = frame.layer * request.overhang.to_radians().tan();
        let lookback = (1.0 / step).ceil().max(1.0) as usize;
        // Half a pixel is the error of a pixel's edge.
        let radius = lookback as f64 * step + 0.5;
        let reach = radius.floor() as i32;
        let mut disc = Vec::new();
        for row in -reach..=reach {
            for column in -reach..=reach {
                let square = f64::from(row * row + column * column);
                if square <= radius * radius {
                    disc.push((square, [row, column]));
                }
            }
        }
        disc.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self {
            frame,
            voxel_size,
            step,
            lookback,
            disc,
            rasters: VecDeque::new(),
            below: None,
            found: BuildLayers::default(),
        }
    }

    fn area(&self, pixels: u64) -> f64 {
        pixels as f64 * self.voxel_size * self.voxel_size
    }

    /// Adds the next layer. Layers before the first pixel do not count.
    fn add(&mut self, number: i64, raster: Raster) {
        if self.below.is_none() && raster.is_empty() {
            return;
        }
        let solid = Components::of(&raster, true);
        let void = Components::of(&raster, false);
        let islands = self.begun(number, &solid, self.below.as_ref().map(|b| &b.solid));
        // The first layer lies on the plate.
        let islands = if self.below.is_some() {
            islands
        } else {
            Vec::new()
        };
        let mut cups = self.begun(number, &void, self.below.as_ref().map(|b| &b.void));
        cups.retain(|(component, _)| *component != Components::OUTER);
        let (class, is_vented) = vented(&void, self.below.as_ref());
        let areas = void.pixels.iter().zip(&is_vented);
        let sealed: u64 = areas.filter(|(_, v)| !**v).map(|(n, _)| n).sum();
        let layer = LayerFacts {
            number,
            area: self.area(raster.pixels()),
            overhang: self.area(self.overhanging(&raster)),
            islands: islands.len() as u64,
            cups: cups.len() as u64,
            sealed: self.area(sealed),
        };
        self.found.layers.push(layer);
        self.found.islands.extend(islands.into_iter().map(|i| i.1));
        self.found.cups.extend(cups.into_iter().map(|c| c.1));
        self.below = Some(Below {
            solid,
            void,
            class,
            is_vented,
        });
        if self.rasters.len() == self.lookback {
            self.rasters.pop_front();
        }
        self.rasters.push_back(raster);
    }

    /// The components of a layer that lie over none of the layer below.
    fn begun(
        &self,
        number: i64,
        own: &Components,
        below: Option<&Components>,
    ) -> Vec<(u32, Start)> {
        let mut is_over = vec![false; own.pixels.len()];
        if let Some(below) = below {
            own.overlaps(below, |component, _| is_over[component as usize] = true);
        }
        let begun = (0..own.pixels.len()).filter(|&n| !is_over[n]);
        begun
            .map(|n| {
                let [row, column] = own.middle[n];
                let place = self.frame.place(number, row, column) * self.voxel_size;
                let area = self.area(own.pixels[n]);
                (n as u32, Start { place, area })
            })
            .collect()
    }

    /// Number of pixels that need support.
    fn overhanging(&self, raster: &Raster) -> u64 {
        let (Some(last), Some(low)) = (self.rasters.back(), self.rasters.front()) else {
            return 0;
        };
        let limit = (self.rasters.len() as f64 * self.step + 0.5).powi(2);
        let is_near = |row: usize, column: usize| {
            let disc = self.disc.iter().take_while(|(square, _)| *square <= limit);
            disc.into_iter().any(|(_, [r, c])| {
                low.contains(row as i64 + i64::from(*r), column as i64 + i64::from(*c))
            })
        };
        let mut count = 0;
        raster.for_each_without(last, |row, column| {
            count += u64::from(!is_near(row, column));
        });
        count
    }
}

/// The pocket of each component of the void, and whether it leads outside.
fn vented(void: &Components, below: Option<&Below>) -> (Vec<u32>, Vec<bool>) {
    let count = void.pixels.len();
    let older = below.map_or(0, |b| b.class.len());
    // Components of this layer, then those of the layer below.
    let mut sets = UnionFind::new(count + older);
    if let Some(below) = below {
        let mut first_of_class = std::collections::BTreeMap::new();
        for (n, &class) in below.class.iter().enumerate() {
            let first = *first_of_class.entry(class).or_insert(n);
            sets.union(count + n, count + first);
        }
        void.overlaps(&below.void, |own, other| {
            sets.union(own as usize, count + other as usize);
        });
    }
    let mut is_open = vec![false; count + older];
    let outer = sets.find(Components::OUTER as usize);
    is_open[outer] = true;
    if let Some(below) = below {
        for n in (0..older).filter(|&n| below.is_vented[n]) {
            let root = sets.find(count + n);
            is_open[root] = true;
        }
    }
    let class: Vec<u32> = (0..count).map(|n| sets.find(n) as u32).collect();
    let is_vented = class.iter().map(|&c| is_open[c as usize]).collect();
    (class, is_vented)
}

/// The world position, in the frame of voxel (0, 0, 0), of a voxel position.
fn voxel_position(c: Coord) -> Vec3 {
    Vec3::from(c.0.map(f64::from))
}
