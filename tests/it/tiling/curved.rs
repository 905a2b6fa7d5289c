//! Maps of bent elements, in bulk and point by point.

use super::options;
use crate::strategy::{self, Noise};
use druse::cell::{Surface, Table};
use druse::field::{Field, SampleLattice, ValueLimits};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::scaffold::{Kind, Scaffold};
use druse::tiling::{Boundary, TiledSolid, TilingOptions};

#[test]
fn maps_are_sums_of_shape_functions() {
    for kind in Kind::solids() {
        let nodes = strategy::element_nodes(kind, 0.1, 7);
        let mut elements = druse::scaffold::Connectivity::default();
        let own: Vec<u32> = (0..nodes.len() as u32).collect();
        elements.push(kind, &own);
        let scaffold = Scaffold::new(nodes.clone(), elements).unwrap();
        let mut noise = Noise::new(11);
        for _ in 0..50 {
            let xi = strategy::cell_point(kind.shape(), &mut noise);
            let (x, jacobian) = scaffold.element(0).map_and_jacobian(xi);
            let weights = kind.shape_functions(xi);
            let sum: Vec3 = nodes.iter().zip(weights).map(|(p, w)| p * w).sum();
            assert!((x.0 - sum).norm() < 1e-12, "{kind:?} at {xi:?}");
            for (axis, column) in jacobian.column_iter().enumerate() {
                let slopes = kind.shape_gradients(xi);
                let sum: Vec3 = nodes.iter().zip(slopes).map(|(p, g)| p * g[axis]).sum();
                assert!((column - sum).norm() < 1e-11, "{kind:?} at {xi:?}");
            }
        }
    }
}

/// Elements that are graded and sheared along the way, so that no derivative of their maps vanishes.
fn graded(kind: Kind) -> Scaffold {
    let (mut nodes, elements) = strategy::mesh(kind, [2, 2, 2], 0.0, 1);
    for p in &mut nodes {
        let q = *p;
        *p += Vec3::new(
            0.12 * q.x * q.x + 0.05 * q.y * q.z,
            0.15 * q.y * q.y + 0.04 * q.x * q.y,
            0.10 * q.z * q.z + 0.06 * q.x * q.z,
        );
    }
    Scaffold::new(nodes, elements).unwrap()
}

#[test]
fn values_in_bulk_are_those_of_single_points_in_graded_elements_of_every_kind() {
    let solids = Kind::solids().filter(|k| matches!(k.shape(), Element::Tet | Element::Hex));
    for kind in solids {
        let scaffold = graded(kind);
        let surface = if kind.shape() == Element::Hex {
            Surface::SchwarzP
        } else {
            Surface::Diamond
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let mut noise = Noise::new(23);
        // From voxels that the elements' bending shows in to ones that it does not.
        for voxels in [8.0, 25.0, 60.0] {
            let h = 1.0 / voxels;
            let tiled = TiledSolid::new(&scaffold, &table, options(h)).unwrap();
            let bounds = scaffold.bounds();
            for _ in 0..60 {
                // Lattices start anywhere, so that faces cut their parts in every way.
                let share = noise.vector() * 0.5 + Vec3::repeat(0.5);
                let origin = bounds.min + bounds.size().component_mul(&share);
                let lattice = SampleLattice {
                    origin: WorldPoint(origin),
                    step: h,
                    counts: [8, 7, 5],
                };
                let mut values = vec![0f32; lattice.len()];
                tiled.fill(&lattice, &mut values);
                for (n, &v) in values.iter().enumerate() {
                    let single = tiled.value(lattice.point(n));
                    let off = (f64::from(v) - single).abs() / h;
                    assert!(off < 1e-4, "{kind:?}, {voxels} voxels: {off:e} at {n}");
                }
            }
        }
    }
}

/// A flat outer face of bent elements through the centres of blocks: these lie in one element, their samples on both sides.
#[test]
fn samples_beside_a_flat_face_have_the_values_of_single_points() {
    for kind in [Kind::Tet10, Kind::Hex20] {
        let (mut nodes, elements) = strategy::mesh(kind, [2, 2, 2], 0.0, 1);
        for p in &mut nodes {
            let q = *p;
            p.y += 0.15 * q.y * q.y + 0.04 * q.x * q.y;
            p.z += 0.10 * q.z * q.z + 0.06 * q.x * q.z;
        }
        let scaffold = Scaffold::new(nodes, elements).unwrap();
        let surface = if kind.shape() == Element::Hex {
            Surface::SchwarzP
        } else {
            Surface::Diamond
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let h = 1.0 / 60.0;
        let tiled = TiledSolid::new(&scaffold, &table, options(h)).unwrap();
        let bounds = scaffold.bounds();
        let mut noise = Noise::new(31);
        for _ in 0..100 {
            let share = noise.vector() * 0.5 + Vec3::repeat(0.5);
            let mut origin = bounds.min + bounds.size().component_mul(&share);
            origin.x = bounds.min.x - 0.5 * h;
            let lattice = SampleLattice {
                origin: WorldPoint(origin),
                step: h,
                counts: [4, 8, 8],
            };
            let mut values = vec![0f32; lattice.len()];
            tiled.fill(&lattice, &mut values);
            for (n, &v) in values.iter().enumerate() {
                let single = tiled.value(lattice.point(n));
                let off = (f64::from(v) - single).abs() / h;
                assert!(off < 1e-4, "{kind:?}: {v} {single} at {n}");
            }
        }
    }
}

#[test]
fn limits_change_no_value_between_them() {
    let mut spared = 0;
    for (kind, bend) in [
        (Kind::Tet10, true),
        (Kind::Hex20, true),
        (Kind::Tet4, false),
        (Kind::Hex8, false),
    ] {
        let scaffold = if bend {
            graded(kind)
        } else {
            let (nodes, elements) = strategy::mesh(kind, [2, 2, 2], 0.1, 1);
            Scaffold::new(nodes, elements).unwrap()
        };
        let surface = if kind.shape() == Element::Hex {
            Surface::SchwarzP
        } else {
            Surface::Diamond
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let mut noise = Noise::new(29);
        let h = 1.0 / 20.0;
        for boundary in [Boundary::Cut, Boundary::Extend] {
            let options = TilingOptions {
                boundary,
                ..options(h)
            };
            let tiled = TiledSolid::new(&scaffold, &table, options).unwrap();
            let bounds = scaffold.bounds().dilated(4.0 * h);
            for _ in 0..30 {
                let share = noise.vector() * 0.5 + Vec3::repeat(0.5);
                let lattice = SampleLattice {
                    origin: WorldPoint(bounds.min + bounds.size().component_mul(&share)),
                    step: h,
                    counts: [8, 8, 7],
                };
                let mut right = vec![0f32; lattice.len()];
                let all = tiled.fill_counting(&lattice, &mut right);
                // A slab that is not needed, signs, one side of the band, and any two numbers.
                let w = options.half_width as f32;
                let (low, high) = (0..lattice.len())
                    .map(|n| match n / 56 {
                        0..4 => (0.2 * w, -0.1 * w),
                        4 => (-f32::MIN_POSITIVE, 0.0),
                        5 => (-w, 0.3 * w),
                        6 => (-0.4 * w, w),
                        _ => [noise.signed(), noise.signed()]
                            .map(|s| w * s as f32)
                            .into(),
                    })
                    .unzip();
                let limits = ValueLimits::new(low, high);
                let mut values = vec![0f32; lattice.len()];
                let evaluated = tiled.fill_within(&lattice, &limits, &mut values);
                spared += all.saturating_sub(evaluated);
                for (n, (v, right)) in values.iter().zip(right).enumerate() {
                    let [low, high] = limits.of_sample(n);
                    let off = v.clamp(low.min(high), high) - right.clamp(low.min(high), high);
                    assert!(
                        !limits.is_needed(n) || off.abs() < 1e-4 * h as f32,
                        "{kind:?} {boundary:?}: {v} in place of {right}, limits {low} {high}"
                    );
                }
            }
        }
    }
    assert!(spared > 20_000, "{spared}");
}
