//! Surfaces: meshes of triangles and quads, which a thickness makes scaffolds of.
//!
//! A *shell* has thickness tau to both sides of its elements: x = X(r, s) + zeta tau sum `N_a(r, s)` `m_a`,
//! zeta in `[-1/2, 1/2]`, with `m_a` the mitre at node a: `n_i . m_a = 1` for the normals `n_i` of the elements
//! there. So walls keep their thickness at creases, neighbours share their side faces, and where the surface
//! is bent too sharply for the thickness the elements are folded, which [`Scaffold::validate`]
//! reports. A *plate* is a planar mesh extruded along z.
//!
//! Elements become prisms: Tri3 Wedge6, Tri6 Wedge18, Quad4 Hex8, Quad8 Hex20, Quad9 Hex27. The third
//! reference coordinate runs through the thickness.

use super::bernstein::Net;
use super::mitre::{Mitre, Normal};
use super::{Connectivity, Kind, Scaffold, ScaffoldError, extent};
use druse_geometry::frame::{Aabb, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

/// Walls of this part of the thickness count as full.
const FULL_WALL: f64 = 0.95;

/// The thinnest walls of a shell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinWall {
    /// Number of nodes with walls thinner than 95 % of the thickness.
    pub count: usize,
    /// Place of the node with the thinnest, world units.
    pub place: Vec3,
    /// Its wall as a part of the thickness.
    pub fraction: f64,
}

/// Nodes and planar elements.
///
/// Holds: at least one element; all are planar; node numbers exist; coordinates are finite.
#[derive(Clone, Debug)]
pub struct Surface {
    nodes: Vec<Vec3>,
    elements: Connectivity,
    numbers: Vec<u64>,
}

impl Surface {
    /// A surface of these nodes (world units) and planar elements, nodes in VTK order.
    ///
    /// # Errors
    /// As [`Scaffold::new`], with solids in the place of planar elements.
    pub fn new(nodes: Vec<Vec3>, elements: Connectivity) -> Result<Self, ScaffoldError> {
        super::check(&nodes, &elements, super::Dimension::Planar)?;
        Ok(Self {
            nodes,
            elements,
            numbers: Vec::new(),
        })
    }

    /// The same surface with the numbers that its file gives to the elements. Ignored unless there is one for each.
    #[must_use]
    pub fn with_numbers(mut self, numbers: Vec<u64>) -> Self {
        if numbers.len() == self.len() {
            self.numbers = numbers;
        }
        self
    }

    /// Node coordinates, world units.
    pub fn nodes(&self) -> &[Vec3] {
        &self.nodes
    }

    /// An element's number in the file, else its place.
    pub fn number(&self, element: usize) -> u64 {
        self.numbers.get(element).copied().unwrap_or(element as u64)
    }

    /// Kinds and node numbers.
    pub fn connectivity(&self) -> &Connectivity {
        &self.elements
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Never: a surface has at least one element.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// The box of the elements, as [`Scaffold::bounds`].
    pub fn bounds(&self) -> Aabb {
        let corners = |e: usize| &self.elements.nodes(e)[..self.elements.kind(e).corner_count()];
        let corners = (0..self.len()).flat_map(corners);
        let curved: Vec<Net<Vec3>> = (0..self.len())
            .filter(|&e| self.elements.kind(e).degree() > 1)
            .map(|e| {
                let nodes = self.elements.nodes(e).iter();
                let points: Vec<Vec3> = nodes.map(|&n| self.nodes[n as usize]).collect();
                extent::planar_controls(self.elements.kind(e), &points)
            })
            .collect();
        let straight = Aabb::of(corners.map(|&n| self.nodes[n as usize]));
        extent::curved_box(&curved.iter(), straight)
    }

    /// Elements of each kind that occurs.
    pub fn kinds(&self) -> Vec<(Kind, usize)> {
        let mut found = BTreeMap::new();
        for e in 0..self.len() {
            *found.entry(self.elements.kind(e)).or_default() += 1;
        }
        found.into_iter().collect()
    }

    /// The same surface with its nodes moved.
    ///
    /// # Errors
    /// [`ScaffoldError::BadNode`] where a moved node is no usable point.
    pub fn mapped(&self, map: impl Fn(Vec3) -> Vec3) -> Result<Self, ScaffoldError> {
        self.with_nodes(self.nodes.iter().map(|&v| map(v)).collect())
    }

    /// The same surface with other nodes, as many as it has.
    ///
    /// # Errors
    /// [`ScaffoldError::BadNode`] where a node is no usable point.
    pub fn with_nodes(&self, nodes: Vec<Vec3>) -> Result<Self, ScaffoldError> {
        Ok(Self::new(nodes, self.elements.clone())?.with_numbers(self.numbers.clone()))
    }

    /// Greatest |z - mean z| of the nodes: 0 for a planar mesh in the plane of x and y.
    pub fn unevenness(&self) -> f64 {
        let mean = self.nodes.iter().map(|p| p.z).sum::<f64>() / self.nodes.len() as f64;
        let off = self.nodes.iter().map(|p| (p.z - mean).abs());
        off.fold(0.0, f64::max)
    }

    /// The plate of this height around a planar mesh, extruded along z to both sides alike. Deviations of the
    /// mesh from a plane stay.
    ///
    /// # Errors
    /// [`ScaffoldError::BadThickness`], and those of [`Scaffold::new`].
    pub fn plate(&self, height: f64) -> Result<Scaffold, ScaffoldError> {
        self.thickened(height, &vec![Vec3::z(); self.nodes.len()])
    }

    /// The shell of this thickness around the surface, to both sides alike.
    ///
    /// # Errors
    /// As [`Surface::plate`]; [`ScaffoldError::NoNormal`] for a node at which the elements have no common outside.
    pub fn shell(&self, thickness: f64) -> Result<Scaffold, ScaffoldError> {
        let mitres = self.mitres()?;
        let along: Vec<Vec3> = mitres.iter().map(|m| m.along).collect();
        self.thickened(thickness, &along)
    }

    /// The node of a shell with the thinnest wall beside it, if that is thinner than the thickness: at creases
    /// that turn by more than 150 degrees, where mitres are cut off, and where no mitre fits all elements.
    ///
    /// # Errors
    /// [`ScaffoldError::NoNormal`], as [`Surface::shell`].
    pub fn thinnest_wall(&self) -> Result<Option<ThinWall>, ScaffoldError> {
        let mitres = self.mitres()?.into_iter().enumerate();
        let thin = mitres.filter(|(_, m)| m.least_wall < FULL_WALL);
        let count = thin.clone().count();
        let least = thin.min_by(|a, b| a.1.least_wall.total_cmp(&b.1.least_wall));
        Ok(least.map(|(node, mitre)| ThinWall {
            count,
            place: self.nodes[node],
            fraction: mitre.least_wall,
        }))
    }

    /// Elements of this thickness (world units) around the surface. A node is moved by half the thickness times its
    /// vector in `along`, to both sides. Every planar kind has a solid: no element is left out.
    fn thickened(&self, thickness: f64, along: &[Vec3]) -> Result<Scaffold, ScaffoldError> {
        if !(thickness.is_finite() && thickness > 0.0) {
            return Err(ScaffoldError::BadThickness(thickness));
        }
        let mut numbers: BTreeMap<(u32, i8), u32> = BTreeMap::new();
        let mut nodes = Vec::new();
        let mut elements = Connectivity::default();
        for e in 0..self.len() {
            let Some((kind, places)) = self.elements.kind(e).thickened() else {
                continue;
            };
            let element_nodes = self.elements.nodes(e);
            // A copy of a node at a level belongs to all elements around the node.
            let made: Vec<u32> = places
                .into_iter()
                .map(|(node, level)| {
                    let n = element_nodes[node as usize];
                    *numbers.entry((n, level)).or_insert_with(|| {
                        let shift = along[n as usize] * (f64::from(level) * thickness / 2.0);
                        nodes.push(self.nodes[n as usize] + shift);
                        nodes.len() as u32 - 1
                    })
                })
                .collect();
            elements.push(kind, &made);
        }
        Ok(Scaffold::new(nodes, elements)?.with_numbers(self.numbers.clone()))
    }

    /// The mitres at the nodes; elements are first oriented alike across common edges. That of a node without
    /// elements is none.
    fn mitres(&self) -> Result<Vec<Mitre>, ScaffoldError> {
        let reversed = self.reversed();
        let mut normals: Vec<Vec<Normal>> = vec![Vec::new(); self.nodes.len()];
        let gradients: BTreeMap<Kind, Vec<Vec<Vec3>>> = self
            .kinds()
            .into_iter()
            .map(|(kind, _)| {
                let nodes = kind.reference_nodes();
                (
                    kind,
                    nodes
                        .into_iter()
                        .map(|xi| kind.shape_gradients(xi))
                        .collect(),
                )
            })
            .collect();
        // Each node gets the element's normal there, weighted by the angle that the element has at the node.
        for e in 0..self.len() {
            let kind = self.elements.kind(e);
            let nodes = self.elements.nodes(e);
            let at = |n: usize| self.nodes[nodes[n] as usize];
            let side = if reversed[e] { -1.0 } else { 1.0 };
            let n = kind.corner_count();
            for (i, slopes) in gradients[&kind].iter().enumerate() {
                // dX/dxi1 and dX/dxi2.
                let mut tangents = [Vec3::zeros(); 2];
                for (k, slope) in slopes.iter().enumerate() {
                    tangents[0] += at(k) * slope.x;
                    tangents[1] += at(k) * slope.y;
                }
                let Some(unit) = tangents[0].cross(&tangents[1]).try_normalize(0.0) else {
                    continue;
                };
                // At a corner the angle between its two sides.
                let weight = if i < n {
                    let (a, b) = (at((i + 1) % n) - at(i), at((i + n - 1) % n) - at(i));
                    a.angle(&b)
                } else {
                    // A mid node of an edge sees half a circle of the element; a centre has no other element.
                    PI
                };
                normals[nodes[i] as usize].push(Normal {
                    unit: unit * side,
                    weight,
                });
            }
        }
        let used: BTreeSet<u32> = (0..self.len())
            .flat_map(|e| self.elements.nodes(e).iter().copied())
            .collect();
        let mitre = |(node, normals): (usize, &Vec<Normal>)| match Mitre::of(normals) {
            Some(mitre) => Ok(mitre),
            None if used.contains(&(node as u32)) => {
                let at = self.nodes[node].into();
                Err(ScaffoldError::NoNormal { node, at })
            }
            None => Ok(Mitre::ZERO),
        };
        normals.iter().enumerate().map(mitre).collect()
    }

    /// The elements to reverse so that neighbours have one orientation; the first of each component stays. On a
    /// one-sided surface some neighbours do not agree.
    fn reversed(&self) -> Vec<bool> {
        // The elements at each edge, and whether each runs from the lower node to the higher.
        let mut edges: BTreeMap<[u32; 2], Vec<(usize, bool)>> = BTreeMap::new();
        for e in 0..self.len() {
            let element_nodes = self.elements.nodes(e);
            let n = self.elements.kind(e).corner_count();
            for i in 0..n {
                let (a, b) = (element_nodes[i], element_nodes[(i + 1) % n]);
                edges
                    .entry([a.min(b), a.max(b)])
                    .or_default()
                    .push((e, a < b));
            }
        }
        // Neighbours of one orientation run along their edge in opposite directions.
        let mut neighbours: Vec<Vec<(usize, bool)>> = vec![Vec::new(); self.len()];
        for pair in edges.values() {
            if let [(a, up), (b, other)] = pair[..] {
                neighbours[a].push((b, up == other));
                neighbours[b].push((a, up == other));
            }
        }
        // Each component is visited from its first element.
        let mut reversed: Vec<Option<bool>> = vec![None; self.len()];
        for first in 0..self.len() {
            if reversed[first].is_some() {
                continue;
            }
            reversed[first] = Some(false);
            let mut open = vec![first];
            while let Some(e) = open.pop() {
                for &(other, against) in &neighbours[e] {
                    if reversed[other].is_none() {
                        reversed[other] = reversed[e].map(|t| t != against);
                        open.push(other);
                    }
                }
            }
        }
        reversed.into_iter().map(|t| t == Some(true)).collect()
    }
}
