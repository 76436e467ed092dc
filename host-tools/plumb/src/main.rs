//! `plumb`, the host program.
fn main() {}
