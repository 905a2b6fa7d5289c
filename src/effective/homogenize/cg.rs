//! Preconditioned conjugate gradients on periodic fields, the same bytes at any number of threads.
//!
//! Solution and residual are in double precision; search directions are rounded to single precision, which
//! changes the path and not the result, since the residual is that of the rounded direction.

use super::HomogenizeError;
use druse_geometry::progress::Progress;
use druse_geometry::simd::run_vectorized;
use rayon::prelude::*;

/// Number of values that one task sums or updates, 64 KiB; another one changes the rounding of sums.
pub(super) const CHUNK_LENGTH: usize = 1 << 13;

/// A symmetric positive system on periodic fields.
pub(super) trait System {
    /// q = K p, for the homogeneous problem (no load).
    fn apply(&self, p: &[f32], q: &mut [f64]);
    /// The residual r = f - K u of a solution under the present load f.
    fn residual(&self, u: &[f64], r: &mut [f64]);
    /// z = P r with P an approximate, symmetric inverse of K. Buffers of transforms change, hence `&mut`.
    fn precondition(&mut self, r: &[f64], z: &mut [f64]);
}

/// When iterations end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// Residual over that of the load alone, in the norm of strains.
    pub tolerance: f64,
    /// Iterations after which the solution is refused.
    pub max_iterations: usize,
}

impl Default for Control {
    fn default() -> Self {
        Self {
            tolerance: 1e-6, // A stiffness errs by its square.
            max_iterations: 5000,
        }
    }
}

/// Buffers that all load cases share: the residual `r`, the vector `q` that holds z and then K p, and the search
/// direction `p`. All have one value per component and voxel.
pub(super) struct Workspace {
    r: Vec<f64>,
    q: Vec<f64>,
    p: Vec<f32>,
}

impl Workspace {
    /// Vectors of `count` numbers, all 0.
    pub fn new(count: usize) -> Self {
        Self {
            r: vec![0.0; count],
            q: vec![0.0; count],
            p: vec![0.0; count],
        }
    }
}

/// The sum of products, chunk by chunk in a fixed order, so that it does not depend on the threads. Eight partial
/// sums per chunk let the compiler vectorise.
pub(super) fn dot<T: Copy + Into<f64> + Sync>(a: &[T], b: &[f64]) -> f64 {
    let parts: Vec<f64> = a
        .par_chunks(CHUNK_LENGTH)
        .zip(b.par_chunks(CHUNK_LENGTH))
        .map(|(a, b)| {
            let mut lanes = [0.0; 8];
            run_vectorized(
                #[inline(always)]
                || {
                    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
                    let tail = ca.remainder().iter().zip(cb.remainder());
                    let tail: f64 = tail.map(|(x, y)| (*x).into() * y).sum();
                    for (x, y) in ca.zip(cb) {
                        for i in 0..8 {
                            lanes[i] += x[i].into() * y[i];
                        }
                    }
                    lanes[0] += tail;
                },
            );
            lanes.iter().sum()
        })
        .collect();
    parts.iter().sum()
}

/// y += factor x, in place.
pub(super) fn add<T: Copy + Into<f64> + Sync>(y: &mut [f64], factor: f64, x: &[T]) {
    y.par_chunks_mut(CHUNK_LENGTH)
        .zip(x.par_chunks(CHUNK_LENGTH))
        .for_each(|(y, x)| {
            run_vectorized(
                #[inline(always)]
                || {
                    for (y, x) in y.iter_mut().zip(x) {
                        *y += factor * (*x).into();
                    }
                },
            );
        });
}

/// Where the iterations begin.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Begin {
    /// At zero: the first residual is that of the load.
    Zero,
    /// At the solution of a similar system.
    Given,
}

impl Begin {
    /// At `u` if it has `count` values, otherwise at zero, for which `u` is filled.
    pub fn at(u: &mut Vec<f64>, count: usize) -> Self {
        if u.len() == count {
            return Self::Given;
        }
        Self::at_zero(u, count)
    }

    /// At zero, for which `u` is filled with `count` values.
    pub fn at_zero(u: &mut Vec<f64>, count: usize) -> Self {
        u.clear();
        u.resize(count, 0.0);
        Self::Zero
    }
}

/// Solves K u = f for the present load f of `system`, beginning at `u`, which is overwritten; returns the number of
/// iterations. `begin` has to agree with `u`: with `Begin::Zero` it is all zeros. The contents of `space` do not
/// matter.
///
/// # Errors
/// `NotConverged` after `control.max_iterations`, or where a sum is not finite; `Cancelled`. `u` then holds the
/// last iterate. A residual in the null space of K is no error: the iterations end there.
pub(super) fn solve(
    system: &mut impl System,
    u: &mut [f64],
    begin: Begin,
    space: &mut Workspace,
    control: Control,
    progress: &dyn Progress,
) -> Result<usize, HomogenizeError> {
    let Workspace { r, q, p } = space;
    // r . z of a start from zero, to which the tolerance refers.
    let mut goal = None;
    if begin == Begin::Given {
        q.fill(0.0);
        system.residual(q, r);
        system.precondition(r, q);
        goal = Some(dot(r, q));
    }
    system.residual(u, r);
    let mut last = 0.0;
    let mut beta = 0.0;
    for iteration in 0..=control.max_iterations {
        if progress.cancelled() {
            return Err(druse_geometry::progress::Cancelled.into());
        }
        // z = P r. The buffer `q` holds z here, and K p from `apply` on.
        system.precondition(r, q);
        let product = dot(r, q);
        let first = *goal.get_or_insert(product);
        // sqrt(r.z / r0.z0): the residual in the norm of P, which measures strains.
        let residual = (product.max(0.0) / first).sqrt();
        // Without a load the start solves the system; a product that rounding makes 0 or negative ends it too.
        let is_solved = first <= 0.0 || product <= 0.0 || residual <= control.tolerance;
        // The residual of a product that is not a number is 0.
        if is_solved && product.is_finite() {
            return Ok(iteration);
        }
        if iteration == control.max_iterations || !product.is_finite() {
            return Err(HomogenizeError::NotConverged {
                iterations: iteration,
                residual,
                tolerance: control.tolerance,
            });
        }
        if iteration > 0 {
            // beta = r.z / (r.z of the iteration before).
            beta = product / last;
        }
        last = product;
        // p = z + beta p, rounded to single precision.
        p.par_chunks_mut(CHUNK_LENGTH)
            .zip(q.par_chunks(CHUNK_LENGTH))
            .for_each(|(p, z)| {
                run_vectorized(
                    #[inline(always)]
                    || {
                        for (p, z) in p.iter_mut().zip(z) {
                            // At the first iteration p is that of the load before: it is not read, since it
                            // need not be finite.
                            let old = if beta == 0.0 {
                                0.0
                            } else {
                                beta * f64::from(*p)
                            };
                            *p = (z + old) as f32;
                        }
                    },
                );
            });
        system.apply(p, q);
        let curvature = dot(p, q);
        if curvature <= 0.0 {
            // The residual lies in the null space of the operator.
            return Ok(iteration);
        }
        // alpha = r.z / (p . K p); u += alpha p; r -= alpha K p.
        let alpha = product / curvature;
        add(u, alpha, p);
        add(r, -alpha, q);
    }
    // The last pass of the loop always returns, so that this line is not reached.
    Ok(control.max_iterations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::progress::Silent;

    /// K = diag(1, 4) with P = 1, under the load (1, 2); `apply` takes `last` for 4.
    struct Diagonal {
        last: f64,
    }

    impl System for Diagonal {
        fn apply(&self, p: &[f32], q: &mut [f64]) {
            q.copy_from_slice(&[f64::from(p[0]), self.last * f64::from(p[1])]);
        }

        fn residual(&self, u: &[f64], r: &mut [f64]) {
            r.copy_from_slice(&[1.0 - u[0], 2.0 - 4.0 * u[1]]);
        }

        fn precondition(&mut self, r: &[f64], z: &mut [f64]) {
            z.copy_from_slice(r);
        }
    }

    #[test]
    fn sums_that_are_not_finite_are_no_solution() {
        let run = |last| {
            let mut u = [0.0; 2];
            let mut space = Workspace::new(2);
            let mut system = Diagonal { last };
            let control = Control::default();
            solve(
                &mut system,
                &mut u,
                Begin::Zero,
                &mut space,
                control,
                &Silent,
            )
            .map(|_| u)
        };
        let u = run(4.0).unwrap();
        assert!(
            (u[0] - 1.0).abs() < 1e-5 && (u[1] - 0.5).abs() < 1e-5,
            "{u:?}"
        );
        // The first residual is finite, the second is not.
        assert!(run(f64::NAN).is_err());
        assert!(run(f64::INFINITY).is_err());
    }
}
