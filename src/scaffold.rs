//! Scaffolds: unstructured meshes of solid elements, with their maps.
