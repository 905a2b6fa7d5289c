//! What is to be designed: the space of cells, the target, the effort; checked before anything is solved.

use super::objective::Objective;
use super::samples::SampledBasis;
use super::space::Space;
use super::target::{Target, UpperBounds, rounded};
use super::verify::scale;
use super::{InverseError, Property};
use crate::homogenize::{Control, Isotropic, Settings};
use druse_cells::cell::{Cell, Solid, space_group, symmetry};
use druse_cells::symmetry::Basis;
use druse_geometry::frame::Element;

/// Least number of voxels along the period.
const MIN_VOXELS: usize = 8;
/// Most voxels along the period: a design evaluates its objective some hundred times.
const MAX_VOXELS: usize = 128;
const MAX_STARTS: usize = 1000;
/// Moduli of the void over those of the solid.
const VOID_SHARE: f64 = 1e-4;
/// Residual of the solver for the final figures.
const FIGURE_RESIDUAL: f64 = 1e-5;

/// A stage of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Its grid over that of the last one.
    pub grid: f64,
    /// Half the width of the interface, voxels.
    pub width: f64,
    /// The power of the share of solid that multiplies the moduli.
    pub power: f64,
    /// Its part of the evaluations.
    pub evaluations: f64,
}

/// From wide interfaces on a coarse grid to narrow ones. The power is high throughout: at 1 a grey membrane is
/// stiffer than any microstructure, and the search makes membranes.
const STAGES: [Stage; 3] = [
    Stage {
        grid: 0.5,
        width: 1.4,
        power: 3.0,
        evaluations: 0.25,
    },
    Stage {
        grid: 0.75,
        width: 1.0,
        power: 3.0,
        evaluations: 0.3,
    },
    Stage {
        grid: 1.0,
        width: 0.75,
        power: 3.0,
        evaluations: 0.45,
    },
];

/// What a design starts from.
#[derive(Clone, Debug, Default)]
pub enum StartChoice {
    /// Named surfaces and random coefficients.
    #[default]
    Several,
    /// A named surface, then coefficients near it.
    Surface(String),
    /// A cell, then coefficients near it.
    Cell(Box<Cell>),
    /// Random coefficients alone.
    Random,
}

/// A design: the space of cells, the target, the effort.
#[derive(Clone, Debug)]
pub struct Design {
    /// Name of the cell.
    pub name: String,
    /// The element: a hex or a tet.
    pub element: Element,
    /// The group, or the element's own.
    pub group: Option<String>,
    /// The lattice, or the element's own.
    pub lattice: Option<String>,
    /// Frequencies up to this many cycles per unit of reference length.
    pub band_limit: f64,
    /// A network below the level, or a sheet.
    pub solid: Solid,
    /// Share of solid.
    pub volume_fraction: f64,
    /// Poisson's ratio of the solid.
    pub solid_poisson: f64,
    /// What the cell shall be.
    pub target: Target,
    /// Where the optimisation starts.
    pub start: StartChoice,
    /// Number of starts.
    pub starts: usize,
    /// Seed of random coefficients.
    pub seed: u64,
    /// Evaluations of the objective in all stages for each start that reaches the last one; corrections have more.
    pub evaluations: usize,
    /// The stages.
    pub stages: Vec<Stage>,
    /// Voxels along the period in the last stage; figures are for as many and twice as many.
    pub voxels: usize,
    /// Least width of walls and gaps, reference lengths.
    pub min_feature: Option<f64>,
    /// Meet the faces at a right angle.
    pub face_normal: bool,
    /// Networks whose trace on the faces the cell keeps.
    pub matched: Vec<Cell>,
}

impl Design {
    /// A design for an element with the usual effort.
    pub fn new(name: &str, element: Element, target: Target, volume_fraction: f64) -> Self {
        Self {
            name: name.to_owned(),
            element,
            group: None,
            lattice: None,
            band_limit: 4.0,
            solid: Solid::Below,
            volume_fraction,
            solid_poisson: 0.3,
            target,
            start: StartChoice::Several,
            starts: 8,
            seed: 0,
            evaluations: 100,
            stages: STAGES.to_vec(),
            voxels: 24,
            min_feature: None,
            face_normal: false,
            matched: Vec::new(),
        }
    }
}

/// A design that has been checked.
pub struct Prepared {
    pub(super) design: Design,
    pub(super) basis: Basis<3>,
    pub(super) objective: Objective,
    pub(super) settings: Settings,
    /// Voxels along the period of each stage.
    pub(super) grids: Vec<usize>,
}

fn refuse(what: &'static str, found: &dyn ToString, expected: String) -> InverseError {
    InverseError::Target {
        what,
        found: found.to_string(),
        expected,
    }
}

impl Design {
    /// Checks a design.
    ///
    /// # Errors
    /// [`InverseError`]: an element without a period, a solid, group or lattice that designs do not have, a target at
    /// odds with itself or beyond its bounds, a band beyond the Nyquist frequency, efforts or lengths out of range.
    pub fn prepare(self) -> Result<Prepared, InverseError> {
        if !matches!(self.element, Element::Hex | Element::Tet) {
            return Err(InverseError::Element(self.element.name()));
        }
        if !matches!(self.solid, Solid::Below | Solid::Sheet) {
            let expected = "\"below\" (a network) or \"sheet\"".to_owned();
            return Err(refuse("solid", &self.solid.name(), expected));
        }
        if !(1..=MAX_STARTS).contains(&self.starts) {
            return Err(refuse("starts", &self.starts, format!("1 to {MAX_STARTS}")));
        }
        if self.stages.is_empty() || self.evaluations < self.stages.len() {
            let expected = format!("{} or more", self.stages.len().max(1));
            return Err(refuse("evaluations", &self.evaluations, expected));
        }
        if self.min_feature.is_some_and(|d| !(d > 0.0 && d < 0.5)) {
            let expected = "a length between 0 and 0.5, both excluded".to_owned();
            return Err(refuse(
                "min_feature",
                &self.min_feature.unwrap_or(0.0),
                expected,
            ));
        }
        if !(MIN_VOXELS..=MAX_VOXELS).contains(&self.voxels) || !self.voxels.is_multiple_of(2) {
            let expected = format!("an even number from {MIN_VOXELS} to {MAX_VOXELS}");
            return Err(refuse("voxels", &self.voxels, expected));
        }
        let solid = Isotropic::new(1.0, self.solid_poisson)?;
        let bounds = UpperBounds::new(solid, VOID_SHARE, self.volume_fraction);
        self.target.check(self.volume_fraction, &bounds)?;
        self.check_opening()?;
        // Unknowns are whole orbits, whose coefficients have no phases.
        if let Some(space) = space_group::<3>(self.element, self.group.as_deref())? {
            let expected = "a group without fractions, such as Oh, O or C1".to_owned();
            return Err(refuse("group", &space.name(), expected));
        }
        let (group, lattice) =
            symmetry::<3>(self.element, self.group.as_deref(), self.lattice.as_deref())?;
        if self.element == Element::Tet && group.order() < self.element.symmetry_order() {
            return Err(refuse(
                "group",
                &group.name(),
                "the tet's whole group Td: neighbours in a packing of tets are numbered unlike"
                    .to_owned(),
            ));
        }
        let basis = Basis::new(group, lattice, self.band_limit);
        if basis.len() < 3 {
            let expected = "a larger band: this one has no two functions beside the constant";
            return Err(refuse("band_limit", &self.band_limit, expected.to_owned()));
        }
        // The last grid must hold the band; earlier ones are as coarse as it allows.
        SampledBasis::new(self.element, &basis, self.voxels)?;
        let grids = self.stages.iter().map(|stage| {
            let coarse =
                ((self.voxels as f64 * stage.grid / 2.0).round() as usize * 2).max(MIN_VOXELS);
            (coarse..=self.voxels)
                .step_by(2)
                .find(|n| SampledBasis::new(self.element, &basis, *n).is_ok())
                .unwrap_or(self.voxels)
        });
        let grids = grids.collect();
        let settings = Settings {
            solid,
            void: VOID_SHARE,
            permeability: self.target.maximise == Some(Property::Permeability)
                || self.target.bounds_flow(),
            control: Control {
                tolerance: FIGURE_RESIDUAL,
                ..Control::default()
            },
            ..Settings::default()
        };
        Ok(Prepared {
            objective: Objective::new(self.target.clone(), bounds),
            design: self,
            basis,
            settings,
            grids,
        })
    }
}

impl Design {
    /// Refuses an opening that the void has no room for: a ball of radius R that travels through one period leaves
    /// a tube at least one period long behind, whose volume pi R^2 is at most that of the void. A sheet has two.
    fn check_opening(&self) -> Result<(), InverseError> {
        let Some(radius) = self.target.min_opening else {
            return Ok(());
        };
        let voids = if self.solid.is_symmetric() { 2.0 } else { 1.0 };
        let room = ((1.0 - self.volume_fraction) / (voids * std::f64::consts::PI)).sqrt();
        let greatest = room.min(0.5) / scale(self.element);
        if radius > 0.0 && radius < greatest {
            return Ok(());
        }
        Err(refuse(
            "min_opening",
            &radius,
            format!(
                "a radius above 0 and below {}, which leaves room for its tube at volume fraction {}",
                rounded(greatest, true),
                self.volume_fraction
            ),
        ))
    }
}

impl Prepared {
    /// The basis of the coefficients.
    pub fn basis(&self) -> &Basis<3> {
        &self.basis
    }

    /// Number of coefficients that the optimiser changes.
    ///
    /// # Errors
    /// [`InverseError`] of matched cells.
    pub fn unknowns(&self) -> Result<usize, InverseError> {
        let sampled = self.sampled(self.design.voxels)?;
        Ok(self.space(&sampled)?.unknowns_count())
    }

    /// Evaluations of the objective that the stages make at most; corrections and known sheets come on top.
    pub fn max_evaluations(&self) -> u64 {
        let each = (0..self.design.stages.len()).map(|stage| self.stage_evaluations(stage));
        let kept = (0..self.design.stages.len()).map(|stage| candidates(self.design.starts, stage));
        each.zip(kept).map(|(e, k)| (e * k) as u64).sum()
    }

    /// Voxels along the period of each stage.
    pub fn grids(&self) -> &[usize] {
        &self.grids
    }

    /// Upper bounds at the volume fraction.
    pub fn bounds(&self) -> &UpperBounds {
        self.objective.bounds()
    }

    pub(super) fn stage_evaluations(&self, stage: usize) -> usize {
        ((self.design.evaluations as f64 * self.design.stages[stage].evaluations).round() as usize)
            .max(1)
    }

    pub(super) fn sampled(&self, n: usize) -> Result<SampledBasis, InverseError> {
        SampledBasis::new(self.design.element, &self.basis, n)
    }

    pub(super) fn space(&self, sampled: &SampledBasis) -> Result<Space, InverseError> {
        Space::new(
            self.design.element,
            &self.basis,
            sampled,
            self.design.solid,
            self.design.face_normal,
            &self.design.matched,
        )
    }
}

/// How many starts a stage has: half of those before it, but two where there are so many.
pub(super) fn candidates(starts: usize, stage: usize) -> usize {
    (starts >> stage).max(1).max(starts.min(2))
}
