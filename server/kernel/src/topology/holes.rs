//! Filling a patch's small holes, for the solve and for what is cut or composed.
//!
//! Each hole gets a vertex at its middle and a fan of triangles around it; they are appended to the patch's and belong
//! to no polygon ([`NONE`]), by which they are told from the surface. *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, pair_halfedges};

/// The mesh with the loops of halfedges in `holes` filled.
pub fn filled(mesh: &TriMesh, holes: &[Vec<u32>]) -> TriMesh {
    let mut out = mesh.clone();
    for hole in holes.iter().filter(|h| !h.is_empty()) {
        let middle = out.positions.len() as u32;
        let sum: Vec3 = hole.iter().map(|&h| mesh.positions[mesh.tail(h) as usize]).sum();
        out.positions.push(sum / hole.len() as f64);
        for &h in hole {
            // Against the boundary's halfedge.
            out.triangles.push([mesh.head(h), mesh.tail(h), middle]);
            out.polygon_of.push(NONE);
        }
    }
    if let Ok(twins) = pair_halfedges(&out.triangles) {
        out.phantom.resize(twins.len(), true);
        out.twins = twins;
        return out;
    }
    // A loop of prepared meshes passes no vertex twice, so that every fan is manifold.
    mesh.clone()
}

/// Whether a triangle of a chart's mesh is filling and no surface.
pub fn is_filling(mesh: &TriMesh, triangle: u32) -> bool {
    mesh.polygon_of.get(triangle as usize) == Some(&NONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{Components, Topology, classify, primitive, submesh, tests::grid};

    #[test]
    fn a_sheet_with_its_holes_filled_is_the_sheet() {
        let sheet = grid(24, 24, false, false);
        let gone = [200, 333, 500, 611, 777, 905];
        let kept: Vec<u32> = (0..sheet.triangles.len() as u32).filter(|t| !gone.contains(t)).collect();
        let patch = primitive(&submesh(&sheet, &kept).0, Components::default()).expect("a disc");
        assert_eq!(patch.holes.len(), gone.len());
        let whole = filled(&patch.mesh, &patch.holes);
        assert_eq!(classify(&whole), Ok(Topology::Disc));
        assert!((whole.total_area() - 1.0).abs() < 1e-12);
        let fillings = (0..whole.triangles.len() as u32).filter(|&t| is_filling(&whole, t)).count();
        assert_eq!(fillings, 3 * gone.len());
    }
}
