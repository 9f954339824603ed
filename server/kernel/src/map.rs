//! The cross map ψ* = φ₂⁻¹ ∘ ψ̂ ∘ φ₁ of an example onto the input.
//!
//! *Source:* paper Eq. 7.

use crate::encode::index::{Location, PlanarIndex};
use crate::register::Registration;
use crate::unfold::{Chart, Uv};

/// Where each vertex of the example's patch goes on the input.
pub fn vertex_locations(
    registration: &Registration,
    example: &Chart,
    input: &Chart,
    index: &PlanarIndex,
) -> Vec<Location> {
    let locate = |x: Uv| index.locate(input, registration.map(example.topology, x));
    example.uv[..example.patch_vertices]
        .iter()
        .enumerate()
        .map(|(v, &uv)| {
            let pole = example.poles.iter().find(|p| p.vertex as usize == v);
            locate(pole.map_or(uv, |p| [uv[0], if p.at_top { 1.0 } else { 0.0 }]))
        })
        .collect()
}
