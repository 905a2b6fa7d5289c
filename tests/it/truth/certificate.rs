//! A failing certificate warns; defaults meet across faces.
