//! The part of an element that lies in a world box: the region in which culling evaluates the unit cell.
//!
//! For xi, `xi_c` in a convex part of the cell, F(xi) = F(`xi_c`) + J (xi - `xi_c`) + q with
//! |`q_i`| <= 1/2 sum `M_ijk` `R_j` `R_k`, where M bounds the second derivatives over the part and
//! R = |xi - `xi_c`| per axis. So F(xi) in the box c +- h implies
//! |xi - `xi_c` - Y (c - F(`xi_c`))| <= |Y| (h + q), Y = J^-1: repeated around the new middle this
//! contracts quadratically. Where it does not (strong curvature), the part is split, and halves
//! whose control points miss the box are dropped.

use super::bernstein::{Net, Part};
use super::element::ElementMap;
use super::kind::Kind;
use super::map::{Affine, Curved, Map, PAIRS, bend};
use druse_geometry::frame::{Aabb, CellBox, CellPoint, Element, Mat3, Vec3};
use std::cell::Cell;
use std::sync::OnceLock;

/// Maximum depth of splits.
const MAX_SPLIT_DEPTH: usize = 12;
/// Relative growth that covers rounding.
const ROUNDING_GROWTH: f64 = 1e-12;

/// Halves of a part and of each of its parts, one level after the other.
type Halves = [[Net<Vec3>; 2]];

thread_local! {
    /// Buffers, reused between calls.
    static HALVES: Cell<Vec<[Net<Vec3>; 2]>> = Cell::default();
}

impl ElementMap<'_> {
    /// A box in the cell frame around every point of the closed reference cell that maps into `world`; `None` proves
    /// that there is none. Tight for small boxes: the preimage's own bounding box, a little larger on curved elements.
    pub fn cell_box(&self, world: &Aabb) -> Option<CellBox<3>> {
        if !self.bounds().meets(*world) {
            return None;
        }
        match &self.geometry.map {
            Map::Affine(a) => of_affine(self.shape(), a, world),
            Map::Curved(c) => {
                let mut found = CellBox::of([]);
                let root = c.kind.shape().cell_box();
                let mut halves = HALVES.take();
                halves.resize_with(MAX_SPLIT_DEPTH, || [Net::empty(), Net::empty()]);
                of_part(c, None, &root, &c.bend, world, &mut halves, &mut found);
                HALVES.set(halves);
                if found.is_empty() {
                    return None;
                }
                grow(&mut found);
                confine(self.shape(), found)
            }
            Map::Twisted(t) => t.cell_box(world),
            Map::Collapsed(c) => c.cell_box(world, self.geometry.stretch.1),
        }
    }
}

/// [`ElementMap::cell_box`] of an affine element: the preimage's own box, within the cell.
fn of_affine(shape: Element, a: &Affine, world: &Aabb) -> Option<CellBox<3>> {
    // A degenerate element has no inverse.
    if !a.inverse[0].is_finite() {
        return Some(shape.cell_box());
    }
    let half = world.size() / 2.0;
    let middle = a.inverse * (world.centre().0 - a.origin);
    if beyond_a_face(shape, &middle, &a.inverse, &half) {
        return None;
    }
    let reach = a.inverse.abs() * half;
    let mut found = CellBox {
        min: middle - reach,
        max: middle + reach,
    };
    grow(&mut found);
    confine(shape, found)
}

/// Face planes that are not axis-aligned, which the bounding box does not contain: n.x <= offset.
fn slanted(shape: Element) -> &'static [(Vec3, f64)] {
    static PLANES: [OnceLock<Vec<(Vec3, f64)>>; 6] = [const { OnceLock::new() }; 6];
    PLANES[shape as usize].get_or_init(|| {
        let faces = shape.faces().into_iter();
        let slanted = faces.filter(|f| f.normal.amax() < 1.0 - 1e-9);
        slanted.map(|f| (f.normal, f.offset)).collect()
    })
}

/// Whether the set middle + Y b, |b| <= half, lies outside one face plane of the cell.
pub(super) fn beyond_a_face(shape: Element, middle: &Vec3, y: &Mat3, half: &Vec3) -> bool {
    slanted(shape).iter().any(|(n, offset)| {
        let reach = (y.transpose() * n).abs().dot(half);
        n.dot(middle) - reach > offset + ROUNDING_GROWTH * (1.0 + reach)
    })
}

/// Widens a box of the cell frame on all sides by a bound of the rounding of its corners.
pub(super) fn grow(b: &mut CellBox<3>) {
    let slack = ROUNDING_GROWTH * (1.0 + b.min.amax().max(b.max.amax()));
    b.min.add_scalar_mut(-slack);
    b.max.add_scalar_mut(slack);
}

/// A box around the intersection of a box and the closed cell, one face plane at a time. `None` if they do not meet.
pub(super) fn confine(shape: Element, found: CellBox<3>) -> Option<CellBox<3>> {
    let mut b = found.intersection(shape.cell_box());
    if b.is_empty() {
        return None;
    }
    for (n, offset) in slanted(shape) {
        // Least n.x over the box; on each axis the other two leave this much.
        let least = |a: usize| n[a] * if n[a] > 0.0 { b.min[a] } else { b.max[a] };
        let slack = offset + 4.0 * ROUNDING_GROWTH - least(0) - least(1) - least(2);
        if slack < 0.0 {
            return None;
        }
        for a in 0..3 {
            if n[a] > 0.0 {
                b.max[a] = b.max[a].min(b.min[a] + slack / n[a]);
            } else if n[a] < 0.0 {
                b.min[a] = b.min[a].max(b.max[a] + slack / n[a]);
            }
        }
    }
    Some(b)
}

/// Adds the preimage of `world` within one part to `found`. `net` and `part` describe the part, `None` the whole cell;
/// `domain` is a box around it, `bend_bounds` bound the second derivatives there, `room` is memory for further splits.
/// Nothing is added where the part cannot meet `world`. It calls itself for the halves, one level of `room` each.
fn of_part(
    c: &Curved,
    part: Option<(&Net<Vec3>, Part)>,
    domain: &CellBox<3>,
    bend_bounds: &[Vec3; 6],
    world: &Aabb,
    room: &mut Halves,
    found: &mut CellBox<3>,
) {
    let Some((inner, settled)) = contract(c, domain, bend_bounds, world) else {
        return;
    };
    // The box found so far covers this part.
    let covered = (0..3).all(|a| found.min[a] <= inner.min[a] && inner.max[a] <= found.max[a]);
    // Settled, covered, or no more room for splits: the box found is taken as it is.
    // `room` ends at the greatest depth: the box found is then larger than needed, never too small.
    let (true, Some((halves, room))) = (!(settled || covered), room.split_first_mut()) else {
        found.min = found.min.inf(&inner.min);
        found.max = found.max.sup(&inner.max);
        return;
    };
    let whole;
    let (net, part) = if let Some((net, part)) = part {
        (net, part)
    } else {
        whole = Part::whole(c.net.family);
        (&c.net, whole)
    };
    // Otherwise both halves of the part are contracted on their own, where their control points meet the box.
    let way = part.longest_way();
    net.split_into(way, halves);
    for (net, part) in halves.iter().zip(part.split(way)) {
        if !Aabb::of(net.coefficients.iter().copied()).meets(*world) {
            continue;
        }
        let (domain, bounds) = local(c.kind, net, &part, &c.bend);
        let domain = domain.intersection(inner);
        if domain.is_empty() {
            continue;
        }
        of_part(c, Some((net, part)), &domain, &bounds, world, room, found);
    }
}

/// The box of a part in the cell frame, and its own bounds of the second derivatives.
fn local(kind: Kind, net: &Net<Vec3>, part: &Part, whole: &[Vec3; 6]) -> (CellBox<3>, [Vec3; 6]) {
    match part {
        // Of degree 2, so the second derivatives are the same everywhere; a prism's nearly so.
        Part::Simplex(v) => (CellBox::of(v.map(|r| kind.from_parameters(r))), *whole),
        Part::Prism(v, [low, high]) => {
            let ends = v
                .iter()
                .flat_map(|r| [*low, *high].map(|z| Vec3::new(r.x, r.y, z)));
            (CellBox::of(ends.map(|r| kind.from_parameters(r))), *whole)
        }
        Part::Tensor(min, max) => {
            let size = max - min;
            let mut bounds = bend(kind, net);
            for (b, [j, k]) in bounds.iter_mut().zip(PAIRS) {
                *b /= size[j] * size[k];
            }
            let domain = CellBox {
                min: kind.from_parameters(*min).0,
                max: kind.from_parameters(*max).0,
            };
            (domain, bounds)
        }
    }
}

/// Contracts `domain` around the preimage; `None` proves it empty. The flag states that the contracted box is within a
/// small factor of the preimage's own box. `bend` bounds the second derivatives over `domain`.
fn contract(
    c: &Curved,
    domain: &CellBox<3>,
    bend: &[Vec3; 6],
    world: &Aabb,
) -> Option<(CellBox<3>, bool)> {
    let half = world.size() / 2.0;
    let target = world.centre().0;
    let mut inner = *domain;
    // An interval Newton step: F(xi) = F(m) + J (xi - m) + rest within the box m +- radius, so that F(xi) in the world
    // box implies xi in m + J^-1 (target - F(m)) +- |J^-1| (half + |rest|).
    // Few steps: where they do not contract, the part is split instead.
    for _ in 0..6 {
        let middle = (inner.min + inner.max) / 2.0;
        let radius = (inner.max - inner.min) / 2.0;
        let (x, j) = c.evaluate(CellPoint(middle));
        // Where the Jacobian is singular the box stays; it is settled once it is tiny.
        let Some(y) = j.try_inverse() else {
            return Some((inner, radius.amax() < 1e-9));
        };
        let mut rest = Vec3::zeros();
        for (b, [j, k]) in bend.iter().zip(PAIRS) {
            // The mixed pairs stand for two entries of the symmetric matrix.
            let times = if j == k { 0.5 } else { 1.0 };
            rest += b * (times * radius[j] * radius[k]);
        }
        let rounding = ROUNDING_GROWTH * (x.amax() + target.amax());
        let spread = (half + rest).add_scalar(rounding);
        let centre = middle + y * (target - x);
        if beyond_a_face(c.kind.shape(), &centre, &y, &spread) {
            return None;
        }
        let reach = y.abs() * spread;
        let next = CellBox {
            min: inner.min.sup(&(centre - reach)),
            max: inner.max.inf(&(centre + reach)),
        };
        if next.is_empty() {
            return None;
        }
        // An edge fell below 3/4, with half edges in `radius`.
        let shrunk = (0..3).any(|a| next.max[a] - next.min[a] < 1.5 * radius[a]);
        inner = next;
        // How much the remainder adds to the linear preimage: settled is up to a quarter, or up to as much again
        // where the box shrinks no further; 1e-9 of the cell in any case.
        let linear = y.abs() * half.add_scalar(rounding);
        let excess = y.abs() * rest;
        let adds = |share: f64| (0..3).all(|a| excess[a] <= share * linear[a] + 1e-9);
        if adds(0.25) {
            return Some((inner, true));
        }
        if !shrunk {
            return Some((inner, adds(1.0)));
        }
    }
    Some((inner, false))
}
