//! Cylinders, tubes and balls of curved hexes, made without a mesher.
//!
//! Around a core, a square or cube bulged towards the circle, lie blocks that reach to the rim ("O-grid"). Elements are
//! Hex27 with their nodes on the shape itself: the rim is met to the third order of the cell size. A tube has no core,
//! and the middles of its arcs lie slightly outside the circle, so that tangents meet at their ends.

use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use druse_geometry::frame::Vec3;
use std::collections::HashMap;

/// Share of the radius that the core takes.
const CORE_SHARE: f64 = 0.5;
/// Shape of the core's sides, from flat (0) to round (1).
const CORE_ROUNDNESS: f64 = 0.5;
/// Maximum number of elements.
const MAX_ELEMENTS: f64 = 2e7;

/// A lattice point.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Name {
    /// The point of the core, or that of its surface below the point, in half cells.
    core: [i64; 3],
    /// Half layers outside the core.
    layer: i64,
}

/// The direction of a point of the cube's surface; the tangent makes the angles uniform.
fn direction(c: Vec3) -> Vec3 {
    c.map(|c| libm::tan(c * std::f64::consts::FRAC_PI_4))
        .try_normalize(0.0)
        .unwrap_or_default()
}

/// The position of a lattice point in a ball of radius 1; a coordinate z of 0 gives a disc.
fn place(name: Name, n: i64, layers: i64) -> Vec3 {
    let c = Vec3::from(name.core.map(|i| i as f64 / n as f64 - 1.0));
    let size = c.amax();
    let unit = if size > 0.0 { direction(c / size) } else { c };
    // A blend of a square or cube of half edge 1.1 / sqrt 2 = 0.78 and the unit circle or sphere, scaled to the core.
    let inner = (c * (1.0 - CORE_ROUNDNESS) / 2f64.sqrt() * 1.1 + unit * (size * CORE_ROUNDNESS))
        * CORE_SHARE;
    let outward = name.layer as f64 / (2 * layers) as f64;
    inner * (1.0 - outward) + unit * outward
}

struct Builder<F> {
    place: F,
    names: HashMap<Name, u32>,
    nodes: Vec<Vec3>,
    elements: Connectivity,
}

impl<F: Fn(Name) -> Vec3> Builder<F> {
    /// Adds the element whose lattice points are named by half steps 0 to 2 along its axes.
    fn hex(&mut self, name: impl Fn([i64; 3]) -> Name) {
        let element_nodes: Vec<u32> = Kind::Hex27
            .lattice()
            .iter()
            .map(|p| {
                let name = name(p.map(i64::from));
                *self.names.entry(name).or_insert_with(|| {
                    self.nodes.push((self.place)(name));
                    self.nodes.len() as u32 - 1
                })
            })
            .collect();
        self.elements.push(Kind::Hex27, &element_nodes);
    }
}

impl Scaffold {
    /// A ball around the origin, of hexes of about `cell` along their edges.
    ///
    /// # Errors
    /// [`ScaffoldError::BadRound`], [`ScaffoldError::TooMany`].
    pub fn ball(radius: f64, cell: f64) -> Result<Self, ScaffoldError> {
        let (n, layers) = counts(radius, cell, 3, 1.0)?;
        let mut builder = Builder {
            place: |name: Name| place(name, n, layers) * radius,
            names: HashMap::new(),
            nodes: Vec::new(),
            elements: Connectivity::default(),
        };
        // The core: a cube of n^3 elements, each two half steps wide.
        for z in 0..n {
            for y in 0..n {
                for x in 0..n {
                    builder.hex(|p| Name {
                        core: [2 * x + p[0], 2 * y + p[1], 2 * z + p[2]],
                        layer: 0,
                    });
                }
            }
        }
        // On each side of the core, layers of elements reach from its surface to the sphere.
        for axis in 0..3 {
            for end in [0, 2 * n] {
                for v in 0..n {
                    for u in 0..n {
                        for l in 0..layers {
                            builder.hex(|p| {
                                let mut core = [0; 3];
                                core[axis] = end;
                                core[(axis + 1) % 3] = 2 * u + p[0];
                                core[(axis + 2) % 3] = 2 * v + p[1];
                                Name {
                                    core,
                                    layer: 2 * l + p[2],
                                }
                            });
                        }
                    }
                }
            }
        }
        Self::new(builder.nodes, builder.elements)
    }

    /// A cylinder around the z axis from z = 0 to `height`, of hexes of about `cell` along their edges.
    ///
    /// # Errors
    /// [`ScaffoldError::BadRound`], [`ScaffoldError::TooMany`].
    pub fn cylinder(radius: f64, height: f64, cell: f64) -> Result<Self, ScaffoldError> {
        if !(height.is_finite() && height > 0.0) {
            return Err(ScaffoldError::BadRound {
                radius: height,
                cell,
            });
        }
        let floors = (height / cell).round().max(1.0);
        let (n, layers) = counts(radius, cell, 2, floors)?;
        let floors = floors as i64;
        let mut builder = Builder {
            place: |name: Name| {
                let [x, y, z] = name.core;
                // In the disc's middle plane the core's third coordinate is that of its centre.
                let in_disc = Name {
                    core: [x, y, n],
                    ..name
                };
                let flat = place(in_disc, n, layers) * radius;
                Vec3::new(flat.x, flat.y, height * (z as f64 / (2 * floors) as f64))
            },
            names: HashMap::new(),
            nodes: Vec::new(),
            elements: Connectivity::default(),
        };
        // The core of each floor, then blocks on its four sides.
        for z in 0..floors {
            for y in 0..n {
                for x in 0..n {
                    builder.hex(|p| Name {
                        core: [2 * x + p[0], 2 * y + p[1], 2 * z + p[2]],
                        layer: 0,
                    });
                }
            }
            for axis in 0..2 {
                for end in [0, 2 * n] {
                    for u in 0..n {
                        for l in 0..layers {
                            builder.hex(|p| {
                                let mut core = [0, 0, 2 * z + p[2]];
                                core[axis] = end;
                                core[1 - axis] = 2 * u + p[0];
                                Name {
                                    core,
                                    layer: 2 * l + p[1],
                                }
                            });
                        }
                    }
                }
            }
        }
        Self::new(builder.nodes, builder.elements)
    }
}

impl Scaffold {
    /// A tube around the z axis from z = 0 to `height`, of hexes of about `cell` along their edges. Its
    /// map is continuously differentiable across all faces: arcs are Bezier curves with the circle's
    /// tangents at their ends, so that cells normal to their faces make a surface without creases.
    ///
    /// # Errors
    /// [`ScaffoldError::BadRound`], [`ScaffoldError::TooMany`].
    pub fn tube(inner: f64, outer: f64, height: f64, cell: f64) -> Result<Self, ScaffoldError> {
        for length in [inner, outer - inner, height, cell] {
            if !(length.is_finite() && length > 0.0) {
                return Err(ScaffoldError::BadRound {
                    radius: length,
                    cell,
                });
            }
        }
        let count = |length: f64, least: f64| (length / cell).round().max(least);
        let around = count(std::f64::consts::PI * (inner + outer), 4.0);
        let (across, floors) = (count(outer - inner, 1.0), count(height, 1.0));
        let found = around * across * floors;
        if found > MAX_ELEMENTS {
            return Err(ScaffoldError::TooMany {
                found: found.min(1e18) as usize,
                limit: MAX_ELEMENTS as usize,
                what: "elements",
            });
        }
        let (n, across, floors) = (around as i64, across as i64, floors as i64);
        let turn = std::f64::consts::PI / around;
        // Where the tangents at an arc's ends meet, halfway to the chord.
        let middle = f64::midpoint(libm::cos(turn), libm::cos(turn).recip());
        let mut builder = Builder {
            // A tube has no core: its lattice runs around, outwards and up.
            place: |name: Name| {
                let [around, outward, up] = name.core;
                let angle = around as f64 * turn;
                let radius = inner + (outer - inner) * (outward as f64 / (2 * across) as f64);
                let radius = radius * if around % 2 == 0 { 1.0 } else { middle };
                let z = height * (up as f64 / (2 * floors) as f64);
                Vec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
            },
            names: HashMap::new(),
            nodes: Vec::new(),
            elements: Connectivity::default(),
        };
        for z in 0..floors {
            for y in 0..across {
                for x in 0..n {
                    // The last element ends where the first begins.
                    builder.hex(|p| Name {
                        core: [(2 * x + p[0]) % (2 * n), 2 * y + p[1], 2 * z + p[2]],
                        layer: 0,
                    });
                }
            }
        }
        Self::new(builder.nodes, builder.elements)
    }
}

/// Cells along the core's edge and layers around it, for a ball (`dimension` 3) or for a disc (2) on each of `floors`.
///
/// # Errors
/// [`ScaffoldError::BadRound`] for lengths that are not positive, [`ScaffoldError::TooMany`].
fn counts(
    radius: f64,
    cell: f64,
    dimension: i32,
    floors: f64,
) -> Result<(i64, i64), ScaffoldError> {
    let usable = |l: f64| l.is_finite() && l > 0.0;
    if !usable(radius) || !usable(cell) {
        return Err(ScaffoldError::BadRound { radius, cell });
    }
    let n = (2.0 * CORE_SHARE * radius / cell).round().max(1.0);
    let layers = ((1.0 - CORE_SHARE) * radius / cell).round().max(1.0);
    let sides = f64::from(2 * dimension);
    let found = (n.powi(dimension) + sides * n.powi(dimension - 1) * layers) * floors;
    if found > MAX_ELEMENTS {
        return Err(ScaffoldError::TooMany {
            found: found.min(1e18) as usize,
            limit: MAX_ELEMENTS as usize,
            what: "elements",
        });
    }
    Ok((n as i64, layers as i64))
}
