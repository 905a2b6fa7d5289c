//! Measures of a polygon mesh: counts, volume, area, planarity, edge lengths, groups.
//!
//! Faces that are not planar are cut into triangles about the mean of their corners; volume and area refer to these.
//! Lengths are in the unit of the model. The volume of a mesh with its faces inside out is negative.

use super::PolyMesh;
use super::polygon::{doubled_area_vector, mean, unit};
use druse_geometry::frame::{Aabb, Vec3, figures};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Counts and measures of a polygon mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Vertices.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Faces.
    pub faces: usize,
    /// Euler characteristic.
    pub euler: i64,
    /// Connected components.
    #[serde(rename = "pieces")]
    pub components: usize,
    /// Signed volume, with faces cut into triangles about the means of their corners.
    pub volume: f64,
    /// Area, with faces cut likewise.
    pub area: f64,
    /// Largest distance of a corner from the plane of its face, and that face.
    pub planarity: (f64, usize),
    /// Lengths of the shortest and the longest edge.
    pub edge_lengths: (f64, f64),
    /// Faces by number of corners.
    pub sides: BTreeMap<usize, usize>,
    /// Faces by group.
    pub groups: BTreeMap<u32, usize>,
    /// Minimum and maximum corner of the bounding box.
    #[serde(rename = "box")]
    pub bounds: [[f64; 3]; 2],
}

impl PolyMesh {
    /// Unit normal of face `f` (Newell); zero for a face without area.
    pub fn normal(&self, f: usize) -> Vec3 {
        unit(doubled_area_vector(&self.points(f))).unwrap_or_else(Vec3::zeros)
    }

    /// Mean of the corners of face `f`.
    pub fn centre(&self, f: usize) -> Vec3 {
        mean(&self.points(f))
    }

    /// Area of face `f`, cut into triangles about its centre.
    pub fn face_area(&self, f: usize) -> f64 {
        let points = self.points(f);
        let c = mean(&points);
        let pairs = points.iter().zip(points.iter().cycle().skip(1));
        pairs
            .map(|(a, b)| (a - c).cross(&(b - c)).norm())
            .sum::<f64>()
            / 2.0
    }

    /// The largest distance of a corner of face `f` from the plane through its centre with its normal;
    /// 0 for triangles, even those without a normal.
    pub fn residual(&self, f: usize) -> f64 {
        let points = self.points(f);
        if points.len() == 3 {
            return 0.0;
        }
        let (c, n) = (mean(&points), self.normal(f));
        let off = |p: &Vec3| (p - c).dot(&n).abs();
        points.iter().map(off).fold(0.0, f64::max)
    }

    /// Signed volume: positive where faces are counter-clockwise seen from outside.
    pub fn volume(&self) -> f64 {
        // Tetrahedra from the centre of the box, against rounding far from the origin.
        let o = self.bounds().centre().0;
        let face = |f: usize| {
            let points = self.points(f);
            let c = mean(&points) - o;
            let pairs = points.iter().zip(points.iter().cycle().skip(1));
            pairs
                .map(|(a, b)| c.dot(&(a - o).cross(&(b - o))))
                .sum::<f64>()
        };
        (0..self.face_count()).map(face).sum::<f64>() / 6.0
    }

    /// Area of all faces.
    pub fn area(&self) -> f64 {
        (0..self.face_count()).map(|f| self.face_area(f)).sum()
    }

    /// The component of each vertex, numbered from 0 in the order of first vertices, and the number of components.
    /// Vertices are connected along edges.
    pub fn components(&self) -> (Vec<u32>, usize) {
        let mut piece = vec![u32::MAX; self.vertex_count()];
        let ring = super::topology::Ring::new(self);
        let mut count = 0;
        let mut open = Vec::new();
        for start in 0..self.vertex_count() {
            if piece[start] != u32::MAX {
                continue;
            }
            piece[start] = count;
            open.push(start);
            while let Some(v) = open.pop() {
                for c in ring.around(v) {
                    let w = ring.vertex(ring.after(c));
                    if piece[w] == u32::MAX {
                        piece[w] = count;
                        open.push(w);
                    }
                }
            }
            count += 1;
        }
        (piece, count as usize)
    }

    /// All counts and measures. Of equally uneven faces the first is named; face 0 where all are planar.
    pub fn summary(&self) -> Summary {
        let mut lengths = (f64::INFINITY, 0.0f64);
        let mut sides = BTreeMap::new();
        let mut planarity = (0.0, 0);
        for f in 0..self.face_count() {
            let points = self.points(f);
            *sides.entry(points.len()).or_insert(0) += 1;
            // Every edge counts twice, which does not change the extremes.
            for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
                let l = (b - a).norm();
                lengths = (lengths.0.min(l), lengths.1.max(l));
            }
            let off = self.residual(f);
            if off > planarity.0 {
                planarity = (off, f);
            }
        }
        let Aabb { min, max } = self.bounds();
        Summary {
            vertices: self.vertex_count(),
            edges: self.edge_count(),
            faces: self.face_count(),
            euler: self.euler(),
            components: self.components().1,
            volume: self.volume(),
            area: self.area(),
            planarity,
            edge_lengths: lengths,
            sides,
            groups: self.group_counts(),
            bounds: [min.into(), max.into()],
        }
    }
}

/// Maximum number of printed rows of the table of groups.
const MAX_GROUP_ROWS: usize = 24;

/// A text of several lines without a last line break; groups beyond the limit are counted only.
impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.components == 1 { "" } else { "s" };
        writeln!(
            f,
            "{} vertices, {} edges, {} faces, Euler {}, {} component{plural}",
            self.vertices, self.edges, self.faces, self.euler, self.components
        )?;
        let [volume, area] = [self.volume, self.area].map(figures);
        writeln!(f, "volume {volume}, area {area}")?;
        let (least, most) = self.edge_lengths;
        writeln!(
            f,
            "edges {} to {}, largest deviation of a face from its plane {:.2e} (face {})",
            figures(least),
            figures(most),
            self.planarity.0,
            self.planarity.1
        )?;
        let list: Vec<String> = self
            .sides
            .iter()
            .map(|(sides, count)| format!("{count} with {sides}"))
            .collect();
        writeln!(f, "corners: {}", list.join(", "))?;
        write!(f, "group  faces")?;
        for (group, count) in self.groups.iter().take(MAX_GROUP_ROWS) {
            write!(f, "\n{group:>5}  {count:>5}")?;
        }
        if self.groups.len() > MAX_GROUP_ROWS {
            write!(
                f,
                "\n  and {} more groups",
                self.groups.len() - MAX_GROUP_ROWS
            )?;
        }
        Ok(())
    }
}
