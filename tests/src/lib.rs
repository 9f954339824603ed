//! What the end-to-end tests, the walls and the runner on real input share.

pub mod binaries;
pub mod bounds;
pub mod client;
pub mod http;
pub mod judge;
pub mod kills;
pub mod load;
pub mod real_input;
pub mod retopo_judged;
pub mod scale;
pub mod server;
pub mod shapes;
pub mod shared;
pub mod soak;
pub mod tool;
pub mod walls;
