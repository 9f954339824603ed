//! A corpus that servers share is a backend like every other, also where its engine is unreliable.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::fake::{FakeEngine, Faults};
use crate::suite::{Pair, eventually, small};
use quadmuse_cluster::{RowMaker, SharedCorpus, SharedOptions};
use quadmuse_store::{Added, Backend, Documents, NewSegmentation, Patch, Store, StoreError};

fn join(engine: &FakeEngine, dir: &Path) -> Arc<SharedCorpus> {
    let cache = dir.join(quadmuse_proto::id::ExampleId::generate().to_string());
    // A lost request is the caller's to send again, as a service that starts is.
    let open = || SharedCorpus::open(Arc::new(engine.clone()), &SharedOptions::caching_in(&cache));
    Arc::new(open().expect("joined"))
}

fn pair(engine: &FakeEngine, dir: &Path) -> Pair {
    (join(engine, dir), join(engine, dir))
}

#[test]
fn jobs_are_done_once_with_effect_whoever_dies_and_whatever_is_lost() {
    let reliable = FakeEngine::new(1, Faults::default());
    crate::queue::all([&reliable, &reliable.clone()], crate::fake::LEASE, true);
    let faulty = FakeEngine::new(2, Faults::many());
    crate::queue::all([&faulty, &faulty.clone()], crate::fake::LEASE, false);
}

#[test]
fn an_encoding_that_was_made_twice_changes_nothing() {
    let dir = tempfile::tempdir().expect("a directory");
    let server = join(&FakeEngine::new(1, Faults::default()), dir.path());
    let sample = small(1);
    let id = server.add(&sample.example(), &[]).expect("added").record().id;
    let derived = &sample.example().derived[0];
    server.put_derived(id, 0, 9, derived, None).expect("put");
    let position = server.position();
    eventually("it is delivered", || server.position() >= position);
    let (position, changes) = (server.reached(), server.changes(u64::MAX).position);
    server.put_derived(id, 0, 9, derived, None).expect("put");
    // An older one, of a server that is not yet upgraded.
    server.put_derived(id, 0, 8, derived, None).expect("put");
    assert_eq!((server.reached(), server.changes(u64::MAX).position), (position, changes));
    assert_eq!(server.missing_derived(9), []);
    server.put_derived(id, 0, 10, derived, None).expect("put");
    assert!(server.reached() > position);
}

#[test]
fn a_shared_corpus_conforms() {
    let dir = tempfile::tempdir().expect("a directory");
    crate::suite::all(&mut || pair(&FakeEngine::new(1, Faults::default()), dir.path()));
}

#[test]
fn a_shared_corpus_conforms_on_an_engine_that_reorders_delays_repeats_and_drops() {
    let dir = tempfile::tempdir().expect("a directory");
    for seed in 1..3 {
        let mut corpora = 0;
        crate::suite::all(&mut || {
            corpora += 1;
            pair(&FakeEngine::new(100 * seed + corpora, Faults::many()), dir.path())
        });
    }
}

#[test]
fn each_fault_alone_is_survived() {
    let dir = tempfile::tempdir().expect("a directory");
    let none = Faults::default();
    for (seed, faults) in (0..).zip([
        Faults { delivered_late: 1, ..none },
        Faults { delivered_twice: 1, ..none },
        Faults { delivered_in_the_wrong_order: 1, ..none },
        Faults { not_delivered: 2, ..none },
        Faults { following_ended: 2, ..none },
        Faults { request_lost: 3, ..none },
        Faults { answer_lost: 2, ..none },
        Faults { read_behind: 2, ..none },
    ]) {
        let engine = FakeEngine::new(seed, faults);
        let (a, b) = pair(&engine, dir.path());
        for example in 0..20 {
            let writer = if example % 2 == 0 { &a } else { &b };
            let id = writer.add(&small(example).example(), &[]).expect("added").record().id;
            let name = Patch { name: Some(format!("example {example}")), ..Patch::default() };
            assert_eq!(writer.annotate(id, name).expect("renamed").revision, 2, "{faults:?}");
        }
        for one in [&a, &b] {
            eventually(&format!("all are there, {faults:?}"), || one.snapshot().examples.len() == 20);
        }
        eventually("both have the same", || a.snapshot().examples == b.snapshot().examples);
    }
}

#[test]
fn a_server_that_joins_later_has_everything_and_the_rows_with_it() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(7, Faults::many());
    let first = join(&engine, dir.path());
    let row = vec![5; 2100];
    let mut ids = Vec::new();
    for seed in 0..30 {
        ids.push(first.add(&small(seed).example(), std::slice::from_ref(&row)).expect("added").record().id);
    }
    first.remove(ids.swap_remove(3)).expect("removed");
    let later = join(&engine, dir.path());
    assert_eq!(later.snapshot().examples, first.snapshot().examples);
    let rows = later.rows();
    assert_eq!(rows.len(), 29);
    assert!(rows.iter().all(|(id, (segment, bytes))| ids.contains(id) && *segment == 0 && *bytes == row));
    assert!(later.rows().is_empty(), "they are handed out once");
    let id = first.add(&small(99).example(), std::slice::from_ref(&row)).expect("added").record().id;
    eventually("it has the new one", || later.get(id).is_ok());
    assert_eq!(later.rows_of(id), [(0, row)]);
    assert_eq!(later.following().behind, 0);
}

#[test]
fn objects_that_are_damaged_or_lost_are_told_and_healed_by_adding_again() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(3, Faults::default());
    let sample = small(1);
    let record = join(&engine, dir.path()).add(&sample.example(), &[]).expect("added").record().clone();
    let mesh = record.content_hash.to_string();
    for damage in [Some(&b"other"[..]), None] {
        engine.spoil(&mesh, damage);
        let server = join(&engine, dir.path());
        assert_eq!(server.check(&mut |_| {}).expect("checked").problems.len(), 1);
        assert!(matches!(server.mesh_bytes(record.id), Err(StoreError::Quarantined { .. })));
        assert!(matches!(server.get(record.id), Err(StoreError::Quarantined { .. })));
        assert!(server.is_damaged(&sample.mesh, NewSegmentation::Auto) && server.snapshot().examples.is_empty());
        assert!(
            matches!(server.add(&sample.example(), &[]).expect("healed"), Added::Exists(healed) if healed == record)
        );
        assert_eq!(server.mesh_bytes(record.id).expect("healed"), sample.mesh);
        assert_eq!(server.quarantined(), []);
    }
}

/// A server that looks after what was written soon after an election.
fn join_looking_soon(engine: &FakeEngine, cache: &Path) -> SharedCorpus {
    join_looking_after(engine, cache, [1, 2, 3].map(|times| Duration::from_millis(50 * times)))
}

fn join_looking_after(engine: &FakeEngine, cache: &Path, looked_after: [Duration; 3]) -> SharedCorpus {
    let options = SharedOptions { looked_after, ..SharedOptions::caching_in(cache) };
    SharedCorpus::open(Arc::new(engine.clone()), &options).expect("joined")
}

#[test]
fn what_the_engine_acknowledged_and_lost_is_written_again() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(11, Faults::default());
    let joined = |cache: &str| join_looking_soon(&engine, &dir.path().join(cache));
    let (a, b) = (joined("a"), joined("b"));
    let mut records: Vec<_> =
        (0..10).map(|seed| a.add(&small(seed).example(), &[]).expect("added").record().clone()).collect();
    let renamed = |name: &str| Patch { name: Some(name.into()), ..Patch::default() };
    a.annotate(records[0].id, renamed("first")).expect("renamed");
    eventually("the other has them", || b.snapshot().examples == a.snapshot().examples);
    // The healer has to know who led before.
    std::thread::sleep(Duration::from_millis(2200));
    engine.lose(4, &records[9].content_hash.to_string());
    assert_eq!(joined("c").snapshot().examples.len(), 7, "they are gone");
    // Another server writes where it ended.
    records.push(b.add(&small(50).example(), &[]).expect("added").record().clone());
    eventually("all have all", || {
        let fresh = joined("d");
        let whole = fresh.check(&mut |_| {}).is_ok_and(|report| report.examples == 11 && report.problems.is_empty());
        let same = [&a, &b].iter().all(|server| server.snapshot().examples == fresh.snapshot().examples);
        std::fs::remove_dir_all(dir.path().join("d")).is_ok() && whole && same
    });
    assert_eq!(a.get(records[0].id).expect("there").name, "first");
    for record in &records {
        b.annotate(record.id, renamed("again")).expect("renamed");
    }
}

#[test]
fn whoever_was_passed_over_notices_by_itself_that_an_example_is_missing() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(12, Faults::default());
    // Nobody looks after what was written meanwhile.
    let joined = |cache: &str| join_looking_after(&engine, &dir.path().join(cache), [Duration::from_secs(3600); 3]);
    let (a, b) = (joined("a"), joined("b"));
    a.add(&small(0).example(), &[]).expect("added");
    eventually("the other has it", || b.snapshot().examples.len() == 1);
    engine.pass_over_next();
    a.add(&small(1).example(), &[]).expect("added");
    a.add(&small(2).example(), &[]).expect("added");
    eventually("the other has what came after", || b.snapshot().examples.len() >= 2);
    assert_eq!(b.snapshot().examples.len(), 2, "one has not come");
    // It is never delivered: the leader has it.
    eventually("the other has all", || b.snapshot().examples == a.snapshot().examples);
}

#[test]
fn whoever_was_passed_over_notices_after_an_election() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(12, Faults::default());
    let joined = |cache: &str| join_looking_soon(&engine, &dir.path().join(cache));
    let (a, b) = (joined("a"), joined("b"));
    let record = a.add(&small(0).example(), &[]).expect("added").record().clone();
    // The looks of those that have just joined are over then.
    std::thread::sleep(Duration::from_millis(4500));
    engine.pass_over_next();
    a.annotate(record.id, Patch { name: Some("renamed".into()), ..Patch::default() }).expect("renamed");
    a.add(&small(1).example(), &[]).expect("added");
    eventually("the other has what came after", || b.snapshot().examples.len() == 2);
    std::thread::sleep(Duration::from_millis(1500));
    assert_ne!(b.snapshot().examples, a.snapshot().examples, "the name never came, and no key is missing");
    engine.deliver_all();
    engine.elect();
    eventually("the other has all", || b.snapshot().examples == a.snapshot().examples);
}

#[test]
fn whoever_joins_and_is_passed_over_notices() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(13, Faults::default());
    let joined = |cache: &str| join(&engine, &dir.path().join(cache));
    let there = joined("there");
    let record = there.add(&small(0).example(), &[]).expect("added").record().clone();
    engine.pass_over_next();
    there.annotate(record.id, Patch { name: Some("renamed".into()), ..Patch::default() }).expect("renamed");
    there.add(&small(1).example(), &[]).expect("added");
    let new = joined("new");
    assert_ne!(new.snapshot().examples, there.snapshot().examples, "an entry never came");
    engine.deliver_all();
    eventually("it has all", || new.snapshot().examples == there.snapshot().examples);
}

#[test]
fn whoever_joins_at_a_copy_that_differs_comes_to_what_was_acknowledged() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(14, Faults::default());
    let joined = |cache: &str| join_looking_soon(&engine, &dir.path().join(cache));
    let a = joined("a");
    let record = a.add(&small(0).example(), &[]).expect("added").record().clone();
    let patch = Patch { name: Some("renamed".into()), ..Patch::default() };
    a.annotate(record.id, patch).expect("renamed");
    engine.have_copies_differ();
    let new = joined("new");
    assert_eq!(new.get(record.id).expect("there").name, record.name, "it was delivered something else");
    eventually("it has what was acknowledged", || new.snapshot().examples == a.snapshot().examples);
    let is_delivered = || joined("newest").get(record.id).is_ok_and(|example| example.name == "renamed");
    eventually("nobody is delivered the other any more", is_delivered);
}

#[test]
fn a_leader_whose_copy_differs_is_given_what_was_acknowledged() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(15, Faults::default());
    let joined = |cache: &str| join_looking_soon(&engine, &dir.path().join(cache));
    let (a, b) = (joined("a"), joined("b"));
    let record = a.add(&small(0).example(), &[]).expect("added").record().clone();
    let patch = Patch { name: Some("renamed".into()), ..Patch::default() };
    a.annotate(record.id, patch).expect("renamed");
    eventually("the other has it", || b.snapshot().examples == a.snapshot().examples);
    // The looks of those that have just joined are over then.
    std::thread::sleep(Duration::from_millis(4500));
    engine.have_leader_differ();
    let are_alike = || {
        let fresh = joined("fresh");
        [&a, &b, &fresh].iter().all(|server| server.get(record.id).is_ok_and(|example| example.name == "renamed"))
    };
    eventually("all have what was acknowledged", are_alike);
}

#[test]
fn objects_are_collected_when_nobody_needs_them_and_they_are_old() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(3, Faults::default());
    let server = join(&engine, dir.path());
    let gone = server.add(&small(1).example(), &[]).expect("added").record().id;
    let kept = server.add(&small(2).example(), &[]).expect("added").record().id;
    server.remove(gone).expect("removed");
    assert_eq!(engine.object_count(), 4);
    assert_eq!(server.collect(Duration::from_secs(3600)).expect("collected"), 0, "they are young");
    assert_eq!(server.collect(Duration::ZERO).expect("collected"), 2);
    let other = join(&engine, dir.path());
    assert_eq!(other.mesh_bytes(kept).expect("there"), small(2).mesh);
    assert_eq!(other.check(&mut |_| {}).expect("checked").problems, []);
}

#[test]
fn a_clock_that_is_wrong_collects_nothing_that_is_young() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(3, Faults::default());
    let server = join(&engine, dir.path());
    // Once by the engine's clock, as if those of the servers were two days ahead, and once by theirs.
    engine.set_clock_behind(Duration::from_secs(2 * 86_400));
    let gone = server.add(&small(1).example(), &[]).expect("added").record().id;
    server.remove(gone).expect("removed");
    assert_eq!(server.collect(Duration::from_secs(86_400)).expect("collected"), 0, "it was put just now");
    engine.set_clock_behind(Duration::ZERO);
    let gone = server.add(&small(2).example(), &[]).expect("added").record().id;
    server.remove(gone).expect("removed");
    assert_eq!(server.collect(Duration::from_secs(86_400)).expect("collected"), 2, "the first is two days old by now");
    assert_eq!(server.collect(Duration::ZERO).expect("collected"), 2);
}

#[test]
fn documents_are_shared_and_not_overwritten_silently() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(5, Faults { answer_lost: 3, ..Faults::default() });
    let (a, b) = (join(&engine, dir.path()), join(&engine, dir.path()));
    assert_eq!(a.known("tokens"), None);
    assert!(Documents::write(&*a, "tokens", 0, b"one").expect("written"));
    assert!(!Documents::write(&*b, "tokens", 0, b"two").expect("refused"));
    eventually("the other knows it", || b.known("tokens").is_some_and(|document| *document.bytes == *b"one"));
    let now = (0..20).find_map(|_| Documents::read(&*b, "tokens").ok()).expect("read").expect("there");
    assert!(Documents::write(&*b, "tokens", now.revision, b"two").expect("written"));
    eventually("the first knows it", || a.known("tokens").is_some_and(|document| *document.bytes == *b"two"));
    assert!(a.snapshot().examples.is_empty());
    assert!(matches!(Documents::write(&*a, "long", 0, &vec![0; 1 << 20]), Err(StoreError::Invalid { .. })));
}

/// Keeps what is written, and has something happen before the second piece.
struct Interrupted<'a> {
    bytes: Vec<u8>,
    pieces: u32,
    happens: &'a dyn Fn(),
}

impl std::io::Write for Interrupted<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.pieces += 1;
        if self.pieces == 2 {
            (self.happens)();
        }
        self.bytes.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_backup_is_the_corpus_of_one_moment_whatever_others_do_meanwhile() {
    let dir = tempfile::tempdir().expect("a directory");
    let engine = FakeEngine::new(13, Faults::default());
    let (a, b) = (join(&engine, dir.path()), join(&engine, dir.path()));
    let ids: Vec<_> = (0..5).map(|seed| a.add(&small(seed).example(), &[]).expect("added").record().id).collect();
    let mut before = Vec::new();
    a.backup(&mut before).expect("written");
    let happens = || {
        eventually("the other has them", || b.snapshot().examples.len() == 5);
        b.remove(ids[3]).expect("removed");
        b.add(&small(7).example(), &[]).expect("added");
        b.annotate(ids[4], Patch { name: Some("later".into()), ..Patch::default() }).expect("renamed");
        eventually("it is seen", || a.snapshot().examples == b.snapshot().examples);
        assert_eq!(a.collect(Duration::from_secs(3600)).expect("collected"), 0);
    };
    let mut meanwhile = Interrupted { bytes: Vec::new(), pieces: 0, happens: &happens };
    assert_eq!(a.backup(&mut meanwhile).expect("written").examples, 5);
    assert!(meanwhile.bytes == before, "another corpus than that of the moment at which it was begun");
    // It fills another engine.
    let elsewhere = FakeEngine::new(17, Faults::many());
    let c = join(&elsewhere, dir.path());
    assert_eq!(quadmuse_store::read_backup(&*c, &mut &before[..]).expect("read"), 5);
    let mut again = Vec::new();
    join(&elsewhere, dir.path()).backup(&mut again).expect("written");
    assert!(again == before);
}

#[test]
fn a_local_corpus_goes_there_and_back_byte_for_byte() {
    let dir = tempfile::tempdir().expect("a directory");
    let (store, _) = Store::open(&dir.path().join("first"), &crate::sample::options()).expect("a store");
    for seed in 0..5 {
        store.add(&crate::sample::Sample::new(seed).example()).expect("added");
    }
    let mut before = Vec::new();
    store.backup(&mut before).expect("written");
    let engine = FakeEngine::new(9, Faults::many());
    let row_maker: RowMaker = Arc::new(|_, segment, packed| Some(vec![segment as u8, packed.encoder_version as u8]));
    let options = SharedOptions { row_maker: Some(row_maker), ..SharedOptions::caching_in(&dir.path().join("cache")) };
    let shared = SharedCorpus::open(Arc::new(engine.clone()), &options).expect("joined");
    for record in &store.snapshot().examples {
        shared.put_whole(Backend::whole(&store, record.id).expect("whole")).expect("imported");
    }
    let (back, _) = Store::open(&dir.path().join("second"), &crate::sample::options()).expect("a store");
    let other = join(&engine, dir.path());
    for record in &other.snapshot().examples {
        Backend::put_whole(&back, other.whole(record.id).expect("whole")).expect("exported");
    }
    let rows = other.rows();
    assert!(rows.len() == 5 && rows.iter().all(|(_, row)| *row == (0, vec![0, 1])), "rows were made on the way");
    let mut after = Vec::new();
    back.backup(&mut after).expect("written");
    assert!(before == after);
}
