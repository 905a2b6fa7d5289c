//! Four properties of a mesh (closed, oriented, manifold, not self-intersecting), in a report with measures, triangles
//! without area and the state of the shells.
//!
//! Vertices of equal coordinates count as one, so that the result depends on geometry only.
//! - closed: every edge belongs to at least two triangles;
//! - oriented: neighbours traverse their common edge in opposite directions;
//! - manifold: no edge belongs to more than two triangles, and the triangles around every vertex form one fan;
//! - not self-intersecting: triangles meet only in common corners and edges.

use super::TriMesh;
use super::half_edges::HalfEdges;
use super::intersect::is_degenerate_triangle;
use super::meeting::meeting_pairs;
use super::repair::ShellReport;
use super::soup::Soup;
use crate::frame::{Aabb, LengthUnit, Vec3, figures, place_figures};
use crate::progress::{Cancelled, Progress, Silent};
use crate::union_find::UnionFind;
use std::fmt::{self, Write};

/// Greatest number of places recorded per kind of defect.
const MAX_PLACES: usize = 5;

/// Triangles that intersect. Some that only earlier ones meet are not counted.
const MEETING: &str = "triangles that meet others";

/// The place of a defect.
#[derive(Clone, Debug, PartialEq)]
pub struct Defect {
    /// A point of the defect.
    pub at: Vec3,
    /// Triangles involved, by number from 0: at most eight of an edge, two of different fans of a vertex.
    pub triangles: Vec<u32>,
}

/// The number of occurrences of a defect, with the first places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Finding {
    /// The number of occurrences.
    pub count: usize,
    /// The first five, in a fixed order.
    pub places: Vec<Defect>,
}

impl Finding {
    fn add(&mut self, defect: impl FnOnce() -> Defect) {
        self.count += 1;
        if self.places.len() < MAX_PLACES {
            self.places.push(defect());
        }
    }
}

/// The result of [`check`].
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// Number of distinct vertices in use.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Components that share no vertex.
    pub components: usize,
    /// Signed volume, in the mesh's unit cubed.
    pub volume: f64,
    /// Area, in the mesh's unit squared.
    pub area: f64,
    /// Bounding box of the triangles.
    pub bounds: Aabb,
    /// Edges of only one triangle.
    pub open_edges: Finding,
    /// Edges of two or more triangles, traversed more often in one direction than in the other.
    pub misoriented_edges: Finding,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: Finding,
    /// Vertices whose triangles form more than one fan.
    pub pinched_vertices: Finding,
    /// Triangles without area.
    pub degenerate: Finding,
    /// Pairs of triangles that intersect: not all, but none exactly if no triangles do; `None` if not checked.
    pub self_intersections: Option<Finding>,
    /// Orientation, overlap and nesting of shells; `None` if not checked, also where too many triangles overlap.
    pub shells: Option<ShellReport>,
}

impl MeshReport {
    /// Whether there is a surface and it has no open edge.
    pub fn is_closed(&self) -> bool {
        self.open_edges.count == 0 && self.triangles > 0
    }
    /// Whether neighbours are oriented consistently.
    pub fn is_oriented(&self) -> bool {
        self.misoriented_edges.count == 0
    }
    /// Whether every point has a neighbourhood like that of a plane or a half plane.
    pub fn is_manifold(&self) -> bool {
        self.nonmanifold_edges.count == 0 && self.pinched_vertices.count == 0
    }
    /// Whether triangles meet only in common corners and edges; `None` if not checked.
    pub fn is_free_of_intersections(&self) -> Option<bool> {
        self.self_intersections.as_ref().map(|f| f.count == 0)
    }
    /// The four properties by name (`None`: not checked).
    pub fn properties(&self) -> [(&'static str, Option<bool>); 4] {
        [
            ("closed", Some(self.is_closed())),
            ("oriented", Some(self.is_oriented())),
            ("manifold", Some(self.is_manifold())),
            ("not self-intersecting", self.is_free_of_intersections()),
        ]
    }
    /// Whether no property is violated; one that is not checked counts as kept.
    pub fn is_sound(&self) -> bool {
        self.properties().iter().all(|w| w.1 != Some(false))
    }
    /// Whether the surface bounds a solid without repair: it is sound, and no shell is oriented inward or overlaps
    /// another. Shells that are not checked count as right.
    pub fn is_solid(&self) -> bool {
        let shells = self.shells.unwrap_or_default();
        self.is_sound() && shells.inward_shells == 0 && shells.overlapping_shells == 0
    }

    /// The defects that occur, by name. Intersections are missing where they were not searched for.
    pub fn defects(&self) -> Vec<(&'static str, &Finding)> {
        let all = [
            ("open edges", Some(&self.open_edges)),
            (
                "edges with turned neighbours",
                Some(&self.misoriented_edges),
            ),
            (
                "edges of more than two triangles",
                Some(&self.nonmanifold_edges),
            ),
            ("pinched vertices", Some(&self.pinched_vertices)),
            ("triangles without area", Some(&self.degenerate)),
            (MEETING, self.self_intersections.as_ref()),
        ];
        all.into_iter()
            .filter_map(|(n, f)| f.filter(|f| f.count > 0).map(|f| (n, f)))
            .collect()
    }
}

impl MeshReport {
    /// The report as text, with the unit of lengths if it is known.
    pub fn text(&self, unit: Option<LengthUnit>) -> String {
        let mut text = String::new();
        let f = &mut text;
        for (property, holds) in self.properties() {
            let holds = match holds {
                Some(true) => "yes",
                Some(false) => "NO",
                None => "not checked",
            };
            let _ = writeln!(f, "{property}: {holds}");
        }
        for (name, finding) in self.defects() {
            let bound = if name == MEETING { "at least " } else { "" };
            let _ = write!(f, "{bound}{} {name}", finding.count);
            if let Some(Defect { at, triangles }) = finding.places.first() {
                let numbers: Vec<String> = triangles.iter().map(u32::to_string).collect();
                let list = numbers.join(", ");
                let at = place_figures(*at);
                let _ = write!(f, ", first at {at}, triangles {list}");
            }
            f.push('\n');
        }
        // Shells are measured only where the mesh was searched for intersections.
        for (name, count) in self.shells.iter().flat_map(ShellReport::counts) {
            if count > 0 {
                let _ = writeln!(f, "{count} {name}");
            }
        }
        let power = |n: u32| unit.map_or_else(String::new, |u| format!(" {u}^{n}"));
        let _ = write!(
            f,
            "{} triangles, {} vertices, {} component{}, volume {}{}, area {}{}",
            self.triangles,
            self.vertices,
            self.components,
            if self.components == 1 { "" } else { "s" },
            figures(self.volume),
            power(3),
            figures(self.area),
            power(2)
        );
        text
    }
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(None))
    }
}

/// Checks all properties of a mesh.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::mesh::{TriMesh, check};
/// let report = check(&TriMesh::ball([0.0; 3].into(), 1.0, 3));
/// assert!(report.is_sound() && report.components == 1);
/// ```
pub fn check(mesh: &TriMesh) -> MeshReport {
    check_with(mesh, SelfIntersections::Search, &Silent)
        .unwrap_or_else(|Cancelled| unreachable!("`Silent` never cancels"))
}

/// Whether [`check_with`] searches for self-intersections, its most expensive part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfIntersections {
    /// It does.
    Search,
    /// It does not.
    Skip,
}

/// Checks a mesh; the search for self-intersections is optional. Without it `self_intersections` and `shells` of the
/// report are `None`; `shells` is so too where too many boxes overlap.
///
/// # Errors
/// [`Cancelled`] when `progress` cancels.
pub fn check_with(
    mesh: &TriMesh,
    intersections: SelfIntersections,
    progress: &dyn Progress,
) -> Result<MeshReport, Cancelled> {
    // Corners at one place are one vertex, as files without shared vertices need.
    let merged = mesh.merged();
    let edges = HalfEdges::of(merged.triangles(), merged.vertices().len());
    if progress.cancelled() {
        return Err(Cancelled);
    }
    let mut report = MeshReport {
        vertices: merged.vertices().len(),
        triangles: mesh.triangles().len(),
        components: components(&merged),
        volume: mesh.volume(),
        area: mesh.area(),
        bounds: mesh.bounds(),
        open_edges: Finding::default(),
        misoriented_edges: Finding::default(),
        nonmanifold_edges: Finding::default(),
        pinched_vertices: Finding::default(),
        degenerate: Finding::default(),
        self_intersections: None,
        shells: None,
    };
    classify_edges(&edges, &merged, &mut report);
    find_pinched_vertices(&merged, &edges, &mut report.pinched_vertices);
    for (t, corners) in merged.iter_corners().enumerate() {
        if is_degenerate_triangle(&corners) {
            let triangles = vec![t as u32];
            report.degenerate.add(|| Defect {
                at: corners[0],
                triangles,
            });
        }
    }
    if intersections == SelfIntersections::Search {
        progress.stage("self-intersections", Some(mesh.triangles().len() as u64));
        let numbered: Vec<_> = merged.iter_corners().zip(0u32..).collect();
        let mut finding = Finding::default();
        for pair in meeting_pairs(&Soup::uncut(&numbered), progress)? {
            // The middle of the first triangle of a pair is its place.
            let [a, b, c] = merged.corners(pair[0] as usize);
            finding.add(|| Defect {
                at: (a + b + c) / 3.0,
                triangles: pair.to_vec(),
            });
        }
        report.shells = ShellReport::of(mesh, finding.count == 0);
        report.self_intersections = Some(finding);
    }
    Ok(report)
}

/// Finds open, misoriented and non-manifold edges.
fn classify_edges(edges: &HalfEdges, mesh: &TriMesh, report: &mut MeshReport) {
    for edge in edges.edges() {
        let defect = || Defect {
            at: (mesh.vertices()[edge[0].lo as usize] + mesh.vertices()[edge[0].hi as usize]) / 2.0,
            // A list for a message: hundreds of triangles may share an edge.
            triangles: edge.iter().take(8).map(|s| s.triangle()).collect(),
        };
        if edge.len() == 1 {
            report.open_edges.add(defect);
            continue;
        }
        let forward = edge.iter().filter(|s| s.is_forward()).count();
        if 2 * forward != edge.len() {
            report.misoriented_edges.add(defect);
        }
        if edge.len() > 2 {
            report.nonmanifold_edges.add(defect);
        }
    }
}

/// The number of components that share no vertex; every vertex of a merged mesh is in use.
fn components(mesh: &TriMesh) -> usize {
    let mut sets = UnionFind::new(mesh.vertices().len());
    for tri in mesh.triangles() {
        let [a, b, c] = tri.map(|v| v as usize);
        sets.union(a, b);
        sets.union(b, c);
    }
    (0..mesh.vertices().len())
        .filter(|&v| sets.find(v) == v)
        .count()
}

/// Finds vertices whose triangles are not all connected through edges at the vertex. A vertex is found once, with a
/// triangle of its first fan and one of another.
fn find_pinched_vertices(mesh: &TriMesh, edges: &HalfEdges, finding: &mut Finding) {
    let triangles = mesh.triangles();
    // The number of a triangle's corner at a vertex that it has: three to a triangle.
    let corner = |t: u32, v: u32| {
        let place = triangles[t as usize]
            .iter()
            .position(|&w| w == v)
            .unwrap_or(0);
        3 * t as usize + place
    };
    // Corners of triangles that share an edge at the vertex are one fan.
    let mut fans = UnionFind::new(3 * triangles.len());
    for edge in edges.edges() {
        let first = edge[0];
        for other in &edge[1..] {
            for v in [first.lo, first.hi] {
                fans.union(corner(first.triangle(), v), corner(other.triangle(), v));
            }
        }
    }
    // The first fan at each vertex; degenerate triangles belong to no fan.
    let mut fan = vec![usize::MAX; mesh.vertices().len()];
    let mut pinched = vec![false; mesh.vertices().len()];
    for (t, tri) in triangles.iter().enumerate() {
        if tri[0] == tri[1] || tri[1] == tri[2] || tri[2] == tri[0] {
            continue;
        }
        for (k, &v) in tri.iter().enumerate() {
            let (own_fan, v) = (fans.find(3 * t + k), v as usize);
            if fan[v] == usize::MAX {
                fan[v] = own_fan;
            } else if fan[v] != own_fan && !pinched[v] {
                pinched[v] = true;
                let triangles = vec![(fan[v] / 3) as u32, t as u32];
                finding.add(|| Defect {
                    at: mesh.vertices()[v],
                    triangles,
                });
            }
        }
    }
}
