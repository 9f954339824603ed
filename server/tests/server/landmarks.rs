//! Landmarks: what a caller says of the pose is taken, and each is met by the map.

use quadmuse_kernel::mesh::{Format, PolyMesh, Vec3, write};
use quadmuse_proto::{
    ConstraintEdit, ConstraintOrigin, ExampleId, Landmark, MeshFormat, NewConstraint, NewMap, OnFold, Place,
};
use quadmuse_server::demo;
use quadmuse_server::pool::{Admission, Pool};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::Cut;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::ingest::{self, Annotation, Upload};
use quadmuse_server::work::query::{LiveQuery, QueryOptions};
use quadmuse_server::work::{Caller, Work, WorkError, mapping, search};
use quadmuse_store::OpenOptions;
use std::sync::Arc;

fn upload(mesh: &PolyMesh) -> Upload {
    let bytes = write(mesh, Format::Obj).expect("writable").into();
    Upload { bytes, format: Some(MeshFormat::Obj), cut: Cut::default() }
}

/// The mesh turned, grown and moved.
fn moved(mesh: &PolyMesh) -> PolyMesh {
    let (sin, cos) = 2.0f64.sin_cos();
    let place =
        |p: &Vec3| Vec3::new(cos * p.x - sin * p.z, p.y, sin * p.x + cos * p.z) * 2.5 + Vec3::new(3.0, 0.0, -1.0);
    PolyMesh { positions: mesh.positions.iter().map(place).collect(), ..mesh.clone() }
}

/// Vertices of the mesh, each farthest from those before.
fn spread(mesh: &PolyMesh, count: usize) -> Vec<usize> {
    let mut chosen = vec![0usize];
    while chosen.len() < count {
        let away = |v: &usize| {
            let from = |c: &usize| (mesh.positions[*c] - mesh.positions[*v]).norm();
            chosen.iter().map(from).fold(f64::INFINITY, f64::min)
        };
        let next = (0..mesh.positions.len()).max_by(|a, b| away(a).total_cmp(&away(b))).expect("vertices");
        chosen.push(next);
    }
    chosen
}

async fn map(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    example: ExampleId,
    landmarks: Vec<Landmark>,
) -> Result<Arc<mapping::LiveMap>, WorkError> {
    let wanted = NewMap { landmarks, ..NewMap::new(0, example, 0) };
    mapping::create(work, live, wanted).await
}

#[tokio::test(flavor = "multi_thread")]
async fn landmarks_are_met_and_become_constraints() {
    let dir = tempfile::tempdir().expect("a directory");
    let pool = Pool::new(2, Admission::new(4 << 30, 64)).expect("threads");
    let (corpus, _) = StoredCorpus::open(dir.path(), &OpenOptions::default()).expect("a store");
    let work = Work::new(pool, Arc::new(KernelEngine::default()), Arc::new(corpus));
    work.load();
    let sample = demo::corpus().into_iter().find(|s| s.tags.iter().any(|t| t == "head")).expect("a head");
    let input = moved(&sample.mesh);
    let annotation = Annotation { name: sample.name.clone(), tags: Vec::new(), relevance: 1.0 };
    let added = ingest::add(&work, Caller::default(), upload(&sample.mesh), annotation).await.expect("added");
    let options = QueryOptions { top: 1, resolution: 64, deadline: None, tags: Vec::new(), like: None };
    let live = search::start(&work, Caller::default(), upload(&input), options).await.expect("started");
    live.wait_for(|_| false).await;
    let id = added.0.id;

    // On a symmetric thing, the landmarks of the mirror image turn the map round.
    let chosen = spread(&sample.mesh, 5);
    let place = |p: &Vec3| Place::Point((*p).into());
    let held = |v: &usize| Landmark {
        on_example: place(&sample.mesh.positions[*v]),
        on_input: place(&input.positions[*v]),
        name: None,
    };
    let landmarks: Vec<Landmark> = chosen.iter().map(held).collect();
    let state = map(&work, &live, id, landmarks.clone()).await.expect("a map").newest();
    let size = (input.positions[chosen[1]] - input.positions[chosen[0]]).norm();
    for v in &chosen {
        let missed = (state.mapped.mesh.positions[*v] - input.positions[*v]).norm() / size;
        assert!(missed < 2e-3, "vertex {v} is {missed} off");
    }
    let by_caller = state.mapped.constraints.iter().filter(|c| c.origin == ConstraintOrigin::User).count();
    assert!(by_caller > 0 && by_caller <= chosen.len(), "{by_caller}");

    // A feature can be dragged and put back; what would fold is led elsewhere, not refused.
    let plain = map(&work, &live, id, Vec::new()).await.expect("a map");
    let first = plain.newest();
    let features = first.mapped.constraints.clone();
    let feature = features.iter().find(|c| c.origin == ConstraintOrigin::Feature).expect("features");
    let near = |share: f64| {
        let from = Vec3::from(feature.on_input.point);
        let apart = |p: &Vec3| ((p - from).norm() / size - share).abs();
        *input.positions.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("vertices")
    };
    let drag = |to: Vec3, on_fold: OnFold| ConstraintEdit {
        set: vec![NewConstraint { id: Some(feature.id.clone()), on_example: None, on_input: Some(place(&to)) }],
        on_fold,
        ..ConstraintEdit::default()
    };
    let to = near(0.02);
    let edited = mapping::constrain(&work, &live, plain.id, drag(to, OnFold::Resolve)).await.expect("an edit");
    let moved = edited.mapped.constraints.iter().find(|c| c.id == feature.id).expect("the same id");
    assert_eq!(moved.origin, ConstraintOrigin::User);
    assert!((Vec3::from(moved.on_input.point) - to).norm() / size < 0.01);
    assert_eq!(edited.mapped.constraints.len(), features.len());
    mapping::constrain(&work, &live, plain.id, drag(near(0.4), OnFold::Resolve)).await.expect("not refused");
    let undo = ConstraintEdit { undo: vec![feature.id.clone()], ..ConstraintEdit::default() };
    let undone = mapping::constrain(&work, &live, plain.id, undo).await.expect("undone");
    let back = undone.mapped.constraints.iter().find(|c| c.id == feature.id).expect("the same id");
    assert_eq!(back.origin, ConstraintOrigin::Feature);

    // One that is removed is not listed any more until that is undone.
    let remove = ConstraintEdit { remove: vec![feature.id.clone()], ..ConstraintEdit::default() };
    let less = mapping::constrain(&work, &live, plain.id, remove).await.expect("removed");
    assert_eq!(less.mapped.constraints.len(), features.len() - 1);
    assert!(less.mapped.constraints.iter().all(|c| c.id != feature.id));
    let undo = ConstraintEdit { undo: vec![feature.id.clone()], ..ConstraintEdit::default() };
    let back = mapping::constrain(&work, &live, plain.id, undo).await.expect("undone").mapped.constraints.len();
    assert_eq!(back, features.len());

    // Each goes a little way without a refusal, and put back they leave the map as it was.
    for feature in features.iter().filter(|c| c.origin == ConstraintOrigin::Feature) {
        let from = Vec3::from(feature.on_input.point);
        let apart = |p: &Vec3| ((p - from).norm() / size - 0.01).abs();
        let to = *input.positions.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("vertices");
        let set = vec![NewConstraint { id: Some(feature.id.clone()), on_example: None, on_input: Some(place(&to)) }];
        let edit = ConstraintEdit { set, ..ConstraintEdit::default() };
        mapping::constrain(&work, &live, plain.id, edit)
            .await
            .unwrap_or_else(|error| panic!("{}: {error}", feature.id));
        let undo = ConstraintEdit { undo: vec![feature.id.clone()], ..ConstraintEdit::default() };
        mapping::constrain(&work, &live, plain.id, undo).await.expect("undone");
    }
    let (was, now) = (&first.mapped, plain.newest());
    let is = &now.mapped;
    assert_eq!((is.verdict, &is.reasons, is.folds), (was.verdict, &was.reasons, was.folds));

    let far = Landmark { on_example: Place::Point([f64::NAN; 3]), ..landmarks[0].clone() };
    let refused = map(&work, &live, id, vec![landmarks[0].clone(), far]).await.map(|_| ()).expect_err("no point");
    assert!(refused.to_string().contains("landmarks[1].on_example"), "{refused}");
    let refused = map(&work, &live, id, vec![landmarks[0].clone(); 33]).await.map(|_| ()).expect_err("too many");
    assert!(refused.to_string().contains("33"), "{refused}");
    let refused = map(&work, &live, ExampleId::TEMPLATE, landmarks).await.map(|_| ()).expect_err("no example");
    assert!(refused.to_string().contains("regular layout"), "{refused}");
}
