//! Laws of `vdb`.
