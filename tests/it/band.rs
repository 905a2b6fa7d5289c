//! Laws of `band`.
