//! What the end-to-end tests, the walls and the runner on real input share.

pub mod walls;
