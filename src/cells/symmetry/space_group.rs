//! Space groups: operators with fractions of the periods, such as `x+1/2,-y,-z+1/2`.
//!
//! An operator maps u to R u + t. A wave composed with it is exp(2 pi i k.(R u + t)) = exp(2 pi i k.t) exp(2 pi i (R^T
//! k).u), so that coefficients of an invariant function change by phases along the orbits {R^T k}. The mean over all
//! operators is the orthogonal projection onto the invariant functions ([`SpaceGroup::mean`]). All fractions of the
//! 230 groups are multiples of 1/24 of a period. Their operators are those of the crate moyo, in the settings of the
//! International Tables.
//!
//! The operators without fractions form the *site group* of the origin. A series keeps that group; what the others
//! demand is in its coefficients.

use super::{Frequency, Operator, PointGroup, SymmetryError};
use moyo::data::{HallSymbol, HallSymbolEntry, hall_symbol_entry};
use std::collections::{BTreeMap, BTreeSet};

/// Fractions are counted in this part of a period.
const PARTS: i32 = 24;
/// Largest number of operators in a period: those of Fm-3m.
const MAX_ORDER: usize = 192;
/// Number of settings in the tables.
const SETTINGS: i32 = 530;

/// An operator u -> R u + t.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SpaceOperator<const D: usize> {
    /// R.
    pub rotation: Operator<D>,
    /// t, in 24ths of the periods, from 0 to 23.
    pub shift: [i32; D],
}

impl<const D: usize> SpaceOperator<D> {
    /// t, in periods.
    pub fn fractions(&self) -> [f64; D] {
        self.shift.map(|t| f64::from(t) / f64::from(PARTS))
    }

    /// The image of lattice coordinates.
    pub fn apply(&self, u: [f64; D]) -> [f64; D] {
        let mut image = self.rotation.apply(u);
        for (c, t) in image.iter_mut().zip(self.fractions()) {
            *c += t;
        }
        image
    }

    /// The product that applies `other` first: R1 (R2 u + t2) + t1; `None` if an entry overflows.
    fn after(&self, other: &Self) -> Option<Self> {
        let mut shift = self.shift;
        for (t, row) in shift.iter_mut().zip(self.rotation.rows()) {
            let moved: i32 = row
                .iter()
                .zip(other.shift)
                .map(|(m, s)| m.rem_euclid(PARTS) * s)
                .sum();
            *t = (*t + moved).rem_euclid(PARTS);
        }
        let rotation = self.rotation.checked_mul(&other.rotation)?;
        Some(Self { rotation, shift })
    }

    /// Reads `x+1/2,-y,-z+1/2`.
    fn parse(text: &str) -> Result<Self, SymmetryError> {
        let mut shift = [0; D];
        let mut images = Vec::new();
        for (n, image) in text.split(',').enumerate() {
            // Terms with a stroke are fractions; what remains is an operator without any.
            let compact = image.replace(char::is_whitespace, "").replace('-', "+-");
            let (fractions, own): (Vec<&str>, Vec<&str>) = compact
                .split('+')
                .filter(|t| !t.is_empty())
                .partition(|t| t.contains('/'));
            for fraction in fractions {
                let parts = parse_fraction(fraction).ok_or_else(|| SymmetryError::Operator {
                    text: text.to_owned(),
                    reason: format!("{fraction:?} is no multiple of 1/24"),
                    dimension: D,
                })?;
                if let Some(t) = shift.get_mut(n) {
                    *t = (*t + parts).rem_euclid(PARTS);
                }
            }
            images.push(own.join("+").replace("+-", "-"));
        }
        Ok(Self {
            rotation: images.join(",").parse()?,
            shift,
        })
    }
}

/// A fraction such as `-3/4` in 24ths.
fn parse_fraction(text: &str) -> Option<i32> {
    let (above, below) = text.split_once('/')?;
    let (above, below): (i32, i32) = (above.parse().ok()?, below.parse().ok()?);
    let is_part = below > 0 && PARTS % below == 0 && above.abs() <= PARTS;
    is_part.then(|| above * (PARTS / below))
}

/// All operators of a space group within one period.
///
/// ```
/// # extern crate druse_cells as druse;
/// use druse::symmetry::SpaceGroup;
/// let gyroid = SpaceGroup::<3>::named("I4132").unwrap();
/// assert_eq!(gyroid.operators().len(), 48);
/// assert_eq!(gyroid.site_group().unwrap().order(), 3);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpaceGroup<const D: usize> {
    name: String,
    operators: Vec<SpaceOperator<D>>,
}

impl<const D: usize> SpaceGroup<D> {
    /// The group with a Hermann-Mauguin symbol of the International Tables, such as `I4132`, `Ia-3d` or `Fd-3m:2`
    /// for the second choice of its origin; spaces and `_` are ignored. `None` for other words, and in the plane.
    pub fn named(name: &str) -> Option<Self> {
        if D != 3 {
            return None;
        }
        let plain = |s: &str| s.replace([' ', '_'], "");
        let (symbol, choice) = name.split_once(':').unwrap_or((name, ""));
        let symbol = plain(symbol);
        let is_meant = |e: &HallSymbolEntry| {
            let is_named = plain(e.hm_short) == symbol || plain(e.hm_full) == symbol;
            is_named && (choice.is_empty() || e.setting == choice)
        };
        let entry = (1..=SETTINGS)
            .filter_map(hall_symbol_entry)
            .find(is_meant)?;
        let table = HallSymbol::new(entry.hall_symbol)?;
        let mut operators = BTreeSet::new();
        for own in table.traverse() {
            for point in entry.centering.lattice_points() {
                let row = |i: usize| std::array::from_fn(|j| own.rotation[(i, j)]);
                let parts = |i: usize| (own.translation[i] + point[i]) * f64::from(PARTS);
                operators.insert(SpaceOperator {
                    rotation: Operator::new(std::array::from_fn(row)),
                    shift: std::array::from_fn(|i| (parts(i).round() as i32).rem_euclid(PARTS)),
                });
            }
        }
        Some(Self {
            name: name.to_owned(),
            operators: operators.into_iter().collect(),
        })
    }

    /// The group generated by operators, separated by `;` or lines: `x+1/2,-y,-z; z,x,y`.
    ///
    /// # Errors
    /// [`SymmetryError::Operator`], [`SymmetryError::Determinant`], and [`SymmetryError::Infinite`] for more than 192
    /// operators in a period.
    pub fn generated(text: &str) -> Result<Self, SymmetryError> {
        let lines = text
            .split([';', '\n'])
            .map(str::trim)
            .filter(|t| !t.is_empty());
        let generators = lines
            .map(SpaceOperator::parse)
            .collect::<Result<Vec<_>, _>>()?;
        if let Some(g) = generators
            .iter()
            .find(|g| g.rotation.determinant().abs() != 1)
        {
            return Err(SymmetryError::Determinant {
                operator: g.rotation.to_string(),
                determinant: g.rotation.determinant(),
            });
        }
        let identity = SpaceOperator {
            rotation: Operator::identity(),
            shift: [0; D],
        };
        let mut found = BTreeSet::from([identity]);
        let mut frontier = vec![identity];
        let infinite = || SymmetryError::Infinite {
            generators: text.to_owned(),
            limit: MAX_ORDER,
            dimension: D,
        };
        while let Some(e) = frontier.pop() {
            for g in &generators {
                let product = g.after(&e).ok_or_else(infinite)?;
                if found.insert(product) {
                    frontier.push(product);
                }
            }
            if found.len() > MAX_ORDER {
                return Err(infinite());
            }
        }
        Ok(Self {
            name: "own".to_owned(),
            operators: found.into_iter().collect(),
        })
    }

    /// The name that was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// All operators in a period, each once.
    pub fn operators(&self) -> &[SpaceOperator<D>] {
        &self.operators
    }

    /// The operators without fractions.
    ///
    /// # Errors
    /// None that a group has.
    pub fn site_group(&self) -> Result<PointGroup<D>, SymmetryError> {
        let own = self.operators.iter().filter(|g| g.shift == [0; D]);
        let own: Vec<Operator<D>> = own.map(|g| g.rotation).collect();
        PointGroup::generated(&format!("{} at the origin", self.name), &own)
    }

    /// The operators with their fractions left out.
    ///
    /// # Errors
    /// None that a group has.
    pub fn point_group(&self) -> Result<PointGroup<D>, SymmetryError> {
        let all: Vec<Operator<D>> = self.operators.iter().map(|g| g.rotation).collect();
        PointGroup::generated(&self.name, &all)
    }

    /// The coefficients of the mean of a function over all operators:
    /// `C'_q = sum over operators and k with R^T k = q of C_k exp(2 pi i k.t) / |G|`.
    pub fn mean(
        &self,
        coefficients: &[(Frequency<D>, [f64; 2])],
    ) -> BTreeMap<Frequency<D>, [f64; 2]> {
        let mut sums = BTreeMap::<Frequency<D>, [f64; 2]>::new();
        let count = self.operators.len() as f64;
        for &(k, [re, im]) in coefficients {
            for g in &self.operators {
                let parts: i32 = k.iter().zip(g.shift).map(|(k, t)| k * t).sum();
                let [cos, sin] = unit(parts.rem_euclid(PARTS));
                let sum = sums.entry(g.rotation.apply_to_frequency(k)).or_default();
                sum[0] += (re * cos - im * sin) / count;
                sum[1] += (re * sin + im * cos) / count;
            }
        }
        sums
    }
}

/// exp(2 pi i n / 24), exact for quarters.
fn unit(n: i32) -> [f64; 2] {
    match n {
        0 => [1.0, 0.0],
        6 => [0.0, 1.0],
        12 => [-1.0, 0.0],
        18 => [0.0, -1.0],
        _ => {
            let angle = std::f64::consts::TAU * f64::from(n) / f64::from(PARTS);
            [libm::cos(angle), libm::sin(angle)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every setting is a group: closed, with the number of operators that its symbol has, and the same from generators.
    #[test]
    fn every_symbol_of_the_tables_names_a_group() {
        for number in (1..=SETTINGS).step_by(7).chain([SETTINGS]) {
            let entry = hall_symbol_entry(number).unwrap();
            let group = SpaceGroup::<3>::named(entry.hm_full).unwrap();
            let all: BTreeSet<_> = group.operators().iter().copied().collect();
            for (a, b) in group.operators().iter().zip(group.operators().iter().rev()) {
                assert!(all.contains(&a.after(b).unwrap()), "{}", entry.hm_full);
            }
            let points = group.point_group().unwrap().order();
            assert_eq!(all.len() % points, 0);
            assert!(all.len() <= MAX_ORDER && group.site_group().is_ok());
        }
        assert!(SpaceGroup::<3>::named("Oh").is_none() && SpaceGroup::<2>::named("P1").is_none());
        let [first, second] = ["Fd-3m:1", "Fd-3m:2"].map(|n| SpaceGroup::<3>::named(n).unwrap());
        assert_eq!(first.operators().len(), 192);
        assert_eq!(
            (
                first.site_group().unwrap().order(),
                second.site_group().unwrap().order()
            ),
            (24, 12)
        );
    }

    #[test]
    fn generators_are_read_with_their_fractions() {
        let text = "z,x,y; 1/4+y, x + 1/4, 1/4 - z; -x+1/2, -y, z+1/2";
        let found = SpaceGroup::<3>::generated(text).unwrap();
        let g = SpaceOperator::<3>::parse("y+1/4,x+1/4,1/4-z").unwrap();
        assert_eq!(g.shift, [6, 6, 6]);
        assert!(found.operators().contains(&g));
        let error = |t: &str| SpaceGroup::<3>::generated(t).err().unwrap().to_string();
        assert!(error("x+1/5,y,z").contains("1/5"));
        assert!(error("x+1/24,y+1/24,z; x,y+1/24,z").contains("192"));
        assert!(error("2x+1/2,y,z").contains("determinant"));
        assert!(error("2x+y+1/2,x+y,z").contains("infinite"));
    }
}
