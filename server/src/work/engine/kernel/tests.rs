//! The engine on the samples of the demo.

use super::KernelEngine;
use crate::demo;
use crate::pool::Stop;
use crate::work::engine::{Cut, Engine, EngineError, ExtraParts, Grain, Model, Refusal};
use quadmuse_kernel::mesh::{Format, write};
use quadmuse_proto::{MeshFormat, Topology};

fn sample(name: &str, besides: ExtraParts) -> Model {
    let sample = demo::corpus().into_iter().find(|sample| sample.name == name).expect("a sample");
    let bytes = write(&sample.mesh, Format::Obj).expect("writable");
    let cut = Cut { grain: Grain::Faces, besides, ..Cut::default() };
    KernelEngine::default().read(&bytes, Some(MeshFormat::Obj), &cut, &Stop::new(None)).expect("a mesh")
}

#[test]
fn an_animal_is_whole_and_has_parts_of_its_own_faces_that_come_back_by_their_labels() {
    let pig = sample("pig", ExtraParts::Sought);
    let labels = pig.besides.clone().expect("parts");
    assert_eq!(pig.segments[0].topology, Topology::Sphere);
    assert_eq!(pig.segments[0].faces, pig.mesh.faces.len() as u64);
    assert!(pig.segments.len() > 4, "{:?}", pig.segments);
    for (number, segment) in (1..).zip(&pig.segments[1..]) {
        let faces = labels.iter().filter(|label| **label == number).count() as u64;
        assert!(segment.faces == faces && faces >= 16, "{segment:?}, {faces} faces");
        assert_ne!(segment.topology, Topology::Sphere);
    }
    let known = sample("pig", ExtraParts::Known(labels.clone()));
    assert_eq!((&known.segments, known.besides), (&pig.segments, Some(labels.clone())));
    let engine = KernelEngine::default();
    let mesh = engine.labelled_by_segment(&pig).expect("a mesh");
    assert_eq!(mesh.attributes.segments.as_ref(), Some(&labels), "each face tells its part");
    let [first, again] = [&pig, &sample("pig", ExtraParts::Known(labels))].map(|model| {
        let part = engine.encode(model, 2, &Stop::new(None)).expect("encoded");
        engine.pack(&part.encoding).expect("packed")
    });
    assert_eq!(first, again);
}

#[test]
fn what_has_no_protrusions_is_whole_alone_and_so_is_all_where_no_parts_are_wanted() {
    let ear = sample("ear_human", ExtraParts::Sought);
    assert_eq!((ear.segments.len(), ear.besides), (1, None));
    let pig = sample("pig", ExtraParts::Nothing);
    assert_eq!((pig.segments.len(), pig.besides), (1, None));
}

#[test]
fn labels_that_are_none_of_the_mesh_are_refused() {
    let sample = demo::corpus().into_iter().find(|sample| sample.name == "pig").expect("a sample");
    let bytes = write(&sample.mesh, Format::Obj).expect("writable");
    let faces = sample.mesh.faces.len();
    let scattered = (0..faces as i64).map(|face| face % 2 + 1).collect();
    for labels in [vec![1; faces - 1], scattered] {
        let cut = Cut { besides: ExtraParts::Known(labels), ..Cut::default() };
        let read = KernelEngine::default().read(&bytes, Some(MeshFormat::Obj), &cut, &Stop::new(None));
        assert!(matches!(read, Err(EngineError::Refused { refusal: Refusal::LabelsInvalid, .. })));
    }
}
