//! From operations to one field: what is made before anything needs neighbours.
//!
//! Tiling, envelopes, skins and primitives are combined by minimum and maximum and sampled once, so
//! that they are culled together and the result does not depend on blocks. The first operation that
//! needs neighbours ends this; from there on the solid is a level set.

use super::error::RunError;
use super::stock::Stock;
use crate::field::{BoxSolid, Complement, Field, Intersection, Sphere, Union, WorldField};
use crate::frame::{Aabb, Vec3};
use crate::mesh::{Side as MeshSide, Skin};
use crate::recipe::{Length, Op, Operand, Scale, Side};

/// A solid as a field, the box it lies in, and what it is called in messages.
pub(super) struct Shape<'a> {
    pub field: Box<WorldField<'a>>,
    pub extent: Aabb,
    pub name: String,
}

/// How many operations from the first act on the field.
pub(super) fn field_operations(ops: &[Op]) -> usize {
    ops.iter().take_while(|op| op.operand().is_some()).count()
}

/// The solid after its field operations, for voxels of one size.
pub(super) fn shape<'a>(stock: &'a Stock, scale: Scale) -> Result<Shape<'a>, RunError> {
    let sections = stock.recipe.sections();
    let mut shape = stock.tiled(scale)?;
    let count = field_operations(&sections.op);
    for (n, op) in sections.op[..count].iter().enumerate() {
        if let Some(operand) = op.operand() {
            let other = self::operand(stock, operand, &format!("op.{n}"), scale);
            shape = Some(match shape {
                Some(shape) => combine(op, shape, other)?,
                None => other,
            });
        }
    }
    let shape = shape.ok_or_else(|| RunError::Empty("no operation".into()))?;
    if shape.extent.is_empty() {
        return Err(RunError::Empty(shape.name));
    }
    Ok(shape)
}

/// Two fields to one.
fn combine<'a>(op: &Op, a: Shape<'a>, b: Shape<'a>) -> Result<Shape<'a>, RunError> {
    let name = a.name.clone();
    Ok(match op {
        Op::Intersect(_) => {
            if !a.extent.meets(b.extent) {
                return Err(RunError::Apart {
                    left_name: a.name,
                    left: a.extent,
                    right_name: b.name,
                    right: b.extent,
                });
            }
            Shape {
                extent: a.extent.intersection(b.extent),
                field: Box::new(Intersection(vec![a.field, b.field])),
                name,
            }
        }
        Op::Subtract(_) => Shape {
            extent: a.extent,
            field: Box::new(Intersection(vec![a.field, Box::new(Complement(b.field))])),
            name,
        },
        _ => Shape {
            extent: a.extent.union(b.extent),
            field: Box::new(Union(vec![a.field, b.field])),
            name,
        },
    })
}

/// The solid to combine with.
pub(super) fn operand<'a>(
    stock: &'a Stock,
    operand: &Operand,
    key: &str,
    scale: Scale,
) -> Shape<'a> {
    let point = |c: &[Length; 3]| Vec3::from(c.map(|l| l.resolve(scale)));
    match operand {
        Operand::Mesh(_) => {
            let solid = stock.solid(key);
            Shape {
                extent: solid.bounds(),
                field: Box::new(Borrowed(solid)),
                name: format!("the mesh of {key}"),
            }
        }
        Operand::Skin(skin) => {
            let solid = stock.solid(key);
            let thickness = skin.thickness.resolve(scale);
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
            Shape {
                extent,
                field: Box::new(BoxSolid(extent)),
                name: format!("the box of {key}"),
            }
        }
    }
}

/// A field that somebody else owns.
pub(super) struct Borrowed<'a, F>(pub &'a F);

impl<F: Field> Field for Borrowed<'_, F> {
    type Point = F::Point;
    fn value(&self, p: F::Point) -> f64 {
        self.0.value(p)
    }
    fn value_and_gradient(&self, p: F::Point) -> (f64, <F::Point as crate::field::Point>::Vector) {
        self.0.value_and_gradient(p)
    }
    fn bound(&self, region: &<F::Point as crate::field::Point>::Region) -> crate::field::Interval {
        self.0.bound(region)
    }
    fn fill(&self, lattice: &crate::field::SampleLattice<F::Point>, out: &mut [f32]) {
        self.0.fill(lattice, out);
    }
}
