//! Proptest strategies that several modules share.

use druse::frame::{CellPoint, Element, Mat3, Vec3};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use std::collections::BTreeMap;

/// A small generator, so that a mesh is a function of one seed.
pub struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Uniform in the cube [-1, 1)^3.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// Nodes of one element: the reference cell under a random affine map, then every node displaced
/// by up to `amplitude` of the edge.
pub fn element_nodes(kind: Kind, amplitude: f64, seed: u64) -> Vec<Vec3> {
    let mut noise = Noise::new(seed);
    let mut linear = Mat3::identity();
    linear.iter_mut().for_each(|m| *m += 0.35 * noise.signed());
    linear *= 3.0;
    let shift = noise.vector() * 5.0;
    kind.reference_nodes()
        .into_iter()
        .map(|xi| linear * (xi.0 + noise.vector() * amplitude) + shift)
        .collect()
}

/// A point of the closed reference cell.
pub fn cell_point(shape: Element, noise: &mut Noise) -> CellPoint<3> {
    let hull = shape.cell_box();
    loop {
        let along = noise.vector().add_scalar(1.0) / 2.0;
        let p = CellPoint(hull.min + (hull.max - hull.min).component_mul(&along));
        if shape.face_distance(p) <= 0.0 {
            return p;
        }
    }
}

/// Every renumbering of a kind's nodes that a symmetry of its reference cell makes: new node i is
/// old node `p[i]`.
pub fn renumberings(kind: Kind) -> Vec<Vec<usize>> {
    let nodes = kind.reference_nodes();
    let mut found = Vec::new();
    for map in reference_maps() {
        let p: Option<Vec<usize>> = nodes
            .iter()
            .map(|n| nodes.iter().position(|m| (map * n.0 - m.0).norm() < 1e-12))
            .collect();
        found.extend(p.filter(|p| !found.contains(p)));
    }
    found
}

/// Signed permutations of the axes, and the symmetries of the hexagonal prism.
fn reference_maps() -> Vec<Mat3> {
    let mut maps = Vec::new();
    for order in [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [1, 0, 2],
        [0, 2, 1],
        [2, 1, 0],
    ] {
        for signs in 0..8 {
            maps.push(Mat3::from_fn(|row, column| {
                let sign = if signs >> row & 1 == 1 { -1.0 } else { 1.0 };
                if order[row] == column { sign } else { 0.0 }
            }));
        }
    }
    for turn in 0..6 {
        let (s, c) = (f64::from(turn) * std::f64::consts::FRAC_PI_3).sin_cos();
        for (x, z) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            maps.push(Mat3::new(c * x, -s, 0., s * x, c, 0., 0., 0., z));
        }
    }
    maps
}

/// A conforming mesh of one kind filling a box of about unit cells: corners displaced by up to
/// `amplitude` of the edge, mid nodes of quadratic kinds by half of that from the middle, every
/// element renumbered at random.
pub fn mesh(
    kind: Kind,
    counts: [usize; 3],
    amplitude: f64,
    seed: u64,
) -> (Vec<Vec3>, Connectivity) {
    let mut noise = Noise::new(seed);
    let linear = match kind.shape() {
        Element::Tet => Kind::Tet4,
        Element::Wedge => Kind::Wedge6,
        Element::Pyramid => Kind::Pyramid5,
        _ => Kind::Hex8,
    };
    let size = Vec3::from(counts.map(|c| c as f64));
    let grid = Scaffold::box_grid(size, counts, linear).unwrap();
    let mut nodes: Vec<Vec3> = grid
        .nodes()
        .iter()
        .map(|p| p + noise.vector() * amplitude)
        .collect();
    let orders = renumberings(kind);
    let mut made: BTreeMap<Vec<u32>, u32> = BTreeMap::new();
    let mut elements = Connectivity::default();
    for e in 0..grid.len() {
        let corners = grid.connectivity().nodes(e);
        let mut own = corners.to_vec();
        let mut groups: Vec<Vec<u8>> = Vec::new();
        if kind.degree() == 2 {
            groups.extend(kind.edges().iter().map(|e| e.to_vec()));
        }
        let centred = kind.faces().iter().filter(|f| f.centre.is_some());
        groups.extend(centred.map(|f| f.corners.to_vec()));
        if kind == Kind::Hex27 {
            groups.push((0..8).collect());
        }
        for group in groups {
            let mut key: Vec<u32> = group.iter().map(|&c| corners[c as usize]).collect();
            key.sort_unstable();
            own.push(*made.entry(key.clone()).or_insert_with(|| {
                let sum: Vec3 = key.iter().map(|&n| nodes[n as usize]).sum();
                nodes.push(sum / key.len() as f64 + noise.vector() * amplitude / 2.0);
                nodes.len() as u32 - 1
            }));
        }
        let order = &orders[noise.below(orders.len())];
        let shuffled: Vec<u32> = order.iter().map(|&i| own[i]).collect();
        elements.push(kind, &shuffled);
    }
    (nodes, elements)
}

/// Two layers of hexes beside wedges, a roof of pyramids and tets on them: all eight ways of sharing a
/// face but that of two pyramids. Nodes are displaced, elements renumbered at random.
pub fn mixed(amplitude: f64, seed: u64) -> Scaffold {
    let mut noise = Noise::new(seed);
    let mut nodes = Vec::new();
    for z in 0..3 {
        for y in 0..3 {
            for x in 0..3 {
                nodes.push(Vec3::from([x, y, z].map(f64::from)) + noise.vector() * amplitude);
            }
        }
    }
    let at = |x: u32, y: u32, z: u32| (z * 3 + y) * 3 + x;
    let mut all: Vec<(Kind, Vec<u32>)> = Vec::new();
    for z in 0..2 {
        for y in 0..2 {
            let square = |x: u32, z: u32| {
                [
                    at(x, y, z),
                    at(x + 1, y, z),
                    at(x + 1, y + 1, z),
                    at(x, y + 1, z),
                ]
            };
            all.push((Kind::Hex8, [square(0, z), square(0, z + 1)].concat()));
            let halves = |z: u32| {
                let s = square(1, z);
                [[s[0], s[1], s[3]], [s[1], s[2], s[3]]]
            };
            for half in 0..2 {
                all.push((
                    Kind::Wedge6,
                    [halves(z)[half], halves(z + 1)[half]].concat(),
                ));
            }
        }
    }
    for y in 0..2 {
        let apex = nodes.len() as u32;
        nodes.push(Vec3::new(0.6, f64::from(y) + 0.5, 2.8) + noise.vector() * amplitude);
        let base = [at(0, y, 2), at(1, y, 2), at(1, y + 1, 2), at(0, y + 1, 2)];
        all.push((Kind::Pyramid5, [&base[..], &[apex]].concat()));
        // On the half of the wedges' square that has the pyramid's edge, and on the other one.
        all.push((
            Kind::Tet4,
            vec![at(1, y, 2), at(2, y, 2), at(1, y + 1, 2), apex],
        ));
        all.push((
            Kind::Tet4,
            vec![at(2, y, 2), at(2, y + 1, 2), at(1, y + 1, 2), apex],
        ));
    }
    let mut elements = Connectivity::default();
    for (kind, own) in all {
        let orders = renumberings(kind);
        let order = &orders[noise.below(orders.len())];
        elements.push(kind, &order.iter().map(|&i| own[i]).collect::<Vec<_>>());
    }
    let s = Scaffold::new(nodes, elements).unwrap();
    assert!(s.validate().unwrap().warnings().is_empty());
    s
}

/// The same mesh of elements of second order, `full` ones or those of serendipity: a node in the middle of
/// every edge (and of every quad and hex), displaced by up to half the amplitude.
pub fn elevated(linear: &Scaffold, full: bool, amplitude: f64, seed: u64) -> Scaffold {
    let mut noise = Noise::new(seed);
    let mut nodes = linear.nodes().to_vec();
    let mut made: BTreeMap<Vec<u32>, u32> = BTreeMap::new();
    let mut elements = Connectivity::default();
    for e in linear.elements() {
        let kind = match (e.shape(), full) {
            (Element::Tet, _) => Kind::Tet10,
            (Element::Wedge, true) => Kind::Wedge18,
            (Element::Wedge, false) => Kind::Wedge15,
            (Element::Pyramid, true) => Kind::Pyramid14,
            (Element::Pyramid, false) => Kind::Pyramid13,
            (_, true) => Kind::Hex27,
            (_, false) => Kind::Hex20,
        };
        let mut groups: Vec<Vec<u8>> = kind.edges().iter().map(|e| e.to_vec()).collect();
        let centred = kind.faces().iter().filter(|f| f.centre.is_some());
        groups.extend(centred.map(|f| f.corners.to_vec()));
        if kind == Kind::Hex27 {
            groups.push((0..8).collect());
        }
        let mut own = e.nodes().to_vec();
        for group in groups {
            let mut key: Vec<u32> = group.iter().map(|&c| e.nodes()[c as usize]).collect();
            key.sort_unstable();
            own.push(*made.entry(key.clone()).or_insert_with(|| {
                let sum: Vec3 = key.iter().map(|&n| linear.nodes()[n as usize]).sum();
                nodes.push(sum / key.len() as f64 + noise.vector() * amplitude / 2.0);
                nodes.len() as u32 - 1
            }));
        }
        elements.push(kind, &own);
    }
    Scaffold::new(nodes, elements).unwrap()
}
