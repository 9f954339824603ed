//! Following a query until its ranking is final: by long polls, or by the stream. Both hand on the same events.

use crate::{
    api::{Api, RankingView},
    error::ClientError,
    stream::EventReader,
};
use futures_util::{StreamExt, stream::FuturesUnordered};
use quadmuse_proto::{Begin, Code, End, EndState, Event, Problem, Query, QueryId, QueryState, Ranking};
use std::time::{Duration, Instant};

/// How long a poll waits for a newer ranking.
const POLL_WAIT_MS: u64 = 10_000;
/// Least time between two polls that bring nothing new.
const POLL_PAUSE: Duration = Duration::from_millis(100);
/// Faults of the connection in a row that are put up with.
const FAULTS_MAX: u32 = 3;
/// Pause after a fault.
const FAULT_PAUSE: Duration = Duration::from_millis(500);

/// Takes the events of a query, in order.
pub trait Watcher {
    /// Takes one event.
    ///
    /// # Errors
    /// What it ran into; then the query is followed no more.
    fn see(&mut self, event: &Event) -> Result<(), ClientError>;
}

/// Follows a query by long polls, one segment beside the other, until nothing more will change.
///
/// # Errors
/// The service refuses or is out of reach, or the watcher fails.
pub async fn poll(api: &Api, query: Query, watcher: &mut dyn Watcher) -> Result<End, ClientError> {
    let query = cut_into_segments(api, query).await?;
    let segments = u32::try_from(query.segments.len()).unwrap_or(u32::MAX);
    let begin = Begin { query: query.id, segments, resolution: query.resolution, corpus_size: query.corpus_size };
    watcher.see(&Event::Begin(begin))?;

    let mut revision = 0;
    let mut polls: FuturesUnordered<_> =
        query.segments.iter().map(|segment| newer(api, query.id, segment.segment, 0)).collect();
    while let Some((after, ranking)) = polls.next().await.transpose()? {
        if ranking.revision > after {
            revision = revision.max(ranking.revision);
            watcher.see(&Event::Level(ranking.clone()))?;
        }
        if !ranking.state.is_final() {
            polls.push(newer(api, query.id, ranking.segment, ranking.revision.max(after)));
        }
    }
    let summary = api.query(query.id).await?;
    let end = End { query: query.id, state: end_state(&summary), revision: revision.max(summary.revision), summary };
    watcher.see(&Event::End(Box::new(end.clone())))?;
    Ok(end)
}

/// The query, once its mesh has been read and cut into segments.
async fn cut_into_segments(api: &Api, mut query: Query) -> Result<Query, ClientError> {
    while query.segments.is_empty() && !query.state.is_final() {
        tokio::time::sleep(POLL_PAUSE).await;
        query = api.query(query.id).await?;
    }
    Ok(query)
}

/// One poll of a segment's ranking, and the revision it was asked to come after.
async fn newer(api: &Api, id: QueryId, segment: u32, after: u64) -> Result<(u64, Ranking), ClientError> {
    let mut faults = 0;
    loop {
        let begun = Instant::now();
        let view = RankingView { segment, after: Some(after), wait_ms: POLL_WAIT_MS };
        match api.ranking(id, view).await {
            Ok(mut ranking) => {
                ranking.segment = segment;
                if ranking.revision <= after && !ranking.state.is_final() {
                    tokio::time::sleep(POLL_PAUSE.saturating_sub(begun.elapsed())).await;
                }
                return Ok((after, ranking));
            }
            Err(ClientError::BrokenOff { .. }) if faults < FAULTS_MAX => {
                faults += 1;
                tokio::time::sleep(FAULT_PAUSE).await;
            }
            Err(error) => return Err(error),
        }
    }
}

/// Follows a query by its stream, which is opened again where it left off when the connection breaks.
///
/// # Errors
/// The service refuses, ends the stream with an error or is out of reach, or the watcher fails.
pub async fn stream(api: &Api, id: QueryId, watcher: &mut dyn Watcher) -> Result<End, ClientError> {
    let (mut last, mut faults) = (None, 0);
    loop {
        let fault = match read_stream(api, id, &mut last, &mut faults, watcher).await {
            Ok(Some(end)) => return Ok(end),
            // The server has closed the stream without a last event.
            Ok(None) => None,
            Err(error @ ClientError::BrokenOff { .. }) => Some(error),
            Err(error) => return Err(error),
        };
        faults += 1;
        if faults > FAULTS_MAX {
            return Err(fault.unwrap_or_else(|| ClientError::Unintelligible {
                url: format!("{}/v1/queries/{id}/stream", api.server()),
                expected: "a last event",
                found: "the end of the stream".into(),
            }));
        }
        tokio::time::sleep(FAULT_PAUSE).await;
    }
}

/// Reads one connection's share of the stream; `None` if it ends without a last event.
async fn read_stream(
    api: &Api,
    id: QueryId,
    last: &mut Option<u64>,
    faults: &mut u32,
    watcher: &mut dyn Watcher,
) -> Result<Option<End>, ClientError> {
    let (format, response) = api.ranking_stream(id, *last).await?;
    let url = response.url().to_string();
    let (mut pieces, mut reader) = (response.bytes_stream(), EventReader::new(format));
    while let Some(piece) = pieces.next().await {
        let piece = piece.map_err(|source| ClientError::BrokenOff { server: api.server().into(), source })?;
        let events = reader.push(&piece).map_err(|fault| ClientError::Unintelligible {
            url: url.clone(),
            expected: "a stream of events",
            found: fault.to_string(),
        })?;
        for event in events {
            *faults = 0;
            *last = event.revision().or(*last);
            watcher.see(&event)?;
            match event {
                Event::End(end) => return Ok(Some(*end)),
                Event::Error(error) => return Err(ClientError::InEvents(Box::new(error.problem))),
                Event::Begin(_) | Event::Level(_) => {}
            }
        }
    }
    Ok(None)
}

/// How a query that will not change any more has ended.
fn end_state(query: &Query) -> EndState {
    match query.state {
        QueryState::Failed => EndState::Failed,
        QueryState::Cancelled => EndState::Cancelled,
        _ if query.deadline_reached => EndState::Deadline,
        _ => EndState::Done,
    }
}

/// Whether the end leaves a ranking to work with.
///
/// # Errors
/// Why not: the query failed or was cancelled.
pub fn conclude(end: &End) -> Result<(), ClientError> {
    match end.state {
        EndState::Done | EndState::Deadline => Ok(()),
        EndState::Cancelled => Err(ClientError::Cancelled { query: end.query.to_string() }),
        EndState::Failed => {
            let unknown = || Problem::new(Code::Internal, 500, "the query failed, and the service does not say why");
            Err(ClientError::InEvents(Box::new(end.summary.problem.clone().unwrap_or_else(unknown))))
        }
    }
}
