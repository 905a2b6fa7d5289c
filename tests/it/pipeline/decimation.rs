//! Decimated meshes keep the topology of the whole ones, at any share.

use crate::strategy::Noise;
use druse::io::read_mesh;
use druse::mesh::TriMesh;
use druse::pipeline::{RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

const GRAPHS: [&str; 6] = ["octet", "bcc", "fcc", "kelvin", "diamond", "sc"];
const SHARES: [f64; 8] = [0.9, 0.6, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02];

/// What the triangles tell, by counts of this file's own.
#[derive(Debug, PartialEq)]
struct Topology {
    /// Directed edges that another triangle has too, or that none has the other way.
    bad_edges: usize,
    euler: i64,
    pieces: usize,
    repeated_triangles: usize,
    flat_triangles: usize,
    /// Neighbours that lie on each other.
    folds: usize,
}

fn find(parent: &mut [usize], mut v: usize) -> usize {
    while parent[v] != v {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    v
}

fn topology(mesh: &TriMesh) -> Topology {
    let mut number = HashMap::new();
    let mut at = |v: u32| {
        let key: [u64; 3] = mesh.vertices()[v as usize]
            .map(|c| (c + 0.0).to_bits())
            .into();
        let next = number.len();
        *number.entry(key).or_insert(next)
    };
    let triangles: Vec<[usize; 3]> = mesh.triangles().iter().map(|t| t.map(&mut at)).collect();
    let mut directed: HashMap<[usize; 2], Vec<usize>> = HashMap::new();
    let mut parent: Vec<usize> = (0..number.len()).collect();
    for (n, &[a, b, c]) in triangles.iter().enumerate() {
        for edge in [[a, b], [b, c], [c, a]] {
            directed.entry(edge).or_default().push(n);
            let [from, to] = edge.map(|v| find(&mut parent, v));
            parent[from] = to;
        }
    }
    let normal = |n: usize| {
        let [a, b, c] = mesh.corners(n);
        (b - a).cross(&(c - a))
    };
    let mut bad_edges = 0;
    let mut folds = 0;
    for (&[a, b], of) in &directed {
        let other = directed.get(&[b, a]);
        if of.len() != 1 || other.is_none() {
            bad_edges += 1;
        } else if let Some(other) = other.filter(|_| a < b) {
            let [m, n] = [of[0], other[0]].map(normal);
            folds += usize::from(m.dot(&n) < -0.99 * m.norm() * n.norm());
        }
    }
    let mut sets: Vec<[usize; 3]> = triangles.clone();
    for triangle in &mut sets {
        triangle.sort_unstable();
    }
    sets.sort_unstable();
    let repeated_triangles = sets.windows(2).filter(|p| p[0] == p[1]).count();
    let flat = |&n: &usize| {
        let [a, b, c] = mesh.corners(n);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        normal(n).norm() <= 1e-6 * longest * longest
    };
    let pieces = (0..parent.len()).filter(|&v| parent[v] == v).count();
    Topology {
        bad_edges,
        euler: number.len() as i64 - directed.len() as i64 / 2 + triangles.len() as i64,
        pieces,
        repeated_triangles,
        flat_triangles: (0..triangles.len()).filter(flat).count(),
        folds,
    }
}

fn meshes(text: &str, names: &[String], (bricks, threads): (Option<u32>, usize)) -> Vec<TriMesh> {
    let place = tempfile::tempdir().unwrap();
    let options = RunOptions {
        out: Some(place.path().to_owned()),
        brief: true,
        bricks,
        threads,
        ..RunOptions::default()
    };
    run(&Recipe::parse(text, &[]).unwrap(), &options, &Silent).unwrap();
    let read = |name: &String| read_mesh(place.path().join(Path::new(name))).unwrap().mesh;
    names.iter().map(read).collect()
}

/// A ball of struts of about three voxels, drawn by a seed; and outputs of all its triangles and of shares.
fn lattice(seed: u64) -> (String, Vec<String>) {
    let mut noise = Noise::new(seed);
    let graph = GRAPHS[noise.below(GRAPHS.len())];
    let thickness = 0.75 + 0.15 * noise.signed();
    let centre = noise.vector() * 0.5;
    let mut text = format!(
        "druse = 1\nunit = \"mm\"\n[cell.o]\nelement = \"hex\"\ngraph = \"{graph}\"\n\
         [scaffold]\nbox = {{ size = [8, 8, 8], cell_size = 4 }}\n\
         [tiling]\ncell = \"o\"\nthickness = {thickness}\n[band]\nvoxel_size = 0.25\n\
         [[op]]\nintersect = {{ sphere = {{ radius = 4.3, centre = [{}, {}, {}] }} }}\n\
         [[output]]\nmesh = \"all.ply\"\n",
        4.0 + centre.x,
        4.0 + centre.y,
        4.0 + centre.z
    );
    let mut names = vec!["all.ply".to_owned()];
    for (n, share) in SHARES.iter().enumerate() {
        let name = format!("{n}.ply");
        writeln!(text, "[[output]]\nmesh = \"{name}\"\ndecimate = {share}").unwrap();
        names.push(name);
    }
    (text, names)
}

#[test]
fn fewer_triangles_keep_the_topology_at_any_share() {
    let seeds = if crate::is_full() { 12 } else { 3 };
    for seed in 0..seeds {
        let (text, names) = lattice(seed);
        let made = meshes(&text, &names, (None, 2));
        let whole = topology(&made[0]);
        assert_eq!(whole.bad_edges, 0, "{seed}");
        for (few, share) in made[1..].iter().zip(SHARES) {
            let found = topology(few);
            let kept = Topology {
                bad_edges: 0,
                repeated_triangles: 0,
                flat_triangles: 0,
                // Thin remains of struts are folded before.
                folds: found.folds.min(whole.folds),
                ..found
            };
            assert_eq!(found, kept, "{seed} {share}: {text}");
            assert_eq!(
                [found.euler, found.pieces as i64],
                [whole.euler, whole.pieces as i64]
            );
            let of_all = few.triangles().len() as f64 / made[0].triangles().len() as f64;
            // As far as the topology and the shapes of triangles allow.
            assert!(
                of_all < share + 0.001 || share < 0.1,
                "{seed} {share}: {of_all}"
            );
            if share > 0.5 {
                let volume = few.volume() / made[0].volume();
                assert!((volume - 1.0).abs() < 0.04, "{seed} {share}: {volume}");
            }
        }
        if seed == 0 {
            assert!(made == meshes(&text, &names, (None, 1)), "one thread");
        }
    }
}

#[test]
fn fewer_triangles_keep_the_topology_across_blocks() {
    // Struts through the plane between two blocks of 128 voxels.
    let text = "druse = 1\nunit = \"mm\"\n[cell.o]\nelement = \"hex\"\ngraph = \"octet\"\n\
        [scaffold]\nbox = { size = [12, 4, 4], cell_size = 4, origin = [10, 10, 10] }\n\
        [tiling]\ncell = \"o\"\nthickness = 0.5\n[band]\nvoxel_size = 0.125\n\
        [[output]]\nmesh = \"all.ply\"\n[[output]]\nmesh = \"few.ply\"\ndecimate = 0.05\n\
        [[output]]\nmesh = \"quads.ply\"\nmesher = \"openvdb\"\ndecimate = 0.1\n";
    let names = ["all.ply", "few.ply", "quads.ply"].map(String::from);
    let made = meshes(text, &names, (Some(1), 2));
    let whole = topology(&made[0]);
    for few in &made[1..] {
        let found = topology(few);
        assert_eq!(
            found,
            Topology {
                bad_edges: 0,
                ..topology(few)
            }
        );
        assert_eq!(
            [found.repeated_triangles, found.flat_triangles, found.folds],
            [0; 3]
        );
        assert_eq!(
            [found.euler, found.pieces as i64],
            [whole.euler, whole.pieces as i64]
        );
        assert!(few.triangles().len() < made[0].triangles().len() / 4);
    }
}
