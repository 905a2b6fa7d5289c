//! The narrow band: which 8^3 leaves can meet it, and their values.
