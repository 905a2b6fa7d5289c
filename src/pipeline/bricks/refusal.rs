//! Runs that cannot use bricks: outputs that must be whole in memory, and inputs off the voxel lattice.

use crate::frame::Vec3;
use crate::pipeline::content::inputs::Inputs;
use crate::recipe::OutputKind;

/// Why a `.nvdb` cannot be streamed.
const NANOVDB_REASON: &str =
    "a .nvdb is a single buffer in memory; write a .vdb, which nanovdb_convert converts";

/// Why a run cannot be divided into bricks, as a sentence for the user; `None` if it can.
pub(crate) fn bricks_refusal(inputs: &Inputs) -> Option<String> {
    let origin = inputs.volumes.start().map(crate::vdb::LevelSet::origin);
    if let Some(o) = origin.filter(|o| *o != Vec3::zeros()) {
        return Some(format!(
            "the voxels of op.0.union are not at multiples of their edge (voxel 0 is at {}, {}, {}), as \
             bricks require; leave out --bricks, or apply druse filter with resample on a machine with enough memory",
            o.x, o.y, o.z
        ));
    }
    let outputs = inputs.recipe.sections().output.iter().enumerate();
    let mut refused = outputs.filter_map(|(n, output)| {
        let (kind, path) = output.named().first().copied()?;
        let is_vdb = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("vdb"));
        let is_nanovdb = kind == OutputKind::Vdb && !is_vdb;
        is_nanovdb.then(|| format!("output.{n}, {}: {NANOVDB_REASON}", path.display()))
    });
    refused.next()
}
