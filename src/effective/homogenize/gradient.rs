//! Derivatives of effective properties with respect to the coefficients of a cell.
//!
//! The operators are self-adjoint, so that the derivative with respect to the share of solid in a voxel needs
//! only the solutions of the load cases. Shares are differentiable with respect to the samples of the field, and
//! samples are linear in the coefficients; the chain is exact for the discretised problem.

use super::HomogenizeError;
use super::period::{Period, place};
use super::phases::{Samples, part};
use super::tensor::{PAIRS, Voigt};
use druse_cells::cell::Series;
use druse_geometry::frame::{CellPoint, Vec3};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Outputs per voxel: 21 of the stiffness, 6 of the conductivity, the volume.
const OUTPUT_COUNT: usize = 28;

/// Derivatives with respect to one real parameter of a cell.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Derivatives {
    /// The index k of the coefficient; `None` for the level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub k: Option<Vec<i32>>,
    /// "re" or "im" of the coefficient, or "level".
    pub part: &'static str,
    /// Its value.
    pub value: f64,
    /// Of the stiffness.
    pub stiffness: Voigt,
    /// Of the conductivity.
    pub conductivity: [[f64; 3]; 3],
    /// Of the volume fraction.
    pub volume_fraction: f64,
}

/// Sensitivities to the shares of voxels, as [`Elasticity`](super::Elasticity) and
/// [`Conduction`](super::Conduction) give them: times the number of voxels, of the same voxels in ascending order.
/// Voxels that are left out count as insensitive.
pub struct Sensitivities {
    /// Of the stiffness, in the order of [`PAIRS`](super::PAIRS).
    pub elastic: Vec<(usize, [f64; 21])>,
    /// Of the conductivity, in the order 11 22 33 23 13 12; may be empty.
    pub thermal: Vec<(usize, [f64; 6])>,
}

/// An orbit of a series: the frequencies that symmetry ties to one coefficient. It is self-paired where it holds -k
/// with each k.
struct Orbit {
    members: Vec<[i32; 3]>,
    is_self_paired: bool,
}

/// The functions that multiply the real parameters of a series. `bound` is the greatest |index|, `to_lattice` maps a
/// reference point to lattice coordinates, and `parameters` lists index, "re" or "im", and value.
struct Basis {
    orbits: Vec<Orbit>,
    bound: i32,
    to_lattice: Box<dyn Fn(Vec3) -> [f64; 3] + Sync>,
    parameters: Vec<(Vec<i32>, &'static str, f64)>,
}

impl Basis {
    /// The functions of a series; planar series are constant along z.
    fn new<const D: usize>(series: &Series<D>) -> Self {
        let mut orbits = Vec::new();
        let mut parameters = Vec::new();
        for t in series.coefficients() {
            let orbit = series.group().orbit(t.k);
            let pad = |k: &[i32; D]| std::array::from_fn(|a| if a < D { k[a] } else { 0 });
            let is_self_paired = orbit.is_self_paired();
            // One real parameter for an orbit that holds k and -k, otherwise the real and the imaginary part of C.
            parameters.push((t.k.to_vec(), "re", t.c[0]));
            if !is_self_paired {
                parameters.push((t.k.to_vec(), "im", t.c[1]));
            }
            orbits.push(Orbit {
                members: orbit.members.iter().map(pad).collect(),
                is_self_paired,
            });
        }
        // The phasors of one axis serve all members of all orbits.
        let indices = orbits.iter().flat_map(|o| o.members.iter().flatten());
        let bound = indices.map(|k| k.abs()).max().unwrap_or(0);
        let inverse = *series.lattice().inverse();
        Self {
            orbits,
            bound,
            to_lattice: Box::new(move |p: Vec3| {
                std::array::from_fn(|a| {
                    if a < D {
                        (0..D).map(|b| inverse[(a, b)] * p[b]).sum()
                    } else {
                        0.0
                    }
                })
            }),
            parameters,
        }
    }

    /// Replaces `out` by the values of all functions at a point of the element, in the order of `parameters`.
    fn values(&self, p: CellPoint<3>, out: &mut Vec<f64>) {
        let u = (self.to_lattice)(p.0);
        let bound = self.bound;
        let powers = u.map(|u| -> Vec<Complex64> {
            (-bound..=bound)
                .map(|k| {
                    // exp(2 pi i k u). Whole turns go first, which keeps the argument within half a turn.
                    let turn = f64::from(k) * (u - u.round());
                    let (s, c) = libm::sincos(TAU * (turn - turn.round()));
                    Complex64::new(c, s)
                })
                .collect()
        });
        let power = |a: usize, k: i32| powers[a][(k + bound) as usize];
        out.clear();
        for orbit in &self.orbits {
            let sum: Complex64 = orbit
                .members
                .iter()
                .map(|k| power(0, k[0]) * power(1, k[1]) * power(2, k[2]))
                .sum();
            // c S and its conjugate add to 2 Re c Re S - 2 Im c Im S. A self-paired orbit holds its
            // own conjugate, so that its sum is real.
            if orbit.is_self_paired {
                out.push(sum.re);
            } else {
                out.push(2.0 * sum.re);
                out.push(-2.0 * sum.im);
            }
        }
    }
}

/// Derivatives with respect to the level, which comes first, and to every real parameter of a cell that is one series,
/// in the order of its coefficients: the real part, then the imaginary part if the orbit has one. `samples` are those
/// of `period` that `sensitivities` refer to.
///
/// # Errors
/// [`HomogenizeError::NoCoefficients`] for beams and for expressions of several series.
pub fn by_coefficients(
    period: &Period,
    samples: &Samples,
    sensitivities: &Sensitivities,
) -> Result<Vec<Derivatives>, HomogenizeError> {
    let cell = period.cell().ok_or(HomogenizeError::NoCoefficients)?;
    let basis = match (cell.series(), cell.planar()) {
        (Some(series), _) => Basis::new(series),
        (_, Some(series)) => Basis::new(series),
        _ => return Err(HomogenizeError::NoCoefficients),
    };
    let [nx, ny, nz] = samples.grid().counts();
    // One task per layer across x. The layers are added in order, so that the sums do not depend on the threads.
    let layers: Vec<(Vec<[f64; OUTPUT_COUNT]>, [f64; OUTPUT_COUNT])> = (0..nx)
        .into_par_iter()
        .map(|i| layer(period, samples, sensitivities, &basis, [i, ny, nz]))
        .collect();
    let count = basis.parameters.len();
    let mut by_level = [0.0; OUTPUT_COUNT];
    let mut by_parameter = vec![[0.0; OUTPUT_COUNT]; count];
    for (parameters, level) in layers {
        add(&mut by_level, 1.0, &level);
        for (sum, own) in by_parameter.iter_mut().zip(&parameters) {
            add(sum, 1.0, own);
        }
    }
    // A property is a mean over voxels.
    let scale = 1.0 / samples.grid().voxels() as f64;
    let mut all = vec![derivatives(
        None,
        "level",
        samples.level(),
        &by_level,
        scale,
    )];
    for ((k, part, value), own) in basis.parameters.into_iter().zip(&by_parameter) {
        all.push(derivatives(Some(k), part, value, own, scale));
    }
    Ok(all)
}

/// sum += factor own, for all outputs.
fn add(sum: &mut [f64; OUTPUT_COUNT], factor: f64, own: &[f64; OUTPUT_COUNT]) {
    for (s, v) in sum.iter_mut().zip(own) {
        *s += factor * v;
    }
}

/// Derivatives by one parameter, from the sums of all outputs times `scale`. `k` is the index of its coefficient,
/// `part` its part, `value` its value.
fn derivatives(
    k: Option<Vec<i32>>,
    part: &'static str,
    value: f64,
    found: &[f64; OUTPUT_COUNT],
    scale: f64,
) -> Derivatives {
    // The outputs are the upper triangle of the stiffness in the order of `PAIRS`, six conductivities, the volume.
    let mut stiffness = [[0.0; 6]; 6];
    for (n, (i, j)) in PAIRS.into_iter().enumerate() {
        stiffness[i][j] = found[n] * scale;
        stiffness[j][i] = found[n] * scale;
    }
    let mut conductivity = [[0.0; 3]; 3];
    let pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)];
    for (n, (i, j)) in pairs.into_iter().enumerate() {
        conductivity[i][j] = found[21 + n] * scale;
        conductivity[j][i] = found[21 + n] * scale;
    }
    Derivatives {
        k,
        part,
        value,
        stiffness,
        conductivity,
        volume_fraction: found[OUTPUT_COUNT - 1] * scale,
    }
}

/// The sums over layer `i` of voxels across x: by every parameter, and by the level. The grid has `ny` by `nz` voxels
/// in a layer. Sums are not divided by the number of voxels.
fn layer(
    period: &Period,
    samples: &Samples,
    sensitivities: &Sensitivities,
    basis: &Basis,
    [i, ny, nz]: [usize; 3],
) -> (Vec<[f64; OUTPUT_COUNT]>, [f64; OUTPUT_COUNT]) {
    let counts = samples.counts();
    let parts = samples.parts([0; 3]).count() as f64;
    // The derivatives with respect to the value of a sample, by the sample's indices. Slopes reach into the layers
    // beside this one, which is why the key is a sample of the whole grid.
    let mut weights: BTreeMap<[usize; 3], [f64; OUTPUT_COUNT]> = BTreeMap::new();
    let mut by_level = [0.0; OUTPUT_COUNT];
    // Sensitivities are sorted by voxel: those of this layer are consecutive.
    let first = sensitivities.elastic.partition_point(|s| s.0 < i * ny * nz);
    let last = sensitivities
        .elastic
        .partition_point(|s| s.0 < (i + 1) * ny * nz);
    for n in first..last {
        let (voxel, elastic) = &sensitivities.elastic[n];
        let mut sensitivity = [0.0; OUTPUT_COUNT];
        sensitivity[..21].copy_from_slice(elastic);
        if let Some((_, thermal)) = sensitivities.thermal.get(n) {
            sensitivity[21..27].copy_from_slice(thermal);
        }
        sensitivity[OUTPUT_COUNT - 1] = 1.0; // The volume is the mean of shares.
        let within = voxel % (ny * nz);
        for at in samples.parts([i, within / nz, within % nz]) {
            let slope = samples.slope(at);
            let share = part(samples.solid(), samples.level(), samples.value(at), slope);
            if share.by_value == 0.0 && share.by_level == 0.0 && share.by_slope == [0.0; 3] {
                continue;
            }
            add(&mut by_level, share.by_level / parts, &sensitivity);
            // d share / d samples: by the value at the part, and by the slope, a central difference of its neighbours.
            let mut give = |at, factor: f64| {
                let sum = weights.entry(at).or_insert([0.0; OUTPUT_COUNT]);
                add(sum, factor / parts, &sensitivity);
            };
            give(at, share.by_value);
            for axis in 0..3 {
                let [before, after] = samples.neighbours(at, axis);
                if before != after {
                    give(after, share.by_slope[axis] / 2.0);
                    give(before, -share.by_slope[axis] / 2.0);
                }
            }
        }
    }
    // d sample / d parameter is the basis function at the sample.
    let mut by_parameter = vec![[0.0; OUTPUT_COUNT]; basis.parameters.len()];
    let mut values = Vec::new();
    for (at, weight) in &weights {
        let p = period.reference(place(counts, *at));
        basis.values(p, &mut values);
        for (sum, value) in by_parameter.iter_mut().zip(&values) {
            add(sum, *value, weight);
        }
    }
    (by_parameter, by_level)
}
