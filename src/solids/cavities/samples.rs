//! Values of a level set around one block, by leaf: what the search for cavities reads to measure distances from the
//! surface up to `reach`, in passes along x, y and z.
//!
//! The halo is what is read around the block, in leaves; the ring is how far a leaf with surface may lie from a voxel
//! that it decides. The values are those of the source, in world units. A leaf without values has one sign; its rows
//! are 1 or -1. Positions of leaves count from the first one of the halo, whose width is the measured reach, in whole
//! leaves.

use super::Measure;
use crate::leaf_source::LeafSource;
use crate::voxel_mask;
use crate::voxel_mask::Bits;
use druse_geometry::frame::Coord;
use druse_tilings::band::{BLOCK, LEAF, Region};

/// Values along z of eight voxels.
pub(super) type Row = [f32; 8];
/// The rows of a leaf, in order (x, y).
pub(super) type Rows = [Row; 64];
/// Leaves along the edge of a block.
pub(super) const SLOTS: usize = (BLOCK / LEAF) as usize;

/// A leaf with values, and which of them are inside.
pub(super) struct StoredLeaf {
    rows: Rows,
    solid: Bits,
}

/// What a level set has in the place of a leaf.
#[derive(Clone, Copy)]
pub(super) enum Sample<'a> {
    Outside,
    Inside,
    Stored(&'a StoredLeaf),
}

/// What [`Sample::solid_row`] returns for a row in the solid.
pub(super) const ALL_SOLID: u8 = u8::MAX;

impl Sample<'_> {
    /// Whether it has values of its own.
    pub fn is_stored(self) -> bool {
        matches!(self, Self::Stored(_))
    }

    /// Whether it is solid as a whole, without values.
    pub fn is_inside(self) -> bool {
        matches!(self, Self::Inside)
    }

    /// Row number `n`, with positive and negative one where no values are stored.
    pub fn row(&self, n: usize) -> &Row {
        match self {
            Self::Outside => &[1.0; 8],
            Self::Inside => &[-1.0; 8],
            Self::Stored(leaf) => &leaf.rows[n],
        }
    }

    /// The voxels inside.
    fn solid(self) -> Bits {
        match self {
            Self::Outside => [0; 8],
            Self::Inside => [u64::MAX; 8],
            Self::Stored(leaf) => leaf.solid,
        }
    }

    /// Which voxels of row number `n` are inside: bit z.
    pub fn solid_row(&self, n: usize) -> u8 {
        match self {
            Self::Outside => 0,
            Self::Inside => ALL_SOLID,
            Self::Stored(leaf) => (leaf.solid[n / 8] >> (8 * (n % 8))) as u8,
        }
    }
}

/// Number of a leaf without values.
const OUTSIDE: u32 = u32::MAX;
const INSIDE: u32 = u32::MAX - 1;

/// The leaves of a block and of a halo around it.
pub(super) struct Samples {
    /// Leaves of the halo before the block, and along the edge of all.
    pub halo: usize,
    pub side: usize,
    /// Greatest distance, in leaves, from a leaf with surface to one with a voxel within reach.
    pub ring: usize,
    /// Number of each leaf, in order (x, y, z).
    numbers: Vec<u32>,
    leaves: Vec<StoredLeaf>,
    /// For each leaf, whether the surface crosses an edge of the lattice at one of its voxels.
    has_surface: Vec<bool>,
}

impl Samples {
    /// Reads the block at `origin`; `None` beyond the reach of all leaves, or without a leaf with values in it and its
    /// halo: nothing is to be measured. `measure` has the reach in voxels, at least 1, and the box of all leaves. The
    /// halo is read with it; cubes inside the solid count as leaves without values, and all others are outside.
    pub fn read<S: LeafSource>(
        source: &S,
        origin: Coord,
        measure: Measure,
    ) -> Result<Option<Self>, S::Error> {
        // The surface may cross the edge from the last voxel of a leaf to the next one.
        let around = measure.bounds.grown(measure.reach + 1);
        if !around.meets(origin, BLOCK) {
            return Ok(None);
        }
        // The halo in whole leaves.
        let halo = (measure.reach + LEAF - 1) / LEAF;
        // Both voxels at a crossing are marked; a voxel within reach is `reach - 1` away from the nearer one at most.
        let ring = ((measure.reach - 1 + LEAF - 1) / LEAF) as usize;
        let region = Region::cube(origin, BLOCK).grown(halo * LEAF);
        let halo = halo as usize;
        let side = SLOTS + 2 * halo;
        let slot = |leaf: Coord| {
            let [x, y, z] = [0, 1, 2].map(|a| ((leaf[a] - region.min[a]) / LEAF) as usize);
            (x * side + y) * side + z
        };
        // A guess: a few layers of leaves beside a surface through the block.
        let mut leaves: Vec<StoredLeaf> = Vec::with_capacity(4 * SLOTS.pow(2));
        let mut numbers = Vec::new();
        source.visit_leaves(region, &mut |leaf| {
            if numbers.is_empty() {
                numbers = vec![OUTSIDE; side.pow(3)];
            }
            numbers[slot(leaf.origin)] = leaves.len() as u32;
            let solid = *leaf.inside;
            let rows = leaf.values.as_chunks().0.first_chunk::<64>();
            leaves.extend(rows.map(|&rows| StoredLeaf { rows, solid }));
        })?;
        if numbers.is_empty() {
            return Ok(None);
        }
        for (cube, edge) in source.inside_cubes(region) {
            for leaf in Region::cube(cube, edge).common(region).cubes(LEAF) {
                numbers[slot(leaf)] = INSIDE;
            }
        }
        let mut found = Self {
            halo,
            side,
            ring,
            numbers,
            leaves,
            has_surface: vec![false; side.pow(3)],
        };
        // A leaf with values has surface if signs differ within it or across its faces.
        for x in 0..side {
            for y in 0..side {
                for z in 0..side {
                    found.has_surface[(x * side + y) * side + z] = found.crosses([x, y, z]);
                }
            }
        }
        Ok(Some(found))
    }

    /// Finds out what [`Samples::has_surface`] returns.
    fn crosses(&self, at: [usize; 3]) -> bool {
        let Sample::Stored(leaf) = self.at(at) else {
            return false;
        };
        // All voxels of the leaf have one sign here, that of its first voxel, or the leaf has surface.
        let uniform = if leaf.solid[0] & 1 == 1 { u64::MAX } else { 0 };
        if leaf.solid.iter().any(|word| *word != uniform) {
            return true;
        }
        (0..6).any(|face| {
            let (axis, ahead) = (face / 2, face % 2 == 1);
            let mut beside = at;
            beside[axis] = if ahead {
                at[axis] + 1
            } else {
                at[axis].wrapping_sub(1)
            };
            if beside[axis] >= self.side {
                return false;
            }
            let other = self.at(beside).solid().map(|word| word ^ uniform);
            !voxel_mask::is_empty(&voxel_mask::face(&other, axis, !ahead))
        })
    }

    /// The leaves along an axis whose surface is within reach of some voxel of the block.
    pub fn within_reach(&self) -> std::ops::Range<usize> {
        self.halo - self.ring..self.halo + SLOTS + self.ring
    }

    /// For each leaf of the block along a line, whether one of those within reach is marked.
    pub fn near(&self, marked: &[bool]) -> Vec<bool> {
        let reach = |n: usize| n + self.halo - self.ring..=n + self.halo + self.ring;
        (0..SLOTS)
            .map(|n| marked[reach(n)].contains(&true))
            .collect()
    }

    /// Whether the surface crosses an edge of the lattice at a voxel of a leaf.
    pub fn has_surface(&self, [x, y, z]: [usize; 3]) -> bool {
        self.has_surface[(x * self.side + y) * self.side + z]
    }

    /// What is at a leaf, counted from the first one of the halo.
    pub fn at(&self, [x, y, z]: [usize; 3]) -> Sample<'_> {
        match self.numbers[(x * self.side + y) * self.side + z] {
            OUTSIDE => Sample::Outside,
            INSIDE => Sample::Inside,
            n => Sample::Stored(&self.leaves[n as usize]),
        }
    }
}
