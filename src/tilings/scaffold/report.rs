//! Counts, measures and defects of a scaffold.
//!
//! Folded and degenerate elements have no inverse map, and where elements of one component overlap the
//! field has two values: these are errors. Hanging, unmerged and overlapping
//! nodes, torn and non-manifold faces leave a seam in the tiled field: they are warnings.

use super::orientation::parametric_scale;
use super::{Defects, Kind, Orientation, Scaffold};
use druse_geometry::frame::{Aabb, CellPoint, Element, Vec3};
use rayon::prelude::*;
use std::fmt;

/// A position within an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spot {
    /// One of its nodes, by its number within the element.
    Node(u8),
    /// A point of its cell.
    Cell(CellPoint<3>),
}

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Node(n) => write!(f, "node {n}"),
            Self::Cell(p) => write!(f, "xi = ({:.3}, {:.3}, {:.3})", p.0.x, p.0.y, p.0.z),
        }
    }
}

/// An element without an inverse map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadElement {
    /// Its place in the scaffold.
    pub element: u32,
    /// Its number in the file.
    pub number: u64,
    /// Its kind.
    pub kind: Kind,
    /// det dx/dr at the worst place found, in cubic world units.
    pub determinant: f64,
    /// The place.
    pub at: Spot,
}

/// The scaffold cannot be filled: the first such element or pair, and the number of others.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidScaffold {
    /// Elements whose Jacobian changes its sign.
    #[error(
        "element {} ({}): Jacobian {:.3e} at {} against the sign of the rest{}; expected one sign \
         over the whole element: a mid node may be displaced or nodes may be in another order",
        .0.number, .0.kind.name(), .0.determinant, .0.at, and_more(*.1, "elements")
    )]
    Folded(BadElement, usize),
    /// Elements whose Jacobian vanishes.
    #[error(
        "element {} ({}): Jacobian {:.3e} at {}{}; expected a volume: nodes may coincide or lie in a \
         plane",
        .0.number, .0.kind.name(), .0.determinant, .0.at, and_more(*.1, "elements")
    )]
    Degenerate(BadElement, usize),
    /// Elements of one component that fill the same space.
    #[error(
        "elements {} and {} fill the same space{}; expected elements beside each other: those that are \
         joined by faces cannot be united (parts with nodes of their own are)",
        .0[0], .0[1], and_more(*.1, "pairs")
    )]
    Overlap([u64; 2], usize),
}

fn and_more(others: usize, noun: &str) -> String {
    match others {
        0 => String::new(),
        n => format!(", and {n} more {noun} like it"),
    }
}

/// Counts, measures and defects of a scaffold. Lengths are in its world unit.
#[derive(Clone, Debug)]
pub struct ScaffoldReport {
    /// Elements of each kind that occurs.
    pub kinds: Vec<(Kind, usize)>,
    /// Number of nodes.
    pub nodes: usize,
    /// Sum of the elements' volumes, whatever their sign.
    pub volume: f64,
    /// The box around it.
    pub bounds: Aabb,
    /// Worst [`super::ElementMap::quality`] and the number of that element.
    pub worst_quality: (f64, u64),
    /// Mean quality.
    pub mean_quality: f64,
    /// Elements whose map is not affine.
    pub curved: usize,
    /// Elements with a negative Jacobian throughout: harmless, mirror-numbered.
    pub mirrored: Vec<u32>,
    /// Elements whose Jacobian changes sign.
    pub folded: Vec<BadElement>,
    /// Elements whose Jacobian vanishes.
    pub degenerate: Vec<BadElement>,
    /// Defects between neighbouring elements.
    pub defects: Defects,
    /// Face-connected components.
    pub components: usize,
    /// Faces without a neighbour.
    pub outer_faces: usize,
}

/// What the report measures of one element.
struct ElementMeasures {
    /// Without sign, world units.
    volume: f64,
    quality: f64,
    orientation: Orientation,
}

impl Scaffold {
    /// Least and greatest dihedral angle of the straight tets, degrees; `None` if there are none.
    pub fn dihedral_range(&self) -> Option<[f64; 2]> {
        let mut range: Option<[f64; 2]> = None;
        for e in self.elements().filter(|e| e.kind() == Kind::Tet4) {
            let p = [0, 1, 2, 3].map(|i| self.nodes()[e.nodes()[i] as usize]);
            for [i, j, k, l] in [
                [0, 1, 2, 3],
                [0, 2, 1, 3],
                [0, 3, 1, 2],
                [1, 2, 0, 3],
                [1, 3, 0, 2],
                [2, 3, 0, 1],
            ] {
                let along = p[j] - p[i];
                let off = |v: Vec3| v - along * (v.dot(&along) / along.norm_squared());
                let angle = off(p[k] - p[i]).angle(&off(p[l] - p[i])).to_degrees();
                let [a, b] = range.unwrap_or([angle; 2]);
                range = Some([a.min(angle), b.max(angle)]);
            }
        }
        range
    }

    /// Measures the scaffold and finds defects. Volumes are in world units cubed, without sign.
    pub fn report(&self) -> ScaffoldReport {
        // In parallel by element; sums and lists follow in order, the same at any number of threads.
        let measures: Vec<ElementMeasures> = (0..self.len())
            .into_par_iter()
            .map(|e| {
                let e = self.element(e);
                ElementMeasures {
                    volume: e.volume().abs(),
                    quality: e.quality(),
                    orientation: e.orientation(),
                }
            })
            .collect();
        let (mut mirrored, mut folded, mut degenerate) = (Vec::new(), Vec::new(), Vec::new());
        let mut worst = (f64::INFINITY, 0);
        for (e, element) in measures.iter().enumerate() {
            if element.quality < worst.0 {
                worst = (element.quality, self.number(e));
            }
            match element.orientation {
                Orientation::Positive => {}
                Orientation::Negative => mirrored.push(e as u32),
                Orientation::Folded { determinant, at } => {
                    folded.push(self.bad(e, determinant, at));
                }
                Orientation::Degenerate { determinant, at } => {
                    degenerate.push(self.bad(e, determinant, at));
                }
            }
        }
        let count = |k: Kind| self.elements().filter(|e| e.kind() == k).count();
        ScaffoldReport {
            kinds: Kind::ALL
                .into_iter()
                .map(|k| (k, count(k)))
                .filter(|k| k.1 > 0)
                .collect(),
            nodes: self.nodes().len(),
            volume: measures.iter().map(|m| m.volume).sum(),
            bounds: self.bounds(),
            worst_quality: worst,
            mean_quality: measures.iter().map(|m| m.quality).sum::<f64>() / self.len() as f64,
            curved: self.elements().filter(|e| !e.is_affine()).count(),
            mirrored,
            folded,
            degenerate,
            defects: self.defects(),
            components: self.components().len(),
            outer_faces: self.outer_faces().count(),
        }
    }

    /// As [`Self::report`], refusing scaffolds that cannot be filled.
    ///
    /// # Errors
    /// [`InvalidScaffold`] names the first folded or degenerate element or the first two that overlap,
    /// and the number of others.
    pub fn validate(&self) -> Result<ScaffoldReport, InvalidScaffold> {
        let report = self.report();
        if let Some(first) = report.folded.first() {
            return Err(InvalidScaffold::Folded(*first, report.folded.len() - 1));
        }
        if let Some(first) = report.degenerate.first() {
            let others = report.degenerate.len() - 1;
            return Err(InvalidScaffold::Degenerate(*first, others));
        }
        if let Some(first) = report.defects.overlaps.first() {
            let others = report.defects.overlaps.len() - 1;
            return Err(InvalidScaffold::Overlap(*first, others));
        }
        Ok(report)
    }

    /// Describes a bad element; the place is a node if the determinant there is as wrong as anywhere.
    fn bad(&self, element: usize, determinant: f64, at: CellPoint<3>) -> BadElement {
        let e = self.element(element);
        let scale = parametric_scale(e.kind());
        let mut worst = (determinant, Spot::Cell(at));
        for (n, xi) in e.kind().reference_nodes().into_iter().enumerate() {
            let d = e.jacobian(xi).determinant() * scale;
            let worse = if determinant < 0.0 {
                d <= worst.0
            } else {
                d >= worst.0
            };
            // A point at a node up to rounding is named by the node.
            let same_place = (xi.0 - at.0).norm() < 1e-12;
            if (worse && d.signum() == determinant.signum() && determinant != 0.0) || same_place {
                worst = (d, Spot::Node(n as u8));
            }
        }
        BadElement {
            element: element as u32,
            number: self.number(element),
            kind: e.kind(),
            determinant: worst.0,
            at: worst.1,
        }
    }

    /// The reference shapes that occur; a tiling needs a cell for each.
    pub fn shapes(&self) -> Vec<Element> {
        let has = |s: Element| (0..self.len()).any(|e| self.connectivity().kind(e).shape() == s);
        Element::SCAFFOLD_ELEMENTS
            .into_iter()
            .filter(|s| has(*s))
            .collect()
    }
}

impl ScaffoldReport {
    /// One sentence for each kind of defect; empty for a sound scaffold. Orientations and qualities are not among them.
    pub fn warnings(&self) -> Vec<String> {
        let d = &self.defects;
        let mut found = Vec::new();
        // Sentences with a count of 0 are left out.
        let mut warn = |count: usize, text: String| {
            if count > 0 {
                found.push(text);
            }
        };
        // The first five numbers.
        let list = |numbers: &mut dyn Iterator<Item = u64>| {
            let first: Vec<String> = numbers.take(5).map(|n| n.to_string()).collect();
            first.join(", ")
        };
        // Of a pair the second element is the later, redundant one.
        warn(
            d.duplicates.len(),
            format!(
                "{} elements have the same corners as another: elements {}",
                d.duplicates.len(),
                list(&mut d.duplicates.iter().map(|p| p.1))
            ),
        );
        warn(
            d.non_manifold.len(),
            format!(
                "{} faces are shared by more than two elements: elements {}",
                d.non_manifold.len(),
                list(&mut d.non_manifold.iter().flatten().copied())
            ),
        );
        warn(
            d.hanging.len(),
            format!(
                "{} hanging nodes lie inside a face or an edge of another element, across which the \
                 structure will not fit: elements {}",
                d.hanging.len(),
                list(&mut d.hanging.iter().map(|h| h.element))
            ),
        );
        warn(
            d.unmerged.len(),
            format!(
                "{} nodes lie on another node without being the same, so their elements are not \
                 connected: elements {}",
                d.unmerged.len(),
                list(&mut d.unmerged.iter().map(|h| h.element))
            ),
        );
        warn(
            d.overlapping.len(),
            format!(
                "{} nodes lie inside another element: elements {}",
                d.overlapping.len(),
                list(&mut d.overlapping.iter().map(|h| h.element))
            ),
        );
        let pairs = |pairs: &[[u64; 2]]| {
            let first: Vec<String> = pairs
                .iter()
                .take(5)
                .map(|[a, b]| format!("{a} and {b}"))
                .collect();
            first.join(", ")
        };
        warn(
            d.overlaps.len(),
            format!(
                "{} pairs of elements fill the same space: elements {}",
                d.overlaps.len(),
                pairs(&d.overlaps)
            ),
        );
        warn(
            d.united.len(),
            format!(
                "{} pairs of elements of parts that share no face overlap and are united: elements {}",
                d.united.len(),
                pairs(&d.united)
            ),
        );
        warn(
            d.torn.len(),
            format!(
                "{} faces have their corners but not their mid nodes in common, up to {:.3e} apart: \
                 elements {}",
                d.torn.len(),
                d.torn.iter().map(|t| t.gap).fold(0.0, f64::max),
                list(&mut d.torn.iter().flat_map(|t| t.elements))
            ),
        );
        warn(
            d.unused_nodes,
            format!("{} nodes belong to no element", d.unused_nodes),
        );
        found
    }
}
