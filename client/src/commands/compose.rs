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
    spec::ExampleRef,
    table,
    ui::Ui,
};
use quadmuse_proto::{Composition, CompositionPart, NewComposition, Query, Verdict, composition::SMOOTHING_DEFAULT};

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
        return stitch(&query, &args.compose, api, ui).await;
    }
    // One segment needs no stitching: the example's own vertex order, faces, UVs and groups are kept.
    for part in &args.compose.uses {
        check_segment(&query, Some(part.segment))?;
    }
    let map = lay(&query, 0, told(0, &args.compose), api, ui).await?;
    write_map(&map, &args.compose.out, api, ui).await
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
    let mut parts = Vec::new();
    for segment in query.segments.iter().map(|s| s.segment) {
        let told = told(segment, args);
        match lay(query, segment, told, api, ui).await {
            // What nobody asked for and is poor is left to the service, which takes a regular layout.
            Ok(map) if told.is_none() && map.verdict == Verdict::Poor => {
                ui.note(&format!("segment {segment}: the best example fits poorly; a regular layout takes its place"));
            }
            Ok(map) => parts.push(CompositionPart { segment, map: map.id }),
            Err(error @ ClientError::NothingRanked { .. }) => {
                ui.note(&format!("segment {segment} takes a regular layout: {}", error.message()));
            }
            Err(error) => return Err(error),
        }
    }
    let new = NewComposition {
        parts,
        smoothing: args.smoothing.unwrap_or(SMOOTHING_DEFAULT),
        density: args.density.unwrap_or_default(),
    };
    let spinner = ui.spinner("stitching");
    let composition = api.start_composition(query.id, &new).await;
    spinner.finish_and_clear();
    write_composition(&composition?, args, api, ui).await
}

async fn write_composition(
    composition: &Composition,
    args: &ComposeArgs,
    api: &Api,
    ui: &mut Ui,
) -> Result<(), ClientError> {
    let mesh = api.mesh(composition.query, MeshSource::Composition(composition.id), args.out.format).await?;
    args.out.write(&mesh)?;
    let file = args.out.path.display().to_string();
    ui.text(&format!("{}\nwritten     {file}", table::composition(composition)))?;
    ui.value(&Written { file, message: composition })
}
