//! Distances of the void from the surface in one block.
//!
//! They are distances to the points where edges of the voxel lattice cross the surface, within the band too: there the
//! values after a Boolean operation may be less than the distance. The squared distance is a separable minimum:
//! along x from the points on lines along x, then along y and z as the lower envelope of parabolas over positions
//! (Felzenszwalb and Huttenlocher 2012), each with the points on lines of its own axis. Points on lines along y and z
//! count only for voxels at the same x, or x and y. Where the surface is nearest in another direction, points on
//! lines along x or y lie beside them, so that distances are up to a few tenths of a voxel too large.

use super::{LeafSource, Measure};
use crate::band::{BLOCK, Region};
use crate::frame::Coord;

/// The void of a block.
pub(super) enum BlockVoid {
    /// No voxel.
    Solid,
    /// All voxels, each as far from the solid as is measured.
    Wide,
    /// Void and solid.
    Mixed(BoxDistances),
}

/// Distances in a box of a block. The rest of the block is outside, and farther from the solid than is
/// measured.
pub(super) struct BoxDistances {
    /// Least voxel of the box in the block, and its edges.
    pub low: [usize; 3],
    pub edges: [usize; 3],
    /// Distances in voxels, in order (x, y, z), at most the measured reach; negative in the solid.
    pub values: Vec<f32>,
}

impl BoxDistances {
    /// Place of a voxel of the void in the order of falling distance, then ascending number, which is its low half.
    pub fn order(&self, n: u32) -> u64 {
        // Bits of positive numbers ascend with them.
        u64::from(!self.values[n as usize].to_bits()) << 32 | u64::from(n)
    }

    /// Position of voxel `n` of the box in the block.
    pub fn position(&self, n: usize) -> [usize; 3] {
        let (low, [_, ey, ez]) = (self.low, self.edges);
        [
            low[0] + n / (ey * ez),
            low[1] + n / ez % ey,
            low[2] + n % ez,
        ]
    }

    /// Whether a voxel of the box has a neighbour in the rest of the block.
    pub fn meets_rest(&self, at: [usize; 3]) -> bool {
        (0..3).any(|a| {
            let high = self.low[a] + self.edges[a];
            (at[a] == 0 && self.low[a] > 0) || (at[a] + 1 == self.edges[a] && high < BLOCK as usize)
        })
    }
}

impl BlockVoid {
    /// Measures the block at `origin`.
    pub fn of<S: LeafSource>(
        source: &S,
        origin: Coord,
        measure: Measure,
    ) -> Result<Self, S::Error> {
        let Some(samples) = Samples::read(source, origin, measure)? else {
            let is_solid = !source.inside_cubes(Region::cube(origin, 1)).is_empty();
            return Ok(if is_solid { Self::Solid } else { Self::Wide });
        };
        Ok(samples.distances(measure))
    }
}

/// Values of the level set around a box of a block.
struct Samples {
    /// Least voxel of the box in the block, and its edges.
    low: [usize; 3],
    edges: [usize; 3],
    /// Voxels that the values begin before the box, and their edges.
    halo: [usize; 3],
    sizes: [usize; 3],
    /// World units, in order (x, y, z).
    values: Vec<f32>,
}

/// A point on a lattice line: the number of the line, and its position along it in voxels of the box.
type Crossing = (u32, f32);

impl Samples {
    /// Reads them; `None` without any leaf.
    fn read<S: LeafSource>(
        source: &S,
        origin: Coord,
        measure: Measure,
    ) -> Result<Option<Self>, S::Error> {
        let block = Region::cube(origin, BLOCK);
        let around = measure.bounds.grown(measure.reach + 1);
        if !around.meets(origin, BLOCK) {
            return Ok(None);
        }
        let inner = block.common(around);
        let region = inner.grown(measure.reach);
        let sizes = [0, 1, 2].map(|a| (region.max[a] - region.min[a] + 1) as usize);
        let [_, ny, nz] = sizes;
        let mut values = Vec::new();
        source.visit_leaves(region, &mut |leaf, own| {
            if values.is_empty() {
                values = vec![measure.background; sizes.iter().product()];
            }
            for (n, row) in own.chunks_exact(8).enumerate() {
                let voxel = leaf.offset((n / 8) as i32, (n % 8) as i32, 0);
                let at = [0, 1, 2].map(|a| voxel[a] - region.min[a]);
                if (0..2).any(|a| at[a] < 0 || at[a] >= sizes[a] as i32) {
                    continue;
                }
                let first = (at[0] as usize * ny + at[1] as usize) * nz;
                let line = &mut values[first..first + nz];
                for (z, &v) in (at[2]..).zip(row) {
                    if let Some(value) = line.get_mut(z as usize).filter(|_| z >= 0) {
                        *value = v;
                    }
                }
            }
        })?;
        if values.is_empty() {
            return Ok(None);
        }
        for (cube, cube_edge) in source.inside_cubes(region) {
            let cube = Region::cube(cube, cube_edge).common(region);
            let [low, high] =
                [cube.min, cube.max].map(|c| [0, 1, 2].map(|a| (c[a] - region.min[a]) as usize));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    let line = (x * ny + y) * nz;
                    values[line + low[2]..=line + high[2]].fill(-measure.background);
                }
            }
        }
        Ok(Some(Self {
            low: [0, 1, 2].map(|a| (inner.min[a] - origin[a]) as usize),
            edges: [0, 1, 2].map(|a| (inner.max[a] - inner.min[a] + 1) as usize),
            halo: [0, 1, 2].map(|a| (inner.min[a] - region.min[a]) as usize),
            sizes,
            values,
        }))
    }

    /// Distances of the box.
    fn distances(&self, measure: Measure) -> BlockVoid {
        let reach = measure.reach as f32;
        let limit = f64::from(reach) * f64::from(reach);
        let ([ex, ey, ez], [hx, hy, hz]) = (self.edges, self.halo);
        let [_, ny, nz] = self.sizes;
        let along_x = self.along_x(limit);
        let mut envelope = Envelope::default();
        // Along y: lines (x, z), x in the box.
        let points = self.crossings(1);
        let mut next = 0;
        let mut along_y = vec![f32::INFINITY; ex * ey * nz];
        for (x, slab) in along_x.chunks_exact(ny * nz).enumerate() {
            let is_empty = slab.iter().all(|v| *v == f32::INFINITY);
            for z in 0..nz {
                let own = take_line(&points, &mut next, (x * nz + z) as u32);
                if is_empty && own.is_empty() {
                    continue;
                }
                let grid = (0..ny).map(|y| (y as f64 - hy as f64, slab[y * nz + z]));
                envelope.build(grid, own);
                envelope.minimum(ey, limit, |y, v| along_y[(x * ey + y) * nz + z] = v);
            }
        }
        drop(along_x);
        // Along z: lines (x, y) of the box.
        let points = self.crossings(2);
        let mut next = 0;
        let mut found = vec![reach; ex * ey * ez];
        let (mut any_void, mut all_wide) = (ex * ey * ez < (BLOCK as usize).pow(3), true);
        for (line, out) in found.chunks_exact_mut(ez).enumerate() {
            let own = take_line(&points, &mut next, line as u32);
            let row = &along_y[line * nz..(line + 1) * nz];
            if !own.is_empty() || row.iter().any(|v| *v < f32::INFINITY) {
                let grid = row.iter().enumerate();
                let grid = grid.map(|(z, &v)| (z as f64 - hz as f64, v));
                envelope.build(grid, own);
                envelope.minimum(ez, limit, |z, v| out[z] = v.sqrt().min(reach));
            }
            let first = ((line / ey + hx) * ny + line % ey + hy) * nz + hz;
            let own = &self.values[first..first + ez];
            for (d, &v) in out.iter_mut().zip(own) {
                if v < 0.0 {
                    *d = -1.0;
                }
                any_void |= *d >= 0.0;
                all_wide &= *d >= reach;
            }
        }
        match (any_void, all_wide) {
            (false, _) => BlockVoid::Solid,
            (true, true) => BlockVoid::Wide,
            (true, false) => BlockVoid::Mixed(BoxDistances {
                low: self.low,
                edges: self.edges,
                values: found,
            }),
        }
    }

    /// Squared distances along x from the points on lines along x, for the box's range of x.
    fn along_x(&self, limit: f64) -> Vec<f32> {
        let slab = self.sizes[1] * self.sizes[2];
        let mut found = vec![f32::INFINITY; self.edges[0] * slab];
        for line in self.crossings(0).chunk_by(|a, b| a.0 == b.0) {
            let at = line[0].0 as usize;
            let mut nearest = 0;
            for x in 0..self.edges[0] {
                let distance = |k: usize| (f64::from(line[k].1) - x as f64).abs();
                while nearest + 1 < line.len() && distance(nearest + 1) <= distance(nearest) {
                    nearest += 1;
                }
                let square = distance(nearest).powi(2);
                if square < limit {
                    found[x * slab + at] = square as f32;
                }
            }
        }
        found
    }

    /// The points on lines along an axis, by line and position. Lines run over the box on earlier axes, over
    /// all values on later ones.
    fn crossings(&self, axis: usize) -> Vec<Crossing> {
        let (halo, [_, ny, nz]) = (self.halo, self.sizes);
        let step = [ny * nz, nz, 1][axis];
        let range = |a: usize| match a.cmp(&axis) {
            std::cmp::Ordering::Less => halo[a]..halo[a] + self.edges[a],
            std::cmp::Ordering::Equal => 0..self.sizes[a] - 1,
            std::cmp::Ordering::Greater => 0..self.sizes[a],
        };
        let mut found = Vec::new();
        for x in range(0) {
            for y in range(1) {
                for z in range(2) {
                    let first = (x * ny + y) * nz + z;
                    let (a, b) = (self.values[first], self.values[first + step]);
                    if (a < 0.0) == (b < 0.0) {
                        continue;
                    }
                    let line = match axis {
                        0 => y * nz + z,
                        1 => (x - halo[0]) * nz + z,
                        _ => (x - halo[0]) * self.edges[1] + y - halo[1],
                    };
                    let position = [x, y, z][axis] as f32 - halo[axis] as f32;
                    found.push((line as u32, position + a.abs() / (a.abs() + b.abs())));
                }
            }
        }
        // Points of one line are found in order of position.
        found.sort_by_key(|p| p.0);
        found
    }
}

/// The points of a line, from points in order of lines; `next` is the first that is not taken.
fn take_line<'a>(points: &'a [Crossing], next: &mut usize, line: u32) -> &'a [Crossing] {
    let first = *next;
    while points.get(*next).is_some_and(|p| p.0 == line) {
        *next += 1;
    }
    &points[first..*next]
}

/// The lower envelope of parabolas (p - position)^2 + height along a line.
#[derive(Default)]
struct Envelope {
    /// Position and height of each parabola.
    apex: Vec<(f64, f64)>,
    /// Position from which each is the lowest.
    from: Vec<f64>,
}

impl Envelope {
    /// Builds it from lattice positions with heights, ascending, and points of height 0, ascending.
    fn build(&mut self, grid: impl Iterator<Item = (f64, f32)>, points: &[Crossing]) {
        self.apex.clear();
        self.from.clear();
        let mut points = points.iter().map(|p| f64::from(p.1)).peekable();
        for (position, height) in grid {
            while let Some(point) = points.next_if(|p| *p <= position) {
                self.add(point, 0.0);
            }
            if height < f32::INFINITY {
                self.add(position, height.into());
            }
        }
        for point in points {
            self.add(point, 0.0);
        }
    }

    fn add(&mut self, position: f64, height: f64) {
        let begin = loop {
            let Some(&(other, other_height)) = self.apex.last() else {
                break f64::NEG_INFINITY;
            };
            if position == other {
                if height >= other_height {
                    return;
                }
                self.apex.pop();
                self.from.pop();
                continue;
            }
            let rise = height + position * position - other_height - other * other;
            let meet = rise / (2.0 * (position - other));
            if meet > self.from[self.apex.len() - 1] {
                break meet;
            }
            self.apex.pop();
            self.from.pop();
        };
        self.apex.push((position, height));
        self.from.push(begin);
    }

    /// Calls `put` with the lowest value at each position below `count`, where it is below a limit.
    fn minimum(&self, count: usize, limit: f64, mut put: impl FnMut(usize, f32)) {
        if self.apex.is_empty() {
            return;
        }
        let mut lowest = 0;
        for i in 0..count {
            let p = i as f64;
            while lowest + 1 < self.apex.len() && self.from[lowest + 1] < p {
                lowest += 1;
            }
            let (position, height) = self.apex[lowest];
            let square = (p - position).powi(2) + height;
            if square < limit {
                put(i, square as f32);
            }
        }
    }
}
