//! Distances of 2^3 voxels from their nearest points.
// Inlined so that the code is compiled for its caller's target features; closures with SIMD arithmetic would
// not be.
#![allow(clippy::inline_always)]

use super::candidates::{Cube, List, Middle, Reach};
use super::surface_points::{NO_WEDGE, Point};
use super::wedge::Wedge;
use crate::simd::{Lanes, SimdKernel};

/// Lower bound of 1 + h k: beyond the centre of curvature other points are nearer.
pub(super) const MIN_SPREAD: f32 = 0.3;
/// Greatest reduction of the distance to the tangent plane by curvature, voxels.
pub(super) const MAX_CURVATURE_REDUCTION: f32 = 0.25;
/// Greatest tangential distance of the nearest point on a smooth surface, voxels: points are closer to each
/// other than this. At twice this distance the point lies on an edge, which has no tangent plane.
pub(super) const MAX_TANGENTIAL: f32 = 1.0;

/// Lengths of an offset.
#[derive(Clone, Copy)]
pub(super) struct Move {
    /// Offset outwards, voxels.
    pub by: f32,
    /// Half width of the band, voxels.
    pub half_width: f32,
    /// Voxel size, world units.
    pub voxel_size: f32,
    /// Background, world units.
    pub background: f32,
}

impl Move {
    /// Greatest distance, voxels, of a relevant point from a group of voxels; not positive if there is none.
    /// `inside` holds the inside voxels of the group, whose voxels are the bits of `all`.
    pub fn most<const N: usize>(&self, inside: [u64; N], all: u64) -> f32 {
        let outside = self.half_width + self.by;
        let within = self.half_width - self.by;
        if inside == [all; N] {
            within
        } else if inside == [0; N] {
            outside
        } else {
            within.max(outside)
        }
    }
}

/// Computes the values of 2^3 voxels, and a bit for each within the band, from the points of a list that may be
/// nearest to one of them; none if there are none.
pub(super) struct Block<'a> {
    /// Padded to a multiple of eight.
    pub list: &'a List,
    pub points: &'a [Point],
    pub wedges: &'a [Wedge],
    /// The least voxel.
    pub first: [usize; 3],
    /// Greatest distance of a relevant point, voxels.
    pub most: f32,
    /// A bit for each voxel inside.
    pub inside: u8,
    pub lengths: Move,
}

impl Block<'_> {
    /// The nearest point to each voxel: squared distances, and indices in the list.
    #[inline(always)]
    fn nearest<L: Lanes>(&self, l: L, [x, y, z]: [L::F; 3]) -> (L::F, L::F) {
        let cube = Cube::new(self.first, 2);
        let reach = Reach {
            cube,
            middle: Middle::of(l, self.list.places(), cube),
            most: self.most,
        };
        let (mut least, mut place) = (l.splat(f32::INFINITY), l.splat(0.0));
        let [xs, ys, zs] = &self.list.at;
        let xs = xs.as_chunks::<8>().0.iter();
        let rest = ys.as_chunks::<8>().0.iter().zip(zs.as_chunks::<8>().0);
        let mut number = 0;
        for (px, (py, pz)) in xs.zip(rest) {
            let mut bits = reach.holds(l, [px, py, pz]);
            while bits != 0 {
                let n = bits.trailing_zeros() as usize & 7;
                bits &= bits - 1;
                let dx = l.sub(x, l.splat(px[n]));
                let dy = l.sub(y, l.splat(py[n]));
                let dz = l.sub(z, l.splat(pz[n]));
                let square = l.fused(dx, dx, l.fused(dy, dy, l.mul(dz, dz)));
                let here = l.splat((number + n as i32) as f32);
                place = l.select_below(square, least, here, place);
                least = l.min(square, least);
            }
            number += 8;
        }
        (least, place)
    }
}

impl SimdKernel for Block<'_> {
    type Output = Option<([f32; 8], u8)>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let [a, b, c] = self.first;
        let [a, b, c] = [a as f32, b as f32, c as f32];
        let x = l.load(&[a, a, a, a, a + 1.0, a + 1.0, a + 1.0, a + 1.0]);
        let y = l.load(&[b, b, b + 1.0, b + 1.0, b, b, b + 1.0, b + 1.0]);
        let z = l.load(&[c, c + 1.0, c, c + 1.0, c, c + 1.0, c, c + 1.0]);
        let (square, place) = self.nearest(l, [x, y, z]);
        if l.below(square, l.splat(f32::INFINITY)) == 0 {
            return None;
        }
        let mut places = [0.0; 8];
        l.store(place, &mut places);
        let mut at = [[0.0; 8]; 3];
        let mut normal = [[0.0; 8]; 3];
        let mut bend = [[0.0; 8]; 6];
        let mut sign = [1.0; 8];
        let mut is_sharp = false;
        for n in 0..8 {
            let place = places[n] as usize;
            let point = &self.points[self.list.of[place] as usize];
            for a in 0..3 {
                at[a][n] = self.list.at[a][place];
                normal[a][n] = point.normal[a];
            }
            for a in 0..6 {
                bend[a][n] = point.bend[a];
            }
            is_sharp |= point.wedge != NO_WEDGE;
            if self.inside >> n & 1 == 1 {
                sign[n] = -1.0;
            }
        }
        let [ax, ay, az] = &at;
        let away = [
            l.sub(x, l.load(ax)),
            l.sub(y, l.load(ay)),
            l.sub(z, l.load(az)),
        ];
        let d = distances(l, (&normal, &bend), away, square, l.load(&sign));
        let d = if is_sharp {
            let mut sizes = [0.0; 8];
            l.store(d, &mut sizes);
            for n in 0..8 {
                let place = places[n] as usize;
                let wedge = self.points[self.list.of[place] as usize].wedge;
                if wedge == NO_WEDGE {
                    continue;
                }
                let voxel = [n >> 2, n >> 1 & 1, n & 1];
                let mut from = [0.0; 3];
                for a in 0..3 {
                    from[a] = (self.first[a] + voxel[a]) as f32 - at[a][n];
                }
                let size = self.wedges[wedge as usize].distance(from) * sign[n];
                sizes[n] = sign[n] * size.max(0.0);
            }
            l.load(&sizes)
        } else {
            d
        };
        let Move {
            by,
            voxel_size,
            background,
            ..
        } = self.lengths;
        let v = l.mul(l.sub(d, l.splat(by)), l.splat(voxel_size));
        let v = l.min(l.max(v, l.splat(-background)), l.splat(background));
        let mut values = [0.0; 8];
        l.store(v, &mut values);
        Some((values, l.below(l.magnitude(v), l.splat(background))))
    }
}

/// The signed distances, voxels, of voxels from their displacements to their nearest points and their signs.
#[inline(always)]
fn distances<L: Lanes>(
    l: L,
    (normal, bend): (&[[f32; 8]; 3], &[[f32; 8]; 6]),
    [x, y, z]: [L::F; 3],
    square: L::F,
    sign: L::F,
) -> L::F {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let [nx, ny, nz] = [l.load(&normal[0]), l.load(&normal[1]), l.load(&normal[2])];
    let height = l.fused(x, nx, l.fused(y, ny, l.mul(z, nz)));
    let back = l.sub(zero, height);
    let across = l.max(l.fused(back, height, square), zero);
    let tx = l.fused(back, nx, x);
    let ty = l.fused(back, ny, y);
    let tz = l.fused(back, nz, z);
    // k |t|^2
    let [xx, yy, zz] = [l.load(&bend[0]), l.load(&bend[1]), l.load(&bend[2])];
    let [xy, yz, zx] = [l.load(&bend[3]), l.load(&bend[4]), l.load(&bend[5])];
    let two = l.splat(2.0);
    let bent_x = l.fused(xx, tx, l.mul(two, l.mul(xy, ty)));
    let bent_y = l.fused(yy, ty, l.mul(two, l.mul(yz, tz)));
    let bent_z = l.fused(zz, tz, l.mul(two, l.mul(zx, tx)));
    let bent = l.fused(tx, bent_x, l.fused(ty, bent_y, l.mul(tz, bent_z)));
    let curvature = l.select_below(l.splat(1e-12), across, l.div(bent, across), zero);
    let spread = l.max(l.fused(height, curvature, one), l.splat(MIN_SPREAD));
    let more = l.mul(l.splat(0.5), l.div(bent, spread));
    let more = l.min(l.max(more, l.splat(-MAX_CURVATURE_REDUCTION)), one);
    // A voxel on the other side of the surface than its sign is set to distance zero.
    let size = l.max(l.mul(l.add(height, more), sign), zero);
    let straight = l.sqrt(square);
    let size = l.min(size, straight);
    let edge = l.sub(l.mul(l.sqrt(across), l.splat(1.0 / MAX_TANGENTIAL)), one);
    let edge = l.min(l.max(edge, zero), one);
    l.mul(sign, l.fused(edge, l.sub(straight, size), size))
}
