//! The samples of a picture: one a pixel, and further ones of the pixels in which something ends.

use super::shading::{FINE, Hit};

/// What rays met, or did not.
pub(super) struct Samples {
    width: usize,
    height: usize,
    /// The first sample of every pixel, row by row; then the others of divided pixels.
    hits: Vec<Option<Hit>>,
    /// Of each pixel where its other samples begin, or 0 if it has none.
    others: Vec<u32>,
}

/// Further samples of a pixel that is divided.
const OTHERS: usize = FINE * FINE - 1;
/// Cosine between the normals of two pixels that are taken for one surface.
const SAME_SURFACE: f32 = 0.85;
/// Square of the sine at which one surface may rise over the tangent plane from pixel to pixel.
const RISE: f32 = 0.1;

impl Samples {
    /// Those of a picture of nothing.
    pub fn none(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            hits: vec![None; width * height],
            others: vec![0; width * height],
        }
    }

    /// The first sample of every pixel; `look` finds what the samples with some numbers met, of `FINE` times as
    /// many along both edges as there are pixels.
    pub fn first<E>(
        width: usize,
        height: usize,
        look: &mut impl FnMut(&[u32]) -> Result<Vec<Option<Hit>>, E>,
    ) -> Result<Self, E> {
        let wanted: Vec<u32> = (0..width * height).map(|n| number(width, n, 0)).collect();
        Ok(Self {
            hits: look(&wanted)?,
            ..Self::none(width, height)
        })
    }

    /// Looks for the other samples of the pixels that see something else than the next.
    pub fn divide<E>(
        &mut self,
        look: &mut impl FnMut(&[u32]) -> Result<Vec<Option<Hit>>, E>,
    ) -> Result<(), E> {
        let (width, height) = (self.width, self.height);
        let mut is_mixed = vec![false; width * height];
        for n in 0..width * height {
            let right = (n % width + 1 < width).then_some(n + 1);
            let below = (n + width < width * height).then_some(n + width);
            for next in [right, below].into_iter().flatten() {
                if differ(self.hits[n].as_ref(), self.hits[next].as_ref()) {
                    is_mixed[n] = true;
                    is_mixed[next] = true;
                }
            }
        }
        let mut wanted = Vec::new();
        for n in (0..width * height).filter(|&n| is_mixed[n]) {
            self.others[n] = (width * height + wanted.len()) as u32;
            wanted.extend((1..=OTHERS).map(|k| number(width, n, k)));
        }
        if !wanted.is_empty() {
            self.hits.extend(look(&wanted)?);
        }
        Ok(())
    }

    /// All of them.
    pub fn hits(&self) -> &[Option<Hit>] {
        &self.hits
    }

    /// Pixels along a row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// What the first sample of a pixel met.
    pub fn pixel(&self, i: usize, j: usize) -> Option<&Hit> {
        self.hits[j * self.width + i].as_ref()
    }

    /// The numbers of the samples of a pixel: one, or all.
    pub fn of_pixel(&self, n: usize) -> impl Iterator<Item = usize> {
        let others = self.others[n] as usize;
        let count = if others == 0 { 0 } else { OTHERS };
        std::iter::once(n).chain(others..others + count)
    }

    /// The pixels that are divided.
    pub fn divided(&self) -> impl Iterator<Item = usize> {
        (0..self.others.len()).filter(|&n| self.others[n] != 0)
    }
}

/// The number of sample `k` of pixel `n` among all samples, row by row.
fn number(width: usize, n: usize, k: usize) -> u32 {
    let (i, j) = (n % width * FINE + k % FINE, n / width * FINE + k / FINE);
    (j * width * FINE + i) as u32
}

/// Whether two pixels side by side see more than one surface in one light.
fn differ(one: Option<&Hit>, other: Option<&Hit>) -> bool {
    let (Some(a), Some(b)) = (one, other) else {
        return one.is_some() != other.is_some();
    };
    let to = b.position - a.position;
    a.on_cut != b.on_cut
        || a.lit != b.lit
        || a.normal.dot(&b.normal) < SAME_SURFACE
        || a.normal.dot(&to).powi(2) > RISE * to.norm_squared()
}
