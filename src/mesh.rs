//! Triangle meshes: measures, checks, winding number, signed distance.
