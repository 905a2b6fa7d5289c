//! Finite-element decks, as the report of a run lists them: input files of a solver with nodes and elements,
//! either cubes of the solid or elements of the scaffold with homogenised cells.

use serde::Serialize;

/// Counts of a finite-element deck; lengths are in the deck's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DeckFacts {
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub elements: u64,
    /// Edge of the elements.
    pub element_size: f64,
    /// Volume of the elements.
    pub volume: f64,
    /// Elements that share no face with the largest component, left out.
    pub dropped_elements: u64,
    /// Components of these.
    pub dropped_components: u64,
}

/// A homogenised cell of a deck.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MacroLawFacts {
    /// The cell's name.
    pub cell: String,
    /// The element that it fills.
    pub element: &'static str,
    /// Its period.
    pub period: String,
    /// The graded quantity: "thickness" over the element's size, "`volume_fraction`", "level", or "none".
    pub quantity: &'static str,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Least and greatest volume fraction.
    pub volume_fraction: [f64; 2],
    /// Ratio of the edges of its period.
    pub aspect: [f64; 3],
    /// Number of homogenised values.
    pub points: usize,
    /// Number of materials.
    pub materials: usize,
}

/// Counts of a deck of the scaffold's elements, in the deck's units.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MacroDeckFacts {
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub elements: u64,
    /// Volume of the elements.
    pub volume: f64,
    /// Volume of their solid by the homogenised cells.
    pub solid_volume: f64,
    /// Mass of the solid, where the output gives a density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// Homogenised cells.
    pub laws: Vec<MacroLawFacts>,
    /// Greatest stretch of an element beside its cell's period: 1 where the law is exact.
    pub stretch: f64,
    /// What the deck does not represent, in words.
    pub notes: Vec<String>,
}
