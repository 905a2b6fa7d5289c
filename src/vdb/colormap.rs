//! The colour map viridis (Smith and van der Walt, CC0), dark violet to yellow.
//!
//! Colours are linear light, red, green and blue from 0 to 1, between ten anchors. Pictures and plots use the same map.

/// Ten of its colours in sRGB, equally spaced.
const ANCHORS: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 74, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [109, 205, 89],
    [180, 222, 44],
    [253, 231, 37],
];
/// Share of the values beyond each end of the colour range.
const CLIPPED_SHARE: f64 = 0.01;

/// Values of samples and their colour range; empty if there are none.
#[derive(Default)]
pub(super) struct ValueColours {
    values: Vec<f32>,
    range: [f32; 2],
}

impl ValueColours {
    /// Sets the range so that a hundredth of the values lies beyond each end. Zeros, the values beside the
    /// band, are ignored.
    pub fn new(values: Vec<f32>) -> Self {
        let mut sorted: Vec<f32> = values.iter().copied().filter(|v| *v != 0.0).collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| {
            let index = share * sorted.len().saturating_sub(1) as f64;
            sorted.get(index.round() as usize).copied().unwrap_or(0.0)
        };
        let range = [at(CLIPPED_SHARE), at(1.0 - CLIPPED_SHARE)];
        Self { values, range }
    }

    /// The values at the dark and the bright end; both 0 if there are no values.
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Linear colour of a sample; `None` without values.
    pub fn colour(&self, sample: usize) -> Option<[f32; 3]> {
        let [low, high] = self.range;
        let value = *self.values.get(sample)?;
        let span = if high > low { high - low } else { 1.0 };
        Some(linear_colour((value - low) / span))
    }
}

/// The linear colour of a value between 0 and 1. Values beyond 0 and 1 get the colour of that end.
pub(crate) fn linear_colour(share: f32) -> [f32; 3] {
    let t = share.clamp(0.0, 1.0) * (ANCHORS.len() - 1) as f32;
    let n = (t as usize).min(ANCHORS.len() - 2);
    let share = t - n as f32;
    // A power of 2.2 stands for the sRGB curve here.
    let linear = |c: u8| (f32::from(c) / 255.0).powf(2.2);
    std::array::from_fn(|c| {
        let (a, b) = (linear(ANCHORS[n][c]), linear(ANCHORS[n + 1][c]));
        a + (b - a) * share
    })
}
