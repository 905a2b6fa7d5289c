//! Samples outside the scaffold.

use super::Straight;
use super::block::Scene;
use super::sample_batch::{MOST, bits};
use crate::frame::{Aabb, Vec3};
use crate::tiling::boundary::Known;
use crate::tiling::locality::Local;
use crate::tiling::{Filling, TiledSolid};

/// Further outside all elements than this share of a voxel a point is not between two by rounding.
pub(super) const GAP: f64 = 1e-6;

/// A sample in no element.
#[derive(Clone, Copy)]
pub(super) struct Stray {
    pub n: usize,
    pub x: Vec3,
    pub part: usize,
}

impl<F: Filling> TiledSolid<'_, F> {
    /// The value at a sample, looked for by itself.
    pub(super) fn alone(&self, scene: &Scene, stray: &Stray, known: Known) -> f64 {
        let mut local = Local::new(scene.near.clone());
        self.value_at(scene.component, &mut local, stray.x, known)
    }

    /// Values outside the scaffold: at the closest points of its boundary, and not less than the distance
    /// to them where the boundary cuts.
    pub(super) fn fill_strays(&self, scene: &Scene, room: &mut Straight, out: &mut [f32]) {
        let w = self.options.half_width;
        let boundary = &self.components[scene.component].boundary;
        let strays = std::mem::take(&mut room.strays);
        for strays in strays.chunks(MOST) {
            room.bundle.clear();
            let mut feet = Aabb::EMPTY;
            let mut asked = [(0, 0.0); MOST];
            for (number, stray) in strays.iter().enumerate() {
                let closest = if self.is_cut() {
                    let known = scene.known(&room.parts[stray.part]);
                    let radius = w.min(known.distance * (1.0 + 1e-9));
                    known.closest_within(boundary, stray.x, radius)
                } else {
                    Some(boundary.closest(stray.x))
                };
                let Some(closest) = closest else {
                    out[stray.n] = w as f32;
                    continue;
                };
                let outside = match self.is_cut() {
                    true if closest.distance < self.on_boundary() => 0.0,
                    true => closest.distance,
                    false => -w,
                };
                asked[room.bundle.len()] = (number, outside);
                let q = closest.point;
                feet = feet.union(Aabb { min: q, max: q });
                room.bundle.push(q.into(), true);
            }
            room.bundle.fill_up();
            if room.bundle.len() == 0 {
                continue;
            }
            let (centre, half) = (feet.centre().0, feet.size() / 2.0);
            room.places.clear();
            for (place, &e) in (0..).zip(&scene.near.patches) {
                if !self.patches[e as usize].misses(centre, half, self.delta()) {
                    room.places.push(place);
                }
            }
            let near = (scene.near, &*room.places);
            self.rule_q(near, &room.bundle, scene.wanted, &mut room.samples);
            room.looked += u64::from(room.samples.owned.count_ones());
            for n in bits(room.bundle.real) {
                let (number, outside) = asked[n];
                let stray = &strays[number];
                out[stray.n] = if room.samples.owned >> n & 1 != 0 {
                    room.samples.found.d(n).max(outside).min(w) as f32
                } else {
                    self.alone(scene, stray, scene.known(&room.parts[stray.part])) as f32
                };
            }
        }
        room.strays = strays;
        room.strays.clear();
    }
}
