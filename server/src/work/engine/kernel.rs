//! The engine in earnest: the kernel.
