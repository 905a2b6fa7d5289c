//! One element of the scaffold with the cell in it: inverse map, slopes, distance to its faces.

use super::Filling;
use super::boundary_distance::Walls;
use super::inverse_map::Curve;
use super::local_map::Trail;
use super::newton_distance::{self, Leg, Pace, Walkers};
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use crate::scaffold::Scaffold;
use std::sync::OnceLock;

/// Points this close to a face, in reference units, belong to the element.
pub(super) const ON_FACE: f64 = 1e-9;

/// How reference coordinates are found.
enum Inverse {
    /// `xi = matrix (x - centre)`.
    Affine { matrix: Mat3, centre: Vec3 },
    /// By Newton's method, starting from the affine map at the centroid.
    Curved { matrix: Mat3, centre: Vec3 },
}

/// An element and what the distance rules need to know of it.
pub(super) struct Patch {
    number: usize,
    shape: Element,
    inverse: Inverse,
    walls: Walls,
    /// L: bound of |grad F| over those points of the element where |F| <= L times the reach of what is near the
    /// surface, per world unit; infinite if none could be proved.
    pub slope_sup: f64,
    /// The same over all of the element.
    pub slope_most: f64,
    /// gamma: root mean square of |grad F| on the surface.
    pub slope_rms: f64,
    /// Least stretch of the map: world length per reference length.
    least_stretch: f64,
}

/// How a point is looked for in a curved element.
#[derive(Clone, Copy, Default)]
pub(super) struct Search {
    /// Where Newton's method starts.
    pub start: Option<Vec3>,
    /// Whether an error of some 1e-8 of the cell will do outside: for values in single precision.
    pub is_rough: bool,
}

/// Where a point lies as an element sees it. Outside the element the map is continued: linearly from
/// the nearest point of the closed reference cell, so that the continuation meets the map at the
/// faces. (An affine map is its own continuation.)
#[derive(Clone, Copy)]
pub(super) struct Spot {
    /// Reference coordinates by the continued map.
    pub xi: Vec3,
    /// d xi / d x there.
    pub inverse: Mat3,
    /// Largest signed distance to the faces in reference coordinates; at most 0 inside.
    pub beyond: f64,
    /// m(x): how far outside the element, world units; continuous, at most 0 inside. Of affine elements
    /// the largest signed distance to the planes of the faces; of curved ones the distance from the point
    /// of the element where the continuation starts.
    pub overshoot: f64,
}

/// Where some of a list of points lie in one element.
#[derive(Default)]
pub(super) struct Spots {
    /// Their numbers in the list, ascending.
    of: Vec<u32>,
    /// `None` where nothing was found.
    pub all: Vec<Option<Spot>>,
    at: Vec<Vec3>,
}

/// The reference vertices, made once.
fn vertices(shape: Element) -> &'static [Vec3] {
    static ALL: [OnceLock<Vec<Vec3>>; 7] = [const { OnceLock::new() }; 7];
    ALL[shape as usize].get_or_init(|| shape.vertices())
}

impl Spots {
    /// Numbers, and where those points lie that were found.
    pub fn found(&self) -> impl Iterator<Item = (u32, &Spot)> {
        let both = self.of.iter().zip(&self.all);
        both.filter_map(|(&n, spot)| Some((n, spot.as_ref()?)))
    }
}

impl Patch {
    /// Prepares element `number` of a filled scaffold; slopes as far from the surface as `reach`, world units,
    /// are near it.
    pub fn new(scaffold: &Scaffold, filling: &impl Filling, number: usize, reach: f64) -> Self {
        let element = scaffold.element(number);
        let shape = element.shape();
        // The affine map that agrees at the origin; curved elements start Newton's method with it.
        let (centre, jacobian) = element.map_and_jacobian(CellPoint(Vec3::zeros()));
        let matrix = jacobian.try_inverse().unwrap_or_else(Mat3::zeros);
        let centre = centre.0;
        let least_stretch = element.stretch().0.max(0.0);
        let per_world = |slope: f64| {
            if least_stretch > 0.0 {
                slope / least_stretch
            } else {
                f64::INFINITY
            }
        };
        let controls = element.control_points();
        let walls = Walls::new(shape, &matrix, &controls, element.bounds());
        Self {
            number,
            shape,
            inverse: if element.is_affine() {
                Inverse::Affine { matrix, centre }
            } else {
                Inverse::Curved { matrix, centre }
            },
            walls,
            slope_sup: per_world(filling.gradient_sup_near(number, reach / least_stretch)),
            slope_most: per_world(filling.gradient_sup(number)),
            slope_rms: filling.gradient_rms(number) * matrix.norm() / 3f64.sqrt(),
            least_stretch,
        }
    }

    /// Whether a point is certainly further than `margin` outside.
    fn is_beyond(&self, x: Vec3, margin: f64) -> bool {
        self.walls.outside::<f64>(x.into()) > margin
    }

    /// Whether a point certainly lies deeper than `margin` under the faces.
    #[inline]
    pub fn is_under(&self, x: Vec3, margin: f64) -> bool {
        self.is_affine() && self.walls.outside::<f64>(x.into()) < -margin
    }

    /// A lower bound of a point's distance to the plane of a face; curved faces have none.
    pub fn face_distance(&self, face: usize, x: Vec3) -> f64 {
        match self.inverse {
            Inverse::Affine { .. } => self.walls.face_distance(face, x),
            Inverse::Curved { .. } => 0.0,
        }
    }

    /// Whether every point of the box is certainly further than `margin` outside, by the measure m.
    #[inline]
    pub fn misses(&self, centre: Vec3, half: Vec3, margin: f64) -> bool {
        self.walls.misses(centre, half, margin)
    }

    /// Where `x` lies, if it may be less than `margin` world units outside.
    pub fn spot(&self, scaffold: &Scaffold, x: Vec3, margin: f64, search: Search) -> Option<Spot> {
        if self.is_beyond(x, margin) {
            return None;
        }
        match &self.inverse {
            Inverse::Affine { .. } => Some(self.by_affine_map(x)),
            Inverse::Curved { matrix, centre } => {
                let guess = search.start.unwrap_or_else(|| matrix * (x - centre));
                let from = |start: Vec3| self.newton(scaffold, x, start, search.is_rough);
                from(self.clamp(guess))
                    .or_else(|| from(Vec3::zeros()))
                    .or_else(|| vertices(self.shape).iter().copied().find_map(from))
            }
        }
    }

    /// Where `x` lies if it is well inside the element, off its faces.
    pub fn inside(&self, scaffold: &Scaffold, x: Vec3, search: Search) -> Option<Spot> {
        let spot = match &self.inverse {
            Inverse::Affine { .. } => self.by_affine_map(x),
            Inverse::Curved { matrix, centre } => {
                if self.is_beyond(x, 0.0) {
                    return None;
                }
                let guess = search.start.unwrap_or_else(|| matrix * (x - centre));
                self.newton(scaffold, x, self.clamp(guess), search.is_rough)?
            }
        };
        (spot.beyond < -ON_FACE).then_some(spot)
    }

    /// Where those of some points lie that may be less than `margin` world units outside; four at a time,
    /// guessed from the first of the last four that was found.
    pub fn spots(
        &self,
        scaffold: &Scaffold,
        (points, margin): (&[Vec3], f64),
        (trail, is_rough): (&mut Trail, bool),
        found: &mut Spots,
    ) {
        let Spots { of, at, all } = found;
        of.clear();
        at.clear();
        all.clear();
        let affine = self.affine();
        self.walls.keep(points, margin, |n, m| {
            of.push(n as u32);
            match affine {
                Some((matrix, centre)) => {
                    let xi = matrix * (points[n] - centre);
                    all.push(Some(self.affine_spot(xi, *matrix, m)));
                }
                None => at.push(points[n]),
            }
        });
        if affine.is_some() {
            return;
        }
        match self.curve(scaffold) {
            Some(curve) => curve.find_all(trail, is_rough, at, all),
            None => all.resize(at.len(), None),
        }
        for (&x, spot) in at.iter().zip(all).filter(|(_, s)| s.is_none()) {
            let start = Some(trail.guess(x));
            *spot = self.spot(scaffold, x, f64::INFINITY, Search { start, is_rough });
            if let Some(spot) = spot {
                *trail = trail.moved(x, spot);
            }
        }
    }

    /// The planes around it.
    pub fn walls(&self) -> &Walls {
        &self.walls
    }

    /// d xi / d x and the centre of an affine element.
    fn affine(&self) -> Option<(&Mat3, &Vec3)> {
        match &self.inverse {
            Inverse::Affine { matrix, centre } => Some((matrix, centre)),
            Inverse::Curved { .. } => None,
        }
    }

    /// The element as one that four points at a time are looked for in, if it is one.
    fn curve<'a>(&self, scaffold: &'a Scaffold) -> Option<Curve<'a>> {
        Some(Curve {
            map: scaffold.element(self.number).polynomial()?,
            shape: self.shape,
        })
    }

    /// Where points are guessed from if nothing is known: the affine map at the centroid.
    #[inline]
    pub fn start(&self) -> Trail {
        let (Inverse::Affine { matrix, centre } | Inverse::Curved { matrix, centre }) =
            &self.inverse;
        Trail {
            x: *centre,
            xi: Vec3::zeros(),
            inverse: *matrix,
            bend: None,
        }
    }

    fn affine_spot(&self, xi: Vec3, inverse: Mat3, overshoot: f64) -> Spot {
        Spot {
            xi,
            inverse,
            beyond: self.shape.face_distance(CellPoint(xi)),
            overshoot,
        }
    }

    /// The spot of a point by the affine map, that at the centroid if the element is curved.
    fn by_affine_map(&self, x: Vec3) -> Spot {
        let Trail {
            x: centre, inverse, ..
        } = self.start();
        let overshoot = self.walls.outside::<f64>(x.into());
        self.affine_spot(inverse * (x - centre), inverse, overshoot)
    }

    /// The spot of any point, by the affine map at the centroid if all else fails.
    pub fn spot_anyway(&self, scaffold: &Scaffold, x: Vec3) -> Spot {
        self.spot(scaffold, x, f64::INFINITY, Search::default())
            .unwrap_or_else(|| self.by_affine_map(x))
    }

    /// Newton's method for the continued map: steps from points of the closed cell, clamped back.
    fn newton(&self, scaffold: &Scaffold, x: Vec3, guess: Vec3, is_rough: bool) -> Option<Spot> {
        const STEPS: usize = 40;
        let element = scaffold.element(self.number);
        let mut at = guess;
        for _ in 0..STEPS {
            let (p, jacobian) = element.map_and_jacobian(CellPoint(at));
            let inverse = jacobian.try_inverse()?;
            let xi = at + inverse * (x - p.0);
            let beyond = self.shape.face_distance(CellPoint(xi));
            let next = if beyond > 0.0 { self.clamp(xi) } else { xi };
            let moved = (next - at).amax();
            if is_settled(moved, beyond, is_rough) {
                let overshoot = if beyond > 0.0 { (x - p.0).norm() } else { 0.0 };
                return Some(Spot {
                    xi,
                    inverse,
                    beyond,
                    overshoot,
                });
            }
            at = next;
        }
        None
    }

    /// The closest point of the closed reference cell.
    pub fn clamp(&self, xi: Vec3) -> Vec3 {
        super::clamp::clamp_to_cell(self.shape, xi)
    }

    /// How deep a point of the element lies under its faces, world units: 0 on the faces.
    pub fn depth(&self, spot: &Spot) -> f64 {
        match &self.inverse {
            Inverse::Affine { .. } => (-spot.overshoot).max(0.0),
            Inverse::Curved { .. } => (-spot.beyond * self.least_stretch).max(0.0),
        }
    }

    /// The first step of points of the element towards the zero set.
    pub fn set_off(&self, scaffold: &Scaffold, pace: Pace, walkers: Walkers, legs: &mut [Leg]) {
        let curve = self.curve(scaffold);
        if self.is_affine() || curve.is_some() {
            return newton_distance::set_off(pace, curve, walkers, legs);
        }
        let Walkers {
            x,
            at,
            frame,
            slopes,
        } = walkers;
        let again = Walkers {
            x,
            at: &mut *at,
            frame,
            slopes,
        };
        newton_distance::set_off(pace, None, again, &mut *legs);
        for (n, at) in at.iter_mut().enumerate() {
            let (leg, lane) = (&mut legs[n / 4], n % 4);
            let end = x[n] + Vec3::from_fn(|r, _| leg.way[r][lane]);
            // One Newton step, from the clamped point so that the Jacobian is regular.
            let from = self.clamp(at.0);
            let (p, jacobian) = self.frame(scaffold, from);
            if let Some(inverse) = jacobian.try_inverse() {
                at.0 = from + inverse * (end - p);
                for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                    leg.by[r][c][lane] = inverse[(r, c)];
                }
            }
        }
    }

    /// How far a step may go in it.
    pub fn pace(&self, half_width: f64, voxel_size: f64) -> Pace {
        Pace::new(self.slope_rms, self.slope_sup, half_width, voxel_size)
    }

    /// By how much, in reference units, a trail errs at one of four points of a curved element at most;
    /// nothing is known of pyramids whose map is no polynomial.
    pub fn error(&self, scaffold: &Scaffold, trail: &Trail, points: [Vec3; 4]) -> f64 {
        if self.is_affine() {
            return 0.0;
        }
        self.curve(scaffold)
            .map_or(f64::INFINITY, |c| c.error(trail, points))
    }

    /// A trail from a point as the element has placed it.
    pub fn trail(&self, scaffold: &Scaffold, x: Vec3, spot: &Spot) -> Trail {
        let (xi, inverse) = (spot.xi, spot.inverse);
        Trail {
            x,
            xi,
            inverse,
            bend: self.curve(scaffold).map(|c| c.bend(xi, &inverse)),
        }
    }

    /// [`Self::depth`] of a point `x` whose reference coordinates are known.
    pub fn depth_at(&self, x: Vec3, xi: Vec3) -> f64 {
        let depth = match &self.inverse {
            Inverse::Affine { .. } => -self.walls.outside::<f64>(x.into()),
            Inverse::Curved { .. } => -self.shape.face_distance(CellPoint(xi)) * self.least_stretch,
        };
        depth.max(0.0)
    }

    /// Its number in the scaffold.
    #[inline]
    pub fn number(&self) -> usize {
        self.number
    }

    /// The world point of reference coordinates inside the element.
    pub fn point(&self, scaffold: &Scaffold, xi: Vec3) -> Vec3 {
        scaffold.element(self.number).map(CellPoint(xi)).0
    }

    /// The world point and the Jacobian at reference coordinates inside the element.
    pub fn frame(&self, scaffold: &Scaffold, xi: Vec3) -> (Vec3, Mat3) {
        let (p, jacobian) = scaffold
            .element(self.number)
            .map_and_jacobian(CellPoint(xi));
        (p.0, jacobian)
    }

    /// The greatest reference length per world length.
    pub fn finest(&self) -> f64 {
        1.0 / self.least_stretch
    }

    /// Whether the map is affine.
    #[inline]
    pub fn is_affine(&self) -> bool {
        matches!(self.inverse, Inverse::Affine { .. })
    }

    /// The reference element's shape.
    pub fn shape(&self) -> Element {
        self.shape
    }
}

/// Whether a step of Newton's method may be the last, which moved by this much in the closed cell and
/// found the point so far beyond it. Inside, convergence is quadratic: the next step would be the square
/// of this one. Outside it is linear, each step a small share (curvature times overshoot) of the last.
/// On the faces the last digit decides who owns a point.
pub(super) fn is_settled(moved: f64, beyond: f64, is_rough: bool) -> bool {
    let is_exact = beyond > 0.0 && !(is_rough && beyond > 1e-3);
    moved < if is_exact { 1e-9 } else { 1e-6 }
}
