//! Selection of faces by conditions on number, position and history.
//!
//! | name | meaning |
//! |---|---|
//! | `index`, `group`, `sides`, `area`, `edge`, `residual` | number from 0, group, corners, area, mean edge, distance from its plane |
//! | `normal.x` ..., `centre.x` ... | unit normal, mean of the corners |
//! | `near(x, y, z)` | the face nearest to a point |
//! | `ray(x, y, z, dx, dy, dz)` | the first face that a ray meets |
//! | `all`, `last`, `top` | every face; those of the last operation; the tops of the last extrusion, or the highest faces |

use super::PolyMesh;
use super::expression::{Expression, ExpressionError, Value};
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::{MeshSolid, TriMesh};
use std::cell::RefCell;
use std::collections::HashMap;

/// The mesh and history that a selection is evaluated on; nothing here changes them.
pub(super) struct Scene<'a> {
    pub mesh: &'a PolyMesh,
    /// The first face of the last operation.
    pub last: usize,
    /// Tops of the last extrusion.
    pub tops: &'a [usize],
    /// Parameters of the script.
    pub parameters: &'a dyn Fn(&str) -> Option<f64>,
}

impl Scene<'_> {
    /// Evaluates a condition for every face: one flag per face. An error for an unknown name or a number instead of a
    /// condition.
    pub fn choose(&self, condition: &Expression) -> Result<Vec<bool>, ExpressionError> {
        let cache = SearchCache::default();
        (0..self.mesh.face_count())
            .map(|f| condition.truth(&|name, arguments| self.resolve(f, name, arguments, &cache)))
            .collect()
    }

    /// The value of a name, or of a function with its arguments, for face `f`; `None` for an unknown one.
    fn resolve(
        &self,
        f: usize,
        name: &str,
        arguments: Option<&[f64]>,
        cache: &SearchCache,
    ) -> Option<Value> {
        let mesh = self.mesh;
        // Names without arguments: numbers of the face, and parameters of the script.
        let Some(arguments) = arguments else {
            let axis = |v: Vec3, part: &str| {
                let place = ["x", "y", "z"].iter().position(|a| *a == part)?;
                Some(Value::Number(v[place]))
            };
            if let Some(part) = name.strip_prefix("normal.") {
                return axis(mesh.normal(f), part);
            }
            if let Some(part) = name
                .strip_prefix("centre.")
                .or(name.strip_prefix("center."))
            {
                return axis(mesh.centre(f), part);
            }
            let number = match name {
                "index" => f as f64,
                "group" => f64::from(mesh.groups()[f]),
                "sides" => mesh.face(f).len() as f64,
                "area" => mesh.face_area(f),
                "residual" => mesh.residual(f),
                "edge" => {
                    let p = mesh.points(f);
                    let pairs = p.iter().zip(p.iter().cycle().skip(1));
                    pairs.map(|(a, b)| (b - a).norm()).sum::<f64>() / p.len() as f64
                }
                "all" => return Some(Value::Truth(true)),
                "last" => return Some(Value::Truth(f >= self.last)),
                "top" => return Some(Value::Truth(self.is_top(f, cache))),
                _ => return (self.parameters)(name).map(Value::Number),
            };
            return Some(Value::Number(number));
        };
        // `near` and `ray` have the same answer for every face: the cache keeps it, by the length of the name and the bits
        // of the arguments.
        let face = match (name, arguments) {
            ("near", [_, _, _]) | ("ray", [_, _, _, _, _, _]) => {
                let key = (name.len(), arguments.iter().map(|a| a.to_bits()).collect());
                let known = cache.faces.borrow().get(&key).copied();
                known.unwrap_or_else(|| {
                    let face = pick(mesh, arguments);
                    cache.faces.borrow_mut().insert(key, face);
                    face
                })
            }
            _ => return None,
        };
        Some(Value::Truth(face == Some(f)))
    }

    /// Whether a face is a top of the last extrusion; without one, whether its centre has the greatest z, up to 1e-9 of
    /// the mesh's size.
    fn is_top(&self, f: usize, cache: &SearchCache) -> bool {
        if !self.tops.is_empty() {
            return self.tops.contains(&f);
        }
        let highest = *cache.highest.borrow_mut().get_or_insert_with(|| {
            let heights = (0..self.mesh.face_count()).map(|f| self.mesh.centre(f).z);
            heights.fold(f64::NEG_INFINITY, f64::max)
        });
        let size = self.mesh.bounds().half_diagonal();
        self.mesh.centre(f).z > highest - 1e-9 * size
    }
}

/// Faces found by `near` and `ray`, keyed by the length of the name and the bits of the arguments.
type FaceCache = HashMap<(usize, Vec<u64>), Option<usize>>;

/// Results of searches, so that each is made once per selection.
#[derive(Default)]
struct SearchCache {
    faces: RefCell<FaceCache>,
    highest: RefCell<Option<f64>>,
}

/// The nearest face to a point (three numbers), or the first on a ray from a point along a direction (six); `None`
/// where the ray meets none or the mesh has no triangles.
fn pick(mesh: &PolyMesh, arguments: &[f64]) -> Option<usize> {
    let cut = mesh.triangulated().ok()?;
    let vector = |k: usize| Vec3::new(arguments[k], arguments[k + 1], arguments[k + 2]);
    let triangle = if arguments.len() == 3 {
        let closest = MeshSolid::new(cut.mesh).closest(vector(0));
        Some(closest.triangle as usize)
    } else {
        first_on_ray(&cut.mesh, vector(0), vector(3))
    };
    Some(*cut.faces.get(triangle?)? as usize)
}

/// The first triangle that a ray from `origin` along `direction` (of any length) meets, from either side; `None` where
/// it meets none. Triangles edge-on, up to 1e-14, are passed (Moeller and Trumbore 1997).
pub(super) fn first_on_ray(mesh: &TriMesh, origin: Vec3, direction: Vec3) -> Option<usize> {
    let mut best: Option<(f64, usize)> = None;
    for (t, [a, b, c]) in mesh.iter_corners().enumerate() {
        let (u, v) = (b - a, c - a);
        let p = direction.cross(&v);
        let determinant = u.dot(&p);
        if determinant.abs() < 1e-14 * u.norm() * v.norm() * direction.norm() {
            continue;
        }
        let s = (origin - a).dot(&p) / determinant;
        let q = (origin - a).cross(&u);
        let r = direction.dot(&q) / determinant;
        let along = v.dot(&q) / determinant;
        let inside = s >= 0.0 && r >= 0.0 && s + r <= 1.0 && along >= 0.0;
        if inside && best.is_none_or(|(d, _)| along < d) {
            best = Some((along, t));
        }
    }
    best.map(|(_, t)| t)
}
