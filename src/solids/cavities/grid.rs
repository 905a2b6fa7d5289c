//! The grid of blocks around a solid.
//!
//! Layers of blocks without any surface nearby are one cell of the grid, however thick they are. The grid is wider than
//! the solid, so that its first cell is outside.

use druse_geometry::frame::Coord;
use druse_tilings::band::BLOCK;
use std::collections::{BTreeSet, HashSet};

/// Voxels along the edge of a block.
const EDGE: usize = BLOCK as usize;

/// A cell of the grid.
pub(super) struct Cell {
    /// Number along each axis.
    pub at: [usize; 3],
    /// Least voxel.
    pub origin: Coord,
    pub voxels: u64,
    /// Whether it is one block that the surface may be near.
    pub is_near: bool,
}

/// Cells in ascending order.
pub(super) struct Grid {
    sides: [usize; 3],
    pub cells: Vec<Cell>,
}

impl Grid {
    /// The cells around the blocks with leaves. `blocks` are origins of blocks, in voxels. Cells are in order (x, y,
    /// z), z fastest; a cell spans all blocks up to the next layer.
    pub fn new(blocks: &[Coord]) -> Self {
        let number = |c: i32| i64::from(c.div_euclid(BLOCK));
        // Layers of blocks within two of a block with leaves; the rest lies between them.
        // Two blocks more on each side: a halo of one block, and one beyond it that is surely far.
        let layers: [Vec<i64>; 3] = std::array::from_fn(|a| {
            let near = blocks
                .iter()
                .flat_map(|b| (-2..=2).map(move |d| number(b[a]) + d));
            near.collect::<BTreeSet<i64>>().into_iter().collect()
        });
        let near: HashSet<[i64; 3]> = blocks
            .iter()
            .flat_map(|b| {
                let [x, y, z] = b.0.map(number);
                (0..27).map(move |n| [x + n / 9 - 1, y + n / 3 % 3 - 1, z + n % 3 - 1])
            })
            .collect();
        // Layers that the cell with this number spans.
        let span = |a: usize, n: usize| {
            let next = layers[a].get(n + 1).map_or(layers[a][n] + 1, |next| *next);
            next - layers[a][n]
        };
        let mut found = Vec::new();
        for x in 0..layers[0].len() {
            for y in 0..layers[1].len() {
                for z in 0..layers[2].len() {
                    let at = [x, y, z];
                    let block: [i64; 3] = std::array::from_fn(|a| layers[a][at[a]]);
                    let blocks: i64 = (0..3).map(|a| span(a, at[a])).product();
                    found.push(Cell {
                        at,
                        origin: Coord(block.map(|c| (c * i64::from(BLOCK)) as i32)),
                        voxels: blocks as u64 * EDGE.pow(3) as u64,
                        is_near: near.contains(&block),
                    });
                }
            }
        }
        Self {
            sides: layers.map(|l| l.len()),
            cells: found,
        }
    }

    /// The cell beside the one with number `n`.
    pub fn beside(&self, n: usize, axis: usize, ahead: bool) -> Option<usize> {
        let [_, y, z] = self.sides;
        let step = [y * z, z, 1][axis];
        let at = self.cells[n].at[axis];
        if ahead {
            (at + 1 < self.sides[axis]).then(|| n + step)
        } else {
            (at > 0).then(|| n - step)
        }
    }
}
