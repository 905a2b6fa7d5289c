//! Meshes filled with tets: what the tets leave of the mesh, and whether they form as few components as it has.
//! The tets themselves are made by `Scaffold::filled`.

use crate::frame::{Vec3, place_figures};
use crate::mesh::{MeshSolid, TriMesh, mesh_components};
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::warning::Warning;
use crate::progress::{CancelOnly, Cancelled, Progress};
use crate::scaffold::{ElementMap, FillOptions, Filled, Scaffold, ScaffoldError};
use rayon::prelude::*;

/// Distance of the mesh from the tets, in cells, and share of the volume that are worth a warning.
const WORTH_A_WARNING: f64 = 0.1;
const MAX_VOLUME_ERROR: f64 = 0.005;
/// Quality (that of `druse scaffold info`) below which tets are named: a mean ratio of 0.1, to the power 3/2.
pub(super) const POOR: f64 = 0.0316;
/// Quality from which down tets are refused: a mean ratio of 0.01, likewise.
const MIN_QUALITY: f64 = 0.001;
/// Quality of tets that count as flat: no rounding is larger.
const NO_VOLUME: f64 = 1e-7;
/// Chordal error at which outer faces are compared with the mesh, cells.
const CHORDAL_ERROR: f64 = 0.01;
/// Shares of the cell that are tried where the tets fall apart.
const SMALLER: [f64; 2] = [0.5, 0.25];
/// Most tets of such a trial: the error is not to take many times as long as the filling.
const MAX_TRIED_TETS: f64 = 2e5;

/// A scaffold, and warnings on where it leaves the mesh.
pub(crate) struct TetFilling {
    pub scaffold: Scaffold,
    pub warnings: Vec<String>,
}

impl TetFilling {
    /// Warning code of all its warnings.
    pub const CODE: &'static str = Warning::FILLING;

    /// Fills a mesh with tets of the edge in `options`, recipe units. Lists what they leave of the mesh as
    /// warnings.
    ///
    /// # Errors
    /// [`RunError::Scaffold`] where no tets can be made, they form more components than the mesh has, or some are far
    /// too thin; [`RunError::Cancelled`].
    pub fn new(
        solid: &MeshSolid,
        options: FillOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let filled = Scaffold::filled(solid, options, progress).map_err(fault)?;
        let (found, expected) = (filled.scaffold.components().len(), component_count(solid));
        if found > expected {
            let tets = filled.scaffold.len();
            let message = torn(solid, options, tets, found, expected, progress);
            if progress.cancelled() {
                return Err(Cancelled.into());
            }
            return Err(bad(message));
        }
        let folded = Tets::worse_than(&filled.scaffold, NO_VOLUME);
        if folded.count > 0 {
            return Err(bad(format!(
                "{} tets have no volume, the first at ({}): the mesh crosses or touches itself there, or is open; \
                 mend it (its warnings name places), or fill it with kind = \"hex\", which the mesh cuts",
                folded.count,
                place_figures(folded.place)
            )));
        }
        if let Some(message) = refused(&filled.scaffold) {
            let advice = advice(solid, options, &filled.scaffold, progress, |s| {
                refused(s).is_none()
            });
            if progress.cancelled() {
                return Err(Cancelled.into());
            }
            return Err(bad(format!(
                "{message}; {advice}, or fill it with kind = \"hex\", which the mesh cuts"
            )));
        }
        let warnings = warnings(solid, &filled, options, progress).map_err(fault)?;
        Ok(Self {
            scaffold: filled.scaffold,
            warnings,
        })
    }

    /// Warnings on the tets of a part of CAD of this volume; 0 is none.
    ///
    /// # Errors
    /// What is wrong where some are far too thin.
    pub fn of_cad(scaffold: &Scaffold, part: f64) -> Result<Vec<String>, String> {
        let advice = "; a smaller or larger cell_size may help";
        if let Some(message) = refused(scaffold) {
            return Err(format!(
                "{message}{advice}, or an STL file of the part in fill, with kind = \"hex\""
            ));
        }
        let own = volume(scaffold);
        let is_off = part > 0.0 && (own / part - 1.0).abs() > MAX_VOLUME_ERROR;
        let off = is_off.then(|| {
            format!(
                "scaffold: the volume of the tets is {}, that of the part {}; a smaller cell_size follows it closer, and \
                 curved tets do (order = 2)",
                short_number(own),
                short_number(part)
            )
        });
        let thin = thin(scaffold).map(|m| m + advice);
        Ok(thin.into_iter().chain(off).collect())
    }
}

/// A warning on the thin tets of a scaffold, without advice.
fn thin(scaffold: &Scaffold) -> Option<String> {
    let thin = Tets::worse_than(scaffold, POOR);
    (thin.count > 0).then(|| {
        format!(
            "scaffold: {} tets are thin, the worst of quality {} at ({})",
            thin.count,
            short_number(thin.quality),
            place_figures(thin.place)
        )
    })
}

/// An error on the tets of a scaffold that are too thin for solvers and cells, without advice.
fn refused(scaffold: &Scaffold) -> Option<String> {
    let found = Tets::worse_than(scaffold, MIN_QUALITY);
    (found.count > 0).then(|| {
        let worst = if found.quality < 0.0 {
            "inside out".to_owned()
        } else {
            format!("of quality {}", short_number(found.quality))
        };
        format!(
            "found {} tets that are too thin, the worst {worst} at ({}); expected more than {MIN_QUALITY}",
            found.count,
            place_figures(found.place)
        )
    })
}

/// The least quality of a scaffold's tets.
pub(super) fn worst_quality(scaffold: &Scaffold) -> f64 {
    Tets::worse_than(scaffold, f64::INFINITY).quality
}

/// The elements whose quality is `limit` or less, with it; that of an element inside out counts as -1.
pub(super) fn poor_elements(scaffold: &Scaffold, limit: f64) -> Vec<(usize, f64)> {
    // The quality of an element that is wholly inside out is positive.
    let quality = |e: ElementMap<'_>| match e.volume() {
        v if v > 0.0 => e.quality(),
        _ => -1.0,
    };
    let all = scaffold.elements().map(quality).enumerate();
    all.filter(|e| e.1 <= limit).collect()
}

/// Tets of at most some quality, and the first of the worst ones.
struct Tets {
    count: usize,
    quality: f64,
    place: Vec3,
}

impl Tets {
    /// The tets whose quality is `limit` or less; that of a tet inside out counts as -1.
    fn worse_than(scaffold: &Scaffold, limit: f64) -> Self {
        let none = Self {
            count: 0,
            quality: f64::INFINITY,
            place: Vec3::zeros(),
        };
        let bad = poor_elements(scaffold, limit).into_iter();
        bad.fold(none, |found, (n, quality)| {
            let place = || {
                let corners = &scaffold.connectivity().nodes(n)[..4];
                let corners = corners.iter().map(|&c| scaffold.nodes()[c as usize]);
                corners.sum::<Vec3>() / 4.0
            };
            let is_worst = quality < found.quality;
            Self {
                count: found.count + 1,
                quality: found.quality.min(quality),
                place: if is_worst { place() } else { found.place },
            }
        })
    }
}

fn bad(message: String) -> RunError {
    RunError::Scaffold {
        file: None,
        element: None,
        message,
    }
}

fn fault(error: ScaffoldError) -> RunError {
    match error {
        ScaffoldError::Cancelled(c) => c.into(),
        e => bad(e.to_string()),
    }
}

/// Number of a mesh's components; overlapping ones are one solid in the end, so it is an upper bound.
fn component_count(solid: &MeshSolid) -> usize {
    mesh_components(&solid.mesh().merged()).0.len().max(1)
}

/// The error on tets that fall apart into `found` components where the mesh has `expected`. It names
/// a cell size with which they do not, if one of a few helps. `tets` is the number of tets so far.
fn torn(
    solid: &MeshSolid,
    options: FillOptions,
    tets: usize,
    found: usize,
    expected: usize,
    progress: &dyn Progress,
) -> String {
    // Otherwise the finer trial was left out for its cost.
    let has_tried_all = tets as f64 / SMALLER[1].powi(3) < MAX_TRIED_TETS;
    let is_whole = |s: &Scaffold| s.components().len() <= expected;
    let smaller = helping_cell(solid, options, tets, progress, is_whole);
    let hint = match smaller {
        Some(cell) => format!("cell_size = {} keeps it together", short_number(cell)),
        None if has_tried_all => {
            "a quarter of cell_size does not help: do its parts meet in edges or points alone?"
                .into()
        }
        None => "a smaller cell_size may keep it together".to_owned(),
    };
    format!("the tets form {found} components, the mesh {expected}; {hint}")
}

/// What helps against bad tets.
fn advice(
    solid: &MeshSolid,
    options: FillOptions,
    scaffold: &Scaffold,
    progress: &dyn Progress,
    is_good: impl Fn(&Scaffold) -> bool,
) -> String {
    match helping_cell(solid, options, scaffold.len(), progress, is_good) {
        Some(cell) => format!("cell_size = {} has none", short_number(cell)),
        None => "a smaller or larger cell_size may help".to_owned(),
    }
}

/// The largest of a few smaller cells whose filling is good; none beyond a cost.
fn helping_cell(
    solid: &MeshSolid,
    options: FillOptions,
    tets: usize,
    progress: &dyn Progress,
    is_good: impl Fn(&Scaffold) -> bool,
) -> Option<f64> {
    progress.stage("smaller", None);
    let mut tried = SMALLER
        .into_iter()
        .take_while(|s| tets as f64 / s.powi(3) < MAX_TRIED_TETS);
    tried.find_map(|s| {
        let cell = s * options.cell;
        let options = FillOptions { cell, ..options };
        let filled = Scaffold::filled(solid, options, &CancelOnly(progress));
        filled.is_ok_and(|f| is_good(&f.scaffold)).then_some(cell)
    })
}

/// The faces of all components as one mesh.
pub(crate) fn outer_mesh(scaffold: &Scaffold, error: f64) -> Result<TriMesh, ScaffoldError> {
    let mut whole = TriMesh::default();
    for n in 0..scaffold.components().len() {
        let boundary = scaffold.boundary(n, error).mesh;
        whole
            .append(&boundary)
            .map_err(|_| ScaffoldError::TooMany {
                found: whole.vertices().len(),
                limit: u32::MAX as usize - 1,
                what: "vertices of outer faces",
            })?;
    }
    Ok(whole)
}

/// What the tets of edge `cell` leave of a mesh, in words; the stage compares the mesh with their outer faces.
fn warnings(
    solid: &MeshSolid,
    filled: &Filled,
    options: FillOptions,
    progress: &dyn Progress,
) -> Result<Vec<String>, ScaffoldError> {
    let cell = options.cell;
    let mut warnings = Vec::new();
    let mut places = |places: &[Vec3], what: &str| {
        if let Some(&first) = places.first() {
            warnings.push(format!(
                "scaffold: {} {what}, the first at ({}); a smaller cell_size may help",
                places.len(),
                place_figures(first)
            ));
        }
    };
    places(
        &filled.lost,
        "pieces of the mesh's edges are no edges of tets",
    );
    places(
        &filled.straight,
        "edges of tets stay straight on a curved surface, because a tet would fold or be a sliver",
    );
    if let Some(message) = thin(&filled.scaffold) {
        let is_good = |s: &Scaffold| thin(s).is_none();
        let advice = advice(solid, options, &filled.scaffold, progress, is_good);
        warnings.push(format!("{message}; {advice}"));
    }
    let outer = MeshSolid::new(outer_mesh(&filled.scaffold, CHORDAL_ERROR * cell)?);
    let surface: Vec<[Vec3; 3]> = solid.surface().map(|(c, _)| c).collect();
    progress.stage("compare", Some(surface.len() as u64));
    let off = surface
        .par_iter()
        .filter(|_| {
            progress.advance(1);
            !progress.cancelled()
        })
        .flat_map_iter(|c| c.iter())
        .map(|&p| (outer.closest(p).distance, p));
    // The first of equally far ones, at any number of threads.
    let worst = off.reduce(
        || (0.0, Vec3::zeros()),
        |a, b| match a.0.total_cmp(&b.0) {
            std::cmp::Ordering::Less => b,
            _ => a,
        },
    );
    if progress.cancelled() {
        return Err(Cancelled.into());
    }
    // The volume of overlapping or open meshes is another one.
    let volumes = solid.volume().map(|part| (volume(&filled.scaffold), part));
    let is_off = volumes.is_some_and(|(own, part)| (own / part - 1.0).abs() > MAX_VOLUME_ERROR);
    if worst.0 > WORTH_A_WARNING * cell || is_off {
        let mut message = format!(
            "scaffold: the tets leave the mesh by up to {}, at ({})",
            short_number(worst.0),
            place_figures(worst.1)
        );
        if let Some((own, part)) = volumes {
            let missing = format!(
                "; their volume is {}, that of the mesh {}",
                short_number(own),
                short_number(part)
            );
            message.push_str(&missing);
        }
        message.push_str("; a smaller cell_size follows it closer");
        warnings.push(message);
    }
    Ok(warnings)
}

/// Volume of all elements.
fn volume(scaffold: &Scaffold) -> f64 {
    scaffold.elements().map(|e| e.volume().abs()).sum()
}
