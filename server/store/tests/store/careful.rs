//! What is not known to be garbage is kept, what is half is not served, and looking changes nothing.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Store, StoreError};

use crate::sample::{Sample, options, segment};

fn add(store: &Store, seed: u64) -> ExampleId {
    store.add(&Sample::with(seed, vec![segment(seed)]).example()).unwrap().record().id
}

/// Every file below a directory with its bytes.
fn tree(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            let name = entry.file_name().to_string_lossy().into_owned();
            all.extend(tree(&path).into_iter().map(|(below, bytes)| (format!("{name}/{below}"), bytes)));
        } else {
            all.insert(entry.file_name().to_string_lossy().into_owned(), fs::read(&path).unwrap());
        }
    }
    all
}

fn objects(dir: &Path) -> usize {
    fs::read_dir(dir.join("objects")).unwrap().count()
}

fn filled(dir: &Path, count: u64) {
    let (store, _) = Store::open(dir, &options()).unwrap();
    (0..count).for_each(|n| _ = add(&store, n));
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() { copy(&path, &to) } else { _ = fs::copy(&path, &to).unwrap() }
    }
}

#[test]
fn meshes_whose_records_are_missing_are_not_collected() {
    let whole = tempfile::tempdir().unwrap();
    filled(whole.path(), 6);
    // A restore of files that has brought the meshes so far.
    let part = tempfile::tempdir().unwrap();
    copy(&whole.path().join("objects"), &part.path().join("objects"));
    assert!(Store::open(part.path(), &options()).is_err(), "without its schema it is not opened");
    assert_eq!(objects(part.path()), 6);
    fs::copy(whole.path().join("schema"), part.path().join("schema")).unwrap();
    for _ in 0..3 {
        let (store, _) = Store::open(part.path(), &options()).unwrap();
        assert_eq!(objects(part.path()), 6);
        drop(store);
    }
    let (store, _) = Store::open(part.path(), &options()).unwrap();
    add(&store, 77);
    drop(store);
    drop(Store::open(part.path(), &options()).unwrap());
    assert_eq!(objects(part.path()), 7);
    // The rest of the files comes.
    fs::remove_dir_all(part.path().join("index")).unwrap();
    copy(&whole.path().join("ground"), &part.path().join("ground"));
    let (store, _) = Store::open(part.path(), &options()).unwrap();
    assert_eq!(store.snapshot().examples.len(), 7);
}

#[test]
fn records_whose_meshes_are_still_to_come_are_not_dropped() {
    let whole = tempfile::tempdir().unwrap();
    filled(whole.path(), 4);
    let part = tempfile::tempdir().unwrap();
    fs::copy(whole.path().join("schema"), part.path().join("schema")).unwrap();
    copy(&whole.path().join("ground"), &part.path().join("ground"));
    let first = fs::read_dir(whole.path().join("objects")).unwrap().flatten().next().unwrap();
    fs::create_dir(part.path().join("objects")).unwrap();
    fs::copy(first.path(), part.path().join("objects").join(first.file_name())).unwrap();
    let (store, _) = Store::open(part.path(), &options()).unwrap();
    assert_eq!((store.snapshot().examples.len(), store.quarantined().len()), (1, 3));
    drop(store);
    copy(&whole.path().join("objects"), &part.path().join("objects"));
    let (store, _) = Store::open(part.path(), &options()).unwrap();
    assert_eq!((store.snapshot().examples.len(), store.quarantined().len()), (4, 0));
}

#[test]
fn half_a_restore_is_not_served_and_begins_anew() {
    let whole = tempfile::tempdir().unwrap();
    let mut backup = Vec::new();
    {
        let (store, _) = Store::open(whole.path(), &options()).unwrap();
        (0..5).for_each(|n| _ = add(&store, n));
        store.backup(&mut backup).unwrap();
    }
    for cut in [backup.len() / 4, backup.len() / 2, backup.len() - 1] {
        let to = tempfile::tempdir().unwrap();
        assert!(Store::restore(to.path(), &options(), &mut &backup[..cut]).is_err());
        assert!(matches!(Store::open(to.path(), &options()), Err(StoreError::HalfRestored { .. })), "{cut}");
        let (store, _) = Store::restore(to.path(), &options(), &mut &backup[..]).unwrap();
        assert_eq!(store.snapshot().examples.len(), 5);
        drop(store);
        assert_eq!(Store::open(to.path(), &options()).unwrap().1.examples, 5);
    }
}

#[test]
fn what_is_damaged_stays_set_aside_over_restarts_until_it_is_healed() {
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let id = add(&store, 1);
    let object = fs::read_dir(dir.path().join("objects")).unwrap().flatten().next().unwrap().path();
    let intact = fs::read(&object).unwrap();
    let mut bytes = intact.clone();
    bytes[0] ^= 1;
    fs::write(&object, &bytes).unwrap();
    assert!(matches!(store.mesh_bytes(id), Err(StoreError::Quarantined { .. })));
    drop(store);
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert_eq!(report.quarantined.len(), 1);
    assert!(matches!(store.get(id), Err(StoreError::Quarantined { .. })));
    drop(store);
    fs::write(&object, &intact).unwrap();
    let (store, report) = Store::open(dir.path(), &options()).unwrap();
    assert!(report.quarantined.is_empty() && store.get(id).is_ok());
}

#[test]
fn a_check_of_a_directory_changes_no_byte_of_it() {
    let (dir, scratch) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    filled(dir.path(), 4);
    let clean = Store::check_dir(dir.path(), scratch.path(), &mut |_| ()).unwrap();
    assert_eq!((clean.examples, &clean.problems[..]), (4, &[][..]));
    // Damage of each kind, and garbage that an opening would collect.
    let objects: Vec<_> = fs::read_dir(dir.path().join("objects")).unwrap().flatten().map(|e| e.path()).collect();
    let mut bytes = fs::read(&objects[0]).unwrap();
    bytes[0] ^= 1;
    fs::write(&objects[0], bytes).unwrap();
    let ground = fs::read_dir(dir.path().join("ground")).unwrap().flatten().last().unwrap().path();
    fs::remove_file(&ground).unwrap();
    fs::write(dir.path().join("objects").join("tmp-left"), b"left").unwrap();
    fs::write(dir.path().join("objects").join("0".repeat(64)), b"unknown").unwrap();
    let before = tree(dir.path());
    let found = Store::check_dir(dir.path(), scratch.path(), &mut |_| ()).unwrap();
    assert!(!found.problems.is_empty());
    assert_eq!(tree(dir.path()), before);
    assert_eq!(fs::read_dir(scratch.path()).unwrap().count(), 0, "the copy is removed");
    let (_store, _) = Store::open(dir.path(), &options()).unwrap();
    let locked = Store::check_dir(dir.path(), scratch.path(), &mut |_| ());
    assert!(matches!(locked, Err(StoreError::Locked { .. })));
}
