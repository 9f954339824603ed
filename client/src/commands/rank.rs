//! `query` and `ranking`: uploads a mesh, and shows its ranking as it is refined.

use super::{
    gauge::Gauge,
    screen::{Screen, Wanted},
};
use crate::{
    api::{Api, RankingView},
    args::{QueryArgs, QueryCommand, RankingArgs},
    error::ClientError,
    follow, names,
    state::State,
    table,
    ui::{Ui, tell_share},
};
use quadmuse_proto::{End, EndState, Query, QueryId};

pub(super) async fn query(args: &QueryCommand, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let query = upload(&args.query, api, state, ui).await?;
    if args.no_follow {
        ui.value(&query)?;
        ui.note(&format!("ranking goes on; see it with `quadmuse ranking {} --follow`", query.id));
        return ui.text(&query.id.to_string());
    }
    let end = match follow_upload(&query, Wanted::Ranking, api, ui).await {
        Err(ClientError::OwnerGone { query, .. }) => {
            let query = again(query, api, state, ui).await?;
            follow_upload(&query, Wanted::Ranking, api, ui).await?
        }
        followed => followed?,
    };
    ui.text(&end.query.to_string())
}

/// Starts a query again whose server is gone, and says so.
pub(super) async fn again(gone: QueryId, api: &Api, state: &State, ui: &mut Ui) -> Result<Query, ClientError> {
    let query = api.restart_query(gone).await?;
    ui.note(&format!("the server that had the query {gone} is gone; it was started again as {}", query.id));
    remember(&query, api, state, ui);
    Ok(query)
}

/// Keeps a query for those who ask for the last.
pub(super) fn remember(query: &Query, api: &Api, state: &State, ui: &mut Ui) {
    if let Err(error) = state.keep_query(api.server(), query.id) {
        ui.note(&format!("the query is not remembered for {}: {}", names::LAST, error.message()));
    }
}

/// Uploads a mesh, remembers its query, and tells what was repaired in it.
pub(super) async fn upload(args: &QueryArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<Query, ClientError> {
    let query = start(args, api, ui).await?;
    remember(&query, api, state, ui);
    for repair in &query.repairs {
        ui.note(&format!("{}: {repair}", args.file.display()));
    }
    Ok(query)
}

/// Uploads a mesh.
pub(super) async fn start(args: &QueryArgs, api: &Api, ui: &mut Ui) -> Result<Query, ClientError> {
    let like = match &args.rank.like {
        Some(name) => Some(names::example(name, api).await?),
        None => None,
    };
    let spinner = ui.spinner("uploading");
    let query = api.start_query(args, like, &|share| tell_share(&spinner, "uploading", share)).await;
    spinner.finish_and_clear();
    query
}

/// Shows the rankings of a query until they are final.
pub(super) async fn follow_upload(query: &Query, wanted: Wanted, api: &Api, ui: &mut Ui) -> Result<End, ClientError> {
    // Where the screen keeps silent, a sign of life.
    let spinner = (wanted == Wanted::Outcome && !ui.is_live()).then(|| ui.spinner("ranking"));
    let mut screen = Screen::new(query.clone(), None, wanted, ui);
    let end = match spinner {
        None => follow::poll(api, query.clone(), &mut screen).await,
        Some(spinner) => {
            let mut gauge = Gauge::new(spinner.clone(), "ranking", Some(&mut screen));
            let end = follow::poll(api, query.clone(), &mut gauge).await;
            spinner.finish_and_clear();
            end
        }
    };
    let end = end?;
    ui.settle();
    follow::conclude(&end)?;
    tell_end(&end, ui);
    Ok(end)
}

fn tell_end(end: &End, ui: &mut Ui) {
    let timings = &end.summary.timings;
    if end.state == EndState::Deadline {
        ui.note("the deadline came before the last level; this is the best ranking so far");
    }
    if let Some(first_ms) = timings.first_ranking_ms {
        let (first, all) = (table::time(first_ms), table::time(timings.total_ms));
        ui.note(&format!("first ranking after {first}, the last after {all}"));
    }
}

pub(super) async fn ranking(args: &RankingArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let query = api.query(names::query(&args.query, api, state).await?).await?;
    let only = args.segment.as_ref().map(|given| names::segment(given, &query.segments)).transpose()?;
    check_segment(&query, only)?;
    if args.follow {
        let mut screen = Screen::new(query.clone(), only, Wanted::Ranking, ui);
        let end = follow::stream(api, query.id, &mut screen).await?;
        ui.settle();
        follow::conclude(&end)?;
        tell_end(&end, ui);
        return Ok(());
    }
    if let Some(problem) = query.problem {
        return Err(ClientError::Refused(Box::new(problem)));
    }
    let segments = query.segments.iter().map(|segment| segment.segment);
    for segment in segments.filter(|&segment| only.is_none_or(|only| only == segment)) {
        let ranking = api.ranking(query.id, RankingView { segment, after: None, wait_ms: 0 }).await?;
        ui.value(&ranking)?;
        ui.text(&table::ranking(&ranking, ui.room()))?;
    }
    Ok(())
}

/// Sees to it that a query has the segment asked for.
pub(super) fn check_segment(query: &Query, segment: Option<u32>) -> Result<(), ClientError> {
    match segment {
        Some(segment) if !query.segments.iter().any(|s| s.segment == segment) && !query.segments.is_empty() => {
            Err(ClientError::NoSuchSegment { query: query.id.to_string(), segment, segments: query.segments.len() })
        }
        _ => Ok(()),
    }
}
