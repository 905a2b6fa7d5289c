//! Distances of 2^3 samples from their nearest points.
//!
//! The eight samples are the eight lanes of a row. Lengths are in voxels from the leaf's first sample until the last
//! step, which turns them into world units. The formula is that in the head of [`super`].
// Inlined so that the code is compiled for its caller's target features; closures with SIMD arithmetic would not be.
#![allow(clippy::inline_always)]

use super::candidates::{CandidateTest, Cube, NearestToCentre, PointList};
use super::surface_points::{NO_WEDGE, Point};
use super::wedge::Wedge;
use druse_geometry::simd::{Lanes, SimdKernel};

/// Lower bound of 1 + h k (see [`super`]): beyond the centre of curvature other points are nearer.
pub(super) const MIN_CURVATURE_FACTOR: f32 = 0.3;
/// Greatest reduction of the distance to the tangent plane by curvature, voxels.
pub(super) const MAX_CURVATURE_REDUCTION: f32 = 0.25;
/// Greatest tangential distance of the nearest point on a smooth surface, voxels: points are closer to each
/// other than this. From here to twice this the distance blends to that to the point, which then lies on an edge.
pub(super) const MAX_TANGENTIAL: f32 = 1.0;
/// Greatest shortfall, voxels: how much nearer than the nearest point the surface may be. In a cell of the lattice
/// that the surface crosses, a point lies at most sqrt(3) from any position. Values of neighbours then differ by
/// less than 3 voxels, the least half width of a band, so that two of different sign are both active.
pub(super) const MAX_SHORTFALL: f32 = 1.9;

#[derive(Clone, Copy)]
pub(super) struct OffsetLengths {
    /// Offset outwards, voxels.
    pub by: f32,
    /// Half width of the band, voxels.
    pub half_width: f32,
    /// Voxel size, world units.
    pub voxel_size: f32,
    /// Background, world units.
    pub background: f32,
    /// Distance between neighbouring samples, voxels.
    pub spacing: f32,
}

impl OffsetLengths {
    /// Largest distance, voxels, at which a point affects a group of samples; not positive if none does. `all` has a
    /// bit for each sample of the group, `inside` for those inside. A sample at the distance d gets the value d - by
    /// outside and -d - by inside, which must be less than the half width in magnitude.
    pub fn max_distance<const N: usize>(&self, inside: [u64; N], all: u64) -> f32 {
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

/// Computes the values of 2^3 samples, and a bit for each within the band, from the points of a list that may be
/// nearest to one of them. `None` if no point is near enough.
pub(super) struct Block<'a> {
    /// Padded to a multiple of eight.
    pub list: &'a PointList,
    pub points: &'a [Point],
    pub wedges: &'a [Wedge],
    /// The least sample, counted from the leaf's first.
    pub first: [usize; 3],
    /// Greatest distance of a relevant point, voxels.
    pub max_distance: f32,
    /// A bit for each sample inside.
    pub inside: u8,
    pub lengths: OffsetLengths,
}

impl Block<'_> {
    /// The nearest point to each sample, whose coordinates are the last parameter: its squared distance, voxels, and
    /// its index in the list as a float. Where no point is accepted, the square is infinite and the index 0.
    #[inline(always)]
    fn nearest<L: Lanes>(&self, l: L, [x, y, z]: [L::F; 3]) -> (L::F, L::F) {
        // Only points that may be nearest to one of the eight samples are measured, see [`CandidateTest`].
        let cube = Cube::new(self.first, 2, self.lengths.spacing);
        let test = CandidateTest {
            cube,
            nearest_to_centre: NearestToCentre::of(l, self.list.coordinates(), cube),
            max_distance: self.max_distance,
        };
        let (mut least, mut place) = (l.splat(f32::INFINITY), l.splat(0.0));
        let [xs, ys, zs] = &self.list.at;
        let xs = xs.as_chunks::<8>().0.iter();
        let rest = ys.as_chunks::<8>().0.iter().zip(zs.as_chunks::<8>().0);
        let mut number = 0;
        for (px, (py, pz)) in xs.zip(rest) {
            let mut bits = test.accepts(l, [px, py, pz]);
            // Each point against all eight samples; the first of equal distances stays.
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

    /// Values are in world units, clamped to the background, z fastest, then y; bit n of the byte is set if value n
    /// is within the band. A point is measured against all eight samples, so that either all of them have a nearest
    /// point or none has.
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        // The eight lanes are the samples of a cube, z fastest.
        let [a, b, c] = self.first;
        let spacing = self.lengths.spacing;
        let [a, b, c] = [spacing * a as f32, spacing * b as f32, spacing * c as f32];
        let [d, e, f] = [a + spacing, b + spacing, c + spacing];
        let x = l.load(&[a, a, a, a, d, d, d, d]);
        let y = l.load(&[b, b, e, e, b, b, e, e]);
        let z = l.load(&[c, f, c, f, c, f, c, f]);
        let (square, place) = self.nearest(l, [x, y, z]);
        if l.below(square, l.splat(f32::INFINITY)) == 0 {
            return None;
        }
        let mut places = [0.0; 8];
        l.store(place, &mut places);
        let mut at = [[0.0; 8]; 3];
        let mut normal = [[0.0; 8]; 3];
        let mut hessian = [[0.0; 8]; 6];
        let mut sign = [1.0; 8];
        let mut is_sharp = false;
        // Each lane gets the position, normal and Hessian of its nearest point.
        for n in 0..8 {
            let place = places[n] as usize;
            let point = &self.points[self.list.numbers[place] as usize];
            for a in 0..3 {
                at[a][n] = self.list.at[a][place];
                normal[a][n] = point.normal[a];
            }
            for a in 0..6 {
                hessian[a][n] = point.hessian[a];
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
        let d = distances(l, &normal, &hessian, away, square, l.load(&sign));
        // Lanes at sharp edges take the closed form of their planes, at least |x - q| less the shortfall.
        let d = if is_sharp {
            let (mut sizes, mut squares) = ([0.0; 8], [0.0; 8]);
            l.store(d, &mut sizes);
            l.store(square, &mut squares);
            for n in 0..8 {
                let place = places[n] as usize;
                let wedge = self.points[self.list.numbers[place] as usize].wedge;
                if wedge == NO_WEDGE {
                    continue;
                }
                let sample = [n >> 2, n >> 1 & 1, n & 1];
                let mut from = [0.0; 3];
                for a in 0..3 {
                    from[a] = spacing * (self.first[a] + sample[a]) as f32 - at[a][n];
                }
                let size = self.wedges[wedge as usize].distance(from) * sign[n];
                let least = (squares[n].sqrt() - MAX_SHORTFALL).max(0.0);
                sizes[n] = sign[n] * size.max(least);
            }
            l.load(&sizes)
        } else {
            d
        };
        let OffsetLengths {
            by,
            voxel_size,
            background,
            ..
        } = self.lengths;
        // The offset surface: (d - by) h, clamped to the band.
        let v = l.mul(l.sub(d, l.splat(by)), l.splat(voxel_size));
        let v = l.min(l.max(v, l.splat(-background)), l.splat(background));
        let mut values = [0.0; 8];
        l.store(v, &mut values);
        Some((values, l.below(l.magnitude(v), l.splat(background))))
    }
}

/// The signed distances, voxels, of samples from their displacements to their nearest points, the squares of these and
/// the samples' signs. `normal` and `hessian` are those of the points, by component. The components of a Hessian are
/// xx, yy, zz, xy, yz, zx. Displacements run from the point to the sample, and the sign is -1 inside.
#[inline(always)]
fn distances<L: Lanes>(
    l: L,
    normal: &[[f32; 8]; 3],
    hessian: &[[f32; 8]; 6],
    [x, y, z]: [L::F; 3],
    square: L::F,
    sign: L::F,
) -> L::F {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let [nx, ny, nz] = [l.load(&normal[0]), l.load(&normal[1]), l.load(&normal[2])];
    // h = x.n, |t|^2 = |x|^2 - h^2 and t = x - h n.
    let height = l.fused(x, nx, l.fused(y, ny, l.mul(z, nz))); // h
    let back = l.sub(zero, height); // -h
    let tangential_square = l.max(l.fused(back, height, square), zero); // |t|^2
    let tx = l.fused(back, nx, x); // t
    let ty = l.fused(back, ny, y);
    let tz = l.fused(back, nz, z);
    // k |t|^2 = t.H t: each mixed term counts twice, in the row of its first axis.
    let [xx, yy, zz] = [
        l.load(&hessian[0]),
        l.load(&hessian[1]),
        l.load(&hessian[2]),
    ];
    let [xy, yz, zx] = [
        l.load(&hessian[3]),
        l.load(&hessian[4]),
        l.load(&hessian[5]),
    ];
    let two = l.splat(2.0);
    let bent_x = l.fused(xx, tx, l.mul(two, l.mul(xy, ty)));
    let bent_y = l.fused(yy, ty, l.mul(two, l.mul(yz, tz)));
    let bent_z = l.fused(zz, tz, l.mul(two, l.mul(zx, tx)));
    let curvature_term = l.fused(tx, bent_x, l.fused(ty, bent_y, l.mul(tz, bent_z)));
    // k, or 0 where t vanishes.
    let curvature = l.select_below(
        l.splat(1e-12),
        tangential_square,
        l.div(curvature_term, tangential_square),
        zero,
    );
    // 1 + h k, bounded below.
    let factor = l.max(
        l.fused(height, curvature, one),
        l.splat(MIN_CURVATURE_FACTOR),
    );
    // k |t|^2 / (2 (1 + h k)), kept between -MAX_CURVATURE_REDUCTION and a voxel.
    let correction = l.mul(l.splat(0.5), l.div(curvature_term, factor));
    let correction = l.min(l.max(correction, l.splat(-MAX_CURVATURE_REDUCTION)), one);
    // If a voxel's sign disagrees with its side of the tangent plane, its distance is zero.
    let size = l.max(l.mul(l.add(height, correction), sign), zero);
    let to_point = l.sqrt(square);
    let size = l.min(size, to_point);
    // Far beside the point, the distance blends to |x - q|.
    let weight = l.sub(
        l.mul(l.sqrt(tangential_square), l.splat(1.0 / MAX_TANGENTIAL)),
        one,
    );
    let weight = l.min(l.max(weight, zero), one);
    let size = l.fused(weight, l.sub(to_point, size), size);
    l.mul(sign, l.max(size, l.sub(to_point, l.splat(MAX_SHORTFALL))))
}
