//! Filling a patch's small holes for the solve.
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
    use crate::unfold::{UnfoldOptions, signed_area, unfold};

    #[test]
    fn a_sheet_with_holes_unfolds_like_the_sheet() {
        let sheet = grid(24, 24, false, false);
        let kept: Vec<u32> =
            (0..sheet.triangles.len() as u32).filter(|t| ![200, 333, 500, 611, 777, 905].contains(t)).collect();
        let patch = primitive(&submesh(&sheet, &kept).0, Components::default()).expect("a disc");
        assert_eq!(patch.holes.len(), 6);
        let whole = filled(&patch.mesh, &patch.holes);
        assert_eq!(classify(&whole), Ok(Topology::Disc));
        assert!((whole.total_area() - 1.0).abs() < 1e-12);
        let pole = UnfoldOptions { poles: vec![25 * 12 + 12] };
        let chart = unfold(&patch, &pole).expect("solvable");
        let sound = unfold(&crate::topology::whole(&sheet).expect("a disc"), &pole).expect("solvable");
        assert!((chart.modulus - sound.modulus).abs() < 0.01 * sound.modulus, "{} {}", chart.modulus, sound.modulus);
        assert!(
            (chart.corners.iter().map(signed_area).sum::<f64>() - sound.corners.iter().map(signed_area).sum::<f64>())
                .abs()
                < 0.01
        );
        assert_eq!(chart.patch_vertices, patch.mesh.positions.len());
    }
}
