//! The page of a report: its sections, from the verdict to the recipe. Values are read from the JSON of the
//! report, so that a report of another version shows what both have; a section without content is left out. Text
//! is escaped where it is inserted.

use super::chart::{Limit, histogram};
use super::printing;
use crate::cli::html::{base64, escaped, hash, number, place, table, text};
use crate::pipeline::shell_word;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// The content of a page.
pub(super) struct Page<'a> {
    pub report: &'a Value,
    /// PNG of the part.
    pub picture: Option<Vec<u8>>,
    /// Text of the recipe, if its file is still that of the run.
    pub recipe: Option<String>,
}

/// Greatest number of cavities on the page.
const MAX_CAVITIES: usize = 20;

impl Page<'_> {
    /// The whole page.
    pub fn html(&self) -> String {
        let name = self.name();
        let mut body = self.head(&name);
        body.push_str(&self.overview());
        let sections = [
            ("Requirements", self.requirements()),
            ("Walls and gaps", self.walls()),
            ("Cavities", self.cavities()),
            (
                "Channels",
                printing::drains(&self.report["solid"], &self.unit()),
            ),
            (
                "Layers",
                printing::layers(&self.report["solid"], &self.unit()),
            ),
            ("Continuity", self.continuity()),
            ("Warnings", self.warnings()),
            ("Inputs", self.inputs()),
            ("Files", self.outputs()),
            ("How to make it again", self.again()),
            ("The run", self.run()),
        ];
        for (title, content) in sections {
            if !content.is_empty() {
                let _ = write!(body, "<section><h2>{title}</h2>{content}</section>");
            }
        }
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{}</title><style>{}</style></head>\n<body><main>{body}</main></body></html>\n",
            escaped(&name),
            include_str!("page.css"),
        )
    }

    /// The name of the part: that of the recipe's file, or "part".
    fn name(&self) -> String {
        let recipe = Path::new(self.report["recipe"].as_str().unwrap_or_default());
        let stem = recipe.file_stem().map(|s| s.to_string_lossy().into_owned());
        stem.filter(|s| !s.is_empty())
            .unwrap_or_else(|| "part".into())
    }

    /// A list of the report; empty where it has none.
    fn list(&self, key: &str) -> &[Value] {
        self.report[key].as_array().map_or(&[], Vec::as_slice)
    }

    /// The unit of the report's lengths, escaped.
    fn unit(&self) -> String {
        text(&self.report["unit"])
    }

    /// The title with the verdict on all requirements.
    fn head(&self, name: &str) -> String {
        let all = self.list("requirements");
        let missed = all.iter().filter(|r| r["met"] != true).count();
        let (class, verdict) = match (all.len(), missed) {
            (0, _) => ("none", "no requirements".to_owned()),
            (1, 0) => ("met", "the requirement is met".to_owned()),
            (n, 0) => ("met", format!("all {n} requirements are met")),
            (n, m) => ("missed", format!("{m} of {n} requirements not met")),
        };
        format!(
            "<header><h1>{}</h1><p class=\"badge {class}\">{verdict}</p></header>",
            escaped(name)
        )
    }

    /// The picture beside the main measures; measures that the run did not take are left out.
    fn overview(&self) -> String {
        let solid = &self.report["solid"];
        let unit = self.unit();
        let mut rows: Vec<(&str, String)> = Vec::new();
        if let Some([low, high]) = corners(&solid["box"]) {
            let size: Vec<String> = (0..3)
                .map(|a| number(&Value::from(high[a] - low[a])))
                .collect();
            rows.push(("size", format!("{} {unit}", size.join(" × "))));
        }
        rows.push(("volume", format!("{} {unit}³", number(&solid["volume"]))));
        rows.push(("area", format!("{} {unit}²", number(&solid["area"]))));
        if let Some(fraction) = solid["volume_fraction"].as_f64() {
            rows.push(("volume fraction", format!("{:.2} %", 100.0 * fraction)));
        }
        if solid["mass"].is_number() {
            rows.push(("mass", format!("{} g", number(&solid["mass"]))));
        }
        rows.push(("components", number(&solid["components"])));
        for (name, key) in [("least wall", "least_wall"), ("least gap", "least_gap")] {
            if solid[key].is_number() {
                rows.push((name, format!("{} {unit}", number(&solid[key]))));
            }
        }
        if solid["thickness"]["p50"].is_number() {
            let median = number(&solid["thickness"]["p50"]);
            rows.push(("median thickness", format!("{median} {unit}")));
        }
        let voxel = number(&self.report["band"]["voxel_size"]);
        rows.push(("voxel size", format!("{voxel} {unit}")));
        let mut out = String::from("<section class=\"overview\">");
        if let Some(png) = &self.picture {
            let _ = write!(
                out,
                "<figure><img alt=\"picture of the part\" src=\"data:image/png;base64,{}\"></figure>",
                base64(png)
            );
        }
        out.push_str("<dl>");
        for (name, value) in rows {
            let _ = write!(out, "<div><dt>{name}</dt><dd>{value}</dd></div>");
        }
        out.push_str("</dl></section>");
        out
    }

    /// The table of requirements, with the place and the hint of those that are not met.
    fn requirements(&self) -> String {
        let rows = self.list("requirements").iter().map(|r| {
            let is_met = r["met"] == true;
            let (class, word) = if is_met {
                ("met", "met")
            } else {
                ("missed", "not met")
            };
            let mut found = text(&r["found"]);
            // Places are known for some requirements, and only where they are missed.
            if r["place"].is_array() {
                let _ = write!(
                    found,
                    " <span class=\"place\">at {}</span>",
                    place(&r["place"])
                );
            }
            if r["hint"].is_string() {
                let _ = write!(found, "<div class=\"hint\">{}</div>", text(&r["hint"]));
            }
            vec![
                format!("<span class=\"badge {class}\">{word}</span>"),
                format!("<code>{}</code>", text(&r["name"])),
                text(&r["required"]),
                found,
            ]
        });
        let rows: Vec<Vec<String>> = rows.collect();
        if rows.is_empty() {
            return String::new();
        }
        table(&["", "requirement", "required", "found"], &rows)
    }

    /// Histograms of walls and gaps, each with its limit and its first percentile.
    fn walls(&self) -> String {
        let solid = &self.report["solid"];
        let unit = self.unit();
        let mut out = String::new();
        for (key, requirement, label) in [
            ("walls", "least_wall", "wall thickness"),
            ("gaps", "least_gap", "width of gaps"),
        ] {
            let limit = self.limit(requirement);
            let chart = histogram(&solid[key], &format!("{label}, {unit}"), limit.as_ref());
            // A brief run measures no walls.
            let Some(chart) = chart else { continue };
            let least = &solid[requirement];
            let at = &solid[format!("{requirement}_place")];
            let mut note = String::new();
            if least.is_number() {
                let _ = write!(
                    note,
                    "<p>First percentile: {} {unit} <span class=\"place\">at {}</span></p>",
                    number(least),
                    place(at)
                );
            }
            let _ = write!(out, "<div class=\"chart\">{chart}{note}</div>");
        }
        if out.is_empty() {
            return out;
        }
        format!("<div class=\"charts\">{out}</div>")
    }

    /// The limit of a requirement such as "at least 0.4 mm": the first number in its text. `None` where the run
    /// had no such requirement.
    fn limit(&self, name: &str) -> Option<Limit> {
        let mut all = self.list("requirements").iter();
        let requirement = all.find(|r| r["name"] == name)?;
        let mut words = requirement["required"].as_str()?.split_whitespace();
        Some(Limit {
            value: words.find_map(|w| w.parse().ok().filter(|v: &f64| v.is_finite()))?,
            is_met: requirement["met"] == true,
        })
    }

    /// The table of cavities, those with the narrowest ways out first; empty unless the run searched for them.
    fn cavities(&self) -> String {
        let found = &self.report["solid"]["cavities"];
        let Some(list) = found["list"].as_array() else {
            return String::new();
        };
        let unit = self.unit();
        let mut out = format!(
            "<p>{} cavities, {} closed. A ball of radius {} {unit} can leave the rest of the void.</p>",
            number(&found["count"]),
            number(&found["closed"]),
            number(&found["limit"])
        );
        let rows = list.iter().take(MAX_CAVITIES).map(|c| {
            let is_closed = c["throat"].is_null();
            vec![
                place(&c["place"]),
                number(&c["volume"]),
                number(&c["radius"]),
                if is_closed {
                    "closed".into()
                } else {
                    number(&c["escape_radius"])
                },
                place(&c["throat"]),
            ]
        });
        let rows: Vec<Vec<String>> = rows.collect();
        if !rows.is_empty() {
            let heads = [
                "place",
                &format!("volume, {unit}³"),
                &format!("radius, {unit}"),
                &format!("escape radius, {unit}"),
                "narrowest at",
            ];
            out.push_str(&table(&heads, &rows));
        }
        out
    }

    /// The greatest jump and crease across shared faces; empty without a certificate.
    fn continuity(&self) -> String {
        let found = &self.report["continuity"];
        let Some(jump) = found["value_jump_max"].as_f64() else {
            return String::new();
        };
        let worst = &found["worst"][0];
        let mut out = format!(
            "<p>Greatest jump of the field across faces that elements share: {jump:.2e} of its range",
        );
        if worst["at"].is_array() {
            let _ = write!(
                out,
                " <span class=\"place\">at {}</span>",
                place(&worst["at"])
            );
        }
        let _ = write!(
            out,
            ". Greatest crease: {} degrees, 99th percentile {}.</p>",
            number(&found["crease_degrees_max"]),
            number(&found["crease_degrees_p99"])
        );
        out
    }

    /// The table of warnings.
    fn warnings(&self) -> String {
        let rows = self.list("warnings").iter();
        let rows: Vec<Vec<String>> = rows
            .map(|w| {
                vec![
                    format!("<code>{}</code>", text(&w["code"])),
                    text(&w["message"]),
                ]
            })
            .collect();
        if rows.is_empty() {
            return String::new();
        }
        table(&["code", "warning"], &rows)
    }

    /// The table of the recipe and the files that the run read, with their hashes.
    fn inputs(&self) -> String {
        let mut rows = vec![vec![
            "recipe".to_owned(),
            text(&self.report["recipe"]),
            hash(&self.report["recipe_blake3"]),
        ]];
        rows.extend(self.list("inputs").iter().map(|i| {
            vec![
                format!("<code>{}</code>", text(&i["key"])),
                text(&i["path"]),
                hash(&i["hash"]),
            ]
        }));
        table(&["key", "file", "BLAKE3"], &rows)
    }

    /// The table of the files that the run wrote.
    fn outputs(&self) -> String {
        let rows = self.list("outputs").iter().map(|o| {
            let bytes = o["bytes"].as_u64().unwrap_or(0);
            let mut hashes = hash(&o["hash"]);
            if o["content_hash"].is_string() {
                let _ = write!(hashes, "<br>content {}", hash(&o["content_hash"]));
            }
            vec![
                text(&o["path"]),
                crate::cli::numbers::size(bytes),
                text(&o["unit"]),
                hashes,
            ]
        });
        let rows: Vec<Vec<String>> = rows.collect();
        if rows.is_empty() {
            return String::new();
        }
        table(&["file", "size", "unit", "BLAKE3"], &rows)
    }

    /// The commands that repeat the run, and the recipe. A recipe whose keys `--set` changed does not repeat it.
    fn again(&self) -> String {
        let command = |path: &str| format!("druse run {}", escaped(&shell_word(path)));
        let recipe = self.report["recipe"].as_str();
        let recipe = recipe.filter(|_| self.recipe.is_some()).map(command);
        let mut lines = Vec::from_iter(recipe);
        let volume = self.list("outputs").iter().find_map(|o| {
            let path = o["path"].as_str().filter(|p| {
                std::path::Path::new(p)
                    .extension()
                    .is_some_and(|e| e == "vdb")
            })?;
            o["content_hash"].is_string().then_some(path)
        });
        let mut out = String::new();
        if let Some(path) = volume {
            lines.push(command(path));
            out.push_str(
                "<p>The .vdb carries the recipe and the hashes of its inputs; its run is repeated and the content \
                 hashes are compared.</p>",
            );
        }
        if lines.is_empty() {
            return String::new();
        }
        let version = text(&self.report["druse"]);
        let mut out = format!(
            "<p>With druse {version}:</p><pre>{}</pre>{out}",
            lines.join("\n")
        );
        if let Some(recipe) = &self.recipe {
            let _ = write!(
                out,
                "<details open><summary>The recipe</summary><pre>{}</pre></details>",
                escaped(recipe)
            );
        }
        out
    }

    /// Time, memory and voxels of the run, with the time of each stage. Seconds are wall time.
    fn run(&self) -> String {
        let stages = self.list("stages");
        let seconds: f64 = stages.iter().filter_map(|s| s["seconds"].as_f64()).sum();
        let mut out = format!(
            "<p>{seconds:.1} s with {} threads, {} of memory, {} active voxels",
            number(&self.report["threads"]),
            crate::cli::numbers::size(self.report["peak_memory_bytes"].as_u64().unwrap_or(0)),
            crate::cli::numbers::grouped(
                self.report["band"]["active_voxels"].as_u64().unwrap_or(0)
            ),
        );
        if let Some(count) = self.report["bricks"]["count"].as_u64() {
            let _ = write!(out, ", {count} bricks");
        }
        out.push_str(".</p>");
        let rows = stages.iter().map(|s| {
            let seconds = s["seconds"].as_f64().unwrap_or(0.0);
            vec![text(&s["name"]), format!("{seconds:.2} s")]
        });
        let rows: Vec<Vec<String>> = rows.collect();
        let _ = write!(
            out,
            "<details><summary>Time per stage</summary>{}</details>",
            table(&["stage", "time"], &rows)
        );
        out
    }
}

/// Both corners of a box; `None` where the report has none.
fn corners(value: &Value) -> Option<[[f64; 3]; 2]> {
    let corner = |v: &Value| -> Option<[f64; 3]> {
        let all: Vec<f64> = v
            .as_array()?
            .iter()
            .map(Value::as_f64)
            .collect::<Option<_>>()?;
        all.try_into().ok()
    };
    Some([corner(&value[0])?, corner(&value[1])?])
}
