//! The layers of a build in the report: islands, overhangs, cups and cross-sections. An island is a component of a
//! layer over nothing, an overhang a part of it beyond the angle that needs no support, a cup a pocket that opens
//! upwards or that the plate closes.

use crate::frame::{LengthUnit, Vec3};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::layer_facts::{BuildReport, ProfileStep, StartReport};
use crate::recipe::{BuildSection, Scale};
use crate::vdb::{BuildLayers, BuildRequest, LayerRegion, LevelSet};
use std::fmt::Write;

/// Greatest number of islands and of cups that a report lists.
const MAX_LISTED: usize = 100;
/// Greatest number of heights in a profile.
const MAX_PROFILE: usize = 400;
/// Least and greatest height of a layer, voxels.
const LAYER_RANGE: [f64; 2] = [1.0 / 64.0, 1000.0];

/// The request of a section `[build]` in world units and degrees. Refuses an invalid section and layers out of
/// range.
pub(crate) fn request(section: &BuildSection, scale: Scale) -> Result<BuildRequest, RunError> {
    let refused = |message: String| RunError::Refused {
        stage: "build".into(),
        message,
        hint: "for instance: up = [0, 0, 1], layer = \"0.05mm\", overhang = 45",
    };
    if let Some((_, message)) = section.fault() {
        return Err(refused(message));
    }
    let layer = section.layer.resolve(scale);
    let voxels = layer / scale.voxel_size;
    let [least, most] = LAYER_RANGE;
    if !(least..=most).contains(&voxels) {
        return Err(refused(format!(
            "found layers of {} voxels; expected {least} to {most}",
            short_number(voxels)
        )));
    }
    let up = Vec3::from(section.up.map(|c| c.0));
    Ok(BuildRequest {
        // `fault` has refused a direction of length 0.
        up: up.try_normalize(0.0).unwrap_or_else(Vec3::z),
        layer_height: layer,
        overhang_angle: section.overhang.0,
    })
}

/// The layers of a solid in memory.
pub(crate) fn measure(
    section: &BuildSection,
    context: StageContext,
    solid: &LevelSet,
) -> Result<BuildReport, RunError> {
    let request = request(section, context.scale)?;
    let found = solid.build_layers(&request, context.session());
    let found = found.map_err(RunError::level_set("layers"))?;
    Ok(BuildReport::new(&request, &found, solid.origin()))
}

impl BuildReport {
    /// The report on layers; `origin` is the world position of voxel (0, 0, 0), from which layers are numbered. A layer's
    /// height is that of its lower end in the world, along `up`.
    pub(crate) fn new(request: &BuildRequest, found: &BuildLayers, origin: Vec3) -> Self {
        let base = origin.dot(&request.up);
        let height = |number: i64| base + number as f64 * request.layer_height;
        let layers = &found.layers[..];
        let count = layers.len();
        // The greatest value of all layers and its height; the first of equal ones.
        let greatest = |value: &dyn Fn(usize) -> f64| {
            let all = (0..layers.len()).map(|n| [value(n), height(layers[n].number)]);
            all.fold([0.0, 0.0], |a, b| if b[0] > a[0] { b } else { a })
        };
        let jump = |n: usize| match n {
            0 => 0.0,
            n => (layers[n].area - layers[n - 1].area).abs(),
        };
        let first = layers.first().map_or(0, |l| l.number);
        let starts = |list: &[LayerRegion]| {
            let listed = list.iter().take(MAX_LISTED);
            listed
                .map(|s| StartReport {
                    place: (s.place + origin).into(),
                    area: s.area,
                })
                .collect()
        };
        // Neighbouring layers share one step of the profile where there are too many.
        let per_step = count.div_ceil(MAX_PROFILE).max(1);
        let profile = layers.chunks(per_step).map(|chunk| ProfileStep {
            height: height(chunk[0].number),
            area: chunk.iter().map(|l| l.area).fold(0.0, f64::max),
            overhang: chunk.iter().map(|l| l.overhang_area).sum(),
            sealed: chunk.iter().map(|l| l.sealed_area).fold(0.0, f64::max),
            islands: chunk.iter().map(|l| l.island_count).sum(),
        });
        Self {
            up: request.up.into(),
            layer: request.layer_height,
            overhang: request.overhang_angle,
            layers: count as u64,
            heights: [height(first), height(first + count as i64)],
            islands: found.islands.len() as u64,
            cups: found.cups.len() as u64,
            overhang_area: layers.iter().map(|l| l.overhang_area).sum(),
            section_max: greatest(&|n| layers[n].area),
            section_jump: greatest(&jump),
            sealed_max: greatest(&|n| layers[n].sealed_area),
            island_list: starts(&found.islands),
            cup_list: starts(&found.cups),
            profile: profile.collect(),
        }
    }

    /// The report with all lengths multiplied by a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        let square = factor * factor;
        self.layer *= factor;
        self.heights = self.heights.map(|h| h * factor);
        self.overhang_area *= square;
        // Each pair is an area and a height.
        for pair in [
            &mut self.section_max,
            &mut self.section_jump,
            &mut self.sealed_max,
        ] {
            *pair = [pair[0] * square, pair[1] * factor];
        }
        for start in self.island_list.iter_mut().chain(&mut self.cup_list) {
            start.area *= square;
            start.place = start.place.map(|c| c * factor);
        }
        for step in &mut self.profile {
            step.height *= factor;
            step.area *= square;
            step.overhang *= square;
            step.sealed *= square;
        }
        self
    }

    /// Lines of text for the terminal; lengths are in `unit`.
    pub fn text(&self, unit: LengthUnit) -> String {
        let number = short_number;
        let mut text = format!(
            "layers: {} of {} {unit} along ({}), from {} to {} {unit}\n",
            self.layers,
            number(self.layer),
            self.up.map(number).join(", "),
            number(self.heights[0]),
            number(self.heights[1]),
        );
        let pair = |[area, height]: [f64; 2]| {
            format!("{} {unit}^2 at {} {unit}", number(area), number(height))
        };
        let _ = writeln!(
            text,
            "  greatest section {}, greatest change {}",
            pair(self.section_max),
            pair(self.section_jump)
        );
        let _ = writeln!(
            text,
            "  overhangs beyond {} degrees: {} {unit}^2",
            number(self.overhang),
            number(self.overhang_area)
        );
        // The first five places; the report holds more.
        for (word, count, list) in [
            ("islands", self.islands, &self.island_list),
            ("cups", self.cups, &self.cup_list),
        ] {
            let _ = write!(text, "  {word}: {count}");
            for (n, start) in list.iter().take(5).enumerate() {
                let _ = write!(
                    text,
                    "{} ({})",
                    if n == 0 { ", at" } else { "," },
                    start.place.map(number).join(", ")
                );
            }
            if count > 5 {
                text.push_str(", ...");
            }
            text.push('\n');
        }
        if self.cups > 0 {
            let _ = writeln!(text, "  greatest sealed area {}", pair(self.sealed_max));
        }
        text
    }
}
