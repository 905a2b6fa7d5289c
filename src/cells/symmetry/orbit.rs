//! Orbits of frequencies: the sets of indices that share a coefficient.

use super::{Frequency, Lattice, PointGroup};

/// The images of one index under a group.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Orbit<const D: usize> {
    /// All images, each once, in ascending lexicographic order.
    pub members: Vec<Frequency<D>>,
    /// Number of operators that fix a member. Times the number of members, it is the order of the group.
    pub stabiliser_order: usize,
}

impl<const D: usize> Orbit<D> {
    /// The lexicographically largest member.
    pub fn representative(&self) -> Frequency<D> {
        self.members[self.members.len() - 1]
    }

    /// Whether the orbit contains -k for each member k. Its coefficient is then real.
    pub fn is_self_paired(&self) -> bool {
        let negative = self.representative().map(|c| -c);
        self.members.binary_search(&negative).is_ok()
    }
}

impl<const D: usize> PointGroup<D> {
    /// The orbit of an index.
    pub fn orbit(&self, k: Frequency<D>) -> Orbit<D> {
        let mut members: Vec<Frequency<D>> = self
            .operators()
            .iter()
            .map(|op| op.apply_to_frequency(k))
            .collect();
        members.sort_unstable();
        members.dedup();
        Orbit {
            stabiliser_order: self.order() / members.len(),
            members,
        }
    }

    /// All orbits in the ball |f| <= `radius`, in ascending order of (|f|, representative).
    pub fn orbits(&self, lattice: &Lattice<D>, radius: f64) -> Vec<Orbit<D>> {
        let representatives = lattice
            .band(radius)
            .into_iter()
            .filter(|&k| self.canonical(k) == k);
        self.sorted(lattice, representatives)
    }

    /// All orbits whose members have indices within +-`max_index`, in the same order.
    pub fn orbits_below(&self, lattice: &Lattice<D>, max_index: i32) -> Vec<Orbit<D>> {
        let side = 2 * max_index as usize + 1;
        let index = |position: usize| -> Frequency<D> {
            std::array::from_fn(|a| {
                let digit = position / side.pow((D - 1 - a) as u32) % side;
                digit as i32 - max_index
            })
        };
        let is_below = |k: &Frequency<D>| {
            self.operators().iter().all(|op| {
                let image = op.apply_to_frequency(*k);
                image <= *k && image.iter().all(|c| c.abs() <= max_index)
            })
        };
        let all = (0..side.pow(D as u32)).map(index);
        self.sorted(lattice, all.filter(is_below))
    }

    fn sorted(
        &self,
        lattice: &Lattice<D>,
        representatives: impl Iterator<Item = Frequency<D>>,
    ) -> Vec<Orbit<D>> {
        let mut orbits: Vec<(i64, Orbit<D>)> = representatives
            .map(|k| {
                // |f| is rounded to 1e-9, so that equal lengths compare equal.
                let length = (lattice.frequency_norm(k) * 1e9).round() as i64;
                (length, self.orbit(k))
            })
            .collect();
        orbits.sort_by_key(|(length, o)| (*length, o.representative()));
        orbits.into_iter().map(|(_, o)| o).collect()
    }
}
