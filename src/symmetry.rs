//! Point groups as integer matrices on a lattice, and the orbits of frequencies.
