//! What callers send beside meshes: JSON and MessagePack.

use crate::{damage::damaged, dice::Dice};
use quadmuse_proto::constraint::Place;
use quadmuse_proto::{
    Beyond, CompositionPart, ConstraintEdit, ExampleId, Landmark, MapId, NewComposition, NewConstraint, NewMap,
    NewRetopo, OnFold,
};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

/// What messages promise.
pub const PROMISE: &str = "a spoilt message is refused, or reads back what it writes";

fn edit() -> ConstraintEdit {
    let set = vec![
        NewConstraint { id: Some("c1".into()), on_example: None, on_input: Some(Place::Point([0.5, -1e-3, 7e8])) },
        NewConstraint { id: None, on_example: Some(Place::Point([0.0; 3])), on_input: Some(Place::Point([1.0; 3])) },
    ];
    ConstraintEdit { set, remove: vec!["c2".into()], undo: vec!["r1".into()], on_fold: OnFold::Resolve }
}

fn map() -> NewMap {
    let point = |x: f64| Place::Point([x, 0.25, -x]);
    let landmark = Landmark { on_example: point(1.0), on_input: point(2.0), name: Some("nose \u{1f443}".into()) };
    let example = ExampleId::TEMPLATE;
    let names = [("chin".to_owned(), Place::OnVertex { vertex: 7 }), ("nose".to_owned(), point(3.0))].into();
    NewMap { segment: 3, example, example_segment: 1, beyond: Beyond::Extend, landmarks: vec![landmark; 3], names }
}

fn composition() -> NewComposition {
    let part = |segment| CompositionPart { segment, map: MapId::from_bytes([segment as u8; 16]) };
    NewComposition {
        parts: (0..4).map(part).collect(),
        smoothing: 5,
        density: -1,
        keep: vec![0, 2],
        beyond: Beyond::Leave,
    }
}

fn retopo() -> NewRetopo {
    NewRetopo { beyond: Beyond::Leave, smoothing: 7, density: Some(-2) }
}

/// Spoils a message of one kind in JSON; whether it was read.
fn json_of<T: Serialize + DeserializeOwned + PartialEq + Debug>(message: &T, dice: &mut Dice) -> bool {
    let whole = serde_json::to_vec(message).unwrap_or_default();
    let Ok(read) = serde_json::from_slice::<T>(&damaged(&whole, dice)) else { return false };
    let again = serde_json::to_vec(&read).unwrap_or_default();
    assert_eq!(serde_json::from_slice::<T>(&again).ok().as_ref(), Some(&read));
    true
}

/// The same in MessagePack, where numbers may be none: what is written is compared.
fn messagepack_of<T: Serialize + DeserializeOwned>(message: &T, dice: &mut Dice) -> bool {
    let whole = rmp_serde::to_vec_named(message).unwrap_or_default();
    let Ok(read) = rmp_serde::from_slice::<T>(&damaged(&whole, dice)) else { return false };
    let again = rmp_serde::to_vec_named(&read).unwrap_or_default();
    let back = rmp_serde::from_slice::<T>(&again).unwrap_or_else(|error| panic!("what it wrote is not read: {error}"));
    assert_eq!(rmp_serde::to_vec_named(&back).unwrap_or_default(), again);
    true
}

/// JSON.
pub fn json(seed: u64) -> bool {
    let mut dice = Dice::new(seed);
    match dice.below(4) {
        0 => json_of(&edit(), &mut dice),
        1 => json_of(&map(), &mut dice),
        2 => json_of(&retopo(), &mut dice),
        _ => json_of(&composition(), &mut dice),
    }
}

/// MessagePack.
pub fn messagepack(seed: u64) -> bool {
    let mut dice = Dice::new(seed);
    match dice.below(4) {
        0 => messagepack_of(&edit(), &mut dice),
        1 => messagepack_of(&map(), &mut dice),
        2 => messagepack_of(&retopo(), &mut dice),
        _ => messagepack_of(&composition(), &mut dice),
    }
}
