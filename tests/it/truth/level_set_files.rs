//! Tools on level-set files: slices, bands, round trips.
