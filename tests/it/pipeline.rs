//! Laws of `pipeline`.
