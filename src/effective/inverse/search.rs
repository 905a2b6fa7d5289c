//! Several starts in parallel, from a coarse grid with wide interfaces to a finer one with narrow ones.
//!
//! After each stage the better half of the starts goes on, two at least. Corrections then move goals and barriers by
//! what sharp voxels miss. Of these and of known sheets the best connected cell that meets all constraints is taken.
//! Starts are independent, their sums in a fixed order: the result does not depend on the number of threads.

use super::InverseError;
use super::design::{Prepared, StartChoice, candidates};
use super::medium::Medium;
use super::objective::{Effective, Objective};
use super::optimise::optimise;
use super::problem::{Evaluation, Interface, Problem};
use super::samples::SampledBasis;
use super::space::{self, Space};
use super::start::{self, Start};
use super::target::{Miss, Property};
use super::tube::Tube;
use super::verify;
use crate::homogenize::{Control, HomogenizeError};
use druse_cells::cell::{Cell, DesignProperties, DesignReport, DesignStep, FitReport, Solid};
use druse_geometry::progress::{Progress, Silent};
use rayon::prelude::*;

/// Residual of the solver in a search; a stiffness errs by its square.
const SEARCH_RESIDUAL: f64 = 1e-4;
/// Corrections of the goals of a target with ratios or a stiffness; beside constraints at least as many.
const CORRECTIONS: usize = 2;
/// Corrections of a target with constraints, at most.
const CONSTRAINED_CORRECTIONS: usize = 4;
/// Opening and width that a correction aims at, over the least ones.
const MARGIN: f64 = 1.005;
/// The least and the greatest radius of the barrier, over the least opening.
const BARRIER_RADII: [f64; 2] = [0.95, 1.5];
/// The least and the greatest distance that the surface is moved by, over half the least feature.
const EROSIONS: [f64; 2] = [0.3, 2.0];
/// The distance at first: of a wall that is as wide as wanted the rest stays, and carries load.
const FIRST_EROSION: f64 = 0.6;
/// Width of walls over the least feature above which a correction moves the surface by less.
const MAX_EXCESS: f64 = 1.15;
/// The key of the least width in messages.
const FEATURE_KEY: &str = "min_feature";
/// Part of the last stage's evaluations that each correction has.
const CORRECTION_SHARE: f64 = 0.4;

/// The size of the greatest miss.
fn miss(misses: &[Miss]) -> f64 {
    misses.iter().map(Miss::size).fold(0.0, f64::max)
}

/// A start on its way through the stages.
struct Candidate {
    start: String,
    unknowns: Vec<f64>,
    /// The best connected cell.
    best: Option<Evaluation>,
    /// The last cell, connected or not: voxels of a finer grid may connect it.
    any: Option<Evaluation>,
    /// The best connected cells of earlier stages: a finer grid may find the last one disconnected.
    earlier: Vec<Evaluation>,
    /// The objective, with goals that corrections have moved.
    objective: Objective,
    /// Radius of the barrier that keeps the void open, over the least opening.
    barrier: f64,
    /// Distance by which the surface is moved, over half the least feature.
    erosion: f64,
}

impl Candidate {
    fn cost(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |b| b.cost)
    }
}

/// What a design made.
pub struct Designed {
    /// The cell; its report holds target, history and properties.
    pub cell: Cell,
    /// Whether the user stopped the search: the cell is the best so far.
    pub is_stopped: bool,
}

impl Prepared {
    /// The starts of the design. A matched one, whose cell keeps the trace of networks on the faces, starts from the
    /// first of them unless another start is named.
    fn starts(&self, sampled: &SampledBasis) -> Result<Vec<Start>, InverseError> {
        let (design, basis) = (&self.design, &self.basis);
        let seeds = |count: usize| (0..count as u64).map(|n| design.seed.wrapping_add(n));
        // The start as it is, then ones near it.
        let near = |first: Start| {
            let mut all = vec![first];
            for seed in seeds(design.starts - 1) {
                let next = start::perturbed(basis, &all[0], seed);
                all.push(next);
            }
            all
        };
        match &design.start {
            StartChoice::Several if !design.matched.is_empty() => {
                // The whole field minus its level, as the space's origin; `of_cell` may take a part, without level.
                let cell = &design.matched[0];
                let own = space::coefficients_of(design.element, basis, sampled, cell)?;
                Ok(near(Start {
                    name: cell.name().to_owned(),
                    coefficients: own,
                }))
            }
            StartChoice::Several => Ok(start::of_design(
                design.element,
                basis,
                sampled,
                design.solid,
                (design.starts, design.seed),
            )),
            StartChoice::Surface(name) => {
                Ok(near(start::of_surface(design.element, sampled, name)?))
            }
            StartChoice::Cell(cell) => Ok(near(start::of_cell(design.element, sampled, cell)?)),
            StartChoice::Random => Ok(seeds(design.starts)
                .map(|seed| start::random(basis, seed))
                .collect()),
        }
    }

    fn is_constrained(&self) -> bool {
        self.design.min_feature.is_some() || self.design.target.is_constrained()
    }

    /// Figures of a cell on `n` sharp voxels along the period, with its least widths where one is wanted.
    fn figures(
        &self,
        cell: &Cell,
        n: usize,
        progress: &dyn Progress,
    ) -> Result<(DesignProperties, Effective), InverseError> {
        let (mut own, found) = verify::figures(cell, n, &self.settings, progress)?;
        if self.design.min_feature.is_some() {
            [own.least_wall, own.least_gap] = verify::widths(cell, n)?.map(Some);
        }
        Ok((own, found))
    }

    /// The constraints that figures of a cell miss, with the width of walls and gaps.
    fn misses(&self, found: &DesignProperties) -> Vec<Miss> {
        let mut all = self.design.target.misses(found);
        let widths = [found.least_wall, found.least_gap].into_iter().flatten();
        let found = widths.fold(f64::INFINITY, f64::min);
        let wanted = self.design.min_feature.filter(|wanted| found < *wanted);
        all.extend(wanted.map(|wanted| Miss {
            key: FEATURE_KEY,
            wanted,
            found,
        }));
        all
    }

    fn problem<'a>(
        &'a self,
        stage: usize,
        sampled: &'a SampledBasis,
        space: &'a Space,
        objective: &'a Objective,
    ) -> Problem<'a> {
        let own = &self.design.stages[stage];
        let scale = verify::scale(self.design.element);
        let half = self.design.min_feature.map(|d| 0.5 * d * scale);
        // Eroded, a solid loses what is narrower than twice the distance: such walls only cost volume. A void loses
        // it dilated.
        let side = if self.design.target.maximise == Some(Property::Permeability) {
            -1.0
        } else {
            1.0
        };
        Problem {
            sampled,
            space,
            objective,
            solid: self.design.solid,
            fraction: self.design.volume_fraction,
            interface: Interface {
                width: own.width / self.grids[stage] as f64,
                power: own.power,
            },
            erosions: half.map_or_else(|| vec![0.0], |h| vec![0.0, side * h]),
            tube: None,
        }
    }

    /// The least opening: the one that is wanted, or that a least feature leaves to a ball between two walls.
    fn least_opening(&self) -> Option<f64> {
        let gap = self.design.min_feature.map(|d| 0.5 * d);
        let wanted = self.design.target.min_opening;
        wanted.into_iter().chain(gap).reduce(f64::max)
    }

    /// The barrier around the ways through a candidate's void, where an opening is wanted.
    fn tube(
        &self,
        candidate: &Candidate,
        problem: &Problem,
        n: usize,
    ) -> Result<Option<Tube>, InverseError> {
        let Some(least) = self.least_opening() else {
            return Ok(None);
        };
        let Some((coefficients, level)) = problem.placed(&candidate.unknowns) else {
            return Ok(None);
        };
        let cell = self.cell(&coefficients, level, problem.space)?;
        let (_, ways) = verify::ways(&cell, n)?;
        let radius = candidate.barrier * least * verify::scale(self.design.element);
        Ok(Some(Tube::new(problem.sampled, &ways, radius)))
    }

    fn media(&self, problem: &Problem) -> Vec<Medium> {
        let control = Control {
            tolerance: SEARCH_RESIDUAL,
            ..Control::default()
        };
        problem
            .erosions
            .iter()
            .map(|_| {
                Medium::new(
                    problem.sampled.grid(),
                    self.settings.solid,
                    self.settings.void,
                    problem.sampled.is_cubic(),
                    control,
                )
            })
            .collect()
    }

    /// Improves all candidates in one stage; whether the user stopped it.
    fn advance(
        &self,
        (stage, title, evaluations): (usize, &str, usize),
        all: &mut [Candidate],
        space: &Space,
        report: &mut DesignReport,
        progress: &dyn Progress,
    ) -> Result<bool, InverseError> {
        let sampled = self.sampled(self.grids[stage])?;
        let best = all
            .iter()
            .map(Candidate::cost)
            .fold(f64::INFINITY, f64::min);
        let shown = if best.is_finite() {
            format!(", objective {best:.4}")
        } else {
            String::new()
        };
        let title = format!(
            "{title}, {} starts, {} voxels{shown}",
            all.len(),
            self.grids[stage]
        );
        progress.stage(&title, Some((evaluations * all.len()) as u64));
        let found: Vec<_> = all
            .par_iter()
            .map(|c| {
                let mut problem = self.problem(stage, &sampled, space, &c.objective);
                for erosion in &mut problem.erosions {
                    *erosion *= c.erosion;
                }
                problem.tube = self.tube(c, &problem, self.grids[stage])?;
                let media = self.media(&problem);
                Ok(optimise(
                    &problem,
                    c.unknowns.clone(),
                    media,
                    evaluations,
                    progress,
                ))
            })
            .collect::<Result<_, InverseError>>()?;
        let mut is_stopped = false;
        for (candidate, (found, failure)) in all.iter_mut().zip(found) {
            report.history.push(DesignStep {
                stage: stage + 1,
                start: candidate.start.clone(),
                voxels: self.grids[stage],
                evaluations: found.evaluations,
                objective: found.best.as_ref().map(|b| b.1.cost),
            });
            match failure {
                Some(e) if e.is_cancelled() => is_stopped = true,
                Some(e) => return Err(e),
                None => {}
            }
            if let Some((unknowns, own)) = found.best {
                candidate.earlier.extend(candidate.best.take());
                (candidate.unknowns, candidate.best) = (unknowns, Some(own));
            } else if let Some((unknowns, own)) = found.any
                && !is_stopped
            {
                candidate.unknowns = unknowns;
                candidate.earlier.extend(candidate.best.take());
                candidate.any = Some(own);
            }
        }
        Ok(is_stopped)
    }

    /// Searches, from the cell of an earlier search if there is one.
    ///
    /// # Errors
    /// [`InverseError::Disconnected`] where no start led to a connected cell, [`InverseError::Infeasible`] where none
    /// meets the constraints, [`InverseError::Start`], [`InverseError::Conflict`] of matched cells, and those of the
    /// solver. A user's stop is an error only before the first connected cell.
    pub fn search(
        &self,
        earlier: Option<&Cell>,
        progress: &dyn Progress,
    ) -> Result<Designed, InverseError> {
        let last = self.sampled(self.design.voxels)?;
        let space = self.space(&last)?;
        let mut report = DesignReport {
            target: self.design.target.describe(),
            volume_fraction: self.design.volume_fraction,
            ..DesignReport::default()
        };
        let count = self.design.stages.len();
        let mut first_stage = 0;
        let starts = match earlier {
            None => self.starts(&last)?,
            Some(cell) => {
                let own = cell.report().and_then(|r| r.design.as_ref());
                if let Some(own) = own {
                    report.history.clone_from(&own.history);
                    first_stage = own.stages.min(count - 1);
                }
                let mut start = start::of_cell(self.design.element, &last, cell)?;
                if let Some(own) = own {
                    start.name.clone_from(&own.start);
                }
                vec![start]
            }
        };
        let mut all: Vec<Candidate> = starts.iter().map(|s| self.candidate(s, &space)).collect();
        let known = if earlier.is_none() {
            self.known_sheets(&last, &space, progress)
        } else {
            Vec::new()
        };
        let mut is_stopped = false;
        for stage in first_stage..count {
            let title = format!("design {} of {count}", stage + 1);
            let effort = (stage, title.as_str(), self.stage_evaluations(stage));
            is_stopped = self.advance(effort, &mut all, &space, &mut report, progress)?;
            // The sort is stable: of equals the earlier start goes on.
            all.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
            if is_stopped {
                break;
            }
            report.stages = stage + 1;
            if stage + 1 < count {
                all.truncate(candidates(self.design.starts, stage + 1));
            }
        }
        let target = &self.design.target;
        if !is_stopped && (target.has_goals() || self.is_constrained()) {
            is_stopped = self.correct(&mut all, &space, &mut report, progress)?;
        }
        report.complete = !is_stopped;
        all.extend(known);
        let found = self.finish(&all, &space, report.clone(), progress);
        let Err(InverseError::Infeasible { misses, .. }) = &found else {
            return found;
        };
        // A start as it is may be nearer, or meet what the barriers lost.
        let given = self.unchanged(&starts, &last, &space, progress);
        match self.finish(&given, &space, report, progress) {
            Err(InverseError::Disconnected(_)) => found,
            Err(InverseError::Infeasible { misses: own, .. }) if miss(&own) > miss(misses) => found,
            other => other,
        }
    }

    /// Known sheets as they are, for a design without a start or conditions that they may break.
    fn known_sheets(
        &self,
        sampled: &SampledBasis,
        space: &Space,
        progress: &dyn Progress,
    ) -> Vec<Candidate> {
        let design = &self.design;
        let is_free = design.matched.is_empty()
            && !design.face_normal
            && design.min_feature.is_none()
            && !design.target.is_constrained();
        let has_start = !matches!(design.start, StartChoice::Several);
        if design.solid != Solid::Sheet || has_start || !is_free {
            return Vec::new();
        }
        let known = start::known_sheets(design.element, sampled);
        self.unchanged(&known, sampled, space, progress)
    }

    /// Starts as they are, evaluated once.
    fn unchanged(
        &self,
        starts: &[Start],
        sampled: &SampledBasis,
        space: &Space,
        progress: &dyn Progress,
    ) -> Vec<Candidate> {
        let stage = self.design.stages.len() - 1;
        let problem = self.problem(stage, sampled, space, &self.objective);
        let evaluated = starts.iter().map(|s| {
            let mut own = self.candidate(s, space);
            let media = self.media(&problem);
            // A stop is noticed by the stage that follows.
            let (found, _) = optimise(&problem, own.unknowns.clone(), media, 1, progress);
            (own.best, own.any) = (found.best.map(|b| b.1), found.any.map(|a| a.1));
            own
        });
        evaluated.collect()
    }

    fn candidate(&self, start: &Start, space: &Space) -> Candidate {
        Candidate {
            unknowns: space.unknowns(&start.coefficients),
            start: start.name.clone(),
            best: None,
            any: None,
            earlier: Vec::new(),
            objective: self.objective.clone(),
            barrier: MARGIN,
            erosion: FIRST_EROSION,
        }
    }

    /// Moves goals, flow bounds, barrier and erosion by what finer sharp voxels miss, and continues; whether stopped.
    fn correct(
        &self,
        all: &mut [Candidate],
        space: &Space,
        report: &mut DesignReport,
        progress: &dyn Progress,
    ) -> Result<bool, InverseError> {
        let stage = self.design.stages.len() - 1;
        let share = CORRECTION_SHARE * self.stage_evaluations(stage) as f64;
        let target = &self.design.target;
        let rounds = if self.is_constrained() {
            CONSTRAINED_CORRECTIONS
        } else {
            CORRECTIONS
        };
        for round in 0..rounds {
            let mut is_met = true;
            for candidate in all.iter_mut() {
                let Some(best) = candidate.best.as_ref().or(candidate.any.as_ref()) else {
                    continue;
                };
                let cell = self.cell(&best.coefficients, best.level, space)?;
                let fine = 2 * self.design.voxels;
                match self.figures(&cell, fine, progress) {
                    Ok((own, found)) => {
                        let misses = self.misses(&own);
                        is_met &= misses.is_empty();
                        candidate.objective =
                            self.objective.corrected(target, &best.effective, &found);
                        // The barrier gives way a little: it is moved by what the opening misses.
                        if let (Some(least), Some(found)) = (self.least_opening(), own.opening) {
                            let moved = candidate.barrier * MARGIN * least / found;
                            candidate.barrier = moved.clamp(BARRIER_RADII[0], BARRIER_RADII[1]);
                        }
                        // Walls that are too narrow must survive a move that is longer by as much, wide ones a
                        // shorter one.
                        if let (Some(least), Some(found)) =
                            (self.design.min_feature, own.least_wall)
                        {
                            let moved = candidate.erosion * MARGIN * least / found;
                            candidate.erosion = moved.clamp(EROSIONS[0], EROSIONS[1]);
                            is_met &= found < MAX_EXCESS * least || moved <= EROSIONS[0];
                        }
                    }
                    Err(e) if e.is_cancelled() => return Ok(true),
                    Err(e) => return Err(e),
                }
            }
            // Goals have all their rounds; constraints end them as soon as every candidate meets them.
            if is_met && (!target.has_goals() || round >= CORRECTIONS) {
                break;
            }
            let title = format!("correction {} of {rounds}", round + 1);
            let effort = (stage, title.as_str(), share.ceil() as usize);
            if self.advance(effort, all, space, report, progress)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The connected candidate with the least objective, on a grid twice as fine, of those that meet all constraints;
    /// stopped, the connected one with the least objective of its last evaluation.
    fn finish(
        &self,
        all: &[Candidate],
        space: &Space,
        mut report: DesignReport,
        progress: &dyn Progress,
    ) -> Result<Designed, InverseError> {
        let is_stopped = !report.complete;
        let fine = 2 * self.design.voxels;
        // A stopped search still tests its cell, without progress, which would cancel the test.
        let watched: &dyn Progress = if is_stopped { &Silent } else { progress };
        if !is_stopped {
            progress.stage(&format!("figures, {fine} voxels"), None);
        }
        let mut fault = InverseError::Disconnected("no level gives the volume fraction".to_owned());
        let mut chosen: Option<(f64, Cell, &Candidate, Option<DesignProperties>)> = None;
        let mut nearest: Option<Vec<Miss>> = None;
        for candidate in all {
            let last = candidate.best.as_ref().or(candidate.any.as_ref());
            // The last cell of a candidate that is connected and meets the constraints: a correction may lose both.
            for evaluation in last.into_iter().chain(candidate.earlier.iter().rev()) {
                let cell = self.cell(&evaluation.coefficients, evaluation.level, space)?;
                match verify::check_connected(&cell, fine, watched) {
                    Ok(()) => {}
                    Err(e @ InverseError::Disconnected(_)) => {
                        fault = e;
                        continue;
                    }
                    Err(e) => return Err(e),
                }
                let (cost, properties) = if is_stopped {
                    (evaluation.cost, None)
                } else {
                    let (own, found) = self.figures(&cell, fine, progress)?;
                    let misses = self.misses(&own);
                    if !misses.is_empty() {
                        if nearest.as_ref().is_none_or(|n| miss(&misses) < miss(n)) {
                            nearest = Some(misses);
                        }
                        continue;
                    }
                    let cost = self
                        .objective
                        .cost(&found)
                        .map_or(f64::INFINITY, |c| c.value);
                    (cost, Some(own))
                };
                if chosen.as_ref().is_none_or(|c| cost < c.0) {
                    chosen = Some((cost, cell, candidate, properties));
                }
                break;
            }
        }
        let Some((cost, cell, candidate, properties)) = chosen else {
            if is_stopped {
                return Err(HomogenizeError::Cancelled(druse_geometry::progress::Cancelled).into());
            }
            return Err(match nearest {
                Some(misses) => InverseError::Infeasible {
                    fraction: self.design.volume_fraction,
                    misses,
                },
                None => fault,
            });
        };
        report.start.clone_from(&candidate.start);
        report.objective = cost;
        if let Some(own) = properties {
            let (coarse, _) = self.figures(&cell, self.design.voxels, progress)?;
            report.properties = vec![own, coarse];
        }
        let report = FitReport {
            method: "target".to_owned(),
            solver: "l-bfgs".to_owned(),
            lattice: self.basis.lattice().name().unwrap_or_default().to_owned(),
            band_limit: self.basis.radius(),
            degrees_of_freedom: space.unknowns_count(),
            kept_energy: 1.0,
            design: Some(report),
            ..FitReport::default()
        };
        Ok(Designed {
            cell: cell.with_report(report),
            is_stopped,
        })
    }
}
