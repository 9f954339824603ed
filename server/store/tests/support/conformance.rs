//! What holds of every backend: the same tests for a store on disk, for a corpus that servers share on an engine, and for
//! one whose engine loses, repeats, delays and reorders what it delivers.
//!
//! Each test is given two servers of one corpus. On a store they are the same; elsewhere what one writes reaches the other
//! after a while, and whoever wrote sees it at once.
#![allow(dead_code, reason = "each suite uses a part of it")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Added, Backend, Changed, NewSegmentation, Patch, StoreError};

use crate::sample::{Sample, segment_of};

/// Two servers of one corpus.
pub(crate) type Pair = (Arc<dyn Backend>, Arc<dyn Backend>);

/// Longest time for one server to see what another wrote.
const SEEN_WITHIN: Duration = Duration::from_secs(60);

/// Waits until `holds`.
///
/// # Panics
/// If it never does.
pub(crate) fn eventually(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < SEEN_WITHIN, "not so after {SEEN_WITHIN:?}: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A small example, quickly made.
pub(crate) fn small(seed: u64) -> Sample {
    Sample::with(seed, vec![segment_of(seed, &[32], 4)])
}

fn rename(name: &str) -> Patch {
    Patch { name: Some(name.into()), ..Patch::default() }
}

/// All tests, in order, each on a corpus of its own.
pub(crate) fn all(corpus: &mut dyn FnMut() -> Pair) {
    what_was_answered_is_read_at_once_and_seen_by_the_other(&corpus());
    the_same_mesh_is_the_same_example_whoever_adds_it(&corpus());
    a_record_that_somebody_else_changed_is_not_overwritten(&corpus());
    concurrent_changes_of_one_record_all_count(&corpus());
    what_is_removed_is_gone_for_both_and_can_come_again(&corpus());
    an_encoding_made_anew_is_seen_by_both(&corpus());
    who_follows_the_changes_has_the_corpus_as_it_is(&corpus());
    a_whole_example_comes_back_byte_for_byte(&corpus(), &corpus());
    values_outside_the_limits_are_refused(&corpus());
}

fn what_was_answered_is_read_at_once_and_seen_by_the_other((a, b): &Pair) {
    let sample = Sample::with(1, vec![segment_of(1, &[32, 64, 128], 700), segment_of(2, &[32, 64], 50)]);
    let rows = [vec![7; 2000], vec![8; 2000]];
    let Added::Created(record) = a.add(&sample.example(), &rows).expect("added") else { panic!("it is new") };
    let id = record.id;
    assert_eq!(a.get(id).expect("there"), record);
    assert_eq!(a.mesh_bytes(id).expect("there"), sample.mesh);
    eventually("the other has it", || b.get(id).is_ok());
    for one in [a, b] {
        assert_eq!(one.get(id).expect("there"), record);
        assert_eq!(one.mesh_bytes(id).expect("there"), sample.mesh);
        assert_eq!(one.labels(id).expect("there"), None);
        let coarse = one.coarse(id, 0).expect("there");
        assert_eq!((coarse.level.side, &coarse.features), (32, &sample.derived[0].features));
        assert_eq!(one.level(id, 1, 64).expect("there"), a.level(id, 1, 64).expect("there"));
        assert_eq!(one.chart(id, 0).expect("there"), sample.derived[0].chart);
        assert!(matches!(one.level(id, 1, 128), Err(StoreError::NoSuchLevel { side: 128, .. })));
        assert!(matches!(one.coarse(id, 2), Err(StoreError::MissingDerived { segment: 2, .. })));
        assert_eq!(one.find(&sample.mesh, NewSegmentation::Auto), Some(record.clone()));
        assert_eq!(one.find(&sample.mesh, NewSegmentation::Whole), None);
        let other = ExampleId::generate();
        assert!(matches!(one.get(other), Err(StoreError::NotFound { id }) if id == other));
        assert!(matches!(one.mesh_bytes(other), Err(StoreError::NotFound { .. })));
        let report = one.check(&mut |_| {}).expect("checked");
        assert_eq!((report.examples, report.segments, report.problems), (1, 2, vec![]));
        assert_eq!(one.unwritable(), None);
    }
}

fn the_same_mesh_is_the_same_example_whoever_adds_it((a, b): &Pair) {
    // At the same moment on both, again and again.
    for seed in 0..6 {
        let sample = small(seed);
        let add = |one: &Arc<dyn Backend>| one.add(&sample.example(), &[]).expect("added");
        let (first, second) = std::thread::scope(|scope| {
            let other = scope.spawn(|| add(b));
            (add(a), other.join().expect("added"))
        });
        assert_eq!(first.record().id, second.record().id, "one example, not two");
        let created = [&first, &second].iter().filter(|added| matches!(added, Added::Created(_))).count();
        assert_eq!(created, 1, "one of them made it");
        assert!(matches!(add(a), Added::Exists(_)));
    }
    for one in [a, b] {
        eventually("each has six", || one.snapshot().examples.len() == 6);
    }
}

fn a_record_that_somebody_else_changed_is_not_overwritten((a, b): &Pair) {
    let id = a.add(&small(1).example(), &[]).expect("added").record().id;
    eventually("the other has it", || b.get(id).is_ok());
    let of = |revision, name: &str| Patch { from_revision: Some(revision), ..rename(name) };
    assert_eq!(a.annotate(id, of(1, "mine")).expect("renamed").revision, 2);
    // Also while the other server has not seen it yet.
    match b.annotate(id, of(1, "yours")) {
        Err(StoreError::Conflict { expected: 1, found: 2, .. }) => {}
        other => panic!("expected a conflict that names revision 2, found {other:?}"),
    }
    let now = b.annotate(id, of(2, "ours")).expect("renamed");
    assert_eq!((now.revision, now.name.as_str()), (3, "ours"));
    eventually("both have it", || a.get(id).is_ok_and(|record| record.name == "ours"));
    let missing = ExampleId::generate();
    assert!(matches!(a.annotate(missing, rename("none")), Err(StoreError::NotFound { .. })));
}

fn concurrent_changes_of_one_record_all_count((a, b): &Pair) {
    let id = a.add(&small(1).example(), &[]).expect("added").record().id;
    eventually("the other has it", || b.get(id).is_ok());
    let changes = 6;
    std::thread::scope(|scope| {
        for (at, one) in [a, b, a, b].into_iter().enumerate() {
            scope.spawn(move || {
                for k in 0..changes {
                    one.annotate(id, rename(&format!("{at}-{k}"))).expect("renamed");
                }
            });
        }
    });
    for one in [a, b] {
        eventually("every change counted once", || one.get(id).is_ok_and(|r| r.revision == 1 + 4 * changes));
    }
    assert_eq!(a.get(id).expect("there"), b.get(id).expect("there"));
}

fn what_is_removed_is_gone_for_both_and_can_come_again((a, b): &Pair) {
    let sample = small(3);
    let id = a.add(&sample.example(), &[]).expect("added").record().id;
    eventually("the other has it", || b.get(id).is_ok());
    b.remove(id).expect("removed");
    assert!(matches!(b.get(id), Err(StoreError::NotFound { .. })));
    eventually("gone for both", || a.get(id).is_err());
    for one in [a, b] {
        assert!(matches!(one.remove(id), Err(StoreError::NotFound { .. })));
        assert!(matches!(one.annotate(id, rename("none")), Err(StoreError::NotFound { .. })));
        assert_eq!(one.find(&sample.mesh, NewSegmentation::Auto), None);
        assert!(one.snapshot().examples.is_empty());
    }
    let Added::Created(again) = a.add(&sample.example(), &[]).expect("added") else { panic!("it is new again") };
    eventually("both have it again", || b.get(again.id).is_ok());
    assert!(again.id != id && b.get(id).is_err());
    assert_eq!(b.mesh_bytes(again.id).expect("there"), sample.mesh);
}

fn an_encoding_made_anew_is_seen_by_both((a, b): &Pair) {
    let id = a.add(&small(5).example(), &[]).expect("added").record().id;
    eventually("the other has it", || b.get(id).is_ok());
    for one in [a, b] {
        assert_eq!(one.missing_derived(1), []);
        assert_eq!(one.missing_derived(2), [(id, 0)]);
    }
    let fresh = segment_of(77, &[32, 64], 9);
    b.put_derived(id, 0, 2, &fresh, None).expect("kept");
    assert_eq!(b.missing_derived(2), []);
    assert_eq!(b.chart(id, 0).expect("there"), fresh.chart);
    eventually("both have it", || a.missing_derived(2).is_empty());
    assert_eq!(a.chart(id, 0).expect("there"), fresh.chart);
    assert_eq!(a.get(id).expect("there").revision, 1, "an encoding is no annotation");
    let missing = ExampleId::generate();
    assert!(matches!(a.put_derived(missing, 0, 2, &fresh, None), Err(StoreError::NotFound { .. })));
    assert!(matches!(a.put_derived(id, 1, 2, &fresh, None), Err(StoreError::Invalid { .. })));
}

/// Keeps a copy of a corpus by its changes alone.
struct Follower {
    position: u64,
    copy: BTreeMap<ExampleId, (u32, bool)>,
}

impl Follower {
    fn follow(&mut self, one: &dyn Backend) {
        let changes = one.changes(self.position);
        let anew = || one.snapshot().examples.iter().map(|record| Changed::Encoded(record.id)).collect();
        for changed in changes.changed.unwrap_or_else(anew) {
            let id = changed.id();
            match one.get(id) {
                Ok(record) => {
                    let entry = self.copy.entry(id).or_default();
                    entry.0 = record.revision;
                    entry.1 |= matches!(changed, Changed::Encoded(_));
                }
                Err(_) => drop(self.copy.remove(&id)),
            }
        }
        assert!(changes.position >= self.position);
        self.position = changes.position;
    }
}

fn who_follows_the_changes_has_the_corpus_as_it_is((a, b): &Pair) {
    let heard = Arc::new(AtomicU64::new(0));
    let telling = Arc::clone(&heard);
    b.subscribe(Box::new(move |position| {
        telling.fetch_max(position, Ordering::SeqCst);
    }));
    let mut followers = [a, b].map(|_| Follower { position: 0, copy: BTreeMap::new() });
    let mut ids = Vec::new();
    for seed in 0..12 {
        let writer = if seed % 2 == 0 { a } else { b };
        ids.push(writer.add(&small(seed).example(), &[]).expect("added").record().id);
        if seed % 3 == 0 {
            writer.annotate(ids[seed as usize], rename("named")).expect("renamed");
        }
        if seed == 7 {
            b.remove(ids[7]).expect("removed");
        }
        followers.iter_mut().zip([a, b]).for_each(|(follower, one)| follower.follow(&**one));
    }
    let expected: BTreeMap<ExampleId, (u32, bool)> = ids
        .iter()
        .enumerate()
        .filter(|(seed, _)| *seed != 7)
        .map(|(seed, &id)| (id, (if seed % 3 == 0 { 2 } else { 1 }, true)))
        .collect();
    for (follower, one) in followers.iter_mut().zip([a, b]) {
        let begun = Instant::now();
        while follower.copy != expected {
            assert!(begun.elapsed() < SEEN_WITHIN, "{:?} is not {expected:?}", follower.copy);
            std::thread::sleep(Duration::from_millis(10));
            follower.follow(&**one);
        }
        let listed: Vec<_> = one.snapshot().examples.iter().map(|record| record.id).collect();
        assert_eq!(listed, expected.keys().copied().collect::<Vec<_>>());
    }
    eventually("listeners are told", || heard.load(Ordering::SeqCst) == b.changes(u64::MAX).position);
    assert_eq!(a.changes(u64::MAX).changed, None, "a position that never was");
}

fn a_whole_example_comes_back_byte_for_byte((a, b): &Pair, (c, d): &Pair) {
    for seed in 0..4 {
        let sample = Sample::with(seed, vec![segment_of(seed, &[32, 64], 30); 2]);
        let labels: Vec<u32> = (0..680).map(|face| u32::from(face % 2 == 0)).collect();
        let mut example = sample.example();
        if seed == 2 {
            example.segmentation = NewSegmentation::Labels(&labels);
        }
        a.add(&example, &[]).expect("added");
    }
    let id = a.snapshot().examples[1].id;
    a.annotate(id, rename("renamed")).expect("renamed");
    let backup_of = |one: &Arc<dyn Backend>| {
        let mut bytes = Vec::new();
        assert_eq!(one.backup(&mut bytes).expect("written").skipped, []);
        bytes
    };
    let first = backup_of(a);
    eventually("both write the same", || backup_of(b) == first);
    assert_eq!(quadmuse_store::read_backup(&**c, &mut &first[..]).expect("read"), 4);
    assert_eq!(backup_of(c), first);
    eventually("both write the same", || backup_of(d) == first);
    let labelled = c.snapshot().examples[2].id;
    assert_eq!(d.labels(labelled).expect("there").map(|labels| labels.len()), Some(680));
    // Once more: all are there already.
    assert_eq!(quadmuse_store::read_backup(&**d, &mut &first[..]).expect("read"), 4);
    assert_eq!(d.snapshot().examples.len(), 4);
    let mut whole = a.whole(id).expect("there");
    whole.objects[0].push(0);
    assert!(matches!(c.put_whole(whole), Err(StoreError::Invalid { .. })));
}

fn values_outside_the_limits_are_refused((a, _): &Pair) {
    let sample = small(1);
    let mut example = sample.example();
    example.relevance = 6.0;
    assert!(matches!(a.add(&example, &[]), Err(StoreError::Invalid { .. })));
    example.relevance = 3.0;
    example.derived = &[];
    assert!(matches!(a.add(&example, &[]), Err(StoreError::Invalid { .. })));
    let id = a.add(&sample.example(), &[]).expect("added").record().id;
    let patch = Patch { relevance: Some(f32::NAN), ..Patch::default() };
    assert!(matches!(a.annotate(id, patch), Err(StoreError::Invalid { .. })));
    assert_eq!(a.get(id).expect("there").revision, 1);
}
