//! A corpus that servers share, as a service on it starts.

use super::StartError;
use crate::commands::cluster::unreachable;
use crate::peers::Peers;
use crate::work::corpus::CorpusError;
use crate::work::corpus::stored::{StoredCorpus, row_maker, without_picture};
use crate::work::engine::Engine;
use crate::work::jobs::Queue;
use crate::work::kept::{KeptKind, UploadStore};
use quadmuse_cluster::{ClusterOptions, JetStream, Job, RowKeeper, SharedCorpus, SharedOptions};
use quadmuse_proto::{QueryId, Share};
use quadmuse_store::{Backend, Documents, StoreError};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the cache is called, in the directory that would hold the store.
const CACHE: &str = "cluster-cache";

/// Longest time to become known to the other servers, and the pause between two attempts.
const MEET_WITHIN: Duration = Duration::from_secs(30);
const MEET_AGAIN: Duration = Duration::from_millis(250);

/// Joins the servers that share the corpus; it is caught up when this returns.
pub(super) async fn join(
    options: &ClusterOptions,
    data: &Path,
    share: Option<Share>,
) -> Result<Arc<SharedCorpus>, StartError> {
    if data.join(quadmuse_migrations::SCHEMA_FILE).exists() {
        tracing::warn!(data = %data.display(), "the store in this directory is not used: the corpus lies on the cluster's engine");
    }
    let (options, cache) = (options.clone(), data.join(CACHE).join(&options.bucket));
    let joining = tokio::task::spawn_blocking(move || {
        let begun = Instant::now();
        // The audit log stands there, too.
        std::fs::create_dir_all(&cache).map_err(|source| StoreError::Io {
            doing: "create",
            path: cache.clone(),
            source,
        })?;
        let engine = JetStream::connect(&options).map_err(unreachable)?;
        let corpus = SharedCorpus::open(Arc::new(engine), &options_of(&cache, share))?;
        let (examples, position) = (corpus.snapshot().examples.len(), corpus.position());
        let (bucket, ms) = (&options.bucket, begun.elapsed().as_millis() as u64);
        tracing::info!(bucket, examples, position, ms, "joined the cluster");
        Ok::<_, StoreError>(Arc::new(corpus))
    });
    Ok(joining.await.map_err(|_| StartError::Interrupted)??)
}

/// Of what belongs to another share, the pictures are not kept, not even until the catalogue asks for them.
fn options_of(cache: &Path, share: Option<Share>) -> SharedOptions {
    let keep = share
        .map(|own| -> RowKeeper { Arc::new(move |id, row| if own.holds(id) { row } else { without_picture(row) }) });
    SharedOptions { row_keeper: keep, ..SharedOptions::caching_in(cache) }
}

/// The corpus as the service has it. Rows are made where an example is added, and travel with it.
pub(super) async fn corpus_of(shared: Arc<SharedCorpus>, engine: &Arc<dyn Engine>) -> Result<StoredCorpus, StartError> {
    let row_maker = row_maker(Arc::clone(engine));
    let reading = tokio::task::spawn_blocking(move || StoredCorpus::of(shared, Some(row_maker)));
    reading.await.map_err(|_| StartError::Interrupted)
}

/// Uploads of queries, kept on the engine.
pub(super) struct SharedUploads(pub(super) Arc<SharedCorpus>);

fn upload_name(id: QueryId, what: KeptKind) -> String {
    format!("query-{id}{}", what.suffix())
}

impl UploadStore for SharedUploads {
    fn put(&self, id: QueryId, what: KeptKind, bytes: &[u8]) -> Result<(), CorpusError> {
        Ok(self.0.keep_upload(&upload_name(id, what), bytes)?)
    }

    fn get(&self, id: QueryId, what: KeptKind) -> Result<Option<Vec<u8>>, CorpusError> {
        Ok(self.0.upload(&upload_name(id, what))?)
    }

    fn remove(&self, id: QueryId, what: KeptKind) -> Result<(), CorpusError> {
        Ok(self.0.remove_upload(&upload_name(id, what))?)
    }
}

/// Jobs, kept on the engine.
pub(super) struct SharedQueue(pub(super) Arc<SharedCorpus>);

impl Queue for SharedQueue {
    fn add(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, CorpusError> {
        Ok(self.0.add_job(kind, name, payload)?)
    }

    fn take(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, CorpusError> {
        Ok(self.0.take_job(kind, wait)?)
    }

    fn count(&self) -> Result<u64, CorpusError> {
        Ok(self.0.jobs()?)
    }

    fn keep(&self, name: &str, bytes: &[u8]) -> Result<(), CorpusError> {
        Ok(self.0.keep_upload(name, bytes)?)
    }

    fn kept(&self, name: &str) -> Result<Option<Vec<u8>>, CorpusError> {
        Ok(self.0.upload(name)?)
    }

    fn forget(&self, name: &str) -> Result<(), CorpusError> {
        Ok(self.0.remove_upload(name)?)
    }
}

/// Becomes one of the servers that share the corpus, at the address given, else where it listens.
pub(super) async fn meet(
    shared: &Arc<SharedCorpus>,
    advertise: Option<&str>,
    share: Option<Share>,
    listens: SocketAddr,
) -> Result<Arc<Peers>, StartError> {
    let documents = Arc::clone(shared) as Arc<dyn Documents>;
    if advertise.is_none() && listens.ip().is_loopback() {
        tracing::warn!("this server listens on the loopback: servers on other machines can't pass requests on to it");
    }
    let address = advertise.map_or_else(|| reached_at(listens), str::to_owned);
    let joining = tokio::task::spawn_blocking(move || {
        let begun = Instant::now();
        let peers = loop {
            match Peers::join_with(Arc::clone(&documents), &address, share) {
                // A leader is being elected: whoever starts then waits for it.
                Err(StoreError::Unreachable { .. } | StoreError::Busy) if begun.elapsed() < MEET_WITHIN => {
                    std::thread::sleep(MEET_AGAIN);
                }
                joined => break joined?,
            }
        };
        let (number, others) = (peers.own().get(), peers.others().len());
        tracing::info!(number, address, others, "known to the other servers");
        Ok::<_, StoreError>(Arc::new(peers))
    });
    Ok(joining.await.map_err(|_| StartError::Interrupted)??)
}

/// Where others are likely to reach a server that listens there.
fn reached_at(listens: SocketAddr) -> String {
    if !listens.ip().is_unspecified() {
        return format!("http://{listens}");
    }
    let name = rustix::system::uname();
    format!("http://{}:{}", name.nodename().to_string_lossy(), listens.port())
}
