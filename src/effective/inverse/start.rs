//! Where an optimisation starts: named surfaces, cells, random coefficients; and sheets that are known to be good.

use super::InverseError;
use super::samples::{SampledBasis, reference};
use druse_cells::cell::{Cell, Solid, Surface, Terms, of_terms};
use druse_cells::symmetry::Basis;
use druse_geometry::field::Field;
use druse_geometry::frame::Element;
use std::f64::consts::TAU;

/// Least share of a start's mean square that the band and the group must keep.
const MIN_KEPT_ENERGY: f64 = 0.05;

/// Surfaces that a design without a start begins with.
const SURFACES: [Surface; 5] = [
    Surface::SchwarzP,
    Surface::Iwp,
    Surface::FRd,
    Surface::Neovius,
    Surface::Diamond,
];

/// Sheets on the way from `schwarz_p` to closed plates along three planes. A downhill search over the coefficients
/// found them at volume fraction 0.3, each trial on 48 sharp voxels and with a way through both voids: the stiffest, and
/// the stiffest isotropic one. Wide interfaces close these ways, so that no gradient leads there.
const OPEN_PLATES: [(&str, Terms); 2] = [
    (
        "open plates",
        &[
            ([1, 0, 0], [0.5, 0.0]),
            ([1, 1, 1], [0.0725, 0.0]),
            ([2, 1, 0], [0.000_375, 0.0]),
            ([2, 2, 1], [-0.016_75, 0.0]),
            ([3, 0, 0], [0.0098, 0.0]),
        ],
    ),
    (
        "isotropic open plates",
        &[
            ([1, 0, 0], [0.5, 0.0]),
            ([1, 1, 1], [0.074, 0.0]),
            ([2, 1, 0], [-0.019_35, 0.0]),
            ([2, 2, 1], [0.010_125, 0.0]),
            ([3, 0, 0], [0.0545, 0.0]),
        ],
    ),
];

#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Its name in reports.
    pub name: String,
    /// Real coefficients.
    pub coefficients: Vec<f64>,
}

/// A generator of random numbers (Steele, Lea and Flood 2014).
struct SplitMix(u64);

impl SplitMix {
    /// A number from 0 to 1, 1 excluded.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number of the normal distribution (Box and Muller).
    fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.next(), self.next());
        (-2.0 * u.ln()).sqrt() * libm::cos(TAU * v)
    }
}

/// Random coefficients that fall off with the square of the frequency; factors set neighbouring seeds far apart.
pub fn random(basis: &Basis<3>, seed: u64) -> Start {
    let mut numbers = SplitMix(seed.wrapping_mul(0x2545_f491_4f6c_dd1d).wrapping_add(1));
    let coefficients = basis
        .frequencies()
        .into_iter()
        .map(|f| numbers.normal() / (1.0 + f * f))
        .collect();
    Start {
        name: format!("seed {seed}"),
        coefficients,
    }
}

/// Coefficients near those of another start: random ones of 0.3 of its norm are added. Norms leave out the constant.
pub fn perturbed(basis: &Basis<3>, start: &Start, seed: u64) -> Start {
    let own = random(basis, seed);
    let size = |v: &[f64]| v.iter().skip(1).map(|c| c * c).sum::<f64>().sqrt();
    let factor = 0.3 * size(&start.coefficients) / size(&own.coefficients).max(f64::MIN_POSITIVE);
    let sum = start.coefficients.iter().zip(&own.coefficients);
    Start {
        name: format!("{} with seed {seed}", start.name),
        coefficients: sum.map(|(a, b)| a + factor * b).collect(),
    }
}

/// The part of a cell that a basis holds; a cell that is solid above its level is negated.
///
/// # Errors
/// [`InverseError::Start`] for another element, or where almost nothing beside the constant is kept.
pub fn of_cell(
    element: Element,
    sampled: &SampledBasis,
    cell: &Cell,
) -> Result<Start, InverseError> {
    if cell.element() != element {
        return Err(InverseError::Start(format!(
            "found the start {}, a cell of a {}; expected one of a {}",
            cell.name(),
            cell.element().name(),
            element.name()
        )));
    }
    let sign = match cell.solid() {
        Solid::Above | Solid::Channels => -1.0,
        Solid::Below | Solid::Sheet => 1.0,
    };
    // One voxel of each orbit, or, for a cell that may have fewer symmetries than the basis, the mean over its orbit.
    let grid = sampled.grid();
    let n = grid.counts()[0];
    let values: Vec<f64> = if cell.fits_any_numbering() {
        let own = sampled.points().iter();
        own.map(|p| sign * cell.expression().value(*p)).collect()
    } else {
        let all: Vec<f64> = (0..grid.voxels())
            .map(|v| {
                let at = [v / (n * n), v / n % n, v % n];
                let p = at.map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
                sign * cell.expression().value(reference(element, p.into()))
            })
            .collect();
        let sums = sampled.gathered(&all);
        sums.iter()
            .zip(sampled.counts())
            .map(|(s, c)| s / c)
            .collect()
    };
    let (coefficients, kept) = sampled.projected(&values);
    let size: f64 = coefficients.iter().skip(1).map(|c| c * c).sum();
    if kept < MIN_KEPT_ENERGY || size < 1e-12 {
        return Err(InverseError::Start(format!(
            "found the start {}; the band and the group keep {:.1} % of it; expected a cell of that \
             symmetry, or a smaller group",
            cell.name(),
            100.0 * kept.max(0.0)
        )));
    }
    Ok(Start {
        name: cell.name().to_owned(),
        coefficients,
    })
}

/// A surface by its name.
///
/// # Errors
/// [`InverseError::Start`] for an unknown name, [`InverseError::Cell`] for a surface that the element cannot have, and
/// as [`of_cell`].
pub fn of_surface(
    element: Element,
    sampled: &SampledBasis,
    name: &str,
) -> Result<Start, InverseError> {
    let Some(surface) = Surface::from_name(name) else {
        let known: Vec<&str> = Surface::CATALOGUE.map(Surface::name).to_vec();
        return Err(InverseError::Start(format!(
            "found the start {name:?}; expected a .cell file or one of {}",
            known.join(", ")
        )));
    };
    of_cell(element, sampled, &surface.cell(element)?)
}

/// Known sheets of a hex; those that the basis holds.
pub fn known_sheets(element: Element, sampled: &SampledBasis) -> Vec<Start> {
    if element != Element::Hex {
        return Vec::new();
    }
    let made = OPEN_PLATES.iter().filter_map(|(name, terms)| {
        let cell = of_terms(name, element, None, terms).ok()?;
        of_cell(element, sampled, &cell).ok()
    });
    made.collect()
}

/// The starts of a design that names none: surfaces, networks on both sides of all but `schwarz_p`, and random ones.
pub fn of_design(
    element: Element,
    basis: &Basis<3>,
    sampled: &SampledBasis,
    solid: Solid,
    (count, seed): (usize, u64),
) -> Vec<Start> {
    let mut all = Vec::new();
    for surface in SURFACES {
        let Ok(cell) = surface.cell(element) else {
            continue;
        };
        let Ok(start) = of_cell(element, sampled, &cell) else {
            continue;
        };
        if !solid.is_symmetric() && surface != Surface::SchwarzP {
            all.push(Start {
                name: format!("{}, other side", start.name),
                coefficients: start.coefficients.iter().map(|c| -c).collect(),
            });
        }
        all.push(start);
    }
    // At least a third of the starts are random, but the first is a surface where one fits.
    let random_count = count.saturating_sub(all.len()).max(count.div_ceil(3));
    all.truncate(count.saturating_sub(random_count).max(1));
    let rest = count.saturating_sub(all.len());
    all.extend((0..rest as u64).map(|n| random(basis, seed.wrapping_add(n))));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_cells::symmetry::{Lattice, PointGroup};

    /// A function of a tet starts alike under its own group and under a smaller one.
    #[test]
    fn cells_of_smaller_groups_start_in_the_tets_of_the_period() {
        let lattice = Lattice::<3>::named("cubic").unwrap();
        let group = PointGroup::named("Td", &lattice).unwrap();
        let basis = Basis::new(group, lattice, 2.0);
        let sampled = SampledBasis::new(Element::Tet, &basis, 16).unwrap();
        let start = |group| {
            let terms = &[([1, 0, 0], [0.5, 0.0])];
            let cell = of_terms("p", Element::Tet, group, terms).unwrap();
            of_cell(Element::Tet, &sampled, &cell).unwrap().coefficients
        };
        let pairs = start(None).into_iter().zip(start(Some("T")));
        for (whole, part) in pairs {
            assert!((whole - part).abs() < 1e-9, "{whole} {part}");
        }
    }
}
