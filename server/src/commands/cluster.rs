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

/// How often a copy says how far it is, in examples.
const PROGRESS_EVERY: usize = 1000;

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
            super::told(&report, file)
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

/// Copies every example, with its id, its revision and its encodings; how many were not there.
fn copy(from: &dyn Backend, to: &dyn Backend) -> Result<usize, CommandError> {
    let mut added = 0;
    for (at, record) in (1..).zip(&from.snapshot().examples) {
        match from.whole(record.id).and_then(|whole| to.put_whole(whole)) {
            Ok(Added::Created(_)) => added += 1,
            Ok(Added::Exists(_)) => {}
            // Removed meanwhile.
            Err(StoreError::NotFound { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        if at % PROGRESS_EVERY == 0 {
            tracing::info!(at, added, "examples copied");
        }
    }
    let left_out = from.quarantined();
    for (id, reason) in &left_out {
        say(&format!("left out {id}: {reason}"));
    }
    if left_out.is_empty() { Ok(added) } else { Err(CommandError::LeftOut(left_out.len())) }
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
    let written = written
        .map_err(|_| CommandError::System { what: "the export to end", source: std::io::Error::other("a panic") })??;
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
