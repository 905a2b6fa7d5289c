//! Laws of `cli`.
