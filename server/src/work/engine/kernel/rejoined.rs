//! One example on all segments of a query, put together again.

use super::super::{EngineError, Model, Stitched};
use super::model::ModelInner;
use quadmuse_kernel::compose::check::extraordinary;
use quadmuse_kernel::map::rejoin;
use quadmuse_kernel::mesh::PolyMesh;
use std::sync::Arc;

/// The example whole, if every segment of it lies on one of the query's and they border on each other alike.
pub(super) fn rejoin(
    query: &Model,
    example: &Model,
    parts: &[(u32, u32, Arc<PolyMesh>)],
) -> Result<Option<Stitched>, EngineError> {
    let (on, of): (&ModelInner, &ModelInner) = (query.inner.open()?, example.inner.open()?);
    let count = of.segmented.parts.len();
    let mut mapped: Vec<Option<(u32, &PolyMesh)>> = vec![None; count];
    for (segment, part, mesh) in parts {
        match mapped.get_mut(*part as usize) {
            Some(place @ None) => *place = Some((*segment, mesh)),
            _ => return Ok(None),
        }
    }
    let mapped: Option<Vec<(u32, &PolyMesh)>> = mapped.into_iter().collect();
    let Some(mapped) = mapped.filter(|m| m.len() == on.segmented.parts.len()) else { return Ok(None) };
    let alike = |part: usize| {
        let mut there: Vec<u32> =
            of.segmented.neighbours(part as u32).iter().filter_map(|&n| mapped.get(n as usize)).map(|m| m.0).collect();
        there.sort_unstable();
        there == on.segmented.neighbours(mapped[part].0)
    };
    if !(0..count).all(alike) {
        return Ok(None);
    }
    let meshes: Vec<&PolyMesh> = mapped.iter().map(|m| m.1).collect();
    let part_of = of.part_of_faces(example.mesh.faces.len());
    // Parts that do not fit together as the example's do are stitched like any others.
    let Ok(mesh) = rejoin::rejoin(&example.mesh, &part_of, &meshes, &on.segmented.mesh) else { return Ok(None) };
    Ok(Some(Stitched {
        is_poor_kept: false,
        extraordinary_vertices: extraordinary(&mesh) as u64,
        extraordinary_before: extraordinary(&example.mesh) as u64,
        notes: vec!["one example on all segments: its own faces, put together again whole".into()],
        mesh: Arc::new(mesh),
    }))
}
