//! The turns of all elements by which cells continue over the faces.
//!
//! The tables of [`Views`] say which turn of a neighbour continues a turned element. From the first element of
//! a component, in each turn that makes a different cell, a breadth-first search turns all others; then every
//! face is checked, also those that the search has not crossed. Of the searches with the fewest bad faces that
//! one is taken whose cells lie best as [`Aim`] wants them, and of the turns that give the same cell the one that
//! lies best too. Where cells continue everywhere, the result thus depends on the elements' numbering only if the aim
//! is [`Aim::Numbering`].

use super::views::{MAX_TURNS, NO_TURN, Turn, Views};
use crate::scaffold::{FaceRef, Neighbour, Scaffold};
use druse_geometry::frame::{Mat3, Vec3};
use rayon::prelude::*;

/// How cells lie where several ways of turning them all continue over the faces.
#[derive(Clone, Debug, Default)]
pub enum Aim {
    /// The axes of the reference shapes along those of the world.
    #[default]
    World,
    /// The elements as they are numbered, as far as possible: the same for every shape that a moving scaffold takes.
    Numbering,
    /// The third axis of the reference shapes along directions.
    Directions(Directions),
}

/// Directions of cells, by element.
#[derive(Clone, Debug, Default)]
pub struct Directions {
    /// Where the third axis points.
    pub toward: Vec<Vec3>,
    /// Where the first axis points, as far as the third one leaves a choice; empty: anywhere.
    pub up: Vec<Vec3>,
    /// Whether a direction and its opposite are the same, as for stresses.
    pub is_axial: bool,
}

/// Elements whose turns are chosen in one go. Scores are summed by these, so that sums do not depend on threads.
const SCORED_ELEMENTS: usize = 1 << 12;

/// Nearly the identity, and generic, so that hardly any two turns of an element are equally good.
const WORLD: Mat3 = Mat3::new(
    1.0, 0.0013, 0.0037, 0.0029, 1.0007, 0.0041, 0.0053, 0.0019, 1.0011,
);
/// Weights of the second direction, and of the world's axes, beside the first direction.
const UP_WEIGHT: f64 = 0.1;
const WORLD_WEIGHT: f64 = 1e-3;

/// What an element's axes A make of an [`Aim`], for all of its turns: its axes become A Q^T by a turn Q.
struct ElementAim {
    /// The matrix M of the score Q.M of the world's axes (or the own ones), the sum of the products of all entries.
    world: Mat3,
    /// A^T v for the directions v of the third and of the first axis, with their weights. That axis of A Q^T is A times
    /// a row of Q, so that its cosine is the row's product with this vector.
    directions: [Option<(usize, Vec3)>; 2],
    is_axial: bool,
}

impl Aim {
    /// The aim of an element whose reference axes are along the columns of `axes`.
    fn of_element(&self, element: usize, axes: &Mat3) -> ElementAim {
        let none = [None; 2];
        let (world, directions, is_axial) = match self {
            Self::World => (WORLD.tr_mul(axes), none, false),
            Self::Numbering => (WORLD.transpose(), none, false),
            Self::Directions(d) => {
                let along = |v: Option<&Vec3>, axis: usize, weight: f64| {
                    v.map(|v| (axis, axes.tr_mul(v) * weight))
                };
                let toward = along(d.toward.get(element), 2, 1.0);
                let up = along(d.up.get(element), 0, UP_WEIGHT);
                let world = WORLD.tr_mul(axes) * WORLD_WEIGHT;
                (world, [toward, up], d.is_axial)
            }
        };
        ElementAim {
            world,
            directions,
            is_axial,
        }
    }
}

impl ElementAim {
    /// How well the element lies with a turn.
    fn score(&self, turn: &Mat3) -> f64 {
        let along = |(axis, v): &(usize, Vec3)| {
            let cosine = turn.row(*axis).transpose().dot(v);
            if self.is_axial { cosine.abs() } else { cosine }
        };
        let directions: f64 = self.directions.iter().flatten().map(along).sum();
        turn.dot(&self.world) + directions
    }
}

/// A shared face with the views of its two elements.
#[derive(Clone, Copy)]
pub(super) struct Shared {
    pub elements: [u32; 2],
    pub views: [u16; 2],
}

impl Shared {
    fn new(scaffold: &Scaffold, views: &Views, f: FaceRef, g: FaceRef) -> Self {
        let [own, theirs] = [f, g].map(|f| {
            let e = scaffold.element(f.element as usize);
            let corners = e.kind().faces()[f.face as usize].corners;
            (corners, e.nodes(), views.shape(e.shape()))
        });
        // The neighbour's corners in the order of the own ones; a degenerate element repeats a node.
        let mut matching = [0; 4];
        let count = own.0.len();
        for (to, &n) in matching.iter_mut().zip(own.0) {
            let node = own.1[n as usize];
            let is_same = |m: &&u8| theirs.1[**m as usize] == node;
            *to = theirs.0.iter().find(is_same).map_or(0, |m| *m);
        }
        Self {
            elements: [f.element, g.element],
            views: [own.2.view(own.0), theirs.2.view(&matching[..count])],
        }
    }

    /// The face as the other element sees it.
    pub fn reversed(self) -> Self {
        Self {
            elements: [self.elements[1], self.elements[0]],
            views: [self.views[1], self.views[0]],
        }
    }
}

/// A scaffold's elements with all that the search needs of them.
pub(super) struct Search<'a> {
    pub scaffold: &'a Scaffold,
    pub views: &'a Views,
    /// Whether the nodes of each element are in mirror order, so that only mirrored turns keep the handedness.
    is_mirror: Vec<bool>,
    /// Unit vectors along the reference axes at each centre.
    axes: Vec<Mat3>,
}

/// A turn of an element and how well it lies.
#[derive(Clone, Copy)]
struct Scored {
    turn: u8,
    score: f64,
}

/// The elements of a part that several trials have turned, each from another turn of the first element.
struct Trials<'a> {
    /// By element of the scaffold its place in the part's order.
    places: &'a [u32],
    count: usize,
    /// By place, then by trial.
    turns: Vec<u8>,
}

/// What a trial makes of some elements.
#[derive(Clone, Default)]
struct Outcome {
    /// Number of their faces over which the cells do not continue.
    bad: usize,
    /// Sum of the scores of `turns`.
    score: f64,
    /// Of the turns that give the same cells, those that lie best.
    turns: Vec<u8>,
}

/// The turns of all elements.
pub(super) struct Found {
    pub turns: Vec<u8>,
    /// The faces over which cells do not continue, from the side with the lower number.
    pub bad: Vec<FaceRef>,
}

impl Trials<'_> {
    /// The turn of an element in a trial.
    fn turn(&self, element: u32, trial: usize) -> u8 {
        self.turns[self.places[element as usize] as usize * self.count + trial]
    }
}

impl<'a> Search<'a> {
    pub fn new(scaffold: &'a Scaffold, views: &'a Views) -> Self {
        let (is_mirror, axes) = (0..scaffold.len())
            .into_par_iter()
            .map(|e| {
                let element = scaffold.element(e);
                let mut axes = element.jacobian(element.shape().centroid());
                let is_mirror = axes.determinant() < 0.0;
                for mut column in axes.column_iter_mut() {
                    let _ = column.try_normalize_mut(0.0);
                }
                (is_mirror, axes)
            })
            .unzip();
        Self {
            scaffold,
            views,
            is_mirror,
            axes,
        }
    }

    /// A shared face as its element sees it: own side first.
    pub fn face(&self, f: FaceRef) -> Option<Shared> {
        let Neighbour::Face(g) = self.scaffold.neighbour(f) else {
            return None;
        };
        let face = Shared::new(self.scaffold, self.views, f.min(g), f.max(g));
        Some(if f < g { face } else { face.reversed() })
    }

    /// The turn of the neighbour behind a face that continues a turned element; [`NO_TURN`] if there is none.
    pub fn next(&self, face: &Shared, turn: u8) -> u8 {
        let shown = self.views.image(face.views[0], turn);
        let is_mirror = self.is_mirror[face.elements[1] as usize];
        self.views.next(shown, face.views[1], is_mirror)
    }

    /// The turns of an element's shape.
    pub fn turns(&self, element: usize) -> &[Turn] {
        &self
            .views
            .shape(self.scaffold.element(element).shape())
            .turns
    }

    pub fn class(&self, element: usize, turn: u8) -> u8 {
        self.turns(element)[usize::from(turn)].class
    }

    /// The classes of all turns that keep the handedness of an element.
    pub fn classes(&self, element: usize) -> impl Iterator<Item = u8> {
        let keeps = move |t: &&Turn| t.is_mirror == self.is_mirror[element];
        self.turns(element).iter().filter(keeps).map(|t| t.class)
    }

    /// The first turn of a class that keeps the handedness of an element.
    pub fn turn_of_class(&self, element: usize, class: u8) -> Option<u8> {
        let is_own = |t: &Turn| t.is_mirror == self.is_mirror[element] && t.class == class;
        let found = self.turns(element).iter().position(is_own);
        found.map(|n| n as u8)
    }

    /// Of the turns of an element that keep its handedness, by class the one that lies best; [`NO_TURN`] for others.
    fn best(&self, element: usize, aim: &Aim) -> [Scored; MAX_TURNS] {
        let mut best = [Scored {
            turn: NO_TURN,
            score: f64::NEG_INFINITY,
        }; MAX_TURNS];
        let aim = aim.of_element(element, &self.axes[element]);
        for (n, turn) in self.turns(element).iter().enumerate() {
            if turn.is_mirror != self.is_mirror[element] {
                continue;
            }
            let score = aim.score(&turn.matrix);
            let best = &mut best[usize::from(turn.class)];
            if score > best.score {
                (best.turn, best.score) = (n as u8, score);
            }
        }
        best
    }

    /// The turns of all elements with the fewest bad faces.
    pub fn run(&self, aim: &Aim) -> Found {
        let mut turns = vec![0; self.scaffold.len()];
        // The place of each element in the part that it belongs to.
        let mut places = vec![u32::MAX; self.scaffold.len()];
        let mut bad = Vec::new();
        for component in self.scaffold.components() {
            // A component by sharing of faces may fall apart where more than two elements share one.
            for &root in component {
                if places[root as usize] == u32::MAX {
                    let way = self.way(root, &mut places);
                    bad.extend(self.turn_part(root, &way, &places, aim, &mut turns));
                }
            }
        }
        bad.sort_unstable();
        Found { turns, bad }
    }

    /// The faces that a breadth-first search from an element crosses, each towards the next element.
    fn way(&self, root: u32, places: &mut [u32]) -> Vec<FaceRef> {
        let mut way = Vec::new();
        places[root as usize] = 0;
        let mut from = root;
        for next in 0.. {
            for f in self.scaffold.faces_of(from as usize) {
                let Neighbour::Face(g) = self.scaffold.neighbour(f) else {
                    continue;
                };
                let to = &mut places[g.element as usize];
                if *to == u32::MAX {
                    // From the far side, which names the next element.
                    way.push(g);
                    *to = way.len() as u32;
                }
            }
            match way.get(next) {
                Some(g) => from = g.element,
                None => break,
            }
        }
        way
    }

    /// Turns the elements of a part; returns the bad faces among them.
    fn turn_part(
        &self,
        root: u32,
        way: &[FaceRef],
        places: &[u32],
        aim: &Aim,
        turns: &mut [u8],
    ) -> Vec<FaceRef> {
        let elements: Vec<u32> = std::iter::once(root)
            .chain(way.iter().map(|g| g.element))
            .collect();
        let starts = self.best(root as usize, aim);
        let starts = starts.iter().map(|s| s.turn).filter(|t| *t != NO_TURN);
        let trials = self.trials(way, places, starts.collect());
        let chunks: Vec<Vec<Outcome>> = elements
            .par_chunks(SCORED_ELEMENTS)
            .map(|own| self.outcomes(own, &trials, aim))
            .collect();
        // Sums in the order of the chunks do not depend on threads.
        let sums: Vec<(usize, f64)> = (0..trials.count)
            .map(|n| {
                let own = chunks.iter().map(|c| (c[n].bad, c[n].score));
                own.fold((0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1))
            })
            .collect();
        let better = |&a: &usize, &b: &usize| {
            let by_faces = sums[b].0.cmp(&sums[a].0);
            by_faces.then(sums[a].1.total_cmp(&sums[b].1))
        };
        // Reversed, since `max_by` takes the last of equals: the first trial wins.
        let Some(chosen) = (0..trials.count).rev().max_by(better) else {
            return Vec::new();
        };
        let own = chunks.iter().flat_map(|c| &c[chosen].turns);
        for (&e, &turn) in elements.iter().zip(own) {
            turns[e as usize] = turn;
        }
        if sums[chosen].0 == 0 {
            return Vec::new();
        }
        let bad = elements.iter().flat_map(|&e| self.own_faces(e));
        bad.filter(|(_, face)| self.is_bad(face, chosen, &trials))
            .map(|(f, _)| f)
            .collect()
    }

    /// The shared faces that an element has from the side with the lower number.
    fn own_faces(&self, element: u32) -> impl Iterator<Item = (FaceRef, Shared)> {
        let faces = self.scaffold.faces_of(element as usize);
        faces.filter_map(|f| match self.scaffold.neighbour(f) {
            Neighbour::Face(g) if f < g => Some((f, Shared::new(self.scaffold, self.views, f, g))),
            _ => None,
        })
    }

    /// Whether the cells of a trial do not continue over a face.
    fn is_bad(&self, face: &Shared, trial: usize, trials: &Trials) -> bool {
        let [a, b] = [0, 1].map(|side| {
            let turn = trials.turn(face.elements[side], trial);
            self.views.image(face.views[side], turn)
        });
        !self.views.fits(a, b)
    }

    /// The turns that follow from those of a part's first element, one in each trial. All trials go the way together,
    /// since finding the faces takes longer than turning the elements behind them.
    fn trials<'b>(&self, way: &[FaceRef], places: &'b [u32], starts: Vec<u8>) -> Trials<'b> {
        let (count, mut turns) = (starts.len(), starts);
        turns.reserve(way.len() * count);
        let faces: Vec<Option<Shared>> = way.par_iter().map(|g| self.face(*g)).collect();
        for face in faces.into_iter().flatten().map(Shared::reversed) {
            let [from, to] = face.elements.map(|e| e as usize);
            let from = places[from] as usize * count;
            for n in from..from + count {
                let turn = self.next(&face, turns[n]);
                // Behind a face that no turn continues, the search goes on with any turn.
                turns.push(if turn == NO_TURN {
                    self.first_turn(to)
                } else {
                    turn
                });
            }
        }
        Trials {
            places,
            count,
            turns,
        }
    }

    /// What each trial makes of elements of a part.
    fn outcomes(&self, elements: &[u32], trials: &Trials, aim: &Aim) -> Vec<Outcome> {
        let mut outcomes = vec![Outcome::default(); trials.count];
        for &e in elements {
            for (_, face) in self.own_faces(e) {
                for (n, outcome) in outcomes.iter_mut().enumerate() {
                    outcome.bad += usize::from(self.is_bad(&face, n, trials));
                }
            }
            let best = self.best(e as usize, aim);
            for (n, outcome) in outcomes.iter_mut().enumerate() {
                let turn = trials.turn(e, n);
                let found = best[usize::from(self.class(e as usize, turn))];
                // An element whose axes are no numbers keeps its turn.
                let (turn, score) = match found.turn {
                    NO_TURN => (turn, 0.0),
                    best => (best, found.score),
                };
                outcome.turns.push(turn);
                outcome.score += score;
            }
        }
        outcomes
    }

    /// The first turn that keeps the handedness of an element.
    fn first_turn(&self, element: usize) -> u8 {
        let keeps = |t: &Turn| t.is_mirror == self.is_mirror[element];
        let found = self.turns(element).iter().position(keeps);
        found.map_or(0, |n| n as u8)
    }
}
