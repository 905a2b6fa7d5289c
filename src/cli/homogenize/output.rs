//! Effective properties as text, JSON and tables. Stiffnesses are in Voigt's order 11 22 33 23 13 12, relative to
//! the solid's Young modulus unless one is given; lengths are in edges of the reference cell.

use crate::frame::Vec3;
use crate::homogenize::{EngineeringConstants, LOADS, Properties, Voigt, directional_modulus};
use crate::pipeline::{CellPeriod, CellProperties};
use serde_json::{Value, json};
use std::fmt::Write;

/// Angle between the directions of a table of moduli, degrees.
const ANGLE_STEP_DEGREES: usize = 5;

/// The solid, as it was given; `None` for a modulus or conductivity of 1, to which the results are relative.
pub(super) struct Material {
    pub young: Option<f64>,
    pub poisson: f64,
    pub kappa: Option<f64>,
    /// Moduli and conductivity of the void over those of the solid.
    pub void: f64,
}

pub(super) struct PeriodResults<'a> {
    pub source: &'a CellPeriod,
    pub material: Material,
    /// Whether voxels were rounded to solid or void.
    pub is_sharp: bool,
    pub computed: &'a CellProperties,
}

impl PeriodResults<'_> {
    /// The properties on the finer grid, which are the results.
    fn fine(&self) -> &Properties {
        &self.computed.fine
    }

    /// The bulk modulus to compare with its bound; for a planar period that of the plane.
    fn bulk(&self, e: &EngineeringConstants) -> f64 {
        match &self.fine().plane_strain {
            Some(c) => (c[0][0] + c[1][1] + 2.0 * c[0][1]) / 4.0,
            None => e.bulk,
        }
    }

    /// The results as one object: those of the period, and the material that was given.
    pub fn json(&self) -> Value {
        let mut all = self.computed.json(self.source);
        all["kind"] = json!("properties");
        all["sharp"] = json!(self.is_sharp);
        all["material"] = json!({
            "E": self.material.young.unwrap_or(1.0),
            "nu": self.material.poisson,
            "kappa": self.material.kappa.unwrap_or(1.0),
            "void": self.material.void,
            "relative": self.material.young.is_none(),
        });
        all
    }

    /// The effective properties with bounds and errors as CSV (the JSON has grids and load cases too): quantity, row,
    /// column, value. The name of a derivative has its coefficient.
    /// Bounds and errors have a word as row, scalars nothing. For a planar period `bulk` is that of all six directions
    /// as in space, `bulk_bound` that of the plane.
    pub fn csv(&self) -> String {
        let mut text = "quantity,i,j,value\n".to_owned();
        let fine = self.fine();
        let mut line = |name: &str, i: &str, j: &str, value: f64| {
            let _ = writeln!(text, "{name},{i},{j},{value}");
        };
        line("volume_fraction", "", "", fine.volume_fraction);
        if let Some(c) = &fine.stiffness {
            for (i, row) in c.iter().enumerate() {
                for (j, v) in row.iter().enumerate() {
                    line("C", LOADS[i], LOADS[j], *v);
                }
            }
        }
        // Planar cells have stiffnesses of two states.
        for (name, matrix) in [
            ("plane_strain", &fine.plane_strain),
            ("plane_stress", &fine.plane_stress),
        ] {
            let of = ["11", "22", "12"];
            for (i, row) in matrix.iter().flatten().enumerate() {
                for (j, v) in row.iter().enumerate() {
                    line(name, of[i], of[j], *v);
                }
            }
        }
        if let Some(e) = &fine.engineering {
            for a in 0..3 {
                let axis = ["1", "2", "3"][a];
                line("E", axis, "", e.young[a]);
                // Shear moduli are in Voigt's order 23, 13, 12; Poisson's ratios in the order 12, 13, 23.
                line("G", ["2", "1", "1"][a], ["3", "3", "2"][a], e.shear[a]);
                line("nu", ["1", "1", "2"][a], ["2", "3", "3"][a], e.poisson[a]);
            }
            for (name, v) in [
                ("bulk", e.bulk),
                ("bulk_reuss", e.bulk_reuss),
                ("shear_voigt", e.shear_voigt),
                ("shear_reuss", e.shear_reuss),
                ("zener", e.zener),
                ("anisotropy", e.anisotropy),
            ] {
                line(name, "", "", v);
            }
        }
        for (name, matrix) in [
            ("conductivity", &fine.conductivity),
            ("permeability", &fine.permeability),
        ] {
            for (i, row) in matrix.iter().flatten().enumerate() {
                for (j, v) in row.iter().enumerate() {
                    line(name, ["1", "2", "3"][i], ["1", "2", "3"][j], *v);
                }
            }
        }
        for (name, [lower, upper], over) in [
            ("bulk_bound", fine.bounds.bulk, fine.over_bounds.bulk),
            ("shear_bound", fine.bounds.shear, fine.over_bounds.shear),
            (
                "conductivity_bound",
                fine.bounds.conductivity,
                fine.over_bounds.conductivity,
            ),
        ] {
            line(name, "lower", "", lower);
            line(name, "upper", "", upper);
            if let Some(over) = over {
                line(name, "over", "", over);
            }
        }
        for (name, error) in ["stiffness", "conductivity", "permeability"]
            .into_iter()
            .zip(self.computed.errors())
        {
            if let Some(error) = error {
                line("error", name, "", error);
            }
        }
        line(
            "surface_per_volume",
            "",
            "",
            self.computed.surface_per_volume,
        );
        if let Some(d) = self.computed.hydraulic_diameter() {
            line("hydraulic_diameter", "", "", d);
        }
        for d in self.computed.gradient.iter().flatten() {
            let k = d.k.as_ref().map_or(String::new(), |k| {
                let shown: Vec<String> = k.iter().map(ToString::to_string).collect();
                format!("({})", shown.join(" "))
            });
            let name = |of: &str| format!("d {of} / d {}{k}", d.part);
            line(&name("volume_fraction"), "", "", d.volume_fraction);
            for i in 0..6 {
                // The derivative is symmetric; its upper half is listed.
                for j in i..6 {
                    line(&name("C"), LOADS[i], LOADS[j], d.stiffness[i][j]);
                }
            }
            for i in 0..3 {
                for j in i..3 {
                    let of = ["1", "2", "3"];
                    line(&name("conductivity"), of[i], of[j], d.conductivity[i][j]);
                }
            }
        }
        text
    }

    /// The properties in words. Without a modulus of the solid the results are relative to it.
    pub fn text(&self) -> String {
        let fine = self.fine();
        let [nx, ny, nz] = fine.voxels;
        let mut text = format!(
            "{}: {} of a {} cell, {nx} x {ny} x {nz} voxels{}, volume fraction {:.5}\n",
            self.source.name,
            self.source.period.describe(),
            self.source.period.element().name(),
            if self.is_sharp { ", sharp" } else { "" },
            fine.volume_fraction,
        );
        let young = self.material.young.unwrap_or(1.0);
        let unit = if self.material.young.is_some() {
            ""
        } else {
            ", relative to the solid's E"
        };
        if let Some(c) = &fine.stiffness {
            let _ = writeln!(text, "stiffness (11 22 33 23 13 12{unit}):");
            matrix(&mut text, c);
        }
        for (name, c) in [
            ("plane strain", &fine.plane_strain),
            ("plane stress", &fine.plane_stress),
        ] {
            if let Some(c) = c {
                let _ = writeln!(text, "{name} (11 22 12{unit}):");
                matrix(&mut text, c);
            }
        }
        if let Some(e) = &fine.engineering {
            let [x, y, z] = e.young.map(short);
            let [a, b, c] = e.shear.map(short);
            let [p, q, r] = e.poisson.map(|v| format!("{v:.4}"));
            let _ = writeln!(
                text,
                "E 1 2 3: {x} {y} {z}   G 23 13 12: {a} {b} {c}   nu 12 13 23: {p} {q} {r}"
            );
            let _ = writeln!(
                text,
                "{} {} ({}), Zener ratio {:.4}, anisotropy {:.4}",
                if nz == 1 { "plane bulk" } else { "bulk" },
                short(self.bulk(e)),
                of_bound(fine.over_bounds.bulk),
                e.zener,
                e.anisotropy
            );
            let _ = writeln!(
                text,
                "shear {} under uniform stress ({})",
                short(e.shear_reuss),
                of_bound(fine.over_bounds.shear)
            );
        } else if fine.stiffness.is_some() {
            let _ = writeln!(
                text,
                "the stiffness is singular against E = {}",
                short(young)
            );
        }
        if let Some(k) = &fine.conductivity {
            let over = of_bound(fine.over_bounds.conductivity);
            let unit = if self.material.kappa.is_some() {
                ""
            } else {
                ", relative to the solid's"
            };
            let _ = writeln!(text, "conductivity{unit} ({over}):");
            matrix(&mut text, k);
        }
        if let Some(k) = &fine.permeability {
            let _ = writeln!(text, "permeability of the void (edge^2):");
            matrix(&mut text, k);
        }
        let mut error_texts = Vec::new();
        let names = ["stiffness", "conductivity", "permeability"];
        for (name, error) in names.into_iter().zip(self.computed.errors()) {
            error_texts.extend(error.map(|e| format!("{name} {:.2} %", 100.0 * e)));
        }
        if let (Some(coarse), false) = (&self.computed.coarse, error_texts.is_empty()) {
            let _ = writeln!(
                text,
                "error, as the difference to {} voxels: {}",
                coarse.voxels[0],
                error_texts.join(", ")
            );
        }
        let _ = write!(
            text,
            "surface per volume {:.4} / edge",
            self.computed.surface_per_volume
        );
        if let Some(d) = self.computed.hydraulic_diameter() {
            let _ = write!(text, ", hydraulic diameter {d:.4} edge");
        }
        text.push('\n');
        if fine.load_cases > 0 {
            let _ = writeln!(
                text,
                "{} load cases, at most {} iterations",
                fine.load_cases, fine.iterations[0]
            );
        }
        if let Some(gradient) = &self.computed.gradient {
            let _ = writeln!(
                text,
                "derivatives: C11, C12, C44, conductivity 11, volume fraction"
            );
            for d in gradient {
                let k = d.k.as_ref().map_or(String::new(), |k| format!("{k:?} "));
                let _ = writeln!(
                    text,
                    "  {k}{}: {} {} {} {} {}",
                    d.part,
                    short(d.stiffness[0][0]),
                    short(d.stiffness[0][1]),
                    short(d.stiffness[3][3]),
                    short(d.conductivity[0][0]),
                    short(d.volume_fraction)
                );
            }
        }
        text
    }

    /// Title and lines beside a picture.
    pub fn caption(&self) -> (String, Vec<String>) {
        let fine = self.fine();
        let title = format!("{}: {}", self.source.name, self.source.period.describe());
        let mut lines = vec![format!("volume fraction {:.4}", fine.volume_fraction)];
        if self.material.young.is_none() {
            lines.push("relative to the solid's E".to_owned());
        }
        lines.push(format!("Poisson's ratio {}", self.material.poisson));
        if let Some(e) = &fine.engineering {
            lines.push(format!("Zener ratio {:.4}", e.zener));
            let name = self.fine().plane_strain.map_or("bulk", |_| "plane bulk");
            lines.push(format!("{name} modulus {}", short(self.bulk(e))));
        }
        (title, lines)
    }
}

/// A ratio to a bound as text.
fn of_bound(share: Option<f64>) -> String {
    share.map_or("no bound".to_owned(), |s| {
        format!("{s:.3} of the Hashin-Shtrikman bound")
    })
}

/// A number in five significant digits.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".to_owned();
    }
    if (1e-3..1e6).contains(&v.abs()) {
        let digits = (4 - v.abs().log10().floor() as i32).clamp(0, 8) as usize;
        format!("{v:.digits$}")
    } else {
        format!("{v:.4e}")
    }
}

/// Writes the rows of a matrix; entries below a millionth of the greatest are rounding and shown as 0.
fn matrix<const N: usize>(text: &mut String, m: &[[f64; N]; N]) {
    let greatest = m.iter().flatten().fold(0.0, |a: f64, v| a.max(v.abs()));
    for row in m {
        text.push(' ');
        for v in row {
            let shown = if v.abs() < 1e-6 * greatest { 0.0 } else { *v };
            let _ = write!(text, " {:>11}", short(shown));
        }
        text.push('\n');
    }
}

/// Young's modulus over all directions: polar angle from z and angle around it in degrees, the direction, the modulus.
pub(super) fn modulus_table(compliance: &Voigt) -> String {
    let mut text = "theta,phi,x,y,z,E\n".to_owned();
    for theta in (0..=180).step_by(ANGLE_STEP_DEGREES) {
        for phi in (0..360).step_by(ANGLE_STEP_DEGREES) {
            let [polar, around] = [theta, phi].map(|d: usize| (d as f64).to_radians());
            let n = Vec3::new(
                libm::sin(polar) * libm::cos(around),
                libm::sin(polar) * libm::sin(around),
                libm::cos(polar),
            );
            let e = directional_modulus(compliance, n);
            let _ = writeln!(text, "{theta},{phi},{},{},{},{e}", n.x, n.y, n.z);
        }
    }
    text
}
