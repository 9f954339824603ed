//! The built-in sample corpus and inputs, made by code.

mod brush;
mod cage;
mod head;

use quadmuse_kernel::mesh::{Attributes, FaceLabels, PolyMesh, Vec3};

/// A mesh of the built-in corpus or an input to query it with.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Name, unique among the samples; also a good file stem.
    pub name: String,
    /// Tags for filtering.
    pub tags: Vec<String>,
    /// Relevance, 0–5.
    pub relevance: f32,
    /// The mesh.
    pub mesh: PolyMesh,
}

/// corpus
pub fn corpus() -> Vec<Sample> {
    let finish = |name: &str, (cage, positions): (cage::Cage, Vec<Vec3>)| Sample {
        name: name.to_owned(),
        tags: vec![],
        relevance: 3.0,
        mesh: PolyMesh {
            positions,
            faces: cage.quads.iter().map(|q| &q[..]).collect(),
            attributes: Attributes { groups: Some(FaceLabels { names: cage.groups.clone(), of_face: cage.group_of.clone() }), ..Attributes::default() },
        },
    };
    vec![finish("head_man", head::human::Human::default().build(1))]
}
