//! The tiled scaffold of a recipe as one field: cells mapped through its elements, or round beams, or sheets, cut
//! by the mesh that a generated scaffold fills (the envelope). Its kernel and visited elements, which round beams
//! do not have, are recorded for the report.

use crate::field::WorldField;
use crate::frame::Aabb;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::shape::{Borrowed, Shape, intersection};
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::sheets::SheetOptions;
use crate::pipeline::content::tiling::{CellTiling, Content, ElementContent};
use crate::recipe::{Boundary, Distance, Scale};
use crate::tiling;
use crate::tiling::{TiledSolid, TilingOptions};

/// Share of a tiling's tolerance that interpolation between nodes may use beside the error of tables.
const NODE_TOLERANCE_SHARE: f64 = 0.5;

impl Inputs<'_> {
    /// The tiling options for voxels of one size, lengths in world units. Distances must hold as far beyond the
    /// band as the offsets reach. Without a scaffold the boundary has its default.
    pub fn tiling_options(&self, scale: Scale, offsets: Offsets) -> TilingOptions {
        let sections = self.recipe.sections();
        let boundary = sections.scaffold.as_ref().map(|s| s.boundary);
        TilingOptions {
            voxel_size: scale.voxel_size,
            half_width: scale.voxel_size * sections.band.half_width.0 + offsets.reach(),
            distance: match sections.band.distance {
                Distance::Fast if !offsets.exact => tiling::Distance::Fast,
                _ => tiling::Distance::Exact,
            },
            boundary: match boundary.unwrap_or_default() {
                Boundary::Cut => tiling::Boundary::Cut,
                Boundary::Extend => tiling::Boundary::Extend,
            },
        }
    }

    /// Displacement of the surface that tables and interpolation may cause, voxels.
    fn tolerance(&self) -> f64 {
        let section = self.recipe.sections().tiling.as_ref();
        section.map_or(0.0, |t| t.tolerance.0)
    }

    /// The tiled scaffold as a field in world units, if the recipe has one; `None` without a tiling. The first
    /// call sets the kernel of the report, except for round beams.
    pub fn tiling_shape(
        &self,
        scale: Scale,
        offsets: Offsets,
    ) -> Result<Option<Shape<'_>>, RunError> {
        let Some(tiling) = &self.tiling else {
            return Ok(None);
        };
        let options = self.tiling_options(scale, offsets);
        let failed = |e: tiling::TilingError| RunError::Tiling(e.to_string());
        let scaffold = &tiling.loaded.scaffold;
        let node_tolerance = NODE_TOLERANCE_SHARE * self.tolerance() * options.voxel_size;
        let field: Box<WorldField<'_>> = match tiling.content() {
            // Distances to beams are closed forms, which need no tables; they cut themselves by boundary and
            // envelope.
            Content::Beams(beams) => return Ok(Some(beams.shape(tiling, options, offsets))),
            Content::Sheets(sheets) => {
                let sheet_options = SheetOptions {
                    tiling: options,
                    offsets,
                    node_tolerance,
                    visits: Some(&self.visits),
                };
                let (field, kernel) = sheets.field(tiling, || tiling.tabulated(), sheet_options)?;
                self.kernel.get_or_init(|| kernel);
                field
            }
            Content::Fitted => match tiling.tabulated()? {
                ElementContent::Cell(table) => {
                    let solid = TiledSolid::new(scaffold, table, options).map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(
                        solid
                            .with_visits(&self.visits)
                            .with_interpolation(node_tolerance),
                    )
                }
                ElementContent::Blend(blend) => {
                    let solid = TiledSolid::with_owned_filling(scaffold, *blend, options)
                        .map_err(failed)?;
                    self.kernel.get_or_init(|| solid.kernel());
                    Box::new(
                        solid
                            .with_visits(&self.visits)
                            .with_interpolation(node_tolerance),
                    )
                }
            },
        };
        let extent = tiled_extent(tiling, options.boundary);
        let mut shape = Shape {
            field,
            extent,
            name: "the scaffold".into(),
        };
        if let Some(envelope) = &tiling.loaded.envelope {
            // The mesh that the scaffold fills bounds the solid.
            let borrowed = Box::new(Borrowed(envelope.as_ref()));
            shape.field = intersection(shape.field, borrowed, options.half_width, offsets);
        }
        Ok(Some(shape))
    }

    /// The bounding box of the tiled scaffold, if the recipe has one.
    pub fn tiled_extent(&self, scale: Scale, offsets: Offsets) -> Option<Aabb> {
        let boundary = self.tiling_options(scale, offsets).boundary;
        self.tiling.as_ref().map(|t| tiled_extent(t, boundary))
    }
}

/// The box in which a tiled scaffold is sampled. Without a cut at its boundary the solid goes on beyond the scaffold,
/// here by half its diagonal; an envelope bounds it.
fn tiled_extent(tiling: &CellTiling, boundary: tiling::Boundary) -> Aabb {
    let bounds = tiling.loaded.scaffold.bounds();
    let extent = match boundary {
        tiling::Boundary::Cut => bounds,
        tiling::Boundary::Extend => bounds.dilated(bounds.half_diagonal()),
    };
    let envelope = tiling.loaded.envelope.as_ref();
    envelope.map_or(extent, |e| extent.intersection(e.bounds()))
}
