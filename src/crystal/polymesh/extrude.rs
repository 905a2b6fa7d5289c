//! Extrusion of faces: new vertices, new faces and their groups.
//!
//! Faces that are not extruded come first, in their order. The new faces follow, source by source: the top,
//! then the rows of side faces from the base upward. New face k of every source gets group M + 1 + k, where M
//! is the greatest old group, so that corresponding edges of all sources have one group. Each further
//! iteration extrudes the tops of the one before.

use super::kind::{Dihedral, Kind, Operator};
use super::polygon::Polygon;
use super::tier;
use super::{ExtrudeError, Faces, MAX_CORNERS, PolyMesh, operator};
use druse_geometry::frame::Vec3;

/// An extrusion and its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Extrusion {
    /// The kind of extrusion.
    pub kind: Kind,
    /// The operator applied to it, if any.
    pub operator: Option<Operator>,
    /// The dihedral angle.
    pub dihedral: Dihedral,
    /// One ratio per tier, in mean edge lengths of the base; empty means 1 for all.
    pub tiers: Vec<f64>,
    /// Number of iterations, 1 to 1000; each extrudes the tops of the one before.
    pub iterations: usize,
    /// Whether the top is made planar by moving its corners to their mean height.
    pub level: bool,
    /// For truncate and omnitruncate: whether the cut edges start at even (0) or odd (1) corners.
    pub odd: bool,
}

/// A mesh after an extrusion.
#[derive(Clone, Debug)]
pub struct Extruded {
    /// The mesh.
    pub mesh: PolyMesh,
    /// The number of the first new face; all faces after it are new.
    pub first: usize,
    /// The top faces of the last iteration.
    pub tops: Vec<usize>,
    /// Warnings: sentences in lower case.
    pub notes: Vec<String>,
}

/// New vertices and faces on one polygon with n corners: numbers below n are its corners.
pub(super) struct Cap {
    pub points: Vec<Vec3>,
    pub faces: Vec<Vec<u32>>,
    /// Whether the first face is a top.
    pub has_top: bool,
}

impl Extrusion {
    /// The extrusion that makes the regular solid where the base is one of its faces.
    pub fn regular(kind: Kind) -> Self {
        Self {
            kind,
            operator: None,
            dihedral: Dihedral::Regular,
            tiers: Vec::new(),
            iterations: 1,
            level: false,
            odd: false,
        }
    }

    /// Its name in scripts.
    pub fn name(&self) -> String {
        match self.operator {
            Some(operator) => format!("{}_{}", operator.prefix(), self.kind),
            None => self.kind.name().to_owned(),
        }
    }

    /// Extrudes every face of a group.
    ///
    /// # Errors
    /// As [`Extrusion::of`].
    pub fn of_group(&self, mesh: &PolyMesh, group: u32) -> Result<Extruded, ExtrudeError> {
        let chosen: Vec<bool> = mesh.groups().iter().map(|&g| g == group).collect();
        self.of(mesh, &chosen)
    }

    /// Extrudes the `chosen` faces (one flag per face).
    ///
    /// # Errors
    /// [`ExtrudeError`]: parameters out of range, no face, a face that has no such extrusion, too large a result, or one
    /// that is no manifold.
    ///
    /// # Panics
    /// When the length of `chosen` is not the number of faces.
    pub fn of(&self, mesh: &PolyMesh, chosen: &[bool]) -> Result<Extruded, ExtrudeError> {
        assert_eq!(chosen.len(), mesh.face_count());
        self.validate()?;
        let mut notes = Vec::new();
        let mut rounds = self.iterations;
        if rounds > 1 && !self.kind.has_top() {
            notes.push(format!(
                "{} has no top face; found {rounds} iterations, made one",
                self.name()
            ));
            rounds = 1;
        }
        let corners = self.corners(mesh, chosen, rounds);
        if corners > MAX_CORNERS {
            return Err(ExtrudeError::TooMany(corners));
        }
        let mut extruded = self.extrude_once(mesh, chosen, &mut notes)?;
        for _ in 1..rounds {
            let mut tops = vec![false; extruded.mesh.face_count()];
            extruded.tops.iter().for_each(|&f| tops[f] = true);
            let first = extruded.first;
            extruded = self.extrude_once(&extruded.mesh, &tops, &mut notes)?;
            // The new faces of earlier iterations come before those of this one.
            extruded.first = first;
        }
        extruded.notes = notes;
        Ok(extruded)
    }

    /// Corners of the whole mesh after so many iterations (`rounds`), so that a result that is too large is refused
    /// before it is made. Saturates instead of overflowing.
    pub(super) fn corners(&self, mesh: &PolyMesh, chosen: &[bool], rounds: usize) -> u64 {
        let faces = chosen.iter().enumerate().filter(|(_, c)| **c);
        // Each iteration takes a polygon, then its top of as many corners, and puts a cap there.
        let added = faces.map(|(f, _)| {
            let corners = mesh.face(f).len() as u64;
            self.cap_corners(corners) - corners
        });
        let added = added.fold(0, u64::saturating_add);
        mesh.corner_count() as u64 + added.saturating_mul(rounds as u64)
    }

    /// Corners of the new faces over a polygon of `n` corners.
    ///
    /// The kind makes g n of them. An operator is applied to the closed solid over a polygon of m corners: m = n / 2
    /// for truncate and omnitruncate, else n. The C = m + g m corners of that solid lie on C / 2 edges. Its faces,
    /// edges and vertices give those of its image, without the image of the base.
    pub(super) fn cap_corners(&self, n: u64) -> u64 {
        let g = self.kind.cap_corners() as u64;
        match self.operator {
            None => g * n,
            // 2 C of faces, C of vertices, less 2 m; m = n / 2.
            Some(Operator::Truncate) => (3 * g + 1) * n / 2,
            // C of faces, C of vertices, less m.
            Some(Operator::Rectify) => (2 * g + 1) * n,
            // C of faces, 4 an edge, C of vertices, less m.
            Some(Operator::Cantellate) => (4 * g + 3) * n,
            // 2 C of faces, 4 an edge, 2 C of vertices, less 2 m; m = n / 2.
            Some(Operator::Omnitruncate) => (3 * g + 2) * n,
            // C of faces, two triangles an edge, C of vertices, less m.
            Some(Operator::Snub) => (5 * g + 4) * n,
        }
    }

    /// Checks the angle, the tiers and the number of iterations.
    fn validate(&self) -> Result<(), ExtrudeError> {
        if let Dihedral::Degrees(degrees) = self.dihedral
            && !(degrees > 0.0 && degrees < 180.0)
        {
            return Err(ExtrudeError::Angle(degrees));
        }
        let expected = self.kind.tiers();
        if !self.tiers.is_empty() && self.tiers.len() != expected {
            return Err(ExtrudeError::Tiers {
                kind: self.name(),
                found: self.tiers.len(),
                expected,
            });
        }
        if let Some(i) = self.tiers.iter().position(|t| !t.is_finite()) {
            return Err(ExtrudeError::Tier {
                index: i + 1,
                value: self.tiers[i],
            });
        }
        if !(1..=1000).contains(&self.iterations) {
            return Err(ExtrudeError::Iterations(self.iterations));
        }
        Ok(())
    }

    /// Builds the mesh of one iteration from the faces that are `chosen`; messages go to `notes`. The result's own list
    /// of notes stays empty: the caller fills it.
    fn extrude_once(
        &self,
        mesh: &PolyMesh,
        chosen: &[bool],
        notes: &mut Vec<String>,
    ) -> Result<Extruded, ExtrudeError> {
        let sources: Vec<usize> = (0..chosen.len()).filter(|&f| chosen[f]).collect();
        if sources.is_empty() {
            return Err(ExtrudeError::Nothing);
        }
        let mut vertices = mesh.vertices().to_vec();
        let mut faces = Faces::with_capacity(mesh.face_count(), mesh.faces().corners.len());
        let mut groups = Vec::with_capacity(mesh.face_count());
        // Faces that stay keep their numbers' order and their groups.
        for f in (0..chosen.len()).filter(|&f| !chosen[f]) {
            faces.push(mesh.face(f).iter().copied());
            groups.push(mesh.groups()[f]);
        }
        let first = faces.len();
        let greatest = mesh.greatest_group();
        let mut tops = Vec::new();
        let mut diagnostics = Diagnostics::default();
        for &f in &sources {
            let cap = self
                .cap(mesh.points(f), &mut diagnostics)
                .map_err(|reason| ExtrudeError::Face { face: f, reason })?;
            let base = mesh.face(f);
            let (n, offset) = (base.len() as u32, vertices.len() as u32);
            vertices.extend(cap.points);
            if cap.has_top {
                tops.push(faces.len());
            }
            for (k, face) in cap.faces.iter().enumerate() {
                // A cap numbers the corners of its base first, then its new points: the former are vertices
                // of the mesh already.
                let place = |v: &u32| match v.checked_sub(n) {
                    None => base[*v as usize],
                    Some(new) => offset + new,
                };
                faces.push(face.iter().map(place));
                groups.push(
                    // Face k of every cap has the same group: corresponding faces of all sources share it.
                    greatest
                        .checked_add(1 + k as u32)
                        .ok_or(ExtrudeError::Groups(greatest))?,
                );
            }
        }
        diagnostics.report(self, sources.len(), notes);
        let mesh = PolyMesh::new(vertices, faces, groups)?;
        Ok(Extruded {
            mesh,
            first,
            tops,
            notes: Vec::new(),
        })
    }

    /// The new vertices and faces over one polygon; observations go to `diagnostics`. The error is a reason without
    /// the number of the face.
    fn cap(&self, points: Vec<Vec3>, diagnostics: &mut Diagnostics) -> Result<Cap, String> {
        let base = Polygon::new(points)?;
        // A base counts as planar up to a millionth of its mean edge.
        if base.max_plane_distance() > 1e-6 * base.mean_edge {
            diagnostics.nonplanar_bases += 1;
        }
        match self.operator {
            None => {
                let delta = self.kind.dihedral(self.dihedral, base.len());
                self.kind_cap(&base, delta, diagnostics)
            }
            Some(operator) => operator::cap(self, operator, &base, diagnostics),
        }
    }

    /// The cap of the kind without an operator. `delta` is the dihedral angle between the base and a side, in radians.
    /// The top face, if any, comes first; kinds have three tiers at most. The error is a reason without the face.
    pub(super) fn kind_cap(
        &self,
        base: &Polygon,
        delta: f64,
        diagnostics: &mut Diagnostics,
    ) -> Result<Cap, String> {
        let row = self.kind.row();
        let ones = [1.0; 3];
        let tiers = if self.tiers.is_empty() {
            &ones[..row.tiers.len()]
        } else {
            &self.tiers
        };
        diagnostics.has_zero_tier |= tiers.contains(&0.0);
        diagnostics.may_fold |=
            // Below 90 degrees the sides lean inward, and the upper tiers of this kind may pass through each other.
            self.kind == Kind::Icosahedral && delta < std::f64::consts::FRAC_PI_2;
        let mut tier_points = tier::place_tiers(base, row.tiers, delta, tiers)?;
        let n = base.len();
        // Vertex i of a ring: ring 0 is the base, ring r is `row.rings[r - 1]` of the new points.
        let number = |ring: usize, i: i32| -> u32 {
            let i = i.rem_euclid(n as i32) as usize;
            match ring.checked_sub(1) {
                None => i as u32,
                Some(r) => {
                    let r = row.rings[r];
                    (n + r.first * n + i * r.stride + r.offset) as u32
                }
            }
        };
        let mut faces = Vec::with_capacity(self.kind.counts(n).1);
        // The top, a ring of consecutive points, is made planar on request; else its deviation is recorded in its mean
        // edges, if it has a normal.
        if let Some(top) = row.top {
            let loops: Vec<u32> = (0..n as i32).map(|i| number(top, i)).collect();
            let places = loops[0] as usize - n;
            let corners = &mut tier_points.points[places..places + n];
            if self.level {
                tier::level(base, corners, &tier_points.directions);
            } else if let Ok(polygon) = Polygon::new(corners.to_vec()) {
                diagnostics.max_top_deviation = diagnostics
                    .max_top_deviation
                    .max(polygon.max_plane_distance() / polygon.mean_edge);
            }
            faces.push(loops);
        }
        // Each row has one set of alternating faces per corner of the base, as corners (ring, shift along the base).
        for alternating in row.rows {
            for i in 0..n as i32 {
                for side in *alternating {
                    faces.push(
                        side.iter()
                            .map(|&(r, shift)| number(r, i + shift))
                            .collect(),
                    );
                }
            }
        }
        Ok(Cap {
            points: tier_points.points,
            faces,
            has_top: row.top.is_some(),
        })
    }
}

/// Observations on an extrusion, reported as notes.
#[derive(Default)]
pub(super) struct Diagnostics {
    /// Number of base faces that are not planar.
    nonplanar_bases: usize,
    /// Largest distance of a top corner from the plane of its top, in mean edges.
    max_top_deviation: f64,
    /// Whether a tier has the length 0.
    has_zero_tier: bool,
    /// Whether upper tiers may fold over the lower ones.
    may_fold: bool,
}

impl Diagnostics {
    /// Adds a note for each irregularity of the extrusion of `sources` faces to `notes`, unless an earlier iteration
    /// has added the same text.
    fn report(&self, extrusion: &Extrusion, sources: usize, notes: &mut Vec<String>) {
        let mut note = |text: String| {
            if !notes.contains(&text) {
                notes.push(text);
            }
        };
        let name = extrusion.name();
        if self.nonplanar_bases > 0 {
            note(format!(
                "{} of {sources} base faces are not planar: side planes refer to their mean planes",
                self.nonplanar_bases
            ));
        }
        // Below this share of an edge the deviation is rounding error.
        if self.max_top_deviation > 1e-9 {
            note(format!(
                "{name}: a top is not planar (off by {:.1e} of its edge); level = true makes it planar",
                self.max_top_deviation
            ));
        }
        if self.has_zero_tier {
            note(format!(
                "{name}: a tier of 0 makes edges without length and faces without area"
            ));
        }
        if self.may_fold {
            note(format!(
                "{name}: below 90 degrees the upper tiers can fold over"
            ));
        }
    }
}
