//! A layer as pixels, and its connected components as runs along rows.
//!
//! The outline of the solid runs between the centres of pixels. A pixel of the solid or the void has the area of its
//! side of the outline in the cells around its centre, each shared among the pixels of that side: 1, except at the
//! outline.

use druse_geometry::union_find::UnionFind;

/// Pixels of a layer. A margin of at least one pixel is empty.
pub(super) struct Raster {
    rows: usize,
    columns: usize,
    /// Words of 64 columns per row.
    words: usize,
    bits: Vec<u64>,
    /// The pixels at the outline, by row and column.
    rim: Vec<RimPixel>,
}

/// A pixel at the outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RimPixel {
    pub row: u32,
    pub column: u32,
    /// Its area less 1.
    pub excess: f32,
}

impl RimPixel {
    /// The pixel in the middle of 3 x 3 values, row by row, if the outline runs beside it. `values` are at the centres
    /// of pixels; solid is negative. `None` where its area is 1, as where all nine have one sign.
    pub fn of(values: &[[f64; 3]; 3], [row, column]: [u32; 2]) -> Option<Self> {
        let is_solid = values[1][1] < 0.0;
        let mut excess = 0.0;
        for (r, c) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let corners = [
                values[r][c],
                values[r][c + 1],
                values[r + 1][c + 1],
                values[r + 1][c],
            ];
            let alike = corners.iter().filter(|v| (**v < 0.0) == is_solid).count();
            let solid = solid_part(&corners);
            let part = if is_solid { solid } else { 1.0 - solid };
            // Each of the four cells gives its part to the pixels of that side, in equal shares; a cell without outline
            // gives 1/4.
            excess += part / alike as f64 - 0.25;
        }
        (excess != 0.0).then_some(Self {
            row,
            column,
            excess: excess as f32,
        })
    }
}

/// The part of a square cell in which values are negative; they are linear in the four triangles between its centre and
/// its edges.
fn solid_part(corners: &[f64; 4]) -> f64 {
    let solid = corners.iter().filter(|v| **v < 0.0).count();
    if solid == 0 || solid == 4 {
        return (solid / 4) as f64;
    }
    let centre = corners.iter().sum::<f64>() / 4.0;
    let triangle = |n: usize| negative_part([corners[n], corners[(n + 1) % 4], centre]);
    (0..4).map(triangle).sum::<f64>() / 4.0
}

/// The part of a triangle in which values that are linear in it are negative.
fn negative_part(values: [f64; 3]) -> f64 {
    let negative = values.map(|v| v < 0.0);
    let count = negative.iter().filter(|n| **n).count();
    if count == 0 || count == 3 {
        return (count / 3) as f64;
    }
    // The corner that is alone on its side cuts off the parts v / (v - w) of its two edges.
    let alone = negative.iter().position(|n| *n == (count == 1));
    let alone = alone.unwrap_or_default();
    let v = values[alone];
    let cut = |n: usize| v / (v - values[(alone + n) % 3]);
    let part = cut(1) * cut(2);
    if count == 1 { part } else { 1.0 - part }
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
            rim: Vec::new(),
        }
    }

    /// Sets the pixels at the outline; those beyond the last row or column are ignored.
    pub fn set_rim(&mut self, mut rim: Vec<RimPixel>) {
        rim.retain(|p| (p.row as usize) < self.rows && (p.column as usize) < self.columns);
        rim.sort_unstable_by_key(|p| (p.row, p.column));
        self.rim = rim;
    }

    /// Area of a pixel, pixels.
    pub fn pixel_area(&self, row: usize, column: usize) -> f64 {
        let key = (row as u32, column as u32);
        let at = self.rim.binary_search_by_key(&key, |p| (p.row, p.column));
        1.0 + at.map_or(0.0, |n| f64::from(self.rim[n].excess))
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

    /// Whether no pixel is set.
    pub fn is_empty(&self) -> bool {
        self.bits.iter().all(|w| *w == 0)
    }

    /// The pixels at the outline that are set.
    pub fn solid_rim(&self) -> impl Iterator<Item = &RimPixel> {
        let is_set = |p: &&RimPixel| self.contains(i64::from(p.row), i64::from(p.column));
        self.rim.iter().filter(is_set)
    }

    /// Area of the pixels that are set, pixels.
    pub fn area(&self) -> f64 {
        let count: u64 = self.bits.iter().map(|w| u64::from(w.count_ones())).sum();
        let excess = self.solid_rim().map(|p| f64::from(p.excess));
        count as f64 + excess.sum::<f64>()
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

    /// The runs of a row: first column and end. Replaces nothing: runs are appended to `runs`. `is_set` selects the
    /// pixels that are set, or the others.
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
                    // Up to the last column, until the end of the run is found.
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

/// Components of the pixels that are set, or of the others, connected over edges, in order of their first pixels.
pub(super) struct Components {
    /// First column and end of each run, and its component.
    runs: Vec<([u32; 2], u32)>,
    /// The first run of each row, and the number of runs.
    rows: Vec<usize>,
    /// Number of pixels of each component.
    pub pixels: Vec<u64>,
    /// Their area, pixels.
    pub areas: Vec<f64>,
    /// Row and column of a pixel of each component: the middle of its first run.
    pub middle: Vec<[usize; 2]>,
}

impl Components {
    /// The component of pixels that are not set which lies around all others: the first pixel is in the margin.
    pub const OUTER: u32 = 0;

    /// The components of the pixels that are set: solid.
    pub fn of_solid(raster: &Raster) -> Self {
        Self::of(raster, true)
    }

    /// The components of the pixels that are not set.
    pub fn of_void(raster: &Raster) -> Self {
        Self::of(raster, false)
    }

    /// Runs of each row are joined with those that they touch in the row above; areas add the shares of pixels at the
    /// outline.
    fn of(raster: &Raster, is_set: bool) -> Self {
        let mut spans: Vec<[u32; 2]> = Vec::new();
        let mut rows = vec![0];
        for row in 0..raster.rows {
            raster.runs(row, is_set, &mut spans);
            rows.push(spans.len());
        }
        // Components of runs: two runs in neighbouring rows touch if their columns overlap.
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
        let mut excess = vec![0.0; count];
        let mut rim = raster.rim.iter().peekable();
        let mut runs = Vec::with_capacity(spans.len());
        for row in 0..raster.rows {
            for n in rows[row]..rows[row + 1] {
                let (span, label) = (spans[n], labels[n]);
                let own = &mut pixels[label as usize];
                if *own == 0 {
                    middle[label as usize] = [row, (span[0] + span[1]) as usize / 2];
                }
                *own += u64::from(span[1] - span[0]);
                // Pixels of the outline between runs belong to the other set, void or solid.
                let end = (row as u32, span[1]);
                while let Some(p) = rim.next_if(|p| (p.row, p.column) < end) {
                    if (p.row, p.column) >= (row as u32, span[0]) {
                        excess[label as usize] += f64::from(p.excess);
                    }
                }
                runs.push((span, label));
            }
        }
        let areas = pixels.iter().zip(&excess);
        Self {
            runs,
            rows,
            areas: areas.map(|(n, e)| *n as f64 + e).collect(),
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

/// Visits the pairs of runs of two rows that overlap. Runs ascend in both rows; the one that ends first is left.
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
        let solid = Components::of_solid(&raster);
        assert_eq!(solid.pixels, [5, 64, 4, 1, 1]);
        assert_eq!(solid.pixels.iter().sum::<u64>(), raster.area() as u64);
        let void = Components::of_void(&raster);
        assert_eq!(void.pixels.len(), 1);
        assert_eq!(void.pixels[0] + raster.area() as u64, (5 * columns) as u64);
    }

    #[test]
    fn pixels_of_a_disc_have_its_area() {
        // A disc between the centres of pixels, and one on them.
        for (centre, radius) in [([10.3, 9.8], 7.4), ([10.0, 10.0], 6.0)] {
            let value =
                |r: i64, c: i64| (r as f64 - centre[0]).hypot(c as f64 - centre[1]) - radius;
            let mut raster = Raster::new(21, 21);
            let mut rim = Vec::new();
            for row in 0..21 {
                let bits = (0..21).fold(0, |w, c| w | u64::from(value(row, c) < 0.0) << c);
                raster.set(row as usize, 0, bits);
                for column in 0..21 {
                    let around = [-1, 0, 1].map(|r| [-1, 0, 1].map(|c| value(row + r, column + c)));
                    rim.extend(RimPixel::of(&around, [row as u32, column as u32]));
                }
            }
            raster.set_rim(rim);
            let exact = std::f64::consts::PI * radius * radius;
            assert!(
                (raster.area() / exact - 1.0).abs() < 0.01,
                "{}",
                raster.area()
            );
            let [solid, void] = [true, false].map(|side| Components::of(&raster, side));
            assert!((solid.areas[0] - raster.area()).abs() < 1e-9);
            // The margin's outer half pixels belong to no cell, but are counted.
            assert!((void.areas[0] + raster.area() - 441.0).abs() < 1e-3);
        }
    }

    #[test]
    fn parts_of_cells_are_exact_for_straight_outlines() {
        for at in [0.0, 0.2, 0.5, 0.99] {
            assert!((solid_part(&[-at, -at, 1.0 - at, 1.0 - at]) - at).abs() < 1e-12);
        }
        // A corner is cut along the diagonal, and one on which the outline ends is not.
        assert!((solid_part(&[-1.0, 1.0, 3.0, 1.0]) - 0.125).abs() < 1e-12);
        assert!(solid_part(&[-1.0, 0.0, 1.0, 0.0]) <= 0.5);
        assert!((solid_part(&[1.0, -1.0, -3.0, -1.0]) - 0.875).abs() < 1e-12);
    }
}
