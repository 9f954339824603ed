//! One example on all segments of a query, put together again.

use super::model::{Model, WholeMap};
use super::stitched::{LayoutOwner, Stitched};
use crate::compose::check::extraordinary;
use crate::map::{assemble::select, rejoin};
use crate::mesh::PolyMesh;
use std::sync::Arc;

/// The map of one segment of an example that lies on all segments of a query.
#[derive(Clone, Debug)]
pub struct OnePart {
    /// The query's segment.
    pub segment: u32,
    /// The example's.
    pub example_segment: u32,
    /// The mapped mesh.
    pub mesh: Arc<PolyMesh>,
    /// Whether the caller set constraints on it.
    pub is_edited: bool,
}

/// The example whole, if every segment of it lies on one of the query's and they border on each other alike.
///
/// Where the query was cut as the example is, the example was laid on it whole: what was not edited since is taken from
/// there, since a part knows less of where it belongs, and one that is nearly its own mirror image may lie mirrored.
pub fn rejoin(query: &Model, example: &Model, parts: &[OnePart]) -> Option<Stitched> {
    let (on, of) = (query, example);
    let count = of.segmented.parts.len();
    let part_of = of.part_of_faces(example.mesh.faces.len());
    let is_it = |laid: &&WholeMap| laid.is_of(&example.mesh) && laid.mesh.faces.len() == example.mesh.faces.len();
    let laid = on.laid.as_ref().filter(is_it);
    let by_itself = |part: &OnePart| part.is_edited || part.segment != part.example_segment;
    if let Some(laid) = laid
        && parts.len() == count
        && !parts.iter().any(by_itself)
    {
        return Some(whole(laid.mesh.clone(), example, count));
    }
    let mut mapped: Vec<Option<(u32, Arc<PolyMesh>)>> = vec![None; count];
    for part in parts {
        let mesh = match laid.filter(|_| !by_itself(part)) {
            Some(laid) => Arc::new(select(&laid.mesh, &part_of.iter().map(|p| *p == part.segment).collect::<Vec<_>>())),
            None => Arc::clone(&part.mesh),
        };
        match mapped.get_mut(part.example_segment as usize) {
            Some(place @ None) => *place = Some((part.segment, mesh)),
            _ => return None,
        }
    }
    let mapped: Option<Vec<(u32, Arc<PolyMesh>)>> = mapped.into_iter().collect();
    let mapped = mapped.filter(|m| m.len() == on.segmented.parts.len())?;
    let alike = |part: usize| {
        let mut there: Vec<u32> =
            of.segmented.neighbours(part as u32).iter().filter_map(|&n| mapped.get(n as usize)).map(|m| m.0).collect();
        there.sort_unstable();
        there == on.segmented.neighbours(mapped[part].0)
    };
    if !(0..count).all(alike) {
        return None;
    }
    let meshes: Vec<&PolyMesh> = mapped.iter().map(|m| &*m.1).collect();
    // Parts that do not fit together as the example's do are stitched like any others.
    let joined = rejoin::rejoin(&example.mesh, &part_of, &meshes, &on.segmented.mesh);
    joined.ok().map(|mesh| whole(mesh, example, count))
}

/// An example that came back whole, on so many segments.
fn whole(mesh: PolyMesh, example: &Model, segments: usize) -> Stitched {
    Stitched {
        bridging: Vec::new(),
        standing: vec![LayoutOwner::Example; segments],
        extraordinary_vertices: extraordinary(&mesh) as u64,
        extraordinary_before: extraordinary(&example.mesh) as u64,
        notes: vec!["one example on all segments: its own faces, put together again whole".into()],
        mesh: Arc::new(mesh),
    }
}
