//! The kernel from outside.
mod boundary;
mod hostile_meshes;
mod mesh_fuzz;
mod mesh_growth;
mod stopping;
mod tori;
mod unfolding;
mod validity;
