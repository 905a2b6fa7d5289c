//! Signs and distances of closed meshes whose faces lie in planes of samples.
//!
//! The parts are unions of prisms, so that closed forms tell the inside and the distance of every sample.

use super::v;
use crate::strategy::Noise;
use druse::field::{Field, LeafBits, Leaves, SampleLattice};
use druse::frame::{Vec3, WorldPoint};
use druse::mesh::{MeshSolid, TriMesh};

/// A convex polygon in a plane, extruded along the third axis.
#[derive(Clone, Debug)]
pub struct Prism {
    /// Counter-clockwise corners.
    polygon: Vec<[f64; 2]>,
    /// The points that the caps join, where they are not the corners alone.
    points: Option<Vec<[f64; 2]>>,
    ends: [f64; 2],
}

impl Prism {
    pub fn block([x, y, z]: [[f64; 2]; 3]) -> Self {
        Self {
            polygon: vec![[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]],
            points: None,
            ends: z,
        }
    }

    pub fn disc(centre: [f64; 2], radius: f64, segments: usize, ends: [f64; 2]) -> Self {
        let corner = |n: usize| {
            let angle = std::f64::consts::TAU * n as f64 / segments as f64;
            [
                centre[0] + radius * angle.cos(),
                centre[1] + radius * angle.sin(),
            ]
        };
        Self {
            polygon: (0..segments).map(corner).collect(),
            points: None,
            ends,
        }
    }

    /// The same block with points on the sides of its caps, which fans join to the first corner. The spacing of the
    /// points of a side is a geometric sequence from `ratio` times the mean.
    pub fn with_points_on_sides(self, per_side: usize, ratio: f64) -> Self {
        let corners = self.polygon.len();
        let weights = (0..per_side).map(|n| ratio.powf(1.0 - n as f64 / per_side as f64));
        let weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        let mut points = Vec::new();
        for i in 0..corners {
            let (a, b) = (self.polygon[i], self.polygon[(i + 1) % corners]);
            let mut along = 0.0;
            for weight in &weights {
                points.push([0, 1].map(|k| a[k] + (b[k] - a[k]) * (along / total)));
                along += weight;
            }
        }
        Self {
            points: Some(points),
            ..self
        }
    }

    /// The closed mesh with fans as caps.
    fn mesh(&self) -> TriMesh {
        let points = self.points.as_ref().unwrap_or(&self.polygon);
        let n = points.len() as u32;
        let at = |z: f64| points.iter().map(move |p| v(p[0], p[1], z));
        let vertices = at(self.ends[0]).chain(at(self.ends[1])).collect();
        let mut triangles = Vec::new();
        for i in 1..n - 1 {
            triangles.push([0, i + 1, i]);
            triangles.push([n, n + i, n + i + 1]);
        }
        for i in 0..n {
            let j = (i + 1) % n;
            triangles.push([i, j, n + j]);
            triangles.push([i, n + j, n + i]);
        }
        TriMesh::new(vertices, triangles).unwrap()
    }

    /// The greatest signed distance from a side's plane: negative inside.
    fn depth(&self, p: Vec3) -> f64 {
        let ends = (self.ends[0] - p.z).max(p.z - self.ends[1]);
        self.depth_in_plane([p.x, p.y]).max(ends)
    }

    fn depth_in_plane(&self, [x, y]: [f64; 2]) -> f64 {
        let n = self.polygon.len();
        let side = |i: usize| {
            let (a, b) = (self.polygon[i], self.polygon[(i + 1) % n]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            ((x - a[0]) * dy - (y - a[1]) * dx) / dx.hypot(dy)
        };
        (0..n).map(side).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The distance of a point that is not inside.
    fn distance(&self, p: Vec3) -> f64 {
        let across = (self.ends[0] - p.z).max(p.z - self.ends[1]).max(0.0);
        if self.depth_in_plane([p.x, p.y]) <= 0.0 {
            return across;
        }
        let n = self.polygon.len();
        let side = |i: usize| {
            let (a, b) = (self.polygon[i], self.polygon[(i + 1) % n]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let t = ((p.x - a[0]) * dx + (p.y - a[1]) * dy) / (dx * dx + dy * dy);
            let t = t.clamp(0.0, 1.0);
            (a[0] + dx * t - p.x).hypot(a[1] + dy * t - p.y)
        };
        (0..n).map(side).fold(f64::INFINITY, f64::min).hypot(across)
    }
}

/// A part: the union of prisms, turned so that x becomes the axis `turn`, and the mesh that bounds them.
pub struct Part {
    prisms: Vec<Prism>,
    turn: usize,
    /// Where the origin of the prisms lies.
    at: Vec3,
    pub mesh: TriMesh,
    /// Greatest rounding of a coordinate.
    rounding: f64,
}

fn turned(p: Vec3, turn: usize) -> Vec3 {
    Vec3::from_fn(|a, _| p[(a + 3 - turn) % 3])
}

impl Part {
    /// Each prism with its own closed shell.
    fn of_shells(prisms: Vec<Prism>, turn: usize, is_single: bool) -> Self {
        let mut mesh = TriMesh::default();
        for prism in &prisms {
            mesh.append(&prism.mesh()).unwrap();
        }
        Self::new(prisms, &mesh, turn, is_single)
    }

    /// Coordinates round to single precision with `is_single`.
    fn new(prisms: Vec<Prism>, mesh: &TriMesh, turn: usize, is_single: bool) -> Self {
        let mesh = mesh.mapped(|p| {
            let p = turned(p, turn);
            if is_single {
                p.map(|c| f64::from(c as f32))
            } else {
                p
            }
        });
        let size = mesh.vertices().iter().map(Vec3::amax).fold(0.0, f64::max);
        Self {
            prisms,
            turn,
            at: Vec3::zeros(),
            mesh,
            rounding: size * if is_single { 1e-7 } else { 1e-14 },
        }
    }

    /// The part somewhere else, in double precision.
    fn moved(self, by: Vec3) -> Self {
        let mesh = self.mesh.mapped(|p| p + by);
        let rounding = self.rounding + 1e-15 * by.amax();
        Self {
            at: by,
            mesh,
            rounding,
            ..self
        }
    }

    /// A point in the axes of the prisms.
    fn local(&self, p: Vec3) -> Vec3 {
        turned(p - self.at, 3 - self.turn)
    }

    fn depth(&self, p: Vec3) -> f64 {
        let depths = self.prisms.iter().map(|prism| prism.depth(p));
        depths.fold(f64::INFINITY, f64::min)
    }

    /// Whether a point is inside, if it is not within `margin` of the surface.
    fn contains(&self, p: Vec3, margin: f64) -> Option<bool> {
        let depth = self.depth(p);
        if depth.abs() > margin {
            return Some(depth < 0.0);
        }
        // Faces that two prisms have in common are inside.
        let corner =
            |n: usize| Vec3::from_fn(|a, _| if n >> a & 1 == 0 { -margin } else { margin });
        let is_inside = |n: usize| self.depth(p + 4.0 * corner(n)) < -margin;
        (0..8).all(is_inside).then_some(true)
    }

    /// The volume: a closed form for one prism, else the count of cells of a quarter voxel.
    pub fn volume(&self, h: f64) -> f64 {
        if let [prism] = &self.prisms[..] {
            let corners = &prism.polygon;
            let twice = |i: usize| {
                let ([ax, ay], [bx, by]) = (corners[i], corners[(i + 1) % corners.len()]);
                ax * by - ay * bx
            };
            let area = (0..corners.len()).map(twice).sum::<f64>() / 2.0;
            return area * (prism.ends[1] - prism.ends[0]);
        }
        let cell = h / 4.0;
        let bounds = self.mesh.bounds();
        // Faces lie on multiples of half a voxel.
        let low = bounds.min.map(|c| (c / cell).round() as i64 - 1);
        let high = bounds.max.map(|c| (c / cell).round() as i64 + 1);
        let mut count = 0u64;
        for x in low.x..high.x {
            for y in low.y..high.y {
                for z in low.z..high.z {
                    let p = v(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5) * cell;
                    count += u64::from(self.depth(self.local(p)) < 0.0);
                }
            }
        }
        count as f64 * cell.powi(3)
    }

    fn distance(&self, p: Vec3) -> f64 {
        let distances = self.prisms.iter().map(|prism| prism.distance(p));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Compares all samples of the leaves around the part with the closed form; returns the first that is wrong.
    pub fn wrong_sample(&self, step: f64) -> Option<String> {
        let (solid, _) = MeshSolid::repaired(self.mesh.clone())
            .map_err(|e| e.to_string())
            .unwrap();
        let bounds = self.mesh.bounds().dilated(3.0 * step);
        let leaf = |c: f64| (c / step / 8.0).floor() as i64;
        let (low, high) = (bounds.min.map(leaf), bounds.max.map(leaf));
        let background = (3.0 * step) as f32;
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    let origin = WorldPoint(v(x as f64, y as f64, z as f64) * (8.0 * step));
                    let lattice = SampleLattice {
                        origin,
                        step,
                        counts: [8; 3],
                    };
                    let mut filled = vec![0.0; 512];
                    solid.fill(&lattice, &mut filled);
                    let (mut values, mut bits) = ([[0f32; 512]], [LeafBits::default()]);
                    let mut leaves = Leaves {
                        origins: &[origin],
                        step,
                        by: 0.0,
                        background,
                        values: &mut values,
                        bits: &mut bits,
                    };
                    solid.fill_leaves(&mut leaves).unwrap();
                    for n in 0..512 {
                        let p = lattice.point(n).0;
                        let found = [filled[n], values[0][n]];
                        if let Some(wrong) = self.wrong(p, found, background) {
                            return Some(wrong);
                        }
                    }
                }
            }
        }
        None
    }

    /// What is wrong with the value of a sample and with its value in a narrow band.
    fn wrong(&self, p: Vec3, found: [f32; 2], background: f32) -> Option<String> {
        let q = self.local(p);
        let size = p.amax().max(1.0);
        let margin = 8.0 * self.rounding + 1e-9 * size;
        let [value, in_band] = found.map(f64::from);
        let band = f64::from(background);
        let is_like_band = if value.abs() < band {
            in_band == value
        } else {
            in_band.abs() >= band * 0.999_999 && (in_band < 0.0) == (value < 0.0)
        };
        let single = 1e-6 * (value.abs() + size);
        let is_right = match self.contains(q, margin) {
            None => value.abs() <= 4.0 * margin + single,
            Some(true) => value < 0.0 && -value >= -self.depth(q) - margin - single,
            Some(false) => value > 0.0 && (value - self.distance(q)).abs() <= margin + single,
        };
        (!is_right || !is_like_band).then(|| {
            let right = self.contains(q, margin);
            format!(
                "{value} and {in_band} at {p:?}, expected inside {right:?}, depth {}, distance {}",
                self.depth(q),
                self.distance(q)
            )
        })
    }
}

/// A random number of voxels in [low, high], whole or half ones.
fn voxels(noise: &mut Noise, low: i32, high: i32) -> f64 {
    let whole =
        f64::from(low) + (f64::midpoint(noise.signed(), 1.0) * f64::from(high - low)).round();
    if noise.signed() > 0.7 {
        whole + 0.5
    } else {
        whole
    }
}

fn chance(noise: &mut Noise, probability: f64) -> bool {
    f64::midpoint(noise.signed(), 1.0) < probability
}

/// A random block in so many voxels, at least `least` thick.
fn random_block(noise: &mut Noise, size: i32, least: i32, h: f64) -> Prism {
    Prism::block([0; 3].map(|_| {
        let low = voxels(noise, 0, size - least - 1);
        let high = (low + f64::from(least)).max(voxels(noise, 0, size));
        [low * h, high * h]
    }))
}

/// A ring of rectangular section as one closed surface of genus one, and as four blocks.
fn frame(outer: [[f64; 2]; 2], width: f64, ends: [f64; 2]) -> (Vec<Prism>, TriMesh) {
    let [x, y] = outer;
    let inner = [x, y].map(|r| [r[0] + width, r[1] - width]);
    let blocks = [
        [[x[0], inner[0][0]], y, ends],
        [[inner[0][1], x[1]], y, ends],
        [x, [y[0], inner[1][0]], ends],
        [x, [inner[1][1], y[1]], ends],
    ];
    let corners = |[x, y]: [[f64; 2]; 2]| [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]];
    let mut vertices = Vec::new();
    for z in ends {
        for ring in [corners(outer), corners(inner)] {
            vertices.extend(ring.map(|[x, y]| v(x, y, z)));
        }
    }
    // Rings of four vertices: outer and inner at the lower end, then at the upper one.
    let mut triangles = Vec::new();
    let mut quad = |a: u32, b: u32, c: u32, d: u32| triangles.extend([[a, b, c], [a, c, d]]);
    for i in 0..4 {
        let j = (i + 1) % 4;
        quad(i, j, 8 + j, 8 + i);
        quad(4 + j, 4 + i, 12 + i, 12 + j);
        quad(8 + i, 8 + j, 12 + j, 12 + i);
        quad(j, i, 4 + i, 4 + j);
    }
    (
        blocks.map(Prism::block).to_vec(),
        TriMesh::new(vertices, triangles).unwrap(),
    )
}

/// A random part, and the voxel size that its faces lie on.
pub fn random_part(case: u64) -> (Part, f64) {
    let mut noise = Noise::new(case);
    let h = [0.05, 0.1, 0.12, 0.2, 0.25, 0.5][case as usize / 7 % 6];
    let is_single = chance(&mut noise, 0.5);
    let turn = (case % 3) as usize;
    let part = match case % 7 {
        // Blocks that overlap, touch or lie apart.
        0 => {
            let count = 2 + (case / 42 % 3) as usize;
            let prisms = (0..count).map(|_| random_block(&mut noise, 18, 3, h));
            Part::of_shells(prisms.collect(), turn, is_single)
        }
        // Sheets that cross, with a common top.
        1 => {
            let top = voxels(&mut noise, 8, 14);
            let thick = voxels(&mut noise, 2, 4);
            let mut prisms = Vec::new();
            for axis in 0..2 {
                for _ in 0..2 {
                    let low = voxels(&mut noise, 0, 14);
                    let mut ranges = [[0.0, 18.0], [0.0, 18.0], [0.0, top]];
                    ranges[axis] = [low, low + thick];
                    prisms.push(Prism::block(ranges.map(|r| r.map(|c| c * h))));
                }
            }
            Part::of_shells(prisms, turn, is_single)
        }
        2 => {
            let outer = [
                [0.0, voxels(&mut noise, 12, 20) * h],
                [0.0, voxels(&mut noise, 12, 20) * h],
            ];
            let width = voxels(&mut noise, 2, 4) * h;
            let (prisms, mesh) = frame(outer, width, [0.0, voxels(&mut noise, 2, 9) * h]);
            Part::new(prisms, &mesh, turn, is_single)
        }
        // Slabs with fans; the points of the sides may be close together.
        3 => {
            let per_side = [20, 100, 300][case as usize / 42 % 3];
            let ratio = [1.0, 1e-3, 1e-6][case as usize / 126 % 3];
            let block = random_block(&mut noise, 16, 3, h);
            let fans = block.with_points_on_sides(per_side, ratio);
            Part::of_shells(vec![fans], turn, is_single && ratio == 1.0)
        }
        4 => {
            let segments = [12, 90, 360, 720][case as usize / 42 % 4];
            let radius = voxels(&mut noise, 5, 9) * h;
            let ends = [0.0, voxels(&mut noise, 2, 6) * h];
            let centre = [voxels(&mut noise, 0, 9) * h, voxels(&mut noise, 0, 9) * h];
            let disc = Prism::disc(centre, radius, segments, ends);
            Part::of_shells(vec![disc], turn, is_single)
        }
        // A disc and a block that share planes.
        5 => {
            let top = voxels(&mut noise, 3, 8) * h;
            let disc = Prism::disc([8.0 * h, 8.0 * h], 7.0 * h, 60, [0.0, top]);
            let low = voxels(&mut noise, -4, 8) * h;
            let block = Prism::block([[low, low + 9.0 * h], [4.0 * h, 9.0 * h], [0.0, top]]);
            Part::of_shells(vec![disc, block], turn, is_single)
        }
        // Coincident triangles: the same block twice, and its mirror image beside it.
        _ => {
            let block = random_block(&mut noise, 14, 3, h);
            let mut further = block.clone();
            let by = further.ends[1] - further.ends[0];
            further.ends = further.ends.map(|z| z + by);
            Part::of_shells(vec![block.clone(), further, block], turn, is_single)
        }
    };
    let is_far = chance(&mut noise, 0.2);
    let voxels = Vec3::new(1e4, -2e3, 300.0).map(|c| (c / h).round());
    let part = if is_far { part.moved(voxels * h) } else { part };
    (part, h)
}

#[test]
fn samples_in_the_planes_of_faces_have_the_right_sign() {
    crate::each_case(63, &[1365, 5060, 6985], |case| {
        let (part, h) = random_part(case);
        part.wrong_sample(h)
            .map(|what| format!("voxels of {h}: {what}"))
    });
}
