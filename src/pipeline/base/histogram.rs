//! Histogram of wall thicknesses or of gaps, for the report: counts in equal bins, in the recipe's unit. Counts
//! are samples and not areas.

use serde::Serialize;

/// Number of bins.
const BINS: usize = 32;
/// Share of the samples that the bins cover; a few thick spots would hide the rest.
const COVERED_SHARE: f64 = 0.99;

/// Numbers of samples by diameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Histogram {
    /// Ascending limits of the bins, one more than bins.
    pub edges: Vec<f64>,
    /// Samples in each bin.
    pub counts: Vec<u64>,
    /// Samples above the last bin.
    pub above: u64,
}

impl Histogram {
    /// The histogram of ascending values (diameters, recipe units), and of `above` samples that are greater than
    /// all of them and whose values are unknown. The bins are equally wide from 0 to the percentile of
    /// `COVERED_SHARE`. `None` without any value.
    pub(crate) fn of(ascending: &[f64], above: u64) -> Option<Self> {
        // Index of the greatest value that the bins still cover.
        let last = ((ascending.len() as f64 * COVERED_SHARE).ceil() as usize).max(1) - 1;
        let top = *ascending.get(last)?;
        let edges: Vec<f64> = (0..=BINS).map(|n| top * n as f64 / BINS as f64).collect();
        let below = |limit: f64| ascending.partition_point(|v| *v <= limit) as u64;
        let ends: Vec<u64> = edges.iter().map(|&e| below(e)).collect();
        Some(Self {
            counts: ends.windows(2).map(|w| w[1] - w[0]).collect(),
            above: above + ascending.len() as u64 - ends[BINS],
            edges,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Histogram;

    #[test]
    fn bins_count_every_sample_once() {
        let values: Vec<f64> = (1..=1000).map(f64::from).collect();
        let found = Histogram::of(&values, 5).unwrap();
        assert_eq!(found.edges.len(), found.counts.len() + 1);
        assert_eq!(found.edges[32], 990.0);
        assert_eq!(found.counts.iter().sum::<u64>() + found.above, 1005);
        assert_eq!(found.above, 15);
        assert_eq!(Histogram::of(&[], 5), None);
    }
}
