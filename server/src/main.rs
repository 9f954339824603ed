//! The long-running corpus search service of Quadmuse.

fn main() {}
