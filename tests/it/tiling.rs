//! Laws of `tiling`.
