//! Rules between the keys and sections of a recipe.
//!
//! Most rules of a single key are in its type, and are checked when it is read. The rules here compare keys (exactly
//! one of several, none without another, names that exist) and refuse a few values. They read no file but the
//! recipe; what depends on the contents of files is checked by the run. An error has the place of a key, what was
//! found and what is expected.

use super::error::{RecipeError, nearest};
use super::op::Op;
use super::operand::Operand;
use super::quantity::{Length, Width};
use super::source::Source;
use super::{
    CellSection, FileRef, FillKind, ScaffoldSection, Sections, Solid, TilingSection, VERSION,
};
use crate::frame::{LengthUnit, Transform};

/// Maximum number of cells that one tiling blends.
const MAX_CELLS: usize = 8;

mod motion;
mod output;
mod require;

pub(super) use require::section as requirements;

/// `Err` is the first rule that the recipe breaks.
type Checked = Result<(), RecipeError>;

/// Checks the version, and all rules between the keys and sections of a recipe, in the order of its sections, so that
/// the first error is the one to mend first.
pub(super) fn check(sections: &Sections, source: &Source) -> Checked {
    if sections.druse != VERSION {
        let found = sections.druse;
        return Err(source
            .fault(
                "druse",
                format!("recipe version {found}, expected {VERSION}"),
            )
            .hint("this program reads recipes that begin with druse = 1"));
    }
    cells(sections, source)?;
    super::crystal::check(sections, source)?;
    scaffold(sections, source)?;
    motion::motion(sections, source)?;
    // Lengths in voxels refer to this key.
    if let Length::Voxels(_) = sections.band.voxel_size.0 {
        return Err(source.fault(
            "band.voxel_size",
            "a voxel cannot be measured in voxels; expected a length",
        ));
    }
    large_enough(sections, sections.unit.0, "band.voxel_size", source)?;
    for (n, op) in sections.op.iter().enumerate() {
        operation(op, &format!("op.{n}"), source)?;
        if let Some(Operand::Cell(single)) = op.operand() {
            let key = format!("op.{n}.{}.cell.name", op.name());
            known_cell(&single.name, &key, sections, source)?;
        }
        if *op == Op::Fog(true) && n + 1 < sections.op.len() {
            return Err(source.fault(
                &format!("op.{n}.fog"),
                "nothing can be done to a fog volume; expected fog to be the last operation",
            ));
        }
    }
    if let Some((key, message)) = sections.build.and_then(|b| b.fault()) {
        return Err(source.fault(&format!("build.{key}"), message));
    }
    start(sections, source)?;
    output::outputs(sections, source)?;
    require::with_recipe(sections, source)
}

/// Rules of `[cell.NAME]`: one source, at most one rule for its level, and references to other
/// cells.
fn cells(sections: &Sections, source: &Source) -> Checked {
    for (name, cell) in &sections.cell {
        let key = format!("cell.{name}");
        let given = cell.sources();
        if given.len() != 1 {
            let found = list(&given);
            return Err(source.fault(
                &key,
                format!(
                    "{key} needs exactly one source of mesh, points, voxels, surface, formula, graph, \
                     plates, crystal, file, target, average, union, intersection, difference, minkowski_sum, \
                     minkowski_difference; found {found}"
                ),
            ));
        }
        parts(sections, cell, &key, source)?;
        let levels = cell.levels();
        if levels.len() > 1 {
            let found = list(&levels);
            return Err(source.fault(
                &format!("{key}.{}", levels[1]),
                format!("{key} takes one of level, volume_fraction, thickness; found {found}"),
            ));
        }
        // The grading of a tiling gives a level too.
        let graded = sections
            .tiling
            .as_ref()
            .is_some_and(|t| t.is_graded() && t.cells().contains(&name.as_str()));
        if cell.solid == Some(Solid::Sheet) && levels.is_empty() && !graded {
            return Err(source
                .fault(
                    &format!("{key}.solid"),
                    "a sheet needs its thickness, volume_fraction or level (half its thickness in field units)",
                )
                .hint("[tiling] thickness = 0.9 gives all sheets a thickness in the recipe's unit"));
        }
    }
    super::target::check(&sections.cell).map_err(|(name, key, reason)| {
        let key = format!("cell.{name}.{key}");
        source.fault(&key, format!("{key}: {reason}"))
    })?;
    super::hybrid::check(&sections.cell).map_err(|(name, reason)| {
        let key = format!("cell.{name}");
        source.fault(&key, format!("{key}: {reason}"))
    })
}

/// Rules of keys that describe struts or plates, or hold a formula. `key` is the cell's place, as in `cell.strut`.
fn parts(sections: &Sections, cell: &CellSection, key: &str, source: &Source) -> Checked {
    // Files of struts may hold plates as well.
    let is_strut_file = |f: &Option<FileRef>| {
        f.as_ref().is_some_and(|f| {
            let extension = f.path.extension().and_then(|e| e.to_str()).unwrap_or("");
            matches!(
                extension.to_ascii_lowercase().as_str(),
                "toml" | "json" | "3mf"
            )
        })
    };
    let mixed = is_strut_file(&cell.graph) || is_strut_file(&cell.plates);
    if cell.radius.is_some() && cell.graph.is_none() && !mixed {
        return Err(source.fault(
            &format!("{key}.radius"),
            "radius belongs to a cell with graph, whose struts it is for",
        ));
    }
    if cell.plate_thickness.is_some() && cell.plates.is_none() && !mixed {
        return Err(source.fault(
            &format!("{key}.plate_thickness"),
            "plate_thickness belongs to a cell with plates",
        ));
    }
    if let Some(text) = &cell.formula {
        let clock = crate::sequence::Clock {
            frame: sections.frame,
            fps: sections.fps.0,
        };
        crate::field::Formula::with_constants(text, &["x", "y", "z"], &clock.constants())
            .map_err(|e| source.fault(&format!("{key}.formula"), e.to_string()))?;
    }
    Ok(())
}

/// Rules of `[scaffold]` and `[tiling]`, which go together: one source, and cells that exist.
fn scaffold(sections: &Sections, source: &Source) -> Checked {
    match (&sections.scaffold, &sections.tiling) {
        (None, None) => Ok(()),
        (None, Some(_)) => Err(source.fault(
            "tiling",
            "[tiling] needs a [scaffold] whose elements it fills",
        )),
        (Some(_), None) => Err(source
            .fault(
                "scaffold",
                "[scaffold] needs a [tiling] that names the cell which fills it",
            )
            .hint("add [tiling] with cell = \"NAME\"")),
        (Some(scaffold), Some(tiling)) => {
            let given = scaffold.sources();
            if given.len() != 1 {
                let found = list(&given);
                return Err(source.fault(
                    "scaffold",
                    format!(
                        "[scaffold] needs exactly one of file, box, cylinder, sphere, fill, crystal; found {found}"
                    ),
                ));
            }
            scaffold_keys(scaffold, source)?;
            tiling_keys(tiling, source)?;
            let key = if tiling.cell.is_some() {
                "tiling.cell"
            } else {
                "tiling"
            };
            for name in tiling.cells() {
                known_cell(name, key, sections, source)?;
                let cell = &sections.cell[name];
                // Fitted cells round their corners by the band limit, not by a radius.
                if cell.fillet.is_some() && !cell.is_round(tiling) {
                    return Err(source
                        .fault(
                            &format!("cell.{name}.fillet"),
                            "fillet rounds the corners of round struts, which this cell is not made of",
                        )
                        .hint("section = \"round\" makes the struts of a graph round"));
                }
            }
            Ok(())
        }
    }
}

/// Rules of `[tiling]`: one way to choose cells, at most `MAX_CELLS` of them, and at most one graded quantity.
fn tiling_keys(tiling: &TilingSection, source: &Source) -> Checked {
    let mut given = Vec::new();
    given.extend(tiling.cell.iter().map(|_| "cell"));
    given.extend((!tiling.transition.is_empty()).then_some("transition"));
    given.extend((!tiling.assign.is_empty()).then_some("assign"));
    if given.len() != 1 {
        let found = list(&given);
        return Err(source.fault(
            "tiling",
            format!("[tiling] needs exactly one of cell, transition, assign; found {found}"),
        ));
    }
    // Each place stores the weights of all cells.
    if tiling.cells().len() > MAX_CELLS {
        return Err(source.fault(
            "tiling",
            format!(
                "{} cells in one tiling; expected at most {MAX_CELLS}",
                tiling.cells().len()
            ),
        ));
    }
    let graded = [
        ("level", &tiling.level),
        ("volume_fraction", &tiling.volume_fraction),
        ("thickness", &tiling.thickness),
    ];
    let graded: Vec<&str> = graded
        .iter()
        .filter(|g| g.1.is_some())
        .map(|g| g.0)
        .collect();
    if graded.len() > 1 {
        let found = list(&graded);
        return Err(source.fault(
            &format!("tiling.{}", graded[1]),
            format!("[tiling] takes one of level, volume_fraction, thickness; found {found}"),
        ));
    }
    Ok(())
}

/// Refuses a name that no cell of the recipe has; `key` is the key that gives the name.
fn known_cell(name: &str, key: &str, sections: &Sections, source: &Source) -> Checked {
    if sections.cell.contains_key(name) {
        return Ok(());
    }
    let known: Vec<&String> = sections.cell.keys().collect();
    let error = source.fault(
        key,
        format!("no cell is named {name:?}; the recipe has {}", list(&known)),
    );
    Err(match nearest(name, &known) {
        Some(word) => error.hint(format!("did you mean \"{word}\"?")),
        None => error,
    })
}

/// Rules of `[scaffold]`. Its lengths must not be in voxels, because the scaffold must not change
/// with their size.
fn scaffold_keys(scaffold: &ScaffoldSection, source: &Source) -> Checked {
    // Each length with the key that an error names.
    let mut lengths: Vec<(&str, Length)> = Vec::new();
    if let Some(block) = &scaffold.block {
        let sizes = block.size.iter().chain([&block.cell_size]);
        lengths.extend(sizes.map(|s| ("scaffold.box", s.0)));
    }
    if let Some(c) = &scaffold.cylinder {
        let sizes = [c.radius, c.height, c.cell_size]
            .into_iter()
            .chain(c.inner_radius);
        lengths.extend(sizes.map(|s| ("scaffold.cylinder", s.0)));
    }
    if let Some(c) = &scaffold.sphere {
        lengths.extend([c.radius, c.cell_size].map(|s| ("scaffold.sphere", s.0)));
    }
    lengths.extend(
        scaffold
            .fill
            .iter()
            .map(|f| ("scaffold.fill", f.cell_size.0)),
    );
    lengths.extend(
        scaffold
            .shell
            .iter()
            .map(|s| ("scaffold.shell", s.thickness.0)),
    );
    lengths.extend(
        scaffold
            .plate
            .iter()
            .map(|s| ("scaffold.plate", s.height.0)),
    );
    for (key, length) in lengths {
        no_voxels(length, key, source)?;
    }
    if let Some(size) = scaffold.cell_size {
        no_voxels(size.0, "scaffold.cell_size", source)?;
    }
    // A CAD part has no elements yet: they need a size.
    let is_cad = scaffold
        .file
        .as_ref()
        .is_some_and(|f| super::is_cad(&f.path));
    if is_cad && scaffold.cell_size.is_none() {
        return Err(source.fault(
            "scaffold.file",
            "a CAD part needs the edge of its tets: expected cell_size = ... beside file",
        ));
    }
    let fill = scaffold.fill.as_ref();
    if fill.is_some_and(|f| f.order.is_some() && f.kind == FillKind::Hex) {
        return Err(source.fault(
            "scaffold.fill.order",
            "hexes that the mesh cuts are straight; expected kind = \"tet\" beside order",
        ));
    }
    if !is_cad && (scaffold.cell_size.is_some() || scaffold.order.is_some()) {
        return Err(source.fault(
            "scaffold",
            "cell_size and order here belong to a CAD part: expected file = \"part.step\" beside them \
             (box, cylinder, sphere and fill have their own)",
        ));
    }
    let surface = scaffold.file.is_some() || scaffold.crystal.is_some();
    if !surface && (scaffold.shell.is_some() || scaffold.plate.is_some()) {
        return Err(source.fault(
            "scaffold",
            "shell and plate belong to a surface: expected file or crystal beside them",
        ));
    }
    if scaffold.all_quad && scaffold.shell.is_none() && scaffold.plate.is_none() {
        return Err(source.fault(
            "scaffold.all_quad",
            "all_quad cuts the triangles and quads of a surface; expected shell or plate beside it \
             (all_hex cuts solids)",
        ));
    }
    if scaffold.crystal.is_some() && scaffold.shell.is_none() {
        return Err(source
            .fault(
                "scaffold.crystal",
                "a crystal is a surface; expected its thickness: shell = { thickness = ... }",
            )
            .hint("fill = { crystal = NAME, cell_size = ... } fills its inside"));
    }
    if scaffold.shell.is_some() && scaffold.plate.is_some() {
        return Err(source.fault(
            "scaffold.plate",
            "expected one of shell and plate; found both",
        ));
    }
    // Each step divides every element into eight: 6 make 262 144 parts of each.
    if scaffold.refine > 6 {
        return Err(source.fault(
            "scaffold.refine",
            format!(
                "refine = {}: 8^{0} parts of every element; expected at most 6",
                scaffold.refine
            ),
        ));
    }
    Ok(())
}

/// Refuses a length in voxels; `key` is its place.
fn no_voxels(length: Length, key: &str, source: &Source) -> Checked {
    match length {
        Length::Voxels(_) => Err(source.fault(
            key,
            format!("{length}: a scaffold is measured in units of length, not in voxels"),
        )),
        _ => Ok(()),
    }
}

/// Rules of one operation of its own keys; `key` is its place, as in `op.2`. Names of cells are checked by the caller,
/// the files of masks by the run.
fn operation(op: &Op, key: &str, source: &Source) -> Checked {
    if let Some(Operand::Plane(plane)) = op.operand()
        && plane.normal.iter().all(|c| c.0 == 0.0)
    {
        let key = format!("{key}.{}", op.name());
        return Err(source.fault(&key, "the plane's normal is 0; expected a direction"));
    }
    // A masked move varies its distance by the mask. An opening is two moves; the recipe writes masked ones one by one.
    if let (Op::Open(_) | Op::Close(_), Some(_)) = (op, op.mask()) {
        return Err(source
            .fault(
                &format!("{key}.{}", op.name()),
                format!("{} takes no mask", op.name()),
            )
            .hint("mask its two halves, dilate and erode"));
    }
    if let Some(range) = op.mask().map(|m| m.range)
        && range[1].0 <= range[0].0
    {
        return Err(source.fault(
            &format!("{key}.{}", op.name()),
            format!(
                "the mask's range goes from {} to {}; expected it to ascend",
                range[0], range[1]
            ),
        ));
    }
    if let Op::Drain(drain) = op {
        if drain.toward.is_some_and(|t| t.iter().all(|c| c.0 == 0.0)) {
            return Err(source.fault(
                &format!("{key}.drain"),
                "the direction toward has length 0; expected a direction such as [0, 0, -1]",
            ));
        }
        if drain.at_most == Some(0) {
            return Err(source.fault(
                &format!("{key}.drain"),
                "at_most = 0 admits no channel; expected at least 1",
            ));
        }
    }
    if let Op::Gaussian(k) | Op::Mean(k) | Op::Median(k) = op {
        let Width(width) = k.width;
        // A bare width counts voxels, so that only one with a unit of length is left out here: it becomes a number
        // of voxels with the voxel size of its step, where the filter refuses it. 64 voxels are the greatest width
        // of a filter.
        if width.number() > 64.0 && !matches!(width, Length::In(..)) {
            return Err(source.fault(
                &format!("{key}.{}", op.name()),
                format!("a kernel of {width} voxels; expected at most 64"),
            ));
        }
    }
    Ok(())
}

/// Without a scaffold the solid is empty at first, so that the first operation must be a union.
fn start(sections: &Sections, source: &Source) -> Checked {
    if sections.scaffold.is_some() {
        return Ok(());
    }
    match sections.op.first() {
        Some(Op::Union(_)) => Ok(()),
        Some(op) => Err(source
            .fault(
                "op.0",
                format!("without a [scaffold] there is nothing to {} yet", op.name()),
            )
            .hint("start with a [scaffold] and [tiling], or with union = { ... }")),
        None => Err(RecipeError::invalid(
            source.path.as_deref(),
            "the recipe makes no solid: expected a [scaffold] with [tiling], or an [[op]] with union",
        )),
    }
}

/// Refuses voxels that OpenVDB cannot hold in this unit: `key` is the key that an error names.
fn large_enough(sections: &Sections, unit: LengthUnit, key: &str, source: &Source) -> Checked {
    let own = sections.unit.0;
    let voxel = sections.scale().voxel_size * own.to(unit);
    if voxel >= Transform::MIN_VOXEL_SIZE {
        return Ok(());
    }
    let found = format!(
        "a voxel of {voxel:e} {unit}; OpenVDB holds none under {:e}",
        Transform::MIN_VOXEL_SIZE
    );
    Err(source
        .fault(key, found)
        .hint("write a smaller unit, as in unit = \"mm\" beside the output and for the recipe"))
}

/// Words for a message, separated by commas; "none" without any.
fn list<S: AsRef<str>>(words: &[S]) -> String {
    match words {
        [] => "none".to_owned(),
        _ => words
            .iter()
            .map(AsRef::as_ref)
            .collect::<Vec<_>>()
            .join(", "),
    }
}
