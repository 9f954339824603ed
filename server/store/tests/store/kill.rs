//! kill -9 at random times under four writers: nothing acknowledged is lost, nothing half-written is seen, no opening refused.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Filter, OpenOptions, Patch, Store, StoreError};

use crate::sample::{Sample, options, random, segment_of};

const DIR: &str = "QUADMUSE_KILL_TEST_DIR";
const ROUND: &str = "QUADMUSE_KILL_TEST_ROUND";
const ROUNDS: &str = "QUADMUSE_KILL_ROUNDS";
const WRITERS: u64 = 4;

fn example(seed: u64) -> Sample {
    Sample::with(seed, vec![segment_of(seed, &[32, 64], 300), segment_of(seed + 1, &[32], 50)])
}

fn say(line: String) {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").unwrap();
    out.flush().unwrap();
}

/// What the killed process does: only when the test below starts it.
#[test]
fn child() {
    let (Ok(dir), Ok(round)) = (std::env::var(DIR), std::env::var(ROUND)) else { return };
    let round: u64 = round.parse().unwrap();
    let (store, _) = Store::open(Path::new(&dir), &options()).unwrap();
    say("@ready".into());
    std::thread::scope(|scope| {
        for writer in 0..WRITERS {
            let store = &store;
            scope.spawn(move || write(store, (round * WRITERS + writer) * 100_000));
        }
    });
}

fn write(store: &Store, base: u64) {
    let mut mine: Vec<ExampleId> = Vec::new();
    for i in 0..100_000 {
        let seed = base + i;
        say(format!("@adding {seed}"));
        let id = store.add(&example(seed).example()).unwrap().record().id;
        say(format!("@added {seed} {id}"));
        mine.push(id);
        let pick = (random(seed, 1) * mine.len() as f64) as usize;
        match i % 4 {
            1 => {
                let id = mine[pick];
                say(format!("@naming {id} name-{seed}"));
                store.annotate(id, Patch { name: Some(format!("name-{seed}")), ..Patch::default() }).unwrap();
                say(format!("@named {id} name-{seed}"));
            }
            2 => {
                let id = mine.swap_remove(pick);
                say(format!("@removing {id}"));
                store.remove(id).unwrap();
                say(format!("@removed {id}"));
            }
            3 => store.put_derived(mine[pick], 1, 2, &segment_of(seed, &[32], 50)).unwrap(),
            _ => {}
        }
    }
}

/// What the parent knows of an example.
#[derive(Default)]
struct Known {
    seed: u64,
    names: Vec<String>,
    removing: bool,
    removed: bool,
}

/// Starts a writer, kills it after some time, and notes what it acknowledged.
fn round(dir: &Path, round: u64, known: &mut HashMap<ExampleId, Known>) -> usize {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "kill::child", "--nocapture", "--test-threads=1"])
        .env(DIR, dir)
        .env(ROUND, round.to_string())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let out = BufReader::new(child.stdout.take().unwrap());
    let after = Duration::from_millis((random(round, 4) * 700.0) as u64);
    let lines = std::thread::spawn(move || out.lines().map_while(Result::ok).collect::<Vec<_>>());
    std::thread::sleep(after);
    child.kill().unwrap();
    child.wait().unwrap();
    let mut acknowledged = 0;
    for line in lines.join().unwrap() {
        let Some((_, line)) = line.split_once('@') else { continue };
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["added", seed, id] => {
                let seed = seed.parse().unwrap();
                let names = vec![format!("sample {seed}")];
                known.insert(id.parse().unwrap(), Known { seed, names, ..Known::default() });
                acknowledged += 1;
            }
            ["naming", id, name] => known.get_mut(&id.parse().unwrap()).unwrap().names.push(name.into()),
            ["named", id, name] => {
                known.get_mut(&id.parse().unwrap()).unwrap().names = vec![name.into()];
                acknowledged += 1;
            }
            ["removing", id] => known.get_mut(&id.parse().unwrap()).unwrap().removing = true,
            ["removed", id] => {
                known.get_mut(&id.parse().unwrap()).unwrap().removed = true;
                acknowledged += 1;
            }
            _ => {}
        }
    }
    acknowledged
}

/// Opens the store and checks it against what is known.
fn check(dir: &Path, known: &mut HashMap<ExampleId, Known>, options: &OpenOptions) -> (u64, usize) {
    let begun = Instant::now();
    let (store, report) = Store::open(dir, options).unwrap();
    let took = begun.elapsed().as_millis() as u64;
    assert!(
        report.index_rebuilt.is_none() && report.quarantined.is_empty() && report.missing_derived.is_empty(),
        "{report:?}"
    );
    assert_eq!(report.blobs, 0);
    for (&id, known) in known.iter_mut() {
        match store.get(id) {
            Ok(record) => {
                assert!(!known.removed, "{id} was removed, acknowledged, and is back");
                assert!(
                    known.names.contains(&record.name),
                    "{id} is named {}, expected one of {:?}",
                    record.name,
                    known.names
                );
                known.names = vec![record.name.clone()];
                assert_eq!(store.mesh_bytes(id).unwrap(), example(known.seed).mesh);
            }
            Err(StoreError::NotFound { .. }) => {
                assert!(known.removing, "{id} was acknowledged and is lost");
                known.removed = true;
            }
            Err(error) => panic!("{id}: {error}"),
        }
        // A removal that had begun and did not happen never will.
        known.removing = known.removed;
    }
    let examples = all(&store);
    for &id in &examples {
        store.mesh_bytes(id).unwrap();
        let segments = store.get(id).unwrap().segments.len() as u32;
        for segment in 0..segments {
            store.derived(id, segment).unwrap();
        }
    }
    (took, examples.len())
}

fn all(store: &Store) -> Vec<ExampleId> {
    let mut ids = Vec::new();
    let mut after = None;
    loop {
        let page = store.list(after, 500, Filter::default());
        ids.extend(page.examples.iter().map(|record| record.id));
        after = page.next;
        if after.is_none() {
            return ids;
        }
    }
}

#[test]
fn nothing_acknowledged_is_lost_and_nothing_half_written_is_seen() {
    if std::env::var(DIR).is_ok() {
        return;
    }
    let rounds = std::env::var(ROUNDS).ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(12);
    let dir = tempfile::tempdir().unwrap();
    let mut known = HashMap::new();
    let (mut acknowledged, mut slowest, mut examples) = (0, 0, 0);
    for number in 1..=rounds {
        acknowledged += round(dir.path(), number, &mut known);
        let (took, found) = check(dir.path(), &mut known, &options());
        slowest = slowest.max(took);
        examples = found;
    }
    println!(
        "{rounds} kills, {acknowledged} acknowledged changes, {examples} examples at the end, slowest opening {slowest} ms"
    );
    assert!(acknowledged > rounds as usize, "the writers were killed too early to mean anything: {acknowledged}");
}
