//! A query's scan, cut otherwise and ranked anew.

use super::when_there_is_room;
use crate::work::ingest::Upload;
use crate::work::kept::KeptQueries;
use crate::work::query::{Board, LiveQuery, QueryOptions};
use crate::work::{Work, WorkError, search};
use quadmuse_proto::Parts;
use std::sync::Arc;
use tokio::sync::OnceCell;

/// The upload that a query was started with, fetched when it is first needed.
pub(super) struct QuerySource {
    pub(super) work: Arc<Work>,
    pub(super) kept: Arc<KeptQueries>,
    /// Largest mesh, in bytes.
    pub(super) largest: u64,
    pub(super) upload: OnceCell<Option<(Upload, QueryOptions)>>,
}

impl QuerySource {
    /// Tells whether nobody said how the scan is to be cut; `None` if what was sent is not kept any more.
    pub(super) async fn is_uncut(&self, live: &LiveQuery) -> Result<Option<bool>, WorkError> {
        let is_uncut =
            |(upload, options): &(Upload, QueryOptions)| !upload.cut.is_asked_for() && options.like.is_none();
        Ok(self.sent(live).await?.map(is_uncut))
    }

    /// What the query was started with; `None` if it is not kept any more.
    async fn sent(&self, live: &LiveQuery) -> Result<Option<&(Upload, QueryOptions)>, WorkError> {
        let sent = self.upload.get_or_try_init(|| self.found(live)).await?;
        Ok(sent.as_ref())
    }

    async fn found(&self, live: &LiveQuery) -> Result<Option<(Upload, QueryOptions)>, WorkError> {
        let found = || self.kept.find(&self.work, live.caller, live.id, self.largest);
        match when_there_is_room(found).await {
            Err(WorkError::NoSuchQuery(_)) => Ok(None),
            found => found.map(Some),
        }
    }

    /// The same scan, cut otherwise; its ranking goes on. `None` if what was sent is not kept any more.
    pub(super) async fn cut(&self, live: &LiveQuery, parts: Parts) -> Result<Option<Recut>, WorkError> {
        let Some((upload, options)) = self.sent(live).await? else { return Ok(None) };
        let mut upload = upload.clone();
        upload.cut.parts = Some(parts);
        let started = || search::start(&self.work, live.caller, upload.clone(), options.clone());
        let live = when_there_is_room(started).await?;
        let (work, kept) = (Arc::clone(&self.work), Arc::clone(&self.kept));
        Ok(Some(Recut { live, upload, work, kept, is_kept: false }))
    }
}

/// A query that was started for a retopology. It is cancelled and freed when it is dropped, unless it is kept.
pub(super) struct Recut {
    pub(super) live: Arc<LiveQuery>,
    upload: Upload,
    work: Arc<Work>,
    kept: Arc<KeptQueries>,
    is_kept: bool,
}

impl Recut {
    /// Leaves it to its owner: it may be started again, as any other.
    pub(super) fn keep(mut self) {
        self.is_kept = true;
        self.kept.keep(&self.work, &self.live, self.upload.clone());
    }
}

impl Drop for Recut {
    fn drop(&mut self) {
        if !self.is_kept {
            // Its owner may have removed it.
            let _ = search::cancel(&self.work, self.live.id);
        }
    }
}

/// The score of the best entry of a segment's ranking: the lower, the better. Infinite where there is none.
pub(super) fn score(board: &Board, segment: u32) -> f64 {
    let best = board.rankings.get(segment as usize).and_then(|ranking| ranking.candidates.first());
    best.map_or(f64::INFINITY, |best| best.score)
}

/// The best score of some segments as soon as their pictures have been compared at the finest level. Where they leave it open who is
/// best, the order may still change, but not the scores.
pub(super) async fn score_when_compared(live: &LiveQuery, segments: &[u32]) -> f64 {
    let is_compared = |board: &Board, segment: u32| {
        board.rankings.get(segment as usize).is_some_and(|ranking| ranking.level >= live.options.resolution)
    };
    let board = live.wait_for(|board| segments.iter().all(|&segment| is_compared(board, segment))).await;
    segments.iter().map(|&segment| score(&board, segment)).fold(f64::INFINITY, f64::min)
}
