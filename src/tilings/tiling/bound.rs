//! Bounds of a tiling's values over boxes: bounds of the cell over the box's image in each element.
//!
//! Three tests decide, the cheapest first: the value at a region's centre with the bound of the slope, the same in its
//! eighths, and the range of the cell over the region's image in each element. A bound may be wider than the values,
//! but never narrower: whatever lies beyond the band w counts as w; of several regions a decisive one stands for all,
//! since the leaf is then sampled anyway. Rules Q and R: `distance_scale` and `exact`. Lengths are in world units,
//! values of F in units of the field.

use super::fill::with_batch_buffers;
use super::locality::{NEIGHBOUR_DISTANCE, NearElements};
use super::{Distance, TiledSolid};
use druse_geometry::field::{Interval, LeafParts};
use druse_geometry::frame::Aabb;
use std::cell::Cell;

/// Relative allowance for rounding to single precision.
const RELATIVE_SLACK: f64 = 1e-6;

/// With more near elements than this, evaluating the centres of regions takes longer than bounding the cell.
const MAX_CENTRE_TEST_ELEMENTS: usize = 256;

/// Greatest number of times that a region is divided into eighths where its centre does not decide.
const MAX_HALVINGS: u32 = 2;

/// Buffers that a thread reuses.
#[derive(Default)]
struct BoundBuffers {
    /// Boundary triangles near all regions.
    boundary_triangles: Vec<u32>,
    /// Elements near all regions, and near one of them.
    near: NearElements,
    region_near: NearElements,
}

thread_local! {
    static BUFFERS: Cell<Option<Box<BoundBuffers>>> = Cell::default();
}

/// Neighbouring regions whose bounds are evaluated together.
pub(super) struct RegionGroup<'a, const N: usize> {
    /// The regions.
    inner: &'a [Aabb; N],
    /// The regions with a layer around them, in which signs must be those of the region.
    padded: &'a [Aabb; N],
    /// Thickness of that layer.
    padding: f64,
    /// Once a region holds values nearer to 0 than this, its bound is used for all.
    decisive: Option<f64>,
}

impl<'a> RegionGroup<'a, 8> {
    /// The parts of a leaf.
    pub fn leaf(parts: &'a LeafParts<Aabb>, decisive: f64) -> Self {
        Self {
            inner: &parts.own,
            padded: &parts.wide,
            padding: NEIGHBOUR_DISTANCE * parts.step,
            decisive: Some(decisive),
        }
    }
}

impl<'a, const N: usize> From<&'a [Aabb; N]> for RegionGroup<'a, N> {
    fn from(regions: &'a [Aabb; N]) -> Self {
        Self {
            inner: regions,
            padded: regions,
            padding: 0.0,
            decisive: None,
        }
    }
}

impl TiledSolid<'_> {
    /// Bound over all components.
    pub(super) fn bound_of_all(&self, region: &Aabb) -> Interval {
        let [bound] = self.bounds_of_all(&RegionGroup::from(&[*region]));
        bound
    }

    /// Bounds over neighbouring regions, over all components. With several regions, values nearer to 0 than the
    /// half width are not resolved.
    pub(super) fn bounds_of_all<const N: usize>(&self, regions: &RegionGroup<N>) -> [Interval; N] {
        let w = self.options.half_width;
        let mut all = [Interval::new(w, w); N];
        let mut buffers = BUFFERS.take().unwrap_or_default();
        for component in 0..self.components.len() {
            let component_bounds = self.bounds_of(component, regions, &mut buffers);
            for (a, b) in all.iter_mut().zip(component_bounds) {
                *a = if self.is_cut() || self.components.len() == 1 {
                    Interval::new(a.lo.min(b.lo), a.hi.min(b.hi))
                } else {
                    // Any of them may determine the value.
                    a.hull(b)
                };
            }
        }
        BUFFERS.set(Some(buffers));
        all
    }

    /// Bounds of one component's distance, cut at its boundary. One bound per region. With `decisive` the search ends
    /// at the first region that holds nearer values, and all regions get its bound.
    fn bounds_of<const N: usize>(
        &self,
        component: usize,
        &RegionGroup {
            inner: regions,
            padded,
            padding,
            decisive,
        }: &RegionGroup<N>,
        buffers: &mut BoundBuffers,
    ) -> [Interval; N] {
        let BoundBuffers {
            boundary_triangles,
            near,
            region_near,
        } = buffers;
        let w = self.options.half_width;
        // Where components meet, points near the surface of one may lie inside another.
        let decisive = decisive.filter(|_| self.components.len() == 1);
        let boundary = &self.components[component].boundary;
        let around = padded.iter().fold(Aabb::EMPTY, |a, b| a.union(*b));
        // Outside, beyond the band: nothing below can lower it.
        let mut found = [Interval::new(w, w); N];
        if self.is_cut() && !boundary.bounds().dilated(w).meets(around) {
            return found;
        }
        let mut reach = 0.0;
        if self.is_cut() {
            self.find_boundary_triangles(component, &around, boundary_triangles);
            if !boundary_triangles.is_empty() {
                reach = self.boundary_reach();
            }
        }
        let boundary_triangles = self.is_cut().then_some(&**boundary_triangles);
        self.find_near(component, &around.dilated(reach), self.margin(), near);
        let near = &*near;
        let mut known_side = None;
        let depth = self.boundary_range(
            component,
            &around,
            Interval::REAL_LINE,
            boundary_triangles,
            &near.patches,
            &mut known_side,
        );
        // Far from the boundary, and where the scaffold does not overlap itself, F is continuous and L bounds its
        // slope. A value that exceeds the band by more than L times the layer has the sign of the layer.
        let may_test_centres = self.options.distance == Distance::Fast
            && near.patches.len() <= MAX_CENTRE_TEST_ELEMENTS;
        let is_leaf = padding > 0.0 && padding < w;
        let is_deep = may_test_centres && is_leaf && depth.hi <= -w;
        // Most regions are decided from their centres. For a leaf deep in the scaffold the regions are bounded
        // without the layer, if the scaffold covers them once.
        let centres = if is_deep { regions } else { padded };
        let mut values = [None; N];
        if may_test_centres {
            values = self.at_centres(near, centres);
        }
        let is_single_cover = || {
            let middle = around.centre().0;
            values.iter().any(Option::is_some) || boundary.winding_number(middle).round() == 1.0
        };
        let use_inner = is_deep && is_single_cover();
        let evaluated = if use_inner { regions } else { padded };
        // The region nearest to the surface most likely decides for all.
        let mut order: [usize; N] = std::array::from_fn(|n| n);
        if decisive.is_some() {
            let away = values.map(|f| f.map_or(f64::INFINITY, f64::abs));
            order.sort_unstable_by(|&a, &b| away[a].total_cmp(&away[b]));
        }
        for n in order {
            let region = &evaluated[n];
            let depth = if N == 1 || depth.hi <= -w || depth.lo >= w {
                depth
            } else {
                self.boundary_range(
                    component,
                    region,
                    depth,
                    boundary_triangles,
                    &near.patches,
                    &mut known_side,
                )
            };
            if self.is_cut() && depth.lo >= w {
                continue;
            }
            let reach = self.continuation_reach(depth.hi);
            let halvings = if decisive.is_some() { MAX_HALVINGS } else { 0 };
            let field = values[n]
                .filter(|_| reach == 0.0)
                .and_then(|f| {
                    let radius = region.farthest(centres[n].centre());
                    self.range_from_centre(f, near, radius, N > 1)
                        .or_else(|| self.range_of_parts(near, region, halvings))
                })
                .unwrap_or_else(|| {
                    let all = region.dilated(reach);
                    // Slopes must be bounded in the layer too.
                    let among = if use_inner { all.dilated(padding) } else { all };
                    if self.is_cut() {
                        self.filter_near(near, &among, region_near);
                    } else {
                        self.find_near(component, &among, self.margin(), region_near);
                    }
                    self.range_among(component, region_near, &all, N > 1)
                });
            found[n] = self.cut_bound(field, depth);
            if decisive.is_some_and(|near| found[n].may_be_within(near)) {
                return [found[n]; N];
            }
        }
        found
    }

    /// Range of the distance in a region within the scaffold from the field's value `f` at its centre; `None` if
    /// `f` decides nothing. `is_coarse`: values nearer to 0 than the half width are not resolved.
    fn range_from_centre(
        &self,
        f: f64,
        near: &NearElements,
        radius: f64,
        is_coarse: bool,
    ) -> Option<Interval> {
        let w = self.options.half_width;
        if f.abs() >= self.max_change(near, w + radius) * (1.0 + RELATIVE_SLACK) {
            let d = w.copysign(f);
            return Some(Interval::new(d, d));
        }
        // The range then includes values near 0: every list of elements near the region has the owner of its
        // centre, whose slope bound is at least the smallest.
        (is_coarse && f.abs() < near.slope_sup_min * w).then(|| Interval::new(-w, w))
    }

    /// As [`Self::range_from_centre`], from the centres of the eighths of the region, divided up to `halvings`
    /// times; `None` if these do not decide.
    fn range_of_parts(
        &self,
        near: &NearElements,
        region: &Aabb,
        halvings: u32,
    ) -> Option<Interval> {
        let w = self.options.half_width;
        let finer = halvings.checked_sub(1)?;
        let parts = eighths(region);
        let values = self.at_centres(near, &parts);
        let mut all: Option<Interval> = None;
        for (part, f) in parts.iter().zip(values) {
            let own = self
                .range_from_centre(f?, near, part.half_diagonal(), true)
                .or_else(|| self.range_of_parts(near, part, finer))?;
            let hull = all.map_or(own, |a| a.hull(own));
            if hull.may_be_within(w) {
                return Some(hull);
            }
            all = Some(hull);
        }
        all
    }

    /// Bound of the distance from the bounds of the cells in near elements.
    fn range_among(
        &self,
        component: usize,
        near: &NearElements,
        region: &Aabb,
        is_coarse: bool,
    ) -> Interval {
        let w = self.options.half_width;
        let least = if is_coarse { w * near.slope_sup } else { 0.0 };
        match self.field_range(near, region, least) {
            Some(f) if f.lo >= least || f.hi <= -least || !is_coarse => {
                self.distance_range(component, near, region, f)
            }
            // The loop over the elements may have ended early.
            _ => Interval::new(-w, w),
        }
    }

    /// Bound of max(d, D) from the bound of d and the bound of D.
    fn cut_bound(&self, field: Interval, depth: Interval) -> Interval {
        let w = self.options.half_width;
        if !self.is_cut() {
            return field;
        }
        Interval::new(
            field.lo.max(depth.lo).clamp(-w, w),
            field.hi.max(depth.hi).clamp(-w, w),
        )
    }

    /// The field at the centres of regions that lie in a single element; `None` where the centre decides nothing.
    fn at_centres<const N: usize>(
        &self,
        near: &NearElements,
        regions: &[Aabb; N],
    ) -> [Option<f64>; N] {
        with_batch_buffers(|buffers| self.field_at(near, regions.map(|r| r.centre().0), buffers))
    }

    /// Distance from a box of the points at which the field is evaluated, if the box extends up to `outside`
    /// beyond the boundary; 0 if it lies in the scaffold.
    pub(super) fn continuation_reach(&self, outside: f64) -> f64 {
        let slack = self.chord_slack();
        if outside < -slack {
            0.0
        } else if self.is_cut() {
            // Further out, the value is the boundary's distance.
            outside.clamp(0.0, self.options.half_width) + slack
        } else {
            outside.max(0.0) + slack
        }
    }

    /// Bounds F over the points of a box in near elements; `None` if there are none. The loop ends once the range
    /// includes values nearer to 0 than `least`. `least` is a value of F.
    pub(super) fn field_range(
        &self,
        near: &NearElements,
        region: &Aabb,
        least: f64,
    ) -> Option<Interval> {
        let mut range: Option<Interval> = None;
        for &e in &near.patches {
            if let Some(image) = self.scaffold.element(e as usize).cell_box(region) {
                let b = self.filling.bound(e as usize, &image);
                let all = range.map_or(b, |r| r.hull(b));
                range = Some(all);
                if all.lo < least && all.hi > -least {
                    break;
                }
            }
        }
        range
    }

    /// Bound of d(F) from a bound of F: the scale is at least 1 / L. `f` bounds F over a region of a component. L is
    /// the slope bound of the near elements, `near.slope_sup`.
    pub(super) fn distance_range(
        &self,
        component: usize,
        near: &NearElements,
        region: &Aabb,
        f: Interval,
    ) -> Interval {
        let w = self.options.half_width;
        let away = f.lo.max(-f.hi);
        if away <= 0.0 {
            return Interval::new(-w, w);
        }
        // |d| = |F| s >= |F| / L.
        let mut least = away / near.slope_sup;
        // Rule R may find zero points that are nearer than the steps of rule Q.
        if self.options.distance == Distance::Exact && !self.is_free_of_zeros(component, region) {
            least = 0.0;
        }
        // Values from w on are w exactly; within the band, rounding counts.
        let least = if least >= w * (1.0 + RELATIVE_SLACK) {
            w
        } else {
            least * (1.0 - RELATIVE_SLACK)
        };
        if f.lo > 0.0 {
            Interval::new(least, w)
        } else {
            Interval::new(-w, -least)
        }
    }

    /// Whether the field certainly has no zero within w of the box.
    fn is_free_of_zeros(&self, component: usize, region: &Aabb) -> bool {
        let padded = region.dilated(self.options.half_width);
        let near = self.near(component, &padded, 0.0);
        self.field_range(&near, &padded, 0.0)
            .is_none_or(|f| f.lo > 0.0 || f.hi < 0.0)
    }
}

/// The eight boxes that result from halving a box along each axis.
fn eighths(region: &Aabb) -> [Aabb; 8] {
    let middle = region.centre().0;
    std::array::from_fn(|n| {
        let mut part = *region;
        for a in 0..3 {
            if n >> a & 1 == 0 {
                part.max[a] = middle[a];
            } else {
                part.min[a] = middle[a];
            }
        }
        part
    })
}
