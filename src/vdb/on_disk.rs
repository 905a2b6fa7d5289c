//! Pieces of a solid that lies on the disk: counted, and removed, as in memory.
//!
//! Each block of 128^3 voxels is labelled for itself, by the parts of its leaves and the slots between
//! them; what hangs together in a block is one component. Components are joined over the faces of
//! blocks, slab by slab, and with the cubes without leaves around them, which are labelled by node of
//! 4096^3 voxels. In memory stay some bytes a component, and while pieces are chosen some a leaf.

use super::components::{NOWHERE, Ranking, Side, Tally};
use super::remove_components::{Dropped, Unwanted};
use super::{FileError, LevelSet, Piece, Session, VdbError};
use crate::band::{BLOCK, LeafStore, Region, StoreError};
use crate::frame::Coord;
use crate::progress::Cancelled;
use crate::union_find::Sets;
use rayon::prelude::*;
use std::collections::BTreeMap;

mod empty_space;
mod labels;
mod removal;
mod segments;

pub use segments::StoredSegments;

use empty_space::{Beyond, Empty};
use labels::{Faces, Labels, label};
use removal::Chosen;

/// Numbered pieces of a store.
struct StoredPieces {
    ranking: Ranking,
    /// Labels of each block, where they are kept, and its first component.
    blocks: BTreeMap<Coord, (usize, Labels)>,
}

impl StoredPieces {
    fn find(
        store: &LeafStore,
        side: Side,
        voxel_size: f64,
        keep: bool,
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let progress = session.progress;
        progress.stage("pieces", Some(store.blocks().count() as u64));
        let mut sets = Sets::new(1);
        // Member 0 is the endless outside.
        let endless = (side == Side::Void).then_some(0);
        let mut tallies = vec![Tally {
            place: endless.map(|_| NOWHERE),
            ..Tally::default()
        }];
        let empty = Empty::new(store, side, &mut sets, &mut tallies);
        let mut blocks = BTreeMap::new();
        // Faces towards greater x of the slab before.
        let mut before: BTreeMap<Coord, (usize, Faces)> = BTreeMap::new();
        let origins: Vec<Coord> = store.blocks().collect();
        for slab in origins.chunk_by(|a, b| a[0] == b[0]) {
            let labelled = session.threads.install(|| {
                let found = slab.par_iter().map(|&origin| {
                    if progress.cancelled() {
                        return Err(StoreError::from(Cancelled));
                    }
                    progress.advance(1);
                    Ok(label(store, origin, side)?)
                });
                found.collect::<Result<Vec<_>, StoreError>>()
            })?;
            let mut here: BTreeMap<Coord, (usize, Faces)> = BTreeMap::new();
            for (&origin, block) in slab.iter().zip(labelled) {
                let first = sets.extend(block.tallies.len());
                tallies.extend(block.tallies);
                if keep {
                    blocks.insert(origin, (first, block.labels));
                }
                let own = (first, block.faces);
                for axis in 0..3 {
                    for last in [false, true] {
                        let beside = step(origin, axis, last, BLOCK);
                        if store.inside_slots(beside).is_none() {
                            if let Beyond::Member(other) = empty.at(beside) {
                                for item in own.1.of(axis, last) {
                                    sets.join(first + item.component as usize, other);
                                }
                            }
                        } else if !last {
                            // Blocks before this one are here already.
                            let row = if axis == 0 { &before } else { &here };
                            if let Some((other_first, other)) = row.get(&beside) {
                                own.1.join(axis, other, |mine, theirs| {
                                    sets.join(first + mine, other_first + theirs);
                                });
                            }
                        }
                    }
                }
                here.insert(origin, own);
            }
            before = here;
        }
        Ok(Self {
            ranking: Ranking::new(&tallies, &mut sets, endless, voxel_size),
            blocks,
        })
    }
}

/// The cube of `edge` voxels beside another.
fn step(origin: Coord, axis: usize, last: bool, edge: i32) -> Coord {
    let mut beside = origin;
    beside.0[axis] += if last { edge } else { -edge };
    beside
}

/// The connected pieces of a solid on the disk, largest first, as [`LevelSet::components`] has them.
///
/// # Errors
/// A leaf file that has changed, or cancelling.
pub fn stored_components(
    store: &LeafStore,
    voxel_size: f64,
    session: Session<'_>,
) -> Result<Vec<Piece>, FileError> {
    let found = StoredPieces::find(store, Side::Solid, voxel_size, false, session)?;
    Ok(found.ranking.counted())
}

/// The cavities of a solid on the disk, largest first, as [`LevelSet::voids`] has them.
///
/// # Errors
/// A leaf file that has changed, or cancelling.
pub fn stored_voids(
    store: &LeafStore,
    voxel_size: f64,
    session: Session<'_>,
) -> Result<Vec<Piece>, FileError> {
    let found = StoredPieces::find(store, Side::Void, voxel_size, false, session)?;
    Ok(found.ranking.counted())
}

/// Pieces of a solid on the disk that are to be removed, brick by brick.
pub struct StoredRemoval {
    chosen: Chosen,
    dropped: Dropped,
}

impl StoredRemoval {
    /// Finds what is to be removed, as [`LevelSet::remove`] does.
    ///
    /// # Errors
    /// A leaf file that has changed, or cancelling.
    pub fn choose(
        store: &LeafStore,
        unwanted: Unwanted,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, FileError> {
        let side = unwanted.side();
        let found = StoredPieces::find(store, side, voxel_size, true, session)?;
        let (goes, dropped) = unwanted.choose(&found.ranking);
        let mut chosen = Chosen::new(side);
        for &block in found.blocks.keys() {
            chosen.enter(&found, block, |piece| goes.get(piece) == Some(&true));
        }
        Ok(Self { chosen, dropped })
    }

    /// How much is removed.
    pub fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// Whether anything that is removed comes near a region.
    pub fn meets(&self, region: Region) -> bool {
        let mut blocks = self.chosen.blocks.iter();
        blocks.any(|&block| region.meets(block, BLOCK))
    }

    /// Removes it from a part of the solid whose voxel (0, 0, 0) is `first` of the whole. The part must
    /// reach [`REMOVAL_REACH`](super::REMOVAL_REACH) half widths of the band farther than what is used
    /// of it; only its band is right afterwards, not the signs beyond.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn apply(
        &self,
        part: &mut LevelSet,
        first: Coord,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        self.chosen.remove(part, first, session)
    }
}
