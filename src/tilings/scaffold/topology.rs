//! Topology of a scaffold: neighbours, outer faces, components.
//!
//! Faces are the same if their corner nodes are. Mid nodes follow from the corners in a conforming
//! mesh; where they do not, the face is torn and the report lists it.

use super::{Connectivity, Scaffold};
use druse_geometry::union_find::UnionFind;
use rayon::prelude::*;

/// A face of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FaceRef {
    /// The element's number.
    pub element: u32,
    /// The face's number within the element, in the order of [`druse_geometry::frame::Element::faces`].
    pub face: u8,
}

/// The neighbour across a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbour {
    /// None: an outer face.
    Outside,
    /// The face of another element with the same corner nodes.
    Face(FaceRef),
    /// More than one other element: no manifold. They count as connected, and the face as inner.
    Several,
}

/// Faces and components of a scaffold.
#[derive(Clone)]
pub(super) struct Topology {
    /// First face of every element in `neighbours`.
    starts: Vec<u32>,
    neighbours: Vec<Neighbour>,
    /// Groups of more than two faces with the same corners.
    pub non_manifold: Vec<Vec<FaceRef>>,
    component_of: Vec<u32>,
    components: Vec<Vec<u32>>,
}

/// The corner nodes of a face, sorted; triangles end in `u32::MAX`.
pub(super) fn face_key(elements: &Connectivity, f: FaceRef) -> [u32; 4] {
    let e = f.element as usize;
    let nodes = elements.nodes(e);
    let mut key = [u32::MAX; 4];
    for (k, &corner) in key
        .iter_mut()
        .zip(elements.kind(e).faces()[f.face as usize].corners)
    {
        *k = nodes[corner as usize];
    }
    key.sort_unstable();
    key
}

impl Topology {
    /// Compares the faces of all elements by their corner nodes. Mid nodes do not count. Elements that share a face are
    /// of one component, even where more than two share it.
    pub fn new(elements: &Connectivity) -> Self {
        let mut starts = Vec::with_capacity(elements.len());
        let mut faces = Vec::new();
        for e in 0..elements.len() {
            starts.push(faces.len() as u32);
            for face in 0..elements.kind(e).faces().len() as u8 {
                let f = FaceRef {
                    element: e as u32,
                    face,
                };
                faces.push((face_key(elements, f), f));
            }
        }
        // Sorted by corners, the faces at one place are beside each other.
        faces.par_sort_unstable();
        let mut topology = Self {
            neighbours: vec![Neighbour::Outside; faces.len()],
            starts,
            non_manifold: Vec::new(),
            component_of: Vec::new(),
            components: Vec::new(),
        };
        let mut sets = UnionFind::new(elements.len());
        // One face is outer, two are neighbours, more are non-manifold.
        for group in faces.chunk_by(|a, b| a.0 == b.0) {
            for pair in group.windows(2) {
                sets.union(pair[0].1.element as usize, pair[1].1.element as usize);
            }
            match group {
                [_] => {}
                [(_, a), (_, b)] => {
                    topology.set(*a, Neighbour::Face(*b));
                    topology.set(*b, Neighbour::Face(*a));
                }
                many => {
                    let many: Vec<FaceRef> = many.iter().map(|f| f.1).collect();
                    for f in &many {
                        topology.set(*f, Neighbour::Several);
                    }
                    topology.non_manifold.push(many);
                }
            }
        }
        topology.non_manifold.sort_unstable();
        // Components are numbered by their first element.
        let (component_of, count) = sets.labels(0..elements.len());
        topology.components = vec![Vec::new(); count];
        for (e, &component) in component_of.iter().enumerate() {
            topology.components[component as usize].push(e as u32);
        }
        topology.component_of = component_of;
        topology
    }

    /// Puts the faces within each element (at least one) in another order: `renumbered` gives a face its new number.
    pub fn renumber(&mut self, renumbered: impl Fn(FaceRef) -> FaceRef) {
        let ends = self.starts[1..].iter().copied();
        let ends = ends.chain([self.neighbours.len() as u32]);
        let mut former = Vec::new();
        for (element, (&start, end)) in self.starts.iter().zip(ends).enumerate() {
            let own = &mut self.neighbours[start as usize..end as usize];
            former.clear();
            former.extend_from_slice(own);
            for (face, neighbour) in former.iter().enumerate() {
                let f = FaceRef {
                    element: element as u32,
                    face: face as u8,
                };
                own[usize::from(renumbered(f).face)] = match *neighbour {
                    Neighbour::Face(g) => Neighbour::Face(renumbered(g)),
                    other => other,
                };
            }
        }
        // As sorted as in a topology that is made anew.
        for group in &mut self.non_manifold {
            for f in &mut *group {
                *f = renumbered(*f);
            }
            group.sort_unstable();
        }
        self.non_manifold.sort_unstable();
    }

    fn set(&mut self, f: FaceRef, n: Neighbour) {
        let at = self.starts[f.element as usize] as usize + f.face as usize;
        self.neighbours[at] = n;
    }

    fn get(&self, f: FaceRef) -> Neighbour {
        self.neighbours[self.starts[f.element as usize] as usize + f.face as usize]
    }
}

impl Scaffold {
    /// The neighbour across a face of an element.
    pub fn neighbour(&self, f: FaceRef) -> Neighbour {
        self.topology.get(f)
    }

    /// The faces of an element.
    pub fn faces_of(&self, element: usize) -> impl Iterator<Item = FaceRef> + use<> {
        let count = self.elements.kind(element).faces().len() as u8;
        let element = element as u32;
        (0..count).map(move |face| FaceRef { element, face })
    }

    /// Elements that share a face with this one, in order of its faces.
    pub fn neighbours(&self, element: usize) -> impl Iterator<Item = u32> + '_ {
        self.faces_of(element)
            .filter_map(|f| match self.neighbour(f) {
                Neighbour::Face(g) => Some(g.element),
                _ => None,
            })
    }

    /// Faces without a neighbour, in order.
    pub fn outer_faces(&self) -> impl Iterator<Item = FaceRef> + '_ {
        (0..self.len())
            .flat_map(|e| self.faces_of(e))
            .filter(|f| self.neighbour(*f) == Neighbour::Outside)
    }

    /// Groups of more than two elements that share one face.
    pub fn non_manifold_faces(&self) -> &[Vec<FaceRef>] {
        &self.topology.non_manifold
    }

    /// Elements of each face-connected component, ascending; components in order of their least element.
    pub fn components(&self) -> &[Vec<u32>] {
        &self.topology.components
    }

    /// The component of an element.
    pub fn component_of(&self, element: usize) -> usize {
        self.topology.component_of[element] as usize
    }
}
