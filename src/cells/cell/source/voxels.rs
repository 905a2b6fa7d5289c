//! Voxels as sources: samples on the period of the unit cube, scalar or binary.
//!
//! Sample (i, j, k) of N^3 lies at u = (i, j, k)/N - 1/2; axis 0 is x. Between samples the value is
//! trilinear. In hexes and quads the grid repeats with period 1; in other elements the last sample is
//! extended. Binary samples become a signed distance to the surface half way between solid and void.

use crate::cell::edt;
use druse_geometry::frame::Vec3;

/// Minimal number of samples along an axis.
const MIN_SAMPLES_PER_AXIS: usize = 4;
/// Maximal total number of samples.
const MAX_SAMPLES: usize = 1 << 28;
/// If the mean slope of scalar samples differs from 1 by less than this, the samples are distances.
const UNIT_SLOPE_TOLERANCE: f64 = 0.15;

/// Why an array is not a voxel grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VoxelError {
    /// Neither a cube nor a square of samples.
    #[error("an array of shape {0:?}; expected [N, N, N] or [N, N]")]
    Shape(Vec<usize>),
    /// Too few or too many samples.
    #[error(
        "{0} samples along an axis; expected {MIN_SAMPLES_PER_AXIS} to 645, or to 16384 in a square"
    )]
    Count(usize),
    /// A value that is not finite.
    #[error("voxel {index:?} is {value}; expected finite numbers")]
    NotFinite {
        /// Its index, from 0.
        index: [usize; 3],
        /// The value.
        value: f64,
    },
    /// All voxels in one phase.
    #[error("every voxel is {0}; expected solid (negative, or true) and void")]
    OneSided(&'static str),
    /// Too few samples for the band limit.
    #[error(
        "{samples} samples per unit of length are too few for the band limit {band_limit}; expected \
         at least {needed}, or a band limit below {largest:.1}"
    )]
    TooCoarse {
        /// Samples per unit of reference length.
        samples: usize,
        /// The requested band limit R.
        band_limit: f64,
        /// Samples that R requires.
        needed: usize,
        /// Largest R that these samples support.
        largest: f64,
    },
}

/// Samples on a cubic or square grid over one period.
#[derive(Clone, Debug, PartialEq)]
pub struct Voxels {
    counts: [usize; 3],
    values: Vec<f64>,
    binary: bool,
}

impl Voxels {
    /// Voxels from an array of shape [N, N, N] or [N, N], its last axis fastest. Scalar values are negative
    /// in the solid; binary values are nonzero there.
    /// N is the same along all axes, 4 to 645 in space and 4 to 16384 in a plane. The first axis is x.
    ///
    /// # Errors
    /// [`VoxelError`].
    pub fn new(shape: &[usize], values: Vec<f64>, binary: bool) -> Result<Self, VoxelError> {
        let n = shape.first().copied().unwrap_or(0);
        let equal = shape.iter().all(|c| *c == n) && matches!(shape.len(), 2 | 3);
        let total = shape.iter().try_fold(1usize, |t, c| t.checked_mul(*c));
        if !equal || total != Some(values.len()) {
            return Err(VoxelError::Shape(shape.to_vec()));
        }
        if n < MIN_SAMPLES_PER_AXIS || values.len() > MAX_SAMPLES {
            return Err(VoxelError::Count(n));
        }
        let counts = [n, n, if shape.len() == 3 { n } else { 1 }];
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            let [_, ny, nz] = counts;
            // Index of the first bad value; the last axis is the fastest.
            return Err(VoxelError::NotFinite {
                index: [at / (ny * nz), at / nz % ny, at % nz],
                value: values[at],
            });
        }
        let solid = |v: &f64| if binary { *v != 0.0 } else { *v < 0.0 };
        let inside = values.iter().filter(|v| solid(v)).count();
        if inside == 0 || inside == values.len() {
            let side = if inside == 0 { "void" } else { "solid" };
            return Err(VoxelError::OneSided(side));
        }
        Ok(Self {
            counts,
            values,
            binary,
        })
    }

    /// Samples along each axis; 1 along z for a square.
    /// The numbers along x and y are equal.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// The values, z fastest.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Whether the values only distinguish solid (nonzero) from void (0).
    pub fn is_binary(&self) -> bool {
        self.binary
    }

    /// Signed values at the samples over a period, negative in the solid: scalar values themselves, or the
    /// distance in periods from binary samples to the surface between solid and void, which repeats.
    /// In the order of [`Self::values`].
    pub fn signed_over_period(&self) -> Vec<f64> {
        self.signed(true)
    }

    /// As [`Self::signed_over_period`]; without `periodic` the surface ends at the last samples.
    fn signed(&self, periodic: bool) -> Vec<f64> {
        if !self.binary {
            return self.values.clone();
        }
        let solid: Vec<bool> = self.values.iter().map(|v| *v != 0.0).collect();
        let step = 1.0 / self.counts[0] as f64;
        // A square has one sample along z and is constant along it.
        let shape = &self.counts[..if self.counts[2] == 1 { 2 } else { 3 }];
        edt::signed_distance(&solid, shape, &vec![step; shape.len()], periodic)
    }

    /// The interpolated function, and whether it is a distance.
    /// Distances are in periods. Scalar samples count as a distance if their mean slope is within 15 % of 1.
    pub(super) fn function(
        &self,
        periodic: bool,
    ) -> (impl Fn(Vec3) -> f64 + Send + Sync + use<>, bool) {
        let grid = Grid {
            counts: self.counts,
            values: self.signed(periodic),
            periodic,
        };
        let exact = self.binary || (grid.mean_slope() - 1.0).abs() < UNIT_SLOPE_TOLERANCE;
        (move |p| grid.value(p), exact)
    }
}

/// A grid with trilinear interpolation.
struct Grid {
    counts: [usize; 3],
    values: Vec<f64>,
    periodic: bool,
}

impl Grid {
    /// The sample with these indices.
    fn at(&self, [i, j, k]: [usize; 3]) -> f64 {
        self.values[(i * self.counts[1] + j) * self.counts[2] + k]
    }

    /// The trilinear interpolant at a point of the unit cube.
    /// The point is from -1/2 to 1/2 along each axis; beyond, the grid repeats or keeps its last values.
    fn value(&self, p: Vec3) -> f64 {
        // Per axis: the two samples around the point, and the interpolation weight of the second.
        let around: [(usize, usize, f64); 3] = std::array::from_fn(|a| {
            let n = self.counts[a];
            if n == 1 {
                return (0, 0, 0.0);
            }
            let g = (p[a] + 0.5) * n as f64;
            let last = (n - 1) as f64;
            if self.periodic {
                let g = g.rem_euclid(n as f64);
                let i = (g.floor() as usize).min(n - 1);
                (i, (i + 1) % n, g - i as f64)
            } else {
                let g = g.clamp(0.0, last);
                let i = (g.floor() as usize).min(n - 2);
                (i, i + 1, g - i as f64)
            }
        });
        let [x, y, z] = around;
        let along_z = |i, j| self.at([i, j, z.0]) * (1.0 - z.2) + self.at([i, j, z.1]) * z.2;
        let along_y = |i| along_z(i, y.0) * (1.0 - y.2) + along_z(i, y.1) * y.2;
        along_y(x.0) * (1.0 - x.2) + along_y(x.1) * x.2
    }

    /// Mean length of the gradient near the surface, from differences of neighbours.
    /// Per period; 0 if no cell is crossed. A square has no slope along z.
    fn mean_slope(&self) -> f64 {
        let [nx, ny, nz] = self.counts;
        let scale = nx as f64;
        let (mut sum, mut count) = (0.0, 0usize);
        for i in 0..nx - 1 {
            for j in 0..ny - 1 {
                for k in 0..nz.max(2) - 1 {
                    let v = self.at([i, j, k]);
                    let dx = self.at([i + 1, j, k]) - v;
                    let dy = self.at([i, j + 1, k]) - v;
                    let dz = if nz == 1 {
                        0.0
                    } else {
                        self.at([i, j, k + 1]) - v
                    };
                    // Only cells that the surface crosses count; elsewhere the slope is arbitrary.
                    let least = v.min(v + dx).min(v + dy).min(v + dz);
                    let greatest = v.max(v + dx).max(v + dy).max(v + dz);
                    if least < 0.0 && greatest >= 0.0 {
                        sum += Vec3::new(dx, dy, dz).norm() * scale;
                        count += 1;
                    }
                }
            }
        }
        if count == 0 { 0.0 } else { sum / count as f64 }
    }
}
