//! The corpus in earnest: the store on disk.
