//! Grids, tubes, spheres and single elements in every numbering, with cells of little symmetry.

use super::*;
use crate::scaffold::{Connectivity, Kind};
use crate::tiling::{Blend, Filling, Interpolation};
use druse_cells::cell::{Expression, Series, Surface, operators_of, symmetry};
use druse_geometry::frame::{CellPoint, Element, Vec3};

/// SplitMix64, below a number.
fn draw(state: &mut u64, below: usize) -> usize {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) % below as u64) as usize
}

/// The scaffold with every element turned at random, by rotations and reflections.
fn shuffled(scaffold: &Scaffold, seed: u64) -> Scaffold {
    let mut state = seed;
    let turns: Vec<Vec<Mat3>> = Element::SCAFFOLD_ELEMENTS
        .iter()
        .map(|&e| operators_of(e, druse_cells::cell::default_group(e)).unwrap())
        .collect();
    let drawn: Vec<&Mat3> = scaffold
        .elements()
        .map(|e| {
            let own = &turns[Element::SCAFFOLD_ELEMENTS
                .iter()
                .position(|s| *s == e.shape())
                .unwrap()];
            &own[draw(&mut state, own.len())]
        })
        .collect();
    let mut turned = scaffold.clone();
    turned.turn(|e, _| Some(drawn[e]));
    turned
}

/// A turned copy of a scaffold.
struct Found {
    scaffold: Scaffold,
    turned: usize,
    mixture: Mixture,
}

fn orient(
    scaffold: &Scaffold,
    members: &[Member<Cell>],
    aim: &Aim,
    mismatch: Mismatch,
) -> Result<Option<Found>, TilingError> {
    let mut scaffold = Arc::new(scaffold.clone());
    let found = super::orient(&mut scaffold, members, aim, mismatch)?;
    Ok(found.map(|Oriented { turned, mixture }| Found {
        scaffold: Arc::unwrap_or_clone(scaffold),
        turned,
        mixture,
    }))
}

/// A grid with displaced nodes.
fn warped(kind: Kind, counts: [usize; 3]) -> Scaffold {
    let size = Vec3::from(counts.map(|n| n as f64));
    let grid = Scaffold::box_grid(size, counts, kind).unwrap();
    let bend = |p: &Vec3| p + Vec3::new(0.2 * p.y.sin(), 0.1 * p.z.cos(), 0.15 * (p.x + p.y).sin());
    let nodes = grid.nodes().iter().map(bend).collect();
    Scaffold::new(nodes, grid.connectivity().clone()).unwrap()
}

fn member(cell: &Cell) -> [Member<'_, Cell>; 1] {
    [Member {
        name: String::new(),
        cells: vec![cell],
    }]
}

/// A chiral cell without any symmetry.
fn chiral(seed: u64) -> Cell {
    let (group, lattice) = symmetry::<3>(Element::Hex, Some("C1"), None).unwrap();
    let mut state = seed;
    let terms: Vec<([i32; 3], [f64; 2])> = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 2]]
        .into_iter()
        .map(|k| {
            (
                k,
                [0, 1].map(|_| 0.2 + draw(&mut state, 1000) as f64 / 1000.0),
            )
        })
        .collect();
    let series = Series::new(group, lattice, &terms).unwrap();
    Cell::new("chiral", Element::Hex, series).unwrap()
}

#[test]
fn a_shuffled_grid_is_numbered_as_the_ordered_one() {
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    for kind in [Kind::Hex8] {
        let ordered = warped(kind, [4, 4, 4]);
        assert!(
            orient(&ordered, &member(&gyroid), &Aim::World, Mismatch::Refuse)
                .unwrap()
                .is_none()
        );
        for seed in 0..4 {
            let mixed = shuffled(&ordered, seed);
            assert!(!continues(&mixed, &member(&gyroid)));
            let found = orient(&mixed, &member(&gyroid), &Aim::World, Mismatch::Refuse)
                .unwrap()
                .unwrap();
            assert!(found.turned > 40);
            assert_eq!(found.scaffold.connectivity(), ordered.connectivity());
        }
    }
}

#[test]
fn a_chiral_cell_continues_in_a_thousand_numberings() {
    let ordered = warped(Kind::Hex8, [5, 2, 2]);
    let cell = chiral(1);
    let is_long = std::env::var_os("DRUSE_FULL").is_some();
    for seed in 0..if is_long { 1000 } else { 20 } {
        let mixed = shuffled(&ordered, seed);
        let found = orient(&mixed, &member(&cell), &Aim::World, Mismatch::Refuse).unwrap();
        let turned = found.map_or(mixed, |f| f.scaffold);
        assert!(continues(&turned, &member(&cell)), "{seed}");
        // The handedness of the cell is kept in all elements.
        assert!(turned.elements().all(|e| e.volume() > 0.0), "{seed}");
    }
}

/// Six blocks around a void, as on a cube blown up to a sphere: three hexes at each edge from a corner outwards.
fn hollow_sphere(layers: usize) -> Scaffold {
    let mut nodes = Vec::new();
    let corners: Vec<Vec3> = Element::Hex.vertices();
    for layer in 0..=layers {
        let radius = 1.0 + layer as f64 / layers as f64;
        nodes.extend(corners.iter().map(|c| c.normalize() * radius));
    }
    let mut elements = Connectivity::default();
    for layer in 0..layers as u32 {
        for face in Kind::Hex8.faces() {
            let inner = face.corners.iter().map(|&c| u32::from(c) + 8 * layer);
            let outer = face.corners.iter().map(|&c| u32::from(c) + 8 * (layer + 1));
            let all: Vec<u32> = inner.chain(outer).collect();
            elements.push(Kind::Hex8, &all);
        }
    }
    Scaffold::new(nodes, elements).unwrap()
}

#[test]
fn edges_with_three_hexes_are_named() {
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    for layers in [1, 3] {
        let scaffold = hollow_sphere(layers);
        let Err(TilingError::Misfit(misfit)) =
            orient(&scaffold, &member(&gyroid), &Aim::World, Mismatch::Refuse)
        else {
            panic!("a gyroid cannot fill it");
        };
        assert_eq!((misfit.edges.len(), misfit.lines), (8 * layers, 8));
        for edge in &misfit.edges {
            assert_eq!(edge.elements, 3);
            let [x, y, z] = edge.middle;
            assert!((x.abs() - y.abs()).abs() < 1e-12 && (y.abs() - z.abs()).abs() < 1e-12);
        }
        assert!(misfit.to_string().contains("8 lines"), "{misfit}");
        assert!(misfit.to_string().contains("mismatch"), "{misfit}");
    }
}

/// Checks a mixture of turns: it continues over all faces, its weights sum to one, its gradients are those of its values,
/// and both keep to their bounds. Returns at how many of the points in mixed elements only one turn counts.
fn check_mixture(scaffold: &Scaffold, cell: &Cell, width: Option<f64>) -> usize {
    let found = orient(
        scaffold,
        &member(cell),
        &Aim::World,
        Mismatch::Blend { width },
    )
    .unwrap()
    .unwrap();
    assert!(!found.mixture.is_empty());
    let ones = vec![1.0; scaffold.nodes().len()];
    let [own] = member(cell);
    let blend = Blend::new(&found.scaffold, vec![own], ones, Interpolation::Linear).unwrap();
    let blend = blend.with_mixture(&found.mixture);
    assert!(blend.check(&found.scaffold).is_ok());
    let jump = crate::tiling::certify(&found.scaffold, &blend).value_jump_max;
    assert!(jump < 1e-9, "{jump}");
    let mut state = 5;
    let mut unmixed = 0;
    for element in (0..scaffold.len()).flat_map(|e| [e; 3]) {
        let turns = found.mixture.turns(element);
        let at = [0; 3].map(|_| draw(&mut state, 1000) as f64 / 1000.0 - 0.5);
        let xi = CellPoint(Vec3::from(at));
        let shape = scaffold.element(element).shape();
        let sum: f64 = turns.iter().map(|t| t.weight(shape, xi).0).sum();
        assert!(turns.is_empty() || (sum - 1.0).abs() < 1e-12, "{sum}");
        unmixed += usize::from(turns.iter().any(|t| t.weight(shape, xi).0 == 1.0));
        for turn in turns {
            let (weight, slope) = turn.weight(shape, xi);
            assert!((-1e-12..=1.0 + 1e-12).contains(&weight));
            assert!(slope.norm() <= turn.max_slope(8) + 1e-12, "{slope}");
            for axis in 0..3 {
                let step = Vec3::ith(axis, 1e-5);
                let [a, b] = [xi.0 + step, xi.0 - step].map(|p| turn.weight(shape, CellPoint(p)).0);
                assert!(((a - b) / 2e-5 - slope[axis]).abs() < 1e-5);
            }
        }
        let (value, gradient) = blend.value_and_gradient(element, xi);
        for axis in 0..3 {
            let step = Vec3::ith(axis, 1e-5);
            let [a, b] = [xi.0 + step, xi.0 - step].map(|p| blend.value(element, CellPoint(p)));
            assert!(((a - b) / 2e-5 - gradient[axis]).abs() < 1e-5);
        }
        assert!(blend.bound(element, &shape.cell_box()).contains(value));
        assert!(gradient.norm() <= blend.gradient_sup(element));
    }
    unmixed
}

/// Around these edges the turns of the cell are mixed, so that it continues over all faces; elsewhere it is as it was.
#[test]
fn mixed_turns_continue_around_edges_with_three_hexes() {
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    let (ball, sphere) = (Scaffold::ball(6.0, 3.0).unwrap(), hollow_sphere(3));
    for (scaffold, cell) in [(&sphere, &gyroid), (&ball, &gyroid), (&sphere, &chiral(4))] {
        let mixed = shuffled(scaffold, 8);
        let unmixed = [None, Some(1.0), Some(0.3)];
        let unmixed = unmixed.map(|width| check_mixture(&mixed, cell, width));
        // A thin layer leaves more of the elements as they are, but for those with all corners at such faces.
        let has_other_corners = std::ptr::eq(scaffold, &ball);
        assert_eq!(unmixed[2] > unmixed[0], has_other_corners, "{unmixed:?}");
    }
    // A cell that shows something else on every face has no partner behind it, so that nothing can be mixed.
    let column = |k| {
        let (group, lattice) = symmetry::<3>(Element::Wedge, Some("C1"), None).unwrap();
        Series::new(group, lattice, &[([1, 0, 0], [0.3, 0.8]), (k, [0.5, 0.1])]).unwrap()
    };
    let one_way = Cell::new("one_way", Element::Wedge, column([0, 1, 1])).unwrap();
    let wedges = warped(Kind::Wedge6, [2, 2, 2]);
    let found = orient(
        &wedges,
        &member(&one_way),
        &Aim::World,
        Mismatch::Blend { width: None },
    );
    let Err(TilingError::Misfit(misfit)) = found else {
        panic!("it continues nowhere");
    };
    assert!(!misfit.can_blend && !misfit.to_string().contains("mismatch"));
}

/// A column along z has the symmetry of a quarter turn about it, so that it runs along edges with three hexes.
#[test]
fn a_column_runs_along_the_axis_of_an_o_grid() {
    let (group, lattice) = symmetry::<3>(Element::Hex, Some("D4h"), None).unwrap();
    let terms = [([1, 0, 0], [-1.0, 0.0]), ([0, 0, 1], [-0.3, 0.0])];
    let column = Series::new(group, lattice, &terms).unwrap();
    let column = Cell::new("column", Element::Hex, column).unwrap();
    let cylinder = shuffled(&Scaffold::cylinder(10.0, 10.0, 4.0).unwrap(), 3);
    let found = orient(&cylinder, &member(&column), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert!(continues(&found.scaffold, &member(&column)));
    for e in found.scaffold.elements() {
        let along = e.jacobian(CellPoint(Vec3::zeros())).column(2).normalize();
        assert!(along.z.abs() > 0.999);
    }
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    assert!(orient(&cylinder, &member(&gyroid), &Aim::World, Mismatch::Refuse).is_err());
    // Without the core all inner edges have four hexes.
    let tube = shuffled(&Scaffold::tube(5.0, 10.0, 10.0, 3.0).unwrap(), 5);
    let found = orient(&tube, &member(&gyroid), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    let jump = crate::tiling::certify(&found.scaffold, &gyroid).value_jump_max;
    assert!(jump < 1e-9, "{jump}");
}

#[test]
fn columns_follow_a_direction_where_nothing_else_decides() {
    let (group, lattice) = symmetry::<3>(Element::Hex, Some("D4h"), None).unwrap();
    let column = Series::new(group, lattice, &[([1, 0, 0], [-1.0, 0.0])]).unwrap();
    let column = Cell::new("column", Element::Hex, column).unwrap();
    let grid = warped(Kind::Hex8, [3, 3, 3]);
    for axis in 0..3 {
        let aim = Aim::Directions(Directions {
            toward: vec![Vec3::ith(axis, 1.0); grid.len()],
            ..Directions::default()
        });
        let found = orient(&grid, &member(&column), &aim, Mismatch::Refuse).unwrap();
        assert_eq!(found.is_none(), axis == 2);
        let turned = found.as_ref().map_or(&grid, |f| &f.scaffold);
        assert!(continues(turned, &member(&column)));
        for e in turned.elements() {
            let along = e.jacobian(CellPoint(Vec3::zeros())).column(2).normalize();
            assert!(along[axis].abs() > 0.8, "{along}");
        }
    }
}

/// Two pyramids on one base, whose cell is its own mirror image in one direction alone; and quads around a tube in all eight
/// orders of their nodes, from which a shell makes hexes.
#[test]
fn pyramids_and_shells_of_surfaces_are_turned() {
    let (group, lattice) = symmetry::<3>(Element::Pyramid, Some("C1"), Some("tetragonal")).unwrap();
    let terms = [([1, 0, 0], [0.6, 0.3]), ([0, 1, 0], [0.4, 0.0])];
    let half = Series::new(group, lattice, &terms).unwrap();
    let half = Cell::new("half", Element::Pyramid, half).unwrap();
    let mut nodes: Vec<Vec3> = [[0., 0.], [2., 0.], [2., 2.], [0., 2.]]
        .map(|[x, y]| Vec3::new(x, y, 0.1 * x))
        .to_vec();
    nodes.extend([Vec3::new(1.1, 1.0, 1.5), Vec3::new(0.9, 1.0, -1.5)]);
    let mut elements = Connectivity::default();
    elements.push(Kind::Pyramid5, &[0, 1, 2, 3, 4]);
    elements.push(Kind::Pyramid5, &[0, 3, 2, 1, 5]);
    let pair = Scaffold::new(nodes, elements).unwrap();
    let mut turned = 0;
    for seed in 0..12 {
        let mixed = shuffled(&pair, seed);
        turned += usize::from(!continues(&mixed, &member(&half)));
        let found = orient(&mixed, &member(&half), &Aim::World, Mismatch::Refuse).unwrap();
        let found = found.map_or(mixed, |f| f.scaffold);
        assert!(continues(&found, &member(&half)), "{seed}");
    }
    assert!(turned > 3);

    let (group, lattice) = symmetry::<2>(Element::Quad, Some("C1"), None).unwrap();
    let terms = [
        ([1, 0], [0.6, 0.3]),
        ([0, 1], [0.2, -0.7]),
        ([1, 2], [0.3, 0.1]),
    ];
    let weave = Series::new(group, lattice, &terms).unwrap();
    let weave = Cell::new("weave", Element::Quad, weave).unwrap();
    let (around, along) = (8u32, 4u32);
    let at = |n: u32| {
        let (angle, z) = (
            f64::from(n % around) * std::f64::consts::TAU / 8.0,
            n / around,
        );
        Vec3::new(4.0 * angle.cos(), 4.0 * angle.sin(), 3.0 * f64::from(z))
    };
    let mut state = 3;
    let mut quads = Connectivity::default();
    for n in 0..around * along {
        let next = n - n % around + (n + 1) % around;
        let mut own = [n, next, next + around, n + around];
        own.rotate_left(draw(&mut state, 4));
        if draw(&mut state, 2) == 1 {
            own.reverse();
        }
        quads.push(Kind::Quad4, &own);
    }
    let tube = crate::scaffold::Surface::new((0..around * (along + 1)).map(at).collect(), quads);
    let shell = tube.unwrap().shell(0.5).unwrap();
    assert!(!continues(&shell, &member(&weave)));
    let found = orient(&shell, &member(&weave), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert!(continues(&found.scaffold, &member(&weave)));
    let jump = crate::tiling::certify(&found.scaffold, &weave).value_jump_max;
    assert!(jump < 1e-9, "{jump}");
}

/// Wedges that tell top from bottom, tets that tell one corner from the others, quads in a shell, and a union that
/// has no coefficients.
#[test]
fn other_shapes_and_functions_are_turned_too() {
    let arrow = |element: Element, group: &str, k: [[i32; 3]; 2]| {
        let (group, lattice) = symmetry::<3>(element, Some(group), None).unwrap();
        let terms = [(k[0], [-1.0, 0.0]), (k[1], [0.2, 0.4])];
        Cell::new(
            "arrow",
            element,
            Series::new(group, lattice, &terms).unwrap(),
        )
        .unwrap()
    };
    let wedges = warped(Kind::Wedge6, [2, 2, 3]);
    let up = arrow(Element::Wedge, "C3v", [[1, 0, 0], [0, 0, 1]]);
    let mixed = shuffled(&wedges, 11);
    assert!(!continues(&mixed, &member(&up)));
    let found = orient(&mixed, &member(&up), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert!(continues(&found.scaffold, &member(&up)));

    // Around one vertex, every tet turns its corner there.
    let cone = arrow(Element::Tet, "C3v", [[1, 1, 1], [1, 0, 0]]);
    let octahedron = {
        let mut nodes = vec![Vec3::zeros()];
        nodes.extend((0..3).flat_map(|a| [-1.0, 1.0].map(|s| Vec3::ith(a, s))));
        let mut elements = Connectivity::default();
        for n in 0..8u32 {
            let own = [0, 1 + (n & 1), 3 + (n >> 1 & 1), 5 + (n >> 2)];
            elements.push(Kind::Tet4, &own);
        }
        Scaffold::new(nodes, elements).unwrap()
    };
    let mixed = shuffled(&octahedron, 2);
    assert!(!continues(&mixed, &member(&cone)));
    let found = orient(&mixed, &member(&cone), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert!(continues(&found.scaffold, &member(&cone)));

    let (group, lattice) = symmetry::<2>(Element::Quad, Some("C1"), None).unwrap();
    let terms = [
        ([1, 0], [0.6, 0.3]),
        ([0, 1], [0.2, -0.7]),
        ([1, 2], [0.3, 0.1]),
    ];
    let weave = Series::new(group, lattice, &terms).unwrap();
    let weave = Cell::new("weave", Element::Quad, weave).unwrap();
    let plate = warped(Kind::Hex8, [4, 3, 1]);
    let quarter = Mat3::new(0., -1., 0., 1., 0., 0., 0., 0., 1.);
    let mut mixed = plate.clone();
    mixed.turn(|e, _| (e % 3 == 1).then_some(&quarter));
    assert!(!continues(&mixed, &member(&weave)));
    let found = orient(&mixed, &member(&weave), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert_eq!(found.scaffold.connectivity(), plate.connectivity());

    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    let both = vec![gyroid.expression().clone(), chiral(5).expression().clone()];
    let union = Cell::new("union", Element::Hex, Expression::min(both, 0.1).unwrap()).unwrap();
    let mixed = shuffled(&warped(Kind::Hex8, [3, 2, 2]), 9);
    let found = orient(&mixed, &member(&union), &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    assert!(continues(&found.scaffold, &member(&union)));
}

/// Turning takes over what renumbering leaves as it is: the result is that of a new scaffold, also where three elements
/// share a face.
#[test]
fn a_turned_scaffold_is_as_made_anew() {
    let three = {
        let grid = warped(Kind::Hex8, [2, 1, 1]);
        let mut nodes = grid.nodes().to_vec();
        let mut elements = grid.connectivity().clone();
        let face = Kind::Hex8.faces()[0].corners;
        let own: Vec<u32> = face
            .iter()
            .map(|&c| grid.connectivity().nodes(1)[c as usize])
            .collect();
        let first = nodes.len() as u32;
        nodes.extend(
            own.iter()
                .map(|&n| grid.nodes()[n as usize] + Vec3::new(0.3, 2.0, 0.1)),
        );
        elements.push(
            Kind::Hex8,
            &[
                own[0],
                own[1],
                own[2],
                own[3],
                first,
                first + 1,
                first + 2,
                first + 3,
            ],
        );
        Scaffold::new(nodes, elements).unwrap()
    };
    assert_eq!(three.non_manifold_faces().len(), 1);
    let grids =
        [Kind::Hex8, Kind::Wedge6, Kind::Tet4, Kind::Pyramid5].map(|k| warped(k, [2, 3, 2]));
    for (n, scaffold) in grids
        .into_iter()
        .chain([three, hollow_sphere(2)])
        .enumerate()
    {
        let turned = shuffled(&scaffold, n as u64);
        let connectivity = turned.connectivity().clone();
        assert_ne!(connectivity, *scaffold.connectivity());
        let anew = Scaffold::new(turned.nodes().to_vec(), connectivity).unwrap();
        for f in (0..anew.len()).flat_map(|e| anew.faces_of(e)) {
            assert_eq!(turned.neighbour(f), anew.neighbour(f), "{f:?}");
        }
        assert_eq!(turned.non_manifold_faces(), anew.non_manifold_faces());
        assert_eq!(turned.components(), anew.components());
        assert_eq!(turned.bounds(), anew.bounds());
        for (own, other) in turned.elements().zip(anew.elements()) {
            let xi = CellPoint(own.shape().centroid().0 + Vec3::new(0.1, -0.05, 0.07));
            assert_eq!(own.map(xi), other.map(xi));
            assert_eq!(own.bounds(), other.bounds());
            let volume = other.volume();
            assert!((own.volume() - volume).abs() <= 1e-12 * volume.abs());
            assert_eq!(own.orientation(), other.orientation());
            // Bounds of the same singular values, though they may be found by other splits.
            let found = own.jacobian(xi).singular_values();
            for (low, high) in [own.stretch(), other.stretch()] {
                assert!(low <= found.min() * (1.0 + 1e-12) && found.max() <= high * (1.0 + 1e-12));
            }
        }
        let p = turned.element(1).map(turned.element(1).shape().centroid());
        assert_eq!(turned.locate(p), anew.locate(p));
    }
}

#[test]
fn every_turn_of_every_kind_moves_reference_points_and_keeps_the_map() {
    for kind in Kind::solids() {
        let mut elements = Connectivity::default();
        let own: Vec<u32> = (0..kind.node_count() as u32).collect();
        elements.push(kind, &own);
        // Nodes off their places make the element curved.
        let bend = |p: &CellPoint<3>| p.0 + p.0.map(|c| 0.05 * c * c).yzx();
        let nodes = kind.reference_nodes().iter().map(bend).collect();
        let before = Scaffold::new(nodes, elements).unwrap();
        for turn in
            operators_of(kind.shape(), druse_cells::cell::default_group(kind.shape())).unwrap()
        {
            let mut after = before.clone();
            after.turn(|_, _| Some(&turn));
            for p in kind.reference_nodes() {
                let xi = kind.shape().centroid().0.lerp(&p.0, 0.7);
                let x = before.element(0).map(CellPoint(xi)).0;
                let y = after.element(0).map(CellPoint(turn * xi)).0;
                assert!((x - y).norm() < 1e-12, "{kind:?} {turn}");
            }
        }
    }
}
