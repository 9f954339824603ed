//! `compose` and `retopo`: the maps of all segments in one mesh, and all of it in one go.

use super::{
    choose::finished,
    map::{Written, lay, write_map},
    rank::{check_segment, follow_upload, upload},
};
use crate::{
    api::{Api, MeshSource},
    args::{ComposeArgs, ComposeCommand, RetopoArgs},
    error::ClientError,
    spec::{ExampleRef, UsePart},
    table,
    ui::Ui,
};
use quadmuse_proto::{
    Composition, CompositionPart, Map, NewComposition, Query, Verdict, composition::SMOOTHING_DEFAULT,
};

/// A map of at most so many faces may pass the input by far; the service is asked to subdivide it where it does.
const COARSE_FACES_MAX: u64 = 500;

pub(super) async fn compose(args: &ComposeCommand, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    args.compose.out.check()?;
    let query = finished(args.query, api, ui).await?;
    stitch(&query, &args.compose, api, ui).await
}

pub(super) async fn retopo(args: &RetopoArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    args.compose.out.check()?;
    let query = upload(&args.query, api, ui).await?;
    let query = follow_upload(&query, api, ui).await?.summary;
    if query.segments.len() > 1 || args.compose.density.is_some() {
        return stitch(&query, &like_all(&query, args), api, ui).await;
    }
    // One segment needs no stitching: the example's own vertex order, faces, UVs and groups are kept.
    for part in &args.compose.uses {
        check_segment(&query, Some(part.segment))?;
    }
    let told = told(0, &args.compose).or(args.query.like.map(|example| ExampleRef { example, segment: Some(0) }));
    let (map, _) = lay(&query, 0, told, api, ui).await?;
    if map.faces <= COARSE_FACES_MAX {
        let new = NewComposition {
            parts: vec![CompositionPart { segment: 0, map: map.id }],
            smoothing: args.compose.smoothing.unwrap_or(SMOOTHING_DEFAULT),
            density: 0,
            keep: Vec::new(),
        };
        let composition = api.start_composition(query.id, &new).await?;
        // As many quads as the example: it follows the input as it is, and stays whole.
        if composition.quads > map.faces {
            return write_composition(&composition, &[map], &args.compose, api, ui).await;
        }
    }
    write_map(&map, &args.compose.out, api, ui).await
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
    let (mut parts, mut maps) = (Vec::new(), Vec::new());
    let count = query.segments.len();
    let bar = ui.bar(count as u64, "mapping");
    for (done, segment) in query.segments.iter().enumerate() {
        let (number, told) = (segment.segment, told(segment.segment, args));
        let said = match lay(query, number, told, api, ui).await {
            // What nobody asked for and is poor is left to the service, which takes a regular layout.
            Ok((map, name)) if told.is_none() && map.verdict == Verdict::Poor => {
                format!("the best example, {name}, fits poorly; a regular layout takes its place")
            }
            Ok((map, name)) => {
                parts.push(CompositionPart { segment: number, map: map.id });
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
    if let Some(density) = args.density {
        ui.note(&table::expected_quads(&maps, count, density));
    }
    let new = NewComposition {
        parts,
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
