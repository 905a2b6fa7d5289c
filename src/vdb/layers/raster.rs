//! A layer as pixels, and its connected components as runs along rows.

use crate::union_find::UnionFind;

/// Pixels of a layer. A margin of at least one pixel is empty.
pub(super) struct Raster {
    rows: usize,
    columns: usize,
    /// Words of 64 columns per row.
    words: usize,
    bits: Vec<u64>,
}

impl Raster {
    /// No pixel set.
    pub fn new(rows: usize, columns: usize) -> Self {
        let words = columns.div_ceil(64);
        Self {
            rows,
            columns,
            words,
            bits: vec![0; rows * words],
        }
    }

    /// Sets 64 columns of a row, from a multiple of 64 on; columns beyond the last are ignored.
    pub fn set(&mut self, row: usize, word: usize, mut bits: u64) {
        if row >= self.rows || word >= self.words {
            return;
        }
        let left = self.columns - 64 * word;
        if left < 64 {
            bits &= (1 << left) - 1;
        }
        self.bits[row * self.words + word] = bits;
    }

    pub fn is_empty(&self) -> bool {
        self.bits.iter().all(|w| *w == 0)
    }

    /// Number of pixels that are set.
    pub fn pixels(&self) -> u64 {
        self.bits.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Whether a pixel is set; none is beyond the ends.
    pub fn contains(&self, row: i64, column: i64) -> bool {
        let is_within = |at: i64, count: usize| usize::try_from(at).is_ok_and(|n| n < count);
        is_within(row, self.rows)
            && is_within(column, self.columns)
            && self.bits[row as usize * self.words + column as usize / 64] >> (column % 64) & 1 == 1
    }

    /// Visits the pixels that are set here and not in another raster of the same size.
    pub fn for_each_without(&self, other: &Self, mut visit: impl FnMut(usize, usize)) {
        for (n, (a, b)) in self.bits.iter().zip(&other.bits).enumerate() {
            let mut rest = a & !b;
            while rest != 0 {
                let column = n % self.words * 64 + rest.trailing_zeros() as usize;
                visit(n / self.words, column);
                rest &= rest - 1;
            }
        }
    }

    /// The runs of a row: first column and end.
    fn runs(&self, row: usize, is_set: bool, runs: &mut Vec<[u32; 2]>) {
        let words = &self.bits[row * self.words..(row + 1) * self.words];
        let mut inside = false;
        for (n, &word) in words.iter().enumerate() {
            let word = if is_set { word } else { !word };
            // Bits at which membership changes.
            let mut changes = word ^ (word << 1 | u64::from(inside));
            while changes != 0 {
                let column = (64 * n) as u32 + changes.trailing_zeros();
                if inside {
                    if let Some(run) = runs.last_mut() {
                        run[1] = column;
                    }
                } else if column < self.columns as u32 {
                    runs.push([column, self.columns as u32]);
                }
                inside = !inside;
                changes &= changes - 1;
            }
        }
        if let Some(run) = runs.last_mut() {
            run[1] = run[1].min(self.columns as u32);
        }
    }
}

/// Components of the pixels that are set, or of the others, connected over edges, in order of their first
/// pixels.
pub(super) struct Components {
    /// First column and end of each run, and its component.
    runs: Vec<([u32; 2], u32)>,
    /// The first run of each row, and the number of runs.
    rows: Vec<usize>,
    /// Number of pixels of each component.
    pub pixels: Vec<u64>,
    /// Row and column of a pixel of each component: the middle of its first run.
    pub middle: Vec<[usize; 2]>,
}

impl Components {
    /// The component of pixels that are not set which lies around all others: the first pixel is in the margin.
    pub const OUTER: u32 = 0;

    pub fn of(raster: &Raster, is_set: bool) -> Self {
        let mut spans: Vec<[u32; 2]> = Vec::new();
        let mut rows = vec![0];
        for row in 0..raster.rows {
            raster.runs(row, is_set, &mut spans);
            rows.push(spans.len());
        }
        let mut sets = UnionFind::new(spans.len());
        for row in 1..raster.rows {
            let [first, middle, end] = [rows[row - 1], rows[row], rows[row + 1]];
            let (upper, lower) = (&spans[first..middle], &spans[middle..end]);
            overlaps(
                upper,
                lower,
                |s| *s,
                |a, b| sets.union(first + a, middle + b),
            );
        }
        let (labels, count) = sets.labels(0..spans.len());
        let mut pixels = vec![0; count];
        let mut middle = vec![[0; 2]; count];
        let mut runs = Vec::with_capacity(spans.len());
        for row in 0..raster.rows {
            for n in rows[row]..rows[row + 1] {
                let (span, label) = (spans[n], labels[n]);
                let own = &mut pixels[label as usize];
                if *own == 0 {
                    middle[label as usize] = [row, (span[0] + span[1]) as usize / 2];
                }
                *own += u64::from(span[1] - span[0]);
                runs.push((span, label));
            }
        }
        Self {
            runs,
            rows,
            pixels,
            middle,
        }
    }

    /// Visits the pairs of components of two layers that have pixels over one another, with repetitions.
    pub fn overlaps(&self, other: &Self, mut visit: impl FnMut(u32, u32)) {
        for row in 0..self.rows.len() - 1 {
            let own = &self.runs[self.rows[row]..self.rows[row + 1]];
            let others = &other.runs[other.rows[row]..other.rows[row + 1]];
            overlaps(own, others, |r| r.0, |a, b| visit(own[a].1, others[b].1));
        }
    }
}

/// Visits the pairs of runs of two rows that overlap.
fn overlaps<T>(
    a: &[T],
    b: &[T],
    span: impl Fn(&T) -> [u32; 2],
    mut visit: impl FnMut(usize, usize),
) {
    let (mut n, mut m) = (0, 0);
    while n < a.len() && m < b.len() {
        let (p, q) = (span(&a[n]), span(&b[m]));
        if p[0] < q[1] && q[0] < p[1] {
            visit(n, m);
        }
        if p[1] <= q[1] {
            n += 1;
        } else {
            m += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_components_are_those_of_single_pixels() {
        let picture = [
            "......................................................................",
            "..##.....#############################################################",
            "...#..##............................................................#.",
            "..##..##.#.#.......................................................##.",
            "......................................................................",
        ];
        let columns = picture[0].len();
        let mut raster = Raster::new(picture.len(), columns);
        for (row, line) in picture.iter().enumerate() {
            for word in 0..columns.div_ceil(64) {
                let part = line.bytes().skip(64 * word).take(64).enumerate();
                let bits = part.fold(0, |w, (n, c)| w | u64::from(c == b'#') << n);
                raster.set(row, word, bits);
            }
        }
        let solid = Components::of(&raster, true);
        assert_eq!(solid.pixels, [5, 64, 4, 1, 1]);
        assert_eq!(solid.pixels.iter().sum::<u64>(), raster.pixels());
        let void = Components::of(&raster, false);
        assert_eq!(void.pixels.len(), 1);
        assert_eq!(void.pixels[0] + raster.pixels(), (5 * columns) as u64);
    }
}
