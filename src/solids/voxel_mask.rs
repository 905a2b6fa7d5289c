//! Sets of voxels of one leaf as 512 bits, and their connected parts.
//!
//! Voxel (x, y, z) is bit 8 y + z of word x, as in a leaf mask of OpenVDB; its offset is 64 x + 8 y + z. A set knows
//! nothing of neighbouring leaves: whatever crosses a face of the leaf is the caller's work, by [`face`] and
//! [`pack_face`].

use druse_geometry::frame::Coord;

/// A set of voxels of one leaf.
pub type Bits = [u64; 8];

/// Bits at z = 0.
const Z_MIN_BITS: u64 = 0x0101_0101_0101_0101;
/// Bits at z = 7.
const Z_MAX_BITS: u64 = Z_MIN_BITS << 7;

/// The set of voxels whose value satisfies `test`.
#[inline]
pub fn select(values: &[f32; 512], test: impl Fn(f32) -> bool) -> Bits {
    let mut bits = [0; 8];
    for (word, slab) in bits.iter_mut().zip(values.chunks_exact(64)) {
        for (n, &v) in slab.iter().enumerate() {
            *word |= u64::from(test(v)) << n;
        }
    }
    bits
}

/// The set of voxels with negative values.
#[inline]
pub fn negative(values: &[f32; 512]) -> Bits {
    druse_geometry::simd::negative_bits(values)
}

/// Whether a set has no voxel.
#[inline]
pub fn is_empty(bits: &Bits) -> bool {
    bits.iter().all(|&w| w == 0)
}

/// The number of voxels of a set.
#[inline]
pub fn count(bits: &Bits) -> u64 {
    bits.iter().map(|w| u64::from(w.count_ones())).sum()
}

/// Whether a set has the voxel at an offset in its leaf.
#[inline]
pub fn contains(bits: &Bits, offset: usize) -> bool {
    bits[offset >> 6] >> (offset & 63) & 1 == 1
}

/// Adds the voxel at an offset in its leaf.
#[inline]
pub fn insert(bits: &mut Bits, offset: usize) {
    bits[offset >> 6] |= 1 << (offset & 63);
}

/// Adds the voxels of another set.
#[inline]
pub fn add(bits: &mut Bits, other: &Bits) {
    for (b, o) in bits.iter_mut().zip(other) {
        *b |= o;
    }
}

/// The set and its face neighbours within the leaf.
#[inline]
pub fn dilated(bits: &Bits) -> Bits {
    let mut out = [0; 8];
    for x in 0..8 {
        let w = bits[x];
        // A step along z is one bit, and must not leave its row of eight; along y it is eight bits, and along x another
        // word.
        let along_z = (w & !Z_MAX_BITS) << 1 | (w & !Z_MIN_BITS) >> 1;
        out[x] |= w | along_z | w << 8 | w >> 8;
        if x > 0 {
            out[x - 1] |= w;
        }
        if x < 7 {
            out[x + 1] |= w;
        }
    }
    out
}

/// The voxels of a set that are connected over faces, within the leaf, to some of the `seeds`. Seeds that are not in
/// the set do not count.
#[inline]
pub fn connected(seeds: Bits, set: &Bits) -> Bits {
    let mut part: Bits = std::array::from_fn(|x| seeds[x] & set[x]);
    loop {
        let mut next = dilated(&part);
        for (n, s) in next.iter_mut().zip(set) {
            *n &= s;
        }
        if next == part {
            return part;
        }
        part = next;
    }
}

/// The parts of a set that are connected over faces within the leaf, in order of their first voxels by offset.
#[inline]
pub fn parts(mut set: Bits) -> Vec<Bits> {
    let mut parts = Vec::new();
    while let Some(x) = set.iter().position(|&w| w != 0) {
        let mut part = [0; 8];
        part[x] = 1 << set[x].trailing_zeros();
        let part = connected(part, &set);
        for (s, p) in set.iter_mut().zip(&part) {
            *s &= !p;
        }
        parts.push(part);
    }
    parts
}

/// The voxels of a set on the first or last face of the leaf on an axis. Voxels that share a face with a voxel of the
/// neighbouring leaf have the same bit there. Axes are 0 to 2 for x, y, z.
#[inline]
pub fn face(bits: &Bits, axis: usize, last: bool) -> Bits {
    let mut out = [0; 8];
    match (axis, last) {
        (0, false) => out[0] = bits[0],
        (0, true) => out[0] = bits[7],
        (1, false) => (0..8).for_each(|x| out[x] = bits[x] & 0xff),
        (1, true) => (0..8).for_each(|x| out[x] = bits[x] >> 56),
        (_, false) => (0..8).for_each(|x| out[x] = bits[x] & Z_MIN_BITS),
        (_, true) => (0..8).for_each(|x| out[x] = bits[x] >> 7 & Z_MIN_BITS),
    }
    out
}

/// The 64 bits of a face in one word; voxels that share a face have the same bit. `face` is a result of [`face`] for
/// the same axis.
#[inline]
pub fn pack_face(face: &Bits, axis: usize) -> u64 {
    let bytes = face.iter().enumerate();
    match axis {
        0 => face[0],
        1 => bytes.fold(0, |out, (x, w)| out | (w & 0xff) << (8 * x)),
        // Gathers the bits 0, 8, ..., 56: the product moves each to one bit of its highest byte.
        _ => bytes.fold(0, |out, (x, w)| {
            out | (w & Z_MIN_BITS).wrapping_mul(0x0102_0408_1020_4080) >> 56 << (8 * x)
        }),
    }
}

/// Whether two sets share a voxel.
#[inline]
pub fn intersects(a: &Bits, b: &Bits) -> bool {
    a.iter().zip(b).any(|(a, b)| a & b != 0)
}

/// Offset of a voxel in its leaf.
#[inline]
pub fn offset(voxel: Coord) -> usize {
    let [x, y, z] = voxel.0.map(|c| (c & 7) as usize);
    x << 6 | y << 3 | z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_equal_those_of_a_flood_fill() {
        let mut state = 1u32;
        for density_in_128ths in [20, 40, 60, 80] {
            let mut set = [0; 8];
            for n in 0..512 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                if state >> 16 & 127 < density_in_128ths {
                    insert(&mut set, n);
                }
            }
            let mut seen = [0; 8];
            let mut expected = Vec::new();
            for start in 0..512 {
                if !contains(&set, start) || contains(&seen, start) {
                    continue;
                }
                let mut part = [0; 8];
                let mut stack = vec![start];
                while let Some(n) = stack.pop() {
                    if contains(&part, n) || !contains(&set, n) {
                        continue;
                    }
                    insert(&mut part, n);
                    insert(&mut seen, n);
                    for shift in [0, 3, 6] {
                        let c = n >> shift & 7;
                        if c > 0 {
                            stack.push(n - (1 << shift));
                        }
                        if c < 7 {
                            stack.push(n + (1 << shift));
                        }
                    }
                }
                expected.push(part);
            }
            assert_eq!(parts(set), expected);
        }
    }

    #[test]
    fn opposite_faces_have_equal_bits() {
        let mut seen = [0u64; 3];
        for axis in 0..3 {
            let step = [64, 8, 1][axis];
            for n in 0..512usize {
                let c = [n >> 6, n >> 3 & 7, n & 7][axis];
                if c != 7 {
                    continue;
                }
                let (mut here, mut there) = ([0; 8], [0; 8]);
                insert(&mut here, n);
                insert(&mut there, n - 7 * step);
                assert!(intersects(
                    &face(&here, axis, true),
                    &face(&there, axis, false)
                ));
                assert!(is_empty(&face(&here, axis, false)));
                let one = pack_face(&face(&here, axis, true), axis);
                assert_eq!(one, pack_face(&face(&there, axis, false), axis));
                assert_eq!(one.count_ones(), 1);
                assert!(seen[axis] & one == 0, "each voxel has a bit of its own");
                seen[axis] |= one;
            }
        }
    }
}
