//! Heads: discs, open at the neck, with loops of quads around eyes and mouth.
//!
//! A head is drawn on a *peg*, a tube with a dome: azimuth a (0 in front, growing towards the head's left) and
//! height t. [`peg`] turns the peg into a skull by sections, [`human`] and [`beast`] lay the quads on it and sculpt
//! the features.

pub(super) mod beast;
mod eyes;
pub(super) mod human;
mod loops;
mod peg;
