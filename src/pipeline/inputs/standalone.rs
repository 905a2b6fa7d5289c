//! Standalone cells: one element of a cell, placed in space, as a solid.
//!
//! The cell fills one element, scaled from its reference coordinates. A planar cell fills the prism over
//! its element. A cell of the ball fills the cube around the ball, and the ball bounds it.

use crate::cell::{Cell, Table};
use crate::field::{Intersection, Sphere};
use crate::frame::{Aabb, Element, Vec3};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::shape::Shape;
use crate::scaffold::{Connectivity, Kind, Scaffold};
use crate::tiling::{TiledSolid, TilingOptions};

/// One element of a cell in space.
pub(crate) struct StandAlone {
    scaffold: Scaffold,
    table: Table,
    /// Centre and radius of the ball that bounds it.
    ball: Option<(Vec3, f64)>,
}

impl StandAlone {
    /// The cell with the origin of its reference coordinates at `centre` and a reference length of `size`, world
    /// units. Tables have their default accuracy, whatever the recipe's tolerance.
    pub fn new(cell: &Cell, centre: Vec3, size: f64) -> Result<Self, RunError> {
        let failed = |e: String| RunError::Tiling(e);
        let (kind, shape) = match cell.element() {
            Element::Tet => (Kind::Tet4, Element::Tet),
            Element::Tri | Element::Wedge => (Kind::Wedge6, Element::Wedge),
            Element::Pyramid => (Kind::Pyramid5, Element::Pyramid),
            Element::Quad | Element::Hex | Element::Ball => (Kind::Hex8, Element::Hex),
        };
        let vertices: Vec<Vec3> = shape.vertices().iter().map(|v| centre + v * size).collect();
        let mut elements = Connectivity::default();
        let nodes: Vec<u32> = (0..vertices.len() as u32).collect();
        elements.push(kind, &nodes);
        Ok(Self {
            scaffold: Scaffold::new(vertices, elements).map_err(|e| failed(e.to_string()))?,
            table: Table::new(cell).map_err(|e| failed(e.to_string()))?,
            // The reference ball has the diameter 1.
            ball: (cell.element() == Element::Ball).then_some((centre, size / 2.0)),
        })
    }

    /// The bounding box.
    pub fn bounds(&self) -> Aabb {
        self.scaffold.bounds()
    }

    /// The solid as a field in world units; `name` is for messages.
    pub fn shape(&self, options: TilingOptions, name: String) -> Result<Shape<'_>, RunError> {
        let solid = TiledSolid::new(&self.scaffold, &self.table, options)
            .map_err(|e| RunError::Tiling(e.to_string()))?;
        Ok(Shape {
            extent: self.bounds(),
            field: match self.ball {
                None => Box::new(solid),
                Some((centre, radius)) => Box::new(Intersection(vec![
                    Box::new(solid),
                    Box::new(Sphere { centre, radius }),
                ])),
            },
            name,
        })
    }
}
