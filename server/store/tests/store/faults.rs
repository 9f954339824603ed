//! A disk that fails: each single change to a file fails in turn, and each is where the process is killed.
//!
//! `support/fault.c` is preloaded into a child of this test; it needs a C compiler, and says so where there is none. Nothing that
//! was acknowledged is lost; what was refused does not come back; a removal succeeds or changes nothing.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Patch, Store, StoreError};

use crate::sample::{Sample, options};

const DIR: &str = "QUADMUSE_FAULT_DIR";
const ORDER: &str = "QUADMUSE_FAULT_ORDER";
const PART: &str = "QUADMUSE_FAULT_PART";
/// The status of a process that was killed in place of a change.
const KILLED: i32 = 137;
/// The status of one that refused to open a store.
const REFUSED: i32 = 3;
/// More changes than any of the parts makes.
const CHANGES_MAX: usize = 2000;
/// How long a store may take to write again by itself.
const RESUME: Duration = Duration::from_secs(10);

/// The layer, compiled; `None` where that can't be done.
fn layer(dir: &Path) -> Option<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/fault.c");
    let made = dir.join("fault.so");
    let status = Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).arg(&made).arg(source).arg("-ldl").status();
    let is_made = status.is_ok_and(|status| status.success());
    if !is_made {
        println!("passed over: no C compiler");
    }
    is_made.then_some(made)
}

/// Runs a part of this file in a process of its own, on a disk that fails as it is ordered.
fn child(layer: &Path, dir: &Path, part: &str, order: Option<&str>) -> ExitStatus {
    let file = layer.with_extension("order");
    let _ = fs::remove_file(&file);
    if let Some(order) = order {
        fs::write(&file, order).unwrap();
    }
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "faults::in_a_child", "--nocapture"]).env("LD_PRELOAD", layer);
    command.env(DIR, dir).env(ORDER, file).env(PART, part).status().unwrap()
}

/// What the children do: only when a test below starts them.
#[test]
fn in_a_child() {
    let (Ok(dir), Ok(part), Ok(order)) = (std::env::var(DIR), std::env::var(PART), std::env::var(ORDER)) else {
        return;
    };
    let (dir, order) = (Path::new(&dir), Path::new(&order));
    match part.as_str() {
        "open" => {
            if let Err(error) = Store::open(dir, &options()) {
                println!("refused: {error}");
                std::process::exit(REFUSED);
            }
        }
        "open_full" => {
            if let Err(error) = Store::open(dir, &options()) {
                println!("refused: {error}");
                assert!(error.is_full(), "a full disk is told as one: {error:?}");
                assert!(error.to_string().contains(&dir.display().to_string()), "the folder is named: {error}");
                std::process::exit(REFUSED);
            }
        }
        "each" => each_change_fails_in_turn(dir, order),
        "all" => all_changes_fail_for_a_while(dir, order),
        other => panic!("no part {other}"),
    }
}

/// What is known of one example after some changes.
#[derive(Default)]
struct Known {
    id: Option<ExampleId>,
    /// Names it may have; empty where it may not be there.
    names: Vec<String>,
}

fn check(store: &Store, known: &[Known], when: &str) {
    let there = store.snapshot().examples.iter().map(|record| (record.id, record.name.clone())).collect::<Vec<_>>();
    for (seed, one) in known.iter().enumerate() {
        let found = there.iter().find(|(id, _)| Some(*id) == one.id);
        match found {
            Some((id, name)) => {
                assert!(one.names.contains(name), "{when}: example {seed} is named {name}, not one of {:?}", one.names);
                assert_eq!(store.mesh_bytes(*id).unwrap(), Sample::new(seed as u64).mesh, "{when}");
            }
            None => assert!(one.names.is_empty(), "{when}: example {seed} is lost"),
        }
    }
    let wanted = known.iter().filter(|one| !one.names.is_empty()).count();
    assert_eq!(there.len(), wanted, "{when}: {there:?}");
}

/// Adds, annotates and removes while one change to a file fails; the n-th, for every n.
fn each_change_fails_in_turn(dir: &Path, order: &Path) {
    let mut met = 0;
    for number in 1..CHANGES_MAX {
        let root = dir.join(number.to_string());
        let (store, _) = Store::open(&root, &options()).unwrap();
        let mut known: Vec<Known> = (0..3).map(|_| Known::default()).collect();
        for (seed, one) in known.iter_mut().take(2).enumerate() {
            let added = store.add(&Sample::new(seed as u64).example()).unwrap();
            (one.id, one.names) = (Some(added.record().id), vec![format!("sample {seed}")]);
        }
        fs::write(order, format!("eio {number}")).unwrap();
        let note = |result: Result<(), StoreError>| {
            let error = result.err();
            assert!(!error.as_ref().is_some_and(StoreError::is_full), "a disk that fails is no full disk: {error:?}");
            error.is_none()
        };
        let patch = Patch { name: Some("named".into()), ..Patch::default() };
        let first = known[0].id.unwrap();
        if note(store.annotate(first, patch).map(drop)) {
            known[0].names = vec!["named".into()];
        }
        let added = store.add(&Sample::new(2).example()).map(|added| added.record().id);
        if let Ok(id) = added {
            (known[2].id, known[2].names) = (Some(id), vec!["sample 2".into()]);
        }
        note(added.map(drop));
        let second = known[1].id.unwrap();
        if note(store.remove(second)) {
            known[1].names.clear();
        }
        let when = format!("change {number} failed");
        check(&store, &known, &when);
        drop(store);
        let was_met = fs::remove_file(order).is_err();
        // What an opening finds is what was answered.
        let (store, report) = Store::open(&root, &options()).unwrap();
        assert!(report.quarantined.is_empty(), "{when}: {report:?}");
        check(&store, &known, &format!("{when}, opened again"));
        drop(store);
        fs::remove_dir_all(&root).unwrap();
        if !was_met {
            break;
        }
        met = number;
    }
    println!("each of {met} changes failed in turn");
    assert!(met > 10, "only {met} changes were met");
}

/// Every change fails for a while: reads go on, nothing is lost, and writing resumes by itself.
fn all_changes_fail_for_a_while(dir: &Path, order: &Path) {
    let root = dir.join("all");
    let (store, _) = Store::open(&root, &options()).unwrap();
    let mut known: Vec<Known> = (0..4).map(|_| Known::default()).collect();
    for (seed, one) in known.iter_mut().take(3).enumerate() {
        let id = store.add(&Sample::new(seed as u64).example()).unwrap().record().id;
        (one.id, one.names) = (Some(id), vec![format!("sample {seed}")]);
    }
    fs::write(order, "eio 0").unwrap();
    for _ in 0..3 {
        let refused = store.add(&Sample::new(3).example()).expect_err("nothing can be written");
        assert!(!refused.is_full(), "{refused}");
    }
    if store.remove(known[0].id.unwrap()).is_ok() {
        known[0].names.clear();
    }
    check(&store, &known, "while the disk fails");
    fs::remove_file(order).unwrap();
    let begun = Instant::now();
    let id = loop {
        match store.add(&Sample::new(3).example()) {
            Ok(added) => break added.record().id,
            Err(error) => assert!(begun.elapsed() < RESUME, "still refused after {RESUME:?}: {error}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    (known[3].id, known[3].names) = (Some(id), vec!["sample 3".into()]);
    check(&store, &known, "after the disk came back");
    drop(store);
    let (store, _) = Store::open(&root, &options()).unwrap();
    check(&store, &known, "opened again");
}

#[test]
fn what_a_failing_disk_refused_does_not_come_back_and_what_it_took_stays() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let Some(layer) = layer(dir.path()) else { return };
    for part in ["each", "all"] {
        let below = dir.path().join(part);
        fs::create_dir(&below).unwrap();
        assert!(child(&layer, &below, part, None).success(), "part {part}: see above");
    }
}

#[test]
fn an_upgrade_killed_at_any_change_is_finished_by_the_next_start() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let Some(layer) = layer(dir.path()) else { return };
    for schema in crate::stored::schemas() {
        let mut killed = 0;
        for number in 1..CHANGES_MAX {
            let root = dir.path().join(format!("{schema}-{number}"));
            crate::stored::unpack(schema, &root);
            let status = child(&layer, &root, "open", Some(&format!("kill {number}")));
            assert!(status.success() || status.code() == Some(KILLED), "schema {schema}, change {number}: {status}");
            let (store, report) = Store::open(&root, &options()).unwrap();
            let when = format!("schema {schema}, killed at change {number}");
            assert!(report.index_rebuilt.is_none() && report.quarantined.is_empty(), "{when}: {report:?}");
            assert_eq!(store.check(&mut |_| ()).unwrap().problems, [], "{when}");
            let written = if schema < 3 { 2 } else { 3 };
            assert_eq!((report.examples, report.missing_derived.len()), (written, 0), "{when}");
            drop(store);
            fs::remove_dir_all(&root).unwrap();
            if status.success() {
                break;
            }
            killed += 1;
        }
        println!("schema {schema}: killed at each of {killed} changes");
        assert!(killed > 0, "schema {schema}");
    }
}

#[test]
fn a_store_opens_on_a_disk_that_takes_nothing_or_says_why_not() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let Some(layer) = layer(dir.path()) else { return };
    for number in 1..12 {
        let root = dir.path().join(number.to_string());
        crate::stored::unpack(1, &root);
        // Whatever an opening meets, it ends in order, and the next one finds everything.
        let status = child(&layer, &root, "open", Some(&format!("eio {number}")));
        assert!(status.success() || status.code() == Some(REFUSED), "change {number}: {status}");
        let (_, report) = Store::open(&root, &options()).unwrap();
        assert_eq!((report.examples, report.quarantined.len()), (2, 0), "change {number}: {report:?}");
    }
}

/// A store of three examples as a stopped process leaves it: the next opening has things to write.
fn stopped(root: &Path) {
    let (store, _) = Store::open(root, &options()).unwrap();
    for seed in 0..3 {
        store.add(&Sample::new(seed).example()).unwrap();
    }
}

#[test]
fn a_start_on_a_full_disk_is_refused_in_words_and_loses_nothing() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let Some(layer) = layer(dir.path()) else { return };
    for (what, examples) in [("stopped", 3), ("new", 0)] {
        let mut refused = 0;
        for number in 1..CHANGES_MAX {
            let root = dir.path().join(format!("{what}-{number}"));
            if examples > 0 {
                stopped(&root);
            }
            let status = child(&layer, &root, "open_full", Some(&format!("full {number}")));
            let when = format!("a {what} store, full from change {number} on");
            assert!(status.success() || status.code() == Some(REFUSED), "{when}: {status}");
            refused += usize::from(!status.success());
            let (store, report) = Store::open(&root, &options()).unwrap();
            assert_eq!((report.examples, report.quarantined.len()), (examples, 0), "{when}: {report:?}");
            assert!(report.index_rebuilt.is_none() && report.missing_derived.is_empty(), "{when}: {report:?}");
            assert_eq!(store.check(&mut |_| ()).unwrap().problems, [], "{when}");
            drop(store);
            fs::remove_dir_all(&root).unwrap();
            if status.success() {
                break;
            }
        }
        println!("{what}: refused at each of {refused} changes");
        assert!(refused > 0, "{what}: an opening met no full disk");
    }
}
