//! The recipe: one TOML document from sources to files.
