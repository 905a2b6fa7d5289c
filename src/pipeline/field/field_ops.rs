//! The first operations of a recipe as one field, before any operation that needs a voxel's neighbours.
//!
//! Tiling, envelopes, skins and primitives are combined by minimum and maximum and sampled once. So they
//! are culled together, and the result does not depend on blocks. From the first operation that needs
//! neighbours on, the solid is a level set.

use crate::field::{
    BoxSolid, Capsule, Complement, Cylinder, HalfSpace, Intersection, Offset, Sphere,
};
use crate::frame::{Aabb, Vec3};
use crate::mesh::{MeshSolid, Side as MeshSide, Skin};
use crate::pipeline::base::chain::Chain;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::shape::{Borrowed, Shape, field_operations, intersection, union};
use crate::pipeline::content::inputs::Inputs;
use crate::recipe::{Length, Op, Operand, Scale, Side, Trim};

/// The solid as the field that is sampled, for voxels of one size.
pub(crate) fn shape<'a>(inputs: &'a Inputs, scale: Scale) -> Result<Shape<'a>, RunError> {
    shape_with(inputs, scale, inputs.offsets())
}

/// The solid after its field operations and some offsets, for voxels of the size in `scale`. Distances hold over
/// the band and over the offsets.
///
/// # Errors
/// An empty or unbounded solid, and solids to intersect whose boxes have no common part.
pub(crate) fn shape_with<'a>(
    inputs: &'a Inputs,
    scale: Scale,
    offsets: Offsets,
) -> Result<Shape<'a>, RunError> {
    let sections = inputs.recipe.sections();
    let reach = offsets.reach() + sections.band.half_width.0 * scale.voxel_size;
    let mut solid = inputs.tiling_shape(scale, offsets)?.map(Chained::from);
    // Operations from the first one that needs neighbours on act on the level set.
    let count = field_operations(&sections.op);
    for (n, op) in sections.op[..count].iter().enumerate() {
        // A first operation without a solid before it starts from its operand.
        let key = format!("op.{n}");
        let other = match op {
            Op::Trim(trim) => box_shape(trim_box(trim, scale), format!("the box of {key}")),
            _ => match op.operand() {
                Some(operand) => self::operand(inputs, operand, &key, scale, offsets)?,
                None => continue,
            },
        };
        solid = Some(match solid {
            Some(solid) => combine(op, solid, other, reach, offsets)?,
            None => Chained::from(other),
        });
    }
    let solid = solid.ok_or_else(|| RunError::Empty("no operation".into()))?;
    let mut shape = Shape {
        field: solid.chain.into_field(),
        extent: solid.extent,
        name: solid.name,
    };
    if shape.extent.is_empty() {
        return Err(RunError::Empty(shape.name));
    }
    if !shape.extent.size().iter().all(|s| s.is_finite()) {
        return Err(RunError::Unbounded(shape.name));
    }
    // The offset comes last: phi - distance, or |phi - distance| - half for a wall.
    if offsets.count > 0 {
        shape.extent = shape.extent.dilated(offsets.growth());
        shape.field = Box::new(Offset {
            field: shape.field,
            by: offsets.distance,
            half: offsets.half_wall,
        });
    }
    Ok(shape)
}

/// A box that contains the solid after its field operations and some offsets, world units. It is found without
/// making the field of the tiling, which is costly. `None` where the solid is empty, unbounded, or nothing makes one.
pub(crate) fn extent_bound(
    inputs: &Inputs,
    scale: Scale,
    offsets: Offsets,
) -> Result<Option<Aabb>, RunError> {
    let sections = inputs.recipe.sections();
    let mut bounds = inputs.tiled_extent(scale, offsets);
    let count = field_operations(&sections.op);
    for (n, op) in sections.op[..count].iter().enumerate() {
        let other = match (op, op.operand()) {
            (Op::Trim(trim), _) => trim_box(trim, scale),
            (_, Some(other)) => operand(inputs, other, &format!("op.{n}"), scale, offsets)?.extent,
            _ => continue,
        };
        bounds = Some(match (bounds, op) {
            (None, _) => other,
            (Some(bounds), Op::Intersect(_) | Op::Trim(_)) if bounds.meets(other) => {
                bounds.intersection(other)
            }
            // Disjoint boxes: the solid is empty.
            (Some(_), Op::Intersect(_) | Op::Trim(_)) => return Ok(None),
            // A subtraction may shrink the solid, but not by a known amount.
            (Some(bounds), Op::Subtract(_)) => bounds,
            (Some(bounds), _) => bounds.union(other),
        });
    }
    // A plane alone has an infinite box.
    let is_usable = |r: &Aabb| !r.is_empty() && r.size().iter().all(|s| s.is_finite());
    // The first filter keeps boxes of no solid from becoming boxes by dilation.
    let grown = bounds
        .filter(is_usable)
        .map(|r| r.dilated(offsets.growth()));
    Ok(grown.filter(is_usable))
}

/// A [`Shape`] that operations are added to.
struct Chained<'a> {
    chain: Chain<'a>,
    extent: Aabb,
    name: String,
}

impl<'a> From<Shape<'a>> for Chained<'a> {
    fn from(shape: Shape<'a>) -> Self {
        Self {
            chain: Chain::One(shape.field),
            extent: shape.extent,
            name: shape.name,
        }
    }
}

/// Adds an operation with its operand `b` to a solid `a` and keeps the name of `a`. `reach` is the distance from
/// the surface, world units, up to which values must be distances. Only an intersection fails, where the boxes
/// have no common part.
fn combine<'a>(
    op: &Op,
    a: Chained<'a>,
    b: Shape<'a>,
    reach: f64,
    offsets: Offsets,
) -> Result<Chained<'a>, RunError> {
    // Maxima and minima can be chained and culled together. Under offsets the distance to the edge of
    // the cut matters, and a combination that knows it takes their place.
    let and = |chain: Chain<'a>, field| match offsets.count {
        0 => chain.and(field),
        _ => Chain::One(intersection(chain.into_field(), field, reach, offsets)),
    };
    let (chain, extent) = match op {
        Op::Intersect(_) | Op::Trim(_) => {
            if !a.extent.meets(b.extent) {
                return Err(RunError::Disjoint {
                    left_name: a.name,
                    left: a.extent,
                    right_name: b.name,
                    right: b.extent,
                });
            }
            (and(a.chain, b.field), a.extent.intersection(b.extent))
        }
        // a minus b = a and not b.
        Op::Subtract(_) => (and(a.chain, Box::new(Complement(b.field))), a.extent),
        _ => {
            let chain = match offsets.count {
                0 => a.chain.or(b.field),
                _ => Chain::One(union(a.chain.into_field(), b.field, reach, offsets)),
            };
            (chain, a.extent.union(b.extent))
        }
    };
    Ok(Chained {
        chain,
        extent,
        name: a.name,
    })
}

/// The operand of an operation on the level set, which is number `n` of the recipe; `None` if it has none.
/// `extent_bound` gives a box of all that matters, world units; it is called only for a `trim`, which it crops,
/// and for an unbounded operand, which it bounds.
pub(crate) fn operation_shape<'a>(
    inputs: &'a Inputs,
    n: usize,
    op: &Op,
    scale: Scale,
    extent_bound: impl FnOnce() -> Result<Aabb, RunError>,
) -> Result<Option<Shape<'a>>, RunError> {
    let key = format!("op.{n}");
    if let Op::Trim(trim) = op {
        let extent = trim_box(trim, scale).intersection(extent_bound()?);
        return Ok(Some(box_shape(extent, format!("the box of {key}"))));
    }
    let Some(other) = op.operand() else {
        return Ok(None);
    };
    let shape = operand(inputs, other, &key, scale, Offsets::default())?;
    if shape.extent.size().iter().all(|s| s.is_finite()) {
        return Ok(Some(shape));
    }
    // The union with an unbounded solid is unbounded.
    if !matches!(op, Op::Intersect(_) | Op::Subtract(_)) {
        return Err(RunError::Unbounded(shape.name));
    }
    let bounds = extent_bound()?;
    Ok(Some(Shape {
        field: Box::new(Intersection(vec![shape.field, Box::new(BoxSolid(bounds))])),
        extent: bounds,
        name: shape.name,
    }))
}

/// The operand of an operation as a shape. `key` names the operation, as in `op.2`, and finds its input, which is
/// read already; `offsets` widen the distance up to which the values of tilings and lattices must be distances.
pub(crate) fn operand<'a>(
    inputs: &'a Inputs,
    operand: &Operand,
    key: &str,
    scale: Scale,
    offsets: Offsets,
) -> Result<Shape<'a>, RunError> {
    let point = |c: &[Length; 3]| Vec3::from(c.map(|l| l.resolve(scale)));
    Ok(match operand {
        Operand::Mesh(_) | Operand::Crystal(_) => {
            let solid = inputs.solid(key);
            let word = operand.surface().map_or("solid", |s| s.word());
            if let Some(lattice) = inputs.lattice(key) {
                let band = inputs.recipe.sections().band.half_width.0 * scale.voxel_size;
                // A file may hold beams without a mesh.
                let mesh = Some(solid).filter(|s| !s.mesh().is_empty());
                let bounds = mesh.map_or(Aabb::EMPTY, MeshSolid::bounds);
                return Ok(Shape {
                    extent: bounds.union(lattice.bounds()),
                    field: lattice.field(mesh, offsets.reach() + band, offsets),
                    name: format!("the {word} of {key}"),
                });
            }
            Shape {
                extent: solid.bounds(),
                field: Box::new(Borrowed(solid)),
                name: format!("the {word} of {key}"),
            }
        }
        Operand::Skin(skin) => {
            let solid = inputs.solid(key);
            let thickness = skin.thickness.resolve(scale);
            // `reach` is the part of the wall outside the mesh, by which the box grows.
            let (side, reach) = match skin.side {
                Side::Inside => (MeshSide::Inside, 0.0),
                Side::Outside => (MeshSide::Outside, thickness),
                Side::Both => (MeshSide::Both, thickness / 2.0),
            };
            Shape {
                extent: solid.bounds().dilated(reach),
                field: Box::new(Skin::new(solid, thickness, side)),
                name: format!("the skin of {key}"),
            }
        }
        Operand::Sphere(ball) => {
            let (centre, radius) = (point(&ball.centre), ball.radius.resolve(scale));
            Shape {
                extent: Aabb::of([centre]).dilated(radius),
                field: Box::new(Sphere { centre, radius }),
                name: format!("the sphere of {key}"),
            }
        }
        Operand::Box(block) => {
            let half = Vec3::from(block.size.map(|s| s.resolve(scale))) / 2.0;
            let centre = point(&block.centre);
            let extent = Aabb::of([centre - half, centre + half]);
            box_shape(extent, format!("the box of {key}"))
        }
        Operand::Vdb(_) => {
            let solid = inputs.volumes.solid(key);
            Shape {
                extent: solid.bounds(),
                field: Box::new(Borrowed(solid)),
                name: format!("the level set of {key}"),
            }
        }
        Operand::Cylinder(rod) => {
            let solid = Cylinder {
                ends: [point(&rod.from), point(&rod.to)],
                radius: rod.radius.resolve(scale),
            };
            Shape {
                extent: solid.bounds(),
                field: Box::new(solid),
                name: format!("the cylinder of {key}"),
            }
        }
        Operand::Capsule(rod) => {
            let solid = Capsule {
                ends: [point(&rod.from), point(&rod.to)],
                radius: rod.radius.resolve(scale),
            };
            Shape {
                extent: solid.bounds(),
                field: Box::new(solid),
                name: format!("the capsule of {key}"),
            }
        }
        Operand::Plane(plane) => {
            let normal = Vec3::from(plane.normal.map(|c| c.0));
            Shape {
                // A half space is unbounded; the operation gives it a box.
                extent: Aabb {
                    min: Vec3::repeat(f64::NEG_INFINITY),
                    max: Vec3::repeat(f64::INFINITY),
                },
                field: Box::new(HalfSpace {
                    point: point(&plane.point),
                    // The checks of the recipe refuse a normal of length 0; z is never used.
                    normal: normal.try_normalize(0.0).unwrap_or_else(Vec3::z),
                }),
                name: format!("the plane of {key}"),
            }
        }
        Operand::Cell(_) => {
            let options = inputs.tiling_options(scale, offsets);
            let name = format!("the cell of {key}");
            inputs.standalone_cell(key).shape(options, name)?
        }
    })
}

/// The box of a `trim`, world units; empty if its corners are in the wrong order.
pub(crate) fn trim_box(trim: &Trim, scale: Scale) -> Aabb {
    let point = |c: &[Length; 3]| Vec3::from(c.map(|l| l.resolve(scale)));
    Aabb {
        min: point(&trim.min),
        max: point(&trim.max),
    }
}

fn box_shape<'a>(extent: Aabb, name: String) -> Shape<'a> {
    Shape {
        field: Box::new(BoxSolid(extent)),
        extent,
        name,
    }
}
