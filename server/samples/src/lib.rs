//! The built-in sample corpus and the inputs to try it with, all made by code.
//!
//! The corpus' examples are quad meshes as an artist would lay them: loops around eyes and mouths, joints and fingers,
//! with UVs and named groups. The inputs are irregular triangle meshes of *other* shapes of the same families, in any
//! pose, with noise; no trace of a quad layout is left in them.

mod atlas;
mod brush;
mod cage;
mod cast;
mod creature;
mod ear;
mod foot;
mod hand;
mod head;
mod limb;
mod loft;
pub mod random;
mod remesh;

use cage::Cage;
use quadmuse_kernel::mesh::tri::NONE;
use quadmuse_kernel::mesh::{Attributes, FaceLabels, PolyMesh, Vec3};

/// A mesh of the built-in corpus, or an input to query it with.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Name, unique among the samples; also a good file stem.
    pub name: String,
    /// Tags to filter by; the first is the family, the last the topology (`disc`, `annulus` or `sphere`).
    pub tags: Vec<String>,
    /// Relevance, 0–5.
    pub relevance: f32,
    /// The mesh.
    pub mesh: PolyMesh,
}

/// The sample corpus: pure-quad examples, y up and facing +z, with UVs and groups.
pub fn corpus() -> Vec<Sample> {
    cast::examples()
        .into_iter()
        .map(|role| Sample { mesh: dressed(&role.shape), ..sample(role.name, role.tags, role.relevance) })
        .collect()
}

/// The inputs: triangle meshes of shapes that are not in the corpus (a head, an arm, a fish), the head first.
pub fn inputs() -> Vec<Sample> {
    cast::strangers()
        .into_iter()
        .map(|(role, scan)| {
            let (cage, positions) = role.shape;
            let mesh = remesh::scan(&positions, &cage.quads, &scan);
            Sample { mesh, ..sample(role.name, role.tags, role.relevance) }
        })
        .collect()
}

fn sample(name: &str, tags: &[&str], relevance: f32) -> Sample {
    let tags = tags.iter().map(|&t| t.to_owned()).collect();
    Sample { name: name.to_owned(), tags, relevance, mesh: PolyMesh::default() }
}

/// A shape as a file would hold it: groups in order of first use, UVs.
fn dressed((cage, positions): &(Cage, Vec<Vec3>)) -> PolyMesh {
    let mut number = vec![NONE; cage.groups.len()];
    let mut names = Vec::new();
    let mut of_face = Vec::with_capacity(cage.quads.len());
    for &group in &cage.group_of {
        let slot = &mut number[group as usize];
        if *slot == NONE {
            *slot = names.len() as u32;
            names.push(cage.groups[group as usize].clone());
        }
        of_face.push(*slot);
    }
    let groups = FaceLabels { names, of_face };
    let faces = cage.quads.iter().map(|q| &q[..]).collect();
    let mut mesh = PolyMesh { positions: positions.clone(), faces, attributes: Attributes::default() };
    mesh.attributes.uvs = Some(atlas::unwrap(&mesh, &groups));
    mesh.attributes.groups = Some(groups);
    mesh
}

#[cfg(test)]
mod tests;
