//! `map` and `constrain`: lays an example on the input, and writes the mesh.

use super::{
    choose::{choose, finished, promising},
    deliver::{Target, write_map},
    rank::check_segment,
};
use crate::{
    api::Api,
    args::{ConstrainArgs, MapArgs},
    error::ClientError,
    names,
    spec::ExampleRef,
    state::State,
    ui::Ui,
};
use futures_util::{StreamExt, stream};
use quadmuse_proto::{
    Beyond, Code, ConstraintEdit, Landmark, Map, MapId, NewMap, Problem, Query, QueryId, QuerySegment,
};

/// Examples that are laid at a time.
const AT_A_TIME: usize = 2;

pub(super) async fn map(args: &MapArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let target = Target::of(&args.out, args.kept.as_deref());
    target.prepare(ui)?;
    let landmarks = landmarks(args)?;
    let told = match &args.example {
        Some(told) => Some(names::example_ref(told, api).await?),
        None => None,
    };
    let query = finished(names::query(&args.query, api, state).await?, api, ui).await?;
    let (map, name) = lay(&query, args.segment, told, (args.beyond, landmarks), api, ui).await?;
    write_map(&map, Some(&name), &target, api, ui).await?.is_enough(args.require)
}

/// The landmarks of the command line and of the file.
fn landmarks(args: &MapArgs) -> Result<Vec<Landmark>, ClientError> {
    let mut all: Vec<Landmark> = args.landmark.iter().map(|spec| spec.0.clone()).collect();
    if let Some(file) = &args.landmarks {
        let text = crate::file::read(file)?;
        let found: Result<Vec<Landmark>, _> = serde_json::from_slice(&text);
        all.extend(
            found.map_err(|error| ClientError::LandmarksInvalid { file: file.clone(), detail: error.to_string() })?,
        );
    }
    Ok(all)
}

/// Lays an example (the best, unless one is told) on a segment; the map, and the example's name.
pub(super) async fn lay(
    query: &Query,
    segment: u32,
    told: Option<ExampleRef>,
    (beyond, landmarks): (Beyond, Vec<Landmark>),
    api: &Api,
    ui: &mut Ui,
) -> Result<(Map, String), ClientError> {
    let spinner = ui.spinner("mapping");
    let found = laid(query, segment, told, (beyond, landmarks), api).await;
    spinner.finish_and_clear();
    found
}

/// The same, and says nothing.
async fn laid(
    query: &Query,
    segment: u32,
    told: Option<ExampleRef>,
    (beyond, landmarks): (Beyond, Vec<Landmark>),
    api: &Api,
) -> Result<(Map, String), ClientError> {
    check_segment(query, Some(segment))?;
    let Some(found) = query.segments.iter().find(|candidate| candidate.segment == segment) else {
        return Err(ClientError::NoSuchSegment {
            query: query.id.to_string(),
            segment,
            segments: query.segments.len(),
        });
    };
    let choice = choose(query, found, told, api).await?;
    let map = api.start_map(query.id, &NewMap { beyond, landmarks, ..choice.new }).await?;
    Ok((map, choice.name))
}

/// Lays the ranking's best examples on a segment until a map is good enough; the map that is worth most, or else the best
/// example's, and its example's name. As many are tried as the service calls worth it, but one at least.
pub(super) async fn lay_best(
    query: &Query,
    segment: &QuerySegment,
    beyond: Beyond,
    api: &Api,
    ui: &mut Ui,
) -> Result<(Map, String), ClientError> {
    let tries = segment.tries as usize;
    let mut best = lay(query, segment.segment, None, (beyond, Vec::new()), api, ui).await?;
    if tries <= 1 || best.0.is_enough(1, tries) {
        return Ok(best);
    }
    // The first is mostly good enough. Where it is not, two at a time are laid, and looked at in order.
    let others = promising(query, segment.segment, tries, api).await?;
    let spinner = ui.spinner("mapping");
    let one = |told| laid(query, segment.segment, Some(told), (beyond, Vec::new()), api);
    let mut found = stream::iter(others.into_iter().skip(1).map(one)).buffered(AT_A_TIME);
    let mut tried = 1;
    while let Some(found) = found.next().await {
        tried += 1;
        match found {
            Ok(found) if found.0.worth() > best.0.worth() => best = found,
            Ok(_) => {}
            Err(error) if is_late(&error) => break,
            Err(error) => {
                spinner.finish_and_clear();
                return Err(error);
            }
        }
        if best.0.is_enough(tried, tries) {
            break;
        }
    }
    spinner.finish_and_clear();
    Ok(best)
}

/// Tells whether the service gave up because the request took too long.
pub(super) fn is_late(error: &ClientError) -> bool {
    matches!(error, ClientError::Refused(problem) if problem.code == Code::Deadline)
}

pub(super) async fn constrain(args: ConstrainArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let target = Target::of(&args.out, None);
    target.prepare(ui)?;
    let set = args.set.into_iter().map(|spec| spec.0).collect();
    let edit = ConstraintEdit { set, remove: args.remove, undo: args.undo, on_fold: args.on_fold };
    let query = names::query(&args.query, api, state).await?;
    let id = names::map(query, &args.map, api).await?;
    let map = match api.edit_constraints(query, id, &edit).await {
        Err(ClientError::Refused(problem)) if problem.code == Code::NotFound => {
            return Err(unknown(problem, (query, id), &edit, api).await);
        }
        answer => answer?,
    };
    write_map(&map, None, &target, api, ui).await?.is_enough(None)
}

/// Names what was not found; for an unknown constraint the error lists those that the map has.
async fn unknown(
    problem: Box<Problem>,
    (query, id): (QueryId, MapId),
    edit: &ConstraintEdit,
    api: &Api,
) -> ClientError {
    let named = edit.set.iter().filter_map(|new| new.id.as_ref()).chain(&edit.remove).chain(&edit.undo);
    let maps = api.maps(query).await.unwrap_or_default();
    let Some(map) = maps.into_iter().find(|map| map.id == id) else { return ClientError::Refused(problem) };
    let known: Vec<String> = map.constraints.into_iter().map(|constraint| constraint.id).collect();
    match named.into_iter().find(|id| !known.contains(id)) {
        Some(found) => ClientError::NoSuchConstraint { found: found.clone(), known: known.join(", "), problem },
        None => ClientError::Refused(problem),
    }
}
