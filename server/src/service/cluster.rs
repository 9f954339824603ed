//! A corpus that servers share, as a service on it starts.

use super::StartError;
use crate::commands::cluster::unreachable;
use crate::work::corpus::stored::{StoredCorpus, row_maker};
use crate::work::engine::Engine;
use quadmuse_cluster::{ClusterOptions, JetStream, SharedCorpus, SharedOptions};
use quadmuse_store::{Backend, StoreError};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// What the cache is called, in the directory that would hold the store.
const CACHE: &str = "cluster-cache";

/// Joins the servers that share the corpus; it is caught up when this returns.
pub(super) async fn join(options: &ClusterOptions, data: &Path) -> Result<Arc<SharedCorpus>, StartError> {
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
        let corpus = SharedCorpus::open(Arc::new(engine), &SharedOptions::caching_in(&cache))?;
        let (examples, position) = (corpus.snapshot().examples.len(), corpus.position());
        let (bucket, ms) = (&options.bucket, begun.elapsed().as_millis() as u64);
        tracing::info!(bucket, examples, position, ms, "joined the cluster");
        Ok::<_, StoreError>(Arc::new(corpus))
    });
    Ok(joining.await.map_err(|_| StartError::Interrupted)??)
}

/// The corpus as the service has it. Rows are made where an example is added, and travel with it.
pub(super) async fn corpus_of(shared: Arc<SharedCorpus>, engine: &Arc<dyn Engine>) -> Result<StoredCorpus, StartError> {
    let row_maker = row_maker(Arc::clone(engine));
    let reading = tokio::task::spawn_blocking(move || StoredCorpus::of(shared, Some(row_maker)));
    reading.await.map_err(|_| StartError::Interrupted)
}
