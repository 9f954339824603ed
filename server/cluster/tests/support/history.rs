//! A record of what was acknowledged while parts of the engine were away, and the comparison with what is there.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::Scope;
use std::time::{Duration, Instant};

use quadmuse_cluster::{Engine, JetStream, SharedCorpus};
use quadmuse_proto::id::ExampleId;
use quadmuse_store::{Backend, Patch, StoreError};

use crate::suite::{eventually, small};

/// Longest time for what the engine lost to be written again: two looks after the last election, and some more.
const HEALED_WITHIN: Duration = Duration::from_secs(40);

/// An acknowledged example: how often it was renamed for certain, and how often perhaps.
struct Acknowledged {
    key: String,
    sure: u32,
    unsure: u32,
}

/// All that was acknowledged.
#[derive(Default)]
pub(crate) struct History {
    examples: BTreeMap<ExampleId, Acknowledged>,
    added: u32,
    unsure: u32,
    /// The longest time between two acknowledgements, of all writers together.
    gap: Duration,
    last: Option<Instant>,
}

impl History {
    fn acknowledged(&mut self) {
        let now = Instant::now();
        self.gap = self.gap.max(self.last.map_or(Duration::ZERO, |last| now - last));
        self.last = Some(now);
    }
}

/// Starts four threads that write to two servers in turn, until `stopping`.
pub(crate) fn start_writers<'scope>(
    scope: &'scope Scope<'scope, '_>,
    servers: &'scope [Arc<SharedCorpus>; 2],
    history: &'scope Mutex<History>,
    stopping: &'scope AtomicBool,
) {
    for writer in 0..4u64 {
        let server = &servers[writer as usize % 2];
        scope.spawn(move || write(&**server, 1_000_000 * (writer + 1)..u64::MAX, history, stopping));
    }
}

/// Adds and renames until `stopping`. What it wrote it reads at once, on the same server.
fn write(server: &dyn Backend, seeds: std::ops::Range<u64>, history: &Mutex<History>, stopping: &AtomicBool) {
    for seed in seeds {
        if stopping.load(Ordering::Relaxed) {
            return;
        }
        let record = match server.add(&small(seed).example(), &[]) {
            Ok(added) => Arc::clone(added.record()),
            Err(StoreError::Unreachable { .. } | StoreError::Busy) => {
                history.lock().expect("whole").unsure += 1;
                continue;
            }
            Err(error) => panic!("an add failed: {error}"),
        };
        assert!(server.get(record.id).is_ok(), "its own write is read");
        let mut all = history.lock().expect("whole");
        all.acknowledged();
        all.added += 1;
        let key = format!("example.{}", record.identity);
        all.examples.insert(record.id, Acknowledged { key, sure: 0, unsure: 0 });
        drop(all);
        for k in 0..3 {
            let name = Patch { name: Some(format!("{seed}-{k}")), ..Patch::default() };
            let renamed = server.annotate(record.id, name);
            let mut all = history.lock().expect("whole");
            let entry = all.examples.get_mut(&record.id).expect("added");
            match renamed {
                Ok(renamed) => {
                    entry.sure += 1;
                    all.acknowledged();
                    drop(all);
                    let read = server.get(record.id).expect("there").revision;
                    assert!(read >= renamed.revision, "no read older than the reader's own write");
                }
                Err(StoreError::Unreachable { .. } | StoreError::Busy) => entry.unsure += 1,
                Err(error) => panic!("renaming failed: {error}"),
            }
        }
    }
}

/// A sentence for each acknowledged change that is not there.
fn lost(history: &History, servers: &[&SharedCorpus], engine: &JetStream) -> Vec<String> {
    let newest = engine.newest().expect("an answer");
    let mut lost = Vec::new();
    for (at, server) in servers.iter().enumerate() {
        eventually("it is quiet", || server.position() >= newest);
        for (id, Acknowledged { key, sure, unsure }) in &history.examples {
            let found = server.get(*id).map_or(0, |record| record.revision);
            if !(1 + sure..=1 + sure + unsure).contains(&found) {
                let (most, there) = (sure + unsure, engine.read(key).expect("read").map_or(0, |entry| entry.position));
                lost.push(format!(
                    "server {at} has revision {found} of {id} after {sure} to {most} changes; the engine has it at {there}"
                ));
            }
        }
        let problems = server.check(&mut |_| {}).expect("checked").problems;
        lost.extend(problems.iter().map(|problem| format!("server {at}: {problem:?}")));
    }
    lost
}

/// Tells what was acknowledged, and compares the servers, and one that joined afresh, with it.
pub(crate) fn judge(
    history: Mutex<History>,
    servers: &[Arc<SharedCorpus>; 2],
    fresh: &SharedCorpus,
    asking: &JetStream,
    after: &str,
) {
    let history = history.into_inner().expect("whole");
    let (added, sure, unsure) = (
        history.added,
        history.examples.values().map(|entry| entry.sure).sum::<u32>(),
        history.unsure + history.examples.values().map(|entry| entry.unsure).sum::<u32>(),
    );
    println!(
        "{after}: {added} adds and {sure} changes acknowledged, {unsure} not known; longest gap between two {:.1} s",
        history.gap.as_secs_f64()
    );
    assert!(added > 0);
    let all = [&*servers[0], &*servers[1], fresh];
    let mut missing = lost(&history, &all, asking);
    // A sentence for each example that the servers tell differently.
    let differing = || {
        let listed: Vec<BTreeMap<ExampleId, String>> = all
            .iter()
            .map(|server| {
                server.snapshot().examples.iter().map(|e| (e.id, format!("{} {}", e.revision, e.name))).collect()
            })
            .collect();
        let ids: BTreeSet<ExampleId> = listed.iter().flat_map(|one| one.keys().copied()).collect();
        let of = |id: &ExampleId| listed.iter().map(|one| one.get(id).cloned()).collect::<Vec<_>>();
        let are_alike = |of: &[Option<String>]| of.iter().all(|one| *one == of[0]);
        let differing = ids.iter().map(|id| (id, of(id))).filter(|(_, of)| !are_alike(of));
        differing.map(|(id, of)| format!("{id}: {of:?}")).collect::<Vec<_>>()
    };
    let is_alike = || servers.iter().all(|server| server.snapshot().examples == fresh.snapshot().examples);
    // The servers write again what the engine itself lost, and a change that nobody acknowledged may still arrive.
    let begun = Instant::now();
    while !(missing.is_empty() && is_alike()) && begun.elapsed() < HEALED_WITHIN {
        println!("after {:.1} s: {missing:?}, {:?}", begun.elapsed().as_secs_f64(), differing());
        std::thread::sleep(Duration::from_secs(1));
        missing = lost(&history, &all, asking);
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(is_alike(), "all servers have the same: {:?}", differing());
    assert!(fresh.snapshot().examples.len() as u32 <= added + history.unsure);
}
