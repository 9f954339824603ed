//! Pieces of an example for which the scan has nothing are spanned where they are surrounded by what lies on it.

use crate::map::CrossMap;
use crate::mesh::TriMesh;
use crate::mesh::bvh::Bvh;
use crate::numerics::stage::Stage;
use crate::settle::spanned;

/// Spans the vertices that are `bare`, for which the input has nothing, between those around them. The example's rim stays.
/// `tree` is the input's. Returns the polygons that move, in order.
pub(crate) fn span(cross: &mut CrossMap, mesh: &TriMesh, bare: &[bool], tree: &Bvh) -> Vec<u32> {
    let rim = mesh.boundary_vertices();
    let free: Vec<bool> = bare.iter().zip(rim).map(|(bare, rim)| *bare && !rim).collect();
    if !free.contains(&true) || !Stage::Span.is_on() {
        return Vec::new();
    }
    let positions = spanned(mesh, &cross.positions, &free);
    for v in (0..free.len()).filter(|v| free[*v]) {
        let place = tree.closest(positions[v]);
        (cross.locations[v], cross.positions[v]) = (place.into(), place.point);
    }
    let moves = mesh.triangles.iter().zip(&mesh.polygon_of).filter(|(t, _)| t.iter().any(|&v| free[v as usize]));
    let mut polygons: Vec<u32> = moves.map(|(_, f)| *f).collect();
    polygons.sort_unstable();
    polygons.dedup();
    polygons
}
