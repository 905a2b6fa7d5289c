//! The turns of all elements by which cells continue over the faces.
//!
//! The tables of [`Views`] say which turn of a neighbour continues a turned element. From the first element of
//! a component, in each turn that makes a different cell, a breadth-first search turns all others; then every
//! face is checked, also those that the search has not crossed. Of the searches with the fewest bad faces that
//! one is taken whose cells lie best as [`Aim`] wants them, and of the turns that give the same cell the one that
//! lies best too. The result does therefore not depend on how the elements were numbered.

use super::views::{NO_TURN, Turn, Views};
use crate::scaffold::{FaceRef, Neighbour, Scaffold};
use druse_geometry::frame::{Mat3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

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
    /// The score of the world's axes is Q.M, the sum of the products of all entries.
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

/// The shared faces of a scaffold.
pub(super) struct Faces {
    pub list: Vec<Shared>,
    /// By element and face, the place in the list; [`u32::MAX`] for others.
    places: Vec<u32>,
    /// By element, the entry of its first face in `places`.
    starts: Vec<u32>,
}

impl Faces {
    /// The shared faces in the order of their lower sides, by element and face.
    pub fn new(scaffold: &Scaffold, views: &Views) -> Self {
        let mut starts = Vec::with_capacity(scaffold.len());
        let mut count = 0;
        for e in 0..scaffold.len() {
            starts.push(count);
            count += scaffold.element(e).kind().faces().len() as u32;
        }
        let mut faces = Self {
            list: Vec::new(),
            places: vec![u32::MAX; count as usize],
            starts,
        };
        let shared: Vec<([FaceRef; 2], Shared)> = (0..scaffold.len())
            .into_par_iter()
            .flat_map_iter(|e| scaffold.faces_of(e))
            .filter_map(|f| match scaffold.neighbour(f) {
                Neighbour::Face(g) if f < g => Some(([f, g], Shared::new(scaffold, views, f, g))),
                _ => None,
            })
            .collect();
        faces.list.reserve(shared.len());
        for (sides, face) in shared {
            for f in sides {
                let at = faces.starts[f.element as usize] + u32::from(f.face);
                faces.places[at as usize] = faces.list.len() as u32;
            }
            faces.list.push(face);
        }
        faces
    }

    /// A shared face as its element sees it: own side first.
    pub fn get(&self, f: FaceRef) -> Option<Shared> {
        let at = self.starts[f.element as usize] + u32::from(f.face);
        let face = self.list.get(self.places[at as usize] as usize)?;
        Some(if face.elements[0] == f.element {
            *face
        } else {
            face.reversed()
        })
    }
}

/// A scaffold's elements with all that the search needs of them.
pub(super) struct Search<'a> {
    pub scaffold: &'a Scaffold,
    pub views: &'a Views,
    pub faces: &'a Faces,
    /// Whether the nodes of each element are in mirror order, so that only mirrored turns keep the handedness.
    is_mirror: Vec<bool>,
    /// Unit vectors along the reference axes at each centre.
    axes: Vec<Mat3>,
}

/// Elements that are joined by faces.
struct Part {
    root: u32,
    /// The faces that the search crosses, each towards the next element.
    way: Vec<Shared>,
    /// Places of all shared faces.
    faces: Vec<u32>,
}

/// Turns of the elements of a part, in the order of its search.
struct Trial {
    bad: Vec<u32>,
    /// Sum of the scores of its elements.
    score: f64,
    turns: Vec<u8>,
}

/// The turns of all elements.
pub(super) struct Found {
    pub turns: Vec<u8>,
    /// Places of the faces over which cells do not continue.
    pub bad: Vec<u32>,
}

impl<'a> Search<'a> {
    pub fn new(scaffold: &'a Scaffold, views: &'a Views, faces: &'a Faces) -> Self {
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
            faces,
            is_mirror,
            axes,
        }
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

    /// The class of a turn of an element.
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

    /// Of the turns of an element that keep its handedness, the one of each class that lies best, with its score.
    fn best(&self, element: usize, aim: &Aim, best: &mut Vec<(u8, u8, f64)>) {
        best.clear();
        let shape = self.views.shape(self.scaffold.element(element).shape());
        let aim = aim.of_element(element, &self.axes[element]);
        for (n, turn) in shape.turns.iter().enumerate() {
            if turn.is_mirror != self.is_mirror[element] {
                continue;
            }
            let score = aim.score(&turn.matrix);
            match best.iter_mut().find(|b| b.0 == turn.class) {
                Some(b) if b.2 >= score => {}
                Some(b) => (b.1, b.2) = (n as u8, score),
                None => best.push((turn.class, n as u8, score)),
            }
        }
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
                    let part = self.part(root, &mut places);
                    bad.extend(self.turn_part(&part, &places, aim, &mut turns));
                }
            }
        }
        bad.sort_unstable();
        Found { turns, bad }
    }

    /// The elements that a breadth-first search from an element reaches.
    fn part(&self, root: u32, places: &mut [u32]) -> Part {
        let mut part = Part {
            root,
            way: Vec::new(),
            faces: Vec::new(),
        };
        places[root as usize] = 0;
        let mut from = root;
        for next in 0.. {
            for f in self.scaffold.faces_of(from as usize) {
                let Some(face) = self.faces.get(f) else {
                    continue;
                };
                let to = &mut places[face.elements[1] as usize];
                if *to == u32::MAX {
                    part.way.push(face);
                    *to = part.way.len() as u32;
                }
                // From the side that the list has first.
                if let Some(place) = self.faces.place(f)
                    && self.faces.list[place as usize].elements[0] == from
                {
                    part.faces.push(place);
                }
            }
            match part.way.get(next) {
                Some(face) => from = face.elements[1],
                None => break,
            }
        }
        part
    }

    /// Turns the elements of a part; returns the bad faces among them.
    fn turn_part(&self, part: &Part, places: &[u32], aim: &Aim, turns: &mut [u8]) -> Vec<u32> {
        let elements = std::iter::once(part.root).chain(part.way.iter().map(|f| f.elements[1]));
        let elements: Vec<u32> = elements.collect();
        let mut starts = Vec::new();
        self.best(part.root as usize, aim, &mut starts);
        // A trial that is given up has more bad faces than another, whatever the order in which trials end.
        let fewest = AtomicUsize::new(usize::MAX);
        let mut trials: Vec<Trial> = starts
            .into_par_iter()
            .map(|(_, start, _)| self.trial(part, places, start, &fewest))
            .collect();
        let fewest = fewest.into_inner();
        trials.retain(|t| t.bad.len() == fewest);
        // By trial the turn of the same cell that lies best, for each element, and the sum of their scores.
        let chosen: Vec<Vec<(Vec<u8>, f64)>> = elements
            .par_chunks(SCORED_ELEMENTS)
            .enumerate()
            .map(|(n, own)| self.best_of_classes(own, n * SCORED_ELEMENTS, &trials, aim))
            .collect();
        for (n, trial) in trials.iter_mut().enumerate() {
            trial.turns.clear();
            for chunk in &chosen {
                trial.turns.extend_from_slice(&chunk[n].0);
                trial.score += chunk[n].1;
            }
        }
        let better = |a: Trial, b: Trial| if b.score > a.score { b } else { a };
        let Some(chosen) = trials.into_iter().reduce(better) else {
            return Vec::new();
        };
        for (e, turn) in elements.into_iter().zip(chosen.turns) {
            turns[e as usize] = turn;
        }
        chosen.bad
    }

    /// The turns that follow from that of a part's first element. The list of bad faces ends once it is longer than
    /// `fewest`, which becomes the least number in any trial.
    fn trial(&self, part: &Part, places: &[u32], start: u8, fewest: &AtomicUsize) -> Trial {
        let mut turns = Vec::with_capacity(part.way.len() + 1);
        turns.push(start);
        for face in &part.way {
            let [from, to] = face.elements.map(|e| e as usize);
            let turn = self.next(face, turns[places[from] as usize]);
            // Behind a face that no turn continues, the search goes on with any turn.
            turns.push(if turn == NO_TURN {
                self.first_turn(to)
            } else {
                turn
            });
        }
        let mut bad = Vec::new();
        for &place in &part.faces {
            let face = &self.faces.list[place as usize];
            let [a, b] = [0, 1].map(|side| {
                let turn = turns[places[face.elements[side] as usize] as usize];
                self.views.image(face.views[side], turn)
            });
            if !self.views.fits(a, b) {
                bad.push(place);
                if bad.len() > fewest.load(Ordering::Relaxed) {
                    break;
                }
            }
        }
        fewest.fetch_min(bad.len(), Ordering::Relaxed);
        Trial {
            bad,
            score: 0.0,
            turns,
        }
    }

    /// For each trial, the best turns of elements from place `first` of the search on that give the same cells as the
    /// trial's, and the sum of their scores.
    fn best_of_classes(
        &self,
        elements: &[u32],
        first: usize,
        trials: &[Trial],
        aim: &Aim,
    ) -> Vec<(Vec<u8>, f64)> {
        let mut chosen = vec![(Vec::with_capacity(elements.len()), 0.0); trials.len()];
        let mut best = Vec::new();
        for (n, &e) in elements.iter().enumerate() {
            self.best(e as usize, aim, &mut best);
            for (trial, (turns, score)) in trials.iter().zip(&mut chosen) {
                let turn = trial.turns[first + n];
                let class = self.class(e as usize, turn);
                let found = best.iter().find(|b| b.0 == class);
                turns.push(found.map_or(turn, |b| b.1));
                *score += found.map_or(0.0, |b| b.2);
            }
        }
        chosen
    }

    /// The first turn that keeps the handedness of an element.
    fn first_turn(&self, element: usize) -> u8 {
        let shape = self.views.shape(self.scaffold.element(element).shape());
        let keeps = |t: &super::views::Turn| t.is_mirror == self.is_mirror[element];
        shape.turns.iter().position(keeps).map_or(0, |n| n as u8)
    }
}

impl Faces {
    /// The place of a shared face in the list.
    pub fn place(&self, f: FaceRef) -> Option<u32> {
        let at = self.starts[f.element as usize] + u32::from(f.face);
        let place = self.places[at as usize];
        (place != u32::MAX).then_some(place)
    }
}
