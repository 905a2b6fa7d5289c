//! Cells that lack symmetries of the hex: which scaffolds they may fill, and that they are whole there.

use druse::cell::{Cell, Surface, Table};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, Distance, TiledSolid, TilingError, TilingOptions};

fn table(surface: Surface) -> Table {
    Table::new(&surface.cell(Element::Hex).unwrap()).unwrap()
}

const OPTIONS: TilingOptions = TilingOptions {
    voxel_size: 0.1,
    half_width: 0.3,
    distance: Distance::Fast,
    boundary: Boundary::Cut,
};

/// A box of 2 x 2 x 2 hexes, one numbered from another corner: turned about its z axis.
fn block(turned: Option<usize>) -> Scaffold {
    let block = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
    let mut elements = Connectivity::default();
    for e in 0..block.len() {
        let n = block.connectivity().nodes(e);
        let own = if turned == Some(e) {
            [1, 2, 3, 0, 5, 6, 7, 4].map(|i| n[i])
        } else {
            [0, 1, 2, 3, 4, 5, 6, 7].map(|i| n[i])
        };
        elements.push(Kind::Hex8, &own);
    }
    Scaffold::new(block.nodes().to_vec(), elements).unwrap()
}

#[test]
fn the_gyroid_fills_a_box_without_a_seam() {
    let (gyroid, scaffold) = (table(Surface::Gyroid), block(None));
    let solid = TiledSolid::new(&scaffold, &gyroid, OPTIONS).unwrap();
    for n in 0..200 {
        let (u, v) = (
            f64::from(n) * 0.618_034 % 1.0,
            f64::from(n) * 0.754_878 % 1.0,
        );
        let on_face = Vec3::new(2.0 * u, 2.0 * v, 1.0);
        let at = |z: f64| solid.sample(WorldPoint(on_face + Vec3::z() * z)).unwrap();
        let (below, above) = (at(-1e-7), at(1e-7));
        assert_ne!(below.element, above.element);
        assert!((below.phi - above.phi).abs() < 1e-5);
        // The wave goes on: even the gradient does.
        assert!((below.gradient - above.gradient).norm() < 0.05);
    }
}

#[test]
fn a_turned_element_is_named_unless_the_cell_is_the_same() {
    let gyroid = table(Surface::Gyroid);
    for e in 0..8 {
        let scaffold = block(Some(e));
        let Err(error) = TiledSolid::new(&scaffold, &gyroid, OPTIONS).map(|_| ()) else {
            panic!("element {e} is turned");
        };
        let TilingError::Discontinuity { elements, .. } = error else {
            panic!("{error}");
        };
        let number = scaffold.number(e);
        assert!(elements.contains(&number), "{elements:?}, not {number}");
        TiledSolid::new(&scaffold, &table(Surface::SchwarzP), OPTIONS).unwrap();
    }
}

#[test]
fn a_cell_without_cubic_symmetry_is_kept_out_of_tets() {
    let refused: Result<Cell, _> = Surface::Lidinoid.cell(Element::Tet);
    assert!(refused.unwrap_err().to_string().contains("box of hexes"));
}
