//! Rules of `[require]`: ranges in order, and nothing that contradicts itself. Those of `section` hold for files of
//! requirements too, those of `with_recipe` for recipes alone.

use super::Checked;
use crate::recipe::op::Op;
use crate::recipe::operand::Operand;
use crate::recipe::quantity::Size;
use crate::recipe::require::RequireSection;
use crate::recipe::source::Source;
use crate::recipe::{ScaffoldSection, Sections};

/// Rules that hold in any file with the section. `length` gives a size in the unit of the file; `None` for voxels of no
/// known size.
pub(in crate::recipe) fn section(
    r: &RequireSection,
    length: impl Fn(Size) -> Option<f64>,
    source: &Source,
) -> Checked {
    let ranges = [
        ("volume_fraction", r.volume_fraction, 1.0),
        ("mass", r.mass, f64::INFINITY),
    ];
    for (name, range, most) in ranges {
        let Some([low, high]) = range else { continue };
        let key = format!("require.{name}");
        if !(low.is_finite() && high.is_finite() && low >= 0.0 && high <= most) {
            let expected = if most.is_finite() {
                "numbers from 0 to 1"
            } else {
                "numbers that are not negative"
            };
            let found = format!("{name} = [{low}, {high}]; expected two {expected}");
            return Err(source.fault(&key, found));
        }
        if low > high {
            return Err(source.fault(
                &key,
                format!("{name} = [{low}, {high}] holds no number; expected the least first"),
            ));
        }
    }
    match (r.mass, r.density) {
        (Some(_), None) => {
            return Err(source
                .fault(
                    "require.mass",
                    "mass needs density, in grams per cubic centimetre",
                )
                .hint(
                    "add density = 4.43 (Ti-6Al-4V), 2.70 (aluminium), 1.01 (PA12), 7.99 (316L)",
                ));
        }
        (None, Some(_)) => {
            return Err(source.fault("require.density", "density belongs to mass"));
        }
        _ => {}
    }
    if let Some(area) = r.overhang_area.filter(|a| !(a.is_finite() && *a >= 0.0)) {
        return Err(source.fault(
            "require.overhang_area",
            format!("overhang_area = {area}; expected a number that is not negative"),
        ));
    }
    if r.components == Some(0) {
        return Err(source.fault(
            "require.components",
            "components = 0; expected at least 1, since a solid has one",
        ));
    }
    if let (Some(wall), Some(fits)) = (r.least_wall, r.fits) {
        let sides = fits.iter().filter_map(|side| length(*side));
        let narrowest = sides.fold(f64::INFINITY, f64::min);
        if length(wall).is_some_and(|wall| wall > narrowest) {
            return Err(source.fault(
                "require.least_wall",
                format!("walls of {wall} do not fit into the box of require.fits"),
            ));
        }
    }
    Ok(())
}

/// Rules of `[require]` in a recipe: those of the section itself, and those that need the other sections.
pub(super) fn with_recipe(sections: &Sections, source: &Source) -> Checked {
    let Some(r) = &sections.require else {
        return Ok(());
    };
    let scale = sections.scale();
    section(r, |size| Some(size.resolve(scale)), source)?;
    if let Some(name) = r.of_builds().first()
        && sections.build.is_none()
    {
        return Err(source
            .fault(
                &format!("require.{name}"),
                format!("{name} needs a [build], whose layers it limits"),
            )
            .hint("add [build] with layer = \"0.05mm\""));
    }
    if r.value_jump_max.is_some() && sections.scaffold.is_none() {
        return Err(source.fault(
            "require.value_jump_max",
            "value_jump_max needs a [scaffold], whose elements share faces",
        ));
    }
    if r.volume_fraction.is_some() && !has_room(sections) {
        return Err(source
            .fault(
                "require.volume_fraction",
                "volume_fraction needs an envelope or a [scaffold], whose share it is",
            )
            .hint("intersect = { mesh = \"part.stl\" } in an [[op]] is an envelope"));
    }
    Ok(())
}

/// Whether the recipe has a volume that a fraction can relate to: a scaffold or an envelope.
fn has_room(sections: &Sections) -> bool {
    let envelope = |op: &Op| matches!(op, Op::Intersect(Operand::Mesh(_) | Operand::Crystal(_)));
    let scaffold: Option<&ScaffoldSection> = sections.scaffold.as_ref();
    scaffold.is_some() || sections.op.iter().any(envelope)
}
