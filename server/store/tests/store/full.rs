//! A disk that is really full, under the database's feet: writes are refused, reads go on, removals work, nothing acknowledged is lost,
//! and writing resumes by itself. Needs a small file system of its own: where mounting one isn't allowed, it says so and is passed over.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{OpenOptions, Store, StoreError};

use crate::sample::{Sample, options};

const DIR: &str = "QUADMUSE_FULL_TEST_DIR";
/// How often is asked whether a store writes again by itself: so long on a busy machine that it never will.
const ASKED: usize = 12_000;

#[test]
fn a_full_disk_is_survived() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let script = r#"mount -t tmpfs -o size=96m none "$1" || exit 77; exec "$0" --exact full::child --nocapture"#;
    let exe = std::env::current_exe().unwrap();
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user", "sh", "-c", script]).arg(exe).arg(dir.path()).env(DIR, dir.path());
    match command.output() {
        Ok(output) if output.status.success() => print!("{}", String::from_utf8_lossy(&output.stdout)),
        Ok(output) if output.status.code() == Some(101) => {
            panic!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
        }
        _ => println!("passed over: no file system may be mounted here"),
    }
}

/// Eats all free space.
fn fill(dir: &Path) {
    use std::io::Write;
    let mut file = fs::OpenOptions::new().create(true).append(true).open(dir.join("filler")).unwrap();
    let mut piece = 1 << 20;
    while piece > 0 {
        if file.write_all(&vec![1; piece]).is_err() {
            piece /= 2;
        }
    }
}

/// Runs in a mount namespace of its own: only when the test above starts it.
#[test]
fn child() {
    let Ok(dir) = std::env::var(DIR) else { return };
    let dir = Path::new(&dir);
    // Once the space check keeps the disk from filling up, once it is blind and the database itself meets the full disk.
    for (number, blind) in (0u64..).zip([None, Some(u64::MAX / 2)]) {
        let root = dir.join(number.to_string());
        let mut options = OpenOptions { reserve_bytes: 8 << 20, ..options() };
        if let Some(free) = blind {
            let real = options.free_space.clone();
            // Blind is only the check before a write, on the caller's thread. The store's own thread, which looks once a second
            // whether it can resume, has to see the truth: else it resumes on the full disk, if the test takes that long.
            let (path, caller) = (root.join("objects"), std::thread::current().id());
            options.free_space = Arc::new(move |asked| {
                let is_lied_to = path.join("../lie").exists() && std::thread::current().id() == caller;
                if is_lied_to { Ok(free) } else { real(asked) }
            });
        }
        survive(dir, &root, &options, blind.is_some());
        fs::remove_dir_all(&root).unwrap();
    }
    start_full(dir, &dir.join("start"));
}

/// What a start needs is kept for it, whoever fills the disk while the store is closed.
fn start_full(disk: &Path, root: &Path) {
    let options = OpenOptions { reserve_bytes: 8 << 20, spare_bytes: 40 << 20, ..options() };
    let mut kept: Vec<(u64, ExampleId)> = Vec::new();
    {
        let (store, _) = Store::open(root, &options).unwrap();
        for seed in 0..6 {
            kept.push((seed, store.add(&Sample::new(seed).example()).unwrap().record().id));
        }
    }
    fill(disk);
    let (store, report) = Store::open(root, &options).unwrap();
    assert_eq!((report.examples, report.quarantined.len(), report.missing_derived.len()), (6, 0, 0), "{report:?}");
    assert!(report.index_rebuilt.is_none(), "{report:?}");
    assert!(store.unwritable().is_some());
    // Whoever filled the disk takes what was given for the start, too.
    fill(disk);
    check(&store, &kept);
    let refused = store.add(&Sample::new(50).example()).unwrap_err();
    assert!(matches!(refused, StoreError::Full { .. }), "{refused}");
    let (_, removed) = kept.remove(2);
    store.remove(removed).unwrap();
    check(&store, &kept);
    fs::remove_file(disk.join("filler")).unwrap();
    kept.push((50, added_again(&store, 50)));
    drop(store);
    // The room is kept for the next such start.
    fill(disk);
    let (store, report) = Store::open(root, &options).unwrap();
    assert_eq!((report.examples, report.missing_derived.len()), (kept.len(), 0), "{report:?}");
    assert!(matches!(store.get(removed), Err(StoreError::NotFound { .. })));
    check(&store, &kept);
}

/// Adds an example as soon as the store writes again.
fn added_again(store: &Store, seed: u64) -> ExampleId {
    let begun = Instant::now();
    let mut last = String::new();
    for _ in 0..ASKED {
        match store.add(&Sample::new(seed).example()) {
            Ok(added) => {
                println!("writes again after {} ms", begun.elapsed().as_millis());
                return added.record().id;
            }
            Err(error) => last = error.to_string(),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("still refused after {ASKED} attempts: {last}")
}

fn survive(disk: &Path, root: &Path, options: &OpenOptions, blind: bool) {
    let (store, _) = Store::open(root, options).unwrap();
    let mut kept: Vec<(u64, ExampleId)> = Vec::new();
    for seed in 0..20 {
        kept.push((seed, store.add(&Sample::new(seed).example()).unwrap().record().id));
    }
    if blind {
        fs::write(root.join("lie"), "").unwrap();
    }
    fill(disk);
    let mut refused = 0;
    for seed in 20..200 {
        match store.add(&Sample::new(seed).example()) {
            Ok(added) => kept.push((seed, added.record().id)),
            Err(StoreError::Full { .. } | StoreError::ReadOnly { .. }) => refused += 1,
            Err(error) => panic!("{error}"),
        }
        if refused > 3 {
            break;
        }
    }
    // The database may have room left in its file: grow it through encodings, which need no other file.
    for round in 0..2000 {
        if !blind || store.suspended().is_some() {
            break;
        }
        let (seed, id) = kept[round % kept.len()];
        let _ = store.put_derived(id, 0, 1, &crate::sample::segment_of(seed, &[32, 64, 128], 700));
    }
    println!("blind {blind}: {} kept, {refused} refused, suspended: {:?}", kept.len(), store.suspended());
    assert!(refused > 0);
    assert_eq!(store.suspended().is_some(), blind);
    check(&store, &kept);
    // Removals work on a full disk.
    for _ in 0..5 {
        let (_, id) = kept.remove(3);
        store.remove(id).unwrap();
        assert!(matches!(store.get(id), Err(StoreError::NotFound { .. })));
        fill(disk);
    }
    check(&store, &kept);
    // Space returns, and writing with it.
    fs::remove_file(disk.join("filler")).unwrap();
    let _ = fs::remove_file(root.join("lie"));
    kept.push((1000, added_again(&store, 1000)));
    check(&store, &kept);
    drop(store);
    let (store, report) = Store::open(root, options).unwrap();
    assert_eq!(
        (report.examples, report.quarantined.len(), report.missing_derived.len()),
        (kept.len(), 0, 0),
        "{report:?}"
    );
    check(&store, &kept);
}

fn check(store: &Store, kept: &[(u64, ExampleId)]) {
    for &(seed, id) in kept {
        assert_eq!(store.mesh_bytes(id).unwrap(), Sample::new(seed).mesh);
        assert_eq!(store.derived(id, 0).unwrap().chart, Sample::new(seed).derived[0].chart);
    }
}
