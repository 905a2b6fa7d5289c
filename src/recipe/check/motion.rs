//! Rules of scaffolds that move: which sources of motion exclude each other, and what each needs. Files are not
//! read here.

use super::Checked;
use crate::field::Formula;
use crate::recipe::source::Source;
use crate::recipe::{FillKind, FillScaffold, Sections};
use crate::sequence::Clock;

/// How an Alembic cache is converted.
const ABC_HINT: &str = "import it in Blender and export the points with the add-on Point Cache (.pc2), or write one file \
    per frame, as in file = \"bar.$F4.vtu\" (meshio writes .vtu)";

/// Whether the scaffold moves from frame to frame.
pub(super) fn moves(sections: &Sections, source: &Source) -> bool {
    let motion = sections.scaffold.as_ref().and_then(|s| s.motion.as_ref());
    motion.is_some_and(|m| m.points.is_some() || m.deform.is_some() || m.velocity.is_some())
        || source.template("scaffold.file").is_some()
}

/// Rules of `[scaffold.motion]`: which sources of motion go together, and with which scaffold.
pub(super) fn motion(sections: &Sections, source: &Source) -> Checked {
    let Some(scaffold) = &sections.scaffold else {
        return Ok(());
    };
    let is_alembic = |path: &std::path::Path| {
        let extension = path.extension();
        extension.is_some_and(|e| e.eq_ignore_ascii_case("abc"))
    };
    if scaffold.file.as_ref().is_some_and(|f| is_alembic(&f.path)) {
        let message = "found an Alembic file (.abc); expected a file of elements, such as .vtu";
        return Err(source.fault("scaffold.file", message).hint(ABC_HINT));
    }
    let Some(motion) = &scaffold.motion else {
        return Ok(());
    };
    let fault = |word: &str, message: String| {
        Err(source.fault(&format!("scaffold.motion.{word}"), message))
    };
    if let Some(points) = &motion.points {
        if is_alembic(&points.path) {
            let message = "found an Alembic file (.abc); expected a point cache (.pc2) or a USD layer (.usda)";
            let e = source.fault("scaffold.motion.points", message);
            return Err(e.hint(ABC_HINT));
        }
        let is_known = points
            .path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("pc2") || e.eq_ignore_ascii_case("usda"));
        if !is_known {
            let found = points.path.display();
            return fault(
                "points",
                format!("found {found}; expected a point cache (.pc2) or a USD layer (.usda)"),
            );
        }
        if scaffold.file.is_none() {
            return fault(
                "points",
                "points belong to the nodes of a scaffold.file".into(),
            );
        }
        if source.template("scaffold.file").is_some() {
            let message =
                "scaffold.file has a frame token and moves by itself; expected one of the two";
            return fault("points", message.into());
        }
    }
    if motion.velocity.is_some() && (motion.points.is_some() || motion.deform.is_some()) {
        let message = "velocity is a field at the nodes of scaffold.file; expected neither points nor deform with it";
        return fault("velocity", message.into());
    }
    if motion.displacement.is_some() && motion.points.is_some() {
        let message = "displacement and points both place the nodes; expected one of the two";
        return fault("displacement", message.into());
    }
    for (word, name) in [
        ("velocity", &motion.velocity),
        ("displacement", &motion.displacement),
    ] {
        if name.is_some() && scaffold.file.is_none() {
            return fault(word, format!("{word} is a point field of a scaffold.file"));
        }
    }
    let is_cut = |f: &FillScaffold| f.kind == FillKind::Hex;
    if motion.deform.is_some() && scaffold.fill.as_ref().is_some_and(is_cut) {
        let message = "the mesh that cuts the hexes of a fill does not move with them; expected kind = \"tet\"";
        return fault("deform", message.into());
    }
    let clock = Clock {
        frame: sections.frame,
        fps: sections.fps.0,
    };
    for (n, text) in motion.deform.iter().flatten().enumerate() {
        // A position, and the same relative to the scaffold's box (0 to 1).
        let names = ["x", "y", "z", "bx", "by", "bz"];
        if let Err(e) = Formula::with_constants(text, &names, &clock.constants()) {
            return fault(&format!("deform.{n}"), e.to_string());
        }
    }
    Ok(())
}
