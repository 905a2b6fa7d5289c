//! Sheets have the asked thickness in world space.
