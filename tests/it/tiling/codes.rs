//! What processors have beyond what all of them do: AVX-512 gives what AVX2 gives, to the last bit.

use super::options;
use crate::strategy;
use druse::cell::{Cell, Solid, Surface, Table};
use druse::field::{Field, SampleLattice};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::scaffold::{Kind, Scaffold};
use druse::simd::{InstructionSet, use_instruction_set};
use druse::tiling::TiledSolid;

/// Distances of a cell over a scaffold, at leaves in and around it and at a lattice of no leaves.
fn distances(scaffold: &Scaffold, cell: &Cell, h: f64) -> Vec<u32> {
    let table = Table::new(cell).unwrap();
    let field = TiledSolid::new(scaffold, &table, options(h)).unwrap();
    let bounds = scaffold.bounds();
    let mut bits = Vec::new();
    for n in 0..24u32 {
        let share = Vec3::new(0.819_17, 0.671_04, 0.549_70) * f64::from(n);
        let corner = share.map(f64::fract).component_mul(&bounds.size());
        let lattice = SampleLattice {
            origin: WorldPoint(bounds.min + corner - Vec3::repeat(3.0 * h)),
            step: h,
            counts: if n < 20 { [8; 3] } else { [5, 9, 7] },
        };
        let mut values = vec![0.0; lattice.len()];
        field.fill(&lattice, &mut values);
        bits.extend(values.iter().map(|v: &f32| v.to_bits()));
    }
    bits
}

#[test]
fn the_widest_registers_give_the_same_bits() {
    let of = |kind: Kind, bent: f64| super::scaffold(kind, [2, 2, 2], bent, 5);
    let hex = |s: Surface| s.cell(Element::Hex).unwrap();
    let sheet = Surface::Diamond.cell(Element::Hex).unwrap();
    let sheet = sheet.with_solid(Solid::Sheet, 0.3).unwrap();
    let grid = || Scaffold::box_grid(Vec3::new(2.0, 2.3, 1.8), [2; 3], Kind::Hex8).unwrap();
    let diamond = || Surface::Diamond.cell(Element::Tet).unwrap();
    let (nodes, elements) = strategy::mesh(Kind::Hex8, [2, 2, 2], 0.0, 1);
    let sheared = nodes
        .iter()
        .map(|p| p + Vec3::new(0.3 * p.y, 0.2 * p.z, 0.0));
    let parts = [
        (grid(), hex(Surface::Gyroid)),
        (grid(), sheet),
        (
            Scaffold::new(sheared.collect(), elements).unwrap(),
            hex(Surface::Iwp),
        ),
        (of(Kind::Tet4, 0.15), diamond()),
        (of(Kind::Tet10, 0.1), diamond()),
        (of(Kind::Hex8, 0.15), hex(Surface::SchwarzP)),
    ];
    for (number, (scaffold, cell)) in parts.iter().enumerate() {
        // Other laws that run meanwhile see no difference if this one holds.
        let [narrow, wide] = [InstructionSet::Avx2, InstructionSet::Best].map(|code| {
            use_instruction_set(code);
            distances(scaffold, cell, 0.03)
        });
        use_instruction_set(InstructionSet::Best);
        let inside = wide.iter().filter(|&&v| f32::from_bits(v) < 0.0).count();
        assert!(inside > 500, "part {number}: {inside} samples inside");
        assert!(narrow == wide, "part {number}");
    }
}
