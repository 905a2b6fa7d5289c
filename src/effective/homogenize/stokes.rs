//! Permeability of the void: creeping flow through one period, by finite volumes on a staggered grid.
//!
//! Velocities stand on the faces of voxels, pressures in their centres (Harlow and Welch 1965), so that the
//! flow is free of divergence voxel by voxel. Walls are the faces between void and solid voxels: velocities
//! across them are 0, those along them are mirrored half a voxel away. A unit force per volume acts on the
//! fluid; the mean velocity over the whole period, solid included, is a column of the permeability for a fluid
//! of viscosity 1, reference length squared. The symmetric indefinite system is solved by preconditioned
//! MINRES (Paige and Saunders 1975; Elman, Silvester and Wathen): the inverse Laplacian of the period for
//! velocities, the identity for pressures.
//!
//! A field lies layer by layer across x, and each layer holds the velocities along x, y, z and the pressure, over y
//! and z. The error is of second order in the voxel along flat walls
//! (`a_slit_has_the_permeability_of_poiseuille`) and
//! below 2 % at 96 voxels for cylinders, whose walls are cut into steps
//! (`a_square_array_of_cylinders_has_the_permeability_of_its_series`).

use super::HomogenizeError;
use super::cg::{CHUNK_LENGTH, Control, add, dot};
use super::grid::Grid;
use super::spectral::Spectral;
use druse_geometry::progress::Progress;
use rayon::prelude::*;

/// Number of components of a field: three velocities and the pressure.
const FIELD_COUNT: usize = 4;

/// The flow problem of one period.
pub struct Stokes {
    grid: Grid,
    /// Bits a: the lower face across axis a lies in the fluid; bit 3: the voxel is fluid.
    flags: Vec<u8>,
    /// Of each velocity four bits: how many neighbours along each of the other two axes lie inside a wall, half
    /// a voxel behind its face.
    ghosts: Vec<u16>,
    /// The factor of a velocity in its own equation, by those four bits.
    diagonals: [[f64; 16]; 3],
    spectral: Spectral<3>,
    /// Squares of the frequencies along each axis.
    squares: [Vec<f64>; 3],
    /// Smallest positive square; 1 where all axes have one voxel.
    least: f64,
    /// Drag of each voxel, per reference length squared; empty where walls stop the flow.
    drag: Vec<f64>,
    /// What the preconditioner adds to the squares for it.
    shift: f64,
}

/// The results of the directions of flow that were solved.
#[derive(Clone, Debug)]
pub struct Permeability {
    /// The permeability, reference length squared; columns of other directions are 0.
    pub matrix: [[f64; 3]; 3],
    /// Iterations of each direction.
    pub iterations: [usize; 3],
}

impl Stokes {
    /// The flow problem of the voxels for which `is_fluid` is true.
    ///
    /// # Errors
    /// [`HomogenizeError::NoWalls`] where all voxels are fluid.
    pub fn new(grid: Grid, is_fluid: impl Fn(usize) -> bool) -> Result<Self, HomogenizeError> {
        let counts = grid.counts();
        let strides = [counts[1] * counts[2], counts[2], 1];
        let flags: Vec<u8> = (0..grid.voxels())
            .map(|n| {
                if !is_fluid(n) {
                    return 0;
                }
                // A velocity is free on faces between two fluid voxels.
                let mut flag = 8;
                for axis in 0..3 {
                    let at = n / strides[axis] % counts[axis];
                    let before = if at == 0 {
                        n + (counts[axis] - 1) * strides[axis]
                    } else {
                        n - strides[axis]
                    };
                    flag |= u8::from(is_fluid(before)) << axis;
                }
                flag
            })
            .collect();
        if flags.iter().all(|f| f & 8 != 0) {
            return Err(HomogenizeError::NoWalls);
        }
        let spacing = grid.spacing();
        // The Laplacian: sum_a (2 u - u_before - u_after) / h_a^2. A neighbour inside a wall is -u, so that
        // the velocity is 0 half way, on the wall; it adds 1 / h_a^2 to the diagonal.
        let weights = spacing.map(|h| 1.0 / (h * h));
        let diagonals = std::array::from_fn(|c: usize| {
            std::array::from_fn(|code: usize| {
                let [a, b] = others(c);
                // A mirrored neighbour counts once more.
                2.0 * weights.iter().sum::<f64>()
                    + weights[a] * (code & 3) as f64
                    + weights[b] * (code >> 2) as f64
            })
        });
        let ghosts = ghosts(grid, &flags);
        // The eigenvalues of that Laplacian without walls: (2 / h_a sin(pi k / N_a))^2 for the frequency k.
        let squares = std::array::from_fn(|a| {
            let value = |k: usize| {
                let angle = std::f64::consts::PI * k as f64 / counts[a] as f64;
                (2.0 / spacing[a] * libm::sin(angle)).powi(2)
            };
            (0..counts[a]).map(value).collect::<Vec<f64>>()
        });
        // The frequency 0 has no inverse; the preconditioner gives it this least positive eigenvalue.
        let least = squares
            .iter()
            .filter_map(|s| s.get(1).copied())
            .fold(f64::INFINITY, f64::min);
        Ok(Self {
            spectral: Spectral::new(counts),
            grid,
            flags,
            ghosts,
            diagonals,
            squares,
            least: if least.is_finite() { least } else { 1.0 },
            drag: Vec::new(),
            shift: 0.0,
        })
    }

    /// The flow through all voxels against a drag in each (Brinkman's equation, drag per reference length squared): a
    /// solid without sharp walls, whose permeability has derivatives.
    ///
    /// # Errors
    /// [`HomogenizeError::NoWalls`] where nothing drags, [`HomogenizeError::Grid`] for another number of
    /// values.
    pub fn with_drag(grid: Grid, drag: Vec<f64>) -> Result<Self, HomogenizeError> {
        if drag.len() != grid.voxels() {
            return Err(HomogenizeError::Grid(format!(
                "found {} values of drag; expected {}, one of each voxel",
                drag.len(),
                grid.voxels()
            )));
        }
        let greatest = drag.iter().copied().fold(0.0, f64::max);
        if greatest <= 0.0 {
            return Err(HomogenizeError::NoWalls);
        }
        // `new` refuses a medium without walls: voxel 0 is a wall for the moment, and all marks are replaced.
        let mut flow = Self::new(grid, |n| n > 0)?;
        flow.flags.fill(15);
        flow.ghosts.fill(0);
        // Between the slowest mode of the void and the drag of the solid.
        flow.shift = (greatest * flow.least).sqrt();
        flow.drag = drag;
        Ok(flow)
    }

    /// The flow under a unit force along an axis: its mean velocity, and the derivative of the component along the axis
    /// by the drag in each voxel, times the number of voxels. For flows of [`Stokes::with_drag`].
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn respond(
        &mut self,
        axis: usize,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<([f64; 3], Vec<f64>), HomogenizeError> {
        let mut velocity = vec![0.0; FIELD_COUNT * self.grid.voxels()];
        let (mean, _) = self.minres(axis, Some(&mut velocity), control, progress)?;
        let [nx, ny, nz] = self.grid.counts();
        let layer = self.grid.layer();
        let square = |c: usize, [i, j, k]: [usize; 3]| {
            velocity[(i * FIELD_COUNT + c) * layer + j * nz + k].powi(2)
        };
        let by_drag = (0..self.grid.voxels()).map(|n| {
            let at = [n / (ny * nz), n / nz % ny, n % nz];
            let after = |a: usize| {
                let mut next = at;
                next[a] = (at[a] + 1) % [nx, ny, nz][a];
                next
            };
            // d<u_axis> / d drag = -|u|^2, for the operator is self-adjoint. The drag on a face is the mean
            // of both voxels, so that a voxel has half the square of each of its six faces.
            let faces = (0..3).map(|c| square(c, at) + square(c, after(c)));
            -0.5 * faces.sum::<f64>()
        });
        Ok((mean, by_drag.collect()))
    }

    /// Bytes for each voxel that a solution without drag takes: six fields of MINRES, transforms, flags and ghosts.
    pub const BYTES_PER_VOXEL: u64 =
        6 * 8 * FIELD_COUNT as u64 + Spectral::<3>::BYTES_PER_VOXEL + 3;

    /// The operator y = A x: minus the Laplacian and the gradient of the pressure; minus the divergence. Velocities
    /// outside the fluid are 0 in `x`. The mark `flags[k] >> c & 1` is 1 where the lower face across axis c is free.
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        let [nx, ny, nz] = self.grid.counts();
        let spacing = self.grid.spacing();
        let layer = ny * nz;
        let weights = spacing.map(|h| 1.0 / (h * h));
        let inverse = spacing.map(f64::recip);
        let row = |i: usize, c: usize, j: usize| {
            let at = ((i * FIELD_COUNT + c) * ny + j) * nz;
            &x[at..at + nz]
        };
        y.par_chunks_mut(FIELD_COUNT * layer)
            .enumerate()
            .for_each(|(i, out)| {
                let (im, ip) = ((i + nx - 1) % nx, (i + 1) % nx);
                for j in 0..ny {
                    let (jm, jp) = ((j + ny - 1) % ny, (j + 1) % ny);
                    let first = (i * ny + j) * nz;
                    let flags = &self.flags[first..first + nz];
                    let ghosts = &self.ghosts[first..first + nz];
                    let pressure = row(i, 3, j);
                    for c in 0..3 {
                        let out = &mut out[c * layer + j * nz..c * layer + (j + 1) * nz];
                        let velocity = row(i, c, j);
                        let across = [row(im, c, j), row(ip, c, j)];
                        let beside = [row(i, c, jm), row(i, c, jp)];
                        let before = match c {
                            0 => row(im, 3, j),
                            1 => row(i, 3, jm),
                            _ => pressure,
                        };
                        // Half of that of the voxels on both sides of a face.
                        let drag = |k: usize| {
                            if self.drag.is_empty() {
                                return 0.0;
                            }
                            // The voxel before the face.
                            let lower = match c {
                                0 => (im * ny + j) * nz + k,
                                1 => (i * ny + jm) * nz + k,
                                _ => first + if k == 0 { nz - 1 } else { k - 1 },
                            };
                            f64::midpoint(self.drag[first + k], self.drag[lower])
                        };
                        // -Laplace u + drag u + dp/dx_c on each free face.
                        for k in 0..nz {
                            if flags[k] >> c & 1 == 0 {
                                out[k] = 0.0;
                                continue;
                            }
                            let km = if k == 0 { nz - 1 } else { k - 1 };
                            let kp = if k + 1 == nz { 0 } else { k + 1 };
                            let around = weights[0] * (across[0][k] + across[1][k])
                                + weights[1] * (beside[0][k] + beside[1][k])
                                + weights[2] * (velocity[km] + velocity[kp]);
                            let diagonal =
                                self.diagonals[c][usize::from(ghosts[k] >> (4 * c) & 15)];
                            let lower = if c == 2 { before[km] } else { before[k] };
                            out[k] = (diagonal + drag(k)) * velocity[k] - around
                                + (pressure[k] - lower) * inverse[c];
                        }
                    }
                    let out = &mut out[3 * layer + j * nz..3 * layer + (j + 1) * nz];
                    let [u, v, w] = [row(i, 0, j), row(i, 1, j), row(i, 2, j)];
                    let (u_next, v_next) = (row(ip, 0, j), row(i, 1, jp));
                    for k in 0..nz {
                        let kp = if k + 1 == nz { 0 } else { k + 1 };
                        // The divergence at the centre of the voxel.
                        let outflow = (u_next[k] - u[k]) * inverse[0]
                            + (v_next[k] - v[k]) * inverse[1]
                            + (w[kp] - w[k]) * inverse[2];
                        out[k] = if flags[k] & 8 == 0 { 0.0 } else { -outflow };
                    }
                }
            });
    }

    /// z = M r: the inverse Laplacian of the period on velocities of the fluid, the identity on pressures. The buffers
    /// of the transforms change.
    fn precondition(&mut self, r: &[f64], z: &mut [f64]) {
        let (squares, least, shift) = (&self.squares, self.least, self.shift);
        self.spectral.apply::<FIELD_COUNT>(r, z, |[i, j, k], v| {
            // 1 / (|xi|^2 + shift), with |xi|^2 the eigenvalue of the Laplacian.
            let square = squares[0][i] + squares[1][j] + squares[2][k];
            let factor = (1.0 / (square.max(least) + shift)) as f32;
            for c in v.iter_mut() {
                *c *= factor;
            }
        });
        let layer = self.grid.layer();
        z.par_chunks_mut(FIELD_COUNT * layer)
            .zip(r.par_chunks(FIELD_COUNT * layer))
            .zip(self.flags.par_chunks(layer))
            .for_each(|((z, r), flags)| {
                // Only velocities on free faces are unknowns. Pressures have the identity.
                for c in 0..3 {
                    for (v, flag) in z[c * layer..].iter_mut().zip(flags) {
                        if flag >> c & 1 == 0 {
                            *v = 0.0;
                        }
                    }
                }
                z[3 * layer..].copy_from_slice(&r[3 * layer..]);
            });
    }

    /// The mean velocity of a field over the whole period.
    fn mean(&self, x: &[f64]) -> [f64; 3] {
        let layer = self.grid.layer();
        let layers: Vec<[f64; 3]> = x
            .par_chunks(FIELD_COUNT * layer)
            .map(|part| {
                std::array::from_fn(|c| part[c * layer..(c + 1) * layer].iter().sum::<f64>())
            })
            .collect();
        let count = self.grid.voxels() as f64;
        std::array::from_fn(|c| layers.iter().map(|l| l[c]).sum::<f64>() / count)
    }

    /// Solves for the flow along the `axes` (0 to 2), each from zero.
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn solve(
        &mut self,
        axes: &[usize],
        control: Control,
        progress: &dyn Progress,
    ) -> Result<Permeability, HomogenizeError> {
        let mut found = Permeability {
            matrix: [[0.0; 3]; 3],
            iterations: [0; 3],
        };
        for &axis in axes {
            let (mean, iterations) = self.minres(axis, None, control, progress)?;
            for (row, m) in found.matrix.iter_mut().zip(mean) {
                row[axis] = m;
            }
            found.iterations[axis] = iterations;
            progress.advance(1);
        }
        Ok(found)
    }

    /// Preconditioned MINRES for a unit force along an axis: the mean velocity and the number of iterations. The
    /// solution is added to `kept`, which holds zeros, four components per voxel.
    fn minres(
        &mut self,
        axis: usize,
        mut kept: Option<&mut Vec<f64>>,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<([f64; 3], usize), HomogenizeError> {
        let layer = self.grid.layer();
        let count = FIELD_COUNT * self.grid.voxels();
        let (mut v_old, mut v) = (vec![0.0; count], vec![0.0; count]);
        for (part, flags) in v
            .chunks_mut(FIELD_COUNT * layer)
            .zip(self.flags.chunks(layer))
        {
            for (value, flag) in part[axis * layer..].iter_mut().zip(flags) {
                *value = f64::from(flag >> axis & 1);
            }
        }
        // M is the preconditioner. v are Lanczos vectors, z = M v, gamma = sqrt(v . z), w directions of the
        // solution, eta the residual's size. The names are those of Elman, Silvester and Wathen.
        let (mut z, mut z_next) = (vec![0.0; count], vec![0.0; count]);
        let (mut w_old, mut w) = (vec![0.0; count], vec![0.0; count]);
        self.precondition(&v, &mut z);
        let mut gamma = dot(&z, &v).max(0.0).sqrt();
        let mut mean = [0.0; 3];
        if gamma == 0.0 {
            return Ok((mean, 0));
        }
        let (start, mut eta) = (gamma, gamma);
        let (mut gamma_old, mut sines, mut cosines) = (1.0, [0.0; 2], [1.0; 2]);
        for iteration in 1..=control.max_iterations {
            if progress.cancelled() {
                return Err(druse_geometry::progress::Cancelled.into());
            }
            scale(&mut z, 1.0 / gamma);
            self.apply(&z, &mut z_next);
            let delta = dot(&z_next, &z);
            // v_next = A z - delta / gamma v - gamma / gamma_old v_old; the next Lanczos vector takes the
            // place of the last one.
            let (first, second) = (-delta / gamma, -gamma / gamma_old);
            combine(&mut v_old, second, &v, first, &z_next);
            std::mem::swap(&mut v_old, &mut v);
            self.precondition(&v, &mut z_next);
            let gamma_next = dot(&z_next, &v).max(0.0).sqrt();
            // Givens rotations make the tridiagonal matrix triangular: alpha3, alpha2 and alpha1 are the
            // entries of its new column.
            let alpha0 = cosines[1] * delta - cosines[0] * sines[1] * gamma;
            let alpha1 = alpha0.hypot(gamma_next);
            let alpha2 = sines[1] * delta + cosines[0] * cosines[1] * gamma;
            let alpha3 = sines[0] * gamma;
            (cosines, sines) = (
                [cosines[1], alpha0 / alpha1],
                [sines[1], gamma_next / alpha1],
            );
            // w_new = (z - alpha3 w_old - alpha2 w) / alpha1.
            combine(&mut w_old, -alpha3, &w, -alpha2, &z);
            scale(&mut w_old, 1.0 / alpha1);
            std::mem::swap(&mut w_old, &mut w);
            // x += c eta w. Only the mean velocity is needed, unless the caller keeps x.
            let step = cosines[1] * eta;
            for (m, own) in mean.iter_mut().zip(self.mean(&w)) {
                *m += step * own;
            }
            if let Some(kept) = &mut kept {
                add(kept, step, &w);
            }
            eta *= -sines[1];
            std::mem::swap(&mut z, &mut z_next);
            (gamma_old, gamma) = (gamma, gamma_next);
            let residual = eta.abs() / start;
            if residual <= control.tolerance || gamma == 0.0 {
                return Ok((mean, iteration));
            }
            if !residual.is_finite() || iteration == control.max_iterations {
                return Err(HomogenizeError::NotConverged {
                    iterations: iteration,
                    residual,
                    tolerance: control.tolerance,
                });
            }
        }
        // Reached only where no iteration is allowed.
        Ok((mean, control.max_iterations))
    }
}

/// The other two axes, in order.
const fn others(axis: usize) -> [usize; 2] {
    match axis {
        0 => [1, 2],
        1 => [0, 2],
        _ => [0, 1],
    }
}

/// Number of neighbours of each velocity inside a wall, along the two axes normal to it: two bits for each axis, four
/// for each velocity.
fn ghosts(grid: Grid, flags: &[u8]) -> Vec<u16> {
    let counts = grid.counts();
    let strides = [counts[1] * counts[2], counts[2], 1];
    // The neighbours of a voxel on an axis, of the next period beyond the ends.
    let at = |n: usize, axis: usize| n / strides[axis] % counts[axis];
    let before = |n: usize, axis: usize| match at(n, axis) {
        0 => n + (counts[axis] - 1) * strides[axis],
        _ => n - strides[axis],
    };
    let after = |n: usize, axis: usize| match at(n, axis) {
        last if last + 1 == counts[axis] => n - last * strides[axis],
        _ => n + strides[axis],
    };
    let is_fluid = |n: usize| flags[n] & 8 != 0;
    (0..flags.len())
        .map(|n| {
            let mut code = 0;
            for c in (0..3).filter(|c| flags[n] >> c & 1 == 1) {
                for (place, axis) in others(c).into_iter().enumerate() {
                    for other in [before(n, axis), after(n, axis)] {
                        // The face between two solid voxels.
                        let is_inside = !is_fluid(other) && !is_fluid(before(other, c));
                        code += u16::from(is_inside) << (4 * c + 2 * place);
                    }
                }
            }
            code
        })
        .collect()
}

/// y = a y + b x + z.
fn combine(y: &mut [f64], a: f64, x: &[f64], b: f64, z: &[f64]) {
    scale(y, a);
    add(y, b, x);
    add(y, 1.0, z);
}

/// y = a y.
fn scale(y: &mut [f64], a: f64) {
    y.par_chunks_mut(CHUNK_LENGTH).for_each(|y| {
        for v in y {
            *v *= a;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slit_has_a_twelfth_of_its_cube() {
        // n of 8 layers are open: h^3 / 12 to second order, with a relative error of 2 / n^2.
        for n in [2, 4, 6] {
            let grid = Grid::new([2, 8, 2], [1.0; 3]).unwrap();
            let mut flow = Stokes::new(grid, |v| v / 2 % 8 < n).unwrap();
            let silent = &druse_geometry::progress::Silent;
            let k = flow.solve(&[0, 1], Control::default(), silent).unwrap();
            let expected = (n as f64 / 8.0).powi(3) / 12.0 * (1.0 + 2.0 / (n * n) as f64);
            assert!((k.matrix[0][0] - expected).hypot(k.matrix[1][1]) < 1e-6);
        }
    }
}
