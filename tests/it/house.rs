//! Laws of `house`.
