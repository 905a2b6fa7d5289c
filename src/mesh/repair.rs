//! Meshes with defects as solids: what is turned, united and closed.

use super::boundary_edges::Rim;
use super::open_winding::Open;
use super::openness::{HopelessMesh, Openness};
use super::shells::{Nesting, Shell, Shells, inconsistent};
use super::sides::HalfEdges;
use super::solid::{Numbered, Parts};
use super::soup::Soup;
use super::unite::{United, unite};
use super::{MeshSolid, TriMesh};
use std::fmt;

/// What was repaired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RepairKind {
    /// Triangles, shells or the whole mesh were turned.
    Turned,
    /// Shells that overlap or lie in each other were united.
    United,
    /// Holes were closed by the winding number.
    Closed,
}

/// A repair of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repair {
    /// What was repaired.
    pub kind: RepairKind,
    /// One sentence in lower case.
    pub message: String,
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

/// Shells of a mesh, and how they lie to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShellReport {
    /// Parts that hang together through edges of two triangles.
    pub shells: usize,
    /// Triangles that wind unlike most of their shell.
    pub inconsistent_faces: usize,
    /// Shells that wind inward without lying in another, with those in them.
    pub inward_shells: usize,
    /// Shells that lie in others.
    pub nested_shells: usize,
    /// Shells with parts inside the solid: they overlap, touch or repeat others.
    pub overlapping_shells: usize,
    /// Shells with open edges.
    pub open_shells: usize,
}

/// A mesh whose triangles wind alike and outward, and what was learnt on the way.
struct Oriented {
    mesh: TriMesh,
    merged: TriMesh,
    sides: HalfEdges,
    soup: Soup,
    shells: Shells,
    measured: Vec<Shell>,
    nesting: Nesting,
    faces_turned: usize,
    shells_turned: usize,
}

impl Oriented {
    fn of(mut mesh: TriMesh) -> Self {
        let mut merged = mesh.merged();
        let count = merged.vertices().len();
        let mut sides = HalfEdges::of(merged.triangles(), count);
        let mut faces_turned = 0;
        if let Some(turned) = inconsistent(&merged, &sides) {
            faces_turned = turned.iter().filter(|t| **t).count();
            mesh = mesh.with_turned(&turned);
            merged = merged.with_turned(&turned);
            sides = HalfEdges::of(merged.triangles(), count);
        }
        let numbered = |mesh: &TriMesh| -> Numbered { mesh.iter_corners().zip(0u32..).collect() };
        let mut soup = Soup::new(&numbered(&mesh));
        let shells = Shells::of(&merged, &sides);
        let measured = shells.measured(&merged, &sides);
        let nesting = Nesting::of(&measured, &shells.of, &soup);
        let inverted = nesting.inverted(&measured);
        let shells_turned = inverted.iter().filter(|i| **i).count();
        if shells_turned > 0 {
            let turned: Vec<bool> = shells.of.iter().map(|&s| inverted[s as usize]).collect();
            mesh = mesh.with_turned(&turned);
            merged = merged.with_turned(&turned);
            sides = HalfEdges::of(merged.triangles(), count);
            soup = Soup::new(&numbered(&mesh));
        }
        Self {
            mesh,
            merged,
            sides,
            soup,
            shells,
            measured,
            nesting,
            faces_turned,
            shells_turned,
        }
    }

    /// What winding numbers need if the triangles are no cycle.
    fn open(&self) -> Option<(Open, Rim)> {
        let (vertices, rim) = (self.merged.vertices(), self.sides.rim());
        let open = Open::new(vertices, &rim, &self.soup)?;
        let rim = Rim::new(vertices, &rim, open.spanning(&self.soup))?;
        Some((open, rim))
    }

    /// The surface, if shells bury parts of it. With `is_thorough` parts that a shell alone buries are looked
    /// for too.
    fn united(&self, open: Option<&(Open, Rim)>, is_thorough: bool) -> Option<United> {
        let Self {
            merged,
            sides,
            shells,
            nesting,
            soup,
            ..
        } = self;
        let open = open.map(|(open, rim)| (open, rim));
        unite(merged, sides, shells, nesting, soup, open, is_thorough)
    }
}

impl ShellReport {
    /// What is worth a line, with its count.
    pub fn facts(&self) -> [(&'static str, usize); 5] {
        let name = |count: usize, one, more| (if count == 1 { one } else { more }, count);
        [
            name(
                self.inconsistent_faces,
                "face wound unlike its neighbours",
                "faces wound unlike their neighbours",
            ),
            name(self.inward_shells, "inward shell", "inward shells"),
            name(
                self.overlapping_shells,
                "overlapping shell",
                "overlapping shells",
            ),
            name(self.nested_shells, "nested shell", "nested shells"),
            name(self.open_shells, "open shell", "open shells"),
        ]
    }

    /// Of a mesh.
    pub(super) fn of(mesh: &TriMesh) -> Self {
        let oriented = Oriented::of(mesh.clone());
        let united = oriented.united(oriented.open().as_ref(), true);
        let within = &oriented.nesting.within;
        let measured = &oriented.measured;
        Self {
            shells: oriented.shells.count,
            inconsistent_faces: oriented.faces_turned,
            inward_shells: oriented.shells_turned,
            nested_shells: within.iter().filter(|w| !w.is_empty()).count(),
            overlapping_shells: united.map_or(0, |u| u.shells),
            open_shells: measured.iter().filter(|s| !s.is_closed).count(),
        }
    }
}

impl MeshSolid {
    /// A solid from a mesh that may have defects: triangles that wind unlike their neighbours and shells
    /// that wind inward are turned, overlapping shells are united, holes are closed by the winding
    /// number.
    ///
    /// # Errors
    /// [`HopelessMesh`] when the surface bounds nothing.
    pub fn repaired(mesh: TriMesh) -> Result<(Self, Vec<Repair>), HopelessMesh> {
        Self::repaired_by(mesh, |mesh| vec![false; mesh.triangles().len()], false)
    }

    /// The same with triangles that are only caps, given by a function of the mesh; parts that a shell
    /// buries by meeting itself are no surface either.
    ///
    /// # Errors
    /// As [`MeshSolid::repaired`].
    pub fn repaired_with_caps(
        mesh: TriMesh,
        caps: impl Fn(&TriMesh) -> Vec<bool>,
    ) -> Result<(Self, Vec<Repair>), HopelessMesh> {
        Self::repaired_by(mesh, caps, true)
    }

    fn repaired_by(
        mesh: TriMesh,
        caps: impl Fn(&TriMesh) -> Vec<bool>,
        is_thorough: bool,
    ) -> Result<(Self, Vec<Repair>), HopelessMesh> {
        let mut repairs = Vec::new();
        let mut note = |kind, message| repairs.push(Repair { kind, message });
        let oriented = Oriented::of(mesh);
        if oriented.faces_turned > 0 {
            let message = format!(
                "{} of {} faces turned: their neighbours wind the other way",
                oriented.faces_turned,
                oriented.mesh.triangles().len()
            );
            note(RepairKind::Turned, message);
        }
        let turned_in_all = "the triangles wind inward; turned";
        // After faces were turned the sign of what is left is nobody's.
        if oriented.shells_turned > 0 && oriented.shells_turned == oriented.shells.count {
            if oriented.faces_turned == 0 {
                note(RepairKind::Turned, turned_in_all.to_owned());
            }
        } else if oriented.shells_turned > 0 {
            let message = format!(
                "{} of {} shells wind inward and lie in no other that winds outward; turned",
                oriented.shells_turned, oriented.shells.count
            );
            note(RepairKind::Turned, message);
        }
        let open = oriented.open();
        let united = oriented.united(open.as_ref(), is_thorough);
        if let Some(united) = &united {
            let message = format!(
                "{} of {} shells overlap, touch or lie in each other; united without the faces inside",
                united.shells, oriented.shells.count
            );
            note(RepairKind::United, message);
        }
        let Oriented {
            mesh,
            merged,
            sides,
            soup,
            ..
        } = oriented;
        let is_cap = caps(&mesh);
        let parts = Parts {
            mesh,
            all: soup,
            open,
            united,
        };
        let solid = Self::of_parts(parts, &is_cap);
        let openness = Openness::of(&solid, &merged, &sides);
        if openness.inside_out {
            let turned = solid.mesh().flipped();
            let (solid, more) = Self::repaired_by(turned, caps, is_thorough)?;
            note(RepairKind::Turned, turned_in_all.to_owned());
            repairs.retain(|r| r.kind != RepairKind::United);
            repairs.extend(more);
            return Ok((solid, repairs));
        }
        if openness.is_hopeless() {
            return Err(HopelessMesh { openness });
        }
        if !openness.is_closed() {
            let message = format!("{openness}; closed by the winding number");
            note(RepairKind::Closed, message);
        }
        Ok((solid, repairs))
    }
}
