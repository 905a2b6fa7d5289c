//! Nastran bulk data, `.bdf` and `.nas`: grid points, coordinate systems, elements.
//!
//! Cards in small, large and free field are read with their continuations and includes; content
//! before a `BEGIN BULK` is ignored. Solids and shells become elements, property numbers become groups.
//! Bars, springs, masses and rigid links are counted and skipped; loads, materials and properties
//! do not affect the shape. A card that makes elements or points in another way is an error.
//! A missing mid node lies in the middle of its edge, as in Nastran.

mod cards;
mod elements;
mod systems;
mod table;

use super::collector::Collector;
use super::element_file::ElementFile;
use super::error::{Place, ReadError};
use super::source::quote;
use cards::{Card, Cards};
use druse_geometry::frame::Vec3;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use systems::Systems;
use table::{NON_ELEMENT_CARDS, REFUSED_CARDS, SKIPPED_CARDS};

/// Greatest depth of nested includes.
const MAX_INCLUDE_DEPTH: usize = 8;

/// Reads a deck.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains unsupported elements or points.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut deck = Deck::new(path);
    deck.file(path, 0)?;
    deck.finish()
}

/// The data of a GRID card.
struct Grid {
    /// The coordinate system; `None` for that of GRDSET.
    system: Option<u64>,
    at: [f64; 3],
    line: u64,
}

struct Deck<'a> {
    path: &'a Path,
    collector: Collector<'a>,
    /// Grid points in file order, and their indices by number.
    grids: Vec<(u64, Grid)>,
    places: HashMap<u64, u32>,
    systems: Systems,
    /// GRDSET's coordinate system.
    default_system: u64,
    /// A hash of each element by number, to recognise repeated cards.
    elements: HashMap<u64, u64>,
    /// The numbers of added mid nodes by the end nodes of their edges.
    missing_mid_nodes: HashMap<[u64; 2], u64>,
    /// Cards that repeat an earlier one.
    repeated: usize,
    /// Skipped cards by name, with their counts.
    skipped: BTreeMap<String, usize>,
    has_begun: bool,
    has_ended: bool,
    /// The first error; dropped if the bulk data only begin after it.
    first_error: Option<ReadError>,
}

impl<'a> Deck<'a> {
    fn new(path: &'a Path) -> Self {
        Self {
            path,
            collector: Collector::new(path),
            grids: Vec::new(),
            places: HashMap::new(),
            systems: Systems::default(),
            default_system: 0,
            elements: HashMap::new(),
            missing_mid_nodes: HashMap::new(),
            repeated: 0,
            skipped: BTreeMap::new(),
            has_begun: false,
            has_ended: false,
            first_error: None,
        }
    }

    /// Reads a file card by card; `depth` is the number of files that include it.
    fn file(&mut self, path: &Path, depth: usize) -> Result<(), ReadError> {
        let mut cards = Cards::open(path)?;
        let mut card = Card::default();
        while !self.has_ended && cards.next(&mut card)? {
            if card.name == "BEGIN" {
                self.begin(&card)?;
                continue;
            }
            // Executive and case control precede BEGIN BULK and may contain anything.
            if self.first_error.is_some() {
                continue;
            }
            let read = match card.name.as_str() {
                "INCLUDE" => self.include(&card, path, depth),
                _ => self.card(&card),
            };
            match read {
                Err(first_error) if !self.has_begun => self.first_error = Some(first_error),
                other => other?,
            }
        }
        Ok(())
    }

    /// `BEGIN BULK`: discards all content before it, its errors included. A second one, or another word than
    /// BULK, is an error.
    fn begin(&mut self, card: &Card) -> Result<(), ReadError> {
        if self.has_begun || !matches!(card.field(0), "" | "BULK") {
            let found = format!("BEGIN {}", quote(card.field(0)));
            let e = card.bad(found, "one BEGIN BULK");
            return Err(e.with_hint("superelements and models beside it cannot be read"));
        }
        *self = Self {
            has_begun: true,
            ..Self::new(self.path)
        };
        Ok(())
    }

    /// Reads the file of an INCLUDE card, relative to the folder of the file `path` that has it.
    fn include(&mut self, card: &Card, path: &Path, depth: usize) -> Result<(), ReadError> {
        if card.field(0).is_empty() {
            return Err(card.bad("INCLUDE without a file", "INCLUDE 'FILE'"));
        }
        if depth == MAX_INCLUDE_DEPTH {
            let found = format!("an INCLUDE {MAX_INCLUDE_DEPTH} files deep");
            return Err(card.bad(found, "fewer includes within includes"));
        }
        let directory = path.parent().unwrap_or(Path::new(""));
        self.file(&directory.join(PathBuf::from(card.field(0))), depth + 1)
    }

    /// Processes a card by its name; other cards than these cannot change the shape and are passed.
    fn card(&mut self, card: &Card) -> Result<(), ReadError> {
        let name = card.name.as_str();
        match name {
            "ENDDATA" => self.has_ended = true,
            "GRID" => self.grid(card)?,
            "GRDSET" => {
                card.check()?;
                self.default_system = card.number(1)?.unwrap_or(0);
            }
            _ if name.starts_with("CORD") => self.systems.add(card)?,
            _ if elements::is_element(name) => self.element(card)?,
            _ if SKIPPED_CARDS.contains(&name) => {
                *self.skipped.entry(name.to_owned()).or_default() += 1;
                self.collector.skipped += 1;
            }
            // Cards that make elements in other ways, and names near to those that are read, would silently
            // change the shape.
            _ if REFUSED_CARDS.contains(&name) || name.starts_with('=') || is_unknown(name) => {
                let e = card.bad(format!("the card {}", quote(name)), "cards that are known");
                return Err(e.with_hint(
                    "it may make points or elements; GRID, CTETRA, CHEXA, CPENTA, CPYRAM, CTRIA3, \
                     CQUAD4 and the like are read",
                ));
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds a grid point; the same point may be listed again. Missing coordinates are 0.
    fn grid(&mut self, card: &Card) -> Result<(), ReadError> {
        card.check()?;
        let number = card.needed(0, "a grid point's number")?;
        let mut at = [0.0; 3];
        for (i, c) in at.iter_mut().enumerate() {
            *c = card.real(2 + i)?.unwrap_or(0.0);
        }
        let system = card.number(1)?;
        let place = self.grids.len() as u32;
        if let Some(&earlier) = self.places.get(&number) {
            let (_, grid) = &self.grids[earlier as usize];
            if grid.at != at || grid.system != system {
                let place = Place::ItemOnLine("node", number, card.line);
                let found = format!("another node of this number than on line {}", grid.line);
                let expected = "every number once";
                return Err(ReadError::data(&card.path, place, found, expected));
            }
            self.repeated += 1;
            return Ok(());
        }
        self.places.insert(number, place);
        let line = card.line;
        self.grids.push((number, Grid { system, at, line }));
        Ok(())
    }

    /// The coordinates of a grid point in the basic system, the global rectangular one; an error for an unknown system.
    fn to_basic(&self, grid: &Grid, number: u64) -> Result<Vec3, ReadError> {
        let system = grid.system.unwrap_or(self.default_system);
        self.systems.to_basic(system, grid.at).ok_or_else(|| {
            let place = Place::ItemOnLine("node", number, grid.line);
            let found = format!("coordinate system {system}, which is not in the deck");
            ReadError::data(self.path, place, found, "one of its CORD cards")
        })
    }

    /// Resolves systems and missing nodes once all cards are read, and builds the elements.
    fn finish(mut self) -> Result<ElementFile, ReadError> {
        if let Some(first_error) = self.first_error.take() {
            return Err(first_error);
        }
        // Cards come in any order: a system may refer to grid points and to other systems that follow it.
        let mut systems = std::mem::take(&mut self.systems);
        systems.resolve(self.path, self.default_system, |number| {
            let place = *self.places.get(&number)? as usize;
            let grid = &self.grids[place].1;
            Some((grid.system, grid.at))
        })?;
        self.systems = systems;
        for (number, grid) in &self.grids {
            let at = self.to_basic(grid, *number)?;
            self.collector.point(*number, at.into());
        }
        self.add_mid_nodes()?;
        if self.repeated > 0 {
            self.collector
                .notes
                .push(format!("{} repeated cards are used once", self.repeated));
        }
        if !self.skipped.is_empty() {
            let list: Vec<String> = self
                .skipped
                .iter()
                .map(|(name, count)| format!("{count} {name}"))
                .collect();
            self.collector
                .notes
                .push(format!("skipped cards: {}", list.join(", ")));
        }
        self.collector.finish(|_| None)
    }
}

/// Whether a card is in none of the tables and may make elements.
fn is_unknown(name: &str) -> bool {
    name.starts_with('C')
        && !NON_ELEMENT_CARDS
            .iter()
            .any(|known| match known.strip_suffix('*') {
                Some(start) => name.starts_with(start),
                None => name == *known,
            })
}
