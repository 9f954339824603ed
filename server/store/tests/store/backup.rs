//! A backup restored is the same corpus; a damaged one is refused; a check finds what is damaged.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;

use quadmuse_store::{LandmarkRecord, NewSegmentation, Patch, Problem, Store, StoreError};

use crate::sample::{Sample, options, random, segment};

/// A corpus with labels, an annotation, a second encoding and two segments.
fn build(store: &Store) {
    let labels: Vec<u32> = (0..680).map(|i| i % 3).collect();
    for seed in 0..4 {
        let sample = Sample::with(seed, vec![segment(seed), segment(seed + 100)]);
        let mut example = sample.example();
        if seed == 2 {
            example.segmentation = NewSegmentation::Labels(&labels);
        }
        store.add(&example).unwrap();
    }
    let id = store.snapshot().examples[1].id;
    let text = |text: &str| Some(text.to_owned());
    let credits = Patch { author: text("Ada"), licence: text("CC0"), notes: text("neutral"), ..Patch::default() };
    let nose = LandmarkRecord { name: "nose_tip".into(), point: [0.1, 0.2, 0.3], vertex: Some(7) };
    store.annotate(id, Patch { relevance: Some(5.0), landmarks: Some(vec![nose]), ..credits }).unwrap();
    store.put_derived(id, 1, 9, &segment(55)).unwrap();
}

fn assert_same(a: &Store, b: &Store) {
    let (ours, theirs) = (a.snapshot(), b.snapshot());
    assert_eq!(ours.examples, theirs.examples);
    for record in &ours.examples {
        assert_eq!(a.mesh_bytes(record.id).unwrap(), b.mesh_bytes(record.id).unwrap());
        assert_eq!(a.labels(record.id).unwrap(), b.labels(record.id).unwrap());
        for segment in 0..record.segments.len() as u32 {
            assert_eq!(a.derived(record.id, segment).unwrap(), b.derived(record.id, segment).unwrap());
            assert_eq!(a.encoder_version(record.id, segment), b.encoder_version(record.id, segment));
        }
    }
}

#[test]
fn a_restored_backup_is_the_same_corpus_and_so_is_its_backup() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (store, _) = Store::open(from.path(), &options()).unwrap();
    build(&store);
    let mut bytes = Vec::new();
    let report = store.backup(&mut bytes).unwrap();
    assert_eq!((report.examples, report.segments, report.bytes), (4, 8, bytes.len() as u64));
    let (restored, report) = Store::restore(to.path(), &options(), &mut &bytes[..]).unwrap();
    assert_eq!((report.examples, report.missing_derived.len()), (4, 0));
    assert_same(&store, &restored);
    let mut again = Vec::new();
    restored.backup(&mut again).unwrap();
    assert_eq!(bytes, again);
    drop(restored);
    let refused = Store::restore(to.path(), &options(), &mut &bytes[..]);
    assert!(matches!(refused, Err(StoreError::NotEmpty { examples: 4 })));
}

#[test]
fn a_damaged_or_cut_backup_is_refused() {
    let from = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(from.path(), &options()).unwrap();
    store.add(&Sample::new(1).example()).unwrap();
    let mut bytes = Vec::new();
    store.backup(&mut bytes).unwrap();
    for flip in 0..24 {
        let mut bad = bytes.clone();
        let at = (random(flip, 1) * bad.len() as f64) as usize;
        if flip % 3 == 0 {
            bad.truncate(at)
        } else {
            bad[at] ^= 0x11
        }
        let to = tempfile::tempdir().unwrap();
        let refused = Store::restore(to.path(), &options(), &mut &bad[..]);
        assert!(matches!(refused, Err(StoreError::Backup { .. })), "at {at} of {}", bytes.len());
    }
    let to = tempfile::tempdir().unwrap();
    let endless = &mut std::io::repeat(0xff).take(1 << 20);
    assert!(matches!(Store::restore(to.path(), &options(), endless), Err(StoreError::Backup { .. })));
}

#[test]
fn a_check_names_each_kind_of_damage_and_scrubbing_mends_records() {
    let dir = tempfile::tempdir().unwrap();
    let ids = {
        let (store, _) = Store::open(dir.path(), &options()).unwrap();
        build(&store);
        let mut seen = 0;
        let report = store.check(&mut |done| seen = done).unwrap();
        assert_eq!((report.examples, report.segments, seen), (4, 8, 4));
        assert_eq!(report.problems, []);
        store.snapshot().examples.iter().map(|record| (record.id, record.content_hash)).collect::<BTreeMap<_, _>>()
    };
    let (&first, _) = ids.iter().next().unwrap();
    let (&last, hash) = ids.iter().last().unwrap();
    let ground = dir.path().join("ground").join(format!("{first}.1"));
    let mut bytes = fs::read(&ground).unwrap();
    bytes[20] ^= 1;
    fs::write(&ground, &bytes).unwrap();
    let object = dir.path().join("objects").join(hash.to_string());
    let mut bytes = fs::read(&object).unwrap();
    bytes[20] ^= 1;
    fs::write(&object, &bytes).unwrap();

    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let report = store.check(&mut |_| ()).unwrap();
    assert!(
        matches!(&report.problems[..], [Problem::Record { id: a, .. }, Problem::Ground { id: b, .. }] if (*a, *b) == (first, last)),
        "{report:?}"
    );
    assert!(store.get(last).is_ok(), "a check changes nothing");
    assert!(matches!(&store.scrub(first).unwrap()[..], [Problem::Record { .. }]));
    assert!(matches!(&store.scrub(last).unwrap()[..], [Problem::Ground { .. }]));
    assert!(matches!(store.get(last), Err(StoreError::Quarantined { .. })));
    let mut backup = Vec::new();
    assert_eq!(store.backup(&mut backup).unwrap().skipped.len(), 1);
    let report = store.check(&mut |_| ()).unwrap();
    assert!(matches!(&report.problems[..], [Problem::Ground { id, .. }] if *id == last), "{report:?}");
}
