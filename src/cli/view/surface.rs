//! The body of a triangle mesh: vertices divided at creases, components, wall thickness. Components and thickness
//! are those of the whole mesh; only the triangles are fewer.

use super::scene::{At, Body, Field, normal_bytes};
use crate::cli::failure::Failure;
use crate::frame::Vec3;
use crate::mesh::{MeshComponent, TriMesh, is_closed, mesh_components};
use crate::pipeline;
use crate::progress::Progress;
use serde_json::{Value, json};

/// Cosine of the greatest angle between triangles that share a normal, 40 degrees.
const CREASE_COSINE: f64 = 0.766;
/// Rounds in which vertices without a thickness take that of their neighbours.
const FILL_ROUNDS: usize = 4;
/// Components that the page lists.
const MAX_LISTED_COMPONENTS: usize = 200;

/// What is measured and how many triangles remain.
#[derive(Clone, Copy)]
pub(super) struct SurfaceOptions {
    pub max_triangles: usize,
    pub has_thickness: bool,
}

/// Makes further fields at points of a surface.
pub(super) type Sampler<'a> = dyn FnMut(&[Vec3]) -> Result<Vec<Field>, Failure> + 'a;

/// The body of a mesh, in at most about `options.max_triangles` triangles, and its components. `unit` is that of
/// lengths; `sampled` gives further fields at the body's vertices.
pub(super) fn body(
    name: &str,
    mesh: &TriMesh,
    options: SurfaceOptions,
    unit: &str,
    sampled: &mut Sampler<'_>,
    progress: &dyn Progress,
) -> Result<(Body, Vec<MeshComponent>), Failure> {
    let is_closed = is_closed(mesh);
    let (components, component_of) = mesh_components(mesh);
    progress.stage("simplify", None);
    let triangles = pipeline::few_triangles(mesh, options.max_triangles)?;
    let (mut body, sources) = divided(mesh, &triangles);
    name.clone_into(&mut body.name);
    body.is_closed = is_closed;
    body.parts = sources.iter().map(|&v| component_of[v as usize]).collect();
    body.part_count = components.len();
    // The shell of a cavity has its normals inwards, so its volume is negative.
    let cavities = components.iter().filter(|c| is_closed && c.volume < 0.0);
    body.cavity_count = cavities.count();
    let listed = components.iter().take(MAX_LISTED_COMPONENTS);
    body.rows = listed.map(|c| row(c, is_closed)).collect();
    if options.has_thickness && is_closed {
        let mut values = pipeline::wall_thickness(mesh, &sources, progress)?;
        fill(&mut values, &body.triangles);
        // A part thicker than the measure reaches has no value at all.
        if values.iter().any(|v| v.is_finite()) {
            body.fields.push(Field {
                name: "wall thickness".into(),
                unit: unit.to_owned(),
                at: At::Vertices,
                values,
                labels: None,
            });
        }
    }
    body.fields.extend(sampled(&body.positions)?);
    if components.len() > 1 {
        let sign = components.iter().map(|c| c.volume < 0.0);
        let labels = sign.enumerate().map(|(n, is_cavity)| {
            let word = if is_cavity && is_closed {
                "cavity"
            } else {
                "component"
            };
            format!("{word} {}", n + 1)
        });
        body.fields.push(Field {
            name: "component".into(),
            unit: String::new(),
            at: At::Parts,
            values: (0..components.len()).map(|n| n as f32).collect(),
            labels: Some(labels.take(MAX_LISTED_COMPONENTS).collect()),
        });
    }
    Ok((body, components))
}

/// Gives vertices without a value, as those at convex edges, the mean of their neighbours' values.
fn fill(values: &mut [f32], triangles: &[[u32; 3]]) {
    for _ in 0..FILL_ROUNDS {
        let mut sums = vec![(0.0f32, 0.0f32); values.len()];
        for t in triangles {
            let known = t.iter().map(|&v| values[v as usize]);
            let known: Vec<f32> = known.filter(|v| v.is_finite()).collect();
            if known.is_empty() || known.len() == 3 {
                continue;
            }
            let (sum, count) = (known.iter().sum::<f32>(), known.len() as f32);
            for &v in t.iter().filter(|&&v| values[v as usize].is_nan()) {
                let total = &mut sums[v as usize];
                *total = (total.0 + sum, total.1 + count);
            }
        }
        for (value, (sum, count)) in values.iter_mut().zip(sums) {
            if count > 0.0 {
                *value = sum / count;
            }
        }
    }
}

/// The row of a component in the page's list.
fn row(c: &MeshComponent, is_closed: bool) -> Value {
    let volume = is_closed.then_some(c.volume.abs());
    json!({
        "cavity": is_closed && c.volume < 0.0, "volume": volume, "triangles": c.triangles,
        "low": <[f64; 3]>::from(c.bounds.min), "high": <[f64; 3]>::from(c.bounds.max),
    })
}

/// Triangles over the vertices of a mesh as a body whose vertices have one normal each: those at creases are
/// divided. Vertices are in order of first use; with the vertex of the mesh that each comes from. Normals are those of
/// the mesh, not of the fewer triangles, whose slivers may lie across a plane.
fn divided(mesh: &TriMesh, triangles: &[[u32; 3]]) -> (Body, Vec<u32>) {
    let points = mesh.vertices();
    let weighted_normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        (b - a).cross(&(c - a))
    };
    let all = mesh.triangles();
    let weighted: Vec<Vec3> = all.iter().map(weighted_normal).collect();
    let units: Vec<Vec3> = weighted
        .iter()
        .map(|n| n.try_normalize(0.0).unwrap_or_default())
        .collect();
    // The triangles around each vertex: those of vertex v are `around[first[v]..first[v + 1]]`.
    let mut first = vec![0u32; points.len() + 1];
    for &v in all.as_flattened() {
        first[v as usize + 1] += 1;
    }
    for v in 0..points.len() {
        first[v + 1] += first[v];
    }
    let mut next = first.clone();
    let mut around = vec![0u32; 3 * all.len()];
    for (t, corners) in all.iter().enumerate() {
        for &v in corners {
            around[next[v as usize] as usize] = t as u32;
            next[v as usize] += 1;
        }
    }
    let mut body = Body::default();
    let mut sources: Vec<u32> = Vec::new();
    // For each vertex its first divided one, and for each divided one the next of the same vertex.
    let mut head = vec![u32::MAX; points.len()];
    let mut following: Vec<u32> = Vec::new();
    for corners in triangles {
        let own = weighted_normal(corners)
            .try_normalize(0.0)
            .unwrap_or_default();
        let numbered = corners.map(|v| {
            let neighbours = &around[first[v as usize] as usize..first[v as usize + 1] as usize];
            let cosine = |&&n: &&u32| units[n as usize].dot(&own);
            let nearest = neighbours
                .iter()
                .max_by(|a, b| cosine(a).total_cmp(&cosine(b)));
            // The side of the crease that the triangle is on: a sliver may be on none.
            let side = match nearest {
                Some(n) if cosine(&n) < CREASE_COSINE => units[*n as usize],
                _ => own,
            };
            let smooth = neighbours
                .iter()
                .filter(|&&n| units[n as usize].dot(&side) >= CREASE_COSINE);
            let sum: Vec3 = smooth.map(|&n| weighted[n as usize]).sum();
            let normal = normal_bytes(sum);
            let mut at = head[v as usize];
            while at != u32::MAX {
                let known = body.normals[at as usize];
                if known
                    .iter()
                    .zip(normal)
                    // Normals of bytes that differ by a tenth of their length, 127, count as one.
                    .all(|(a, b)| (i32::from(*a) - i32::from(b)).abs() <= 12)
                {
                    return at;
                }
                at = following[at as usize];
            }
            let new = body.positions.len() as u32;
            body.positions.push(points[v as usize]);
            body.normals.push(normal);
            sources.push(v);
            following.push(head[v as usize]);
            head[v as usize] = new;
            new
        });
        body.triangles.push(numbered);
    }
    (body, sources)
}
