//! What a cell shows on the faces of its shape, as tables over turns and views.
//!
//! A view is a face of a reference shape with an order of its corners: 48 of a hex, 24 of a tet. Two elements
//! that share a face see it through one view each, with equal nodes at equal places. A turn, a symmetry Q of the
//! shape, makes the cell at reference point xi what it is at Q xi, and so every view V into the view Q V of the
//! unturned cell. Cells continue over a face if their restrictions to the two turned views are the same
//! function, so that all is decided by one table over pairs of views.

use crate::scaffold::Kind;
use crate::tiling::Member;
use druse_cells::cell::{Cell, Frame, Restriction, default_group, operators_of};
use druse_geometry::frame::{Element, Mat3, Vec3};

/// Greatest difference of two restrictions that are the same function, in reference lengths: over the mean slope.
const MAX_DIFFERENCE: f64 = 1e-5;
/// Greatest difference of the slopes of restrictions that continue smoothly, over the mean slope.
const MAX_SLOPE_DIFFERENCE: f64 = 1e-3;

/// Greatest number of symmetries of a shape: those of the cube.
pub(super) const MAX_TURNS: usize = 48;

/// No turn continues the cell.
pub(super) const NO_TURN: u8 = u8::MAX;

/// A symmetry of a reference shape.
pub(super) struct Turn {
    /// The orthogonal map Q.
    pub matrix: Mat3,
    /// Whether it is improper.
    pub is_mirror: bool,
    /// The least turn that gives the same cell.
    pub class: u8,
}

/// A reference shape with its turns and views.
pub(super) struct Shape {
    pub element: Element,
    /// The number of its first view.
    first: u16,
    views: Vec<Vec<u8>>,
    /// The number of the view with these first three corners, in base 8.
    numbers: Vec<u16>,
    pub turns: Vec<Turn>,
}

/// The tables of a set of cells.
pub(super) struct Views {
    shapes: Vec<Shape>,
    count: usize,
    /// By view and turn, the view of the unturned cell that the turned one shows.
    images: Vec<u16>,
    /// Whether cells continue from one view to another: 0 not at all, 1 in value, 2 also in slope, 3 as the
    /// cell's own period does.
    ranks: Vec<u8>,
    /// For a view of the cell and a view of a neighbour, by whether the turn is a mirror image: the turn of the
    /// neighbour in which its cell continues best.
    next: Vec<[u8; 2]>,
}

impl Views {
    /// The tables of cells over the shapes of a scaffold.
    pub fn new(shapes: &[Element], members: &[Member<Cell>]) -> Self {
        let mut all = Vec::new();
        let mut first = 0;
        let mut images = Vec::new();
        for &element in shapes {
            let shape = Shape::new(element, first as u16, members);
            first += shape.views.len();
            images.extend(shape.images());
            all.push(shape);
        }
        let mut views = Self {
            shapes: all,
            count: first,
            images,
            ranks: Vec::new(),
            next: Vec::new(),
        };
        views.fill_ranks(members);
        views.fill_next();
        views
    }

    /// The tables of a shape.
    pub fn shape(&self, element: Element) -> &Shape {
        let is_own = |s: &&Shape| s.element == element;
        self.shapes.iter().find(is_own).unwrap_or(&self.shapes[0])
    }

    /// The view of the unturned cell that a turned one shows in a view.
    pub fn image(&self, view: u16, turn: u8) -> u16 {
        self.images[usize::from(view) * MAX_TURNS + usize::from(turn)]
    }

    /// Whether a cell continues from a view to a view.
    pub fn fits(&self, from: u16, to: u16) -> bool {
        self.ranks[usize::from(from) * self.count + usize::from(to)] > 0
    }

    /// The turn of a neighbour that sees a face through `view` in which its cell continues what a cell shows in
    /// the view `shown`; [`NO_TURN`] if there is none.
    pub fn next(&self, shown: u16, view: u16, is_mirror: bool) -> u8 {
        self.next[usize::from(shown) * self.count + usize::from(view)][usize::from(is_mirror)]
    }

    /// Compares the cells of all members in each pair of views; the rank is that of the member that continues worst.
    fn fill_ranks(&mut self, members: &[Member<Cell>]) {
        // The restrictions of every cell to every view, with the slope that its differences are measured by.
        let mut shown: Vec<(Vec<Restriction>, Frame, usize)> = Vec::new();
        for shape in &self.shapes {
            for view in &shape.views {
                let frame = face_frame(shape.element, view);
                let cells = members.iter().filter_map(|m| m.of(shape.element));
                let restrictions = cells.map(|c| c.restriction(&frame)).collect();
                shown.push((restrictions, frame, view.len()));
            }
        }
        let slopes: Vec<f64> = members
            .iter()
            .map(|m| m.cells.first().map_or(1.0, |c| c.gamma()))
            .collect();
        let rank = |a: &(Vec<Restriction>, Frame, usize), b: &(Vec<Restriction>, Frame, usize)| {
            if a.2 != b.2 {
                return 0;
            }
            let mut is_smooth = true;
            for ((r, s), slope) in a.0.iter().zip(&b.0).zip(&slopes) {
                let found = r.mismatch(s);
                if found.value > MAX_DIFFERENCE * slope {
                    return 0;
                }
                is_smooth &= found.slope <= MAX_SLOPE_DIFFERENCE * slope;
            }
            let same = |(p, q): (&Vec3, &Vec3)| (p - q).norm() < 1e-9;
            let is_period =
                a.1.axes.iter().zip(&b.1.axes).all(same) && (a.1.normal + b.1.normal).norm() < 1e-9;
            match (is_period, is_smooth) {
                (true, _) => 3,
                (false, true) => 2,
                (false, false) => 1,
            }
        };
        let pairs = shown.iter().flat_map(|a| shown.iter().map(move |b| (a, b)));
        self.ranks = pairs.map(|(a, b)| rank(a, b)).collect();
    }

    fn fill_next(&mut self) {
        let mut next = vec![[NO_TURN; 2]; self.count * self.count];
        for from in 0..self.count {
            for shape in &self.shapes {
                for view in shape.first..shape.first + shape.views.len() as u16 {
                    let found = &mut next[from * self.count + usize::from(view)];
                    let mut best = [0; 2];
                    for (n, turn) in shape.turns.iter().enumerate() {
                        let to = usize::from(self.image(view, n as u8));
                        let rank = self.ranks[from * self.count + to];
                        let side = usize::from(turn.is_mirror);
                        if rank > best[side] {
                            best[side] = rank;
                            found[side] = n as u8;
                        }
                    }
                }
            }
        }
        self.next = next;
    }
}

impl Shape {
    /// The views of a shape from number `first` on, and its turns; those of planar cells keep z upright.
    fn new(element: Element, first: u16, members: &[Member<Cell>]) -> Self {
        let kind = Kind::solids().find(|k| k.shape() == element);
        // Every face in every order that follows its edges.
        let mut views: Vec<Vec<u8>> = Vec::new();
        for face in kind.into_iter().flat_map(Kind::faces) {
            let n = face.corners.len();
            for start in 0..n {
                views.push((0..n).map(|i| face.corners[(start + i) % n]).collect());
                views.push((0..n).map(|i| face.corners[(start + n - i) % n]).collect());
            }
        }
        let cells: Vec<&Cell> = members.iter().filter_map(|m| m.of(element)).collect();
        let mut numbers = vec![first; 512];
        for (n, view) in views.iter().enumerate() {
            numbers[key(view)] = first + n as u16;
        }
        // Operators of the whole group of a shape always exist.
        let group = operators_of(element, default_group(element)).unwrap_or_default();
        // The cell of a planar element stands upright in its prism.
        let is_planar = cells.iter().any(|c| c.element().dimension() == 2);
        let group: Vec<Mat3> = group
            .into_iter()
            .filter(|q| !is_planar || q[(2, 2)].abs() > 0.5)
            .collect();
        let symmetries = symmetries(&cells, &group);
        let turn = |q: &Mat3| {
            // The turns s Q with s a symmetry of the cell give the same cell as Q.
            let classes = symmetries.iter().filter_map(|s| {
                let same = s * q;
                group.iter().position(|p| (p - same).norm() < 1e-6)
            });
            Turn {
                matrix: *q,
                is_mirror: q.determinant() < 0.0,
                class: classes.min().map_or(0, |n| n as u8),
            }
        };
        Self {
            element,
            first,
            views,
            numbers,
            turns: group.iter().map(turn).collect(),
        }
    }

    /// The number of a view of this shape.
    pub fn view(&self, corners: &[u8]) -> u16 {
        self.numbers[key(corners)]
    }

    /// For each view and turn the image of the view.
    fn images(&self) -> Vec<u16> {
        let corners = self.element.vertices();
        // Q maps vertices onto vertices.
        let vertex = |p: Vec3| {
            let place = corners.iter().position(|v| (v - p).norm() < 1e-6);
            place.map_or(0, |n| n as u8)
        };
        let moved: Vec<Vec<u8>> = self
            .turns
            .iter()
            .map(|t| corners.iter().map(|v| vertex(t.matrix * v)).collect())
            .collect();
        let mut images = vec![0; self.views.len() * MAX_TURNS];
        for (row, view) in images.chunks_exact_mut(MAX_TURNS).zip(&self.views) {
            for (image, moved) in row.iter_mut().zip(&moved) {
                let turned: Vec<u8> = view.iter().map(|&v| moved[usize::from(v)]).collect();
                *image = self.view(&turned);
            }
        }
        images
    }

    /// Whether all turns that keep the handedness give the same cell.
    pub fn has_one_class(&self) -> bool {
        let mut classes = self.turns.iter().filter(|t| !t.is_mirror).map(|t| t.class);
        let first = classes.next();
        classes.all(|c| Some(c) == first)
    }
}

/// A number of the first three corners of a view, which determine it.
fn key(corners: &[u8]) -> usize {
    corners
        .iter()
        .take(3)
        .fold(0, |key, &v| 8 * key + usize::from(v))
}

/// The frame of a face with this order of its corners: from the first corner along both edges.
fn face_frame(element: Element, view: &[u8]) -> Frame {
    let v = element.vertices();
    let corner = |n: usize| v[usize::from(view[n])];
    let origin = corner(0);
    let axes = vec![corner(1) - origin, corner(view.len() - 1) - origin];
    let mut normal = axes[0].cross(&axes[1]).normalize();
    if normal.dot(&(origin - element.centroid().0)) < 0.0 {
        normal = -normal;
    }
    Frame {
        origin,
        axes,
        normal,
        is_triangle: view.len() == 3,
    }
}

/// The operators of a group that leave all cells unchanged.
fn symmetries(cells: &[&Cell], group: &[Mat3]) -> Vec<Mat3> {
    let frame = |q: &Mat3| Frame {
        origin: q * Vec3::repeat(-0.5),
        axes: q.column_iter().map(Into::into).collect(),
        normal: Vec3::zeros(),
        is_triangle: false,
    };
    let keeps = |q: &&Mat3| {
        cells.iter().all(|cell| {
            let own = cell.restriction(&frame(&Mat3::identity()));
            let turned = cell.restriction(&frame(q));
            own.mismatch(&turned).value <= MAX_DIFFERENCE * cell.gamma()
        })
    };
    group.iter().filter(keeps).copied().collect()
}
