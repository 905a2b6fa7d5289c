//! The content of a page: bodies of triangles with values, and their compact binary form.
//!
//! Positions are 16-bit shares of the body's box, normals 8-bit, values 16-bit shares of their range; 65535 stands
//! for no value. Numbers are stored as differences to the one before, low bytes and high bytes apart, so that the
//! compression (zlib) finds their redundancy. `decode.js` reads them in the same order.

use crate::frame::{Aabb, Vec3};
use flate2::{Compression, write::ZlibEncoder};
use serde_json::{Value, json};
use std::io::Write;

/// Largest quantised value; one more stands for no value.
const MAX_QUANTISED: f64 = 65534.0;

/// What the values of a field belong to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum At {
    Vertices,
    Parts,
}

/// Values that can colour a body.
pub(super) struct Field {
    pub name: String,
    pub unit: String,
    pub at: At,
    /// Not a number where there is no value.
    pub values: Vec<f32>,
    /// Names of the values 0, 1, ... of a category.
    pub labels: Option<Vec<String>>,
}

impl Field {
    /// Least and greatest value.
    pub fn range(&self) -> [f32; 2] {
        let finite = self.values.iter().filter(|v| v.is_finite());
        let range = finite.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], &v| {
            [a.min(v), b.max(v)]
        });
        if range[0] <= range[1] {
            range
        } else {
            [0.0; 2]
        }
    }
}

/// Triangles with values. Normals have the length 127; positions are in the unit of the scene.
#[derive(Default)]
pub(super) struct Body {
    pub name: String,
    pub positions: Vec<Vec3>,
    pub normals: Vec<[i8; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// The component or element of each vertex.
    pub parts: Vec<u32>,
    /// Lines between vertices.
    pub lines: Vec<[u32; 2]>,
    pub fields: Vec<Field>,
    /// Whether a cut can be filled.
    pub is_closed: bool,
    /// Whether parts are cut off whole, as elements are.
    pub has_elements: bool,
    /// Numbers of the parts in the file.
    pub numbers: Vec<u32>,
    /// Rows of the list of parts.
    pub rows: Vec<Value>,
    pub part_count: usize,
    /// Number of components that are walls of cavities.
    pub cavity_count: usize,
}

/// All that a page shows.
#[derive(Default)]
pub(super) struct Scene {
    /// The kind of the file.
    pub kind: &'static str,
    pub unit: String,
    pub bodies: Vec<Body>,
    /// Name and text of facts about the file.
    pub facts: Vec<[String; 2]>,
    pub notes: Vec<String>,
}

impl Scene {
    /// Number of triangles of all bodies.
    pub fn triangles(&self) -> usize {
        self.bodies.iter().map(|b| b.triangles.len()).sum()
    }

    /// The box around all bodies.
    pub fn bounds(&self) -> Aabb {
        Aabb::of(self.bodies.iter().flat_map(|b| b.positions.iter().copied()))
    }

    /// Description and compressed numbers.
    pub fn encode(&self, compression: Compression) -> std::io::Result<(Value, Vec<u8>)> {
        let mut zlib = ZlibEncoder::new(Vec::new(), compression);
        let mut bodies = Vec::new();
        for body in &self.bodies {
            bodies.push(body.describe());
            let mut bytes = Vec::new();
            body.encode(&mut bytes);
            zlib.write_all(&bytes)?;
        }
        let about = json!({
            "kind": self.kind, "unit": self.unit, "facts": self.facts, "notes": self.notes, "bodies": bodies,
        });
        Ok((about, zlib.finish()?))
    }
}

impl Body {
    fn describe(&self) -> Value {
        let bounds = Aabb::of(self.positions.iter().copied());
        let fields = self.fields.iter().map(|f| {
            let [low, high] = f.range();
            json!({
                "name": f.name, "unit": f.unit, "low": low, "high": high, "labels": f.labels,
                "atParts": f.at == At::Parts,
            })
        });
        json!({
            "name": self.name, "low": <[f64; 3]>::from(bounds.min), "size": <[f64; 3]>::from(bounds.size()),
            "vertices": self.positions.len(), "triangles": self.triangles.len(), "lines": self.lines.len(),
            "closed": self.is_closed, "elements": self.has_elements, "parts": self.part_count,
            "numbers": self.numbers.len(), "rows": self.rows, "fields": fields.collect::<Vec<_>>(),
        })
    }

    /// Appends the body as bytes: positions and values as shares of their range in 16 bits, normals
    /// in 8 bits, and numbers as differences, which compress well.
    fn encode(&self, out: &mut Vec<u8>) {
        let bounds = Aabb::of(self.positions.iter().copied());
        let size = bounds.size();
        // One axis after the other: neighbouring numbers are alike then.
        for axis in 0..3 {
            let (low, size) = (bounds.min[axis], size[axis]);
            let shares = self.positions.iter().map(|p| {
                let share = if size > 0.0 {
                    (p[axis] - low) / size
                } else {
                    0.0
                };
                (share * 65535.0).round() as u16
            });
            put_words(out, shares.collect());
        }
        for axis in 0..3 {
            out.extend(self.normals.iter().map(|n| n[axis] as u8));
        }
        // Vertices are about in order of first use: the distance to the next new one is small.
        let mut next = 0;
        for &v in self.triangles.as_flattened() {
            put_varint(out, zigzag(next as i32 - v as i32));
            next = next.max(v + 1);
        }
        put_differences(out, &self.parts);
        put_differences(out, self.lines.as_flattened());
        put_differences(out, &self.numbers);
        for field in &self.fields {
            let [low, high] = field.range().map(f64::from);
            let shares = field.values.iter().map(|&v| {
                // The greatest number stands for a missing value.
                if !v.is_finite() {
                    return u16::MAX;
                }
                let range = high - low;
                let share = if range > 0.0 {
                    (f64::from(v) - low) / range
                } else {
                    0.0
                };
                (share * MAX_QUANTISED).round() as u16
            });
            put_words(out, shares.collect());
        }
    }
}

/// Differences of words: all low bytes, then all high bytes.
fn put_words(out: &mut Vec<u8>, words: Vec<u16>) {
    let mut before = 0u16;
    let differences: Vec<u16> = words
        .into_iter()
        .map(|w| {
            let difference = w.wrapping_sub(before) as i16;
            before = w;
            ((difference << 1) ^ (difference >> 15)) as u16
        })
        .collect();
    out.extend(differences.iter().map(|d| *d as u8));
    out.extend(differences.iter().map(|d| (d >> 8) as u8));
}

/// A signed number with its sign in the lowest bit.
fn zigzag(n: i32) -> u32 {
    ((n << 1) ^ (n >> 31)) as u32
}

/// Seven bits a byte, low ones first.
fn put_varint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 128 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Differences of numbers below 2^31, the sign in the lowest bit.
fn put_differences(out: &mut Vec<u8>, numbers: &[u32]) {
    let mut before = 0i32;
    for &n in numbers {
        let difference = n as i32 - before;
        before = n as i32;
        put_varint(out, zigzag(difference));
    }
}

/// A direction as a vector of length 127 in 8 bits an axis; z for a vector of length 0.
pub(super) fn normal_bytes(n: Vec3) -> [i8; 3] {
    let length = n.norm();
    if length > 0.0 {
        (n / length).map(|c| (c * 127.0).round() as i8).into()
    } else {
        [0, 0, 127]
    }
}
