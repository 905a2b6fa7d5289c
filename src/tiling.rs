//! Tilings: one cell over all elements of a scaffold, as a distance field in world space.
