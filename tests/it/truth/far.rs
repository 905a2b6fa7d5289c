//! Parts far from the origin keep their volume.
