//! Samples of a picture: one per pixel, and further samples of pixels with an edge in them.
//!
//! Samples are numbered row by row over a grid twice as fine as the pixels. The first pass has one per pixel; pixels
//! whose neighbour belongs to another surface, shadow or cut get the other three. So the cost of smooth edges follows
//! the length of the edges.

/// The hits of all samples; none where a ray misses.
pub(super) struct Samples {
    width: usize,
    height: usize,
    /// The first sample of every pixel, row by row; then the extra samples of divided pixels.
    hits: Vec<Option<Hit>>,
    /// For each pixel the start of its extra samples, or 0.
    extra: Vec<u32>,
}

/// Extra samples of a divided pixel.
const EXTRA_SAMPLES: usize = SAMPLES_PER_EDGE * SAMPLES_PER_EDGE - 1;
/// Least cosine between the normals of neighbouring pixels on one surface: 32 degrees.
const MIN_NORMAL_COSINE: f32 = 0.85;
/// Greatest squared sine of the angle between the tangent plane and the line to a neighbouring pixel on one surface: 18
/// degrees.
const MAX_RISE: f32 = 0.1;

impl Samples {
    /// The samples of an empty picture.
    pub fn empty(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            hits: vec![None; width * height],
            extra: vec![0; width * height],
        }
    }

    /// Traces the first sample of every pixel. `trace` returns the hits of the samples with given numbers, on
    /// a grid `SAMPLES_PER_EDGE` times as fine as the pixels.
    pub fn first<E>(
        width: usize,
        height: usize,
        trace: &mut impl FnMut(&[u32]) -> Result<Vec<Option<Hit>>, E>,
    ) -> Result<Self, E> {
        let numbers: Vec<u32> = (0..width * height).map(|n| number(width, n, 0)).collect();
        Ok(Self {
            hits: trace(&numbers)?,
            ..Self::empty(width, height)
        })
    }

    /// Traces the extra samples of pixels with an edge towards a neighbour. `trace` returns a hit or
    /// `None` for each number of a sample.
    pub fn divide<E>(
        &mut self,
        trace: &mut impl FnMut(&[u32]) -> Result<Vec<Option<Hit>>, E>,
    ) -> Result<(), E> {
        let (width, height) = (self.width, self.height);
        let mut has_edge = vec![false; width * height];
        for n in 0..width * height {
            let right = (n % width + 1 < width).then_some(n + 1);
            let below = (n + width < width * height).then_some(n + width);
            // Each pair of neighbours once; an edge marks both pixels.
            for next in [right, below].into_iter().flatten() {
                if is_edge(self.hits[n].as_ref(), self.hits[next].as_ref()) {
                    has_edge[n] = true;
                    has_edge[next] = true;
                }
            }
        }
        let mut numbers = Vec::new();
        for n in (0..width * height).filter(|&n| has_edge[n]) {
            // Extra samples follow those of all pixels; the pixel keeps the number of its first extra one.
            self.extra[n] = (width * height + numbers.len()) as u32;
            numbers.extend((1..=EXTRA_SAMPLES).map(|k| number(width, n, k)));
        }
        if !numbers.is_empty() {
            self.hits.extend(trace(&numbers)?);
        }
        Ok(())
    }

    /// The hits of all samples.
    pub fn hits(&self) -> &[Option<Hit>] {
        &self.hits
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The hit of the first sample of a pixel.
    pub fn pixel(&self, i: usize, j: usize) -> Option<&Hit> {
        self.hits[j * self.width + i].as_ref()
    }

    /// The numbers of the samples of a pixel.
    pub fn of_pixel(&self, n: usize) -> impl Iterator<Item = usize> {
        let extra = self.extra[n] as usize;
        let count = if extra == 0 { 0 } else { EXTRA_SAMPLES };
        std::iter::once(n).chain(extra..extra + count)
    }

    /// The divided pixels.
    pub fn divided(&self) -> impl Iterator<Item = usize> {
        (0..self.extra.len()).filter(|&n| self.extra[n] != 0)
    }
}

/// The number of sample `k` of pixel `n` among all samples, row by row.
fn number(width: usize, n: usize, k: usize) -> u32 {
    let (i, j) = (
        n % width * SAMPLES_PER_EDGE + k % SAMPLES_PER_EDGE,
        n / width * SAMPLES_PER_EDGE + k / SAMPLES_PER_EDGE,
    );
    (j * width * SAMPLES_PER_EDGE + i) as u32
}

/// Whether there is an edge between neighbouring pixels: another surface, or a boundary of a shadow or cut.
fn is_edge(first: Option<&Hit>, second: Option<&Hit>) -> bool {
    let (Some(a), Some(b)) = (first, second) else {
        return first.is_some() != second.is_some();
    };
    let to = b.position - a.position;
    a.on_cut != b.on_cut
        || a.lit != b.lit
        || a.normal.dot(&b.normal) < MIN_NORMAL_COSINE
        || a.normal.dot(&to).powi(2) > MAX_RISE * to.norm_squared()
}

/// Samples along each edge of a divided pixel.
pub(super) const SAMPLES_PER_EDGE: usize = 2;

/// A position or direction in single precision, which saves memory per sample.
pub(super) type Vec3f = nalgebra::Vector3<f32>;

/// The intersection of a ray with the solid.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// Position relative to the eye.
    pub position: Vec3f,
    pub normal: Vec3f,
    pub on_cut: bool,
    pub lit: bool, // by the key light
}
