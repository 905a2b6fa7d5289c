//! One element of the scaffold with its cell: inverse map, slope bounds, distance to its faces.
//!
//! Outside an element its map is continued, so that the cell's field is defined beyond it; [`Preimage`] holds the rule.
//! The inverse is in closed form for affine elements and by Newton's method for curved ones, which may fail: then the
//! result is `None`, and the caller chooses the fallback.

use super::Filling;
use super::boundary_distance::BoundingPlanes;
use super::inverse_map::{CurvedMap, convergence_tolerance};
use super::local_map::LocalMap;
use super::newton_distance::{StepLimits, StepMap};
use crate::scaffold::Scaffold;
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use std::sync::OnceLock;

/// Points within this distance of a face, in reference units, belong to the element.
pub(super) const FACE_TOLERANCE: f64 = 1e-9;

/// The inverse of an element's map.
enum Inverse {
    /// `xi = matrix (x - centre)`.
    Affine { matrix: Mat3, centre: Vec3 },
    /// By Newton's method, from the affine map at the reference origin.
    Curved { matrix: Mat3, centre: Vec3 },
}

/// An element with the data that the distance rules need.
pub(super) struct Patch {
    number: usize,
    shape: Element,
    inverse: Inverse,
    planes: BoundingPlanes,
    /// L: bound of |grad F|, per world unit, over the points of the element where |F| <= L times the distance
    /// [`near_surface_distance`](super::locality::near_surface_distance); infinite if no bound is proved.
    pub slope_sup: f64,
    /// Bound of |grad F| over the whole element.
    pub slope_sup_anywhere: f64,
    /// gamma: root mean square of |grad F| on the surface, by the map at the reference origin alone.
    pub slope_rms: f64,
    /// Least stretch of the map: world length per reference length.
    least_stretch: f64,
    /// [`CurvedMap::expansion_factor`], 0 in affine elements.
    expansion_factor: f64,
}

/// Start and tolerance of Newton's method in a curved element.
#[derive(Clone, Copy, Default)]
pub(super) struct InverseOptions {
    /// Where Newton's method starts.
    pub start: Option<Vec3>,
    /// Whether the result is for values in single precision, see [`convergence_tolerance`].
    pub for_f32: bool,
}

/// The preimage of a point under the continued map of an element. Outside the element the map is continued
/// linearly from the nearest point of the closed reference cell, so that it is continuous at the faces. (An
/// affine map is its own continuation.)
#[derive(Clone, Copy)]
pub(super) struct Preimage {
    /// Reference coordinates by the continued map.
    pub xi: Vec3,
    /// d xi / d x there.
    pub inverse: Mat3,
    /// Largest signed distance to the faces in reference coordinates; at most 0 inside.
    pub face_distance: f64,
    /// m(x): distance outside the element, world units; continuous, at most 0 inside. For affine elements it is
    /// the largest signed distance to the planes of the faces, for curved ones the distance from the point of
    /// the element where the continuation starts.
    pub outside_distance: f64,
}

/// The reference vertices, computed once for each of the seven shapes.
fn vertices(shape: Element) -> &'static [Vec3] {
    static ALL: [OnceLock<Vec<Vec3>>; 7] = [const { OnceLock::new() }; 7];
    ALL[shape as usize].get_or_init(|| shape.vertices())
}

impl Patch {
    /// Prepares element `number` of a filled scaffold. Slopes count as near the surface up to the distance
    /// `reach`, world units.
    pub fn new(scaffold: &Scaffold, filling: &dyn Filling, number: usize, reach: f64) -> Self {
        let element = scaffold.element(number);
        let shape = element.shape();
        // The affine map that agrees at the origin; curved elements start Newton's method with it. A singular Jacobian
        // gives the zero matrix: the start is then the origin, and the planes exclude nothing.
        let (centre, jacobian) = element.map_and_jacobian(CellPoint(Vec3::zeros()));
        let matrix = jacobian.try_inverse().unwrap_or_else(Mat3::zeros);
        let centre = centre.0;
        let least_stretch = element.stretch().0.max(0.0);
        // Slopes by world units are at most those by reference units over the least stretch.
        let per_world = |slope: f64| {
            if least_stretch > 0.0 {
                slope / least_stretch
            } else {
                f64::INFINITY
            }
        };
        let controls = element.control_points();
        let planes = BoundingPlanes::new(shape, &matrix, &controls, element.bounds());
        Self {
            number,
            shape,
            inverse: if element.is_affine() {
                Inverse::Affine { matrix, centre }
            } else {
                Inverse::Curved { matrix, centre }
            },
            planes,
            slope_sup: per_world(filling.gradient_sup_near(number, reach / least_stretch)),
            slope_sup_anywhere: per_world(filling.gradient_sup(number)),
            // The Frobenius norm over sqrt 3 is the root mean square stretch over all directions.
            slope_rms: filling.gradient_rms(number) * matrix.norm() / 3f64.sqrt(),
            least_stretch,
            expansion_factor: if element.is_affine() {
                0.0
            } else {
                CurvedMap::new(element).expansion_factor()
            },
        }
    }

    /// Whether a point is certainly more than `margin` outside.
    fn is_farther_outside(&self, x: Vec3, margin: f64) -> bool {
        self.planes.outside_distance::<f64>(x.into()) > margin
    }

    /// Whether a point is certainly more than `margin` inside.
    #[inline]
    pub fn is_deeper_inside(&self, x: Vec3, margin: f64) -> bool {
        self.is_affine() && self.planes.outside_distance::<f64>(x.into()) < -margin
    }

    /// A lower bound of a point's distance to the plane of a face; 0 in curved elements, whose faces have none.
    pub fn face_distance(&self, face: usize, x: Vec3) -> f64 {
        match self.inverse {
            Inverse::Affine { .. } => self.planes.face_distance(face, x),
            Inverse::Curved { .. } => 0.0,
        }
    }

    /// Whether every point of a box is certainly more than `margin` outside, by the measure m.
    #[inline]
    pub fn is_box_outside(&self, centre: Vec3, half: Vec3, margin: f64) -> bool {
        self.planes.is_box_outside(centre, half, margin)
    }

    /// The preimage of `x`, if it may be less than `margin` world units outside. `None` if it is farther out, or if
    /// Newton's method fails from the estimate, the reference origin and all vertices.
    pub fn preimage(
        &self,
        scaffold: &Scaffold,
        x: Vec3,
        margin: f64,
        options: InverseOptions,
    ) -> Option<Preimage> {
        if self.is_farther_outside(x, margin) {
            return None;
        }
        match &self.inverse {
            Inverse::Affine { .. } => Some(self.affine_preimage(x)),
            Inverse::Curved { matrix, centre } => {
                let estimate = options.start.unwrap_or_else(|| matrix * (x - centre));
                let from = |start: Vec3| self.newton(scaffold, x, start, options.for_f32);
                from(self.clamp(estimate))
                    .or_else(|| from(Vec3::zeros()))
                    .or_else(|| vertices(self.shape).iter().copied().find_map(from))
            }
        }
    }

    /// The preimage of `x`, if it is inside the element and off its faces. `None` also if Newton's method fails from
    /// the first estimate.
    pub fn interior_preimage(
        &self,
        scaffold: &Scaffold,
        x: Vec3,
        options: InverseOptions,
    ) -> Option<Preimage> {
        let preimage = match &self.inverse {
            Inverse::Affine { .. } => self.affine_preimage(x),
            Inverse::Curved { matrix, centre } => {
                if self.is_farther_outside(x, 0.0) {
                    return None;
                }
                let estimate = options.start.unwrap_or_else(|| matrix * (x - centre));
                self.newton(scaffold, x, self.clamp(estimate), options.for_f32)?
            }
        };
        (preimage.face_distance < -FACE_TOLERANCE).then_some(preimage)
    }

    /// The bounding planes of the element.
    pub fn planes(&self) -> &BoundingPlanes {
        &self.planes
    }

    /// The map of a curved element.
    pub fn curved_map<'a>(&self, scaffold: &'a Scaffold) -> Option<CurvedMap<'a>> {
        (!self.is_affine()).then(|| CurvedMap::new(scaffold.element(self.number)))
    }

    /// The map for the ends of Newton steps.
    pub fn step_map<'a>(&self, scaffold: &'a Scaffold) -> StepMap<'a> {
        self.curved_map(scaffold).map_or_else(
            || StepMap::Affine(self.origin_map().inverse),
            StepMap::Curved,
        )
    }

    /// The affine map at the reference origin: the start where no local map is known.
    #[inline]
    pub fn origin_map(&self) -> LocalMap {
        let (Inverse::Affine { matrix, centre } | Inverse::Curved { matrix, centre }) =
            &self.inverse;
        LocalMap {
            x: *centre,
            xi: Vec3::zeros(),
            inverse: *matrix,
            second_derivatives: None,
        }
    }

    fn preimage_of(&self, xi: Vec3, inverse: Mat3, outside_distance: f64) -> Preimage {
        Preimage {
            xi,
            inverse,
            face_distance: self.shape.face_distance(CellPoint(xi)),
            outside_distance,
        }
    }

    /// The preimage of a point by the affine map; that at the reference origin if the element is curved.
    fn affine_preimage(&self, x: Vec3) -> Preimage {
        let LocalMap {
            x: centre, inverse, ..
        } = self.origin_map();
        let outside_distance = self.planes.outside_distance::<f64>(x.into());
        self.preimage_of(inverse * (x - centre), inverse, outside_distance)
    }

    /// The preimage of any point, by the affine map at the reference origin if Newton's method fails.
    pub fn preimage_or_affine(&self, scaffold: &Scaffold, x: Vec3) -> Preimage {
        self.preimage(scaffold, x, f64::INFINITY, InverseOptions::default())
            .unwrap_or_else(|| self.affine_preimage(x))
    }

    /// Newton's method for the continued map, from `estimate`, reference coordinates. Each step starts at a point of
    /// the closed cell; the last one may end outside, where the map is continued linearly. `None` after 40 steps or at
    /// a singular Jacobian.
    fn newton(
        &self,
        scaffold: &Scaffold,
        x: Vec3,
        estimate: Vec3,
        for_f32: bool,
    ) -> Option<Preimage> {
        const STEPS: usize = 40;
        let element = scaffold.element(self.number);
        // J^-1 is that of the clamped point: beyond the cell the map is linear.
        let mut at = estimate;
        for _ in 0..STEPS {
            let (p, jacobian) = element.map_and_jacobian(CellPoint(at));
            let inverse = jacobian.try_inverse()?;
            let xi = at + inverse * (x - p.0);
            let face_distance = self.shape.face_distance(CellPoint(xi));
            let next = if face_distance > 0.0 {
                self.clamp(xi)
            } else {
                xi
            };
            let moved = (next - at).amax();
            if moved < convergence_tolerance(face_distance, for_f32) {
                let outside_distance = if face_distance > 0.0 {
                    (x - p.0).norm()
                } else {
                    0.0
                };
                return Some(Preimage {
                    xi,
                    inverse,
                    face_distance,
                    outside_distance,
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

    /// Depth of a point of the element below its faces, world units; 0 on the faces.
    pub fn depth(&self, preimage: &Preimage) -> f64 {
        match &self.inverse {
            Inverse::Affine { .. } => (-preimage.outside_distance).max(0.0),
            Inverse::Curved { .. } => (-preimage.face_distance * self.least_stretch).max(0.0),
        }
    }

    /// Limits of the Newton steps in the element.
    pub fn limits(&self, half_width: f64, voxel_size: f64) -> StepLimits {
        StepLimits::new(self.slope_rms, self.slope_sup, half_width, voxel_size)
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
    pub fn point_and_jacobian(&self, scaffold: &Scaffold, xi: Vec3) -> (Vec3, Mat3) {
        let (p, jacobian) = scaffold
            .element(self.number)
            .map_and_jacobian(CellPoint(xi));
        (p.0, jacobian)
    }

    /// The greatest reference length per world length.
    pub fn max_compression(&self) -> f64 {
        1.0 / self.least_stretch
    }

    /// The least world length per reference length.
    pub fn least_stretch(&self) -> f64 {
        self.least_stretch
    }

    /// [`CurvedMap::expansion_factor`], per square world unit.
    pub fn expansion_factor(&self) -> f64 {
        self.expansion_factor
    }

    /// Whether the map is affine.
    #[inline]
    pub fn is_affine(&self) -> bool {
        matches!(self.inverse, Inverse::Affine { .. })
    }

    pub fn shape(&self) -> Element {
        self.shape
    }
}
