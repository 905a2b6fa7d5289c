//! Repair of meshes with defects: orientation, union of shells, closing of holes.
//!
//! A repair runs in this order: copies of triangles of an open mesh are removed, neighbours are oriented alike, inward
//! shells are flipped, cracks are closed, scans of one surface are reduced to one, buried parts are removed, and the
//! winding number closes what is still open. Steps that change something leave notes for the user; flipped shells leave
//! none where faces were flipped and all shells are inward. The result is a solid with a signed distance, not a closed
//! mesh: holes get no triangles. Shells are connected through edges, those of more than two triangles by pairs.

use super::boundary_edges::BoundaryEdges;
use super::cracks::without_cracks;
use super::half_edges::HalfEdges;
use super::open_winding::OpenWinding;
use super::openness::{NoSolidError, Openness};
use super::repeated::{Scans, repeated_triangles};
use super::shells::{Nesting, ShellMeasures, Shells, inconsistent_triangles};
use super::solid::{NumberedTriangles, SolidParts};
use super::soup::Soup;
use super::unite::{United, unite};
use super::{MeshSolid, TriMesh};
use crate::frame::Aabb;
use std::fmt;

/// Maximum number of pairs of triangles whose boxes overlap, each counted twice, and each triangle once with itself.
const MAX_OVERLAPS: u64 = 40_000_000;

/// The kind of a repair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RepairKind {
    /// Triangles, shells or the whole mesh were flipped.
    Flipped,
    /// Shells that overlap or lie in each other were united.
    United,
    /// Holes were closed by the winding number, or edges that were open by rounding alone.
    Closed,
    /// Copies of triangles or of an open surface were left out.
    Repeated,
}

/// A repair of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repair {
    /// The kind.
    pub kind: RepairKind,
    /// A description: one sentence in lower case.
    pub message: String,
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

/// Counts of shells (connected components) and their defects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShellReport {
    /// Components connected through edges, those of more than two triangles by pairs.
    pub shells: usize,
    /// Triangles whose orientation differs from that of most of their shell.
    pub inconsistent_faces: usize,
    /// Shells oriented inward that lie in no other, and the shells inside them.
    pub inward_shells: usize,
    /// Shells that lie in others.
    pub nested_shells: usize,
    /// Shells with parts inside the solid: they overlap, touch or duplicate others.
    pub overlapping_shells: usize,
    /// Shells with open or misoriented edges, and triangles that repeat a vertex.
    pub open_shells: usize,
}

fn without(mesh: &TriMesh, is_left_out: &[bool]) -> TriMesh {
    let triangles = mesh.triangles().iter().zip(is_left_out);
    let kept = triangles.filter(|(_, out)| !**out).map(|(t, _)| *t);
    TriMesh::new_unchecked(mesh.vertices().to_vec(), kept.collect())
}

/// A mesh with consistent outward orientation, and the structures of its analysis.
struct Oriented {
    mesh: TriMesh,
    merged: TriMesh,
    sides: HalfEdges,
    /// Its long triangles may be cut into pieces for the search tree, which changes times and no result.
    soup: Soup,
    shells: Shells,
    measured: Vec<ShellMeasures>,
    nesting: Nesting,
    /// Copies of triangles that were left out.
    repeated_faces: usize,
    flipped_faces: usize,
    flipped_shells: usize,
}

impl Oriented {
    /// Orients a mesh: triangles given twice are removed if it is open, then triangles are flipped to agree with their
    /// neighbours, then shells that point inward. Boundaries, shells and their nesting are those of the result.
    fn of(mut mesh: TriMesh) -> Self {
        let mut merged = mesh.merged();
        let mut count = merged.vertices().len();
        let mut sides = HalfEdges::of(merged.triangles(), count);
        let mut repeated_faces = 0;
        // Copies of a closed surface are shells, which are united.
        if !sides.boundary().is_empty() {
            let is_repeated = repeated_triangles(&merged);
            repeated_faces = is_repeated.iter().filter(|t| **t).count();
            if repeated_faces > 0 {
                mesh = without(&mesh, &is_repeated);
                merged = mesh.merged();
                count = merged.vertices().len();
                sides = HalfEdges::of(merged.triangles(), count);
            }
        }
        // Neighbours first: a shell needs one orientation before its sign means anything.
        let mut flipped_faces = 0;
        if let Some(is_flipped) = inconsistent_triangles(&merged, &sides) {
            flipped_faces = is_flipped.iter().filter(|t| **t).count();
            mesh = mesh.with_flipped(&is_flipped);
            merged = merged.with_flipped(&is_flipped);
            sides = HalfEdges::of(merged.triangles(), count);
        }
        let numbered =
            |mesh: &TriMesh| -> NumberedTriangles { mesh.iter_corners().zip(0u32..).collect() };
        let mut soup = Soup::uncut(&numbered(&mesh));
        let shells = Shells::of(&merged, &sides);
        // For speed only: nesting takes winding numbers, but not of a single shell, which lies in no other.
        if shells.count > 1 {
            soup.cut();
        }
        // Before the flip, which the volumes decide; what is read later (areas, boxes, closedness) does not change by it.
        let measured = shells.measured(&merged, &sides);
        let nesting = Nesting::of(&measured, &shells.of, &soup);
        let inverted = nesting.inverted(&measured);
        let flipped_shells = inverted.iter().filter(|i| **i).count();
        if flipped_shells > 0 {
            let is_flipped: Vec<bool> = shells.of.iter().map(|&s| inverted[s as usize]).collect();
            mesh = mesh.with_flipped(&is_flipped);
            merged = merged.with_flipped(&is_flipped);
            sides = HalfEdges::of(merged.triangles(), count);
            soup = Soup::uncut(&numbered(&mesh));
        }
        Self {
            mesh,
            merged,
            sides,
            soup,
            shells,
            measured,
            nesting,
            repeated_faces,
            flipped_faces,
            flipped_shells,
        }
    }

    /// Closes edges that are open by rounding alone, and adds a note of it.
    fn without_cracks(self, add: &mut impl FnMut(RepairKind, String)) -> Self {
        let before = self.sides.boundary();
        let Some(mesh) = without_cracks(&self.mesh, &self.merged, &before) else {
            return self;
        };
        let mut closed = Self::of(mesh);
        let after = closed.sides.boundary().len();
        // Merged vertices may also open edges, where a part is as thin as the rounding.
        if after >= before.len() {
            return self;
        }
        let message = format!(
            "{} edges are open by less than two roundings of single precision; closed",
            before.len() - after
        );
        add(RepairKind::Closed, message);
        closed.flipped_faces += self.flipped_faces;
        closed.repeated_faces += self.repeated_faces;
        closed
    }

    /// Leaves one copy of what the mesh gives more than once, and adds a note of it.
    fn without_repeats(self, add: &mut impl FnMut(RepairKind, String)) -> Self {
        if self.repeated_faces > 0 {
            let message = format!(
                "{} of {} faces are given twice; one copy counts",
                self.repeated_faces,
                self.repeated_faces + self.mesh.triangles().len()
            );
            add(RepairKind::Repeated, message);
        }
        let mut oriented = self;
        let scans = Scans::of(&oriented.mesh, &oriented.shells, &oriented.measured);
        let of_shells = |shells: &[usize]| -> Vec<bool> {
            let of = oriented.shells.of.iter();
            of.map(|s| shells.contains(&(*s as usize))).collect()
        };
        if scans.opposed.is_empty() && scans.covered.is_empty() {
            return oriented;
        }
        let all = oriented.shells.count;
        let mut mesh = oriented.mesh.clone();
        if !scans.opposed.is_empty() {
            let message = format!(
                "{} of {all} shells are open and oriented against the one that they overlap; flipped",
                scans.opposed.len()
            );
            add(RepairKind::Flipped, message);
            mesh = mesh.with_flipped(&of_shells(&scans.opposed));
        }
        if !scans.covered.is_empty() {
            let message = format!(
                "{} of {all} shells are open and lie along or in a larger one, as scans of one surface do; left out",
                scans.covered.len()
            );
            add(RepairKind::Repeated, message);
            mesh = without(&mesh, &of_shells(&scans.covered));
        }
        // The shells have changed: all is determined anew from the remaining mesh.
        let flipped_faces = oriented.flipped_faces;
        oriented = Self::of(mesh);
        oriented.flipped_faces += flipped_faces;
        oriented
    }

    /// Winding data, if the triangles are no cycle.
    fn open(&self) -> Option<(OpenWinding, BoundaryEdges)> {
        let (vertices, boundary) = (self.merged.vertices(), self.sides.boundary());
        let open = OpenWinding::new(vertices, &boundary, &self.soup)?;
        let boundary = BoundaryEdges::new(vertices, &boundary, open.spanning(&self.soup))?;
        Some((open, boundary))
    }

    /// The surface without its buried parts; `None` if no shell buries anything. `open` are the winding data of
    /// [`Self::open`]. With `is_thorough` a shell may also bury parts of itself.
    fn united(
        &self,
        open: Option<&(OpenWinding, BoundaryEdges)>,
        is_thorough: bool,
    ) -> Option<United> {
        let Self {
            merged,
            sides,
            shells,
            nesting,
            soup,
            ..
        } = self;
        let open = open.map(|(open, boundary)| (open, boundary));
        unite(merged, sides, shells, nesting, soup, open, is_thorough)
    }
}

impl ShellReport {
    /// The defects by name, with their counts.
    pub fn counts(&self) -> [(&'static str, usize); 5] {
        let noun = |count: usize, one, further| (if count == 1 { one } else { further }, count);
        [
            noun(
                self.inconsistent_faces,
                "inconsistently oriented face",
                "inconsistently oriented faces",
            ),
            noun(self.inward_shells, "inward shell", "inward shells"),
            noun(
                self.overlapping_shells,
                "overlapping shell",
                "overlapping shells",
            ),
            noun(self.nested_shells, "nested shell", "nested shells"),
            noun(self.open_shells, "open shell", "open shells"),
        ]
    }

    /// The report of a mesh; `is_free_of_intersections` means that none of its triangles meet. `None` where too many
    /// overlap. Nothing is repaired: counts are of what a repair would change.
    pub(super) fn of(mesh: &TriMesh, is_free_of_intersections: bool) -> Option<Self> {
        let mut oriented = Oriented::of(mesh.clone());
        // A single shell that does not meet itself buries nothing.
        let united = if is_free_of_intersections && oriented.shells.count == 1 {
            None
        } else if has_too_many_overlaps(&oriented.soup) {
            return None;
        } else {
            oriented.soup.cut();
            oriented.united(oriented.open().as_ref(), !is_free_of_intersections)
        };
        let within = &oriented.nesting.within;
        let measured = &oriented.measured;
        Some(Self {
            shells: oriented.shells.count,
            inconsistent_faces: oriented.flipped_faces,
            inward_shells: oriented.flipped_shells,
            nested_shells: within.iter().filter(|w| !w.is_empty()).count(),
            overlapping_shells: united.map_or(0, |u| u.shells),
            open_shells: measured.iter().filter(|s| !s.is_closed).count(),
        })
    }
}

/// Whether the boxes of triangles overlap in so many pairs that finding buried triangles takes minutes.
fn has_too_many_overlaps(soup: &Soup) -> bool {
    let mut pairs = 0u64;
    for corners in &soup.corners {
        soup.bvh.overlapping(&Aabb::of(*corners), |_| {
            pairs += 1;
            pairs <= MAX_OVERLAPS
        });
        if pairs > MAX_OVERLAPS {
            return true;
        }
    }
    false
}

impl MeshSolid {
    /// A solid from a mesh that may have defects: inconsistently oriented triangles and inward shells are
    /// flipped, copies left out, overlapping shells united, cracks closed, holes too by the winding number. Shells
    /// within 2.5e-7 of the greatest coordinate, two roundings of single precision, touch and are one body.
    ///
    /// # Errors
    /// [`NoSolidError`] when the surface bounds no solid.
    pub fn repaired(mesh: TriMesh) -> Result<(Self, Vec<Repair>), NoSolidError> {
        Self::repaired_by(mesh, |mesh| vec![false; mesh.triangles().len()], false)
    }

    /// As [`MeshSolid::repaired`] for a mesh with caps, which a function of the mesh marks. Parts that a shell
    /// buries by intersecting itself are removed too.
    ///
    /// # Errors
    /// As [`MeshSolid::repaired`].
    pub fn repaired_with_caps(
        mesh: TriMesh,
        caps: impl Fn(&TriMesh) -> Vec<bool>,
    ) -> Result<(Self, Vec<Repair>), NoSolidError> {
        Self::repaired_by(mesh, caps, true)
    }

    /// Repairs a mesh, as [`MeshSolid::repaired_with_caps`]; with `is_thorough` a shell may bury parts of itself.
    /// `caps` marks the triangles that count for the winding number only. The notes come in the order cracks, copies
    /// and scans, flips, union, holes. It calls itself with the flipped mesh where most is inside out.
    fn repaired_by(
        mesh: TriMesh,
        caps: impl Fn(&TriMesh) -> Vec<bool>,
        is_thorough: bool,
    ) -> Result<(Self, Vec<Repair>), NoSolidError> {
        let mut repairs = Vec::new();
        let mut add = |kind, message| repairs.push(Repair { kind, message });
        let mut oriented = Oriented::of(mesh)
            .without_cracks(&mut add)
            .without_repeats(&mut add);
        oriented.soup.cut();
        if oriented.flipped_faces > 0 {
            let message = format!(
                "{} of {} faces flipped: their neighbours are oriented the other way",
                oriented.flipped_faces,
                oriented.mesh.triangles().len()
            );
            add(RepairKind::Flipped, message);
        }
        let all_flipped = "the triangles are oriented inward; flipped";
        // Once faces were flipped, the sign of the whole mesh is arbitrary and not worth a message.
        if oriented.flipped_shells > 0 && oriented.flipped_shells == oriented.shells.count {
            if oriented.flipped_faces == 0 {
                add(RepairKind::Flipped, all_flipped.to_owned());
            }
        } else if oriented.flipped_shells > 0 {
            let message = format!(
                "{} of {} shells are oriented inward and lie in no outward shell; flipped",
                oriented.flipped_shells, oriented.shells.count
            );
            add(RepairKind::Flipped, message);
        }
        // What shells bury in each other is no surface.
        let open = oriented.open();
        let united = oriented.united(open.as_ref(), is_thorough);
        if let Some(united) = &united {
            let message = format!(
                "{} of {} shells overlap, touch or lie in each other; united, interior faces removed",
                united.shells, oriented.shells.count
            );
            add(RepairKind::United, message);
        }
        let Oriented {
            mesh,
            merged,
            sides,
            soup,
            ..
        } = oriented;
        let is_cap = caps(&mesh);
        let parts = SolidParts {
            mesh,
            winding_triangles: soup,
            open,
            united,
        };
        let solid = Self::of_parts(parts, &is_cap);
        let openness = Openness::of(&solid, &merged, &sides);
        if openness.inside_out {
            let flipped = solid.mesh().flipped();
            let (solid, further) = Self::repaired_by(flipped, caps, is_thorough)?;
            add(RepairKind::Flipped, all_flipped.to_owned());
            // The union is found again in the flipped mesh, with its own note.
            repairs.retain(|r| r.kind != RepairKind::United);
            repairs.extend(further);
            return Ok((solid, repairs));
        }
        if openness.bounds_no_solid() {
            return Err(NoSolidError { openness });
        }
        if !openness.is_closed() {
            let message = format!("{openness}; closed by the winding number");
            add(RepairKind::Closed, message);
        }
        Ok((solid, repairs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Vec3;

    /// The union of boxes, each with a shell of its own, in double or single precision.
    fn united(boxes: &[[[f64; 2]; 3]], is_single: bool) -> MeshSolid {
        let mut mesh = TriMesh::default();
        for [x, y, z] in boxes {
            let corners = [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]];
            let level = |z: f64| corners.iter().map(move |c| Vec3::new(c[0], c[1], z));
            let vertices = level(z[0]).chain(level(z[1])).collect();
            let mut triangles = vec![[0, 2, 1], [4, 5, 6], [0, 3, 2], [4, 6, 7]];
            for i in 0..4 {
                let j = (i + 1) % 4;
                triangles.extend([[i, j, 4 + j], [i, 4 + j, 4 + i]]);
            }
            let shell = TriMesh::new(vertices, triangles).unwrap();
            mesh.append(&shell).unwrap();
        }
        let single = |c: f64| f64::from(c as f32);
        let mesh = mesh.mapped(|p| if is_single { p.map(single) } else { p });
        MeshSolid::repaired(mesh).unwrap().0
    }

    /// The distance of a point outside boxes.
    fn distance(boxes: &[[[f64; 2]; 3]], p: Vec3) -> f64 {
        let one = |b: &[[f64; 2]; 3]| {
            Vec3::from_fn(|a, _| (b[a][0] - p[a]).max(p[a] - b[a][1]).max(0.0)).norm()
        };
        boxes.iter().map(one).fold(f64::INFINITY, f64::min)
    }

    /// Corners of a box that are not quite equal, as programs write them in single precision.
    #[test]
    fn a_crack_by_rounding_is_closed() {
        let bounds = Aabb::of([Vec3::zeros(), Vec3::new(3.0, 2.0, 1.0)]);
        let whole = TriMesh::cuboid(&bounds);
        let cracked = |gap: f64| {
            let mut corners: Vec<Vec3> = whole.iter_corners().flatten().collect();
            // One corner in two triangles, the other ones exact.
            for p in corners.iter_mut().filter(|p| **p == Vec3::zeros()).take(2) {
                p.x = gap;
            }
            let triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
            let mesh = TriMesh::new(corners, triangles.collect()).unwrap();
            MeshSolid::repaired(mesh).unwrap()
        };
        let (solid, repairs) = cracked(1e-17);
        assert!(repairs.len() == 1 && repairs[0].message.contains("roundings"));
        assert_eq!(solid.mesh().merged().vertices().len(), 8);
        // A gap that single precision can tell is a hole.
        let (_, repairs) = cracked(1e-5);
        assert!(repairs.iter().any(|r| r.message.contains("winding number")));
    }

    /// Faces that touch up to the last bit leave neither a face nor a crack, with and without further shells there.
    #[test]
    fn boxes_a_rounding_apart_are_one_body() {
        let lower = [[0.9, 1.2], [0.9, 1.2], [0.35, 0.9]];
        let upper = [[0.9, 1.2], [0.9, 1.2], [0.900_000_000_000_000_1, 1.45]];
        for boxes in [&[lower, upper][..], &[lower, upper, lower]] {
            let solid = united(boxes, false);
            let within = solid.signed_distance(Vec3::new(1.0, 1.05, 0.9));
            assert!((within + 0.1).abs() < 1e-12, "{within}");
        }
        // A gap that single precision can tell is one.
        let apart = [lower, upper.map(|r| r.map(|c| c + 0.001))];
        let gap = united(&apart, false).signed_distance(Vec3::new(1.05, 1.05, 0.9005));
        assert!(gap > 0.0, "{gap}");
    }

    /// No part of a face is lost where splits meet in a side that is only rounding.
    #[test]
    fn splits_that_meet_within_rounding_lose_no_face() {
        let boxes = [
            [[1.0, 3.6], [1.5, 2.1], [2.0, 3.5]],
            [[1.0, 1.6], [0.2, 2.6], [1.6, 2.8]],
            [[0.4, 3.4], [1.2, 1.8], [2.0, 3.4]],
            [[1.8, 2.4], [1.8, 2.4], [0.2, 2.2]],
        ];
        let solid = united(&boxes, true);
        for n in 0..9261u32 {
            let at = [n % 21, n / 21 % 21, n / 441].map(f64::from);
            let p = Vec3::new(0.2, 0.16, 0.2).component_mul(&Vec3::from(at));
            let right = distance(&boxes, p);
            if right > 1e-3 {
                let found = solid.signed_distance(p);
                assert!(
                    (found - right).abs() < 1e-5,
                    "{found}, not {right}, at {p:?}"
                );
            }
        }
    }

    /// What is written far from the origin keeps margins of a few roundings of single precision: the walls of a cavity may
    /// be that close together, and are no contact with what is around it.
    #[test]
    fn narrow_cavities_are_no_overlaps() {
        let width = 0.002;
        let outline = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [1.5 + width, 3.0],
            [1.5 + width, 1.0],
            [1.5, 1.0],
            [1.5, 3.0],
            [0.0, 3.0],
        ];
        let level = |z: f64| outline.iter().map(move |p| Vec3::new(p[0], p[1], z));
        let vertices: Vec<Vec3> = level(0.0).chain(level(3.0)).collect();
        let mut triangles = Vec::new();
        for [a, b, c] in [
            [0, 5, 6],
            [0, 6, 7],
            [1, 2, 3],
            [1, 3, 4],
            [0, 1, 4],
            [0, 4, 5],
        ] {
            triangles.extend([[a, c, b], [8 + a, 8 + b, 8 + c]]);
        }
        for i in 0..8 {
            let j = (i + 1) % 8;
            triangles.extend([[i, j, 8 + j], [i, 8 + j, 8 + i]]);
        }
        let slit = TriMesh::new(vertices, triangles).unwrap();
        let crack = TriMesh::cuboid(&Aabb::of([Vec3::zeros(), Vec3::new(3.0, 3.0, 0.005)]));
        for cavity in [slit, crack] {
            let mut mesh = TriMesh::cuboid(&Aabb::of([Vec3::repeat(-2.0), Vec3::repeat(5.0)]));
            mesh.append(&cavity.flipped()).unwrap();
            let mesh = mesh.mapped(|p| p.add_scalar(1e4));
            let (_, repairs) = MeshSolid::repaired(mesh.clone()).unwrap();
            assert!(repairs.is_empty(), "{repairs:?}");
            let report = crate::mesh::check(&mesh);
            assert!(report.is_solid(), "{report}");
        }
    }
}
