//! Laws of `cell`.
