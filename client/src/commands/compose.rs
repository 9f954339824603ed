//! `compose` and `retopo`: the maps of all segments in one mesh, and all of it in one go.

use super::{
    choose::finished,
    map::{Written, lay, lay_best, write_map},
    rank::{check_segment, follow_upload, upload},
};
use crate::{
    api::{Api, MeshSource},
    args::{ComposeArgs, ComposeCommand, QueryArgs, RetopoArgs},
    error::ClientError,
    spec::{ExampleRef, UsePart},
    table,
    ui::Ui,
};
use quadmuse_proto::{
    Composition, CompositionPart, Map, NewComposition, Query, Verdict, composition::SMOOTHING_DEFAULT, segment::Parts,
};

/// A map of at most so many faces may pass the input by far; the service is asked to subdivide it where it does.
const COARSE_FACES_MAX: u64 = 500;
/// A mesh with more small holes is a scan full of gaps, and is not cut where nobody asked for it.
const HOLES_CUT_MAX: u32 = 8;

pub(super) async fn compose(args: &ComposeCommand, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    args.compose.out.check()?;
    let query = finished(args.query, api, ui).await?;
    stitch(&query, &args.compose, api, ui).await
}

pub(super) async fn retopo(args: &RetopoArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    args.compose.out.check()?;
    let query = ranked(&args.query, api, ui).await?;
    if query.segments.len() > 1 || args.compose.density.is_some() {
        return stitch(&query, &like_all(&query, args), api, ui).await;
    }
    // One segment needs no stitching: the example's own vertex order, faces, UVs and groups are kept.
    for part in &args.compose.uses {
        check_segment(&query, Some(part.segment))?;
    }
    let told = told(0, &args.compose).or(args.query.like.map(|example| ExampleRef { example, segment: Some(0) }));
    let laid = match told {
        Some(_) => lay(&query, 0, told, api, ui).await,
        None => lay_best(&query, 0, api, ui).await,
    };
    let is_free = told.is_none() && args.query.segments.segments.is_none() && args.query.segments.parts.is_none();
    match laid {
        Ok((map, name)) if is_free && map.verdict == Verdict::Poor => in_parts(&query, &name, args, api, ui).await,
        Ok((map, _)) => followed(&query, map, &args.compose, api, ui).await,
        Err(error @ ClientError::NothingRanked { .. }) if is_free => {
            ui.note(&error.message());
            stitch(&query, &args.compose, api, ui).await
        }
        Err(error) => Err(error),
    }
}

/// Uploads, and follows the ranking to its end.
async fn ranked(args: &QueryArgs, api: &Api, ui: &mut Ui) -> Result<Query, ClientError> {
    let query = upload(args, api, ui).await?;
    Ok(follow_upload(&query, api, ui).await?.summary)
}

/// What no example fits as a whole is cut into its protrusions, each with an example that fits or a regular layout. A scan
/// full of holes is not: cuts would run from hole to hole.
async fn in_parts(whole: &Query, best: &str, args: &RetopoArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let holes = whole.segments.first().map_or(0, |segment| segment.holes);
    if holes > HOLES_CUT_MAX {
        ui.note(&format!(
            "the best example, {best}, fits poorly, and there are {holes} holes; a regular layout takes its place"
        ));
        return compose_maps(whole, Vec::new(), &args.compose, api, ui).await;
    }
    ui.note(&format!("the best example, {best}, fits poorly as a whole; cutting the mesh into parts"));
    let mut again = args.query.clone();
    again.segments.parts = Some(Parts::Auto);
    let query = ranked(&again, api, ui).await?;
    if query.segments.len() > 1 {
        return stitch(&query, &args.compose, api, ui).await;
    }
    ui.note("nothing sticks out of it; a regular layout takes its place");
    compose_maps(whole, Vec::new(), &args.compose, api, ui).await
}

/// Writes a map; subdivided, where it is coarse and passes the input by far.
async fn followed(query: &Query, map: Map, args: &ComposeArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    if map.faces <= COARSE_FACES_MAX {
        let new = NewComposition {
            parts: vec![CompositionPart { segment: 0, map: map.id }],
            smoothing: args.smoothing.unwrap_or(SMOOTHING_DEFAULT),
            density: 0,
            keep: Vec::new(),
        };
        let composition = api.start_composition(query.id, &new).await?;
        // As many quads as the example: it follows the input as it is, and stays whole.
        if composition.quads > map.faces {
            return write_composition(&composition, &[map], args, api, ui).await;
        }
    }
    write_map(&map, &args.out, api, ui).await
}

/// What was cut as an example is takes that example, segment by segment, where nothing else is told.
fn like_all(query: &Query, args: &RetopoArgs) -> ComposeArgs {
    let mut compose = args.compose.clone();
    if let Some(example) = args.query.like {
        let segments = query.segments.iter().map(|s| s.segment);
        let part = |segment| UsePart { segment, example: ExampleRef { example, segment: Some(segment) } };
        compose.uses = segments.map(part).chain(args.compose.uses.iter().copied()).collect();
    }
    compose
}

/// The example that the command line tells a segment to take; the last word counts.
fn told(segment: u32, args: &ComposeArgs) -> Option<ExampleRef> {
    args.uses.iter().rev().find(|part| part.segment == segment).map(|part| part.example)
}

/// Maps every segment, stitches the maps and writes the mesh.
async fn stitch(query: &Query, args: &ComposeArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    for part in &args.uses {
        check_segment(query, Some(part.segment))?;
    }
    let mut maps = Vec::new();
    let count = query.segments.len();
    let bar = ui.bar(count as u64, "mapping");
    for (done, segment) in query.segments.iter().enumerate() {
        let (number, told) = (segment.segment, told(segment.segment, args));
        let laid = match told {
            Some(_) => lay(query, number, told, api, ui).await,
            None => lay_best(query, number, api, ui).await,
        };
        let said = match laid {
            // What nobody asked for and is poor is left to the service, which takes a regular layout.
            Ok((map, name)) if told.is_none() && map.verdict == Verdict::Poor => {
                format!("the best example, {name}, fits poorly; a regular layout takes its place")
            }
            Ok((map, name)) => {
                let said = format!("{name}, {} faces, {}", map.faces, map.verdict.as_str());
                maps.push(map);
                said
            }
            Err(error @ ClientError::NothingRanked { .. }) => format!("a regular layout: {}", error.message()),
            Err(error) => {
                bar.finish_and_clear();
                return Err(error);
            }
        };
        bar.suspend(|| ui.note(&format!("segment {number} ({} of {count}, {}): {said}", done + 1, segment.topology)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    compose_maps(query, maps, args, api, ui).await
}

/// Stitches maps, with regular layouts on the other segments, and writes the mesh.
async fn compose_maps(
    query: &Query,
    maps: Vec<Map>,
    args: &ComposeArgs,
    api: &Api,
    ui: &mut Ui,
) -> Result<(), ClientError> {
    if let Some(density) = args.density {
        ui.note(&table::expected_quads(&maps, query.segments.len(), density));
    }
    let new = NewComposition {
        parts: maps.iter().map(|map| CompositionPart { segment: map.segment, map: map.id }).collect(),
        smoothing: args.smoothing.unwrap_or(SMOOTHING_DEFAULT),
        density: args.density.unwrap_or_default(),
        // Who chose a part wants its layout.
        keep: args.uses.iter().map(|part| part.segment).collect(),
    };
    let spinner = ui.spinner("stitching");
    let composition = api.start_composition(query.id, &new).await;
    spinner.finish_and_clear();
    write_composition(&composition?, &maps, args, api, ui).await
}

async fn write_composition(
    composition: &Composition,
    maps: &[Map],
    args: &ComposeArgs,
    api: &Api,
    ui: &mut Ui,
) -> Result<(), ClientError> {
    let mesh = api.mesh(composition.query, MeshSource::Composition(composition.id), args.out.format).await?;
    args.out.write(&mesh)?;
    let file = args.out.path.display().to_string();
    let verdicts = table::verdicts(maps, composition.templates.len());
    let quads = composition.quads;
    ui.text(&format!("{}\nwritten     {file}: {quads} quads, {verdicts}", table::composition(composition)))?;
    ui.value(&Written { file, message: composition })
}
