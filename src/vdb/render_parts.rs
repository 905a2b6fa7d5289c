//! A picture of a solid that is rendered part by part: the nearest sample of all parts is kept.
//!
//! A ray may hit the cut face of a part, which is not a surface of the solid. There it is inside the solid and
//! has hit the surface before, in this part or another. Hence the nearest hit over all parts is that of the
//! whole solid, and a sample is lit if no part blocks its light.

use super::camera::View;
use super::ffi;
use super::render::{Image, Picture, RAY_VALUES};
use super::{LevelSet, Session, VdbError};
use crate::frame::{Aabb, Vec3};

/// Receives a part and the box that it covers.
pub type VisitPart<'v> = dyn FnMut(&LevelSet, Aabb) -> Result<(), VdbError> + 'v;

/// Makes a picture of a solid in parts. `parts` passes all parts to its argument, each with a layer of at least
/// 2 voxels around its box; it is called three times. `bounds` is the box around all parts.
///
/// # Errors
/// As [`LevelSet::render`], and those of `parts`.
pub fn render_parts<E: From<VdbError> + Send>(
    picture: &Picture,
    bounds: Aabb,
    session: Session<'_>,
    mut parts: impl FnMut(&mut VisitPart<'_>) -> Result<(), E>,
) -> Result<Image, E> {
    picture.check()?;
    let mut trace = |view: &View, light: Vec3, _: &[u32]| -> Result<Vec<f32>, E> {
        let mut scene = Scene {
            view,
            light,
            cut: picture.cut,
            values: vec![f32::INFINITY; RAY_VALUES * view.size()[0] * view.size()[1]],
            session,
        };
        parts(&mut |part, bounds| scene.trace(part, bounds))?;
        // The coarse view needs no shadows.
        if view.size()[0] >= picture.width {
            parts(&mut |part, _| scene.shade(part))?;
        }
        Ok(scene.values)
    };
    // All samples at once, so that the parts are visited as rarely as possible.
    Ok(picture.compose(bounds, None, session, true, &mut trace)?.0)
}

/// A view and the nearest hits over the parts so far.
struct Scene<'a> {
    view: &'a View,
    light: Vec3,
    cut: Option<(usize, f64)>,
    values: Vec<f32>,
    session: Session<'a>,
}

impl Scene<'_> {
    /// Traces a part and keeps its nearer hits.
    fn trace(&mut self, part: &LevelSet, bounds: Aabb) -> Result<(), VdbError> {
        let Some((low, high)) = self.view.window(bounds) else {
            return Ok(());
        };
        let window = self.view.part(low, high);
        let found = part.trace(&window, (self.light, self.cut), &[], self.session)?;
        let row = RAY_VALUES * window.size()[0];
        for (j, samples) in found.chunks_exact(row).enumerate() {
            let start = RAY_VALUES * ((low[1] + j) * self.view.size()[0] + low[0]);
            let whole = self.values[start..start + row].chunks_exact_mut(RAY_VALUES);
            for (nearest, sample) in whole.zip(samples.chunks_exact(RAY_VALUES)) {
                if sample[0] < nearest[0] {
                    nearest.copy_from_slice(sample);
                }
            }
        }
        Ok(())
    }

    /// Removes the light from the samples in the shadow of a part.
    fn shade(&mut self, part: &LevelSet) -> Result<(), VdbError> {
        let camera = self.view.camera(self.light, self.cut);
        ffi::grid_shade(&part.grid, &camera, &mut self.values, &self.session.host())
            .map_err(|e| VdbError::of("rendering", self.session, &e))
    }
}
