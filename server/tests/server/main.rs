//! The server from inside: corpus, queries and maps without HTTP.
mod determinism;
mod landmarks;
mod parts;
mod transfer;
