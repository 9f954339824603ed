//! Derived state is rebuilt in the background: encodings that are missing, damaged or of an older encoder.
//!
//! The old encoding of an example, where there is one, is ranked until its new one is stored.

use super::engine::PackedEncoding;
use super::{Work, WorkError, ingest, jobs};
use crate::pool::{Lane, User};
use quadmuse_proto::ExampleId;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Pause between looks for stale encodings, and after a failure.
const PAUSE: Duration = Duration::from_secs(30);

/// Time to encode one example again.
const TIME_MAX: Duration = Duration::from_secs(600);

/// The turn that background work takes in the pool.
const BACKGROUND: User = User(u64::MAX);

/// Rebuilds what is stale until `stopping`; never returns before.
pub async fn run(work: Arc<Work>, stopping: CancellationToken) {
    while stopping.run_until_cancelled(round(&work)).await.is_some() {
        if stopping.run_until_cancelled(tokio::time::sleep(PAUSE)).await.is_none() {
            return;
        }
    }
}

/// One look over the corpus; an example that fails is logged and left for the next.
pub async fn round(work: &Arc<Work>) {
    let Ok(stale) = work.blocking(|work| Ok(work.corpus.stale(work.engine.version()))).await else { return };
    if work.queue.get().is_some() {
        // Whichever server is free does it.
        if let Err(error) = jobs::encode_again(work, stale).await {
            tracing::warn!(%error, "what is to be encoded again is not in the queue");
        }
        return;
    }
    for (example, segment) in stale {
        match rebuild(work, example, segment).await {
            Ok(()) => tracing::info!(%example, segment, "encoded again"),
            Err(error) => tracing::warn!(%example, segment, %error, "not encoded again"),
        }
    }
}

/// Encodes a segment again, unless somebody did meanwhile.
pub(super) async fn rebuilt(work: &Arc<Work>, id: ExampleId, segment: u32) -> Result<(), WorkError> {
    let is_stale = work.blocking(move |work| {
        work.catalogue.follow();
        Ok(work.corpus.stale(work.engine.version()).contains(&(id, segment)))
    });
    if is_stale.await? { rebuild(work, id, segment).await } else { Ok(()) }
}

async fn rebuild(work: &Arc<Work>, id: ExampleId, segment: u32) -> Result<(), WorkError> {
    let example = work.catalogue.example(id)?;
    let estimate = work.engine.memory_estimate(example.bytes);
    let job = work.pool.admit(BACKGROUND, estimate, Some(TIME_MAX))?;
    let model = ingest::model(work, &job, Lane::Ingest, &example).await?;
    let (engine, counts) = (Arc::clone(&work.engine), ingest::counts_of(&model.mesh));
    let pack = move |stop: &_| engine.encode(&model, segment, stop).and_then(|e| engine.pack(&e.encoding));
    let packed: PackedEncoding = work.pool.run(&job, Lane::Ingest, pack).await??;
    work.blocking(move |work| {
        work.corpus.put_encoding(id, segment, &packed, counts, work.engine.version())?;
        work.catalogue.follow();
        Ok(())
    })
    .await
}
