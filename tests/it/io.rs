//! Laws of `io`.
