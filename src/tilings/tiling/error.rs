//! Why a cell cannot be tiled over a scaffold.

/// Why a cell cannot be tiled over a scaffold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TilingError {
    /// The scaffold has elements of another shape than the cell.
    #[error("the cell fills a {cell}, but element {number} of the scaffold is a {found}")]
    Shape {
        /// Name of the cell's element.
        cell: &'static str,
        /// The first element that differs, by its number in the file; without a file its index.
        number: u64,
        /// Name of its shape.
        found: &'static str,
    },
    /// Two neighbours' copies of a cell differ on the common face.
    #[error(
        "the cell does not continue from element {} (a {}) to element {} (a {}): its values on their \
         common face differ by {jump:.3} reference lengths; use a cell with its element's whole group, \
         and in mixed meshes cells that agree on faces, or all_hex = true with one hex cell",
        elements[0], shapes[0], elements[1], shapes[1]
    )]
    Discontinuity {
        /// Numbers of the elements in their file.
        elements: [u64; 2],
        /// Names of their shapes.
        shapes: [&'static str; 2],
        /// The greatest difference found, over the mean slope.
        jump: f64,
    },
    /// No turns of the elements make the cell continue over all faces.
    #[error(transparent)]
    Misfit(Box<super::misfit::Misfit>),
    /// Weights whose sum is not positive and finite.
    #[error("the weights at ({}, {}, {}) sum to {sum}; expected a positive, finite sum", at[0], at[1], at[2])]
    Weights {
        /// The node or control point, world coordinates.
        at: [f64; 3],
        /// Their sum there.
        sum: f64,
    },
    /// Too few or too many weights.
    #[error("{found} weights; expected {expected}, one for each of at most 8 cells at each place")]
    WeightCount {
        /// Number of weights given.
        found: usize,
        /// Number of weights expected.
        expected: usize,
    },
    /// Smoothed weights in a pyramid, which has none.
    #[error(
        "element {number} is a pyramid, whose weights cannot be smoothed; expected linear ones"
    )]
    Smoothstep {
        /// Its number in the file.
        number: u64,
    },
    /// A length is not positive and finite.
    #[error("{what} is {value}; expected a positive, finite length")]
    Length {
        /// Name of the length.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The scaffold is empty.
    #[error("the scaffold has no elements")]
    Empty,
    /// The cell's gradient vanishes or is not finite, so that it has no distance.
    #[error(
        "the cell's gradient has the root mean square {rms} on its surface and the bound {sup}; expected positive, finite numbers (does the cell have a surface?)"
    )]
    Slope {
        /// Root mean square of the gradient on the surface.
        rms: f64,
        /// Its bound.
        sup: f64,
    },
}
