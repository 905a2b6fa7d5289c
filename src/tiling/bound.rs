//! What the tiling's values can be in a box: bounds of the cell over the box's image in each element.

use super::fill::with_straight;
use super::locality::{Local, NEIGHBOUR, Near};
use super::{Distance, Filling, TiledSolid};
use crate::field::{Interval, LeafParts};
use crate::frame::{Aabb, CellPoint};
use std::cell::Cell;

/// Room for the rounding of single precision, relative.
const SLACK: f64 = 1e-6;

/// With more near elements than this, to look at the field where regions have their centres takes longer
/// than to bound it.
const WORTH: usize = 256;

/// How often regions that are asked for together are halved where their centres do not decide.
const HALVINGS: u32 = 2;

/// What a thread keeps from some regions to the next.
#[derive(Default)]
struct Room {
    /// Triangles of the boundary near all of them.
    shore: Vec<u32>,
    /// Elements near all of them, and near one.
    near: Near,
    nearer: Near,
    local: Local,
}

thread_local! {
    static ROOM: Cell<Option<Box<Room>>> = Cell::default();
}

/// Regions that lie together, whose bounds are asked for at once.
pub(super) struct Together<'a, const N: usize> {
    /// Where values are wanted.
    own: &'a [Aabb; N],
    /// The same with points around them that must have their sign.
    wide: &'a [Aabb; N],
    /// How far around.
    layer: f64,
    /// Once one holds values nearer to 0 than this the others are not told apart.
    enough: Option<f64>,
}

impl<'a> Together<'a, 8> {
    /// Parts of a leaf.
    pub fn leaf(parts: &'a LeafParts<Aabb>, enough: f64) -> Self {
        Self {
            own: &parts.own,
            wide: &parts.wide,
            layer: NEIGHBOUR * parts.step,
            enough: Some(enough),
        }
    }
}

impl<'a, const N: usize> From<&'a [Aabb; N]> for Together<'a, N> {
    fn from(regions: &'a [Aabb; N]) -> Self {
        Self {
            own: regions,
            wide: regions,
            layer: 0.0,
            enough: None,
        }
    }
}

impl<F: Filling> TiledSolid<'_, F> {
    /// Bound over all components.
    pub(super) fn bound_of_all(&self, region: &Aabb) -> Interval {
        let [bound] = self.bounds_of_all(&Together::from(&[*region]));
        bound
    }

    /// The same for regions that lie together. Of several, values nearer to 0 than the band's half width are
    /// not told apart.
    pub(super) fn bounds_of_all<const N: usize>(&self, regions: &Together<N>) -> [Interval; N] {
        let w = self.options.half_width;
        let mut all = [Interval::new(w, w); N];
        let mut room = ROOM.take().unwrap_or_default();
        for component in 0..self.components.len() {
            let own = self.bounds_of(component, regions, &mut room);
            for (a, b) in all.iter_mut().zip(own) {
                *a = if self.is_cut() || self.components.len() == 1 {
                    Interval::new(a.lo.min(b.lo), a.hi.min(b.hi))
                } else {
                    // Any of them may govern.
                    a.hull(b)
                };
            }
        }
        ROOM.set(Some(room));
        all
    }

    /// Bounds of one component's distance, its boundary included.
    fn bounds_of<const N: usize>(
        &self,
        component: usize,
        &Together {
            own: regions,
            wide,
            layer,
            enough,
        }: &Together<N>,
        room: &mut Room,
    ) -> [Interval; N] {
        let Room {
            shore,
            near,
            nearer,
            local,
        } = room;
        let w = self.options.half_width;
        // Where components meet, what is near the surface of one may lie inside another.
        let enough = enough.filter(|_| self.components.len() == 1);
        let boundary = &self.components[component].boundary;
        let around = wide.iter().fold(Aabb::EMPTY, |a, b| a.union(*b));
        let mut found = [Interval::new(w, w); N];
        if self.is_cut() && !boundary.bounds().dilated(w).meets(around) {
            return found;
        }
        let mut reach = 0.0;
        if self.is_cut() {
            self.find_shore(component, &around, shore);
            if !shore.is_empty() {
                reach = self.sight();
            }
        }
        let shore = self.is_cut().then_some(&**shore);
        self.find_near(component, &around.dilated(reach), self.margin(), near);
        let near = &*near;
        let depth = self.boundary_range(component, &around, Interval::ALL, (shore, &near.patches));
        // Far from the boundary, and where the scaffold does not overlap itself there, F is continuous and L
        // bounds its slopes: what is so much further than the layer around has the layer's sign.
        let may_tell = self.options.distance == Distance::Fast && near.patches.len() <= WORTH;
        let is_straight = self.are_straight(near);
        let is_leaf = layer > 0.0 && layer < w;
        let is_deep = may_tell && is_leaf && depth.hi <= -w;
        // Around these most is decided; of a leaf that is open they are the ones asked for. Of one that is deep
        // and not open no single element holds any, so that there are no values.
        let centres = if is_deep { regions } else { wide };
        let mut values = [None; N];
        if may_tell && is_straight {
            values = self.at_centres(near, centres, None);
        }
        let is_once = || {
            let middle = around.centre().0;
            values.iter().any(Option::is_some) || boundary.winding_number(middle).round() == 1.0
        };
        let is_open = is_deep && is_once();
        let mut local = (is_open && !is_straight).then_some(local);
        if let Some(local) = local.as_deref_mut() {
            local.start(near);
            values = self.at_centres(near, centres, Some(local));
        }
        let asked = if is_open { regions } else { wide };
        // The one nearest to the surface settles most likely what all are worth.
        let mut order: [usize; N] = std::array::from_fn(|n| n);
        if enough.is_some() {
            let away = values.map(|f| f.map_or(f64::INFINITY, f64::abs));
            order.sort_unstable_by(|&a, &b| away[a].total_cmp(&away[b]));
        }
        for n in order {
            let region = &asked[n];
            let depth = if N == 1 || depth.hi <= -w || depth.lo >= w {
                depth
            } else {
                self.boundary_range(component, region, depth, (shore, &near.patches))
            };
            if self.is_cut() && depth.lo >= w {
                continue;
            }
            let reach = self.reach(depth.hi);
            let halvings = if enough.is_some() { HALVINGS } else { 0 };
            let field = values[n]
                .filter(|_| reach == 0.0)
                .and_then(|f| {
                    let radius = region.farthest(centres[n].centre());
                    self.range_about(f, near, radius, N > 1).or_else(|| {
                        self.range_of_parts(near, region, halvings, local.as_deref_mut())
                    })
                })
                .unwrap_or_else(|| {
                    let all = region.dilated(reach);
                    // Slopes count as far as the layer, too.
                    let among = if is_open { all.dilated(layer) } else { all };
                    if self.is_cut() {
                        self.keep_near(near, &among, nearer);
                    } else {
                        self.find_near(component, &among, self.margin(), nearer);
                    }
                    self.range_among(component, nearer, &all, N > 1)
                });
            found[n] = self.ended_bound(field, depth);
            if enough.is_some_and(|near| found[n].comes_within(near)) {
                return [found[n]; N];
            }
        }
        found
    }

    /// What the field's value at the centre says of the distance in a region within the scaffold, if it
    /// says enough; `is_coarse` if values nearer to 0 than the band's half width are not told apart.
    fn range_about(&self, f: f64, near: &Near, radius: f64, is_coarse: bool) -> Option<Interval> {
        let w = self.options.half_width;
        if f.abs() >= self.rise(near, w + radius) * (1.0 + SLACK) {
            let d = w.copysign(f);
            return Some(Interval::new(d, d));
        }
        // No interval that holds it is far from 0: all lists of elements near it have its owner, whose slopes
        // are not below the least.
        (is_coarse && f.abs() < near.slope_least * w).then(|| Interval::new(-w, w))
    }

    /// The same from the values at the centres of its eighths, halved so often at most; nothing, if these do not
    /// decide.
    fn range_of_parts(
        &self,
        near: &Near,
        region: &Aabb,
        halvings: u32,
        mut local: Option<&mut Local>,
    ) -> Option<Interval> {
        let w = self.options.half_width;
        let finer = halvings.checked_sub(1)?;
        let parts = eighths(region);
        let values = self.at_centres(near, &parts, local.as_deref_mut());
        let mut all: Option<Interval> = None;
        for (part, f) in parts.iter().zip(values) {
            let own = self
                .range_about(f?, near, part.half_diagonal(), true)
                .or_else(|| self.range_of_parts(near, part, finer, local.as_deref_mut()))?;
            let hull = all.map_or(own, |a| a.hull(own));
            if hull.comes_within(w) {
                return Some(hull);
            }
            all = Some(hull);
        }
        all
    }

    /// Bound of the distance from the ranges of the cells in near elements.
    fn range_among(
        &self,
        component: usize,
        near: &Near,
        region: &Aabb,
        is_coarse: bool,
    ) -> Interval {
        let w = self.options.half_width;
        let least = if is_coarse { w * near.slope_sup } else { 0.0 };
        match self.field_range(near, region, least) {
            Some(f) if f.lo >= least || f.hi <= -least || !is_coarse => {
                self.distance_range(component, near, region, f)
            }
            // Perhaps not all elements were looked at.
            _ => Interval::new(-w, w),
        }
    }

    /// Bound of the distance from that of the field's and that of the boundary's.
    fn ended_bound(&self, field: Interval, depth: Interval) -> Interval {
        let w = self.options.half_width;
        if !self.is_cut() {
            return field;
        }
        Interval::new(
            field.lo.max(depth.lo).clamp(-w, w),
            field.hi.max(depth.hi).clamp(-w, w),
        )
    }

    /// The field at the centres of regions, where a single element holds them: among straight elements, or
    /// among any, of which it is known that they do not overlap there, with a place to look from.
    fn at_centres<const N: usize>(
        &self,
        near: &Near,
        regions: &[Aabb; N],
        local: Option<&mut Local>,
    ) -> [Option<f64>; N] {
        let Some(local) = local else {
            return with_straight(|room| self.field_at(near, regions.map(|r| r.centre().0), room));
        };
        regions.map(|region| {
            let owner = self.owner(local, region.centre().0)?;
            let element = self.patch(local, owner.place).number();
            let mut value = [0.0];
            self.filling
                .values(element, &[CellPoint(owner.spot.xi)], &mut value);
            Some(value[0])
        })
    }

    /// How far from a box the points can be at which the field is taken, if the box reaches up to
    /// `outside` beyond the boundary: 0 if it lies in the scaffold.
    pub(super) fn reach(&self, outside: f64) -> f64 {
        let slack = self.chord_slack();
        if outside < -slack {
            0.0
        } else if self.is_cut() {
            // Further out the boundary's distance alone is the value.
            outside.clamp(0.0, self.options.half_width) + slack
        } else {
            outside.max(0.0) + slack
        }
    }

    /// Bounds F at points of the box that lie in near elements; `None` if there are none. Once it holds
    /// values nearer to 0 than `least` the other elements are left out: it says no more than that.
    pub(super) fn field_range(&self, near: &Near, region: &Aabb, least: f64) -> Option<Interval> {
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

    /// Bound of d(F) from one of F: its scale is at least 1 / L.
    pub(super) fn distance_range(
        &self,
        component: usize,
        near: &Near,
        region: &Aabb,
        f: Interval,
    ) -> Interval {
        let w = self.options.half_width;
        let away = f.lo.max(-f.hi);
        if away <= 0.0 {
            return Interval::new(-w, w);
        }
        let mut least = away / near.slope_sup;
        if self.options.distance == Distance::Exact && !self.is_free_of_zeros(component, region) {
            least = 0.0;
        }
        let least = if least >= w * (1.0 + SLACK) {
            w
        } else {
            least * (1.0 - SLACK)
        };
        if f.lo > 0.0 {
            Interval::new(least, w)
        } else {
            Interval::new(-w, -least)
        }
    }

    /// Whether the field certainly has no zero within w of the box.
    fn is_free_of_zeros(&self, component: usize, region: &Aabb) -> bool {
        let wide = region.dilated(self.options.half_width);
        let near = self.near(component, &wide, 0.0);
        self.field_range(&near, &wide, 0.0)
            .is_none_or(|f| f.lo > 0.0 || f.hi < 0.0)
    }
}

/// The eight halves by axis of a box.
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
