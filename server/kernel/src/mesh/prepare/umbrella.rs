//! Vertices as fans of corners.
//!
//! A vertex of the prepared mesh is a set of corners that are connected across edges: so a vertex of the upload at which
//! several fans touch becomes several, and vertices along a stitched seam become one.

use super::surface::CornerRows;
use crate::mesh::disjoint::Sets;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::{NONE, Vec3};
use crate::numerics::stop;

/// For each corner, the smallest corner of its fan. `same_way` tells whether two paired halfedges run the same way.
pub(super) fn fans(surface: &CornerRows, mut same_way: impl FnMut(u32, u32) -> bool) -> Vec<u32> {
    let mut sets = Sets::new(surface.corner_count() as usize);
    for c in 0..surface.corner_count() {
        stop::pass(1);
        let d = surface.twins[c as usize];
        if d == NONE || d < c {
            continue;
        }
        let (next_c, next_d) = (surface.next(c), surface.next(d));
        let [with_c, with_next_c] = if same_way(c, d) { [d, next_d] } else { [next_d, d] };
        sets.join(c, with_c);
        sets.join(next_c, with_next_c);
    }
    (0..surface.corner_count()).map(|c| sets.root(c)).collect()
}

/// The vertices of the prepared mesh.
pub(super) struct Vertices {
    /// Vertex, a corner of the surface.
    pub(super) of_corner: Vec<u32>,
    /// Position, a vertex.
    pub(super) positions: Vec<Vec3>,
    /// A vertex for each vertex of the upload; [`NONE`] for those without a face.
    pub(super) of_upload: Vec<u32>,
}

/// Numbers the fans of a surface of which all rows agree, in the order of the upload's vertices.
pub(super) fn number(surface: &CornerRows, positions: &[Vec3], repairs: &mut Repairs) -> Vertices {
    let fan_of = fans(surface, |_, _| false);
    let mut lowest = vec![NONE; fan_of.len()];
    for (c, fan) in fan_of.iter().enumerate() {
        let slot = &mut lowest[*fan as usize];
        *slot = (*slot).min(surface.tail(c as u32));
    }
    let mut order: Vec<(u32, u32)> =
        (0..fan_of.len() as u32).filter(|c| fan_of[*c as usize] == *c).map(|c| (lowest[c as usize], c)).collect();
    order.sort_unstable();
    let mut number_of = vec![NONE; fan_of.len()];
    order.iter().enumerate().for_each(|(number, (_, fan))| number_of[*fan as usize] = number as u32);
    let of_corner: Vec<u32> = fan_of.iter().map(|fan| number_of[*fan as usize]).collect();
    let vertices = Vertices {
        positions: order.iter().map(|(v, _)| positions[*v as usize]).collect(),
        of_upload: of_upload(surface, &of_corner, positions.len()),
        of_corner,
    };
    report(surface, &vertices, &order, positions, repairs);
    vertices
}

fn of_upload(surface: &CornerRows, of_corner: &[u32], upload_count: usize) -> Vec<u32> {
    let mut of_upload = vec![NONE; upload_count];
    for (c, vertex) in of_corner.iter().enumerate() {
        let slot = &mut of_upload[surface.tail(c as u32) as usize];
        *slot = (*slot).min(*vertex);
    }
    of_upload
}

/// Notes which vertices were joined and which doubled.
fn report(surface: &CornerRows, vertices: &Vertices, order: &[(u32, u32)], positions: &[Vec3], repairs: &mut Repairs) {
    let mut pairs: Vec<(u32, u32)> =
        vertices.of_corner.iter().enumerate().map(|(c, vertex)| (surface.tail(c as u32), *vertex)).collect();
    pairs.sort_unstable();
    pairs.dedup();
    for run in pairs.chunk_by(|x, y| x.0 == y.0) {
        repairs.note_many(RepairKind::PinchedVertices, run.len() as u64 - 1, run[0].0);
    }
    for (upload, vertex) in pairs {
        let lowest = order[vertex as usize].0;
        if lowest != upload {
            let equal = positions[lowest as usize] == positions[upload as usize];
            let kind = if equal { RepairKind::WeldedVertices } else { RepairKind::NearlyWeldedVertices };
            repairs.note(kind, upload);
        }
    }
}
