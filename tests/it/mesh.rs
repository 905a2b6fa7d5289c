//! Laws of `mesh`.
