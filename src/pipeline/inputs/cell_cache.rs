//! Fitted cells that the runs of a changing recipe share, so that only changed cells are fitted and levelled
//! again. A cell is found by its name, element and keys, and by size and time of its files.

use super::cells::with_level;
use super::run_cache::file_key;
use super::source::{SourceFault, SourceReader, SourceRecord};
use crate::cell::Cell;
use crate::frame::{Aabb, Element};
use crate::pipeline::base::error::CellFault;
use crate::pipeline::base::warning::Warning;
use crate::recipe::CellSection;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Cells that are kept; the cache is emptied when there are more.
const MAX_CELLS: usize = 64;

/// Cells by the keys that they were fitted with. Clones share the cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct CellCache(Arc<Mutex<BTreeMap<String, FittedCell>>>);

/// A cell before its level is set, the same with levels that were requested, and the entries of its source for the
/// report.
#[derive(Clone, Debug)]
struct FittedCell {
    cell: Cell,
    /// By the keys of the level.
    levelled: BTreeMap<String, Cell>,
    warnings: Vec<Warning>,
    file: Option<(&'static str, PathBuf, Aabb)>,
}

impl CellCache {
    /// The cell of a section before its level is set: the kept one, if its keys and its file are the same, else the one
    /// that `reader` makes, which is kept unless it has no key. Warnings and file go to `record` in all cases.
    pub(crate) fn cell(
        &self,
        reader: &SourceReader,
        name: &str,
        section: &CellSection,
        element: Element,
        record: &mut SourceRecord,
    ) -> Result<Cell, SourceFault> {
        let Some(key) = key(reader, name, section, element) else {
            return reader.cell(name, section, element, record);
        };
        let kept = self.lock().get(&key).cloned();
        if let Some(kept) = kept {
            record.warnings = kept.warnings;
            record.file = kept.file;
            return Ok(kept.cell);
        }
        let cell = reader.cell(name, section, element, record)?;
        let mut cells = self.lock();
        if cells.len() >= MAX_CELLS {
            cells.clear();
        }
        let fitted = FittedCell {
            cell: cell.clone(),
            levelled: BTreeMap::new(),
            warnings: record.warnings.clone(),
            file: record.file.clone(),
        };
        cells.insert(key, fitted);
        Ok(cell)
    }

    /// A cell of [`CellCache::cell`] at the level of its section: the kept one, if its keys are the same.
    pub(crate) fn with_level(
        &self,
        reader: &SourceReader,
        name: &str,
        section: &CellSection,
        cell: Cell,
    ) -> Result<Cell, CellFault> {
        let Some(key) = key(reader, name, section, cell.element()) else {
            return with_level(cell, section);
        };
        // The level depends on these keys alone; all others are in the key of the cell.
        let level = format!(
            "{:?} {:?} {:?} {:?} {:?}",
            section.level,
            section.volume_fraction,
            section.thickness,
            section.solid,
            section.invert
        );
        let kept = self
            .lock()
            .get(&key)
            .and_then(|f| f.levelled.get(&level).cloned());
        if let Some(kept) = kept {
            return Ok(kept);
        }
        let cell = with_level(cell, section)?;
        if let Some(fitted) = self.lock().get_mut(&key) {
            if fitted.levelled.len() >= MAX_CELLS {
                fitted.levelled.clear();
            }
            fitted.levelled.insert(level, cell.clone());
        }
        Ok(cell)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, FittedCell>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All that a cell before its level depends on: its keys, and size and time of its files. `None` for cells of crystals,
/// which depend on other sections, and where the system does not tell the time of a file. Hybrids and targets, which
/// also do, never come here.
fn key(
    reader: &SourceReader,
    name: &str,
    section: &CellSection,
    element: Element,
) -> Option<String> {
    if section.crystal.is_some() {
        return None;
    }
    let unlevelled = CellSection {
        level: None,
        volume_fraction: None,
        thickness: None,
        solid: None,
        invert: None,
        ..section.clone()
    };
    let mut key = format!("{name} {element:?} {unlevelled:?}");
    let files = [
        &unlevelled.mesh,
        &unlevelled.points,
        &unlevelled.voxels,
        &unlevelled.graph,
        &unlevelled.plates,
        &unlevelled.file,
    ];
    let mut paths: Vec<PathBuf> = files
        .into_iter()
        .flatten()
        .map(|f| reader.resolve(&f.path))
        .collect();
    paths.extend(unlevelled.group.iter().map(|g| reader.resolve(g.as_ref())));
    for path in paths {
        // Names of graphs and groups are no files.
        if path.exists() {
            let _ = write!(key, " {}", file_key(&path)?);
        }
    }
    Some(key)
}
