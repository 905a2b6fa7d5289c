//! A picture of a solid that never is in memory as a whole: part by part, the nearest sample wins.
//!
//! Where a part is cut off rays may meet a surface that is none; but there they are inside the solid,
//! and have met it before, in this part or another. So the nearest sample of all parts is that of the
//! whole, and a sample is in the light if no part stands in its way.

use super::camera::View;
use super::ffi;
use super::render::{Image, NUMBERS, Picture};
use super::{LevelSet, Session, VdbError};
use crate::frame::{Aabb, Vec3};

/// Takes a part and the box of what it is there for.
pub type VisitPart<'v> = dyn FnMut(&LevelSet, Aabb) -> Result<(), VdbError> + 'v;

/// Takes a picture of a solid in parts. `parts` shows all of them to its argument, each with a layer
/// of at least 2 voxels around its box, and is called three times; `bounds` is the box around all.
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
            numbers: vec![f32::INFINITY; NUMBERS * view.size()[0] * view.size()[1]],
            session,
        };
        parts(&mut |part, bounds| scene.meet(part, bounds))?;
        // Coarse views are only looked at for what they hold.
        if view.size()[0] >= picture.width {
            parts(&mut |part, _| scene.shade(part))?;
        }
        Ok(scene.numbers)
    };
    // Parts are passed as seldom as can be: all samples at once.
    Ok(picture.compose(bounds, None, session, true, &mut trace)?.0)
}

/// A view while parts pass.
struct Scene<'a> {
    view: &'a View,
    light: Vec3,
    cut: Option<(usize, f64)>,
    numbers: Vec<f32>,
    session: Session<'a>,
}

impl Scene<'_> {
    fn meet(&mut self, part: &LevelSet, bounds: Aabb) -> Result<(), VdbError> {
        let Some((low, high)) = self.view.window(bounds) else {
            return Ok(());
        };
        let own = self.view.part(low, high);
        let found = part.trace(&own, (self.light, self.cut), &[], self.session)?;
        let row = NUMBERS * own.size()[0];
        for (j, samples) in found.chunks_exact(row).enumerate() {
            let start = NUMBERS * ((low[1] + j) * self.view.size()[0] + low[0]);
            let whole = self.numbers[start..start + row].chunks_exact_mut(NUMBERS);
            for (nearest, sample) in whole.zip(samples.chunks_exact(NUMBERS)) {
                if sample[0] < nearest[0] {
                    nearest.copy_from_slice(sample);
                }
            }
        }
        Ok(())
    }

    fn shade(&mut self, part: &LevelSet) -> Result<(), VdbError> {
        let camera = self.view.camera(self.light, self.cut);
        ffi::grid_shade(&part.grid, &camera, &mut self.numbers, &self.session.host())
            .map_err(|e| VdbError::of("rendering", self.session, &e))
    }
}
