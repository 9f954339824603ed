//! `compose` and `retopo`: the maps of all segments in one mesh, and all of it in one go.

use super::{
    choose::{best_score, finished, in_turn, score},
    deliver::{Delivered, Target, write_composition, write_kept, write_map},
    making::{Awaited, awaited},
    map::{Held, is_late, lay, lay_best, lay_each, mapping},
    rank::{again, check_segment, follow_upload, remember, start, upload},
    screen::Wanted,
};
use crate::{
    api::Api,
    args::{ComposeArgs, ComposeCommand, LayArgs, QueryArgs, RetopoArgs},
    error::ClientError,
    follow, names,
    spec::{ExampleRef, SegmentRef, UsePart},
    state::State,
    table,
    ui::Ui,
};
use futures_util::StreamExt;
use quadmuse_proto::{
    Composition, CompositionPart, ExampleId, Map, NewComposition, Product, Query, QuerySegment, Verdict,
    composition::{AS_MAPPED, INSPIRED_LEAST, SMOOTHING_DEFAULT},
    segment::Parts,
};
use std::cmp::Reverse;

/// A mesh with more small holes is a scan full of gaps, and is not cut where nobody asked for it.
const HOLES_CUT_MAX: u32 = 8;

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
    match made(args, None, &wish, api, state, ui).await {
        // Of several servers the one that had the scan died: another goes on, from what is kept of it.
        Err(ClientError::OwnerGone { query, .. }) => {
            let query = again(query, api, state, ui).await?;
            made(args, Some(query), &wish, api, state, ui).await
        }
        made => made,
    }
}

/// The same, from a query that was started already if one is given.
async fn made(
    args: &QueryArgs,
    started: Option<Query>,
    wish: &Wish<'_>,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let like = match &args.rank.like {
        Some(name) => Some(names::example(name, api).await?),
        None => None,
    };
    let query = ranked(args, started, api, state, ui).await?;
    let asked = &args.rank.segments;
    let is_uncut = like.is_none() && asked.segments.is_none() && asked.parts.is_none() && wish.uses.is_empty();
    if query.segments.len() > 1 || wish.lay.density.is_some() {
        let wish = wish.like_all(&query, like);
        let made = composed(&query, &wish, api, ui).await?;
        let figure = match is_uncut && !made.is_most() && may_be_cut(&query, ui) {
            true => tried(at_waist(&query, (args, &wish), api, state, ui).await, ui)?,
            false => None,
        };
        let best = match figure {
            Some(figure) => made.or_better(figure.made),
            None => made,
        };
        return best.written(&wish, api, ui).await;
    }
    for part in &wish.uses {
        check_segment(&query, Some(part.segment))?;
    }
    let told = told(0, wish).or(like.map(|example| ExampleRef { example, segment: Some(0) }));
    if told.is_some() {
        // Who chose an example wants it as it is.
        let (map, name) = lay(&query, 0, told, (wish.lay.beyond, &Held::default()), api, ui).await?;
        return write_map(&map, Some(&name), &wish.target, api, ui).await;
    }
    let Some(only) = query.segments.first().filter(|only| only.tries > 0) else {
        return stitch(&query, wish, api, ui).await;
    };
    // What is worth one try alone has too few faces to be cut.
    let is_free = is_uncut && only.tries > 1;
    let best = match lay_best(&query, only, wish.lay.beyond, api, ui).await {
        Err(error) if is_late(&error) => {
            ui.note(&error.message());
            return stitch(&query, wish, api, ui).await;
        }
        best => best?,
    };
    match &best {
        None => ui.note("no example lies well on all of it"),
        Some((map, name)) if map.verdict.is_poor() => {
            ui.note(&format!("the best example, {name}, fits poorly as a whole"));
        }
        Some(_) => {}
    }
    let best = best.filter(|(map, _)| !map.verdict.is_poor());
    let is_cut = is_free && may_be_cut(&query, ui);
    // A regular layout of the whole is wanted only where its parts have nothing better.
    let whole = match best.is_none() && is_cut {
        true => None,
        false => Some(settled(&query, best, wish, api, ui).await?),
    };
    let is_enough = whole.as_ref().is_some_and(Outcome::is_most);
    let parts = match is_cut && !is_enough {
        true => tried(in_parts(&query, (args, wish), api, state, ui).await, ui)?,
        false => None,
    };
    let result = match (whole, parts) {
        (Some(whole), Some(parts)) => whole.or_better(parts),
        (Some(whole), None) => whole,
        (None, Some(parts)) if parts.share() > 0.0 => parts,
        // What the parts came to is broken, or nobody's quads: those of the whole have no seams.
        (None, _) => settled(&query, None, wish, api, ui).await?,
    };
    result.written(wish, api, ui).await
}

/// Uploads, unless that was done, and follows the ranking to its end.
async fn ranked(
    args: &QueryArgs,
    started: Option<Query>,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Query, ClientError> {
    let query = match started {
        Some(query) => query,
        None => upload(args, api, state, ui).await?,
    };
    Ok(follow_upload(&query, Wanted::Outcome, api, ui).await?.summary)
}

/// The result for a scan, before it is written.
#[derive(Clone)]
enum Outcome {
    /// A map as it is, and the name of its example.
    Map(Box<Map>, String),
    /// A composition, and the maps that it was made of.
    Composition(Box<Composition>, Vec<Map>),
}

/// Examples that make up this share of a scan are most of it.
const MOST: f64 = 0.5;

impl Outcome {
    /// The share of the scan that has an example's quads; nothing that is broken is worth anything.
    fn share(&self) -> f64 {
        let (verdict, share) = match self {
            // Rows that continue the example beyond its rim are not counted there.
            Self::Map(map, _) => (map.verdict, map.covers.input),
            Self::Composition(made, _) => (made.verdict, made.inspired * made.covers.input),
        };
        if verdict == Verdict::Broken { 0.0 } else { share }
    }

    fn is_most(&self) -> bool {
        self.share() >= MOST
    }

    /// This one, unless examples make up more of the other.
    fn or_better(self, other: Self) -> Self {
        if other.share() > self.share() { other } else { self }
    }

    async fn written(self, wish: &Wish<'_>, api: &Api, ui: &mut Ui) -> Result<Delivered, ClientError> {
        match self {
            Self::Map(map, name) => write_map(&map, Some(&name), &wish.target, api, ui).await,
            Self::Composition(made, maps) => {
                // Of a scan of one segment there is one example, whose kept vertices can be told.
                if let [only] = &maps[..] {
                    write_kept(only, &wish.target)?;
                }
                write_composition(&made, &maps, &wish.target, api, ui).await
            }
        }
    }
}

/// Tells whether a scan may be cut where nobody asked for it: one full of holes is not, since cuts would run from hole to hole.
fn may_be_cut(query: &Query, ui: &mut Ui) -> bool {
    let holes = query.segments.iter().map(|segment| segment.holes).max().unwrap_or(0);
    if holes > HOLES_CUT_MAX {
        ui.note(&format!("with {holes} holes the mesh is not cut into parts"));
    }
    holes <= HOLES_CUT_MAX
}

/// The result of laying examples on the parts of a scan: parted at its waist, as a figure from its base, and where that helps little, cut into
/// its protrusions, each with an example that fits or a regular layout. `None` where it has no parts.
async fn in_parts(
    whole: &Query,
    (args, wish): (&QueryArgs, &Wish<'_>),
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Option<Outcome>, ClientError> {
    let figure = match tried(at_waist(whole, (args, wish), api, state, ui).await, ui)? {
        Some(Figure { made, is_enough: true }) => return Ok(Some(made)),
        figure => figure.map(|figure| figure.made),
    };
    ui.note("cutting the mesh into parts");
    let parts = tried(cut_and_composed((args, wish), api, state, ui).await, ui)?;
    Ok(match (parts, figure) {
        (Some(parts), Some(figure)) => Some(parts.or_better(figure)),
        (one, other) => one.or(other),
    })
}

/// A scan cut into its protrusions, with what examples make of them; `None` where it has none.
async fn cut_and_composed(
    (args, wish): (&QueryArgs, &Wish<'_>),
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Option<Outcome>, ClientError> {
    let is_cut = |query: &Query| query.segments.len() > 1;
    let Some(query) = cut(args, (Parts::Auto, is_cut), f64::INFINITY, api, state, ui).await? else {
        ui.note("no parts were found");
        return Ok(None);
    };
    if in_reach(&query, api).await? >= INSPIRED_LEAST {
        let maps = mapped(&query, (wish, INSPIRED_LEAST), api, ui).await?;
        if maps.iter().map(|map| inspired_by(map, &query)).sum::<f64>() >= INSPIRED_LEAST {
            return stitched_of(&query, maps, wish, api, ui).await.map(Some);
        }
    }
    ui.note("no example fits enough of its parts");
    Ok(None)
}

/// The share of a scan's faces in segments that some example may be laid on.
async fn in_reach(query: &Query, api: &Api) -> Result<f64, ClientError> {
    let mut share = 0.0;
    for segment in query.segments.iter().filter(|segment| segment.tries > 0) {
        if !in_turn(query, segment.segment, api).await?.is_empty() {
            share += share_of(query, segment.segment);
        }
    }
    Ok(share)
}

/// The share of a scan that has a map's quads.
fn inspired_by(map: &Map, query: &Query) -> f64 {
    map.covers.input * share_of(query, map.segment)
}

/// The share of a scan's faces that a segment has.
fn share_of(query: &Query, segment: u32) -> f64 {
    let all: u64 = query.segments.iter().map(|segment| segment.faces).sum();
    let of: u64 = query.segments.iter().filter(|s| s.segment == segment).map(|segment| segment.faces).sum();
    of as f64 / all.max(1) as f64
}

/// The result of one of several tries; nothing where the service refused it, since there are others to fall back on.
fn tried<T>(found: Result<Option<T>, ClientError>, ui: &mut Ui) -> Result<Option<T>, ClientError> {
    match found {
        Err(error @ ClientError::Refused(_)) => {
            ui.note(&error.message());
            Ok(None)
        }
        found => found,
    }
}

/// A scan parted at its waist.
struct Figure {
    made: Outcome,
    /// True where examples make up most of the side that they are on: there is no need to look further.
    is_enough: bool,
}

/// The same scan, cut otherwise and ranked again; `None` where it was not cut: it would only be ranked as before. `None`,
/// too, and ranked no further, where the pictures of no segment have a score less than `below`.
async fn cut(
    args: &QueryArgs,
    (parts, is_cut): (Parts, fn(&Query) -> bool),
    below: f64,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Option<Query>, ClientError> {
    let mut args = args.clone();
    args.rank.segments.parts = Some(parts);
    let query = start(&args, api, ui).await?;
    if !is_cut(&query) || !has_score(&query, below, api).await? {
        api.remove_query(query.id).await?;
        return Ok(None);
    }
    remember(&query, api, state, ui);
    ranked(&args, Some(query), api, state, ui).await.map(Some)
}

/// Tells whether the best picture for some segment that may take an example has a score less than `below`.
async fn has_score(query: &Query, below: f64, api: &Api) -> Result<bool, ClientError> {
    if below == f64::INFINITY {
        return Ok(true);
    }
    for segment in query.segments.iter().filter(|segment| segment.tries > 0) {
        let ranking = follow::compared(api, query.id, segment.segment).await?;
        if score(&ranking) < below {
            return Ok(true);
        }
    }
    Ok(false)
}

/// A scan parted at its waist, such as a figure from its base, with the example that fits one side of it best and what lies around
/// that; `None` where it has no waist, or no example fits a side, or is more like it than like the `whole`.
async fn at_waist(
    whole: &Query,
    (args, wish): (&QueryArgs, &Wish<'_>),
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Option<Figure>, ClientError> {
    // Parts of a scan are liker to parts of examples than a side is to a whole: those scores don't compare.
    let as_whole = match &whole.segments[..] {
        [only] => best_score(whole, only.segment, api).await?,
        _ => f64::INFINITY,
    };
    let is_cut = |query: &Query| query.waist;
    let Some(query) = cut(args, (Parts::Waist, is_cut), as_whole, api, state, ui).await? else { return Ok(None) };
    // A figure is more like an example than with its base, and more than its base is.
    let mut sides = Vec::new();
    for side in query.segments.iter().filter(|side| side.tries > 0) {
        let score = best_score(&query, side.segment, api).await?;
        if score < as_whole {
            sides.push((score, side));
        }
    }
    sides.sort_by(|a, b| a.0.total_cmp(&b.0));
    if sides.is_empty() {
        return Ok(None);
    }
    ui.note("parting it at its waist, as a figure from its base");
    let mut best: Option<Figure> = None;
    for (_, side) in sides {
        let Some((map, name)) = lay_well(&query, side, wish, api, ui).await? else { continue };
        ui.note(&chosen(side, 1, 2, &fitting(&map, &name)));
        let composition = stitched(&query, &new_composition(std::slice::from_ref(&map), wish), api, ui).await?;
        let maps = if composition.parts.is_empty() { Vec::new() } else { vec![map] };
        let made = Outcome::Composition(Box::new(composition), maps);
        let (share, of) = (made.share(), share_of(&query, side.segment));
        if share > best.as_ref().map_or(0.0, |best| best.made.share()) {
            best = Some(Figure { made, is_enough: share >= MOST * of });
        }
        if best.as_ref().is_some_and(|best| best.is_enough) {
            break;
        }
    }
    Ok(best)
}

/// The best map of a segment, and its example's name, unless it is poor or there is none.
async fn lay_well(
    query: &Query,
    segment: &QuerySegment,
    wish: &Wish<'_>,
    api: &Api,
    ui: &mut Ui,
) -> Result<Option<(Map, String)>, ClientError> {
    match lay_best(query, segment, wish.lay.beyond, api, ui).await {
        Err(error) if is_late(&error) => Ok(None),
        found => found.map(|found| found.filter(|(map, _)| !map.verdict.is_poor())),
    }
}

/// The service's result for the best map of a single segment, which is not poor: the map itself, with the example's own vertex order,
/// faces, UVs and groups, where it follows the input; else what is composed of it. Without a map, a regular layout.
async fn settled(
    query: &Query,
    best: Option<(Map, String)>,
    wish: &Wish<'_>,
    api: &Api,
    ui: &mut Ui,
) -> Result<Outcome, ClientError> {
    let Some((map, name)) = best else {
        let regular = stitched(query, &new_composition(&[], wish), api, ui).await?;
        return Ok(Outcome::Composition(Box::new(regular), Vec::new()));
    };
    let composition = match stitched(query, &new_composition(std::slice::from_ref(&map), wish), api, ui).await {
        Err(error) if is_late(&error) => {
            ui.note(&format!("it is as it was mapped: {}", error.message()));
            return Ok(Outcome::Map(Box::new(map), name));
        }
        stitched => stitched?,
    };
    // What the composition says against the whole mesh, the map does not know.
    if composition.notes.iter().any(|note| note == AS_MAPPED) && composition.verdict <= map.verdict {
        return Ok(Outcome::Map(Box::new(map), name));
    }
    if let [segment] = &query.segments[..] {
        ui.note(&chosen(segment, 1, 1, &fitting(&map, &name)));
    }
    let maps = if composition.parts.is_empty() { Vec::new() } else { vec![map] };
    Ok(Outcome::Composition(Box::new(composition), maps))
}

/// What the service stitches.
async fn stitched(query: &Query, new: &NewComposition, api: &Api, ui: &Ui) -> Result<Composition, ClientError> {
    let wanted = Awaited { query: query.id, product: Product::Composition, what: "stitching" };
    awaited(wanted, api.start_composition(query.id, new), api, ui).await
}

fn new_composition(maps: &[Map], Wish { lay, uses, .. }: &Wish<'_>) -> NewComposition {
    NewComposition {
        parts: maps.iter().map(|map| CompositionPart { segment: map.segment, map: map.id }).collect(),
        smoothing: lay.smoothing.unwrap_or(SMOOTHING_DEFAULT),
        density: lay.density.unwrap_or_default(),
        // Who chose a part wants its layout.
        keep: uses.iter().map(|part| part.segment).collect(),
    }
}

/// The example that the command line tells a segment to take; the last word counts.
fn told(segment: u32, wish: &Wish<'_>) -> Option<ExampleRef> {
    wish.uses.iter().rev().find(|part| part.segment == segment).map(|part| part.example)
}

/// What a segment takes, in a line.
fn chosen(segment: &QuerySegment, number: usize, count: usize, what: &str) -> String {
    let of = table::segment(segment.segment, segment.name.as_deref());
    format!("{of} ({number} of {count}, {}): {what}", segment.topology)
}

/// An example that was laid, and how well it fits.
fn fitting(map: &Map, name: &str) -> String {
    format!("{name}, {} faces, {}", map.faces, map.verdict.as_str())
}

/// Maps every segment, stitches the maps and writes the mesh.
async fn stitch(query: &Query, wish: &Wish<'_>, api: &Api, ui: &mut Ui) -> Result<Delivered, ClientError> {
    composed(query, wish, api, ui).await?.written(wish, api, ui).await
}

/// Maps every segment, and stitches the maps.
async fn composed(query: &Query, wish: &Wish<'_>, api: &Api, ui: &mut Ui) -> Result<Outcome, ClientError> {
    let maps = mapped(query, (wish, 0.0), api, ui).await?;
    if let Some(density) = wish.lay.density {
        ui.note(&table::expected_quads(&maps, query.segments.len(), density));
    }
    stitched_of(query, maps, wish, api, ui).await
}

/// Stitches maps, and leaves out those that gave way.
async fn stitched_of(
    query: &Query,
    mut maps: Vec<Map>,
    wish: &Wish<'_>,
    api: &Api,
    ui: &Ui,
) -> Result<Outcome, ClientError> {
    let composition = stitched(query, &new_composition(&maps, wish), api, ui).await?;
    maps.retain(|map| composition.parts.iter().any(|part| part.segment == map.segment));
    Ok(Outcome::Composition(Box::new(composition), maps))
}

/// The maps of all segments, but for those that nobody chose and that are poor. Ends early where less than a share `least` of the
/// scan can still come to have an example's quads.
async fn mapped(
    query: &Query,
    (wish, least): (&Wish<'_>, f64),
    api: &Api,
    ui: &mut Ui,
) -> Result<Vec<Map>, ClientError> {
    for part in &wish.uses {
        check_segment(query, Some(part.segment))?;
    }
    let mut maps = Vec::new();
    let mut mapped: Vec<&QuerySegment> =
        query.segments.iter().filter(|s| s.tries > 0 || told(s.segment, wish).is_some()).collect();
    mapped.sort_by_key(|segment| Reverse(segment.faces));
    let count = mapped.len();
    if count < query.segments.len() {
        let (left, all) = (query.segments.len() - count, query.segments.len());
        ui.note(&format!("{left} of {all} segments have too few faces for an example; they take regular layouts"));
    }
    let bar = ui.bar(count as u64, "mapping");
    let asked: Vec<_> = mapped.into_iter().map(|segment| (segment, told(segment.segment, wish))).collect();
    let mut each = lay_each(query, asked.clone(), wish.lay.beyond, api);
    let mut in_reach: f64 = asked.iter().map(|(segment, _)| share_of(query, segment.segment)).sum();
    for (done, (segment, told)) in asked.into_iter().enumerate() {
        if in_reach < least {
            break;
        }
        let Some(laid) = awaited(mapping(query), each.next(), api, ui).await else { break };
        in_reach -= share_of(query, segment.segment);
        let said = match laid {
            Ok(None) => "no example lies well on it".into(),
            // What nobody asked for and is poor is left to the service, which says what takes its place.
            Ok(Some((map, name))) if told.is_none() && map.verdict.is_poor() => {
                format!("the best example, {name}, fits poorly")
            }
            Ok(Some((map, name))) => {
                let said = fitting(&map, &name);
                in_reach += inspired_by(&map, query);
                maps.push(map);
                said
            }
            Err(error) if told.is_none() && is_late(&error) => error.message(),
            Err(error) => {
                bar.finish_and_clear();
                return Err(error);
            }
        };
        bar.suspend(|| ui.note(&chosen(segment, done + 1, count, &said)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    maps.sort_by_key(|map| map.segment);
    Ok(maps)
}
