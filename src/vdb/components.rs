//! Connected components of the solid, and of the space around it.
//!
//! Two voxels are connected if they share a face and are both inside. Bodies are counted as the mesher sees them: a
//! distance that is only the rounding of 0 is outside. Removals and voids go by the sign alone. Leaves are split into
//! parts by bit operations; parts and tiles are then united over faces. Solids are counted, not surfaces: a hollow
//! sphere is one component with one void. A component that is nowhere deeper than a thousandth of a voxel is rounding
//! and does not count.

use super::error::VdbError;
use super::ffi::TileChoice;
use super::index::{FACES, Holder, LeafIndex};
use super::leaves::LeafView;
use super::{LevelSet, Session};
use crate::frame::Coord;
use crate::mesher::inside_below;
use crate::progress::Cancelled;
use crate::simd::bits_below;
use crate::union_find::UnionFind;
use druse_solids::voxel_mask;
use druse_solids::voxel_mask::Bits;
use rayon::prelude::*;
use std::cmp::Reverse;

/// A connected component of the solid, or a void in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// Number of voxels.
    pub voxels: u64,
    /// Volume of the voxels, world units cubed.
    pub volume: f64,
    /// Distance of the deepest voxel from the surface, world units; at most the half width of the band.
    pub depth: f64,
    /// First voxel, in order (x, y, z) of leaves, then of voxels.
    pub place: Coord,
}

/// The side of the surface whose components are found.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Distance < 0, but for rounding.
    Solid,
    /// All others, including tiles and the unbounded outside.
    Void,
}

impl Side {
    /// The tiles to list for it: for the void all, even those inside.
    pub fn tiles(self) -> TileChoice {
        match self {
            Self::Solid => TileChoice::Solid,
            Self::Void => TileChoice::All,
        }
    }
}

/// Least depth of a component, voxels.
const MIN_DEPTH: f64 = 1e-3;
/// First voxel of the unbounded outside.
pub(super) const UNBOUNDED_PLACE: Coord = Coord([i32::MIN; 3]);

/// A connected part of a leaf.
pub(super) struct Part {
    pub bits: Bits,
    /// Greatest distance of a voxel from the surface, world units.
    depth: f32,
}

impl Part {
    /// The connected parts of a leaf on a side; inside are values below a threshold. `threshold` is in world units. The
    /// depth of a part is the greatest distance in it, world units.
    pub fn all_of(leaf: &LeafView<'_>, side: Side, threshold: f32) -> Vec<Self> {
        let negative = bits_below(leaf.values, threshold);
        let set = match side {
            Side::Solid => negative,
            Side::Void => negative.map(|w| !w),
        };
        let parts = voxel_mask::parts(set);
        let deeper = |d: f32, v: f32| if v > d { v } else { d };
        let depth = |part: &Bits| {
            if *part == set {
                // A single part: one pass over the leaf suffices.
                let sign = if side == Side::Solid { -1.0 } else { 1.0 };
                return leaf.greatest(sign);
            }
            let mut depth = 0.0;
            for (&word, row) in part.iter().zip(leaf.values.chunks_exact(64)) {
                let mut rest = word;
                while rest != 0 {
                    depth = deeper(depth, row[rest.trailing_zeros() as usize].abs());
                    rest &= rest - 1;
                }
            }
            depth
        };
        parts
            .into_iter()
            .map(|bits| Self {
                depth: depth(&bits),
                bits,
            })
            .collect()
    }
}

/// Statistics of a part, a tile or a set of them.
#[derive(Clone, Copy, Default)]
pub(super) struct ComponentStats {
    pub voxels: u64,
    /// Greatest distance from the surface, world units.
    pub depth: f32,
    /// First voxel in order of leaves, then of voxels; the least voxel of a tile. None on the other side.
    pub place: Option<Coord>,
}

impl ComponentStats {
    /// Statistics of a part of a leaf.
    pub fn of_part(part: &Part, leaf: &LeafView<'_>) -> Self {
        let x = part.bits.iter().position(|&w| w != 0).unwrap_or(0);
        let first = 64 * x + part.bits[x].trailing_zeros() as usize;
        Self {
            voxels: voxel_mask::count(&part.bits),
            depth: part.depth,
            place: Some(leaf.voxel(first)),
        }
    }

    /// Statistics of a cube without leaves.
    pub fn of_cube(origin: Coord, edge: i32, value: f32) -> Self {
        Self {
            voxels: (edge as u64).pow(3),
            depth: value.abs(),
            place: Some(origin),
        }
    }

    /// Adds the statistics of another part of the component. The place becomes the one whose leaf comes first, whatever
    /// the order of the sums.
    pub fn add(&mut self, other: Self) {
        let first = |place: Option<Coord>| place.map(|p| (p.aligned(8), p));
        self.voxels += other.voxels;
        self.depth = self.depth.max(other.depth);
        self.place = match (first(self.place), first(other.place)) {
            (Some(a), Some(b)) => Some(a.min(b).1),
            (a, b) => a.or(b).map(|p| p.1),
        };
    }
}

/// Components in order of size.
pub(super) struct Ranking {
    /// Component of each member of the sets; `usize::MAX` for members on the other side.
    pub component_of: Vec<usize>,
    /// The components, largest first, equal ones in order of place; those that are only rounding follow after
    /// the first `count`.
    pub list: Vec<Component>,
    /// Number of components that are more than rounding.
    pub count: usize,
    /// The component of the unbounded outside (voids only).
    pub unbounded: Option<usize>,
}

impl Ranking {
    /// Ranks sets whose members have these statistics. `unbounded` is the member of the unbounded outside. Sets without
    /// a place, those of the other side, are no components.
    pub fn new(
        stats: &[ComponentStats],
        sets: &mut UnionFind,
        unbounded: Option<usize>,
        voxel_size: f64,
    ) -> Self {
        let mut whole = vec![ComponentStats::default(); stats.len()];
        for (n, member) in stats.iter().enumerate() {
            whole[sets.find(n)].add(*member);
        }
        let unbounded_root = unbounded.map(|n| sets.find(n));
        if let Some(root) = unbounded_root {
            // The unbounded outside is never rounding.
            whole[root].depth = f32::INFINITY;
        }
        let is_deep = |root: usize| f64::from(whole[root].depth) >= MIN_DEPTH * voxel_size;
        let mut order: Vec<(Coord, usize)> = (0..whole.len())
            .filter_map(|root| Some((whole[root].place?, root)))
            .collect();
        // Rounding last, then largest first; equal ones by place, so that numbers do not depend on the order of
        // uniting.
        order.sort_by_key(|&(place, root)| (!is_deep(root), Reverse(whole[root].voxels), place));
        let mut number = vec![usize::MAX; whole.len()];
        for (component, &(_, root)) in order.iter().enumerate() {
            number[root] = component;
        }
        Self {
            component_of: (0..whole.len()).map(|n| number[sets.find(n)]).collect(),
            unbounded: unbounded_root.map(|root| number[root]),
            count: order.iter().filter(|(_, root)| is_deep(*root)).count(),
            list: order
                .into_iter()
                .map(|(place, root)| Component {
                    voxels: whole[root].voxels,
                    volume: whole[root].voxels as f64 * voxel_size.powi(3),
                    depth: whole[root].depth.into(),
                    place,
                })
                .collect(),
        }
    }

    /// The components without rounding and the unbounded outside.
    pub fn counted(mut self) -> Vec<Component> {
        self.list.truncate(self.count);
        if let Some(outside) = self.unbounded {
            self.list.remove(outside);
        }
        self.list
    }
}

/// The parts of all leaves, and the components of parts, tiles and the outside.
pub(super) struct Components {
    /// For each leaf the number of its first part, and its parts.
    pub parts: Vec<(usize, Vec<Part>)>,
    /// Number of the first tile among the members of the ranking, which are all parts, all tiles and the
    /// unbounded outside.
    pub first_tile: usize,
    pub ranking: Ranking,
}

impl Components {
    /// The components by the sign alone, as removals need them.
    pub fn find(
        index: &LeafIndex<'_>,
        side: Side,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, Cancelled> {
        Self::below(index, side, voxel_size, 0.0, session)
    }

    /// The bodies of the solid as the mesher sees them, to be counted.
    pub fn bodies(
        index: &LeafIndex<'_>,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, Cancelled> {
        let threshold = inside_below(voxel_size);
        Self::below(index, Side::Solid, voxel_size, threshold, session)
    }

    /// The components of one side. Inside are values below `threshold`; both it and `voxel_size` are in world units.
    /// Members of the sets are the parts of all leaves, then the tiles, then the unbounded outside.
    fn below(
        index: &LeafIndex<'_>,
        side: Side,
        voxel_size: f64,
        threshold: f32,
        session: Session<'_>,
    ) -> Result<Self, Cancelled> {
        let progress = session.progress;
        let lists: Vec<Vec<Part>> = session.threads.install(|| {
            let leaves = index.leaves.par_iter();
            leaves
                .map(|leaf| {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    Ok(Part::all_of(leaf, side, threshold))
                })
                .collect::<Result<_, _>>()
        })?;
        // Each list with the number of its first part among all parts.
        let mut parts = Vec::with_capacity(lists.len());
        let mut first_tile = 0;
        for list in lists {
            let first = first_tile;
            first_tile += list.len();
            parts.push((first, list));
        }
        let outside = first_tile + index.tiles.len();
        let mut sets = UnionFind::new(outside + 1);
        join_leaves(index, &parts, side, first_tile, &mut sets);
        join_tiles(index, side, first_tile, &mut sets);
        let mut stats = Vec::with_capacity(outside + 1);
        for (leaf, (_, list)) in index.leaves.iter().zip(&parts) {
            stats.extend(list.iter().map(|part| ComponentStats::of_part(part, leaf)));
        }
        // Tiles on the other side keep empty statistics, and so have no rank.
        stats.extend(index.tiles.iter().map(|tile| {
            let stats = is_on_side(tile.value, side)
                .then(|| ComponentStats::of_cube(tile.origin, tile.edge, tile.value));
            stats.unwrap_or_default()
        }));
        let unbounded = (side == Side::Void).then_some(outside);
        stats.push(ComponentStats {
            place: unbounded.map(|_| UNBOUNDED_PLACE),
            ..ComponentStats::default()
        });
        let ranking = Ranking::new(&stats, &mut sets, unbounded, voxel_size);
        Ok(Self {
            parts,
            first_tile,
            ranking,
        })
    }

    /// The voxels of a leaf that belong to selected components.
    pub fn selected_in(&self, leaf: usize, is_selected: &[bool]) -> Bits {
        self.voxels_in(leaf, |component| is_selected[component])
    }

    /// The voxels of a leaf that belong to any other component.
    pub fn others_in(&self, leaf: usize, component: usize) -> Bits {
        self.voxels_in(leaf, |other| other != component)
    }

    fn voxels_in(&self, leaf: usize, is_selected: impl Fn(usize) -> bool) -> Bits {
        let (first, list) = &self.parts[leaf];
        let mut out = [0; 8];
        for (n, part) in list.iter().enumerate() {
            if is_selected(self.ranking.component_of[first + n]) {
                voxel_mask::add(&mut out, &part.bits);
            }
        }
        out
    }

    /// For each component that is more than rounding, the ascending numbers of the leaves with parts of it.
    pub fn leaves_by_component(&self) -> Vec<Vec<usize>> {
        let mut all = vec![Vec::new(); self.ranking.count];
        for (leaf, (first, list)) in self.parts.iter().enumerate() {
            let own = first + list.len();
            for &component in &self.ranking.component_of[*first..own] {
                if let Some(leaves) = all.get_mut(component)
                    && leaves.last() != Some(&leaf)
                {
                    leaves.push(leaf);
                }
            }
        }
        all
    }
}

/// Whether a tile value is on a side.
fn is_on_side(value: f32, side: Side) -> bool {
    (value < 0.0) == (side == Side::Solid)
}

/// Joins the parts of leaves with those of the next leaves, with tiles on all sides, and, for the void, with the
/// outside. `parts` holds for each leaf the member of its first part and the parts; `first_tile` is the member of the
/// first tile.
fn join_leaves(
    index: &LeafIndex<'_>,
    parts: &[(usize, Vec<Part>)],
    side: Side,
    first_tile: usize,
    sets: &mut UnionFind,
) {
    let outside = first_tile + index.tiles.len();
    for (leaf, (first, list)) in index.leaves.iter().zip(parts) {
        for (f, step) in FACES.iter().enumerate() {
            let (axis, last) = (f / 2, f % 2 == 1);
            let beside = leaf.origin.offset(8 * step[0], 8 * step[1], 8 * step[2]);
            let here = list
                .iter()
                .map(|part| voxel_mask::face(&part.bits, axis, last));
            match index.holder(beside) {
                Holder::Leaf(other) if last => {
                    let (other_first, others) = &parts[other];
                    for (n, mine) in here.enumerate() {
                        for (m, part) in others.iter().enumerate() {
                            if voxel_mask::intersects(
                                &mine,
                                &voxel_mask::face(&part.bits, axis, false),
                            ) {
                                sets.union(first + n, other_first + m);
                            }
                        }
                    }
                }
                Holder::Leaf(_) => {} // joined from the other leaf
                // The other side: nothing to join.
                Holder::Tile(tile) if !is_on_side(index.tiles[tile].value, side) => {}
                Holder::Background if side == Side::Solid => {}
                Holder::Tile(_) | Holder::Background => {
                    let target = match index.holder(beside) {
                        Holder::Tile(tile) => first_tile + tile,
                        _ => outside,
                    };
                    for (n, mine) in here.enumerate() {
                        if !voxel_mask::is_empty(&mine) {
                            sets.union(first + n, target);
                        }
                    }
                }
            }
        }
    }
}

/// Joins tiles with neighbouring tiles of the same size or larger; smaller tiles find larger ones.
fn join_tiles(index: &LeafIndex<'_>, side: Side, first_tile: usize, sets: &mut UnionFind) {
    let outside = first_tile + index.tiles.len();
    for (n, tile) in index.tiles.iter().enumerate() {
        if !is_on_side(tile.value, side) {
            continue;
        }
        for step in FACES {
            let [x, y, z] = step.map(|s| s * tile.edge);
            match index.holder(tile.origin.offset(x, y, z)) {
                Holder::Tile(other) => {
                    let other_tile = index.tiles[other];
                    if other_tile.edge >= tile.edge && is_on_side(other_tile.value, side) {
                        sets.union(first_tile + n, first_tile + other);
                    }
                }
                // Finer nodes beside the tile find it. The first voxel beside it is in no node only if
                // there is none along the whole face.
                Holder::Background if side == Side::Void => sets.union(first_tile + n, outside),
                Holder::Background | Holder::Leaf(_) => {}
            }
        }
    }
}

impl LevelSet {
    /// The connected components of the solid, largest first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn components(&self, session: Session<'_>) -> Result<Vec<Component>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
        Ok(Components::bodies(&index, self.voxel_size(), session)?
            .ranking
            .counted())
    }

    /// The voids, largest first: components of empty space that the solid encloses, by the sign alone.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn voids(&self, session: Session<'_>) -> Result<Vec<Component>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, TileChoice::All)?;
        Ok(
            Components::find(&index, Side::Void, self.voxel_size(), session)?
                .ranking
                .counted(),
        )
    }
}
