//! `druse grade RECIPE --results r.frd --field S -o field.vtu`: a new grading from results of the recipe's deck.
//! The recipe is not changed; its next run reads the written field if its keys name it.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::frame::{LengthUnit, figures};
use crate::io::atomic::require_writable;
use crate::pipeline;
use crate::pipeline::{GradeOptions, GradeReport, GradeRule};
use crate::recipe::Recipe;
use clap::{Args, ValueEnum};
use std::fmt::Write;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe (.toml) whose deck was solved: an output fe without kind.
    recipe: PathBuf,
    /// Results: the .frd of `CalculiX`, or a .vtu of other programs.
    #[arg(long, value_name = "FILE")]
    results: PathBuf,
    /// The field: a stress such as S (six numbers), or an energy density such as ENER (one number).
    #[arg(long, value_name = "NAME")]
    field: String,
    /// The new thickness or volume fraction at the scaffold's nodes (.vtu), for [tiling] as
    /// thickness = { file = "field.vtu", field = "thickness" }.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The stress of a fully stressed element, as in 120MPa (forces in newtons) or a number in the deck's units.
    #[arg(long, value_name = "STRESS")]
    limit: Option<String>,
    /// Mass of the new part over that of the present one [default: 1, unless --limit sets the mass].
    #[arg(long, value_name = "RATIO")]
    mass: Option<f64>,
    /// Least and greatest thickness (the recipe's unit) or volume fraction [default: volume fractions 0.05:0.8].
    #[arg(long, value_name = "LEAST:GREATEST")]
    bounds: Option<String>,
    /// Radius of the filter in the recipe's unit, 0 for none [default: one and a half elements].
    #[arg(long, value_name = "LENGTH")]
    filter: Option<f64>,
    /// Greatest factor by which an element's volume fraction changes.
    #[arg(long, value_name = "FACTOR", default_value_t = 2.0)]
    step: f64,
    /// Power of measure over target [default: 1 for stress, 0.5 for energy].
    #[arg(long, value_name = "POWER")]
    exponent: Option<f64>,
    /// What elements are compared by [default: by the numbers of the field].
    #[arg(long, value_enum)]
    rule: Option<Rule>,
    /// Unit of the results' lengths [default: that of the recipe's deck].
    #[arg(long, value_name = "UNIT")]
    unit: Option<LengthUnit>,
    /// Override a key of the recipe, as in tiling.thickness=1.2.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// What elements are compared by.
#[derive(Clone, Copy, ValueEnum)]
enum Rule {
    /// Von Mises stress of the mean stress in the solid.
    Stress,
    /// Strain energy per volume of solid.
    Energy,
}

/// Makes a new grading from the results of a deck. All flags are checked before the recipe is computed.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    if p.output.extension().is_none_or(|e| e != "vtu") {
        return Err(Failure::usage(format!(
            "found -o {}; expected a name that ends in .vtu",
            p.output.display()
        )));
    }
    require_writable(&p.output)?;
    let positive = |flag: &str, value: Option<f64>| match value {
        Some(v) if !(v.is_finite() && v > 0.0) => Err(Failure::usage(format!(
            "{flag}: found {v}; expected a positive number"
        ))),
        other => Ok(other),
    };
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    // Without --unit, results are in the unit of the recipe's deck; of a recipe without one, in its own.
    let deck_unit = p.unit.unwrap_or_else(|| {
        let outputs = &recipe.sections().output;
        let deck = outputs.iter().find(|o| o.is_macro_deck());
        deck.map_or(recipe.unit(), |o| o.unit_or_default(recipe.unit()))
    });
    if p.step.is_nan() || p.step <= 1.0 {
        return Err(Failure::usage(format!(
            "--step: found {}; expected a factor above 1",
            p.step
        )));
    }
    if p.filter.is_some_and(|f| !(f.is_finite() && f >= 0.0)) {
        return Err(Failure::usage(
            "--filter: expected a radius that is not negative",
        ));
    }
    let limit = p.limit.as_deref().map(|text| limit(text, deck_unit));
    let limit = limit.transpose().map_err(Failure::usage)?;
    if limit.is_some() && matches!(p.rule, Some(Rule::Energy)) {
        return Err(Failure::usage(
            "--limit is a stress; expected it without --rule energy",
        ));
    }
    let bounds = p.bounds.as_deref().map(bounds).transpose();
    let options = GradeOptions {
        results: p.results.clone(),
        field: p.field.clone(),
        rule: match (p.rule, limit) {
            (Some(Rule::Energy), _) => Some(GradeRule::Energy),
            // A limit is a stress, so it chooses that rule.
            (Some(Rule::Stress), _) | (None, Some(_)) => Some(GradeRule::Stress),
            (None, None) => None,
        },
        limit: positive("--limit", limit)?,
        mass: positive("--mass", p.mass)?,
        bounds: bounds.map_err(Failure::usage)?,
        filter: p.filter,
        step: p.step,
        exponent: positive("--exponent", p.exponent)?,
        unit: p.unit,
    };
    let run = super::vdb::run_options(p.threads, session)?;
    let report = pipeline::grade(&recipe, &run, &options, &p.output, session)?;
    session.finish();
    let mut text = describe(&report, recipe.unit());
    let shown = p.output.display().to_string();
    let _ = write!(
        text,
        "{}  {}",
        super::terminal::line(&shown),
        super::numbers::size(report.bytes)
    );
    let mut facts = serde_json::to_value(&report).unwrap_or_default();
    facts["path"] = shown.into();
    Ok(Answer::new(text, facts))
}

/// The new grading in words; lengths in the recipe's unit, measures in that of the results.
fn describe(r: &GradeReport, unit: LengthUnit) -> String {
    let measure = match r.rule {
        GradeRule::Stress => "stress in the solid",
        GradeRule::Energy => "energy per volume of solid",
    };
    let above = r
        .above_limit
        .map_or(String::new(), |n| format!(", {n} elements above the limit"));
    // A thickness is a length; a volume fraction and a level have no unit.
    let of = match r.quantity {
        "thickness" => format!(" {unit}"),
        _ => String::new(),
    };
    format!(
        "{measure}: mean {}, greatest {}, target {}{above}\nsolid: {} {unit}^3, then {} ({:+.2} %)\n\
         {}: {} to {}{of}, then {} to {}{of}; {} of {} elements at a bound\n",
        figures(r.mean),
        figures(r.greatest),
        figures(r.target),
        figures(r.solid_volume),
        figures(r.new_solid_volume),
        100.0 * (r.new_solid_volume / r.solid_volume - 1.0),
        r.quantity,
        figures(r.range[0]),
        figures(r.range[1]),
        figures(r.new_range[0]),
        figures(r.new_range[1]),
        r.at_bounds,
        r.elements
    )
}

/// A stress in newtons per square of the deck's unit, from "120MPa"; a bare number is in the deck's units. The
/// error is text for the user.
fn limit(text: &str, unit: LengthUnit) -> Result<f64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let suffix = &text[number.len()..];
    // An exponent is not a unit.
    let (number, suffix) = match text.parse::<f64>() {
        Ok(_) => (text, ""),
        Err(_) => (number, suffix),
    };
    let pascals = match suffix {
        "" => None,
        "Pa" => Some(1.0),
        "kPa" => Some(1e3),
        "MPa" => Some(1e6),
        "GPa" => Some(1e9),
        _ => Some(f64::NAN), // as a text that is no number: refused below
    };
    let value = number.trim().parse::<f64>().unwrap_or(f64::NAN);
    let square = unit.to(LengthUnit::Metre).powi(2);
    let found = pascals.map_or(value, |p| value * p * square);
    if found.is_finite() && found > 0.0 {
        return Ok(found);
    }
    Err(format!(
        "--limit: found {text:?}; expected a positive number, with Pa, kPa, MPa or GPa or without, as in 120MPa"
    ))
}

/// Two positive numbers in order, as in 0.5:2.
fn bounds(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<f64> = text
        .split(':')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    match numbers[..] {
        [low, high]
            if text.split(':').count() == 2 && low > 0.0 && high >= low && high.is_finite() =>
        {
            Ok([low, high])
        }
        _ => Err(format!(
            "--bounds: found {text:?}; expected two positive numbers in order, as in 0.5:2"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_stresses_in_the_units_of_the_deck() {
        assert_eq!(limit("120MPa", LengthUnit::Millimetre), Ok(120.0));
        assert_eq!(limit("120MPa", LengthUnit::Metre), Ok(120e6));
        assert_eq!(limit("1.2e2", LengthUnit::Metre), Ok(120.0));
        for wrong in ["", "MPa", "-3", "12 psi", "0MPa"] {
            assert!(limit(wrong, LengthUnit::Metre).is_err(), "{wrong}");
        }
        assert_eq!(bounds("0.5:2"), Ok([0.5, 2.0]));
        for wrong in ["2:1", "1", "0:1", "1:2:3", "a:2"] {
            assert!(bounds(wrong).is_err(), "{wrong}");
        }
    }
}
