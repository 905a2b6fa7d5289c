//! Closed meshes are solids: unions, voids, turned shells.
