//! P15 and P16: what cells are made from, samples on a grid and signed distances of meshes.

use super::baselines;
use super::clock::{Spread, in_turn};
use super::figure::Found;
use crate::Setting;
use druse::cell::{Cell, Transform, fourier_coefficients};
use druse::field::{Field, SampleLattice};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::mesh::{MeshSolid, TriMesh};
use std::hint::black_box;

type Fault = Box<dyn std::error::Error>;

const ROUNDS: usize = 5;
/// Samples along an edge of the period.
const SAMPLES: usize = 128;
/// Points along an edge of the unit cube where distances are evaluated.
const POINTS: usize = 64;

/// P15: the fit of samples under Td beside their own real transform, one thread.
pub fn against_the_transform(_: &Setting) -> Result<Vec<Found>, Fault> {
    let (group, lattice) = Cell::symmetry(Element::Tet, Some("cubic"))?;
    let at = |j: usize| j as f64 / SAMPLES as f64 - 0.5;
    // Cylinders of radius 0.1 about the three axes.
    let cross = |p: Vec3| {
        let s = p.component_mul(&p);
        (s.sum() - s.max()).max(0.0).sqrt() - 0.1
    };
    let samples: Vec<f64> = (0..SAMPLES.pow(3))
        .map(|n| [n / (SAMPLES * SAMPLES), n / SAMPLES % SAMPLES, n % SAMPLES])
        .map(|place| cross(Vec3::from(place.map(at))))
        .collect();
    let plan = Transform::<3>::new(SAMPLES);
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || {
                black_box(fourier_coefficients(
                    &group,
                    &lattice,
                    black_box(&samples),
                    SAMPLES,
                    None,
                ));
            },
            &mut || {
                black_box(plan.forward(black_box(&samples)));
            },
        ],
    );
    let ratios = Spread::of_ratios(&seconds[0], &seconds[1]);
    let [fit, transform] = [0, 1].map(|n| Spread::of(&seconds[n]).median * 1e3);
    let note = format!("{ratios}; {fit:.1} and {transform:.1} ms");
    Ok(vec![Found::new("P15", ratios.median, note)])
}

/// A torus about z of radii 0.3 and 0.12, cut into so many parts around each.
fn torus(around: u32, across: u32) -> Result<TriMesh, Fault> {
    let angle = |i: u32, n: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (i, j) in (0..around).flat_map(|i| (0..across).map(move |j| (i, j))) {
        let (a, b) = (angle(i, around), angle(j, across));
        let r = 0.3 + 0.12 * b.cos();
        vertices.push(Vec3::new(r * a.cos(), r * a.sin(), 0.12 * b.sin()));
        let at = |i: u32, j: u32| i % around * across + j % across;
        let [p, q, r, s] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        triangles.extend([[p, q, r], [p, r, s]]);
    }
    Ok(TriMesh::new(vertices, triangles)?)
}

/// P16: the signed distance of 27,540 triangles at points of the unit cube, one thread, in microseconds
/// of the machine that the goal was set on.
pub fn signed_distances(_: &Setting) -> Result<Vec<Found>, Fault> {
    let solid = MeshSolid::new(torus(135, 102)?);
    let step = 1.0 / POINTS as f64;
    let lattice = SampleLattice {
        origin: WorldPoint(Vec3::repeat(step / 2.0 - 0.5)),
        step,
        counts: [POINTS; 3],
    };
    let mut values = vec![0.0; lattice.len()];
    let one = druse::progress::Threads::new(1)?;
    let seconds = in_turn(
        ROUNDS,
        &mut [
            &mut || one.install(|| solid.fill(&lattice, black_box(&mut values))),
            &mut baselines::fuse,
        ],
    );
    let each = seconds[0].iter().map(|s| s * 1e6 / lattice.len() as f64);
    let each: Vec<f64> = each.collect();
    Ok(vec![baselines::at_reference("P16", &each, &seconds[1], "")])
}
