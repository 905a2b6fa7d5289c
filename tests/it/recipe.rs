//! Laws of `recipe`.
