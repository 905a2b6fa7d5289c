//! Pictures of level sets: rays are traced in C++, shading is done here.
//!
//! A key light from the upper left with shadows, a fill light, sky and ground, ambient occlusion from the
//! depths of neighbouring samples; distant parts fade slightly. Pixels are sampled once, and three times
//! more at edges.

use super::camera::View;
use super::colormap::ValueColours;
use super::error::VdbError;
use super::picture::{Image, MAX_PIXELS, Picture, RAY_VALUES};
use super::samples::{Hit, SAMPLES_PER_EDGE, Samples, Vec3f};
use super::shading::{Lights, ambient_openness, shade_image};
use super::volume::Volume;
use super::{LevelSet, Session, ffi};
use crate::frame::{Aabb, Vec3, WorldPoint};
use rayon::prelude::*;

/// Traces samples of a view under a light; returns [`RAY_VALUES`] values per sample. An empty list of sample
/// numbers means all samples.
pub(super) type Trace<'t, E> = dyn FnMut(&View, Vec3, &[u32]) -> Result<Vec<f32>, E> + 't;

/// For which samples of a view rays are traced.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Tracing {
    /// For those that the picture needs, in several calls.
    AsNeeded,
    /// For all in one call, where each call reads the whole solid.
    AllSamples,
}

impl Picture {
    /// Checks the number of pixels and the cut; a value that is not allowed is [`VdbError::Parameter`].
    pub(super) fn check(&self) -> Result<(), VdbError> {
        let pixels = self.width.saturating_mul(self.height);
        if pixels == 0 || pixels > MAX_PIXELS {
            return Err(VdbError::Parameter {
                name: "size of the picture in pixels",
                value: pixels as f64,
                expected: "1 to 2^26",
            });
        }
        if let Some((axis, at)) = self.cut
            && (axis > 2 || !at.is_finite())
        {
            return Err(VdbError::Parameter {
                name: if axis > 2 {
                    "axis of the cut"
                } else {
                    "position of the cut"
                },
                value: if axis > 2 { axis as f64 } else { at },
                expected: "axis 0, 1 or 2 and a finite position",
            });
        }
        Ok(())
    }

    /// Makes the picture of the contents of a box. `trace` is called as `tracing` requests. `grid` colours the surface
    /// by its values; the second result is the range of its colours, 0 without a grid. An empty box gives an empty
    /// picture.
    pub(super) fn compose<E: From<VdbError> + Send>(
        &self,
        bounds: Aabb,
        grid: Option<&Volume>,
        session: Session<'_>,
        tracing: Tracing,
        trace: &mut Trace<'_, E>,
    ) -> Result<(Image, [f32; 2]), E> {
        let (width, height) = (self.width, self.height);
        if bounds.is_empty() {
            let samples = Samples::empty(width, height);
            return Ok((shade_image(self, &samples, &Lights::unlit()), [0.0; 2]));
        }
        let (columns, rows) = (width * SAMPLES_PER_EDGE, height * SAMPLES_PER_EDGE);
        let towards = self.towards_eye;
        // A coarse view, of an eighth of the pixels along each side but at least 32, finds the part that is filled.
        let coarse = [width.div_ceil(8).max(32), height.div_ceil(8).max(32)];
        let view = View::fit(bounds, towards, self.perspective, coarse[0], coarse[1]);
        // The key light comes from above, the left and behind the viewer.
        let key = (view.up * 0.8 - view.right * 0.7 - view.forward * 0.55).normalize();
        let (low, high) = covered(&trace(&view, key, &[])?, coarse[0]);
        let view = view.cropped(low, high, columns, rows);
        let at_once = tracing == Tracing::AllSamples;
        let all = if at_once {
            trace(&view, key, &[])?
        } else {
            Vec::new()
        };
        // Hits of samples by number: from the ones traced at once, or traced now; a thread takes 4096.
        let mut trace_samples = |numbers: &[u32]| {
            let values = if at_once {
                let selected = numbers
                    .iter()
                    .flat_map(|&n| &all[RAY_VALUES * n as usize..][..RAY_VALUES]);
                selected.copied().collect()
            } else {
                trace(&view, key, numbers)?
            };
            let samples = numbers.par_iter().zip(values.par_chunks_exact(RAY_VALUES));
            let hits = samples.with_min_len(1 << 12).map(|(&n, s)| {
                let (i, j) = (n as usize % columns, n as usize / columns);
                s[0].is_finite().then(|| Hit {
                    position: view.position(i, j, s[0].into()).cast(),
                    normal: Vec3f::new(s[1], s[2], s[3]),
                    on_cut: s[4] > 0.5,
                    lit: s[5] > 0.5,
                })
            });
            Ok::<Vec<_>, E>(session.threads.install(|| hits.collect()))
        };
        let mut samples = Samples::first(width, height, &mut trace_samples)?;
        samples.divide(&mut trace_samples)?;
        session.threads.install(|| {
            let hits = samples.hits();
            let values = grid.map(|g| values_at(hits, view.eye, g)).transpose()?;
            let colours = ValueColours::new(values.unwrap_or_default());
            // Occlusion within a twentieth of half the box's diagonal.
            let reach = 0.05 * bounds.half_diagonal();
            let radius = reach / (SAMPLES_PER_EDGE as f64 * view.pixel());
            let openness = ambient_openness(&samples, reach, radius, session.progress)
                .map_err(VdbError::from)?;
            let range = colours.range();
            let lights = Lights::new(&view, key, hits, openness).with_colours(colours);
            Ok((shade_image(self, &samples, &lights), range))
        })
    }
}

impl LevelSet {
    /// Makes a picture of the solid.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a size of 0 or beyond 2^26 pixels or a cut on an axis other than
    /// 0, 1, 2; [`VdbError::Cancelled`]; errors of OpenVDB.
    pub fn render(&self, picture: &Picture, session: Session<'_>) -> Result<Image, VdbError> {
        Ok(self.render_with(picture, None, session)?.0)
    }

    /// As [`LevelSet::render`], coloured by the values of a grid, dark violet to yellow. Also returns the
    /// values at the two ends of the colours; 2 % of the samples lie beyond them.
    ///
    /// # Errors
    /// As [`LevelSet::render`].
    pub fn render_by(
        &self,
        picture: &Picture,
        grid: &Volume,
        session: Session<'_>,
    ) -> Result<(Image, [f32; 2]), VdbError> {
        self.render_with(picture, Some(grid), session)
    }

    fn render_with(
        &self,
        picture: &Picture,
        grid: Option<&Volume>,
        session: Session<'_>,
    ) -> Result<(Image, [f32; 2]), VdbError> {
        picture.check()?;
        let bounds = self.bounds()?;
        picture.compose(
            bounds,
            grid,
            session,
            Tracing::AsNeeded,
            &mut |view, key, numbers| self.trace(view, key, picture.cut, numbers, session),
        )
    }

    /// [`RAY_VALUES`] values for each sample with a number, or for all samples of a view if `numbers` is empty. `light`
    /// is the direction to the light, `cut` an axis and a position in world units.
    pub(super) fn trace(
        &self,
        view: &View,
        light: Vec3,
        cut: Option<(usize, f64)>,
        numbers: &[u32],
        session: Session<'_>,
    ) -> Result<Vec<f32>, VdbError> {
        let camera = view.camera(light, cut);
        let count = match numbers.len() {
            0 => camera.columns * camera.rows,
            some => some,
        };
        let mut values = vec![0f32; RAY_VALUES * count];
        ffi::grid_trace(&self.grid, &camera, numbers, &mut values, &session.host())
            .map_err(|e| VdbError::of("rendering", session, &e))?;
        Ok(values)
    }

    /// A picture with the default view as the bytes of a PNG file.
    ///
    /// # Errors
    /// As [`LevelSet::render`].
    pub fn picture(
        &self,
        width: usize,
        height: usize,
        cut: Option<(usize, f64)>,
        session: Session<'_>,
    ) -> Result<Vec<u8>, VdbError> {
        let picture = Picture {
            width,
            height,
            cut,
            ..Picture::default()
        };
        self.render(&picture, session)?.png()
    }
}

/// Values of a grid at the hits, 16,384 at a time; samples without a hit get the value at the eye.
fn values_at(hits: &[Option<Hit>], eye: Vec3, grid: &Volume) -> Result<Vec<f32>, VdbError> {
    let rows = hits.par_chunks(1 << 14).map(|hits| {
        let points = hits.iter().map(|hit| {
            let p = hit.as_ref().map_or(eye, |h| eye + h.position.cast());
            WorldPoint(p)
        });
        grid.samples(&points.collect::<Vec<_>>())
    });
    Ok(rows.collect::<Result<Vec<_>, _>>()?.concat())
}

/// The box of samples with a hit; the whole view if there are none. First and last column and row, both included.
pub(super) fn covered(values: &[f32], columns: usize) -> ([usize; 2], [usize; 2]) {
    let rows = values.len() / (RAY_VALUES * columns);
    let mut found = ([columns, rows], [0, 0]);
    for (n, sample) in values.chunks_exact(RAY_VALUES).enumerate() {
        if sample[0].is_finite() {
            let at = [n % columns, n / columns];
            for a in 0..2 {
                found.0[a] = found.0[a].min(at[a]);
                found.1[a] = found.1[a].max(at[a]);
            }
        }
    }
    if found.0[0] > found.1[0] {
        return ([0, 0], [columns - 1, rows - 1]);
    }
    found
}
