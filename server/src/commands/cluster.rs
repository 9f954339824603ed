//! `quadmuse-server cluster …`: a corpus that servers share, moved, kept and looked after.

use super::{CommandError, existing, say, write_whole};
use crate::config::{ClusterAction, ClusterArgs};
use crate::work::corpus::stored::{row_maker, row_of_packed, words_of};
use crate::work::engine::kernel::KernelEngine;
use quadmuse_cluster::{ClusterOptions, JetStream, SharedCorpus, SharedOptions};
use quadmuse_store::{Added, Backend, OpenOptions, Store, StoreError};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How often a copy says how far it is, in examples.
const PROGRESS_EVERY: usize = 1000;

/// Examples that are copied at a time.
const AT_ONCE: usize = 8;

/// Bytes of objects that a command keeps on disk: each is read about once.
const CACHE_BYTES: u64 = 64 << 20;

/// A corpus on the engine with a cache of its own, which goes with it.
struct Joined {
    corpus: SharedCorpus,
    cache: PathBuf,
}

impl Drop for Joined {
    fn drop(&mut self) {
        // A cache: what is left of it harms nobody.
        let _ = std::fs::remove_dir_all(&self.cache);
    }
}

fn join(args: &ClusterArgs) -> Result<Joined, CommandError> {
    let options: ClusterOptions = args.required()?;
    let engine = JetStream::connect(&options).map_err(unreachable)?;
    let cache = std::env::temp_dir().join(format!("quadmuse-cluster-{}", std::process::id()));
    let maker = row_maker(Arc::new(KernelEngine::default()));
    let shared = SharedOptions {
        cache_bytes: CACHE_BYTES,
        row_maker: Some(Arc::new(move |record, segment, packed| row_of_packed(record, segment, packed, &maker))),
        ..SharedOptions::caching_in(&cache)
    };
    Ok(Joined { corpus: SharedCorpus::open(Arc::new(engine), &shared)?, cache })
}

/// An engine that isn't reached, as the corpus tells it.
pub(crate) fn unreachable(error: quadmuse_cluster::EngineError) -> StoreError {
    StoreError::Unreachable { doing: "be reached", reason: error.to_string() }
}

/// Does what the command line says.
///
/// # Errors
/// [`CommandError`], to be printed.
pub(super) fn run(action: &ClusterAction) -> Result<(), CommandError> {
    match action {
        ClusterAction::Import { cluster, store } => {
            let from = existing(store)?;
            let joined = join(cluster)?;
            let added = copy(&from, &joined.corpus)?;
            say(&format!("{added} examples copied to the engine, {} there now", count(&joined.corpus)));
            Ok(())
        }
        ClusterAction::Export { cluster, store } => export(&join(cluster)?.corpus, &store.dir()),
        ClusterAction::Backup { cluster, file } => {
            let joined = join(cluster)?;
            let report = write_whole(file, &|writer| Ok(joined.corpus.backup(writer)?))?;
            super::report_backup(&report, file)
        }
        ClusterAction::Restore { cluster, file } => restore(&join(cluster)?.corpus, file),
        ClusterAction::Check { cluster } => check(&join(cluster)?.corpus),
        ClusterAction::Collect { cluster, older_than } => {
            let removed = join(cluster)?.corpus.collect(*older_than)?;
            say(&format!("{removed} objects removed"));
            Ok(())
        }
    }
}

fn count(corpus: &dyn Backend) -> usize {
    corpus.snapshot().examples.len()
}

/// Copies every example, with its id, its revision and its encodings; how many were not there. Several are under way at
/// a time: one alone mostly waits for the engine.
fn copy(from: &dyn Backend, to: &dyn Backend) -> Result<usize, CommandError> {
    let snapshot = from.snapshot();
    let (begun, added) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let copy_some = || -> Result<(), StoreError> {
        loop {
            let at = begun.fetch_add(1, Ordering::Relaxed);
            let Some(record) = snapshot.examples.get(at) else { return Ok(()) };
            match from.whole(record.id).and_then(|whole| to.put_whole(whole)) {
                Ok(Added::Created(_)) => drop(added.fetch_add(1, Ordering::Relaxed)),
                Ok(Added::Exists(_)) => {}
                // Removed meanwhile.
                Err(StoreError::NotFound { .. }) => {}
                Err(error) => {
                    // The others end with what they are at.
                    begun.store(snapshot.examples.len(), Ordering::Relaxed);
                    return Err(error);
                }
            }
            if (at + 1).is_multiple_of(PROGRESS_EVERY) {
                tracing::info!(at = at + 1, added = added.load(Ordering::Relaxed), "examples copied");
            }
        }
    };
    std::thread::scope(|scope| {
        let all: Vec<_> = (0..AT_ONCE).map(|_| scope.spawn(copy_some)).collect();
        let ended = all.into_iter().map(|one| one.join().map_err(|_| panicked("the copy to end")));
        ended.collect::<Result<Vec<_>, _>>()?.into_iter().collect::<Result<(), _>>().map_err(CommandError::from)
    })?;
    let left_out = from.quarantined();
    for (id, reason) in &left_out {
        say(&format!("left out {id}: {reason}"));
    }
    if left_out.is_empty() { Ok(added.into_inner()) } else { Err(CommandError::LeftOut(left_out.len())) }
}

/// A thread of a command ended by a panic, which is said where it happened.
fn panicked(what: &'static str) -> CommandError {
    CommandError::System { what, source: std::io::Error::other("a panic") }
}

/// Through a restore, so that what is interrupted is never taken for a whole store.
fn export(from: &SharedCorpus, dir: &Path) -> Result<(), CommandError> {
    let (mut reading, mut writing) =
        std::io::pipe().map_err(|source| CommandError::System { what: "a pipe", source })?;
    let restored = std::thread::scope(|scope| {
        let written = scope.spawn(move || from.backup(&mut writing));
        let restored = Store::restore(dir, &OpenOptions::default(), &mut reading);
        drop(reading);
        (written.join(), restored)
    });
    let (written, restored) = restored;
    let (_, report) = restored?;
    let written = written.map_err(|_| panicked("the export to end"))??;
    say(&format!("{} examples in {}", report.examples, dir.display()));
    if written.skipped.is_empty() { Ok(()) } else { Err(CommandError::LeftOut(written.skipped.len())) }
}

fn restore(to: &SharedCorpus, file: &Path) -> Result<(), CommandError> {
    let examples = count(to);
    if examples > 0 {
        return Err(StoreError::NotEmpty { examples }.into());
    }
    let path = file.to_owned();
    let opened = File::open(file).map_err(|source| CommandError::File { doing: "read", path, source })?;
    let examples = quadmuse_store::read_backup(to, &mut BufReader::new(opened))?;
    say(&format!("{examples} examples on the engine"));
    Ok(())
}

fn check(corpus: &SharedCorpus) -> Result<(), CommandError> {
    let report = corpus.check(&mut |done| tracing::debug!(done, "examples checked"))?;
    for problem in &report.problems {
        say(&words_of(problem));
    }
    say(&format!("{} examples, {} segments, {} bytes read", report.examples, report.segments, report.bytes));
    if report.problems.is_empty() { Ok(()) } else { Err(CommandError::Damage(report.problems.len())) }
}
