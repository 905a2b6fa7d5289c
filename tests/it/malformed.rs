//! Laws of `malformed`.
