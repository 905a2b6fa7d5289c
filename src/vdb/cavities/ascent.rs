//! Steepest ascent in one block: the local maximum that each voxel leads to, and where their basins meet.
//!
//! Voxels have a total order: falling distance, then ascending number. A voxel leads to the neighbour that is first
//! in this order, if that one is before it. All passes run over the voxels as they lie in memory; only maxima and
//! meetings of basins are sorted.

use super::distances::{BoxDistances, Row};

/// Parent or label of a voxel of the solid.
pub(super) const UNLABELLED: u32 = u32::MAX;

/// Two basins at neighbouring voxels.
pub(super) struct Meeting {
    /// Order of the later voxel; its low half is the number of the voxel.
    pub order: u64,
    /// Side of the later voxel at which the other one is: -x, x, -y, y, -z, z, and 6 for the rest of the block.
    pub side: u8,
    /// Basin of the later voxel, and of the other one.
    pub basins: [u32; 2],
}

/// The neighbour, or the voxel itself, that each voxel leads to; [`UNLABELLED`] in the solid.
pub(super) fn parents(space: &BoxDistances) -> Vec<u32> {
    let ([ex, ey, ez], values) = (space.edges, &space.values[..]);
    let mut parents = vec![UNLABELLED; values.len()];
    // The greatest distance so far in a row, and the number of its voxel.
    let (mut best, mut leads) = (vec![0f32; ez], vec![0u32; ez]);
    for x in 0..ex {
        for y in 0..ey {
            let line = (x * ey + y) * ez;
            let rows = &space.rows;
            match rows[x * ey + y] {
                Row::Solid => continue,
                // Equals before it lead.
                Row::Wide if x > 0 && rows[(x - 1) * ey + y] == Row::Wide => {
                    let before = (line - ey * ez) as u32..;
                    for (parent, lead) in parents[line..line + ez].iter_mut().zip(before) {
                        *parent = lead;
                    }
                    continue;
                }
                _ => {}
            }
            best.fill(-1.0);
            // In ascending number, since the first of equals leads.
            if x > 0 {
                raise(&mut best, &mut leads, values, line - ey * ez);
            }
            if y > 0 {
                raise(&mut best, &mut leads, values, line - ez);
            }
            raise(&mut best[1..], &mut leads[1..], values, line);
            raise(&mut best, &mut leads, values, line);
            raise(&mut best[..ez - 1], &mut leads[..ez - 1], values, line + 1);
            if y + 1 < ey {
                raise(&mut best, &mut leads, values, line + ez);
            }
            if x + 1 < ex {
                raise(&mut best, &mut leads, values, line + ey * ez);
            }
            let own = &values[line..line + ez];
            let row = &mut parents[line..line + ez];
            for ((parent, &lead), &value) in row.iter_mut().zip(&leads).zip(own) {
                *parent = if value >= 0.0 { lead } else { UNLABELLED };
            }
        }
    }
    parents
}

/// Raises the best values of a row to those of another that begins at voxel `first`, and notes which they are.
fn raise(best: &mut [f32], leads: &mut [u32], values: &[f32], first: usize) {
    let row = &values[first..first + best.len()];
    for (n, ((best, lead), &value)) in best.iter_mut().zip(leads).zip(row).enumerate() {
        let is_higher = value > *best;
        *best = if is_higher { value } else { *best };
        *lead = if is_higher { (first + n) as u32 } else { *lead };
    }
}

/// The voxels that lead to themselves, ascending.
pub(super) fn maxima(space: &BoxDistances, parents: &[u32]) -> Vec<u32> {
    let all = 0..space.values.len() as u32;
    all.filter(|&n| parents[n as usize] == n).collect()
}

/// The basin of each voxel: `first` for the first of the maxima, and so on; [`UNLABELLED`] in the solid.
pub(super) fn labels(parents: &[u32], maxima: &[u32], first: u32) -> Vec<u32> {
    let mut labels = vec![UNLABELLED; parents.len()];
    for (&n, label) in maxima.iter().zip(first..) {
        labels[n as usize] = label;
    }
    let mut path = Vec::new();
    for n in 0..parents.len() {
        if parents[n] == UNLABELLED {
            continue;
        }
        let mut at = n;
        while labels[at] == UNLABELLED {
            path.push(at);
            at = parents[at] as usize;
        }
        let label = labels[at];
        for voxel in path.drain(..) {
            labels[voxel] = label;
        }
    }
    labels
}

/// All meetings of different basins, in no order. The rest of the block, if there is any, is basin 0.
pub(super) fn meetings(space: &BoxDistances, labels: &[u32], has_rest: bool) -> Vec<Meeting> {
    let [ex, ey, ez] = space.edges;
    let mut found = Vec::new();
    for x in 0..ex {
        for y in 0..ey {
            let line = (x * ey + y) * ez;
            if x > 0 {
                meet(space, labels, (line, line - ey * ez, ez), 0, &mut found);
            }
            if y > 0 {
                meet(space, labels, (line, line - ez, ez), 2, &mut found);
            }
            meet(space, labels, (line + 1, line, ez - 1), 4, &mut found);
            let ends = if has_rest { ez } else { 0 };
            for z in 0..ends {
                let label = labels[line + z];
                if label != UNLABELLED && label != 0 && space.meets_rest([x, y, z]) {
                    found.push(Meeting {
                        order: space.order((line + z) as u32),
                        side: 6,
                        basins: [label, 0],
                    });
                }
            }
        }
    }
    found
}

/// Meetings between the voxels of a row and those before it along an axis; `side` is the lower one of the two.
fn meet(
    space: &BoxDistances,
    labels: &[u32],
    (own, before, count): (usize, usize, usize),
    side: u8,
    found: &mut Vec<Meeting>,
) {
    let rows = [own, before].map(|first| &labels[first..first + count]);
    if rows[0] == rows[1] {
        return;
    }
    for (n, (&a, &b)) in rows[0].iter().zip(rows[1]).enumerate() {
        if a == b || a == UNLABELLED || b == UNLABELLED {
            continue;
        }
        let orders = [own, before].map(|first| space.order((first + n) as u32));
        found.push(if orders[0] > orders[1] {
            Meeting {
                order: orders[0],
                side,
                basins: [a, b],
            }
        } else {
            Meeting {
                order: orders[1],
                side: side + 1,
                basins: [b, a],
            }
        });
    }
}
