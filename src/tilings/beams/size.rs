//! Sizes of a network: diameters along its struts, thicknesses over its plates.
//!
//! A beam's radius is linear along it. Where the requested diameter is not linear, the strut is bisected, down to an
//! eighth of its length, until the radius is within the tolerance; such a plate is divided into sixteen parts. Weights
//! of cells scale the sizes of their parts.

use super::network::{Facet, Strut, subdivided};
use super::{Beam, Network, Plate};
use crate::scaffold::Scaffold;
use druse_geometry::frame::{CellPoint, Vec3};

/// Intervals along a strut at whose ends a diameter is evaluated, and along the side of a plate.
const STRUT_INTERVALS: usize = 8;
const PLATE_INTERVALS: usize = 4;
/// Weight of a cell that counts as 0.
const ZERO_WEIGHT_TOLERANCE: f64 = 1e-9;

/// Weights of at most eight cells at a point of an element.
pub type WeightsAt<'a> = dyn Fn(usize, CellPoint<3>) -> [f64; 8] + Sync + 'a;
/// Diameters at world points, world units.
pub type DiametersAt<'a, E> = dyn FnMut(&[Vec3]) -> Result<Vec<f64>, E> + 'a;

/// Thickness of the parts.
pub enum Width<'a, E> {
    /// The radii of the parts in reference lengths, times the elements' mean scale there.
    Relative,
    /// A constant diameter or thickness, world units.
    Constant(f64),
    /// A diameter or thickness as a function of position, world units.
    Varying(&'a mut DiametersAt<'a, E>),
}

/// Limits of the radii of a sized network, world units.
#[derive(Clone, Copy, Debug)]
pub struct RadiusLimits {
    /// Bounds the error of the radii between the ends of a part.
    pub tolerance: f64,
    /// The smallest radius of a part with weights, unless half its radius without them is less.
    pub min_radius: f64,
}

/// Numbers of intervals at whose ends the radius is evaluated.
#[derive(Clone, Copy)]
struct Intervals {
    /// Along a strut.
    strut: usize,
    /// Along each side of a plate's triangle.
    side: usize,
}

/// Points along the parts, and the radii there.
struct Samples {
    points: Vec<Vec3>,
    radii: Vec<f64>,
}

impl Network {
    /// Beams and plates with these widths. With weights, a part's width is multiplied by the sum of the
    /// weights of the cells that contain it: parts of a single cell taper off with its weight, and parts
    /// common to all cells keep their width. Parts without any weight are omitted.
    ///
    /// # Errors
    /// Errors of a varying width.
    pub fn sized<E>(
        &self,
        scaffold: &Scaffold,
        width: Width<E>,
        weights: Option<&WeightsAt>,
        limits: RadiusLimits,
    ) -> Result<(Vec<Beam>, Vec<Plate>), E> {
        // Without weights, constant and relative widths are linear along each part: the ends suffice.
        let varies = weights.is_some() || matches!(width, Width::Varying(_));
        let intervals = if varies {
            Intervals {
                strut: STRUT_INTERVALS,
                side: PLATE_INTERVALS,
            }
        } else {
            Intervals { strut: 1, side: 1 }
        };
        let (along, across) = (intervals.strut, intervals.side);
        // The samples of all struts, then of all plates, are evaluated at once.
        let mut points = Vec::new();
        for strut in &self.struts {
            points.extend((0..=along).map(|n| self.on_strut(scaffold, strut, n, along)));
        }
        let per_facet = triangle_points(across).count();
        for facet in &self.facets {
            points.extend(triangle_points(across).map(|c| self.on_facet(scaffold, facet, c)));
        }
        let mut radii = match width {
            Width::Relative => {
                let struts = self.struts.iter().flat_map(|s| {
                    let [a, b] = s.radii;
                    (0..=along).map(move |n| a + (b - a) * n as f64 / along as f64)
                });
                let facets = self.facets.iter().flat_map(|f| {
                    let [a, b, c] = f.radii;
                    triangle_points(across).map(move |[u, v]| a + (b - a) * u + (c - a) * v)
                });
                struts.chain(facets).collect()
            }
            Width::Constant(d) => vec![d / 2.0; points.len()],
            Width::Varying(diameters) => {
                let mut widths = diameters(&points)?;
                for d in &mut widths {
                    *d /= 2.0;
                }
                widths
            }
        };
        // Weights scale radii at the samples.
        if let Some(weights) = weights {
            self.apply_weights(weights, intervals, limits.min_radius, &mut radii);
        }
        // Parts are cut where the radius is not linear.
        let samples = Samples { points, radii };
        let mut beams = Vec::new();
        for n in 0..self.struts.len() {
            samples.beams(n * (along + 1), along, limits.tolerance, &mut beams);
        }
        let mut plates = Vec::new();
        let first = self.struts.len() * (along + 1);
        for n in 0..self.facets.len() {
            samples.plates(first + n * per_facet, across, limits.tolerance, &mut plates);
        }
        Ok((beams, plates))
    }

    /// World point `n` of the `count + 1` points that divide a strut evenly.
    fn on_strut(&self, scaffold: &Scaffold, strut: &Strut, n: usize, count: usize) -> Vec3 {
        // The ends are nodes, the same bits in every element.
        if n == 0 || n == count {
            return self.nodes[strut.ends[usize::from(n == count)] as usize];
        }
        let xi = CellPoint(strut_point(strut, n as f64 / count as f64));
        scaffold.element(strut.element as usize).map(xi).0
    }

    /// The world point of a facet at weights `c` of its second and third corner.
    fn on_facet(&self, scaffold: &Scaffold, facet: &Facet, c: [f64; 2]) -> Vec3 {
        let corner = |n: usize| self.nodes[facet.corners[n] as usize];
        match c {
            [0.0, 0.0] => corner(0),
            [1.0, 0.0] => corner(1),
            [0.0, 1.0] => corner(2),
            _ => {
                let xi = CellPoint(facet_point(facet, c));
                scaffold.element(facet.element as usize).map(xi).0
            }
        }
    }

    /// Multiplies radii by the weights of the parts' cells, with the lower limit `min_radius`, or half the radius if that
    /// is less. Parts without any weight get radius 0. `radii` are in world units, struts first, as the samples are.
    fn apply_weights(
        &self,
        weights: &WeightsAt,
        intervals: Intervals,
        min_radius: f64,
        radii: &mut [f64],
    ) {
        let (along, across) = (intervals.strut, intervals.side);
        // The sum of the weights of a part's cells at a point.
        let weight_at = |cells: u8, element: u32, xi: Vec3| {
            let all = weights(element as usize, CellPoint(xi));
            let part_weights = all.iter().enumerate().filter(|(n, _)| cells >> n & 1 == 1);
            part_weights.map(|(_, w)| w).sum::<f64>()
        };
        let taper = |radii: &mut [f64], weights: &[f64]| {
            // A weight that is a rounding error counts as 0.
            let has_weight = weights.iter().any(|&w| w > ZERO_WEIGHT_TOLERANCE);
            for (radius, weight) in radii.iter_mut().zip(weights) {
                let thinnest = min_radius.min(*radius / 2.0);
                *radius = if has_weight {
                    (*radius * weight).max(thinnest)
                } else {
                    0.0
                };
            }
        };
        // Radii come as the samples do: of all struts, then of all facets.
        let (of_struts, of_facets) = radii.split_at_mut(self.struts.len() * (along + 1));
        for (s, radii) in self
            .struts
            .iter()
            .zip(of_struts.chunks_exact_mut(along + 1))
        {
            let point = |n: usize| strut_point(s, n as f64 / along as f64);
            let weights = (0..=along).map(|n| weight_at(s.cells, s.element, point(n)));
            taper(radii, &weights.collect::<Vec<f64>>());
        }
        let per_facet = triangle_points(across).count();
        for (f, radii) in self
            .facets
            .iter()
            .zip(of_facets.chunks_exact_mut(per_facet))
        {
            let weights =
                triangle_points(across).map(|c| weight_at(f.cells, f.element, facet_point(f, c)));
            taper(radii, &weights.collect::<Vec<f64>>());
        }
    }
}

/// The reference point at the fraction `t` of a strut.
fn strut_point(strut: &Strut, t: f64) -> Vec3 {
    let [a, b] = strut.reference;
    a + (b - a) * t
}

/// The reference point of a facet at weights of its second and third corner.
fn facet_point(facet: &Facet, [u, v]: [f64; 2]) -> Vec3 {
    let [a, b, c] = facet.reference;
    a + (b - a) * u + (c - a) * v
}

/// Points of a triangle subdivided into `count`^2 parts, as weights of the second and third corner.
fn triangle_points(count: usize) -> impl Iterator<Item = [f64; 2]> {
    let share = move |n: usize| n as f64 / count as f64;
    (0..=count).flat_map(move |i| (0..=count - i).map(move |j| [share(i), share(j)]))
}

impl Samples {
    /// Adds the beams of a strut with `count + 1` samples from `first` on: one, or those of its halves where the radius
    /// is not linear within the tolerance. Beams with radius 0 at both ends are left out.
    fn beams(&self, first: usize, count: usize, tolerance: f64, out: &mut Vec<Beam>) {
        let (from, to) = (first, first + count);
        let [a, b] = [self.radii[from], self.radii[to]];
        let off = (1..count).map(|n| {
            let linear = a + (b - a) * n as f64 / count as f64;
            (self.radii[from + n] - linear).abs()
        });
        if count > 1 && off.fold(0.0, f64::max) > tolerance {
            let half = count / 2;
            self.beams(from, half, tolerance, out);
            self.beams(from + half, count - half, tolerance, out);
        } else if a > 0.0 || b > 0.0 {
            out.push(Beam {
                ends: [self.points[from], self.points[to]],
                radii: [a, b],
            });
        }
    }

    /// Adds the plates of a facet with the samples of [`triangle_points`] from `first` on: one, or `count^2` where the
    /// radius is not linear within the tolerance. Plates whose corners all have radius 0 are left out.
    fn plates(&self, first: usize, count: usize, tolerance: f64, out: &mut Vec<Plate>) {
        // Index in the order of `triangle_points`: row i has count + 1 - i of them.
        let number = |i: usize, j: usize| first + i * (2 * count + 3 - i) / 2 + j;
        let whole = [number(0, 0), number(count, 0), number(0, count)];
        let [a, b, c] = whole.map(|n| self.radii[n]);
        let off = triangle_points(count).enumerate().map(|(n, [u, v])| {
            let linear = a + (b - a) * u + (c - a) * v;
            (self.radii[first + n] - linear).abs()
        });
        let mut push = |at: [usize; 3]| {
            let radii = at.map(|n| self.radii[n]);
            if radii.iter().any(|&r| r > 0.0) {
                let corners = at.map(|n| self.points[n]);
                out.push(Plate { corners, radii });
            }
        };
        if off.fold(0.0, f64::max) <= tolerance {
            return push(whole);
        }
        // The corners of each part are samples: their weights times `count` are whole.
        let points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[u, v]| Vec3::new(u, v, 0.0));
        for part in subdivided(points, count) {
            push(part.map(|p| {
                let steps = (p * count as f64).map(f64::round);
                number(steps.x as usize, steps.y as usize)
            }));
        }
    }
}
