//! The store from outside: add, read, annotate, remove, restart.

use std::time::Duration;

use quadmuse_store::{Added, Filter, NewSegmentation, OpenOptions, Patch, Segmentation, Store, StoreError, Topology};

use crate::sample::{Sample, options, segment};

#[test]
fn what_was_added_is_there_after_a_restart_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let sample = Sample::new(1);
    let (id, before) = {
        let (store, report) = Store::open(dir.path(), &options()).unwrap();
        assert_eq!(report.examples, 0);
        let Added::Created(record) = store.add(&sample.example()).unwrap() else { panic!("it was new") };
        (record.id, store.derived(record.id, 0).unwrap())
    };
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.examples, report.records_restored, report.ground_restored, report.blobs), (1, 0, 0, 0));
    assert!(report.index_rebuilt.is_none() && report.missing_derived.is_empty());
    let record = store.get(id).unwrap();
    assert_eq!(record.name, "sample 1");
    assert_eq!(record.tags, ["head", "sample"]);
    assert_eq!(store.mesh_bytes(id).unwrap(), sample.mesh);
    assert_eq!(store.derived(id, 0).unwrap(), before);
    assert_eq!(before.chart, sample.derived[0].chart);
    assert_eq!(before.features, sample.derived[0].features);
    let coarse = store.coarse(id, 0).unwrap();
    assert_eq!((coarse.level.side, &coarse.signature), (32, &before.signature));
    assert_eq!(store.level(id, 0, 128).unwrap(), before.levels[2]);
    assert!(matches!(store.level(id, 0, 16), Err(StoreError::NoSuchLevel { side: 16, .. })));
    assert!(matches!(store.level(id, 0, 0), Err(StoreError::NoSuchLevel { .. })));
    assert!(matches!(store.derived(id, 1), Err(StoreError::MissingDerived { segment: 1, .. })));
}

#[test]
fn many_added_by_one_commit_are_each_as_if_added_alone() {
    let dir = tempfile::tempdir().unwrap();
    let samples: Vec<Sample> = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 3].map(Sample::new).into();
    let alone = tempfile::tempdir().unwrap();
    let (one_by_one, _) = Store::open(alone.path(), &options()).unwrap();
    let added = {
        let (store, _) = Store::open(dir.path(), &options()).unwrap();
        let already = store.add(&samples[4].example()).unwrap().record().id;
        let added = store.add_all(&samples.iter().map(Sample::example).collect::<Vec<_>>()).unwrap();
        let Added::Exists(there) = &added[4] else { panic!("it was there") };
        assert_eq!(there.id, already);
        let Added::Exists(twice) = &added[10] else { panic!("it was among them already") };
        assert_eq!(twice.id, added[2].record().id);
        added
    };
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.examples, report.ground_restored, report.records_restored, report.blobs), (10, 0, 0, 0));
    for (sample, added) in samples.iter().zip(&added) {
        let alone = one_by_one.add(&sample.example()).unwrap();
        let (id, alone) = (added.record().id, alone.record().id);
        assert_eq!(store.mesh_bytes(id).unwrap(), sample.mesh);
        assert_eq!(store.derived(id, 0).unwrap(), one_by_one.derived(alone, 0).unwrap());
    }
}

#[test]
fn rows_hold_as_long_as_their_encoding() {
    let dir = tempfile::tempdir().unwrap();
    let samples = [1, 2, 3].map(Sample::new);
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let ids = samples.each_ref().map(|sample| store.add(&sample.example()).unwrap().record().id);
    let rows = [1u8, 2, 3].map(|k| (ids[usize::from(k) - 1], (0, vec![k; 2000])));
    store.put_rows(&mut rows.clone().into_iter()).unwrap();
    assert_eq!(store.rows(), rows);
    store.put_derived(ids[1], 0, 2, &segment(9)).unwrap();
    store.remove(ids[2]).unwrap();
    drop(store);
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!(store.rows(), rows[..1]);
}

#[test]
fn the_same_mesh_with_the_same_options_is_the_same_example() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let sample = Sample::new(1);
    let first = store.add(&sample.example()).unwrap();
    let again = store.add(&sample.example()).unwrap();
    assert!(matches!(&again, Added::Exists(record) if record.id == first.record().id));
    let labels = vec![0; 7];
    let mut other = sample.example();
    other.segmentation = NewSegmentation::Labels(&labels);
    let other = store.add(&other).unwrap();
    assert!(matches!(other, Added::Created(_)));
    assert!(matches!(other.record().segmentation, Segmentation::Labels { faces: 7, .. }));
    assert_eq!(store.labels(other.record().id).unwrap(), Some(labels.clone()));
    assert_eq!(store.labels(first.record().id).unwrap(), None);
    assert_eq!(store.find(&sample.mesh, NewSegmentation::Auto, [None]).unwrap().id, first.record().id);
    assert_eq!(store.find(&sample.mesh, NewSegmentation::Whole, [None]), None);
    // The mesh they share stays when one of them goes.
    store.remove(first.record().id).unwrap();
    assert_eq!(store.mesh_bytes(other.record().id).unwrap(), sample.mesh);
    assert_eq!(store.labels(other.record().id).unwrap(), Some(labels));
}

#[test]
fn the_same_mesh_added_by_many_at_once_is_added_once() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let sample = Sample::new(3);
    let results: Vec<Added> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..6).map(|_| scope.spawn(|| store.add(&sample.example()).unwrap())).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(results.iter().filter(|added| matches!(added, Added::Created(_))).count(), 1);
    assert!(results.iter().all(|added| added.record().id == results[0].record().id));
    assert_eq!(store.stats().examples, 1);
}

#[test]
fn lists_go_page_by_page_and_keep_to_their_filter() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let mut ids = Vec::new();
    for i in 0..7 {
        let mut sample = Sample::new(i);
        if i % 2 == 1 {
            sample.tags = vec!["odd".into()];
            sample.segments[0].topology = Topology::Annulus;
        }
        ids.push(store.add(&sample.example()).unwrap().record().id);
    }
    let page = store.list(None, 3, Filter::default());
    assert_eq!(page.examples.iter().map(|record| record.id).collect::<Vec<_>>(), ids[..3]);
    assert_eq!(page.next, Some(ids[2]));
    let page = store.list(page.next, 4, Filter::default());
    assert_eq!((page.examples.len(), page.next), (4, None));
    let odd = store.list(None, 50, Filter { tag: Some("odd"), topology: None });
    assert_eq!(odd.examples.iter().map(|record| record.id).collect::<Vec<_>>(), [ids[1], ids[3], ids[5]]);
    let annuli = store.list(None, 2, Filter { tag: None, topology: Some(Topology::Annulus) });
    assert_eq!((annuli.examples.len(), annuli.next), (2, Some(ids[3])));
}

#[test]
fn annotations_last_and_refuse_what_is_out_of_bounds() {
    let dir = tempfile::tempdir().unwrap();
    let id = {
        let (store, _) = Store::open(dir.path(), &options()).unwrap();
        let id = store.add(&Sample::new(1).example()).unwrap().record().id;
        let revision = store.snapshot().revision;
        let tags = Some(vec!["b".into(), "a".into(), "b".into()]);
        let patch = Patch { name: Some("é".repeat(100)), tags, relevance: Some(4.5), ..Patch::default() };
        let record = store.annotate(id, patch).unwrap();
        assert_eq!((record.revision, record.tags.join(" ")), (2, "a b".into()));
        assert!(store.wait_newer(revision, Duration::ZERO) > revision);
        for relevance in [-0.1, 5.1, f32::NAN] {
            let patch = Patch { relevance: Some(relevance), ..Patch::default() };
            assert!(matches!(store.annotate(id, patch), Err(StoreError::Invalid { .. })), "{relevance}");
        }
        let patch = Patch { tags: Some(vec![" ".into()]), ..Patch::default() };
        assert!(matches!(store.annotate(id, patch), Err(StoreError::Invalid { .. })));
        id
    };
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.records_restored, report.ground_restored), (0, 0));
    let record = store.get(id).unwrap();
    assert_eq!((record.name.as_str(), record.relevance), ("é".repeat(100).as_str(), 4.5));
    assert_eq!(std::fs::read_dir(dir.path().join("ground")).unwrap().count(), 1, "the former revision is gone");
}

#[test]
fn removal_leaves_nothing_behind() {
    let dir = tempfile::tempdir().unwrap();
    {
        let (store, _) = Store::open(dir.path(), &options()).unwrap();
        let keep = store.add(&Sample::new(1).example()).unwrap().record().id;
        let id = store.add(&Sample::new(2).example()).unwrap().record().id;
        store.remove(id).unwrap();
        assert!(matches!(store.get(id), Err(StoreError::NotFound { .. })));
        assert!(matches!(store.remove(id), Err(StoreError::NotFound { .. })));
        assert!(matches!(store.derived(id, 0), Err(StoreError::NotFound { .. })));
        assert!(store.get(keep).is_ok());
    }
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.examples, report.garbage_collected), (1, 0));
    assert_eq!(std::fs::read_dir(dir.path().join("ground")).unwrap().count(), 1);
    assert_eq!(std::fs::read_dir(dir.path().join("objects")).unwrap().count(), 1);
    assert_eq!(store.stats().segments, 1);
}

#[test]
fn a_new_encoding_takes_the_place_of_the_old() {
    let dir = tempfile::tempdir().unwrap();
    let sample = Sample::new(1);
    let id = {
        let (store, _) = Store::open(dir.path(), &options()).unwrap();
        let id = store.add(&sample.example()).unwrap().record().id;
        assert_eq!(store.missing_derived(1), []);
        assert_eq!(store.missing_derived(2), [(id, 0)]);
        store.put_derived(id, 0, 2, &segment(77)).unwrap();
        assert!(matches!(store.put_derived(id, 1, 2, &segment(77)), Err(StoreError::Invalid { .. })));
        id
    };
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!(report.garbage_collected, 0);
    assert_eq!((store.encoder_version(id, 0), store.missing_derived(2)), (Some(2), vec![]));
    assert_eq!(store.derived(id, 0).unwrap().signature, segment(77).signature);
}

#[test]
fn a_second_opening_of_the_same_directory_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    assert!(matches!(Store::open(dir.path(), &options()), Err(StoreError::Locked { .. })));
    drop(store);
    assert!(Store::open(dir.path(), &options()).is_ok());
}

#[test]
fn compaction_keeps_everything_and_sheds_garbage() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let ids: Vec<_> = (0..4).map(|i| store.add(&Sample::new(i).example()).unwrap().record().id).collect();
    store.remove(ids[1]).unwrap();
    let before: Vec<_> = [ids[0], ids[2], ids[3]].iter().map(|&id| store.derived(id, 0).unwrap()).collect();
    store.compact().unwrap();
    let check = |store: &Store| {
        let after: Vec<_> = [ids[0], ids[2], ids[3]].iter().map(|&id| store.derived(id, 0).unwrap()).collect();
        assert_eq!(after, before);
        assert!(matches!(store.get(ids[1]), Err(StoreError::NotFound { .. })));
    };
    check(&store);
    store.add(&Sample::new(9).example()).unwrap();
    drop(store);
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.examples, report.records_restored, report.blobs), (4, 0, 0));
    check(&store);
}

#[test]
fn adding_is_refused_on_a_full_disk_while_removal_works() {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};
    let free = Arc::new(AtomicU64::new(u64::MAX / 2));
    let probe = free.clone();
    let options = OpenOptions { free_space: Arc::new(move |_| Ok(probe.load(Ordering::SeqCst))), ..options() };
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options).unwrap();
    let id = store.add(&Sample::new(1).example()).unwrap().record().id;
    free.store(options.reserve_bytes, Ordering::SeqCst);
    assert!(matches!(store.add(&Sample::new(2).example()), Err(StoreError::Full { .. })));
    let rename = Patch { name: Some("other".into()), ..Patch::default() };
    assert!(matches!(store.annotate(id, rename), Err(StoreError::Full { .. })));
    assert!(store.derived(id, 0).is_ok());
    assert!(matches!(store.add(&Sample::new(1).example()), Ok(Added::Exists(_))));
    store.remove(id).unwrap();
    free.store(u64::MAX / 2, Ordering::SeqCst);
    assert!(matches!(store.add(&Sample::new(2).example()), Ok(Added::Created(_))));
}
