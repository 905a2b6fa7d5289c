//! What a run in bricks cannot make: outputs that are whole in memory; and from what it cannot.

use super::super::stock::Stock;
use crate::frame::Vec3;
use crate::recipe::{GridWord, Output, OutputKind};
use std::path::Path;

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
        let why = match kind {
            OutputKind::Mesh => of_mesh(output),
            OutputKind::Vdb => of_volume(output, path),
            OutputKind::Picture | OutputKind::Report => None,
        };
        Some(format!("output.{n}, {}: {}", path.display(), why?))
    });
    refused.next()
}

/// What both kinds of files may not hold.
const THICKNESS: &str = "\"thickness\" is that of the widest ball wherever it touches, which no part of the \
    solid tells; leave it out, or write it with coarser voxels";

fn wants_thickness(o: &Output) -> bool {
    let words = o.grids.as_deref().unwrap_or_default();
    words.contains(&GridWord::Thickness)
}

/// Why a mesh is not streamed, if it is not.
fn of_mesh(o: &Output) -> Option<&'static str> {
    if o.is_meshed_by_openvdb() {
        return Some(
            "quads, sharp, adaptivity and mesher = \"openvdb\" are OpenVDB's, whose meshes are whole in \
             memory; leave them out for triangles, or druse mesh the written .vdb on a machine that holds it",
        );
    }
    if o.decimate.is_some() {
        return Some(
            "decimate merges triangles wherever they are, which takes the whole mesh; leave it out and \
             decimate the written mesh on a machine that holds it",
        );
    }
    wants_thickness(o).then_some(THICKNESS)
}

/// Why a volume is not streamed, if it is not.
fn of_volume(o: &Output, path: &Path) -> Option<&'static str> {
    if path
        .extension()
        .is_none_or(|e| !e.eq_ignore_ascii_case("vdb"))
    {
        return Some(
            "a .nvdb is one buffer, whole in memory; write a .vdb, which nanovdb_convert makes one of",
        );
    }
    wants_thickness(o).then_some(THICKNESS)
}

#[cfg(test)]
mod tests {
    use crate::band::Band;
    use crate::field::Sphere;
    use crate::frame::{Aabb, Transform, Vec3};
    use crate::pipeline::{RunError, RunOptions, run};
    use crate::progress::{Silent, Threads};
    use crate::recipe::Recipe;
    use crate::vdb::{LevelSetBuilder, Session, VdbWriter};

    #[test]
    fn a_level_set_between_the_voxels_of_bricks_is_refused_and_run_in_memory() {
        let threads = Threads::new(1).unwrap();
        let session = Session::new(&threads, &Silent);
        let transform = Transform::new(0.5).unwrap();
        let builder = LevelSetBuilder::new(transform, 3.0).unwrap();
        let ball = Sphere {
            centre: Vec3::zeros(),
            radius: 4.0,
        };
        let band = Band {
            field: &ball,
            transform,
            half_width: 3.0,
            extent: Aabb::of([ball.centre]).dilated(ball.radius),
        };
        band.evaluate(&threads, &Silent, &builder).unwrap();
        let mut solid = builder.finish(session).unwrap();
        solid.place_at(Vec3::new(0.1, 0.0, 0.0)).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.vdb");
        let mut file = VdbWriter::new(&path, session).unwrap();
        file.level_set("surface", &solid).unwrap();
        file.write().unwrap();
        let text = format!(
            "druse = 1\nunit = \"m\"\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = {{ vdb = {{ path = \"{}\" }} }}\n",
            path.display()
        );
        let recipe = Recipe::parse(&text, &[]).unwrap();
        let made = |bricks| {
            let options = RunOptions {
                bricks,
                brief: true,
                out: Some(directory.path().to_owned()),
                ..RunOptions::default()
            };
            run(&recipe, &options, &Silent)
        };
        let error = made(Some(1)).unwrap_err();
        assert!(matches!(error, RunError::Whole { .. }), "{error}");
        assert!(error.to_string().contains("0.1, 0, 0"), "{error}");
        let report = made(None).unwrap();
        assert_eq!(report.band.active_voxels, solid.active_voxels().unwrap());
    }
}
