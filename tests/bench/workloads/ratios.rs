//! What each figure was when it was last stored, by processor family: `tests/bench/ratios.json`.
//!
//! A figure that is worse than the stored one by [`LOSS`] or more is named after the table. It is a fault until both
//! states of the program were run in turn on one machine; noise of a shared machine reaches 10 % at times.

use super::baselines;
use super::figure::{FIGURES, Found};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// The least loss that is reported, as a fraction of the stored figure.
const LOSS: f64 = 0.15;

/// Figures by processor family and key.
pub struct Ratios {
    all: Map<String, Value>,
    family: String,
}

impl Ratios {
    /// Reads the stored figures.
    pub fn read() -> Result<Self, Box<dyn std::error::Error>> {
        let all = serde_json::from_slice(&std::fs::read(Self::path())?)?;
        let family = baselines::processor_family();
        Ok(Self { all, family })
    }

    fn path() -> PathBuf {
        [env!("CARGO_MANIFEST_DIR"), "tests/bench/ratios.json"]
            .iter()
            .collect()
    }

    /// The stored figure of this processor's family.
    fn stored(&self, key: &str) -> Option<f64> {
        self.all.get(&self.family)?.get(key)?.as_f64()
    }

    /// One line for each figure that is worse than the stored one by [`LOSS`] or more.
    pub fn losses(&self, found: &[Found]) -> Vec<String> {
        let mut lines = Vec::new();
        for figure in FIGURES {
            let now = found.iter().find(|f| f.key() == figure.key);
            let (Some(now), Some(stored)) = (now.and_then(Found::value), self.stored(figure.key))
            else {
                continue;
            };
            let loss = figure.goal.loss(stored, now);
            if loss >= LOSS {
                lines.push(format!(
                    "LOST {:.0} %: {} is {now:.2} {}, {stored:.2} when it was stored for {}",
                    100.0 * loss,
                    figure.key,
                    figure.unit,
                    self.family
                ));
            }
        }
        lines
    }

    /// Stores these figures for this processor's family; others stay.
    pub fn store(mut self, found: &[Found]) -> Result<(), Box<dyn std::error::Error>> {
        let mut figures = match self.all.remove(&self.family) {
            Some(Value::Object(figures)) => figures,
            _ => Map::new(),
        };
        for found in found {
            if let Some(value) = found.value() {
                figures.insert(
                    found.key().to_owned(),
                    json!((value * 100.0).round() / 100.0),
                );
            }
        }
        self.all.insert(self.family, Value::Object(figures));
        let text = serde_json::to_string_pretty(&Value::Object(self.all))?;
        std::fs::write(Self::path(), text + "\n")?;
        Ok(())
    }
}
