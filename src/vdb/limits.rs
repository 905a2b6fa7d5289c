//! Limits of analyses.

/// Maximum number of cubes.
pub const MAX_CUBES: u64 = 1 << 28;
