//! PLY: ascii and both binary encodings, with polygons of any degree and whatever else the header declares.
//!
//! Read by hand: rows are typed by the header, so that nothing is allocated for elements and properties that are not
//! kept, and an announced count is compared with the bytes that are there before anything is reserved.

mod header;
mod read;
mod strips;
mod write;

pub(super) use read::read;
pub(super) use write::write;

#[cfg(test)]
mod tests;
