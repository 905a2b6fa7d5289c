//! Squared distances along lattice lines: from the points where a line crosses the surface, and from squared
//! distances that the rows of a line have already. The minimum is separable: on a line with crossings p it is at x
//! min over p of (x - p)^2, and a pass along another axis turns squares f into min over k of f(k) + (x - k)^2.
// What the passes call must be inlined into a function that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::samples::{Row, Rows, Sample};

const NO_ROW: Row = [f32::INFINITY; 8]; // squares without any point

/// Rows by leaf, in a box of leaves; most leaves have none.
pub(super) struct LeafRows {
    sides: [usize; 3],
    numbers: Vec<u32>, // places in `leaves`, or `NO_LEAF`
    leaves: Vec<Rows>,
}

const NO_LEAF: u32 = u32::MAX; // the number of a leaf without rows

impl LeafRows {
    /// A box of this many leaves along each axis, without rows. Room for a few layers is reserved.
    pub fn new(sides: [usize; 3]) -> Self {
        Self {
            sides,
            numbers: vec![NO_LEAF; sides.iter().product()],
            leaves: Vec::with_capacity(4 * sides[1] * sides[2]),
        }
    }

    /// The index of a leaf's place, z fastest.
    fn slot(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.sides[1] + y) * self.sides[2] + z
    }

    /// The rows of the leaf at a place; `None` if they are all infinite because none was stored.
    pub fn get(&self, at: [usize; 3]) -> Option<&Rows> {
        let number = self.numbers[self.slot(at)];
        (number != NO_LEAF).then(|| &self.leaves[number as usize])
    }

    /// The rows of a leaf, which are infinite at first.
    pub fn rows_mut(&mut self, at: [usize; 3]) -> &mut Rows {
        let slot = self.slot(at);
        if self.numbers[slot] == NO_LEAF {
            self.numbers[slot] = self.leaves.len() as u32;
            self.leaves.push([NO_ROW; 64]);
        }
        &mut self.leaves[self.numbers[slot] as usize]
    }
}

/// A row of a leaf.
#[derive(Clone, Copy)]
struct LeafRow<'a> {
    leaf: &'a Sample<'a>,
    row: usize,
}

/// Moves positions to where the surface crosses the lines from one row to the next, `x` steps from the start.
#[inline(always)]
fn cross(position: &mut Row, from: LeafRow, to: LeafRow, x: f32) {
    // Most rows are alike.
    if from.leaf.solid_row(from.row) == to.leaf.solid_row(to.row) {
        return;
    }
    let (a, b) = (from.leaf.row(from.row), to.leaf.row(to.row));
    for n in 0..8 {
        let (va, vb) = (a[n].abs(), b[n].abs());
        let crosses = (a[n] < 0.0) != (b[n] < 0.0);
        let at = x + va / (va + vb);
        position[n] = if crosses { at } else { position[n] };
    }
}

/// Squared distances from the nearest points at which lines cross the surface. Positions count in voxels from the first
/// leaf; `squares` has eight entries per leaf and is infinite without any crossing.
///
/// The lines run through a line of leaves; those of eight neighbouring z are measured together. Row `n` of the lines
/// is row `row(n % 8)` of its leaf. Only rows of leaves that are `needed` become right.
#[inline(always)]
pub(super) fn from_crossings(
    leaves: &[Sample],
    row: impl Fn(usize) -> usize,
    needed: &[bool],
    squares: &mut [Row],
) {
    let at = |n: usize, step: usize| LeafRow {
        leaf: &leaves[n],
        row: row(step),
    };
    let has_values = |n: usize| leaves.get(n).is_some_and(|l| l.is_stored());
    // Forward: the last crossing before each voxel. Crossings lie between two voxels, those of neighbouring
    // leaves included.
    let mut position = [f32::NEG_INFINITY; 8];
    for (n, leaf) in leaves.iter().enumerate() {
        let is_stored = leaf.is_stored();
        if n > 0 && (is_stored || has_values(n - 1)) {
            let x = (8 * n - 1) as f32;
            cross(&mut position, at(n - 1, 7), at(n, 0), x);
        }
        // A leaf without values has no crossing within it; unless it is needed, its squares are left as they are.
        if !is_stored && !needed[n] {
            continue;
        }
        for step in 0..8 {
            let x = (8 * n + step) as f32;
            if is_stored && step > 0 {
                cross(&mut position, at(n, step - 1), at(n, step), x - 1.0);
            }
            squares[8 * n + step] = position.map(|p| (x - p) * (x - p));
        }
    }
    // Backward: the next crossing behind each voxel, and the nearer of both.
    position = [f32::INFINITY; 8];
    for (n, leaf) in leaves.iter().enumerate().rev() {
        let is_stored = leaf.is_stored();
        if n + 1 < leaves.len() && (is_stored || has_values(n + 1)) {
            let x = (8 * n + 7) as f32;
            cross(&mut position, at(n, 7), at(n + 1, 0), x);
        }
        if !is_stored && !needed[n] {
            continue;
        }
        for step in (0..8).rev() {
            let x = (8 * n + step) as f32;
            if is_stored && step < 7 {
                cross(&mut position, at(n, step), at(n, step + 1), x);
            }
            let square = &mut squares[8 * n + step];
            for (square, p) in square.iter_mut().zip(position) {
                *square = lower(*square, (p - x) * (p - x));
            }
        }
    }
}

/// The squares of the steps from `-(reach - 1)` to `reach - 1`: longer ones give no distance below the reach.
pub(super) fn squared_steps(reach: usize) -> Vec<f32> {
    let far = reach as i32 - 1;
    (-far..=far).map(|step| (step * step) as f32).collect()
}

/// Lowers a row to the rows of the lines within the squared `steps`: the least sum of a value and its squared distance.
/// The row is `at` steps from the start; leaves without rows are skipped. `rows` has eight entries per leaf, and
/// `has_rows` one.
#[inline(always)]
pub(super) fn lower_to_rows(
    square: &mut Row,
    rows: &[Row],
    has_rows: &[bool],
    at: usize,
    steps: &[f32],
) {
    let far = steps.len() / 2;
    let first = at.saturating_sub(far);
    let end = (at + far + 1).min(rows.len());
    let mut own = [*square, NO_ROW];
    let mut from = first;
    while from < end {
        // A run of rows in leaves that are all there, or all not.
        let has = has_rows[from / 8];
        let mut to = (from / 8 + 1) * 8;
        while to < end && has_rows[to / 8] == has {
            to += 8;
        }
        let to = to.min(end);
        if has {
            lower_twice(&mut own, &rows[from..to], &steps[from + far - at..]);
        }
        from = to;
    }
    for z in 0..8 {
        square[z] = lower(own[0][z], own[1][z]);
    }
}

/// Lowers two rows to sums of other rows and squared steps, in turns, so that neither waits for the other.
#[inline(always)]
fn lower_twice(own: &mut [Row; 2], rows: &[Row], steps: &[f32]) {
    let pairs = rows.chunks_exact(2).zip(steps.chunks_exact(2));
    for (rows, steps) in pairs {
        for (own, (row, step)) in own.iter_mut().zip(rows.iter().zip(steps)) {
            for z in 0..8 {
                own[z] = lower(own[z], row[z] + step);
            }
        }
    }
    if let ([row], Some(step)) = (rows.chunks_exact(2).remainder(), steps.get(rows.len() - 1)) {
        for z in 0..8 {
            own[0][z] = lower(own[0][z], row[z] + step);
        }
    }
}

/// The least sums of the values along a line and the squared `steps` from eight neighbours on it; the first of the
/// eight is `at` steps from the start.
#[inline(always)]
pub(super) fn along_line(line: &[f32], at: usize, steps: &[f32]) -> Row {
    let mut own = [NO_ROW; 2];
    let first = at - steps.len() / 2;
    let line = &line[first..first + steps.len() + 7];
    let mut windows = line.windows(8).zip(steps);
    while let Some((window, step)) = windows.next() {
        for z in 0..8 {
            own[0][z] = lower(own[0][z], window[z] + step);
        }
        if let Some((window, step)) = windows.next() {
            for z in 0..8 {
                own[1][z] = lower(own[1][z], window[z] + step);
            }
        }
    }
    std::array::from_fn(|z| lower(own[0][z], own[1][z]))
}

/// The lower of two numbers that are not NaN: one instruction, unlike `f32::min`.
#[inline(always)]
pub(super) fn lower(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}
