//! What the server does, free of HTTP.

pub mod picture;
