//! Laws of `symmetry`.
