//! Diameters along the struts of a network, thicknesses over its plates.
//!
//! A beam's radius is linear along it. Where the requested diameter is not, the strut is bisected, down to an
//! eighth of its length, until the radius follows within the tolerance; a plate is cut into sixteen parts.

use super::network::{Facet, Strut, divided};
use super::{Beam, Network, Plate};
use crate::frame::{CellPoint, Vec3};
use crate::scaffold::Scaffold;

/// Intervals along a strut at whose ends a diameter is looked up, and along the side of a plate.
const ALONG: usize = 8;
const ACROSS: usize = 4;
/// Weight of a cell that counts as none.
const NO_WEIGHT: f64 = 1e-9;

/// Weights of at most eight cells at a point of an element.
pub type WeightsAt<'a> = dyn Fn(usize, CellPoint<3>) -> [f64; 8] + Sync + 'a;
/// Diameters at world points, world units.
pub type DiametersAt<'a, E> = dyn FnMut(&[Vec3]) -> Result<Vec<f64>, E> + 'a;

/// How thick parts are.
pub enum Width<'a, E> {
    /// As their radii say, in reference lengths, times the elements' mean scale there.
    Relative,
    /// The same everywhere, world units.
    Constant(f64),
    /// As a function of the place says, world units.
    Varying(&'a mut DiametersAt<'a, E>),
}

/// Points along a part, and radii there.
struct Samples {
    places: Vec<Vec3>,
    radii: Vec<f64>,
}

impl Network {
    /// Beams and plates of these widths. With weights, a part's width is multiplied by the sum of the weights of
    /// the cells that have it: parts of one cell of several taper off with its weight, and what all have in
    /// common keeps its width. They get no thinner than the radius `least`, or half of what they would be
    /// without weights if that is less, and are left out where they have no weight along their whole length.
    /// `tolerance` bounds the error of the radii between their ends. All lengths are in world units.
    ///
    /// # Errors
    /// Those of a varying width.
    pub fn sized<E>(
        &self,
        scaffold: &Scaffold,
        width: Width<E>,
        weights: Option<&WeightsAt>,
        [tolerance, least]: [f64; 2],
    ) -> Result<(Vec<Beam>, Vec<Plate>), E> {
        let varies = weights.is_some() || matches!(width, Width::Varying(_));
        let (along, across) = if varies { (ALONG, ACROSS) } else { (1, 1) };
        let mut places = Vec::new();
        for strut in &self.struts {
            places.extend((0..=along).map(|n| self.on_strut(scaffold, strut, (n, along))));
        }
        let per_facet = corners(across).count();
        for facet in &self.facets {
            places.extend(corners(across).map(|c| self.on_facet(scaffold, facet, c)));
        }
        let mut radii = match width {
            Width::Relative => {
                let struts = self.struts.iter().flat_map(|s| {
                    let [a, b] = s.radii;
                    (0..=along).map(move |n| a + (b - a) * n as f64 / along as f64)
                });
                let facets = self.facets.iter().flat_map(|f| {
                    let [a, b, c] = f.radii;
                    corners(across).map(move |[u, v]| a + (b - a) * u + (c - a) * v)
                });
                struts.chain(facets).collect()
            }
            Width::Constant(d) => vec![d / 2.0; places.len()],
            Width::Varying(diameters) => {
                let mut found = diameters(&places)?;
                for d in &mut found {
                    *d /= 2.0;
                }
                found
            }
        };
        if let Some(weights) = weights {
            self.weigh(weights, (along, across), least, &mut radii);
        }
        let samples = Samples { places, radii };
        let mut beams = Vec::new();
        for n in 0..self.struts.len() {
            samples.beams(n * (along + 1), along, tolerance, &mut beams);
        }
        let mut plates = Vec::new();
        let first = self.struts.len() * (along + 1);
        for n in 0..self.facets.len() {
            samples.plates(first + n * per_facet, across, tolerance, &mut plates);
        }
        Ok((beams, plates))
    }

    fn on_strut(&self, scaffold: &Scaffold, strut: &Strut, (n, of): (usize, usize)) -> Vec3 {
        if n == 0 || n == of {
            return self.nodes[strut.ends[usize::from(n == of)] as usize];
        }
        let xi = CellPoint(mixed(strut, n as f64 / of as f64));
        scaffold.element(strut.element as usize).map(xi).0
    }

    fn on_facet(&self, scaffold: &Scaffold, facet: &Facet, c: [f64; 2]) -> Vec3 {
        let corner = |n: usize| self.nodes[facet.corners[n] as usize];
        match c {
            [0.0, 0.0] => corner(0),
            [1.0, 0.0] => corner(1),
            [0.0, 1.0] => corner(2),
            _ => {
                let xi = CellPoint(within(facet, c));
                scaffold.element(facet.element as usize).map(xi).0
            }
        }
    }

    /// Multiplies radii by the weights of the parts' cells, down to the radius `least` or half of what they are.
    /// Parts without any weight get no radius.
    fn weigh(
        &self,
        weights: &WeightsAt,
        (along, across): (usize, usize),
        least: f64,
        radii: &mut [f64],
    ) {
        let share = |cells: u8, element: u32, xi: Vec3| {
            let all = weights(element as usize, CellPoint(xi));
            let own = all.iter().enumerate().filter(|(n, _)| cells >> n & 1 == 1);
            own.map(|(_, w)| w).sum::<f64>()
        };
        let taper = |radii: &mut [f64], shares: &[f64]| {
            // A share of rounding is none.
            let has_weight = shares.iter().any(|&s| s > NO_WEIGHT);
            for (radius, share) in radii.iter_mut().zip(shares) {
                let thinnest = least.min(*radius / 2.0);
                *radius = if has_weight {
                    (*radius * share).max(thinnest)
                } else {
                    0.0
                };
            }
        };
        let (of_struts, of_facets) = radii.split_at_mut(self.struts.len() * (along + 1));
        for (s, radii) in self
            .struts
            .iter()
            .zip(of_struts.chunks_exact_mut(along + 1))
        {
            let at = |n: usize| share(s.cells, s.element, mixed(s, n as f64 / along as f64));
            let shares: Vec<f64> = (0..=along).map(at).collect();
            taper(radii, &shares);
        }
        let per_facet = corners(across).count();
        for (f, radii) in self
            .facets
            .iter()
            .zip(of_facets.chunks_exact_mut(per_facet))
        {
            let shares = corners(across).map(|c| share(f.cells, f.element, within(f, c)));
            taper(radii, &shares.collect::<Vec<f64>>());
        }
    }
}

fn mixed(strut: &Strut, t: f64) -> Vec3 {
    let [a, b] = strut.reference;
    a + (b - a) * t
}

fn within(facet: &Facet, [u, v]: [f64; 2]) -> Vec3 {
    let [a, b, c] = facet.reference;
    a + (b - a) * u + (c - a) * v
}

/// Places on a triangle cut into `count`^2 parts: shares of its second and third corner.
fn corners(count: usize) -> impl Iterator<Item = [f64; 2]> {
    let share = move |n: usize| n as f64 / count as f64;
    (0..=count).flat_map(move |i| (0..=count - i).map(move |j| [share(i), share(j)]))
}

impl Samples {
    /// The beams of a strut whose samples begin at `first`.
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
                ends: [self.places[from], self.places[to]],
                radii: [a, b],
            });
        }
    }

    /// The plates of a facet whose samples begin at `first`.
    fn plates(&self, first: usize, count: usize, tolerance: f64, out: &mut Vec<Plate>) {
        // In the order of `corners`: of the last j for i = 0, and the last i.
        let number = |i: usize, j: usize| first + i * (2 * count + 3 - i) / 2 + j;
        let whole = [number(0, 0), number(count, 0), number(0, count)];
        let [a, b, c] = whole.map(|n| self.radii[n]);
        let off = corners(count).enumerate().map(|(n, [u, v])| {
            let linear = a + (b - a) * u + (c - a) * v;
            (self.radii[first + n] - linear).abs()
        });
        let mut push = |at: [usize; 3]| {
            let radii = at.map(|n| self.radii[n]);
            if radii.iter().any(|&r| r > 0.0) {
                let corners = at.map(|n| self.places[n]);
                out.push(Plate { corners, radii });
            }
        };
        if off.fold(0.0, f64::max) <= tolerance {
            return push(whole);
        }
        let places = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[u, v]| Vec3::new(u, v, 0.0));
        for part in divided(places, count) {
            push(part.map(|p| {
                let steps = (p * count as f64).map(f64::round);
                number(steps.x as usize, steps.y as usize)
            }));
        }
    }
}
