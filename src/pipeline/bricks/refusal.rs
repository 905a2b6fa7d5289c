//! What a run in bricks cannot make: outputs that are whole in memory; and from what it cannot.

use super::super::inputs::Stock;
use crate::frame::Vec3;
use crate::recipe::OutputKind;

/// Why no `.nvdb` is streamed.
const NANO: &str =
    "a .nvdb is one buffer, whole in memory; write a .vdb, which nanovdb_convert makes one of";

/// Why a run cannot go through bricks, if it cannot.
pub(crate) fn refusal(stock: &Stock) -> Option<String> {
    let origin = stock.volumes.start().map(crate::vdb::LevelSet::origin);
    if let Some(o) = origin.filter(|o| *o != Vec3::zeros()) {
        return Some(format!(
            "the voxels of op.0.union stand off the multiples of their edge (voxel 0 is at {}, {}, {}), on \
             which bricks lie; leave out --bricks, or druse filter it with resample on a machine that holds it",
            o.x, o.y, o.z
        ));
    }
    let outputs = stock.recipe.sections().output.iter().enumerate();
    let mut refused = outputs.filter_map(|(n, output)| {
        let (kind, path) = output.named().first().copied()?;
        let is_vdb = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("vdb"));
        let is_whole = kind == OutputKind::Vdb && !is_vdb;
        is_whole.then(|| format!("output.{n}, {}: {NANO}", path.display()))
    });
    refused.next()
}
