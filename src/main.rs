//! The `druse` program: parse, run, exit code.

fn main() {}
