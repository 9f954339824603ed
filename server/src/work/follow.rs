//! What others change in the corpus is brought into memory in the background.

use super::Work;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

/// Follows the corpus until `stopping`. A writer of this server has brought in its own change already.
pub async fn run(work: Arc<Work>, stopping: CancellationToken) {
    let mut newest = work.corpus.watch();
    while let Some(Ok(())) = stopping.run_until_cancelled(newest.changed()).await {
        let followed = work.blocking(|work| {
            work.catalogue.follow();
            Ok(())
        });
        if let Err(error) = followed.await {
            tracing::error!(%error, "a change of the corpus was not brought in");
        }
    }
}
