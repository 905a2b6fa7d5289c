//! Limits between which values matter, sample by sample.
//!
//! A minimum of fields needs one of them only where it is less than the others, a band only values nearer than its half
//! width, and a sign only the side of 0. So each reader of a lattice passes limits down, and a field that costs much
//! leaves out the samples that other fields have decided.

/// For each sample of a lattice, an open interval (low, high). Only values in it are needed exactly: any value that is
/// at most `low` stands for each other one, and so does any value that is at least `high`. Where `low` is not less
/// than `high`, the value is not needed.
#[derive(Clone, Debug, Default)]
pub struct ValueLimits {
    pub(super) low: Vec<f32>,
    pub(super) high: Vec<f32>,
}

impl ValueLimits {
    /// Limits sample by sample.
    ///
    /// # Panics
    /// When the numbers of the two differ.
    pub fn new(low: Vec<f32>, high: Vec<f32>) -> Self {
        assert_eq!(low.len(), high.len(), "two limits per sample");
        Self { low, high }
    }

    /// The same limits for `count` samples.
    pub fn uniform(count: usize, [low, high]: [f32; 2]) -> Self {
        Self {
            low: vec![low; count],
            high: vec![high; count],
        }
    }

    /// Replaces the limits by those of samples whose signs alone are needed, and only where a bit of `needed` is set,
    /// in rows of `along` samples; zero is not negative. No normal number lies between the limits: signs suffice.
    pub fn set_signs(&mut self, needed: &[u64], along: usize) {
        let [low, high] = [-f32::MIN_POSITIVE, 0.0];
        let bits = needed
            .iter()
            .flat_map(|row| (0..along).map(move |k| row >> k & 1));
        self.low.clear();
        self.low
            .extend(bits.map(|bit| if bit == 0 { high } else { low }));
        self.high.clear();
        self.high.resize(self.low.len(), high);
    }

    /// Whether the value of sample `n` is needed.
    #[inline]
    pub fn is_needed(&self, n: usize) -> bool {
        self.low[n] < self.high[n]
    }

    /// The limits of sample `n`.
    #[inline]
    pub fn of_sample(&self, n: usize) -> [f32; 2] {
        [self.low[n], self.high[n]]
    }

    /// The least and the greatest limit of the needed ones among some samples; `None` if none is needed.
    #[inline]
    pub fn hull(&self, samples: impl IntoIterator<Item = usize>) -> Option<[f32; 2]> {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for n in samples {
            if self.is_needed(n) {
                low = low.min(self.low[n]);
                high = high.max(self.high[n]);
            }
        }
        (low < high).then_some([low, high])
    }

    /// [`Self::hull`] of all samples, in eight lanes that the compiler turns into vector instructions.
    pub fn hull_of_all(&self) -> Option<[f32; 2]> {
        const LANES: usize = 8;
        let (mut lows, mut highs) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        for (low, high) in self.low.chunks(LANES).zip(self.high.chunks(LANES)) {
            let lanes = lows.iter_mut().zip(&mut highs);
            for ((least, most), (&low, &high)) in lanes.zip(low.iter().zip(high)) {
                let is_needed = low < high;
                *least = if is_needed && low < *least {
                    low
                } else {
                    *least
                };
                *most = if is_needed && high > *most {
                    high
                } else {
                    *most
                };
            }
        }
        let low = lows.into_iter().fold(f32::INFINITY, f32::min);
        let high = highs.into_iter().fold(f32::NEG_INFINITY, f32::max);
        (low < high).then_some([low, high])
    }

    /// The limits of the field whose negative has these limits.
    #[must_use]
    pub fn negated(&self) -> Self {
        Self {
            low: self.high.iter().map(|v| -v).collect(),
            high: self.low.iter().map(|v| -v).collect(),
        }
    }
}
