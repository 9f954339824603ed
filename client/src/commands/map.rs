//! `map` and `constrain`: lays an example on the input, and writes the mesh.

use super::{
    choose::{choose, finished, promising},
    rank::check_segment,
};
use crate::{
    api::{Api, MeshSource},
    args::{ConstrainArgs, MapArgs},
    error::ClientError,
    file::OutFile,
    names,
    spec::{ExampleRef, Require},
    state::State,
    table,
    ui::Ui,
};
use quadmuse_proto::{Beyond, ConstraintEdit, Landmark, Map, NewMap, Query, Verdict};
use serde::Serialize;
use std::path::Path;

/// What programs get: the message, and the file that was written.
#[derive(Serialize)]
pub(super) struct Written<'a, T> {
    pub(super) file: String,
    #[serde(flatten)]
    pub(super) message: &'a T,
}

pub(super) async fn map(args: &MapArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    args.out.check()?;
    let landmarks = landmarks(args)?;
    let told = match &args.example {
        Some(told) => Some(names::example_ref(told, api).await?),
        None => None,
    };
    let query = finished(names::query(&args.query, api, state).await?, api, ui).await?;
    let (map, name) = lay(&query, args.segment, told, (args.beyond, landmarks), api, ui).await?;
    write_kept(&map, args.kept.as_deref())?;
    write_map(&map, Some(&name), &args.out, args.require, api, ui).await
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

/// Writes the numbers of the example's vertices that a map has, one a line.
pub(super) fn write_kept(map: &Map, file: Option<&Path>) -> Result<(), ClientError> {
    let Some(file) = file else { return Ok(()) };
    let all: Vec<u32> = (0..u32::try_from(map.own_vertices).unwrap_or(u32::MAX)).collect();
    let kept = map.kept.as_ref().unwrap_or(&all);
    let text: String = kept.iter().map(|v| format!("{v}\n")).collect();
    crate::file::write(file, text.as_bytes())
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
    check_segment(query, Some(segment))?;
    let Some(found) = query.segments.iter().find(|candidate| candidate.segment == segment) else {
        return Err(ClientError::NoSuchSegment {
            query: query.id.to_string(),
            segment,
            segments: query.segments.len(),
        });
    };
    let choice = choose(query, found, told, api).await?;
    let spinner = ui.spinner("mapping");
    let map = api.start_map(query.id, &NewMap { beyond, landmarks, ..choice.new }).await;
    spinner.finish_and_clear();
    Ok((map?, choice.name))
}

/// First entries of the ranking of a single segment that are laid where nobody chose one.
const TRIES: usize = 3;

/// Lays on a segment the first of the ranking's few best examples whose map is not poor, or else the best; the map, and
/// the example's name.
pub(super) async fn lay_best(
    query: &Query,
    segment: u32,
    beyond: Beyond,
    api: &Api,
    ui: &mut Ui,
) -> Result<(Map, String), ClientError> {
    let best = lay(query, segment, None, (beyond, Vec::new()), api, ui).await?;
    if !best.0.verdict.is_poor() {
        return Ok(best);
    }
    for other in promising(query, segment, TRIES, api).await?.into_iter().skip(1) {
        let found = lay(query, segment, Some(other), (beyond, Vec::new()), api, ui).await?;
        if !found.0.verdict.is_poor() {
            return Ok(found);
        }
    }
    Ok(best)
}

/// Downloads the mesh of a map, writes it, and tells how good it is; with the example's name, where it is known.
pub(super) async fn write_map(
    map: &Map,
    name: Option<&str>,
    out: &OutFile,
    require: Option<Require>,
    api: &Api,
    ui: &mut Ui,
) -> Result<(), ClientError> {
    let mesh = api.mesh(map.query, MeshSource::Map(map.id), out.format).await?;
    out.write(&mesh)?;
    let file = out.path.display().to_string();
    ui.text(&format!("{}\nwritten    {file}: {}, {} faces", table::map(map, name), map.verdict.as_str(), map.faces))?;
    ui.value(&Written { file: file.clone(), message: map })?;
    is_enough(require, Outcome { verdict: map.verdict, inspired: map.inspired, reasons: &map.reasons }, file)
}

/// Tells how good a result is: the lines at its top.
pub(super) struct Outcome<'a> {
    pub(super) verdict: Verdict,
    pub(super) inspired: f64,
    pub(super) reasons: &'a [String],
}

/// Refuses, once all is written and printed, what is broken or less than is required.
pub(super) fn is_enough(require: Option<Require>, of: Outcome<'_>, file: String) -> Result<(), ClientError> {
    if of.verdict == Verdict::Broken {
        return Err(ClientError::Broken { file, reasons: of.reasons.join("; ") });
    }
    let Some(require) = require.filter(|require| !require.is_met(of.verdict, of.inspired)) else { return Ok(()) };
    let percent = format!("{:.0}", 100.0 * of.inspired);
    Err(ClientError::Below { required: require.as_str(), verdict: of.verdict.as_str(), percent, file })
}

pub(super) async fn constrain(args: ConstrainArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    args.out.check()?;
    let set = args.set.into_iter().map(|spec| spec.0).collect();
    let edit = ConstraintEdit { set, remove: args.remove, undo: args.undo, on_fold: args.on_fold };
    let query = names::query(&args.query, api, state).await?;
    let map = api.edit_constraints(query, names::map(query, &args.map, api).await?, &edit).await?;
    write_map(&map, None, &args.out, None, api, ui).await
}
