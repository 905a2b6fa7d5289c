//! Round struts have the asked diameter in world space.
