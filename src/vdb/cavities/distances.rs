//! Distances of the void from the surface in one block.
//!
//! They are distances to the points where edges of the voxel lattice cross the surface, within the band too: there the
//! values after a Boolean operation may be less than the distance. The squared distance is a separable minimum:
//! along x from the points on lines along x, then along y and z over the rows within reach, each with the points on
//! lines of its own axis. Points on lines along y and z count only for voxels at the same x, or x and y. Where the
//! surface is nearest in another direction, points on lines along x or y lie beside them, so that distances are up to a
//! few tenths of a voxel too large. Rows along z without any such point within reach are skipped.

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
    /// What the rows along z hold, in order (x, y).
    pub rows: Vec<Row>,
}

/// What a row of voxels along z holds.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Row {
    /// No void.
    Solid,
    /// Void as far from the solid as is measured.
    Wide,
    Mixed,
}

impl Row {
    fn of(distances: &[f32], reach: f32) -> Self {
        let first = distances[0];
        if distances.iter().any(|d| *d != first) {
            Self::Mixed
        } else if first < 0.0 {
            Self::Solid
        } else if first >= reach {
            Self::Wide
        } else {
            Self::Mixed
        }
    }
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
    /// Whether a row along z has values of a leaf; only such rows have points of the surface.
    has_leaf: Vec<bool>,
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
        let mut has_leaf = vec![false; sizes[0] * ny];
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
                has_leaf[at[0] as usize * ny + at[1] as usize] = true;
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
            has_leaf,
        }))
    }

    /// Distances of the box.
    fn distances(&self, measure: Measure) -> BlockVoid {
        let reach = measure.reach as f32;
        let limit = reach * reach;
        let ([ex, ey, ez], [hx, hy, hz]) = (self.edges, self.halo);
        let [_, ny, nz] = self.sizes;
        let along_x = self.along_x(limit.into());
        let along_y = self.along_y(&along_x, measure.reach as usize);
        drop(along_x);
        let points = self.crossings(2);
        let mut next = 0;
        let mut values = vec![reach; ex * ey * ez];
        let mut rows = Vec::with_capacity(ex * ey);
        let mut squares = vec![f32::INFINITY; ez];
        for (line, out) in values.chunks_exact_mut(ez).enumerate() {
            let crossings = take_line(&points, &mut next, line as u32);
            let near = along_y.row(line);
            if near.is_some() || !crossings.is_empty() {
                squares.fill(f32::INFINITY);
                if let Some(near) = near {
                    lower_along(near, hz, measure.reach as usize, &mut squares);
                }
                for (_, position) in crossings {
                    for (z, square) in squares.iter_mut().enumerate() {
                        *square = square.min((z as f32 - position).powi(2));
                    }
                }
                for (d, &square) in out.iter_mut().zip(&squares) {
                    *d = if square < limit { square.sqrt() } else { reach };
                }
            }
            let first = ((line / ey + hx) * ny + line % ey + hy) * nz + hz;
            let own = &self.values[first..first + ez];
            for (d, &v) in out.iter_mut().zip(own) {
                *d = if v < 0.0 { -1.0 } else { *d };
            }
            rows.push(Row::of(out, reach));
        }
        let is_whole_block = ex * ey * ez == (BLOCK as usize).pow(3);
        let all = |kind: Row| rows.iter().all(|r| *r == kind);
        if is_whole_block && all(Row::Solid) {
            BlockVoid::Solid
        } else if all(Row::Wide) {
            BlockVoid::Wide
        } else {
            BlockVoid::Mixed(BoxDistances {
                low: self.low,
                edges: self.edges,
                values,
                rows,
            })
        }
    }

    /// Squared distances from the points on lines along x and y: rows (x, y) of the box along all z.
    fn along_y(&self, along_x: &Rows, reach: usize) -> Rows {
        let ([ex, ey, _], [_, hy, _], [_, ny, nz]) = (self.edges, self.halo, self.sizes);
        let mut found = Rows::new(ex * ey, nz);
        let points = self.crossings(1);
        let mut next = 0;
        for x in 0..ex {
            for from in 0..ny {
                let Some(row) = along_x.row(x * ny + from) else {
                    continue;
                };
                let near = (from.saturating_sub(hy + reach - 1))
                    ..(from + reach).saturating_sub(hy).min(ey);
                for y in near {
                    let step = ((y + hy) as f32 - from as f32).powi(2);
                    let out = found.row_mut(x * ey + y);
                    for (square, v) in out.iter_mut().zip(row) {
                        *square = lower(*square, v + step);
                    }
                }
            }
            for z in 0..nz {
                for (_, position) in take_line(&points, &mut next, (x * nz + z) as u32) {
                    let low = (position - reach as f32).ceil().max(0.0) as usize;
                    let high = (position + reach as f32).floor().min(ey as f32 - 1.0);
                    if high < 0.0 {
                        continue;
                    }
                    for y in low..=high as usize {
                        let square = &mut found.row_mut(x * ey + y)[z];
                        *square = square.min((y as f32 - position).powi(2));
                    }
                }
            }
        }
        found
    }

    /// Squared distances along x from the points on lines along x: rows (x, y) along all z, for the box's range of x.
    fn along_x(&self, limit: f64) -> Rows {
        let [_, ny, nz] = self.sizes;
        let mut found = Rows::new(self.edges[0] * ny, nz);
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
                    found.row_mut(x * ny + at / nz)[at % nz] = square as f32;
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
                if !self.has_leaf[x * ny + y] {
                    continue;
                }
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

/// Rows of squared distances, each allocated once it has a finite one.
struct Rows {
    width: usize,
    rows: Vec<Vec<f32>>,
}

impl Rows {
    fn new(count: usize, width: usize) -> Self {
        Self {
            width,
            rows: vec![Vec::new(); count],
        }
    }

    /// The row; `None` if all of it is infinite.
    fn row(&self, n: usize) -> Option<&[f32]> {
        Some(&self.rows[n][..]).filter(|r| !r.is_empty())
    }

    fn row_mut(&mut self, n: usize) -> &mut [f32] {
        let row = &mut self.rows[n];
        if row.is_empty() {
            row.resize(self.width, f32::INFINITY);
        }
        row
    }
}

/// The lower of two numbers that are not NaN: one instruction, unlike `f32::min`.
fn lower(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// Lowers squares to those of a row along the same line, which begins `halo` before them: the least sum of a value
/// and the square of its distance, less than `reach`.
fn lower_along(row: &[f32], halo: usize, reach: usize, squares: &mut [f32]) {
    let far = reach as isize - 1;
    for step in -far..=far {
        // Element n is lowered by element n + halo + step of the row.
        let first = halo as isize + step;
        let skipped = (-first).max(0) as usize;
        let from = first.max(0) as usize;
        if from >= row.len() || skipped >= squares.len() {
            continue;
        }
        let own = (step * step) as f32;
        for (square, v) in squares[skipped..].iter_mut().zip(&row[from..]) {
            *square = lower(*square, v + own);
        }
    }
}
