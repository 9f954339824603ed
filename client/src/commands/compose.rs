//! `compose` and `retopo`: the maps of all segments in one mesh, and all of it in one go.

use super::{
    choose::finished,
    deliver::{Delivered, Target, write_composition, write_kept, write_map},
    making::{Awaited, awaited},
    map::{Held, lay, lay_each, mapping},
    rank::{again, check_segment, follow_upload, remember, upload},
    screen::Wanted,
};
use crate::{
    api::Api,
    args::{ComposeArgs, ComposeCommand, LayArgs, QueryArgs, RetopoArgs},
    error::ClientError,
    names,
    spec::{ExampleRef, SegmentRef, UsePart},
    state::State,
    table,
    ui::Ui,
};
use futures_util::StreamExt;
use quadmuse_proto::{
    Composition, CompositionPart, ExampleId, Map, NewComposition, NewRetopo, Product, Query, QuerySegment,
    RetopoResult, Verdict, composition::SMOOTHING_DEFAULT,
};
use std::collections::BTreeMap;

/// How to compose: the flags, the examples that they name, and where it goes.
#[derive(Clone)]
pub(super) struct Wish<'a> {
    /// The flags.
    pub(super) lay: &'a LayArgs,
    /// Which segments take which examples.
    pub(super) uses: Vec<UsePart>,
    /// Where the result goes.
    pub(super) target: Target,
}

impl Wish<'_> {
    /// What was cut as an example is takes that example, segment by segment, where nothing else is told.
    fn like_all(&self, query: &Query, like: Option<ExampleId>) -> Self {
        let part = |example, segment| UsePart { segment, example: ExampleRef { example, segment: Some(segment) } };
        let alike = like.into_iter().flat_map(|example| query.segments.iter().map(move |s| part(example, s.segment)));
        Self { uses: alike.chain(self.uses.iter().copied()).collect(), ..self.clone() }
    }
}

pub(super) async fn compose(args: &ComposeCommand, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let target = target(&args.compose, ui)?;
    let id = names::query(&args.query, api, state).await?;
    let has_names = args.compose.lay.uses.iter().any(|part| matches!(part.segment, SegmentRef::Named(_)));
    // What is misspelt is told before the ranking is waited for.
    let segments = if has_names { api.query(id).await?.segments } else { Vec::new() };
    let wish = wish(&args.compose.lay, target, &segments, api).await?;
    let query = finished(id, api, ui).await?;
    stitch(&query, &wish, api, ui).await?.is_enough(wish.lay.require)
}

pub(super) async fn retopo(args: &RetopoArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let target = target(&args.compose, ui)?;
    // A scan that is yet to be sent has no names.
    let wish = wish(&args.compose.lay, target, &[], api).await?;
    let require = wish.lay.require;
    make(&args.query, wish, api, state, ui).await?.is_enough(require)
}

fn target(args: &ComposeArgs, ui: &mut Ui) -> Result<Target, ClientError> {
    let target = Target::of(&args.out, args.kept.as_deref()).sized(&args.lay.size);
    target.prepare(ui)?;
    Ok(target)
}

/// The flags, with what their names stand for.
async fn wish<'a>(
    lay: &'a LayArgs,
    target: Target,
    segments: &[QuerySegment],
    api: &Api,
) -> Result<Wish<'a>, ClientError> {
    Ok(Wish { lay, uses: names::uses(&lay.uses, segments, api).await?, target })
}

/// All of it in one go: uploads a scan, ranks, maps or composes, and writes the mesh.
///
/// # Errors
/// The scan can't be read, the service refuses or is out of reach, or a file can't be written.
pub(super) async fn make(
    args: &QueryArgs,
    wish: Wish<'_>,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let query = upload(args, api, state, ui).await?;
    match made(args, &query, &wish, api, state, ui).await {
        // Of several servers the one that had the scan died: another goes on, from what is kept of it.
        Err(ClientError::OwnerGone { query, .. }) => {
            let query = again(query, api, state, ui).await?;
            made(args, &query, &wish, api, state, ui).await
        }
        made => made,
    }
}

/// The same, once the scan was sent.
async fn made(
    args: &QueryArgs,
    query: &Query,
    wish: &Wish<'_>,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let like = match &args.rank.like {
        Some(name) => Some(names::example(name, api).await?),
        None => None,
    };
    let query = follow_upload(query, Wanted::Outcome, api, ui).await?.summary;
    let wish = wish.like_all(&query, like);
    if wish.uses.is_empty() {
        return retopologised(&query, &wish, api, state, ui).await;
    }
    match (&query.segments[..], wish.lay.density, chosen_examples(&wish).get(&0)) {
        ([_], None, Some(&only)) => {
            check_uses(&query, &wish)?;
            // Who chose an example wants it as it is.
            let (map, name) = lay(&query, 0, Some(only), (wish.lay.beyond, &Held::default()), api, ui).await?;
            write_map(&map, Some(&name), &wish.target, api, ui).await
        }
        _ => stitch(&query, &wish, api, ui).await,
    }
}

/// Has the service make quads for a scan for which nothing was chosen, and writes them.
async fn retopologised(
    query: &Query,
    wish: &Wish<'_>,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let LayArgs { beyond, smoothing, density, .. } = *wish.lay;
    let new = NewRetopo { beyond, smoothing: smoothing.unwrap_or(SMOOTHING_DEFAULT), density };
    let wanted = Awaited { query: query.id, product: Product::Retopo, what: "laying examples" };
    let made = awaited(wanted, api.start_retopo(query.id, &new), api, ui).await?;
    made.notes.iter().for_each(|note| ui.note(note));
    let of = match made.result_query == query.id {
        true => query.clone(),
        false => api.query(made.result_query).await?,
    };
    if of.id != query.id {
        remember(&of, api, state, ui);
    }
    match made.result {
        RetopoResult::Map(id) => {
            let map = api.map(of.id, id).await?;
            write_map(&map, Some(&name_of(&map, api).await), &wish.target, api, ui).await
        }
        RetopoResult::Composition(id) => {
            let made = api.composition(of.id, id).await?;
            composed(&of, &made, wish, api, ui).await
        }
    }
}

/// The example that each segment is told to take; the last word counts.
fn chosen_examples(wish: &Wish<'_>) -> BTreeMap<u32, ExampleRef> {
    wish.uses.iter().map(|part| (part.segment, part.example)).collect()
}

fn check_uses(query: &Query, wish: &Wish<'_>) -> Result<(), ClientError> {
    wish.uses.iter().try_for_each(|part| check_segment(query, Some(part.segment)))
}

/// Lays the examples that were chosen, has the service stitch them with the best for all other segments, and writes the mesh.
async fn stitch(query: &Query, wish: &Wish<'_>, api: &Api, ui: &mut Ui) -> Result<Delivered, ClientError> {
    check_uses(query, wish)?;
    let chosen: Vec<(u32, ExampleRef)> = chosen_examples(wish).into_iter().collect();
    let bar = ui.bar(chosen.len() as u64, "mapping");
    let mut each = lay_each(query, &chosen, wish.lay.beyond, api);
    let mut maps = Vec::new();
    while let Some(laid) = awaited(mapping(query), each.next(), api, ui).await {
        maps.push(laid.inspect_err(|_| bar.finish_and_clear())?.0);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(density) = wish.lay.density
        && !maps.is_empty()
    {
        ui.note(&table::expected_quads(&maps, query.segments.len(), density));
    }
    let new = new_composition(&maps, wish);
    let wanted = Awaited { query: query.id, product: Product::Composition, what: "stitching" };
    let made = awaited(wanted, api.start_composition(query.id, &new), api, ui).await?;
    composed(query, &made, wish, api, ui).await
}

fn new_composition(maps: &[Map], Wish { lay, uses, .. }: &Wish<'_>) -> NewComposition {
    NewComposition {
        parts: maps.iter().map(|map| CompositionPart { segment: map.segment, map: map.id }).collect(),
        smoothing: lay.smoothing.unwrap_or(SMOOTHING_DEFAULT),
        density: lay.density.unwrap_or_default(),
        // Who chose a part wants its layout.
        keep: uses.iter().map(|part| part.segment).collect(),
        beyond: lay.beyond,
    }
}

/// Tells what each segment of a composition took, and writes the mesh.
async fn composed(
    query: &Query,
    made: &Composition,
    wish: &Wish<'_>,
    api: &Api,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let mut maps = if made.parts.is_empty() { Vec::new() } else { api.maps(query.id).await? };
    maps.retain(|map| made.parts.iter().any(|part| part.map == map.id));
    maps.sort_by_key(|map| map.segment);
    for (k, map) in maps.iter().enumerate() {
        let Some(segment) = query.segments.iter().find(|segment| segment.segment == map.segment) else { continue };
        let name = name_of(map, api).await;
        ui.note(&chosen(segment, k + 1, maps.len(), &fitting(map, &name)));
    }
    // Where there is but one example, its kept vertices can be told.
    if let [only] = &maps[..] {
        write_kept(only, &wish.target)?;
    }
    write_composition(made, &maps, &wish.target, api, ui).await
}

/// The name of a map's example, or its id where it has none, or was removed meanwhile.
async fn name_of(map: &Map, api: &Api) -> String {
    if map.example == ExampleId::TEMPLATE {
        return "a regular layout".into();
    }
    let name = api.example(map.example).await.map(|example| example.name).unwrap_or_default();
    if name.is_empty() { map.example.to_string() } else { name }
}

/// What a segment takes, in a line.
fn chosen(segment: &QuerySegment, number: usize, count: usize, what: &str) -> String {
    let of = table::segment(segment.segment, segment.name.as_deref());
    format!("{of} ({number} of {count}, {}): {what}", segment.topology)
}

/// An example that was laid, and how well it fits. One that is broken may still serve, where stitching covers what it leaves bare; the
/// verdict on the whole follows.
fn fitting(map: &Map, name: &str) -> String {
    let word = match map.verdict {
        Verdict::Broken => "broken by itself",
        verdict => verdict.as_str(),
    };
    format!("{name}, {} faces, {word}", map.faces)
}
