//! A picture of a solid that is rendered part by part: the nearest sample of all parts is kept.
//!
//! A ray may hit the cut face of a part, which is not a surface of the solid. There it is inside the solid and
//! has hit the surface before, in this part or another. Hence the nearest hit over all parts is that of the
//! whole solid, and a sample is lit if no part blocks its light. Near parts come first (outer
//! ones in the coarse view), and parts that no sample needs are not made.

use super::camera::{View, corners};
use super::error::VdbError;
use super::picture::{Image, Picture, RAY_VALUES};
use super::render::{Tracing, covered};
use super::{LevelSet, Session, ffi};
use crate::frame::{Aabb, Vec3};

/// Samples along the edge of a tile of a view.
const TILE: usize = 32;

/// The parts of a solid.
pub struct SolidParts<'a, E> {
    /// The boxes that they cover.
    pub boxes: &'a [Aabb],
    /// Makes the part of a box, with a layer of at least 2 voxels around it.
    pub make: &'a mut dyn FnMut(usize) -> Result<LevelSet, E>,
    /// Called after each visit of a part, three times as often as there are parts, or four in narrow pictures.
    pub visited: &'a dyn Fn(),
}

/// Makes a picture of a solid in parts. `bounds` is the box around all parts.
///
/// # Errors
/// As [`LevelSet::render`], and those of the making of parts.
pub fn render_parts<E: From<VdbError> + Send>(
    picture: &Picture,
    bounds: Aabb,
    session: Session<'_>,
    parts: SolidParts<'_, E>,
) -> Result<Image, E> {
    picture.check()?;
    let SolidParts {
        boxes,
        make,
        visited,
    } = parts;
    let mut trace = |view: &View, light: Vec3, _: &[u32]| -> Result<Vec<f32>, E> {
        let mut scene = Scene {
            view,
            light,
            cut: picture.cut,
            values: vec![f32::INFINITY; RAY_VALUES * view.size()[0] * view.size()[1]],
            session,
        };
        // Of the coarse view only the box around its hits is used, without shadows. Outer parts come first: that box
        // soon covers the others, which are then not made.
        if view.size()[0] < picture.width {
            for n in outermost_first(view, boxes) {
                if !scene.covers(boxes[n]) {
                    // Beyond all depths: samples without a hit so far.
                    let samples = scene.samples_beyond(boxes[n], f64::MAX);
                    if !samples.is_empty() {
                        scene.trace(&make(n)?, &samples)?;
                    }
                }
                visited();
            }
            return Ok(scene.values);
        }
        let mut near: Vec<(f64, usize)> = boxes
            .iter()
            .map(|b| view.nearest_depth(*b))
            .zip(0..)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (depth, n) in near {
            let samples = scene.samples_beyond(boxes[n], depth);
            if !samples.is_empty() {
                scene.trace(&make(n)?, &samples)?;
            }
            visited();
        }
        let shadows = Shadows::new(&scene);
        for (n, own) in boxes.iter().enumerate() {
            let samples = shadows.samples(&scene, *own);
            if !samples.is_empty() {
                scene.shade(&make(n)?, &samples)?;
            }
            visited();
        }
        Ok(scene.values)
    };
    // All samples at once, so that the parts are visited as rarely as possible.
    Ok(picture
        .compose(bounds, None, session, Tracing::AllSamples, &mut trace)?
        .0)
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
    /// The samples that may see a box and have no hit before `depth`.
    fn samples_beyond(&self, bounds: Aabb, depth: f64) -> Vec<u32> {
        let Some((low, high)) = self.view.window(bounds) else {
            return Vec::new();
        };
        let columns = self.view.size()[0];
        let rows = low[1]..=high[1];
        let all = rows.flat_map(|j| (low[0]..=high[0]).map(move |i| j * columns + i));
        let is_open = |n: &usize| f64::from(self.values[RAY_VALUES * n]) > depth;
        all.filter(is_open).map(|n| n as u32).collect()
    }

    /// Whether all samples that may see a box lie in the box around those with a hit.
    fn covers(&self, bounds: Aabb) -> bool {
        let Some((low, high)) = self.view.window(bounds) else {
            return true;
        };
        let (first, last) = covered(&self.values, self.view.size()[0]);
        let is_hit = self
            .values
            .chunks_exact(RAY_VALUES)
            .any(|s| s[0].is_finite());
        is_hit && (0..2).all(|a| first[a] <= low[a] && high[a] <= last[a])
    }

    /// Traces samples in a part and keeps its nearer hits.
    fn trace(&mut self, part: &LevelSet, samples: &[u32]) -> Result<(), VdbError> {
        let found = part.trace(self.view, self.light, self.cut, samples, self.session)?;
        for (&n, sample) in samples.iter().zip(found.chunks_exact(RAY_VALUES)) {
            let nearest = &mut self.values[RAY_VALUES * n as usize..][..RAY_VALUES];
            if sample[0] < nearest[0] {
                nearest.copy_from_slice(sample);
            }
        }
        Ok(())
    }

    /// Removes the light from those of some samples that are in the shadow of a part.
    fn shade(&mut self, part: &LevelSet, samples: &[u32]) -> Result<(), VdbError> {
        let camera = self.view.camera(self.light, self.cut);
        let sample = |n: &u32| &self.values[RAY_VALUES * *n as usize..][..RAY_VALUES];
        let mut hits: Vec<f32> = samples.iter().flat_map(sample).copied().collect();
        ffi::grid_shade(
            &part.grid,
            &camera,
            samples,
            &mut hits,
            &self.session.host(),
        )
        .map_err(|e| VdbError::of("rendering", self.session, &e))?;
        for (&n, hit) in samples.iter().zip(hits.chunks_exact(RAY_VALUES)) {
            self.values[RAY_VALUES * n as usize..][..RAY_VALUES].copy_from_slice(hit);
        }
        Ok(())
    }

    /// The hit of a sample that light reaches so far, relative to the eye. `None` without a hit, or in the shadow of a
    /// part that was visited.
    fn lit_hit(&self, [i, j]: [usize; 2]) -> Option<Vec3> {
        let n = j * self.view.size()[0] + i;
        let sample = &self.values[RAY_VALUES * n..][..RAY_VALUES];
        let is_lit = sample[0].is_finite() && sample[5] != 0.0; // depth and light
        is_lit.then(|| self.view.position(i, j, sample[0].into()))
    }
}

/// Numbers of boxes, from those at the edges of a view to those in its middle.
fn outermost_first(view: &View, boxes: &[Aabb]) -> Vec<usize> {
    let middle = view.size().map(|n| n / 2);
    let distance = |bounds: Aabb| {
        let (low, high) = view.window(bounds)?;
        (0..2)
            .map(|a| middle[a].abs_diff(low[a]).max(middle[a].abs_diff(high[a])))
            .max()
    };
    let distances = boxes.iter().map(|b| std::cmp::Reverse(distance(*b)));
    let mut order: Vec<_> = distances.zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, n)| n).collect()
}

/// Positions across and along the light: two axes across it, and the light's direction.
struct Shadows {
    axes: [Vec3; 3],
    /// Tiles of samples with lit hits: the first sample, and the box of the hits along the axes.
    tiles: Vec<([usize; 2], Aabb)>,
}

impl Shadows {
    fn new(scene: &Scene) -> Self {
        let light = scene.light;
        let across = light.cross(&Vec3::ith(light.iamin(), 1.0)).normalize();
        let axes = [across, light.cross(&across), light];
        let [columns, rows] = scene.view.size();
        let starts = |count: usize| (0..count).step_by(TILE);
        let all = starts(rows).flat_map(|j| starts(columns).map(move |i| [i, j]));
        let boxed = |first: [usize; 2]| {
            let hits = samples_of(first, [columns, rows]).filter_map(|at| scene.lit_hit(at));
            let bounds = Aabb::of(hits.map(|p| along(&axes, p)));
            (!bounds.is_empty()).then_some((first, bounds))
        };
        Self {
            axes,
            tiles: all.filter_map(boxed).collect(),
        }
    }

    /// The samples whose way to the light may meet a box.
    fn samples(&self, scene: &Scene, bounds: Aabb) -> Vec<u32> {
        let size = scene.view.size();
        let corners = corners(bounds).map(|c| along(&self.axes, c - scene.view.eye));
        let target = Aabb::of(corners);
        let may_meet = |low: Vec3, high: Vec3| {
            (0..2).all(|a| low[a] <= target.max[a] && high[a] >= target.min[a])
                && low[2] <= target.max[2]
        };
        let tiles = self.tiles.iter().filter(|(_, b)| may_meet(b.min, b.max));
        let near = tiles.flat_map(|(first, _)| samples_of(*first, size));
        let meets = |at: &[usize; 2]| {
            let hit = scene.lit_hit(*at).map(|p| along(&self.axes, p));
            hit.is_some_and(|p| may_meet(p, p))
        };
        near.filter(meets)
            .map(|[i, j]| (j * size[0] + i) as u32)
            .collect()
    }
}

/// Components of a vector along three axes.
fn along(axes: &[Vec3; 3], v: Vec3) -> Vec3 {
    Vec3::from_fn(|a, _| axes[a].dot(&v))
}

/// The samples of the tile that begins at a sample of a view.
fn samples_of([i, j]: [usize; 2], size: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let columns = i..(i + TILE).min(size[0]);
    let rows = j..(j + TILE).min(size[1]);
    rows.flat_map(move |j| columns.clone().map(move |i| [i, j]))
}
