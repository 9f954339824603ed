//! `map` and `constrain`: lays an example on the input, and writes the mesh.

use super::{
    choose::{choose, finished},
    deliver::{Target, write_map},
    making::{Awaited, awaited},
    rank::check_segment,
};
use crate::{
    api::Api,
    args::{ConstrainArgs, MapArgs},
    error::ClientError,
    names,
    spec::{ExampleRef, Landmarks, LandmarksSpec},
    state::State,
    ui::Ui,
};
use futures_util::{Stream, StreamExt, stream};
use quadmuse_proto::{
    Beyond, Code, ConstraintEdit, ExampleId, Landmark, Map, MapId, NewMap, Place, Problem, Product, Query, QueryId,
};
use std::collections::BTreeMap;

/// Segments that examples are laid on at a time.
const AT_A_TIME: usize = 2;

pub(super) async fn map(args: &MapArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let target = Target::of(&args.out, args.kept.as_deref()).sized(&args.size);
    target.prepare(ui)?;
    let held = Held::of(args)?;
    let wanted = match &args.example {
        Some(given) => Some(names::example_ref(given, api).await?),
        None => None,
    };
    let query = finished(names::query(&args.query, api, state).await?, api, ui).await?;
    let segment = names::segment(&args.segment, &query.segments)?;
    let (map, name) = lay(&query, segment, wanted, (args.beyond, &held), api, ui).await?;
    held.tell(map.example, api, ui).await?;
    write_map(&map, Some(&name), &target, api, ui).await?.is_enough(args.require)
}

/// The landmarks that a new map is held by: pairs of points, and points of the scan by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Held {
    landmarks: Vec<Landmark>,
    names: BTreeMap<String, Place>,
}

impl Held {
    /// Of the command line and its files.
    fn of(args: &MapArgs) -> Result<Self, ClientError> {
        let mut held = Self { landmarks: args.landmark.iter().map(|spec| spec.0.clone()).collect(), ..Self::default() };
        match &args.landmarks {
            Some(LandmarksSpec::File(file)) => match Landmarks::read(file)? {
                Landmarks::Pairs(pairs) => held.landmarks.extend(pairs),
                Landmarks::Named(named) => held.names.extend(named),
            },
            Some(LandmarksSpec::ByName) if args.names.is_none() => return Err(ClientError::NamesMissing),
            Some(LandmarksSpec::ByName) | None => {}
        }
        if let Some(file) = &args.names {
            held.names.extend(Landmarks::read_named(file)?);
        }
        Ok(held)
    }

    /// Tells which of the names the example has.
    async fn tell(&self, example: ExampleId, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
        if self.names.is_empty() {
            return Ok(());
        }
        let known = api.example(example).await?.landmarks;
        let met = known.iter().filter(|landmark| self.names.contains_key(&landmark.name)).count();
        let (given, of) = (self.names.len(), if self.names.len() == 1 { "name" } else { "names" });
        ui.note(&format!("{met} of {given} {of} that the file gives are landmarks of the example"));
        Ok(())
    }
}

/// Lays an example (the best, unless one is told) on a segment; the map, and the example's name.
pub(super) async fn lay(
    query: &Query,
    segment: u32,
    wanted: Option<ExampleRef>,
    (beyond, held): (Beyond, &Held),
    api: &Api,
    ui: &mut Ui,
) -> Result<(Map, String), ClientError> {
    awaited(mapping(query), laid(query, segment, wanted, (beyond, held), api), api, ui).await
}

/// The same, and says nothing.
async fn laid(
    query: &Query,
    segment: u32,
    wanted: Option<ExampleRef>,
    (beyond, held): (Beyond, &Held),
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
    let choice = choose(query, found, wanted, api).await?;
    let (landmarks, names) = (held.landmarks.clone(), held.names.clone());
    let map = api.start_map(query.id, &NewMap { beyond, landmarks, names, ..choice.new }).await?;
    Ok((map, choice.name))
}

/// A map of a query that is awaited.
pub(super) fn mapping(query: &Query) -> Awaited {
    Awaited { query: query.id, product: Product::Map, what: "mapping" }
}

/// Lays on each of some segments the example that is told; two segments at a time. The answers come in order.
pub(super) fn lay_each<'a>(
    query: &'a Query,
    segments: &'a [(u32, ExampleRef)],
    beyond: Beyond,
    api: &'a Api,
) -> impl Stream<Item = Result<(Map, String), ClientError>> + Unpin {
    let one = move |&(segment, wanted): &'a (u32, ExampleRef)| async move {
        laid(query, segment, Some(wanted), (beyond, &Held::default()), api).await
    };
    Box::pin(stream::iter(segments).map(one).buffered(AT_A_TIME))
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
