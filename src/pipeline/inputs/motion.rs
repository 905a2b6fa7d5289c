//! Scaffolds that move: their nodes at a frame, the velocity of the material, and its place at rest.
//!
//! The connectivity must be that of every frame involved. Velocities are differences of the nodes over the nearest
//! frames that exist on both sides, on one side at the ends of a series; or a point field of the scaffold's file.

use super::input_files::{InputFiles, frame_map};
use crate::field::Formula;
use crate::frame::{Aabb, Vec3};
use crate::io::{DataField, FieldAt, Place, PointCache, ReadError};
use crate::pipeline::base::error::RunError;
use crate::recipe::{FileFrame, GridWord, Recipe, ScaffoldSection};
use crate::scaffold::Scaffold;
use crate::sequence::{Clock, expand, frames_on_disk, nearest_frames};
use std::path::{Path, PathBuf};

/// Frames before and after at which formulas are evaluated for velocities.
const FORMULA_STEP: f64 = 1.0 / 64.0;
/// Seconds that nodes move along a velocity field, over the scaffold's half diagonal.
const FIELD_STEP: f64 = 1e-6;
/// Difference of frames below which they are equal.
const FRAME_TOLERANCE: f64 = 1e-3;
/// Variables of the formulas of `deform`.
const DEFORM_VARIABLES: [&str; 6] = ["x", "y", "z", "bx", "by", "bz"];
/// Key that records a point cache.
const CACHE_KEY: &str = "scaffold.motion.points";

/// Velocity and place at rest of a scaffold's nodes, recipe units and seconds.
#[derive(Default)]
pub(crate) struct NodeMotion {
    pub velocity: Vec<Vec3>,
    pub rest: Vec<Vec3>,
}

/// The state of a scaffold's source that is read; the default is the source as it is stored.
#[derive(Clone, Default)]
pub(crate) struct Pose {
    /// The frame of caches and formulas; without one, nodes are where their source has them.
    frame: Option<f64>,
    /// The file of another frame, and that frame.
    other: Option<(PathBuf, i32)>,
    /// Seconds that nodes move along the velocity field.
    drift: f64,
}

impl Pose {
    /// The frame of the run.
    pub fn current(recipe: &Recipe) -> Self {
        Self {
            frame: Some(f64::from(recipe.clock().frame)),
            ..Self::default()
        }
    }

    /// The scaffold's file in this pose.
    pub fn path(&self, recipe: &Recipe, file: &FileFrame) -> PathBuf {
        let other = self.other.as_ref().map(|(path, _)| path.clone());
        other.unwrap_or_else(|| recipe.resolve(&file.path))
    }

    /// The key that records the scaffold's file.
    pub fn key(&self) -> String {
        match &self.other {
            Some((_, frame)) => format!("scaffold.file.frame.{frame}"),
            None => "scaffold.file".into(),
        }
    }

    /// Its name in messages.
    fn name(&self) -> String {
        match (&self.other, self.frame) {
            (Some((_, frame)), _) => format!("frame {frame}"),
            (None, Some(frame)) => format!("frame {frame}"),
            (None, None) => "rest".into(),
        }
    }
}

/// The nodes of a file, as it holds them.
pub(crate) struct FileNodes<'a> {
    pub nodes: &'a [Vec3],
    /// The file's number of each node.
    pub numbers: &'a [u64],
    /// Nodes of the file that no element uses.
    pub unused: usize,
    pub fields: &'a [DataField],
}

impl FileNodes<'_> {
    /// The nodes in the recipe's frame, in the order of `self.nodes`, where the section's cache, field and
    /// formulas move them. `file` is the frame of the scaffold's file and `path` its path. Records a cache once.
    pub fn posed(
        &self,
        files: &mut InputFiles,
        section: &ScaffoldSection,
        pose: &Pose,
        file: &FileFrame,
        path: &Path,
    ) -> Result<Vec<Vec3>, RunError> {
        let recipe = files.recipe;
        let map = frame_map(file, file.unit.map(|u| u.0), recipe.unit());
        let motion = section.motion.as_ref();
        let cache = motion.and_then(|m| m.points.as_ref());
        let mut nodes: Vec<Vec3> = match (cache, pose.frame) {
            // A cache replaces the nodes of the file; it counts them in the file's order.
            (Some(points), Some(frame)) => {
                let cache_path = recipe.resolve(&points.path);
                let cache = PointCache::open(&cache_path)?;
                let read = self.in_order(&cache.read(cache.sample_at(frame)?)?, &cache_path)?;
                let unit = points.unit.or(file.unit).map(|u| u.0);
                let nodes: Vec<Vec3> = read
                    .into_iter()
                    .map(frame_map(points, unit, recipe.unit()))
                    .collect();
                if files.inputs.iter().all(|i| i.key != CACHE_KEY) {
                    files.record(CACHE_KEY, &cache_path, Aabb::of(nodes.iter().copied()))?;
                }
                nodes
            }
            _ => self.nodes.iter().map(|&v| map(v)).collect(),
        };
        let displacement = motion.and_then(|m| m.displacement.as_ref());
        let velocity = motion.and_then(|m| m.velocity.as_ref());
        // Vectors are turned and scaled as the nodes are, but not translated: map(v) - map(0).
        let origin = map(Vec3::zeros());
        // x + u of a displacement, x + t v of a velocity.
        for (name, factor) in [
            (displacement.filter(|_| pose.frame.is_some()), 1.0),
            (velocity.filter(|_| pose.drift != 0.0), pose.drift),
        ] {
            let Some(name) = name else {
                continue;
            };
            for (node, v) in nodes.iter_mut().zip(self.vectors(name, path)?) {
                *node += (map(v) - origin) * factor;
            }
        }
        deformed(recipe, section, pose, nodes)
    }

    /// The points of a cache, which has all nodes of the file in the order of their numbers, in the order of this
    /// scaffold's nodes.
    fn in_order(&self, points: &[Vec3], path: &Path) -> Result<Vec<Vec3>, ReadError> {
        let all = self.nodes.len() + self.unused;
        if points.len() != all {
            let found = format!("{} points", points.len());
            let expected = format!("{all}, as many as the scaffold's file has nodes");
            return Err(ReadError::data(path, Place::File, found, expected));
        }
        let mut sorted = self.numbers.to_vec();
        sorted.sort_unstable();
        if self.unused == 0 {
            // The scaffold numbers its nodes as elements use them, the cache as the file does: the rank of a
            // node's number among all is its place in the cache.
            let rank = |n: &u64| sorted.partition_point(|m| m < n);
            return Ok(self.numbers.iter().map(|n| points[rank(n)]).collect());
        }
        // With unused nodes ranks do not count them. Numbers are then places themselves, if they run from 0 or
        // from 1.
        let first = match (sorted.first(), sorted.last()) {
            (Some(0), Some(last)) if *last < all as u64 => 0,
            (_, Some(last)) if *last == all as u64 => 1,
            _ => {
                let found = format!("{} nodes that no element uses", self.unused);
                let expected = "a file whose nodes are all used, for a cache";
                return Err(ReadError::data(path, Place::File, found, expected));
            }
        };
        let ordered = self.numbers.iter().map(|n| points[(n - first) as usize]);
        Ok(ordered.collect())
    }

    /// The vectors of the point field `name`, one for each node, in the file's unit, or per second. `path` is the
    /// file that an error names.
    fn vectors(&self, name: &str, path: &Path) -> Result<Vec<Vec3>, ReadError> {
        let is_vector = |f: &&DataField| f.at == FieldAt::Points && f.components == 3;
        let mut fields = self.fields.iter().filter(is_vector);
        let Some(field) = fields.find(|f| f.name == name) else {
            let known = self.fields.iter().filter(is_vector).map(|f| &*f.name);
            let known = known.collect::<Vec<_>>().join(", ");
            let found = if known.is_empty() {
                "no point fields of three components".to_owned()
            } else {
                format!("the point fields {known}")
            };
            let expected = format!("a point field {name:?} of three components");
            return Err(ReadError::data(path, Place::File, found, expected));
        };
        let vectors = field.values.chunks_exact(3).map(Vec3::from_column_slice);
        let vectors: Vec<Vec3> = vectors.collect();
        // One vector that is not finite would spoil every element beside it, so its node is named.
        match vectors
            .iter()
            .position(|v| !v.iter().all(|c| c.is_finite()))
        {
            None => Ok(vectors),
            Some(n) => Err(ReadError::data(
                path,
                Place::Item("node", self.numbers.get(n).copied().unwrap_or(n as u64)),
                format!("a vector that is not finite in the field {name:?}"),
                "finite numbers",
            )),
        }
    }
}

/// Applies the formulas of `deform`, if the section has them and the pose has a frame. Each node's new place is a
/// function of its old one and of the frame.
pub(crate) fn deformed(
    recipe: &Recipe,
    section: &ScaffoldSection,
    pose: &Pose,
    nodes: Vec<Vec3>,
) -> Result<Vec<Vec3>, RunError> {
    let formulas = section.motion.as_ref().and_then(|m| m.deform.as_ref());
    let (Some(texts), Some(frame)) = (formulas, pose.frame) else {
        return Ok(nodes);
    };
    let fps = recipe.clock().fps;
    // Frame 1 is time 0.
    let constants = [
        ("frame", frame),
        ("time", (frame - 1.0) / fps),
        ("fps", fps),
    ];
    let mut formulas = Vec::new();
    for text in texts {
        let parsed = Formula::with_constants(text, &DEFORM_VARIABLES, &constants);
        formulas
            .push(parsed.map_err(|e| RunError::Tiling(format!("scaffold.motion.deform: {e}")))?);
    }
    let bounds = Aabb::of(nodes.iter().copied());
    let size = bounds.size();
    let moved_node = |p: &Vec3| {
        // The second triple of variables is the place within the box of the scaffold, from 0 to 1.
        let b = (p - bounds.min).zip_map(&size, |d, s| if s > 0.0 { d / s } else { 0.0 });
        let variables = [p.x, p.y, p.z, b.x, b.y, b.z];
        let q = Vec3::from_fn(|a, _| formulas[a].value(&variables));
        if q.iter().all(|c| c.is_finite()) {
            return Ok(q);
        }
        Err(RunError::Tiling(format!(
            "scaffold.motion.deform gives ({}, {}, {}) at ({}, {}, {}); expected finite numbers",
            q.x, q.y, q.z, p.x, p.y, p.z
        )))
    };
    nodes.iter().map(moved_node).collect()
}

/// Which of `vel` and `rest` the outputs of a recipe hold.
fn requested(recipe: &Recipe) -> [bool; 2] {
    let outputs = &recipe.sections().output;
    [GridWord::Vel, GridWord::Rest].map(|word| {
        let mut grids = outputs.iter().filter_map(|o| o.grids.as_ref());
        grids.any(|words| words.contains(&word))
    })
}

/// A scaffold with the number of each node in its file.
#[derive(Clone, Copy)]
pub(crate) struct NumberedScaffold<'a> {
    pub scaffold: &'a Scaffold,
    pub node_numbers: &'a [u64],
}

/// The motion of the nodes that the outputs need, in the order of the scaffold `here`; empty lists where they need
/// none. `load` makes the scaffold and the numbers of its nodes in another pose.
pub(crate) fn node_motion(
    files: &mut InputFiles,
    section: &ScaffoldSection,
    here: NumberedScaffold,
    load: impl Fn(&mut InputFiles, &Pose) -> Result<(Scaffold, Vec<u64>), RunError>,
) -> Result<NodeMotion, RunError> {
    let recipe = files.recipe;
    let scaffold = here.scaffold;
    let [needs_velocity, needs_rest] = requested(recipe);
    let mut motion = NodeMotion::default();
    // The defects of the other frames are those of this one, which are reported once.
    let warnings = files.warnings.len();
    let mut nodes_in = |pose: Option<Pose>| {
        let Some(pose) = pose else {
            return Ok(scaffold.nodes().to_vec());
        };
        let (other, other_numbers) = load(files, &pose)?;
        let there = NumberedScaffold {
            scaffold: &other,
            node_numbers: &other_numbers,
        };
        check_connectivity(recipe, here, there, &pose)?;
        Ok::<_, RunError>(other.nodes().to_vec())
    };
    if needs_velocity {
        let (before, after, seconds) = neighbours(recipe, section, scaffold)?;
        let (first, last) = (nodes_in(before)?, nodes_in(after)?);
        let pairs = last.iter().zip(&first);
        motion.velocity = pairs.map(|(b, a)| (b - a) / seconds).collect();
    }
    if needs_rest {
        motion.rest = nodes_in(rest_pose(recipe, section)?)?;
    }
    files.warnings.truncate(warnings);
    Ok(motion)
}

/// Poses before and after the frame of the run, and the seconds between them: differences over them are velocities.
/// `None` is the frame itself, whose nodes are known.
fn neighbours(
    recipe: &Recipe,
    section: &ScaffoldSection,
    scaffold: &Scaffold,
) -> Result<(Option<Pose>, Option<Pose>, f64), RunError> {
    let Clock { frame, fps } = recipe.clock();
    let now = f64::from(frame);
    let motion = section.motion.as_ref();
    if motion.is_some_and(|m| m.velocity.is_some()) {
        // Seconds: so few that, at a velocity near 1, shells and divided elements follow linearly.
        let drift = FIELD_STEP * scaffold.bounds().half_diagonal();
        let pose = Pose {
            drift,
            ..Pose::current(recipe)
        };
        return Ok((None, Some(pose), drift));
    }
    let series = series(recipe);
    let frames: Vec<f64> = match (&series, motion.and_then(|m| m.points.as_ref())) {
        (Some((_, frames)), _) => frames.iter().map(|&f| f64::from(f)).collect(),
        (None, Some(points)) => {
            let cache = PointCache::open(&recipe.resolve(&points.path))?;
            (0..cache.samples()).map(|n| cache.frame(n)).collect()
        }
        // Formulas have values at any frame: central differences over a short step.
        (None, None) => vec![now - FORMULA_STEP, now, now + FORMULA_STEP],
    };
    let pose_at = |frame: f64| match &series {
        Some((template, _)) => series_pose(recipe, template, frame as i32),
        None => Pose {
            frame: Some(frame),
            ..Pose::default()
        },
    };
    // The nearest frames on both sides that exist, or the frame itself at an end.
    let before = frames.iter().rev().find(|f| **f < now - FRAME_TOLERANCE);
    let after = frames.iter().find(|f| **f > now + FRAME_TOLERANCE);
    let seconds = (after.unwrap_or(&now) - before.unwrap_or(&now)) / fps;
    if seconds <= 0.0 {
        return Err(RunError::Scaffold {
            file: None,
            element: None,
            message: format!(
                "found frame {frame} alone and a time step of zero; expected a frame before or after it for vel, \
                 or scaffold.motion.velocity"
            ),
        });
    }
    Ok((
        before.map(|&f| pose_at(f)),
        after.map(|&f| pose_at(f)),
        seconds,
    ))
}

/// Whether the scaffold of a recipe differs from frame to frame.
pub(crate) fn moves(recipe: &Recipe) -> bool {
    let section = recipe.sections().scaffold.as_ref();
    section.is_some_and(|s| s.motion.is_some()) || series(recipe).is_some()
}

/// The template of a scaffold's series of files and the frames that exist.
fn series(recipe: &Recipe) -> Option<(String, Vec<i32>)> {
    let template = recipe.source().template("scaffold.file")?;
    let frames = frames_on_disk(&recipe.resolve(Path::new(template)));
    Some((template.to_owned(), frames))
}

/// The pose of a frame of a series of files.
fn series_pose(recipe: &Recipe, template: &str, frame: i32) -> Pose {
    // The tokens agree, since the recipe was read.
    let name = expand(template, frame).ok().flatten();
    let name = name.unwrap_or_else(|| template.to_owned());
    Pose {
        frame: Some(f64::from(frame)),
        other: Some((recipe.resolve(Path::new(&name)), frame)),
        drift: 0.0,
    }
}

/// The pose at rest, to which `rest` attributes refer: that of `rest_frame`, else the source as it is stored, or the
/// first frame of a series without a displacement. `None` if that frame of a series is the run's.
fn rest_pose(recipe: &Recipe, section: &ScaffoldSection) -> Result<Option<Pose>, RunError> {
    let requested = section.motion.as_ref().and_then(|m| m.rest_frame);
    let now = recipe.clock().frame;
    let is_displaced = section
        .motion
        .as_ref()
        .is_some_and(|m| m.displacement.is_some());
    // A displaced file is at rest as it is stored.
    if is_displaced && requested.is_none() {
        return Ok(Some(Pose::default()));
    }
    let Some((template, frames)) = series(recipe) else {
        return Ok(Some(Pose {
            frame: requested.map(f64::from),
            ..Pose::default()
        }));
    };
    let rest = requested.or(frames.first().copied()).unwrap_or(now);
    // Nothing else to read.
    if rest == now {
        return Ok(None);
    }
    if !frames.contains(&rest) {
        let path = recipe.resolve(Path::new(&template));
        let found = format!("no file for the rest frame {rest}");
        let e = ReadError::missing(path, found, "a file of the series");
        return Err(e.with_hint(nearest_text(&frames, rest)).into());
    }
    Ok(Some(series_pose(recipe, &template, rest)))
}

/// The frames of a series nearest to a missing one, in words.
pub(crate) fn nearest_text(frames: &[i32], frame: i32) -> String {
    match nearest_frames(frames, frame) {
        (None, None) => "no frame of this series exists".into(),
        (Some(a), Some(b)) => format!("the nearest frames that exist are {a} and {b}"),
        (Some(a), None) | (None, Some(a)) => format!("the nearest frame that exists is {a}"),
    }
}

/// Refuses a scaffold `there` in a pose whose elements or node numbers are not those of the run's frame, `here`:
/// differences of places would be meaningless. The error shows the first element that differs.
fn check_connectivity(
    recipe: &Recipe,
    here: NumberedScaffold,
    there: NumberedScaffold,
    pose: &Pose,
) -> Result<(), RunError> {
    let (a, b) = (here.scaffold.connectivity(), there.scaffold.connectivity());
    let is_equal =
        |e: usize| e < a.len() && e < b.len() && a.kind(e) == b.kind(e) && a.nodes(e) == b.nodes(e);
    // Readers number nodes as elements use them, so that the numbers of the files count too.
    let mut pairs = here.node_numbers.iter().zip(there.node_numbers);
    let renumbered = pairs.position(|(a, b)| a != b);
    let uses = |n: usize| (0..a.len()).find(|&e| a.nodes(e).contains(&(n as u32)));
    let differing = (0..a.len().max(b.len())).find(|&e| !is_equal(e));
    let differing = differing.or_else(|| renumbered.and_then(uses));
    let is_same = differing.is_none() && renumbered.is_none();
    if is_same && here.scaffold.nodes().len() == there.scaffold.nodes().len() {
        return Ok(());
    }
    let owner = |e: usize| {
        let is_here = e < here.scaffold.len();
        if is_here {
            here.scaffold
        } else {
            there.scaffold
        }
    };
    let number = differing.map(|e| owner(e).number(e));
    let text = |NumberedScaffold {
                    scaffold,
                    node_numbers,
                }: NumberedScaffold| match differing {
        None => format!("{} nodes", scaffold.nodes().len()),
        Some(e) if e >= scaffold.len() => "no element".into(),
        Some(e) => {
            let name = |n: &u32| {
                let number = node_numbers.get(*n as usize);
                number.copied().unwrap_or(u64::from(*n))
            };
            let nodes = scaffold
                .connectivity()
                .nodes(e)
                .iter()
                .map(|n| name(n).to_string());
            let nodes = nodes.collect::<Vec<_>>().join(" ");
            format!("{} [{nodes}]", scaffold.connectivity().kind(e).name())
        }
    };
    Err(RunError::Scaffold {
        file: pose.other.as_ref().map(|(path, _)| path.clone()),
        element: number,
        message: format!(
            "found {} at frame {} and {} at {}{}; expected the same connectivity at every frame, which vel and rest need",
            text(here),
            recipe.clock().frame,
            text(there),
            pose.name(),
            number.map_or(String::new(), |n| format!(" as element {n}"))
        ),
    })
}
