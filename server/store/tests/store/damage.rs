//! Damaged bytes in any file of a store: never a panic out of opening, never wrong bytes, the rest served, encodings rebuilt.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Added, DerivedSegment, OpenOptions, Store, StoreError};

use crate::sample::{Sample, options, random, segment_of};

/// Examples of the store; more of them fill several segments of the database.
const EXAMPLES: &str = "QUADMUSE_DAMAGE_EXAMPLES";
const FLIPS: &str = "QUADMUSE_DAMAGE_FLIPS";
/// How long a store may take to write again by itself.
const RESUME: Duration = Duration::from_secs(10);

/// What each example must read as.
type Truth = BTreeMap<ExampleId, (Sample, DerivedSegment)>;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|number| number.parse().ok()).unwrap_or(default)
}

/// A store with some history: restarts, a removal, an encoding written twice.
fn build(dir: &Path) -> Truth {
    let mut truth = Truth::new();
    let examples = number(EXAMPLES, 12);
    for seeds in [0..examples / 2, examples / 2..examples] {
        let (store, _) = Store::open(dir, &options()).unwrap();
        let extra = store.add(&Sample::new(10_000 + seeds.start).example()).unwrap().record().id;
        add(&store, seeds, &mut truth);
        store.remove(extra).unwrap();
    }
    truth
}

fn add(store: &Store, seeds: std::ops::Range<u64>, truth: &mut Truth) {
    for seed in seeds {
        let sample =
            if seed < 12 { Sample::new(seed) } else { Sample::with(seed, vec![segment_of(seed, &[32, 512], 3000)]) };
        let id = store.add(&sample.example()).unwrap().record().id;
        if seed % 5 == 0 {
            store.put_derived(id, 0, 1, &sample.derived[0]).unwrap();
        }
        truth.insert(id, (sample, store.derived(id, 0).unwrap()));
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, out);
        } else {
            out.push(path);
        }
    }
    out.sort();
}

/// The part of a file that holds something: flips among the zeros behind it would test nothing.
fn content(path: &Path) -> u64 {
    let bytes = fs::read(path).unwrap();
    bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last as u64 + 1)
}

#[derive(Default, Debug)]
struct Seen {
    flips: usize,
    index_rebuilt: usize,
    records_restored: usize,
    quarantined: usize,
    encodings_rebuilt: usize,
    /// Openings after which the database itself met the damage, and the store copied what was left of it.
    suspended: usize,
}

/// Writes an encoding anew, waiting while the store mends itself.
fn put_again(store: &Store, id: ExampleId, derived: &DerivedSegment) {
    let begun = Instant::now();
    loop {
        match store.put_derived(id, 0, 1, derived) {
            Ok(()) => return,
            Err(StoreError::ReadOnly { .. } | StoreError::Busy) if begun.elapsed() < RESUME => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(error) => panic!("the encoding can't be written anew: {error}"),
        }
    }
}

/// Opens a damaged store, checks what it serves, and does what a server would do to mend it.
fn mend(dir: &Path, truth: &Truth, seen: &mut Seen, what: &str) {
    let (store, report) = Store::open(dir, &options()).unwrap_or_else(|error| panic!("{what}: {error}"));
    seen.flips += 1;
    seen.index_rebuilt += usize::from(report.index_rebuilt.is_some());
    seen.records_restored += report.records_restored;
    let mut suspended = false;
    for (&id, (sample, derived)) in truth {
        match store.mesh_bytes(id) {
            Ok(mesh) => assert_eq!(mesh, sample.mesh, "{what}: wrong bytes"),
            Err(StoreError::Quarantined { .. }) => {
                seen.quarantined += 1;
                assert!(store.quarantined().iter().any(|(named, _)| *named == id));
                let Added::Exists(healed) = store.add(&sample.example()).unwrap() else {
                    panic!("{what}: it was known")
                };
                assert_eq!(healed.id, id);
                assert_eq!(store.mesh_bytes(id).unwrap(), sample.mesh);
            }
            Err(error) => panic!("{what}: {id}: {error}"),
        }
        assert_eq!(store.get(id).unwrap().name, sample.name);
        match store.derived(id, 0) {
            Ok(found) => assert_eq!(&found, derived, "{what}: wrong encoding"),
            Err(StoreError::MissingDerived { .. } | StoreError::DamagedDerived { .. }) => {
                suspended |= store.suspended().is_some();
                seen.encodings_rebuilt += 1;
                put_again(&store, id, &sample.derived[0]);
                assert_eq!(&store.derived(id, 0).unwrap(), derived, "{what}");
            }
            Err(error) => panic!("{what}: {id}: {error}"),
        }
    }
    seen.suspended += usize::from(suspended);
}

/// A mended store is whole after the next opening, or mends itself again.
fn check_mended(dir: &Path, truth: &Truth, what: &str) {
    let (store, report) = Store::open(dir, &options()).unwrap();
    assert!(report.quarantined.is_empty() && report.missing_derived.is_empty(), "{what}: {report:?}");
    for (&id, (sample, derived)) in truth {
        assert_eq!(store.mesh_bytes(id).unwrap(), sample.mesh, "{what}");
        assert_eq!(&store.derived(id, 0).unwrap(), derived, "{what}");
    }
}

#[test]
fn flipped_bytes_anywhere_are_noticed_and_mended() {
    let whole = tempfile::tempdir().unwrap();
    let truth = build(whole.path());
    let mut names = Vec::new();
    files(whole.path(), &mut names);
    let mut seen = Seen::default();
    for flip in 0..number(FLIPS, 40) {
        // Half of the flips in the database, the other half spread over the rest.
        let database = names.iter().position(|name| name.ends_with("index/db")).unwrap();
        let pick = if flip % 2 == 0 { database } else { (random(flip, 1) * names.len() as f64) as usize };
        let name = names[pick].strip_prefix(whole.path()).unwrap();
        let length = content(&names[pick]);
        if length == 0 {
            continue;
        }
        let damaged = tempfile::tempdir().unwrap();
        copy(whole.path(), damaged.path());
        let at = (random(flip, 2) * length as f64) as u64;
        let file = fs::OpenOptions::new().read(true).write(true).open(damaged.path().join(name)).unwrap();
        let count = 1 + flip as usize % 4;
        let mut bytes = vec![0; count];
        let found = file.read_at(&mut bytes, at).unwrap();
        bytes.truncate(found);
        bytes.iter_mut().for_each(|byte| *byte ^= 0x5a);
        file.write_all_at(&bytes, at).unwrap();
        drop(file);
        let what = format!("flip {flip}: {count} bytes at {at} of {}", name.display());
        mend(damaged.path(), &truth, &mut seen, &what);
        check_mended(damaged.path(), &truth, &what);
    }
    println!("{seen:?}");
    assert!(seen.quarantined > 0 && seen.encodings_rebuilt > 0, "the flips hit nothing: {seen:?}");
}

#[test]
fn a_truncated_or_lost_index_is_built_anew() {
    let whole = tempfile::tempdir().unwrap();
    let truth = build(whole.path());
    let length = content(&whole.path().join("index/db"));
    let mut seen = Seen::default();
    for keep in [0, 1, 100, length / 2, length - 1] {
        let damaged = tempfile::tempdir().unwrap();
        copy(whole.path(), damaged.path());
        fs::OpenOptions::new().write(true).open(damaged.path().join("index/db")).unwrap().set_len(keep).unwrap();
        let what = format!("index cut at {keep}");
        mend(damaged.path(), &truth, &mut seen, &what);
        check_mended(damaged.path(), &truth, &what);
    }
    fs::remove_dir_all(whole.path().join("index")).unwrap();
    mend(whole.path(), &truth, &mut seen, "no index");
    check_mended(whole.path(), &truth, "no index");
    println!("{seen:?}");
    assert!(seen.records_restored >= truth.len());
}

#[test]
fn a_lost_ground_file_is_written_anew_from_the_index() {
    let dir = tempfile::tempdir().unwrap();
    let truth = build(dir.path());
    for entry in fs::read_dir(dir.path().join("ground")).unwrap() {
        fs::remove_file(entry.unwrap().path()).unwrap();
    }
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.ground_restored, report.examples), (truth.len(), truth.len()));
    drop(store);
    check_mended(dir.path(), &truth, "ground files lost");
}

#[test]
fn an_example_without_its_mesh_is_quarantined_and_can_be_removed() {
    let dir = tempfile::tempdir().unwrap();
    let truth = build(dir.path());
    let (&id, (sample, _)) = truth.iter().next().unwrap();
    let hash = quadmuse_store::ContentHash::of(&sample.mesh);
    fs::remove_file(dir.path().join("objects").join(hash.to_string())).unwrap();
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!((report.examples, report.quarantined.len()), (truth.len() - 1, 1));
    assert!(matches!(store.get(id), Err(StoreError::Quarantined { .. })));
    assert!(store.snapshot().examples.iter().all(|record| record.id != id));
    store.remove(id).unwrap();
    assert!(matches!(store.get(id), Err(StoreError::NotFound { .. })));
    assert!(store.quarantined().is_empty());
}

#[test]
fn damage_under_an_open_store_is_met_by_a_copy_of_what_is_left() {
    let dir = tempfile::tempdir().unwrap();
    let small_cache = OpenOptions { cache_bytes: 1 << 20, ..options() };
    let (store, _) = Store::open(dir.path(), &small_cache).unwrap();
    let mut truth = Truth::new();
    for seed in 0..100 {
        let sample = Sample::with(seed, vec![segment_of(seed, &[32, 512], 6000)]);
        let id = store.add(&sample.example()).unwrap().record().id;
        truth.insert(id, (sample, store.derived(id, 0).unwrap()));
    }
    let path = dir.path().join("index/db");
    let file = fs::OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let length = content(&path);
    let mut seen = Seen::default();
    // What the index still holds in memory hides damage on the disk; a few places more, and some of it is met.
    for first in (0..8).map(|k| length / 8 + (k << 17)) {
        for at in (first..length / 2).step_by(1 << 20) {
            let mut bytes = [0; 16];
            file.read_exact_at(&mut bytes, at).unwrap();
            file.write_all_at(&bytes.map(|byte| byte ^ 0x33), at).unwrap();
        }
        read_all(&store, &truth, &mut seen);
        if seen.encodings_rebuilt > 0 {
            break;
        }
    }
    println!("{seen:?}");
    assert!(seen.encodings_rebuilt > 0 && seen.suspended > 0, "the damage was not met: {seen:?}");
    let begun = Instant::now();
    while store.suspended().is_some() {
        assert!(begun.elapsed() < RESUME, "still suspended: {:?}", store.suspended());
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut again = Seen::default();
    read_all(&store, &truth, &mut again);
    assert_eq!(again.encodings_rebuilt, 0);
    drop(store);
    check_mended(dir.path(), &truth, "damaged while open");
}

/// Reads every encoding; one that is damaged is written anew.
fn read_all(store: &Store, truth: &Truth, seen: &mut Seen) {
    for (&id, (sample, derived)) in truth {
        match store.derived(id, 0) {
            Ok(found) => assert_eq!(&found, derived, "wrong encoding"),
            Err(StoreError::MissingDerived { .. } | StoreError::DamagedDerived { .. }) => {
                seen.encodings_rebuilt += 1;
                seen.suspended += usize::from(store.suspended().is_some());
                put_again(store, id, &sample.derived[0]);
                assert_eq!(&store.derived(id, 0).unwrap(), derived);
            }
            Err(error) => panic!("{id}: {error}"),
        }
    }
}
