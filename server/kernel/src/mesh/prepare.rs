//! From polygons to a triangle mesh that can be computed with.
//!
//! Safe repairs are made, in this order, and each is reported: repeated corners, duplicate faces, edges of more than
//! two faces, unwelded seams, faces wound against their neighbours, closed surfaces inside out, pinched vertices, edges
//! without length, isolated vertices. What is not safe is refused with the element's number: edges with more faces,
//! one-sided surfaces of examples (those of scans are cut).
//!
//! The upload stays as it is. In particular a closed surface whose normals point inwards is turned here only, so that two
//! surfaces agree about which side is out when one is laid on the other; what the artist gets back keeps the file's
//! winding.

mod collapse;
mod copies;
mod duplicates;
mod ears;
mod orient;
mod shared;
mod stitch;
mod surface;
mod tessellate;
mod umbrella;

#[cfg(test)]
mod tests;

use super::error::MeshError;
use super::repair::{Repair, RepairKind, Repairs};
use super::tri::{NONE, TriMesh, pair_halfedges};
use super::{PolyMesh, Vec3, diagonal, read};
use crate::numerics::stop;
use std::sync::Arc;
use surface::CornerRows;

/// A mesh ready for computation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prepared {
    /// Oriented manifold triangles; `polygon_of` gives the face of the upload.
    pub mesh: Arc<TriMesh>,
    /// The triangle mesh's vertex of each vertex of the upload; [`NONE`] for those that no face uses. A vertex of the
    /// upload that became several points to one of them.
    pub vertex_of: Vec<u32>,
    /// Whether the triangles of each face of the upload run against its winding.
    pub reversed: Vec<bool>,
    /// What was repaired, by kind.
    pub repairs: Vec<Repair>,
}

/// Bounding box diagonals below this underflow when areas are squared.
const DIAGONAL_MIN: f64 = 1e-60;

/// Repairs, orients and tessellates a mesh. The result satisfies [`validate`](super::validate).
///
/// # Errors
/// An element that cannot be used or repaired, by its number.
pub fn prepare(poly: &PolyMesh) -> Result<Prepared, MeshError> {
    prepared(poly, false)
}

/// The same for a scan: pieces that lie exactly on others are left out before, and a surface with one side is cut. In an
/// example they are what its artist meant, or has to mend.
///
/// # Errors
/// As [`prepare`].
pub fn prepare_scan(poly: &PolyMesh) -> Result<Prepared, MeshError> {
    prepared(poly, true)
}

fn prepared(poly: &PolyMesh, is_scan: bool) -> Result<Prepared, MeshError> {
    stop::ask();
    let mut repairs = Repairs::default();
    let diagonal = check(poly, &mut repairs)?;
    let mut surface = CornerRows::cleaned(poly, &mut repairs);
    if is_scan {
        surface = copies::leave_out(surface, &poly.positions, &mut repairs);
    }
    if surface.rows.is_empty() {
        let remedy = "every face has fewer than 3 different corners: export the mesh again";
        return Err(MeshError::NoExtent { diagonal, remedy });
    }
    surface = duplicates::leave_out(surface, &mut repairs);
    let (mut surface, mut sides) = shared::paired(surface, &poly.positions, is_scan, &mut repairs)?;
    stitch::stitch(&mut surface, &mut sides, &poly.positions, diagonal);
    let turned = orient::turn(&mut surface, sides, &poly.positions, &mut repairs);
    let mut reversed = vec![false; poly.faces.len()];
    surface.face_of.iter().zip(&turned).for_each(|(face, turned)| reversed[*face as usize] = *turned);

    let mut vertices = umbrella::number(&surface, &poly.positions, &mut repairs);
    let mut triangles = tessellate::cut(&surface, &mut vertices, &mut repairs)?;
    let kept = collapse::collapse(&mut triangles, &mut vertices.positions, diagonal, &mut repairs)?;
    collapse::report_flat(&triangles, &vertices.positions, &mut repairs);
    let vertex_of = vertices.of_upload.iter().map(|v| if *v == NONE { NONE } else { kept[*v as usize] }).collect();
    let mesh = Arc::new(assemble(triangles, vertices.positions)?);
    Ok(Prepared { mesh, vertex_of, reversed, repairs: repairs.finish() })
}

/// Checks indices and coordinates; returns the diagonal of the used vertices' bounding box.
fn check(poly: &PolyMesh, repairs: &mut Repairs) -> Result<f64, MeshError> {
    let used = read::check(poly)?;
    let mut isolated = (0..used.len()).filter(|v| !used[*v]);
    if let Some(first) = isolated.next() {
        repairs.note_many(RepairKind::IsolatedVertices, 1 + isolated.count() as u64, first as u32);
    }
    let corners = poly.positions.iter().zip(&used).filter(|(_, used)| **used).map(|(p, _)| p);
    let diagonal = diagonal(corners);
    if diagonal < DIAGONAL_MIN {
        let remedy = "all vertices lie at one point or too close to compute with: scale the mesh up or export it again";
        return Err(MeshError::NoExtent { diagonal, remedy });
    }
    Ok(diagonal)
}

fn assemble(triangles: tessellate::Triangles, positions: Vec<Vec3>) -> Result<TriMesh, MeshError> {
    let twins = pair_halfedges(&triangles.corners).map_err(|bad| MeshError::EdgeShared {
        vertices: bad.vertices,
        positions: bad.vertices.map(|v| positions[v as usize]),
        faces: Vec::new(),
        count: bad.halfedges as usize,
    })?;
    Ok(TriMesh {
        positions,
        triangles: triangles.corners,
        twins,
        phantom: triangles.phantom.into_flattened(),
        polygon_of: triangles.face_of,
    })
}
