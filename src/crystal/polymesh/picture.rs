//! Pictures of polygon meshes: faces in the colours of their groups, with edges between faces.
//!
//! The light comes from above the viewer's right shoulder. A depth buffer with 2 x 2 samples per pixel finds the
//! visible faces; a pixel is the mean of its samples. Edges fade where the mean face of the mesh is small in the
//! picture, so that they do not cover fine meshes.

use super::PolyMesh;
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::MeshError;

/// Samples along each edge of a pixel.
const SAMPLES_PER_PIXEL_EDGE: usize = 2;
/// Direction from the model to the viewer.
const VIEW_DIRECTION: [f64; 3] = [0.74, 0.5, 0.45];
/// Direction to the light: right, up, towards the viewer.
const LIGHT_DIRECTION: [f64; 3] = [0.3, 0.6, 0.74];
/// Half of the angle of view, radians.
const HALF_VIEW_ANGLE: f64 = 0.26;
/// Share of the picture left free on each side.
const MARGIN_SHARE: f64 = 0.04;
/// A sample that shows no face.
const NO_FACE: u32 = u32::MAX;

/// The colour of a group, red, green and blue from 0 to 1: hues a golden section apart.
pub fn group_color(group: u32) -> [f64; 3] {
    // HSV to RGB; the factor is the golden section's share, so that consecutive groups differ.
    let hue = 6.0 * (0.618034 * f64::from(group)).fract();
    let (saturation, value) = (0.65, 0.95);
    [5.0, 3.0, 1.0].map(|k: f64| {
        let t = (k + hue) % 6.0;
        value - value * saturation * t.min(4.0 - t).clamp(0.0, 1.0)
    })
}

/// The face that each sample of a picture shows.
pub struct DepthBuffer {
    /// Samples along each edge of a pixel.
    edge: usize,
    columns: usize,
    rows: usize,
    face: Vec<u32>,
    /// Greater is nearer; 0 where no face is visible.
    nearness: Vec<f32>,
}

impl PolyMesh {
    /// A picture on white, 4 bytes a pixel (red, green, blue, 255), rows from the top. The model fills the picture up
    /// to a margin, seen in perspective from a fixed direction.
    ///
    /// # Errors
    /// As [`PolyMesh::triangulated`].
    pub fn picture(&self, width: usize, height: usize) -> Result<Vec<u8>, MeshError> {
        // Axes of the viewer: right, up, towards the viewer.
        let back = Vec3::from(VIEW_DIRECTION).normalize();
        let right = Vec3::z().cross(&back).normalize();
        let axes = [right, back.cross(&right), back];
        let cut = self.triangulated()?;
        let bounds = self.bounds();
        let (centre, radius) = (
            bounds.centre().0,
            bounds.half_diagonal().max(f64::MIN_POSITIVE),
        );
        let distance = radius / HALF_VIEW_ANGLE.sin();
        // The projection of each vertex on the plane through the centre, and its inverse depth.
        let seen: Vec<[f64; 3]> = (cut.mesh.vertices().iter())
            .map(|v| {
                let [x, y, z] = axes.map(|a| a.dot(&(v - centre)));
                let inverse_depth = distance / (distance - z);
                [x * inverse_depth, y * inverse_depth, inverse_depth]
            })
            .collect();
        let range = |k: usize| {
            let all = seen.iter().map(move |p| p[k]);
            (
                all.clone().fold(f64::INFINITY, f64::min),
                all.fold(f64::NEG_INFINITY, f64::max),
            )
        };
        let frame = [range(0), range(1)];
        let fine = [
            width * SAMPLES_PER_PIXEL_EDGE,
            height * SAMPLES_PER_PIXEL_EDGE,
        ];
        // The projection fills the picture up to a margin, unless it has no extent; rows run downwards.
        let fill = 1.0 - 2.0 * MARGIN_SHARE;
        let scale = (0..2)
            .map(|k| fill * fine[k] as f64 / (frame[k].1 - frame[k].0).max(1e-9 * radius))
            .fold(f64::INFINITY, f64::min);
        let place = |k: usize, at: f64| {
            let from = at - f64::midpoint(frame[k].0, frame[k].1);
            fine[k] as f64 / 2.0 + scale * if k == 0 { from } else { -from }
        };
        let mut samples = DepthBuffer::new([width, height], SAMPLES_PER_PIXEL_EDGE);
        for (corners, &face) in cut.mesh.triangles().iter().zip(&cut.faces) {
            let at = |v: u32| {
                let [x, y, inverse_depth] = seen[v as usize];
                [place(0, x), place(1, y), inverse_depth]
            };
            samples.fill(corners.map(at), face);
        }
        let light: Vec3 = (0..3)
            .map(|k| axes[k] * LIGHT_DIRECTION[k])
            .sum::<Vec3>()
            .normalize();
        // A share of ambient light, chosen for the eye, and the rest by the angle to the lamp.
        let colors = (0..self.face_count()).map(|f| {
            let shade = 0.38 + 0.62 * self.normal(f).dot(&light).max(0.0);
            group_color(self.groups()[f]).map(|c| 255.0 * c * shade)
        });
        let colors: Vec<[f64; 3]> = colors.collect();
        // The mean edge of a face, in samples: edges fade where faces are small. No ink below 6 samples an edge, then
        // more up to 0.75 from 36 on, chosen for the eye.
        let mean = self.area().sqrt() * scale / (self.face_count() as f64).sqrt();
        let ink = ((mean - 6.0) / 40.0).clamp(0.0, 0.75);
        let pixels = samples.pixels(|n, face| {
            let color = face.map_or([255.0; 3], |f| colors[f]);
            let kept = if samples.is_edge(n) { 1.0 - ink } else { 1.0 };
            color.map(|c| c * kept)
        });
        let bytes = pixels.map(|[r, g, b]| [r, g, b, 255.0].map(|c| c.round() as u8));
        Ok(bytes.flatten().collect())
    }
}

impl DepthBuffer {
    /// An empty picture of (width, height) pixels, with `edge` samples along each edge of a pixel.
    pub fn new([width, height]: [usize; 2], edge: usize) -> Self {
        let [columns, rows] = [width * edge, height * edge];
        Self {
            edge,
            columns,
            rows,
            face: vec![NO_FACE; columns * rows],
            nearness: vec![0.0; columns * rows],
        }
    }

    /// Draws a triangle of points (column and row of samples, nearness above 0); the nearer face wins. Either
    /// orientation is drawn; a triangle without area is not.
    pub fn fill(&mut self, [a, b, c]: [[f64; 3]; 3], face: u32) {
        // Twice the signed area of the triangle p, q, (x, y).
        let turn = |p: [f64; 3], q: [f64; 3], x: f64, y: f64| {
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
        };
        let whole = turn(a, b, c[0], c[1]);
        if whole == 0.0 {
            return;
        }
        // The rows or columns that the triangle may cover, within the picture.
        let span = |k: usize, most: usize| {
            let low = a[k].min(b[k]).min(c[k]).floor().max(0.0) as usize;
            let high = a[k].max(b[k]).max(c[k]).ceil().max(0.0) as usize;
            low..high.min(most)
        };
        for row in span(1, self.rows) {
            for column in span(0, self.columns) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                // Barycentric coordinates of the sample, negative outside. Inverse depth is linear in the picture.
                let share =
                    [turn(b, c, x, y), turn(c, a, x, y), turn(a, b, x, y)].map(|t| t / whole);
                if share.iter().any(|&s| s < 0.0) {
                    continue;
                }
                let nearness = (share[0] * a[2] + share[1] * b[2] + share[2] * c[2]) as f32;
                let n = row * self.columns + column;
                if nearness > self.nearness[n] {
                    (self.nearness[n], self.face[n]) = (nearness, face);
                }
            }
        }
    }

    /// Whether the sample to the right or below sample `n` shows another face, or none.
    fn is_edge(&self, n: usize) -> bool {
        let (right, below) = (n + 1, n + self.columns);
        let differs = |m: usize| self.face.get(m).is_some_and(|&f| f != self.face[n]);
        (right % self.columns != 0 && differs(right)) || differs(below)
    }

    /// Pixels, rows from the top, as means of the colours of their samples. `color` gets the number of a sample and its
    /// face, `None` for the background.
    pub fn pixels(
        &self,
        color: impl Fn(usize, Option<usize>) -> [f64; 3],
    ) -> impl Iterator<Item = [f64; 3]> {
        let [width, height] = [self.columns / self.edge, self.rows / self.edge];
        let places = (0..height).flat_map(move |r| (0..width).map(move |c| (r, c)));
        places.map(move |(row, column)| {
            let mut sum = [0.0; 3];
            for k in 0..self.edge * self.edge {
                let n = (row * self.edge + k / self.edge) * self.columns
                    + column * self.edge
                    + k % self.edge;
                let face = Some(self.face[n]).filter(|&f| f != NO_FACE);
                let color = color(n, face.map(|f| f as usize));
                (0..3).for_each(|c| sum[c] += color[c]);
            }
            sum.map(|c| c / (self.edge * self.edge) as f64)
        })
    }
}
