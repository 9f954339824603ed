//! The corpus is read in the background, a little at a time, so that damage is found before somebody needs what is damaged.

use super::Work;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Time for a round over the whole corpus.
const ROUND: Duration = Duration::from_secs(24 * 3600);

/// Shortest and longest pause between two examples.
const PAUSE: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(60));

/// Reads round after round until `stopping`.
pub async fn run(work: Arc<Work>, stopping: CancellationToken) {
    stopping.run_until_cancelled(rounds(&work)).await;
}

async fn rounds(work: &Arc<Work>) {
    // There from the beginning: of a counter that is first seen at 1 an alert doesn't know that it has grown.
    metrics::counter!("quadmuse_damage_found_total").increment(0);
    loop {
        let ids: Vec<_> = work.catalogue.snapshot().examples_after(None).map(|example| example.id).collect();
        let pause = ROUND.checked_div(ids.len().max(1) as u32).unwrap_or(ROUND).clamp(PAUSE.0, PAUSE.1);
        tokio::time::sleep(pause).await;
        for id in ids {
            example(work, id).await;
            tokio::time::sleep(pause).await;
        }
        metrics::counter!("quadmuse_scrub_rounds_total").increment(1);
    }
}

/// Reads one example; what is damaged is set aside, mended or encoded anew.
pub async fn example(work: &Arc<Work>, id: quadmuse_proto::ExampleId) {
    let found = work.blocking(move |work| Ok(work.corpus.scrub(id)?)).await;
    metrics::counter!("quadmuse_scrubbed_total").increment(1);
    match found {
        Ok(problems) => problems.iter().for_each(|problem| {
            metrics::counter!("quadmuse_damage_found_total").increment(1);
            tracing::error!(problem, "damage found");
        }),
        Err(error) => tracing::warn!(%id, %error, "not read by the scrubber"),
    }
}
