//! Finds, in the layers of a solid as a printer makes them, islands, overhangs, cups and areas of sections.
//!
//! A layer is represented by the plane section at its mid-height, on square pixels of one voxel; a pixel is solid where
//! the trilinear value at its centre is negative. Pixels are connected over edges. The first layer lies on the plate.
//! Areas are those within the outline, which runs straight between the centres of pixels (`raster`).
//! Not promised: supports, heat or warp; what is thinner than a pixel or a layer may fall between their centres.
//!
//! - An **island** is a component of the solid pixels that lies over no solid pixel of the layer below.
//! - The **overhanging** pixels of a layer are over void, and farther from the solid below than the overhang angle
//!   admits. The solid below is that of the nearest lower layer over which the admitted step is at least a pixel.
//! - A **hole** is a component of the void pixels within the outline of the solid. A **cup** is a hole that lies
//!   over no void pixel of the layer below: it begins over solid or, in the first layer, over the plate.
//! - A **pocket** is a connected part of the void of all layers so far; it is **open** where it leads outside the
//!   outline of a layer, else **sealed**.
//!
//! ```
//! # mod druse { pub use druse_geometry::*; pub use druse_solids::*; pub use druse_tilings::*; }
//! use druse::{Task, band::*, field::*, frame::*, layers::*, progress::*};
//! let block = |min: [f64; 3], max: [f64; 3]| Aabb { min: min.into(), max: max.into() };
//! let extent = block([0.0; 3], [24.0, 10.0, 10.0]);
//! // One on the plate; another, of 10 x 10, that begins 5 above it and meets nothing.
//! let [low, high] = [block([0.0; 3], [10.0; 3]), block([14.0, 0.0, 5.0], [24.0, 10.0, 10.0])];
//! let pair = Union(vec![Box::new(BoxSolid(low)), Box::new(BoxSolid(high))]);
//! let threads = Threads::new(1).unwrap();
//! let file = std::env::temp_dir().join(format!("druse-pair-{}", std::process::id()));
//! let head = LeafFileHead { plan: [0; 32], brick: 0, background: 3.0 };
//! let sink = LeafFileWriter::new(std::fs::File::create(&file).unwrap(), &head).unwrap();
//! Band::new(&pair, extent, 1.0).unwrap().evaluate(&threads, &Silent, &sink).unwrap();
//! sink.finish().unwrap();
//! let store = LeafStore::open(vec![(file.clone(), head)], &threads, &Silent).unwrap();
//! let task = Task { threads: &threads, progress: &Silent };
//! let request = BuildRequest { up: Vec3::z(), layer_height: 1.0, overhang_angle: 45.0 };
//! let found = build_layers(&store, 1.0, 3.0, &request, task).unwrap();
//! assert!(found.islands.len() == 1 && (found.islands[0].area - 100.0).abs() < 5.0);
//! # std::fs::remove_file(file).unwrap();
//! ```

use super::Task;
use super::leaf_source::LeafSource;
use druse_geometry::frame::Vec3;
use druse_geometry::union_find::UnionFind;
use std::collections::VecDeque;

mod raster;
mod sections;

use raster::{Components, Raster};
use sections::{Frame, sections};

/// Distance of the outline from the centre of a solid pixel on its way out: 0 to 1 pixels, on average this.
const MEAN_EDGE: f64 = 0.5;

/// How a solid is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildRequest {
    /// The direction in which layers are stacked, a unit vector.
    pub up: Vec3,
    /// Height of a layer, world units. The ends of layers are its multiples along `up`.
    pub layer_height: f64,
    /// Greatest angle between a wall and `up` that needs no support, degrees: more than 0, less than 90.
    pub overhang_angle: f64,
}

/// Measures of one layer; areas are in world units squared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerFacts {
    /// Its number; its lower end lies at this multiple of the layer height along `up`.
    pub number: i64,
    /// Area of the section.
    pub area: f64,
    /// Area that needs support.
    pub overhang_area: f64,
    /// Number of islands.
    pub island_count: u64,
    /// Number of cups that begin in the layer.
    pub cup_count: u64,
    /// Area of the holes that belong to sealed pockets.
    pub sealed_area: f64,
}

/// An island or a cup, in the layer where it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerRegion {
    /// A point of it, world units, relative to the centre of voxel (0, 0, 0).
    pub place: Vec3,
    /// Its area in that layer, world units squared.
    pub area: f64,
}

/// The layers of a solid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildLayers {
    /// From the lowest layer with a solid pixel to the highest.
    pub layers: Vec<LayerFacts>,
    /// The islands, from below.
    pub islands: Vec<LayerRegion>,
    /// The cups, from below.
    pub cups: Vec<LayerRegion>,
}

/// The layers of the solid whose leaves `source` gives; `voxel_size` and `background` are in world units. Layers count
/// from voxel (0, 0, 0). `background` is the half width of the band. The layers are sampled from below in groups, and
/// only the last few are kept. Without leaves there are no layers.
///
/// # Errors
/// Cancellation, and errors of the source.
pub fn build_layers<S: LeafSource>(
    source: &S,
    voxel_size: f64,
    background: f32,
    request: &BuildRequest,
    task: Task<'_>,
) -> Result<BuildLayers, S::Error> {
    let Some(bounds) = source.bounds() else {
        return Ok(BuildLayers::default());
    };
    let frame = Frame::new(request.up, request.layer_height / voxel_size, bounds);
    let mut analysis = Analysis::new(request, voxel_size, &frame);
    sections(source, &frame, background, task, |number, raster| {
        analysis.add(number, raster);
    })?;
    let mut found = analysis.found;
    let highest = found.layers.iter().rposition(|l| l.area > 0.0);
    found.layers.truncate(highest.map_or(0, |n| n + 1));
    Ok(found)
}

/// The components of the layer below the one that is added.
struct Below {
    solid: Components,
    void: Components,
    pockets: Pockets,
}

/// The pockets of the components of a layer's void.
struct Pockets {
    /// For each component, a number that the components of one pocket share.
    pocket: Vec<u32>,
    /// For each component, whether its pocket is open.
    is_open: Vec<bool>,
}

/// The state after some layers, which are added from below. It holds the layers that overhangs are compared with.
struct Analysis<'a> {
    frame: &'a Frame,
    voxel_size: f64,
    /// Horizontal step that the overhang angle admits per layer, pixels.
    step: f64,
    /// Number of layers over which the admitted step is at least a pixel.
    lookback: usize,
    /// Squared length, pixels squared, and [row, column] of the offsets within the step over `lookback` layers,
    /// nearest first.
    offsets: Vec<(f64, [i32; 2])>,
    /// The last layers, at most `lookback`, from below.
    rasters: VecDeque<Raster>,
    /// `None` before the first layer with a solid pixel.
    below: Option<Below>,
    found: BuildLayers,
}

impl<'a> Analysis<'a> {
    /// The state before the first layer. `step` is the horizontal step that the overhang angle admits per layer,
    /// `lookback` the layers over which it is at least a pixel.
    fn new(request: &BuildRequest, voxel_size: f64, frame: &'a Frame) -> Self {
        let step = frame.layer_height * request.overhang_angle.to_radians().tan();
        let lookback = (1.0 / step).ceil().max(1.0) as usize;
        // A pixel at which the overhang begins is beyond the step by half a pixel, its support ends a pixel outwards.
        let radius = lookback as f64 * step + 1.0 + MEAN_EDGE;
        let reach = radius.floor() as i32;
        let mut offsets = Vec::new();
        for row in -reach..=reach {
            for column in -reach..=reach {
                let square = f64::from(row * row + column * column);
                if square <= radius * radius {
                    offsets.push((square, [row, column]));
                }
            }
        }
        offsets.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self {
            frame,
            voxel_size,
            step,
            lookback,
            offsets,
            rasters: VecDeque::new(),
            below: None,
            found: BuildLayers::default(),
        }
    }

    /// An area of so many pixels, world units squared.
    fn area(&self, pixels: f64) -> f64 {
        pixels * self.voxel_size * self.voxel_size
    }

    /// Adds the next layer. Layers below the first solid pixel are left out. The raster is kept as long as overhangs
    /// are compared with it.
    fn add(&mut self, number: i64, raster: Raster) {
        if self.below.is_none() && raster.is_empty() {
            return;
        }
        let solid = Components::of_solid(&raster);
        let void = Components::of_void(&raster);
        let islands = self.starts(number, &solid, self.below.as_ref().map(|b| &b.solid));
        // The first layer lies on the plate.
        let islands = if self.below.is_some() {
            islands
        } else {
            Vec::new()
        };
        // A hole over no void is a cup; the component around the outline is no hole.
        let mut cups = self.starts(number, &void, self.below.as_ref().map(|b| &b.void));
        cups.retain(|(component, _)| *component != Components::OUTER);
        let pockets = Pockets::of(&void, self.below.as_ref());
        let void_areas = void.areas.iter().zip(&pockets.is_open);
        // A pocket that leads outside in no layer so far is sealed.
        let sealed = void_areas.filter(|(_, is_open)| !**is_open);
        let sealed_area = sealed.fold(0.0, |sum, (area, _)| sum + area);
        let layer = LayerFacts {
            number,
            area: self.area(raster.area()),
            overhang_area: self.area(self.overhang_area(&raster)),
            island_count: islands.len() as u64,
            cup_count: cups.len() as u64,
            sealed_area: self.area(sealed_area),
        };
        self.found.layers.push(layer);
        self.found.islands.extend(islands.into_iter().map(|i| i.1));
        self.found.cups.extend(cups.into_iter().map(|c| c.1));
        self.below = Some(Below {
            solid,
            void,
            pockets,
        });
        if self.rasters.len() == self.lookback {
            self.rasters.pop_front();
        }
        self.rasters.push_back(raster);
    }

    /// The components of a layer's solid or void that lie over none of the layer below, with their numbers. `number` is
    /// that of the layer; `below` is `None` for the first one, where all components start.
    fn starts(
        &self,
        number: i64,
        own: &Components,
        below: Option<&Components>,
    ) -> Vec<(u32, LayerRegion)> {
        let mut is_over = vec![false; own.pixels.len()];
        if let Some(below) = below {
            own.overlaps(below, |component, _| is_over[component as usize] = true);
        }
        (0..own.pixels.len())
            .filter(|&component| !is_over[component])
            .map(|component| {
                let [row, column] = own.middle[component];
                let place = self.frame.place(number, row, column) * self.voxel_size;
                let area = self.area(own.areas[component]);
                (component as u32, LayerRegion { place, area })
            })
            .collect()
    }

    /// Area of the next layer that needs support, pixels; none of the first layer, which lies on the plate. Support
    /// reaches as far beyond the outline of the lowest kept layer as the layers above it admit.
    fn overhang_area(&self, raster: &Raster) -> f64 {
        let (Some(last), Some(lowest)) = (self.rasters.back(), self.rasters.front()) else {
            return 0.0;
        };
        // Fewer than `lookback` layers near the plate.
        let admitted = self.rasters.len() as f64 * self.step;
        // Distance of a pixel's centre from the outline below: |offset| - (area - 1/2), as a straight outline at the
        // distance e from the centre of a solid pixel leaves it the area 1/2 + e.
        let distance = |row: usize, column: usize| {
            let mut least = f64::INFINITY;
            for (square, [r, c]) in &self.offsets {
                let length = square.sqrt();
                // No outline is farther out than a pixel.
                if length - 1.0 >= least {
                    break;
                }
                let (row, column) = (row as i64 + i64::from(*r), column as i64 + i64::from(*c));
                if lowest.contains(row, column) {
                    // Area less 1/2 is how far the outline lies beyond the centre, 0 to 1 pixels.
                    let edge = lowest.pixel_area(row as usize, column as usize) - 0.5;
                    least = least.min(length - edge.clamp(0.0, 1.0));
                }
            }
            least
        };
        let mut sum = 0.0;
        // What a pixel has gained over the layer below, as far as it has no support. A new pixel takes area from the
        // one behind it, which was counted there.
        let mut add = |row: usize, column: usize, area_below: f64| {
            let area = raster.pixel_area(row, column);
            let growth = area - area_below;
            // The solid ends area - 1/2 beyond the centre, the support `admitted` beyond the outline below.
            let beyond = distance(row, column) - admitted + area - 0.5;
            sum += growth.signum() * beyond.clamp(0.0, growth.abs());
        };
        raster.for_each_without(last, |row, column| add(row, column, 0.0));
        // Where walls lean by less than a pixel a layer, most layers move the outline within its pixels.
        for pixel in last.solid_rim() {
            let (row, column) = (pixel.row as usize, pixel.column as usize);
            if raster.contains(row as i64, column as i64) {
                add(row, column, last.pixel_area(row, column));
            }
        }
        sum.max(0.0)
    }
}

impl Pockets {
    /// The pockets of a layer's void, from those of the layer below.
    fn of(void: &Components, below: Option<&Below>) -> Self {
        let count = void.pixels.len();
        let count_below = below.map_or(0, |b| b.pockets.pocket.len());
        // The components of this layer, then those of the layer below.
        let mut sets = UnionFind::new(count + count_below);
        if let Some(below) = below {
            // Components of one pocket below are one set already.
            let mut first_of_pocket = std::collections::BTreeMap::new();
            for (n, &pocket) in below.pockets.pocket.iter().enumerate() {
                let first = *first_of_pocket.entry(pocket).or_insert(n);
                sets.union(count + n, count + first);
            }
            void.overlaps(&below.void, |own, other| {
                sets.union(own as usize, count + other as usize);
            });
        }
        let mut is_open_set = vec![false; count + count_below];
        is_open_set[sets.find(Components::OUTER as usize)] = true;
        if let Some(below) = below {
            for n in (0..count_below).filter(|&n| below.pockets.is_open[n]) {
                is_open_set[sets.find(count + n)] = true;
            }
        }
        let pocket: Vec<u32> = (0..count).map(|n| sets.find(n) as u32).collect();
        let is_open = pocket.iter().map(|&p| is_open_set[p as usize]).collect();
        Self { pocket, is_open }
    }
}
