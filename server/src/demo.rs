//! The built-in sample corpus and inputs, made by code.

mod brush;
mod cage;
mod creature;
mod ear;
mod foot;
mod hand;
mod head;
mod limb;
mod loft;

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
    let cat = head::beast::Beast { snout: 0.16, narrow: 1.9, droop: 0.0, stop: 0.2, eye: [0.40, 0.20, 0.165, 0.13], pad: 0.8, cheek: 1.0, ear: [0.62, 0.30, 0.35], point: 1.0, askew: 0.01 };
    let fox = head::beast::Beast { snout: 0.85, narrow: 3.4, droop: 0.12, stop: 0.0, eye: [0.42, 0.24, 0.135, 0.085], pad: 1.0, cheek: 1.1, ear: [0.78, 0.27, 0.30], point: 1.0, askew: 0.01 };
    let bear = head::beast::Beast { snout: 0.42, narrow: 3.0, droop: 0.10, stop: 1.5, eye: [0.36, 0.22, 0.10, 0.085], pad: 1.6, cheek: 1.5, ear: [0.40, 0.29, 0.75], point: 0.1, askew: 0.01 };
    let h = head::human::Human { jaw: 1.04, nose: [0.29, 1.05, 0.1], hump: 0.02, brow: 1.5, neck: 1.08, cheek: 0.9, ..Default::default() };
    let child = head::human::Human { wide: 1.04, jaw: 0.86, chin: 0.5, face: 0.80, nose: [0.19, 0.95, -0.6], hump: 0.0, brow: 0.2, eye: [0.185, 0.105], slant: 0.0, mouth: [0.215, 1.1], cheek: 1.6, neck: 0.72, ear: [0.92, 1.15], point: 0.0, askew: 0.01 };
    let woman = head::human::Human { wide: 0.95, jaw: 0.76, chin: 0.7, face: 0.94, nose: [0.215, 0.80, -0.4], hump: -0.015, brow: 0.2, eye: [0.182, 0.098], slant: 0.03, mouth: [0.235, 1.4], cheek: 1.25, neck: 0.72, ear: [0.85, 0.7], point: 0.0, askew: 0.01 };
    let goblin = head::human::Human { wide: 1.06, jaw: 0.90, chin: 1.9, face: 1.04, nose: [0.43, 1.45, 1.2], hump: 0.07, brow: 2.2, eye: [0.175, 0.08], slant: 0.06, mouth: [0.36, 0.8], cheek: 1.7, neck: 0.85, ear: [1.05, 1.6], point: 1.1, askew: 0.02 };
    let f = |length, radius, spread, curl| hand::Finger { length, radius, spread, curl, taper: 0.28 };
    let human_hand = hand::Hand { fingers: vec![f(0.78, 0.125, -0.20, 0.35), f(1.00, 0.142, -0.06, 0.28), f(1.10, 0.147, 0.04, 0.25), f(0.98, 0.142, 0.16, 0.22)], thumb: Some(f(0.92, 0.185, 0.95, 0.35)), wide: 0.62, thick: 0.20, high: 1.15, wrist: 0.40, pads: 0.0 };
    let paw = hand::Hand { fingers: vec![f(0.50, 0.22, -0.30, 0.5), f(0.60, 0.24, -0.10, 0.5), f(0.58, 0.24, 0.10, 0.5), f(0.48, 0.22, 0.30, 0.5)], thumb: None, wide: 0.76, thick: 0.34, high: 0.95, wrist: 0.56, pads: 1.0 };
    let glove = hand::Hand { fingers: vec![f(0.70, 0.23, -0.24, 0.3), f(0.82, 0.25, 0.0, 0.25), f(0.76, 0.24, 0.22, 0.2)], thumb: Some(f(0.75, 0.27, 1.0, 0.3)), wide: 0.70, thick: 0.33, high: 0.95, wrist: 0.36, pads: 0.3 };
    let b = limb::Build { thick: 1.0, muscle: 1.0, bend: 0.35 };
    vec![finish("ear", ear::Ear { slim: 1.0, lobe: 1.0, helix: 1.0, fold: 1.0, point: 0.0 }.build(1)), finish("foot", foot::Foot { wide: 1.0, arch: 1.0, toes: 1.0 }.build(1)), finish("fish", creature::fish(1.0, 1.0)), finish("duck", creature::duck(0.4, 1.0)), finish("pig", creature::pig(1.0)), finish("hand", human_hand.build(1)), finish("paw", paw.build(1)), finish("glove", glove.build(1)), finish("arm", limb::arm(&b)), finish("leg", limb::leg(&b)), finish("tentacle", limb::tentacle(2.6, 7)), finish("head_man", h.build(1)), finish("head_woman", woman.build(1)), finish("head_child", child.build(1)), finish("head_goblin", goblin.build(1)), finish("head_cat", cat.build(1)), finish("head_fox", fox.build(1)), finish("head_bear", bear.build(1))]
}
