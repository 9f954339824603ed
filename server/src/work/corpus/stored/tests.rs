use super::*;
use quadmuse_proto::Topology;
use quadmuse_store::Feature;

fn packed(level_value: f32) -> PackedEncoding {
    let facts = SegmentFacts { topology: Topology::Annulus, k: 0.4, faces: 12, features: 1, bending: Some(3.25) };
    let levels = [32u32, 64].map(|side| (side, vec![level_value; (side * side) as usize])).to_vec();
    PackedEncoding { facts, features: vec![feature_out(&Feature { u: 0.25, v: 0.5, lambda: 2.0, level: 64 })], levels }
}

fn new_example(bytes: &'static [u8], labels: Option<Vec<i64>>) -> NewExample {
    NewExample {
        name: "limb".into(),
        tags: vec!["arm".into()],
        relevance: 3.3,
        bytes: Bytes::from_static(bytes),
        format: "obj".into(),
        cut: Cut { labels, ..Cut::default() },
        counts: MeshCounts { vertices: 14, faces: 12, triangles: 2, quads: 10 },
        repairs: vec!["two vertices merged".into()],
        segments: vec![packed(1.0)],
        encoder_version: 1,
    }
}

fn open(dir: &Path) -> StoredCorpus {
    StoredCorpus::open(dir, &OpenOptions { reserve_bytes: 0, ..OpenOptions::default() }).expect("a store").0
}

#[test]
fn an_example_is_told_the_same_before_and_after_a_restart() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (example, put) = corpus.put(new_example(b"mesh", Some(vec![7, -1, 7]))).expect("added");
    assert_eq!(put, PutOutcome::Added);
    assert_eq!((example.relevance, example.counts.quads, example.segments[0].features), (3.3, 10, 1));
    let encoding = corpus.encoding(example.id, 0, 64).expect("an encoding");
    drop(corpus);
    let corpus = open(dir.path());
    assert_eq!(corpus.get(example.id).expect("there"), example);
    assert_eq!(corpus.encoding(example.id, 0, 64).expect("an encoding"), encoding);
    assert_eq!(corpus.bytes(example.id).expect("bytes"), Bytes::from_static(b"mesh"));
    assert_eq!(corpus.cut(example.id).expect("a cut").labels, Some(vec![1, 0, 1]));
}

/// Whole, and by as many parts as there are labels but 0.
fn with_parts(bytes: &'static [u8], labels: Vec<i64>) -> NewExample {
    let count = labels.iter().max().map_or(0, |label| *label as usize);
    let cut = Cut { besides: ExtraParts::Known(labels), ..Cut::default() };
    NewExample { cut, segments: vec![packed(1.0); count + 1], ..new_example(bytes, None) }
}

#[test]
fn parts_besides_the_whole_are_told_the_same_after_a_restart_and_a_restore() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (example, _) = corpus.put(with_parts(b"mesh", vec![2, 0, 1])).expect("added");
    assert_eq!(example.segments.iter().map(|s| s.is_part).collect::<Vec<_>>(), [false, true, true]);
    let mut backup = Vec::new();
    corpus.backup(&mut backup).expect("written");
    drop(corpus);
    let other = tempfile::tempdir().expect("a directory");
    Store::restore(other.path(), &OpenOptions { reserve_bytes: 0, ..OpenOptions::default() }, &mut &backup[..])
        .map(drop)
        .expect("restored");
    for dir in [dir.path(), other.path()] {
        let corpus = open(dir);
        assert_eq!(corpus.list()[0].segments, example.segments);
        let id = corpus.list()[0].id;
        let cut = corpus.cut(id).expect("a cut");
        assert_eq!(cut, Cut { besides: ExtraParts::Known(vec![2, 0, 1]), ..Cut::default() });
        assert_eq!(corpus.check().expect("checked").problems, Vec::<String>::new());
    }
}

#[test]
fn whole_or_with_any_parts_it_is_one_example_and_damage_to_it_is_healed() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let sought = Cut { besides: ExtraParts::Sought, ..Cut::default() };
    let (both, _) = corpus.put(with_parts(b"both", vec![1, 2])).expect("added");
    for cut in [&sought, &Cut::default()] {
        assert_eq!(corpus.find(b"both", cut).map(|e| e.id), Some(both.id));
    }
    // Another release finds other parts.
    let (again, put) = corpus.put(with_parts(b"both", vec![1, 2, 3])).expect("there");
    assert_eq!((&again, put), (&both, PutOutcome::There));
    let (whole, _) = corpus.put(new_example(b"whole", None)).expect("added");
    assert_eq!(corpus.find(b"whole", &sought).map(|e| e.id), Some(whole.id));
    let objects = dir.path().join("objects");
    for example in [&both, &whole] {
        std::fs::write(objects.join(&example.hash), b"other").expect("damaged");
        assert!(matches!(corpus.bytes(example.id), Err(CorpusError::Damaged(_))));
    }
    assert_eq!(corpus.find(b"whole", &sought), None);
    let healed = corpus.put(with_parts(b"whole", vec![1, 2])).expect("healed");
    assert_eq!((healed.0.id, healed.0.segments.len(), healed.1), (whole.id, 1, PutOutcome::There));
    corpus.put(with_parts(b"both", vec![1, 2])).expect("healed");
    assert_eq!(corpus.bytes(both.id).expect("whole"), Bytes::from_static(b"both"));
    assert_eq!(corpus.health().quarantined, []);
}

#[test]
fn damaged_labels_of_parts_are_healed_by_the_same_parts_and_by_no_others() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (both, _) = corpus.put(with_parts(b"both", vec![1, 2])).expect("added");
    let labels = std::fs::read_dir(dir.path().join("objects")).expect("objects").map(|e| e.expect("a file").path());
    let labels = labels.filter(|path| !path.ends_with(&both.hash)).collect::<Vec<_>>();
    assert_eq!(labels.len(), 1);
    std::fs::write(&labels[0], b"none").expect("damaged");
    assert!(matches!(corpus.cut(both.id), Err(CorpusError::Damaged(_))));
    assert!(matches!(corpus.put(with_parts(b"both", vec![2, 1])), Err(CorpusError::Damaged(_))));
    assert_eq!(corpus.health().quarantined, [both.id]);
    corpus.put(with_parts(b"both", vec![1, 2])).expect("healed");
    assert_eq!(corpus.cut(both.id).expect("a cut").besides, ExtraParts::Known(vec![1, 2]));
}

#[test]
fn the_same_bytes_cut_the_same_way_are_the_same_example() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (first, _) = corpus.put(new_example(b"mesh", None)).expect("added");
    let (second, put) = corpus.put(new_example(b"mesh", None)).expect("there");
    assert_eq!((second.id, put), (first.id, PutOutcome::There));
    assert_eq!(corpus.find(b"mesh", &Cut::default()).map(|e| e.id), Some(first.id));
    assert_eq!(corpus.find(b"mesh", &Cut { way: Segmentation::Whole, ..Cut::default() }), None);
}

#[test]
fn what_is_removed_is_gone_and_an_older_encoding_is_stale() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (example, _) = corpus.put(new_example(b"mesh", None)).expect("added");
    assert_eq!(corpus.stale(1), []);
    assert_eq!(corpus.stale(2), [(example.id, 0)]);
    corpus.put_encoding(example.id, 0, &packed(2.0), example.counts, 2).expect("encoded again");
    assert_eq!(corpus.stale(2), []);
    corpus.remove(example.id).expect("removed");
    assert!(matches!(corpus.get(example.id), Err(CorpusError::NotFound(_))));
    assert!(matches!(corpus.remove(example.id), Err(CorpusError::NotFound(_))));
}

#[test]
fn counts_are_told_while_encodings_are_made_anew() {
    let dir = tempfile::tempdir().expect("a directory");
    let mesh: &[u8] = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\n";
    let counts = MeshCounts { vertices: 5, faces: 2, triangles: 1, quads: 1 };
    let (example, _) = open(dir.path()).put(NewExample { counts, ..new_example(mesh, None) }).expect("added");
    std::fs::remove_dir_all(dir.path().join("index")).expect("removed");
    let described = open(dir.path()).get(example.id).expect("there");
    assert_eq!((described.counts.triangles, described.counts.quads), (1, 1));
}

#[test]
fn what_was_added_tells_its_counts_before_it_is_described() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (example, _) = corpus.put(new_example(b"mesh", None)).expect("added");
    // As another request sees it that comes between the commit and the description.
    corpus.described.write().expect("no panic").remove(&example.id);
    assert_eq!(corpus.get(example.id).expect("there"), example);
}

#[test]
fn a_damaged_example_says_so_also_after_a_restart() {
    let dir = tempfile::tempdir().expect("a directory");
    let corpus = open(dir.path());
    let (example, _) = corpus.put(new_example(b"mesh", None)).expect("added");
    std::fs::write(dir.path().join("objects").join(&example.hash), b"hsem").expect("damaged");
    assert!(matches!(corpus.bytes(example.id), Err(CorpusError::Damaged(_))));
    drop(corpus);
    let corpus = open(dir.path());
    assert!(matches!(corpus.get(example.id), Err(CorpusError::Damaged(_))));
    assert_eq!(corpus.health().quarantined, [example.id]);
    corpus.put(new_example(b"mesh", None)).expect("healed");
    assert_eq!(corpus.bytes(example.id).expect("whole"), Bytes::from_static(b"mesh"));
    assert_eq!(corpus.health().quarantined, []);
}

#[test]
fn it_is_writable_only_where_there_is_space() {
    use std::sync::atomic::{AtomicU64, Ordering};
    let dir = tempfile::tempdir().expect("a directory");
    let free = Arc::new(AtomicU64::new(u64::MAX));
    let probe = Arc::clone(&free);
    let free_space: quadmuse_store::FreeSpace = Arc::new(move |_| Ok(probe.load(Ordering::SeqCst)));
    let (corpus, _) =
        StoredCorpus::open(dir.path(), &OpenOptions { free_space, ..OpenOptions::default() }).expect("a store");
    assert_eq!(corpus.health().read_only, None);
    free.store(1 << 20, Ordering::SeqCst);
    assert!(corpus.health().read_only.is_some());
    assert!(matches!(corpus.put(new_example(b"mesh", None)), Err(CorpusError::Full(_))));
}

#[test]
fn what_another_server_changed_is_brought_into_memory() {
    use crate::work::catalogue::Catalogue;
    use crate::work::engine::fake::FakeEngine;
    let dir = tempfile::tempdir().expect("a directory");
    let store =
        Store::open(dir.path(), &OpenOptions { reserve_bytes: 0, ..OpenOptions::default() }).expect("a store").0;
    let corpora = [(); 2].map(|()| Arc::new(StoredCorpus::of(Arc::new(store.clone()), None)));
    let mine = Catalogue::new(corpora[0].clone(), Arc::new(FakeEngine));
    mine.load();
    let other = &corpora[1];
    let (example, _) = other.put(new_example(b"mesh", None)).expect("added");
    mine.follow();
    // All of it, the counts that are derived of its encodings included.
    assert_eq!(mine.snapshot().example(example.id), Some(&example));
    let patch = ExamplePatch { name: Some("leg".into()), revision: Some(1), ..ExamplePatch::default() };
    let renamed = other.annotate(example.id, &patch).expect("renamed");
    assert!(matches!(corpora[0].annotate(example.id, &patch), Err(CorpusError::Conflict(_))));
    mine.follow();
    assert_eq!((renamed.revision, mine.snapshot().example(example.id)), (2, Some(&renamed)));
    other.remove(example.id).expect("removed");
    mine.follow();
    assert_eq!((mine.snapshot().example_count(), mine.snapshot().segment_count()), (0, 0));
    assert_eq!(*corpora[0].watch().borrow(), 3);
}
