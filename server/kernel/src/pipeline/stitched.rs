//! A mesh that maps were stitched to.

use crate::compose::{apart::side_by_side, check::extraordinary};
use crate::mesh::PolyMesh;
use std::sync::Arc;

/// The note of a composition that is the one map itself, with all that the example brings.
pub const AS_MAPPED: &str = "the map follows the input as it is";

/// Tells whose layout stands on a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutOwner {
    /// An example's.
    Example,
    /// A regular layout.
    Regular,
    /// The scan's own triangles as quads.
    Own,
}

/// A stitched mesh.
#[derive(Clone, Debug)]
pub struct Stitched {
    /// The mesh.
    pub mesh: Arc<PolyMesh>,
    /// Tells what stands on each segment, in order.
    pub standing: Vec<LayoutOwner>,
    /// Inner vertices with another number of edges than four.
    pub extraordinary_vertices: u64,
    /// Those that the parts had inside before.
    pub extraordinary_before: u64,
    /// What was done beyond plain stitching, a sentence each.
    pub notes: Vec<String>,
    /// Faces of the mesh, in order, that span a gap of the scan on purpose.
    pub bridging: Vec<u32>,
}

impl Stitched {
    /// Tells whether an example's layout stands on a segment.
    pub fn is_example(&self, segment: usize) -> bool {
        self.standing.get(segment) == Some(&LayoutOwner::Example)
    }

    /// A mesh that needed no stitching.
    pub fn as_it_is(mesh: Arc<PolyMesh>, standing: Vec<LayoutOwner>) -> Self {
        let extraordinary = extraordinary(&mesh) as u64;
        Self {
            mesh,
            standing,
            extraordinary_vertices: extraordinary,
            extraordinary_before: extraordinary,
            notes: vec![AS_MAPPED.into()],
            bridging: Vec::new(),
        }
    }

    /// The meshes of some maps, side by side as they are, each with the faces that bridge a gap.
    pub fn as_mapped(maps: &[(&Arc<PolyMesh>, &[u32])], standing: Vec<LayoutOwner>) -> Self {
        let mesh = match maps {
            [(mesh, _)] => Arc::clone(mesh),
            _ => Arc::new(side_by_side(maps.iter().map(|(mesh, _)| &***mesh))),
        };
        let mut made = Self::as_it_is(mesh, standing);
        let mut first = 0;
        for (mesh, bridging) in maps {
            made.bridging.extend(bridging.iter().map(|face| first + face));
            first += mesh.faces.len() as u32;
        }
        made
    }
}
