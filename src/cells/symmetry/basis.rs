//! The real orthonormal basis of the invariant, real and band-limited functions.

use super::{Frequency, Lattice, Orbit, PointGroup};

/// One orbit, or a pair of opposite orbits, with its one or two real basis functions.
///
/// Let phi(u) = (|L| m)^(-1/2) sum over the orbit of exp(2 pi i k.u). A self-paired orbit has the basis
/// function phi, which is real; a pair has sqrt 2 Re phi and sqrt 2 Im phi.
#[derive(Clone, Debug, PartialEq)]
pub struct Harmonic<const D: usize> {
    /// The orbit; for a pair, the one with the lexicographically larger representative.
    pub orbit: Orbit<D>,
    /// Whether -k belongs to the orbit of k.
    pub self_paired: bool,
    /// |f| of the orbit.
    pub frequency: f64,
    /// (|L| m)^(-1/2).
    pub scale: f64,
}

impl<const D: usize> Harmonic<D> {
    /// Number of real basis functions: 1 or 2.
    pub fn functions(&self) -> usize {
        if self.self_paired { 1 } else { 2 }
    }

    /// The coefficient C = (re, im) of each exponential of the orbit, from the real coefficients (a) or
    /// (a, b): C = (a - i b)/sqrt 2 (|L| m)^(-1/2).
    pub fn coefficient(&self, real: &[f64]) -> [f64; 2] {
        if self.self_paired {
            [real[0] * self.scale, 0.0]
        } else {
            let s = self.scale * std::f64::consts::FRAC_1_SQRT_2;
            [real[0] * s, -real[1] * s]
        }
    }
}

/// The basis of the band |f| <= R.
#[derive(Clone, Debug, PartialEq)]
pub struct Basis<const D: usize> {
    group: PointGroup<D>,
    lattice: Lattice<D>,
    radius: f64,
    harmonics: Vec<Harmonic<D>>,
}

impl<const D: usize> Basis<D> {
    /// The basis for |f| <= `radius`, in cycles per unit of reference length. Functions are in ascending
    /// order of (|f|, representative).
    pub fn new(group: PointGroup<D>, lattice: Lattice<D>, radius: f64) -> Self {
        let orbits = group.orbits(&lattice, radius);
        Self::of(group, lattice, radius, orbits)
    }

    /// The basis of all orbits whose members all have indices up to `max_index`, which 2 `max_index` + 1
    /// samples along each lattice vector can represent. Its radius is the largest |f|.
    pub fn below(group: PointGroup<D>, lattice: Lattice<D>, max_index: i32) -> Self {
        let orbits = group.orbits_below(&lattice, max_index);
        let radius = orbits
            .last()
            .map_or(0.0, |o| lattice.frequency_norm(o.representative()));
        Self::of(group, lattice, radius, orbits)
    }

    fn of(group: PointGroup<D>, lattice: Lattice<D>, radius: f64, orbits: Vec<Orbit<D>>) -> Self {
        let harmonics = orbits
            .into_iter()
            .filter_map(|orbit| {
                let rep = orbit.representative();
                let partner = group.canonical(rep.map(|c| -c));
                (partner <= rep).then(|| Harmonic {
                    self_paired: partner == rep,
                    frequency: lattice.frequency_norm(rep),
                    scale: (lattice.volume() * orbit.members.len() as f64)
                        .sqrt()
                        .recip(),
                    orbit,
                })
            })
            .collect();
        Self {
            group,
            lattice,
            radius,
            harmonics,
        }
    }

    /// Number of real basis functions.
    pub fn len(&self) -> usize {
        self.harmonics.iter().map(Harmonic::functions).sum()
    }

    /// Whether there are no basis functions, which never holds: the constant is always present.
    pub fn is_empty(&self) -> bool {
        self.harmonics.is_empty()
    }

    /// The group whose operators leave every function unchanged.
    pub fn group(&self) -> &PointGroup<D> {
        &self.group
    }

    /// The lattice of periods.
    pub fn lattice(&self) -> &Lattice<D> {
        &self.lattice
    }

    /// The band limit R.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Orbits and orbit pairs.
    pub fn harmonics(&self) -> &[Harmonic<D>] {
        &self.harmonics
    }

    /// |f| of every basis function.
    pub fn frequencies(&self) -> Vec<f64> {
        self.harmonics
            .iter()
            .flat_map(|h| std::iter::repeat_n(h.frequency, h.functions()))
            .collect()
    }

    /// Coefficients C of the representatives, from the real coefficients of a function.
    ///
    /// # Panics
    /// If the length of `real` is not [`Basis::len`].
    pub fn coefficients(&self, real: &[f64]) -> Vec<(Frequency<D>, [f64; 2])> {
        assert_eq!(real.len(), self.len(), "one number per basis function");
        let mut rest = real;
        self.harmonics
            .iter()
            .map(|h| {
                let (own, tail) = rest.split_at(h.functions());
                rest = tail;
                (h.orbit.representative(), h.coefficient(own))
            })
            .collect()
    }
}
