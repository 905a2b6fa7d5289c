//! What point location and inverse maps cost beside the cell itself.
//!
//! `cargo bench --bench scaffolds`, for some kinds `cargo bench --bench scaffolds -- Tet10 Hex20`: for each
//! kind of element, nanoseconds per evaluated voxel of leaves of a tiling over bent elements; of leaves in
//! the midst of one straight element, whose distances are found by the same rule without inverse maps,
//! owners and neighbours; and of the cell's table alone, called again for the values and gradients that
//! the tiling needed, at the same points. The scaffold is to cost at most 3 times the straight
//! element; its ratio to the look-ups alone is shown beside it. Processor time, rounds in turn, medians.

use druse::cell::{Surface, Table};
use druse::field::{Field, Interval, SampleLattice};
use druse::frame::{CellBox, CellPoint, Element, Mat3, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, CellField, Distance, TiledSolid, TilingOptions};
use std::hint::black_box;
use std::sync::Mutex;

/// A block of one kind, its nodes bent, so that maps of all but Tet4 are curved.
fn block(kind: Kind) -> Scaffold {
    let linear = match kind.shape() {
        Element::Tet => Kind::Tet4,
        _ => Kind::Hex8,
    };
    let grid = Scaffold::box_grid(Vec3::repeat(4.0), [4, 4, 4], linear).unwrap();
    let bent = |p: Vec3| {
        let (s, c) = ((p * 0.8).map(f64::sin), (p * 0.6).map(f64::cos));
        p + Vec3::new(s.y * c.z, s.z * c.x, s.x * c.y) * 0.2
    };
    let mut nodes: Vec<Vec3> = Vec::new();
    let mut elements = Connectivity::default();
    let mut known: std::collections::HashMap<[i64; 3], u32> = std::collections::HashMap::new();
    for e in grid.elements() {
        let own: Vec<u32> = kind
            .reference_nodes()
            .into_iter()
            .map(|xi| {
                let p = e.map(xi).0;
                let name = [p.x, p.y, p.z].map(|c| (c * 64.0).round() as i64);
                *known.entry(name).or_insert_with(|| {
                    nodes.push(bent(p));
                    nodes.len() as u32 - 1
                })
            })
            .collect();
        elements.push(kind, &own);
    }
    Scaffold::new(nodes, elements).unwrap()
}

/// A call from a tiling to its cell.
enum Query {
    Value(CellPoint<3>),
    Slope(CellPoint<3>),
    Values(Vec<CellPoint<3>>),
    Slopes(Vec<CellPoint<3>>),
}

/// A table that records its calls.
struct Noted<'a> {
    table: &'a Table,
    queries: Mutex<Vec<Query>>,
}

impl Noted<'_> {
    fn note(&self, question: Query) {
        self.queries.lock().unwrap().push(question);
    }
}

impl Field for Noted<'_> {
    type Point = CellPoint<3>;
    fn value(&self, p: CellPoint<3>) -> f64 {
        self.note(Query::Value(p));
        Field::value(self.table, p)
    }
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        self.note(Query::Slope(p));
        Field::value_and_gradient(self.table, p)
    }
    fn bound(&self, region: &CellBox<3>) -> Interval {
        Field::bound(self.table, region)
    }
}

impl CellField for Noted<'_> {
    fn element(&self) -> Element {
        CellField::element(self.table)
    }
    fn fits_any_numbering(&self) -> bool {
        CellField::fits_any_numbering(self.table)
    }
    fn gradient_sup(&self) -> f64 {
        CellField::gradient_sup(self.table)
    }
    fn gradient_rms(&self) -> f64 {
        CellField::gradient_rms(self.table)
    }
    fn values(&self, points: &[CellPoint<3>], out: &mut [f64]) {
        self.note(Query::Values(points.to_vec()));
        CellField::values(self.table, points, out);
    }
    fn values_and_gradients(&self, points: &[CellPoint<3>], out: &mut [(f64, Vec3)]) {
        self.note(Query::Slopes(points.to_vec()));
        CellField::values_and_gradients(self.table, points, out);
    }
}

/// One straight element, turned so that no axis of it is one of the world's, and leaves in its midst.
fn alone(shape: Element, h: f64) -> (Scaffold, Vec<SampleLattice<WorldPoint>>) {
    let kind = if shape == Element::Tet {
        Kind::Tet4
    } else {
        Kind::Hex8
    };
    let turn = Mat3::new(0.8, -0.6, 0.0, 0.48, 0.64, -0.6, 0.36, 0.48, 0.8);
    let nodes: Vec<Vec3> = kind
        .reference_nodes()
        .into_iter()
        .map(|xi| turn * xi.0 + Vec3::repeat(1.0))
        .collect();
    let mut elements = Connectivity::default();
    let own: Vec<u32> = (0..nodes.len() as u32).collect();
    elements.push(kind, &own);
    let scaffold = Scaffold::new(nodes, elements).unwrap();
    let middle = scaffold.bounds().centre().0.add_scalar(-3.5 * h);
    let leaves: Vec<_> = (0..4096u32)
        .map(|i| [i % 16, i / 16 % 16, i / 256].map(|n| f64::from(n) - 8.0))
        .map(|i| middle + Vec3::from(i) * (8.0 * h))
        .filter(|corner| {
            (0..8).all(|n| {
                let end = Vec3::from([n & 1, n >> 1 & 1, n >> 2].map(f64::from)) * (7.0 * h);
                let xi = scaffold
                    .element(0)
                    .inverse(WorldPoint(corner + end))
                    .unwrap();
                shape.face_distance(xi) < -6.0 * h
            })
        })
        .map(|corner| leaf(corner, h))
        .collect();
    // So deep that the element's own faces do not show, as those of the bent scaffold do not.
    assert!(!leaves.is_empty());
    (scaffold, leaves)
}

fn leaf(corner: Vec3, h: f64) -> SampleLattice<WorldPoint> {
    SampleLattice {
        origin: WorldPoint(corner),
        step: h,
        counts: [8, 8, 8],
    }
}

/// Rounds of each measurement.
const ROUNDS: usize = 7;
/// What the ratio is to be at most.
const MAX_RATIO: f64 = 3.0;

/// Seconds of processor time that this process has used.
fn processor_seconds() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_unstable_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

fn main() {
    println!("nanoseconds per evaluated voxel");
    println!(
        "kind    bent scaffold  one straight element  ratio          look-ups only  ratio  evaluated per active"
    );
    let named: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let is_wanted = |k: &Kind| named.is_empty() || named.iter().any(|n| n == k.name());
    let solids = Kind::solids().filter(|k| matches!(k.shape(), Element::Tet | Element::Hex));
    for kind in solids.filter(is_wanted) {
        let scaffold = block(kind);
        assert!(kind == Kind::Tet4 || scaffold.elements().any(|e| !e.is_affine()));
        let surface = if kind.shape() == Element::Tet {
            Surface::Diamond
        } else {
            Surface::Neovius
        };
        let table = Table::new(&surface.cell(kind.shape()).unwrap()).unwrap();
        let noted = Noted {
            table: &table,
            queries: Mutex::default(),
        };
        let h = 0.02;
        let options = TilingOptions {
            voxel_size: h,
            half_width: 3.0 * h,
            distance: Distance::Fast,
            boundary: Boundary::Cut,
        };
        let tiled = TiledSolid::new(&scaffold, &table, options).unwrap();
        let leaves: Vec<SampleLattice<WorldPoint>> = (0..1000u32)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(f64::from))
            .map(|i| leaf((Vec3::from(i) * (16.0 * h)).add_scalar(0.6), h))
            .collect();
        let (straight, inner) = alone(kind.shape(), h);
        let single = TiledSolid::new(&straight, &table, options).unwrap();
        let (mut looked, mut active) = (0u64, 0usize);
        let mut out = vec![0f32; 512];
        let noting = TiledSolid::new(&scaffold, &noted, options).unwrap();
        noted.queries.lock().unwrap().clear();
        for leaf in &leaves {
            looked += noting.fill_counting(leaf, &mut out);
            active += out.iter().filter(|v| v.abs() < (3.0 * h) as f32).count();
        }
        let queries = noted.queries.lock().unwrap();
        let (mut values, mut slopes) = (vec![0.0; 512], vec![(0.0, Vec3::zeros()); 512]);
        let evaluated: u64 = inner
            .iter()
            .map(|l| single.fill_counting(l, &mut out))
            .sum();
        let rounds = looked.div_ceil(evaluated);
        let (mut whole, mut pure, mut cell) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            let start = processor_seconds();
            for leaf in &leaves {
                tiled.fill(leaf, &mut out);
                black_box(&out);
            }
            let middle = processor_seconds();
            for leaf in (0..rounds).flat_map(|_| &inner) {
                single.fill(leaf, &mut out);
                black_box(&out);
            }
            let between = processor_seconds();
            for question in &*queries {
                match question {
                    Query::Value(p) => values[0] = Field::value(&table, *p),
                    Query::Slope(p) => slopes[0] = Field::value_and_gradient(&table, *p),
                    Query::Values(p) => CellField::values(&table, p, &mut values[..p.len()]),
                    Query::Slopes(p) => {
                        CellField::values_and_gradients(&table, p, &mut slopes[..p.len()]);
                    }
                }
                black_box((&values, &slopes));
            }
            whole.push((middle - start) / looked as f64);
            pure.push((between - middle) / (rounds * evaluated) as f64);
            cell.push((processor_seconds() - between) / looked as f64);
        }
        let ratio = |to: &[f64]| median(whole.iter().zip(to).map(|(a, b)| a / b).collect());
        let (by_rule, by_table) = (ratio(&pure), ratio(&cell));
        println!(
            "{:6} {:15.1} {:21.1} {:6.2} {:8} {:13.1} {by_table:6.2} {:23.2}",
            kind.name(),
            median(whole) * 1e9,
            median(pure) * 1e9,
            by_rule,
            if by_rule <= MAX_RATIO {
                "met"
            } else {
                "not met"
            },
            median(cell) * 1e9,
            looked as f64 / active as f64,
        );
    }
}
