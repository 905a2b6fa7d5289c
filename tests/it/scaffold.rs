//! Laws of `scaffold`.
