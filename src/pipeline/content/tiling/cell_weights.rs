//! Weights of a tiling's cells at points of elements, for any kind of cells. Weights at a point have the sum 1 and
//! the order of the palette.

use super::CellTiling;
use crate::frame::CellPoint;
use crate::pipeline::base::error::RunError;
use crate::tiling::{TilingError, Weights};

/// Weights of the palette's cells at points.
pub(crate) struct CellWeights<'a> {
    /// `None` for one cell, whose weight is 1 everywhere.
    weights: Option<Weights<'a>>,
    count: usize,
}

impl CellTiling {
    /// The weights of the palette's cells.
    pub fn cell_weights(&self) -> Result<CellWeights<'_>, RunError> {
        let count = self.palette.len();
        let scaffold = &self.loaded.scaffold;
        let is_single = count < 2 || self.weights.is_empty();
        let failed = |e: TilingError| RunError::Tiling(e.to_string());
        let weights = (!is_single).then(|| {
            let values = self.weights.clone();
            Weights::new(scaffold, self.interpolation, count, values).map_err(failed)
        });
        Ok(CellWeights {
            weights: weights.transpose()?,
            count,
        })
    }
}

impl CellWeights<'_> {
    /// Whether there is only one cell.
    pub fn is_single(&self) -> bool {
        self.weights.is_none()
    }

    /// The weights at a point of an element, padded with 0 to eight cells.
    pub fn at(&self, element: usize, xi: CellPoint<3>) -> [f64; 8] {
        match &self.weights {
            Some(weights) => weights.at(element, xi),
            None => std::array::from_fn(|n| f64::from(u8::from(n == 0))),
        }
    }

    /// The weights in the order of the palette.
    pub fn list(&self, element: usize, xi: CellPoint<3>) -> Vec<f64> {
        self.at(element, xi)[..self.count].to_vec()
    }
}
