//! Solids that touch are one piece.
